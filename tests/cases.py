"""What most tests use: tables of cases, calls that have to fail, files to begin with."""

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest


def cases(names: str, *rows, **options) -> pytest.MarkDecorator:
    """A test for each row; ``names``, separated by commas, are those of its columns.  A mapping in their place has rows by their ids."""
    if len(rows) == 1 and isinstance(rows[0], dict):
        return pytest.mark.parametrize(names, rows[0].values(), ids=map(str, rows[0]), **options)
    return pytest.mark.parametrize(names, rows, **options)


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
