"""Steps with an eye on the Context they run in: which forces act in it, who wrote its state, and what a failed step left.

OpenMM integrates whatever is in the System when the Context is made.  The programs of this package have to know a little more: which
forces are theirs, and whether there are others.  So :meth:`Watching.step` looks at the System that the Context really has, whoever made it
and whenever a force came in, before it steps.

An integrator that was read from XML is a plain ``openmm.CustomIntegrator``, and one inside an ``openmm.CompoundIntegrator`` is not asked
to look: their steps are right beside any force, but nobody checks the System, compares the temperature of a state with that of the
script, or takes a failed step back.
"""

import gc
import logging
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property

import openmm

from .barostat_temperature import active_barostats, check_barostats
from .errors import PlanError, RunError
from .made import Made, acting, text_number, variables_number
from .names import BEGUN, BESIDE, BY_KT, BY_SCHEME, BY_SEED, BY_VARIABLES, PAIR_FORCE, SEED

_LOGGER = logging.getLogger("openmm_dpd")

#: Steps after which what has been reached is remembered.  Simulation.step() asks for no more than that at once.
PIECE = 10

#: What a Ctrl-C leaves behind that comes inside a force of this package: OpenMM makes an error without a text of it.
interrupts = threading.local()


@contextmanager
def reported() -> Iterator[None]:
    """Make the error of a step what it is if OpenMM reports it."""
    try:
        yield
    except RunError as error:
        raise openmm.OpenMMException(str(error)) from error


class Watching:
    """What both integrators do around OpenMM's own ``step``; instances read from XML or a pickle have ``made`` None and only step."""

    made: Made | None = None
    _known: weakref.ref | None = None
    _looked_at: tuple = ()
    _beside = 0.0
    _mixed = False
    _slow = True
    _barostats = True
    _volumes = False
    _piece = PIECE
    _begun = False

    def context(self) -> openmm.Context | None:
        """The Context that this integrator belongs to, None before there is one.

        OpenMM has no way from an integrator to its Context, but the Context refers to its integrator, and Python knows who does.
        """
        found = None if self._known is None else self._known()
        if found is None or found.getIntegrator() is not self:
            holders = gc.get_referrers(self)
            owners = [*holders, *(owner for holder in holders if isinstance(holder, dict) for owner in gc.get_referrers(holder))]
            found = next((owner for owner in owners if isinstance(owner, openmm.Context) and owner.getIntegrator() is self), None)
            self._known, self._looked_at, self._mixed = None if found is None else weakref.ref(found), (), False
        return found

    def bind(self, context: openmm.Context) -> None:
        """Say which Context this integrator belongs to, for those who know."""
        self._known, self._looked_at, self._mixed = weakref.ref(context), (), False

    def step(self, steps: int) -> None:
        """Take steps; one that fails leaves everything as it was after the last :data:`PIECE` steps that did not.

        Raises
        ------
        PlanError
            If something in the Context's System would not act, or its state was written by another scheme.
        openmm.OpenMMException
            If a step fails, with the reason.
        """
        context = None if self.made is None else self.context()
        if context is None:
            super().step(steps)  # type: ignore[misc]
            return
        self._look(context)
        while steps > 0:
            piece = min(steps, self._piece)
            self._take(context, piece)
            steps -= piece

    def _take(self, context: openmm.Context, steps: int) -> None:
        """Take a few steps, or none of them if one fails."""
        with self._or_back(context):
            super().step(steps)  # type: ignore[misc]

    @contextmanager
    def _or_back(self, context: openmm.Context) -> Iterator[None]:
        before = context.createCheckpoint()
        interrupts.seen = False
        try:
            with reported():
                yield
        except BaseException as error:
            context.loadCheckpoint(before)
            if interrupts.seen and isinstance(error, openmm.OpenMMException):
                raise KeyboardInterrupt from None
            raise

    def _look(self, context: openmm.Context) -> None:
        """See whether the System has changed, and where the state comes from."""
        system = context.getSystem()
        forces = tuple((type(force), force.getName(), force.getForceGroup()) for force in system.getForces())
        now = (system.getNumParticles(), system.getNumConstraints(), forces)
        if now != self._looked_at:
            assert self.made is not None
            others = acting(self.made.check(system))
            self._beside = text_number(" ".join(f"{type(force).__name__} {force.getName()} {force.getForceGroup()}" for force in others))
            if "dt" in context.getParameters():
                raise PlanError("a force has a global parameter called dt, which is the step size in a CustomIntegrator; rename it")
            # a force taken from the System acts in this Context still
            self._mixed = self._mixed or bool(others)
            self._slow = self._mixed or self._slow_own()
            often = [force.getFrequency() for force in active_barostats(system)]
            self._volumes, self._barostats = bool(often), self._mixed or bool(often)
            self._piece = min([PIECE, *often])
            self._looked_at = now
        self.settle(context)
        if BESIDE in context.getParameters() and context.getParameter(BESIDE) != self._beside:
            context.setParameter(BESIDE, self._beside)
        kelvin = self._kelvin(context) if self._volumes else None
        if kelvin is not None:
            assert self.made is not None
            check_barostats(context, kelvin, self.made.asked < 0)

    def _kelvin(self, context: openmm.Context) -> float | None:
        """The temperature that the thermostat of a Context has now; None if nothing has one."""
        raise NotImplementedError

    def _slow_own(self) -> bool:
        """Whether forces of the package itself act beside the pair force."""
        assert self.made is not None
        groups = self.getIntegrationForceGroups()  # type: ignore[attr-defined]
        return any(name != PAIR_FORCE and groups >> group & 1 for name, group in self.made.own)

    def settle(self, context: openmm.Context) -> None:
        """Begin a new Context, and let what this script asked for hold where another one wrote the state.

        Raises
        ------
        PlanError
            If it was written by another scheme, or by an integrator with other variables.
        """
        made, parameters = self.made, context.getParameters()
        if made is None or BY_SCHEME not in parameters:
            return
        if parameters[BEGUN] == 0.0:
            context.setParameter(BEGUN, 1.0)
            self._begin(context)
            self._begun = True
        made.check_writer(parameters)
        if parameters[BY_VARIABLES] != self._variables_number:
            raise PlanError(
                "the state was written by an integrator of this scheme with other variables (on another platform, or with a temperature "
                "ramp, say), and a checkpoint cannot go from one to the other; save and load an XML state instead, by "
                "loadState of what simulation() of this package returned"
            )
        if parameters[BY_KT] != made.asked:
            now = f"the {made.kT:g} kJ/mol" if made.asked >= 0 else "the ramp"
            _LOGGER.warning("the state was written by a run that asked for another temperature; it goes on with %s of this script", now)
            self._take_kT(context, made.kT)
            context.setParameter(BY_KT, made.asked)
            for barostat in active_barostats(context.getSystem()):
                context.setParameter(barostat.Temperature(), barostat.getDefaultTemperature())
        if made.seed is not None and parameters[BY_SEED] != made.seed:
            self._take_seed(context, made.seed)

    def _begin(self, context: openmm.Context) -> None:
        """What has to be so before the first step of a Context."""
        self._mixed = bool(self._beside)

    def _take_seed(self, context: openmm.Context, seed: int) -> None:
        if SEED in context.getParameters():
            context.setParameter(SEED, seed)
        context.setParameter(BY_SEED, seed)

    @cached_property
    def _variables_number(self) -> float:
        return variables_number(self)  # type: ignore[arg-type]

    def _take_kT(self, context: openmm.Context, kT: float) -> None:
        """Go on at another thermal energy."""
