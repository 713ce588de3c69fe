"""The picture of a run."""

import struct

import numpy as np
import pytest
from cases import cases, raises
from matplotlib.figure import Figure

from openmm_dpd.base.errors import ParameterError
from openmm_dpd.io.pictures import COLOURS, _sliding_mean, _spans, thermo_picture


def rows(count: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    levels = {"temp": 1.0, "temp_conf": 1.01, "press": 23.6, "press_full": 23.5, "pe": 4.55, "ke": 1.5, "etotal": 6.05}
    return {"time": 0.5 * np.arange(count)} | {word: level + 0.01 * rng.standard_normal(count) for word, level in levels.items()}


@pytest.fixture
def undrawn():
    """Pictures are drawn here."""


@pytest.fixture
def drawn(monkeypatch):
    """Figures that are saved while the test runs."""
    figures = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda figure, *args, **kwargs: (figures.append(figure), save(figure, *args, **kwargs)))
    return figures


def size(path) -> tuple[int, int]:
    """Width and height of a PNG file, from its first chunk."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", data[16:24])


def test_panels_labels_and_legend(tmp_path, drawn):
    units = {"temperature": "K", "pressure": "bar", "time": "ps"}
    thermo_picture(tmp_path / "run.png", rows(200), runs=[50.0], target=1.0, labels=units, title="a run")
    assert size(tmp_path / "run.png") == (1200, 1275)
    (figure,) = drawn
    assert [axis.get_ylabel() for axis in figure.axes] == ["temperature\n[K]", "pressure\n[bar]", "potential energy", "total energy"]
    assert [axis.get_xlabel() for axis in figure.axes] == ["", "", "", "time [ps]"]
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["kinetic", "configurational", "set"]
    assert len(figure.axes[1].get_legend().get_texts()) == 2
    assert figure.axes[2].get_legend() is None
    for line in figure.axes[2].lines:  # rows and mean of two runs, with a gap
        before, after = np.split(line.get_xdata(), np.flatnonzero(np.isnan(line.get_xdata())))
        assert (before[0], before[-1], after[1], after[-1]) == (0.0, 49.5, 50.0, 99.5)
    between, *_ = figure.axes[2].collections
    assert [segment.tolist() for segment in between.get_segments()] == [[[50.0, 0.0], [50.0, 1.0]]] and len(figure.axes[2].lines) == 2


@pytest.mark.parametrize(("count", "shown"), [(30, 30), (150, 150), (100_000, 20_000)])
def test_every_row_is_drawn_of_long_series_some_and_the_target_may_be_a_ramp(tmp_path, drawn, count, shown):
    step, ramp = np.arange(count), np.linspace(1.0, 2.0, count)
    thermo_picture(tmp_path / "run.png", {"step": step, "temp": np.sin(step)}, x="step", target=ramp)
    first, *_, level = drawn[0].axes[0].lines
    rows = slice(None, None, count // shown)
    assert np.array_equal(first.get_xdata(), step[rows]) and np.array_equal(first.get_ydata(), np.sin(step)[rows])
    assert np.array_equal(level.get_ydata(), ramp)


def test_runs_are_kept_apart():
    """Runs often share the step at which one ends and the next begins; only there two rows have the same x.  A mean slides."""
    assert _spans(np.array([0.0, 1.0, 2.0, 2.0, 3.0]), [2.0]) == [slice(0, 3), slice(3, 5)]
    assert _spans(np.array([0.0, 1.0, 2.0, 3.0]), [2.0]) == [slice(0, 2), slice(2, 4)]
    assert _spans(np.arange(4.0), [1.0, 3.0]) == [slice(0, 1), slice(1, 3), slice(3, 4)]
    assert _spans(np.arange(4.0), []) == _spans(np.arange(4.0), [0.0, 9.0]) == [slice(0, 4)]
    line = 3.0 * np.arange(50) - 7
    assert np.allclose(_sliding_mean(line, 11)[5:-5], line[5:-5], rtol=1e-12)
    values = np.random.default_rng(2).standard_normal(50)
    assert _sliding_mean(values, 11)[20] == pytest.approx(values[15:26].mean(), rel=1e-12)
    values[17] = np.nan
    assert _sliding_mean(values, 11)[20] == pytest.approx(np.nanmean(values[15:26]), rel=1e-12)
    assert _sliding_mean(values, 11)[[0, 1, -1]] == pytest.approx([values[:6].mean(), values[:7].mean(), values[-6:].mean()], rel=1e-12)


@cases(
    "count, options, means, said, level",
    (3, {}, 0, "rows of the thermo output (too few for means)", False),
    (14, {"runs": [3.0], "target": np.nan}, 0, "rows of the thermo output (too few for means)\ndotted: a new run begins", False),
    (20, {"target": 1.0}, 1, "light: rows of the thermo output; dark: mean over a tenth of the run, in runs of 15 to 50 rows over 5", True),
    (200, {"runs": [4.0], "target": 1.0}, 1, "in runs of 15 to 50 rows over 5 rows\ndotted: a new run begins", True),
)
def test_lines_are_explained_and_means_are_of_a_part(tmp_path, drawn, count, options, means, said, level):
    """Rows are dark where no run has a mean; nothing is said to be set where nothing is."""
    thermo_picture(tmp_path / "run.png", rows(count), **options)
    (figure,) = drawn
    first, spans = figure.axes[0], 1 + len(options.get("runs", ()))
    assert said in figure.get_supxlabel() and "grey" not in figure.get_supxlabel() and ("dotted" in figure.get_supxlabel()) == (spans > 1)
    found = {line.get_color(): 1 + np.count_nonzero(np.isnan(line.get_xdata())) for line in first.lines}
    lines = [found.get(colour, 0) for pair in COLOURS for colour in pair]
    assert lines == 2 * [means, spans] if means else 2 * [spans, 0]
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["kinetic", "configurational", "set"][: 2 + level]
    assert {line.get_marker() for line in figure.axes[2].lines[:1]} == {"None" if count > 60 else "o"}


def test_the_start_neither_scales_the_axes_nor_has_a_mean(tmp_path, drawn):
    columns, counted = rows(200), np.arange(200) >= 30
    columns["temp"][:30] += 100.0
    thermo_picture(tmp_path / "run.png", columns, counted=counted)
    (figure,) = drawn
    axis, temp, time = figure.axes[0], np.concatenate([columns[word][30:] for word in ("temp", "temp_conf")]), columns["time"]
    assert axis.get_ylim() == pytest.approx((temp.min() - 0.12 * np.ptp(temp), temp.max() + 0.12 * np.ptp(temp)))
    assert {len(line.get_xdata()) for line in axis.lines} == {200, 170}
    assert all(line.get_xdata()[0] == time[30] for line in axis.lines if len(line.get_xdata()) == 170)
    (shade,) = axis.collections[-1].get_paths()
    assert shade.get_extents().extents == pytest.approx((time[0], 0.0, time[30], 1.0)) and "grey" in figure.get_supxlabel()


@cases(
    "columns, options, message",
    ({"temp": [1.0]}, {}, "no column 'time' to draw against; there are temp"),
    (None, {}, "a mapping of words to rows, not None"),
    ({"time": [0.0], "vol": [1.0]}, {}, "nothing to draw: none of temp, "),
    ({"time": [], "temp": []}, {}, "no rows to draw"),
    ({"time": [0.0, 1.0], "temp": [1.0]}, {}, r"'temp' has the shape \(1,\)"),
    ({"time": [0.0, 2.0, 1.0], "temp": [1.0, 1.0, 1.0]}, {"runs": [1.0]}, r"goes back \(from 2 to 1 in row 2\)"),
    ({"time": [0.0, 1.0], "temp": [1.0, 1.0]}, {"target": [1.0, 1.0, 1.0]}, r"target has the shape \(3,\)"),
    ({"time": [1, 2], "temp": ["a", "b"]}, {}, "the column 'temp' must be numbers.*'a'"),
    ({"time": [1, 2], "temp": [1, 2]}, {"target": "warm"}, "target must be numbers.*'warm'"),
    ({"time": [1, 2], "temp": [1, 2]}, {"counted": [True]}, r"counted has the shape \(1,\)"),
)
def test_what_cannot_be_drawn(tmp_path, columns, options, message):
    raises(ParameterError, message, thermo_picture, tmp_path / "run.png", columns, **options)
    assert not (tmp_path / "run.png").exists()
