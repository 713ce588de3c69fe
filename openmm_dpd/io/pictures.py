"""Plot of a run: temperature, pressure and energies against time, drawn with matplotlib but without its global state."""

import io
import os
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..base.errors import ParameterError, require, what_is
from ..base.files import write_whole

#: Panels from top to bottom: label of the axis, and the columns drawn there with their labels, the first one in front.
PANELS = (
    ("temperature", {"temp": "kinetic", "temp_conf": "configurational"}),
    ("pressure", {"press": "as in the thermo output", "press_full": "with friction"}),
    ("potential energy", {"pe": "potential energy"}),
    ("total energy", {"etotal": "total energy"}),
)

#: Colours (dark for means, light for rows) that colour-blind readers can tell apart.
COLOURS = (("#1f5a99", "#a9c6e3"), ("#b3541e", "#efc9ae"))
#: Pixels per inch of all pictures.
DPI = 150
#: Fewest rows of a run with a mean: three windows.
LEAST_ROWS = 15
#: Legends of lines with and without means, and of the shading.
MEANS = f"light: rows of the thermo output; dark: mean over a tenth of the run, in runs of {LEAST_ROWS} to 50 rows over 5 rows"
ROWS, NEW_RUN = "rows of the thermo output (too few for means)", "dotted: a new run begins"
LEFT_OUT = "grey: left out of averages, and of the range of the axes"
#: Most rows to draw; of longer series, only every n-th row is shown.
MOST_ROWS = 20_000


def thermo_picture(
    path: str | os.PathLike,
    columns: Mapping[str, Sequence[float] | np.ndarray],
    *,
    x: str = "time",
    runs: Sequence[float] = (),
    target: float | Sequence[float] | np.ndarray | None = None,
    counted: Sequence[bool] | np.ndarray | None = None,
    labels: Mapping[str, str] | None = None,
    title: str = "",
) -> None:
    """Plot thermo columns, given by their words, against one of them, ``x``, to a PNG file.

    The columns are ``temp``, ``temp_conf``, ``press``, ``press_full``, ``pe`` and ``etotal``; panels without a column are left out, and a
    NaN is a gap. Rows are light lines (with dots if they are few); sliding means (over a tenth of a run, at least 5 rows) are dark lines,
    in runs of 15 rows or more. Without such a run, rows are dark. A line at the foot explains this.

    At ``runs``, the values of x where a new run begins, there is a thin line that means do not cross; x must not go back then. ``target``
    is the set temperature, one number or one per row, NaN where nothing sets it. ``counted`` marks the rows that averages are taken over:
    in each run, all after some row. Earlier rows are shaded, have no mean, and may leave the plot, as the axes have the range of the
    counted ones. ``labels`` are units by names of panels and of the column x.

    ParameterError if there is nothing to plot, or columns are not numeric, differ in length, or go back; OutputError if the file cannot
    be written.
    """
    require(columns, Mapping, "expected a mapping of words to rows")
    data = {word: _numbers(values, f"the column {what_is(word)}") for word, values in columns.items()}
    _check(data, x)
    panels = _panels(data)
    level = _level(target, len(data[x]))
    labels = labels or {}
    spans = _spans(data[x], runs)
    mask = np.ones(len(data[x]), bool) if counted is None else np.asarray(counted, bool)
    if mask.shape != data[x].shape:
        raise ParameterError(f"counted has the shape {mask.shape}; it must have one entry for each of the {len(data[x])} rows")
    left_out = [slice(span.start, span.start + int(np.sum(~mask[span]))) for span in spans]
    begins = [data[x][[rows.start, min(rows.stop, len(data[x]) - 1)]] for rows in left_out]
    grey = [(begin, end - begin) for begin, end in begins]
    means = any(span.stop - rows.stop >= LEAST_ROWS for span, rows in zip(spans, left_out, strict=True))
    figure = new_figure(8.0, 0.9 + 1.9 * len(panels))
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (name, words) in zip(axes, panels, strict=True):
        for number, (word, label) in enumerate(words.items()):
            # the first column in front
            dark, light = COLOURS[number]
            _draw(axis, data[x], data[word], spans, left_out, label, (dark, light if means else dark), 3 - number)
        set_level = name == "temperature" and level is not None and bool(np.isfinite(level).any())
        if set_level:
            axis.plot(data[x], level, color="black", linewidth=1.2, linestyle=(0, (5, 3)), label="set", zorder=3.9)
        upright: dict[str, Any] = {"transform": axis.get_xaxis_transform(), "zorder": 0}
        axis.vlines(runs, 0.0, 1.0, color="0.6", linewidth=0.8, linestyle=":", **upright)
        axis.broken_barh(grey, (0.0, 1.0), color="0.93", linewidth=0, **upright)
        finish_axis(axis, with_unit(name, labels.get(name), "\n"), legend=len(words) > 1 or set_level)
        if not mask.all():
            _scale(axis, [data[word][mask] for word in words] + ([level[mask]] if level is not None and set_level else []))
    figure.align_ylabels(axes)
    axes[-1].set_xlabel(with_unit(x, labels.get(x)), fontsize=11)
    said = "; ".join([NEW_RUN] * (len(spans) > 1) + [LEFT_OUT] * (not mask.all()))
    figure.supxlabel(f"{MEANS if means else ROWS}\n{said}".rstrip(), fontsize=9, color="0.35")
    if title:
        figure.suptitle(title, fontsize=12)
    write_picture(path, figure)


