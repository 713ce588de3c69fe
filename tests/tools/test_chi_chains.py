"""chi of bonded beads: contacts of different molecules beside a naive loop, the table of chains, compositions of chains."""

import math

import mdtraj
import numpy as np
import pytest
from cases import raises
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.molecules import FENESpring, Spring, bead, branched, pack
from openmm_dpd.parameters import (
    chain_chi_slope,
    chi_from_composition,
    chi_from_repulsion,
    chi_slope,
    composition_from_chi,
    measured_chi_slope,
    repulsion_from_chi,
)

SOFT, STIFF = Spring(k=2.0, r0=0.0), Spring(k=64.0, r0=0.5)


def mixture(seed: int = 1):
    """Branched molecules of two types in single beads of a third."""
    star = branched("TTT", {1: ["H"]}, Spring(k=50.0, r0=0.7), name="STAR")
    return pack({star: 12, bead("W"): 30}, solvent=None, box=[3.0, 3.0, 3.2], seed=seed)


def built(mix, cutoff: float = 1.0) -> dpd.BuiltSystem:
    pairs = {("*", "*"): dpd.DPD(A=25.0, gamma=4.5, cutoff=cutoff)}
    return dpd.build(mix.scene(pairs=pairs, kT=1.0), dt=0.02, scheme="bababo", platform="CPU", seed=3)


def naive(x, box, molecules, first, second, cutoff: float) -> float:
    """N/(N_a N_b) sum of (1 - r/rc)^2/2 over i of a and j of b in other molecules, pair by pair."""
    total = 0.0
    for i in np.flatnonzero(first):
        for j in np.flatnonzero(second):
            if molecules[i] != molecules[j]:
                d = x[i] - x[j]
                r = np.linalg.norm(d - box * np.round(d / box))
                total += 0.5 * (1 - r / cutoff) ** 2 if r < cutoff else 0.0
    return total * len(x) / (first.sum() * second.sum())


def frame(mix, x: np.ndarray, run: dpd.BuiltSystem) -> mdtraj.Trajectory:
    """One configuration as a trajectory, in mdtraj's single precision."""
    topology = mdtraj.Topology.from_openmm(run.topology)
    return mdtraj.Trajectory(x[None], topology, unitcell_lengths=np.diag(mix.box)[None], unitcell_angles=[[90.0] * 3])


@pytest.mark.parametrize("cutoff", [1.0, 1.3])
@pytest.mark.parametrize("beads, other", [(None, None), ("T", None), ("H", "T"), (["H", "T"], "W"), ("W", ["W", "H"])])
def test_contacts_of_a_run_and_of_its_trajectory_beside_a_naive_loop(beads, other, cutoff):
    mix = mixture()
    run = built(mix, cutoff)
    simulation = run.simulation()
    found = measured_chi_slope(run, beads, other, steps=5, every=5, settle=0, simulation=simulation)
    assert simulation.currentStep == 5
    x = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    types = np.array(mix.types)
    first = np.isin(types, ["H", "T", "W"] if beads is None else beads)
    second = first if other is None else np.isin(types, other)
    expected = naive(x, np.diag(mix.box), mix.molecules, first, second, cutoff)
    assert expected > 0.01
    assert found.mean == pytest.approx(expected, rel=1e-9)
    assert chi_slope(frame(mix, x, run), beads, other, cutoff=cutoff).mean == pytest.approx(expected, rel=1e-4)


def test_the_slope_of_all_is_the_sum_over_its_beads():
    mix = mixture()
    trajectory = frame(mix, mix.positions, built(mix))
    parts = {name: mix.types.count(name) / mix.n_beads for name in ("T", "H", "W")}
    summed = sum(part * chi_slope(trajectory, name, list(parts)).mean for name, part in parts.items())
    assert summed == pytest.approx(chi_slope(trajectory).mean, rel=1e-12)


