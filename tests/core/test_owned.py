"""What a scene takes over: copies of what a caller hands over, and tables of many types, in which a thousand types are no matter of minutes."""

import importlib
import pickle
import pkgutil
import time
from dataclasses import fields, is_dataclass
from itertools import combinations_with_replacement

import numpy as np
import pytest
from openmm import unit

import openmm_dpd as dpd
import openmm_dpd.model
from openmm_dpd.model.bodies import GivenBody
from openmm_dpd.molecules import Molecule, Spring

KJ, MASK = unit.kilojoule_per_mole, [True, False, True]
PAIRS = [[0, 1], [1, 2]]
X = [[0.1, 0.2, 0.3], [1.0, 1.0, 1.0], [2.0, 2.0, 2.0]]
DISTANCES = np.linspace(0.1, 1.0, 12)
REACTIVE = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 1.0, "r0": 1.0})


def scene_arguments() -> dict:
    table, walls = {("A", "A"): dpd.DPD(A=25.0, gamma=4.5)}, [dpd.Wall("z", 0.0, "above"), dpd.Wall("z", 4.0, "below")]
    found = {"masses": {"A": 1.0}, "types": ["A", "A", "A"], "positions": np.array(X), "pairs": table, "kT": 1.0}
    found |= {"box": np.array([5.0, 5.0, 5.0]), "velocities": np.array(X), "bead_masses": np.array([1.0, 2.0, 3.0])}
    found |= {"charges": np.array([1.0, -1.0, 0.0]), "bonds": [dpd.HarmonicBonds(PAIRS, 1.0, 1.0)], "mobile": np.array(MASK)}
    found |= {"molecules": np.array([1, 1, 2]), "angles": [dpd.CosineAngles([[0, 1, 2]], 1.0)]}
    return found | {"body_forces": [dpd.BodyForce([1.0, 0, 0])], "walls": walls, "residues": ["R", "R", "S"]}


def bonds(**coefficients: float) -> dict:
    return {"pairs": np.array(PAIRS), **{name: np.array([value, value]) for name, value in coefficients.items()}}


def dihedrals(*coefficients: str) -> dict:
    return {"quads": np.array([[0, 1, 2, 3]]), **{name: np.array([1.0]) for name in coefficients}}


