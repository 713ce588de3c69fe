"""Programs where the plugin holds the pair terms: it reads OpenMM's velocities itself, so that no drift has to show them.

Either the plugin carries out a whole step when the Context's state is updated (phase RUN), or it is one force among others, which the lines
of a program evaluate: where constraints hold.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction

from ...base.names import AHEAD, PHASE, Phase
from ...model.schemes import SWEEPS
from ...plan.program_options import ProgramOptions
from .program import Program
from .splitting import Writer, spelling, times
from .walls import add_reflection


def device_program(options: ProgramOptions) -> Program:
    """The program of a scheme on the device."""
    p = Program(options.scheme.name, options.scheme.reference, options)
    if options.execution.steps == "device":
        return _verlet(p) if options.predicting else _word(p)
    return DeviceWriter(p, options.scheme.steps(options.thermostat)).written()


def _word(p: Program) -> Program:
    """One step by the plugin; a kick at the end of a step leaves its acceleration to one at the beginning of the next."""
    p.begin()
    _run(p, sum(letter in SWEEPS for letter, _ in p.options.scheme.steps(p.options.thermostat)))
    return p


def _run(p: Program, draws: int) -> None:
    """A step, with new noise so many times."""
    p.declare("valid_for", -1.0, "who has the acceleration at x: 1 acc, 0 or 2 the pair force alone, -1 nobody")
    p.next_temperature()
    p.set(PHASE, f"{int(Phase.RUN)}+step(-0.5-valid_for)+2*step(valid_for-1.5)", "RUN, anew where there is no acceleration")
    p.update("a whole step by the pair force; barostats and other updates of the Context's state")
    p.set("dpd_counter", f"dpd_counter+{draws}", "noise that was used")
    p.set("valid_for", "0")


def _verlet(p: Program) -> Program:
    """Modified velocity Verlet, as :mod:`.mvv` has it, by the plugin.  It keeps the acceleration from step to step, and finds out by itself
    where positions or the box have changed; states and checkpoints have it as ``acc`` after the last step of a call."""
    p.declare_per_dof("acc", "acceleration at x, friction and noise included")
    p.declare(AHEAD, 0.0, "steps to the last one of a call")
    p.begin()
    with _drawing_alike(p, "valid_for", "1", "did somebody bring an acceleration?"):
        _exchange(p, "v", "acc")
    _run(p, 1)
    with _drawing_alike(p, AHEAD, "1", "is it the last step of a call?"):
        _exchange(p, "acc", "v")
        if p.options.lam != 0.5:
            p.declare_per_dof("vp", "predicted velocity")
            _exchange(p, "vp", "v", 1)
        p.set("valid_for", "1")
    p.set(AHEAD, f"{AHEAD}-1")
    return p


@contextmanager
def _drawing_alike(p: Program, name: str, value: str, why: str) -> Iterator[None]:
    """A block that runs where a variable has a value.  OpenMM draws numbers for every line, from where barostats draw theirs: where
    the block does not run there are as many, so that moves do not depend on it."""
    begun = len(p.steps)
    with p.when(f"{name} = {value}", why):
        yield
    lines = sum(step.kind == "global" for step in p.steps[begun:])
    with p.when(f"{name} != {value}", "numbers are drawn for every line: as many in every step"):
        for _ in range(lines):
            p.set(name, name)


def _exchange(p: Program, target: str, source: str, block: int = 0) -> None:
    """Assign while the velocities and what the pair force keeps have changed places; it exerts no force then."""
    for name, value in ((target, source), ("acc", "acc")):
        p.phase(Phase.EXCHANGE, block)
        p.each(name, f"{value}+{p.pair_force}")


class DeviceWriter(Writer):
    """Letters of a step: nothing has to be stored or shown, and no acceleration is kept."""

    def __init__(self, program: Program, letters):
        super().__init__(program, letters)
        self.kept = self.known = False
        self.seen = True

    def drift(self, n: int, part: Fraction) -> int:
        """Drift."""
        self.settle()
        self.p.each("x", f"x+{times(part)}*v", spelling("drift", part))
        add_reflection(self.p)
        self.known = False
        return n + 1

    def sweep(self, n: int, part: Fraction) -> int:
        """Sweep: pair updates of the velocities as they are."""
        p = self.p
        self.settle()
        if not self.ramped:
            p.next_temperature()
            self.ramped = True
        p.set("dpd_counter", "dpd_counter+1", "new noise")
        if part != 1:
            p.set("dpd_dt", times(part), "how long this sweep lasts")
        p.phase(Phase.SWEEP_SEEN, SWEEPS.index(self.letters[n][0]))
        p.each("v", f"v+{times(part)}*{p.pair_force}/m", "sweep")
        p.constrain_velocities()
        if part != 1:
            p.set("dpd_dt", "dt")
        return n + 1
