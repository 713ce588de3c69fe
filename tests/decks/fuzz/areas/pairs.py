"""Pair styles: forces, energies and pressures of beads anywhere in a box, and a few steps."""

from ..deck import Deck
from ..draw import Draw
from .interactions import interactions
from .scene import beads, conservative, draw_box, dump, groups, head, thermo, timestep


def pairs(draw: Draw) -> Deck:
    """A deck with pair forces and no noise."""
    deck = head(Deck(draw), draw.pick(["atomic", "atomic", "charge", "bond"]))
    deck.cutoff = draw.pick([1.0, 1.0, 1.2])
    draw_box(deck, 2.0 * deck.cutoff + 0.05, 2.0 * deck.cutoff + draw.pick([0.3, 2.0]), tilted=0.5, types=3)
    x = beads(deck, draw.pick([1, 2, 3, draw.whole(4, 40)]), draw.pick([0.4, 0.4, 0.0]))
    names = interactions(deck)
    if "lj/cut" not in names and "table" not in names and draw.chance(0.1):
        deck.add("set", "atom", 1, *(word for axis, value in zip("xyz", x[-1], strict=True) for word in (axis, float(value))))
    groups(deck)
    deck.add("fix", 1, "all", "nve")
    timestep(deck)
    thermo(deck)
    dump(deck)
    conservative(deck)
    return deck.run(draw.whole(0, 4))
