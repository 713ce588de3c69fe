"""Many-body DPD: the kernel's layer against the oracle, finite differences and live LAMMPS, and its potential as OpenMM forces."""

import pickle
from dataclasses import replace
from itertools import combinations

import lammps_peer
import lammps_steps
import numpy as np
import openmm
import oracle_density as od
import pytest
from cases import raises
from devices import Device
from openmm import unit
from scenes import BOX, BOXES, MASSES, noise_of, ready

import openmm_dpd as dpd
from openmm_dpd.kernels.dpd import TermTable
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine, PairSpec
from openmm_dpd.kernels.exceptions import compressed_exceptions
from openmm_dpd.kernels.manybody import ManyBodyTable
from openmm_dpd.kernels.sweeps import EXACT, SHARDLOW
from openmm_dpd.model.mdpd import MDPD, check_many_body, why_no_openmm_force
from openmm_dpd.model.pairs import NONE
from openmm_dpd.runtime.threads import set_threads
from openmm_dpd.simulation.build import build_plan

ALL = CONSERVATIVE | DISSIPATIVE | RANDOM
KT, DT, SEED, COUNTER = 1.3, 0.02, 21, 5
NAMES = ["A", "B"]
PAIRS = [("A", "A"), ("A", "B"), ("B", "B")]
RANGES = {"A": [-40.0, -30.0, -35.0], "gamma": [4.5, 2.0, 9.0], "cutoff": [1.0, 1.2, 0.9]}


def coefficients(kernel: str, **changed) -> dict:
    """Everything differs between the pairs of types that may."""
    values = {**RANGES, "B": [25.0] * 3, "cutoff_B": [0.75] * 3, "kernel": [kernel] * 3}
    if kernel == "lucy":
        values |= {"B": [25.0, 15.0, 20.0], "cutoff_B": [0.75, 0.8, 0.9], "cutoff_density": [0.75, 1.1, 0.6]}
    values |= changed
    return {pair: MDPD(**{key: value[k] for key, value in values.items()}) for k, pair in enumerate(PAIRS)}


TABLES = {"lucy": coefficients("lucy"), "quadratic": coefficients("quadratic"), "NONE": {**coefficients("quadratic"), ("A", "B"): NONE}}
TABLE = pytest.mark.parametrize("table", TABLES.values(), ids=TABLES.keys())
QUADRATIC = pytest.mark.parametrize("table", [TABLES["quadratic"], TABLES["NONE"]], ids=["quadratic", "NONE"])


def matrix(table: dict, key: str) -> np.ndarray:
    """(T, T) array of one coefficient, 0 for NONE."""
    array = np.zeros((2, 2))
    for (a, b), c in table.items():
        i, j = NAMES.index(a), NAMES.index(b)
        array[i, j] = array[j, i] = 0.0 if c is NONE else getattr(c, key)
    return array


def is_lucy(table: dict) -> bool:
    return table[("A", "A")].kernel == "lucy"


def kernel_table(table: dict, mass) -> ManyBodyTable:
    keys = ("A", "B", "gamma", "cutoff", "cutoff_B", "cutoff_density")
    return ManyBodyTable(**{key: matrix(table, key) for key in keys}, lucy=is_lucy(table), mass=mass)


class Fluid:
    """Random beads of two types and masses, strewn over several images of the box."""

    def __init__(self, table: dict, box=BOXES["ortho"], n: int = 90, seed: int = 1):
        rng = np.random.default_rng(seed)
        self.table, self.box, self.n = table, box, n
        self.x = rng.random((n, 3)) * 3.0 if box is None else (rng.random((n, 3)) + rng.integers(-1, 2, (n, 3))) @ box
        self.types = rng.integers(0, 2, n).astype(np.int32)
        self.mass = np.array(list(MASSES.values()))[self.types]
        self.v = rng.normal(size=(n, 3))

    def engine(self, *, factors=None, mobile=None, terms=None, update=EXACT) -> PairEngine:
        inv_mass = 1.0 / self.mass if mobile is None else np.where(mobile, 1.0 / self.mass, 0.0)
        terms = (kernel_table(self.table, self.mass),) if terms is None else terms
        spec = PairSpec(self.types, inv_mass, terms, update, exceptions=compressed_exceptions(factors or {}, self.n))
        return ready(PairEngine(pickle.loads(pickle.dumps(spec))), self.x, self.box)

    def oracle(self):
        """Densities, pair terms, and the potential of the quadratic kernel."""
        table, lucy = self.table, is_lucy(self.table)
        kernel, h = od.LUCY if lucy else od.WARREN, matrix(table, "cutoff_density")
        rho = od.local_density(self.x, self.types, h, self.box, kernel, self.mass if lucy else None)
        xi = np.zeros((self.n, self.n))
        noise = noise_of(self.n, SEED, COUNTER, KT)
        for i, j in combinations(range(self.n), 2):
            xi[i, j] = xi[j, i] = noise(i, j, 0)
        arrays = [matrix(table, key) for key in ("A", "B", "gamma", "cutoff", "cutoff_B")]
        terms = od.mdpd_pair(self.x, self.v, rho, self.types, *arrays, KT, self.box, DT, xi)
        if lucy:
            return rho, terms, terms.energy
        plain = od.mdpd_pair(self.x, self.v, 0 * rho, self.types, *arrays, KT, self.box, DT)
        c = table[("A", "A")]
        return rho, terms, plain.energy + np.pi * c.B * c.cutoff_B**4 / 30 * float(np.sum(rho**2))


