"""A deck in one piece, and divided by a restart file: both sides write one of their own and go on from it."""

from ..deck import Deck
from ..draw import Draw
from .interactions import interactions
from .scene import beads, conservative, draw_box, dump, groups, head, timestep

_COLUMNS = "id type mass x y z xu yu zu ix iy iz vx vy vz fx fy fz"


def restarts(draw: Draw) -> Deck:
    """Runs and what comes between them; the last one once more in a second script, from a restart file."""
    deck = head(Deck(draw), "atomic", ("lj", "lj", "real", "metal"))
    settings = deck.lines[-2:]
    draw_box(deck)
    beads(deck, draw.whole(2, 15), 0.4)
    before = len(deck.lines)
    interactions(deck, [draw.pick(["dpd", "dpd/ext", "dpd/tstat", "lj/cut", "zero"])] * draw.pick([1, 1, 2]))
    repeated = deck.lines[before:] if "hybrid" in deck.lines[before] else []  # LAMMPS keeps no coefficients of hybrid
    groups(deck)
    timestep(deck)
    fixes = _fixes(deck)
    thermo = _thermo(deck)
    conservative(deck)
    steps = draw.whole(0, 4)
    middle = draw.chance(0.4) and steps > 0
    if middle:
        thermo = [line.replace(" time", " dt") for line in thermo]  # the clock of LAMMPS begins anew behind such a file
    deck.lines += fixes + thermo
    if middle:
        deck.add("restart", steps, "r.*.restart")  # a file from the middle of a run: what is gone on from is a run that ends there
        deck.run(steps + draw.whole(1, 3))
    else:
        deck.run(steps)
        _change(deck)
        deck.add("write_restart", f"r.{steps}.restart")
    last = draw.whole(0, 4)
    if not middle:
        deck.add("dump", "w", "all", "custom", 1, "whole.txt", _COLUMNS)
        deck.add("dump_modify", "w", "sort", "id", "format", "float", "%.17g")
        deck.run(last)
        deck.same.append(("whole.txt", "after.txt"))
    deck.next_stage()
    deck.add("read_restart", f"r.{steps}.restart")
    deck.lines += [*settings, *repeated, *fixes, *thermo]
    deck.show("step", "atoms", "lx", "xlo", "yz", "dt", *(f"count({name})" for name in deck.groups), "mass(all)")
    dump(deck)
    deck.add("dump", "w", "all", "custom", 1, "after.txt", _COLUMNS)
    deck.add("dump_modify", "w", "sort", "id", "format", "float", "%.17g")
    deck.run(last)
    if draw.chance(0.4):
        deck.add("write_data", "out.data", "nocoeff")
    return deck


def _fixes(deck: Deck) -> list[str]:
    """What moves the beads: a restart file holds none of it."""
    draw, natural = deck.draw, deck.units
    found: list[list[object]] = [["fix", "move", "all", "nve"]]
    for k in range(draw.whole(0, 2)):
        words: list[object] = [natural.force * draw.real(-2, 2) for _ in range(3)]
        style = draw.pick(["addforce", "setforce"])
        if style == "setforce":
            words = [word if draw.chance(0.5) else "NULL" for word in words]
        found.append(["fix", f"push{k}", deck.group(), style, *words])
    return [" ".join(draw.word(word) for word in words) for words in found]


def _thermo(deck: Deck) -> list[str]:
    words = deck.draw.some(["temp", "press", "pe", "ke", "fmax", "vol", "lx", "time", "pxx", "evdwl"], 1, 6)
    return ["thermo 1", f"thermo_style custom step {' '.join(words)}", "thermo_modify format float %.15g"]


def _change(deck: Deck) -> None:
    """Something between the run and the file, which the file has to know."""
    draw, natural = deck.draw, deck.units
    bead = draw.whole(1, deck.beads)
    choices: list[list[object]] = [
        ["timestep", natural.step * draw.real(0.5, 2)],
        ["velocity", "all", "set", *(natural.velocity * draw.real(-1, 1) for _ in range(3))],
        ["set", "atom", bead, "type", draw.whole(1, deck.types)],
        ["set", "atom", bead, "image", draw.whole(-2, 2), "NULL", 1],
        ["mass", draw.whole(1, deck.types), natural.mass * draw.real(0.5, 2)],
        ["group", "late", "id", bead],
        ["reset_timestep", draw.whole(0, 30)],
        ["displace_atoms", "all", "move", *(natural.length * draw.real(-1, 1) for _ in range(3)), "units", "box"],
    ]
    for words in draw.some(choices, 0, 2):
        deck.add(*words)
        if words[0] == "group":
            deck.groups.append("late")
