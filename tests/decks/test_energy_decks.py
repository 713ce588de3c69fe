"""The example decks, run unchanged, against LAMMPS run on the same decks (lammps_reference.json, energy_reference.json, pressure_reference.json)."""

import json
from pathlib import Path

import numpy as np
import pytest
from judged import any_seed
from make_energy_reference import fit_diffusivity, transient

import openmm_dpd as dpd
from openmm_dpd.lammps import RunOptions, deck_scene, run_deck
from openmm_dpd.stats import block_average
from openmm_dpd.units import METAL

HERE = Path(__file__).parent
DECKS = HERE.parents[1] / "examples" / "decks"
PRESSURE = json.loads((HERE / "pressure_reference.json").read_text())["decks"]
REFERENCE = json.loads((HERE / "energy_reference.json").read_text())["decks"]


def run(deck, out, variables=None, **options):
    return run_deck(DECKS / deck, RunOptions(threads=1, **options), variables=variables or {}, out=out)


@pytest.mark.parametrize("deck", REFERENCE)
def test_first_row(deck, tmp_path):
    """Every number of the first row without noise, to the digits of the platform; places of ``create_atoms random`` are those of LAMMPS, too."""
    reference = REFERENCE[deck]
    thermo = run(deck, tmp_path, platform="Reference", steps=0)["runs"][0]["thermo"]
    words = [word for word in reference["first_deterministic"] if word in thermo]
    assert len(words) >= 2
    for word in words:
        assert thermo[word]["first"] == pytest.approx(reference["first"][word], rel=1e-9, abs=1e-12), word


def students_t(values: np.ndarray, reference: dict, n: int) -> float:
    """Difference of two means over its standard error, both spreads pooled; ``n`` replicates of the reference."""
    m = len(values)
    pooled = ((m - 1) * values.var(ddof=1) + (n - 1) * reference["sd"] ** 2) / (m + n - 2)
    return float((values.mean() - reference["mean"]) / np.sqrt(pooled * (1 / m + 1 / n)))


REPLICATES = {  # deck -> step of the comparison, replicates here and in LAMMPS, words
    "in.dpde-vv": (200, 6, 12, ("temp", "press", "pe", "c_inner[2]", "c_inner[4]")),
    "in.dpde-table": (200, 6, 12, ("temp", "press", "pe", "c_inner[4]", "c_innerl[4]", "c_innerr[4]")),
    "in.mdpd": (100, 5, 3, ("temp", "press", "pe")),
}


@pytest.mark.slow
@any_seed(501)
@pytest.mark.parametrize("deck", REPLICATES)
def test_the_way_to_equilibrium(deck, tmp_path, seed):
    """Means over replicates at a step on the way, where everything still moves; |t| < 6 (p of about 1e-4 at 6 to 16 degrees of freedom)."""
    step, here, there, words = REPLICATES[deck]
    reference = REFERENCE[deck]["replicates"]["steps"][str(step)]
    rows = []
    for k in range(here):
        variables = {"nrun": str(step), "every": str(step), "seed": str(seed + k), "vseed": str(seed - 424 + k)}
        thermo = run(deck, tmp_path, variables, platform="CPU", steps=step)["thermo"]
        rows.append([thermo[word]["last"] for word in words])
    t = {word: round(students_t(column, reference[word], there), 2) for word, column in zip(words, np.array(rows).T, strict=True)}
    print(deck, t)
    assert max(map(abs, t.values())) < 6, t


@pytest.mark.parametrize("deck", ["in.dpdp-shardlow", "in.dpdh-shardlow"])
def test_decks_at_no_pressure_run(deck, tmp_path):
    """Repulsive beads at P = 0 only expand; with conserved energy the enthalpy, which is the energy here, stays what it is."""
    thermo = run(deck, tmp_path, {"every": "50"}, platform="CPU", steps=200)["thermo"]
    assert thermo["vol"]["last"] > thermo["vol"]["first"]
    if deck == "in.dpdh-shardlow":
        assert thermo["v_energy"]["last"] == pytest.approx(thermo["v_energy"]["first"], rel=3e-6)


DT, SECOND_RUN = 0.01, 5.0  # Time step of both decks, and the time at which their second run begins.

CARRIED = {"c_heat": 2e-4}  # What LAMMPS's heat noise carries along y (see test_profiles), measured in three runs of each program.


def never_put_in(y: np.ndarray, window: tuple[float, float], diffusivity: float, source: float) -> np.ndarray:
    """What LAMMPS's profiles lack: its source fixes do nothing in the first half step of a run, and there are two runs."""
    begin, end = window

    def change(start):
        whole = transient(y, begin - start, end - start, diffusivity, source)
        return whole - transient(y, begin - start - DT / 2, end - start - DT / 2, diffusivity, source)

    return change(0.0) + change(SECOND_RUN)


