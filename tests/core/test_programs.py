"""Integrator programs: their listings, the checks that OpenMM does not make, and that each holds no more than it needs."""

import os
import re
from dataclasses import replace
from pathlib import Path

import openmm
import pytest
from cases import cases, raises

from openmm_dpd import PlanError, ProgramError, TemperatureRamp
from openmm_dpd.base.names import AHEAD, COUNTER, DT, FIRST, KT, LAST, PARAMETERS, PHASE, PORTABLE, Phase
from openmm_dpd.model.schemes import SCHEMES, scheme_of
from openmm_dpd.plan.execution import Execution
from openmm_dpd.plan.program_options import ProgramOptions
from openmm_dpd.simulation.programs import make_program, walls
from openmm_dpd.simulation.programs.program import Program

GOLDEN = Path(__file__).parent / "golden"
BASE = ProgramOptions(scheme=SCHEMES["mvv"], dt=0.02, kT=1.0, seed=1, execution=Execution())
RAMP = TemperatureRamp(1.0, 2.0, 10, 110)
KERNEL = Execution(conservative="kernel")
LOOP = Execution(steps="loop", conservative="kernel")

VARIANTS = {  # Name of a variant -> what differs from BASE.
    "kernel": dict(execution=KERNEL, settable=True),
    "looped": dict(execution=LOOP),
    "openmm": dict(),
    "ramp": dict(execution=KERNEL, ramp=RAMP),
    "walls": dict(execution=KERNEL, walls="bounce-back"),
    "no_thermostat": dict(thermostat=False),
    "no_thermostat_kernel": dict(thermostat=False, execution=KERNEL),
}
#: Named schemes with a program, and words: a sweep at the end of a step that is kept, two sweeps, Shardlow's in the middle of a drift.
_WORDS = {"baoab": "B/2 A/2 O A/2 B/2", "obabo": "O/2 B/2 A B/2 O/2", "asab": "A/4 S A/4 B A/2"}
_LISTED = ("mvv", "shardlow", "middle", "aboba", "bababo")  # other names are words of the same letters
WORDS = {name: SCHEMES[name] for name in _LISTED} | {k: scheme_of(text) for k, text in _WORDS.items()}
CASES = {f"{name}_{variant}": replace(BASE, scheme=scheme, **VARIANTS[variant]) for name, scheme in WORDS.items() for variant in VARIANTS}
CASES["mvv_lambda_looped"] = replace(BASE, lam=0.65, execution=LOOP)
CASES["mvv_lambda_kernel"] = replace(BASE, lam=0.65, execution=KERNEL)
CASES["mvv_lambda_openmm"] = replace(BASE, lam=0.65)
CASES["mvv_fields_looped"] = replace(BASE, execution=LOOP, field_blocks=2, field_names="concentrations")
CASES["bababo_slow_looped"] = replace(BASE, scheme=SCHEMES["bababo"], execution=LOOP, slow_every=5)
CASES["middle_constraints"] = replace(BASE, scheme=SCHEMES["middle"], constraints=True)
CASES["middle_constraints_no_thermostat"] = replace(BASE, scheme=SCHEMES["middle"], constraints=True, thermostat=False)
ENERGIES = dict(scheme=SCHEMES["bababo"], execution=KERNEL, field_blocks=1, field_names="internal energy", trial=0.0078125)
CASES["bababo_energies"] = replace(BASE, **ENERGIES)
CASES["bababo_energies_compensated"] = replace(BASE, compensated=True, **ENERGIES)
CASES["middle_energies"] = replace(BASE, **ENERGIES | dict(scheme=SCHEMES["middle"]))
HEATED = dict(execution=KERNEL, fields_act=True, field_names="temperatures", trial=0.0078125)
CASES["bababo_temperatures"] = replace(BASE, **HEATED, scheme=SCHEMES["bababo"], field_blocks=1)
CASES["aboba_species"] = replace(BASE, **HEATED | dict(fields_act=False), scheme=SCHEMES["aboba"], field_blocks=2)
CASES["mvv_single_precision_drift"] = replace(BASE, tau_ratio=0.25)

CASE = pytest.mark.parametrize("options", CASES.values(), ids=CASES.keys())


COMMENTED = "middle_openmm"  # The case whose listing is kept with its comments.


def without_comments(listing: str) -> str:
    """A listing without what follows ``#`` in a line, and without the words that describe schemes and variables."""
    lines = [line.partition("#")[0].rstrip() for line in listing.splitlines()]
    lines[0] = lines[0].partition(" (")[0]
    return "\n".join(line.partition(": ")[0] if line.lstrip().startswith(("global ", "per DOF ")) else line for line in lines) + "\n"


