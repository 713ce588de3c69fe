"""minimize: where it goes down, to a minimum that both programs reach, and where it stays where it is."""

import numpy as np

from ..deck import Deck
from ..draw import Draw
from .interactions import interactions
from .scene import beads, conservative, draw_box, dump, groups, head, thermo, timestep

MINIMUM = 1e-5  # How far a minimum is known: forces are below 1e-7 of a natural unit, energies depend on their square.


def minimizing(draw: Draw) -> Deck:
    """A deck that minimises, and runs behind it."""
    deck = Deck(draw)
    if draw.chance(0.5):
        _nothing_to_do(deck)
    else:
        _down(deck)
    return deck


def _nothing_to_do(deck: Deck) -> None:
    """No iteration, or one without forces: all that is left are rows, dumps, and the run that follows."""
    draw = deck.draw
    head(deck, "atomic", ("lj", "lj", "real", "metal"))
    draw_box(deck)
    beads(deck, draw.whole(1, 12), 0.4, moving=0.0)
    forces = draw.chance(0.7)
    interactions(deck, [draw.pick(["dpd", "dpd/ext", "lj/cut"]) if forces else "zero"])
    groups(deck)
    deck.add("fix", "move", "all", "nve")
    if draw.chance(0.4):
        deck.add("fix", "hold", draw.pick(deck.groups), "setforce", 0.0, 0.0, 0.0)
        deck.partial = True
        deck.add("compute", "movers", "all", "ke")
    timestep(deck)
    thermo(deck, "fmax", "fnorm", "pe")
    dump(deck)
    conservative(deck)
    if draw.chance(0.4):
        deck.run(draw.whole(0, 2))
        deck.add("velocity", "all", "set", 0.0, 0.0, 0.0)
    _style(deck, ["cg", "sd", "hftn"] if not forces else ["cg", "sd", "hftn", "fire", "quickmin"])
    deck.add("minimize", 0, 0, *([0, 10] if forces else [draw.whole(0, 10), 10]))
    deck.show("step", "pe", "fmax")
    deck.run(draw.whole(0, 3))


def _style(deck: Deck, styles: list[str]) -> None:
    """How to go down; where there is no force, those that follow a motion take all iterations that they may."""
    draw = deck.draw
    if draw.chance(0.5):
        deck.add("min_style", draw.pick(styles))
    if draw.chance(0.3):
        deck.add("min_modify", *draw.pick([["norm", "two"], ["norm", "max"], ["norm", "inf"], ["dmax", 0.05 * deck.units.length]]))


def _down(deck: Deck) -> None:
    """A chain that hangs together by bonds and angles, alone or with a soft repulsion that does not reach it: one minimum."""
    draw = deck.draw
    head(deck, "molecular", ("lj", "lj", "real"))
    natural = deck.units
    draw_box(deck, 4.0, 6.0, types=1)
    count = draw.whole(2, 5)
    directions = np.array([[0.6 * (k + 0.1 * draw.random()), 0.3 * (k % 2), 0.1 * draw.random()] for k in range(count)])
    places = np.round(np.array(deck.low) + natural.length * (0.2 + directions), 9)
    bonds = [[1, k, k + 1] for k in range(1, count)]
    angles = [[1, k, k + 1, k + 2] for k in range(1, count - 1)] if draw.chance(0.7) else []
    beads(deck, count, bonds=bonds, angles=angles, carried={"mol": [1] * count}, places=places)
    deck.add("special_bonds", "lj", 0.0, 0.0, 0.0)
    style = "harmonic" if angles or count > 2 else draw.pick(["harmonic", "morse"])
    length, stiff = natural.length * draw.real(0.5, 0.8), natural.energy / natural.length**2
    deck.add("bond_style", style)
    if style == "harmonic":
        deck.add("bond_coeff", 1, stiff * draw.real(10, 60), length)
    else:
        deck.add("bond_coeff", 1, natural.energy * draw.real(5, 20), draw.real(1, 2) / natural.length, length)
    if angles:
        deck.add("angle_style", "harmonic")
        deck.add("angle_coeff", 1, natural.energy * draw.real(3, 10), draw.real(100, 170))
    deck.add("pair_style", "zero", 0.5 * natural.length)
    deck.add("pair_coeff", "*", "*")
    deck.add("comm_modify", "cutoff", 3.0 * natural.length)
    deck.add("min_style", draw.pick(["fire", "hftn"]))  # LAMMPS's cg goes to and fro about some minima until its iterations are used up
    held = draw.chance(0.4)
    if held:
        deck.add("group", "held", "id", draw.whole(1, count))
        deck.add("fix", "hold", "held", "setforce", 0.0, 0.0, 0.0)
    deck.add("minimize", 0, f"{1e-9 * natural.force:g}", 100000, 1000000)
    deck.add("reset_timestep", 0)
    if held:
        deck.show("xcm(held,x)", "xcm(held,y)", "xcm(held,z)")
    deck.accuracy = MINIMUM
    deck.add("fix", "move", "all", "nve")
    deck.add("thermo_style", "custom", "step", "pe", "ebond", "eangle", *([] if held else ["ke", "temp"]))
    deck.add("thermo_modify", "norm", "no", "format", "float", "%.12g")
    deck.run(0)
