"""Pages of measured steps: the numbers on docs/atlas.md, how errors and limits are computed, and what the script of the stability map measures again."""

import copy
import json
import re
from pathlib import Path

import chain_speed
import equal_error
import many_body
import numpy as np
import orders
import pytest
import scaling
import stability
import transport
from atlas_parts import headline, maps, page
from atlas_parts.errors import crossing, norm
from atlas_parts.fluids import FLUIDS, methods
from atlas_parts.sampling import BINS, Series
from atlas_parts.store import Store, key

from openmm_dpd.advice.stability_table import StabilityTable

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "atlas.md").read_text(encoding="utf-8")
SCHEMES = (ROOT / "docs" / "schemes.md").read_text(encoding="utf-8")
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


def test_tables_that_come_with_the_package():
    texts = maps.blocks(json.loads((ROOT / "openmm_dpd" / "advice" / "stability.json").read_text(encoding="utf-8")))
    for name, text in texts.items():
        assert page.block_of(PAGE, name) == text.strip(), name
    assert page.block_of(PAGE, "transport") == transport.blocks(json.loads(transport.FILE.read_text(encoding="utf-8")))["transport"]
    assert page.block_of(SCHEMES, "many-body") == many_body.blocks(json.loads(many_body.FILE.read_text(encoding="utf-8")))["many-body"]


def test_tables_of_orders_are_those_of_their_json():
    results = json.loads((ROOT / "docs" / "orders.json").read_text(encoding="utf-8"))
    atlas = json.loads(ATLAS.read_text(encoding="utf-8"))
    texts = [(orders.table(results, gamma, atlas), orders.published(results, gamma)) for gamma in orders.FRICTIONS]
    shown = page.block_of(PAGE, "orders"), page.block_of(SCHEMES, "published")
    assert shown == tuple(map("\n\n".join, zip(*texts, strict=True)))


def test_tables_of_sizes_and_chains_are_those_of_their_json():
    data = json.loads((ROOT / "docs" / "scaling.json").read_text(encoding="utf-8"))
    assert page.block_of(PAGE, "scaling") == scaling.text(data)
    chains = json.loads((ROOT / "docs" / "scaling.json").read_text(encoding="utf-8"))["chains"]
    assert page.block_of(PAGE, "chains") == chain_speed.text(chains)


