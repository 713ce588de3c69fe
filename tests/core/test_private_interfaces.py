"""What is taken from inside other libraries: used in one file each, tried here, and what to do where it has changed."""

from __future__ import annotations

import ast
import importlib
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numba
import numpy as np
import openmm
import pytest
from import_graph import NODES, PATHS, ROOT, TREES
from openmm import unit

from openmm_dpd.kernels.vectors import LANES, bits_set, copy_shifted, count_up, floor, load_lanes, lowest_bit, splat, store_lanes, total

NUMBA, OPENMM, LLVMLITE = "openmm_dpd.runtime.numba_private", "openmm_dpd.base.openmm_private", "openmm_dpd.kernels.vectors"
ADDRESSES = "openmm_dpd.runtime.addresses"

#: Modules that are not their library's documented interface (or, for llvmlite, change with it), and the file that may import them.
MODULES = {"numba.core": NUMBA, "llvmlite": LLVMLITE, "openmm.app.internal": OPENMM, "openmm._openmm": OPENMM}

#: The same for attributes of objects of other libraries, and for options by name.
ATTRIBUTES = dict.fromkeys(("_value", "_getNumParticles", "_getVectorAsNumpy"), OPENMM)
ATTRIBUTES |= dict.fromkeys(("_cache", "_rebuild", "_reduce", "_nrt"), NUMBA)
ATTRIBUTES["_getvalue"] = ADDRESSES
ATTRIBUTES["_default_value"] = "openmm_dpd.molecules.inputs.gsd_files"  # of gsd

#: Attributes of the package's own classes that others look at, and the documented one of named tuples.
OWN = {"_BEADS", "_DIMENSIONS", "_accelerate", "_count", "_evaluated", "_reflect", "_replace", "_take"}


@contextmanager
def advised(module: str, what: str) -> Iterator[None]:
    """A block that tries an interface; if it fails, what the file that uses it says about that."""
    try:
        yield
    except Exception as error:
        advice = importlib.import_module(module).__doc__
        pytest.fail(f"{what} has changed in {numba.__version__=}, {openmm.__version__=}: {error!r}\n\n{module}:\n{advice}")


# -- one file each ---------------------------------------------------------------------------------------------------------------
def imported(nodes: list[ast.AST]) -> set[str]:
    """Full names of what a file imports, also inside functions."""
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def private_names(nodes: list[ast.AST]) -> set[str]:
    """Names with an underscore that are looked up on something else than self, and such keys of dictionaries."""
    found = set()
    for node in nodes:
        if isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
            if not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")):
                found.add(node.attr)
        elif isinstance(node, ast.Dict):
            found |= {key.value for key in node.keys if isinstance(key, ast.Constant) and key.value == "_nrt"}
    return found


def test_each_is_used_in_one_file_which_says_what_to_do():
    found = {(p, module) for module, nodes in NODES.items() for name in imported(nodes) for p in MODULES if f"{name}.".startswith(f"{p}.")}
    assert found == {*MODULES.items(), ("llvmlite", ADDRESSES)}
    assert {(name, module) for module, nodes in NODES.items() for name in private_names(nodes) - OWN} == set(ATTRIBUTES.items())
    nodes = list(
        ast.walk(ast.parse("import gc\nfrom numba.core import event\nx._value\nself._held\nnjit(**{'_nrt': False})\nsuper()._take()"))
    )
    assert imported(nodes) == {"gc", "numba.core.event"}
    assert private_names(nodes) == {"_value", "_nrt", "_take"}
    for module in (NUMBA, OPENMM):
        tree, text = TREES[module], (ROOT / PATHS[module]).read_text(encoding="utf-8")
        (exported,) = [node.value for node in tree.body if isinstance(node, ast.Assign) and node.targets[0].id == "__all__"]
        assert not [name for name in ast.literal_eval(exported) if f"``{name}``" not in ast.get_docstring(tree)], text


# -- numba -----------------------------------------------------------------------------------------------------------------------
def first_of(pair):
    return pair[0][0] + pair[1][0]


def through(helper):
    """A kernel that hands a tuple of arrays to a helper."""

    def kernel(a, b):
        found = 0.0
        for _ in range(len(a)):
            found += helper((a, b))
        return found

    return kernel


