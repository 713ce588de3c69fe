"""The result of building: System, integrator, Topology and start, and the Simulation that runs them."""

import io
import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import openmm
from openmm import app, unit

from ..base.errors import A_CONTEXT, ParameterError, PlanError, either, fact_table, require, what_is
from ..base.files import write_whole
from ..base.names import BY_FIELDS, BY_VARIABLES, FIELD, SHOWN, WRITTEN
from ..base.platforms import fastest_platform
from ..base.serialized import checked_xml, deserialized, read_file
from ..base.signals import unbroken
from ..base.units import whole_number, whole_steps
from ..io.snapshot import Cadence
from ..io.view import view
from ..model.pairs import checked
from ..model.scene import Scene
from ..plan.device import PRECISION
from ..plan.explain import explain_plan
from ..plan.forces.device_force import update_force
from ..plan.made import variables_number
from ..plan.pair_spec import longest
from ..plan.plan import Plan
from .bonds import with_bonds
from .device_check import check_device
from .downhill import descend
from .fields import raw_bonds
from .integrators import NativeIntegrator, PairIntegrator
from .programs.program import Program
from .watching import Watching

_LOGGER = logging.getLogger("openmm_dpd")
#: Longest displacement of a bead in one iteration of the minimiser, in cutoffs.
FARTHEST = 0.1


class LateTopology:
    """An attribute that is a Topology, or a function that makes it when it is first asked for: with many beads it takes more time, and as
    much memory, as all else that is built."""

    def __get__(self, instance, owner=None):
        given = vars(instance)["topology"]
        if callable(given):
            given = vars(instance)["topology"] = given()
        return given

    def __set__(self, instance, value):
        vars(instance)["topology"] = value


