"""Data files: written by each program and read by both."""

from ..deck import Deck
from ..draw import Draw
from .bonded import bonded
from .interactions import interactions
from .meso import meso
from .pairs import pairs
from .scene import beads, draw_box, dump, head, thermo

#: Lines that come before the beads, and those that set up forces.
_BEFORE = ("units", "atom_style", "comm_modify", "neighbor", "neigh_modify", "special_bonds", "atom_modify")
_FORCES = ("pair_style", "bond_style", "angle_style", "pair_modify")
_COEFFICIENTS = ("pair_coeff", "bond_coeff", "angle_coeff", "mass")


def _rows(deck: Deck) -> Deck:
    """A plain deck, with a box and beads of any atom style without energies."""
    draw = deck.draw
    style = draw.pick(["atomic", "charge", "bond", "angle", "molecular", "full"])
    head(deck, style)
    draw_box(deck, types=3)
    count = draw.whole(1, 12)
    carried: dict = {"mol": [draw.whole(0, 3) for _ in range(count)], "q": [draw.real(-1, 1) for _ in range(count)]}
    beads(deck, count, 0.4, carried=carried)
    interactions(deck)
    deck.add("fix", 1, "all", "nve")
    thermo(deck)
    dump(deck)
    return deck.run(draw.whole(0, 3))


def data(draw: Draw) -> Deck:
    """A deck that writes its beads, and two that read them: the file of LAMMPS and that of ours."""
    deck = draw.pick([lambda: _rows(Deck(draw)), lambda: bonded(draw), lambda: pairs(draw), lambda: meso(draw)])()
    first = list(deck.lines)
    if not any(line.startswith("write_data") for line in first):
        deck.add("write_data", "out.data", *draw.pick([[], [], ["pair", "ij"], ["pair", "ii"], ["nocoeff"]]))
    bare = "nocoeff" in " ".join(deck.lines[-3:])
    hybrid = any(line.startswith(("pair_style hybrid", "bond_style hybrid", "angle_style hybrid", "pair_style table")) for line in first)
    mixed = any(line.startswith("pair_style lj/cut") for line in first)
    # style zero has no coefficients that a file could hold
    bare = bare or any(line.startswith(_FORCES) and "zero" in line for line in first)
    whole = any(line.startswith("write_data") and "pair ij" in line for line in deck.lines) and not hybrid
    for writer in ("lammps", "ours"):
        deck.next_stage()
        deck.lines += [line for line in first if line.startswith(_BEFORE)]
        deck.lines += [line for line in first if line.startswith(_FORCES)]
        deck.lines.append(f"read_data {writer}_out.data")
        if bare or not (whole or mixed) or draw.chance(0.3):
            deck.lines += [line for line in first if line.startswith(_COEFFICIENTS)]
        deck.lines += [line for line in first if line.startswith("fix")]
        thermo(deck)
        columns = "id type mass x y z xu yu zu vx vy vz fx fy fz".split()
        deck.add("dump", "d", "all", "custom", 1, f"{writer}.txt", *columns)
        deck.add("dump_modify", "d", "sort", "id", "pbc", "yes", "format", "float", "%.15g")
        deck.run(1)
    return deck
