"""Compiled kernels are kept where nobody else writes, and a cache that is full or damaged is not in the way."""

import os
import pickle
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread

import numba
import pytest
from full_disk import file_limit

from openmm_dpd.kernels.cells import _bin_beads
from openmm_dpd.runtime import kernel_cache
from openmm_dpd.runtime.decorators import compiled, helper, inlined
from openmm_dpd.runtime.kernel_cache import KernelFiles, cache_folder, why_unusable

POSIX = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no owners of files here")


@pytest.fixture
def places(tmp_path, monkeypatch) -> dict[str, Path]:
    """The folders of a home and for temporary files, both empty."""
    found = {"home": tmp_path / "home", "temporary": tmp_path / "temporary"}
    for folder in found.values():
        folder.mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(found["home"]))
    monkeypatch.setattr("tempfile.tempdir", str(found["temporary"]))
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(kernel_cache, "_SAID", set())
    cache_folder.cache_clear()
    yield found
    cache_folder.cache_clear()


def double(x):
    return 2.0 * x


@POSIX
def test_the_folder_is_the_users_own(places):
    folder = cache_folder()
    assert folder == places["home"] / "openmm_dpd" / "kernels"
    assert folder.stat().st_mode & 0o777 == 0o700


@POSIX
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o1777], ids=oct)
def test_folders_that_others_can_write_to_are_not_used(tmp_path, mode):
    folder = tmp_path / "cache"
    folder.mkdir()
    folder.chmod(mode)
    assert why_unusable(folder) == "others can write to it"
    assert why_unusable(folder / "below") == (f"others can write to {folder}" if mode in (0o707, 0o777) else None)


@POSIX
def test_links_and_files_are_not_used(tmp_path):
    (tmp_path / "own").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(tmp_path / "own")
    (tmp_path / "file").write_text("")
    assert why_unusable(tmp_path / "own") is None
    assert why_unusable(tmp_path / "link") == why_unusable(tmp_path / "file") == "it is a link or a file, not a folder"
    assert why_unusable(tmp_path / "file" / "below") == "File exists"


@POSIX
def test_a_folder_that_somebody_else_has_made_is_not_used(places, caplog):
    """In a folder for temporary files anybody can make one of any name, before its user does."""
    if os.geteuid():
        pytest.skip("only root can give a folder away")
    places["temporary"].chmod(0o1777)
    planted = places["temporary"] / f"openmm_dpd-{os.getuid()}"
    planted.mkdir()
    os.chown(planted, 12345, 12345)
    places["home"].rmdir()
    places["home"].write_text("a file where a folder should be")
    assert why_unusable(planted) == "it belongs to another user"
    assert cache_folder() is None
    assert "kernels are compiled at every start" in caplog.text and f"{planted}: it belongs to another user" in caplog.text
    assert compiled(double)(2.0) == 4.0
    assert not list(planted.iterdir())


@POSIX
def test_a_place_for_temporary_files_will_do(places):
    (places["home"] / "openmm_dpd").write_text("a file where a folder should be")
    assert cache_folder() == places["temporary"] / f"openmm_dpd-{os.getuid()}"


def test_kernels_are_found_again(places, monkeypatch):
    assert compiled(double)(2.0) == 4.0
    (file,) = cache_folder().rglob("*.kernel")
    before = file.stat().st_mtime_ns
    again = compiled(double)
    assert again(3.0) == 6.0
    assert (sum(again.stats.cache_hits.values()), file.stat().st_mtime_ns) == (1, before)
    assert compiled(double)(3) == 6  # another type is another file
    assert len(list(cache_folder().rglob("*.kernel"))) == 2


