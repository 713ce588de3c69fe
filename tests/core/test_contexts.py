"""Several Contexts at once: on one System, in turn, and in two Python threads; and one Context with two kernel threads."""

import copy
import threading

import numpy as np
import openmm
import pytest
from cases import raises
from devices import CPU, DEVICES, REFERENCE
from scenes import BOXES, EXTENDED, SCHEME, beads, chains, fluid, place, run_of, same_bits, state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.runtime.threads import set_threads


def alone(scene, device, steps, **choices):
    return state_of(stepped(run_of(scene, device, dt=0.03, **choices), steps).context)


@SCHEME
def test_same_bits_for_one_and_two_threads(host, choices, two_threads):
    """The kernel does all the work here; 30 steps of a scene with everything in it, in a box of many cells."""
    scene = chains(BOXES["wide"], n=400, table=EXTENDED, mobile=np.arange(400) % 9 > 0)
    ends = []
    for threads in (1, 2):
        set_threads(threads)
        ends.append(alone(scene, host, 30, conservative="kernel", **choices))
    assert same_bits(*ends)


def test_same_bits_whatever_the_threads_of_the_platform():
    """OpenMM's own threads do not matter where the kernel returns all the forces."""
    built = [dpd.build(beads(), dt=0.04, platform="CPU", conservative="kernel", seed=3) for _ in range(2)]
    ends = []
    for count, each in zip(("1", "2"), built, strict=True):
        ends.append(state_of(stepped(each.simulation(properties={"Threads": count}), 20).context))
    assert same_bits(*ends)


@SCHEME
@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
def test_two_contexts_of_one_system_in_turn(choices, conservative):
    """Two Contexts share a System, and with it the pair force; stepping one between the steps of the other disturbs neither."""
    scene = fluid(EXTENDED, BOXES["ortho"], n=60)
    built = dpd.build(scene, dt=0.03, platform="Reference", conservative=conservative, seed=11, **choices)
    platform = openmm.Platform.getPlatformByName("Reference")
    contexts, integrators = [], []
    for shift in (0.0, 0.4):
        integrators.append(copy.copy(built.integrator))
        contexts.append(openmm.Context(built.system, integrators[-1], platform))
        place(contexts[-1], scene.positions + shift * scene.velocities, scene.velocities)
    for k in range(8):
        integrators[0].step(1 + k % 2)
        integrators[1].step(2 - k % 2)
    assert same_bits(state_of(contexts[0]), alone(scene, REFERENCE, 12, conservative=conservative, **choices))
    moved = fluid(EXTENDED, BOXES["ortho"], n=60, positions=scene.positions + 0.4 * scene.velocities)
    assert same_bits(state_of(contexts[1]), alone(moved, REFERENCE, 12, conservative=conservative, **choices))


def in_threads(*runs) -> None:
    """Run each function in a Python thread of its own; an error in one of them is raised here."""
    errors = []

    def guarded(run):
        try:
            run()
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=guarded, args=(run,)) for run in runs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]


@SCHEME
@pytest.mark.parametrize("kernel_threads", [1, 2])
def test_two_contexts_in_two_python_threads(host, choices, kernel_threads, two_threads):
    """Different scenes and Systems; the trajectories are those of each alone, with the kernel's threads too."""
    set_threads(kernel_threads)
    scenes = [fluid(EXTENDED, BOXES["ortho"], n=90, seed=seed) for seed in (1, 2)]
    runs = [run_of(scene, host, dt=0.03, conservative="kernel", **choices) for scene in scenes]
    in_threads(*(lambda run=run: run.step(40) for run in runs))
    for scene, run in zip(scenes, runs, strict=True):
        assert same_bits(state_of(run.context), alone(scene, host, 40, conservative="kernel", **choices))


@pytest.mark.parametrize("device", [d for d in DEVICES if d.precision in ("", "mixed")], indirect=True, ids=str)
def test_two_contexts_of_one_system_in_two_python_threads(device):
    """One System, one pair force object, two threads."""
    scene = fluid(EXTENDED, BOXES["ortho"], n=90, seed=1)
    built = dpd.build(scene, dt=0.03, platform=device.platform, scheme="mvv", conservative="kernel", seed=11)
    contexts = []
    for shift in (0.0, 0.4):
        where = openmm.Platform.getPlatformByName(device.platform), device.properties
        contexts.append(openmm.Context(built.system, openmm.XmlSerializer.clone(built.integrator), *where))
        place(contexts[-1], scene.positions + shift * scene.velocities, scene.velocities)
    in_threads(*(lambda context=context: context.getIntegrator().step(40) for context in contexts))
    for shift, context in zip((0.0, 0.4), contexts, strict=True):
        moved = fluid(EXTENDED, BOXES["ortho"], n=90, seed=1, positions=scene.positions + shift * scene.velocities)
        expected = alone(moved, device, 40, scheme="mvv", conservative="kernel")
        # these integrators have no loop, which agrees with their program to rounding
        assert np.abs(state_of(context)[1] - expected[1]).max() < (1e-9 if device.exact else 1e-3)


def test_a_context_may_move_from_one_thread_to_another():
    """What the pair force keeps belongs to the thread that steps; every step begins by keeping the positions anew."""
    scene = beads()
    run = stepped(run_of(scene, CPU, dt=0.03, scheme="mvv", conservative="kernel"), 5)
    in_threads(lambda: run.step(5))
    run.step(5)
    assert same_bits(state_of(run.context), alone(scene, CPU, 15, scheme="mvv", conservative="kernel"))


def test_number_of_threads_is_clamped():
    set_threads(10**6)
    assert 1 <= dpd.get_threads() <= 10**6 - 1
    for wrong in (0, -1, 1.5, "2", True):
        raises(dpd.ParameterError, "number of threads", set_threads, wrong)
    set_threads(None)
    assert dpd.get_threads() >= 1
