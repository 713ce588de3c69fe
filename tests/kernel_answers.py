"""What the kernel's forces, virials and noise are compared with."""

import numpy as np
import pytest
from oracle import minimum_image
from scenes import noise_of, ready

from openmm_dpd.kernels import noise as hashed
from openmm_dpd.kernels.compiled import compiled
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine
from openmm_dpd.plan.plan import make_plan

DT, SEED, COUNTER = 0.02, 21, 5
PARTS = (CONSERVATIVE, DISSIPATIVE, RANDOM)


def prepared(scene, scheme="mvv", dt=DT) -> PairEngine:
    """The engine of a scene that knows where its beads are."""
    return ready(PairEngine(make_plan(scene, dt=dt, seed=SEED, scheme=scheme).spec), scene.positions, scene.box)


def close(got, expected, rtol=1e-12):
    """Equal to rtol of the largest component, which is no rounding."""
    np.testing.assert_allclose(got, expected, rtol=0, atol=rtol * np.abs(expected).max())
    assert np.abs(expected).max() > 1e-3


def noise_matrices(n: int, seed: int, counter: int):
    """The kernel's numbers: symmetric for the motion, antisymmetric (the lower index gets +) for the heat."""
    draw = noise_of(n, seed, counter, 1.0)
    motion, heat = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1, n):
            motion[i, j] = motion[j, i] = draw(i, j, 0)
            heat[i, j] = draw(i, j, 1)
            heat[j, i] = -heat[i, j]
    return motion, heat


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
