"""Programs with the plugin's pair terms: the plugin reads OpenMM's velocities itself, so no drift has to pass them.

Either the plugin carries out a whole step when the Context's state is updated (phase RUN), or, with constraints, it is one force among
others that the lines of a program evaluate.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction

from ...base.names import AHEAD, DT, FIELD, KEPT, PHASE, RATE, SHEARED, TAKEN, Phase
from ...model.schemes import SWEEPS
from ...plan.program_options import ProgramOptions
from .program import Program
from .splitting import Writer, spelling, times
from .walls import add_reflection


def device_program(options: ProgramOptions) -> Program:
    """Program of a scheme with the plugin's pair terms."""
    p = Program(options.scheme.name, options.scheme.reference, options)
    if options.execution.steps == "device":
        p.declare("valid_for", -1.0, "where the acceleration at x is: 1 in acc, 0 or 2 in the pair force, -1 nowhere")
        return _verlet(p) if options.predicting else _word(p)
    return DeviceWriter(p, options.scheme.steps(options.thermostat)).written()


def _word(p: Program) -> Program:
    """Add a step by the plugin; a kick at the end of a step leaves its acceleration to one at the start of the next."""
    p.begin()
    fields = _hand_over(p)
    _run(p, sum(letter in SWEEPS for letter, _ in p.options.scheme.steps(p.options.thermostat)))
    if fields:
        with _drawing_alike(p, f"step(1.5-{AHEAD})", "1", "is it the last step of a call?"):
            _exchange_all(p, fields, give=False)
            p.set("valid_for", "-1")
    return _ended(p) if fields or p.options.impulses else p


def _ended(p: Program) -> Program:
    """Count the steps of a call; where nobody counts them, and asks the device after a call, add what walls have taken up."""
    p.declare(AHEAD, 0.0, "steps to the last one of a call")
    if p.options.impulses:
        with p.when(f"{AHEAD} < 1", "does nobody count the steps?"):
            for number, name in p.options.impulses:
                p.phase(Phase.EXCHANGE, TAKEN + number)
                p.set(name, f"{name}+{p.pair_energy}", "momentum that the wall has taken up since then")
    p.set(AHEAD, f"{AHEAD}-1")
    return p


def _hand_over(p: Program) -> dict[str, int]:
    """Add the lines by which the pair force takes over fields; returns their numbers for it."""
    fields = {name: KEPT[FIELD] + k for k, name in enumerate(p.fields())}
    if fields:
        with _drawing_alike(p, "abs(valid_for)", "1", "are fields those of the variables, and not of the pair force?"):
            _exchange_all(p, fields, give=True)
    return fields


def _exchange_all(p: Program, numbers: dict[str, int], *, give: bool) -> None:
    for name, number in numbers.items():
        _exchange(p, *(("v", name) if give else (name, "v")), number)


def _run(p: Program, draws: int) -> None:
    """Add the lines of a step that draws noise this many times."""
    p.next_temperature()
    p.set(PHASE, f"{int(Phase.RUN)}+step(-0.5-valid_for)+2*step(valid_for-1.5)", "RUN, anew where there is no acceleration")
    p.update("a whole step by the pair force; barostats and other updates of the Context's state")
    p.set("dpd_counter", f"dpd_counter+{draws}", "noise used in this step")
    letters = [("A", 1)] if p.options.predicting else p.options.scheme.steps(p.options.thermostat)
    for part in (float(part) for letter, part in letters if letter == "A" and p.options.sheared):
        p.set(SHEARED, f"{SHEARED}+{part!r}*dt", "duration of the shear, drift by drift, as the pair force adds it up")
    p.set("valid_for", "0")


