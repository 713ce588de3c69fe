"""Short versions of docs/measure/insertion.py: excess chemical potentials beside exact and published ones."""

import math

import numpy as np
import pytest
from judged import any_seed
from openmm import unit
from scipy.integrate import quad, trapezoid

import openmm_dpd as dpd
from openmm_dpd.molecules import Molecule, Spring, linear, pack
from openmm_dpd.parameters import excess_chemical_potential, log_p, repulsion_from_log_p, water_mapping

BEAD = Molecule(("A",))


def solvent(own: float, A: float, *, edge: float = 6.0, density: float = 3.0) -> dpd.Scene:
    pairs = {("*", "*"): dpd.DPD(A=own, gamma=4.5), ("A", "W"): dpd.DPD(A=A, gamma=4.5)}
    return pack({}, box=[edge] * 3, solvent="W", density=density, seed=3).scene(pairs=pairs, kT=1.0, masses={"W": 1.0, "A": 1.0})


def displaced(A: float, distance: float) -> float:
    """Integral of 1 - exp(-u) over space, u the energy of a point with two beads at a distance."""
    z, s = np.linspace(-1, 1 + distance, 301), np.linspace(0, 1, 121)
    energy = sum(0.5 * A * np.maximum(0, 1 - np.hypot(z[:, None] - centre, s)) ** 2 for centre in (0.0, distance))
    return float(trapezoid(trapezoid(2 * math.pi * s * (1 - np.exp(-energy)), s, axis=1), z))


@any_seed(2)
def test_an_ideal_gas_is_exact(seed):
    """Beads of a solvent that do not see each other: mu_ex is the density times the integral of 1 - exp(-u)."""
    found = excess_chemical_potential(BEAD, solvent(0.0, 10.0, edge=5.0), time=60.0, settle=10.0, copies=4, dt=0.1, seed=seed)
    for part in (0.5, 1.0):
        here = found.at(part)
        exact = 3 * quad(lambda r, A: 4 * math.pi * r**2 * (1 - math.exp(-0.5 * A * (1 - r) ** 2)), 0, 1, args=(10 * part,))[0]
        assert here.error < 0.07 * exact
        assert abs(here.value - exact) < 4 * here.error


@pytest.mark.slow
@any_seed(5)
def test_two_beads_in_an_ideal_gas_are_exact(seed):
    """mu_ex = -ln <exp(-mu_ex(r))> over the lengths r of the spring alone, on which the beads repel each other."""
    k, r0, A, own = 8.0, 0.4, 10.0, 12.0
    pairs = {("*", "*"): dpd.DPD(A=0, gamma=4.5), ("A", "W"): dpd.DPD(A=A, gamma=4.5), ("A", "A"): dpd.DPD(A=own, gamma=4.5)}
    scene = pack({}, box=[5.5] * 3, solvent="W", seed=3).scene(pairs=pairs, kT=1.0, masses={"W": 1.0, "A": 1.0})
    found = excess_chemical_potential(linear("A2", Spring(k, r0)), scene, time=80.0, settle=10.0, copies=4, dt=0.07, seed=seed)
    r = np.linspace(0.005, 1.995, 100)
    weight = r**2 * np.exp(-k * (r - r0) ** 2 - 0.5 * own * np.maximum(0, 1 - r) ** 2)
    exact = -math.log(np.sum(weight * np.exp(-np.array([3 * displaced(A, distance) for distance in r]))) / np.sum(weight))
    assert found.error < 0.06 * exact
    assert abs(found.value - exact) < 4 * found.error


@pytest.mark.slow
@any_seed(11)
def test_beads_in_the_fluid_of_groot_and_warren(seed):
    """Widom insertion by P. B. Warren (python3-HNC-solver, dimer_data.ods): 5.6732(3) at A = 10 and 12.163(3) at 25."""
    found = excess_chemical_potential(BEAD, solvent(25.0, 25.0), time=250.0, seed=seed)
    assert found.error < 0.04
    assert abs(found.value - 12.163) < 4 * found.error
    assert abs(found.at(0.4).value - 5.6732) < 4 * found.at(0.4).error
    assert abs(float(found.densities.mean()) - 1) < 0.005


@pytest.mark.slow
@pytest.mark.long
@any_seed(1)
def test_a_repulsion_from_log_p_gives_that_log_p(seed):
    """Two beads on a spring between solvents of single beads and of pairs."""
    spring = Spring(k=20.0, r0=0.5)
    pair, pairs = linear("A2", spring), {("*", "*"): dpd.DPD(A=25, gamma=4.5)}
    masses = {"W": 1.0, "O": 1.0, "A": 1.0}

    def water(A: float) -> dpd.Scene:
        own = pairs | {("A", "W"): dpd.DPD(A=A, gamma=4.5)}
        return pack({}, box=[6.0] * 3, solvent="W", seed=4).scene(pairs=own, kT=1.0, masses=masses)

    octanol = pack({}, box=[6.0] * 3, solvent=linear("O2", spring), seed=5).scene(pairs=pairs, kT=1.0, masses=masses)
    A = repulsion_from_log_p(2.0, pair, octanol, water(45.0), time=80.0, settle=15.0, copies=5, seed=seed)
    assert 30 < A.value < 45 and A.error < 0.7
    found = log_p(pair, octanol, water(A.value), time=80.0, settle=15.0, copies=5, seed=seed + 20)
    assert found.error < 0.08
    assert abs(found.value - 2.0) < 4 * math.sqrt(2) * found.error  # both runs have this error


@any_seed(1)
def test_units_make_no_difference(seed):
    """The same run in nm, Da and kJ/mol; bits differ, so beads part after a while."""
    water = water_mapping(3)
    A, edge = water.coefficient(25.0, gamma=4.5), 5.0
    plain = solvent(25.0, 25.0, edge=edge)
    mass, kT, edges = water.mass * unit.dalton, water.temperature * unit.kelvin, np.full(3, edge * water.cutoff) * unit.nanometer
    x = plain.positions * water.cutoff * unit.nanometer
    real = dpd.Scene({"W": mass, "A": mass}, plain.types, x, {("*", "*"): A}, kT=kT, box=edges)
    options = {"time": 20.0, "settle": 3.0, "copies": 3, "seed": seed}
    one, other = (excess_chemical_potential(BEAD, scene, **options) for scene in (plain, real))
    assert abs(one.value - other.value) < 4 * math.hypot(one.error, other.error)
    assert other.molar_energy / unit.kilojoule_per_mole == pytest.approx(other.value * water.thermal_energy)
    assert len(one.energies) == len(other.energies)
