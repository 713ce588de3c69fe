"""The numbers on docs/atlas.md are those of docs/atlas.json and of the table in the package; and how errors and limits are computed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scaling
from atlas_parts import maps, page
from atlas_parts.errors import crossing, errors, norm, reference
from atlas_parts.fluids import FLUIDS, methods
from atlas_parts.sampling import BINS, Series, histogram, slope
from atlas_parts.store import Store, key
from atlas_parts.summary import merged, short

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "atlas.md").read_text(encoding="utf-8")
ATLAS = ROOT / "docs" / "atlas.json"


# -- the page --------------------------------------------------------------------------------------------------------------------
def test_tables_of_the_atlas_are_those_of_its_json():
    if not ATLAS.exists():
        pytest.skip("docs/atlas.json is not there yet: python benchmarks/atlas.py makes it")
    texts = page.blocks(json.loads(ATLAS.read_text(encoding="utf-8")))
    shown = {name: page.block_of(PAGE, name) for name in texts if f"<!-- begin {name} -->" in PAGE}
    assert {"targets", "limits-weak", "reference"} <= set(shown)
    for name, text in shown.items():
        assert text == texts[name].strip(), name


def test_tables_of_the_stability_map_are_those_of_the_package():
    texts = maps.blocks(json.loads((ROOT / "openmm_dpd" / "data" / "stability.json").read_text(encoding="utf-8")))
    for name, text in texts.items():
        assert page.block_of(PAGE, name) == text.strip(), name


def test_the_table_of_sizes_is_that_of_its_json():
    data = json.loads((ROOT / "docs" / "scaling.json").read_text(encoding="utf-8"))
    assert page.block_of(PAGE, "scaling") == scaling.text(data)


def test_pictures_of_the_page_exist():
    for figure in re.findall(r"!\[.*?\]\((figures/.*?)\)", PAGE):
        made_by_atlas = figure.startswith("figures/atlas_")
        assert (ROOT / "docs" / figure).exists() or (made_by_atlas and not ATLAS.exists()), figure


def test_a_block_is_replaced_and_nothing_else():
    text = "a\n<!-- begin x -->\nold\n<!-- end x -->\nb\n<!-- begin y -->\nkept\n<!-- end y -->\n"
    new = page.replaced(text, "x", "new | 1 \\d")
    assert page.block_of(new, "x") == "new | 1 \\d" and page.block_of(new, "y") == "kept"
    assert page.replaced(new, "x", "old").replace("\n\n", "\n") == text


# -- limits ----------------------------------------------------------------------------------------------------------------------
def test_crossing_of_a_power_law_is_exact():
    dts = [0.01, 0.02, 0.05, 0.1]
    found = crossing(dts, [[4.0 * dt**2, 1e-9] for dt in dts], 0.01)
    assert found["dt"] == pytest.approx(0.05) and found["sem"] < 1e-6


def test_error_of_a_crossing_follows_the_errors():
    """d(dt)/dt = (1/2) d(error)/error: 10 % of the error is 5 % of the step; two points share it."""
    dts = [0.02, 0.04, 0.08]
    found = crossing(dts, [[4.0 * dt**2, 0.4 * dt**2] for dt in dts], 0.01, 2000)
    assert found["dt"] == pytest.approx(0.05)
    assert 0.02 < found["sem"] / found["dt"] < 0.06


def test_crossings_that_are_not_there():
    assert crossing([0.1, 0.2], [[0.001, 1e-4], [-0.002, 1e-4]], 0.01) == {"at_least": pytest.approx(0.2)}
    assert crossing([0.1, 0.2], [[0.02, 1e-4], [-0.03, 1e-4]], 0.01) == {"at_most": pytest.approx(0.1)}


def test_noise_at_small_steps_is_no_crossing():
    """1.5 % with a standard error of 1 % at the smallest step."""
    found = crossing([0.01, 0.02, 0.04, 0.08], [[0.015, 0.01], [0.002, 0.001], [0.005, 0.0005], [0.02, 0.0005]], 0.01)
    assert found["dt"] == pytest.approx(0.0566, rel=0.01)


def test_g_norm_takes_noise_off():
    """Blocks with noise alone: the norm is 0 within its error; with a known difference it is that difference."""
    rng = np.random.default_rng(1)
    shape = 1 + 0.3 * np.sin(np.arange(BINS) / 3)
    blocks, ref = (shape + 0.01 * rng.normal(size=(n, BINS)) for n in (10, 40))
    size, sem = norm(blocks, ref)
    assert size < 4 * sem and sem < 0.01
    size, sem = norm(1.05 * shape + 0.01 * rng.normal(size=(10, BINS)), ref)
    assert size == pytest.approx(0.05, abs=4 * sem) and sem < 0.01


def test_potential_energy_counts_as_a_temperature():
    """0.009 higher, at a slope of 0.9 per kT: 1 %."""
    ref = {"U": (4.543, 0.0)}
    result = {"kT": 1.0, "U": [4.552, 0.0009], "T_conf": [1.02, 0.001], "T_kin": [0.99, 0.002]}
    found = errors(result, ref, (0.9, 0.01), conserves=False)
    assert found["U"] == [pytest.approx(0.01), pytest.approx(0.001)]
    assert found["T_conf"] == [pytest.approx(0.02), pytest.approx(0.001)]
    assert errors({"failed": "x"}, ref, None, False) == {}


def test_references_are_weighted_means():
    runs = [{"U": [1.0, 0.1], "P": [3.0, 1.0]}, {"U": [2.0, 0.2], "P": [4.0, 1.0]}, {"failed": "x"}]
    found = reference(runs)
    assert found["U"][0] == pytest.approx(1.2) and found["P"] == (pytest.approx(3.5), pytest.approx(0.5**0.5))


# -- samples ---------------------------------------------------------------------------------------------------------------------
def test_histogram_counts_pairs_by_minimum_image():
    edges = np.array([4.0, 5.0, 6.0])
    x = np.random.default_rng(2).random((40, 3)) * edges * 3 - edges
    d = x[:, None] - x[None]
    d -= edges * np.rint(d / edges)
    r = np.sqrt((d**2).sum(axis=2))[np.triu_indices(40, 1)]
    expected = np.histogram(r, bins=BINS, range=(0, 2.0))[0]
    assert np.array_equal(histogram(x, edges, 0.05, BINS), expected)


def test_diffusion_of_a_random_walk():
    """Steps of variance 2 D t along each axis, in a periodic box: D = 0.3 within four standard errors."""
    rng = np.random.default_rng(3)
    edges, x = np.array([5.0] * 3), np.zeros((200, 3))
    series = Series(edges, 1.0)
    for _ in range(300):
        x = x + rng.normal(size=x.shape) * (2 * 0.3 * 0.2) ** 0.5
        folded = x % edges
        step = folded - (series._last if series._last is not None else folded)
        series._unwrapped = folded.copy() if series._last is None else series._unwrapped + step - edges * np.rint(step / edges)
        series._last = folded
        series.paths.append(series._unwrapped.astype(np.float32))
    value, sem = series.diffusion(0.2, (4.0, 8.0))
    assert abs(value - 0.3) < 4 * sem and sem < 0.02


def test_slope_of_a_line():
    t = np.arange(100.0)
    value, sem = slope(t, 5.0 * (1 + 1e-5 * t))
    assert value == pytest.approx(1e-5) and sem < 1e-12


# -- jobs ------------------------------------------------------------------------------------------------------------------------
def test_runs_with_several_seeds_count_once():
    """Drifts with their spread, temperatures weighted by their errors; a step at which one run fails fails."""
    run = {"method": "middle", "dt": 0.1, "T_kin": [2.0, 0.1], "theta": [2.0, 0.1], "drift": [1e-7, 1e-9]}
    other = run | {"drift": [3e-7, 1e-9], "T_kin": [2.3, 0.2]}
    (one,) = merged([run, other])
    assert one["drift"] == pytest.approx([2e-7, 1e-7]) and one["T_kin"][0] == pytest.approx((2.0 * 4 + 2.3) / 5)
    first, second = merged([run, other | {"failed": "too long"}, run | {"dt": 0.05}])
    assert first == run | {"dt": 0.05} and second["failed"] == "1 of 2 runs: too long"


def test_a_store_goes_on_where_it_stopped(tmp_path):
    """Also after a line that was cut off, and whatever a report added."""
    job = {"fluid": "weak", "dt": 0.02}
    store = Store(tmp_path / "results.jsonl")
    store.add(job | {"U": [1.0, 0.1], "seconds": 3})
    with store.file.open("a") as file:
        file.write('{"fluid": "we')
    again = Store(store.file)
    assert job in again and again.get(job)["U"] == [1.0, 0.1] and {"fluid": "weak", "dt": 0.03} not in again
    assert key(job) == key(job | {"failed": "x"})


def test_every_scheme_and_peer_is_in_the_atlas():
    names = [m.name for m in methods("weak")]
    assert {"mvv", "shardlow", "middle", "aboba", "LAMMPS dpd + nve", "LAMMPS dpd/fdt + shardlow", "OpenMM DPDIntegrator, CPU"} <= set(
        names
    )
    assert "LAMMPS dpd/ext + nve" in [m.name for m in methods("transverse")]
    for name, fluid in FLUIDS.items():
        for method in methods(name):
            assert len(fluid.dts(method, quick=True)) < len(fluid.dts(method, quick=method.slow)) or method.slow


def test_numbers_are_short():
    assert short(0.123456789) == 0.1235 and short(np.nan) is None and short(None) is None
