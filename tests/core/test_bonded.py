"""Bonds and angles of the model: energies against closed forms, derivatives and Laplacians against finite differences, bad input."""

import numpy as np
import openmm
import pytest
from cases import cases, refused
from openmm import unit
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.measure.stress_parts import angle_sums, bond_sums, stress_parts

PAIR = np.array([[0, 1]])
CURVES = {
    "harmonic": (dpd.HarmonicBonds(PAIR, 20.0, 0.7), lambda r: 20 * (r - 0.7) ** 2, (0.1, 0.7, 1.4)),
    "fene": (dpd.FENEBonds(PAIR, 30.0, 1.5), lambda r: -0.5 * 30 * 1.5**2 * np.log(1 - r * r / 2.25), (0.0, 0.4, 1.49)),
    "fene with repulsion": (
        dpd.FENEBonds(PAIR, 30.0, 1.5, 0.8, 0.9),
        lambda r: -33.75 * np.log(1 - r * r / 2.25) + (0.8 + 3.2 * ((0.9 / r) ** 12 - (0.9 / r) ** 6) if r < 0.9 * 2 ** (1 / 6) else 0.0),
        (0.6, 0.97, 1.0, 1.02, 1.3),
    ),
    "morse": (dpd.MorseBonds(PAIR, 12.0, 1.7, 0.6), lambda r: 12 * (1 - np.exp(-1.7 * (r - 0.6))) ** 2, (0.05, 0.6, 2.0)),
    "nonlinear": (dpd.NonlinearBonds(PAIR, 12.0, 0.7, 0.5), lambda r: 12 * (r - 0.7) ** 2 / (0.25 - (r - 0.7) ** 2), (0.3, 0.7, 1.1)),
    "quartic": (
        dpd.QuarticBonds(PAIR, 1200.0, -0.55, 0.25, 1.3, 34.7),
        lambda r: 1200 * (r - 1.3) ** 2 * (r - 0.75) * (r - 1.55) + 34.7 + (4 * (r**-12 - r**-6) + 1 if r < 2 ** (1 / 6) else 0),
        (0.8, 0.97, 1.12, 1.2),
    ),
    "harmonic angle": (dpd.HarmonicAngles([(0, 1, 2)], 6.0, 1.9), lambda t: 6 * (t - 1.9) ** 2, (0.3, 1.9, 3.0)),
    "cosine angle": (dpd.CosineAngles([(0, 1, 2)], 4.0), lambda t: 4 * (1 + np.cos(t)), (0.3, 1.9, np.pi)),
    "delta angle": (dpd.CosineDeltaAngles([(0, 1, 2)], 4.0, 1.2), lambda t: 4 * (1 - np.cos(t - 1.2)), (0.3, 1.2, np.pi)),
    "squared angle": (dpd.CosineSquaredAngles([(0, 1, 2)], 4.0, 1.2), lambda t: 4 * (np.cos(t) - np.cos(1.2)) ** 2, (0.3, 1.2, np.pi)),
    "periodic angle": (dpd.PeriodicAngles([(0, 1, 2)], 4.0, -1, 3), lambda t: 8 / 9 * (1 - np.cos(3 * t)), (0.3, 1.2, np.pi)),
}


@cases("term, formula, points", CURVES)
def test_energies_and_derivatives(term, formula, points):
    for point in points:
        energy, slope, curvature = (float(value[0]) for value in term.curve(np.array([point])))
        assert energy == pytest.approx(formula(point), rel=1e-13, abs=1e-13)
        if point > 0:
            h = 1e-4
            low, high = (term.curve(np.array([point + step])) for step in (-h, h))
            scale = abs(slope) + abs(curvature) + 1
            assert slope == pytest.approx((high[0][0] - low[0][0]) / (2 * h), abs=3e-4 * scale)
            assert curvature == pytest.approx((high[1][0] - low[1][0]) / (2 * h), abs=3e-3 * scale)


