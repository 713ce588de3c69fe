"""The bond or angle style of a deck and its coefficients, as data."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..language.lexer import Line


@dataclass
class BondedSetup:
    """Style of the bonds, or of the angles, and the coefficients of each type.

    Attributes
    ----------
    style : str
        ``none``, the style, or ``hybrid``.
    styles : tuple of str
        The styles of hybrid, or the one style.
    coefficients : dict
        By type: the name of its style and the arguments of its class in MD units.
    where : Line or None
        The line of the style.
    """

    style: str = "none"
    styles: tuple[str, ...] = ()
    coefficients: dict[int, tuple[str, dict[str, float]]] = field(default_factory=dict)
    where: Line | None = None
