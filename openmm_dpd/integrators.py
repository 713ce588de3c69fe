"""OpenMM's integrators, with an eye on the Context they run: which forces act in it, who wrote its state, and what a failed step left.

OpenMM integrates whatever is in the System when the Context is made.  The programs of this package have to know a little more: which
forces are theirs, and whether there are others.  So :meth:`step` looks at the System that the Context really has, whoever made it and
whenever a force came in, before it steps.

An integrator that was read from XML is a plain ``openmm.CustomIntegrator``, and one inside an ``openmm.CompoundIntegrator`` is not asked
to look: their steps are right beside any force, but nobody checks the System, compares the temperature of a state with that of the
script, or takes a failed step back.
"""

from __future__ import annotations

import gc
import logging
import secrets
import threading
import weakref
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol
from zlib import crc32

import numpy as np
import openmm
from openmm import unit

from .errors import ParameterError, PlanError, RunError
from .names import (
    BEGUN,
    BESIDE,
    BY_KT,
    BY_SCHEME,
    BY_SEED,
    BY_VARIABLES,
    KT,
    PAIR_FORCE,
    RAMP_STEP,
    SEED,
    SEEN_KT,
    SEEN_TEMPERATURE,
    SLOW_STEP,
    STAMP,
    TEMPERATURE,
)
from .units import BOLTZMANN, to_md

if TYPE_CHECKING:
    from .program_options import ProgramOptions

_LOGGER = logging.getLogger("openmm_dpd")

#: Steps after which what has been reached is remembered.  Simulation.step() asks for no more than that at once.
PIECE = 10

#: What a Ctrl-C leaves behind that comes inside a force of this package: OpenMM makes an error without a text of it.
interrupts = threading.local()

#: Forces that change the box now and then, and exert no force.
BAROSTATS = (
    openmm.MonteCarloBarostat,
    openmm.MonteCarloAnisotropicBarostat,
    openmm.MonteCarloFlexibleBarostat,
    openmm.MonteCarloMembraneBarostat,
)


def _number(text: str) -> float:
    """What stands for a text in a context parameter; 0 for an empty one."""
    return float(crc32(text.encode()))


def origin(options: ProgramOptions, integrator: openmm.Integrator) -> dict[str, float]:
    """Context parameters by which a state says who wrote it."""
    return {
        BY_SCHEME: _number(options.scheme.name),
        BY_KT: _asked(options),
        BY_SEED: float(options.seed),
        BY_VARIABLES: variables_number(integrator),
        BESIDE: 0.0,
        BEGUN: 0.0,
    }


def variables_number(integrator: openmm.Integrator) -> float:
    """A number for the names of an integrator's variables, 0 if it has none."""
    if not isinstance(integrator, openmm.CustomIntegrator):
        return 0.0
    single = map(integrator.getGlobalVariableName, range(integrator.getNumGlobalVariables()))
    per_dof = map(integrator.getPerDofVariableName, range(integrator.getNumPerDofVariables()))
    return _number(" ".join([*single, "each", *per_dof]))


def _asked(options: ProgramOptions) -> float:
    """A number for the temperature that a script asked for: the thermal energy, or a negative one for a ramp."""
    return options.kT if options.ramp is None else -1.0 - _number(repr(options.ramp))


def groups_of(force: openmm.Force) -> set[int]:
    """Force groups in which a force acts."""
    groups = {force.getForceGroup()}
    if isinstance(force, openmm.NonbondedForce) and force.getReciprocalSpaceForceGroup() >= 0:
        groups.add(force.getReciprocalSpaceForceGroup())
    return groups


def acting(forces: list[openmm.Force]) -> list[openmm.Force]:
    """Those that have an energy, whatever it may be at present."""
    return [force for force in forces if not isinstance(force, (*BAROSTATS, openmm.CMMotionRemover, openmm.AndersenThermostat))]


