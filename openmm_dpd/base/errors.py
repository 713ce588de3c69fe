"""The errors this package raises: all are ``ValueError``, all say what is wrong, where, and what would be right."""

import reprlib
from importlib import import_module
from types import ModuleType

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