def close(got, expected, rtol=1e-11):
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(got, expected, rtol=0, atol=rtol * np.abs(expected).max())


def gradient(fluid: Fluid, energy, h=1e-5) -> np.ndarray:
    """Central differences of energy(x)."""
    result = np.zeros_like(fluid.x)
    for k in np.ndindex(*fluid.x.shape):
        step = np.zeros_like(fluid.x)
        step[k] = h
        result[k] = (energy(fluid.x + step) - energy(fluid.x - step)) / (2 * h)
    return result


# ------------------------------------------------------------------------------------------------ kernel
@BOX
@TABLE
def test_forces_equal_the_oracle(table, box):
    fluid = Fluid(table, box)
    engine, (rho, terms, potential) = fluid.engine(), fluid.oracle()
    arguments = (fluid.v, KT, DT, SEED, COUNTER)
    energy, force, virial = engine.forces(CONSERVATIVE, None, KT, DT, SEED, COUNTER)
    close(force, terms.conservative)
    close(engine.layers[0].densities, rho)
    assert energy == pytest.approx(potential, rel=1e-11)
    assert virial == pytest.approx(np.trace(terms.virial_conservative), rel=1e-11)
    for which, expected, tensor in (
        (DISSIPATIVE, terms.dissipative, terms.virial_dissipative),
        (RANDOM, terms.random, terms.virial_random),
        (ALL, terms.forces, terms.virial_conservative + terms.virial_dissipative + terms.virial_random),
    ):
        energy, force, virial = engine.forces(which, *arguments)
        close(force, expected)
        assert virial == pytest.approx(np.trace(tensor), rel=1e-10)
        assert energy == pytest.approx(potential if which & CONSERVATIVE else 0.0, rel=1e-11)
        assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()


def test_two_beads_by_hand():
    """r = h/2: Lucy 105/(16 pi h^3) 5/16 times the other's mass; quadratic 15/(2 pi h^3)/4; F = A w + B (rho_0 + rho_1)/2."""
    h = 0.8
    for kernel, weight, share in (("lucy", 105 / (16 * np.pi * h**3) * 5 / 16, 0.5), ("quadratic", 15 / (8 * np.pi * h**3), 0.25)):
        fluid = Fluid(coefficients(kernel, B=[25.0] * 3, cutoff_B=[h] * 3, cutoff_density=[h] * 3), None, n=2)
        fluid.types[:] = 0, 1
        fluid.mass[:] = 1.0, 2.5
        fluid.x = np.array([[0.0, 0, 0], [h / 2, 0, 0]])
        engine = fluid.engine()
        energy, force, _ = engine.forces(CONSERVATIVE, None, 0.0, DT, 0, 0)
        rho = weight * (np.array([2.5, 1.0]) if kernel == "lucy" else np.ones(2))
        np.testing.assert_allclose(engine.layers[0].densities, rho, rtol=1e-14)
        w = 1 - h / 2 / 1.2
        assert force[0, 0] == pytest.approx(-(-30.0 * w + 25.0 * rho.sum() / 2), rel=1e-13)
        assert energy == pytest.approx(0.5 * -30.0 * 1.2 * w**2 + share * 25.0 * h * rho.sum() / 4, rel=1e-13)


FACTORS = {(0, 1): 0.0, (2, 3): 0.4, (4, 5): 0.0, (5, 6): 0.25}


