"""The table of layers in ARCHITECTURE.md: every module is in it, and imports only from its own row and the rows above."""

import re

from import_graph import GRAPH, PATHS, ROOT, TREES

TEXT = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")


def rows() -> list[list[str]]:
    """Files and folders of the package in the first column, row by row."""
    found = []
    for line in TEXT.splitlines():
        if line.startswith("| `openmm_dpd/"):
            found.append(re.findall(r"`(openmm_dpd/[^`]*)`", line.split("|")[1]))
    return found


def row_of(path: str) -> int | None:
    """The row of a file: the one that names it, or else the one of its innermost folder."""
    best: tuple[int, int] | None = None
    for number, names in enumerate(rows()):
        for name in names:
            if name == path or (name.endswith("/") and path.startswith(name)):
                best = max(best or (0, 0), (len(name), number))
    return None if best is None else best[1]


ROW = {module: row_of(path) for module, path in PATHS.items()}


def test_every_module_is_listed():
    assert len(rows()) > 20
    assert not [path for module, path in PATHS.items() if ROW[module] is None]
    named = [name for names in rows() for name in names]
    assert len(named) == len(set(named)) and not [name for name in named if not (ROOT / name).exists()]


def test_imports_go_one_way():
    """Those within functions and for type checkers too; there are no exceptions."""
    wrong = [
        f"{PATHS[module]} (row {ROW[module]}) imports {PATHS[name]} (row {ROW[name]})"
        for module in TREES
        for name in GRAPH[module]
        if name in TREES and ROW[name] > ROW[module]
    ]
    assert not wrong, "\n".join(wrong)


def test_kernels_know_neither_openmm_nor_the_model():
    kernels = {module for module in TREES if module.startswith("openmm_dpd.kernels")}
    for module in kernels:
        assert "openmm" not in GRAPH[module]
        assert not [name for name in GRAPH[module] if name.startswith("openmm_dpd.model")]


def test_the_model_knows_no_openmm_force():
    for module in TREES:
        if module.startswith("openmm_dpd.model"):
            assert not [name for name in GRAPH[module] if name.startswith(("openmm_dpd.plan.forces", "openmm_dpd.kernels"))]


def test_analysis_knows_no_context():
    """It reads trajectories and arrays: beside numpy, scipy, mdtraj and matplotlib it needs the lowest layers only."""
    lowest = {f"openmm_dpd.{name}" for name in ("bead_elements", "errors", "geometry", "neighbours", "pictures", "stats", "units")}
    for module in TREES:
        if module.startswith("openmm_dpd.analysis"):
            own = {name for name in GRAPH[module] if name.startswith(("openmm", "openmm_dpd"))}
            assert not {name for name in own if not name.startswith("openmm_dpd.analysis")} - lowest, module
