"""What single commands of a deck say, as plain data: fixes, computes, thermo output, the sum over charges."""

from __future__ import annotations

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


#: Fixes that change the forces on single beads.
FORCE_FIXES = ("addforce", "setforce")


@dataclass(frozen=True)
class ForceVector:
    """The vector of a fix addforce or setforce: the total force on its group before it acted."""

    name: str
    size: int = 3

    def is_extensive(self, *indices: int) -> bool:
        """Sums over beads are what thermo output divides by their number when it normalises."""
        return True

    def check_index(self, *indices: int) -> None:
        """ParameterError unless ``f_id[index]`` is one of its values."""
        if len(indices) != 1 or not 1 <= indices[0] <= self.size:
            raise ParameterError(f"f_{self.name}: its values are the force before it acts, f_{self.name}[1] to f_{self.name}[3]")


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