@pytest.mark.parametrize("name", CASES)
def test_listing(name):
    """As kept in golden/, one of them with comments; OPENMM_DPD_UPDATE_GOLDEN=1 writes the files anew, for a reader to compare."""
    path, listing = GOLDEN / f"{name}.txt", make_program(CASES[name]).describe() + "\n"
    if name != COMMENTED:
        listing = without_comments(listing)
    if os.environ.get("OPENMM_DPD_UPDATE_GOLDEN"):
        path.write_text(listing)
    assert listing == path.read_text(), f"the program changed; if that is right, write {path.name} anew"
    assert {path.stem for path in GOLDEN.glob("*.txt")} == set(CASES), "a listing is left over"


@CASE
def test_integrator_holds_exactly_the_steps_of_the_program(options):
    program = make_program(options)
    integrator = program.lower()
    assert integrator.getNumComputations() == len(program.steps)
    kinds = {"global": "ComputeGlobal", "per_dof": "ComputePerDof", "sum": "ComputeSum", "update": "UpdateContextState"}
    kinds |= {"constrain_positions": "ConstrainPositions", "constrain_velocities": "ConstrainVelocities"}
    kinds |= {"if": "IfBlockStart", "end": "BlockEnd"}
    for k, step in enumerate(program.steps):
        kind, target, expression = integrator.getComputationStep(k)
        assert kind == getattr(integrator, kinds[step.kind])
        assert (target, expression) == (step.target, step.expression)
    portable = PORTABLE if options.kernel else ()
    names = [integrator.getGlobalVariableName(k) for k in range(integrator.getNumGlobalVariables())]
    assert names == sorted({*program.globals_, *portable})
    assert [integrator.getPerDofVariableName(k) for k in range(integrator.getNumPerDofVariables())] == sorted(program.per_dof)
    assert integrator.getStepSize().value_in_unit(openmm.unit.picosecond) == options.dt


# -- what every program must be --------------------------------------------------------------------------------------------------
@CASE
def test_every_variable_is_used(options):
    program = make_program(options)
    text = " ".join(f"{step.target} {step.expression}" for step in program.steps)
    for name in (*program.globals_, *program.per_dof):
        assert name in re.findall(r"[A-Za-z_]\w*", text), name
        constant = (*walls.CONSTANTS, FIRST, LAST)  # where the walls are never changes; the others are set from outside
        assert any(step.target == name for step in program.steps) or name in constant, name


@CASE
def test_phase_is_idle_again_at_the_end(options):
    """Reporters, minimizers and barostats must find the pair force idle; the barostat acts where the program updates the Context's state."""
    program = make_program(options)
    phases = [step.expression for step in program.steps if step.target == PHASE]
    if options.kernel:
        assert phases[-1] == str(int(Phase.IDLE))
        update = next(k for k, step in enumerate(program.steps) if step.kind == "update")
        assert [step.expression for step in program.steps[:update] if step.target == PHASE] == [str(int(Phase.IDLE))]
    else:
        assert not phases


@CASE
def test_each_sweep_draws_new_noise(options):
    """Not where the history is invalid: its noise is that of the last half kick."""
    program = make_program(options)
    depth, drawn, inside = 0, 0, 0
    for step in program.steps:
        depth += (step.kind == "if") - (step.kind == "end")
        if step.target == COUNTER:
            found = re.fullmatch(rf"{COUNTER}\+(\d)", step.expression)
            drawn, inside = drawn + int(found[1]), inside + (depth > options.execution.looped)
    sweeps = sum(letter in "OS" for letter, _ in options.scheme.letters) or 1
    assert drawn == (sweeps if options.thermostat else 0)
    assert inside == 0


@CASE
def test_kernel_learns_the_step_size_of_every_step(options):
    program = make_program(options)
    sizes = [step.expression for step in program.steps if step.target == DT]
    if "O/2" in options.scheme.word and options.thermostat:  # half a sweep lasts half a step
        assert sizes == ["dt", "0.5*dt", "dt", "0.5*dt", "dt"]
    else:
        assert sizes == (["dt"] if options.kernel else [])


