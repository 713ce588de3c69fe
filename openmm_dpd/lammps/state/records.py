"""What single commands of a deck say, as plain data: fixes, computes, dumps, thermo output, the sum over charges."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ...dcd import DCDWriter
from ...errors import DeckError
from ...files import BlockFile
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


@dataclass(frozen=True)
class Compute:
    """One compute as the deck defines it: id, group, style, arguments, and what ``ComputeSpec.prepare`` made of them."""

    name: str
    group: str
    style: str
    arguments: tuple[str, ...] = ()
    settings: Any = None


@dataclass
class Dump:
    """One dump.

    Attributes
    ----------
    name, group, style : str
        Its id, group and style.
    every : int
        Interval in steps.
    file : str
        File name; a ``*`` makes one file per configuration, named after the step.
    columns : tuple of str
        Columns of the text styles.
    append, first, unwrap : bool
        Settings of dump_modify, and ``formats`` by column.
    last_step : int or None
        Step of the last configuration that was written.
    opened : BlockFile or DCDWriter or None
        The file, once something is in it.
    """

    name: str
    group: str
    style: str
    every: int
    file: str
    columns: tuple[str, ...] = ()
    append: bool = False
    first: bool = False
    unwrap: bool = False
    formats: dict[str, str] = field(default_factory=dict)
    last_step: int | None = None
    opened: BlockFile | DCDWriter | None = field(default=None, repr=False)


@dataclass(frozen=True)
class KspaceSetup:
    """What ``kspace_style`` and ``kspace_modify`` said: accuracy, gewald (1/nm), mesh, and the line."""

    accuracy: float = 1e-4
    gewald: float | None = None
    mesh: tuple[int, ...] | None = None
    where: Line | None = None


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
