"""Shadow work: in energy-conserving DPD, whose sweeps conserve the energy, it is the change of the whole energy in a step."""

import numpy as np
import pytest
from cases import cases, raises
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.measure import Observer, ShadowWorkReporter

ENERGIES = {"internal": dpd.InternalEnergy(dpd.ConstantHeatCapacity(10.0), thetas=1.0)}
CHAINS = np.arange(81).reshape(-1, 3)
BONDS = dpd.HarmonicBonds(np.concatenate([CHAINS[:, :2], CHAINS[:, 1:]]), k=20.0, r0=0.5)


@pytest.mark.parametrize("scheme", ["middle", "bababo", "bab3", "shardlow", "aboba", "A/3 B O 2A/3"])
def test_it_is_the_change_of_a_conserved_energy(scheme):
    """Of the steps after steps 14, 21, ...; forces before and after the sweep, and velocities that lag, are those of the run."""
    table = {("W", "W"): dpd.EnergyDPD(A=25.0, sigma=3.0, kappa=1.0)}
    built = dpd.build(beads(81, table=table, bonds=[BONDS], **ENERGIES), dt=0.04, scheme=scheme, seed=1, platform="CPU")
    simulation, observer = built.simulation(), Observer(built)
    simulation.minimizeEnergy(maxIterations=10)
    simulation.step(9)
    meter, total = ShadowWorkReporter(7, built), {}
    simulation.reporters.append(meter)
    for _ in range(22):
        total[simulation.currentStep] = observer.sample(simulation.context).total
        simulation.step(1)
    change = [total[k + 1] - total[k] for k in (14, 21, 28)]
    assert np.allclose(meter.work, change, rtol=0, atol=1e-9) and min(map(abs, change)) > 1e-4
    assert meter.heating.mean == pytest.approx(np.mean(change) / 81 / 0.04)
    assert meter.variance == pytest.approx(np.var(change) / 81)
    assert meter.acceptance == pytest.approx(np.mean(np.minimum(1.0, np.exp(-np.array(change)))))


def test_a_run_is_the_same_with_and_without_it():
    ends = []
    for measured in (True, False):
        built = dpd.build(beads(81), dt=0.04, scheme="bababo", seed=1, platform="CPU")
        simulation = built.simulation()
        simulation.reporters += [ShadowWorkReporter(3, built)] * measured
        simulation.step(20)
        ends.append(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value)
    assert np.array_equal(*ends)


SPECIES = {"table": {("W", "W"): dpd.TDPD(A=25, gamma=4.5, kappa=[1.0])}, "internal": dpd.Concentrations(np.ones((81, 1)))}


@cases(
    "choices, more, reason",
    ({"scheme": "mvv"}, {}, "no word"),
    ({"scheme": "O/2 B/2 A B/2 O/2"}, {}, "more than one sweep"),
    ({}, {"shear": dpd.LeesEdwards(0.2)}, "a shear does work"),
    ({}, {"body_forces": [dpd.BodyForce((0.1, 0, 0))]}, "forces on single beads"),
    ({}, {"kT": dpd.TemperatureRamp(1.0, 2.0, 0, 100)}, "ramp"),
    (
        {},
        {"reactions": [dpd.BondBreaking(dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 1.0, "r0": 0.5}), beyond=1.0)]},
        "bonds form and break",
    ),
    ({}, SPECIES | {"sources": [dpd.Buoyancy((0, 0, 1.0), 1.0)]}, "a force follows"),
    ({}, {"walls": [dpd.Wall("z", 0.1, "above"), dpd.Wall("z", 2.0, "below")], "positions": np.full((81, 3), 1.0)}, "walls"),
)
def test_where_it_is_not_known(choices, more, reason):
    built = dpd.build(beads(81, **more), dt=0.02, platform="CPU", **choices)
    raises(dpd.ParameterError, reason, ShadowWorkReporter, 10, built)


def test_other_mistakes():
    built = dpd.build(beads(81), dt=0.02, platform="CPU")
    raises(dpd.ParameterError, "at least 2", ShadowWorkReporter, 1, built)
    raises(dpd.ParameterError, "no samples", lambda: ShadowWorkReporter(2, built).heating)
