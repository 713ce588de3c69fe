"""The examples in the docstrings of the package."""

import ast
import doctest
import importlib

import pytest
from import_graph import NODES, PATHS, ROOT, TREES

EXAMPLES = [module for module in TREES if ">>> " in (ROOT / PATHS[module]).read_text(encoding="utf-8")]


@pytest.mark.parametrize("module", EXAMPLES)
def test_examples_of_docstrings(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # some write files
    failed, attempted = doctest.testmod(importlib.import_module(module))
    assert attempted and not failed


def test_no_example_is_left_out():
    """Examples that are skipped rot, and doctest sees docstrings only."""
    assert len(EXAMPLES) >= 9
    for module in EXAMPLES:
        assert "doctest: +SKIP" not in (ROOT / PATHS[module]).read_text(encoding="utf-8")
        assert any(">>> " in (ast.get_docstring(node) or "") for node in NODES[module] if isinstance(node, (ast.ClassDef, ast.FunctionDef)))
