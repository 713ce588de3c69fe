"""Words that several styles have: coefficients that are numbers, in both directions, and the settings ``T cutoff seed``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...units import UnitSystem
from ..language import arguments as read

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
    # LAMMPS's conductivity is an energy times a temperature per time, ours has the square of an energy
    "energy*kT/time": lambda units: units.energy * units.thermal_energy / units.time,
}


@dataclass(frozen=True)
class Columns:
    """Names of numbers, in the order of the command, and their dimensions (:data:`FACTORS`)."""

    dimensions: dict[str, str]

    def __len__(self) -> int:
        return len(self.dimensions)

    @property
    def usage(self) -> str:
        """The names."""
        return " ".join(self.dimensions)

    def read(self, words: list[str]) -> dict[str, float]:
        """Values from the words at the beginning of ``words``, in the deck's units."""
        return {name: read.number(word, name) for name, word in zip(self.dimensions, words, strict=False)}

    def read_with_cutoff(self, words: list[str]) -> tuple[dict, float | None]:
        """Values from all ``words``, and the cutoff that may come behind them."""
        read.count(words, f"{self.usage} [cutoff]", len(self), len(self) + 1)
        return self.read(words), read.positive(words[-1], "the cutoff") if len(words) > len(self) else None

    def to_md(self, values: dict[str, Any], units: UnitSystem) -> dict[str, Any]:
        """Values in MD units; those without a dimension here stay what they are."""
        return {name: value * FACTORS[self.dimensions[name]](units) if name in self.dimensions else value for name, value in values.items()}

    def of(self, term: Any, units: UnitSystem) -> list:
        """The same fields of a term of the model, in the deck's units."""
        return [getattr(term, name) / FACTORS[dimension](units) for name, dimension in self.dimensions.items()]


def seeded(name: str, temperatures: int) -> Callable[[list[str]], dict]:
    """Reader of ``[T | Tstart Tstop] cutoff seed``, with 0, 1 or 2 temperatures."""
    usage = f"{name} {('', 'T ', 'Tstart Tstop ')[temperatures]}cutoff seed"

    def settings(words: list[str]) -> dict:
        read.count(words, usage, temperatures + 2)
        *given, cutoff, seed = words
        ends = [read.non_negative(word, f"the temperature of {name}") for word in given]
        found = {"start": ends[0], "stop": ends[-1]} if ends else {}
        return {**found, "cutoff": read.positive(cutoff, f"the cutoff of {name}"), "seed": read.integer(seed, f"the seed of {name}", 1)}

    return settings
