"""Boxes that ``fix deform`` shears, with beads that cross their faces.

LAMMPS moves the box at the end of a step, so that forces see the images where they were a step ago.  At first no bead is near to the sliding
faces; from there on it is the shear of a box that began a step later, which is the deck that ours gets.  In the step in which it flips the box,
LAMMPS forgets the velocity of a bead that crosses; here no box is tilted so far.
"""

from ..deck import Deck
from ..draw import Draw
from .interactions import interactions
from .scene import TENSOR, draw_box, head, points

_WORDS = "pe ke etotal fmax fnorm epair lx vol density c_d c_d[1] c_d[4] c_p c_p[1] c_p[4] c_f c_n[1] c_n[2]".split()
_COLUMNS = "vx vy vz fx fy fz y z".split()


def shear(draw: Draw) -> Deck:
    """A deck with a shear."""
    deck = head(Deck(draw), "atomic", ("lj", "lj", "real", "metal"))
    natural = deck.units
    draw_box(deck, 3.4, 4.6, tilted=0.0)
    (low, bottom, _), (length, height, _), count = deck.low, deck.edges, draw.whole(2, 20)
    step, steps = natural.step * draw.pick([1.0, 0.5, 2.0, draw.real(0.3, 1.5)]), draw.whole(5, 120)
    most = 0.97 * length / (height * step * (steps + 1))  # then it is tilted from one end to the other
    rate = draw.pick([-1, 1]) * min(draw.uniform(0.1, 5.0) * natural.velocity / natural.length, most)
    slid = rate * height * step
    room = 0.48 * length - max(rate, 0) * height * step * steps, -0.48 * length + max(-rate, 0) * height * step * steps + abs(slid)
    tilt = draw.uniform(min(room), max(room))
    deck.tilt = (tilt, 0.0, 0.0)
    # farther than half a cutoff from the sliding faces
    places = [
        place for place in points(deck, 6 * count, 0.4) if 0.5 < (place[1] - bottom) / natural.length < height / natural.length - 0.5
    ][:count]
    numbers = [v for corner, edge in zip(deck.low, deck.edges, strict=True) for v in (corner, corner + edge)]
    deck.lines.append("region box prism " + " ".join(f"{number:.15g}" for number in numbers) + f" {tilt!r} 0 0 units box")
    deck.ours = {f" {tilt!r} 0 0": f" {tilt - slid!r} 0 0"}
    deck.add("create_box", deck.types, "box")
    for k in range(1, deck.types + 1):
        deck.add("mass", k, natural.mass * draw.real(0.5, 3))
    for k, place in enumerate(places, start=1):
        # in both boxes, which differ by their tilts
        x = (
            min(max(place[0] - tilt * (place[1] - bottom) / height, low + abs(slid)), low + length - abs(slid))
            + tilt * (place[1] - bottom) / height
        )
        deck.lines.append(f"create_atoms {draw.whole(1, deck.types)} single {x:.15g} {place[1]:.15g} {place[2]:.15g} units box")
        speeds = (natural.velocity * draw.gauss(0, 2) for _ in range(3))
        deck.lines.append(f"set atom {k} " + " ".join(f"v{axis} {speed:.9g}" for axis, speed in zip("xyz", speeds, strict=True)))
    interactions(deck, [draw.pick(["dpd", "dpd", "dpd/ext", "dpd/tstat"])])
    deck.add("fix", "move", "all", "nve")
    deck.lines.append(f"fix slide all deform 1 xy erate {rate!r} remap v")
    deck.lines.append(f"timestep {step!r}")
    deck.lines += ["compute d all temp/deform", "compute p all pressure d", "compute f all temp/profile 1 0 1 y 2"]
    deck.lines += [f"compute n all reduce sumsq {' '.join(draw.some(_COLUMNS, 2, 2))}"]
    deck.add("thermo", draw.whole(1, 10))
    deck.add("thermo_style", "custom", "step", "temp", "press", *draw.some([*_WORDS, *TENSOR], 4, 14))
    deck.add("thermo_modify", "format", "float", "%.15g", *draw.pick([[], ["temp", "d"], ["temp", "d", "norm", "no"]]))
    deck.options["conservative"] = "kernel"
    return deck.run(steps)
