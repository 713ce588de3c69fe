"""Errors of this package, all of them ``ValueError``: what is wrong, where, and what to do.

In scripts, messages use OpenMM's units and bead numbers from 0; while a deck runs, they use its units and ids.
"""

import reprlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from html import escape
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np


class _Short(reprlib.Repr):
    """Short representations of values: numpy's numbers as plain ones, arrays as lists, Quantities with their unit."""

    def repr_instance(self, x, level):
        if isinstance(x, (np.generic, np.ndarray)):
            return self.repr1((x[: self.maxlist + 1] if isinstance(x, np.ndarray) and x.ndim else x).tolist(), level)
        return super().repr_instance(x, level)

    def repr_Quantity(self, x, level):
        return f"{self.repr1(x.value_in_unit(x.unit), level)} {x.unit.get_symbol()}"


_SHORT = _Short()
_SHORT.maxstring, _SHORT.maxother, _SHORT.maxlist, _SHORT.maxtuple = 60, 40, 4, 6


class DPDError(ValueError):
    """Base class of all errors of openmm_dpd."""


class ParameterError(DPDError):
    """An input value is missing, out of bounds, of the wrong shape, or contradicts another one."""


class PlanError(DPDError):
    """The scene is valid, but cannot be built with these choices."""


class ProgramError(DPDError):
    """An integrator program uses an undeclared name, or breaks a rule that OpenMM does not check."""


class RunError(DPDError):
    """A run failed while stepping (a NaN, a bead that left the box, a temperature out of bounds)."""


class OutputError(DPDError):
    """A file of results cannot be written; what was written before is kept."""


class DeckError(DPDError):
    """A LAMMPS deck or data file cannot be read, or needs something that is not supported.

    Parameters
    ----------
    message : str
        What is wrong.
    file : str, optional
        File with the error.
    line : int, optional
        Line number, from 1.
    """

    def __init__(self, message: str, file: str | None = None, line: int | None = None):
        self.message, self.file, self.line = message, file, line
        where = "" if file is None else f"{file}: " if line is None else f"{file}:{line}: "
        super().__init__(where + message)

    def __reduce__(self):
        return type(self), (self.message, self.file, self.line)


def what_is(value) -> str:
    """A wrong argument in a few words, for messages: numbers, text, arrays and short collections themselves, of everything else the type.

    A scene or System written out would be thousands of lines.
    """
    kind, name = type(value).__name__, getattr(value, "__name__", None)
    if value is None or kind == "Quantity" or isinstance(value, (int, float, str, bytes, list, tuple, dict, set, np.generic, np.ndarray)):
        return _SHORT.repr(value)
    if isinstance(value, type):
        return f"the class {name}"
    if callable(value) and name is not None:
        return f"the function {name}; call it: {name}()"
    return f"{'an' if kind[:1] in 'AEIOUaeiou' else 'a'} {kind}"


def require(value, kind, wanted: str) -> None:
    """Raise ParameterError, whose text begins with what is ``wanted``, unless a value is of a type, or of one of several."""
    if not isinstance(value, kind):
        raise ParameterError(f"{wanted}, not {what_is(value)}")


def require_one(value, known: Iterable[str], what: str) -> None:
    """Raise ParameterError unless a value, which is ``what``, is one of these words."""
    if not isinstance(value, str) or value not in known:
        raise ParameterError(f"{what} must be one of {', '.join(known)}, not {what_is(value)}")


#: What :func:`require` says of a context.
A_CONTEXT = "context must be an openmm.Context, such as simulation.context"


def optional_package(name: str, extra: str, what: str) -> ModuleType:
    """Import and return a module such as ``gsd.hoomd``; if it is missing, ParameterError names what needs it and the extra that installs
    it."""
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ParameterError(
            f"{what} the package {package}, which cannot be imported ({error}); install it: pip install 'openmm-dpd[{extra}]'"
        ) from None


