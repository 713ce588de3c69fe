"""Boxes, lattices, regions, groups, set, velocity and delete_atoms: everything before the first run."""

from collections.abc import Callable

import numpy as np

from ..deck import Deck
from ..draw import Draw
from .lattices import box, lattice, region, units

_MOLECULAR = ("bond", "angle", "molecular", "full")


class _Builder:
    """The commands between create_box and the run; ``spacing`` is that of the present lattice."""

    def __init__(self, deck: Deck, spacing: np.ndarray):
        self.deck, self.draw, self.spacing = deck, deck.draw, spacing
        self.created = False

    # -- beads -----------------------------------------------------------------------------------------------------------
    def lattice(self) -> None:
        self.spacing = lattice(self.deck)

    def region(self) -> None:
        region(self.deck, self.spacing)

    def forget_region(self) -> None:
        known = [name for name in self.deck.regions if name != "box"]
        if known and not any(" union " in line or " intersect " in line for line in self.deck.lines):
            name = self.draw.pick(known)
            self.deck.add("region", name, "delete")
            self.deck.regions.remove(name)

    def create(self) -> None:
        deck, draw = self.deck, self.draw
        kind = draw.whole(1, deck.types)
        style = draw.pick(["single", "single", "box", "region", "region"])
        if style == "single" or self.created:
            place = deck.place()
            if draw.chance(0.5):
                deck.add("create_atoms", kind, "single", *(float(f"{c / s:.10g}") for c, s in zip(place, self.spacing, strict=True)))
            else:
                deck.add("create_atoms", kind, "single", *place, "units", "box")
            return
        words: list[object] = ["region", draw.pick(deck.regions)] if style == "region" else ["box"]
        if deck.types > 1 and draw.chance(0.3):
            words += ["basis", 1, draw.whole(1, deck.types)]
        deck.add("create_atoms", kind, *words)
        self.created = True

    def delete(self) -> None:
        deck, draw = self.deck, self.draw
        target = ["region", draw.pick(deck.regions)] if draw.chance(0.5) else ["group", draw.pick(deck.groups[1:] or ["all"])]
        if target[1] in ("box", "all"):
            return
        deck.add("delete_atoms", *target, *(["compress", draw.pick(["yes", "no"])] if draw.chance(0.4) else []))
        if draw.chance(0.4):
            words = [
                ["reset_atoms", "id"],
                ["reset_atoms", "id", "sort", "yes"],
                ["reset_atoms", "id", "sort", "no"],
                ["reset_ids"],
                ["reset_atom_ids", "sort", "no"],
            ]
            deck.add(*draw.pick(words))

    # -- groups and what beads are ---------------------------------------------------------------------------------------
    def group(self) -> None:
        deck, draw = self.deck, self.draw
        name = draw.pick(deck.groups[1:]) if len(deck.groups) > 1 and draw.chance(0.4) else deck.name("g")
        others = [draw.pick(deck.groups) for _ in range(draw.whole(2, 3))]
        low = draw.whole(1, 12)
        selections: list[list[object]] = [
            ["type", draw.whole(1, deck.types)],
            ["type", draw.pick(["<", ">", "<=", ">=", "==", "!="]), draw.whole(1, deck.types)],
            ["id", low, low + 2],
            ["id", f"{low}:{low + draw.whole(0, 30)}"],
            ["id", f"{low}:{low + 30}:{draw.whole(2, 4)}"],
            ["id", "<>", low, low + 5],
            ["id", draw.pick(["<", ">", "<=", ">="]), low],
            ["region", draw.pick(deck.regions)],
            ["region", draw.pick(deck.regions)],
            ["union", *others],
            ["subtract", *others],
            ["subtract", "all", *others[:1]],
            ["intersect", *others],
            ["empty"],
        ]
        if deck.style in _MOLECULAR:
            selections.append(["molecule", draw.pick([0, 1, 2, "1:2"])])
        if name in deck.groups:
            selections.append(["clear"])
        deck.add("group", name, *draw.pick(selections))
        if name not in deck.groups:
            deck.groups.append(name)

    def target(self) -> list[object]:
        deck, draw = self.deck, self.draw
        atoms = draw.pick([draw.whole(1, 10), "*", f"{draw.whole(1, 5)}*{draw.whole(6, 20)}", f"*{draw.whole(1, 9)}"])
        types = draw.pick([draw.whole(1, deck.types), "*"])
        return draw.pick([["atom", atoms], ["type", types], ["group", draw.pick(deck.groups)], ["region", draw.pick(deck.regions)]])

    def set(self) -> None:
        deck, draw, natural = self.deck, self.draw, self.deck.units
        target = self.target()
        words: list[object] = []
        for _ in range(draw.pick([1, 1, 2])):
            axis = draw.whole(0, 2)
            place = deck.low[axis] + draw.pick([0.5, 0.25, -0.3, 1.4, -0.8, draw.random()]) * deck.edges[axis]
            choices: list[list[object]] = [
                ["xyz"[axis], draw.real(place, place + 0.1 * deck.edges[axis])],
                ["v" + "xyz"[axis], natural.velocity * draw.real(-2, 2)],
                ["image", *(draw.pick([-1, 0, 1, 3, "NULL"]) for _ in range(3))],
                ["type", draw.whole(1, deck.types)],
            ]
            if deck.style in _MOLECULAR:
                choices.append(["mol", draw.whole(0, 3)])
            if deck.style in ("charge", "full"):
                choices.append(["charge", draw.real(-1, 1)])
            words += draw.pick(choices)
        deck.add("set", *target, *words)

    def velocity(self) -> None:
        deck, draw, natural = self.deck, self.draw, self.deck.units
        group = deck.group()

        def speed() -> float:
            return natural.velocity * draw.real(-2, 2)

        options: list[object] = []
        if draw.chance(0.3):
            options += ["sum", draw.pick(["yes", "no"])]
        if draw.chance(0.4):
            options += ["units", draw.pick(["box", "lattice"])]
        style = draw.pick(["set", "set", "ramp", "ramp", "zero", "scale"])
        if style == "set":
            deck.add("velocity", group, "set", *(draw.pick([speed(), speed(), "NULL"]) for _ in range(3)), *options)
        elif style == "ramp":
            axis = draw.whole(0, 2)
            ends = sorted(deck.low[axis] + draw.uniform(-0.2, 1.2) * deck.edges[axis] for _ in range(2))
            scale = 1.0 if "box" in options else float(self.spacing[axis])
            ends = [float(f"{end / scale:.3g}") for end in ends]
            deck.add("velocity", group, "ramp", "v" + draw.pick("xyz"), speed(), speed(), "xyz"[axis], *ends, *options)
        elif style == "zero":
            deck.add("velocity", group, "zero", draw.pick(["linear", "angular"]))
        else:
            deck.add("velocity", group, "scale", natural.temperature * draw.real(0.1, 2.0))

    def show(self) -> None:
        deck, draw = self.deck, self.draw
        group, place = draw.pick(deck.groups), draw.pick(deck.regions)
        axis = draw.pick("xyz")
        words = [f"count({group})", f"count({group},{place})", f"vcm({group},{axis})", f"ke({group})"]
        words += [f"bound({group},{axis}{draw.pick(['min', 'max'])})", f"xcm({group},{axis})", f"mass({group})", "atoms"]
        deck.show(*draw.some(words, 1, 4))


