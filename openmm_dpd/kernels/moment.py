"""What a step is, the moment it begins at, and what a loop over steps has to do, whichever engine it uses."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..runtime import Tape
from .columns import Totals
from .driven import Driven
from .interface import Engine
from .solids import Solids

#: Speeds in thermal velocities that no bead has in equilibrium: the Maxwell distribution gives one in 10^21 beads.
FASTEST = 10.0


def ramped_energy(ramp: Any, steps: float) -> float:
    """Thermal energy on a temperature ramp after some steps, with the bits of
    :func:`openmm_dpd.simulation.programs.program.ramp_expression`."""
    part = (steps - ramp.first_step) * (1.0 / (ramp.last_step - ramp.first_step))
    return ramp.kT_start + (ramp.kT_end - ramp.kT_start) * min(1.0, max(0.0, part))


@dataclass(frozen=True, eq=False)
class StepSpec:
    """Everything about a step that never changes."""

    letters: tuple[tuple[str, float], ...]  #: (letter, part of the step); empty for the modified velocity Verlet scheme
    #: For how many step sizes forces that are not the kernel's kick, before and after :attr:`slow_every` steps
    slow_kicks: tuple[float, float] = (0.5, 0.5)
    slow_every: int = 1  #: Steps from one evaluation of these forces to the next
    thermostat: bool = True  #: Whether there is friction or noise
    lam: float = 0.5  #: Weight of the velocity prediction in the modified velocity Verlet scheme
    field_lam: float = 0.5  #: Weight of the prediction of fields in that scheme
    #: Planes that beads do not pass, five arrays (3,): low, high, start, period, back (see :mod:`openmm_dpd.simulation.programs.walls`).
    walls: tuple[np.ndarray, ...] | None = None
    driven: Driven | Solids | None = None  #: The walls, if some move, or have a shape or something behind them
    ramp: Any = None  #: A TemperatureRamp of the model, or None
    shear: Any = None  #: A LeesEdwards of the model, or None
    tilt: float = 0.0  #: Tilt of the box at the start of a shear, nm
    reactions: Any = None  #: A :class:`.reactions.BondsSpec`, if bonds form and break

    @property
    def predicts(self) -> bool:
        """Whether friction is a force of a predicted velocity."""
        return not self.letters

    @property
    def looks_first(self) -> bool:
        """Whether a step sweeps over the pairs before its first drift."""
        return next((letter for letter, _ in self.letters if letter != "B"), "A") != "A"

    @property
    def foresees(self) -> bool:
        """Whether the prediction scales the kick of slow forces by 2 lam; kicks that come less often than every step count as they are."""
        return self.lam != 0.5 and self.slow_every == 1


@dataclass(frozen=True, eq=False)
class Masses:
    """1/masses, as passes over beads and over components read them."""

    inverse: np.ndarray  #: (N,) of beads; 0 for those that do not move
    components: np.ndarray  #: (3 N,) of components, or (1,) if all are alike
    moving: np.ndarray  #: The same, as if all masses were 1: for accelerations
    slowest: float  #: Square root of 1/mass of the heaviest bead that moves; 0 if none does
    some_rest: bool  #: Whether there are beads that do not move

    @classmethod
    def of(cls, inverse: np.ndarray) -> "Masses":
        """From the 1/masses (N,) of the beads."""
        moving, alike = inverse[inverse > 0.0], bool(np.all(inverse == inverse[:1]))
        slowest = math.sqrt(moving.min()) if len(moving) else 0.0
        components = inverse[:1].copy() if alike else np.repeat(inverse, 3)
        return cls(inverse.copy(), components, np.sign(components), slowest, len(moving) < len(inverse))

    def seat(self, given: np.ndarray, names: np.ndarray) -> None:
        """Put beads in another order: ``given`` (N,) are 1/masses by the numbers of beads, ``names`` (N,) the number of the bead in each
        row."""
        if len(self.components) > 1:  # they are unlike
            np.take(given, names, out=self.inverse)
            self.components.reshape(-1, 3)[...] = self.inverse[:, None]
            np.sign(self.components, out=self.moving)


class Guide:
    """Acts within steps where friction is a force: on velocities, and on the sum of all forces, in ways that no force of OpenMM can.  This
    one does nothing."""

    what = ""  #: What it is, in words
    numbers: tuple[float, ...] = ()  #: What it keeps from step to step, at the start
    limits = False  #: Whether :meth:`limit` changes anything
    resizes = False  #: Whether it changes the box
    more = 0  #: What it wants summed beside forces: STRESS

    def begin(self, m: "Moment") -> None:
        """Change velocities at the beginning of a step."""

    def forces(self, m: "Moment", v: np.ndarray, force: np.ndarray, step: int) -> np.ndarray:
        """All forces (N, 3) at the positions of the moment, which belong to this step of the Context, from those of the scene, and the
        velocities v that friction sees."""
        return force

    def limit(self, m: "Moment") -> None:
        """Change velocities after a kick."""

    def place(self, m: "Moment", seen: np.ndarray) -> None:
        """Put beads that do not move by themselves where they are once all have drifted, and set their velocities, also ``seen``, those
        that friction sees."""

    def end(self, m: "Moment") -> None:
        """Change velocities at the end of a step."""


NO_GUIDE = Guide()


@dataclass(eq=False)
class Moment:
    """Everything that a step depends on; a :class:`Stepper` changes it in place."""

    x: np.ndarray  #: (N, 3) positions
    v: np.ndarray  #: (N, 3) velocities; beads that do not move have the velocity 0
    box: np.ndarray | None  #: (3, 3) box vectors
    dt: float  #: Step size
    kT: float  #: Thermal energy
    seed: int  #: Key of the noise, with the counter
    counter: int  #: Key of the noise, with the seed: random numbers of pairs drawn so far
    ramped: float | None = None  #: Steps done, for a temperature ramp that the loop follows; None where the caller follows it
    slow_step: int = 0  #: Steps done since forces that are not the kernel's kicked
    time: float = 0.0  #: Time of the Context, ps, where walls are driven
    #: Momentum that walls have taken up, where they are driven, at the places that their ``impulses`` name
    impulses: np.ndarray | None = None
    values: np.ndarray | None = None  #: (N, K) fields
    rates: np.ndarray | None = None  #: (N, K) rates of change of the fields, if friction is a force
    acc: np.ndarray | None = None  #: (N, 3) acceleration at x if friction is a force; None to have it computed
    predicted: np.ndarray | None = None  #: (N, 3) velocities that friction saw last, if they are not those of the half step
    #: If friction is a force: (N, 3) velocities before the slow forces kicked, where that makes a difference.
    unkicked: np.ndarray | None = None
    #: (4,) in a shear, see :mod:`.shear`; the box vectors belong to its time, and both change in place
    flow: np.ndarray | None = None
    number: int = 0  #: Steps done in the Context
    bonds: np.ndarray | None = None  #: (N, W) int64, the table of bonds that form and break, see :mod:`.reactions`
    #: (K,) what a :class:`Guide` keeps from step to step, and then for each reaction bonds made, bonds broken, bonds that its last trial
    #: has changed
    numbers: np.ndarray = field(default_factory=lambda: np.zeros(0))
    guide: Guide = NO_GUIDE  #: Acts within the steps
    more: int = 0  #: If friction is a force: what the present step sums beside forces
    #: Forces (N, 3) of others at a step of the Context, where a guide acts on the sum of all: they do not kick by themselves then
    others: Callable[["Moment", int], np.ndarray] | None = None

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays with a row for each bead, by name: positions, velocities, and fields, rates and accelerations if there are any."""
        each = {"x": self.x, "v": self.v, "values": self.values, "rates": self.rates, "acc": self.acc}
        return {name: rows for name, rows in each.items() if rows is not None}

    @property
    def beside(self) -> dict[str, np.ndarray]:
        """Other arrays that steps change, by name: box and flow of a shear, impulses on walls."""
        each = {"box": None if self.flow is None else self.box, "flow": self.flow, "impulses": self.impulses}
        return {name: values for name, values in each.items() if values is not None}

    @property
    def state(self) -> list[np.ndarray]:
        """All arrays that steps change."""
        return [*self.arrays.values(), *self.beside.values()]