def bonded(table, box=BOXES["ortho"]) -> Fluid:
    """Pairs of FACTORS close to each other."""
    fluid = Fluid(table, box)
    for (i, j), step in zip(FACTORS, np.random.default_rng(3).normal(size=(len(FACTORS), 3)), strict=True):
        fluid.x[j] = fluid.x[i] + 0.3 * step / np.linalg.norm(step)
    return fluid


@pytest.mark.parametrize("box", [BOXES["none"], BOXES["ortho"], BOXES["narrow"]], ids=["none", "ortho", "narrow"])
def test_factors_of_bonded_neighbours_lucy(box):
    """The density counts neighbours in full, or with a factor of 0 not at all; C and D have the factor, R its root: the difference to factor
    1 is that of single pairs."""
    fluid = bonded(TABLES["lucy"], box)
    scaled, full = fluid.engine(factors=FACTORS), fluid.engine(factors={pair: f for pair, f in FACTORS.items() if f == 0.0})
    every = fluid.engine().layers[0].densities - full.layers[0].densities
    assert np.all(every[[0, 1, 4, 5]] > 0.1) and np.all(np.abs(np.delete(every, [0, 1, 4, 5])) < 1e-14)
    assert np.array_equal(scaled.layers[0].densities, full.layers[0].densities)
    rho, noise = full.layers[0].densities, noise_of(fluid.n, SEED, COUNTER, KT)
    arguments = (fluid.v, KT, DT, SEED, COUNTER)
    expected = {which: full.forces(which, *arguments)[1] for which in (CONSERVATIVE, DISSIPATIVE, RANDOM)}
    energy = full.forces(CONSERVATIVE, *arguments)[0]
    for (i, j), f in ((pair, f) for pair, f in FACTORS.items() if f):
        two, keys = np.array([i, j]), ("A", "B", "gamma", "cutoff", "cutoff_B")
        arrays = [matrix(fluid.table, key)[np.ix_(fluid.types[two], fluid.types[two])] for key in keys]
        xi = np.array([[0.0, noise(i, j, 0)], [noise(i, j, 0), 0.0]])
        pair = od.mdpd_pair(fluid.x[two], fluid.v[two], rho[two], np.array([0, 1]), *arrays, KT, box, DT, xi)
        expected[CONSERVATIVE][two] -= (1 - f) * pair.conservative
        expected[DISSIPATIVE][two] -= (1 - f) * pair.dissipative
        expected[RANDOM][two] -= (1 - np.sqrt(f)) * pair.random
        energy -= (1 - f) * pair.energy
    for which, force in expected.items():
        close(scaled.forces(which, *arguments)[1], force)
    assert scaled.forces(CONSERVATIVE, *arguments)[0] == pytest.approx(energy, rel=1e-11)


@pytest.mark.parametrize("factors", [None, FACTORS], ids=["all", "bonded"])
@QUADRATIC
def test_quadratic_force_is_the_gradient_of_its_energy(table, factors):
    fluid = bonded(table, BOXES["tilted_narrow"])
    engine = fluid.engine(factors=factors)

    def energy(x):
        engine.prepare(x, fluid.box)
        return engine.forces(CONSERVATIVE, None, 0.0, DT, 0, 0)[0]

    expected = -gradient(fluid, energy)
    engine.prepare(fluid.x, fluid.box)
    close(engine.forces(CONSERVATIVE, None, 0.0, DT, 0, 0)[1], expected, 1e-7)


@pytest.mark.parametrize("factors", [None, FACTORS], ids=["all", "bonded"])
@QUADRATIC
def test_laplacian_is_that_of_the_energy_over_mobile_beads(table, factors):
    fluid, h = bonded(table), 1e-6
    mobile = np.arange(fluid.n) % 4 > 0
    engine = fluid.engine(factors=factors, mobile=mobile)
    expected = 0.0
    for bead in np.flatnonzero(mobile):
        for axis in range(3):
            force = []
            for shift in (h, -h):
                x = fluid.x.copy()
                x[bead, axis] += shift
                engine.prepare(x, fluid.box)
                force.append(engine.forces(CONSERVATIVE, None, 0.0, DT, 0, 0)[1][bead, axis])
            expected -= (force[0] - force[1]) / (2 * h)
    engine.prepare(fluid.x, fluid.box)
    assert engine.laplacian() == pytest.approx(expected, rel=1e-6)
    assert np.isnan(Fluid(TABLES["lucy"]).engine().laplacian())  # it has none


