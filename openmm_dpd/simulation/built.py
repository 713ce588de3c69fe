"""What is handed to ``openmm.app.Simulation``, whichever way it was made."""

from dataclasses import dataclass

import openmm
from openmm import app, unit

from ..base.errors import ParameterError, PlanError, what_is
from ..base.platforms import fastest_platform
from ..base.wording import either, fact_table
from ..io.view import view
from ..plan.explain import explain_plan
from ..plan.plan import Plan
from .device_check import check_device
from .integrators import NativeIntegrator, PairIntegrator
from .programs.program import Program
from .simulation import DPDSimulation


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
        """The plan in words, and the name of the integrator's program, or all of its lines."""
        listing = self.program.describe() if self.program else "integrator: openmm.DPDIntegrator"
        if self.program and not program:
            listing = listing.splitlines()[0] + either("; explain(program=True) lists it", "; --program lists it")
        return f"{explain_plan(self.plan)}\n{listing}"

    def simulation(self, platform: openmm.Platform | str | None = None, properties: dict[str, str] | None = None) -> app.Simulation:
        """A Simulation with positions and velocities set (those along constraints removed), on the plan's platform by default.

        It is one that refuses states of other schemes, and that can minimise on OpenCL through PoCL (:mod:`openmm_dpd.simulation`).

        Raises
        ------
        PlanError
            If the integrator belongs to a Simulation already, or there are no topology and positions.
        ParameterError
            If there is no such platform, or it does not know a property.
        """
        if self.topology is None or self.positions is None:
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

    def view(self, **choices):
        """A widget of nglview for a notebook: :func:`openmm_dpd.io.view.view`, with its ``state`` and ``radii``."""
        return view(self, **choices)

    def _new_simulation(self, platform: openmm.Platform | str | None, properties: dict[str, str] | None) -> app.Simulation:
        name = platform if platform is not None else self.plan.platform or fastest_platform()
        try:
            chosen = openmm.Platform.getPlatformByName(name) if isinstance(name, str) else name
            return DPDSimulation(self.plan, self.topology, self.system, self.integrator, chosen, properties)
        except openmm.OpenMMException as error:
            if "same name as a Context parameter" in str(error):
                name = str(error).rpartition(":")[2].strip()
                raise PlanError(f"a force has a global parameter called {name}, which is a variable of the integrator; rename it") from None
            if "already bound" in str(error):
                again = "this scene" if self.plan.host is None else "this System"
                raise PlanError(f"{again} has a Simulation already; build it again for another one") from None
            raise ParameterError(f"no Simulation on platform {what_is(name)} with properties {what_is(properties)}: {error}") from None
