"""The rooms of the package and its three wings, by ``tests/rooms.json``: few, in one order of imports, within their budgets."""

import json
import re
import subprocess
import sys

import pytest
from cases import cases
from import_graph import GRAPH, PACKAGE, PATHS, ROOT, TREES

import openmm_dpd
import openmm_dpd.lammps

#: Wing -> its budget of lines and its rooms, in the order of imports.
WINGS = json.loads((ROOT / "tests" / "rooms.json").read_text(encoding="utf-8"))

ORDER = [room for wing in WINGS.values() for room in wing["rooms"]]


def room_of(module: str) -> str:
    """The innermost room of a module; "top" for files beside the rooms."""
    path = PATHS[module].removeprefix("openmm_dpd/")
    return max((room for room in ORDER if path.startswith(f"{room}/")), key=len, default="top")


ROOM = {module: room_of(module) for module in TREES}
WING = {module: next(name for name, wing in WINGS.items() if room in wing["rooms"]) for module, room in ROOM.items()}


def test_few_entries():
    entries = {path for path in PACKAGE.iterdir() if path.name != "__pycache__"}
    files = {path.name for path in entries if path.is_file()}
    assert files == {"__init__.py", "__main__.py", "inputs.py", "py.typed"}
    assert {path.name for path in entries} - files == {room.partition("/")[0] for room in ORDER} - {"top"}
    assert len(entries) <= 19


def test_imports_go_one_way():
    """Those within functions and for type checkers too; there are no exceptions."""
    imports = [(module, name) for module in TREES for name in GRAPH[module] & set(TREES)]
    wrong = [f"{PATHS[a]} imports {PATHS[b]}" for a, b in imports if ORDER.index(ROOM[b]) > ORDER.index(ROOM[a])]
    assert not wrong, "\n".join(wrong)


@cases(
    "room, unknown",
    ("runtime", ("openmm", "openmm_dpd.model", "openmm_dpd.kernels")),
    ("kernels", ("openmm", "openmm_dpd.model")),
    ("model", ("openmm_dpd.kernels",)),
    ("analysis", ("openmm", "openmm_dpd.model", "openmm_dpd.plan")),
)
def test_what_a_room_does_not_know(room, unknown):
    """No physics in the runtime, neither OpenMM nor the model in kernels, no kernels in the model, no Contexts in the analysis of trajectories."""
    for module in (module for module in TREES if ROOM[module] == room):
        assert not {name for name in GRAPH[module] if any(f"{name}.".startswith(f"{one}.") for one in unknown)}, module


@pytest.mark.parametrize("wing", ["core", "core tools"])
def test_wings_stand_without_those_behind_them(wing, tmp_path):
    """All modules of the core are imported from a package that has nothing else, then those of the tools from one without decks."""
    for room in (room for name in wing.split() for room in WINGS[name]["rooms"]):
        (tmp_path / room).symlink_to(PACKAGE / room)
    names = sorted(module for module in TREES if WING[module] in wing.split())
    code = f"""
import importlib, sys, types
package = sys.modules["openmm_dpd"] = types.ModuleType("openmm_dpd")
package.__path__ = [{str(tmp_path)!r}]
for name in {names}:
    importlib.import_module(name)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("wing", WINGS)
def test_wings_keep_their_budgets(wing):
    """A budget changes in a commit of its own, which says why."""
    inside = [path for module, path in PATHS.items() if WING[module] == wing]
    assert sum(len((ROOT / path).read_text(encoding="utf-8").splitlines()) for path in inside) <= WINGS[wing]["lines"]


def test_public_modules_are_found_by_both_names():
    for name, module in openmm_dpd.PUBLIC_MODULES.items():
        assert __import__(f"openmm_dpd.{name}", fromlist=["_"]) is getattr(openmm_dpd, name) is module
    assert openmm_dpd.inputs.scene_from_psf and openmm_dpd.outputs.write_pdb
    with pytest.raises(ModuleNotFoundError):
        __import__("openmm_dpd.nothing")


def test_the_face_of_lammps_is_what_its_page_describes():
    page = (ROOT / "docs" / "api" / "lammps.md").read_text(encoding="utf-8")
    described = re.findall(r"^\.\. auto(?:function|class|exception):: openmm_dpd\.lammps\.(\w+)$", page, flags=re.MULTILINE)
    assert len(described) == len(set(described))
    folders = {room.rpartition("/")[2] for room in ORDER if room.startswith("lammps/")}
    assert {name for name in vars(openmm_dpd.lammps) if not name.startswith("_")} - folders == set(described)