EXAMPLES = {  # For each class that takes arrays, sequences or mappings, arguments made anew.
    dpd.Scene: scene_arguments,
    dpd.HarmonicBonds: lambda: bonds(k=1.0, r0=1.0),
    dpd.FENEBonds: lambda: bonds(k=1.0, R0=1.0, epsilon=1.0, sigma=1.0),
    dpd.MorseBonds: lambda: bonds(D=1.0, alpha=1.0, r0=1.0),
    dpd.NonlinearBonds: lambda: bonds(epsilon=1.0, r0=1.0, lamda=1.0),
    dpd.QuarticBonds: lambda: bonds(k=1.0, B1=-0.5, B2=0.2, Rc=1.3, U0=1.0),
    dpd.HarmonicAngles: lambda: {"triples": np.array([[0, 1, 2]]), "k": np.array([1.0]), "theta0": np.array([1.0])},
    dpd.CosineAngles: lambda: {"triples": np.array([[0, 1, 2]]), "k": np.array([1.0])},
    dpd.CosineDeltaAngles: lambda: {"triples": np.array([[0, 1, 2]]), "k": np.array([1.0]), "theta0": np.array([1.0])},
    dpd.CosineSquaredAngles: lambda: {"triples": np.array([[0, 1, 2]]), "k": np.array([1.0]), "theta0": np.array([1.0])},
    dpd.PeriodicAngles: lambda: {"triples": np.array([[0, 1, 2]]), **dict.fromkeys("CBn", np.array([1.0]))},
    dpd.HarmonicDihedrals: lambda: dihedrals("k", "d", "n"),
    dpd.OPLSDihedrals: lambda: dihedrals("K1", "K2", "K3", "K4"),
    dpd.MultiHarmonicDihedrals: lambda: dihedrals("A1", "A2", "A3", "A4", "A5"),
    dpd.HarmonicImpropers: lambda: dihedrals("k", "chi0"),
    dpd.CosineImpropers: lambda: dihedrals("k", "d", "n"),
    dpd.UmbrellaImpropers: lambda: dihedrals("k", "omega0"),
    dpd.ReactiveBonds: lambda: {"kind": dpd.HarmonicBonds, "coefficients": {"k": 1.0, "r0": 1.0}, "pairs": np.array(PAIRS)},
    dpd.BondFormation: lambda: {"bonds": REACTIVE, "types": ["A", "A"], "within": 0.5, "valences": [2, 2]},
    dpd.RadialPair: lambda: {"form": "gauss", "values": {"A": 1.0, "B": 2.0}, "cutoff": 1.0},
    dpd.TabulatedPair: lambda: {"distances": DISTANCES.copy(), "energies": 1 - DISTANCES, "forces": np.ones(12)},
    dpd.TabulatedEOS: lambda: {"thetas": np.array([1.0, 2.0]), "energies": np.array([1.0, 3.0])},
    dpd.SegmentalRepulsion: lambda: {"A": 1.0, "bonds": np.array(PAIRS)},
    dpd.Body: lambda: {"beads": np.array([0, 2])},
    GivenBody: lambda: {"beads": np.array([0, 2]), "mass": 1.0, "centre": np.zeros(3), "inertia": np.eye(3)},
    dpd.BodyForce: lambda: {"force": np.array(X), "types": ["A"], "beads": np.array(MASK)},
    dpd.PositionForce: lambda: {"formulas": ["x", "0", "0"], "types": ["A"], "beads": np.array(MASK), "corner": np.zeros(3)},
    dpd.Block: lambda: {"low": np.zeros(3), "high": np.ones(3)},
    dpd.Sphere: lambda: {"centre": np.zeros(3), "radius": 1.0},
    dpd.shapes.Ball: lambda: {"centre": np.zeros(3), "radius": 1.0},
    dpd.shapes.Cone: lambda: {"centre": np.zeros(3), "axis": np.ones(3), "length": 1.0, "radius": 1.0},
    dpd.shapes.Cylinder: lambda: {"centre": np.zeros(3), "axis": np.ones(3), "radius": 1.0, "length": 1.0},
    dpd.shapes.RoundedBox: lambda: {"centre": np.zeros(3), "size": np.ones(3)},
    dpd.shapes.GridShape: lambda: {"distances": np.zeros((2, 2, 2))},
    dpd.shapes.Union: lambda: {"shapes": [dpd.shapes.Ball(np.zeros(3), 1.0)]},
    dpd.SolidWall: lambda: {"shape": dpd.shapes.Ball(np.zeros(3), 1.0), "velocity": np.zeros(3), "spin": np.ones(3), "centre": np.ones(3)},
    dpd.Source: lambda: {"region": dpd.Sphere([0, 0, 0], 1.0), "rate": 1.0, "beads": np.array(MASK), "corner": np.zeros(3)},
    dpd.Buoyancy: lambda: {"force": np.ones(3), "reference": 1.0, "beads": np.array(MASK)},
    dpd.InternalEnergy: lambda: {"eos": {"A": dpd.ConstantHeatCapacity(10.0)}, "thetas": np.ones(3) * KJ, "conductive": np.ones(3)},
    dpd.BeadTemperatures: lambda: {"thetas": np.ones(3), "capacities": np.ones(3)},
    dpd.Concentrations: lambda: {"values": np.ones((3, 2))},
    dpd.TDPD: lambda: {"A": 1.0, "gamma": 1.0, "kappa": np.ones(2), "epsilon": np.ones(2), "exponent_c": [2.0, 2.0]},
    dpd.EDPD: lambda: {"A": 1.0, "gamma": 1.0, "kappa": 1.0, "kappa_polynomial": [1.0, 0.0, 0.0, 0.0]},
    dpd.SlaterCharges: lambda: {"permittivity": 1.0, "lamda": 0.5, "bonded_factors": [0.0, 0.0, 1.0], "grid": [8, 8, 8]},
    dpd.PointCharges: lambda: {"permittivity": 1.0, "bonded_factors": [0.0, 0.0, 1.0], "grid": [8, 8, 8]},
    dpd.GaussianCharges: lambda: {"permittivity": 1.0, "width": 0.5, "bonded_factors": [0.0, 0.0, 1.0], "grid": [8, 8, 8]},
}

_SCALARS = (
    "BondBreaking ConstantHeatCapacity DPD EnergyDPD EwaldSum LeesEdwards LennardJones MDPD SmearedCharges Scheme TemperatureRamp Wall "
    "FormulaShape Complement Difference MeshShape _Plane"
)
SCALARS = set(_SCALARS.split())  # Only numbers, text and other frozen classes in them.


def model_classes() -> set[type]:
    """All dataclasses of the model."""
    modules = [importlib.import_module(f"openmm_dpd.model.{m.name}") for m in pkgutil.iter_modules(openmm_dpd.model.__path__)]
    return {v for m in modules for v in vars(m).values() if isinstance(v, type) and is_dataclass(v) and v.__module__ == m.__name__}


def spoil(value) -> None:
    """Change an array, sequence or mapping in place."""
    value = value._value if unit.is_quantity(value) else value
    if isinstance(value, np.ndarray):
        value[...] = ~value if value.dtype == bool else value + 1
    elif isinstance(value, (list, dict)):
        value.clear()


