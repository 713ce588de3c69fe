"""Fluids under gravity: velocities set by formulas, temperatures of parts of them, correlations, and single frames."""

from ..deck import Deck
from ..draw import Draw
from .averages import Values
from .interactions import interactions
from .scene import beads, conservative, draw_box, groups, head, movers, thermo, timestep


def _gravity(deck: Deck) -> None:
    """A fix gravity; numbers may be variables."""
    draw = deck.draw
    style, size = draw.pick([("vector", 3), ("chute", 1), ("spherical", 2)])
    words: list[object] = [deck.units.force / deck.units.mass * draw.real(-2, 2)]
    words += [draw.real(0.1, 2) if style == "vector" else draw.real(-180, 180) for _ in range(size)]
    if draw.chance(0.4):
        k, name = draw.whole(0, size), deck.name("v")
        deck.add("variable", name, "equal", f'"{draw.word(words[k])}*lx/lx"')
        words[k] = f"v_{name}"
    deck.add("fix", deck.name("push"), deck.group(), "gravity", words[0], style, *words[1:])


def _set(deck: Deck) -> None:
    """A property of beads by a formula of them."""
    draw, natural, name = deck.draw, deck.units, deck.name("v")
    target = draw.pick([["group", deck.group()], ["type", draw.whole(1, deck.types)], ["atom", f"*{draw.whole(1, deck.beads)}"]])
    speed, axis = f"{natural.velocity:g}", draw.pick("xyz")
    spread, shifted = f"0.5*v{axis}+{speed}*(type==1)", f"{axis}+0.05*{natural.length:g}*sin(id)"
    types = f"1+(id>{draw.whole(1, deck.beads)})*{deck.types - 1}"
    choices = [(f"v{axis}", f"{speed}*sin(x/{natural.length:g}+id)"), (f"v{axis}", spread), (axis, shifted), ("type", types)]
    word, formula = draw.pick([*choices, ("image", "id-3.5")])
    deck.add("variable", name, "atom", f'"{formula}"')
    deck.add("set", *target, word, *([f"v_{name}"] if word != "image" else [draw.pick(["NULL", 1]), f"v_{name}", 0]))


def _temperature(deck: Deck, values: Values) -> None:
    """A compute of the temperature of some components, or without the flow of each bin."""
    draw, name = deck.draw, deck.name("c")
    flags = [draw.whole(0, 1) for _ in range(3)]
    table = False
    if draw.chance(0.4):
        deck.add("compute", name, deck.group(), "temp/partial", *flags)
    else:
        flags[draw.whole(0, 2)] = 1
        axes = draw.pick(["x", "y", "z", "xy", "yz", "xz", "xyz"])
        table = draw.chance(0.3)
        # with more bins than beads LAMMPS stops
        counts = [draw.whole(1, 3 if deck.beads > 15 or k == 0 and deck.beads > 5 else 1) for k in range(len(axes))]
        deck.add("compute", name, deck.group(), "temp/profile", *flags, axes, *counts, *(["out", "bin"] if table else []))
        if table:
            bins = counts[0] * (counts[1] if len(counts) > 1 else 1) * (counts[2] if len(counts) > 2 else 1)
            values.tables[f"c_{name}"] = (bins, 2)
    values.scalars.append(f"c_{name}")
    if not table:
        values.temperatures.append(name)
        values.vectors[f"c_{name}"] = 6
        values.scalars += [f"c_{name}[{k}]" for k in range(1, 7)]
    if draw.chance(0.3):
        deck.add("compute_modify", draw.pick([name, name, "thermo_temp"]), "extra/dof", draw.whole(0, 4))


