"""What the kernel's forces, virials and noise are compared with."""

import numpy as np
import pytest
from scenes import noise_of, ready

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