def counted(options: dict[str, bool]) -> bool:
    """Whether references to arrays are counted on the way through a helper."""
    helper = numba.njit(**options)(first_of)
    kernel = numba.njit(**options)(through(helper))
    assert kernel(np.ones(3), np.ones(3)) == 6.0
    return any("NRT_incref" in code for code in kernel.inspect_asm().values())


def test_references_are_not_counted():
    with advised(NUMBA, "the option _nrt"):
        from openmm_dpd.runtime.numba_private import NO_REFERENCE_COUNTS

        assert counted({}) and not counted(NO_REFERENCE_COUNTS)


def test_code_that_is_only_linked_is_called_by_others():
    """Two functions of the same types, one of which calls the other; and no code of theirs is anywhere by itself."""
    with advised(NUMBA, "ONLY_LINKED"):
        from openmm_dpd.runtime.numba_private import NO_REFERENCE_COUNTS, ONLY_LINKED

        options = {**NO_REFERENCE_COUNTS, **ONLY_LINKED, "error_model": "numpy"}
        half = numba.njit(**options)(lambda a, n: 0.5 * a[n])
        third = numba.njit(**options)(lambda a, n: a[n] / 3.0 + half(a, n))
        kernel = numba.njit(lambda a: half(a, 0) + 100.0 * third(a, 1))
        assert kernel(np.array([4.0, 6.0])) == 2.0 + 100.0 * 5.0
        for compiled in (*half.overloads.values(), *third.overloads.values()):
            assert compiled.library.get_pointer_to_function(compiled.fndesc.mangled_name) == 0


def test_compiled_functions_are_kept_and_come_back():
    """Loaded and saved by numba, by signature, through pickles."""
    kept: dict[object, bytes] = {}
    with advised(NUMBA, "the cache of compiled functions"):
        from openmm_dpd.runtime.numba_private import NullCache, dumps, packed, set_cache, unpacked

        class Kept(NullCache):
            def load_overload(self, sig, target_context):
                target_context.refresh()
                return unpacked(target_context, pickle.loads(kept[sig])) if sig in kept else None

            def save_overload(self, sig, data):
                assert not data.library.has_dynamic_globals
                kept[sig] = dumps(packed(data))

        results = []
        for _ in range(2):
            dispatcher = numba.njit(first_of)
            set_cache(dispatcher, Kept())
            results.append((dispatcher((np.ones(2), np.ones(2))), sum(dispatcher.stats.cache_hits.values()), len(kept)))
        assert results == [(2.0, 0, 1), (2.0, 1, 1)]


def test_a_compiler_that_is_switched_off_is_named():
    run = [sys.executable, "-c", "import openmm_dpd"]
    said = subprocess.run(run, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True, cwd=ROOT)
    assert said.returncode == 1 and said.stderr.splitlines()[-1].startswith(
        "ImportError: NUMBA_DISABLE_JIT is set, but openmm_dpd computes in kernels that numba compiles"
    )


def test_who_waits_for_the_compiler_hears_of_it():
    heard = []
    with advised(NUMBA, "the events of the compiler"):
        from openmm_dpd.runtime.numba_private import compiling

        with compiling(lambda: heard.append(1)):
            dispatcher = numba.njit(first_of)
            assert not heard
            dispatcher((np.ones(1), np.ones(1)))
            assert heard
            heard.clear()
            dispatcher((np.ones(1), np.ones(1)))
        numba.njit(first_of)((np.ones(1), np.ones(1)))
        assert not heard


def test_instructions_do_what_loops_do():
    """Of every one, beside numpy."""
    bits = np.uint64(0b101000)
    a, b = np.random.default_rng(1).normal(size=(2, LANES))

    def all_of_them(a, b, sums, moved, counts, bits):
        one, other = load_lanes(a, 0), load_lanes(b, 0)
        store_lanes(sums, 0, floor(one + other) * splat(2.0) - one)
        copy_shifted(a, 0, 0.5, moved, 0)
        count_up(np.uint64(7), counts, 0)
        return total(one), lowest_bit(bits), bits_set(bits)

    with advised(LLVMLITE, "the instructions of llvmlite"):
        sums, moved, counts = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES, np.uint32)
        assert numba.njit(all_of_them)(a, b, sums, moved, counts, bits) == (0.0 + sum(a[1:].tolist(), a[0]), 3, 2)
        assert np.array_equal(sums, np.floor(a + b) * 2 - a) and np.array_equal(moved, a + 0.5)
        assert np.array_equal(counts, np.arange(7, 7 + LANES))


