"""Bonds that form and break, without noise: fixes bond/create and bond/break, angles with them, and bonds that repel each other."""

import numpy as np

from ..deck import Deck
from ..draw import Draw
from .bonded import _chains, _inside
from .scene import beads, box_vectors, draw_box, dump, head


def _fixes(deck: Deck) -> dict[str, int]:
    """Fixes by name, with the types of bonds that they make or break; no bead gets more bonds than LAMMPS has room for."""
    draw, length, found = deck.draw, deck.units.length, dict[str, int]()
    if draw.chance(0.8):
        one, other, most = draw.whole(1, deck.types), draw.whole(1, deck.types), draw.whole(1, 3)
        limits = [draw.whole(1, 3) if one != other else most for _ in range(2)]
        later = [draw.whole(1, deck.types) for _ in range(2)] if draw.chance(0.2) and one != other else [one, other]
        found["grow"] = draw.whole(1, 2)
        words = [draw.whole(1, 4), one, other, length * draw.real(0.4, 0.8), found["grow"]]
        words += ["iparam", limits[0], later[0], "jparam", limits[1], later[1]]
        deck.add("fix", "grow", "all", "bond/create", *words, *(["atype", draw.whole(1, 2)] if draw.chance(0.3) else []))
    if not found or draw.chance(0.5):
        found["tear"] = draw.whole(1, 2)
        deck.add("fix", "tear", "all", "bond/break", draw.whole(1, 4), found["tear"], length * draw.real(0.5, 0.9))
    return found


def reacting(draw: Draw) -> Deck:
    """A deck with bonds that form or break, perhaps with srp or srp/react; its beads have no noise."""
    deck = head(Deck(draw), "angle", ("lj", "lj", "real"))
    natural = deck.units
    draw_box(deck, 3.6, 4.5, tilted=0.2)
    x, bonds, angles, molecules = _chains(deck)
    more = [np.array([draw.random() for _ in range(3)]) @ box_vectors(deck) + np.array(deck.low) for _ in range(draw.whole(20, 60))]
    x, molecules = np.vstack([x, *more]), molecules + [0] * len(more)
    equal = draw.chance(0.6)
    deck.add("special_bonds", *(["lj/coul", 1.0, 1.0, 1.0] if equal else draw.pick([["lj/coul", 0.0, 0.5, 1.0], ["lj", 0.5, 1.0, 1.0]])))
    beads(deck, len(x), bonds=bonds, angles=angles, carried={"mol": molecules}, places=_inside(deck, x))
    lines = [k for k, line in enumerate(deck.lines) if line.startswith("read_data")]
    deck.lines[lines[0]] += " extra/atom/types 1 extra/bond/per/atom 9 extra/special/per/atom 40 extra/angle/per/atom 30"
    last = deck.types + 1
    deck.add("mass", "*", natural.mass)
    deck.add("comm_modify", "cutoff", 3.3 * natural.length)
    deck.add("bond_style", "harmonic")
    for kind in (1, 2):
        deck.add("bond_coeff", kind, natural.energy / natural.length**2 * draw.real(5, 60), natural.length * draw.real(0.2, 0.7))
    if angles:
        deck.add("angle_style", "harmonic")
        for kind in (1, 2):
            deck.add("angle_coeff", kind, natural.energy * draw.real(1, 9), draw.real(60, 180))
    fixes = _fixes(deck)
    style = draw.pick(["", "srp", "srp/react", "srp/react", "srp/react"])
    words = ["dpd", 0.0, natural.length, draw.seed_word()]
    if style:
        named = draw.pick(list(fixes))
        kind = draw.pick(["*", fixes[named]]) if style == "srp/react" and len(fixes) < 2 else draw.whole(1, 2)
        distance, exclude = draw.pick([("mid", "yes"), ("mid", "no"), ("min", "yes")])
        deck.options["compat"] = "lammps"
        words += [style, 0.7 * natural.length, kind, distance, *([named] if style == "srp/react" else []), "exclude", exclude]
        deck.add("neighbor", 1.2 * natural.length, "bin")
    deck.add("pair_style", *(["hybrid"] if style else []), *words)
    force, friction = natural.force * draw.real(5, 40), natural.friction * draw.real(0, 5)
    deck.add("pair_coeff", f"1*{deck.types}", f"1*{last if not style else deck.types}", *(["dpd"] if style else []), force, friction)
    if style:
        deck.add("pair_coeff", f"1*{deck.types}", last, "none")
        deck.add("pair_coeff", last, last, style, natural.force * draw.real(10, 60))
    else:
        deck.add("pair_coeff", last, last, force, friction)
    deck.add("fix", "move", "all", "nve")
    deck.add("timestep", natural.step * 0.5)
    deck.add("thermo", 1)
    shown = [f"f_{name}[2]" for name in fixes] + ["angles"] * bool(angles)
    deck.add("thermo_style", "custom", "step", "temp", "pe", "epair", "ebond", "eangle", "press", "bonds", *shown)
    deck.add("thermo_modify", "format", "float", "%.15g", "norm", "no")
    if not style:  # LAMMPS's dumps have its particles of bonds, too
        dump(deck)
    deck.accuracy = 1e-7
    deck.run(draw.whole(3, 12))
    if draw.chance(0.4):
        deck.run(draw.whole(1, 8))
    return deck
