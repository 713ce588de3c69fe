"""Integrator programs: their listings, the checks that OpenMM does not make, and that each holds no more than it needs."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import openmm
import pytest

from openmm_dpd import PlanError, ProgramError, TemperatureRamp
from openmm_dpd.names import ALONE, COUNTER, DT, KT, PARAMETERS, PHASE, PORTABLE, Phase
from openmm_dpd.plan import ProgramOptions
from openmm_dpd.programs import PROGRAMS, make_program, walls
from openmm_dpd.programs.program import Program, Step

GOLDEN = Path(__file__).parent / "golden"
BASE = ProgramOptions(scheme="mvv", dt=0.02, kT=1.0, seed=1)
RAMP = TemperatureRamp(1.0, 2.0, 10, 110)

#: Name of a variant -> what differs from BASE.
VARIANTS = {
    "kernel": dict(kernel_conservative=True, sole_force=True, settable=True),
    "kernel_and_others": dict(kernel_conservative=True),
    "openmm": dict(),
    "ramp": dict(kernel_conservative=True, sole_force=True, ramp=RAMP),
    "walls": dict(kernel_conservative=True, sole_force=True, walls="bounce-back"),
    "no_thermostat": dict(thermostat=False),
    "no_thermostat_kernel": dict(thermostat=False, kernel_conservative=True, sole_force=True),
}
CASES = {f"{scheme}_{name}": replace(BASE, scheme=scheme, **options) for scheme in PROGRAMS for name, options in VARIANTS.items()}
CASES["mvv_lambda_kernel"] = replace(BASE, lam=0.65, kernel_conservative=True, sole_force=True)
CASES["mvv_lambda_openmm"] = replace(BASE, lam=0.65)
CASES["middle_constraints"] = replace(BASE, scheme="middle", constraints=True)
CASES["middle_constraints_no_thermostat"] = replace(BASE, scheme="middle", constraints=True, thermostat=False)
CASES["bababo_energies"] = replace(
    BASE, scheme="bababo", kernel_conservative=True, sole_force=True, field_blocks=1, field_names="internal energy", trial=0.0078125
)
CASES["mvv_single_precision_drift"] = replace(BASE, tau_ratio=0.25)
#: Variables that are set from outside.
SET_FROM_OUTSIDE = {ALONE}


def ways(program: Program) -> list[list[Step]]:
    """Steps that may run one after the other: where no other force acts, and where some may; one list if that makes no difference."""
    found: dict[str, list[Step]] = {f"{ALONE} > 0": [], f"{ALONE} < 1": []}
    inside = None
    depth = 0
    for step in program.steps:
        depth += (step.kind == "if") - (step.kind == "end")
        if step.kind == "if" and step.expression in found:
            inside = step.expression
        elif inside is not None and depth == 0:
            inside = None
        else:
            for condition in found:
                if inside in (None, condition):
                    found[condition].append(step)
    return [*found.values()] if ALONE in program.globals_ else [program.steps]


CASE = pytest.mark.parametrize("options", CASES.values(), ids=CASES.keys())


@pytest.mark.parametrize("name", CASES)
def test_listing(name):
    """What a scheme does, step by step, as kept in golden/; OPENMM_DPD_UPDATE_GOLDEN=1 writes the files anew, for a reader to compare."""
    path, listing = GOLDEN / f"{name}.txt", make_program(CASES[name]).describe() + "\n"
    if os.environ.get("OPENMM_DPD_UPDATE_GOLDEN"):
        path.write_text(listing)
    assert listing == path.read_text(), f"the program changed; if that is right, write {path.name} anew"


def test_no_listing_is_left_over():
    assert {path.stem for path in GOLDEN.glob("*.txt")} == set(CASES)


@CASE
def test_integrator_holds_exactly_the_steps_of_the_program(options):
    program = make_program(options)
    integrator = program.lower()
    assert integrator.getNumComputations() == len(program.steps)
    kinds = {
        "global": integrator.ComputeGlobal,
        "per_dof": integrator.ComputePerDof,
        "sum": integrator.ComputeSum,
        "constrain_positions": integrator.ConstrainPositions,
        "constrain_velocities": integrator.ConstrainVelocities,
        "update": integrator.UpdateContextState,
        "if": integrator.IfBlockStart,
        "end": integrator.BlockEnd,
    }
    for k, step in enumerate(program.steps):
        kind, target, expression = integrator.getComputationStep(k)
        assert kind == kinds[step.kind]
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
        assert name in text.replace("(", " ").replace(")", " ").replace("+", " ").replace("-", " ").replace("*", " ").split(), name
        # where the walls are never changes
        assert any(step.target == name for step in program.steps) or name in walls.CONSTANTS or name in SET_FROM_OUTSIDE, name


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
def test_noise_is_drawn_once_per_step(options):
    """Also where the history is invalid: its noise is that of the last half kick."""
    program = make_program(options)
    for steps in ways(program):
        depth, drawn, inside = 0, 0, 0
        for step in steps:
            depth += (step.kind == "if") - (step.kind == "end")
            if step.target == COUNTER:
                assert step.expression == f"{COUNTER}+1"
                drawn, inside = drawn + (depth == 0), inside + (depth > 0)
        assert drawn == int(options.thermostat)
        assert inside == 0


@CASE
def test_kernel_learns_the_step_size_of_every_step(options):
    program = make_program(options)
    assert [step.expression for step in program.steps if step.target == DT] == (["dt"] if options.kernel else [])


@CASE
def test_nothing_that_is_not_needed(options):
    """No ramp: no ramp variable.  No kernel: none of its parameters.  No constraints: no constraint steps.  No history: no variable that keeps it."""
    program = make_program(options)
    targets = {step.target for step in program.steps}
    names = set(program.globals_) | set(program.per_dof) | targets
    assert ("ramp_step" in names) == (options.ramp is not None and options.thermostat)
    assert (KT in targets) == ((options.ramp is not None or options.settable) and options.thermostat)
    assert ("temperature" in names) == options.settable
    if not options.kernel:
        assert not names & set(PARAMETERS) and not program.globals_
        assert all(step.kind in ("per_dof", "update", "constrain_positions", "constrain_velocities") for step in program.steps)
    if not options.constraints:
        assert not any(step.kind.startswith("constrain") for step in program.steps)
    if options.scheme in ("middle", "aboba") or not options.kernel:
        assert "last" not in names
    if options.sole_force and options.thermostat and options.scheme in ("aboba", "bababo") and not (options.walls or options.field_blocks):
        alone = {name for step in ways(program)[0] for name in (step.target, *re.findall(r"\w+", step.expression))}
        assert not alone & set(program.per_dof)  # one evaluation does it all
    if options.scheme == "mvv" and options.lam == 0.5:
        assert "vp" not in names


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


@pytest.mark.parametrize(
    ("kind", "target", "expression", "message"),
    [
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
    ],
)
def test_mistakes_that_openmm_would_not_report(kind, target, expression, message):
    p = program()
    p.declare("k", 1.0, "a number")
    p.declare_per_dof("a", "something")
    getattr(p, kind)(target, expression)
    with pytest.raises(ProgramError, match=message):
        p.check()


@pytest.mark.parametrize("name", ["x", "v", "f", "m", "dt", "energy", "f7", "energy31", "gaussian", "sqrt", *PARAMETERS])
@pytest.mark.parametrize("per_dof", [False, True])
def test_a_variable_must_not_shadow_a_reserved_name(name, per_dof):
    p = program()
    p.declare_per_dof(name, "") if per_dof else p.declare(name, 0.0, "")
    with pytest.raises(ProgramError, match=f"'{name}' shadows"):
        p.check()


def test_parameters_of_the_kernel_are_unknown_without_one():
    p = Program("test", "nowhere", replace(BASE, thermostat=False))
    p.begin()
    p.set(COUNTER, f"{COUNTER}+1")
    with pytest.raises(ProgramError, match=COUNTER):
        p.check()


def test_blocks_and_updates_are_counted():
    p = program()
    p.if_changed()
    with pytest.raises(ProgramError, match="here|not closed"):
        p.check()
    p = program()
    p.begin()
    with pytest.raises(ProgramError, match="exactly once"):
        p.check()
    with pytest.raises(ProgramError, match="exactly once"):
        Program("test", "nowhere", BASE).check()


@pytest.mark.parametrize("scheme", [scheme for scheme in PROGRAMS if scheme != "middle"])
def test_constraints_need_a_scheme_that_keeps_them(scheme):
    with pytest.raises(PlanError, match=f"{scheme}.*middle"):
        make_program(replace(BASE, scheme=scheme, constraints=True))