_WEIGHTS: dict[str, float] = {
    "region": 3, "group": 4, "set": 4, "velocity": 3, "create": 1, "delete": 1, "show": 3, "lattice": 0.4, "forget_region": 0.3,
}  # fmt: skip


def setup(draw: Draw) -> Deck:
    """A deck about what comes before the first run."""
    deck = Deck(draw)
    units(deck)
    deck.style = draw.pick(["atomic", "atomic", "charge", "bond", "angle", "molecular", "full"])
    if deck.style != "atomic" or draw.chance(0.3):
        deck.add("atom_style", deck.style)
    spacing = lattice(deck) if draw.chance(0.9) else np.ones(3) * 1.0
    if not any(line.startswith("lattice") for line in deck.lines):
        deck.add("lattice", "sc", 1.0 if deck.units.name == "lj" else deck.units.length)
        spacing = np.full(3, deck.units.length)
    box(deck, spacing)
    deck.types = draw.whole(1, 3)
    deck.add("create_box", deck.types + 1, "box", *(["bond/types", 1] if deck.style in _MOLECULAR and draw.chance(0.5) else []))
    for kind in range(1, deck.types + 2):
        deck.add("mass", kind, deck.units.mass * draw.real(0.5, 2))
    builder = _Builder(deck, spacing)
    if draw.chance(0.8):
        builder.region()
    builder.create()
    if not builder.created:
        for _ in range(draw.whole(0, 8)):
            builder.create()
    commands: list[Callable[[], None]] = [getattr(builder, name) for name in _WEIGHTS]
    for _ in range(draw.whole(2, 10)):
        draw.choices(commands, list(_WEIGHTS.values()))[0]()
    builder.show()
    _random_tail(deck, builder)
    return deck