#: Figures are drawn one at a time, and a fork waits: matplotlib has one lock, which a child forked meanwhile would wait for forever.
_DRAWING = threading.RLock()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_DRAWING.acquire, after_in_parent=_DRAWING.release, after_in_child=_DRAWING.release)


def new_figure(width: float, height: float) -> Any:
    """A matplotlib figure of this size in inches, outside of matplotlib's global state."""
    with _DRAWING:  # a child forked while a module is imported would wait for it forever
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def write_picture(path: str | os.PathLike, figure: Any) -> None:
    """Write a matplotlib figure as a PNG file; OutputError if that fails."""
    picture = io.BytesIO()
    with _DRAWING:
        figure.savefig(picture, format="png", pil_kwargs={"compress_level": 1})  # the default takes as long as the drawing
    write_whole(path, picture.getvalue(), "the picture")


def write_pixels(path: str | os.PathLike, colours: np.ndarray) -> None:
    """Write (H, W, 3) red, green and blue from 0 to 1 as a PNG file; OutputError if that fails."""
    picture = io.BytesIO()
    with _DRAWING:
        from matplotlib.image import imsave

        imsave(picture, np.clip(colours, 0.0, 1.0), format="png")
    write_whole(path, picture.getvalue(), "the picture")


def _numbers(values: Any, name: str) -> np.ndarray:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError(f"{name} must be numbers, not {what_is(values)}") from None


def _check(data: Mapping[str, np.ndarray], x: str) -> None:
    """Raise ParameterError if there is no column x, it has no rows, or columns differ in length."""
    if x not in data:
        raise ParameterError(f"there is no column {what_is(x)} to draw against; there are {', '.join(data) or 'none'}")
    rows = data[x].shape
    if len(rows) != 1 or rows[0] == 0:
        raise ParameterError(f"there are no rows to draw: the column {what_is(x)} has the shape {rows}")
    for word, values in data.items():
        if values.shape != rows:
            raise ParameterError(f"the column {what_is(word)} has the shape {values.shape}, but {what_is(x)} has {rows}")


def _panels(data: Mapping[str, np.ndarray]) -> list[tuple[str, dict[str, str]]]:
    """Panels with at least one column, each with its columns and their labels."""
    panels = [(name, {word: label for word, label in words.items() if word in data}) for name, words in PANELS]
    if not any(words for _, words in panels):
        raise ParameterError(f"nothing to draw: none of {', '.join(word for _, words in PANELS for word in words)} is among the columns")
    return [(name, words) for name, words in panels if words]


def _level(target: float | Sequence[float] | np.ndarray | None, rows: int) -> np.ndarray | None:
    """Target temperature of each row, (rows,), or None."""
    if target is None:
        return None
    level = _numbers(target, "target")
    if level.shape not in ((), (rows,)):
        raise ParameterError(f"target has the shape {level.shape}; it must be one number or one for each of the {rows} rows")
    return np.broadcast_to(level, (rows,))