def test_bad_input_of_slopes():
    run = built(mixture())
    raises(dpd.ParameterError, "no bead is of type 'X'; there are 'T', 'H', 'W'", lambda: measured_chi_slope(run, "X"))
    raises(dpd.ParameterError, "indices must be from 0 to 77; there is 90", lambda: measured_chi_slope(run, [0, 90]))
    raises(dpd.ParameterError, "no two beads of different molecules", lambda: measured_chi_slope(run, [0], [1]))
    raises(dpd.ParameterError, "needs as built the result", lambda: measured_chi_slope(run.plan.scene))
    raises(dpd.ParameterError, "steps", lambda: measured_chi_slope(run, steps=0))
    pairs = {("*", "*"): dpd.DPD(A=25.0, gamma=4.5), ("W", "W"): dpd.DPD(A=25.0, gamma=4.5, cutoff=1.2)}
    mix = mixture()
    other = dpd.build(mix.scene(pairs=pairs, kT=1.0), dt=0.02, scheme="bababo", platform="CPU", seed=3)
    raises(dpd.ParameterError, "needs one cutoff for all of the beads; they have 1, 1.2 nm", lambda: measured_chi_slope(other))
    measured_chi_slope(other, "T", "W", steps=1, settle=0)
    tables = [dpd.PairTable({**pairs, ("H", "W"): dpd.NONE}), dpd.PairTable({("H", "W"): dpd.LennardJones(1.0, 0.3, 0.9)})]
    none = dpd.build(mix.scene(pairs=tables, kT=1.0), dt=0.001, scheme="bababo", platform="CPU", seed=3)
    raises(dpd.ParameterError, "which types H and W do not have", lambda: measured_chi_slope(none, "H", "W"))


def test_compositions_and_bounds_of_chains():
    for beads in (2, 7):
        phi = composition_from_chi(3.0 / beads, beads=beads)
        assert phi == pytest.approx(composition_from_chi(3.0), rel=1e-12)
        assert chi_from_composition(phi, beads=beads) == pytest.approx(3.0 / beads)
    raises(dpd.ParameterError, "chi times 4 beads above 2", lambda: composition_from_chi(0.4, beads=4))
    raises(dpd.ParameterError, "beads", lambda: chi_from_composition(0.1, beads=0))
    raises(dpd.ParameterError, "r0 = 0.2 is outside of 0.3 to 0.9", lambda: repulsion_from_chi(0.5, beads=4, bond=Spring(64.0, 0.2)))
    raises(dpd.ParameterError, "k = 3 is outside of 25 to 100", lambda: repulsion_from_chi(0.5, beads=4, bond=Spring(3.0, 0.0)))
    raises(dpd.ParameterError, "beads = 30 is outside of 1 to 20", lambda: chain_chi_slope(30, SOFT))
    raises(dpd.ParameterError, "beads is 4 and bond is None", lambda: repulsion_from_chi(0.5, beads=4))
    raises(dpd.ParameterError, "beads is 1 and bond is a Spring", lambda: chi_from_repulsion(1.0, bond=SOFT))
    raises(dpd.ParameterError, "bond must be a Spring", lambda: chain_chi_slope(4, FENESpring(10.0, 2.0)))
    raises(dpd.ParameterError, "chains were measured at A = 75/density", lambda: repulsion_from_chi(0.5, beads=4, bond=SOFT, A=78.0))
    with pytest.raises(dpd.ParameterError, match="for single beads; leave beads and bond out"):
        repulsion_from_chi(0.5, beads=4, bond=SOFT, relation="groot-warren")
    raises(dpd.ParameterError, "chi = 3 is outside of 0 to", lambda: repulsion_from_chi(3.0, beads=4, bond=SOFT))
    far = repulsion_from_chi(3.0, beads=4, bond=SOFT, extrapolate=True)
    assert far.extrapolated and far.error is None
    assert math.isfinite(far.value)


def test_chains_there_and_back_and_their_small_limit():
    for density in (3.0, 4.0, 5.0):
        for spring in (SOFT, STIFF):
            for beads in (2, 4, 20):
                for chi in (0.5 / beads, 3.0 / beads):
                    dA = repulsion_from_chi(chi, density, beads=beads, bond=spring)
                    assert chi_from_repulsion(dA, density, beads=beads, bond=spring).value == pytest.approx(chi, rel=1e-9)
                    assert dA.error > 0.03 * dA.value
                slope = chain_chi_slope(beads, spring, density).value
                assert chi_from_repulsion(1e-4, density, beads=beads, bond=spring).value == pytest.approx(1e-4 * slope, rel=1e-3)


def test_longer_chains_and_shorter_bonds_have_fewer_contacts():
    single = chain_chi_slope(1).value
    for springs in ((SOFT,), [Spring(64.0, r0) for r0 in (0.85, 0.65, 0.45, 0.3)]):
        slopes = np.array([[chain_chi_slope(beads, spring).value for beads in range(2, 21)] for spring in springs])
        assert np.all(np.diff(slopes, axis=0) < 0)
        assert np.all(np.diff(slopes, axis=1) < 0)
        assert slopes.max() < single