def compare_profiles(deck: str, profile: dict[str, list[float]]) -> dict[str, tuple[float, float, float, float]]:
    """By column: largest deviation of a bin in standard errors (beyond what is carried); diffusivity, and its deviation from LAMMPS and from the continuum formula.

    The error of a single run's bin is the spread of LAMMPS's three runs, pooled over the bins of a column (40 degrees of freedom).
    """
    reference, found = REFERENCE[deck], {}
    window = reference["profiles"]["time"]
    y = np.array(profile["coord"])
    for column, fit in reference["fits"].items():
        source = -0.01 if column == "c_c2" else 0.01
        expected = reference["profiles"]["columns"][column]
        theirs = np.array(expected["mean"]) + never_put_in(y, window, fit["continuum"], source)
        spread = np.sqrt(3 * np.mean(np.square(expected["sem"])) * (1 + 1 / 3))
        mine = np.array(profile[column])
        fitted, lammps = (fit_diffusivity(y, values, window, source)[0] for values in (mine, theirs))
        worst = np.maximum(0.0, np.abs(mine - theirs) - CARRIED.get(column, 0.0)).max() / spread
        found[column] = (round(worst, 2), round(fitted, 4), round(fitted / lammps - 1, 4), round(fitted / fit["continuum"] - 1, 4))
    return found


@pytest.mark.slow
@any_seed(1)
@pytest.mark.parametrize("deck", [pytest.param("in.edpd", marks=pytest.mark.long), "in.tdpd"])
def test_profiles(deck, tmp_path, seed):
    """Bins of the heat and species profiles, and the diffusivities fitted to them: 1 % beside LAMMPS, 3 % beside the continuum formula.

    Heat as LAMMPS computes it, since the conserving form heats the fluid by what velocity Verlet makes of this time step
    (docs/theory_energy.md).  LAMMPS's heat noise is the noise of the motion, with a sign that depends on the direction of its pairs, which
    carries a little heat along y: 2e-4 in the profile.
    """
    (profile,) = run(deck, tmp_path, platform="CPU", compat="lammps", seed=seed)["profiles"].values()
    found = compare_profiles(deck, profile)
    print(deck, found)
    for worst, _, beside_lammps, beside_formula in found.values():
        assert worst < 4.5
        assert abs(beside_lammps) < 0.01
        assert abs(beside_formula) < 0.03


@pytest.mark.slow
@any_seed(3)
@pytest.mark.parametrize("deck", PRESSURE)
def test_constant_pressure_in_equilibrium(deck, tmp_path, seed):
    """Mean volume, temperatures and potential energy, and the variance of the volume, within 4 combined standard errors."""
    reference = PRESSURE[deck]
    thermo = run(deck, tmp_path, {"nrun": "16000", "nequil": "3000"}, platform="CPU", seed=seed)["thermo"]
    words = {"Temp": "temp", "PotEng": "pe", "Volume": "vol", "c_dpdU[4]": "c_dpdU[4]"}
    z = {}
    for name, word in words.items():
        if name in reference:
            mine, theirs = thermo[word], reference[name]
            z[word] = round((mine["mean"] - theirs["mean"]) / float(np.hypot(mine["sem"], theirs["sem"])), 2)
    print(deck, z, {word: (thermo[word]["mean"], thermo[word]["sem"]) for word in words.values() if word in thermo})
    assert thermo["vol"]["sem"] < 0.002 * thermo["vol"]["mean"]
    assert max(map(abs, z.values())) < 4, z
    if deck == "in.dpdh-pressure":
        # the integrator's own error: the enthalpy of the first and the last row
        assert thermo["v_enthalpy"]["last"] == pytest.approx(thermo["v_enthalpy"]["first"], rel=2e-5)


