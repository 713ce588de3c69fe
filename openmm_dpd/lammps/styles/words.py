"""Shared parts of styles: numeric coefficients in both directions, settings such as ``T cutoff seed``, and what exports need: groups,
styles, and the differences between a scene and LAMMPS; styles of bonds, angles, dihedrals and impropers."""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.pairs import NONE
from ...model.scene import Scene
from ...plan.kinds import BONDED_KINDS, BondedKind
from ..language import arguments as read
from ..state.pair_setup import Coefficient, Find, PairStyle, Term, Values

#: Value of the deck's unit in MD units, by dimension.
FACTORS: dict[str, Callable[[UnitSystem], float]] = {
    "1": lambda units: 1.0,
    "length": lambda units: units.length,
    "1/length": lambda units: 1.0 / units.length,
    "energy": lambda units: units.energy,
    "energy/length^2": lambda units: units.energy / units.length**2,
    "energy/length^4": lambda units: units.energy / units.length**4,
    "degrees": lambda units: np.pi / 180.0,
    "1/area": lambda units: units.length**-2,
    "energy*length": lambda units: units.energy * units.length,
    "energy*length^6": lambda units: units.energy * units.length**6,
    "force": lambda units: units.force,
    "force/kT": lambda units: units.force / units.thermal_energy,
    "force/density": lambda units: units.force * units.length**3 / units.mass,
    "friction": lambda units: units.friction,
    "noise": lambda units: units.noise,
    "1/time": lambda units: 1 / units.time,
    "energy*kT/time": lambda units: units.conduction,
}


@dataclass(frozen=True)
class Columns:
    """Names of numeric coefficients, in the order of the command, and their dimensions (:data:`FACTORS`)."""

    dimensions: dict[str, str]

    def __len__(self) -> int:
        return len(self.dimensions)

    def read(self, words: list[str]) -> dict[str, float]:
        """Values from the first words, in the deck's units."""
        return {name: read.number(word, name) for name, word in zip(self.dimensions, words, strict=False)}

    def coefficient(self, style: PairStyle, words: list[str], find: Find) -> Values:
        """Values from ``words``, and the optional cutoff after them; ``Spec.coefficient`` of most styles."""
        read.count(words, f"{' '.join(self.dimensions)} [cutoff]", len(self), len(self) + 1)
        return self.read(words), cutoff_of(words, len(self))

    def to_md(self, values: dict[str, Any], units: UnitSystem) -> dict[str, Any]:
        """The named values, in MD units."""
        return {name: values[name] * FACTORS[dimension](units) for name, dimension in self.dimensions.items() if name in values}

    def builder(self, kind: Callable[..., object]) -> Callable[[PairStyle, Coefficient, UnitSystem], Term]:
        """``Spec.build`` of a style whose terms are ``kind(**values, cutoff=...)``."""

        def build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
            return kind(**self.to_md(found.values, units), cutoff=style.cutoff(found) * units.length), None  # type: ignore[operator]

        return build

    def of(self, term: Any, units: UnitSystem) -> list:
        """The named attributes of a term of the model, in the deck's units."""
        return [getattr(term, name) / FACTORS[dimension](units) for name, dimension in self.dimensions.items()]


def cutoff_of(words: list[str], at: int) -> float | None:
    """The cutoff given by the word at this index; None if there is no such word."""
    if len(words) > at and read.number(words[at], "the cutoff") == 0:
        raise ParameterError("the cutoff must be > 0, but is 0; use 'pair_coeff i j none' for types that do not interact")
    return read.positive(words[at], "the cutoff") if len(words) > at else None


