"""What a step is, and what it begins with: what loops over steps have in common, whichever engine they use."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from .columns import Totals
from .driven import Driven

#: Speeds in thermal velocities that no bead has in equilibrium: the Maxwell distribution gives one in 10^21 beads.
FASTEST = 10.0


def ramped_energy(ramp: Any, steps: float) -> float:
    """Thermal energy on a temperature ramp after some steps; as :func:`openmm_dpd.simulation.programs.program.ramp_expression` has it, to
    the bit."""
    part = (steps - ramp.first_step) * (1.0 / (ramp.last_step - ramp.first_step))
    return ramp.kT_start + (ramp.kT_end - ramp.kT_start) * min(1.0, max(0.0, part))


@dataclass(frozen=True, eq=False)
class StepSpec:
    """The part of a step that never changes."""

    letters: tuple[tuple[str, float], ...]  #: (letter, part of the step); empty for the modified velocity Verlet scheme
    slow_kicks: tuple[float, float] = (0.5, 0.5)  #: Over how many steps forces that are not the kernel's kick before and after
    slow_every: int = 1  #: How many steps lie between the two
    thermostat: bool = True  #: Whether there is friction or noise
    lam: float = 0.5  #: Weight of the prediction of velocities in that scheme
    field_lam: float = 0.5  #: Weight of that of fields
    #: Planes that beads do not pass, five arrays (3,): low, high, start, period, back (see :mod:`openmm_dpd.simulation.programs.walls`).
    walls: tuple[np.ndarray, ...] | None = None
    driven: Driven | None = None  #: The same walls where some move or have something behind them
    ramp: Any = None  #: A TemperatureRamp of the model, or None
    shear: Any = None  #: A LeesEdwards of the model, or None
    tilt: float = 0.0  #: Of the box that a shear begins with

    @property
    def predicts(self) -> bool:
        """Whether friction is a force of a predicted velocity."""
        return not self.letters

    @property
    def looks_first(self) -> bool:
        """Whether a step sweeps over the pairs at the positions that it begins with."""
        return next((letter for letter, _ in self.letters if letter != "B"), "A") != "A"

    @property
    def foresees(self) -> bool:
        """Whether a kick by slow forces before a step is not just what they add to that prediction; impulses are taken as they are."""
        return self.lam != 0.5 and self.slow_every == 1


@dataclass(frozen=True, eq=False)
class Masses:
    """1/masses, as passes over beads and over components read them."""

    inverse: np.ndarray  #: (N,) of beads; 0 for those that do not move
    components: np.ndarray  #: (3 N,) of components, or (1,) if all are alike
    slowest: float  #: Square root of 1/mass of the heaviest bead that moves; 0 if none does
    some_rest: bool  #: Whether there are beads that do not move

    @classmethod
    def of(cls, inverse: np.ndarray) -> "Masses":
        """Those of beads with these 1/masses (N,)."""
        moving, alike = inverse[inverse > 0.0], bool(np.all(inverse == inverse[:1]))
        slowest = math.sqrt(moving.min()) if len(moving) else 0.0
        return cls(inverse.copy(), inverse[:1].copy() if alike else np.repeat(inverse, 3), slowest, len(moving) < len(inverse))

    def seat(self, given: np.ndarray, names: np.ndarray) -> None:
        """Put beads in another order: ``given`` (N,) are 1/masses by the numbers of beads, ``names`` (N,) the number of the bead in each
        row."""
        if len(self.components) > 1:  # they are unlike
            np.take(given, names, out=self.inverse)
            self.components.reshape(-1, 3)[...] = self.inverse[:, None]


@dataclass(eq=False)
class Moment:
    """What a step begins with; a :class:`Stepper` changes it in place."""

    x: np.ndarray  #: (N, 3) positions
    v: np.ndarray  #: (N, 3) velocities; beads that do not move have the velocity 0
    box: np.ndarray | None  #: (3, 3) box vectors
    dt: float  #: Step size
    kT: float  #: Thermal energy
    seed: int  #: Key of the noise, with the counter
    counter: int  #: The other part of the key
    ramped: float | None = None  #: Steps done, for a temperature ramp that the loop follows; None where the caller follows it
    slow_step: int = 0  #: Steps done since forces that are not the kernel's kicked
    time: float = 0.0  #: Of the Context, where walls are driven
    #: (3, 2, 3) what walls have taken up of momentum, by axis, side and component, where they are driven
    impulses: np.ndarray | None = None
    values: np.ndarray | None = None  #: (N, K) fields
    rates: np.ndarray | None = None  #: (N, K) their changes per time, if friction is a force
    acc: np.ndarray | None = None  #: (N, 3) acceleration at x if friction is a force; None to have it computed
    predicted: np.ndarray | None = None  #: (N, 3) velocities that friction saw last, if they are not those of the half step
    #: If friction is a force: (N, 3) velocities before the slow forces kicked, where that makes a difference.
    unkicked: np.ndarray | None = None
    #: (4,) in a shear, see :mod:`.shear`; the box vectors belong to its time, and both change in place
    flow: np.ndarray | None = None

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """What there is of positions, velocities, fields, their rates, and accelerations, by name."""
        each = {"x": self.x, "v": self.v, "values": self.values, "rates": self.rates, "acc": self.acc}
        return {name: rows for name, rows in each.items() if rows is not None}

    @property
    def beside(self) -> dict[str, np.ndarray]:
        """What else changes in steps: box and flow of a shear, impulses on walls."""
        each = {"box": None if self.flow is None else self.box, "flow": self.flow, "impulses": self.impulses}
        return {name: values for name, values in each.items() if values is not None}

    @property
    def state(self) -> list[np.ndarray]:
        """All of these arrays."""
        return [*self.arrays.values(), *self.beside.values()]


#: Raises RunError if beads of these velocities (N, 3) and 1/masses (N,) run away in a step of a moment.
Watch = Callable[[np.ndarray, np.ndarray, Moment], None]
#: Forces (N, 3) of others at the positions of a moment, after so many of the steps that are being done.
SlowForces = Callable[[Moment, int], np.ndarray]


class Stepper(Protocol):
    """Does whole steps with one engine, and keeps what it has computed in the last one."""

    spec: StepSpec
    #: Where friction is a force, what the last step of a run sums beside its forces: STRESS, and LAPLACIAN, with conservative forces apart,
    #: from engines that can
    more: int

    def run(self, moment: Moment, n: int, slow: SlowForces | None = None) -> None:
        """Do n steps; ``slow`` are forces of others (N, 3), at the positions of the moment, that kick before and after.  RunError if a step
        fails; ``steps_done`` is how many were complete, and the moment is worth nothing."""

    def conserve(self, values: np.ndarray | None, more: int = 0) -> tuple[np.ndarray, Totals]:
        """Conservative force (N, 3) at the positions that were placed last, and its sums, STRESS and LAPLACIAN as well if asked for."""
        ...

    def swept(self, counter: int) -> np.ndarray | None:
        """In a shear: (6,) sum of r J over the sweeps of the last step, if that is the one with this counter of the noise.  J are impulses
        of friction along the lines between beads.  None where friction is a force."""
        ...

    def last(self) -> "LastStep | None":
        """Where friction is a force: what the last step computed, if the engine is still there."""
        ...

    def forget(self) -> None:
        """Let go of the moment after the last step and its arrays."""


class LastStep(NamedTuple):
    """What the last step of a run has computed, where friction is a force."""

    moment: Moment  #: After the step
    force: np.ndarray  #: (N, 3) all forces there
    totals: Totals
    held: np.ndarray | None  #: (N, 3) conservative forces alone, if they were parted: the totals have their Laplacian and virial then