class DPDSimulation(app.Simulation):
    """An ``openmm.app.Simulation`` that checks states before it loads them, saves them completely or not at all, and has a minimiser of its
    own."""

    topology = LateTopology()

    def __init__(self, plan: Plan, topology: app.Topology | Callable[[], app.Topology], *arguments):
        asked = app.Topology()  # for whether there is a box, if a force does not say whether it uses one
        if plan.scene.box is not None:
            asked.setPeriodicBoxVectors(plan.scene.box * unit.nanometer)
        super().__init__(asked, *arguments)
        self._plan, self.topology = plan, topology

    def step(self, steps: int) -> None:
        """Take steps.  Where a loop of whole steps does them, all steps before a report are taken at once, not ten at a time as in OpenMM.
        Reporters are asked once before each report, since their answer may change from call to call."""
        end = self.currentStep + whole_steps(steps)
        if getattr(self.integrator, "whole", None) is None:
            super().step(end - self.currentStep)
            return
        while self.currentStep < end:
            asked = [(reporter, _described(reporter.describeNextReport(self))) for reporter in self.reporters]
            free = min([end - self.currentStep, *(report["steps"] for _, report in asked if report["steps"] > 0)])
            followed = self._followed(asked, free, end)
            if not followed:
                self.integrator.step(free)
            self._report([each for each in asked if each[1]["steps"] == (followed or free)])

    def _followed(self, asked: list[tuple[Any, dict]], free: int, end: int) -> int:
        """If a reporter alone is due after ``free`` steps, and can report within runs (``report_within(simulation, first, end)`` steps to
        ``end`` and reports steps ``first``, ``first + interval``, ... before it, or returns False), take steps up to the next report of any
        other; returns their number, or 0."""
        (follower, its), *more = [each for each in asked if each[1]["steps"] == free] or [(None, {})]
        kind = next((kind for kind in type(follower).__mro__ if "report" in vars(kind)), object)
        # one that reports something else, or at other steps, is asked as OpenMM would
        own = {"report", "describeNextReport"} & getattr(follower, "__dict__", {}).keys()
        if more or own or "report_within" not in vars(kind) or type(follower).describeNextReport is not Cadence.describeNextReport:
            return 0
        others = [report["steps"] for reporter, report in asked if reporter is not follower and report["steps"] > 0]
        now, last = self.currentStep, min([end - self.currentStep, self.integrator.straight, *others])
        if last <= free or not follower.report_within(self, now + free, now + last):
            return 0
        its["steps"] += (last - free) // follower.interval * follower.interval
        return last

    def _report(self, due: list[tuple[Any, dict]]) -> None:
        """Make the reports that are due: one State for all that want folded positions, one for those that do not."""
        folded, whole, either = list[tuple[Any, dict]](), list[tuple[Any, dict]](), list[tuple[Any, dict]]()
        for each in due:
            folds = self._usesPBC if each[1].get("periodic") is None else each[1]["periodic"]
            (either if "positions" not in each[1]["include"] else folded if folds else whole).append(each)
        (folded if len(folded) > len(whole) else whole).extend(either)
        for reports, folds in ((folded, True), (whole, False)):
            if reports:
                self._generate_reports(reports, folds)

    @unbroken()
    def minimizeEnergy(self, tolerance=10 * unit.kilojoules_per_mole / unit.nanometer, maxIterations=0, reporter=None):
        """Minimise the potential energy by :func:`openmm_dpd.simulation.downhill.descend`, with the parameters of ``app.Simulation``.

        No particle moves by more than a tenth of the longest cutoff in one iteration, and no FENE bond gets as long as its R0.  OpenMM's
        own minimiser breaks such bonds, and crashes on OpenCL through PoCL.  Rigid bodies stay where they are.  RunError if the energy is
        not finite at the start.  With the Lucy kernel of many-body DPD it warns: that force derives from no potential, and has no minimum
        to go to.
        """
        plan = with_bonds(self._plan, raw_bonds(self.integrator)) if self._plan.scene.reactions else self._plan

        def impossible(x: np.ndarray) -> str | None:
            return next(filter(None, (group.overstretched(x, box) for group in plan.scene.bonds)), None)

        box = None if plan.scene.box is None else self.context.getState().getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
        reach = FARTHEST * longest((*plan.layers, *plan.overlays)) or np.inf
        least, most = checked(tolerance, "force", "tolerance"), whole_number(maxIterations, "maxIterations", least=0)
        if plan.no_potential is not None:
            _LOGGER.warning("minimizeEnergy goes down an energy, but %s: it may stop where forces are far from 0", plan.no_potential)
        held = np.concatenate([np.zeros(0, np.int64), *(body.beads for body in plan.scene.bodies)])
        descend(self.context, least, most, reporter, longest=reach, impossible=impossible, held=held)

    def saveState(self, file):
        """Save the state as XML, to a file by its name or to an open one; an OutputError leaves one that was there as it is."""
        _save_whole(super().saveState, file, io.StringIO(), "the state")

    def saveCheckpoint(self, file):
        """Save a checkpoint, to a file by its name or to an open one; OutputError as :meth:`saveState`."""
        _save_whole(super().saveCheckpoint, file, io.BytesIO(), "the checkpoint")

    def loadState(self, file):
        """Load a state in XML, from a file's name or an open file; PlanError, before anything is changed, if another scheme wrote it.

        Variables that this integrator does not have, such as the steps of a temperature ramp that another script followed, are left out.
        """
        root = checked_xml(read_file(file))
        if root.tag != "State":
            raise ParameterError(f"this is no State: the file holds {root.tag!r}")
        state = deserialized(root)
        made = self.integrator.made
        parameters = state.getParameters() if state.getDataTypes() & state.Parameters else {}
        if made is not None:
            made.check_writer(parameters)
            if _take_unknown_out(root, self.integrator):
                state = deserialized(root)
        self.context.setState(state)
        if BY_VARIABLES in parameters:  # variables are loaded by name
            self.context.setParameter(BY_VARIABLES, variables_number(self.integrator))
        self.integrator.settle(self.context)

    def loadCheckpoint(self, file):
        """Load a checkpoint, from a file's name or an open file.

        PlanError if another scheme, or an integrator with other variables, wrote it; positions and velocities are in the Context then.
        """
        super().loadCheckpoint(file)
        self.integrator.settle(self.context)


