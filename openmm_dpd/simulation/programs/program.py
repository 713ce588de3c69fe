"""A program as data: declared variables and steps, checked before OpenMM sees them.

On the Reference and CPU platforms OpenMM evaluates a misspelt name in an integrator expression as 0, without an error.  So every name is
checked here.
"""

import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field

import openmm

from ...base import names as shared
from ...base.errors import ProgramError
from ...base.units import BOLTZMANN
from ...plan.program_options import ProgramOptions
from ..integrators import AGREE, PairIntegrator

_ENERGIES = frozenset({"energy"} | {f"energy{g}" for g in range(32)})
_PER_DOF = frozenset({"x", "v", "f", "m"} | {f"f{g}" for g in range(32)})
_RESERVED = frozenset({"dt", "gaussian", "uniform"}) | _ENERGIES | _PER_DOF
_FUNCTIONS = frozenset(
    "sqrt exp log sin cos sec csc tan cot asin acos atan atan2 sinh cosh tanh erf erfc".split()
    + "step delta square cube recip min max abs floor ceil select".split()
    + "dot cross vector _x _y _z".split()
)
_NAME = re.compile(r"(?<![\w.])[A-Za-z_]\w*")


@dataclass(frozen=True)
class Step:
    """One line of a program: ``kind`` is global, sum, per_dof, constrain_positions, constrain_velocities, update, if or end."""

    kind: str
    target: str = ""
    expression: str = ""
    why: str = ""


