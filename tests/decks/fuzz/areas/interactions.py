"""Pair styles with their coefficients, without noise."""

from ..compare import TABULATED
from ..deck import Deck

#: Styles that need nothing but positions and velocities, with how often they are drawn.
SIMPLE = {"dpd": 4, "dpd/ext": 2, "dpd/tstat": 1, "dpd/ext/tstat": 1, "dpd/fdt": 1, "lj/cut": 2, "zero": 0.5, "table": 1}


def _pairs(deck: Deck, mixing: bool) -> list[tuple[str, str]]:
    """Words for types that cover every pair, in the order of the commands."""
    draw, n = deck.draw, deck.types
    if n == 1:
        return [draw.pick([("1", "1"), ("*", "*")])]
    if mixing:
        return [(str(k), str(k)) for k in range(1, n + 1)] + [("1", str(n))] * draw.chance(0.3)
    style = draw.whole(0, 2)
    if style == 0:
        return [("*", "*")]
    if style == 1:
        return [
            ("*", "*"),
            draw.pick([("1", "1"), ("1", str(n)), (str(n), str(n)), ("1*2", str(n)), (str(n), "1"), ("*", str(n)), ("2*", "2*")]),
        ]
    return [(str(i), str(j)) if draw.chance(0.9) else (str(j), str(i)) for i in range(1, n + 1) for j in range(i, n + 1)]


def _settings(deck: Deck, style: str, noise: float) -> list[object]:
    cutoff, seed = deck.cutoff * deck.units.length, deck.draw.seed_word()
    temperature = noise * deck.units.temperature
    table: dict[str, list[object]] = {
        "dpd": [temperature, cutoff, seed],
        "dpd/ext": [temperature, cutoff, seed],
        "dpd/fdt": [temperature or deck.units.temperature, cutoff, seed],
        "dpd/tstat": [temperature, temperature, cutoff, seed],
        "dpd/ext/tstat": [temperature, temperature, cutoff, seed],
        "lj/cut": [cutoff],
        "zero": [cutoff],
        "table": [deck.draw.pick(["linear", "spline", "lookup"]), 20000],
    }
    return table[style]


def _coefficients(deck: Deck, style: str) -> list[object]:
    draw, natural = deck.draw, deck.units
    A, gamma, perp = natural.force * draw.real(0, 40), natural.friction * draw.real(0, 10), natural.friction * draw.real(0, 10)
    if draw.chance(0.15):
        gamma = 0.0
    if draw.chance(0.15):
        A = 0.0
    exponents = [draw.pick([1.0, 0.5, 2.0, 0.25]) for _ in range(2)]
    table: dict[str, list[object]] = {
        "dpd": [A, gamma],
        "dpd/ext": [A, gamma, perp, *exponents],
        "dpd/fdt": [A, 0.0],
        "dpd/tstat": [gamma],
        "dpd/ext/tstat": [gamma, perp, *exponents],
        "lj/cut": [natural.energy * draw.real(0.1, 1), natural.length * draw.real(0.4, 0.6)],
        "zero": [],
    }
    if style == "table":
        return ["pair.table", "SOFT"]
    own = [natural.length * deck.cutoff * draw.real(0.5, 1)] if draw.chance(0.3) else []
    return [*table[style], *own]


def table_file(deck: Deck) -> None:
    """A file with a smooth repulsion, with forces that are its slope."""
    natural, n = deck.units, 400
    end, scale = deck.cutoff * natural.length, natural.energy * deck.draw.real(2, 20)
    lines = ["# soft", "", "SOFT", f"N {n} R {0.02 * end} {end}", ""]
    for k in range(n):
        r = 0.02 * end + k * 0.98 * end / (n - 1)
        lines.append(f"{k + 1} {r:.15g} {scale * (1 - r / end) ** 2:.15g} {2 * scale / end * (1 - r / end):.15g}")
    deck.files["pair.table"] = "\n".join(lines) + "\n"
    deck.accuracy = TABULATED


def styles(deck: Deck, allowed: dict[str, float] | None = None) -> list[str]:
    """The styles of the deck: one, or several in hybrid or hybrid/overlay."""
    draw = deck.draw
    weights = allowed or SIMPLE
    mode = draw.random()
    count = 1 if mode < 0.6 else 2 if mode < 0.9 else 3
    found: list[str] = []
    while len(found) < count:
        style = draw.choices(list(weights), list(weights.values()))[0]
        if style == "dpd/fdt" and count > 1:
            continue  # its temperature cannot be 0, and then that of the others is not
        if style not in found or draw.chance(0.2):
            found.append(style)
    return found


def interactions(deck: Deck, names: list[str] | None = None, noise: float = 0.0) -> list[str]:
    """pair_style and pair_coeff; returns the styles."""
    draw = deck.draw
    names = names or styles(deck)
    if len(names) == 1 and draw.chance(0.9):
        deck.add("pair_style", names[0], *_settings(deck, names[0], noise))
        for i, j in _pairs(deck, names[0] == "lj/cut" and draw.chance(0.7)):
            deck.add("pair_coeff", i, j, *_coefficients(deck, names[0]))
        _modify(deck, names)
    else:
        overlay = len(names) == 1 or draw.chance(0.8)
        words = (word for name in names for word in (name, *_settings(deck, name, noise)))
        deck.add("pair_style", "hybrid/overlay" if overlay else "hybrid", *words)
        called = [[name] if names.count(name) == 1 else [name, names[:k].count(name) + 1] for k, name in enumerate(names)]
        if overlay:
            for words in called:
                for i, j in _pairs(deck, False):
                    deck.add("pair_coeff", i, j, *words, *_coefficients(deck, str(words[0])))
            # LAMMPS pays no heed to it where one style is alone, which is documented
            if deck.types > 1 and len(set(names)) > 1 and draw.chance(0.1):
                deck.add("pair_coeff", 1, 2, "none")
        else:
            every = [(i, j) for i in range(1, deck.types + 1) for j in range(i, deck.types + 1)]
            for k, (i, j) in enumerate(every):
                words = called[k] if k < len(called) else draw.pick(called)
                deck.add("pair_coeff", i, j, *words, *_coefficients(deck, str(words[0])))
    if "table" in names:
        table_file(deck)
    return names


def _modify(deck: Deck, names: list[str]) -> None:
    draw = deck.draw
    if names == ["lj/cut"] and draw.chance(0.5):
        options = [["shift", "yes"], ["mix", "arithmetic"], ["mix", "geometric"], ["mix", "sixthpower", "shift", "yes"]]
        deck.add("pair_modify", *draw.pick(options))
