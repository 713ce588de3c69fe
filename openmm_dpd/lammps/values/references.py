"""Words that name values: ``c_id``, ``f_id`` and ``v_name``, perhaps with one or two indices."""

from __future__ import annotations

import re
from typing import NamedTuple

from ...errors import ParameterError

_FORM = re.compile(r"([cfv])_(\w+?)((?:\[\d+\]){0,2})", re.ASCII)


class Reference(NamedTuple):
    """What a word names: kind (``c``, ``f`` or ``v``), id, and its indices."""

    kind: str
    name: str
    indices: tuple[int, ...]

    @property
    def first(self) -> int | None:
        """The first index, None without one."""
        return self.indices[0] if self.indices else None

    @property
    def second(self) -> int | None:
        """The second one."""
        return self.indices[1] if len(self.indices) > 1 else None


def reference(word: str) -> Reference:
    """The parts of a word that begins with ``c_``, ``f_`` or ``v_``; ParameterError if it is malformed."""
    match = _FORM.fullmatch(word)
    if match is None:
        start = word[:2]
        raise ParameterError(f"expected {start}id, {start}id[index] or {start}id[row][column], not '{word}'")
    return Reference(match[1], match[2], tuple(map(int, re.findall(r"\d+", match[3]))))
