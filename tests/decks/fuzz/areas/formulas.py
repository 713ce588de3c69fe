"""Formulas of variables: operators, functions, thermo words, groups, single beads, and values of all beads."""

from ..deck import Deck
from ..draw import Draw
from .lattices import box, lattice, region, units

_ONE = ("sqrt", "exp", "ln", "log", "abs", "sign", "sin", "cos", "tan", "asin", "acos", "atan", "ceil", "floor", "round")
_WORDS = ("lx", "ly", "lz", "xlo", "xhi", "ylo", "zhi", "vol", "atoms", "step", "dt", "xy", "yz", "bonds", "density")
_OPERATORS = ("+", "-", "*", "/", "^", "%", "==", "!=", "<", "<=", ">", ">=", "&&", "||")


class _Grammar:
    """Expressions over leaves; ``of_beads`` are those of them that differ from bead to bead."""

    def __init__(self, draw: Draw, leaves: list[str], of_beads: tuple[str, ...] = ()):
        self.draw, self.leaves, self.of_beads = draw, [*leaves, *of_beads * 3], of_beads

    def number(self) -> str:
        return self.draw.pick(
            ["0", "1", "2", "0.5", "2.5", "-1.5", "3", "1.0e1", "1e-2", "0.25", ".5", "7", "PI", f"{self.draw.uniform(-3, 3):.3g}"]
        )

    def expression(self, depth: int = 0) -> str:
        """A formula; brackets where they change nothing as well."""
        draw = self.draw
        kind = draw.random() if depth < 4 else 0.0
        if kind < 0.25:
            return self.number()
        if kind < 0.4:
            return draw.pick(self.leaves)
        if kind < 0.65:
            one, other = self.expression(depth + 1), self.expression(depth + 1)
            return f"{one}{draw.pick(_OPERATORS)}{other}" if draw.chance(0.5) else f"({one}{draw.pick(_OPERATORS)}{other})"
        if kind < 0.73:
            return f"{draw.pick(['-', '!', '-'])}({self.expression(depth + 1)})"
        if kind < 0.95:
            name, inside = draw.pick(_ONE), self.expression(depth + 1)
            if name in ("sqrt", "ln", "log"):
                inside = f"abs({inside})" + ("+0.5" if name != "sqrt" else "")
            elif name in ("asin", "acos"):
                inside = f"sin({inside})"
            elif name == "exp":
                inside = f"cos({inside})"
            return f"{name}({inside})"
        if kind < 0.98:
            return f"atan2({self.expression(depth + 1)},{self.expression(depth + 1)})"
        # what LAMMPS makes of a condition without anything of the beads, in a formula of beads, is a fault of its own (docs/decks/differences.md)
        condition = f"({draw.pick(self.of_beads)})+({self.expression(depth + 1)})" if self.of_beads else self.expression(depth + 1)
        return f"ternary({condition},{self.expression(depth + 1)},{self.expression(depth + 1)})"


def formulas(draw: Draw) -> Deck:
    """A deck that prints many formulas."""
    deck = Deck(draw)
    units(deck)
    deck.add("atom_modify", "map", "yes")
    spacing = lattice(deck)
    box(deck, spacing)
    deck.add("create_box", 2, "box")
    deck.add("mass", "*", deck.units.mass)
    for k in range(4):
        deck.add("create_atoms", 1 + k % 2, "single", *deck.place(), "units", "box")
    deck.add("velocity", "all", "ramp", "vx", 0.0, deck.units.velocity, "y", deck.low[1], deck.low[1] + deck.edges[1], "units", "box")
    deck.add("group", "g", "id", 1, 3)
    deck.regions.remove("box")
    place = region(deck, spacing)
    axis = draw.pick("xyz")
    leaves = [
        *draw.some(_WORDS, 3, 6),
        f"x[{draw.whole(1, 4)}]", f"v{axis}[{draw.whole(1, 4)}]", "type[2]", "mass[1]", "id[3]", f"count(g,{place})",
        "count(all)", "mass(g)", f"xcm(g,{axis})", f"vcm(all,{axis})", "ke(g)", f"bound(all,{axis}max)",
    ]  # fmt: skip
    grammar = _Grammar(draw, leaves)
    for k in range(draw.whole(1, 4)):
        deck.add("variable", f"e{k}", "equal", grammar.expression(1) if draw.chance(0.5) else f'"{grammar.expression()}"')
        leaves.append(f"v_e{k}")
    deck.add("variable", "s", "string", draw.pick(["2.5", "7", "-1"]))
    deck.add("variable", "i", "index", 3, 4, 5)
    leaves.append("v_i")
    for _ in range(12):
        deck.show(grammar.expression())
    deck.say("$(v_e0:%10.4f) ${e0} $s $i ${i}")
    deck.add("pair_style", "zero", 0.4 * deck.units.length)
    deck.add("pair_coeff", "*", "*")
    deck.add("fix", 1, "all", "nve")
    _of_beads(deck, grammar)
    return deck.run(0)


def _of_beads(deck: Deck, grammar: _Grammar) -> None:
    """Atom-style variables in a dump."""
    draw = deck.draw
    beads = ("x", "y", "z", "vx", "vy", "type", "mass", "id", "fx")
    inner = _Grammar(draw, [leaf for leaf in grammar.leaves if "$" not in leaf], beads)
    names = []
    for k in range(draw.whole(1, 4)):
        deck.add("variable", f"b{k}", "atom", f'"{inner.expression(1)}"')
        names.append(f"v_b{k}")
        inner.leaves.append(f"v_b{k}")
    deck.add("dump", "d", "all", "custom", 1, "dump.txt", "id", *names)
    deck.add("dump_modify", "d", "sort", "id", "format", "float", "%.15g")
