"""The kernel of segmental repulsion: against plain numpy over all pairs, finite differences, any number of threads, and odd input."""

import chains_of_beads as chains
import numpy as np
import pytest
from cases import raises
from scenes import BOXES

from openmm_dpd.base.errors import RunError
from openmm_dpd.kernels.segments import CLAMPED, MID, NEAREST, SegmentEngine, SegmentSpec, adjoining
from openmm_dpd.runtime.threads import set_threads

A, RC = 100.0, 0.8
RULES = pytest.mark.parametrize(("rule", "distance"), [(MID, "mid"), (NEAREST, "min")], ids=["mid", "min"])


def engine_of(x, bonds, rule, cutoff=RC, exclude=True) -> SegmentEngine:
    return SegmentEngine(SegmentSpec(len(x), np.asarray(bonds), A, cutoff, rule, exclude))


@RULES
@pytest.mark.parametrize("box", ["none", "ortho", "wide", "tilted", "slab"])
def test_energy_equals_the_sum_over_all_pairs(rule, distance, box):
    vectors = BOXES[box]
    edges = np.diag([4.0] * 3) if vectors is None else vectors
    cutoff = min(RC, 0.5 * np.diag(edges).min() - (0.62 if rule == NEAREST else 0.0))
    x, bonds, _ = chains.walks(15, 5, edges, 2, step=0.5, spread=0 if vectors is None else 2)
    energy, _, _ = engine_of(x, bonds, rule, cutoff).forces(x, vectors)
    expected = chains.segment_energy(x, bonds, vectors, A, cutoff, distance)
    assert expected > 10.0
    assert energy == pytest.approx(expected, rel=1e-11)


def test_bonds_that_share_a_bead():
    """Left out in stars and rings too; counted if asked for."""
    x = np.random.default_rng(1).random((7, 3))
    bonds = [(0, 1), (2, 0), (0, 3), (3, 4), (4, 5), (5, 3), (5, 6)]
    for exclude in (True, False):
        energy, _, _ = engine_of(x, bonds, MID, 1.5, exclude).forces(x, None)
        assert energy == pytest.approx(chains.segment_energy(x, bonds, None, A, 1.5, "mid", sharing=not exclude), rel=1e-13)
    assert len(adjoining(np.array(bonds))[1]) == 2 * (3 + 3 + 1 + 3)  # at the beads 0, 3, 4 and 5


@RULES
@pytest.mark.parametrize("box", ["none", "tilted"])
def test_forces_and_virial_are_the_gradient(rule, distance, box):
    vectors = BOXES[box]
    x, bonds, _ = chains.walks(15, 5, np.diag([4.0] * 3) if vectors is None else vectors, 4, step=0.5, spread=0)
    engine, h = engine_of(x, bonds, rule), 1e-6
    _, force, stress = engine.forces(x, vectors)
    force = force.copy()
    for bead in range(0, len(x), 5):
        for axis in range(3):
            step = np.zeros_like(x)
            step[bead, axis] = h
            slope = (engine.forces(x + step, vectors)[0] - engine.forces(x - step, vectors)[0]) / (2 * h)
            assert force[bead, axis] == pytest.approx(-slope, abs=1e-5 * np.abs(force).max())
    grown = [engine.forces(x * s, None if vectors is None else vectors * s)[0] for s in (1 - h, 1 + h)]
    assert stress[:3].sum() == pytest.approx(-(grown[1] - grown[0]) / (2 * h), rel=1e-6)
    assert np.abs(force.sum(axis=0)).max() < 1e-11 * np.abs(force).sum()


@pytest.mark.parametrize("rule", [MID, NEAREST, CLAMPED])
def test_the_same_bits_with_two_threads(rule, two_threads):
    box = np.diag([9.0, 8.0, 7.0])
    x, bonds, _ = chains.walks(100, 6, box, 5, step=0.5)
    results = []
    for threads in (1, 2, 1):
        set_threads(threads)
        results.append(engine_of(x, bonds, rule).forces(x, box))
    for other in results[1:]:
        assert all(np.array_equal(*both) for both in zip(other, results[0], strict=True))


