"""Pair potentials of bonded neighbours with a factor."""

import numpy as np
import openmm
import pytest

import openmm_dpd as dpd

R = 1.3
DISTANCES = np.linspace(0.0, 3.0, 61)
POTENTIALS = {
    "DPD": (dpd.DPD(A=25, cutoff=2.5), 0.5 * 25 * 2.5 * (1 - R / 2.5) ** 2, 25 * (1 - R / 2.5)),
    "LennardJones": (
        dpd.LennardJones(epsilon=0.8, sigma=1.1, cutoff=2.5),
        4 * 0.8 * ((1.1 / R) ** 12 - (1.1 / R) ** 6),
        24 * 0.8 * (2 * (1.1 / R) ** 12 - (1.1 / R) ** 6) / R,
    ),
    "TabulatedPair": (dpd.TabulatedPair(DISTANCES, (3.0 - DISTANCES) ** 2), (3.0 - R) ** 2, 2 * (3.0 - R)),
}


@pytest.mark.parametrize("kind", POTENTIALS)
@pytest.mark.parametrize("types", [["A", "A"], ["A", "B"]], ids=["one type", "two types"])
def test_factor_of_bonded_neighbours(kind, types):
    """Half the energy and half the force of one pair, written out; with tables of type pairs as well as with constants."""
    coefficient, energy, force = POTENTIALS[kind]
    table = {("A", "A"): coefficient} if types[1] == "A" else {("*", "*"): dpd.NONE, ("A", "B"): coefficient}
    bonded = {"bonds": [dpd.HarmonicBonds([[0, 1]], k=0, r0=1)], "bonded_factors": (0.5, 1.0, 1.0)}
    scene = dpd.Scene(dict.fromkeys(sorted(set(types)), 1.0), types, [[0, 0, 0], [R, 0, 0]], table, kT=1, **bonded)
    built = dpd.build(scene, dt=0.01, platform="Reference", conservative="openmm", seed=1)
    state = built.simulation().context.getState(energy=True, forces=True)
    assert state.getPotentialEnergy()._value == pytest.approx(0.5 * energy, rel=1e-6)
    assert state.getForces()[1].x == pytest.approx(0.5 * force, rel=1e-6)
    assert isinstance(built.system, openmm.System)
