"""Smeared charges: pair energies and forces, lattice sums, bonded neighbours, input."""

import sys
import warnings
from functools import cache

import numpy as np
import openmm
import pytest
from cases import cases, each_with, raises
from devices import DEVICES
from openmm import unit
from oracle_charges import gaussian_tail, lattice_sum, slater_tail

import openmm_dpd as dpd
from openmm_dpd.units import COULOMB

mpmath = pytest.importorskip("mpmath")

ONE = {"permittivity": COULOMB}  # Coulomb constant 1.
KINDS = {"slater": (dpd.SlaterCharges, "lamda", slater_tail), "gaussian": (dpd.GaussianCharges, "width", gaussian_tail)}


def charges_of(kind, width, **options):
    maker, name, _ = KINDS[kind]
    return maker(**{name: width}, **ONE, **options)


def scene(x, q, electrostatics, box=None, **options):
    n = len(x)
    options.setdefault("pairs", {("W", "W"): dpd.DPD(A=0.0, gamma=1.0)})
    return dpd.Scene({"W": 1.0}, ["W"] * n, x, kT=1.0, box=box, charges=q, electrostatics=electrostatics, **options)


def evaluate(scene, device):
    """Energy, forces and virial of the charges; nothing else exerts forces."""
    built = dpd.build(scene, dt=0.01, platform=device.platform, seed=1)
    found = dpd.Observer(built).sample(built.simulation(properties=device.properties).context)
    return found.coulomb_real + found.coulomb_reciprocal, found.forces, found.virial_conservative


def exact_pair(kind, width, r):
    """Energy and force of two unit charges, to 30 digits."""
    with mpmath.workdps(60):
        r, w = mpmath.mpf(float(r)), mpmath.mpf(float(width))
        if kind == "slater":
            y = 2 * r / w
            return float((1 - (1 + y / 2) * mpmath.exp(-y)) / r), float((1 - mpmath.exp(-y) * (1 + y + y**2 / 2)) / r**2)
        t = r / (2 * w)
        return float(mpmath.erf(t) / r), float((mpmath.erf(t) - 2 * t / mpmath.sqrt(mpmath.pi) * mpmath.exp(-t * t)) / r**2)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("width", [0.25, 1.3])
