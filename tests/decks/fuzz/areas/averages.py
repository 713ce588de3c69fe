"""Computes, and averages of them over steps: fix ave/time, fix ave/chunk, rdf, msd, reduce, chunks."""

from ..deck import Deck
from ..draw import Draw
from .interactions import interactions
from .scene import beads, conservative, draw_box, dump, groups, head, movers, thermo, timestep

_BEAD_WORDS = ("x", "y", "z", "vx", "vy", "vz", "fx", "fy", "fz")  # Values of single beads.


class Values:
    """Computes and variables of a deck, and the words by which they are called."""

    def __init__(self, deck: Deck):
        self.deck, self.draw = deck, deck.draw
        self.scalars = ["c_thermo_temp", "c_thermo_press", "c_thermo_pe"]
        self.vectors: dict[str, int] = {}
        self.tables: dict[str, tuple[int, int]] = {}
        self.per_bead: list[str] = []
        self.variables: list[str] = []
        self.temperatures: list[str] = []
        self.chunks: list[str] = []

    def compute(self) -> None:
        """One more compute."""
        deck, draw = self.deck, self.draw
        name, group = deck.name("c"), deck.group()
        style = draw.pick("temp ke pe pressure com momentum gyration msd rdf reduce property/atom ke/atom".split())
        scalar, size = True, 0
        words: list[object] = []
        if style == "temp":
            size = 6
            self.temperatures.append(name)
        elif style == "pe":
            group, words = "all", draw.pick([[], [], ["pair"], ["bond"], ["pair", "bond"]])
        elif style == "pressure":
            size = 6
            group, words = ("all", [draw.pick(["thermo_temp", *self.temperatures]), *draw.pick([[], [], ["virial"], ["ke"]])])
        elif style in ("com", "momentum"):
            scalar, size = False, 3
        elif style == "gyration":
            size = 6
        elif style == "msd":
            scalar, size, words = False, 4, draw.pick([[], ["com", "yes"], ["com", "no"]])
        elif style == "rdf":
            self.rdf(name)
            return
        elif style == "reduce":
            inputs = draw.some([*_BEAD_WORDS, *self.per_bead], 1, 3)
            # of several inputs LAMMPS's sumabs and aveabs are wrong, which is documented
            modes = ["sum", "min", "max", "ave", "sumsq", "avesq", *(["sumabs", "aveabs"] if len(inputs) == 1 else [])]
            words = [draw.pick(modes), *inputs]
            scalar, size = len(inputs) == 1, len(inputs) if len(inputs) > 1 else 0
        else:
            if style == "property/atom":
                words = draw.some([*_BEAD_WORDS, "mass", "type", "id", "xu", "yu", "xs", "ix"], 1, 3)
            self.per_bead += [f"c_{name}"] if len(words) < 2 else [f"c_{name}[{k}]" for k in range(1, len(words) + 1)]
            scalar = False
        deck.add("compute", name, group, style, *words)
        if scalar:
            self.scalars.append(f"c_{name}")
        if size:
            self.vectors[f"c_{name}"] = size
            self.scalars += [f"c_{name}[{k}]" for k in range(1, size + 1)]

    def rdf(self, name: str) -> None:
        """A compute rdf, which is asked for by fix ave/time."""
        deck, draw = self.deck, self.draw
        bins = draw.whole(2, 12)
        kinds = draw.pick([[], [], [1, 1], [1, deck.types], [1, 1, "*", "*"], ["*", deck.types]])
        reach = ["cutoff", deck.units.length * draw.pick([0.8, deck.cutoff])] if draw.chance(0.4) else []
        deck.add("compute", name, deck.group(), "rdf", bins, *kinds, *reach)
        self.tables[f"c_{name}"] = (bins, 1 + 2 * max(len(kinds) // 2, 1))

    def variable(self) -> None:
        """One more variable."""
        deck, draw, name = self.deck, self.draw, self.deck.name("v")
        if draw.chance(0.25):
            value = draw.pick([*_BEAD_WORDS, *self.per_bead])
            deck.add("variable", name, "atom", f'"{value}{draw.pick(["*2", "+y", "^2", "*vx", "*(type==1)"])}"')
            self.per_bead.append(f"v_{name}")
            return
        time = [
            "step", "elapsed", "elaplong", "dt*step", "time", f"ramp({draw.real(0, 2)},{draw.real(0, 5)})", f"vdisplace({draw.real(0, 1)},{draw.real(0.5, 3)})",
            f"swiggle({draw.real(0, 1)},{draw.real(0.5, 3)},{deck.units.step * draw.whole(20, 60)})",
            f"cwiggle({draw.real(0, 1)},{draw.real(0.5, 3)},{deck.units.step * draw.whole(20, 60)})",
        ]  # fmt: skip
        thermo = ["temp", "pe", "ke", "press", "etotal", "vol", "fmax", "fnorm", "enthalpy", f"xcm(all,{draw.pick('xyz')})", f"vcm({deck.group()},x)",
                  f"ke({deck.group()})", "bound(all,xmin)"]  # fmt: skip
        term = draw.pick([draw.pick(time), draw.pick(thermo), draw.pick(self.scalars), *self.variables])
        other = draw.pick(["1", "2", "step", draw.pick(self.scalars), *self.variables])
        deck.add("variable", name, "equal", f'"{term}{draw.pick(["+", "*", "-"])}{other}"' if draw.chance(0.5) else f'"{term}"')
        self.variables.append(f"v_{name}")

    def chunk(self) -> None:
        """One more division of the box."""
        deck, draw, name = self.deck, self.draw, self.deck.name("k")
        cuts = draw.choices([1, 2, 3], [4, 1, 1])[0]
        axes = draw.some("xyz", cuts, cuts)
        reduced = any(deck.tilt) or draw.chance(0.3)
        words: list[object] = []
        for axis in axes:
            k = "xyz".index(axis)
            edge, low = (1.0, 0.0) if reduced else (deck.edges[k], deck.low[k])
            origin = draw.pick(["lower", "lower", "center", "upper", float(f"{low + draw.random() * edge:.4g}")])
            # whole fractions of the edge only where they are exact: a face a rounding error off the end is one slice more in LAMMPS
            fraction = draw.pick([0.5, 0.25, 0.3] if reduced else [draw.uniform(0.2, 0.9)])
            words += [axis, origin, float(f"{edge * fraction:.3g}")]
        words += ["units", "reduced" if reduced else "box"]
        if draw.chance(0.3):
            words += ["discard", draw.pick(["yes", "no", "mixed"])]
        if draw.chance(0.25):
            k = "xyz".index(axes[0])
            edge, low = (1.0, 0.0) if reduced else (deck.edges[k], deck.low[k])
            words += ["bound", axes[0], draw.pick(["lower", float(f"{low + 0.2 * edge:.4g}")])]
            words.append(draw.pick(["upper", float(f"{low + 0.85 * edge:.4g}")]))
        deck.add("compute", name, deck.group(), "chunk/atom", f"bin/{cuts}d", *words)
        self.chunks.append(name)

    # -- averages --------------------------------------------------------------------------------------------------------
    def schedule(self) -> list[object]:
        """Nevery Nrepeat Nfreq."""
        draw = self.draw
        every = draw.pick([1, 1, 2])
        repeat = draw.whole(1, 3)
        return [every, repeat, every * repeat * draw.whole(1, 2) if repeat > 1 else every * draw.whole(1, 4)]

    def options(self) -> list[object]:
        """Options that both averages have."""
        draw = self.draw
        words: list[object] = draw.pick([[], [], ["ave", "one"], ["ave", "running"], ["ave", "window", draw.whole(1, 3)]])
        return [*words, "format", '" %.15g"']

    def average(self) -> None:
        """One more fix ave/time."""
        deck, draw, name = self.deck, self.draw, self.deck.name("a")
        words: list[object]
        vector = draw.chance(0.3) and (self.vectors or self.tables)
        if vector:
            if self.tables and (draw.chance(0.6) or not self.vectors):
                table = draw.pick(list(self.tables))
                words = [draw.pick([f"{table}[*]", f"{table}[1]", f"{table}[2]"])]
            else:
                size = draw.pick(list(self.vectors.values()))
                words = [*draw.some([v for v, n in self.vectors.items() if n == size], 1, 2)]
            words += ["mode", "vector"]
        else:
            words = [*draw.some([*self.scalars, *self.variables, *self.variables], 1, 4)]
            if draw.chance(0.2):
                words += ["off", draw.whole(1, len(words))]
        if draw.chance(0.3):
            words += ["start", draw.whole(0, 8)]
        deck.add("fix", name, "all", "ave/time", *self.schedule(), *words, *self.options(), "file", f"{name}.time")

    def chunk_average(self) -> None:
        """One more fix ave/chunk."""
        deck, draw, name = self.deck, self.draw, self.deck.name("a")
        values = draw.some(["vx", "vy", "vz", "fx", "fy", "mass", "temp", "density/number", "density/mass", *self.per_bead], 1, 4)
        norm = draw.pick([[], [], ["norm", "all"], ["norm", "sample"], ["norm", "none"], ["adof", 2, "cdof", 1]])
        words = [*self.schedule(), draw.pick(self.chunks), *values, *norm, *self.options()]
        deck.add("fix", name, deck.group(), "ave/chunk", *words, "file", f"{name}.chunk")


def averages(draw: Draw) -> Deck:
    """A deck with computes and averages of a moving fluid."""
    deck = head(Deck(draw), "atomic", ("lj", "lj", "lj", "real", "metal"))
    deck.add("atom_modify", "map", "yes")
    deck.cutoff = 1.0
    draw_box(deck)
    beads(deck, draw.whole(2, 25), 0.4)
    interactions(deck)
    groups(deck)
    timestep(deck)
    movers(deck)
    values = Values(deck)
    for _ in range(draw.whole(2, 7)):
        draw.pick([values.compute, values.compute, values.variable, values.variable])()
    for _ in range(draw.whole(1, 4)):
        if draw.chance(0.4):
            if not values.chunks or draw.chance(0.3):
                values.chunk()
            values.chunk_average()
        else:
            values.average()
    thermo(deck, *draw.some([*values.scalars, *values.variables], 0, 6), every=draw.pick([1, 2, 5]), most=4)
    if values.temperatures and draw.chance(0.4):
        deck.add("thermo_modify", "temp", draw.pick(values.temperatures))
    if draw.chance(0.5):
        dump(deck, draw.pick([1, 3]), *draw.some(values.per_bead, 0, 4))
    conservative(deck)
    for _ in range(draw.pick([1, 1, 2])):
        deck.run(draw.whole(1, 8))
    return deck
