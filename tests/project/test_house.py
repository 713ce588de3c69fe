"""Rules of the house that a script can count.  Bounds are what there is today; they may go down, never up."""

import ast
import importlib
import inspect
import re
from collections import defaultdict

import numpy as np
from import_graph import NODES, PATHS, ROOT, TREES, circles, nodes_of

from openmm_dpd.plan import kinds

LAMMPS = {module for module in TREES if module.startswith("openmm_dpd.lammps")}

#: Where kinds may be distinguished: the files that define them, and their records.
HOME = ("openmm_dpd.model", "openmm_dpd.kernels", "openmm_dpd.plan.kinds")


FIELDS = {"InternalEnergy", "BeadTemperatures", "Concentrations"}  # Classes of per-bead fields.


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


def _questions(nodes: list[ast.AST], classes: set[str]) -> list[int]:
    """Lines that ask whether something is of one of these classes: isinstance, type(x) is C, C in kinds."""
    found = []
    for node in nodes:
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
    return [f"{PATHS[module]}:{line}" for module in sorted(modules) for line in sorted(_questions(NODES[module], classes))]


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
    assert sorted(_questions(nodes_of(ast.parse("\n".join(lines))), {"DPD", "EDPD"})) == [1, 2, 3, 4]


def test_files_are_short_without_circles_and_names_stand_for_one_thing():
    assert circles(set(TREES)) == []
    found = defaultdict(set)
    for module, tree in TREES.items():
        for node in tree.body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
                found[node.name].add(PATHS[module])
    assert not {name: sorted(files) for name, files in found.items() if len(files) > 1}
    long = {path for path in PATHS.values() if len((ROOT / path).read_text(encoding="utf-8").splitlines()) > 400}
    assert not long


def test_docstrings_stand_alone():
    """In hover help there is no neighbour to lean on.  The rooms named here are not done yet."""
    leans = re.compile(r"(?s)(The same\b|Both\b|As |Of (these|those|all)\b|Those\b|Its\b|See\b|Like\b|.*\n *(As for|Likewise)\b)")
    later = tuple(f"openmm_dpd.{room}" for room in ("kernels", "runtime", "plan", "simulation", "lammps"))
    for module in sorted(TREES):
        for node in NODES[module] if not module.startswith(later) else ():
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                assert not leans.match(ast.get_docstring(node) or ""), f"{PATHS[module]}: {ast.get_docstring(node)}"


def test_defaults_are_those_that_docstrings_name():
    said, compared = re.compile(r"(?m)^(\w[\w, ]*) : .*?\bdefault:? (\([^)]*\)|\S+?)[.,;]?(?:\s|$)"), 0
    for module in TREES:
        own = [each for each in vars(importlib.import_module(module)).values() if getattr(each, "__module__", "") == module]
        classes = [each for each in own if inspect.isclass(each)]
        for each in [*own, *(part for one in classes for part in vars(one).values())]:
            if not (inspect.isclass(each) or inspect.isfunction(each)):
                continue
            for names, text in said.findall(inspect.getdoc(each) or ""):
                value = ast.literal_eval(text) if re.fullmatch(r"[-\d(].*|True|False|None", text) else text.strip('"')
                for name in names.split(", "):
                    default = inspect.signature(each).parameters[name].default
                    compared += 1
                    assert type(default) is not bool or value is default, f"{module}: {name} of {each}"
                    assert np.all(np.asarray(default) == np.asarray(value)), f"{module}: {name} of {each} is {default}, not {value}"
    assert compared >= 100


def test_what_the_night_runs_exists():
    for line in (ROOT / "tests" / "night.txt").read_text(encoding="utf-8").splitlines()[1:]:
        path, _, name = line.partition("  # ")[0].partition("::")
        assert f"def {name.partition('[')[0]}(" in (ROOT / "tests" / path).read_text(encoding="utf-8"), line
        assert line.partition("  # ")[2], line
