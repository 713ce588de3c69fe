"""Short versions of docs/measure/parameters_check.py: parameters give what they were asked for."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from judged import any_seed, quantile

from openmm_dpd import parameters
from openmm_dpd.molecules import Spring
from openmm_dpd.parameters import chain_chi_slope, measured_chi_slope, measured_pressure, repulsion_from_chi, water_mapping

sys.path.append(str(Path(__file__).parents[2] / "docs" / "measure"))
import demixing  # noqa: E402
import transport_table  # noqa: E402


@any_seed(3)
def test_pressure_between_the_points_of_the_table(seed):
    found = measured_pressure(33.0, 3.3, beads=600, time=30.0, seed=seed)
    said = parameters.pressure(33.0, 3.3)
    assert abs(found.pressure.mean - said.value) < 4 * math.hypot(found.pressure.sem, said.error)
    assert found.pressure.sem < 2e-3 * said.value
    # the energy of a bead is A/2 times the overlap that chi is made of
    assert abs(2 * found.energy.mean / 33.0 - parameters.state.overlap_energy(33.0, 3.3)) < 4 * 2 * found.energy.sem / 33.0 + 1e-3


@pytest.mark.slow
@any_seed(7)
def test_water_is_as_compressible_as_water(seed):
    water = water_mapping(3)
    A = water.repulsion().value
    low, high = (measured_pressure(A, 3.0 + side * 0.15, beads=800, time=30.0, seed=seed + side).pressure for side in (-1, 1))
    slope, error = (high.mean - low.mean) / 0.3, math.hypot(low.sem, high.sem) / 0.3
    assert error < 0.012 * slope
    assert abs(slope - water.inverse_compressibility) < 0.05 * water.inverse_compressibility


@pytest.mark.slow
@any_seed(9)
@pytest.mark.parametrize("density", [3.0, pytest.param(5.0, marks=pytest.mark.long)])
def test_two_fluids_demix_as_their_chi_says(density, seed):
    dA = repulsion_from_chi(3.5, density)
    found, error = demixing.demixed_chi(demixing.Model(density), dA.value, edge=6.0, length=18.0, time=100.0, settle=30.0, seed=seed)
    assert error < 0.03 * 3.5
    assert abs(found - 3.5) < 0.1 * 3.5


@pytest.mark.slow
@any_seed(1)
def test_chains_have_the_slope_of_the_table(seed):
    spring = Spring(k=64.0, r0=0.5)
    for beads in (2, 5):
        built = demixing.fluid(demixing.Model(3.0, beads=beads, spring=spring), 0.0, (7.0, 7.0, 7.0), False, seed)
        found = measured_chi_slope(built, steps=800, settle=200)
        said = chain_chi_slope(beads, spring)
        assert found.sem < 0.005 * said.value
        assert abs(found.mean - said.value) < 4 * math.hypot(found.sem, said.error)


@pytest.mark.slow
@any_seed(3)
def test_mixed_tetramers_have_the_chi_that_was_asked_for(seed):
    model = demixing.Model(3.0, beads=4, spring=Spring(k=2.0, r0=0.0))
    mixed = repulsion_from_chi(0.4, beads=4, bond=model.spring)
    points = [mixed.value * part for part in (0.0, 0.25, 0.5, 0.75, 1.0)]
    found, error = demixing.mixed_chi(model, points, edge=6.0, time=25.0, seed=seed)[1]
    assert error < 0.02 * 0.4
    assert abs(found - 0.4) < 4 * math.hypot(error, 0.4 * mixed.error / mixed.value)


@pytest.mark.long
@pytest.mark.slow
@any_seed(4)
def test_demixed_tetramers_have_the_chi_that_was_asked_for(seed):
    model = demixing.Model(3.0, beads=4, spring=Spring(k=2.0, r0=0.0))
    demixed = repulsion_from_chi(0.75, beads=4, bond=model.spring)
    slabs = [  # compositions of slabs this small change slowly: they scatter by four times the error of a series
        demixing.demixed_chi(model, demixed.value, edge=6.0, length=18.0, time=100.0, settle=30.0, seed=s)[0] for s in range(seed, seed + 6)
    ]
    found, error = np.mean(slabs), np.std(slabs, ddof=1) / len(slabs) ** 0.5
    assert error < 0.06 * 0.75
    assert abs(found - 0.75) < quantile(6) * math.hypot(error, 0.75 * demixed.error / demixed.value)


@pytest.mark.slow
@any_seed(5)
def test_transport_between_the_points_of_the_table(seed):
    found = transport_table.measure({**transport_table.BASE, "drag": 8.0}, 120.0, seed)
    said = parameters.transport(8.0)
    assert abs(found["eta"] - said.viscosity.value) < 4 * math.hypot(found["eta_error"], said.viscosity.error)
    assert abs(found["D"] - said.diffusion.value) < 4 * math.hypot(found["D_error"], said.diffusion.error)
    assert found["D_error"] < 0.03 * found["D"]


def test_amplitude_of_a_flow_is_that_of_displacements():
    """Beads that drift with 0.3 sin(k z) for a step, and across."""
    z, wave, dt = np.arange(200) * 0.05, 2 * np.pi / 10, 0.1
    before = np.stack([np.zeros(200), np.zeros(200), z], axis=1)
    after = before + dt * np.stack([0.3 * np.sin(wave * (z + 0.5 * dt)), np.ones(200), np.ones(200)], axis=1)
    assert transport_table.amplitude(before, after, wave, dt) == pytest.approx(0.3)
