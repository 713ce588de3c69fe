"""Noise: beads at rest are heated by it, at a rate that does not depend on the random numbers."""

from ..deck import Deck
from ..draw import Draw
from .scene import draw_box, head, points


def thermostats(draw: Draw) -> Deck:
    """A deck whose beads begin at rest, feel friction and noise only, and are measured after few steps.

    The mean of v^2 of some 1,000 beads after a step has a standard error of sqrt(2/3000), or 3 %, and somewhat more because each pair
    pushes two beads; both sides have one each.  A third is about six of these.
    """
    deck = head(Deck(draw), "atomic", ("lj", "lj", "real"))
    deck.accuracy = 0.33
    natural = deck.units
    draw_box(deck, 7.0, 7.5, tilted=0.2)
    x = points(deck, 1000)
    lines = ["beads", "", f"{len(x)} atoms", f"{deck.types} atom types"]
    lines += [f"{low:.15g} {low + edge:.15g} {a}lo {a}hi" for a, low, edge in zip("xyz", deck.low, deck.edges, strict=True)]
    lines += ["{} {} {} xy xz yz".format(*deck.tilt)] * any(deck.tilt)
    lines += ["", "Atoms", "", *(f"{k} {1 + k % deck.types} {p[0]:.9g} {p[1]:.9g} {p[2]:.9g}" for k, p in enumerate(x.tolist(), start=1))]
    deck.files["beads.txt"] = "\n".join(lines) + "\n"
    deck.add("read_data", "beads.txt")
    deck.add("mass", "*", natural.mass)
    _styles(deck)
    for kind in range(1, deck.types + 1):
        deck.add("group", f"t{kind}", "type", kind)
        deck.add("compute", f"t{kind}", f"t{kind}", "temp")
    deck.add("fix", 1, "all", "nve")
    if any(" dpd/fdt " in line for line in deck.lines) and draw.chance(0.7):
        deck.lines[-1:] = ["fix 0 all shardlow", "fix 1 all nve"]
    deck.add("timestep", natural.step)
    deck.add("thermo_style", "custom", "step", *(f"c_t{kind}" for kind in range(1, deck.types + 1)))
    deck.add("thermo", 100)
    deck.run(2, *draw.pick([[], ["start", 0, "stop", 10]]))
    if draw.chance(0.5):
        deck.add("velocity", "all", "set", 0.0, 0.0, 0.0)
        deck.run(1)
    return deck


def _styles(deck: Deck) -> None:
    draw, natural = deck.draw, deck.units
    cutoff = natural.length * draw.real(0.8, 1.3)
    temperatures = [natural.temperature * draw.pick([1.0, 1.0, 1.0, 3.0]) for _ in range(2)]

    def friction() -> float:
        return natural.friction * draw.pick([4.5, 2.0, draw.real(1, 10)])

    def settings(style: str, temperature: float) -> list[object]:
        ramp = [temperature, temperature * draw.pick([1.0, 1.0, 2.0])] if style.endswith("tstat") else [temperature]
        return [style, *ramp, cutoff, draw.seed_word()]

    def coefficients(style: str) -> list[object]:
        """Without repulsion, so that noise is all there is; one of two frictions may be missing."""
        along, across = draw.pick([(friction(), friction()), (0.0, friction()), (friction(), 0.0)])
        exponents = [draw.pick([1.0, 0.5, 2.0]) for _ in range(2)]
        table: dict[str, list[object]] = {"dpd": [0.0, along], "dpd/tstat": [along], "dpd/fdt": [0.0, natural.noise * draw.real(1, 4)]}
        table |= {"dpd/ext": [0.0, along, across, *exponents], "dpd/ext/tstat": [along, across, *exponents]}
        return table[style]

    names = ["dpd", "dpd/tstat", "dpd/ext", "dpd/ext/tstat", "dpd/fdt"]
    if draw.chance(0.5):
        style = draw.pick(names)
        deck.add("pair_style", *settings(style, temperatures[0]))
        deck.add("pair_coeff", "*", "*", *coefficients(style))
        return
    chosen = draw.some(names[:4], 2, 2)
    deck.add("pair_style", "hybrid/overlay", *(word for style, t in zip(chosen, temperatures, strict=True) for word in settings(style, t)))
    for style in chosen:
        deck.add("pair_coeff", "*", "*", style, *coefficients(style))
