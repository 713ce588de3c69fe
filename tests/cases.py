"""What most tests use: tables of cases, calls that have to fail, files to begin with."""

from collections.abc import Callable
from pathlib import Path

import pytest


def cases(names: str, *rows, **options) -> pytest.MarkDecorator:
    """A test for each row; ``names``, separated by commas, are those of its columns."""
    return pytest.mark.parametrize(names, rows, **options)


def raises(error: type[BaseException] | tuple[type[BaseException], ...], match: str, call: Callable, /, *values, **named) -> None:
    """The call, with these arguments, fails with this error, and the message has what ``match`` looks for."""
    with pytest.raises(error, match=match):
        call(*values, **named)


def put(path: Path, text: str) -> Path:
    """A file with this text."""
    path.write_text(text, encoding="utf-8")
    return path
