"""Parsing of command arguments.  Every error names the argument and the invalid value."""

import difflib
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import TypeVar

import numpy as np

from ...base.errors import ParameterError

_ROWS = json.loads((files(__package__) / "deck_words.json").read_text(encoding="utf-8"))
#: What to write instead of an unsupported command or style; error messages add it after a colon.
INSTEAD: dict[str, str] = {name: row["write"] for row in _ROWS for name in row["instead of"]}


T = TypeVar("T")


def as_float(word: str) -> float:
    """Convert a word of ASCII digits to a float.  ValueError for spellings that only Python accepts (2_5, digits of other scripts)."""
    if "_" in word or not word.isascii():
        raise ValueError(word)
    return float(word)


def as_integer(word: str) -> int:
    """Convert a word of ASCII digits to an integer.  ValueError for spellings that only Python accepts (2_5, digits of other scripts)."""
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
    """A finite number > 0."""
    value = number(word, what)
    if value <= 0:
        raise ParameterError(f"{what} must be > 0, but is {word}")
    return value


def non_negative(word: str, what: str) -> float:
    """A finite number >= 0."""
    value = number(word, what)
    if value < 0:
        raise ParameterError(f"{what} must be >= 0, but is {word}")
    return value


def integer(word: str, what: str, minimum: int | None = None) -> int:
    """A whole number >= ``minimum``."""
    try:
        value = as_integer(word)
    except ValueError:
        raise ParameterError(f"expected a whole number for {what}, not '{word}'") from None
    if minimum is not None and value < minimum:
        raise ParameterError(f"{what} must be at least {minimum}, but is {value}")
    return value


def switch(word: str, what: str) -> bool:
    """A yes-or-no word as a boolean."""
    try:
        return {"yes": True, "on": True, "true": True, "no": False, "off": False, "false": False}[word]
    except KeyError:
        raise ParameterError(f"expected yes or no for {what}, not '{word}'") from None


def known(table: Mapping[str, T], name: str, what: str) -> T:
    """The entry of a table with this name.  ParameterError, with the names there are, if there is none."""
    if name not in table:
        raise ParameterError(f"there is no {what} '{name}'; defined so far: {', '.join(table) or 'none'}{near(name, table)}")
    return table[name]


def near(word: str, names: Iterable[str]) -> str:
    """The end of an error message about an unknown word: the most similar name, or the name without an accelerator suffix."""
    plain = re.sub(r"/(omp|kk|gpu|intel|opt)$", "", word)
    found = [plain] if plain in (names := list(names)) else difflib.get_close_matches(word, names, 1, 0.7)
    return f"; did you mean {found[0]}?" if found else ""


def style(table: Mapping[str, T], command: str, word: str, *others: str) -> T:
    """The entry of a table of styles.  ParameterError, with what to write instead or with the supported styles (``others`` included), if
    there is none."""
    if word not in table:
        names = [*table, *others]
        ending = (
            f": {INSTEAD[f'{command} {word}']}"
            if f"{command} {word}" in INSTEAD
            else f"; supported are {', '.join(names)}{near(word, names)}"
        )
        raise ParameterError(f"{command} style '{word}' is not supported{ending}")
    return table[word]


def identifier(word: str, what: str) -> str:
    """The word itself.  ParameterError unless it consists of letters, digits and underscores."""
    if not word or not all(char.isascii() and (char.isalnum() or char == "_") for char in word):
        raise ParameterError(f"{what} may contain only letters, digits and underscores, not '{word}'")
    return word


def choice(word: str, what: str, allowed: Sequence[str]) -> str:
    """The word itself.  ParameterError unless it is one of the allowed words."""
    if word not in allowed:
        raise ParameterError(f"{what} must be one of {', '.join(allowed)}, not '{word}'{near(word, allowed)}")
    return word


def count(args: Sequence[str], usage: str, minimum: int, maximum: int | None = -1) -> None:
    """Raise ParameterError unless the number of arguments is between ``minimum`` and ``maximum``; -1 means exactly ``minimum``, None no
    upper limit."""
    most = minimum if maximum == -1 else maximum
    if len(args) < minimum or (most is not None and len(args) > most):
        raise ParameterError(f"expected '{usage}', but found {len(args)} argument{'s' * (len(args) != 1)}: {' '.join(args)}".rstrip(": "))


