"""Words that several styles have: coefficients that are numbers, in both directions, and settings such as ``T cutoff seed``; what styles
write, and what they say about it: groups, differences between a scene and LAMMPS."""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.pairs import NONE
from ...model.scene import Scene
from ..language import arguments as read
from ..state.pair_setup import Coefficient, Find, PairStyle, Term, Values

#: MD units per unit of the deck, by dimension.
FACTORS: dict[str, Callable[[UnitSystem], float]] = {
    "1": lambda units: 1.0,
    "length": lambda units: units.length,
    "1/length": lambda units: 1.0 / units.length,
    "energy": lambda units: units.energy,
    "energy/length^2": lambda units: units.energy / units.length**2,
    "degrees": lambda units: np.pi / 180.0,
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
    """Names of numbers, in the order of the command, and their dimensions (:data:`FACTORS`)."""

    dimensions: dict[str, str]

    def __len__(self) -> int:
        return len(self.dimensions)

    def read(self, words: list[str]) -> dict[str, float]:
        """Values from the words at the beginning of ``words``, in the deck's units."""
        return {name: read.number(word, name) for name, word in zip(self.dimensions, words, strict=False)}

    def coefficient(self, style: PairStyle, words: list[str], find: Find) -> Values:
        """Values from all ``words``, and the cutoff that may come behind them: ``Spec.coefficient`` of most styles."""
        read.count(words, f"{' '.join(self.dimensions)} [cutoff]", len(self), len(self) + 1)
        return self.read(words), cutoff_of(words, len(self))

    def to_md(self, values: dict[str, Any], units: UnitSystem) -> dict[str, Any]:
        """Those of the values that have a name here, in MD units."""
        return {name: values[name] * FACTORS[dimension](units) for name, dimension in self.dimensions.items() if name in values}

    def builder(self, kind: Callable[..., object]) -> Callable[[PairStyle, Coefficient, UnitSystem], Term]:
        """``Spec.build`` of a style whose terms are ``kind(**values, cutoff=...)``."""

        def build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
            return kind(**self.to_md(found.values, units), cutoff=style.cutoff(found) * units.length), None  # type: ignore[operator]

        return build

    def of(self, term: Any, units: UnitSystem) -> list:
        """The same fields of a term of the model, in the deck's units."""
        return [getattr(term, name) / FACTORS[dimension](units) for name, dimension in self.dimensions.items()]


def cutoff_of(words: list[str], at: int) -> float | None:
    """The cutoff, if there is a word at this place."""
    if len(words) > at and read.number(words[at], "the cutoff") == 0:
        raise ParameterError("the cutoff must be > 0, but is 0; types that do not interact have 'pair_coeff i j none'")
    return read.positive(words[at], "the cutoff") if len(words) > at else None


def no_force(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    """``Spec.build`` of a style that puts no force between pairs of beads."""
    return NONE, None


#: Words of pair_style commands: the settings that they give, how they are read, and what errors call them.
_WORDS: dict[str, tuple[tuple[str, ...], Callable[[str, str], float], str]] = {
    "T": (("start", "stop"), read.non_negative, "the temperature"),
    "Tstart": (("start",), read.non_negative, "the temperature"),
    "Tstop": (("stop",), read.non_negative, "the temperature"),
    "cutoff": (("cutoff",), read.positive, "the cutoff"),
    "cut_dpd": (("cutoff",), read.positive, "the cutoff"),
    "cut_coul": (("cutoff_charges",), read.positive, "the cutoff of the charges"),
    "lambda": (("lamda",), read.positive, "lambda"),
    "seed": (("seed",), lambda word, what: read.integer(word, what, 1), "the seed"),
}


def settings(name: str, usage: str) -> Callable[[list[str]], dict]:
    """``Spec.settings`` of a style whose words are some of :data:`_WORDS`, such as ``T cutoff seed``."""

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
    """LAMMPS will do something else than the scene says; the message names the difference."""


@dataclass
class Differences:
    """What an exported deck does differently, in the order it came up; each becomes a warning and a comment of the deck."""

    found: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def add(self, text: str) -> None:
        """Note that LAMMPS's averages may differ from the scene's."""
        if text not in self.found:
            self.found.append(text)

    def remark(self, text: str) -> None:
        """Note something the reader of the deck should know; no warning."""
        if text not in self.remarks:
            self.remarks.append(text)

    def warn(self, stacklevel: int) -> None:
        """Issue the warnings."""
        for text in self.found:
            warnings.warn(text, ExportWarning, stacklevel=stacklevel + 1)


def exact(values) -> str:
    """A number, or several with spaces between them: the shortest texts that read back as the same doubles."""
    return " ".join(repr(value) for value in np.ravel(values).astype(float).tolist())


# -- beads by their ids, and seeds ----------------------------------------------------------------------------------------------
#: Words on one physical line of a deck.
_LINE = 16
#: Words in one group command.
_GROUP = 400


def lammps_seed(seed: int, offset: int = 0) -> int:
    """A seed that LAMMPS takes, 1 to 900000000."""
    return (int(seed) + offset - 1) % 900_000_000 + 1


def id_words(mask: np.ndarray) -> list[str]:
    """Ids (counted from 1) of the True entries as words ``n`` and ``n:m``."""
    padded = np.concatenate([[False], np.asarray(mask, bool), [False]]).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(padded) == 1) + 1, np.flatnonzero(np.diff(padded) == -1)
    return [f"{first}" if first == last else f"{first}:{last}" for first, last in zip(starts.tolist(), ends.tolist(), strict=True)]


def group_lines(name: str, mask: np.ndarray) -> Iterator[str]:
    """Commands that put beads into a group, each on several lines if it is long."""
    ids = id_words(mask)
    for k in range(0, len(ids), _GROUP):
        words = ["group", name, "id", *ids[k : k + _GROUP]]
        yield " &\n  ".join(" ".join(words[n : n + _LINE]) for n in range(0, len(words), _LINE))


# -- styles ---------------------------------------------------------------------------------------------------------------------
@dataclass
class StyleUse:
    """One pair style and its coefficients."""

    name: str
    settings: str  #: Words after the name, with ``{start}``, ``{stop}`` and ``{seed}`` where temperatures and seed go
    coefficients: dict[Pair, str]  #: By pair of the scene's bead types
    cutoff: float  #: Largest range, nm
    modify: str = ""  #: Words of a pair_modify command, if it needs one
    constant: bool = False  #: Whether its temperature is 0 at any temperature of the scene (it has no friction)


@dataclass
class PairExport:
    """What the translation of tables needs to know, and the files it makes."""

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
        """ParameterError if LAMMPS has not this kind of terms with the units, or the temperature, of the scene."""
        if self.ramps and what != "EDPD":
            raise ParameterError(f"{what} goes with one temperature in LAMMPS, but the scene has a ramp; LAMMPS has ramps for DPD only")
        if self.units.name != "lj":
            raise ParameterError(f"{what} goes with units lj only in LAMMPS, not with units {self.units.name}")


def plain_use(name: str, settings: str, columns: Columns, export: PairExport, entries: dict[Pair, Any], modify: str = "") -> StyleUse:
    """Use of a style whose coefficients are some numbers and the cutoff; ``settings`` has ``{cutoff}`` where the longest one goes."""
    units, longest = export.units, max(c.cutoff for c in entries.values())
    words = {pair: exact([*columns.of(c, units), c.cutoff / units.length]) for pair, c in entries.items()}
    return StyleUse(name, settings.replace("{cutoff}", exact(longest / units.length)), words, longest, modify)


#: From the kind of a table of a scene to the styles that say the same.
Exports = dict[type, Callable[[PairExport, dict[Pair, Any]], list[StyleUse]]]