def no_force(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    """``Spec.build`` of a style without forces between pairs of beads."""
    return NONE, None


#: Arguments of pair_style commands: the settings they define, their parser, and their name in error messages.
_WORDS: dict[str, tuple[tuple[str, ...], Callable[[str, str], float], str]] = {
    "T": (("start", "stop"), read.non_negative, "the temperature"),
    "Tstart": (("start",), read.non_negative, "the temperature"),
    "Tstop": (("stop",), read.non_negative, "the temperature"),
    "cutoff": (("cutoff",), read.positive, "the cutoff"),
    "cut_dpd": (("cutoff",), read.positive, "the cutoff"),
    "cut_coul": (("cutoff_charges",), read.positive, "the cutoff of the charges"),
    "kappa": (("kappa",), read.non_negative, "kappa"),
    "lambda": (("lamda",), read.positive, "lambda"),
    **{name: ((name,), read.non_negative, name) for name in ("n", "alpha_C")},
    "seed": (("seed",), lambda word, what: read.integer(word, what, 1), "the seed"),
}


def settings(name: str, usage: str) -> Callable[[list[str]], dict]:
    """``Spec.settings`` of a style whose arguments are entries of :data:`_WORDS`, such as ``T cutoff seed``."""

    def reader(words: list[str]) -> dict:
        read.count(words, f"{name} {usage}".strip(), len(usage.split()))
        found: dict = {}
        for kind, word in zip(usage.split(), words, strict=True):
            names, read_one, what = _WORDS[kind]
            found |= dict.fromkeys(names, read_one(word, f"{what} of {name}"))
        return found

    return reader


Pair = tuple[str, str]


class ExportWarning(UserWarning):
    """LAMMPS will behave differently from the scene; the message describes the difference."""


@dataclass
class Differences:
    """Differences between an exported deck and its scene, in the order found; each becomes a warning and a comment in the deck."""

    found: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def add(self, text: str) -> None:
        """Record a difference that may change LAMMPS's averages."""
        if text not in self.found:
            self.found.append(text)

    def remark(self, text: str) -> None:
        """Record a comment for readers of the deck; it gives no warning."""
        if text not in self.remarks:
            self.remarks.append(text)

    def warn(self, stacklevel: int) -> None:
        """Issue the warnings."""
        for text in self.found:
            warnings.warn(text, ExportWarning, stacklevel=stacklevel + 1)


def exact(values) -> str:
    """A number, or several separated by spaces, as the shortest text that reads back as the same double."""
    return " ".join(repr(value) for value in np.ravel(values).astype(float).tolist())


# -- beads by their ids, and seeds ----------------------------------------------------------------------------------------------
#: Maximum number of words on a physical line of a deck.
_LINE = 16
#: Maximum number of words in a group command.
_GROUP = 400


def lammps_seed(seed: int, offset: int = 0) -> int:
    """A seed in LAMMPS's range, 1 to 900000000."""
    return (int(seed) + offset - 1) % 900_000_000 + 1


def id_words(mask: np.ndarray) -> list[str]:
    """Ids (from 1) of the True entries, as words ``n`` and ``n:m``."""
    padded = np.concatenate([[False], np.asarray(mask, bool), [False]]).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(padded) == 1) + 1, np.flatnonzero(np.diff(padded) == -1)
    return [f"{first}" if first == last else f"{first}:{last}" for first, last in zip(starts.tolist(), ends.tolist(), strict=True)]


def group_lines(name: str, mask: np.ndarray) -> Iterator[str]:
    """Commands that put beads into a group; long ones are continued on further lines."""
    ids = id_words(mask)
    for k in range(0, len(ids), _GROUP):
        words = ["group", name, "id", *ids[k : k + _GROUP]]
        yield " &\n  ".join(" ".join(words[n : n + _LINE]) for n in range(0, len(words), _LINE))


# -- styles ---------------------------------------------------------------------------------------------------------------------
@dataclass
class StyleUse:
    """A pair style of an export and its coefficients."""

    name: str
    settings: str  #: Words after the name, with ``{start}``, ``{stop}`` and ``{seed}`` where temperatures and seed go
    coefficients: dict[Pair, str]  #: Coefficients by pair of the scene's bead types
    cutoff: float  #: Largest range, nm
    modify: str = ""  #: Arguments of a pair_modify command, if one is needed
    constant: bool = False  #: Whether its temperature is always 0, since it has no friction


