"""Several runs, with changes between them."""

from ..deck import Deck
from ..draw import Draw
from .averages import Values
from .interactions import interactions
from .scene import beads, conservative, draw_box, dump, groups, head, movers, thermo, timestep


def _change(deck: Deck, values: Values, state: dict) -> None:
    """Something between two runs."""
    draw, natural = deck.draw, deck.units
    speed = [natural.velocity * draw.real(-1, 1) for _ in range(3)]
    choices: list[list[object]] = [
        ["timestep", natural.step * draw.real(0.5, 2)],
        ["velocity", deck.group(), "set", *speed, *draw.pick([[], ["sum", "yes"]])],
        ["velocity", deck.group(), "zero", "linear"],
        ["velocity", "all", "scale", natural.temperature * draw.real(0.5, 2)],
        ["set", "atom", draw.whole(1, deck.beads), draw.pick(["vx", "vy", "vz"]), speed[0]],
        ["set", "atom", draw.whole(1, deck.beads), "x", float(f"{deck.low[0] + draw.random() * deck.edges[0]:.6g}")],
        ["set", "atom", draw.whole(1, deck.beads), "type", draw.whole(1, deck.types)],
        ["set", "atom", draw.whole(1, deck.beads), "image", draw.whole(-2, 2), "NULL", draw.whole(-1, 1)],
        ["mass", draw.whole(1, deck.types), natural.mass * draw.real(0.5, 2)],
        ["thermo", draw.whole(0, 4)],
        ["group", deck.name("g"), "id", draw.whole(1, deck.beads)],
        ["fix", "push", deck.group(), "addforce", *(natural.force * draw.real(-1, 1) for _ in range(3))],
        ["variable", "q", "equal", draw.whole(1, 9)],
    ]
    if not state["averages"]:
        choices.append(["reset_timestep", draw.whole(0, 30)])
    words = draw.pick(choices)
    deck.add(*words)
    if words[0] == "fix":
        if draw.chance(0.3):
            deck.lines.pop()
            deck.lines.append("unfix push" if "push" in state else "timestep " + draw.word(natural.step))
        else:
            state["push"] = True
        if deck.lines[-1] == "unfix push":
            del state["push"]
    elif words[0] == "reset_timestep":
        state["step"] = words[1]


def runs(draw: Draw) -> Deck:
    """A deck with several runs."""
    deck = head(Deck(draw), draw.pick(["atomic", "atomic", "bond"]), ("lj", "lj", "lj", "real"))
    draw_box(deck)
    beads(deck, draw.whole(2, 15), 0.4)
    style = draw.pick(["dpd", "dpd/ext", "dpd/tstat", "lj/cut"])
    interactions(deck, [style])
    groups(deck)
    movers(deck)
    timestep(deck)
    values = Values(deck)
    for _ in range(draw.whole(1, 4)):
        values.variable()
    for _ in range(draw.whole(0, 2)):
        values.compute()
    state = {"averages": draw.chance(0.5), "step": 0}
    if state["averages"]:
        values.average()
    thermo(deck, *draw.some([*values.scalars, *values.variables], 1, 5), every=draw.pick([1, 2]), most=5)
    dump(deck, draw.pick([1, 2, 3]))
    conservative(deck)
    for number in range(draw.whole(2, 4)):
        changes = draw.whole(0, 2) if number else 0
        for _ in range(changes):
            _change(deck, values, state)
        steps = draw.whole(0, 5)
        step = state["step"]
        words: list[object] = [steps]
        if draw.chance(0.15):
            words = [step + steps, "upto"]
        if draw.chance(0.4):
            words += ["start", draw.whole(0, step), "stop", step + steps + draw.whole(0, 10)]
        # forces with friction follow the velocities, and are evaluated anew here
        if number and not changes and style == "lj/cut" and draw.chance(0.4):
            words += ["pre", "no"]
        if draw.chance(0.1):
            words += ["post", "no"]
        deck.run(*words)
        state["step"] = step + steps
    return deck
