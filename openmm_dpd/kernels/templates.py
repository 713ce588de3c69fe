"""Loops that are written once for all that is done inside them."""

from collections.abc import Callable
from types import FunctionType
from typing import Any


def renamed(function: Callable, name: str, names: dict[str, Any] | None = None) -> FunctionType:
    """A copy of a Python function under another name, in which ``names`` take the place of global names that it uses."""
    known = {**function.__globals__, **names} if names else function.__globals__
    copy = FunctionType(function.__code__, known, name, function.__defaults__)
    copy.__qualname__, copy.__module__, copy.__doc__ = name, function.__module__, function.__doc__
    return copy
