"""A box with beads anywhere in it, soft enough to move a few steps, and what is written of a run."""

import numpy as np

from ..deck import Deck
from .lattices import units

_BEFORE = {  # Columns of a bead in a data file, before its coordinates, by atom style.
    "atomic": "type", "charge": "type q", "bond": "mol type", "angle": "mol type", "molecular": "mol type", "full": "mol type q",
    "dpd": "type theta", "mdpd": "type rho", "edpd": "type temp cv", "tdpd": "type",
}  # fmt: skip


def head(deck: Deck, style: str, names: tuple[str, ...] = ("lj", "lj", "real", "metal"), species: int = 0) -> Deck:
    """Units and what LAMMPS needs to see every pair at every step, and to fold beads into the box at every step."""
    units(deck, names)
    deck.style = style
    if style != "atomic":
        deck.add("atom_style", style, *([species] if species else []))
    deck.add("comm_modify", "vel", "yes")
    deck.add("neighbor", 0.3 * deck.units.length, "bin")
    deck.add("neigh_modify", "every", 1, "delay", 0, "check", "no")
    return deck


def draw_box(deck: Deck, low: float = 2.4, high: float = 4.0, tilted: float = 0.35, types: int = 2) -> None:
    """Edges in natural lengths; up to so many types of beads."""
    draw, length = deck.draw, deck.units.length
    deck.low = tuple(length * draw.pick([0.0, 0.0, -1.5, 0.7]) for _ in range(3))  # type: ignore[assignment]
    deck.edges = tuple(float(f"{length * draw.uniform(low, high):.4g}") for _ in range(3))  # type: ignore[assignment]
    deck.tilt = (0.0, 0.0, 0.0)
    if draw.chance(tilted):
        factors = [draw.uniform(-0.5, 0.5) if draw.chance(0.7) else 0.0 for _ in range(3)]
        deck.tilt = tuple(float(f"{f * deck.edges[k]:.3g}") for f, k in zip(factors, (0, 0, 1), strict=True))  # type: ignore[assignment]
    deck.types = draw.whole(1, types) if types > 1 else types


def box_vectors(deck: Deck) -> np.ndarray:
    """Rows are the edges of the box."""
    xy, xz, yz = deck.tilt
    return np.array([[deck.edges[0], 0, 0], [xy, deck.edges[1], 0], [xz, yz, deck.edges[2]]])


def points(deck: Deck, count: int, gap: float = 0.0) -> np.ndarray:
    """(count, 3) points in the box, farther apart than a gap (in natural lengths) if they find room."""
    vectors, found = box_vectors(deck), np.zeros((0, 3))
    for _ in range(50 * count):
        fraction = np.array([deck.draw.random() for _ in range(3)])
        if gap and len(found):
            apart = found - fraction
            apart -= np.round(apart)
            if np.min(np.linalg.norm(apart @ vectors, axis=1)) < gap * deck.units.length:
                continue
        found = np.vstack([found, fraction])
        if len(found) == count:
            break
    return np.round(found @ vectors + np.array(deck.low), 9)


def beads(deck: Deck, count: int, gap: float = 0.0, bonds: list[list[int]] | None = None, angles: list[list[int]] | None = None, moving: float = 0.85,
          carried: dict[str, list[float]] | None = None, places: np.ndarray | None = None, fours: dict[str, list[list[int]]] | None = None) -> np.ndarray:  # fmt: skip
    """Box and beads, from a data file or by commands; masses and velocities; returns the positions."""
    draw, natural = deck.draw, deck.units
    x = points(deck, count, gap) if places is None else places
    deck.beads = len(x)
    types = [draw.whole(1, deck.types) for _ in x]
    speeds = [[natural.velocity * round(draw.gauss(0, 1), 6) for _ in range(3)] if draw.chance(moving) else [0.0] * 3 for _ in x]
    if len(x) == 1 or bonds or carried or draw.chance(0.6):
        _data_file(deck, x, types, speeds, {"bond": bonds, "angle": angles} | (fours or {}), carried or {})
    else:
        numbers = [v for low, edge in zip(deck.low, deck.edges, strict=True) for v in (low, low + edge)]
        if any(deck.tilt):
            deck.add("region", "box", "prism", *numbers, *deck.tilt, "units", "box")
        else:
            deck.add("region", "box", "block", *numbers, "units", "box")
        deck.add("create_box", deck.types, "box")
        for kind, place in zip(types, x, strict=True):
            deck.add("create_atoms", kind, "single", *map(float, place), "units", "box")
        for k, speed in enumerate(speeds, start=1):
            deck.add("set", "atom", k, "vx", speed[0], "vy", speed[1], "vz", speed[2])
    for kind in range(1, deck.types + 1):
        deck.add("mass", kind, natural.mass * draw.real(0.5, 2))
    return x


