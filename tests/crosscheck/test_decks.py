"""The example decks, run unchanged, against LAMMPS run on the same decks (lammps_reference.json, made by make_lammps_reference.py)."""

import json
from pathlib import Path

import numpy as np
import pytest
from judged import any_seed

from openmm_dpd.lammps import RunOptions, run_deck

HERE = Path(__file__).parent
DECKS = HERE.parents[1] / "examples" / "decks"
REFERENCE = json.loads((HERE / "lammps_reference.json").read_text())["decks"]

# deck -> steps of the production run.  The first group is long enough for standard errors of 0.3 % (temperature) and 0.2 % (energy); the
# others mix slowly, and would need hours here: docs/validation.md has long runs of them.
LONG = {"in.dpd": 180_000, "in.dpdext": 30_000, "in.bonded": 20_000, "in.triclinic": 20_000, "in.dpd_tstat": 36_000}
LONG["in.dpdext_tstat"] = 25_000
SHORT = {"in.dpd-vv": 40_000, "in.dpd-shardlow": 20_000, "in.srp": 10_000}
PRODUCTION = LONG | SHORT

#: Marked long: their total energy wanders for a thousand steps at a time, and short runs do not know their own errors.
HOURS = ("in.dpd_tstat", "in.dpdext_tstat")

#: First rows do not depend on velocities or noise where positions come from a data file.
FIXED_POSITIONS = ("in.dpd-vv", "in.dpd-shardlow", "in.dpdext_tstat", "in.bonded", "in.ramp", "in.triclinic", "in.srp")


@pytest.mark.parametrize("deck", FIXED_POSITIONS)
def test_first_row(deck, tmp_path):
    """Potential energy of the first configuration to the digits of the platform: exact pair terms, LAMMPS's constants."""
    report = run_deck(DECKS / deck, RunOptions(platform="Reference", steps=0, threads=1), out=tmp_path)
    mine, theirs = report["runs"][0]["thermo"]["pe"]["first"], REFERENCE[deck]["first"]["pe_per_bead"]
    if not REFERENCE[deck]["norm"]:
        mine /= report["natoms"]
    # tables are splines here and there, through the same points but not the same spline
    assert mine == pytest.approx(theirs, rel=1e-6 if deck == "in.dpdext_tstat" else 1e-11)


def test_first_row_shardlow_pressure(tmp_path):
    """Fix shardlow keeps noise out of the pressure, so the first row's is deterministic."""
    report = run_deck(DECKS / "in.dpd-shardlow", RunOptions(platform="Reference", steps=0, threads=1), out=tmp_path)
    first = REFERENCE["in.dpd-shardlow"]["first"]
    for word in ("press", "temp", "ke"):
        assert report["runs"][0]["thermo"][word]["first"] == pytest.approx(first[word], rel=1e-9)


@pytest.mark.slow
@any_seed(20)
@pytest.mark.parametrize("deck", [pytest.param(deck, marks=pytest.mark.long if deck in HOURS else ()) for deck in PRODUCTION])
def test_averages(deck, tmp_path, seed):
    """Averages of T, P and PE per bead within 4 combined standard errors of LAMMPS's."""
    reference = REFERENCE[deck]["production"]
    options = RunOptions(platform="CPU", discard=reference["discard"], seed=seed)
    variables = REFERENCE[deck]["variables"] | {"nrun": str(PRODUCTION[deck])}
    thermo = run_deck(DECKS / deck, options, variables=variables, out=tmp_path)["thermo"]
    z = {}
    for word in ("temp", "press", "pe"):
        theirs = reference["quantities"][word]
        # a short run does not know its own error well; it follows from the deviation and the correlation time (in steps) of LAMMPS's long one
        error = max(thermo[word]["sem"], theirs["sd"] * np.sqrt(2 * theirs["tau"] / (PRODUCTION[deck] - reference["discard"])))
        z[word] = (thermo[word]["mean"] - theirs["mean"]) / np.hypot(error, theirs["sem"])
    print(deck, {word: (thermo[word]["mean"], thermo[word]["sem"], round(z[word], 2)) for word in z})
    precision = 1 if deck in LONG else 5
    assert thermo["temp"]["sem"] < precision * 0.003 * thermo["temp"]["mean"]
    assert thermo["pe"]["sem"] < precision * 0.002 * abs(thermo["pe"]["mean"])
    assert max(map(abs, z.values())) < 4, z
