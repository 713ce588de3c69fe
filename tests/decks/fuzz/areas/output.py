"""How things are written: thermo layouts and formats, dumps, prints."""

from ..deck import Deck
from ..draw import Draw
from .averages import Values
from .interactions import interactions
from .scene import WORDS, beads, draw_box, groups, head, timestep


def output(draw: Draw) -> Deck:
    """A deck about formats; numbers are rounded to few digits, text is compared word by word."""
    deck = head(Deck(draw), draw.pick(["atomic", "bond", "full"]), ("lj", "real"))
    deck.accuracy = 1e-6
    draw_box(deck)
    beads(deck, draw.whole(2, 6), 0.4)
    interactions(deck, ["dpd"])
    groups(deck)
    deck.add("fix", 1, "all", "nve")
    timestep(deck)
    values = Values(deck)
    for _ in range(2):
        values.compute()
        values.variable()
    deck.add("thermo", draw.whole(0, 3))
    style = draw.pick(["one", "multi", "yaml", "custom", "custom"])
    words = ["step", *draw.some([*WORDS, *values.scalars, *values.variables], 1, 6)]
    deck.add("thermo_style", style, *(words if style == "custom" else []))
    for _ in range(draw.whole(0, 3)):
        deck.add("thermo_modify", *_thermo_option(deck, style, words))
    columns = draw.some("id type mass x y z xs ys zs xu ix iy vx vy fx".split() + values.per_bead, 1, 6)
    if "id" not in columns:
        columns = ["id", *columns]
    if draw.chance(0.5):
        deck.add("dump", "d", deck.group(), "custom", draw.whole(1, 3), draw.pick(["dump.txt", "dump.*.txt"]), *columns)
    else:
        deck.add("dump", "d", deck.group(), "atom", draw.whole(1, 3), "dump.txt")
        if draw.chance(0.5):
            deck.add("dump_modify", "d", draw.pick(["scale", "image"]), draw.pick(["yes", "no"]))
    deck.add("dump_modify", "d", "sort", "id", "pbc", "yes")
    options: list[list[object]] = [["first", "yes"], ["every", 2], ["append", "no"]]
    if any(" custom " in line and line.startswith("dump ") for line in deck.lines):
        options += [["format", "float", "%12.5f"], ["format", "int", "%6d"], ["format", 1, "%8d"]]
    for _ in range(draw.whole(0, 2)):
        deck.add("dump_modify", "d", *draw.pick(options))
    _xyz(deck)
    if draw.chance(0.4):
        deck.add("dump", "b", deck.group(), "xtc", draw.whole(1, 3), "dump.xtc")
        # wrapped positions of beads at a face are at either end
        deck.add("dump_modify", "b", "unwrap", "yes", *(["sfactor", 0.5, "tfactor", 2] if draw.chance(0.3) else []))
    deck.run(draw.whole(0, 4))
    deck.say(f"step $(step) $(step:%08.3f) {draw.pick(['a', 'b'])} \\t")
    return deck.run(draw.whole(0, 3))


def _xyz(deck: Deck) -> None:
    """A dump xyz, one or two frames in a file."""
    draw = deck.draw
    deck.add("dump", "z", deck.group(), "xyz", draw.whole(1, 3), draw.pick(["dump.xyz", "dump.*.xyz"]))
    options: list[object] = ["sort", "id"]
    if draw.chance(0.5):
        options += ["element", *draw.choices(["C", "O", "W_1"], k=deck.types)]
    if draw.chance(0.4):
        options += ["format", "line", draw.pick(['"%s %12.5f %g %.3e"', '"%s %8.3f %8.3f %8.3f"', '"%-4s %g %g %g"'])]
    deck.add("dump_modify", "z", *options)


def _thermo_option(deck: Deck, style: str, words: list[str]) -> list[object]:
    draw = deck.draw
    number = draw.whole(1, len(words))
    options: list[list[object]] = [
        ["norm", draw.pick(["yes", "no"])],
        ["format", "float", draw.pick(["%12.6f", "%-10.4g", "%14.8e"])],
        ["format", "int", "%8d"],
        ["line", draw.pick(["one", "multi", "yaml"])],
        ["colname", number, "Title"],
        ["flush", "yes"],
        ["format", "none"],
        ["colname", "default"],
    ]
    # LAMMPS prints nonsense where a whole number gets the format of another
    if number > 1 and words[number - 1] not in ("elapsed", "elaplong", "atoms", "bonds", "angles", "dihedrals", "impropers"):
        options.append(["format", number, "%9.3f"])
    return draw.pick(options)
