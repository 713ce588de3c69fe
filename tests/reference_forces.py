"""What kernels are compared with: the oracle's forces, virials and noise, OpenMM's own forces on the Reference platform; and what every one has to keep to."""

import copy
import pickle

import numpy as np
import openmm
import pytest
from openmm import unit
from oracle import minimum_image
from scenes import noise_of, ready

from openmm_dpd.kernels import noise as hashed
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.runtime.decorators import compiled
from openmm_dpd.runtime.threads import set_threads

#: Boxes by name; positions are strewn over several images of each.
BOXES = {"none": None, "cubic": np.diag([4.5, 4.5, 4.5]), "tilted": np.array([[5.2, 0, 0], [1.9, 4.9, 0], [-2.0, 1.8, 4.4]])}


def reference(forces, x, box, **parameters) -> tuple[float, np.ndarray]:
    """Energy and forces that OpenMM gives for some of its forces."""
    system = openmm.System()
    for _ in x:
        system.addParticle(1.0)
    if box is not None:
        system.setDefaultPeriodicBoxVectors(*(openmm.Vec3(*row) for row in box.tolist()))
    for force in forces:
        system.addForce(copy.deepcopy(force))
    context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName("Reference"))
    context.setPositions(x)
    for name, value in parameters.items():
        context.setParameter(name, value)
    state = context.getState(energy=True, forces=True)
    force = state.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
    return state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole), np.array(force)


def evaluate(extras, x, box, scale=1.0, fewest=None) -> tuple[float, np.ndarray]:
    """Energy and forces of kernels, on top of a force that is there already."""
    before = np.random.default_rng(5).normal(size=x.shape)
    force, energy = before.copy(), 0.0
    for extra in extras:
        evaluator = extra.evaluator()
        if fewest is not None and hasattr(evaluator, "fewest"):
            evaluator.fewest = fewest
        energy += evaluator.add_to(x, box, force, scale)
    return energy, force - before


def check_agreement(extras, forces, x, box, rtol=1e-9, force_rtol=None) -> None:
    """Energy and every force agree with OpenMM's."""
    energy, force = evaluate(extras, x, box)
    expected, expected_force = reference(forces, x, box)
    assert np.abs(expected_force).max() > 1.0
    assert energy == pytest.approx(expected, rel=rtol)
    np.testing.assert_allclose(force, expected_force, rtol=0, atol=(force_rtol or rtol) * np.abs(expected_force).max())


def check_gradient(extras, x, box, every=7) -> None:
    """The forces are minus the slope of the energy."""
    _, force = evaluate(extras, x, box)
    evaluators, scratch, h = [extra.evaluator() for extra in extras], np.zeros_like(x), 1e-6

    def energy(bead, axis, step):
        moved = x.copy()
        moved[bead, axis] += step
        return sum(evaluator.add_to(moved, box, scratch, 1.0) for evaluator in evaluators)

    for bead in range(0, len(x), every):
        for axis in range(3):
            slope = (energy(bead, axis, h) - energy(bead, axis, -h)) / (2 * h)
            assert force[bead, axis] == pytest.approx(-slope, abs=1e-6 * np.abs(force).max())


def check_total_force(extras, x, box) -> None:
    """No net force."""
    _, force = evaluate(extras, x, box)
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * np.abs(force).sum()


def check_threads(extras, x, box) -> None:
    """The same bits for one thread and two, and whether or not there are enough terms for several."""
    results = []
    for threads, fewest in ((1, None), (2, 0), (2, None), (1, 0)):
        set_threads(threads)
        results.append(evaluate(extras, x, box, fewest=fewest))
    for energy, force in results[1:]:
        assert energy == results[0][0] and np.array_equal(force, results[0][1])


def check_pickle(extras, x, box) -> None:
    """What was pickled gives the same bits."""
    first, second = evaluate(extras, x, box), evaluate(pickle.loads(pickle.dumps(extras)), x, box)
    assert first[0] == second[0] and np.array_equal(first[1], second[1])


DT, SEED, COUNTER = 0.02, 21, 5
PARTS = (CONSERVATIVE, DISSIPATIVE, RANDOM)


def prepared(scene, scheme="mvv", dt=DT) -> PairEngine:
    """The engine of a scene that knows where its beads are."""
    return ready(PairEngine(make_plan(scene, dt=dt, seed=SEED, scheme=scheme).spec), scene.positions, scene.box)


def close(got, expected, rtol=1e-12):
    """Equal to rtol of the largest component, which is no rounding."""
    np.testing.assert_allclose(got, expected, rtol=0, atol=rtol * np.abs(expected).max())
    assert np.abs(expected).max() > 1e-3


def noise_matrices(n: int, kT: float = 1.0, counter: int = COUNTER, flows: int = 1):
    """The kernel's numbers: symmetric for the motion, antisymmetric (the lower index gets +) for the heat or each species."""
    draw = noise_of(n, SEED, counter, kT, streams=1 + flows)
    upper = np.array([[[draw(i, j, k) if i < j else 0.0 for j in range(n)] for i in range(n)] for k in range(1 + flows)])
    return upper[0] + upper[0].T, *(one - one.T for one in upper[1:])


@compiled
def _fill(key, stream, table):
    for i in range(len(table)):
        for j in range(i + 1, len(table)):
            table[i, j] = table[j, i] = hashed.uniform(hashed.pair_key(key, i, j), stream)


def uniform_matrix(n: int, seed: int, counter: int, stream: int) -> np.ndarray:
    """The kernel's uniform numbers, symmetric."""
    table = np.zeros((n, n))
    _fill(hashed.noise_key(seed, counter, 0, 1.0), stream, table)
    return table


def between(scene):
    """(i, j) -> distance, and unit vector from j to i."""

    def geometry(i: int, j: int):
        d = minimum_image(scene.positions[i] - scene.positions[j], scene.box)
        return np.linalg.norm(d), d / np.linalg.norm(d)

    return geometry


def same_terms(parts, terms) -> None:
    """Forces and virials of the conservative, dissipative and random part, (energy, force, virial, rates) each, are those of the oracle."""
    for (_, force, virial, _), part in zip(parts, ("conservative", "dissipative", "random"), strict=True):
        close(force, getattr(terms, part))
        assert virial == pytest.approx(np.trace(getattr(terms, f"virial_{part}")), rel=1e-11)
    assert parts[0][0] == pytest.approx(terms.energy, rel=1e-12)


def scaled_by(factor: float, one, other) -> None:
    """Energy, force and virial of the other are those of the one, times the factor."""
    close(other[1], factor * one[1])
    assert other[2] == pytest.approx(factor * one[2], rel=1e-12)
    assert other[0] == pytest.approx(factor * one[0], rel=1e-12)


def matrix(scene, key):
    """One coefficient of the first table of a scene, for all pairs of types."""
    names = scene.type_names
    entries = scene.tables[0].resolve(names)
    term = lambda a, b: entries[(names[min(a, b)], names[max(a, b)])]  # noqa: E731
    return np.array([[getattr(term(a, b), key) for b in range(len(names))] for a in range(len(names))])