@pytest.mark.parametrize("update", [EXACT, SHARDLOW], ids=["exact", "shardlow"])
@pytest.mark.parametrize("table", [TABLES["lucy"], TABLES["quadratic"]], ids=["lucy", "quadratic"])
def test_friction_and_noise_are_those_of_dpd(table, update):
    fluid = bonded(table, BOXES["tilted"])
    zero, one = np.zeros((2, 2)), np.ones((2, 2))
    plain = TermTable(zero, matrix(table, "gamma"), np.full((2, 2), np.nan), zero, one, one, matrix(table, "cutoff"))
    # a pair of factor 0 may be in one list and not in the other, and then the orders of pairs differ
    factors = {pair: max(factor, 0.1) for pair, factor in FACTORS.items()}
    ours, dpd = fluid.engine(factors=factors, update=update), fluid.engine(factors=factors, update=update, terms=(plain,))
    kick = ours.sweep(fluid.v, KT, DT, SEED, COUNTER)
    assert np.array_equal(kick, dpd.sweep(fluid.v, KT, DT, SEED, COUNTER))
    assert np.abs(kick).max() > 0.01
    for which in (DISSIPATIVE, RANDOM):
        close(ours.forces(which, fluid.v, KT, DT, SEED, COUNTER)[1], dpd.forces(which, fluid.v, KT, DT, SEED, COUNTER)[1], 1e-13)


@TABLE
def test_same_bits_for_any_number_of_threads(table, two_threads):
    fluid = Fluid(table, BOXES["wide"], n=900)
    results = []
    for threads in (1, 2):
        set_threads(threads)
        engine = fluid.engine()
        energy, force, virial = engine.forces(ALL, fluid.v, KT, DT, SEED, COUNTER)
        results.append([np.array([energy, virial]), force, engine.layers[0].densities, engine.sweep(fluid.v, KT, DT, SEED, COUNTER)])
    for one, two in zip(*results, strict=True):
        assert np.array_equal(one, two)


@pytest.mark.parametrize("box", [BOXES["none"], BOXES["ortho"], BOXES["tilted_narrow"]], ids=["none", "ortho", "narrow"])
@TABLE
def test_beads_at_one_point_count_in_densities_alone(table, box):
    fluid = Fluid(table, box)
    fluid.x[1:3] = fluid.x[0]
    fluid.x[4] = fluid.x[3] + 1e-14
    engine, (rho, terms, potential) = fluid.engine(), fluid.oracle()
    close(engine.layers[0].densities, rho)
    energy, force, virial = engine.forces(ALL, fluid.v, KT, DT, SEED, COUNTER)
    close(force, terms.forces)
    assert energy == pytest.approx(potential, abs=1e-12 * np.abs(force).sum())
    assert virial == pytest.approx(np.trace(terms.virial_conservative + terms.virial_dissipative + terms.virial_random), rel=1e-10)
    swept = engine.sweep(fluid.v, KT, DT, SEED, COUNTER)
    assert np.all(np.isfinite(swept)) and np.isfinite(engine.laplacian()) != is_lucy(table)


# ------------------------------------------------------------------------------------------------ OpenMM
def context_of(fluid: Fluid, device, factors=None, integrator=None, mobile=None) -> openmm.Context:
    """The forces that a scene gets with conservative="openmm", under another integrator."""
    scene = dpd.Scene(MASSES, [NAMES[k] for k in fluid.types], fluid.x, fluid.table, kT=KT, box=fluid.box, mobile=mobile)
    plan = dpd.make_plan(scene, dt=DT, scheme="mvv", conservative="openmm", platform=device.platform, seed=SEED)
    system = build_plan(replace(plan, exceptions=factors or {})).system
    platform = openmm.Platform.getPlatformByName(device.platform)
    context = openmm.Context(system, integrator or openmm.VerletIntegrator(0.001), platform, device.properties)
    context.setPositions(fluid.x)
    return context


def state_of(context) -> tuple[float, np.ndarray]:
    state = context.getState(energy=True, forces=True)
    force = state.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
    return state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole), force


def spread_out(fluid: Fluid) -> Fluid:
    """Beads a little apart and near the origin, so that single precision keeps the directions."""
    rng = np.random.default_rng(5)
    places = np.stack(np.meshgrid(*[np.arange(5)] * 3, indexing="ij"), -1).reshape(-1, 3)[: fluid.n]
    cell = np.diag([3.0] * 3) if fluid.box is None else fluid.box
    fluid.x = ((places + 0.6 * rng.random((fluid.n, 3))) / 5) @ cell
    return fluid