def _data_file(deck: Deck, x, types, speeds, joined, carried) -> None:
    draw = deck.draw
    lines = ["beads", "", f"{len(x)} atoms", f"{deck.types} atom types"]
    for what, terms in joined.items():
        lines += [f"{len(terms)} {what}s", f"{max(row[0] for row in terms)} {what} types"] if terms else []
    lines += [f"{low:.15g} {low + edge:.15g} {a}lo {a}hi" for a, low, edge in zip("xyz", deck.low, deck.edges, strict=True)]
    if any(deck.tilt):
        lines.append("{} {} {} xy xz yz".format(*deck.tilt))
    lines += ["", "Atoms" + (f" # {deck.style}" if draw.chance(0.5) else ""), ""]
    charges = carried.get("q", [0.0] * len(x))
    imaged = draw.chance(0.4)
    order = list(range(len(x)))
    if draw.chance(0.3):
        draw.shuffle(order)
    for k in order:
        values = {"type": types[k], "q": charges[k], "mol": carried.get("mol", [0] * len(x))[k]}
        values |= {name: column[k] for name, column in carried.items() if name in ("theta", "rho", "temp", "cv")}
        words: list[object] = [k + 1, *(values[name] for name in _BEFORE[deck.style].split()), *x[k].tolist()]
        words += [column[k] for name, column in carried.items() if name.startswith("c") and name != "cv"]
        words += [draw.whole(-1, 1) for _ in range(3)] if imaged else []
        lines.append(" ".join(f"{w:.15g}" if isinstance(w, float) else str(w) for w in words))
    lines += ["", "Velocities", "", *(f"{k + 1} " + " ".join(f"{v:.12g}" for v in speeds[k]) for k in range(len(x)))]
    for name, terms in ((f"{what.capitalize()}s", terms) for what, terms in joined.items()):
        if terms:
            lines += ["", name, "", *(f"{k} " + " ".join(map(str, term)) for k, term in enumerate(terms, start=1))]
    deck.files["beads.txt"] = "\n".join(lines) + "\n"
    deck.add("read_data", "beads.txt")


def groups(deck: Deck) -> None:
    """A few groups of beads."""
    draw = deck.draw
    for _ in range(draw.whole(0, 3)):
        name, low = deck.name("g"), draw.whole(1, max(deck.beads, 1))
        words = [["id", f"1:{low}"], ["type", draw.whole(1, deck.types)], ["id", low], ["id", f"{low}:{deck.beads}:2"]]
        deck.add("group", name, *draw.pick(words))
        deck.groups.append(name)


def movers(deck: Deck, partial: float = 0.2) -> None:
    """The fix that moves the beads, or some of them."""
    group = deck.draw.pick(deck.groups) if deck.draw.chance(partial) else "all"
    deck.add("fix", "move", group, "nve")
    if group != "all":
        deck.partial = True
        deck.add("compute", "movers", group, "temp")


WORDS = (  # Thermo words that need nothing but beads.
    "temp press pe ke etotal enthalpy evdwl ecoul epair ebond eangle edihed eimp emol elong etail vol density lx ly lz xlo xhi ylo yhi zlo zhi "
    "xy xz yz cella cellb cellc cellalpha cellbeta cellgamma fmax fnorm elapsed elaplong dt time atoms bonds angles dihedrals impropers"
).split()

TENSOR = "pxx pyy pzz pxy pxz pyz".split()  # The pressure tensor, which is not known of beads with fields.
_WITH_FIELDS = ("dpd", "edpd", "tdpd")


def thermo(deck: Deck, *more: str, every: int = 1, most: int = 12) -> None:
    """Thermo output: some words and ``more``."""
    draw = deck.draw
    if deck.partial and draw.chance(0.3):
        more = (*more, "c_movers")
    words = [*WORDS, *([] if deck.style in _WITH_FIELDS else TENSOR)]
    deck.add("thermo", every)
    deck.add("thermo_style", "custom", "step", *draw.some(["temp", "press", "pe", "ke"], 2), *draw.some(words, 2, most), *more)
    deck.add("thermo_modify", "format", "float", "%.15g", *draw.pick([[], [], ["norm", "yes"], ["norm", "no"]]))


def dump(deck: Deck, every: int = 1, *more: str) -> None:
    """A dump of all columns."""
    columns = "id type mass x y z xs ys zs xu yu zu ix iy iz vx vy vz fx fy fz".split()
    deck.add("dump", "d", deck.group(), "custom", every, "dump.txt", *columns, *more)
    deck.add("dump_modify", "d", "sort", "id", "pbc", "yes", "format", "float", "%.15g")


def timestep(deck: Deck) -> None:
    """A step in which beads move a hundredth of their size."""
    deck.add("timestep", deck.units.step * deck.draw.pick([1.0, 0.5, 2.0, deck.draw.real(0.3, 1.5)]))


def conservative(deck: Deck) -> None:
    """Which way openmm_dpd computes conservative forces."""
    if deck.draw.chance(0.4):
        deck.options["conservative"] = deck.draw.pick(["kernel", "openmm"])