def test_laplacians_and_virials_by_finite_differences():
    """Of all kinds together; half of the beads do not move and are left out."""
    x = np.random.default_rng(3).random((6, 3)) * 0.6 + 1.2
    mobile = np.array([True, False, True, True, False, True])
    fene, morse = dpd.FENEBonds([(1, 2), (3, 4)], 30, 1.5, 0.2, 0.4), dpd.MorseBonds([(4, 5)], 12, 2, 0.6)
    terms = {"bonds": [dpd.HarmonicBonds([(0, 1)], 20, 0.7), fene, morse]}
    terms["angles"] = [dpd.HarmonicAngles([(0, 1, 2), (3, 4, 5)], 6, 1.9), dpd.CosineAngles([(1, 2, 3)], 4)]
    terms["angles"] += [dpd.CosineDeltaAngles([(0, 2, 4)], 5, 1.2), dpd.CosineSquaredAngles([(1, 3, 5)], 5, 1.2)]
    terms["angles"].append(dpd.PeriodicAngles([(2, 1, 4)], 5, -1, 3))
    plan = dpd.make_plan(beads(6, positions=x, mobile=mobile, **terms), dt=0.01, seed=1)

    def energy(y) -> float:
        return bond_sums(plan, y, None, mobile)[0] + angle_sums(plan, y, None, mobile)[0]

    virial = sum(part(x, None)[:3].sum() for part in stress_parts(plan))
    laplacian = bond_sums(plan, x, None, mobile)[1] + angle_sums(plan, x, None, mobile)[1]
    h, second = 1e-4, 0.0
    for step in h * np.eye(18).reshape(6, 3, 6, 3)[mobile].reshape(-1, 6, 3):
        second += (energy(x + step) - 2 * energy(x) + energy(x - step)) / h**2
    assert laplacian == pytest.approx(second, rel=1e-5)
    assert virial == pytest.approx(-((energy(x * (1 + 1e-5)) - energy(x * (1 - 1e-5))) / 2e-5), rel=1e-7)


def test_units():
    bonds = dpd.FENEBonds(PAIR, 1 * unit.kilocalorie_per_mole / unit.angstrom**2, 15 * unit.angstrom, 1 * unit.kilocalorie_per_mole)
    assert (bonds.k[0], bonds.R0[0], bonds.epsilon[0], bonds.sigma[0]) == pytest.approx((418.4, 1.5, 4.184, 1.0))
    assert dpd.MorseBonds(PAIR, 1, 0.1 / unit.angstrom, 1).alpha[0] == pytest.approx(1.0)
    angles = dpd.HarmonicAngles([(0, 1, 2)], 2 * unit.kilojoule_per_mole / unit.radian**2, 120 * unit.degree)
    assert (angles.k[0], angles.theta0[0]) == pytest.approx((2.0, 2 * np.pi / 3))


def scene(**options):
    x = np.zeros((4, 3))
    x[:, 0] = [0.1, 0.9, 1.7, 2.9]
    return beads(4, positions=x, **options)