@pytest.mark.parametrize("rule", [MID, NEAREST, CLAMPED])
def test_a_history_leaves_no_trace(rule):
    """An engine that saw other positions, longer bonds and another box gives what a fresh one gives."""
    box = np.diag([8.0, 8.0, 7.0])
    x, bonds, _ = chains.walks(40, 6, box, 5, step=0.5)
    used = engine_of(x, bonds, rule)
    used.forces(1.2 * x, 1.2 * box)
    used.forces(x + 0.1, box)
    again, fresh = used.forces(x, box), engine_of(x, bonds, rule).forces(x, box)
    assert again[0] == fresh[0] and np.array_equal(again[1], fresh[1])


def two(a, b, rule, cutoff=RC):
    """Energy and forces of two segments given by their ends."""
    x = np.array([*a, *b], dtype=float)
    energy, force, stress = engine_of(x, [(0, 1), (2, 3)], rule, cutoff).forces(x, None)
    assert np.all(np.isfinite(force)) and np.isfinite(energy + stress.sum())
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-10)
    return energy, force


CROSS = ([(-0.5, 0, 0.1), (0.5, 0, 0.1)], [(0, -0.3, 0), (0, 0.7, 0)])


def test_the_lever_rule():
    """Second bond: the contact is 0.3 from its first bead and 0.7 from its second."""
    energy, force = two(*CROSS, NEAREST)
    pull = A * (1 - 0.1 / RC)
    assert energy == pytest.approx(0.5 * A * RC * (1 - 0.1 / RC) ** 2)
    np.testing.assert_allclose(force[:, 2], [0.5 * pull, 0.5 * pull, -0.7 * pull, -0.3 * pull])
    energy, force = two(*CROSS, MID)
    d = np.hypot(0.1, 0.2)
    assert energy == pytest.approx(0.5 * A * RC * (1 - d / RC) ** 2)
    np.testing.assert_allclose(force[:2, 2], 0.5 * A * (1 - d / RC) * 0.1 / d)


@pytest.mark.parametrize("rule", [NEAREST, CLAMPED])
def test_touching_parallel_and_degenerate_segments(rule):
    assert not two([(-0.5, 0, 0), (0.5, 0, 0)], [(0, -0.3, 0), (0, 0.7, 0)], rule)[1].any()  # they touch: no direction
    energy, force = two([(0, 0, 0), (1, 0, 0)], [(0.5, 0, 0.4), (1.5, 0, 0.4)], NEAREST)  # parallel: the middle of the overlap
    assert energy == pytest.approx(0.5 * A * RC * 0.25)
    np.testing.assert_allclose(force[:, 2] / A, [-0.5 * 0.25, -0.5 * 0.75, 0.5 * 0.75, 0.5 * 0.25])
    energy, _ = two([(0, 0, 0), (1, 0, 0)], [(1.4, 0, 0), (2.4, 0, 0)], NEAREST)  # one behind the other
    assert energy == pytest.approx(0.5 * A * RC * 0.25)
    assert two([(0, 0, 0), (0, 0, 0)], [(0.4, 0.1, 0), (0.4, -0.1, 0)], NEAREST)[0] == pytest.approx(0.5 * A * RC * 0.25)  # no length


def test_clamped_points_are_lammps_own():
    """Both points are moved to an end each by itself: not the nearest ones; two bonds that touch have the full energy."""
    a, b = [(-0.5, 0, 0), (0.5, 0, 0)], [(0.4, 0.2, 0.1), (1.4, 0.9, 0.1)]
    assert two(a, b, CLAMPED)[0] < two(a, b, NEAREST)[0]
    assert two([(-0.5, 0, 0), (0.5, 0, 0)], [(0, -0.3, 0), (0, 0.7, 0)], NEAREST)[0] == pytest.approx(0.5 * A * RC)


def test_errors():
    x, bonds, _ = chains.walks(3, 4, np.diag([4.0] * 3), 1, spread=0)
    with pytest.raises(RunError, match=r"over half the box: the range of 0.8 nm and the longest bond of .* nm in a box of 2.5"):
        engine_of(x, bonds, NEAREST).forces(x, np.diag([2.5] * 3))
    x[5, 1] = np.nan
    raises(RunError, r"the position of one of the beads 4 and 5", lambda: engine_of(x, bonds, MID).forces(x, None))
