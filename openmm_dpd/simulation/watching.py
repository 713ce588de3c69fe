"""What integrators check before they step: which forces act in the Context, who wrote its state, and how a failed step is taken back.

OpenMM integrates all forces that the System has when the Context is made.  The programs of this package have to know which forces are
theirs and whether there are others, so :meth:`Watching.step` inspects the System of the Context before it steps, no matter who made the
System or when a force was added.

An integrator that was read from XML is a plain ``openmm.CustomIntegrator``, and the step method of one inside an
``openmm.CompoundIntegrator`` is not called.  Their steps are correct beside any force, but nothing checks the System, compares the
temperature of a state with that of the script, or takes a failed step back.
"""

import logging
import os
import re
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property, lru_cache, wraps
from typing import Any

import numpy as np
import openmm

from ..base import names as shared
from ..base.errors import PlanError, RunError, bead_number
from ..base.names import ALL_TAKEN, BEGUN, BESIDE, BY_KT, BY_SCHEME, BY_SEED, BY_VARIABLES, PAIR_FORCE, ROOM, SEED, SHEARED, SHOWN, VOLATILE
from ..base.openmm_private import bare, hear_calls, vectors
from ..base.signals import CTRL_C, unbroken
from ..base.units import whole_steps
from ..plan.made import Made, acting, lines_of, text_number, variables_number, wrong_key
from .barostat_temperature import barostats, check_barostats, tell_pressures
from .fields import swap_kept

_LOGGER = logging.getLogger("openmm_dpd")
#: Steps after which the state is remembered, to come back to if a later step fails; OpenMM's Simulation.step() asks for this many at once.
PIECE = 10
#: Seconds after which the state is remembered where only the loop of whole steps acts, and the largest number of steps.
STRAIGHT, MOST = 1.0, 10_000

#: Why nothing may be added to a System with a shear.
BESIDE_SHEAR = "beside Lees-Edwards shear no force of OpenMM's own can act, for it does not know the sliding images; remove added forces"
#: Seconds after which the state is remembered on a device, and how often steps are tried that run out of room there.
REMEMBERED, MOST_TRIES = 10.0, 4


def _box(context: openmm.Context) -> list:
    """Box vectors of a Context; to read them needs no device."""
    return bare(openmm.Context.getState(context).getPeriodicBoxVectors())


@lru_cache
def watched(kind: type) -> type:
    """A subclass of a class of Contexts that tells the integrator when a Context is reinitialized, changed or read: OpenMM does not."""

    def reinitialize(self, preserveState=False):
        if preserveState:
            self.getIntegrator().verify(self)
        kind.reinitialize(self, preserveState)  # type: ignore[attr-defined]
        self.getIntegrator().bind(self)

    reinitialize.__doc__ = "Reinitialize the Context; the next step inspects the System again."
    methods: dict[str, Any] = {"reinitialize": reinitialize, "watched": True, "__module__": kind.__module__}
    for names, hear in ((_CHANGING, "changed"), (_LOOKING, "looked")):
        methods |= {name: _heard(kind, name, hear) for name in names}
    return type(kind.__name__, (kind,), methods)


#: Methods of a Context that change its state, and that read it.
_CHANGING = "setPositions setVelocities setVelocitiesToTemperature setPeriodicBoxVectors setParameter setState loadCheckpoint".split()
_LOOKING = ("getState", "createCheckpoint")
#: Parameters of ``getState`` for which OpenMM computes forces.
_FORCES = "forces energy parameterDerivatives getForces getEnergy getParameterDerivatives".split()


def _heard(kind: type, name: str, hear: str) -> Callable:
    """A method of a class of Contexts that tells the integrator before it is carried out."""

    @wraps(getattr(kind, name))
    def heard(self, *arguments, **more):
        listener = getattr(self.getIntegrator(), hear, None)
        if listener is not None and hear == "looked":
            listener(self, name == "getState" and (len(arguments) > 2 or any(more.get(word) for word in _FORCES)))
        elif listener is not None and (name != "setParameter" or len(arguments) != 2):
            listener(self)
        elif listener is not None and arguments[0] not in VOLATILE and arguments[1] != self.getParameters().asdict().get(arguments[0]):
            listener(self, str(arguments[0]).startswith(shared.OWN))
        try:
            return getattr(kind, name)(self, *arguments, **more)
        except openmm.OpenMMException as error:
            lacking = re.search(r"invalid parameter name: (dpd_\w+)", str(error))
            if lacking is None:
                raise
            left_out = "bonds that form or what beads carry; here none do: use simulation.loadState"
            of = left_out if lacking[1] in (SHOWN, shared.WRITTEN, shared.BY_FIELDS) else "another kind of scene"
            raise PlanError(f"that state has the parameter {lacking[1]} of {of}") from error

    return heard


