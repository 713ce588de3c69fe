"""Beads with internal energies, temperatures, concentrations or local densities, without noise.

Without sources too: LAMMPS leaves them out of the very first half step, which is documented.
"""

from ..deck import Deck
from ..draw import Draw
from .scene import beads, draw_box, dump, groups, head, thermo


def meso(draw: Draw) -> Deck:
    """A deck of dpd/fdt/energy, edpd, tdpd or mdpd."""
    style = draw.pick(["dpd", "edpd", "tdpd", "mdpd"])
    species = draw.whole(1, 3)
    deck = head(Deck(draw), style, ("lj", "lj", "real") if style == "dpd" else ("lj",), species if style == "tdpd" else 0)
    natural = deck.units
    sweeps = style == "dpd" and draw.chance(0.4)
    draw_box(deck, 2.7, 4.0, 0.0 if sweeps else 0.35)  # LAMMPS has no neighbour lists for fix shardlow in tilted boxes
    count = draw.whole(2, 25)
    carried: dict[str, list[float]] = {
        "dpd": {"theta": [natural.temperature * round(draw.uniform(0.5, 2), 4) for _ in range(count)]},
        "edpd": {
            "temp": [round(draw.uniform(0.5, 2), 4) for _ in range(count)],
            "cv": [round(draw.uniform(100, 300), 2) for _ in range(count)],
        },
        "tdpd": {f"c{k}": [round(draw.uniform(0, 1), 4) for _ in range(count)] for k in range(1, species + 1)},
        "mdpd": {"rho": [0.0] * count},
    }[style]
    beads(deck, count, 0.3, carried=carried)
    {"dpd": _energy, "edpd": _edpd, "tdpd": _tdpd, "mdpd": _mdpd}[style](deck, sweeps if style == "dpd" else species)
    groups(deck)
    columns = _extra(deck, style, species)
    thermo(deck, most=6)
    dump(deck, 1, *columns)
    return deck.run(draw.whole(0, 4))


def _extra(deck: Deck, style: str, species: int) -> list[str]:
    """Computes of what the beads carry, and their columns."""
    if style == "dpd":
        deck.add("compute", "e", "all", "dpd/atom")
        return [*(f"c_e[{k}]" for k in (1, 2, 4))]
    if style == "edpd":
        deck.add("compute", "e", "all", "edpd/temp/atom")
        return ["c_e"]
    if style == "tdpd":
        for k in range(1, species + 1):
            deck.add("compute", f"e{k}", "all", "tdpd/cc/atom", k)
        return [f"c_e{k}" for k in range(1, species + 1)]
    deck.add("compute", "e", "all", "property/atom", "rho", "vx")
    return ["c_e[1]"]


def _energy(deck: Deck, sweeps: int) -> None:
    draw, natural = deck.draw, deck.units
    deck.add("pair_style", "dpd/fdt/energy", natural.length, draw.seed_word())
    deck.add("pair_coeff", "*", "*", natural.force * draw.real(1, 30), 0.0, 0.0)
    capacity = natural.energy / natural.temperature * draw.real(5, 50)
    deck.add("fix", "eos", "all", "eos/cv", capacity)
    if sweeps:
        deck.add("fix", "pairs", "all", "shardlow")
    else:
        deck.add("fix", "heat", "all", "dpd/energy")
    deck.add("fix", "move", "all", "nve")
    deck.add("timestep", natural.step)


def _edpd(deck: Deck, species: int) -> None:
    draw = deck.draw
    deck.add("pair_style", "edpd", 1.0, draw.seed_word())
    deck.add("pair_coeff", "*", "*", draw.real(1, 30), 0.0, draw.pick([0.5, 1.0, 2.0]), 1.0, 0.0, 2.0, 1.0)
    deck.add("fix", "move", "all", "mvv/edpd", *draw.pick([[], [0.5], [0.65]]))
    deck.add("timestep", 0.01)


def _tdpd(deck: Deck, species: int) -> None:
    draw = deck.draw
    deck.add("pair_style", "tdpd", 0.0, 1.0, draw.seed_word())
    exchange = [word for _ in range(species) for word in (draw.real(0.1, 5), 0.0, draw.pick([1.0, 2.0]))]
    deck.add("pair_coeff", "*", "*", draw.real(1, 30), draw.real(0, 5), draw.pick([1.0, 2.0, 0.5]), 1.0, 1.0, *exchange)
    deck.add("fix", "move", "all", "mvv/tdpd", *draw.pick([[], [0.5], [0.65]]))
    deck.add("timestep", 0.01)


def _mdpd(deck: Deck, species: int) -> None:
    draw = deck.draw
    deck.add("pair_style", "hybrid/overlay", "mdpd/rhosum", "mdpd", 0.0, 1.0, draw.seed_word())
    deck.add("pair_coeff", "*", "*", "mdpd/rhosum", 0.75)
    deck.add("pair_coeff", "*", "*", "mdpd", -draw.real(5, 40), draw.real(5, 30), draw.real(0, 10), 1.0, 0.75)
    deck.add("fix", "move", "all", "mvv/dpd", *draw.pick([[], [0.5], [0.65]]))
    deck.add("timestep", 0.01)
