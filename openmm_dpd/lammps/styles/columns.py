"""Words that several styles have: coefficients that are numbers, in both directions, and settings such as ``T cutoff seed``."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.pairs import NONE
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