def _described(report: dict | tuple) -> dict:
    """The answer of a reporter's ``describeNextReport``, a tuple or a dict, as a dict."""
    if isinstance(report, dict):
        return report
    included = zip(("positions", "velocities", "forces", "energy"), report[1:5], strict=True)
    return {
        "steps": report[0],
        "periodic": report[5] if len(report) > 5 else None,
        "include": [name for name, wanted in included if wanted],
    }


def _save_whole(save: Callable, file, content: io.StringIO | io.BytesIO, what: str) -> None:
    """Save to an open file, or to a file by its name, which is written only when all of ``content`` is there."""
    if not isinstance(file, (str, os.PathLike)):
        save(file)
        return
    save(content)
    write_whole(file, content.getvalue(), what)


def _take_unknown_out(root: ElementTree.Element, integrator: openmm.Integrator) -> bool:
    """Remove variables that a CustomIntegrator does not have from a state; returns whether there were any."""
    if not isinstance(integrator, openmm.CustomIntegrator):
        return False
    known = {integrator.getGlobalVariableName(k) for k in range(integrator.getNumGlobalVariables())}
    known_per_dof = {integrator.getPerDofVariableName(k) for k in range(integrator.getNumPerDofVariables())}
    single = [(node, name) for node in root.iterfind("IntegratorParameters/GlobalVariables") for name in set(node.attrib) - known]
    bare = f"{FIELD}0" not in known_per_dof
    absent = {SHOWN: getattr(integrator, "shown_to", None) is None, WRITTEN: bare, BY_FIELDS: bare}
    single += [(node, name) for node in root.iterfind("Parameters") for name, lacks in absent.items() if lacks and name in node.attrib]
    per_dof = [(node, child) for node in root.iterfind("IntegratorParameters/PerDofVariables") for child in node]
    per_dof = [(node, child) for node, child in per_dof if child.tag not in known_per_dof]
    for node, name in single:
        del node.attrib[name]
    for node, child in per_dof:
        node.remove(child)
    return bool(single or per_dof)