# -- OpenMM ----------------------------------------------------------------------------------------------------------------------
def three_particles() -> tuple[openmm.Context, openmm.Integrator]:
    """A Context with positions, velocities, a box and a force."""
    system, force = openmm.System(), openmm.CustomExternalForce("x^2")
    for k in range(3):
        system.addParticle(1.0)
        force.addParticle(k)
    system.addForce(force)
    system.setDefaultPeriodicBoxVectors([3, 0, 0], [0, 4, 0], [0, 0, 5])
    integrator = openmm.VerletIntegrator(0.25)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName("Reference"))
    context.setPositions(np.arange(9.0).reshape(3, 3) / 7)
    context.setVelocities(np.arange(9.0).reshape(3, 3) / 11)
    return context, integrator


def test_quantities_hold_numbers_in_their_units():
    context, integrator = three_particles()
    integrator.step(1)
    state = context.getState(energy=True, forces=True)
    energy, force = unit.kilojoule_per_mole, unit.kilojoule_per_mole / unit.nanometer
    cases = [(integrator.getStepSize(), unit.picosecond), (state.getTime(), unit.picosecond), (state.getPotentialEnergy(), energy)]
    cases += [(state.getForces(asNumpy=True), force), (state.getPeriodicBoxVectors(asNumpy=True), unit.nanometer)]
    with advised(OPENMM, "Quantity"):
        from openmm_dpd.base.openmm_private import bare

        for quantity, in_units in cases:
            found, expected = bare(quantity), quantity.value_in_unit(in_units)
            assert type(found) is type(expected) and type(found) in (float, np.ndarray) and np.array_equal(found, expected)
            assert np.array_equal(expected, quantity.value_in_unit_system(unit.md_unit_system))  # what the file says to do instead


def test_masses_and_virtual_sites_of_a_system():
    system = three_particles()[0].getSystem()
    system.setParticleMass(1, 0.0)
    system.setVirtualSite(1, openmm.TwoParticleAverageSite(0, 2, 0.5, 0.5))
    with advised(OPENMM, "System"):
        from openmm_dpd.base.openmm_private import masses_of, virtual_sites

        assert virtual_sites(system).tolist() == [False, True, False]
        assert np.array_equal(masses_of(system), [system.getParticleMass(k).value_in_unit(unit.dalton) for k in range(3)])


def test_vectors_of_a_state_are_the_callers_own():
    state = three_particles()[0].getState(positions=True, velocities=True)
    with advised(OPENMM, "State"):
        from openmm_dpd.base.openmm_private import vectors

        x, v = vectors(state, openmm.State.Positions), vectors(state, openmm.State.Velocities)
        assert np.array_equal(x, np.arange(9.0).reshape(3, 3) / 7) and np.array_equal(v, np.arange(9.0).reshape(3, 3) / 11)
        x[:] = 0.0
        assert vectors(state, openmm.State.Positions)[2, 2] == 8 / 7


def test_contexts_are_heard_of(monkeypatch):
    class Own(openmm.Context):
        """Somebody's own."""

    heard = []
    monkeypatch.setattr(openmm.Context, "__init__", openmm.Context.__init__)
    with advised(OPENMM, "the way from an integrator to its Context"):
        from openmm_dpd.base.openmm_private import hear_calls

        hear_calls(openmm.Context, "__init__", heard.append)
        context, integrator = three_particles()
        own = Own(context.getSystem(), openmm.VerletIntegrator(0.25))
        assert list(map(id, heard)) == [id(context), id(own)] and context.getIntegrator() is integrator


def test_a_frame_is_written_as_xtc(tmp_path):
    mdtraj = pytest.importorskip("mdtraj")
    x = np.random.default_rng(2).random((20, 3)).astype(np.float32)
    with advised(OPENMM, "xtc_write_frame"):
        from openmm_dpd.base.openmm_private import xtc_write_frame

        path = tmp_path / "frame.xtc"
        xtc_write_frame(str(path).encode(), x, 3 * np.eye(3, dtype=np.float32), np.float32(2.5), np.int32(7))
        with mdtraj.formats.XTCTrajectoryFile(str(path)) as file:
            xyz, time, step, box = file.read()
        assert np.abs(xyz[0] - x).max() < 6e-4 and (time[0], step[0]) == (2.5, 7) and np.array_equal(box[0], 3 * np.eye(3))
