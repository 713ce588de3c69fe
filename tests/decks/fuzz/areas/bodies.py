"""Rigid bodies: lumps, rods and pairs of any molecules, whole or of images far apart, among free beads."""

import numpy as np

from ..deck import Deck
from ..draw import Draw
from .bonded import _inside
from .interactions import interactions
from .scene import beads, box_vectors, draw_box, dump, groups, head


def bodies(draw: Draw) -> Deck:
    """A deck with a fix rigid/nve or rigid/nve/small.  The first run is without a step: only then LAMMPS has velocities of bodies."""
    deck = head(Deck(draw), "molecular", ("lj", "lj", "real"))
    length, places, molecules = deck.units.length, list[np.ndarray](), list[int]()
    draw_box(deck, 3.4, 5.0)
    count = draw.whole(1, 4)
    for molecule in range(1, count + 1):
        start = np.array([draw.random() for _ in range(3)]) @ box_vectors(deck) + np.array(deck.low)
        along = np.array([draw.gauss(0, 0.4) for _ in range(3)])
        rod = draw.chance(0.25)
        for k in range(draw.whole(2, 7)):
            places.append(start + length * (k * along if rod else np.array([draw.gauss(0, 0.45) for _ in range(3)])))
            molecules.append(molecule)
    for _ in range(draw.whole(0, 30)):
        places.append(np.array([draw.random() for _ in range(3)]) @ box_vectors(deck) + np.array(deck.low))
        molecules.append(0)
    beads(deck, len(places), carried={"mol": molecules}, places=_inside(deck, np.array(places)))
    interactions(deck, [draw.pick(["dpd", "dpd", "dpd/tstat"])])
    deck.add("group", "stiff", "molecule", "1:9")
    deck.add("group", "first", "molecule", 1)
    deck.add("group", "free", "subtract", "all", "stiff")
    groups(deck)
    if draw.chance(0.3):
        deck.add("fix", "push", deck.group(), "addforce", *[deck.units.force * draw.real(-5, 5) for _ in range(3)])
    excluded = draw.pick(["", "molecule/intra stiff", "group first first", "type 1 1" if deck.types > 1 else "", "group first stiff"])
    if excluded:
        deck.add("neigh_modify", "exclude", *excluded.split())
    style = draw.pick(["rigid/nve molecule", "rigid/nve/small molecule", "rigid/nve single", "rigid/nve group 1 first"])
    some = style.endswith(("single", "first"))
    deck.add("fix", "bodies", "first" if some else "stiff", *style.split())
    if draw.chance(0.8):
        deck.add("fix", "move", "free", "nve")
    deck.add("timestep", deck.units.step * 0.02)
    deck.accuracy = 1e-7
    deck.add("compute", "its", deck.group(), "temp")
    deck.add("compute", "their", "stiff", "temp")
    deck.add("thermo", 1)
    deck.add("thermo_style", "custom", "step", "temp", "pe", "ke", "etotal", "c_its", "c_their")
    deck.add("thermo_modify", "format", "float", "%.15g")
    deck.run(0)
    dump(deck)
    deck.run(draw.whole(0, 6))
    if draw.chance(0.4):
        deck.run(2)
    return deck