@dataclass(eq=False)
class BuiltSystem:
    """A System with its integrator: what :func:`openmm_dpd.build`, :func:`openmm_dpd.add_thermostat` and
    :func:`openmm_dpd.create_mixed_system` return.

    Attributes
    ----------
    system : openmm.System
        Serialized, it holds the pair terms as a pickled Python object: read such a file with :func:`openmm_dpd.load_xml`, which runs no
        other code.
    integrator : PairIntegrator, an openmm.CustomIntegrator (NativeIntegrator, an openmm.DPDIntegrator, for the native scheme)
    topology : openmm.app.Topology, or None if ``add_thermostat`` got none
        Made when it is first asked for.
    positions : (N, 3) Quantity, or None if ``add_thermostat`` got none
    velocities : (N, 3) Quantity
    plan : Plan
    program : Program or None
        None for the native scheme.
    """

    system: openmm.System
    integrator: PairIntegrator | NativeIntegrator
    topology: app.Topology | None
    positions: unit.Quantity | None
    velocities: unit.Quantity
    plan: Plan
    program: Program | None

    def __repr__(self) -> str:
        return f"<{type(self).__name__} from {self.plan!r}>"

    def _repr_html_(self) -> str:
        return fact_table(type(self).__name__, self.plan.facts())

    def explain(self, *, program: bool = False) -> str:
        """The plan in words, with the name of the integrator's program or, with ``program``, its lines."""
        listing = self.program.describe() if self.program else "integrator: openmm.DPDIntegrator"
        if self.program and not program:
            listing = listing.splitlines()[0] + either("; explain(program=True) lists it", "; --program lists it")
        return f"{explain_plan(self.plan)}\n{listing}"

    def simulation(self, platform: openmm.Platform | str | None = None, properties: dict[str, str] | None = None) -> app.Simulation:
        """A Simulation with positions and velocities set (those along constraints removed), on the plan's platform by default.

        With the engine "device" GPU platforms run in mixed precision; ``properties={"Precision": "single"}`` is faster, by a little or, on
        GPUs with few units for double precision, by much.

        It is one that refuses states of other schemes, and that can minimise on OpenCL through PoCL (:mod:`openmm_dpd.simulation`).

        Raises
        ------
        PlanError
            If the integrator belongs to a Simulation already, or there are no topology and positions.
        ParameterError
            If there is no such platform, or it does not know a property.
        """
        require(platform, openmm.Platform | str | None, "platform must be one of OpenMM's platforms or its name")
        require(properties, dict | None, "properties must be a dict of names and values of the platform")
        if vars(self)["topology"] is None or self.positions is None:
            raise PlanError("a Simulation needs a topology and positions: give them to add_thermostat, or make your own app.Simulation")
        simulation = self._new_simulation(platform, properties)
        context = simulation.context
        context.setPositions(self.positions)
        context.setVelocities(self.velocities)
        if self.plan.host is not None:
            context.applyConstraints(1e-6)
            context.computeVirtualSites()
            context.applyVelocityConstraints(1e-6)
        if self.plan.execution.on_device:
            check_device(context, self.plan)
        return simulation

    def update_in_context(self, context: openmm.Context) -> None:
        """Give the repulsion and friction of this build to a Context that another one with the engine "device" has made, as
        ``updateParametersInContext`` of OpenMM's forces does.

        They act from the next step on, with the bits of a new Simulation with the same positions, velocities and parameters.  Temperature,
        step size and seed stay those of the Context.  Measure with this build from then on.

        Parameters
        ----------
        context : openmm.Context
            Of a scene that differs in the numbers A, B, gamma, sigma and gamma_perp of its pairs alone.

        Raises
        ------
        PlanError
            If the two differ in anything else, another engine has made one of them, or there is friction, transverse friction, a fixed
            sigma or repulsion in one of them alone.
        """
        require(context, openmm.Context, A_CONTEXT)
        integrator = context.getIntegrator()
        if not isinstance(integrator, Watching):
            raise PlanError("the Context has an integrator of another package, which does not notice that forces change")
        here, there = (() if each.made is None else each.made.own for each in (self.integrator, integrator))
        if lost := sorted({name for name, _ in set(there) - set(here)}):
            raise PlanError(f"this build has no {lost[0]}, and the Context has: only repulsion and friction can change in it")
        integrator.changed(context)
        update_force(self.system, context)
        if integrator.made is not None and self.integrator.made is not None:
            integrator.made = replace(integrator.made, forces=self.integrator.made.forces)  # of the states that it writes from now on

    def scene_in(self, context: openmm.Context) -> Scene:
        """The scene with the bonds, angles, dihedrals and types that a Context has now, which reactions change."""
        return with_bonds(self.plan, raw_bonds(context.getIntegrator())).scene if self.plan.scene.reactions else self.plan.scene

    def view(self, **choices):
        """A widget of nglview for a notebook: :func:`openmm_dpd.io.view.view`, with its ``state`` and ``radii``."""
        return view(self, **choices)

    def _new_simulation(self, platform: openmm.Platform | str | None, properties: dict[str, str] | None) -> app.Simulation:
        name = platform if platform is not None else self.plan.platform or fastest_platform()
        try:
            chosen = openmm.Platform.getPlatformByName(name) if isinstance(name, str) else name
            usual = chosen.getPropertyDefaultValue("Precision") if "Precision" in chosen.getPropertyNames() else ""
            more = {"Precision": PRECISION} if self.plan.execution.on_device and usual == "single" else {}
            return DPDSimulation(self.plan, lambda: self.topology, self.system, self.integrator, chosen, more | (properties or {}))
        except openmm.OpenMMException as error:
            if "same name as a Context parameter" in str(error):
                name = str(error).rpartition(":")[2].strip()
                raise PlanError(f"a force has a global parameter called {name}, which is a variable of the integrator; rename it") from None
            if "already bound" in str(error):
                again = "this scene" if self.plan.host is None else "this System"
                raise PlanError(f"{again} has a Simulation already; build it again for another one") from None
            raise ParameterError(f"no Simulation on platform {what_is(name)} with properties {what_is(properties)}: {error}") from None


BuiltSystem.topology = LateTopology()  # type: ignore[assignment]  # behind the class, where it is no default