class Watching:
    """What the integrators of this package do around OpenMM's ``step``.  Those read from XML or a pickle, without ``made``, only step."""

    made: Made | None = None
    #: Does many whole steps at once; None where OpenMM carries out the program step by step.
    whole: Any = None
    #: Group of a pair force on a device, whose kernels stop after an error, but report it only when they are asked for an energy.
    device_group: int | None = None
    #: Whether context parameters have what walls take up of momentum on a device.
    pushed: bool = False
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

    @property
    def beside(self) -> bool:
        """Whether forces of OpenMM kick, or barostats act, between the kernel's steps."""
        return self._slow or self._barostats

    def context(self) -> openmm.Context | None:
        """The Context that this integrator belongs to, None before there is one."""
        found = None if self._known is None else self._known()
        return None if found is None or found.getIntegrator() is not self else found  # a copy knows the Context of the original

    def bind(self, context: openmm.Context) -> None:
        """Called when the Context of this integrator was made or reinitialized: the next step inspects everything in it."""
        if not hasattr(context, "watched"):
            context.__class__ = watched(type(context))  # type: ignore[arg-type]
        self._process, self._known, self._looked_at, self._remembered, self._unverified = os.getpid(), weakref.ref(context), (), None, False
        self._taken = 0
        self._groups = self.getIntegrationForceGroups()  # type: ignore[attr-defined]

    @unbroken()
    def step(self, steps: int) -> None:
        """Take steps.  After one that fails the state is that of at most :data:`PIECE` steps before, or of about a second before where only
        the loop of whole steps acts.

        PlanError if something in the Context's System would not act, or its state was written by another scheme.  openmm.OpenMMException
        if a step fails, with the reason.  KeyboardInterrupt after Ctrl-C, which waits for the end of a step."""
        context, steps = None if self.made is None else self.context(), whole_steps(steps)
        if context is None:
            super().step(steps)  # type: ignore[misc]
            return
        self.look_at(context)
        while steps > 0:
            CTRL_C.check()
            piece = min(steps, self._piece() if self.whole is None or self.beside else self.straight)
            self._take(context, piece)
            steps -= piece
            self._taken += piece

    def _piece(self) -> int:
        """Steps to the next move of a barostat, which counts them from where its Context was made; at most :data:`PIECE`."""
        return min([PIECE, *(every - self._taken % every for every in self._intervals)])

    def _take(self, context: openmm.Context, steps: int) -> None:
        """Take a few steps; if one fails, none of them."""
        if self.device_group is not None:
            self._on_device(context, context.getStepCount() + steps)
            return
        with self._or_back(context):
            super().step(steps)  # type: ignore[misc]
            if context.getPlatform().getName() == "Reference":  # the other platforms check this themselves
                x = vectors(context.getState(positions=True), openmm.State.Positions)
                for bead in np.flatnonzero(~np.isfinite(x).all(axis=1))[:1]:
                    raise openmm.OpenMMException(f"by step {context.getStepCount()} the position of bead {bead_number(bead)} is not finite")

    def _on_device(self, context: openmm.Context, last: int, failed: int = 0) -> None:
        """Step up to the step number ``last``; if a device runs out of room, which may have ``failed`` before, again from the remembered
        state, and ask it then."""
        self._before(context)
        for again in range(failed, MOST_TRIES):
            try:
                with self._or_back(context):
                    self._step_beside_barostats(context, last - context.getStepCount())
                    if self.pushed and self.device_group is not None:
                        swap_kept(context, self.device_group, ALL_TAKEN)
                    if again:
                        self._ask(context)
                    self._unverified = not again
                break
            except openmm.OpenMMException as error:
                if again == MOST_TRIES - 1 or ROOM not in str(error):
                    raise

    def _step_beside_barostats(self, context: openmm.Context, steps: int) -> None:
        """Take steps on a device.  If a barostat changes the box behind the last one, the acceleration is not valid any more."""
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
            self._remembered = kept  # the state is that of this checkpoint now
            raise

    def _before(self, context: openmm.Context) -> bytes:
        """A checkpoint to go back to: of now, or of the last seconds on a device, where one takes as long as many steps."""
        now = time.monotonic()
        if self._remembered is not None and now - self._remembered[0] < REMEMBERED:
            return self._remembered[1]
        before = context.createCheckpoint()
        self._remembered = None if self.device_group is None else (now, before)
        return before

    def changed(self, context: openmm.Context, ours: bool = True) -> None:
        """Called before the state of the Context is changed from outside; not ``ours``: a parameter of forces of others."""
        self.verify(context)
        self._remembered = None

    def parameters_changed(self, context: openmm.Context) -> None:
        """Called after a force of the Context got new parameters, on which the acceleration that a program keeps depends."""
        if self.whole is None and self.device_group is None:
            self._forget_acceleration()

    def looked(self, context: openmm.Context, forces: bool) -> None:
        """Called before the state of the Context is read; ``forces``: forces or energies are computed for that."""
        self._at_home(context, forces)
        self.verify(context)

    def _at_home(self, context: openmm.Context, forces: bool) -> None:
        """Raise RunError in a process forked from that of the Context, if OpenMM would wait for threads that exist only there."""
        platform = context.getPlatform().getName() if self._process != os.getpid() else "Reference"
        if platform not in ("Reference", "" if forces else "CPU"):
            raise RunError(
                f"this Context on the platform {platform} was made in another process, which this one was forked from without OpenMM's "
                "threads: make a Simulation in the process that uses it"
            )

    def verify(self, context: openmm.Context) -> None:
        """Ask a device whether the steps since the last call have succeeded; if not, go back to the remembered state.

        Raises
        ------
        openmm.OpenMMException
            If a step has failed, with the reason.
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
                self._on_device(context, last, failed=1)

    def _ask(self, context: openmm.Context) -> None:
        context.getState(energy=True, groups={self.device_group})

    def look_at(self, context: openmm.Context) -> None:
        """Find out what has changed since the last call of ``step``: the Context, its System, its groups, its barostats, its state."""
        system, groups = context.getSystem(), self.getIntegrationForceGroups()  # type: ignore[attr-defined]
        now = (system.getNumParticles(), system.getNumForces(), groups)
        if now != self._looked_at:
            self._look_at_everything(context, groups)
            self._looked_at = now
        moving = [barostat for barostat in barostats(context) if barostat.getFrequency() > 0] if self._has_barostats else []
        self._barostats = self._mixed or bool(moving)
        self._intervals = [barostat.getFrequency() for barostat in moving]
        self._at_home(context, self.whole is None or self.beside)
        self.settle(context)
        assert self.made is not None
        if self.made.edges:
            self.made.check_box(np.array(_box(context)))
        parameters = context.getParameters()
        if (wrong := wrong_key(parameters)) is not None:
            raise openmm.OpenMMException(wrong)
        if BESIDE in parameters and parameters[BESIDE] != self._beside:
            context.setParameter(BESIDE, self._beside)
        if moving:
            check_barostats(context, moving, self._kelvin(context), self.made)

    def _look_at_everything(self, context: openmm.Context, groups: int) -> None:
        """Check the System of a Context, and find out which forces act in it."""
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
            self.whole = None  # lines were added to the program, so it has to do the steps
        if "dt" in context.getParameters():
            raise PlanError("a force has a global parameter called dt, which is the step size in a CustomIntegrator; rename it")
        self._beside = text_number(" ".join(f"{type(force).__name__} {force.getName()} {force.getForceGroup()}" for force in others))
        self._has_barostats = bool(barostats(context))
        # a force that was removed from the System acts until the Context is reinitialized
        self._mixed = bool(others) or (self._mixed and not new)
        if self._mixed and self.device_group is not None and SHEARED in context.getParameters():
            raise PlanError(BESIDE_SHEAR)
        self._slow = self._mixed or any(name != PAIR_FORCE and groups >> group & 1 for name, group in made.own)
        if new:
            tell_pressures(context, made)

    def _kelvin(self, context: openmm.Context) -> float | None:
        """The temperature that the thermostat of a Context has now; None if nothing has one."""
        raise NotImplementedError

    def settle(self, context: openmm.Context) -> None:
        """Begin a new Context; in a state that another script wrote, restore temperature and seed of this one.  PlanError if the state was
        written by another scheme, or by an integrator with other variables."""
        made, parameters = self.made, context.getParameters()
        if made is None or BY_SCHEME not in parameters:
            return
        if parameters[BEGUN] == 0.0:
            self._begin(context)
            self._begun = True
            context.setParameter(BEGUN, 1.0)  # last, so that it is begun again after an error
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
        if shared.BY_FORCES in parameters and parameters[shared.BY_FORCES] != made.forces:
            self._forget_acceleration()
            context.setParameter(shared.BY_FORCES, made.forces)
        if made.seed is not None and parameters[BY_SEED] != made.seed:
            self._take_seed(context, made.seed)

    def _begin(self, context: openmm.Context) -> None:
        """Prepare the first step of a Context."""

    def _take_seed(self, context: openmm.Context, seed: int) -> None:
        if SEED in context.getParameters():
            context.setParameter(SEED, seed)
        context.setParameter(BY_SEED, seed)

    @cached_property
    def _variables_number(self) -> float:
        return variables_number(self)  # type: ignore[arg-type]

    def _take_kT(self, context: openmm.Context, kT: float) -> None:
        """Set the thermal energy (kJ/mol) of the thermostat."""


def _tell(method: str) -> Callable[[openmm.Context], None]:
    """A function of a Context that calls a method of its integrator, if that is one of this package.  It keeps no Context alive.  No such
    integrator, and so no Context of one, exists before this module is imported."""

    def tell(context: openmm.Context) -> None:
        integrator = openmm.Context.getIntegrator(context)
        if isinstance(integrator, Watching):
            getattr(integrator, method)(context)

    return tell


hear_calls(openmm.Context, "__init__", _tell("bind"))
for kind in vars(openmm).values():
    if isinstance(kind, type) and "updateParametersInContext" in vars(kind):
        hear_calls(kind, "updateParametersInContext", _tell("parameters_changed"))
