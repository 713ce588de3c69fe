"""Pair styles with charges: their arguments."""

from __future__ import annotations

from ..language import arguments as read
from ..state.pair_setup import PairStyle


def both_settings(words: list[str]) -> dict:
    """``dpd/coul/slater/long T cut_dpd seed lambda cut_coul``."""
    read.count(words, "dpd/coul/slater/long T cut_dpd seed lambda cut_coul", 5)
    name = "of dpd/coul/slater/long"
    temperature = read.non_negative(words[0], f"the temperature {name}")
    return {
        "start": temperature,
        "stop": temperature,
        "cutoff": read.positive(words[1], f"the cutoff {name}"),
        "seed": read.integer(words[2], f"the seed {name}", 1),
        "lamda": read.positive(words[3], f"lambda {name}"),
        "cutoff_charges": read.positive(words[4], f"the cutoff of the charges {name}"),
    }


def both_coefficient(style: PairStyle, words: list[str], _) -> tuple[dict, float | None]:
    """``A gamma [yes|no] [cutoff]``."""
    read.count(words, "A gamma [yes|no] [cutoff]", 2, 4)
    values: dict = {key: read.number(word, key) for key, word in zip(("A", "gamma"), words, strict=False)}
    values["charged"] = "yes" if len(words) > 2 and read.switch(words[2], "whether the pair is charged") else "no"
    return values, read.positive(words[3], "the cutoff") if len(words) > 3 else None


def slater_settings(words: list[str]) -> dict:
    """``coul/slater/long lambda cutoff``."""
    read.count(words, "coul/slater/long lambda cutoff", 2)
    lamda, cutoff = (read.positive(w, f"{what} of coul/slater/long") for w, what in zip(words, ("lambda", "the cutoff"), strict=True))
    return {"lamda": lamda, "cutoff_charges": cutoff}


def slater_coefficient(style: PairStyle, words: list[str], _) -> tuple[dict, float | None]:
    """No coefficients: ``pair_coeff * *``."""
    read.count(words, "pair_coeff i j (coul/slater/long has no coefficients)", 0)
    return {}, None
