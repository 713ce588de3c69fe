"""Programs of words, letter by letter, for any other forces and every platform.

A line of a program costs a good part of a pass over the pairs, so two things are optimised.  A drift right before a sweep also passes the
velocities to it; without one (or if walls reflect beads) a trial drift does so, and is undone.  And a force that kicks several times at the
same positions is stored as an acceleration, across the end of a step with a fingerprint of what it was computed from.  Its kicks are merged
with the sweep between them.
"""

from contextlib import nullcontext
from fractions import Fraction

from ...base.names import SLOW_STEP, Phase
from ...model.schemes import SWEEPS, Letter
from ...plan.program_options import ProgramOptions
from .program import Program
from .walls import add_reflection


def splitting_program(options: ProgramOptions) -> Program:
    """Program of a scheme that is a word."""
    scheme = options.scheme
    return Writer(Program(scheme.name, scheme.reference, options), scheme.steps(options.thermostat)).written()


class Writer:
    """Writes the letters of one step."""

    def __init__(self, program: Program, letters: tuple[Letter, ...]):
        self.p, self.options, self.letters = program, program.options, letters
        #: kicks share positions if the number of drifts before them is equal; those after the last drift belong to the next step
        drifts = [sum(name == "A" for name, _ in letters[:n]) for n in range(len(letters))]
        total = sum(name == "A" for name, _ in letters)
        self.places = [n % total for n in drifts]
        kicks = [n for n, (name, _) in enumerate(letters) if name == "B"]
        #: whether the force at the end of a step is used in the next one
        self.kept = self.options.kernel and drifts[kicks[0]] == 0 and drifts[kicks[-1]] == total and not self.options.fields_act
        self.owed = Fraction(0)  # part of a kick by acc that v still lacks
        self.known = self.kept  # whether acc is the acceleration at x
        self.seen = self.kept  # whether the pair force has stored x
        self.away = False  # whether x is displaced from xs
        self.told = False  # whether the pair force has read the fields
        self.shown: Fraction | None = None  # part of the drift that passes v at x
        self.ramped = False

    def written(self) -> Program:
        """Write all letters, and return the program."""
        p = self.p
        p.begin()
        if self.kept:
            p.keep_acceleration()
        kick_before(p)
        n = 0
        while n < len(self.letters):
            name, part = self.letters[n]
            n = {"A": self.drift, "B": self.kick}.get(name, self.sweep)(n, part)
        self.settle()
        self.put_back()
        if self.options.constraints:
            p.declare_per_dof("xu", "positions before they are constrained")
            p.each("xu", "x")
            p.constrain_positions()
            p.each("v", "v+(x-xu)/dt", "the constraints' impulse")
        if self.kept:
            p.acceleration_is_kept()
        kick_after(p)
        return p

    def drift(self, n: int, part: Fraction) -> int:
        """Write a drift; the last one before a sweep passes the velocities to it.  Returns the number of the next letter."""
        p, options = self.p, self.options
        shows = not options.walls and n + 1 < len(self.letters) and self.letters[n + 1][0] in SWEEPS
        if shows and not self.seen:
            self.put_back()
            p.store()
        self.settle()
        if shows and options.field_blocks and not self.told:
            if not self.away:
                p.keep_positions()
            p.read(p.fields())
            self.away = True
        p.each("x", f"{'xs' if self.away else 'x'}+{times(part)}*v", spelling("drift", part))
        add_reflection(p)
        self.known = self.seen = self.away = False
        self.shown = part if shows else None
        return n + 1

    def kick(self, n: int, part: Fraction) -> int:
        """Write a kick, or postpone it until v is needed if the acceleration is kept.  Returns the number of the next letter."""
        p = self.p
        if not self.known:
            self.put_back()
            if self.options.fields_act and not self.told:
                if not self.seen:
                    p.store()
                p.read_at_rest()
                self.told = True
            if self.options.execution.pushes:
                p.phase(Phase.CONSERVE)
                self.seen = True
            # without a kernel nothing comes in between, and OpenMM keeps the force itself
            here = [name for place, (name, _) in zip(self.places, self.letters, strict=True) if place == self.places[n]]
            if not self.options.partial and (here.count("B") == 1 or not self.options.kernel):
                p.each("v", f"v+{times(part)}*{p.kicking}/m", spelling("kick", part))
                p.constrain_velocities()
                return n + 1
            p.declare_per_dof("acc", "conservative acceleration at x")
            p.each("acc", f"{p.kicking}/m")
            p.leave_to_body_forces()
            self.known = True
        self.owed += part
        return n + 1

    def sweep(self, n: int, part: Fraction) -> int:
        """Write a sweep, with the kicks by the same acceleration around it.  Returns the number of the next letter."""
        p, options = self.p, self.options
        if not self.ramped:
            p.next_temperature()
            self.ramped = True
        if part != 1:
            p.set("dpd_dt", times(part), "duration of this sweep")
        fields, update = p.fields(), SWEEPS.index(self.letters[n][0])
        if self.shown is None:
            self.put_back()
            if not self.seen:
                p.store()
                self.seen = True
            p.keep_positions()
            if not self.told:
                p.read(fields)
            p.next_noise(options.trial_time)
            p.show(f"(v+{times(self.owed)}*acc)" if self.owed else "v")
            p.phase(Phase.SWEEP_KEPT, update)
            self.away = True
        else:
            p.next_noise(times(self.shown))
            p.phase(Phase.SWEEP_SEEN, update)
        n += 1
        if fields:  # internal energies need the velocities before and after the sweep only
            self.settle()
        else:
            while self.known and n < len(self.letters) and self.letters[n][0] == "B":
                self.owed += self.letters[n][1]
                n += 1
        p.before_sweep()
        kick, why = (f"+{times(self.owed)}*acc", "kicks, sweep") if self.owed else ("", "sweep")
        p.each("v", f"v{kick}+{times(part)}*{p.pair_force}/m", why if self.shown is None else f"{why}: the drift passed the velocities")
        p.constrain_velocities()
        self.owed, self.shown = Fraction(0), None
        p.after_sweep(fields)
        self.told, self.known = False, self.known and not options.fields_act
        if part != 1:
            p.set("dpd_dt", "dt")
        return n

    def settle(self) -> None:
        """Write postponed kicks."""
        if self.owed:
            self.p.each("v", f"v+{times(self.owed)}*acc", spelling("kick", self.owed))
            self.owed = Fraction(0)

    def put_back(self) -> None:
        """Undo a trial drift."""
        if self.away:
            self.p.each("x", "xs", "back")
            self.away = False


