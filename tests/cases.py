"""Tests that differ by values, written as a table."""

import pytest


def cases(names: str, *rows, **options) -> pytest.MarkDecorator:
    """A test for each row; ``names``, separated by commas, are those of its columns."""
    return pytest.mark.parametrize(names, rows, **options)
