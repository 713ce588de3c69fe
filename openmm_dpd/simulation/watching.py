"""Steps with an eye on the Context they run in: which forces act in it, who wrote its state, and what a failed step left.

OpenMM integrates all forces of the System when the Context is made.  The programs of this package have to know a little more: which
forces are theirs, and whether there are others.  So :meth:`Watching.step` looks at the System that the Context really has, whoever made it
and whenever a force came in, before it steps.

An integrator that was read from XML is a plain ``openmm.CustomIntegrator``, and one inside an ``openmm.CompoundIntegrator`` is not asked
to look: their steps are right beside any force, but nobody checks the System, compares the temperature of a state with that of the
script, or takes a failed step back.
"""

import logging
import os
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property, lru_cache, wraps
from typing import Any

import numpy as np
import openmm

from ..base.errors import PlanError, RunError, bead_number, what_is
from ..base.names import BEGUN, BESIDE, BY_KT, BY_SCHEME, BY_SEED, BY_VARIABLES, PAIR_FORCE, ROOM, SEED, VOLATILE
from ..base.openmm_private import bare, hear_calls, vectors
from ..base.signals import CTRL_C, unbroken
from ..plan.made import Made, acting, lines_of, text_number, variables_number, wrong_key
from .barostat_temperature import barostats, check_barostats, tell_pressures

_LOGGER = logging.getLogger("openmm_dpd")
#: Steps after which what has been reached is remembered.  OpenMM's Simulation.step() asks for no more than that at once.
PIECE = 10
#: The same where nothing but the loop of whole steps acts: as many as it does in so many seconds, and no more than that.
STRAIGHT, MOST = 1.0, 10_000

#: Seconds after which it is on a device.
REMEMBERED = 10.0


def whole_steps(steps) -> int:
    """A number of steps of any type, as OpenMM takes them; TypeError if it is not whole."""
    if int(steps) != steps:
        raise TypeError(f"the number of steps must be a whole one, not {what_is(steps)}")
    return int(steps)


def _box(context: openmm.Context) -> list:
    """Vectors of the box of a Context, which the host knows."""
    return bare(openmm.Context.getState(context).getPeriodicBoxVectors())


@lru_cache
def watched(kind: type) -> type:
    """A class of Contexts, ``openmm.Context`` or somebody's own, whose integrator hears when one is made anew, changed, or looked at.
    OpenMM leaves no sign of that: its checkpoint brings everything back."""

    def reinitialize(self, preserveState=False):
        if preserveState:
            self.getIntegrator().verify(self)
        kind.reinitialize(self, preserveState)  # type: ignore[attr-defined]
        self.getIntegrator().bind(self)

    reinitialize.__doc__ = "As before; the next step looks at the System again."
    methods: dict[str, Any] = {"reinitialize": reinitialize, "watched": True, "__module__": kind.__module__}
    for names, hear in ((_CHANGING, "changed"), (_LOOKING, "looked")):
        methods |= {name: _heard(kind, name, hear) for name in names}
    return type(kind.__name__, (kind,), methods)


#: Methods of a Context that change its state, and that read it.
_CHANGING = "setPositions setVelocities setVelocitiesToTemperature setPeriodicBoxVectors setParameter setState loadCheckpoint".split()
_LOOKING = ("getState", "createCheckpoint")
#: What may be asked of a State for which forces are computed.
_FORCES = "forces energy parameterDerivatives getForces getEnergy getParameterDerivatives".split()


def _heard(kind: type, name: str, hear: str) -> Callable:
    """A method of a class of Contexts that its integrator hears of before."""

    @wraps(getattr(kind, name))
    def heard(self, *arguments, **more):
        listener = getattr(self.getIntegrator(), hear, None)
        if listener is not None and hear == "looked":
            listener(self, name == "getState" and (len(arguments) > 2 or any(more.get(word) for word in _FORCES)))
        elif listener is not None and not (name == "setParameter" and arguments and arguments[0] in VOLATILE):
            listener(self)
        return getattr(kind, name)(self, *arguments, **more)

    return heard