@dataclass
class Program:
    """An integrator program under construction."""

    name: str  #: Scheme
    reference: str  #: Publication of the scheme
    options: ProgramOptions  #: Choices that determine the lines
    globals_: dict[str, tuple[float, str]] = field(default_factory=dict)  #: Global variables: initial values and meanings
    per_dof: dict[str, str] = field(default_factory=dict)  #: Meanings of the per-DOF variables, which are 0 at the start
    steps: list[Step] = field(default_factory=list)

    @property
    def pair_force(self) -> str:
        """Expression of the pair force's own force."""
        return f"f{self.options.pair_group}"

    @property
    def kicking(self) -> str:
        """Expression of the force in kicks: of all forces, or of the pair force only where a loop could carry out the step."""
        return self.pair_force if self.options.execution.looped else "f"

    @property
    def field_change(self) -> str:
        """Expression of the change of the fields by the last evaluation of the pair force, in phase CHANGE."""
        scale = self.options.field_scale
        return f"{scale!r}*{self.pair_force}" if scale != 1.0 else self.pair_force

    @property
    def pair_energy(self) -> str:
        """Name of the pair force's own energy."""
        return f"energy{self.options.pair_group}"

    # -- writing ---------------------------------------------------------------------------------------------------------------
    def declare(self, name: str, value: float, why: str) -> None:
        """Declare a global variable."""
        self.globals_[name] = (value, why)

    def declare_per_dof(self, name: str, why: str) -> None:
        """Declare a variable with one value per degree of freedom, 0 at the start."""
        self.per_dof[name] = why

    def set(self, target: str, expression: str, why: str = "") -> None:
        """Assign to a global variable or context parameter."""
        self.steps.append(Step("global", target, expression, why))

    def each(self, target: str, expression: str, why: str = "") -> None:
        """Assign to x, v or a per-DOF variable, for each degree of freedom."""
        self.steps.append(Step("per_dof", target, expression, why))

    def total(self, target: str, expression: str, why: str = "") -> None:
        """Assign the sum of an expression over all degrees of freedom to a global variable."""
        self.steps.append(Step("sum", target, expression, why))

    def phase(self, phase: shared.Phase, block: int = 0) -> None:
        """Set what the next evaluation of the pair force computes."""
        self.set(shared.PHASE, str(int(phase) + block), phase.name + (f" {block}" if phase >= shared.Phase.SWEEP_SEEN else ""))

    def begin(self) -> None:
        """Add the lines at the start of every step: barostats, the present dt for the kernel, and the valid temperature."""
        if self.options.kernel:
            # an error within a step leaves another phase behind, and barostats need energies
            self.phase(shared.Phase.IDLE)
        if self.options.execution.steps != "device":
            self.update("barostats and other updates of the Context's state")
        if self.options.execution.looped:
            self.declare(shared.AHEAD, 0.0, "steps already done, in which only barostats still act")
            self.steps.append(Step("if", expression=f"{shared.AHEAD} < 1", why="is this step still to be done?"))
        for k, value in enumerate(self.options.numbers):
            self.declare(f"{shared.GUIDE}{k}", value, "what acts within steps keeps it")
        for k in range(self.options.bond_blocks):
            self.declare_per_dof(f"{shared.BONDS}{k}", "bonds that form and break: 1 + partner + N sort")
        if self.options.kernel:
            self.set(shared.DT, "dt", "so that setStepSize works")
        if self.options.fields_act and not self.options.execution.on_device:
            self.set(shared.SHOWN, "0", "the temperatures on which forces depend will be others")
        if self.options.settable:
            kelvin = self.options.kT / BOLTZMANN
            self.declare(shared.TEMPERATURE, kelvin, "temperature, K: set it here or by dpd_kT, the later one holds")
            self.declare(shared.SEEN_TEMPERATURE, kelvin, "its value when it last agreed with dpd_kT")
            self.declare(shared.SEEN_KT, self.options.kT, "the value of dpd_kT then")
            self.steps += [Step(*line) for line in AGREE]

    def update(self, why: str) -> None:
        """Add an update of the Context's state, in which barostats act."""
        self.steps.append(Step("update", why=why))

    def finish(self) -> None:
        """Add the lines at the end of every step, which close those of :meth:`begin`; what a loop of steps left is no longer valid."""
        if self.options.kernel:
            self.phase(shared.Phase.IDLE)
        kept = self.options.field_blocks or self.options.predicting or self.options.bond_blocks
        if self.options.kernel and not self.options.execution.on_device and kept:
            self.declare(shared.STAMP, 0.0, "fingerprint of the per-DOF variables that a loop of steps left, or 0")
            self.set(shared.STAMP, "0")
        if self.options.execution.looped:
            self.set(shared.AHEAD, "1")
            self.steps.append(Step("end"))
            self.set(shared.AHEAD, f"{shared.AHEAD}-1")

    def show_by(self, tau: str) -> None:
        """Set tau, the time of the drift that passes the velocities to the pair force."""
        self.set(shared.TAU, tau, "the drift that passes the velocities")

    def next_noise(self, tau: str) -> None:
        """Advance the noise counter, and set tau, the time of the drift that passes the velocities."""
        self.show_by(tau)
        self.set(shared.COUNTER, f"{shared.COUNTER}+1", "new noise")

    def next_temperature(self) -> None:
        """Advance the temperature ramp, if there is one."""
        ramp = self.options.ramp
        if ramp is None or not self.options.kernel:
            return
        self.declare(shared.RAMP_STEP, 0.0, "steps done, for the temperature ramp")
        self.set(shared.RAMP_STEP, f"{shared.RAMP_STEP}+1")
        self.set(shared.KT, ramp_expression(ramp, shared.RAMP_STEP), "kT of this step")

    def store_fingerprint(self, left: list[str] | tuple = ()) -> None:
        """Have the pair force store the present positions; set the fingerprint of them, and of the velocities or fields in ``left``."""
        self.declare("fingerprint", 0.0, "fingerprint of the present positions and parameters")
        if left:
            self.declare(shared.FIRST, 1.0, "whether this step is the first one of a call")
            self.declare("changed", 0.0, "number of velocities and fields changed since the last call")
            with self.when(f"{shared.FIRST} > 0", "may they have been changed?"):
                self.total("changed", f"{len(left)}-{'-'.join(f'delta({name}-{shared.LEFT}{name})' for name in left)}")
        self.phase(shared.Phase.FINGERPRINT)
        self.set("fingerprint", f"{self.pair_energy}{f'+{shared.FIRST}*changed' if left else ''}", "the pair force stores x")

    def evaluate_pair_force(self, phase: shared.Phase, why: str, block: int = 0) -> None:
        """Evaluate the pair force for its side effect, such as storing positions; the energy that it returns is not used."""
        self.declare("unused", 0.0, "energy of evaluations for their side effect")
        self.phase(phase, block)
        self.set("unused", self.pair_energy, why)

    def store(self) -> None:
        """Have the pair force store the present positions, without a fingerprint."""
        self.evaluate_pair_force(shared.Phase.STORE, "the pair force stores x")

    def show(self, velocity: str) -> None:
        """Add a trial drift by tau*velocity from xs, which passes this velocity to the pair force; x has to be restored afterwards."""
        self.each("x", f"xs+{shared.TAU}*{velocity}", "trial drift: passes this velocity")

    def fields(self) -> list[str]:
        """Declare the per-DOF variables with internal energies, temperatures or concentrations, and return their names."""
        names = [f"{shared.FIELD}{k}" for k in range(self.options.field_blocks)]
        for name in names:
            self.declare_per_dof(name, self.options.field_names)
        return names

    def read(self, variables: list[str]) -> None:
        """Have the pair force read per-DOF variables, as displacements from xs, its stored positions; x has to be restored.

        The displacement is scaled so that the largest one stays below ``options.field_reach``.
        """
        for block, variable in enumerate(variables):
            self.declare("size", 0.0, "sum of squares of what the pair force reads next")
            self.total("size", f"{variable}*{variable}")
            self.set(shared.TAU, f"{self.options.field_reach!r}/sqrt(size+1e-280)", "scale of the displacement")
            self.each("x", f"xs+{shared.TAU}*{variable}", "passes these values")
            self.evaluate_pair_force(shared.Phase.READ, "the pair force reads them", block)

    def read_at_rest(self) -> None:
        """Have the pair force read the fields at its stored positions, and restore the positions."""
        self.keep_positions()
        self.read(self.fields())
        self.each("x", "xs", "back")

    def keep_positions(self) -> None:
        """Store x as xs."""
        self.declare_per_dof("xs", "positions before the trial drift")
        self.each("xs", "x")

    def keep_acceleration(self) -> None:
        """Reuse the conservative acceleration of the last step, or compute it anew if something has changed since."""
        self.declare_per_dof("acc", "conservative acceleration at x")
        self.store_fingerprint()
        with self.if_changed():
            if self.options.execution.pushes:
                self.phase(shared.Phase.CONSERVE)
            self.each("acc", f"{self.kicking}/m", "conservative acceleration")
            self.leave_to_body_forces()

    def leave_to_body_forces(self) -> None:
        """Replace the last acceleration by that of body forces, where only these act."""
        if self.options.partial:
            self.declare_per_dof(shared.ALONE, "1 where only body forces act, 0 elsewhere")
            self.each("acc", f"(1-{shared.ALONE})*acc+{shared.ALONE}*f{shared.EXTERNAL_GROUP}/m", "only body forces act on some beads")

    def acceleration_is_kept(self, left: list[str] | tuple = ()) -> None:
        """Mark the last acceleration of a step as valid for the next one, unless velocities or fields of these names have changed then."""
        self.store_fingerprint()
        self.set("valid_for", "fingerprint", "acc is valid for this")
        if left:
            self.declare(shared.LAST, 1.0, "whether this step is the last one of a call")
            with self.when(f"{shared.LAST} > 0", "may they be changed before the next step?"):
                for name in left:
                    self.declare_per_dof(shared.LEFT + name, "value at the end of a call")
                    self.each(shared.LEFT + name, name)

    def after_sweep(self, fields: list[str]) -> None:
        """Apply the changes of the fields by a sweep.  If velocities are not double precision, internal energies change by what these
        really changed.

        The kernel then returns the total energy that a bead gained, including its motion; the part of the motion follows from the
        program's velocities, and the rounding of the sum is kept in the third component.
        """
        if not fields:
            return
        if not self.options.compensated:
            for block, name in enumerate(fields):
                self.phase(shared.Phase.CHANGE, block)
                self.each(name, f"{name}+{self.field_change}", "change by the sweep")
            return
        (u,) = fields
        self.phase(shared.Phase.CHANGE)
        for name, why in (("du", "change of the energies"), ("un", "energies before the correction of rounding")):
            self.declare_per_dof(name, why)
        self.each("du", f"{self.field_change}-vector(0, 0.5*m*dot(v-vi, v+vi), 0)", "energy gained, less that of motion")
        self.each("un", f"{u}+du")
        self.each("du", f"du-(un-{u})", "less the rounding error")
        self.each(u, "un+vector(0, 0, _x(du)+_y(du))", "which the third component keeps")

    def before_sweep(self) -> None:
        """Store the velocities at the start of a sweep, if they are needed afterwards."""
        if self.options.field_blocks and self.options.compensated:
            self.declare_per_dof("vi", "velocities before the sweep")
            self.each("vi", "v")

    def if_changed(self) -> AbstractContextManager[None]:
        """A block that runs in the first step, and whenever the fingerprint is not that at the end of the last step."""
        self.declare("valid_for", -1.0, "fingerprint at which the stored acceleration is valid")
        return self.when("fingerprint != valid_for", "is the stored acceleration still valid?")

    @contextmanager
    def when(self, condition: str, why: str) -> Iterator[None]:
        """A block that runs if a condition on global variables holds."""
        self.steps.append(Step("if", expression=condition, why=why))
        yield
        self.steps.append(Step("end"))

    def constrain_positions(self) -> None:
        """Apply constraints of distances, and place virtual sites."""
        self.steps.append(Step("constrain_positions"))

    def constrain_velocities(self) -> None:
        """Remove velocities along constraints."""
        if self.options.constraints:
            self.steps.append(Step("constrain_velocities"))

    # -- checking and building ---------------------------------------------------------------------------------------------------
    def check(self) -> None:
        """Raise ProgramError for an unknown or shadowed name, or a line with two kinds of force."""
        more = {shared.SHOWN, shared.SHEARED, *dict(self.options.impulses).values()}
        context = {*shared.PARAMETERS, *more} if self.options.kernel else set()
        everywhere = set(self.globals_) | context | _RESERVED
        for name in [*self.globals_, *self.per_dof]:
            if name in _RESERVED or name in _FUNCTIONS or name in shared.PARAMETERS:
                raise ProgramError(f"{self.name}: the variable {name!r} shadows a reserved name")
        targets = {"global": set(self.globals_) | context, "sum": set(self.globals_), "per_dof": set(self.per_dof) | {"x", "v"}}
        depth = 0
        for number, step in enumerate(self.steps):
            where = f"{self.name}, step {number} ({step.target} <- {step.expression})"
            if step.kind in targets and step.target not in targets[step.kind]:
                raise ProgramError(f"{where}: {step.target!r} was not declared")
            names = set(_NAME.findall(step.expression))
            per_dof = names & (_PER_DOF | set(self.per_dof))
            if per_dof and step.kind not in ("per_dof", "sum"):
                listing = ", ".join(map(repr, sorted(per_dof)))
                raise ProgramError(f"{where}: {listing} has one value per degree of freedom and cannot be in a global expression")
            unknown = names - everywhere - set(self.per_dof) - _FUNCTIONS
            if unknown:
                raise ProgramError(f"{where}: unknown name {', '.join(sorted(unknown))}")
            if len({name for name in names if re.fullmatch(r"f\d*|energy\d*", name)}) > 1:
                raise ProgramError(f"{where}: OpenMM allows one force group per step")
            depth += (step.kind == "if") - (step.kind == "end")
        if depth:
            raise ProgramError(f"{self.name}: a block is not closed")
        if sum(step.kind == "update" for step in self.steps) != 1:
            raise ProgramError(f"{self.name}: a step must update the Context's state exactly once")

    def lower(self) -> PairIntegrator:
        """The OpenMM integrator of the program."""
        integrator = PairIntegrator(self.options.dt)
        # barostats draw from a generator of the whole process, which a new Context finally seeds with this number
        openmm.CustomIntegrator.setRandomNumberSeed(integrator, self.options.openmm_seed)
        portable = dict.fromkeys(shared.PORTABLE if self.options.kernel else (), (0.0, ""))
        # in an order that does not depend on the lines of a step, since a checkpoint has no names
        for name, (value, _) in sorted((portable | self.globals_).items()):
            integrator.addGlobalVariable(name, value)
        for name in sorted(self.per_dof):
            integrator.addPerDofVariable(name, 0.0)
        add = {
            "global": lambda s: integrator.addComputeGlobal(s.target, s.expression),
            "per_dof": lambda s: integrator.addComputePerDof(s.target, s.expression),
            "sum": lambda s: integrator.addComputeSum(s.target, s.expression),
            "constrain_positions": lambda s: integrator.addConstrainPositions(),
            "constrain_velocities": lambda s: integrator.addConstrainVelocities(),
            "update": lambda s: integrator.addUpdateContextState(),
            "if": lambda s: integrator.beginIfBlock(s.expression),
            "end": lambda s: integrator.endBlock(),
        }
        for step in self.steps:
            add[step.kind](step)
        return integrator

    def describe(self) -> str:
        """Listing of the program: one line per step, with its reason."""
        lines = [f"program {self.name} ({self.reference})"]
        lines += [f"  global  {name} = {value:g}: {why}" for name, (value, why) in self.globals_.items()]
        lines += [f"  per DOF {name}: {why}" for name, why in self.per_dof.items()]
        indent = 0
        for number, step in enumerate(self.steps):
            indent -= step.kind == "end"
            text = {
                "global": f"{step.target} <- {step.expression}",
                "per_dof": f"{step.target} <- {step.expression}  (each)",
                "sum": f"{step.target} <- sum of {step.expression}",
                "if": f"if {step.expression}:",
            }.get(step.kind, step.kind.replace("_", " "))
            width = 52 - 2 * indent
            why = f"{'' if len(text) < width else '  '}# {step.why}" if step.why else ""
            lines.append(f"  {number:3d}  {'  ' * indent}{text:<{width}}{why}".rstrip())
            indent += step.kind == "if"
        return "\n".join(lines)


def ramp_expression(ramp, steps: str) -> str:
    """Expression of kT on a temperature ramp after ``steps``, with the reciprocal of its length, since OpenMM divides so by constants."""
    part = f"({steps}-({ramp.first_step}))*{1.0 / (ramp.last_step - ramp.first_step)!r}"
    return f"{ramp.kT_start!r}+({ramp.kT_end - ramp.kT_start!r})*min(1, max(0, {part}))"
