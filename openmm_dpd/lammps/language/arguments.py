"""Reading the arguments of commands: each helper names the argument and the value it did not like."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

from ...errors import ParameterError

T = TypeVar("T")


def as_float(word: str) -> float:
    """A number in plain ASCII digits; ValueError for what only Python takes for one (2_5, digits of other scripts)."""
    if "_" in word or not word.isascii():
        raise ValueError(word)
    return float(word)


def as_integer(word: str) -> int:
    """The same for whole numbers."""
    if "_" in word or not word.isascii():
        raise ValueError(word)
    return int(word)


def number(word: str, what: str) -> float:
    """A finite number."""
    try:
        value = as_float(word)
    except ValueError:
        raise ParameterError(f"expected a number for {what}, not '{word}'") from None
    if not math.isfinite(value):
        raise ParameterError(f"{what} must be finite, but is {word}")
    return value


def positive(word: str, what: str) -> float:
    """A number > 0."""
    value = number(word, what)
    if value <= 0:
        raise ParameterError(f"{what} must be > 0, but is {word}")
    return value


def non_negative(word: str, what: str) -> float:
    """A number >= 0."""
    value = number(word, what)
    if value < 0:
        raise ParameterError(f"{what} must be >= 0, but is {word}")
    return value


def integer(word: str, what: str, minimum: int | None = None) -> int:
    """A whole number, not below ``minimum``."""
    try:
        value = as_integer(word)
    except ValueError:
        raise ParameterError(f"expected a whole number for {what}, not '{word}'") from None
    if minimum is not None and value < minimum:
        raise ParameterError(f"{what} must be at least {minimum}, but is {value}")
    return value


def switch(word: str, what: str) -> bool:
    """Yes or no."""
    try:
        return {"yes": True, "on": True, "true": True, "no": False, "off": False, "false": False}[word]
    except KeyError:
        raise ParameterError(f"expected yes or no for {what}, not '{word}'") from None


def known(table: Mapping[str, T], name: str, what: str) -> T:
    """The entry of a table by its name."""
    if name not in table:
        raise ParameterError(f"there is no {what} '{name}'; defined so far: {', '.join(table) or 'none'}")
    return table[name]


def identifier(word: str, what: str) -> str:
    """A name of letters, digits and underscores."""
    if not word or not all(char.isascii() and (char.isalnum() or char == "_") for char in word):
        raise ParameterError(f"{what} has letters, digits and underscores only, not '{word}'")
    return word


def choice(word: str, what: str, allowed: Sequence[str]) -> str:
    """One of a few words."""
    if word not in allowed:
        raise ParameterError(f"{what} must be one of {', '.join(allowed)}, not '{word}'")
    return word


def count(args: Sequence[str], usage: str, minimum: int, maximum: int | None = -1) -> None:
    """Raise ParameterError unless the number of arguments fits; ``maximum`` -1 means exactly ``minimum``, None any number above."""
    most = minimum if maximum == -1 else maximum
    if len(args) < minimum or (most is not None and len(args) > most):
        raise ParameterError(f"expected '{usage}', but found {len(args)} argument{'s' * (len(args) != 1)}: {' '.join(args)}".rstrip(": "))


def numeric_range(word: str, highest: int, what: str) -> range:
    """The numbers that ``3``, ``*``, ``2*``, ``*4`` or ``2*4`` stands for.

    Parameters
    ----------
    word : str
        The range.
    highest : int
        Largest number there is; the smallest is 1.
    what : str
        What is counted ("atom type"), for the message.
    """
    low, star, high = word.partition("*")
    try:
        first = as_integer(low) if low else 1
        last = (as_integer(high) if high else highest) if star else first
        if not star and not low:
            raise ValueError
    except ValueError:
        raise ParameterError(f"expected {what} as a number or a range such as 1*3, not '{word}'") from None
    if not 1 <= first <= highest or not first <= last <= highest:
        raise ParameterError(f"{what} {word} is out of range: there are {highest}")
    return range(first, last + 1)


def id_ranges(words: Sequence[str], what: str) -> list[tuple[int, int, int]]:
    """Inclusive (first, last, stride) of words such as ``7``, ``1:8`` and ``1:100:10``."""
    found = []
    for word in words:
        parts = [integer(part, what) for part in word.split(":")]
        if len(parts) > 3 or (len(parts) == 3 and parts[2] < 1):
            raise ParameterError(f"expected {what} as n, n:m or n:m:step, not '{word}'")
        found.append((parts[0], parts[-1] if len(parts) == 1 else parts[1], parts[2] if len(parts) == 3 else 1))
    return found


def options(args: Sequence[str], sizes: dict[str, int], command: str) -> list[tuple[str, list[str]]]:
    """Keyword-value groups at the end of a command: ``sizes`` says how many values follow each keyword."""
    found = []
    index = 0
    while index < len(args):
        keyword = args[index]
        if keyword not in sizes:
            raise ParameterError(f"{command} has no option '{keyword}' here; supported are {', '.join(sizes)}")
        values = list(args[index + 1 : index + 1 + sizes[keyword]])
        if len(values) < sizes[keyword]:
            raise ParameterError(f"option '{keyword}' of {command} needs {sizes[keyword]} values, but {len(values)} follow")
        found.append((keyword, values))
        index += 1 + sizes[keyword]
    return found
