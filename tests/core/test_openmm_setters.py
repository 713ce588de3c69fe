"""Changes between two steps, setter by setter: in whole steps and in programs they do what they do with an integrator of OpenMM's own.

Beads farther apart than the cutoff of the pair terms feel the user's force alone, so that all three ways of stepping give one trajectory.
"""

import numpy as np
import openmm
import pytest
from cases import every_pair, raises
from import_graph import ROOT
from openmm_setters import BAROSTATS, FORCES, GENERIC, LIKE_ALL, METHODS, REFUSED, N, force_classes, setters
from scenes import place, state_of

import openmm_dpd as dpd
from openmm_dpd.units import BOLTZMANN

BOX, DT = 4.0, 0.01
CORNERS = np.array([[2.3 * (i >> 2), 1.2 * (i >> 1 & 1), 1.3 * (i & 1)] for i in range(N)]) + 0.3
START = CORNERS + 0.05 * np.sin(np.arange(3 * N)).reshape(N, 3), 0.1 * np.cos(np.arange(3 * N)).reshape(N, 3)
REFERENCE = openmm.Platform.getPlatformByName("Reference")


def push(state):
    force = np.zeros((len(state.getPositions()), 3))
    force[:, 0] = 3.0
    return 0.0, force


NAMES = {"openmm": openmm, "N": N, "table": lambda: openmm.Continuous1DFunction([1, 2, 5], 0.0, 9.0), "PUSH": push}


class Run:
    """Beads in a Context, stepped ``"whole"``, by a ``"program"``, or by OpenMM's ``"own"`` integrator without friction."""

    def __init__(self, way: str, forces=(), *, built=None, system=None, integrator=None, **choices):
        if system is None and way == "own":
            system, integrator = openmm.System(), openmm.LangevinMiddleIntegrator(0.0, 0.0, DT)
            integrator.setRandomNumberSeed(1)
            system.setDefaultPeriodicBoxVectors(*(BOX * np.eye(3)))
            for _ in range(N):
                system.addParticle(2.0)
        elif system is None:
            built = built or self.built(way, **choices)
            system, integrator = built.system, built.integrator
        for force in forces:
            system.addForce(force)
        self.system, self.integrator = system, integrator
        self.context = openmm.Context(system, integrator, REFERENCE)
        self.put_back()
        self.step(2)

    @staticmethod
    def built(way: str, scheme: str = "middle", pair=None, kT: float = 1.0, **choices) -> dpd.BuiltSystem:
        pairs = {("A", "A"): pair or dpd.DPD(A=25, gamma=4.5, cutoff=0.5)}
        scene = dpd.Scene({"A": 2.0}, ["A"] * N, START[0], pairs, kT=kT, box=[BOX] * 3, **choices)
        return dpd.build(scene, dt=DT, scheme=scheme, platform="Reference", seed=1, loop=way == "whole")

    def put_back(self) -> None:
        place(self.context, START[0], START[1])

    def step(self, n: int) -> None:
        self.integrator.step(n)

    def forces(self) -> np.ndarray:
        return self.context.getState(forces=True).getForces(asNumpy=True)._value


def trio(make=lambda: ()) -> list[Run]:
    """The three ways, OpenMM's own first."""
    return [Run(way, make()) for way in ("own", "whole", "program")]