#: (velocities (N, 3), 1/masses (N,), moment): raises RunError if a bead runs away.
Watch = Callable[[np.ndarray, np.ndarray, Moment], None]
#: (moment, number of steps done in this run) -> forces (N, 3) of others at the positions of the moment.
SlowForces = Callable[[Moment, int], np.ndarray]


class Looks(Protocol):
    """What is measured at some steps of a run while it goes on."""

    every: int  #: Steps from one to the next
    more: int  #: Summed with the forces of such a step

    def until(self, number: int) -> int:
        """Steps from this one to the next at which something is measured."""
        ...

    def take(self, m: Moment, force: np.ndarray, tape: Tape, number: int) -> None:
        """Measure a step, with its conservative force (N, 3), while a tape records."""

    def played(self, number: int, steps: int, tape: Tape, until: int, every: int, room: list[np.ndarray]) -> None:
        """Steps from this one on were played; those that measure, ``until`` and more steps later, left in ``room`` what they found."""


class Stepper(Protocol):
    """Does whole steps with one engine, and keeps what the last one has computed."""

    spec: StepSpec
    engine: Engine
    #: Where friction is a force, what the last step of a run sums beside its forces: STRESS, and LAPLACIAN, with conservative forces apart,
    #: from engines that can
    more: int
    looks: Looks | None  #: What is measured within the present run

    def run(self, moment: Moment, n: int, slow: SlowForces | None = None) -> None:
        """Do n steps; ``slow`` computes forces of others, which kick before and after them.  RunError if a step fails; it has the number of
        complete steps as ``steps_done``, and the moment must not be used."""

    def conserve(self, values: np.ndarray | None, more: int = 0) -> tuple[np.ndarray, Totals]:
        """Conservative force (N, 3) at the positions that were placed last, and its sums; ``more`` asks for STRESS and LAPLACIAN."""
        ...

    def swept(self, counter: int) -> np.ndarray | None:
        """(6,) sum of r J over the sweeps of the last step in a shear, J the impulses of friction along the lines between beads.  None if
        the last step was not the one with this counter of the noise, or friction is a force."""
        ...

    def last(self) -> "LastStep | None":
        """What the last step computed, where friction is a force and the engine has not placed other positions since; otherwise None."""
        ...

    def forget(self) -> None:
        """Let go of the moment after the last step and its arrays."""


class LastStep(NamedTuple):
    """Forces and sums of the last step of a run, where friction is a force."""

    moment: Moment  #: After the step
    force: np.ndarray  #: (N, 3) all forces there
    totals: Totals
    held: np.ndarray | None  #: (N, 3) conservative forces alone, if they were parted: the totals have their Laplacian and virial then