def test_tables_of_other_kinds_are_those_of_their_json():
    for name, text in equal_error.blocks(json.loads((ROOT / "docs" / "kinds.json").read_text(encoding="utf-8"))).items():
        assert page.block_of(PAGE, name) == text, name
    for row in page.block_of(PAGE, "kinds-gains").splitlines()[2:]:
        kind, one, two = (cell.strip() for cell in row.split("|")[1:4])
        assert f"{kind} {one} / {two}" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_speeds_on_the_page_in_readme_and_paper_are_those_of_the_files():
    """Every ratio; README says of what versions they are.  Twice as fast per bead here, four times there: half the ratio."""
    of, readme = headline.load(), (ROOT / "README.md").read_text(encoding="utf-8")
    sizes = headline.sizes(of)
    assert page.block_of(PAGE, "gains") == headline.gains(of) and page.block_of(PAGE, "sizes") == sizes
    assert page.block_of(PAGE, "headline") == headline.short(of, long=True) and f"\n\n{headline.short(of)}\n\n" in readme
    assert f"\n\n{sizes}\n\n" in (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
    for name, version in ("LAMMPS", of.scaling["machine"]["lammps"]), ("OpenMM", of.scaling["machine"]["openmm"]):
        assert f"{name} {version}" in readme.partition("**Speed.**")[2]
    of = headline.load()
    ms = {name: of.ms("weak", name, "1", of.scaling["steps"][name]) for name in ("bab3", "LAMMPS dpd + nve")}
    row = {"ns": {"bab3": {"1": ms["bab3"] / 2}, "LAMMPS dpd + nve": {"1": ms["LAMMPS dpd + nve"] / 4}}}
    assert of.change(row, "bab3", "LAMMPS dpd + nve", "1") == pytest.approx(0.5)


def test_pictures_of_the_page_exist():
    for figure in re.findall(r"!\[.*?\]\((figures/.*?)\)", PAGE):
        made_by_atlas = figure.startswith("figures/atlas_")
        assert (ROOT / "docs" / figure).exists() or (made_by_atlas and not ATLAS.exists()), figure


# -- limits ----------------------------------------------------------------------------------------------------------------------
def test_crossing_of_a_power_law_is_exact():
    dts = [0.01, 0.02, 0.05, 0.1]
    found = crossing(dts, [[4.0 * dt**2, 1e-9] for dt in dts], 0.01)
    assert found["dt"] == pytest.approx(0.05) and found["sem"] < 1e-6


def test_g_norm_takes_noise_off():
    """Blocks with noise alone: the norm is 0 within its error; with a known difference it is that difference."""
    rng = np.random.default_rng(1)
    shape = 1 + 0.3 * np.sin(np.arange(BINS) / 3)
    blocks, ref = (shape + 0.01 * rng.normal(size=(n, BINS)) for n in (10, 40))
    size, sem = norm(blocks, ref)
    assert size < 4 * sem and sem < 0.01
    size, sem = norm(1.05 * shape + 0.01 * rng.normal(size=(10, BINS)), ref)
    assert size == pytest.approx(0.05, abs=4 * sem) and sem < 0.01


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


# -- jobs ------------------------------------------------------------------------------------------------------------------------
def test_a_store_goes_on_where_it_stopped(tmp_path):
    """Also after a line that was cut off, and with anything that a report added."""
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
    lammps = {"LAMMPS dpd + nve", "LAMMPS dpd/fdt + shardlow"}
    assert {"mvv", "shardlow", "middle", "aboba", *lammps, "OpenMM DPDIntegrator, CPU"} <= set(names)
    assert "LAMMPS dpd/ext + nve" in [m.name for m in methods("transverse")]
    for name, fluid in FLUIDS.items():
        for method in methods(name):
            assert len(fluid.dts(method, quick=True)) < len(fluid.dts(method, quick=method.slow)) or method.slow


def smooth() -> dict:
    """Steps that go as 1/omega, known to a tenth."""
    points = [stability.BASE | {"gamma": g, "a": a, "schemes": {}} for g in (0.5, 4.5, 40.5, 450.0) for a in (6.0, 25.0, 50.0, 100.0)]
    for p in points:
        dt = 0.2 * p["a"] ** -0.5
        levels = {name: [k * dt, 0.1 * k * dt, ""] for name, k in (("1", 1), ("5", 2), ("10", 3))}
        entry = {"blow": [4 * dt, 0.0, ""], "sign": {"conf": 1, "kin": 1}, "conf": levels, "kin": levels}
        p["schemes"] = {"middle": copy.deepcopy(entry), "bababo": copy.deepcopy(entry)}
    return {"loose": 4.0, "base": stability.BASE, "cost": {"middle": 1.2, "bababo": 1.4}, "points": points}


def entry(data: dict, gamma: float, a: float, scheme: str) -> dict:
    return next(p for p in data["points"] if (p["gamma"], p["a"]) == (gamma, a))["schemes"][scheme]


def test_nothing_of_a_smooth_table_is_noisy():
    assert stability.noisy(StabilityTable(smooth())) == []


@pytest.mark.parametrize("change", ["three times too long", "three times too short", "badly known"])
@pytest.mark.parametrize("kind", ["conf", "kin"])
def test_a_point_off_its_neighbours_or_badly_known_is_noisy(change, kind):
    data = smooth()
    step = entry(data, 4.5, 25.0, "bababo")[kind]["1"]
    step[0] *= {"three times too long": 3, "three times too short": 1 / 3}.get(change, 1)
    step[1] *= 4 if change == "badly known" else 1
    assert stability.noisy(StabilityTable(data)) == [("bababo", stability.BASE)]


def test_what_was_not_measured_again_stays():
    """Errors of (dt/0.1)^2 % at one point: the step of 1 % is 0.1 there, and nothing else changes."""
    before = smooth()
    ladder = [[dt, [dt**2, 0.001], [dt**2, 0.001]] for dt in (0.05, 0.07, 0.1, 0.14, 0.2, 0.25)] + [[0.5, None, None]]

    class Measured:
        results = {"job": {"point": stability.BASE, "scheme": "middle", "loose": 1.0, "ladder": ladder, "levels": {"blow": [0.4, 0.01, ""], "sign": {"conf": 1, "kin": 1}}}}  # fmt: skip

    after = stability.tabulate(Measured(), before["cost"], before)
    assert entry(after, 4.5, 25.0, "middle")["conf"]["1"][0] == pytest.approx(0.1, rel=0.1)
    assert entry(after, 4.5, 25.0, "middle")["blow"] == [0.4, 0.01, ""]
    assert entry(after, 4.5, 25.0, "bababo") == entry(before, 4.5, 25.0, "bababo")
    others = [p for p in before["points"] if (p["gamma"], p["a"]) != (4.5, 25.0)]
    assert [p for p in after["points"] if (p["gamma"], p["a"]) != (4.5, 25.0)] == sorted(others, key=lambda p: (p["gamma"], p["a"]))
