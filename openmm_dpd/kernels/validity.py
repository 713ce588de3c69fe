"""What a loop over steps has already computed for the present positions, and until when it holds: every such rule is a method here.

=====================  ====================================================  ===========================================================
what                   is there after                                        until
=====================  ====================================================  ===========================================================
lists of pairs         ``begin``, if the engine holds them; ``listed``       ``drift``
force and its sums     ``summed``                                            the engine lists pairs anew, ``lose_force``
force without lists    ``begin``, if it is given                             ``drift``
moment                 ``end``                                               ``begin``
recorded step          ``record``                                            ``take``
=====================  ====================================================  ===========================================================
"""

from typing import NamedTuple

import numpy as np

from ..runtime import Tape
from .columns import Totals
from .interface import Engine
from .moment import Looks, Moment

_NONE = -1


class Computed(NamedTuple):
    """What is there before a step, so that the step need not compute it."""

    placed: bool  #: Lists of pairs
    forced: bool  #: The force, with lists of pairs
    accelerated: bool  #: The acceleration, where friction is a force
    given: bool  #: The force, without lists of pairs


class Recorded(NamedTuple):
    """A step that can be played again where the same is known before it, under the same conditions."""

    step: Tape
    before: Computed
    conditions: tuple


class Validity:
    """What one loop over steps has computed with its engine.

    Attributes
    ----------
    placed : bool
        Whether the lists of the engine are those of the present positions.
    given : bool
        Whether the force is that at the present positions although there are no lists.
    moment : Moment or None
        The moment after the last step of a run; None during a run.
    totals : Totals
        Sums that belong to the force.
    """

    def __init__(self, engine: Engine):
        self._engine = engine
        self.placed = self.given = False
        self.moment: Moment | None = None
        self.totals = Totals(0.0, 0.0, 0.0)
        self._number, self._which = _NONE, 0
        self._recorded: dict[bool, Recorded] = {}

    # -- a run -------------------------------------------------------------------------------------------------------------------
    def begin(self, x: np.ndarray, box: np.ndarray | None, given: bool) -> None:
        """A run begins at these positions; ``given`` says whether the force is that at them."""
        self.moment, self.given = None, given
        self.placed = self._engine.holds(x, box)

    def end(self, moment: Moment | None) -> None:
        """A run has ended at this moment; None: it is not needed any more."""
        self.moment = moment

    def drift(self) -> None:
        """The beads move: their pairs have to be listed anew.  The force stays that of the lists it was summed over."""
        self.placed = self.given = False

    def listed(self) -> None:
        """The engine has listed the pairs at the present positions."""
        self.placed = True

    # -- the force ---------------------------------------------------------------------------------------------------------------
    @property
    def forced(self) -> bool:
        """Whether the force was summed over the lists that the engine has."""
        return self._number == self._engine.number

    def has(self, which: int) -> bool:
        """Whether the force was summed over the lists that the engine has, with all of these terms and sums."""
        return self.forced and not which & ~self._which

    def lose_force(self) -> None:
        """There is no force: another one is being summed, or the array is that of other beads."""
        self._number = _NONE

    def summed(self, which: int, totals: Totals) -> None:
        """The force of these terms has been summed over the lists that the engine has."""
        self.totals, self._which, self._number = totals, which, self._engine.number

    # -- steps that are played ---------------------------------------------------------------------------------------------------
    def computed(self, m: Moment) -> Computed:
        """What is there before a step from this moment."""
        return Computed(self.placed, self.placed and self.forced, m.acc is not None, self.given)

    def record(self, recorded: dict[bool, Recorded]) -> None:
        """Keep steps that can be played again, by whether they measure."""
        self._recorded |= recorded

    def take(self) -> dict[bool, Recorded]:
        """Take the recorded steps out: they are there once, so that a step that fails is not played again."""
        recorded, self._recorded = self._recorded, {}
        return recorded

    def fitting(self, looks: Looks | None, number: int, steps: int, state: list[np.ndarray], conditions: tuple):
        """Recorded steps that can be played from step ``number`` on, or None: those that were taken out, the usual one, how often it can be
        played, and what :meth:`.Tape.play` needs to play those that measure among them, if due."""
        taken, seldom = self.take(), None
        until, every = (steps, steps) if looks is None else (looks.until(number), looks.every)
        measuring = taken.get(True)
        recorded = measuring if not until and every == 1 else taken.get(False)
        steps = steps if measuring is not None else min(steps, until)
        if recorded is None or not steps:
            self.record(taken)
            return None
        if any(not each.step.begins_with(*state) or each[1:] != (recorded.before, conditions) for each in taken.values()):
            return None
        steps = min(steps, recorded.step.at_once)
        if measuring is not None and until < steps:
            room = [np.empty((-(-(steps - until) // every), *each.shape)) for each in measuring.step.noted]
            seldom = measuring.step, until, every, room
        return taken, recorded, steps, seldom

    def played(self, before: Computed | None) -> None:
        """Steps have been played: what was known before the recorded one is known again; nothing, where None was completed."""
        self.placed, self.given = before is not None and before.placed, False
        self._number = self._engine.number if before is not None and before.forced else _NONE
