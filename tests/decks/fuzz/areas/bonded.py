"""Bonds, angles, dihedrals, impropers and special_bonds."""

import itertools

import numpy as np

from ..deck import Deck
from ..draw import Draw
from .interactions import interactions
from .scene import beads, box_vectors, conservative, draw_box, dump, groups, head, thermo

_BONDS = ("harmonic", "morse", "fene", "zero")
_ANGLES = ("harmonic", "cosine", "zero")
_FOURS = {"dihedral": ("harmonic", "opls", "zero"), "improper": ("harmonic", "cvff", "umbrella", "zero")}


def _chains(deck: Deck) -> tuple[np.ndarray, list[list[int]], list[list[int]], list[int]]:
    """Positions of chains and rings, bonds and angles with their types, and the molecule of each bead."""
    draw, length = deck.draw, deck.units.length
    places: list[np.ndarray] = []
    bonds: list[list[int]] = []
    angles: list[list[int]] = []
    molecules: list[int] = []
    for molecule in range(1, draw.whole(1, 4) + 1):
        size, first = draw.whole(2, 6), len(places) + 1
        x = np.array([draw.random() for _ in range(3)]) @ box_vectors(deck) + np.array(deck.low)
        for k in range(size):
            places.append(x)
            direction = np.array([draw.gauss(0, 1) for _ in range(3)])
            x = x + length * draw.uniform(0.5, 0.8) * direction / np.linalg.norm(direction)
            molecules.append(molecule)
            if k:
                bonds.append([draw.whole(1, 2), first + k - 1, first + k])
            if k > 1:
                angles.append([draw.whole(1, 2), first + k - 2, first + k - 1, first + k])
    for _ in range(draw.whole(0, 6)):
        places.append(np.array([draw.random() for _ in range(3)]) @ box_vectors(deck) + np.array(deck.low))
        molecules.append(0)
    bonds[0][0] = 2  # every type has to be there, since the header counts the types that are
    if angles:
        angles[0][0] = 2
    return np.round(places, 9), bonds, angles, molecules


def _inside(deck: Deck, x: np.ndarray) -> np.ndarray:
    fractions = (x - np.array(deck.low)) @ np.linalg.inv(box_vectors(deck))
    return np.round((fractions - np.floor(fractions)) @ box_vectors(deck) + np.array(deck.low), 9)


def _coefficients(deck: Deck, command: str, styles: tuple[str, ...], table) -> None:
    draw = deck.draw
    hybrid = draw.chance(0.3)
    chosen = draw.some(styles, 2, 2) if hybrid else [draw.pick(styles)]
    deck.add(f"{command}_style", *(["hybrid"] if hybrid else []), *chosen)
    for kind in (1, 2):
        style = chosen[(kind - 1) % len(chosen)]
        deck.add(f"{command}_coeff", kind, *([style] if hybrid else []), *table(style))


def bonded(draw: Draw) -> Deck:
    """A deck with bonds, perhaps angles."""
    style = draw.pick(["bond", "angle", "molecular", "full"])
    deck = head(Deck(draw), style, ("lj", "lj", "real"))
    natural = deck.units
    draw_box(deck, 3.4, 4.5)
    x, bonds, angles, molecules = _chains(deck)
    if style == "bond" or draw.chance(0.2):
        angles = []
    if draw.chance(0.6):
        random = ["lj", draw.real(0, 1), draw.real(0, 1), draw.real(0, 1)]
        deck.add("special_bonds", *draw.pick([["lj", 1.0, 1.0, 1.0], ["lj/coul", 0.0, 0.5, 1.0], random, ["fene"], ["lj", 0.0, 1.0, 1.0]]))
    fours: dict[str, list[list[int]]] = {}
    quads = [[i, j, k, m] for (_, i, j, k), (_, _, _, m) in itertools.pairwise(angles) if m == k + 1]
    # LAMMPS takes the images that are nearest to the second bead, so that an improper longer than half the box is another one there
    half = 0.5 / np.linalg.norm(np.linalg.inv(box_vectors(deck)), axis=0).max()
    quads = [quad for quad in quads if np.linalg.norm(x[quad[3] - 1] - x[quad[0] - 1]) < half]
    for what in _FOURS if quads and style in ("molecular", "full") else ():
        if draw.chance(0.5):
            # with beads that are at most two bonds apart next to each other, and to the vertex
            fours[what] = [[draw.whole(1, 2), *((j, i, k, m) if what == "improper" else (i, j, k, m))] for i, j, k, m in quads]
            fours[what][0][0] = 2
    beads(deck, len(x), bonds=bonds, angles=angles, carried={"mol": molecules}, places=_inside(deck, x), fours=fours)
    if fours:
        deck.add("comm_modify", "cutoff", natural.length * 2.6)

    def bond(name: str) -> list[object]:
        k, r0 = natural.energy / natural.length**2 * draw.real(5, 100), natural.length * draw.real(0, 0.8)
        table: dict[str, list[object]] = {
            "harmonic": [k, r0],
            "morse": [natural.energy * draw.real(1, 20), draw.real(0.5, 2) / natural.length, r0],
            "fene": [k, natural.length * 1.5, natural.energy * draw.pick([0.0, 1.0]), natural.length * draw.real(0.4, 0.7)],
            "zero": [],
        }
        return table[name]

    def angle(name: str) -> list[object]:
        return {
            "harmonic": [natural.energy * draw.real(1, 20), draw.real(60, 180)],
            "cosine": [natural.energy * draw.real(1, 20)],
            "zero": [],
        }[name]

    def four(what: str, name: str) -> list[object]:
        energies = [natural.energy * draw.real(0.5, 5) for _ in range(4)]
        waves: list[object] = [energies[0], draw.pick([1, -1]), draw.whole(0, 4)]
        bent = [energies[0], draw.pick([0.0, draw.real(5, 85)])]
        return {"cvff": waves, "umbrella": bent, "opls": energies, "zero": [], "harmonic": waves if what == "dihedral" else bent}[name]

    _coefficients(deck, "bond", _BONDS, bond)
    if angles:
        _coefficients(deck, "angle", _ANGLES, angle)
    for what in fours:
        _coefficients(deck, what, _FOURS[what], lambda name, what=what: four(what, name))
    interactions(deck, [draw.pick(["dpd", "dpd", "dpd/ext", "zero", "dpd/fdt"])])
    groups(deck)
    if draw.chance(0.15):
        deck.add("group", "lost", "id", draw.whole(1, deck.beads))
        deck.add("delete_atoms", "group", "lost", "bond", "yes")
        deck.add("reset_atoms", "id")
    deck.add("fix", 1, "all", "nve")
    deck.add("timestep", natural.step * 0.5)
    thermo(deck, *draw.some(["ebond", "eangle", "edihed", "eimp", "emol", "bonds", "angles", "dihedrals", "impropers"], 1))
    dump(deck)
    conservative(deck)
    deck.run(draw.whole(0, 4))
    if draw.chance(0.4):
        deck.add("write_data", "out.data", *draw.pick([[], ["pair", "ij"], ["nocoeff"]]))
    if draw.chance(0.3):
        deck.add("group", "gone", "id", draw.whole(1, deck.beads))
        words = [[], ["bond", "yes"], ["bond", "yes", "compress", "no"], ["compress", "yes", "bond", "yes"]]
        deck.add("delete_atoms", "group", "gone", *draw.pick(words))
        deck.run(1)
    return deck
