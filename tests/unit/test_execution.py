"""Who computes what: one record, made in one place, with a reason for everything, which is what ``explain`` prints."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from import_graph import PATHS, ROOT
from kinds import KINDS, chains

import openmm_dpd as dpd
from openmm_dpd.plan.forces.bonded import MOLECULES
from openmm_dpd.simulation.build import build_plan

SOURCES = {path: (ROOT / path).read_text(encoding="utf-8") for path in PATHS.values()}

#: Kinds of bonds, angles and dihedrals that are here.
BONDED = {
    **{"harmonic bonds": dpd.HarmonicBonds, "FENE bonds": dpd.FENEBonds, "Morse bonds": dpd.MorseBonds},
    **{"harmonic angles": dpd.HarmonicAngles, "cosine angles": dpd.CosineAngles, "OPLS dihedrals": dpd.OPLSDihedrals},
}

#: Parts of a scene, and where it has them.
PARTS = {
    **{name: lambda plan, kind=kind: any(type(group) is kind for group in plan.scene.bonded) for name, kind in BONDED.items()},
    "overlays": lambda plan: plan.overlays,
    "segments": lambda plan: plan.scene.segments,
    "body forces": lambda plan: any(isinstance(term, dpd.BodyForce) for term in plan.scene.body_forces),
    "walls": lambda plan: plan.scene.walls,
    "charges": lambda plan: plan.scene.electrostatics,
}


def found(pattern: str) -> list[str]:
    """Files in which a pattern occurs, once for each time."""
    return [path for path, text in SOURCES.items() for _ in re.findall(pattern, text)]


def test_there_are_no_flags_beside_it():
    assert not found(r"unlooped|charges_held|kernel_conservative|options\.loop\b|whole_steps *[:=]|options\.whole_steps")


def test_it_is_made_in_one_place():
    assert [path.rpartition("/")[2] for path in found(r"\bExecution\(")] == ["plan.py"]


def test_engines_are_made_in_one_place():
    """Others ask for one by its name."""
    assert found(r"(?<!class )\bPairEngine\(") == ["openmm_dpd/kernels/engine.py"]
    assert set(found(r"\bPairEngine\b")) == {"openmm_dpd/kernels/engine.py"}
    assert set(found(r"\bhost_engine\b")) == {"openmm_dpd/kernels/engine.py", "openmm_dpd/kernels/engines.py"}
    assert len(found(r"\.make\(")) == 2  # of the pair force, of a plan


def dihedrals() -> dpd.Scene:
    """Everything that may be beside pair terms."""
    return chains(electric=True, dihedrals=[dpd.OPLSDihedrals(np.arange(48).reshape(12, 4), 1, -2, 3, 0.5)])


def plans():
    for kind, scene in {**KINDS, "dihedrals": dihedrals}.items():
        for choices in ({}, {"loop": False}, {"scheme": "native"}, {"conservative": "openmm"}, {"platform": "OpenCL"}):
            try:
                yield kind, dpd.make_plan(scene(), **{"dt": 0.01, "scheme": "mvv", "platform": "Reference", "seed": 1} | choices)
            except dpd.PlanError:
                pass


def test_everything_has_a_reason_that_is_told():
    steps = set()
    for kind, plan in plans():
        execution, text = plan.execution, dpd.explain_plan(plan)
        parts = {name for name, there in PARTS.items() if there(plan)}
        assert set(execution.why) == {"engine", "steps", "conservative", "precision"} | parts, kind
        assert execution.held <= parts and (not execution.held or execution.looped)
        for name, why in execution.why.items():
            assert f"({why})" in text or (name == "engine" and "pair kernel: host" not in text), (kind, why)
        for part in parts:
            assert re.search(rf"^[\w, ]*\b{part}\b[\w, ]*: {'in' if part in execution.held else 'outside of'} the pair kernel", text, re.M)
        steps.add(execution.steps)
    assert steps == {"program", "loop", "openmm"}
    plan = dpd.make_plan(KINDS["energies"](), dt=0.01, scheme="mvv", platform="OpenCL", conservative="kernel", seed=1)
    assert plan.execution.why["steps"].startswith("velocities on the platform OpenCL are less than double precision")


@pytest.mark.parametrize("part", [*BONDED, "overlays", "segments", "body forces", "charges"])
def test_the_system_follows_it(part):
    """A part that is not held has a force in the System instead, and all forces together are the same."""
    plan = dpd.make_plan(dihedrals(), dt=0.01, scheme="mvv", platform="Reference", seed=1)
    execution = replace(plan.execution, held=plan.execution.held - {part})
    looped, left = map(build_plan, (plan, replace(plan, options=replace(plan.options, execution=execution))))
    assert re.search(rf"^[\w, ]*\b{part}\b[\w, ]*: outside of the pair kernel", left.explain(), re.M)
    names, more = ({force.getName() for force in built.system.getForces()} for built in (looped, left))
    assert names - more <= {MOLECULES} and more - names
    forces, others = (built.simulation().context.getState(forces=True).getForces(asNumpy=True)._value for built in (looped, left))
    np.testing.assert_allclose(others, forces, rtol=0, atol=(1e-4 if part == "charges" else 1e-10) * np.abs(forces).max())
