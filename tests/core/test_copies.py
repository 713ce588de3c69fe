"""Copies of integrators and Systems: what is kept beside positions and velocities goes along, or the copy says that it cannot."""

import copy

import numpy as np
import openmm
import pytest
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.kernels.moment import Guide
from openmm_dpd.shapes import Ball

N, EDGE = 120, 3.4
X = np.random.default_rng(1).random((N, 3)) * EDGE
LEVELS = np.linspace(0.8, 1.2, N)


class NoseHoover(Guide):
    """A friction of the whole, which follows the kinetic energy."""

    what, numbers = "Nose and Hoover", (0.0,)

    def begin(self, m):
        m.v *= np.exp(-m.dt * m.numbers[0])

    def end(self, m):
        m.numbers[0] += 0.01 * m.dt * (np.sum(m.v**2) - 4.5 * N)


def reactions():
    bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 20.0, "r0": 0.5}, [[0, 1], [2, 3]])
    made = dpd.BondFormation(bonds, ("A", "B"), within=0.7, valences=(1, 2), every=3)
    return {"reactions": [made, dpd.BondBreaking(bonds, beyond=0.75, every=4)]}


def energies(*eos):
    inside = dict(zip("AB", eos, strict=False))
    return {"pairs": {("*", "*"): dpd.EnergyDPD(A=25, sigma=3, kappa=1)}, "internal": dpd.InternalEnergy(inside, LEVELS)}


def table(power):
    theta = np.linspace(0.05, 6.0, 120)
    return dpd.TabulatedEOS(theta, 20.0 * theta**power)


DPD, SPECIES = dpd.DPD(A=25, gamma=4.5), dpd.TDPD(A=25, gamma=4.5, kappa=[3.0] * 5, cutoff=1.0, exponent=0.5)
HEAT = {"pairs": {("*", "*"): dpd.EDPD(A=25, gamma=4.5, kappa=0.01, exponent=1.0)}, "internal": dpd.BeadTemperatures(LEVELS, 1000.0)}
FLAT = {"box": [EDGE, EDGE, EDGE + 1.0]}
KINDS = {
    "eDPD": HEAT,
    "eDPD beside walls": HEAT | {"mobile": np.arange(N) > 9},
    "two of them": energies(dpd.ConstantHeatCapacity(60.0), dpd.ConstantHeatCapacity(20.0)),
    "a mixture with a table": energies(dpd.ConstantHeatCapacity(60.0), table(1.1)),
    "species": {"pairs": {("*", "*"): SPECIES}, "internal": dpd.Concentrations(np.outer(LEVELS, np.arange(1, 6)))},
    "reactions": reactions(),
    "reacting species": {"pairs": {("*", "*"): SPECIES}, "internal": dpd.Concentrations(np.outer(LEVELS, np.arange(1, 6)))} | reactions(),
    "bodies": {"bodies": [dpd.Body(range(k, k + 3)) for k in (0, 3, 6)]},
    "a wall with spin": {"walls": [dpd.SolidWall(Ball((1.7, 1.7, 3.9), 0.4), spin=(0, 0, 2.0), centre=(1.7, 1.7, 3.9))]} | FLAT,
    "moving planes": {"walls": [dpd.Wall("z", -0.5, "above", velocity=(1.0, 0, 0)), dpd.Wall("z", EDGE + 0.4, "below")]} | FLAT,
    "shear": {"shear": dpd.LeesEdwards(rate=0.3)},
    "ramp": {"kT": dpd.TemperatureRamp(1.0, 2.0, 0, 20)},
    "Nose and Hoover": {},
}


def built_of(name, scheme):
    given = {"masses": {"A": 1.0, "B": 2.0}, "types": ["A", "B"] * (N // 2), "positions": X, "kT": 1.0, "box": [EDGE] * 3}
    scene = dpd.Scene(**given | {"pairs": {("*", "*"): DPD}} | KINDS[name])
    guide = NoseHoover() if name == "Nose and Hoover" else None
    return dpd.build(scene, dt=0.02, scheme="mvv" if guide else scheme, platform="CPU", seed=3, guide=guide)


def whole(context):
    return context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)


def measured(context):
    state = context.getState(energy=True, forces=True, positions=True, velocities=True)
    vectors = state.getForces(asNumpy=True), state.getPositions(asNumpy=True), state.getVelocities(asNumpy=True)
    return [np.array(state.getPotentialEnergy()._value), *(each._value for each in vectors)]


def same(found, wanted, tolerance=0.0):
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=tolerance, atol=tolerance)


def compound(integrator):
    found = openmm.CompoundIntegrator()
    found.addIntegrator(integrator)
    return found


