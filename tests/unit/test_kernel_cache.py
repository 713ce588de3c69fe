"""Compiled kernels are kept where nobody else writes, and a cache that is full or damaged is not in the way."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from full_disk import file_limit

from openmm_dpd.base import kernel_cache
from openmm_dpd.base.kernel_cache import KernelFiles, cache_folder, why_unusable
from openmm_dpd.kernels.compiled import compiled

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
    assert not [path for path in cache_folder().rglob("*") if path.is_file()]


def test_a_file_answers_to_its_own_key_only(tmp_path):
    files = KernelFiles(tmp_path, "kernel", "source")
    files.save(("a", 1), [1, 2])
    assert files.load(("a", 1)) == [1, 2]
    assert files.load(("a", 2)) is None and KernelFiles(tmp_path, "kernel", "changed").load(("a", 1)) is None


def test_without_any_place_the_package_is_imported_and_computes():
    """As in a container whose folders are all read-only."""
    code = (
        "import tempfile; tempfile.tempdir = '/dev/null/t'\n"
        "import numpy as np, openmm_dpd, openmm_dpd.kernels.motion as motion\n"
        "print(motion.second_moments(np.ones(1), np.ones((1, 3)))[5])\n"
    )
    environment = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_CACHE")}
    environment |= {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null/cache"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "1.0\n"), done.stderr
    assert done.stderr.count("\n") == 1 and "kernels are compiled at every start, since there is no place to keep them" in done.stderr
