"""Forces, constraints, barostats, virtual sites and particles that the user adds: they act in full, or are refused by one clear line.

foreign_forces.py has the cells and what must come of each.
"""

import copy
import itertools

import foreign_forces as cells
import numpy as np
import openmm
import pytest
from cases import every_pair
from foreign_forces import FORCE, STEPS, Cell, covering, lacking, outcome, state
from openmm import app, unit
from scenes import BOXES, EXTENDED, beads, fluid, place, stepped

import openmm_dpd as dpd
from openmm_dpd.model.eos import ConstantHeatCapacity

HOSTS = ("Reference", "CPU")
SCHEMES = cells.LEVELS["scheme"]
OWN = tuple(scheme for scheme in SCHEMES if scheme != "native")
SCHEME = pytest.mark.parametrize("scheme", SCHEMES)
HOST = pytest.mark.parametrize("platform", HOSTS)
CONSERVATIVE = pytest.mark.parametrize("conservative", ["openmm", "kernel"])
REFUSED = (dpd.DPDError, openmm.OpenMMException)
DT = 0.01


def check(cell: Cell) -> None:
    reason = lacking(cell.platform)
    if reason is not None:
        pytest.skip(reason)
    found = outcome(cell)
    assert not found.startswith("WRONG"), found


# -- the matrix ------------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("cell", covering(2), ids=str)
def test_what_is_added_acts_in_full(cell):
    """Every two levels of the factors together at least once, on every platform."""
    check(cell)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("cell", [cell for cell in covering(3, HOSTS) if cell not in covering(2)], ids=str)
def test_what_is_added_acts_in_full_three_by_three(cell):
    """Every three levels together at least once, on the platforms that need no compiler."""
    check(cell)


@pytest.mark.parametrize("strength, platforms", [(2, cells.LEVELS["platform"]), (3, HOSTS)])
def test_the_selection_covers(strength, platforms):
    """No two (three) levels that some cell has together are missing from the selection."""

    def combinations(some):
        return {c for cell in some for c in itertools.combinations(sorted(vars(cell).items()), strength)}

    assert combinations(covering(strength, platforms)) == combinations(c for c in cells.cells() if c.platform in platforms)


@pytest.mark.parametrize("kind", ["external", "bond", "cv", "constraint", "barostat"])
def test_the_checks_can_fail(kind, monkeypatch):
    """What is added is expected, but kept from the System: the check must say so (in a case that is right otherwise)."""
    cell = Cell(kind, 0, "middle", "Reference", "openmm", "build", "after", "app")
    assert outcome(cell) == "acts" or kind == "constraint"
    add = cells.ADD[kind]

    def forgetful(case, group):
        real, case.system = case.system, openmm.XmlSerializer.clone(case.system)
        try:
            return add(case, group)
        finally:
            case.system = real

    monkeypatch.setitem(cells.ADD, kind, forgetful)
    assert outcome(cell).startswith("WRONG")


# -- many at once ----------------------------------------------------------------------------------------------------------------------
def pushed(kT=1.0, **changes) -> dpd.Scene:
    """The standard fluid with velocities."""
    v = np.random.default_rng(2).normal(size=(81, 3))
    return beads(kT=kT, velocities=v - v.mean(axis=0), **changes)


def push(system: openmm.System, strength: float, group: int = 0, which=None) -> None:
    """A constant force along x."""
    force = openmm.CustomExternalForce(f"-{strength}*x")
    for k in range(system.getNumParticles()) if which is None else which:
        force.addParticle(int(k))
    force.setForceGroup(group)
    system.addForce(force)


def momentum(context) -> np.ndarray:
    """Total momentum."""
    system = context.getSystem()
    masses = [system.getParticleMass(k).value_in_unit(unit.dalton) for k in range(system.getNumParticles())]
    return np.array(masses) @ state(context)[1]


def fluid_of(scheme, platform, conservative):
    """The fluid, built; skips what there is not."""
    if scheme == "native" and conservative == "kernel":
        pytest.skip("native has no kernel")
    return dpd.build(pushed(), dt=DT, scheme=scheme, conservative=conservative, platform=platform, seed=3)


