"""Which module of the package imports which, from the syntax trees: within functions and for type checkers too."""

import ast
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "openmm_dpd"

PATHS: dict[str, str] = {}  # Module name -> its path, from the root.
for _path in sorted(PACKAGE.rglob("*.py")):
    _parts = _path.relative_to(ROOT).with_suffix("").parts
    PATHS[".".join(_parts[:-1] if _parts[-1] == "__init__" else _parts)] = _path.relative_to(ROOT).as_posix()


class OfModules(Mapping):
    """Module name -> what is found out about it once it is asked for."""

    def __init__(self, find: Callable[[str], Any]) -> None:
        self._find = cache(find)

    def __getitem__(self, module: str) -> Any:
        return self._find(module)

    def __iter__(self) -> Iterator[str]:
        return iter(PATHS)

    def __len__(self) -> int:
        return len(PATHS)


TREES = OfModules(lambda module: ast.parse((ROOT / PATHS[module]).read_text(encoding="utf-8")))


def nodes_of(tree: ast.AST) -> list[ast.AST]:
    """What ast.walk gives, in another order: to walk through all trees takes seconds."""
    found, left = [], [tree]
    while left:
        node = left.pop()
        found.append(node)
        for value in vars(node).values():
            if isinstance(value, ast.AST):
                left.append(value)
            elif type(value) is list:
                left += [each for each in value if isinstance(each, ast.AST)]
    return found


NODES = OfModules(lambda module: nodes_of(TREES[module]))


def _base(module: str, node: ast.ImportFrom) -> str:
    """What the names of an import are taken from."""
    package = module.split(".") if PATHS[module].endswith("__init__.py") else module.split(".")[:-1]
    here = package[: len(package) + 1 - node.level] if node.level else []
    return ".".join([*here, *([node.module] if node.module else [])])


def imports(module: str) -> set[str]:
    """Modules of the package that a module imports, and the first names of all others."""
    found = set()
    for node in NODES[module]:
        if isinstance(node, ast.ImportFrom):
            base = _base(module, node)
            found |= {f"{base}.{alias.name}" if f"{base}.{alias.name}" in PATHS else base for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {name if name in PATHS else name.partition(".")[0] for name in found} - {module}


GRAPH = OfModules(imports)


def circles(modules: set[str]) -> list[list[str]]:
    """Groups of modules that import each other, directly or through others of them."""

    def reached(start: str) -> set[str]:
        found, waiting = set(), [start]
        while waiting:
            for name in GRAPH[waiting.pop()] & modules - found:
                found.add(name)
                waiting.append(name)
        return found

    reach = {module: reached(module) for module in modules}
    groups = {tuple(sorted(name for name in reach[module] if module in reach[name])) for module in modules if module in reach[module]}
    return sorted(map(list, groups))