clone = openmm.XmlSerializer.clone
OWN = {"integrator": lambda built: (built.system, copy.copy(built.integrator))}
OWN["both"] = lambda built: (clone(built.system), copy.deepcopy(built.integrator))
OTHERS = {"both in XML": lambda built: (clone(built.system), clone(built.integrator))}
OTHERS["integrator in XML"] = lambda built: (built.system, clone(built.integrator))
OTHERS["compound"] = lambda built: (built.system, compound(copy.copy(built.integrator)))
OTHERS["Verlet"] = lambda built: (built.system, openmm.VerletIntegrator(0.02))


@pytest.mark.parametrize(("name", "scheme"), [*((name, "middle") for name in KINDS), ("eDPD", "mvv"), ("reacting species", "mvv")])
def test_a_copy_has_what_there_is_now_or_says_that_it_has_not(name, scheme):
    built = built_of(name, scheme)
    simulation = built.simulation()
    simulation.step(9)
    context, platform = simulation.context, simulation.context.getPlatform()
    start, now = whole(context), measured(context)
    for way in OWN.values():
        system, integrator = way(built)
        other = openmm.Context(system, integrator, platform)
        other.setPositions(start.getPositions())  # per-DOF variables came with the integrator
        if name != "shear":
            same(measured(other)[:1], now[:1])
        other.setState(start)
        same(measured(other), now)
        integrator.step(4)
        simulation.step(4)
        later = measured(context)
        same(measured(other), later)
        for fields in (dpd.read_fields(each, built.plan) for each in (other, context)):
            assert all(np.array_equal(values, dpd.read_fields(context, built.plan)[key]) for key, values in fields.items())
        context.setState(start)
        same(measured(context), now)
    for kind, way in OTHERS.items():
        system, integrator = way(built)
        other = openmm.Context(system, integrator, platform)
        try:
            other.setPositions(start.getPositions())
            other.setVelocities(start.getVelocities())
            other.setPeriodicBoxVectors(*start.getPeriodicBoxVectors())
            if kind.endswith("XML"):
                other.setState(start)
            same(measured(other)[:1], now[:1], 1e-10)
            integrator.step(4)
            found, there = measured(other), other.getState(positions=True)
            if kind.endswith("XML"):
                context.setState(whole(other))
            context.setPositions(there.getPositions())
            context.setPeriodicBoxVectors(*there.getPeriodicBoxVectors())
            same(found[:1], measured(context)[:1], 1e-10)
        except openmm.OpenMMException as refusal:
            expected = {
                "eDPD": "temperatures",
                "reac": "form and break",
                "bodi": "rigid",
                "a wa": "walls",
                "movi": "walls",
                "shea": "shear",
            }
            assert expected.get(name[:4], "?") in str(refusal), refusal
        context.setState(start)


def test_two_contexts_and_threads_do_not_mix_what_they_show():
    """Temperatures of one are not those of another that runs the same System, and a minimiser that is called directly sees its own."""
    built = built_of("eDPD", "middle")
    one = built.simulation().context
    other = openmm.Context(built.system, copy.copy(built.integrator), one.getPlatform())
    other.setPositions(one.getState(positions=True).getPositions())
    before = measured(one)[0]
    dpd.write_fields(other, built.plan, theta=2.0)
    hot = measured(other)[0]
    assert hot > 1.5 * before
    assert measured(one)[0] == before
    openmm.LocalEnergyMinimizer.minimize(other, maxIterations=1)
    assert measured(other)[0] < hot
    assert measured(one)[0] == before


def test_a_state_without_its_bonds_is_refused_by_name():
    """In another process there is no integrator that keeps them; here the number of the state is made up."""
    built = built_of("reactions", "middle")
    other = openmm.Context(built.system, openmm.VerletIntegrator(0.01), openmm.Platform.getPlatformByName("Reference"))
    other.setPositions(X * unit.nanometer)
    for number in (0.0, 1e-300):
        other.setParameter("dpd_shown", number)
        with pytest.raises(openmm.OpenMMException, match=r"bonds that form and break.*not OpenMM's own integrators"):
            other.getState(energy=True)


@pytest.mark.parametrize("name", ["reactions", "eDPD"])
def test_a_saved_state_goes_on_where_nothing_is_shown(tmp_path, name):
    """A network after its reactions, and beads whose repulsion followed temperatures that nobody needs any more."""
    before, after = built_of(name, "middle").simulation(), built_of("ramp", "middle").simulation()
    before.step(5)
    before.saveState(str(tmp_path / "state.xml"))
    after.loadState(str(tmp_path / "state.xml"))
    same(measured(after.context)[2:], measured(before.context)[2:])