def test_pairs_against_mpmath(kind, width, device):
    """Two charges without a box at twenty distances from 1e-6 on, one after the other."""
    pair = scene(np.array([[0.0, 0, 0], [1, 0, 0]]), [1.0, -1.0], charges_of(kind, width))
    built = dpd.build(pair, dt=0.01, platform=device.platform, loop=False)  # OpenMM's forces
    context = built.simulation(properties=device.properties).context
    top = exact_pair(kind, width, width)[1]
    for r in np.geomspace(1e-6, 8 * width, 20):
        context.setPositions([[0, 0, 0], [r, 0, 0]])
        state = context.getState(energy=True, forces=True, groups={17})
        energy = state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
        force = state.getForces(asNumpy=True)._value[:, 0]
        wanted_energy, wanted_force = exact_pair(kind, width, np.float32(r) if device.precision == "single" else r)
        tolerance = 1e-9 if device.platform == "Reference" or device.precision == "double" else 1e-5
        assert energy == pytest.approx(-wanted_energy, rel=tolerance), r
        grain = 2.0**-31 if device.platform == "OpenCL" else 0.0  # GPU platforms add forces up in 64-bit fixed point
        assert force[0] == pytest.approx(wanted_force, rel=tolerance, abs=tolerance * 0.1 * top + grain), r
        assert force[0] == pytest.approx(-force[1], rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_potential_is_that_of_the_force(kind):
    """The function of the model, beside mpmath."""
    charges = charges_of(kind, 0.4)
    r = np.geomspace(1e-7, 5, 40)
    np.testing.assert_allclose(charges.potential(r), [exact_pair(kind, 0.4, one)[0] for one in r], rtol=1e-13)
    assert charges.tail(charges.reach(1e-5)) == pytest.approx(1e-5, rel=1e-6)


def electrolyte(n, edge, ions, seed=1):
    rng = np.random.default_rng(seed)
    q = np.zeros(n)
    q[:ions], q[ions : 2 * ions] = 1.0, -1.0
    return rng.random((n, 3)) * edge, q


CASES = {
    "dense": ("slater", 0.25, 5.0, 120, 60),
    "dilute": ("slater", 0.25, 5.0, 150, 3),
    "wide": ("slater", 0.929, 14.0, 120, 40),
    "gaussian": ("gaussian", 0.3, 5.0, 150, 30),
}


#: Every platform in every precision has mostly charged beads and few ions; the other cases, slow to compile, are for Reference and CPU.
MATRIX = [
    pytest.param(case, device, marks=pytest.mark.slow if case in ("wide", "gaussian") and not device.exact else (), id=f"{device}-{case}")
    for device in DEVICES
    for case in CASES
]


@cache
def exact_sum(case: str):
    kind, width, edge, n, ions = CASES[case]
    return lattice_sum(*electrolyte(n, edge, ions), np.eye(3) * edge, KINDS[kind][2], width)


@pytest.mark.parametrize(("case", "device"), MATRIX, indirect=["device"])
def test_forces_of_the_lattice_at_default_settings(case, device):
    """Root mean square error of the forces over their root mean square: 1e-4, the default tolerance; the energy and virial to match."""
    kind, width, edge, n, ions = CASES[case]
    x, q = electrolyte(n, edge, ions)
    energy, forces, virial = evaluate(scene(x, q, charges_of(kind, width), [edge] * 3), device)
    exact_energy, exact, exact_virial = exact_sum(case)
    assert np.sqrt(np.sum((forces - exact) ** 2) / np.sum(exact**2)) < 1e-4
    assert energy == pytest.approx(exact_energy, rel=1e-4)
    assert virial == pytest.approx(exact_virial, rel=2e-4)


def test_tilted_box_and_tight_tolerance(device):
    """A tilted box; the tolerance is kept when it is smaller, as far as the precision goes."""
    box = np.array([[6.0, 0, 0], [1.0, 5.5, 0], [-0.8, 1.2, 6.5]])
    x, q = electrolyte(60, 5.0, 20)
    energy, forces, virial = evaluate(scene(x, q, charges_of("slater", 0.25, tolerance=1e-6), box), device)
    exact_energy, exact, exact_virial = lattice_sum(x, q, box, slater_tail, 0.25)
    double = device.platform == "Reference" or device.precision == "double"
    assert np.sqrt(np.sum((forces - exact) ** 2) / np.sum(exact**2)) < (1e-6 if double else 1e-4)
    assert energy == pytest.approx(exact_energy, rel=1e-6 if double else 1e-4)
    assert virial == pytest.approx(exact_virial, rel=1e-5 if double else 1e-4)


@pytest.mark.parametrize("loop", [True, False])
def test_virial_is_the_derivative_of_the_energy(loop):
    """-dE/dlnL by finite differences of the package's own energies, at a width that stays."""
    x, q = electrolyte(40, 5.0, 15)
    electrostatics = charges_of("slater", 0.3, tolerance=1e-7, cutoff=2.4, alpha=1.8, grid=(60, 60, 60))

    def at(s):
        built = dpd.build(scene(x * s, q, electrostatics, [5.0 * s] * 3), dt=0.01, platform="Reference", seed=1, loop=loop)
        sample = dpd.Observer(built).sample(built.simulation().context)
        return sample.coulomb_real + sample.coulomb_reciprocal, sample.virial_conservative

    h = 1e-4
    assert at(1.0)[1] == pytest.approx(-(at(1 + h)[0] - at(1 - h)[0]) / (2 * h), rel=2e-5)


@pytest.mark.parametrize("periodic", [True, False])
def test_factors_of_bonded_neighbours(periodic, device):
    """Chains of four: f times the smeared energy of 1-2, 1-3 and 1-4 pairs, all of it, and the lattice's for all others and for images."""
    rng = np.random.default_rng(5)
    x = rng.random((16, 3)) * 2.0
    x[5] = x[4]  # bonded beads at the same point
    q = rng.choice([-1.0, 1.0, 2.0], 16)
    q -= np.round(q.mean())
    q[0] -= q.sum()
    pairs = np.array([(k, k + 1) for k in range(16) if k % 4 != 3])
    special = (0.0, 0.5, 0.8)
    box = np.eye(3) * 6.0 if periodic else None
    electrostatics = charges_of("slater", 0.25, tolerance=1e-6)
    bonded = scene(x, q, electrostatics, box, bonds=[dpd.HarmonicBonds(pairs, 0.0, 0.0)], bonded_factors=special)
    energy, forces, _ = evaluate(bonded, device)
    wanted, pull = (lattice_sum(x, q, box, slater_tail, 0.25)[:2]) if periodic else (0.0, np.zeros_like(x))
    for i in range(16):
        for j in range(i):
            apart = i - j if i // 4 == j // 4 else 0
            factor = (special[apart - 1] if apart else 1.0) - (1.0 if periodic else 0.0)
            d = x[i] - x[j]
            r = max(float(np.linalg.norm(d)), 1e-12)
            u, f = exact_pair("slater", 0.25, r)
            wanted += factor * q[i] * q[j] * u
            pull[i] += factor * q[i] * q[j] * f * d / r
            pull[j] -= factor * q[i] * q[j] * f * d / r
    double = device.platform == "Reference" or device.precision == "double"
    assert energy == pytest.approx(wanted, rel=2e-6 if double else 1e-4)
    np.testing.assert_allclose(forces, pull, atol=(3e-6 if double else 1e-4) * np.abs(pull).max())


def test_charges_have_factors_of_their_own():
    """``bonded_factors`` of the charges beside that of the scene."""
    x, q = np.array([[1.0, 1, 1], [1.4, 1, 1]]), np.array([1.0, -1.0])
    bonds = [dpd.HarmonicBonds([(0, 1)], 0.0, 0.0)]
    options, bonded = {"bonds": bonds, "bonded_factors": (0.25, 1, 1)}, (None, (0.5, 1.0, 1.0))
    found = [evaluate_energy(scene(x, q, charges_of("slater", 0.25, bonded_factors=own), None, **options)) for own in bonded]
    whole = -exact_pair("slater", 0.25, 0.4)[0]
    assert found == pytest.approx([0.25 * whole, 0.5 * whole], rel=1e-9)


def evaluate_energy(scene):
    built = dpd.build(scene, dt=0.01, platform="Reference", seed=1)
    sample = dpd.Observer(built).sample(built.simulation().context)
    return sample.coulomb_real + sample.coulomb_reciprocal


def test_opposite_charges_at_the_same_point(device):
    """Finite energies and forces, and a run that stays finite, in every precision and every scheme's company."""
    x, q = electrolyte(60, 5.0, 10)
    x[10:20] = x[:10]  # every cation under an anion
    x[11] = x[1] + [1e-6, 0, 0]
    electrostatics = charges_of("slater", 0.25)
    pairs = {("W", "W"): dpd.DPD(A=25.0, gamma=4.5)}
    built = dpd.build(scene(x, q, electrostatics, [5.0] * 3, pairs=pairs), dt=0.01, platform=device.platform, seed=3)
    simulation = built.simulation(properties=device.properties)
    first = dpd.Observer(built).sample(simulation.context)
    assert np.all(np.isfinite(first.forces))
    assert first.coulomb_real + first.coulomb_reciprocal < -10 / 0.25 * 0.8
    simulation.step(20)
    assert np.isfinite(dpd.Observer(built).sample(simulation.context).potential)


@cases(
    "device, scheme",
    *each_with(DEVICES, lambda _: ("mvv", "shardlow", "middle", "aboba", "bababo", "native"), 4),
    indirect=["device"],
    ids=str,
)
def test_every_scheme_runs_with_charges(scheme, device):
    x, q = electrolyte(81, 3.0, 10)
    pairs = {("W", "W"): dpd.DPD(A=25.0, gamma=4.5)}
    electrostatics = dpd.SlaterCharges(lamda=0.25, bjerrum_length=1.0, cutoff=1.5)
    built = dpd.build(scene(x, q, electrostatics, [3.0] * 3, pairs=pairs), dt=0.01, scheme=scheme, platform=device.platform, seed=3)
    simulation = built.simulation(properties=device.properties)
    simulation.step(10)
    sample = dpd.Observer(built).sample(simulation.context)
    assert np.isfinite(sample.potential) and np.isfinite(sample.pressure()) and sample.coulomb_reciprocal != 0
    np.testing.assert_allclose(sample.momentum, 0, atol=5e-3)  # PME conserves momentum to its accuracy


def test_one_list_or_all_pairs():
    """Mostly charged beads go through the neighbour list, few ions through all their pairs: the same forces."""
    x, q = electrolyte(100, 5.0, 25)
    found = []
    for listed in (True, False):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys.modules["openmm_dpd.simulation.scene_system"], "needs_list", lambda *_, answer=listed: answer)
            built = dpd.build(scene(x, q, charges_of("slater", 0.25), [5.0] * 3), dt=0.01, platform="Reference", seed=1, loop=False)
        pair = next(f for f in built.system.getForces() if isinstance(f, openmm.CustomNonbondedForce))
        assert (pair.getNumInteractionGroups() == 0) == listed
        found.append(dpd.force_terms(built)["electrostatic"])
    np.testing.assert_allclose(*found, atol=1e-9)