def refuse_thermostat(force: openmm.Force) -> None:
    """Raise PlanError for a force that changes velocities, which pairwise friction does not stand beside."""
    if isinstance(force, openmm.AndersenThermostat):
        raise PlanError("the System has an AndersenThermostat beside the DPD thermostat; remove it")
    if isinstance(force, openmm.CMMotionRemover):
        raise PlanError(
            "the System has a CMMotionRemover, which DPD does not need (it conserves momentum) and which takes energy out of the flow; "
            "make the System with removeCMMotion=False"
        )


@dataclass(frozen=True, eq=False)
class Made:
    """What an integrator was made for.

    Attributes
    ----------
    maker : str
        Function of this package that made the System, or added to it.
    masses : (N,) array
        Masses of the particles, Da.
    constraints : int
        Number of constraints.
    virtual : (N,) bool array
        Which particles are virtual sites.
    own : tuple of (str, int)
        Names and force groups of the forces that the package made.
    scheme : str
    kT : float
        Thermal energy the script asked for, kJ/mol (that at the beginning of a ramp).
    asked : float
        The same as it stands in states.
    seed : int or None
        The seed the script chose; None if it left the choice to the package.
    """

    maker: str
    masses: np.ndarray
    constraints: int
    virtual: np.ndarray
    own: tuple[tuple[str, int], ...]
    scheme: str
    kT: float
    asked: float
    seed: int | None

    @classmethod
    def of(cls, maker: str, system: openmm.System, own: Sequence[openmm.Force], options: ProgramOptions) -> Made:
        """What stands in a System now, and what was asked for."""
        forces = tuple((force.getName(), force.getForceGroup()) for force in own)
        seed = options.seed if options.seeded else None
        asked = options.scheme.name, options.kT, _asked(options), seed
        return cls(maker, masses_of(system), system.getNumConstraints(), _virtual(system), forces, *asked)

    def check(self, system: openmm.System) -> list[openmm.Force]:
        """The forces in a System that the package did not make.

        Raises
        ------
        PlanError
            If the System is not the one that the integrator was made for, or has something that would not act, or twice.
        """
        count, maker = len(self.masses), self.maker
        if system.getNumParticles() != count:
            raise PlanError(f"the System has {system.getNumParticles()} particles, but {maker} made the integrator for {count}")
        if system.getNumConstraints() != self.constraints:
            raise PlanError(
                f"the System has {system.getNumConstraints()} constraints, and it had {self.constraints} when {maker} made the integrator, "
                f"which would ignore the others; {self._remedy('hold distances by stiff bonds of the scene', 'add them')}"
            )
        changed = np.flatnonzero(_virtual(system) != self.virtual)
        if len(changed):
            raise PlanError(
                f"particle {changed[0]} has become a virtual site, or is none any more, since {maker} made the integrator; "
                f"{self._remedy('a scene has none', 'do that')}"
            )
        changed = np.flatnonzero(masses_of(system) != self.masses)
        if len(changed):
            raise PlanError(
                f"the mass of particle {changed[0]} is not what it was when {maker} made the integrator; "
                f"{self._remedy('give the scene its masses', 'change it')}"
            )
        return self._foreign(system)

    def check_writer(self, parameters: Mapping[str, float]) -> None:
        """Raise PlanError if the parameters of a state say that another scheme wrote it."""
        if BY_SCHEME in parameters and parameters[BY_SCHEME] != _number(self.scheme):
            raise PlanError(
                f"the state was written by another scheme than {self.scheme!r}, and schemes keep velocities at different times; take "
                "positions, velocities and box vectors from it (context.setPositions(state.getPositions()), ...) into a new Context"
            )

    def others(self, system: openmm.System) -> list[openmm.Force]:
        """Forces in a System that have an energy and that the package did not make."""
        return acting(self._told_apart(system)[1])

    def _told_apart(self, system: openmm.System) -> tuple[Counter, list[openmm.Force]]:
        """Own forces that are not there (or not in their group), and forces of others."""
        missing, foreign = Counter(self.own), []
        for force in system.getForces():
            place = (force.getName(), force.getForceGroup())
            if missing[place]:
                missing[place] -= 1
            else:
                foreign.append(force)
        return missing, foreign

    def _remedy(self, scene: str, before: str) -> str:
        return scene if self.maker == "build()" else f"{before} before {self.maker}"

    def _foreign(self, system: openmm.System) -> list[openmm.Force]:
        missing, foreign = self._told_apart(system)
        lost = next(missing.elements(), None)
        if lost is not None:
            name, group = lost
            now = [force.getForceGroup() for force in foreign if force.getName() == name]
            what = f"is in group {now[0]} now" if now else "is gone"
            raise PlanError(
                f"the force {name!r}, which {self.maker} put into force group {group}, {what}; leave the package's own forces as they are, "
                "and give other forces any groups that are free"
            )
        taken = {group: name for name, group in self.own}
        for force in foreign:
            for group in groups_of(force) & set(taken):
                free = ", ".join(str(g) for g in range(32) if g not in taken)
                raise PlanError(
                    f"the {force.getName()} is in force group {group}, which {taken[group]!r} of this package needs for itself; "
                    f"free groups are {free}"
                )
            refuse_thermostat(force)
        return foreign