def times(part: Fraction) -> str:
    """Expression of a part of the step size."""
    return "dt" if part == 1 else f"{float(part)!r}*dt"


def spelling(what: str, part: Fraction) -> str:
    """A substep and its part in words, for the listing."""
    return what if part == 1 else f"{what} over {part} of the step"


def kick_before(p: Program) -> None:
    """Kick by OpenMM's slow forces before a step, in every or every n-th step as in the loop, if a loop could carry out the steps.

    In a program without a loop they kick with all other forces, and nothing is written here.  The pair force exerts none in phase STORE, so
    ``f`` is that of all others.
    """
    if p.options.slow_every > 1 and p.options.execution.looped:
        p.declare(SLOW_STEP, 0.0, "steps done since OpenMM's forces kicked")
    _kick(p, p.options.slow_kicks[0], "before")


def kick_after(p: Program) -> None:
    """Kick by OpenMM's slow forces after a step; the counterpart of :func:`kick_before`."""
    every = p.options.slow_every
    if every > 1 and p.options.execution.looped:
        p.set(SLOW_STEP, f"{SLOW_STEP}+1-{every}*step({SLOW_STEP}+1-{every})")
    _kick(p, p.options.slow_kicks[1], "after")


def _kick(p: Program, steps: float, where: str) -> None:
    every = p.options.slow_every
    if steps and p.options.execution.looped:
        with nullcontext() if every == 1 else p.when(f"{SLOW_STEP} < 1", f"do they kick {where} this step?"):
            p.phase(Phase.STORE)
            p.each("v", f"v+{steps!r}*dt*f/m", "kick by OpenMM's forces; the pair force stores x")