class Watching:
    """What both integrators do around OpenMM's own ``step``; instances read from XML or a pickle have ``made`` None and only step."""

    made: Made | None = None
    #: What carries out many steps at once; None where OpenMM does them one by one.
    whole: Any = None
    #: Group of a pair force on a device, whose kernels stop where anything is wrong, but say so only when they are asked.
    device_group: int | None = None
    #: The callable of a pair force whose energy depends on per-bead fields, which OpenMM does not hand to forces.
    shown_to: Any = None
    _remembered: tuple[float, bytes] | None = None
    _unverified = False
    _known: weakref.ref | None = None
    _process = 0
    _looked_at: tuple = ()
    _groups = 0
    _beside = 0.0
    _mixed = False
    _slow = True
    _barostats = _has_barostats = True
    straight = PIECE
    _intervals: Sequence[int] = ()
    _taken = 0
    _begun = False

    def context(self) -> openmm.Context | None:
        """The Context that this integrator belongs to, None before there is one."""
        found = None if self._known is None else self._known()
        return None if found is None or found.getIntegrator() is not self else found  # a copy knows the Context of the original

    def bind(self, context: openmm.Context) -> None:
        """Hear which Context this integrator belongs to, or that it was made anew: the next step looks at everything in it."""
        if not hasattr(context, "watched"):
            context.__class__ = watched(type(context))  # type: ignore[arg-type]
        self._process, self._known, self._looked_at, self._remembered, self._unverified = os.getpid(), weakref.ref(context), (), None, False
        self._taken = 0
        self._groups = self.getIntegrationForceGroups()  # type: ignore[attr-defined]

    @unbroken()
    def step(self, steps: int) -> None:
        """Take steps; one that fails leaves everything as it was after the last :data:`PIECE` steps that did not, or as it was a second
        before where nothing but the loop of whole steps acts.  PlanError if something
        in the Context's System would not act, or its state was written by another scheme. openmm.OpenMMException if a step fails, with the
        reason. KeyboardInterrupt: After Ctrl-C, which waits for the end of a step."""
        context, steps = None if self.made is None else self.context(), whole_steps(steps)
        if context is None:
            super().step(steps)  # type: ignore[misc]
            return
        self._look(context)
        while steps > 0:
            CTRL_C.check()
            piece = min(steps, self._piece() if self.whole is None or self._slow or self._barostats else self.straight)
            self._take(context, piece)
            steps -= piece
            self._taken += piece

    def _piece(self) -> int:
        """Steps to the next move of a barostat, which counts from where its Context was made; a few at most."""
        return min([PIECE, *(every - self._taken % every for every in self._intervals)])

    def _take(self, context: openmm.Context, steps: int) -> None:
        """Take a few steps, or none of them if one fails."""
        if self.device_group is not None:
            self._on_device(context, context.getStepCount() + steps)
            return
        with self._or_back(context):
            super().step(steps)  # type: ignore[misc]
            if context.getPlatform().getName() == "Reference":  # all others look by themselves
                x = vectors(context.getState(positions=True), openmm.State.Positions)
                for bead in np.flatnonzero(~np.isfinite(x).all(axis=1))[:1]:
                    raise openmm.OpenMMException(f"by step {context.getStepCount()} the position of bead {bead_number(bead)} is not finite")

    def _on_device(self, context: openmm.Context, last: int) -> None:
        """Step up to the step number ``last``; where a device had too little room, once more from the state that is remembered."""
        self._before(context)
        for again in (False, True):
            try:
                with self._or_back(context):
                    self._step_beside_barostats(context, last - context.getStepCount())
                    if again:
                        self._ask(context)
                    self._unverified = not again
                break
            except openmm.OpenMMException as error:
                if again or ROOM not in str(error):
                    raise

    def _step_beside_barostats(self, context: openmm.Context, steps: int) -> None:
        """Take steps on a device.  A barostat acts behind the last one, whose acceleration is not that of the box that it makes."""
        self._announce(steps)
        if not self._has_barostats:
            super().step(steps)  # type: ignore[misc]
            return
        super().step(steps - 1)  # type: ignore[misc]
        box = _box(context)
        super().step(1)  # type: ignore[misc]
        if _box(context) != box:
            self._forget_acceleration()

    def _announce(self, steps: int) -> None:
        """Tell a program how many steps follow."""

    def _forget_acceleration(self) -> None:
        """Tell a program that the acceleration that it has kept is not valid."""

    @contextmanager
    def _or_back(self, context: openmm.Context) -> Iterator[None]:
        before = self._before(context)
        try:
            yield
        except BaseException:
            self._unverified = False
            kept = self._remembered
            context.loadCheckpoint(before)
            self._remembered = kept  # it is the state of now
            raise

    def _before(self, context: openmm.Context) -> bytes:
        """A checkpoint to go back to: the present one, or on a device, where it costs as much as many steps, one of the last seconds."""
        now = time.monotonic()
        if self._remembered is not None and now - self._remembered[0] < REMEMBERED:
            return self._remembered[1]
        before = context.createCheckpoint()
        self._remembered = None if self.device_group is None else (now, before)
        return before

    def changed(self, context: openmm.Context) -> None:
        """Hear that somebody changes the state of the Context."""
        self.verify(context)
        self._remembered = None

    def parameters_changed(self, context: openmm.Context) -> None:
        """Hear that a force took over parameters of its terms: it is part of the acceleration that a program of the host keeps."""
        if self.whole is None and self.device_group is None:
            self._forget_acceleration()

    def looked(self, context: openmm.Context, forces: bool) -> None:
        """Hear that somebody looks at the state of the Context, and whether at forces or energies."""
        self._at_home(context, forces)
        self.verify(context)

    def _at_home(self, context: openmm.Context, forces: bool) -> None:
        """RunError in a process forked from that of the Context, where a call of OpenMM, for forces or not, would wait for its threads."""
        platform = context.getPlatform().getName() if self._process != os.getpid() else "Reference"
        if platform not in ("Reference", "" if forces else "CPU"):
            raise RunError(
                f"this Context on the platform {platform} was made in another process, which this one was forked from without OpenMM's "
                "threads: make a Simulation in the process that uses it"
            )

    def verify(self, context: openmm.Context) -> None:
        """Ask a device whether the steps since the last time went well; if not, all is as it was when it was remembered.

        Raises
        ------
        openmm.OpenMMException
            If they did not, with the reason.
        """
        if self._unverified:
            self._unverified = False
            last = context.getStepCount()
            try:
                with self._or_back(context):
                    self._ask(context)
            except openmm.OpenMMException as error:
                if ROOM not in str(error):
                    raise
                self._on_device(context, last)
                self._unverified = False

    def _ask(self, context: openmm.Context) -> None:
        context.getState(energy=True, groups={self.device_group})

    def _look(self, context: openmm.Context) -> None:
        """See whether something has changed that acts at once in OpenMM, or the Context is new, and where the state comes from."""
        system = context.getSystem()
        groups = self.getIntegrationForceGroups()  # type: ignore[attr-defined]
        now = (system.getNumParticles(), system.getNumForces(), groups)
        if now != self._looked_at:
            self._look_at_everything(context, groups)
            self._looked_at = now
        moving = [barostat for barostat in barostats(context) if barostat.getFrequency() > 0] if self._has_barostats else []
        self._barostats = self._mixed or bool(moving)
        self._intervals = [barostat.getFrequency() for barostat in moving]
        self._at_home(context, self.whole is None or self._slow or self._barostats)
        self.settle(context)
        parameters = context.getParameters()
        wrong = wrong_key(parameters)
        if wrong is not None:
            raise openmm.OpenMMException(wrong)
        if BESIDE in parameters and parameters[BESIDE] != self._beside:
            context.setParameter(BESIDE, self._beside)
        assert self.made is not None
        if moving:
            check_barostats(context, moving, self._kelvin(context), self.made)

    def _look_at_everything(self, context: openmm.Context, groups: int) -> None:
        """Check the System of a Context, and what acts in it."""
        made, system, new = self.made, context.getSystem(), not self._looked_at
        assert made is not None
        others = acting(made.check(system))
        made.check_groups(groups)
        if groups != self._groups and self.whole is None and isinstance(self, openmm.CustomIntegrator):
            raise PlanError(
                "setIntegrationForceGroups came after the Context was made, and a program of OpenMM's CustomIntegrator keeps the groups of "
                "before; call context.reinitialize(preserveState=True) after it"
            )
        if lines_of(self) != made.lines:  # type: ignore[arg-type]
            self.whole = None  # somebody added to the program, so that it has to do the steps
        if "dt" in context.getParameters():
            raise PlanError("a force has a global parameter called dt, which is the step size in a CustomIntegrator; rename it")
        self._beside = text_number(" ".join(f"{type(force).__name__} {force.getName()} {force.getForceGroup()}" for force in others))
        self._has_barostats = bool(barostats(context))
        # a force taken from the System acts until the Context is made anew
        self._mixed = bool(others) or (self._mixed and not new)
        self._slow = self._mixed or any(name != PAIR_FORCE and groups >> group & 1 for name, group in made.own)
        if new:
            tell_pressures(context, made)

    def _kelvin(self, context: openmm.Context) -> float | None:
        """The temperature that the thermostat of a Context has now; None if nothing has one."""
        raise NotImplementedError

    def settle(self, context: openmm.Context) -> None:
        """Begin a new Context, and let what this script asked for hold where another one wrote the state.  PlanError if it was written by
        another scheme, or by an integrator with other variables."""
        made, parameters = self.made, context.getParameters()
        if made is None or BY_SCHEME not in parameters:
            return
        if parameters[BEGUN] == 0.0:
            self._begin(context)
            self._begun = True
            context.setParameter(BEGUN, 1.0)  # last: what an error cuts short is begun anew
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
            for barostat in barostats(context):
                context.setParameter(barostat.Temperature(), barostat.getDefaultTemperature())
        if made.seed is not None and parameters[BY_SEED] != made.seed:
            self._take_seed(context, made.seed)

    def _begin(self, context: openmm.Context) -> None:
        """What has to be so before the first step of a Context."""

    def _take_seed(self, context: openmm.Context, seed: int) -> None:
        if SEED in context.getParameters():
            context.setParameter(SEED, seed)
        context.setParameter(BY_SEED, seed)

    @cached_property
    def _variables_number(self) -> float:
        return variables_number(self)  # type: ignore[arg-type]

    def _take_kT(self, context: openmm.Context, kT: float) -> None:
        """Go on at another thermal energy."""


def _tell(method: str) -> Callable[[openmm.Context], None]:
    """Have a method of integrators of this package called with their Context.  No Context can have been made before this is imported: there
    is no such integrator yet.  It keeps none alive."""

    def tell(context: openmm.Context) -> None:
        integrator = openmm.Context.getIntegrator(context)
        if isinstance(integrator, Watching):
            getattr(integrator, method)(context)

    return tell


hear_calls(openmm.Context, "__init__", _tell("bind"))
for kind in vars(openmm).values():
    if isinstance(kind, type) and "updateParametersInContext" in vars(kind):
        hear_calls(kind, "updateParametersInContext", _tell("parameters_changed"))