@SCHEME
@HOST
@CONSERVATIVE
def test_forces_in_every_group_add_up(scheme, platform, conservative):
    """One in each of the groups from 0 to 30 that is free, of different sizes."""
    built = fluid_of(scheme, platform, conservative)
    free = sorted(set(range(32)) - {force.getForceGroup() for force in built.system.getForces()} - {31})
    assert len(free) >= 30  # of its own the package has one group here, or none beside 31
    for group in free:
        push(built.system, 0.5 + 0.1 * group, group)
    simulation = stepped(built.simulation(), STEPS)
    expected = 81 * sum(0.5 + 0.1 * group for group in free) * STEPS * DT
    assert momentum(simulation.context) == pytest.approx([expected, 0, 0], abs=81 * 2.0**-23 * STEPS * 60)


LATTICE = (np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3) + 0.5) * 0.9
APART = [{("*", "*"): dpd.LennardJones(epsilon=0.1, sigma=0.3, cutoff=0.8)}, {("*", "*"): dpd.DPD(gamma=4.5)}]
WARM = {("*", "*"): dpd.EnergyDPD(A=25, sigma=3, kappa=2.0)}
FLUIDS = {
    "one type": lambda: fluid({("A", "*"): dpd.DPD(A=25, gamma=4.5), ("B", "B"): dpd.DPD(A=25, gamma=4.5)}),
    "extended, tilted": lambda: fluid(EXTENDED, BOXES["tilted"], n=90),
    "no box": lambda: fluid(EXTENDED, None, n=90),
    "many-body": lambda: fluid({("*", "*"): dpd.MDPD(A=-40, B=25, gamma=4.5, cutoff=1.0, cutoff_B=0.75)}, n=90),
    "energies": lambda: fluid(WARM, n=90, internal=dpd.InternalEnergy(ConstantHeatCapacity(60.0), 1.0)),
    "conservative only": lambda: fluid({("*", "*"): dpd.DPD(A=25)}, n=90),
    "friction only": lambda: fluid({("*", "*"): dpd.DPD(gamma=4.5)}, n=90),
    "Lennard-Jones": lambda: fluid(APART, BOXES["ortho"], n=64, spread=0, positions=LATTICE),
    "ramp": lambda: fluid({("*", "*"): dpd.DPD(A=25, gamma=4.5)}, n=90, kT=dpd.TemperatureRamp(1.0, 2.0, 3, 15)),
}