def _verlet(p: Program) -> Program:
    """Modified velocity Verlet (:mod:`.mvv`) by the plugin, which keeps the acceleration from step to step, and detects by itself whether
    positions or the box have changed; states and checkpoints have it as ``acc`` after the last step of a call."""
    p.declare_per_dof("acc", "acceleration at x, with friction and noise")
    p.set("valid_for", f"select(delta(valid_for-1)*(1-delta({DT}-dt)), -1, valid_for)", "one from outside has the noise of its step size")
    p.begin()
    fields = _hand_over(p)
    rates = {f"{RATE}{k}": KEPT[RATE] + k for k in range(len(fields))}
    for name in rates:
        p.declare_per_dof(name, "change of the field per time, at x")
    if p.options.ramp is not None:  # before the temperature goes on: the noise is that of the last half kick
        with _drawing_alike(p, "valid_for", "-1", "is there no acceleration?"):
            p.phase(Phase.FORCE_SEEN)
            p.each("acc", f"{p.kicking}/m", "all forces, with friction of the present velocities")
            p.leave_to_body_forces()
            _exchange_all(p, rates, give=False)
            p.set("valid_for", "1")
    with _drawing_alike(p, "valid_for", "1", "is there an acceleration from outside?"):
        _exchange(p, "v", "acc")
        _exchange_all(p, rates, give=True)
    _run(p, 1)
    # steps of others, which nobody counts, all leave what beads carry behind
    with _drawing_alike(p, f"step(1.5-{AHEAD})" if fields else AHEAD, "1", "is it the last step of a call?"):
        _exchange(p, "acc", "v")
        if p.options.lam != 0.5:
            p.declare_per_dof("vp", "predicted velocity")
            _exchange(p, "vp", "v", 1)
        _exchange_all(p, fields | rates, give=False)
        p.set("valid_for", "1")
    return _ended(p)


@contextmanager
def _drawing_alike(p: Program, name: str, value: str, why: str) -> Iterator[None]:
    """A block that runs if a variable has a value.  OpenMM draws random numbers for every line, from the generator of barostats; if the
    block does not run, as many are drawn, so that volume moves do not depend on it."""
    begun = len(p.steps)
    with p.when(f"{name} = {value}", why):
        yield
    block = p.steps[begun:]
    del p.steps[begun:]
    with p.when(f"{name} != {value}", "random numbers are drawn for every line: as many in every step"):
        for _ in range(sum(step.kind == "global" for step in block)):
            p.set("valid_for", "valid_for")
    p.steps += block  # behind, since it may change the variable


def _exchange(p: Program, target: str, source: str, block: int = 0) -> None:
    """Assign while velocities are swapped with what the pair force keeps, during which it exerts no force."""
    other = source if target == "v" else target
    for name, value in ((target, source), (other, other)):
        p.phase(Phase.EXCHANGE, block)
        p.each(name, f"{value}+{p.pair_force}")


class DeviceWriter(Writer):
    """Writes the letters of a step on the device: nothing is stored or passed by drifts, and no acceleration is kept."""

    def __init__(self, program: Program, letters):
        super().__init__(program, letters)
        self.kept = self.known = False
        self.seen = True

    def drift(self, n: int, part: Fraction) -> int:
        """Write a drift; returns the number of the next letter."""
        self.settle()
        self.p.each("x", f"x+{times(part)}*v", spelling("drift", part))
        add_reflection(self.p)
        self.known = False
        return n + 1

    def sweep(self, n: int, part: Fraction) -> int:
        """Write a sweep, pair updates of the present velocities; returns the number of the next letter."""
        p = self.p
        self.settle()
        if not self.ramped:
            p.next_temperature()
            self.ramped = True
        p.set("dpd_counter", "dpd_counter+1", "new noise")
        if part != 1:
            p.set("dpd_dt", times(part), "duration of this sweep")
        p.phase(Phase.SWEEP_SEEN, SWEEPS.index(self.letters[n][0]))
        p.each("v", f"v+{times(part)}*{p.pair_force}/m", "sweep")
        p.constrain_velocities()
        if part != 1:
            p.set("dpd_dt", "dt")
        return n + 1