#: The deck that is running, if any: an object with ``units`` (:class:`openmm_dpd.base.units.UnitSystem`) and ``atoms``, whose ``ids`` are
#: those of the beads.
_DECK: ContextVar[Any] = ContextVar("deck", default=None)
#: Default for scripts.
_NAMES = {"length": "nm", "time": "ps", "energy": "kJ/mol", "force": "kJ/mol/nm", "inverse_length": "/nm", "rate": "/ps"}
_NAMES["thermal_energy"] = "kJ/mol"


@contextmanager
def read_by(deck: Any) -> Iterator[None]:
    """A block in which messages are for the author of a deck."""
    token = _DECK.set(deck)
    try:
        yield
    finally:
        _DECK.reset(token)


def either(script: str, deck: str) -> str:
    """One of two texts: for the author of a script, or while a deck runs for that of the deck."""
    return script if _DECK.get() is None else deck


def in_units(value: float, dimension: str, digits: int = 6) -> str:
    """A number in MD units as text with its unit, or in the deck's units, which have no name if reduced."""
    return f"{in_number(value, dimension, digits)} {unit_name(dimension)}".rstrip()


def in_number(value: float, dimension: str, digits: int = 6) -> str:
    """A number in MD units as text, converted to the deck's units while one runs, without its unit."""
    deck = _DECK.get()
    return f"{value if deck is None else value / getattr(deck.units, dimension, 1.0):.{digits}g}"


def unit_name(dimension: str) -> str:
    """Name of the unit of a dimension, such as ``nm``; empty for reduced units."""
    deck = _DECK.get()
    return _NAMES[dimension] if deck is None else deck.units.unit_names.get(dimension, "")


def in_length(value: float, digits: int = 6) -> str:
    """A length in nm as text with its unit, or in the deck's unit while one runs."""
    return in_units(value, "length", digits)


def thermal(kT: float) -> str:
    """A thermal energy in kJ/mol as text, or the deck's temperature while one runs."""
    return f"{either('kT =', 'temperature')} {in_units(kT, 'thermal_energy')}"


def bead_number(bead) -> int:
    """Number of a bead, from 0, or its id in the deck while one runs."""
    deck = _DECK.get()
    return int(bead if deck is None else deck.atoms.ids[bead])


def bead_names(*indices: int) -> str:
    """Beads as text: their numbers "(counted from 0)", or their ids in the deck while one runs."""
    *first, last = (str(bead_number(index)) for index in indices)
    return f"beads {', '.join(first)} and {last}" + either(" (counted from 0)", "")


def overstretched(pairs: np.ndarray, r: np.ndarray, longest: np.ndarray, epsilon: np.ndarray) -> str | None:
    """Error message about the first FENE bond (of ``pairs``, with lengths r) without a finite energy, or None."""
    bad = np.flatnonzero(~(r < longest))
    if len(bad):
        limit = f"its R0 of {in_length(longest[bad[0]])}"
        return f"the FENE bond between {bead_names(*pairs[bad[0]])} is {in_length(r[bad[0]])} long, which is not less than {limit}"
    bad = np.flatnonzero((r == 0) & (epsilon > 0))
    return f"{bead_names(*pairs[bad[0]])} are at the same point, where the repulsion of their FENE bond is infinite" if len(bad) else None


def out_of_range(name: str, pairs: np.ndarray, r: np.ndarray, low: np.ndarray, high: np.ndarray, end: str) -> str | None:
    """Error message about the first bond (of ``pairs``, with lengths r) that is not between low and high, or None; ``end`` says why."""
    bad = np.flatnonzero((r <= low) | (r >= high))
    if not len(bad):
        return None
    ends = " and ".join(in_length(limit[bad[0]]) for limit in (low, high) if limit[bad[0]] > 0)
    return f"the {name} bond between {bead_names(*pairs[bad[0]])} is {in_length(r[bad[0]])} long{end} {ends}"


#: What ends bonds: :func:`out_of_range`.
NONLINEAR_END = ", which is not between its limits"
QUARTIC_END = ": a bond that breaks ends a run here, and it does so at its Rc of"


def fact_table(title: str, facts: Mapping[str, object]) -> str:
    """An HTML table of names and values; rows with the value None are left out."""
    rows = (f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in facts.items() if value is not None)
    return f"<table><caption>{escape(title)}</caption>{''.join(rows)}</table>"
