"""The errors this package raises, all of them ``ValueError``: what is wrong, where, and what would be right.

Messages name quantities and beads in OpenMM's units and counted from 0 for a script, and as the deck does where one is carried out.
"""

import reprlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from html import escape
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np


class _Short(reprlib.Repr):
    """Values as they are typed, shortened: numbers of numpy as plain ones, arrays as lists, quantities with their unit."""

    def repr_instance(self, x, level):
        if isinstance(x, (np.generic, np.ndarray)):
            return self.repr1((x[: self.maxlist + 1] if isinstance(x, np.ndarray) and x.ndim else x).tolist(), level)
        return super().repr_instance(x, level)

    def repr_Quantity(self, x, level):
        return f"{self.repr1(x.value_in_unit(x.unit), level)} {x.unit.get_symbol()}"


_SHORT = _Short()
_SHORT.maxstring, _SHORT.maxother, _SHORT.maxlist, _SHORT.maxtuple = 60, 40, 4, 6


class DPDError(ValueError):
    """Base class of every error that openmm_dpd raises on purpose."""


class ParameterError(DPDError):
    """A value given by the user is missing, out of range, of the wrong shape or contradicts another one."""


class PlanError(DPDError):
    """The scene is valid, but cannot be built with these choices."""


class ProgramError(DPDError):
    """An integrator program uses a name it never declared, or breaks a rule that OpenMM would not report."""


class RunError(DPDError):
    """Something went wrong while stepping (a NaN, a bead that left the box, a temperature out of bounds)."""


class OutputError(DPDError):
    """A file of results cannot be written; what could be is kept."""


class DeckError(DPDError):
    """A LAMMPS deck or data file cannot be read or asks for something that is not supported.

    Parameters
    ----------
    message : str
        What is wrong.
    file : str, optional
        The file that has it.
    line : int, optional
        Line number, counted from 1.
    """

    def __init__(self, message: str, file: str | None = None, line: int | None = None):
        self.message, self.file, self.line = message, file, line
        where = "" if file is None else f"{file}: " if line is None else f"{file}:{line}: "
        super().__init__(where + message)

    def __reduce__(self):
        return type(self), (self.message, self.file, self.line)


def what_is(value) -> str:
    """What a wrong argument is, in a few words: numbers, text, arrays and collections themselves, if short, of everything else the type.

    A whole scene or system in a message would be thousands of lines.
    """
    kind, name = type(value).__name__, getattr(value, "__name__", None)
    if value is None or kind == "Quantity" or isinstance(value, (int, float, str, bytes, list, tuple, dict, set, np.generic, np.ndarray)):
        return _SHORT.repr(value)
    if isinstance(value, type):
        return f"the class {name}"
    if callable(value) and name is not None:
        return f"the function {name}; call it: {name}()"
    return f"{'an' if kind[:1] in 'AEIOUaeiou' else 'a'} {kind}"


def optional_package(name: str, extra: str, what: str) -> ModuleType:
    """The module of a name, such as ``gsd.hoomd``; ParameterError, which says what needs it and which extra installs it, if it is not
    there."""
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ParameterError(
            f"{what} the package {package}, which cannot be imported ({error}); install it: pip install 'openmm-dpd[{extra}]'"
        ) from None


#: The deck whose author reads: something with ``units`` (:class:`openmm_dpd.base.units.UnitSystem`) and ``atoms``, whose ``ids`` are the
#: beads'.
_DECK: ContextVar[Any] = ContextVar("deck", default=None)
#: What scripts read.
_NAMES = {"length": "nm", "time": "ps", "energy": "kJ/mol", "force": "kJ/mol/nm", "inverse_length": "/nm", "rate": "/ps"}
_NAMES["thermal_energy"] = "kJ/mol"


@contextmanager
def read_by(deck: Any) -> Iterator[None]:
    """A block whose messages are for the author of a deck."""
    token = _DECK.set(deck)
    try:
        yield
    finally:
        _DECK.reset(token)


def either(script: str, deck: str) -> str:
    """Words for the author of a script, or others for that of a deck."""
    return script if _DECK.get() is None else deck


def in_units(value: float, dimension: str, digits: int = 6) -> str:
    """A number in MD units with its unit, or the same in the deck's, where reduced units have no name."""
    return f"{in_number(value, dimension, digits)} {unit_name(dimension)}".rstrip()


def in_number(value: float, dimension: str, digits: int = 6) -> str:
    """The number without its unit."""
    deck = _DECK.get()
    return f"{value if deck is None else value / getattr(deck.units, dimension, 1.0):.{digits}g}"


def unit_name(dimension: str) -> str:
    """The unit, as in ``nm``; nothing for reduced units."""
    deck = _DECK.get()
    return _NAMES[dimension] if deck is None else deck.units.unit_names.get(dimension, "")


def in_length(value: float, digits: int = 6) -> str:
    """A length in nm with its unit, or in the deck's."""
    return in_units(value, "length", digits)


def thermal(kT: float) -> str:
    """A thermal energy in kJ/mol, or the deck's temperature."""
    return f"{either('kT =', 'temperature')} {in_units(kT, 'thermal_energy')}"


def bead_number(bead) -> int:
    """The number of a bead, from 0, or its id in the deck."""
    deck = _DECK.get()
    return int(bead if deck is None else deck.atoms.ids[bead])


def bead_names(*indices: int) -> str:
    """Beads by their numbers from 0, which is said, or by their ids in the deck."""
    *first, last = (str(bead_number(index)) for index in indices)
    return f"beads {', '.join(first)} and {last}" + either(" (counted from 0)", "")


def overstretched(pairs: np.ndarray, r: np.ndarray, longest: np.ndarray, epsilon: np.ndarray) -> str | None:
    """What is wrong with the first FENE bond (of ``pairs``, of the length r) that has no finite energy, or None."""
    bad = np.flatnonzero(~(r < longest))
    if len(bad):
        limit = f"its R0 of {in_length(longest[bad[0]])}"
        return f"the FENE bond between {bead_names(*pairs[bad[0]])} is {in_length(r[bad[0]])} long, which is not less than {limit}"
    bad = np.flatnonzero((r == 0) & (epsilon > 0))
    return f"{bead_names(*pairs[bad[0]])} are at the same point, where the repulsion of their FENE bond is infinite" if len(bad) else None


def fact_table(title: str, facts: Mapping[str, object]) -> str:
    """An HTML table of names and values; None leaves a row out."""
    rows = (f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in facts.items() if value is not None)
    return f"<table><caption>{escape(title)}</caption>{''.join(rows)}</table>"
