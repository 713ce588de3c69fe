"""Wrong input gives one clear error that names what, where and what would be right; what goes wrong while stepping, likewise."""

import inspect
import io
import itertools
import re

import numpy as np
import openmm
import pytest
from cases import cases, put, raises
from devices import DEVICES
from openmm import unit
from scenes import D, beads, run_of, state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.analysis import poiseuille_viscosity, radial_distribution
from openmm_dpd.base.names import KT
from openmm_dpd.lammps import RunOptions
from openmm_dpd.measure import VelocityReporter, WallReporter
from openmm_dpd.molecules import Spring, frozen_layer, linear, ring
from openmm_dpd.parameters import repulsion_from_chi
from openmm_dpd.score.scoring import score_word

N = 20
X = np.random.default_rng(0).random((N, 3)) * 3
TABLE = {("W", "W"): D(A=25, gamma=4.5)}
KELVIN, NM = unit.kelvin, unit.nanometer


def scene(**changes):
    return dpd.Scene(**{**dict(masses={"W": 1.0}, types=["W"] * N, positions=X, pairs=TABLE, kT=1.0, box=[3.0] * 3), **changes})


def build(of=None, **changes):
    return dpd.build(of or scene(), **{"dt": 0.02, "platform": "Reference", "seed": 1, **changes})


def set_kT(built):
    dpd.set_kT(built.simulation().context, 1)


def with_value(value):
    x = X.copy()
    x[7, 1] = value
    return x