@pytest.mark.parametrize(("kind", "scheme"), itertools.product(FLUIDS, OWN))
def test_every_kind_of_scene_feels_a_force(kind, scheme):
    """Momentum of the whole, in every kind of fluid; platforms and groups take turns."""
    turn = OWN.index(scheme) + list(FLUIDS).index(kind)
    platform, group = HOSTS[turn % 2], (0, 11)[turn // 2 % 2]
    scene = FLUIDS[kind]()
    built = dpd.build(scene, dt=0.002, scheme=scheme, platform=platform, seed=3)
    n = scene.n_beads
    push(built.system, FORCE, group)
    simulation = built.simulation()
    context = simulation.context
    before, size = momentum(context), np.abs(context.getState(forces=True).getForces(asNumpy=True)._value).sum()
    simulation.step(STEPS)
    expected = [n * FORCE * STEPS * 0.002, 0, 0]
    single = 0 if platform == "Reference" else 2.0**-22  # OpenMM's own forces on the CPU
    assert momentum(context) - before == pytest.approx(expected, abs=1e-8 + single * STEPS * 0.002 * size)


@pytest.mark.parametrize("scheme", OWN)
@HOST
def test_a_force_on_some_beads_leaves_immobile_ones_alone(scheme, platform):
    """... and the others get its impulse, if nothing acts between the two kinds."""
    table = {("W", "W"): dpd.DPD(A=25, gamma=4.5), ("S", "*"): dpd.NONE}
    n = 81
    x = np.random.default_rng(1).random((n, 3)) * 3
    mobile = np.arange(n) >= 9
    v = np.random.default_rng(2).normal(size=(n, 3)) * mobile[:, None]
    scene = dpd.Scene({"W": 1.0, "S": 1.0}, ["S"] * 9 + ["W"] * 72, x, table, 1.0, box=[3.0] * 3, mobile=mobile, velocities=v)
    built = dpd.build(scene, dt=DT, scheme=scheme, platform=platform, seed=3)
    push(built.system, FORCE, 7)
    simulation = built.simulation()
    before = momentum(simulation.context)
    simulation.step(STEPS)
    assert momentum(simulation.context) - before == pytest.approx([72 * FORCE * STEPS * DT, 0, 0], abs=72 * 2.0**-23 * STEPS * 60)
    assert np.array_equal(state(simulation.context)[0][:9], x[:9])


# -- the same force in two ways --------------------------------------------------------------------------------------------------------
@every_pair("scheme, platform, conservative, group", SCHEMES, HOSTS, ("openmm", "kernel"), (0, 7, 30))
def test_a_bond_is_a_bond_whoever_makes_it(scheme, platform, conservative, group):
    """Stiff bonds in the fluid, by the scene and by OpenMM's force: the first steps are the same.

    In the loop of whole steps a force of OpenMM's kicks around them, which is the same step in `middle` only.
    """
    if scheme == "native" and conservative == "kernel":
        pytest.skip("native has no kernel")
    pairs = np.array([(0, 1), (1, 2), (10, 11), (20, 40)])
    k, r0, steps = 200.0, 0.6, 5
    found = []
    for bonds in ([dpd.HarmonicBonds(pairs, k=k, r0=r0)], []):
        choices = {"conservative": conservative, "platform": platform, "loop": scheme == "middle"}
        built = dpd.build(pushed(bonds=bonds), dt=DT, scheme=scheme, seed=3, **choices)
        if not bonds:
            force = openmm.HarmonicBondForce()
            for first, second in pairs.tolist():
                force.addBond(first, second, r0, _openmm_constant(k))
            force.setUsesPeriodicBoundaryConditions(True)
            force.setForceGroup(group)
            built.system.addForce(force)
        simulation = built.simulation()
        if scheme == "native":
            simulation.integrator.setRandomNumberSeed(5)
            simulation.context.reinitialize(preserveState=True)
        simulation.step(steps)
        found.append(state(simulation.context))
    size = k * 1.5 * DT * steps  # of the bonds' impulses
    limit = size * (1e-10 if platform == "Reference" else 2.0**-20)
    assert np.abs(found[0][1] - found[1][1]).max() < limit
    assert np.abs(found[0][0] - found[1][0]).max() < limit * DT * steps


def _openmm_constant(k: float) -> float:
    """The constant of OpenMM's HarmonicBondForce for the energy of this package's bond."""
    bonds = [dpd.HarmonicBonds([(0, 1)], k=k, r0=0.0)]
    scene = dpd.Scene({"W": 1.0}, ["W"] * 2, [[0, 0, 0], [1.0, 0, 0]], {("W", "W"): dpd.DPD(gamma=1)}, 1.0, bonds=bonds)
    context = dpd.build(scene, dt=DT, platform="Reference", seed=1).simulation().context
    return 2 * context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)


# -- group 31, and groups given anew -----------------------------------------------------------------------------------------------------
def one_line(error: BaseException) -> None:
    """A refusal is one line in words, and not numpy's."""
    text = str(error)
    assert text and "\n" not in text.strip() and "broadcast" not in text and "object has no attribute" not in text, text


@pytest.mark.parametrize("scheme", OWN)
@HOST
@CONSERVATIVE
@pytest.mark.parametrize("way", ["build", "add_thermostat", "mixed"])
def test_a_force_in_the_group_of_the_pair_terms_is_refused_or_right(scheme, platform, conservative, way):
    """Added after them, where nobody can move it."""
    if way != "build" and conservative == "kernel":
        pytest.skip("there is no choice")
    cell = Cell("external", 31, scheme, platform, conservative if way == "build" else "auto", way, "after", "app")
    try:
        assert cells._run(cell) == "acts"
    except REFUSED as error:
        one_line(error)
        assert "group" in str(error)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", OWN)
