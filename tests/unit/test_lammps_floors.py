"""The folders of ``openmm_dpd/lammps`` are layers, and no file leads back to itself: read from the imports, all of them."""

import ast
import re
from pathlib import Path

import openmm_dpd.lammps

ROOT = Path(openmm_dpd.lammps.__file__).parent
REPOSITORY = ROOT.parents[1]

#: Each imports from itself and those before it.
FLOORS = ("language", "state", "files", "styles", "values", "output", "scene", "commands", "run", "exchange")

FILES = sorted(path.relative_to(ROOT).with_suffix("") for path in ROOT.rglob("*.py"))
MODULES = {".".join(path.parts) for path in FILES}


def imported(path: Path) -> set[str]:
    """Modules of ``lammps`` that a file imports, within functions and for types as well."""
    found = set()
    for node in ast.walk(ast.parse((ROOT / path).with_suffix(".py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            assert not any(alias.name.startswith("openmm_dpd") for alias in node.names), "imports within the package are relative"
        if not isinstance(node, ast.ImportFrom) or node.level > len(path.parts):
            continue
        if node.level == 0:
            assert not str(node.module).startswith("openmm_dpd"), "imports within the package are relative"
            continue
        base = ".".join([*path.parts[: len(path.parts) - node.level], *([node.module] if node.module else [])])
        names = (f"{base}.{alias.name}".lstrip(".") for alias in node.names)
        found |= {name for name in names if name in MODULES} or {base} & MODULES
    return found


IMPORTS = {".".join(path.parts): imported(path) for path in FILES}


def test_the_imports_are_seen():
    assert {"state.moment", "values.words", "language.expressions"} <= IMPORTS["values.resolver"]
    without = {name for name in MODULES if name.startswith(("commands.", "run.")) and not name.endswith("__init__") and not IMPORTS[name]}
    assert without == {"run.log"}  # lines of text, of any program


def test_every_folder_is_a_floor():
    assert {path.parts[0] for path in FILES if len(path.parts) > 1} == set(FLOORS)
    assert [path.name for path in FILES if len(path.parts) == 1] == ["__init__"]


def test_floors_import_from_themselves_and_from_below():
    floor = {name: FLOORS.index(name.partition(".")[0]) for name in MODULES - {"__init__"}}
    wrong = [(name, other) for name in floor for other in IMPORTS[name] if other == "__init__" or floor[other] > floor[name]]
    assert not wrong


def test_there_are_no_circles():
    left = dict(IMPORTS)
    while ready := [name for name, others in left.items() if not others & set(left)]:
        for name in ready:
            del left[name]
    assert not left


def test_the_architecture_has_the_floors_in_order():
    rows = re.findall(r"^\| `openmm_dpd/lammps/(\w+)/`", (REPOSITORY / "ARCHITECTURE.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert tuple(rows) == FLOORS


def test_the_face_is_what_its_page_describes():
    page = (REPOSITORY / "docs" / "api" / "lammps.md").read_text(encoding="utf-8")
    described = re.findall(r"^\.\. auto(?:function|class|exception):: openmm_dpd\.lammps\.(\w+)$", page, flags=re.MULTILINE)
    assert len(described) == len(set(described))
    folders = {*FLOORS, "annotations"}
    assert {name for name in vars(openmm_dpd.lammps) if not name.startswith("_")} - folders == set(described)
