"""What single commands of a deck say, as plain data: fixes, computes, thermo output, the sum over charges."""

from dataclasses import dataclass, field
from typing import Any

from ...errors import DeckError, ParameterError
from ..language.lexer import Line, located


@dataclass(frozen=True)
class Fix:
    """One fix: its id, group and style, its parameters and where it stands."""

    name: str
    group: str
    style: str
    parameters: dict
    where: Line

    def error(self, message: str) -> DeckError:
        """An error about this fix."""
        return located(self.where, f"fix {self.name}: {message}")


#: Fixes that change the forces on single beads; their parameter ``force`` has three formulas, or NULL.
FORCE_FIXES = ("addforce", "setforce", "gravity")

#: Those whose vector is the total force on their group before they act.
VECTOR_FIXES = ("addforce", "setforce")


class Valued:
    """A fix with values that formulas name.

    Attributes
    ----------
    name : str
        Its id.
    shape : tuple of (int or None)
        How many values ``f_id`` (no index), ``f_id[i]`` or ``f_id[i][j]`` has by each index; None where that may change.
    what : str
        What they are, for errors.
    """

    name: str
    shape: tuple[int | None, ...]
    what: str

    @property
    def size(self) -> int:
        """Number of values that ``f_id[*]`` stands for."""
        return (self.shape[0] or 0) if len(self.shape) == 1 else 0

    def is_extensive(self, *indices: int) -> bool:
        """Whether thermo output divides such a value by the number of beads when it normalises."""
        return False

    def check_index(self, *indices: int) -> None:
        """ParameterError unless there is such a value."""
        if len(indices) != len(self.shape):
            usage = f"f_{self.name}" + ("", f"[1] to f_{self.name}[{self.size}]", "[row][column]")[len(self.shape)]
            raise ParameterError(f"f_{self.name}: {self.what}; use {usage}")
        if any(index < 1 or (size is not None and index > size) for index, size in zip(indices, self.shape, strict=True)):
            raise ParameterError(f"f_{self.name}{''.join(f'[{index}]' for index in indices)} is out of range: {self.what}")


@dataclass(frozen=True)
class ForceVector(Valued):
    """The vector of a fix addforce or setforce: the total force on its group before it acted."""

    name: str
    shape = (3,)
    what = "its values are the three components of the force before it acts"

    def is_extensive(self, *indices: int) -> bool:
        """It is a sum over beads."""
        return True


@dataclass(frozen=True)
class Compute:
    """One compute as the deck defines it: id, group, style, arguments, and what ``ComputeSpec.prepare`` made of them."""

    name: str
    group: str
    style: str
    arguments: tuple[str, ...] = ()
    settings: Any = None


@dataclass(frozen=True)
class KspaceSetup:
    """What ``kspace_style`` and ``kspace_modify`` said: accuracy, gewald (1/nm), mesh, and the line."""

    accuracy: float = 1e-4
    gewald: float | None = None
    mesh: tuple[int, ...] | None = None
    where: Line | None = None


@dataclass
class RestartSettings:
    """What ``restart`` said: interval (0: none), names of files, of which ``*`` becomes the step, and how many are written already."""

    every: int = 0
    files: tuple[str, ...] = ()
    written: int = 0


@dataclass
class ThermoSettings:
    """What thermo output looks like: columns, interval, normalisation, computes to use and formats."""

    words: list[str] = field(default_factory=lambda: ["step", "temp", "epair", "emol", "etotal", "press"])
    every: int = 0
    norm: bool | None = None
    temp: str = "thermo_temp"
    press: str = "thermo_press"
    layout: str = "one"
    formats: dict[str | int, str] = field(default_factory=dict)
    headers: dict[str | int, str] = field(default_factory=dict)