@pytest.mark.parametrize("box", [None, BOXES["tilted"]], ids=["none", "tilted"])
@QUADRATIC
def test_openmm_forces_equal_the_kernel(table, box, device):
    """With frozen beads, which count, and a pair of bonded neighbours that does not."""
    fluid = spread_out(Fluid(table, box))
    first, second = np.flatnonzero(fluid.types == 0)[:2].tolist()
    fluid.x[second] = fluid.x[first] + [0.3, -0.2, 0.1]
    mobile, factors = np.arange(fluid.n) % 5 > 0, {(first, second): 0.0}
    energy, force, _ = fluid.engine(factors=factors, mobile=mobile).forces(CONSERVATIVE, None, 0.0, DT, 0, 0)
    got_energy, got = state_of(context_of(fluid, device, factors, mobile=mobile))
    # nonbonded forces are single precision on the CPU platform too; GPU platforms keep tabulated functions as such even in double precision
    tolerance = {"Reference": 1e-10}.get(device.platform, 1e-6 if device.precision == "double" else 1e-5)
    # OpenMM does not promise forces on frozen beads
    np.testing.assert_allclose(got[mobile], force[mobile], rtol=0, atol=tolerance * np.abs(force).max())
    assert got_energy == pytest.approx(energy, rel=tolerance)
    assert np.abs(force - fluid.engine(mobile=mobile).forces(CONSERVATIVE, None, 0.0, DT, 0, 0)[1]).max() > 0.1


def test_tables_that_have_no_potential_are_refused():
    for message, table in (
        (r"types \(A, B\): B = 15.0 differs from 25.0 of types \(A, A\)", coefficients("quadratic", B=[25.0, 15.0, 25.0])),
        (r"types \(B, B\): cutoff_B = 0.8 differs", coefficients("quadratic", cutoff_B=[0.75, 0.75, 0.8])),
        (r"types \(A, B\): kernel = 'lucy' differs from 'quadratic'", TABLES["quadratic"] | {("A", "B"): TABLES["lucy"]["A", "B"]}),
        ("interacts", {("A", "A"): NONE}),
    ):
        raises(dpd.ParameterError, message, check_many_body, table)
    for table in TABLES.values():
        check_many_body(table)


def test_what_openmm_forces_cannot_do():
    table = TABLES["quadratic"]
    assert why_no_openmm_force(table, {(0, 1): 0.0, (1, 2): 1.0}, []) is None
    assert "r = 0" in why_no_openmm_force(table, {}, [(3, 7)])
    assert "beads 1 and 2 (counted from 0) has the factor 0.5" in why_no_openmm_force(table, {(1, 2): 0.5}, [])
    fluid = Fluid(TABLES["lucy"])
    raises(dpd.PlanError, "conservative='openmm' is not possible: .* Lucy", lambda: context_of(fluid, Device("Reference")))


# ------------------------------------------------------------------------------------------------ live LAMMPS
def test_densities_forces_and_energy_equal_lammps():
    """Step 0 at T = 0: conservative forces and drag."""
    lammps_peer.need(("pair", "mdpd"), ("pair", "mdpd/rhosum"))
    table = TABLES["lucy"]
    fluid = Fluid(table, lammps_steps.peer_box(), n=150)
    fluid.x = np.random.default_rng(12).uniform(4.0, 7.0, (fluid.n, 3))
    numbers = {("A", "A"): "1 1", ("A", "B"): "1 2", ("B", "B"): "2 2"}
    commands = [
        "pair_style hybrid/overlay mdpd/rhosum mdpd 0.0 1.2 99",
        *(f"pair_coeff {numbers[pair]} mdpd/rhosum {c.cutoff_density}" for pair, c in table.items()),
        *(f"pair_coeff {numbers[pair]} mdpd {c.A} {c.B} {c.gamma} {c.cutoff} {c.cutoff_B}" for pair, c in table.items()),
    ]
    peer = lammps_steps.run("mdpd", fluid.x, fluid.v, fluid.types, list(MASSES.values()), commands, 0, {"rho": "atom:rho"})
    engine = fluid.engine()
    energy, force, _ = engine.forces(ALL, fluid.v, 0.0, DT, 0, 0)
    close(engine.layers[0].densities, peer.values["rho"], 1e-10)
    close(force, peer.f, 1e-10)
    assert energy == pytest.approx(peer.pe, rel=1e-10)