@HOST
@pytest.mark.parametrize("way", ["build-openmm", "build-kernel", "add_thermostat", "mixed"])
@pytest.mark.parametrize("how", ["by number", "all in one", "pair terms to 0", "others to 31"])
def test_renumbered_groups_are_refused_or_right(scheme, platform, way, how):
    """The usual idiom for energies by term: a group for each force, before the Simulation is made."""
    way, _, conservative = way.partition("-")
    cell = Cell("external", 0, scheme, platform, conservative or "auto", way, "after", "app")
    found = []
    for renumber in (False, True):
        case = {"build": lambda: cells.beads(cell), "add_thermostat": cells.argon, "mixed": cells.atoms}[way]()
        if way == "add_thermostat":
            cells.with_thermostat(case, cell)
        elif way == "mixed":
            cells.among_beads(case, cell)
        forces = case.system.getForces()
        own = max(force.getForceGroup() for force in forces)
        for k, force in enumerate(forces if renumber else ()):
            if how == "by number":
                force.setForceGroup(k)
            elif how == "all in one":
                force.setForceGroup(5)
            elif how == "pair terms to 0" and force.getForceGroup() == own:
                force.setForceGroup(0)
            elif how == "others to 31":
                force.setForceGroup(31)
        try:
            simulation = stepped(case.simulation(platform, False), 10)
        except REFUSED as error:
            assert renumber, error
            one_line(error)
            assert "group" in str(error)
            return
        found.append(state(simulation.context)[1])
    assert np.abs(found[0] - found[1]).max() < np.sqrt(np.mean(found[0] ** 2)) * (1e-9 if platform == "Reference" else 1e-4)


# -- particles, virtual sites, constraints -------------------------------------------------------------------------------------------
@SCHEME
@pytest.mark.parametrize("platform", cells.LEVELS["platform"])
@CONSERVATIVE
def test_added_particles_are_refused(scheme, platform, conservative):
    """By one line, at the first step at the latest."""
    if lacking(platform):
        pytest.skip(lacking(platform))
    built = fluid_of(scheme, platform, conservative)
    built.system.addParticle(1.0)
    with pytest.raises(REFUSED) as caught:
        context = openmm.Context(built.system, built.integrator, openmm.Platform.getPlatformByName(platform))
        context.setPositions(np.vstack([built.positions.value_in_unit(unit.nanometer), [[1.0, 1.0, 1.0]]]))
        context.getIntegrator().step(1)
    one_line(caught.value)
    assert "particle" in str(caught.value)


@SCHEME
@HOST
@CONSERVATIVE
def test_virtual_sites_act_or_are_refused(scheme, platform, conservative):
    """A bead without mass becomes the middle of two others."""
    if scheme == "native":
        pytest.skip("OpenMM's DPDIntegrator ends in NaN near massless particles")
    n = 81
    table = {("W", "W"): dpd.DPD(A=25, gamma=4.5), ("S", "*"): dpd.NONE}
    x = np.random.default_rng(1).random((n, 3)) * 3
    x[0] = (x[1] + x[2]) / 2
    v = np.random.default_rng(2).normal(size=(n, 3))
    v[0] = 0
    scene = dpd.Scene({"W": 1.0, "S": 1.0}, ["S"] + ["W"] * (n - 1), x, table, 1.0, box=[3.0] * 3, mobile=np.arange(n) > 0, velocities=v)
    built = dpd.build(scene, dt=DT, scheme=scheme, conservative=conservative, platform=platform, seed=3)
    built.system.setVirtualSite(0, openmm.TwoParticleAverageSite(1, 2, 0.5, 0.5))
    try:
        simulation = stepped(built.simulation(), STEPS)
    except REFUSED as error:
        one_line(error)
        assert "site" in str(error)
        return
    found = state(simulation.context)[0]
    assert np.abs(found[1] - x[1]).max() > 0.01
    assert found[0] == pytest.approx((found[1] + found[2]) / 2, abs=1e-6)


@pytest.mark.parametrize("scheme", OWN)
@HOST
@CONSERVATIVE
def test_a_force_on_a_constrained_pair_moves_both_or_is_refused(scheme, platform, conservative):
    """Constraint and force together: the pair keeps its distance and takes up all of the impulse."""
    case = cells.beads(Cell("constraint", 0, scheme, platform, conservative, "build", "after", "app"))
    cells.add_constraint(case, 0)
    force = openmm.CustomExternalForce(f"-{FORCE}*x")
    force.addParticle(case.free[0])
    force.setForceGroup(7)
    case.system.addForce(force)
    try:
        simulation = stepped(case.simulation(platform, False), STEPS)
    except REFUSED as error:
        one_line(error)
        assert "constrain" in str(error)
        return
    x, v = state(simulation.context)
    assert np.linalg.norm(x[1] - x[0]) == pytest.approx(1.0, abs=1e-4)
    assert (case.masses[:, None] * v)[:2].sum(axis=0) == pytest.approx([FORCE * STEPS * case.dt, 0, 0], abs=1e-4)


