"""Molecules inserted into a solvent: what is built, weights of the integral, theory of partition; no runs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cases import raises
from openmm import unit
from scipy.optimize import brentq

import openmm_dpd as dpd
from openmm_dpd.base.geometry import minimum_images
from openmm_dpd.molecules import Molecule, Spring, Twist, linear, pack
from openmm_dpd.parameters import Estimate, ExcessChemicalPotential, chi_from_log_p, excess_chemical_potential, log_p, repulsion_from_log_p
from openmm_dpd.parameters.insertion import weights
from openmm_dpd.parameters.insertion_scene import insertion, lattice_points

MASSES = {"W": 1.0, "V": 1.0, "A": 2.0, "B": 1.0}
PAIRS = {("*", "*"): dpd.DPD(A=25, gamma=4.5), ("A", "W"): dpd.DPD(A=40, gamma=4.5), ("B", "W"): dpd.NONE}
PAIRS["A", "V"] = dpd.DPD(A=10, gamma=4.5, cutoff=1.3)
CHAIN = linear("AABA", Spring(k=20, r0=0.5))


def solvent(pairs=PAIRS, **options) -> dpd.Scene:
    mixture = pack({linear("WV", Spring(k=20, r0=0.5)): 60}, box=[5.0, 5.0, 5.5], solvent="W", seed=2)
    return mixture.scene(pairs=pairs, kT=options.pop("kT", 1.0), masses=MASSES, **options)


def pair_energy(scene: dpd.Scene) -> float:
    built = dpd.build(scene, dt=0.01, scheme="bababo", platform="Reference")
    return dpd.Observer(built).sample(built.simulation().context).pair


# -- copies -----------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("pairs", [PAIRS, [PAIRS, {("A", "W"): dpd.DPD(A=5, gamma=0.0, cutoff=0.7)}]], ids=["one table", "two tables"])
def test_the_energy_is_what_its_factor_scales(pairs):
    """U(parts) - U(no part) is the sum of part times energy of each copy; the rest does not depend on the parts."""
    parts, scene = np.array([0.1, 0.5, 0.8]), solvent(pairs)
    coupled, free = insertion(CHAIN, scene, parts, 4), insertion(CHAIN, scene, 0 * parts, 4)
    x, n = coupled.scene.positions, coupled.solvent
    apart = minimum_images((x[n:, None, :] - x[None, :n, :]).reshape(-1, 3), scene.box).reshape(3, CHAIN.n_beads, n, 3)
    energies = coupled.energies(np.linalg.norm(apart, axis=-1))
    assert np.all(energies > 1)
    assert pair_energy(coupled.scene) - pair_energy(free.scene) == pytest.approx(parts @ energies, rel=1e-9)
    assert coupled.reach == 1.3


def test_copies_are_molecules_held_by_the_middle():
    made = insertion(CHAIN, solvent(), np.array([0.2, 0.5, 0.9]), 1)
    assert (np.flatnonzero(made.scene.immobile) - made.solvent).tolist() == [1, 5, 9]
    assert made.scene.bead_masses[made.solvent :].tolist() == [2.0, 2.0, 1.0, 2.0] * 3
    bonds = made.scene.bond_pairs
    assert len(bonds) == 60 + 9 and np.all((bonds < made.solvent).all(axis=1) | (bonds >= made.solvent).all(axis=1))
    assert np.allclose(made.scene.positions[made.scene.immobile], lattice_points(3, made.scene.box))
    twisted = insertion(replace(CHAIN, dihedrals=((0, 1, 2, 3, Twist(2, -1, 3)),)), solvent(), np.array([0.2, 0.5, 0.9]), 1)
    (dihedrals,) = twisted.scene.dihedrals
    assert dihedrals.quads.tolist() == [[made.solvent + 4 * k + bead for bead in range(4)] for k in range(3)]


@pytest.mark.parametrize("count, least", [(2, 27**0.5), (3, 12**0.5), (6, 3.0), (8, 3.0), (12, 2.4)])
def test_lattice_keeps_points_apart(count, least):
    """In a cube of edge 6: two are half a diagonal apart, three a third of one, eight no nearer than on a cubic lattice."""
    box = np.diag([6.0, 6.0, 6.0])
    points = lattice_points(count, box)
    i, j = np.triu_indices(count, 1)
    apart = np.linalg.norm(minimum_images(points[i] - points[j], box), axis=1).min()
    assert apart >= least - 1e-9
    assert apart <= 2 ** (1 / 6) * (216 / count) ** (1 / 3) + 1e-9  # no lattice is denser than fcc


# -- integral ---------------------------------------------------------------------------------------------------------------------
def test_weights_integrate_polynomials():
    nodes, gauss = np.polynomial.legendre.leggauss(6)
    parts = 0.5 * (nodes + 1)
    assert weights(parts, 1.0) == pytest.approx(0.5 * gauss, rel=1e-12)
    for end in (0.0, 0.3, 0.77):
        assert [weights(parts, end) @ parts**k for k in range(6)] == pytest.approx([end ** (k + 1) / (k + 1) for k in range(6)], abs=1e-13)


def made_up(density: float = 1.0) -> ExcessChemicalPotential:
    """Energies 10 - 4 part with noise of its own in each row."""
    parts = 0.5 * (np.polynomial.legendre.leggauss(5)[0] + 1)
    noise = np.random.default_rng(3).normal(size=(4000, 5))
    return ExcessChemicalPotential(parts, 10 - 4 * parts + noise, np.full(4000, density), 2.0)


def test_values_errors_and_units():
    """A dense solvent is corrected by the middle of 8, the value, and 10, the energy at a part of 0; half of the difference is the doubt."""
    found = made_up()
    expected = math.sqrt(np.sum((0.5 * np.polynomial.legendre.leggauss(5)[1]) ** 2) / 4000)
    assert found.error == pytest.approx(math.hypot(expected, 0.001 * 9), rel=0.1)
    assert abs(found.value - 8.0) < 4 * expected
    assert found.molar_energy.value_in_unit(unit.kilojoule_per_mole) == pytest.approx(2 * found.value)
    assert abs(found.at(0.5).value - 4.5) < 4 * found.at(0.5).error
    assert found.at(1.0, 0.5).value == pytest.approx(found.value - found.at(0.5).value)
    assert found.at(1.0, 0.5).error < math.hypot(found.error, found.at(0.5).error)
    raises(dpd.ParameterError, "from 0 to 1; 1.1", lambda: found.at(1.1))
    plain, dense = made_up(), made_up(1.02)
    assert plain.value - dense.value == pytest.approx(0.02 * 9, rel=0.01)
    assert dense.error == pytest.approx(math.hypot(plain.error, 0.02 * 1), rel=0.02)


def test_what_cannot_be_switched_is_refused():
    scene, one = solvent(), Molecule(("A",))
    still = np.ones(scene.n_beads, bool)
    still[0] = False
    cases = [
        ("must be a Molecule", "W", scene),
        ("must be a Scene", one, None),
        ("does not have the bead type 'C'", Molecule(("C",)), scene),
        ("charges", Molecule(("A",), charges=(1.0,)), scene),
        ("do not move", one, replace(scene, mobile=still)),
        ("not all forces act", one, replace(scene, interacting=np.tile(still[:, None], 3))),
        ("no box", one, replace(scene, box=None)),
        ("temperature of 0", one, replace(scene, kT=0.0)),
        ("forces on single beads", one, replace(scene, body_forces=[dpd.BodyForce((1.0, 0.0, 0.0))])),
        ("not LennardJones", one, solvent([PAIRS, {("*", "*"): dpd.LennardJones(epsilon=1, sigma=0.3, cutoff=1)}])),
        ("at least 3.3 cutoffs wide, 4.29", one, replace(scene, box=np.diag([4.0, 5.0, 5.5]))),
    ]
    for message, molecule, given in cases:
        raises(dpd.ParameterError, message, excess_chemical_potential, molecule, given)
    unseen = pack({}, box=[5.0] * 3, solvent="W", seed=1).scene(pairs=PAIRS, kT=1.0, masses=MASSES)
    raises(dpd.ParameterError, "nothing acts between B1? and this solvent", lambda: excess_chemical_potential(Molecule(("B",)), unseen))
    raises(dpd.ParameterError, "seed must be at least 0", lambda: excess_chemical_potential(one, scene, seed=-1))
    raises(dpd.ParameterError, "must be from 3 to 32, not 40", lambda: excess_chemical_potential(one, scene, copies=40))
    raises(dpd.ParameterError, "a time of at least 2, not 1", lambda: excess_chemical_potential(one, scene, time=1.0))
    few = {pair: dpd.DPD(A=25, gamma=4.5) for pair in (("*", "A"), ("W", "W"))}
    raises(dpd.ParameterError, r"no pair coefficients for types .*\(W, B\)", solvent, few)
    raises(dpd.ParameterError, "different temperatures", lambda: log_p(one, scene, replace(scene, kT=2.0)))
    raises(dpd.ParameterError, "repel water with one A > 0, but they have A = 10, 40", repulsion_from_log_p, 3.0, one, scene, scene)


# -- theory -----------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("size, octanol, water", [(1, 1, 1), (3, 3, 1), (4, 2, 5)])
def test_theory_makes_chemical_potentials_equal(size, octanol, water):
    """From the free energy of mixing of Flory and Huggins, by its derivative; a chi of the answer gives the ratio that was asked for."""
    wanted, chi_o = 1.7, 0.4
    chi_w = chi_from_log_p(wanted, size, chi_octanol=chi_o, octanol_beads=octanol, water_beads=water).value

    def potential(phi: float, chi: float, n: int) -> float:
        """d(F/kT)/d(molecules of solute), F of molecules on sites, at a constant number of molecules of the solvent."""

        def energy(solutes: float) -> float:
            sites = solutes * size + others * n
            part = solutes * size / sites
            return solutes * math.log(part) + others * math.log(1 - part) + chi * sites * part * (1 - part)

        solutes = 1.0
        others = solutes * size * (1 - phi) / (phi * n)
        step = 1e-5
        return (energy(solutes + step) - energy(solutes - step)) / (2 * step)

    phi_w = 1e-5
    target = potential(phi_w, chi_w, water)
    phi_o = math.exp(brentq(lambda x: potential(math.exp(x), chi_o, octanol) - target, math.log(phi_w), math.log(phi_w) + 8))
    assert math.log10(phi_o / phi_w) == pytest.approx(wanted, abs=2e-3)


def test_errors_of_log_p_are_those_of_chi():
    found = chi_from_log_p(Estimate(4.0, 0.1, "measured", {}), 2, chi_octanol=Estimate(0.3, 0.05, "measured", {}))
    assert found.error == pytest.approx(math.hypot(0.1 * math.log(10) / 2, 0.05))
    assert chi_from_log_p(-1.0, 2).value < 0
    raises(dpd.ParameterError, "beads", lambda: chi_from_log_p(1.0, 0))