def taken(args: Sequence[str], size: int, command: str) -> tuple[list[str], list[str]]:
    """Split the arguments of a command into its ``size`` leading values and the rest.  ParameterError if there are too few."""
    if len(args) < size:
        raise ParameterError(f"{command} needs {size} values, but {len(args)} follow{': ' * bool(args)}{' '.join(args)}")
    return list(args[:size]), list(args[size:])


def ramp(words: Sequence[str], component: Sequence[str], positions: np.ndarray, spacing: np.ndarray) -> tuple[int, np.ndarray]:
    """Parse ``component first last x|y|z low high``: return the axis of the component, and its values at ``positions`` (n, 3), which go
    linearly from ``first`` to ``last``.  ``component`` lists the words for the three axes; ``spacing`` scales all numbers."""
    axis = list(component).index(choice(words[0], "the component of ramp", component))
    along = "xyz".index(choice(words[3], "the direction of ramp", ("x", "y", "z")))
    first, last = (number(word, "a value of ramp") * spacing[axis] for word in words[1:3])
    low, high = (number(word, "a coordinate of ramp") * spacing[along] for word in words[4:6])
    if high <= low:
        raise ParameterError(f"the coordinates of ramp must increase, not {words[4]} to {words[5]}")
    return axis, first + np.clip((positions[:, along] - low) / (high - low), 0.0, 1.0) * (last - first)


def numeric_range(word: str, highest: int, what: str) -> range:
    """The numbers from 1 to ``highest`` selected by ``3``, ``*``, ``2*``, ``*4`` or ``2*4``; ``what`` names them in error messages."""
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
    """Inclusive (first, last, stride) ranges from words such as ``7``, ``1:8`` and ``1:100:10``."""
    found = []
    for word in words:
        parts = [integer(part, what) for part in word.split(":")]
        if len(parts) > 3 or (len(parts) == 3 and parts[2] < 1):
            raise ParameterError(f"expected {what} as n, n:m or n:m:step, not '{word}'")
        found.append((parts[0], parts[-1] if len(parts) == 1 else parts[1], parts[2] if len(parts) == 3 else 1))
    return found


def single(args: Sequence[str], command: str, **defaults: str) -> dict[str, str]:
    """Values of options that take one value each; ``defaults`` has the options and their defaults."""
    return defaults | {keyword: values[0] for keyword, values in options(args, dict.fromkeys(defaults, 1), command)}


#: Words for no and yes, as ``only`` of :func:`options` has them.
NO, YES = "no off false", "yes on true"


def options(
    args: Sequence[str],
    sizes: Mapping[str, int],
    command: str,
    alone: Mapping[str, str] | None = None,
    only: Mapping[str, tuple[str, str]] | None = None,
) -> list[tuple[str, list[str]]]:
    """Parse the keyword-value groups at the end of a command; ``sizes`` gives the number of values of each keyword.  ``alone`` lists, by
    keyword, a value after which no other values follow; ``only`` the supported values (perhaps none), and why there are no others."""
    found = []
    index = 0
    while index < len(args):
        keyword = args[index]
        if keyword not in sizes:
            raise ParameterError(f"{command} has no option '{keyword}' here; supported are {', '.join(sizes)}{near(keyword, sizes)}")
        values = list(args[index + 1 : index + 1 + sizes[keyword]])
        if alone is not None and values[:1] == [alone.get(keyword)]:
            values = values[:1]
        elif len(values) < sizes[keyword]:
            raise ParameterError(f"option '{keyword}' of {command} needs {sizes[keyword]} values, but {len(values)} follow")
        allowed, reason = (only or {}).get(keyword, (None, ""))
        if allowed is not None and values[0] not in allowed.split():
            raise ParameterError(f"{command} {keyword} {' '.join(values)} is not supported{': ' * bool(reason)}{reason}")
        found.append((keyword, values))
        index += 1 + len(values)
    return found
