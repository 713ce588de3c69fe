"""What is missing to build or to load the plugin is said in one sentence."""

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
FAKE = "openmm_library_path = '/nowhere/lib'\nshort_version = "


@pytest.mark.skipif(None in (shutil.which("cmake"), shutil.which("ninja")), reason="there is no cmake, or no ninja, here")
@pytest.mark.parametrize(
    "found, says",
    [
        ("", "openmm-dpd-device is C.., and there is no compiler here: install one .*apt-get install g"),
        ("raise ImportError('lost')", "OpenMM is needed to build openmm-dpd-device, and .* cannot import it: ImportError: lost"),
        (FAKE + "'8.60.1'", "written for OpenMM 8.6, and this is 8.60.1: its C.. classes differ"),
        (FAKE + f"'{HERE}'", "/nowhere/include has no headers of OpenMM's common platform"),
        ("-DCMAKE_SYSTEM_NAME=Darwin", "openmm-dpd-device is written for Linux, and this is Darwin"),
    ],
    ids=["compiler", "OpenMM", "version", "headers", "Linux"],
)
def test_what_building_lacks(found, says, tmp_path):
    """With another OpenMM, on another system, and without anything on the PATH."""
    command = [
        shutil.which("cmake"),
        "-G",
        "Ninja",
        f"-DCMAKE_MAKE_PROGRAM={shutil.which('ninja')}",
        f"-DPython_EXECUTABLE={sys.executable}",
    ]
    if found.startswith("-D"):
        command.append(found)
    elif found:
        (tmp_path / "openmm").mkdir()
        (tmp_path / "openmm" / "__init__.py").touch()
        (tmp_path / "openmm" / "version.py").write_text(found, encoding="utf-8")
    environment = {"PATH": str(tmp_path), "PYTHONPATH": str(tmp_path)}
    run = subprocess.run([*command, "-S", PLUGIN, "-B", tmp_path / "build"], env=environment, capture_output=True, text=True)
    assert run.stderr.count("CMake Error") == 1 and re.search(says, " ".join(run.stderr.split())), run.stderr


DIFFER = (
    f"built for OpenMM 8.5.1, and this is {HERE}: their C.. classes differ; to install one that it fits: pip install .openmm==8.5.[*].$"
)


@pytest.mark.parametrize("built, says", [(HERE, ""), ("8.5.1", DIFFER), (None, "is its source, which is not compiled")])
def test_what_loading_lacks(built, says, tmp_path, monkeypatch):
    """For this OpenMM all that lacks are the libraries."""
    package = Path(shutil.copytree(PLUGIN / "openmm_dpd_device", tmp_path / "openmm_dpd_device"))
    if built:
        (package / "built.py").write_text(f"OPENMM = {built!r}\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.startswith("openmm_dpd_device")]:
        monkeypatch.delitem(sys.modules, name)
    found = device_force.plugin.__wrapped__()
    if says:
        assert re.search(says, found)
    else:
        assert not found.loaded and re.match("openmm-dpd-device does not fit the OpenMM in .*: install it again", found.failed["Reference"])
