"""What is missing to build or to load the plugin is said in one sentence; its wheel needs the OpenMM that it says, and no Python."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import openmm
import pytest

from openmm_dpd.plan.forces import device_force

PLUGIN = Path(__file__).parents[1]
HERE = openmm.version.short_version
MINOR = HERE.rpartition(".")[0]


def fake_openmm(folder: Path, version: str) -> Path:
    """A package that says where its libraries would be."""
    (folder / "openmm").mkdir()
    (folder / "openmm" / "__init__.py").touch()
    (folder / "openmm" / "version.py").write_text(f"short_version = '{version}'\nopenmm_library_path = '/nowhere/lib'\n", encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    "what, says",
    [
        ("no compiler", "openmm-dpd-device is C.., and there is no compiler here: install one .*apt-get install g"),
        (
            "no openmm",
            "OpenMM is needed to build openmm-dpd-device, and .* cannot import it: ModuleNotFoundError: No module named 'openmm'",
        ),
        ("openmm 8.60.1", "written for OpenMM 8.6, and this is 8.60.1: its C.. classes differ"),
        (f"openmm {HERE}", "/nowhere/include has no headers of OpenMM's common platform"),
        ("Darwin", "openmm-dpd-device is written for Linux, and this is Darwin"),
    ],
)
def test_what_building_lacks(what, says, tmp_path):
    tools = [shutil.which(name) for name in ("cmake", "ninja")]
    if None in tools:
        pytest.skip("there is no cmake, or no ninja, here")
    for tool in tools:
        (tmp_path / Path(tool).name).symlink_to(tool)
    environment = {"PATH": str(tmp_path)}
    arguments = [f"-DPython_EXECUTABLE={sys.executable}"]
    if what == "no openmm":
        (tmp_path / "python").write_text(f'#!/bin/sh\nexec {sys.executable} -S "$@"\n', encoding="utf-8")
        (tmp_path / "python").chmod(0o755)
        arguments = [f"-DPython_EXECUTABLE={tmp_path / 'python'}"]
    elif what.startswith("openmm"):
        environment["PYTHONPATH"] = str(fake_openmm(tmp_path, what.split()[1]))
    elif what == "Darwin":
        arguments.append("-DCMAKE_SYSTEM_NAME=Darwin")
    command = ["cmake", "-G", "Ninja", "-S", str(PLUGIN), "-B", str(tmp_path / "build"), *arguments]
    run = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert run.returncode != 0 and run.stderr.count("CMake Error") == 1, run.stderr
    assert re.search(says, " ".join(run.stderr.split())), run.stderr


@pytest.mark.parametrize(
    "built, says",
    [
        (HERE, None),
        (MINOR + ".99", None),
        (
            "8.5.1",
            f"was built for OpenMM 8.5.1, and this is {HERE}: their C.. classes differ; to install one that it fits: pip install .openmm==8.5.[*].$",
        ),
        ("", "is its source, which is not compiled"),
    ],
)
def test_what_loading_lacks(built, says, tmp_path, monkeypatch):
    """Libraries are missing here; what fits but does not load is not a failed import."""
    package = tmp_path / "openmm_dpd_device"
    package.mkdir()
    shutil.copy(PLUGIN / "openmm_dpd_device" / "__init__.py", package)
    if built:
        (package / "built.py").write_text(f"OPENMM = {built!r}\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.startswith("openmm_dpd_device")]:
        monkeypatch.delitem(sys.modules, name)
    reason = device_force.plugin.__wrapped__()
    if says is not None:
        assert re.search(says, reason)
        return
    assert reason.loaded == [] and re.match("openmm-dpd-device does not fit the OpenMM in .*: install it again", reason.failed["Reference"])
    monkeypatch.setattr(device_force, "plugin", lambda: reason)
    assert "does not fit" in device_force.why_no_plugin("CPU") and "knows no platform Abacus" in device_force.why_no_plugin("Abacus")
