"""What most tests use: tables of cases, calls that have to fail, files to begin with."""

import importlib.util
import itertools
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import ModuleType

import pytest


def cases(names: str, *rows, **options) -> pytest.MarkDecorator:
    """A test for each row; ``names``, separated by commas, are those of its columns.  A mapping in their place has rows by their ids."""
    if len(rows) == 1 and isinstance(rows[0], dict):
        return pytest.mark.parametrize(names, rows[0].values(), ids=map(str, rows[0]), **options)
    return pytest.mark.parametrize(names, rows, **options)


def each_with(rows: Iterable, of_row: Callable[..., Sequence], count: int) -> list[tuple]:
    """Each row with so many of the values that ``of_row`` gives for it; the next row goes on where this one ended."""
    found: list[tuple] = []
    for row in rows:
        row = row if isinstance(row, tuple) else (row,)
        values, begin = of_row(*row), len(found)
        found += [(*row, values[(begin + k) % len(values)]) for k in range(min(count, len(values)))]
    return found


def every_pair(names: str, *axes: Sequence, **options) -> pytest.MarkDecorator:
    """Tests in which every two values of different axes are together at least once: fewer than all combinations of three axes or more."""
    left = {(a, i, b, j) for a, b in itertools.combinations(range(len(axes)), 2) for i in range(len(axes[a])) for j in range(len(axes[b]))}
    rows, chosen = list(itertools.product(*(range(len(axis)) for axis in axes))), []

    def pairs(row: tuple[int, ...]) -> set:
        return {(a, row[a], b, row[b]) for a, b in itertools.combinations(range(len(axes)), 2)}

    while left:
        best = max(rows, key=lambda row: len(left & pairs(row)))
        left -= pairs(best)
        chosen.append(tuple(axis[k] for axis, k in zip(axes, best, strict=True)))
    return pytest.mark.parametrize(names, chosen, ids=lambda value: getattr(value, "__name__", str(value)), **options)


def refused(error: type[BaseException], *rows) -> Callable:
    """A test of calls that have to fail, with this error and the message beside each of them; rows as :func:`cases` takes them."""

    @cases("call, match", *rows)
    def test(call, match):
        raises(error, match, call)

    return test


def raises(error: type[BaseException] | tuple[type[BaseException], ...], match: str, call: Callable, /, *values, **named) -> None:
    """The call, with these arguments, fails with this error, and the message has what ``match`` looks for."""
    with pytest.raises(error, match=match):
        call(*values, **named)


def put(path: Path, text: str) -> Path:
    """A file with this text."""
    path.write_text(text, encoding="utf-8")
    return path


def script(path: Path) -> ModuleType:
    """A script as a module, which is not main."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look themselves up
    spec.loader.exec_module(module)
    return module