def masses_of(system: openmm.System) -> np.ndarray:
    """Masses of all particles, Da."""
    return np.array([m.value_in_unit(unit.dalton) for m in map(system.getParticleMass, range(system.getNumParticles()))])


def _virtual(system: openmm.System) -> np.ndarray:
    return np.array([system.isVirtualSite(k) for k in range(system.getNumParticles())], dtype=bool)


def _drawn_seed() -> int:
    return secrets.randbelow(2**31 - 1) + 1


@contextmanager
def _reported() -> Iterator[None]:
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
    _piece = PIECE
    _begun = False
    _numbered: float | None = None

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
            with _reported():
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
            self._beside = _number(" ".join(f"{type(force).__name__} {force.getName()} {force.getForceGroup()}" for force in others))
            if "dt" in context.getParameters():
                raise PlanError("a force has a global parameter called dt, which is the step size in a CustomIntegrator; rename it")
            # a force taken from the System acts in this Context still
            self._mixed = self._mixed or bool(others)
            self._slow = self._mixed or self._slow_own()
            often = [force.getFrequency() for force in system.getForces() if isinstance(force, BAROSTATS)]
            self._barostats = self._mixed or any(often)
            self._piece = min([PIECE, *(frequency for frequency in often if frequency > 0)])
            self._looked_at = now
        self.settle(context)
        if BESIDE in context.getParameters() and context.getParameter(BESIDE) != self._beside:
            context.setParameter(BESIDE, self._beside)

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
        if parameters[BY_VARIABLES] != self._variables_number():
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
            for force in context.getSystem().getForces():
                if isinstance(force, BAROSTATS):
                    context.setParameter(force.Temperature(), force.getDefaultTemperature())
        if made.seed is not None and parameters[BY_SEED] != made.seed:
            self._take_seed(context, made.seed)

    def _begin(self, context: openmm.Context) -> None:
        """What has to be so before the first step of a Context."""
        self._mixed = bool(self._beside)

    def _take_seed(self, context: openmm.Context, seed: int) -> None:
        if SEED in context.getParameters():
            context.setParameter(SEED, seed)
        context.setParameter(BY_SEED, seed)

    def _variables_number(self) -> float:
        if self._numbered is None:
            self._numbered = variables_number(self)  # type: ignore[arg-type]
        return self._numbered

    def _take_kT(self, context: openmm.Context, kT: float) -> None:
        """Go on at another thermal energy."""


class StepsAtOnce(Protocol):
    """Carries out many whole steps of a Context (:class:`openmm_dpd.whole_steps.WholeSteps`)."""

    function: Any

    def run(self, integrator: PairIntegrator, context: openmm.Context, n: int, *, slow: bool, barostats: bool) -> None:
        """Carry out n steps; ``slow``: forces stay OpenMM's, ``barostats``: something else has to act in these steps."""


