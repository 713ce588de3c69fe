"""Smeared, point and softened charges: their pair forces and lattice sums."""

from ..compare import LATTICE_SUM
from ..deck import Deck
from ..draw import Draw
from .scene import beads, draw_box, dump, groups, head, timestep


def charges(draw: Draw) -> Deck:
    """A deck with charges of a sum of 0, in a slab of nothing."""
    deck = head(Deck(draw), draw.pick(["charge", "full"]), ("lj", "lj", "real"))
    deck.accuracy = LATTICE_SUM
    natural = deck.units
    draw_box(deck, 3.0, 4.0, tilted=0.2, types=1)
    count = 2 * draw.whole(1, 8)
    scale = 1.0 if natural.name == "lj" else 0.2
    values = [scale * round(draw.uniform(0.2, 2), 3) for _ in range(count // 2)]
    beads(deck, count, 0.4, carried={"q": values + [-value for value in values], "mol": [0] * count})
    lamda, reach = natural.length * draw.real(0.3, 0.6), natural.length * draw.real(1.2, 1.45)
    A, gamma = natural.force * draw.real(1, 25), natural.friction * draw.real(0, 5)
    point = draw.pick(["", "", "coul/cut", "coul/debye", "coul/long", "coul/cut/soft", "coul/long/soft"])
    if point:
        soft = [draw.pick([0, 1, 2]), natural.length**2 * draw.real(0.05, 1)]
        before = soft if point.endswith("soft") else [draw.real(0.5, 2) / natural.length] if point.endswith("debye") else []
        deck.add("pair_style", "hybrid/overlay", "dpd", 0.0, natural.length, draw.seed_word(), point, *before, reach)
        deck.add("pair_coeff", "*", "*", "dpd", A, gamma)
        # with a lattice sum LAMMPS's forces are not the derivative of the energy unless lambda is 1
        deck.add("pair_coeff", "*", "*", point, *([1 if "long" in point else draw.real(0, 1)] if soft is before else []))
    elif draw.chance(0.5):
        deck.add("pair_style", "dpd/coul/slater/long", 0.0, natural.length, draw.seed_word(), lamda, reach)
        deck.add("pair_coeff", "*", "*", A, gamma, "yes")
    else:
        deck.add("pair_style", "hybrid/overlay", "dpd", 0.0, natural.length, draw.seed_word(), "coul/slater/long", lamda, reach)
        deck.add("pair_coeff", "*", "*", "dpd", A, gamma)
        deck.add("pair_coeff", "*", "*", "coul/slater/long")
    if not point or "long" in point:
        deck.add("kspace_style", draw.pick(["ewald", "ewald", "pppm"]), 1e-7)
    if draw.chance(0.3):
        deck.add("dielectric", draw.real(0.5, 2))
    groups(deck)
    deck.add("fix", 1, "all", "nve")
    timestep(deck)
    deck.add("thermo", 1)  # how the energy is split into a short part and a lattice sum is each program's own choice
    deck.add("thermo_style", "custom", "step", "temp", "press", "pe", "etotal", "fnorm")
    deck.add("thermo_modify", "format", "float", "%.15g")
    dump(deck)
    return deck.run(draw.whole(0, 2))
