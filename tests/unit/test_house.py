"""Rules of the house that a script can count.  Bounds are what there is today; they may go down, never up."""

import ast
from collections import defaultdict

from import_graph import PATHS, ROOT, TREES, circles

from openmm_dpd.plan import kinds

LAMMPS = {module for module in TREES if module.startswith("openmm_dpd.lammps")}

#: Where kinds may be distinguished: the files that define them, and their records.
HOME = ("openmm_dpd.model", "openmm_dpd.kernels", "openmm_dpd.plan.kinds")


#: Classes of per-bead fields.
FIELDS = {"InternalEnergy", "BeadTemperatures", "Concentrations"}

#: Files over 400 lines.
LONG = {"energy.py"}


def _coefficients_and_tables() -> set[str]:
    """Names of the classes of pair coefficients, and of the kernel's tables and layers."""
    kernel = {
        node.name
        for module, tree in TREES.items()
        if module.startswith("openmm_dpd.kernels")
        for node in tree.body
        if isinstance(node, ast.ClassDef) and node.name.endswith(("Table", "Layer")) and node.name not in ("Table", "Layer")
    }
    return {kind.__name__ for kind in kinds.KINDS} | kernel


def _questions(tree: ast.Module, classes: set[str]) -> list[int]:
    """Lines that ask whether something is of one of these classes: isinstance, type(x) is C, C in kinds."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("isinstance", "issubclass"):
            asked: list[ast.expr] = node.args[1:]
        elif isinstance(node, ast.Compare):
            asked = [node.left, *node.comparators]
        else:
            continue
        if any(isinstance(part, ast.Name) and part.id in classes for one in asked for part in ast.walk(one)):
            found.append(node.lineno)
    return found


def _asked(modules, classes: set[str]) -> list[str]:
    return [f"{PATHS[module]}:{line}" for module in sorted(modules) for line in _questions(TREES[module], classes)]


def test_kinds_are_asked_by_their_records():
    classes = _coefficients_and_tables()
    assert {"DPD", "TabulatedPair", "ManyBodyTable", "DPDLayer", "EOSTable"} <= classes
    outside = {module for module in TREES if not module.startswith(HOME)}
    assert _asked(outside - LAMMPS, classes) == []
    assert len(_asked(LAMMPS, classes)) <= 7
    assert len(_asked(outside - LAMMPS, FIELDS)) <= 2
    assert len(_asked(LAMMPS, FIELDS)) <= 16


def test_questions_are_found():
    """All ways of asking that there are, and what is none."""
    lines = ["isinstance(x, DPD)", "isinstance(x, (int, EDPD))", "type(x) is DPD", "x in (EDPD, 1)", "DPD(A=1)", "x is None", "{DPD: 1}[x]"]
    assert _questions(ast.parse("\n".join(lines)), {"DPD", "EDPD"}) == [1, 2, 3, 4]


def test_no_circles():
    assert circles(set(TREES)) == []


def test_names_stand_for_one_thing():
    found = defaultdict(set)
    for module, tree in TREES.items():
        for node in tree.body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
                found[node.name].add(PATHS[module])
    twice = {name: sorted(files) for name, files in found.items() if len(files) > 1}
    assert not twice


def test_files_are_short():
    long = {path for path in PATHS.values() if len((ROOT / path).read_text(encoding="utf-8").splitlines()) > 400}
    assert {path.rpartition("/")[2] for path in long} <= LONG and len(long) <= len(LONG)


#: Where features have been added since the core was cleaned up.
GROWN = (
    *("inputs/", "outputs/", "parameters/", "molecules/", "lammps/", "view.py", "optional.py", "cli.py", "barostat"),
    *("analysis/membranes.py", "measure/present.py", "measure/kinetic_stress.py"),
    *("file_ledger.py", "xtc.py", "files.py", "dcd.py", "field_file.py"),
)


#: Lines of features that have since been added to files of the core.
ADDED = {
    "beads on which only body forces act (Scene.interacting)": 60,
    "one temperature of thermostat and barostats": 22,
    "degrees of freedom by what takes up momentum": 17,
    "Ctrl-C between two steps, and never an error of OpenMM's": 36,
    "rest lengths over half the box, Contexts of other Systems": 14,
    "steps for bonds and angles by what a word does to their vibrations": 285,
    "a minimiser that breaks no bonds, for scripts and decks on every platform": 185,
    "where averages begin, and their picture": 83,
    "messages for decks, in their units and words": 131,
    "notices of the compiler, python -m openmm_dpd": 52,
    "what changes between steps: Contexts made anew, force groups, lines of programs, walls": 80,
    "bonds and angles of anybody's: records, which kernels and OpenMM's forces are made of": 70,
    "dihedrals: three kinds, their kernel, measured": 340,
    "steps for dihedrals, or why there is none": 76,
    "exp, log and their kin, with the same bits on every machine": 165,
    "a record of who computes what with its reasons, engines from outside of the package": 268,
    "pair terms on OpenMM's devices: their Force, programs, guards, comparison with the host": 519,
}


def test_the_core_stays_short():
    """The package had 35,281 lines when its clean-up began; 20,882 of these were where no feature has been added since."""
    core = [path for path in PATHS.values() if not path.removeprefix("openmm_dpd/").startswith(GROWN)]
    assert len(core) > 120 and sum(len((ROOT / path).read_text(encoding="utf-8").splitlines()) for path in core) < 20_882 + sum(
        ADDED.values()
    )
