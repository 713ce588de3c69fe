"""Forces on single beads, walls, and beads that stay where they are."""

from ..compare import ROUNDED_FORCES, ROUNDED_POSITIONS
from ..deck import Deck
from ..draw import Draw
from .interactions import interactions
from .scene import beads, conservative, draw_box, dump, groups, head, movers, thermo, timestep


def flow(draw: Draw) -> Deck:
    """A deck with addforce, setforce or wall/reflect."""
    deck = head(Deck(draw), "atomic", ("lj", "lj", "real", "metal"))
    natural = deck.units
    walls = [draw.chance(0.35) for _ in range(3)] if draw.chance(0.5) else [False] * 3
    if any(walls):
        deck.add("boundary", *("f" if wall else "p" for wall in walls))
    draw_box(deck, tilted=0.0 if any(walls) else 0.3)
    beads(deck, draw.whole(1, 15), 0.4)
    interactions(deck, [draw.pick(["dpd", "dpd", "dpd/ext", "lj/cut", "zero"])])
    groups(deck)
    movers(deck, 0.0 if any(walls) else 0.3)
    for k, axis in enumerate("xyz"):
        if walls[k]:
            inset = natural.length * 0.02
            ends = [draw.pick(["EDGE", "EDGE", deck.low[k] - inset * 0]), draw.pick(["EDGE", "EDGE", deck.low[k] + deck.edges[k]])]
            deck.add("fix", f"wall{axis}", "all", "wall/reflect", f"{axis}lo", ends[0], f"{axis}hi", ends[1], "units", "box")
    makers = [_push] * draw.whole(0, 3) + [_hold] * draw.chance(0.25) + [_put] * draw.pick([0, 0, 1, 2])
    draw.shuffle(makers)
    for k, maker in enumerate(makers):
        maker(deck, k)
    timestep(deck)
    named = [
        f"f_{words[1]}[{draw.whole(1, 3)}]"
        for words in map(str.split, deck.lines)
        if words[:1] == ["fix"] and words[3] in ("setforce", "addforce")
    ]
    thermo(deck, "fmax", "fnorm", "pe", *draw.some(named, 0, 2))
    dump(deck)
    conservative(deck)
    deck.run(draw.whole(0, 5))
    if draw.chance(0.3):
        deck.run(2)
    return deck


def _push(deck: Deck, k: int) -> None:
    """A force on beads that is added to the others."""
    deck.add("fix", f"push{k}", deck.group(), "addforce", *_force(deck, k))


def _put(deck: Deck, k: int) -> None:
    """A force in the place of all others, along some axes."""
    words = [word if deck.draw.chance(0.6) else "NULL" for word in _force(deck, k)]
    deck.add("fix", f"put{k}", deck.group(), "setforce", *words)


def _force(deck: Deck, k: int) -> list[object]:
    """Numbers, or numbers and one component that follows the bead."""
    draw, natural = deck.draw, deck.units
    words: list[object] = [natural.force * draw.real(-5, 5) if draw.chance(0.7) else 0.0 for _ in range(3)]
    if draw.chance(0.4):
        deck.accuracy, deck.of_forces = ROUNDED_POSITIONS, ROUNDED_FORCES * natural.force
        axis = draw.pick("xyz")
        size = f"{natural.force:g}"
        formulas = [
            f"{size}*sin({axis}/{natural.length:g})",
            f"{size}*({axis}<{deck.low[0] + 1:.3g})",
            f"{size}*(type-1.5)",
            f"{size}*mass/{natural.mass:g}*{axis}/l{axis}",
        ]
        deck.add("variable", f"p{k}", "atom", f'"{draw.pick(formulas)}"')
        words[draw.whole(0, 2)] = f"v_p{k}"
    return words


def _hold(deck: Deck, k: int) -> None:
    """Beads without forces, which are at rest as a rule."""
    draw, group = deck.draw, deck.draw.pick(deck.groups)
    if draw.chance(0.8):
        deck.add("velocity", group, "set", 0.0, 0.0, 0.0)
    deck.add("fix", f"hold{k}", group, "setforce", 0.0, 0.0, 0.0)
    if not deck.partial:
        deck.partial = True
        deck.add("compute", "movers", "all", "ke")