def _correlate(deck: Deck, values: Values) -> None:
    """A fix ave/correlate."""
    draw, name = deck.draw, deck.name("a")
    words = draw.some([*values.scalars, *values.variables], 1, 3)
    every, repeat = draw.whole(1, 2), draw.whole(1, 4)
    kinds = ["auto", "auto/upper", "auto/lower", "full", "first"] + (["upper", "lower"] if len(words) > 1 else [])
    kind = draw.pick(kinds)
    options: list[object] = ["type", kind] if draw.chance(0.7) or kind.endswith("lower") else []
    options += draw.pick([[], ["ave", "one"], ["ave", "running"], ["ave", "running", "overwrite"]])
    if draw.chance(0.3):
        options += ["start", draw.whole(0, 8)]
    if draw.chance(0.3):
        options += ["prefactor", draw.real(-2, 2)]
    options += ["title3", '"# rows"'] if kind.endswith("lower") else []  # LAMMPS leaves titles of the types with lower out
    deck.add(
        "fix", name, "all", "ave/correlate", every, repeat, every * (repeat + draw.whole(0, 2)), *words, *options, "file", f"{name}.corr"
    )


def _frame(deck: Deck) -> None:
    """A write_dump."""
    draw, name = deck.draw, deck.name("w")
    style = draw.pick(["atom", "custom", "custom", "xyz"])
    columns = draw.some("type mass xu yu zu vx vy vz".split(), 1, 5) if style == "custom" else []
    form = ["format", "float", "%.15g"] if style == "custom" else ["format", "line", '"%s %.10g %.10g %.10g"'] if style == "xyz" else []
    file = draw.pick([f"{name}.txt", f"{name}.*.txt", "frames.txt"])
    deck.add("write_dump", deck.group(), style, file, *(["id", *columns] if columns else []), "modify", "sort", "id", "pbc", "yes", *form)


def streaming(draw: Draw) -> Deck:
    """A deck with gravity, set with variables, temp/partial, temp/profile, compute_modify, ave/correlate and write_dump."""
    deck = head(Deck(draw), "atomic", ("lj", "lj", "real", "metal"))
    deck.accuracy = 2e-6  # of the files that fix ave/correlate and dumps write with few digits
    draw_box(deck)
    beads(deck, draw.whole(2, 20), 0.4)
    interactions(deck, [draw.pick(["dpd", "dpd/ext", "lj/cut", "zero"])])
    groups(deck)
    movers(deck)
    timestep(deck)
    for maker in draw.choices([_gravity, _set], k=draw.whole(1, 3)):
        maker(deck)
    values = Values(deck)
    for _ in range(draw.whole(1, 3)):
        _temperature(deck, values)
    values.variable()
    if values.temperatures and draw.chance(0.5):
        name = deck.name("c")
        deck.add("compute", name, "all", "pressure", draw.pick(values.temperatures))
        values.scalars += [f"c_{name}", f"c_{name}[{draw.whole(1, 6)}]"]
    for _ in range(draw.whole(0, 2)):
        _correlate(deck, values)
    if values.tables and draw.chance(0.6):
        deck.add("fix", "t", "all", "ave/time", 1, 1, 1, f"{draw.pick(list(values.tables))}[*]", "mode", "vector", "file", "t.time")
    thermo(deck, *draw.some([*values.scalars, *values.variables], 1, 6), every=draw.pick([1, 2, 5]), most=4)
    if values.temperatures and draw.chance(0.4):
        deck.add("thermo_modify", "temp", draw.pick(values.temperatures))
    if draw.chance(0.4):
        deck.add("fix", "say", "all", "print", draw.pick([2, 50]), '"$(step)"', "file", "say.txt", "screen", "no")
    if draw.chance(0.4):
        deck.add("dump", "z", "all", "xyz", 50, draw.pick(["z.xyz", "z.*.xyz"]))
        deck.add("dump_modify", "z", "sort", "id")
    conservative(deck)
    deck.run(draw.whole(0, 8))
    for _ in range(draw.whole(0, 2)):
        draw.pick([_frame, _frame, _set])(deck)
    if draw.chance(0.3):
        deck.add("fix", "late", "all", "print", 50, '"never"', "file", "late.txt", "screen", "no")
    return deck.run(draw.whole(0, 4))
