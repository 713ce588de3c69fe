"""Calls that have to fail."""

from collections.abc import Callable

import pytest


def raises(error: type[BaseException] | tuple[type[BaseException], ...], match: str, call: Callable, /, *values, **named) -> None:
    """The call, with these arguments, fails with this error, and the message has what ``match`` looks for."""
    with pytest.raises(error, match=match):
        call(*values, **named)