def _spans(x: np.ndarray, runs: Sequence[float]) -> list[slice]:
    """Rows of each run.  If two rows are at the x where the next run begins, the first of them belongs to the run before."""
    if len(runs) and np.any(np.diff(x) < 0):
        row = int(np.argmax(np.diff(x) < 0)) + 1
        raise ParameterError(
            f"several runs cannot be plotted against a column that goes back (from {x[row - 1]:g} to {x[row]:g} in row {row})"
        )
    edges = [0]
    for start in sorted(runs):
        first, behind = int(np.searchsorted(x, start, side="left")), int(np.searchsorted(x, start, side="right"))
        edge = first + 1 if behind - first > 1 else first
        if edges[-1] < edge < len(x):
            edges.append(edge)
    return [slice(start, stop) for start, stop in zip(edges, [*edges[1:], len(x)], strict=True)]


def _sliding_mean(values: np.ndarray, window: int) -> np.ndarray:
    """Mean over the ``window`` rows around each row, or fewer near the ends; NaN rows do not count."""
    good = np.isfinite(values)
    total = np.concatenate([[0.0], np.cumsum(np.where(good, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(good)])
    row = np.arange(len(values))
    low, high = np.maximum(row - window // 2, 0), np.minimum(row + window // 2 + 1, len(values))
    rows = count[high] - count[low]
    return np.divide(total[high] - total[low], rows, out=np.full(len(values), np.nan), where=rows > 0)


def _scale(axis: Any, counted: list[np.ndarray]) -> None:
    """Set the range of an axis to that of the counted rows."""
    values = np.concatenate(counted)
    values = values[np.isfinite(values)]
    if np.ptp(values) if len(values) else 0:
        margin = 0.12 * np.ptp(values)
        axis.set_ylim(values.min() - margin, values.max() + margin)


def _with_gaps(lines: list[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """x and y of lines as those of one line with gaps: among hundreds of runs, each line would take longer than its run."""
    gaps = ([np.append(values, np.nan) for values in each] for each in zip(*lines, strict=True))
    return [np.concatenate(values)[:-1] for values in gaps]


def _draw(axis: Any, x: np.ndarray, values: np.ndarray, spans: list[slice], left_out: list[slice], label: str, colours, depth: int) -> None:
    """Draw one column: rows light (as dots if they are few), sliding means of the counted rows dark."""
    dark, light = colours
    few = all(span.stop - span.start <= 60 for span in spans)
    rows, means = [], []
    for span, start in zip(spans, (rows.stop for rows in left_out), strict=True):
        step = max(1, (span.stop - span.start) // MOST_ROWS)
        rows += [(x[span][::step], values[span][::step])]
        if span.stop - start >= LEAST_ROWS:
            mean = _sliding_mean(values[start : span.stop], max(5, (span.stop - span.start) // 10))
            means += [(x[start : span.stop : step], mean[::step])]
    style = {"marker": "o" if few else None, "markersize": 3.5, "zorder": depth}
    drawn = axis.plot(*_with_gaps(rows), color=light, linewidth=0.9, **style)
    if means:
        above = axis.plot(*_with_gaps(means), color=dark, linewidth=1.7, zorder=depth + 3)
    named = above[0] if means else drawn[0]
    named.set_label(label)


def finish_axis(axis: Any, name: str, legend: bool) -> None:
    """Add label, grid and frame to a panel, and its legend above it."""
    axis.set_ylabel(name, fontsize=11)
    axis.tick_params(labelsize=10)
    axis.grid(color="0.92", linewidth=0.7)
    axis.set_axisbelow(True)
    axis.margins(x=0.01, y=0.12)
    # an offset such as "+1.234e5" above an axis is easily overlooked
    if axis.get_yscale() == "linear":
        axis.ticklabel_format(axis="y", useOffset=False)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    if legend:
        handles, texts = axis.get_legend_handles_labels()
        order = sorted(range(len(texts)), key=lambda k: -handles[k].get_zorder())
        # above the panel, where it covers no line
        place = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.98), "borderaxespad": 0.0, "ncols": len(order)}
        axis.legend([handles[k] for k in order], [texts[k] for k in order], fontsize=9.5, frameon=False, **place)


def with_unit(name: str, unit: str | None, separator: str = " ") -> str:
    """Label of an axis: its name, with the unit in brackets if there is one."""
    return f"{name}{separator}[{unit}]" if unit else name
