"""Forces on single beads, walls, and beads that stay where they are."""

from __future__ import annotations

from ..deck import Deck
from ..draw import Draw
from .interactions import interactions
from .scene import beads, conservative, draw_box, dump, groups, head, thermo, timestep


def flow(draw: Draw) -> Deck:
    """A deck with addforce, setforce or wall/reflect."""
    deck = Deck(draw)
    head(deck, "atomic", ("lj", "lj", "real", "metal"))
    natural = deck.units
    walls = [draw.chance(0.35) for _ in range(3)] if draw.chance(0.5) else [False] * 3
    if any(walls):
        deck.add("boundary", *("f" if wall else "p" for wall in walls))
    draw_box(deck, tilted=0.0 if any(walls) else 0.3)
    deck.types = draw.whole(1, 2)
    beads(deck, draw.whole(1, 15), 0.4)
    interactions(deck, [draw.pick(["dpd", "dpd", "dpd/ext", "lj/cut", "zero"])])
    groups(deck)
    deck.add("fix", "move", deck.group() if draw.chance(0.3) else "all", "nve")
    for k, axis in enumerate("xyz"):
        if walls[k]:
            inset = natural.length * 0.02
            ends = [draw.pick(["EDGE", "EDGE", deck.low[k] - inset * 0]), draw.pick(["EDGE", "EDGE", deck.low[k] + deck.edges[k]])]
            deck.add("fix", f"wall{axis}", "all", "wall/reflect", f"{axis}lo", ends[0], f"{axis}hi", ends[1], "units", "box")
    for k in range(draw.whole(0, 3)):
        words: list[object] = [natural.force * draw.real(-5, 5) if draw.chance(0.7) else 0.0 for _ in range(3)]
        if draw.chance(0.4):
            axis = draw.pick("xyz")
            formulas = [f"{natural.force:g}*sin({axis})", f"{natural.force:g}*({axis}<{deck.low[0] + 1:.3g})", f"{natural.force:g}*(type-1.5)", f"{natural.force:g}*mass*{axis}/l{axis}"]
            deck.add("variable", f"p{k}", "atom", f'"{draw.pick(formulas)}"')
            words[draw.whole(0, 2)] = f"v_p{k}"
        deck.add("fix", f"push{k}", deck.group(), "addforce", *words)
    if draw.chance(0.2):
        group = draw.pick(deck.groups)
        if draw.chance(0.8):
            deck.add("velocity", group, "set", 0.0, 0.0, 0.0)
        deck.add("fix", "hold", group, "setforce", 0.0, 0.0, 0.0)
    if draw.chance(0.4):
        deck.add("compute", "t", "all", "temp")
        deck.add("thermo_modify", "temp", "t")
    timestep(deck)
    thermo(deck, "fmax", "fnorm", "pe")
    dump(deck)
    conservative(deck)
    deck.run(draw.whole(0, 5))
    if draw.chance(0.3):
        deck.run(2)
    return deck