def same(runs: list[Run], n: int = 3) -> None:
    """All take the same steps."""
    for run in runs:
        run.step(n)
    for run in runs[1:]:
        for found, expected in zip(end(run), end(runs[0]), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


def end(run: Run) -> list[np.ndarray]:
    """Positions, velocities, time and number of steps."""
    context = run.context
    return [*state_of(context), np.array([context.getTime()._value, context.getStepCount()])]


def differ(first: np.ndarray, second: np.ndarray) -> bool:
    return not np.allclose(first, second, rtol=1e-9, atol=1e-9)


# -- the table is whole -----------------------------------------------------------------------------------------------------------------
def test_every_force_is_in_the_table():
    """One that a newer OpenMM has is not: say what its setters do, or that it is like all."""
    assert force_classes() == set(FORCES) | LIKE_ALL | set(REFUSED) | set(BAROSTATS)


def test_the_page_says_what_the_table_says():
    page = (ROOT / "docs" / "howto" / "changes.md").read_text(encoding="utf-8")
    every = [row for rows in METHODS.values() for row in rows.items()]
    rows = {f"| `{method}` | {in_table(whole)} | {in_table(program)} |" for method, (whole, program) in every}
    assert not [row for row in sorted(rows) if row not in page]
    assert page.count("\n| `") == len(rows)


def in_table(does: str) -> str:
    """What a change does, in the words of the page."""
    words = {"": "-", "anew": "after `reinitialize`", "refused": "refused", "anew refused": "refused after `reinitialize`"}
    word = does.partition(": ")[0]
    return words.get(word, word)


# -- forces of users ----------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", FORCES)
def test_forces_of_users(name):
    block = FORCES[name]

    def make():
        scope = dict(NAMES)
        exec(block.code, scope)
        scope["f"].setName("user's")
        return [scope["f"]]

    runs = trio(make)
    for line in block.lines:
        for run in runs:
            run.put_back()
        at_first = runs[0].forces()
        if line.does == "refused":
            for run in runs:
                with pytest.raises(openmm.OpenMMException):  # a Context whose reinitialize() fails is not even deleted without a crash
                    carry_out(line.code, run)
                    openmm.Context(run.system, openmm.VerletIntegrator(DT), REFERENCE)
            runs = trio(make)
            continue
        for run in runs:
            carry_out(line.code, run)
        assert not differ(at_first, runs[0].forces()), line
        if line.does == "update":
            for run in runs:
                users(run).updateParametersInContext(run.context)
            assert differ(at_first, runs[0].forces()), line
        same(runs)
        before = runs[0].forces()
        for run in runs:
            run.context.reinitialize(preserveState=True)
        assert differ(before, runs[0].forces()) == (line.does == "anew"), line
        same(runs)


def users(run: Run) -> openmm.Force:
    return next(force for force in run.system.getForces() if force.getName() == "user's")


def carry_out(code: str, run: Run) -> None:
    exec(code, NAMES | {"f": users(run), "CONTEXT": run.context})


@pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle", "bababo"])
@pytest.mark.parametrize("way", ["whole", "program"])
@pytest.mark.parametrize("how", ["reinitialize", "update"])
def test_a_force_that_changed_acts_from_the_first_half_kick(how, way, scheme):
    """... of the next step, in schemes whose programs keep accelerations as well."""
    force = openmm.CustomExternalForce("-k*x")
    force.addPerParticleParameter("k")
    for bead in range(N):
        force.addParticle(bead, [1.0])
    run = Run(way, [force], scheme=scheme)
    before = state_of(run.context)[1]
    if how == "reinitialize":
        force.setEnergyFunction("-5*x")
        run.context.reinitialize(preserveState=True)
    else:
        for bead in range(N):
            force.setParticleParameters(bead, bead, [5.0])
        force.updateParametersInContext(context=run.context)
    run.step(3)
    assert (state_of(run.context)[1] - before)[:, 0] == pytest.approx(np.full(N, 3 * DT * 5 / 2.0))


# -- System, Context, integrators -----------------------------------------------------------------------------------------------------------
CLASSES = {"PairIntegrator": dpd.simulation.integrators.PairIntegrator, "System": openmm.System, "Context": openmm.Context}


def spring() -> list[openmm.Force]:
    """A force with a parameter, in a group of its own, and a bond to the next image, which depends on the box."""
    force, bond = openmm.CustomExternalForce("k*x^2"), openmm.HarmonicBondForce()
    force.setName("user's")
    force.setForceGroup(5)
    force.addGlobalParameter("k", 1.0)
    for bead in range(N):
        force.addParticle(bead)
    bond.addBond(0, 4, 1.0, 5.0)
    bond.setUsesPeriodicBoundaryConditions(True)
    return [force, bond]


def pull(run: Run) -> None:
    force = openmm.CustomExternalForce("y")
    force.addParticle(3)
    run.system.addForce(force)


def go_back(run: Run, how: str) -> None:
    """To what was saved some steps ago."""
    context = run.context
    state = context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
    saved = context.createCheckpoint() if how == "loadCheckpoint" else state
    run.step(4)
    getattr(context, how)(saved)


def make_virtual(run: Run) -> None:
    run.system.setParticleMass(7, 0.0)
    run.system.setVirtualSite(7, openmm.TwoParticleAverageSite(0, 1, 0.5, 0.5))


def used_groups(run: Run) -> set[int]:
    return {group for group in range(32) if run.integrator.getIntegrationForceGroups() >> group & 1}


def set_step(run: Run) -> None:
    run.integrator.setStepSize(0.3 * DT)
    if isinstance(run.integrator, openmm.CustomIntegrator) and run.integrator.whole is None:
        run.context.reinitialize(preserveState=True)  # the steps act without; only then does OpenMM count the time with them, too


#: What is done.
CHANGES = {
    "addConstraint": lambda run: run.system.addConstraint(0, 1, 1.3),
    "addForce": pull,
    "addParticle": lambda run: run.system.addParticle(1.0),
    "removeForce": lambda run: run.system.removeForce(run.system.getNumForces() - 1),
    "setDefaultPeriodicBoxVectors": lambda run: run.system.setDefaultPeriodicBoxVectors(*(3.9 * np.eye(3))),
    "setParticleMass": lambda run: run.system.setParticleMass(1, 5.0),
    "setVirtualSite": make_virtual,
    "loadCheckpoint": lambda run: go_back(run, "loadCheckpoint"),
    "setState": lambda run: go_back(run, "setState"),
    "reinitialize": lambda run: (run.context.reinitialize(), run.put_back()),
    "setParameter": lambda run: run.context.setParameter("k", 4.0),
    "setPeriodicBoxVectors": lambda run: run.context.setPeriodicBoxVectors(*(3.9 * np.eye(3))),
    "setPositions": lambda run: run.context.setPositions(START[0] + 0.02),
    "setStepCount": lambda run: run.context.setStepCount(77),
    "setTime": lambda run: run.context.setTime(3.0),
    "setVelocities": lambda run: run.context.setVelocities(0.3 * START[1]),
    "setIntegrationForceGroups": lambda run: run.integrator.setIntegrationForceGroups(used_groups(run) - {5}),
    "setStepSize": set_step,
    "setForceGroup": lambda run: users(run).setForceGroup(31),
    "setName": lambda run: users(run).setName("another"),
    "addTabulatedFunction": lambda run: (
        isinstance(run.integrator, openmm.CustomIntegrator) and run.integrator.addTabulatedFunction("table", NAMES["table"]())
    ),
}


def test_every_method_is_in_the_table():
    for name, cls in CLASSES.items():
        assert set(METHODS[name]) == setters(cls), name
    known = GENERIC | set(METHODS["MonteCarloBarostat"]) | set(METHODS["MonteCarloMembraneBarostat"])
    assert known >= set().union(*(setters(getattr(openmm, name)) for name in BAROSTATS))
    assert set(METHODS["Force"]) == setters(openmm.Force)


@pytest.mark.parametrize("way", ["whole", "program"])
@pytest.mark.parametrize("method", CHANGES)
def test_methods_of_system_context_and_integrator(method, way):
    (does,) = (methods[method][way == "program"] for methods in METHODS.values() if method in methods)
    word, _, reason = does.partition(": ")
    own, run, untouched = (Run(kind, spring()) for kind in ("own", way, "own"))
    CHANGES[method](run)
    if word.endswith("refused"):
        if word.startswith("anew"):
            same([untouched, run])
            run.context.reinitialize(preserveState=True)
        raises(dpd.PlanError, reason, lambda: run.step(1))
        return
    CHANGES[method](own)
    if word == "anew":
        for one in (own, run):
            one.context.reinitialize(preserveState=True)
    same([own, run])
    untouched.step(3)
    changed = any(differ(*pair) for pair in zip(end(own), end(untouched), strict=True))
    assert changed == (word != "nothing" and method not in ("loadCheckpoint", "setState"))  # these come back to where they were


@pytest.mark.parametrize("way", ["whole", "program"])
def test_velocities_of_a_temperature(way):
    """OpenMM draws them for the times at which its own integrator has velocities, and for positions' times with all others."""
    run = Run(way, spring())
    run.context.setVelocitiesToTemperature(10.0, 5)
    drawn, force = state_of(run.context)[1], run.forces()
    assert differ(drawn, START[1])
    run.step(1)
    np.testing.assert_allclose(state_of(run.context)[1], drawn + DT * force / 2.0, atol=1e-10)


def test_groups_that_a_program_does_not_take_over_act_when_the_context_is_made_anew():
    runs = [Run(way, spring()) for way in ("own", "program")]
    for run in runs:
        CHANGES["setIntegrationForceGroups"](run)
        run.context.reinitialize(preserveState=True)
    same(runs)


def test_a_mass_of_zero_is_refused_with_what_holds_beads():
    """Scripts for OpenMM hold atoms so."""
    run = Run("whole", ())
    run.system.setParticleMass(1, 0.0)
    run.context.reinitialize(preserveState=True)
    raises(dpd.PlanError, "give the scene its masses, and mobile= to hold beads", lambda: run.step(1))


@pytest.mark.parametrize("way", ["whole", "program"])
def test_forces_and_groups_of_the_package_stay(way):
    for change, reason in (
        (lambda run, k: run.integrator.setIntegrationForceGroups({0}), "force group .* was in the integration force groups"),
        (lambda run, k: run.system.removeForce(k), "is gone"),
        (lambda run, k: (run.system.getForce(k).setForceGroup(0), run.context.reinitialize(True)), "is in group 0 now"),
        (lambda run, k: (run.system.getForce(k).setName("mine"), run.context.reinitialize(True)), "is gone"),
    ):
        run = Run(way)
        change(run, next(k for k, force in enumerate(run.system.getForces()) if force.getName() == "DPD pair terms"))
        raises(dpd.PlanError, reason, run.step, 1)


def test_a_lattice_sum_in_the_group_of_the_pair_terms_is_refused():
    force = openmm.NonbondedForce()
    force.setNonbondedMethod(openmm.NonbondedForce.PME)
    for bead in range(N):
        force.addParticle((-1) ** bead, 1.0, 0.0)
    run = Run("program", [force])
    force.setReciprocalSpaceForceGroup(31)
    run.step(1)
    run.context.reinitialize(preserveState=True)
    raises(dpd.PlanError, "is in force group 31", lambda: run.step(1))


@pytest.mark.parametrize("way", ["whole", "program", "host"])
@pytest.mark.parametrize("name", REFUSED)
def test_forces_that_are_refused(name, way):
    force = getattr(openmm, name)(*{"AndersenThermostat": (300, 1), "RPMDMonteCarloBarostat": (1.0,)}.get(name, ()))
    with pytest.raises((dpd.PlanError, openmm.OpenMMException), match=REFUSED[name]):
        bound("program", [force]) if way == "host" else Run(way, [force])


# -- what the integrators of the package have beside -------------------------------------------------------------------------------------------
ARGUMENTS = {"addComputeGlobal": ("dpd_dt", "1"), "addComputePerDof": ("v", "0.5*v"), "addComputeSum": ("unused", "x")}
ARGUMENTS |= {name: () for name in ("addConstrainPositions", "addConstrainVelocities", "addUpdateContextState")}
ARGUMENTS |= {name: ("more", 1.0) for name in ("addGlobalVariable", "addPerDofVariable")}


@pytest.mark.parametrize("way", ["whole", "program"])
def test_programs_are_closed_in_a_context(way):
    run = Run(way)
    for method, arguments in ARGUMENTS.items():
        raises(openmm.OpenMMException, METHODS["PairIntegrator"][method][0].partition(": ")[2], getattr(run.integrator, method), *arguments)


def test_lines_that_were_added_before_are_executed():
    """Whole steps leave the steps to a program that somebody added to."""
    ends = []
    for way in ("whole", "program"):
        built = Run.built(way)
        built.integrator.addComputePerDof("v", "0.5*v")
        ends.append(end(Run(way, built=built)))
        assert np.abs(ends[-1][1] - 0.25 * START[1]).max() < 1e-12
    assert not differ(ends[0][0], ends[1][0])


@pytest.mark.parametrize("way", ["whole", "program"])
def test_values_of_an_integrator(way):
    run = Run(way)
    integrator, names = run.integrator, run.integrator.variables()
    index = next(k for k in range(len(names)) if integrator.getGlobalVariableName(k) == "temperature")
    for set_it, kelvin in (
        (lambda T: integrator.setTemperature(T), 200.0),
        (lambda T: integrator.setGlobalVariableByName("temperature", T), 210.0),
        (lambda T: integrator.setGlobalVariable(index, T), 220.0),
    ):
        set_it(kelvin)
        run.step(1)
        assert run.context.getParameter("dpd_kT") == pytest.approx(kelvin * BOLTZMANN)
    integrator.setRandomNumberSeed(99)
    run.step(1)
    assert run.context.getParameter("dpd_seed") == 99
    energies = []
    for change in (lambda: None, lambda: integrator.setKineticEnergyExpression("m*v*v"), lambda: run.context.reinitialize(True)):
        change()
        energies.append(run.context.getState(energy=True).getKineticEnergy()._value)
    assert energies[1:] == pytest.approx([energies[0], 2 * energies[0]])


@pytest.mark.parametrize("way", ["whole", "program"])
def test_values_of_each_bead(way):
    """Temperatures of beads, which the integrator keeps, are set by name and by number."""
    fields = dpd.BeadTemperatures(thetas=1.0, capacities=10.0)
    run = Run(way, scheme="mvv", pair=dpd.EDPD(A=25, gamma=4.5, kappa=0.1, cutoff=0.5), internal=fields)
    index = next(k for k in range(run.integrator.getNumPerDofVariables()) if run.integrator.getPerDofVariableName(k) == "field0")
    for set_it, theta in (
        (lambda values: run.integrator.setPerDofVariableByName("field0", values), 2.0),
        (lambda values: run.integrator.setPerDofVariable(index, values), 3.0),
    ):
        set_it([openmm.Vec3(theta, 0, 0)] * N)
        run.step(3)
        assert np.array(run.integrator.getPerDofVariableByName("field0"))[:, 0] == pytest.approx(np.full(N, theta))


# -- constraints, where a System has them ---------------------------------------------------------------------------------------------------
def bound(way: str, forces=()) -> Run:
    """Two constraints and a virtual site, beside OpenMM's own integrator or with a thermostat."""
    system = openmm.System()
    system.setDefaultPeriodicBoxVectors(*(BOX * np.eye(3)))
    for _ in range(N - 1):
        system.addParticle(2.0)
    system.addParticle(0.0)
    system.setVirtualSite(N - 1, openmm.TwoParticleAverageSite(4, 5, 0.5, 0.5))
    for k in (0, 2):
        system.addConstraint(k, k + 1, float(np.linalg.norm(START[0][k] - START[0][k + 1])))
    for force in (*spring(), *forces):
        system.addForce(force)
    integrator = openmm.LangevinMiddleIntegrator(0.0, 0.0, DT)
    if way == "program":
        integrator = dpd.add_thermostat(system, dpd.DPD(gamma=4.5, cutoff=0.5), 120, DT, seed=1, platform="Reference").integrator
    integrator.setConstraintTolerance(1e-10)
    return Run(way, system=system, integrator=integrator)


BOUND = {
    "removeConstraint": lambda run: run.system.removeConstraint(0),
    "setConstraintParameters": lambda run: run.system.setConstraintParameters(0, 0, 1, 1.28),
    "applyConstraints": lambda run: (run.context.setPositions(START[0] * 1.01), run.context.applyConstraints(1e-10)),
    "applyVelocityConstraints": lambda run: (run.context.setVelocities(START[1]), run.context.applyVelocityConstraints(1e-10)),
    "computeVirtualSites": lambda run: (run.context.setPositions(START[0]), run.context.computeVirtualSites()),
    "setConstraintTolerance": lambda run: run.integrator.setConstraintTolerance(1e-3),
    "addConstraint": lambda run: run.system.addConstraint(4, 6, 1.2),
    "setVirtualSite": lambda run: run.system.setVirtualSite(N - 1, openmm.TwoParticleAverageSite(4, 5, 0.3, 0.7)),
}


@pytest.mark.parametrize("method", BOUND)
def test_constraints_and_virtual_sites(method):
    does = next(methods[method][1] for methods in METHODS.values() if method in methods)
    runs = [bound("own"), bound("program")]
    for run in runs:
        BOUND[method](run)
        if does != "acts":
            run.context.reinitialize(preserveState=True)
            run.context.applyConstraints(1e-10)
    if method == "setConstraintTolerance":
        assert runs[1].integrator.getConstraintTolerance() == 1e-3
        for run in runs:
            run.step(5)
            x = state_of(run.context)[0]
            assert np.linalg.norm(x[1] - x[0]) == pytest.approx(np.linalg.norm(START[0][1] - START[0][0]), rel=2e-3)
        return
    same(runs)


# -- barostats ----------------------------------------------------------------------------------------------------------------------------
def edges(run: Run) -> np.ndarray:
    """The box, its three edges first."""
    box = run.context.getState().getPeriodicBoxVectors(asNumpy=True)._value
    return np.append(np.diag(box), box[np.tril_indices(3, -1)])


def moved(run: Run, n: int = 20) -> np.ndarray:
    """Which numbers of the box change in some steps, and whether they become larger."""
    before = edges(run)
    run.step(n)
    return np.sign(edges(run) - before)


WAYS = pytest.mark.parametrize("way", ["own", "whole", "program"])


def pressed(way: str, name: str, frequency: int = 1, bonds: bool = True) -> Run:
    """Beads that are far apart: what the barostat asks for decides.  OpenMM wants something periodic beside it."""
    barostat = BAROSTATS[name](3e3, frequency)
    barostat.setName("user's")
    barostat.setRandomNumberSeed(3)
    molecule = openmm.HarmonicBondForce()
    molecule.setUsesPeriodicBoundaryConditions(True)
    molecule.addBond(2, 3, 1.2, 0.0)
    return Run(way, [barostat, molecule] if bonds else [barostat])


@every_pair("way, name, anew", ("own", "whole", "program"), list(BAROSTATS), (False, True))
def test_barostats_are_switched_on_and_off(name, way, anew):
    run = pressed(way, name, frequency=0, bonds=way == "own")
    assert not moved(run).any()
    for frequency in (1, 0, 5, 0):
        users(run).setFrequency(frequency)
        if anew:
            run.context.reinitialize(preserveState=True)
        assert moved(run, 80).any() == (frequency > 0)


@pytest.mark.parametrize("way", ["whole", "program"])
def test_a_barostat_that_came_later_acts_when_the_context_is_made_anew(way):
    run = Run(way)
    run.system.addForce(BAROSTATS["MonteCarloBarostat"](3e3, 1))
    assert not moved(run).any()
    run.context.reinitialize(preserveState=True)
    assert moved(run).any()


@pytest.mark.parametrize("way", ["whole", "program"])
def test_a_barostat_that_is_switched_on_has_the_temperature_of_the_thermostat(way):
    run = pressed(way, "MonteCarloBarostat", frequency=0, bonds=False)
    run.context.setParameter("MonteCarloTemperature", 300.0)
    run.step(3)
    users(run).setFrequency(5)
    raises(dpd.PlanError, "samples volumes at 300 K", lambda: run.step(1))
    users(run).setFrequency(0)
    run.integrator.setTemperature(250.0)  # that of a barostat that is off as well
    run.step(3)
    users(run).setFrequency(5)
    run.step(1)
    assert run.context.getParameter("MonteCarloTemperature") == 250.0


@WAYS
def test_pressures(way):
    """The parameter of the Context acts at once, defaults in no Context that keeps its state."""
    run = pressed(way, "MonteCarloBarostat")
    assert moved(run)[0] < 0
    users(run).setDefaultPressure(-3e3)
    users(run).setDefaultTemperature(300.0)
    assert moved(run)[0] < 0
    run.context.reinitialize(preserveState=True)
    assert moved(run)[0] < 0
    run.context.setParameter("MonteCarloPressure", -3e3)
    assert moved(run)[0] > 0


@WAYS
def test_modes_of_the_barostat_for_membranes(way):
    run = pressed(way, "MonteCarloMembraneBarostat")
    users(run).setDefaultSurfaceTension(1e5)
    run.step(20)
    x, y, z = edges(run)[:3]
    assert x == pytest.approx(y) and z < BOX
    users(run).setZMode(openmm.MonteCarloMembraneBarostat.ZFixed)
    run.step(20)
    assert edges(run)[2] == z
    users(run).setXYMode(openmm.MonteCarloMembraneBarostat.XYAnisotropic)
    run.step(20)
    assert abs(edges(run)[0] - edges(run)[1]) > 1e-3


@WAYS
def test_molecules_are_scaled_by_beads_when_the_context_is_made_anew(way):
    run = pressed(way, "MonteCarloBarostat")
    run.context.setVelocities(np.zeros((N, 3)))

    def length():
        x = state_of(run.context)[0]
        return np.linalg.norm(x[3] - x[2])

    first = length()
    users(run).setScaleMoleculesAsRigid(False)
    users(run).setRandomNumberSeed(7)
    moved(run)
    assert length() == pytest.approx(first, rel=1e-9)
    run.context.reinitialize(preserveState=True)
    moved(run)
    assert abs(length() - first) > 1e-3


@pytest.mark.parametrize(("kT", "reported"), [(1.0, True), (2.494, False)])
def test_a_pressure_in_bar_beside_a_reduced_scene_is_said_in_its_units(kT, reported, caplog):
    for name, make in BAROSTATS.items():
        caplog.clear()
        Run("whole", [make(23.7, 0)], kT=kT)
        found = [record.getMessage() for record in caplog.records if "23.7" in record.getMessage()]
        assert bool(found) == reported
        assert not reported or name in found[0] and "1.42725" in found[0] and "add_barostat" in found[0]
    caplog.clear()
    built = Run.built("whole")
    dpd.add_barostat(built, 23.7)  # which converts it
    Run("whole", built=built)
    assert not caplog.records