def test_plan_says_what_it_does():
    x, q = electrolyte(50, 5.0, 10)
    text = dpd.explain_plan(dpd.make_plan(scene(x, q, charges_of("slater", 0.25, cutoff=2.0), [5.0] * 3), dt=0.01, platform="OpenCL"))
    assert "20 charged beads, total charge 0 e: Slater charges, lambda = 0.25 nm" in text and "real space to 2 nm, PME" in text
    text = dpd.explain_plan(dpd.make_plan(scene(x, q, charges_of("slater", 0.6, cutoff=2.0), [5.0] * 3), dt=0.01))
    assert "beyond that charges are point charges" in text
    assert "every pair, no cutoff" in dpd.explain_plan(dpd.make_plan(scene(x, q, charges_of("gaussian", 0.6)), dt=0.01))


def test_units():
    """Permittivity and Bjerrum length, as Quantities and bare numbers."""
    angstrom = unit.angstrom
    charges = dpd.SlaterCharges(lamda=2.5 * angstrom, bjerrum_length=7 * angstrom)
    assert (charges.lamda, charges.bjerrum_length) == pytest.approx((0.25, 0.7))
    assert charges.coulomb(2.5) == pytest.approx(1.75)
    assert dpd.GaussianCharges(width=0.1, permittivity=78.0).coulomb(2.5) == pytest.approx(COULOMB / 78)
    assert COULOMB / 78 / (dpd.units.BOLTZMANN * 300) == pytest.approx(0.714, abs=1e-3)  # water at 300 K: the Bjerrum length is 0.714 nm


