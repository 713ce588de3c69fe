"""How many small mistakes in kernels, programs and plans the tests notice.

Lines of code are drawn at random from ``openmm_dpd/kernels``, ``simulation/programs`` and ``plan``; on each, one thing is changed (an operator, a
comparison, a number, a truth value, a sign, or what is assigned), and tests run until one fails: first those that name the module, then those of
its room, none of the slow ones. The tree is changed and put back, so let it be one of its own:

    git worktree add --detach ../mutants
    python docs/measure/mutants.py ../mutants mutants.txt   # some hours of one core; goes on with a file that is there

Each line of the file says where, what became what, and "noticed" with the test, "survived", or "too long" where none had failed in five minutes.
Kernels on disk are found by what is compiled, so none of another change is ever taken.
"""

from __future__ import annotations

import ast
import os
import random
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

COUNT, SEED, LONGEST = 60, 1, 300.0  # seconds
#: Folders that are changed, and tests behind those that name the module.
ROOMS = {
    "kernels": "kernel_forces kernel_sweeps kernel_cells kernel_energy kernel_charges kernel_bonded whole_steps",
    "simulation/programs": "programs schemes steps whole_steps_beside flow",
    "plan": "execution plan_least schemes errors mixed_system changes_between_steps toy_engine",
}
#: What takes the place of an operator.
OTHER = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Pow: "*", ast.BitOr: "&", ast.BitAnd: "|",
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==", ast.In: "not in", ast.NotIn: "in",
    ast.Is: "is not", ast.IsNot: "is", ast.And: "or", ast.Or: "and",
}  # fmt: skip
OPERATOR = re.compile(r"(?:not\s+in|is\s+not|and|or|in|is)\b|\*\*|//|[<>=!]=|[-+*/<>|&]")


def code_of(tree: ast.Module) -> Iterator[ast.AST]:
    """Nodes that do something: no imports, decorators, annotations or texts."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        yield (node := waiting.pop())
        parts = [part for name, part in ast.iter_fields(node) if name not in ("decorator_list", "annotation", "returns")]
        found = [n for part in parts for n in (part if isinstance(part, list) else [part])]
        waiting += [n for n in found if isinstance(n, ast.AST) and not isinstance(n, ast.Import | ast.ImportFrom | ast.JoinedStr)]


def changes(source: str) -> Iterator[tuple[int, int, str]]:
    """Each small change: from and to which character, and what takes its place."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    begin = lambda node: starts[node.lineno - 1] + node.col_offset  # noqa: E731
    end = lambda node: starts[node.end_lineno - 1] + node.end_col_offset  # noqa: E731
    for node in code_of(ast.parse(source)):
        pairs: list = []
        match node:
            case ast.BinOp(left=left, op=op, right=right) | ast.AugAssign(target=left, op=op, value=right):
                pairs = [(left, op, right)]
            case ast.Compare(left=left, ops=ops, comparators=others):
                pairs = list(zip([left, *others], ops, others, strict=False))
            case ast.BoolOp(op=op, values=values):
                pairs = [(first, op, second) for first, second in zip(values, values[1:], strict=False)]
            case ast.UnaryOp(op=ast.Not() | ast.USub() as op):
                yield begin(node), begin(node) + (3 if isinstance(op, ast.Not) else 1), ""
            case ast.Constant(value=bool(value)):
                yield begin(node), end(node), str(not value)
            case ast.Constant(value=int() | float() as value):
                yield begin(node), end(node), repr(value + 1)
            case ast.Assign(targets=[ast.Name()], value=value) if not isinstance(value, ast.Name):
                inside = list(ast.walk(value))
                taken = {id(n.func if isinstance(n, ast.Call) else n.value) for n in inside if isinstance(n, ast.Call | ast.Attribute)}
                bound = {n.id for n in inside if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
                names = [n.id for n in inside if isinstance(n, ast.Name) and id(n) not in taken and n.id.islower() and n.id not in bound]
                if names:
                    yield begin(value), end(value), names[0]
        for left, op, right in pairs:
            if type(op) in OTHER and (found := OPERATOR.search(source, end(left), begin(right))):
                yield found.start(), found.end(), OTHER[type(op)]


def drawn(root: Path) -> list[tuple[Path, int, int, str]]:
    """Random lines that something can be changed on, and one change of each."""
    lines: dict[tuple[Path, int], list[tuple[int, int, str]]] = {}
    for path in sorted(p for room in ROOMS for p in (root / "openmm_dpd" / room).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        for change in sorted(changes(source)):
            lines.setdefault((path, source.count("\n", 0, change[0]) + 1), []).append(change)
    rng = random.Random(SEED)
    return [(place[0], *rng.choice(lines[place])) for place in rng.sample(sorted(lines), COUNT)]


def tests_of(root: Path, path: Path) -> list[Path]:
    """Test files that name the module, those that are called after it first, small ones before large ones; then those of its room."""
    named = re.compile(rf"\b{path.parent.name}(\.| import [^\n]*\b){path.stem}\b")
    files = {f.stem.removeprefix("test_"): f for f in root.glob("tests/*/test_*.py") if f.parent.name != "decks"}
    first = [name for name, f in files.items() if path.stem in name or named.search(f.read_text(encoding="utf-8"))]
    first.sort(key=lambda name: (path.stem not in name, files[name].stat().st_size))
    more = next(words for room, words in ROOMS.items() if f"openmm_dpd/{room}/" in path.as_posix())
    return [files[name] for name in dict.fromkeys([*first, *more.split()])]


def outcome(root: Path, tests: list[Path]) -> str:
    """What the tests say of the tree."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", *map(str, tests)]
    given = {"env": os.environ | {"PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}, "cwd": root, "start_new_session": True}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **given)
    try:
        text, _ = process.communicate(timeout=LONGEST)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return "too long"
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", text, re.MULTILINE)
    return "survived" if process.returncode == 0 else f"noticed by {failed[1] if failed else 'a crash, or at the start'}"


def main(tree: str, out: str) -> None:
    """Change, run and put back, line by line."""
    root, file = Path(tree).resolve(), Path(out)
    done = {line.split()[0] for line in file.read_text().splitlines()} if file.exists() else set()
    for number, (path, start, end, new) in enumerate(drawn(root), start=1):
        if str(number) in done:
            continue
        source = path.read_text(encoding="utf-8")
        changed, row = source[:start] + new + source[end:], source.count("\n", 0, start)
        try:
            path.write_text(changed, encoding="utf-8")
            said = outcome(root, tests_of(root, path))
        finally:
            path.write_text(source, encoding="utf-8")
        before, after = (text.splitlines()[row].strip() for text in (source, changed))
        with file.open("a", encoding="utf-8") as lines:
            print(f"{number} {path.relative_to(root)}:{row + 1}  {before}  ->  {after}  {said}", file=lines)


if __name__ == "__main__":
    main(*sys.argv[1:])