@dataclass
class PairExport:
    """Input of the translation of tables, and the files it makes."""

    scene: Scene
    units: UnitSystem
    shardlow: bool
    name: str
    differences: Differences
    tables: dict[str, list[str]] = field(default_factory=dict)

    @property
    def ramps(self) -> bool:
        """Whether the temperature changes."""
        kT = self.scene.kT
        return not isinstance(kT, float) and kT.kT_start != kT.kT_end

    def require_reduced(self, what: str) -> None:
        """Raise ParameterError if LAMMPS does not have such terms with the units, or the temperature ramp, of the scene."""
        if self.ramps and what != "EDPD":
            raise ParameterError(f"{what} has a constant temperature in LAMMPS, but the scene has a ramp; LAMMPS has ramps for DPD only")
        if self.units.name != "lj":
            raise ParameterError(f"{what} requires units lj in LAMMPS, not units {self.units.name}")


def plain_use(name: str, settings: str, columns: Columns, export: PairExport, entries: dict[Pair, Any], modify: str = "") -> StyleUse:
    """Use of a style whose coefficients are numbers and a cutoff; ``{cutoff}`` in ``settings`` is replaced by the longest cutoff."""
    units, longest = export.units, max(c.cutoff for c in entries.values())
    words = {pair: exact([*columns.of(c, units), c.cutoff / units.length]) for pair, c in entries.items()}
    return StyleUse(name, settings.replace("{cutoff}", exact(longest / units.length)), words, longest, modify)


#: Export functions, by the kind of a scene's table.
Exports = dict[type, Callable[[PairExport, dict[Pair, Any]], list[StyleUse]]]


#: Parsers of numbers with a bound.
_READERS = {"> 0": read.positive, ">= 0": read.non_negative}


@dataclass(frozen=True)
class BondedStyle:
    """A bond, angle, dihedral or improper style; ``kind`` is None for a style without energy."""

    kind: BondedKind | None

    @property
    def columns(self) -> Columns:
        """Arguments of the model's class, and their dimensions."""
        return Columns({} if self.kind is None else {name: dimension for name, (dimension, _) in self.kind.words.items()})

    def coefficient(self, words: list[str], usage: str, units: UnitSystem) -> dict[str, float]:
        """Arguments of the model's class, in MD units, from the words of a coefficient command; ``usage`` is the beginning of that
        command."""
        if self.kind is None:
            return {}
        labels = [label for _, label in self.kind.words.values()]
        read.count(words, f"{usage} {' '.join(labels)}", len(labels))
        values = {}
        for name, label, word in zip(self.kind.words, labels, words, strict=True):
            values[name] = _READERS.get(self.kind.terms._DIMENSIONS[name][1], read.number)(word, label)
        values = self.columns.to_md(values, units)
        self.build(np.arange(self.kind.width)[None, :], values)  # built once here, so that an invalid value is reported with its line
        return values

    def words(self, values: dict[str, float], units: UnitSystem) -> list[str]:
        """The words of a coefficient command, in the deck's units."""
        return [f"{value:.15g}" for value in self.columns.of(SimpleNamespace(**values), units)]

    def build(self, beads: np.ndarray, values: dict[str, float]) -> Any:
        """The bonds, angles, dihedrals or impropers of the model."""
        assert self.kind is not None
        terms: Any = self.kind.terms
        return terms(beads, **values)


def bonded_styles(what: str) -> dict[str, BondedStyle]:
    """Styles of bonds, angles, dihedrals or impropers by name: those of all registered kinds, and ``zero``."""
    known = {kind.style: BondedStyle(kind) for kind in BONDED_KINDS.values() if kind.style and kind.what == what}
    return {**known, "zero": BondedStyle(None)}