# -- added again and again -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", SCHEMES)
@HOST
@CONSERVATIVE
def test_forces_can_come_and_go_between_steps(scheme, platform, conservative):
    """Added, changed, and taken away again with reinitialize: what acts is what the System has."""
    built = fluid_of(scheme, platform, conservative)
    simulation = stepped(built.simulation(), 3)
    total = 0.0
    for group, strength in ((7, 10.0), (30, -4.0), (None, -10.0)):
        if group is None:
            (at,) = [k for k, force in enumerate(built.system.getForces()) if force.getForceGroup() == 7]
            built.system.removeForce(at)
        else:
            push(built.system, strength, group)
        simulation.context.reinitialize(preserveState=True)
        before = momentum(simulation.context)
        simulation.step(STEPS)
        total += strength
        assert abs((momentum(simulation.context) - before)[0] - 81 * total * STEPS * DT) < 81 * 2.0**-23 * STEPS * 60, group


@pytest.mark.parametrize("scheme", OWN)
@pytest.mark.parametrize("way", [openmm.XmlSerializer.clone, copy.copy, copy.deepcopy], ids=["XML", "copy", "deepcopy"])
@HOST
def test_copies_of_a_system_and_its_integrator_take_a_force(scheme, platform, way):
    """They travel as XML, or are copied, and the System gets its force on the way."""
    built = dpd.build(pushed(), dt=DT, scheme=scheme, platform=platform, seed=3)
    system, integrator = way(built.system), way(built.integrator)
    push(system, FORCE, 7)
    simulation = app.Simulation(built.topology, system, integrator, openmm.Platform.getPlatformByName(platform))
    place(simulation.context, built.positions, built.velocities)
    simulation.step(STEPS)
    assert momentum(simulation.context) == pytest.approx([81 * FORCE * STEPS * DT, 0, 0], abs=81 * 2.0**-23 * STEPS * 60)


@pytest.mark.parametrize("scheme", OWN)
@HOST
@CONSERVATIVE
def test_a_force_reaches_every_bead_that_it_names(scheme, platform, conservative):
    """Free beads get different impulses, each its own, in three directions."""
    n = 40
    x = np.random.default_rng(1).random((n, 3)) * 3
    v = np.random.default_rng(2).normal(size=(n, 3))
    masses = np.random.default_rng(3).uniform(0.5, 3.0, n)
    # beads far from each other in a large box have no neighbours: friction and repulsion are there and do nothing
    x = np.stack(np.meshgrid(*[np.arange(4) * 3.0] * 3), axis=-1).reshape(-1, 3)[:n]
    v *= 0.1
    table = {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    scene = dpd.Scene({"W": 1.0}, ["W"] * n, x, table, 1.0, box=[12.0] * 3, bead_masses=masses, velocities=v)
    strengths = np.random.default_rng(4).normal(size=(n, 3))
    built = dpd.build(scene, dt=DT, scheme=scheme, conservative=conservative, platform=platform, seed=3)
    force = openmm.CustomExternalForce("-(a*x+b*y+c*z)")
    for name in "abc":
        force.addPerParticleParameter(name)
    for k in range(n):
        force.addParticle(k, strengths[k])
    force.setForceGroup(12)
    built.system.addForce(force)
    simulation = stepped(built.simulation(), STEPS)
    t = STEPS * DT
    found_x, found_v = state(simulation.context)
    ahead = cells.AHEAD.get(scheme, 0.0)
    acceleration = strengths / masses[:, None]
    assert found_v == pytest.approx(v + acceleration * t, abs=1e-6)
    assert found_x == pytest.approx(x + v * t + acceleration * DT**2 * (STEPS**2 / 2 + ahead * STEPS), abs=1e-6)
