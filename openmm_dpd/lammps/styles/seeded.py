"""Settings of the styles whose beads carry more than a velocity: ``[T] cutoff seed``."""

from __future__ import annotations

from collections.abc import Callable

from ..language import arguments as read


def seeded(name: str, isothermal: bool) -> Callable[[list[str]], dict]:
    """Reader of ``[T] cutoff seed``."""
    usage = f"{name} {'T ' if isothermal else ''}cutoff seed"

    def settings(words: list[str]) -> dict:
        read.count(words, usage, 3 if isothermal else 2)
        temperature = read.non_negative(words[0], f"the temperature of {name}") if isothermal else None
        found = {"start": temperature, "stop": temperature} if isothermal else {}
        cutoff, seed = words[-2:]
        return {**found, "cutoff": read.positive(cutoff, f"the cutoff of {name}"), "seed": read.integer(seed, f"the seed of {name}", 1)}

    return settings