class PairIntegrator(Watching, openmm.CustomIntegrator):
    """A scheme of this package: a CustomIntegrator with a temperature and a seed, as OpenMM's own integrators have them.

    Where a CustomIntegrator has them, ``temperature`` (kelvin), :meth:`setTemperature`, :func:`openmm_dpd.set_temperature` and the
    context parameter ``dpd_kT`` (kJ/mol) all set the thermostat, and whichever was set last holds.
    """

    _variables: frozenset[str] = frozenset()

    #: What carries out many steps at once; None where the program does them one by one.
    whole: StepsAtOnce | None = None

    def _take(self, context: openmm.Context, steps: int) -> None:
        if self.whole is None:
            super()._take(context, steps)
        elif self._slow or self._barostats:
            with self._or_back(context):
                self.whole.run(self, context, steps, slow=self._slow, barostats=self._barostats)
        else:  # the Context is not touched before all steps are done
            with _reported():
                self.whole.run(self, context, steps, slow=False, barostats=False)

    def variables(self) -> frozenset[str]:
        """Names of the global variables."""
        if len(self._variables) != self.getNumGlobalVariables():
            self._variables = frozenset(map(self.getGlobalVariableName, range(self.getNumGlobalVariables())))
        return self._variables

    def _take_kT(self, context: openmm.Context, kT: float) -> None:
        if TEMPERATURE in self.variables():
            self.agree(context, kT, kT / BOLTZMANN)
        elif KT in context.getParameters() and RAMP_STEP not in self.variables():
            context.setParameter(KT, kT)

    def _begin(self, context: openmm.Context) -> None:
        super()._begin(context)
        names, parameters, put = self.variables(), context.getParameters(), openmm.CustomIntegrator.setGlobalVariableByName
        assert self.made is not None
        if "valid_for" in names:
            put(self, "valid_for", -1.0)  # a Context that was reinitialized has lost the acceleration that belonged to it
        self._forget()
        for name in (RAMP_STEP, SLOW_STEP) if self._begun else ():
            if name in names:
                put(self, name, 0.0)
        if TEMPERATURE in names:
            kT, kelvin = parameters[KT], self.getGlobalVariableByName(TEMPERATURE)
            if kT != self.made.kT:  # set in this Context, so later than what the integrator had before
                kelvin = kT / BOLTZMANN
            elif kelvin != kT / BOLTZMANN:
                kT = BOLTZMANN * kelvin
            self.agree(context, kT, kelvin)
        if self._begun and self.made.seed is None and SEED in parameters and parameters[SEED] == parameters[BY_SEED]:
            context.setParameter(SEED, _drawn_seed())  # nobody asked for the same noise in every Context

    def agree(self, context: openmm.Context, kT: float, kelvin: float) -> None:
        """Set thermal energy (kJ/mol) and temperature, which have to fit, at once: whatever is set next is then known to be later."""
        put = openmm.CustomIntegrator.setGlobalVariableByName
        context.setParameter(KT, kT)
        put(self, TEMPERATURE, kelvin)
        put(self, SEEN_TEMPERATURE, kelvin)
        put(self, SEEN_KT, kT)

    def getTemperature(self) -> unit.Quantity:
        """The temperature of the thermostat, kelvin (that of this step, where it follows a ramp).

        Raises
        ------
        ParameterError
            If nothing has a temperature to be held.
        """
        names, context = self.variables(), self.context()
        if not names & {TEMPERATURE, RAMP_STEP}:
            raise ParameterError(_NOT_SETTABLE)
        if context is None:
            value = self.getGlobalVariableByName(TEMPERATURE) if TEMPERATURE in names else self.made.kT / BOLTZMANN  # type: ignore[union-attr]
            return value * unit.kelvin
        self.settle(context)
        kT = context.getParameter(KT)
        if TEMPERATURE in names and kT == self.getGlobalVariableByName(SEEN_KT):
            return self.getGlobalVariableByName(TEMPERATURE) * unit.kelvin
        return kT / BOLTZMANN * unit.kelvin

    def setTemperature(self, temperature) -> None:
        """Set the temperature of the thermostat.

        Parameters
        ----------
        temperature : temperature
            Bare numbers: kelvin, as for OpenMM's integrators.

        Raises
        ------
        ParameterError
            If it is no temperature, or none can be set: it follows a ramp, nothing has friction or noise, or beads have temperatures of
            their own.
        """
        names = self.variables()
        if TEMPERATURE not in names:
            raise ParameterError(RAMPED if RAMP_STEP in names else _NOT_SETTABLE)
        kelvin = to_md(temperature, "temperature", "the temperature")
        if not isinstance(kelvin, float) or not 0.0 <= kelvin < np.inf:
            raise ParameterError(f"the temperature must be a single number of kelvin >= 0, not {temperature!r}")
        context, put = self.context(), openmm.CustomIntegrator.setGlobalVariableByName
        if context is None:  # for the next step to take, whatever it took before
            put(self, TEMPERATURE, kelvin)
            put(self, SEEN_TEMPERATURE, -1.0)
        elif kelvin != self.getTemperature().value_in_unit(unit.kelvin):
            self.agree(context, BOLTZMANN * kelvin, kelvin)

    def setGlobalVariableByName(self, name: str, value) -> None:
        """Set a global variable; ``temperature`` is :meth:`setTemperature`."""
        if name == TEMPERATURE:
            self.setTemperature(value)
        else:
            super().setGlobalVariableByName(name, value)

    def setGlobalVariable(self, index: int, value) -> None:
        """Set a global variable by its number; ``temperature`` is :meth:`setTemperature`."""
        self.setGlobalVariableByName(self.getGlobalVariableName(index), value)

    def setPerDofVariableByName(self, name: str, values) -> None:
        """Set a per-DOF variable; as in OpenMM."""
        super().setPerDofVariableByName(name, values)
        self._forget()

    def setPerDofVariable(self, index: int, values) -> None:
        """Set a per-DOF variable; as in OpenMM."""
        super().setPerDofVariable(index, values)
        self._forget()

    def _forget(self) -> None:
        """Per-DOF variables are not what a loop of steps has left."""
        if STAMP in self.variables():
            openmm.CustomIntegrator.setGlobalVariableByName(self, STAMP, 0.0)

    def setRandomNumberSeed(self, seed: int) -> None:
        """Set the seed of the noise, and of the random numbers of OpenMM's barostats (these when a Context is made next).

        The noise takes it over at the next step, whatever the seed of a state that was loaded; 0 draws a seed, as in OpenMM.
        """
        super().setRandomNumberSeed(seed)
        if self.made is not None:
            chosen, context = int(seed) % 2**31 or _drawn_seed(), self.context()
            self.made = replace(self.made, seed=chosen)
            if context is not None:
                self.settle(context)
                self._take_seed(context, chosen)


class NativeIntegrator(Watching, openmm.DPDIntegrator):
    """OpenMM's own DPDIntegrator."""

    whole = None

    def step(self, steps: int) -> None:
        """Take steps, as all integrators here; a step size of 0 is an error, of which OpenMM would make NaNs."""
        dt = self.getStepSize().value_in_unit(unit.picosecond)
        if not dt > 0:
            raise openmm.OpenMMException(f"the step size must be > 0, but the integrator's is {dt:g} ps")
        super().step(steps)


#: Why a temperature cannot be set.
RAMPED = "the temperature of this Context follows a ramp, which would overwrite it at the next step"
_NOT_SETTABLE = "there is no temperature to set: nothing has friction or noise, or the beads have temperatures of their own (write_fields)"


__all__ = ["Made", "NativeIntegrator", "PairIntegrator", "origin"]