@CASE
def test_nothing_that_is_not_needed(options):
    """No ramp: no ramp variable.  No kernel: none of its parameters.  No constraints: no constraint steps.  No history: no variable that keeps it."""
    program = make_program(options)
    targets = {step.target for step in program.steps}
    names = set(program.globals_) | set(program.per_dof) | targets
    assert ("ramp_step" in names) == (options.ramp is not None and options.thermostat)
    assert (AHEAD in names) == options.execution.looped
    assert (KT in targets) == ((options.ramp is not None or options.settable) and options.thermostat)
    assert ("temperature" in names) == options.settable
    if not options.kernel:
        assert not names & set(PARAMETERS) and not program.globals_
        assert all(step.kind in ("per_dof", "update", "constrain_positions", "constrain_velocities") for step in program.steps)
    if not options.constraints:
        assert not any(step.kind.startswith("constrain") for step in program.steps)
    starts_and_ends_with_kicks = options.scheme.name in ("shardlow", "bababo", "baoab", "O/2 B/2 A B/2 O/2", "B/2 A/2 O A/2 B/2", "mvv")
    assert ("valid_for" in names) == (options.kernel and starts_and_ends_with_kicks and not options.fields_act)
    assert ("xs" in names) == (options.thermostat and _displaced(options))
    if options.predicting and options.lam == 0.5:
        assert "vp" not in names


def _displaced(options) -> bool:
    """Whether x has to be put back: where no drift shows the velocities to a sweep, and where more than velocities is shown."""
    return options.predicting or not re.search(r"A\S* [OS]", options.scheme.word) or bool(options.walls or options.field_blocks)


@pytest.mark.parametrize("variant", ["kernel", "openmm"])
@pytest.mark.parametrize(("scheme", "most"), [("middle", 4), ("aboba", 6), ("shardlow", 6), ("bababo", 9)])
def test_lines_of_a_step(scheme, most, variant):
    """Each costs as much as a good part of a pass over the pairs on the CPU platform: no more than a hand would write."""
    steps = make_program(CASES[f"{scheme}_{variant}"]).steps
    inside, count = 0, 0
    for step in steps:
        inside += (step.kind == "if") - (step.kind == "end")
        count += step.kind == "per_dof" and not inside
    assert count <= most and len(Phase) <= 12


# -- the checks ------------------------------------------------------------------------------------------------------------------
def program(**options) -> Program:
    p = Program("test", "nowhere", replace(BASE, **options))
    p.begin()
    return p


def test_a_good_program_passes():
    p = program()
    p.declare("k", 1.0, "a number")
    p.declare_per_dof("a", "something")
    p.set("k", "k+1e-3*dpd_kT")
    p.each("a", "f31/m + sqrt(k)*gaussian*2.5E2")
    p.check()


@cases(
    "kind, target, expression, message",
    ("each", "v", "v+dt*acel/m", "unknown name acel"),
    ("each", "v", "v+dt*F/m", "unknown name F"),
    ("set", "k", "k+dpd_KT", "unknown name dpd_KT"),
    ("each", "v", "sqr(v)", "unknown name sqr"),
    ("each", "v", "v+f32", "unknown name f32"),
    ("each", "vel", "v", "'vel' was not declared"),
    ("set", "v", "1", "'v' was not declared"),
    ("set", "dt", "1", "'dt' was not declared"),
    ("each", "k", "v", "'k' was not declared"),
    ("each", "f", "v", "'f' was not declared"),
    ("each", "v", "f+f31", "one force group"),
    ("each", "v", "f1/m+f2/m", "one force group"),
    ("set", "k", "energy+energy31", "one force group"),
    ("set", "k", "a+1", "'a'"),
    ("set", "k", "x*2", "'x'"),
)
def test_mistakes_that_openmm_would_not_report(kind, target, expression, message):
    p = program()
    p.declare("k", 1.0, "a number")
    p.declare_per_dof("a", "something")
    getattr(p, kind)(target, expression)
    raises(ProgramError, message, p.check)


@pytest.mark.parametrize("name", ["x", "v", "f", "m", "dt", "energy", "f7", "energy31", "gaussian", "sqrt", *PARAMETERS])
@pytest.mark.parametrize("per_dof", [False, True])
def test_a_variable_must_not_shadow_a_reserved_name(name, per_dof):
    p = program()
    p.declare_per_dof(name, "") if per_dof else p.declare(name, 0.0, "")
    raises(ProgramError, f"'{name}' shadows", p.check)


def test_parameters_blocks_and_updates_are_checked():
    p = program(thermostat=False)  # which has no kernel
    p.set(COUNTER, f"{COUNTER}+1")
    raises(ProgramError, COUNTER, p.check)
    p = program()
    p.if_changed().__enter__()
    raises(ProgramError, "fingerprint|not closed", p.check)
    p = program()
    p.begin()
    raises(ProgramError, "exactly once", p.check)
    raises(ProgramError, "exactly once", lambda: Program("test", "nowhere", BASE).check())


@pytest.mark.parametrize("name", [name for name in WORDS if not WORDS[name].constraints])
def test_constraints_need_a_scheme_that_keeps_them(name):
    raises(PlanError, f"{re.escape(WORDS[name].name)}.*middle", lambda: make_program(replace(BASE, scheme=WORDS[name], constraints=True)))
