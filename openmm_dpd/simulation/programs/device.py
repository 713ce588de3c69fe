"""Programs where the plugin holds the pair terms: it reads OpenMM's velocities itself, so that no drift has to show them.

Either the plugin carries out a whole step when the Context's state is updated (phase RUN), or it is one force among others, which the lines
of a program evaluate: where constraints hold, and for modified velocity Verlet.
"""

from fractions import Fraction

from ...base.names import Phase
from ...model.schemes import SWEEPS
from ...plan.program_options import ProgramOptions
from .program import Program
from .splitting import Writer, spelling, times
from .walls import add_reflection


def device_program(options: ProgramOptions) -> Program:
    """The program of a scheme on the device."""
    if options.execution.steps == "device":
        return _whole_step(options)
    p = Program(options.scheme.name, options.scheme.reference, options)
    return _mvv(p) if options.predicting else DeviceWriter(p, options.scheme.steps(options.thermostat)).written()


def _whole_step(options: ProgramOptions) -> Program:
    """One step by the plugin."""
    p = Program(options.scheme.name, options.scheme.reference, options)
    p.begin()
    p.next_temperature()
    p.phase(Phase.RUN)
    p.update("a whole step by the pair force; barostats and other updates of the Context's state")
    sweeps = sum(letter in SWEEPS for letter, _ in options.scheme.steps(options.thermostat))
    if sweeps:
        p.set("dpd_counter", f"dpd_counter+{sweeps}", "noise that was used")
    return p


def _mvv(p: Program) -> Program:
    """Modified velocity Verlet, as :mod:`.mvv` has it; ``valid_for`` is 1 where ``acc`` is the acceleration at the present positions."""
    options = p.options
    p.declare_per_dof("acc", "acceleration at x, friction and noise included")
    p.declare("valid_for", -1.0, "1 where acc is valid")
    p.begin()
    with p.when("valid_for != 1", "is there no acceleration yet?"):
        _accelerate(p)
    predicted = options.lam != 0.5
    if predicted:
        p.declare_per_dof("vp", "predicted velocity")
        p.each("vp", f"v+{options.lam!r}*dt*acc", "what the friction will see")
    p.each("v", "v+0.5*dt*acc", "half kick")
    p.each("x", "x+dt*v", "drift")
    add_reflection(p, ("vp",) if predicted else ())
    p.next_temperature()
    p.set("dpd_counter", "dpd_counter+1", "new noise")
    if predicted:
        p.declare_per_dof("vh", "velocity after the first half kick")
        p.each("vh", "v")
        p.each("v", "vp", "shown to the pair force")
    _accelerate(p)
    p.each("v", f"{'vh' if predicted else 'v'}+0.5*dt*acc", "half kick")
    p.set("valid_for", "1")
    return p


def _accelerate(p: Program) -> None:
    """Acc from all forces, friction and noise included, at x and v."""
    p.phase(Phase.FORCE_SEEN)
    p.each("acc", "f/m" if p.options.execution.pushes else f"{p.pair_force}/m", "the pair force reads the velocities")
    if not p.options.execution.pushes:
        p.each("acc", "acc+f/m", "forces of others")
    p.leave_to_body_forces()


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
