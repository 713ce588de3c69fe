"""Who computes what: one record, made in one place, with a reason for everything, which is what ``explain`` prints."""

from __future__ import annotations

import re
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import openmm
import pytest
from import_graph import PATHS, ROOT
from kinds import KINDS, WORDS, chains, plain, walled
from random_scenes import random_scene

import openmm_dpd as dpd
from openmm_dpd.model.schemes import SCHEMES
from openmm_dpd.plan import device
from openmm_dpd.plan.device import is_gpu  # as it is without conftest.py
from openmm_dpd.plan.forces import device_force
from openmm_dpd.plan.forces.bonded import MOLECULES
from openmm_dpd.plan.kinds import BONDED_KINDS
from openmm_dpd.simulation.build import build_plan
from openmm_dpd.simulation.whole_steps import WholeSteps

SOURCES = {path: (ROOT / path).read_text(encoding="utf-8") for path in PATHS.values()}

#: Parts of a scene, and where it has them.
PARTS = {
    **{kind.name: lambda plan, of=of: any(type(group) is of for group in plan.scene.bonded) for of, kind in BONDED_KINDS.items()},
    "overlays": lambda plan: plan.overlays,
    "segments": lambda plan: plan.scene.segments,
    "body forces": lambda plan: any(isinstance(term, dpd.BodyForce) for term in plan.scene.body_forces),
    "walls": lambda plan: plan.scene.walls,
    "charges": lambda plan: plan.scene.electrostatics,
}

#: A force that is in the System where the kernel does not hold it: some of its name, if that is not the part's.
FORCES = {"overlays": "tabulated pair", "segments": "segmental", "body forces": "body force", "charges": "smeared charges"}


def found(pattern: str) -> list[str]:
    """Files in which a pattern occurs, once for each time."""
    return [path for path, text in SOURCES.items() for _ in re.findall(pattern, text)]


def test_it_is_made_in_one_place():
    """There are no flags beside it; engines are asked for by name."""
    assert not found(r"unlooped|charges_held|kernel_conservative|options\.loop\b|whole_steps *[:=]|options\.whole_steps")
    assert [path.rpartition("/")[2] for path in found(r"\bExecution\(")] == ["plan.py"]
    assert found(r"(?<!class )\bPairEngine\(") == ["openmm_dpd/kernels/engine.py"]
    assert set(found(r"\bPairEngine\b")) == {"openmm_dpd/kernels/engine.py"}
    assert set(found(r"\bhost_engine\b")) == {
        *("openmm_dpd/kernels/engine.py", "openmm_dpd/kernels/engines.py"),
        "openmm_dpd/measure/of_beads.py",  # lists of the host's engine, with a column for each pair
    }
    assert len(found(r"\.make\(")) == 2  # of the pair force, of a plan


def dihedrals() -> dpd.Scene:
    """Everything that may be beside pair terms."""
    return chains(electric=True, dihedrals=[dpd.OPLSDihedrals(np.arange(48).reshape(12, 4), 1, -2, 3, 0.5)])


def driven() -> dpd.Scene:
    """Walls that move."""
    still = walled(None, "bounce-back")
    walls = [replace(wall, velocity=speed) for wall, speed in zip(still.walls, ((0.5, 0, 0), (0, 0.2, 0)), strict=True)]
    return plain({("*", "*"): dpd.DPD(A=25, gamma=4.5)}, positions=still.positions, walls=walls)


SCENES = {**KINDS, "dihedrals": dihedrals, "driven": driven, "sheared": lambda: plain(shear=dpd.LeesEdwards(0.3))}
SCENES |= {f"random {seed}": lambda seed=seed: random_scene(seed) for seed in (101, 102, 103)}
#: One draw in three takes one of these, the others what is chosen by default.
CHOICES = {
    **{"scheme": ["mvv", "native", *SCHEMES, *WORDS], "platform": ["Reference", "CPU", "OpenCL", "CUDA"], "loop": [False]},
    **{"conservative": ["openmm", "kernel"], "engine": ["host", "device"], "lam": [0.65], "slow_every": [2]},
}


def told(make, *given, **choices):
    """What a function makes, or its error."""
    try:
        return make(*given, dt=0.01, seed=1, **choices)
    except dpd.DPDError as error:
        return str(error)