def test_every_class_of_the_model_is_looked_at():
    assert {kind.__name__ for kind in model_classes()} == {kind.__name__ for kind in EXAMPLES} | SCALARS


@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__name__)
def test_a_caller_may_go_on_with_what_it_handed_over(kind):
    arguments = EXAMPLES[kind]()
    made = kind(**arguments)
    before = pickle.dumps(made)
    for value in arguments.values():
        spoil(value)
    assert pickle.dumps(made) == before
    for field in fields(made):
        value = getattr(made, field.name)
        assert not isinstance(value, np.ndarray) or not value.flags.writeable, field.name


def test_what_is_handed_over_is_copied():
    """A mask used for two forces, tables, molecules, and what is built of a scene."""
    mask = np.arange(81) < 10
    first = dpd.BodyForce([1.0, 0, 0], beads=mask)
    mask[:] = np.arange(81) >= 71
    second = dpd.BodyForce([0, 1.0, 0], beads=mask)
    assert np.flatnonzero(first.beads).tolist() == list(range(10))
    assert np.flatnonzero(second.beads).tolist() == list(range(71, 81))
    entries = {("A", "A"): dpd.DPD(A=25.0, gamma=4.5)}
    table = dpd.PairTable(entries)
    entries.clear()
    assert list(table.entries) == [("A", "A")]
    bonds, types, charges = [(0, 1, Spring(k=1.0, r0=1.0))], ["A", "B"], np.array([1.0, -1.0])
    molecule = Molecule(types, bonds, charges=charges)
    for value in (bonds, types, charges):
        spoil(value)
    assert (molecule.types, len(molecule.bonds), molecule.charges) == (("A", "B"), 1, (1.0, -1.0))
    arguments = scene_arguments()
    scene = dpd.Scene(**arguments)
    built = dpd.build(scene, dt=0.01, platform="Reference", seed=1)
    for quantity in (built.positions, built.velocities):
        spoil(quantity)
    assert np.array_equal(scene.positions, arguments["positions"])
    assert np.array_equal(scene.velocities, arguments["velocities"])


@pytest.mark.parametrize("seed", range(5))
def test_later_entries_win_and_order_has_no_meaning(seed):
    rng = np.random.default_rng(seed)
    names = list("ABCDE")
    keys = [tuple(rng.choice([*names, "*"], 2)) for _ in range(12)]
    entries = {}
    for number, key in enumerate(dict.fromkeys((str(a), str(b)) for a, b in keys)):
        if key[::-1] not in entries:
            entries[key] = dpd.DPD(A=float(number), gamma=1.0)
    found = dpd.PairTable(entries).resolve(names)

    def naive(pair):
        values = [c for (a, b), c in entries.items() if any((a in (x, "*")) and (b in (y, "*")) for x, y in (pair, pair[::-1]))]
        return values[-1] if values else None

    wanted = {pair: naive(pair) for pair in combinations_with_replacement(names, 2)}
    assert found == {pair: value for pair, value in wanted.items() if value is not None}


def test_kernel_tables_are_symmetric_and_in_the_order_of_the_types():
    values = {("A", "A"): 1.0, ("B", "A"): 2.0, ("B", "B"): 3.0, ("C", "A"): 4.0, ("B", "C"): 5.0}
    pairs = {key: dpd.DPD(A=a, gamma=a / 10) for key, a in values.items()} | {("C", "C"): dpd.NONE}
    scene = dpd.Scene({"A": 1.0, "B": 1.0, "C": 1.0}, list("ABC"), np.eye(3), pairs, kT=1.0, box=[4.0] * 3)
    (table,) = dpd.make_plan(scene, dt=0.01).spec.terms
    np.testing.assert_array_equal(table.A, [[1, 2, 4], [2, 3, 5], [4, 5, 0]])
    np.testing.assert_array_equal(table.gamma, np.array([[1, 2, 4], [2, 3, 5], [4, 5, 0]]) / 10)


def test_many_types_take_no_more_than_their_pairs():
    """45,150 pairs: 0.4 s where this was written; a search through all pairs for each entry would take more than ten minutes."""
    names = [f"T{k}" for k in range(300)]
    pairs = {pair: dpd.DPD(A=25.0, gamma=4.5) for pair in combinations_with_replacement(names, 2)}
    begun = time.process_time()
    scene = dpd.Scene(dict.fromkeys(names, 1.0), names, np.random.default_rng(1).random((300, 3)) * 5, pairs, kT=1.0, box=[5.0] * 3)
    dpd.build(scene, dt=0.01, platform="CPU")
    assert time.process_time() - begun < 20