BOND = np.array([[0, 1]])
TWO = dict(masses={"A": 1.0, "B": 1.0}, types=["A", "B"] * (N // 2))

WRONG = {  # What is wrong -> what makes it, and what the message has to say.
    "NaN position": (lambda: scene(positions=with_value(np.nan)), r"positions.*nan.*\(7, 1\)"),
    "infinite position": (lambda: scene(positions=with_value(np.inf)), r"positions.*inf.*\(7, 1\)"),
    "NaN velocity": (lambda: scene(velocities=with_value(np.nan)), r"velocities.*nan.*\(7, 1\)"),
    "too few positions": (lambda: scene(positions=X[:5]), r"positions.*\(20, 3\).*\(5, 3\)"),
    "cutoff over half the box": (lambda: build(scene(pairs={("W", "W"): D(A=25, cutoff=1.6)})), r"\(W, W\).*1\.6.*half the box.*3"),
    "cutoff over half of one edge": (lambda: build(scene(box=[3, 3, 1.9])), r"\(W, W\).*half the box.*1\.9"),
    "unset type pair": (lambda: scene(**TWO, pairs={("A", "A"): D(A=1)}), r"\(A, B\), \(B, B\)"),
    "unknown type in a table": (lambda: scene(pairs={("W", "X"): D(A=1)}), r"\('W', 'X'\).*'X'"),
    "unknown type of a bead": (lambda: scene(types=["V"] * N), "V.*W"),
    "types that are lists": (lambda: scene(types=[["W"]] * N), r"unknown bead types \['W'\]"),
    "a pair in both orders": (
        lambda: scene(**TWO, pairs={("*", "*"): D(A=1), ("A", "B"): D(A=25), ("B", "A"): D(A=30)}),
        r"\('B', 'A'\) and \('A', 'B'\) differ|\('A', 'B'\) and \('B', 'A'\) differ",
    ),
    "a BuiltSystem for a Scene": (lambda: build(build()), "expected a Scene, not a BuiltSystem$"),
    "a method for a Scene": (lambda: build(dpd.BuiltSystem.explain), "expected a Scene, not the function explain; call it: explain\\(\\)$"),
    "advice about a BuiltSystem": (lambda: dpd.recommend(build()), "expected a Scene, not a BuiltSystem$"),
    "barostat of a Scene": (lambda: dpd.add_barostat(scene(), 20.0), r"build\(\).* or create_mixed_system\(\) returned, not a Scene$"),
    "no pairs": (lambda: scene(pairs={}), "at least one"),
    "pairs is None": (lambda: scene(pairs=None), "pairs"),
    "negative gamma": (lambda: D(gamma=-1), "gamma.*-1"),
    "negative gamma_perp": (lambda: D(gamma_perp=-2), "gamma_perp.*-2"),
    "negative sigma": (lambda: D(sigma=-3), "sigma.*-3"),
    "negative exponent": (lambda: D(exponent=-1), "exponent.*-1"),
    "cutoff 0": (lambda: D(cutoff=0), "cutoff.*> 0"),
    "infinite A": (lambda: D(A=np.inf), "A.*inf"),
    "A in kelvin": (lambda: D(A=25 * KELVIN), "A.*kelvin.*force"),
    "gamma is text": (lambda: D(gamma="much"), "gamma.*'much'"),
    "gamma, sigma": (lambda: scene(pairs={("W", "W"): D(gamma=4.5, sigma=2)}), r"\('W', 'W'\).*sigma = 2.*gamma = 4\.5.*sigma = 3"),
    "sigma at zero temperature": (lambda: scene(kT=0, pairs={("W", "W"): D(sigma=3)}), "sigma = 3.*temperature of 0"),
    "ramp to zero with sigma": (lambda: scene(kT=dpd.TemperatureRamp(1, 0, 0, 5), pairs={("W", "W"): D(sigma=3)}), "temperature of 0"),
    "negative temperature": (lambda: scene(kT=-1), "kT.*-1"),
    "temperature is text": (lambda: scene(kT="hot"), "kT.*'hot'"),
    "temperature in nanometers": (lambda: scene(kT=1 * unit.nanometer), "kT.*nanometer.*energy"),
    "ramp without length": (lambda: dpd.TemperatureRamp(1, 2, 5, 5), "end.*5"),
    "dt 0": (lambda: build(dt=0), "dt.*> 0"),
    "negative dt": (lambda: build(dt=-1), "dt.*-1"),
    "dt in kelvin": (lambda: build(dt=1 * KELVIN), "dt.*kelvin.*time"),
    "dt is text": (lambda: build(dt="short"), "dt.*'short'"),
    "unknown scheme": (lambda: build(scheme="verlet"), "'verlet'.*mvv.*shardlow.*middle.*aboba.*native"),
    "lambda out of bounds": (lambda: build(scheme="mvv", lam=2), "lam.*0 and 1.*2"),
    "lambda is text": (lambda: build(scheme="mvv", lam="half"), "lam"),
    "unknown placement": (lambda: build(conservative="gpu"), "conservative.*'gpu'"),
    "unknown platform": (lambda: build(platform="GPU"), "'GPU'.*Reference"),
    "negative seed": (lambda: build(seed=-1), "seed.*-1"),
    "seed too large": (lambda: build(seed=2**31), "seed.*2147483648"),
    "seed not whole": (lambda: build(seed=1.5), r"seed.*1\.5"),
    "two edges": (lambda: scene(box=[3, 3]), r"box.*\(2,\)"),
    "negative edge": (lambda: scene(box=[3, 3, -3]), r"box.*-3"),
    "tilt over half": (lambda: scene(box=[[3, 0, 0], [2, 3, 0], [0, 0, 3]]), "reduced form"),
    "box not lower triangular": (lambda: scene(box=[[3, 1, 0], [0, 3, 0], [0, 0, 3]]), "lower triangular"),
    "mass 0": (lambda: scene(masses={"W": 0}), "'W'.*> 0.*mobile"),
    "mass is text": (lambda: scene(masses={"W": "heavy"}), "'W'.*'heavy'"),
    "masses is a list": (lambda: scene(masses=[1.0]), "masses"),
    "bead mass 0": (lambda: scene(bead_masses=[1.0] * 19 + [0.0]), "bead 19.*mass 0"),
    "mobile of the wrong length": (lambda: scene(mobile=[True]), "mobile.*20"),
    "bond to a missing bead": (lambda: scene(bonds=[dpd.HarmonicBonds(np.array([[0, 25]]), 1, 1)]), "bead 25.*20"),
    "bond to itself": (lambda: dpd.HarmonicBonds(np.array([[3, 3]]), 1, 1), "bead 3"),
    "negative bond constant": (lambda: dpd.HarmonicBonds(BOND, -1, 1), "k.*-1"),
    "bond twice": (lambda: scene(bonds=[dpd.HarmonicBonds(np.array([[0, 1], [1, 0]]), 1, 1)]), "beads 0 and 1.*twice"),
    "bonds not in a sequence": (lambda: scene(bonds=dpd.HarmonicBonds(BOND, 1, 1)), "bonds.*HarmonicBonds"),
    "factor over 1": (lambda: scene(bonded_factors=(2, 1, 1)), "bonded_factors.*0 and 1"),
    "one factor": (lambda: scene(bonded_factors=0.5), "bonded_factors.*three"),
    "Quantities and bare numbers": (lambda: scene(positions=[X[0] * NM, *X[1:]]), "positions mixes Quantities.*entry 1 "),
    "masked positions": (lambda: scene(positions=np.ma.masked_less(X, 0.5)), "positions has masked entries"),
    "units of another library": (lambda: scene(positions=X.view(type("A", (np.ndarray,), {"units": 1}))), "positions has.*units that"),
    "Quantities in kelvin": (lambda: scene(positions=[x * KELVIN for x in X]), "positions.*kelvin.*length"),
    "ragged positions": (lambda: scene(positions=[[1, 2, 3]] * (N - 1) + [[1, 2]]), r"positions.*\(3,\) and \(2,\)"),
    "complex positions": (lambda: scene(positions=X + 1j), "positions.*array of numbers"),
    "positions of text": (lambda: scene(positions=[["1", "2", "3"]] * N), "positions.*'1'"),
    "positions in one row": (lambda: scene(positions=X.ravel()), r"positions.*\(20, 3\).*20 beads.*\(60,\)"),
    "temperature is True": (lambda: scene(kT=True), "kT.*True"),
    "dt is True": (lambda: build(dt=True), "dt.*True"),
    "types is a number": (lambda: scene(types=5), "types.*5"),
    "types is missing": (lambda: scene(types=None), "types.*None"),
    "type named by a number": (lambda: scene(masses={1: 1.0}, types=[1] * N), "masses.*1"),
    "type named as the wildcard": (lambda: scene(masses={"*": 1.0}, types=["*"] * N), r"masses.*'\*'"),
    "ramp ends within a step": (lambda: dpd.TemperatureRamp(1, 2, 0, 5.5), r"ramp's last_step.*5\.5"),
    "ramp begins with text": (lambda: dpd.TemperatureRamp(1, 2, "0", 5), "ramp's first_step.*'0'"),
    "ramp over time": (lambda: dpd.TemperatureRamp(1, 2, 0, 5 * unit.picosecond), "ramp's last_step.*5 ps"),
    "mobile by indices": (lambda: scene(mobile=np.arange(N)), "mobile.*True or False.*isin.*int64"),
    "mobile is text": (lambda: scene(mobile=["no"] * N), "mobile.*True or False"),
    "molecules not whole": (lambda: scene(molecules=np.arange(N) + 0.5), "molecules.*whole number"),
    "sources is None": (lambda: scene(sources=None), "sources.*None"),
    "pairs is a list of coefficients": (lambda: scene(pairs=[D(A=25)]), "PairTable.*not a DPD"),
    "shift is text": (lambda: dpd.LennardJones(1, 1, 1, "no"), "shift.*'no'"),
    "negative distance in a table": (lambda: dpd.TabulatedPair([-0.1, 0, 0.1, 0.2], [3, 2, 1, 0]), r"distances.*-0\.1"),
    "ragged bonds": (lambda: dpd.HarmonicBonds([(0, 1), (2,)], 1, 1), "bond pairs.*length"),
    "wrong number of bond constants": (lambda: dpd.HarmonicBonds([(0, 1), (2, 3)], [1, 2, 3], 1), r"bond k.*2 bonds.*\(3,\)"),
    "forces at too few positions": (lambda: dpd.force_terms(build(), X[:5]), r"positions.*\(20, 3\).*\(5, 3\)"),
    "noise before the first": (lambda: dpd.force_terms(build(), counter=-1), "counter.*-1"),
    "observer of a Simulation": (lambda: dpd.Observer(build().simulation()), "Observer.*build.*Simulation"),
    "reporter of fields of a Scene": (lambda: dpd.FieldReporter("fields.npz", 10, scene()), "FieldReporter.*build.*a Scene"),
    "sample of a Simulation": (lambda: dpd.Observer(build()).sample(build().simulation()), "Context.*Simulation"),
    "temperature of a Simulation": (lambda: dpd.set_kT(build().simulation(), 1), "Context.*Simulation"),
    "temperature under a ramp": (lambda: set_kT(build(scene(kT=dpd.TemperatureRamp(1, 2, 0, 5)))), "ramp.*overwrite"),
    "temperature without friction": (lambda: set_kT(build(scene(pairs={("W", "W"): D(A=1)}))), "no thermostat.*friction"),
    "temperature of the native scheme": (lambda: set_kT(build(scheme="native")), "no thermostat.*DPDIntegrator"),
    "rows every 1.5 steps": (lambda: dpd.DPDReporter(io.StringIO(), 1.5, build()), r"interval.*1\.5"),
    "rows every True steps": (lambda: dpd.DPDReporter(io.StringIO(), True, build()), "interval.*True"),
    "one column as text": (lambda: dpd.DPDReporter(io.StringIO(), 1, build(), "kT"), "columns.*'kT'"),
    "no columns": (lambda: dpd.DPDReporter(io.StringIO(), 1, build(), []), r"columns.*\[\]"),
    "no file": (lambda: dpd.DPDReporter(None, 1, build()), "file.*None"),
    "a loop by text": (lambda: build(loop="no"), "loop must be True or False, not 'no'"),
    "a platform by number": (lambda: build(platform=0), "no platform 0 here"),
    "axes by text": (lambda: dpd.add_barostat(build(), 23.0, axes="yes"), "axes must be three of True or False.*'yes'"),
    "axes by names": (lambda: dpd.add_barostat(build(), 23.0, axes=["x", "y", "z"]), "axes must be three of True or False"),
    "no name of a platform": (lambda: build(platform=""), "no platform '' here"),
    "a plan to explain": (lambda: dpd.explain_plan(build()), "expected a Plan, such as built.plan, not a BuiltSystem"),
    "a plan to build": (lambda: dpd.build_plan(scene()), "expected a Plan, such as make_plan.*not a Scene"),
    "a guide by name": (lambda: dpd.build_plan(build().plan, "g"), "guide must be a Guide, not 'g'"),
    "a host by number": (lambda: dpd.make_plan(scene(), dt=0.01, host=3), "host must be a Host, not 3"),
    "no file of XML": (lambda: dpd.load_xml(3), "file must be a path or a text file open for reading, not 3"),
    "a Simulation on platform 3": (lambda: build().simulation(platform=3), "platform must be one of OpenMM's.*not 3"),
    "properties as text": (lambda: build().simulation(properties="x"), "properties must be a dict.*not 'x'"),
    "properties of forces": (lambda: dpd.force_terms(build(), properties=3), "properties must be a dict.*not 3"),
    "a table of steps": (lambda: dpd.recommend(scene(), table="t"), "table must be a StabilityTable, not 't'"),
    "scenes to score": (lambda: score_word("middle", 3), "scenes must be names.*not 3"),
    "an error to score": (lambda: score_word("middle", [], error="x"), "error must be a number.*'x'"),
    "a time to score": (lambda: score_word("middle", [], time="x"), "time must be a number.*'x'"),
    "fields of a Simulation": (lambda: dpd.read_fields(build().simulation(), build().plan), "context must be an openmm.Context"),
    "fields without a plan": (lambda: dpd.read_fields(build().simulation().context, build()), "plan must be a Plan.*not a BuiltSystem"),
    "bonds of a Simulation": (lambda: dpd.read_bonds(build().simulation(), build().plan), "context must be an openmm.Context"),
    "an update of a Simulation": (lambda: build().update_in_context(build().simulation()), "context must be an openmm.Context"),
    "walls of a Scene": (lambda: WallReporter(10, scene()), "WallReporter needs as built the result of.*not a Scene"),
    "a layer in a built system": (lambda: frozen_layer(build(), [], dt=0.01), "expected a Scene, not a BuiltSystem"),
    "degrees of freedom of a Context": (lambda: dpd.degrees_of_freedom(build()), "expected an openmm.System, not a BuiltSystem"),
    "the flow of a number": (lambda: poiseuille_viscosity(3, force=1.0), "profile must be a VelocityProfile, not 3"),
    "an array for a word": (lambda: dpd.Wall("z", 0.0, np.array(["above"] * 2)), r"side of a wall.* one of above, below, not \['above'"),
    "append as text": (lambda: dpd.DPDReporter(io.StringIO(), 1, build(), append="x"), "append must be True or False, not 'x'"),
    "velocities into no file": (lambda: VelocityReporter(3, 1), "file must be a path, not 3"),
    "one molecule for all": (lambda: scene(residues=3), "residues must name the molecule of each"),
}


@cases("make, message", WRONG)
def test_wrong_input(make, message):
    with pytest.raises(dpd.DPDError, match=message) as caught:
        make()
    assert isinstance(caught.value, dpd.ParameterError)
    assert "\n" not in str(caught.value)


#: Public functions and classes with arguments that they take, and what these are replaced by one after the other.
SOUND = {
    dpd.Scene: dict(masses={"W": 1.0}, types=["W"] * N, positions=X, pairs=TABLE, kT=1.0, box=[3.0] * 3),
    dpd.build: dict(scene=scene(), dt=0.02, platform="Reference"),
    **{call: {} for call in (D, RunOptions)},
    **{call: dict(A=25.0, gamma=4.5, kappa=kappa) for call, kappa in ((dpd.EDPD, 1.0), (dpd.TDPD, (1.0,)))},
    dpd.FENEBonds: dict(pairs=BOND, k=1.0, R0=1.0),
    dpd.BodyForce: dict(force=(1.0, 0.0, 0.0)),
    dpd.SlaterCharges: dict(lamda=1.0, permittivity=1.0),
    repulsion_from_chi: dict(chi=2.0),
    dpd.HarmonicDihedrals: dict(quads=[(0, 1, 2, 3)], k=1.0, d=1, n=1),
    dpd.Wall: dict(axis="z", position=0.0, side="above"),
    **{kind: dict(blocks="A6", spring=Spring(2.0, 0.5)) for kind in (linear, ring)},
    radial_distribution: dict(trajectory=[], r_max=1.0),
}
OF_NUMPY = (np.float64(-1), np.int64(-7), np.bool_(True), np.str_("no"), np.array(1.5), np.arange(3), (np.float64(2), 1, 1))
OF_NUMPY += ([np.str_("Q")], {np.str_("X"): np.float64(-1)}, {(np.str_("X"), np.str_("W")): D()}, np.float64(-2) * unit.picosecond)


def test_numbers_of_numpy_are_printed_like_others():
    said = set()
    for call, sound in SOUND.items():
        for name, value in itertools.product(inspect.signature(call).parameters, OF_NUMPY):
            try:
                call(**{**sound, name: value})
            except (TypeError, ValueError) as error:
                said |= {str(error)} if isinstance(error, dpd.DPDError) else set()
    assert len(said) > 300 and not [text for text in said if re.search(r"np\.|array\(|Quantity\(|dtype", text)]


def test_lists_of_quantities_keep_their_units():
    """NumPy drops the unit of a Quantity of an array without a word, which would scale positions by ten."""
    x = 10 * X
    for positions in ([row * unit.angstrom for row in x], [[v * unit.angstrom for v in row] for row in x], x * unit.angstrom):
        np.testing.assert_allclose(scene(positions=positions).positions, X)
    built = build()
    expected, found = (dpd.force_terms(built, positions)["conservative"] for positions in (X, x * unit.angstrom))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_reporter_that_is_refused_leaves_the_file(tmp_path):
    path = put(tmp_path / "rows.csv", "precious")
    raises(dpd.ParameterError, ".", dpd.DPDReporter, path, 0, build())
    raises(dpd.ParameterError, ".", dpd.DPDReporter, path, 10, build().simulation())
    assert path.read_text() == "precious"
    raises(FileNotFoundError, ".", dpd.DPDReporter, tmp_path / "nowhere" / "rows.csv", 10, build())


NATIVE = {
    "transverse friction": (D(gamma=1, gamma_perp=1), "transverse"),
    "sigma fixed": (D(sigma=3), "sigma is fixed"),
    "exponent": (D(gamma=4.5, exponent=0.5), "exponent is 0.5"),
}


@cases("coefficient, message", NATIVE)
def test_what_the_native_scheme_cannot_express(coefficient, message):
    raises(dpd.PlanError, message, lambda: build(scene(pairs={("W", "W"): coefficient}), scheme="native"))


SMALL_TILTED = [[3.0, 0, 0], [1.4, 3.0, 0], [0, 0, 3.0]]
NATIVE_SCENES = {
    "immobile beads": (dict(mobile=np.arange(N) != 3), "bead 3 is immobile"),
    "beads that only say that they move": (dict(mobile=np.ones(N, bool)), None),
    "moving wall": (dict(mobile=np.arange(N) != 3, velocities=np.ones((N, 3))), "bead 3 is immobile"),
    "beads at one point": (dict(positions=np.concatenate([X[:1], X[:-1]])), "beads 0 and 1 .counted from 0. are at the same point"),
    "small tilted box": (dict(box=SMALL_TILTED), "small and tilted.*friction.*Reference"),
    "masses of beads": (dict(bead_masses=np.arange(1.0, N + 1)), "same mass"),
}


@cases("changes, message", NATIVE_SCENES)
def test_scenes_that_the_native_scheme_cannot_run(changes, message):
    if message is None:
        build(scene(**changes), scheme="native").simulation().step(2)
    else:
        raises(dpd.PlanError, message, lambda: build(scene(**changes), scheme="native"))


def test_native_needs_openmms_force_and_no_ramp():
    raises(dpd.PlanError, "openmm", lambda: build(scheme="native", conservative="kernel"))
    raises(dpd.PlanError, "ramp", lambda: build(scene(kT=dpd.TemperatureRamp(1, 2, 0, 5)), scheme="native"))


def test_one_barostat_before_the_context_is_made():
    built = build()
    dpd.add_barostat(built, 20.0)
    raises(dpd.PlanError, "has a MonteCarloBarostat already", lambda: dpd.add_barostat(built, 20.0, coupled=False))
    for scheme in ("middle", "native"):
        built = build(scheme=scheme)
        simulation = built.simulation()
        raises(dpd.PlanError, "before the Simulation is made", dpd.add_barostat, built, 20.0)
        assert simulation.context.getStepCount() == 0
    raises(dpd.PlanError, "temperature.*is 0", lambda: dpd.add_barostat(build(scene(kT=0.0)), 20.0))


# -- while stepping --------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
@cases("device, scheme", *((d, s) for d in DEVICES for s in ("mvv", "middle") if d.exact or s == "middle"), indirect=["device"], ids=str)
def test_box_smaller_than_twice_the_cutoff(device, scheme, conservative):
    """A barostat that shrinks the box too far ends the run with the reason, and does not take wrong images instead."""
    simulation = stepped(run_of(scene(), device, dt=0.02, scheme=scheme, conservative=conservative), 1)
    simulation.context.setPeriodicBoxVectors([1.9, 0, 0], [0, 3, 0], [0, 0, 3])
    raises(openmm.OpenMMException, r"box (size )?has (shrunk|decreased).*less than twice the.*cutoff", lambda: simulation.step(1))


def test_bead_that_became_nan_is_named(device):
    """By the kernel: its number; the CPU platform looks at positions before any force and says it in its own words."""
    simulation = run_of(scene(), device, dt=0.02, scheme="middle", conservative="kernel")
    simulation.context.setPositions(with_value(np.nan))
    raises(openmm.OpenMMException, "bead 7 is not finite|coordinate is NaN", lambda: simulation.step(2))


@pytest.mark.parametrize(("scheme", "table"), [("middle", {("W", "W"): D(A=25)}), ("mvv", {("W", "W"): D(A=25)}), ("native", TABLE)])
def test_bead_that_becomes_nan_without_a_pair_kernel(scheme, table):
    """The Reference platform of OpenMM would go on; the steps are taken back."""
    simulation = build(scene(pairs=table), scheme=scheme, conservative="openmm").simulation()
    _, v = state_of(simulation.context)
    v[7] = np.nan
    simulation.context.setVelocities(v)
    raises(openmm.OpenMMException, "by step 10 the position of bead .* is not finite", lambda: simulation.step(12))
    assert simulation.context.getStepCount() == 0 and np.isfinite(state_of(simulation.context)[0]).all()


@pytest.mark.parametrize("loop", [True, False])
def test_bead_that_is_far_away_has_a_position(loop):
    simulation = build(conservative="kernel", loop=loop).simulation()
    simulation.context.setPositions(with_value(1e18))
    raises(openmm.OpenMMException, r"bead 7 is so far away that it is in no cell: \[.*1e\+18", lambda: simulation.step(1))


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle"])
@cases("table, kT, match", (TABLE, -1.0, ">= 0.*-1"), ({("W", "W"): D(sigma=3)}, 0.0, "is 0.*infinite friction|> 0 where sigma is fixed"))
def test_temperature_that_is_none_while_stepping(table, kT, match, scheme, loop):
    simulation = build(scene(pairs=table), scheme=scheme, loop=loop).simulation()
    simulation.context.setParameter(KT, kT)
    raises(openmm.OpenMMException, f"dpd_kT.*({match})", lambda: simulation.step(1))


def test_dihedral_in_line():
    """The pair kernel has no force where three beads have no plane; of OpenMM there would be no number."""
    x = X.copy()
    x[1:4] = [(1.0, 1.1, 1.0), (1.3, 1.1, 1.3), (1.6, 1.1, 1.6)]
    of = scene(positions=x, dihedrals=[dpd.HarmonicDihedrals([(0, 1, 2, 3)], k=3.0, d=1, n=1)])
    assert np.isfinite(state_of(stepped(build(of).simulation(), 5).context)[1]).all()
    raises(dpd.PlanError, r"three of beads 0, 1, 2 and 3 \(counted from 0\) are in line", lambda: build(of, loop=False))


@pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle", "aboba", "bababo", "native"])
def test_step_size_of_zero(scheme):
    simulation = run_of(beads(), DEVICES[0], dt=0.02, scheme=scheme)
    simulation.integrator.setStepSize(0.0)
    raises(openmm.OpenMMException, "step size must be > 0.*is 0 ps", lambda: simulation.step(1))


def test_observer_says_when_a_run_has_blown_up():
    built = build(conservative="openmm", scheme="mvv")
    simulation = built.simulation()
    _, v = state_of(simulation.context)
    v[3] = np.nan
    simulation.context.setVelocities(v)
    raises(dpd.RunError, "not finite", lambda: dpd.Observer(built).sample(simulation.context))