@pytest.mark.parametrize("seed", [4, 23, 31, 52])
def test_everything_has_a_reason_and_is_told_as_it_is_built_and_done(seed, monkeypatch):
    """A plan has the words of what ``build`` makes, and System and steps are as they say."""
    rng, steps, looped = np.random.default_rng(seed), set(), []
    monkeypatch.setattr(WholeSteps, "run", lambda *given, **more: looped.append(True))
    for integrator in (openmm.CustomIntegrator, openmm.DPDIntegrator):
        monkeypatch.setattr(integrator, "step", lambda *given: None)
    for kind, scene in SCENES.items():
        choices = {name: rng.choice(values).item() for name, values in CHOICES.items() if rng.random() < 1 / 3}
        plan, built = (told(make, scene(), **choices) for make in (dpd.make_plan, dpd.build))
        if isinstance(built, str):
            assert plan == built or "there is no platform" in built, (kind, choices)
            continue
        execution, text = plan.execution, dpd.explain_plan(plan)
        assert text == built.explain().rpartition("\n")[0], (kind, choices)
        parts = {name for name, there in PARTS.items() if there(plan)}
        assert set(execution.why) == {"engine", "steps", "conservative", "precision"} | parts, kind
        assert execution.held <= parts and (not execution.held or execution.looped)
        for name, why in execution.why.items():
            assert f"({why})" in text or (name == "engine" and "pair kernel: host" not in text), (kind, why)
        names = " ".join(force.getName() for force in built.system.getForces())
        assert ("CustomNonbondedForce" in text) == bool(re.search("DPD conservative|MDPD attraction", names)), (kind, choices)
        assert ("no pair kernel" in text or "OpenMM's DPDIntegrator" in text) == ("DPD pair terms" not in names), (kind, choices)
        for part in parts:
            held = part in execution.held
            assert re.search(rf"^[-\w, ]*\b{part}\b[-\w, ]*: {'in' if held else 'outside of'} the pair kernel", text, re.M), (kind, part)
            assert held == (FORCES.get(part, part) not in names) or part == "walls", (kind, choices, part)
        if plan.platform != "OpenCL":
            looped.clear()
            simulation = built.simulation()
            simulation.integrator.step(1)
            assert ("steps: many at once" in text) == bool(looped), (kind, choices)
        steps.add(execution.steps)
    assert {"program", "loop"} <= steps


def test_energies_are_balanced_by_the_program():
    plan = dpd.make_plan(KINDS["energies"](), dt=0.01, scheme="mvv", platform="OpenCL", conservative="kernel", seed=1)
    assert plan.execution.why["steps"].startswith("velocities on the platform OpenCL are less than double precision")


@pytest.mark.parametrize("part", [name for name in PARTS if name != "walls" and PARTS[name](dpd.make_plan(dihedrals(), dt=0.01))])
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


def test_a_plugin_that_is_missing_comes_with_the_command_that_installs_it(monkeypatch):
    """In a copy of the project with its path; where the package was installed without one, in words."""
    assert [is_gpu(platform) for platform in (None, "Reference", "CPU", "CUDA", "HIP")] == [False, False, False, True, True]
    monkeypatch.setitem(sys.modules, "openmm_dpd_device", None)
    monkeypatch.setattr(device_force, "plugin", device_force.plugin.__wrapped__)
    monkeypatch.setattr(device, "is_gpu", lambda platform: True)
    said = dpd.build(plain(), dt=0.01, platform="Reference").explain()
    command = re.search(r"not the device: .* is not installed; to install it: pip install (.*)\)", said)[1]
    assert (Path(*shlex.split(command)) / "CMakeLists.txt").is_file()
    monkeypatch.setattr(device_force, "__file__", "/usr/site-packages/openmm_dpd/plan/forces/device_force.py")
    with pytest.raises(dpd.PlanError, match="to install it, in a copy of the project: pip install ./plugin$"):
        dpd.build(plain(), dt=0.01, platform="Reference", engine="device")


def test_a_library_that_openmm_lacks_for_a_platform_is_named(monkeypatch):
    failures = [f"Error loading library /lib/libOpenMM{of}.so: lib{of}.so.1: cannot open shared object file" for of in ("CPU", "HAL")]
    monkeypatch.setattr(openmm.Platform, "getPluginLoadFailures", lambda: failures)
    for name, says in (("HAL", ", as OpenMM found no library libHAL.so.1;"), ("SAL", ";")):
        with pytest.raises(dpd.ParameterError, match=f"there is no platform '{name}' here{says} it must be one of Reference"):
            dpd.build(plain(), dt=0.01, platform=name)