@cases(
    "message, options",
    ("lamda of SlaterCharges must be > 0", {"lamda": 0.0, "permittivity": 1}),
    ("lamda of SlaterCharges must be > 0", {"lamda": -1.0, "permittivity": 1}),
    ("lamda of SlaterCharges holds nan", {"lamda": float("nan"), "permittivity": 1}),
    ("which is no length", {"lamda": 1 * unit.picosecond, "permittivity": 1}),
    ("both are given", {"lamda": 1, "permittivity": 1, "bjerrum_length": 1}),
    ("neither is given", {"lamda": 1}),
    ("permittivity of SlaterCharges must be", {"lamda": 1, "permittivity": 0}),
    ("bjerrum_length of SlaterCharges must be", {"lamda": 1, "bjerrum_length": -2}),
    ("cutoff of SlaterCharges must be", {"lamda": 1, "permittivity": 1, "cutoff": 0}),
    ("tolerance of SlaterCharges must be between", {"lamda": 1, "permittivity": 1, "tolerance": 0.5}),
    ("grid of SlaterCharges must be three", {"lamda": 1, "permittivity": 1, "grid": (8, 8)}),
    ("bonded_factors of SlaterCharges must be three", {"lamda": 1, "permittivity": 1, "bonded_factors": (1, 1, 2)}),
)
def test_bad_values_of_charges(message, options):
    raises(dpd.ParameterError, message, dpd.SlaterCharges, **options)


def test_bad_scenes():
    x, q = electrolyte(20, 5.0, 5)
    good, clouds = charges_of("slater", 0.25), dpd.SlaterCharges(lamda=1, bjerrum_length=1)
    table = {("W", "W"): dpd.DPD(A=1, gamma=0)}
    for message, make in {
        "needs the charges of the beads": lambda: scene(x, None, good, [5.0] * 3),
        "all charges are 0": lambda: scene(x, 0 * q, good, [5.0] * 3),
        "must be SlaterCharges": lambda: scene(x, q, "slater", [5.0] * 3),
        "over half the box, whose smallest width is 5": lambda: scene(x, q, charges_of("slater", 0.25, cutoff=2.6), [5.0] * 3),
        "of the real-space sum is beyond the cutoff": lambda: scene(x, q, charges_of("slater", 0.25, alpha=0.1), [5.0] * 3),
        # OpenMM crashes when it makes such grids
        "would need a grid of": lambda: scene(x, q, charges_of("slater", 0.25, cutoff=0.01), [5.0] * 3),
        "would need a grid of 1": lambda: scene(x, q, charges_of("slater", 0.25, grid=(100000, 100000, 100000)), [5.0] * 3),
        "is too coarse": lambda: scene(x, q, charges_of("slater", 0.25, alpha=3.0, grid=(6, 6, 6)), [5.0] * 3),
        "cutoff and alpha would have no effect": lambda: scene(x, q, charges_of("slater", 0.25, cutoff=2.0, alpha=2.0)),
        "the smearing reaches to": lambda: scene(x, q, charges_of("slater", 0.6), [5.0] * 3),
        "a Bjerrum length needs a temperature": lambda: dpd.Scene({"W": 1}, ["W"] * 20, x, table, kT=0, charges=q, electrostatics=clouds),
    }.items():
        raises(dpd.ParameterError, message, make)
    raises(dpd.ParameterError, "charges", lambda: scene(x, [*q[:-1], np.nan], good, [5.0] * 3))


def test_a_charged_box_warns():
    x, q = electrolyte(20, 5.0, 5)
    with pytest.warns(UserWarning, match="the charges add up to 1 e; in a periodic box"):
        charged = scene(x, np.where(np.arange(20) == 19, 1.0, q), charges_of("slater", 0.25, tolerance=1e-6, cutoff=2.2), [5.0] * 3)
    assert evaluate_energy(charged) == pytest.approx(lattice_sum(x, charged.charges, np.eye(3) * 5, slater_tail, 0.25)[0], rel=1e-5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene(x, np.where(np.arange(20) == 19, 1.0, q), charges_of("slater", 0.25))  # no box, nothing to make up for
