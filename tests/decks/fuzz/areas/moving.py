"""Beads displaced and copied, momentum taken out of them, lines printed on the way."""

from ..deck import Deck
from ..draw import Draw
from .averages import Values
from .interactions import interactions
from .lattices import lattice
from .scene import beads, conservative, draw_box, dump, groups, head, movers, thermo, timestep


def _displace(deck: Deck) -> None:
    draw, length = deck.draw, deck.units.length
    units = draw.pick([["units", "box"], ["units", "box"], []])
    size = length if units else 1.0
    far = [size * draw.real(-4, 4) for _ in range(3)]
    style = draw.pick(["move", "move", "ramp", "rotate", "variable"])
    words: list[object]
    if style == "move":
        words = ["move", *far]
    elif style == "ramp":
        low = size * draw.real(-1, 2)
        words = ["ramp", draw.pick("xyz"), far[0], far[1], draw.pick("xyz"), low, low + size * draw.real(0.5, 2)]
    elif style == "rotate":
        axis = [draw.real(-1, 1) for _ in range(3)]
        words = ["rotate", *far, *(axis if any(axis) else [0, 0, 1]), draw.real(-200, 200)]
    else:
        name = deck.name("v")
        deck.add("variable", name, draw.pick(["equal", "atom"]), far[0])
        if draw.chance(0.7):
            deck.lines[-1] = f'variable {name} atom "{far[0]:.6g}*{draw.pick(["x", "vy", "type", "id"])}"'
        words = ["move", *draw.sample([f"v_{name}", 0, far[1]], 3)]
    deck.add("displace_atoms", deck.group(), *words, *units)


def _momentum(deck: Deck) -> None:
    draw, group = deck.draw, deck.group()
    # LAMMPS divides rounding errors by each other where beads lie on one line, and scales them up where there is one bead
    angular = group == "all" and deck.beads > 2 and draw.chance(0.5)
    flags = [draw.whole(0, 1) for _ in range(3)]
    words = ["linear", *flags] if any(flags) else [] if angular else ["linear", 1, 1, 1]
    words += ["angular"] if angular else []
    deck.add(
        "fix", deck.name("m"), group, "momentum", draw.whole(1, 3), *words, *draw.pick([[], [], ["rescale"] if group == "all" else []])
    )


def moving(draw: Draw) -> Deck:
    """A deck with some of that, and runs."""
    style = draw.pick(["atomic", "atomic", "bond"])
    deck = head(Deck(draw), style, ("lj", "lj", "real"))
    ordered = draw.chance(0.25)  # then beads stay in the order in which they came, and commands that give new ids may come after runs
    if ordered:
        deck.add("atom_modify", "sort", 0, 0.0)
    draw_box(deck)
    count = draw.whole(2, 8)
    beads(deck, count, 0.4, carried={"mol": [draw.whole(0, 3) for _ in range(count)]} if style == "bond" else {})
    if draw.chance(0.3):
        lattice(deck)
    groups(deck)
    for _ in range(draw.whole(0, 2)):
        _displace(deck)
    if draw.chance(0.6):
        copies = [draw.pick([1, 1, 2, 3]) for _ in range(3)]
        deck.add("replicate", *copies)
        deck.edges = tuple(edge * n for edge, n in zip(deck.edges, copies, strict=True))  # type: ignore[assignment]
        for name in deck.groups:
            deck.show(f"count({name})")
        if draw.chance(0.3) and style == "atomic" and len(deck.groups) > 1:
            deck.add("delete_atoms", "group", deck.groups[-1], *draw.pick([[], ["compress", "no"]]))
        if draw.chance(0.2):
            deck.add("reset_atoms", "id")
        if draw.chance(0.4):
            _displace(deck)
    if draw.chance(0.4):
        deck.add("write_data", "out.data", "nocoeff")
    interactions(deck, [draw.pick(["dpd", "lj/cut"])])
    movers(deck, 0.0)
    timestep(deck)
    values = Values(deck)
    for _ in range(draw.whole(0, 2)):
        values.variable()
    for _ in range(draw.whole(0, 2)):
        _momentum(deck)
    shown = " ".join(f"${{{name[2:]}}}" for name in values.variables)
    if draw.chance(0.6):
        options = ["screen", "no", *draw.pick([[], ["title", '"# here"']])]
        text = f'"said $(step) $(ke:%.15g) $(vcm(all,{draw.pick("xyz")}):%.15g) {shown}"'
        deck.add("fix", "say", deck.group(), "print", draw.whole(1, 3), text, draw.pick(["file", "append"]), "said.txt", *options)
    thermo(deck, *values.variables, every=draw.pick([1, 2]), most=4)
    dump(deck)
    conservative(deck)
    deck.run(draw.whole(0, 5))
    if draw.chance(0.5):
        if draw.chance(0.5):
            _displace(deck)
        if ordered and len(deck.groups) > 1:
            deck.add("delete_atoms", "group", deck.groups[-1], "compress", draw.pick(["yes", "no"]))
            deck.add("reset_atoms", "id")
        deck.run(draw.whole(0, 3))
    return deck