@pytest.mark.parametrize("damage", ["empty", "cut", "changed", "foreign"])
def test_damaged_files_are_replaced(places, caplog, damage):
    compiled(double)(2.0)
    (file,) = cache_folder().rglob("*.kernel")
    whole = file.read_bytes()
    changed = bytearray(whole)
    changed[len(whole) // 2] ^= 1
    file.write_bytes({"empty": b"", "cut": whole[:-100], "changed": bytes(changed), "foreign": pickle.dumps("index of numba")}[damage])
    assert compiled(double)(2.0) == 4.0
    assert caplog.text.count("cannot be read") == 1 and str(cache_folder()) in caplog.text
    again = compiled(double)
    assert again(2.0) == 4.0 and sum(again.stats.cache_hits.values()) == 1


def test_a_full_disk_is_said_once(places, caplog):
    with file_limit(100):
        assert compiled(double)(2.0) == 4.0
        assert compiled(double)(3) == 6
    assert caplog.text.count("kernels are compiled at every start") == 1 and "NUMBA_CACHE_DIR" in caplog.text
    assert [path.name for path in cache_folder().rglob("*")] == ["lock"]


def test_a_file_answers_to_its_own_key_only(tmp_path):
    files = KernelFiles(tmp_path, "kernel", "source")
    files.save(("a", 1), [1, 2])
    assert files.load(("a", 1)) == [1, 2]
    assert files.load(("a", 2)) is None and KernelFiles(tmp_path, "kernel", "changed").load(("a", 1)) is None


def loaded(path: Path, decorator, number: str):
    """A function of a file that calls another one, which knows a number."""
    names = {"helper": decorator, "__name__": path.stem}
    path.write_text(f"NUMBER = {number}\n\n@helper\ndef add(x):\n    return x + NUMBER\n\ndef kernel(x):\n    return add(x)\n")
    exec(compile(path.read_text(), str(path), "exec"), names)
    return names["kernel"]


@pytest.mark.parametrize("decorator", [helper, inlined])
def test_what_is_compiled_decides_not_where_it_lies(places, tmp_path, decorator):
    """Also for kinds that are registered from outside: a number that a called function knows is another kernel."""
    first = compiled(loaded(tmp_path / "one.py", decorator, "1.0"))
    assert first(2.0) == 3.0
    (tmp_path / "other").mkdir()
    moved = compiled(loaded(tmp_path / "other" / "two.py", decorator, "1.0"))
    os.utime(tmp_path / "other" / "two.py", (1.0, 1.0))
    assert moved(2.0) == 3.0 and sum(moved.stats.cache_hits.values()) == 1
    changed = compiled(loaded(tmp_path / "one.py", decorator, "10.0"))
    assert changed(2.0) == 12.0 and not changed.stats.cache_hits


REACHED = """
import itertools
from numba.core.bytecode import FunctionIdentity
from openmm_dpd.kernels.cells import _bin_beads
from openmm_dpd.runtime import kernel_cache
from openmm_dpd.runtime.kernel_cache import KernelCache, contents
from openmm_dpd.measure import warming

compiled, known, kernels = [], set(), 0
identity, code, file, save = FunctionIdentity.from_function.__func__, kernel_cache._code, kernel_cache._file, KernelCache.save_overload
FunctionIdentity.from_function = classmethod(lambda cls, of: (compiled.append(getattr(of, "py_func", of)), identity(cls, of))[1])
kernel_cache._code = lambda of, *rest: (known.add(of), code(of, *rest))[1]
kernel_cache._file = lambda path: (known.add(path), file(path))[1]

def saved(self, *rest):
    global kernels
    known.clear()
    contents(self._function)
    for of in compiled:
        if of.__module__.startswith("openmm_dpd"):
            kernels += 1
            assert of.__code__ in known or (of.__name__ == "<lambda>" and of.__code__.co_filename in known), (self._function, of)
    compiled.clear()
    save(self, *rest)

KernelCache.save_overload = saved
scenes = warming._scenes
warming._scenes = lambda: itertools.islice(scenes(), 1, 3)
kinds = warming.BONDED_KINDS.items()
warming.BONDED_KINDS = dict(itertools.islice(kinds, 3, None, 4))  # of angles, bonds, dihedrals and impropers one each: all are made by one decorator
warming.warm(print)
assert kernels > 100
"""


def test_no_place_is_part_of_a_key(monkeypatch):
    """Kernels that meet other threads refer to functions of Python's library, which know where Python is."""
    before = kernel_cache.contents(_bin_beads)
    monkeypatch.setattr(sys, "executable", "/elsewhere/python")
    monkeypatch.setattr(sys, "prefix", "/elsewhere")
    assert kernel_cache.contents(_bin_beads) == before


@pytest.mark.slow
@pytest.mark.long
def test_all_that_is_compiled_decides(places):
    """Each function that numba compiles for a kernel is one that decides; of overloads, which are lambdas, it is their file."""
    environment = os.environ | {"XDG_CACHE_HOME": str(places["home"]), "NUMBA_CACHE_DIR": ""}
    done = subprocess.run([sys.executable, "-c", REACHED], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


AT_ONCE = """
import sys, time
from pathlib import Path
from openmm_dpd.runtime.decorators import compiled
def slow(x):
    for k in range(3):
        x = x + k
    return x
kernel = compiled(slow)
Path(sys.argv[1]).touch()
while not Path(sys.argv[2]).exists():
    time.sleep(0.001)
kernel(1.0)
print(sum(kernel.stats.cache_hits.values()))
"""


@pytest.mark.skipif(kernel_cache.fcntl is None, reason="no locks of files here")
def test_two_processes_compile_once(places, tmp_path):
    """Both begin at once; and what a process that is killed has in work is compiled by the next one."""
    environment = os.environ | {"XDG_CACHE_HOME": str(places["home"]), "NUMBA_CACHE_DIR": ""}
    go = tmp_path / "go"
    ready = [tmp_path / "first", tmp_path / "second"]
    started = {"env": environment, "stdout": subprocess.PIPE}
    both = [subprocess.Popen([sys.executable, "-c", AT_ONCE, each, go], text=True, **started) for each in ready]
    while not all(path.exists() for path in ready):
        time.sleep(0.001)
    files = KernelFiles(cache_folder(), "held", "source")
    go.touch()
    assert sorted(each.communicate()[0] for each in both) == ["0\n", "1\n"]
    holder = "from openmm_dpd.runtime.kernel_cache import *; import time; KernelFiles(cache_folder(), 'held', 'source').begin(1); print(flush=True); time.sleep(60)"
    held = subprocess.Popen([sys.executable, "-c", holder], **started)
    assert held.stdout.read(1)
    waiting = Thread(target=files.begin, args=(1,))
    waiting.start()
    waiting.join(0.2)
    assert waiting.is_alive()
    held.kill()
    waiting.join(10.0)
    held.communicate()
    assert not waiting.is_alive()
    files.end()


def test_without_any_place_the_package_is_imported_and_computes():
    """As in a container whose folders are all read-only."""
    code = (
        "import tempfile; tempfile.tempdir = '/dev/null/t'\n"
        "import numpy as np, openmm_dpd, openmm_dpd.kernels.motion as motion\n"
        "print(motion.moments(np.ones(1), np.ones((1, 3)))[5])\n"
    )
    environment = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_CACHE")}
    environment |= {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null/cache"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "1.0\n"), done.stderr
    assert done.stderr.count("\n") == 1 and "kernels are compiled at every start, since there is no place to keep them" in done.stderr


RUN = """
import sys
import numpy as np
import openmm_dpd as dpd
x = np.random.default_rng(1).random((81, 3)) * 3
scene = dpd.Scene({"A": 1}, ["A"] * 81, x, {("A", "A"): dpd.DPD(A=25, gamma=4.5)}, 1.0, box=[3, 3, 3])
built = dpd.build(scene, dt=0.01, platform="CPU", seed=1)
simulation = built.simulation()
simulation.step(5)
print(dpd.Observer(built).sample(simulation.context).kinetic, "numba.np.arraymath" in sys.modules)
"""


def test_kernels_from_disk_need_no_compiler():
    """What numba has to compile with takes 0.2 s to import: it is left alone where all kernels are on disk."""
    first, second = (
        subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, check=True).stdout.split() for _ in range(2)
    )
    assert second == [first[0], "False"]