_TWICE = [dpd.CosineAngles([(0, 1, 2)], 1), dpd.HarmonicAngles([(2, 1, 0)], 1, 1)]
_TOO_LONG = r"FENE bond between beads 2 and 3 \(counted from 0\) is 1.2 nm long, which is not less than its R0 of 1.1 nm"
_POINT = {"positions": np.ones((2, 3)), "bonds": [dpd.FENEBonds(PAIR, 1, 1.1, 1)]}
BAD = {
    "negative k": (lambda: dpd.FENEBonds(PAIR, -1, 1.5), "bond k must be >= 0"),
    "no R0": (lambda: dpd.FENEBonds(PAIR, 1, 0), "bond R0 must be > 0"),
    "no sigma": (lambda: dpd.FENEBonds(PAIR, 1, 1, 1, 0), "bond sigma must be > 0"),
    "negative alpha": (lambda: dpd.MorseBonds(PAIR, 1, -2, 1), "bond alpha must be >= 0, but is -2"),
    "wrong unit": (lambda: dpd.MorseBonds(PAIR, 1, 1 * unit.nanometer, 1), "bond alpha has the unit nanometer"),
    "degrees": (lambda: dpd.HarmonicAngles([(0, 1, 2)], 1, 120), r"must be from 0 to pi, but is 120 .*120 \* openmm.unit.degree"),
    "two beads": (lambda: dpd.CosineAngles([(0, 1)], 1), r"angle triples must be an integer array of shape \(K, 3\)"),
    "a bead twice": (lambda: dpd.CosineAngles([(2, 1, 2)], 1), "entry 0 of angle triples names bead 2 twice"),
    "too many k": (lambda: dpd.CosineAngles([(0, 1, 2)], [1, 2]), r"angle k must be one number, or one for each of the 1 angles"),
    "angle of a missing bead": (lambda: scene(angles=[dpd.CosineAngles([(0, 1, 4)], 1)]), "an angle names bead 4.*only 4 beads"),
    "angle twice": (lambda: scene(angles=_TWICE), r"0, 1 and 2 \(counted from 0\) is listed twice"),
    "not a sequence": (lambda: scene(angles=_TWICE[0]), "angles must be a sequence of HarmonicAngles or CosineAngles"),
    "bond for an angle": (lambda: scene(angles=[dpd.MorseBonds(PAIR, 1, 1, 1)]), "not a MorseBonds"),
    "angle for a bond": (
        lambda: scene(bonds=_TWICE[:1]),
        "HarmonicBonds or FENEBonds or MorseBonds or NonlinearBonds or QuarticBonds, not a CosineAngles",
    ),
    "too long": (lambda: scene(bonds=[dpd.FENEBonds([(0, 1), (2, 3)], 1, 1.1)]), _TOO_LONG),
    "at one point": (lambda: beads(2, **_POINT), r"beads 0 and 1 \(counted from 0\) are at the same point"),
}


test_bad_input = refused(dpd.ParameterError, BAD)


def test_bonds_through_the_box():
    """A FENE bond across a face is as long as its minimum image."""
    x = np.array([[0.1, 1, 1], [2.8, 1, 1]])
    made = beads(2, positions=x, bonds=[dpd.FENEBonds(PAIR, 1, 1.1)])
    assert made.bonds[0].lengths(x, made.box) == pytest.approx([0.3])


# -- pair potentials of bonded neighbours with a factor ---------------------------------------------------------------------------
R, S6 = 1.3, (1.1 / 1.3) ** 6
DISTANCES = np.linspace(0.0, 3.0, 61)
POTENTIALS = {
    "DPD": (dpd.DPD(A=25, cutoff=2.5), 0.5 * 25 * 2.5 * (1 - R / 2.5) ** 2, 25 * (1 - R / 2.5)),
    "LennardJones": (dpd.LennardJones(epsilon=0.8, sigma=1.1, cutoff=2.5), 3.2 * (S6**2 - S6), 19.2 * (2 * S6**2 - S6) / R),
    "TabulatedPair": (dpd.TabulatedPair(DISTANCES, (3.0 - DISTANCES) ** 2), (3.0 - R) ** 2, 2 * (3.0 - R)),
}


@cases("coefficient, energy, force", POTENTIALS)
@pytest.mark.parametrize("types", [["A", "A"], ["A", "B"]], ids=["one type", "two types"])
def test_factor_of_bonded_neighbours(coefficient, energy, force, types):
    """Half the energy and half the force of one pair, written out; with tables of type pairs as well as with constants."""
    table = {("A", "A"): coefficient} if types[1] == "A" else {("*", "*"): dpd.NONE, ("A", "B"): coefficient}
    bonded = {"bonds": [dpd.HarmonicBonds([[0, 1]], k=0, r0=1)], "bonded_factors": (0.5, 1.0, 1.0)}
    scene = dpd.Scene(dict.fromkeys(sorted(set(types)), 1.0), types, [[0, 0, 0], [R, 0, 0]], table, kT=1, **bonded)
    built = dpd.build(scene, dt=0.01, platform="Reference", conservative="openmm", seed=1)
    state = built.simulation().context.getState(energy=True, forces=True)
    assert state.getPotentialEnergy()._value == pytest.approx(0.5 * energy, rel=1e-6)
    assert state.getForces()[1].x == pytest.approx(0.5 * force, rel=1e-6)
    assert isinstance(built.system, openmm.System)