def _columns(deck: Deck) -> list[str]:
    columns = "id type mass x y z xs ys zs xu yu zu ix iy iz vx vy vz".split()
    return columns + ["mol"] * (deck.style in _MOLECULAR) + ["q"] * (deck.style in ("charge", "full"))


def _random_tail(deck: Deck, builder: _Builder) -> None:
    """The run; now and then a command with random numbers before it, of which only what does not depend on them is compared."""
    draw, kind = deck.draw, deck.types + 1
    scattered = draw.chance(0.35)
    if scattered:
        seed = draw.seed_word()
        fraction = float(f"{draw.random():.2g}")
        choice = draw.pick(["random", "ratio", "subset", "set", "set", "velocity"])
        if choice == "random":
            deck.add("create_atoms", kind, "random", draw.whole(0, 20), seed, draw.pick(["NULL", "NULL", *deck.regions]))
        elif choice in ("ratio", "subset"):
            deck.add("create_atoms", kind, "box", choice, fraction if choice == "ratio" else draw.whole(1, 10), seed)
        elif choice == "set":
            style, amount = ("type/ratio", fraction) if draw.chance(0.7) else ("type/subset", draw.whole(0, 3))
            deck.add("set", *builder.target(), style, kind, amount, seed)
        else:
            words = [
                w for w in (["mom", draw.pick(["yes", "no"])], ["rot", "yes"], ["dist", "gaussian"], ["loop", "geom"]) if draw.chance(0.4)
            ]
            group = deck.group()
            deck.add("velocity", group, "create", deck.units.temperature * draw.real(0.1, 2), seed, *(v for w in words for v in w))
            if not any(w[0] == "mom" and w[1] == "no" for w in words):
                deck.show(*(f"vcm({group},{axis})" for axis in "xyz"))
            deck.show(f"ke({group})")
        deck.add("group", "last", "type", kind)
        deck.show("count(all)", "count(last)")
        deck.add("thermo_style", "custom", "step atoms vol")
    deck.add("pair_style", "zero", 0.4 * deck.units.length)
    deck.add("pair_coeff", "*", "*")
    deck.add("fix", 1, "all", "nve")
    if not scattered:
        deck.add("dump", "d", "all", "custom", 1, "dump.txt", *_columns(deck))
        deck.add("dump_modify", "d", "sort", "id", "format", "float", "%.15g")
        deck.add("thermo_style", "custom", "step atoms temp ke vol lx ly lz xy xz yz xlo xhi ylo zhi density")
        deck.add("thermo_modify", "format", "float", "%.15g")
    deck.run(0)