@pytest.mark.slow
@pytest.mark.long
@any_seed(4)
def test_volume_fluctuations_are_the_compressibility(tmp_path, seed):
    """Isothermal: <dV^2> = kT V kappa, with kappa from the pressures of two runs at constant volume; and as LAMMPS has it."""
    scene = deck_scene(DECKS / "in.dpdp-pressure")
    kT, pressure = scene.initial_kT, 3000 * METAL.pressure

    def sampled(scene, steps, **choices):
        built = dpd.build(scene, dt=0.01, scheme="shardlow", platform="CPU", seed=seed)
        if choices:
            dpd.add_barostat(built, pressure, **choices)
        simulation, observer, rows = built.simulation(), dpd.Observer(built), []
        simulation.step(2000)
        for _ in range(steps // 10):
            simulation.step(10)
            sample = observer.sample(simulation.context)
            rows.append((sample.volume, sample.pressure(False)))
        return np.array(rows).T

    volumes, _ = sampled(scene, 24_000, interval=5)
    mean = volumes.mean()
    edges = np.diag(scene.box) * ((mean * np.array([0.99, 1.01])) / np.prod(np.diag(scene.box)))[:, None] ** (1 / 3)
    pressures = []
    for edge in edges:
        scaled = scene.positions * (edge / np.diag(scene.box))
        squeezed = dpd.Scene(scene.masses, list(scene.types), scaled, scene.tables[0], kT, box=edge)
        pressures.append(block_average(sampled(squeezed, 4000)[1]).mean)
    expected = kT * 0.02 * mean / (pressures[0] - pressures[1])
    measured = block_average((volumes - mean) ** 2)
    theirs = PRESSURE["in.dpdp-pressure"]["variance of Volume"]
    print(expected, measured, theirs["mean"] * METAL.length**6)
    assert measured.sem < 0.15 * expected
    assert abs(measured.mean - expected) < 4 * measured.sem + 0.03 * expected
    assert abs(measured.mean - theirs["mean"] * METAL.length**6) < 4 * np.hypot(measured.sem, theirs["sem"] * METAL.length**6)


ISOTHERMAL = json.loads((HERE / "lammps_reference.json").read_text())["decks"]

# deck -> steps of the production run.  The first group is long enough for standard errors of 0.3 % (temperature) and 0.2 % (energy); the
# others mix slowly, and would need hours here: docs/validation.md has long runs of them.
LONG = {"in.dpd": 150_000, "in.dpdext": 30_000, "in.bonded": 12_000, "in.triclinic": 20_000, "in.dpd_tstat": 36_000}
LONG["in.dpdext_tstat"] = 25_000
SHORT = {"in.dpd-vv": 26_000, "in.dpd-shardlow": 12_000, "in.srp": 10_000}
PRODUCTION = LONG | SHORT
#: Steps from row to row: temperature and energy remember more, and a row takes as long as ten steps.
EVERY = {"in.dpd": 30, "in.dpd-vv": 40, "in.dpd-shardlow": 40, "in.bonded": 20, "in.triclinic": 20, "in.srp": 20}

#: Marked long: their total energy wanders for a thousand steps at a time, and short runs do not know their own errors.
HOURS = ("in.dpd_tstat", "in.dpdext_tstat")

#: First rows do not depend on velocities or noise where positions come from a data file.
FIXED_POSITIONS = ("in.dpd-vv", "in.dpd-shardlow", "in.dpdext_tstat", "in.bonded", "in.ramp", "in.triclinic", "in.srp")


@pytest.mark.parametrize("deck", FIXED_POSITIONS)
def test_first_row_of_isothermal_decks(deck, tmp_path):
    """Potential energy of the first configuration to the digits of the platform: exact pair terms, LAMMPS's constants."""
    report = run_deck(DECKS / deck, RunOptions(platform="Reference", steps=0, threads=1), out=tmp_path)
    mine, theirs = report["runs"][0]["thermo"]["pe"]["first"], ISOTHERMAL[deck]["first"]["pe_per_bead"]
    if not ISOTHERMAL[deck]["norm"]:
        mine /= report["natoms"]
    # tables are splines here and there, through the same points but not the same spline
    assert mine == pytest.approx(theirs, rel=1e-6 if deck == "in.dpdext_tstat" else 1e-11)


def test_first_row_shardlow_pressure(tmp_path):
    """Fix shardlow keeps noise out of the pressure, so the first row's is deterministic."""
    report = run_deck(DECKS / "in.dpd-shardlow", RunOptions(platform="Reference", steps=0, threads=1), out=tmp_path)
    first = ISOTHERMAL["in.dpd-shardlow"]["first"]
    for word in ("press", "temp", "ke"):
        assert report["runs"][0]["thermo"][word]["first"] == pytest.approx(first[word], rel=1e-9)


@pytest.mark.slow
@any_seed(20)
@pytest.mark.parametrize("deck", [pytest.param(deck, marks=pytest.mark.long if deck in HOURS else ()) for deck in PRODUCTION])
def test_averages(deck, tmp_path, seed):
    """Averages of T, P and PE per bead within 4 combined standard errors of LAMMPS's."""
    reference = ISOTHERMAL[deck]["production"]
    options = RunOptions(platform="CPU", discard=reference["discard"], seed=seed)
    variables = ISOTHERMAL[deck]["variables"] | {"nrun": str(PRODUCTION[deck]), "every": str(EVERY.get(deck, 10))}
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
