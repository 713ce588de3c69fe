"""The example decks with internal energy, heat, species and many-body terms, run unchanged, against LAMMPS (energy_reference.json)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from openmm_dpd.lammps.main import run_deck
from openmm_dpd.lammps.run import RunOptions

HERE = Path(__file__).parent
DECKS = HERE.parents[1] / "examples" / "decks"
REFERENCE = json.loads((HERE / "energy_reference.json").read_text())["decks"]


def run(deck, out, variables=None, **options):
    return run_deck(DECKS / deck, RunOptions(threads=1, **options), variables=variables or {}, out=out)


@pytest.mark.parametrize("deck", REFERENCE)
def test_first_row(deck, tmp_path):
    """Every number of the first row that no random number enters, to the digits of the platform.

    Positions and velocities drawn by ``create_atoms random`` and ``velocity create`` are not LAMMPS's: those decks are compared where the
    positions are a lattice or a file, and for the temperature.
    """
    reference = REFERENCE[deck]
    thermo = run(deck, tmp_path, platform="Reference", steps=0)["runs"][0]["thermo"]
    words = [word for word in reference["first_deterministic"] if word in thermo]
    assert len(words) >= 3
    for word in words:
        assert thermo[word]["first"] == pytest.approx(reference["first"][word], rel=1e-9, abs=1e-12), word


def students_t(values: np.ndarray, reference: dict, n: int) -> float:
    """Difference of two means over its standard error, both spreads pooled; ``n`` replicates of the reference."""
    m = len(values)
    pooled = ((m - 1) * values.var(ddof=1) + (n - 1) * reference["sd"] ** 2) / (m + n - 2)
    return float((values.mean() - reference["mean"]) / np.sqrt(pooled * (1 / m + 1 / n)))


#: deck -> step of the comparison, replicates here and in LAMMPS, words
REPLICATES = {
    "in.dpde-vv": (200, 6, 12, ("temp", "press", "pe", "c_inner[2]", "c_inner[4]")),
    "in.dpde-table": (200, 6, 12, ("temp", "press", "pe", "c_inner[4]", "c_innerl[4]", "c_innerr[4]")),
    "in.mdpd": (100, 5, 3, ("temp", "press", "pe")),
}


@pytest.mark.parametrize("deck", REPLICATES)
def test_the_way_to_equilibrium(deck, tmp_path):
    """Means over replicates at a step on the way, where everything still moves; |t| < 6 (p of about 1e-4 at 6 to 16 degrees of freedom)."""
    step, here, there, words = REPLICATES[deck]
    reference = REFERENCE[deck]["replicates"]["steps"][str(step)]
    rows = []
    for k in range(here):
        variables = {"nrun": str(step), "every": str(step), "seed": str(501 + k), "vseed": str(77 + k)}
        thermo = run(deck, tmp_path, variables, platform="CPU", steps=step)["thermo"]
        rows.append([thermo[word]["last"] for word in words])
    t = {word: round(students_t(column, reference[word], there), 2) for word, column in zip(words, np.array(rows).T, strict=True)}
    print(deck, t)
    assert max(map(abs, t.values())) < 6, t


@pytest.mark.parametrize("deck", ["in.dpdp-shardlow", "in.dpdh-shardlow"])
def test_decks_at_no_pressure_run(deck, tmp_path):
    """Repulsive beads at P = 0 only expand; with conserved energy the enthalpy, which is the energy here, stays what it is."""
    report = run(deck, tmp_path, {"every": "50"}, platform="CPU", steps=200)
    thermo = report["thermo"]
    assert thermo["vol"]["last"] > thermo["vol"]["first"]
    if deck == "in.dpdh-shardlow":
        assert thermo["v_energy"]["last"] == pytest.approx(thermo["v_energy"]["first"], rel=3e-6)
