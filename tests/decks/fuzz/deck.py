"""A deck in the making: its lines, the files beside it, and what its commands have defined so far."""

from __future__ import annotations

from dataclasses import dataclass, field

from .draw import Draw

MARK = "=== run"  # Printed before every run: thermo output is looked for behind it.


@dataclass(frozen=True)
class Units:
    """Natural sizes in a unit style: what is about 1 in units lj."""

    name: str
    length: float = 1.0
    energy: float = 1.0
    mass: float = 1.0
    velocity: float = 1.0
    step: float = 0.01
    temperature: float = 1.0

    @property
    def force(self) -> float:
        return self.energy / self.length

    @property
    def friction(self) -> float:
        return self.force / self.velocity

    @property
    def noise(self) -> float:
        return self.force * (self.length / self.velocity) ** 0.5


UNITS = (Units("lj"), Units("real", 5.0, 1.0, 50.0, 0.003, 10.0, 300.0), Units("metal", 5.0, 0.05, 50.0, 3.0, 0.01, 300.0))


@dataclass
class Deck:
    """What a grammar writes into.

    Attributes
    ----------
    draw : Draw
        Where its choices come from.
    lines : list of str
        The lines of the present stage.
    stages : list of list of str
        Scripts that are run one after the other in one folder; every ``*.data`` file of a stage reaches both sides in the next one, as
        ``lammps_NAME`` and ``ours_NAME``.
    files : dict
        Text of the files beside the deck.
    same : list of (str, str)
        Files of ours that must be the same in the end, to the bit.
    options : dict
        ``conservative`` and ``compat``: options of openmm_dpd that change nothing of the physics that is compared.
    ours : dict
        Words that our deck has in place of others.
    accuracy : float
        Relative accuracy to which both sides must agree.
    of_forces : float
        Difference of forces that is no more than what is known of them.
    units, style : Units, str
        Of the deck, and its atom style.
    types : int
        Number of atom types.
    beads : int
        Number of beads, if the grammar knows it.
    groups, regions : list of str
        Names that exist.
    low, edges, tilt : three floats each
        The box.
    cutoff : float
        Of pair forces, in natural lengths.
    partial : bool
        Whether there may be beads that no fix moves.
    """

    draw: Draw
    lines: list[str] = field(default_factory=list)
    stages: list[list[str]] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)
    same: list[tuple[str, str]] = field(default_factory=list)
    options: dict[str, str] = field(default_factory=dict)
    ours: dict[str, str] = field(default_factory=dict)
    accuracy: float = 0.0
    of_forces: float = 0.0
    units: Units = UNITS[0]
    style: str = "atomic"
    types: int = 1
    beads: int = 0
    groups: list[str] = field(default_factory=lambda: ["all"])
    regions: list[str] = field(default_factory=list)
    low: tuple[float, float, float] = (0.0, 0.0, 0.0)
    edges: tuple[float, float, float] = (1.0, 1.0, 1.0)
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cutoff: float = 1.0
    partial: bool = False
    _names: int = 0

    def __post_init__(self):
        self.stages = [self.lines]

    def add(self, *words: object) -> None:
        """A line of these words."""
        self.lines.append(" ".join(self.draw.word(word) for word in words))

    def name(self, letter: str) -> str:
        """A name that is not in use."""
        self._names += 1
        return f"{letter}{self._names}"

    def show(self, *formulas: str) -> None:
        """Print values of formulas to a file."""
        self.add('print "' + " ".join(f"$({formula}:%.15g)" for formula in formulas) + '" append values.txt screen no')

    def say(self, text: str) -> None:
        """Print text to a file, with any ``$`` in it."""
        self.add(f'print "{text}" append values.txt screen no')

    def run(self, *words: object) -> Deck:
        """A run command."""
        self.add(f'print "{MARK}"')
        self.add("run", *words)
        return self

    def next_stage(self) -> None:
        """Begin another script."""
        self.lines = []
        self.stages.append(self.lines)

    def group(self) -> str:
        """One of the groups, mostly all."""
        return "all" if self.draw.chance(0.5) else self.draw.pick(self.groups)

    def place(self, nice: float = 0.5) -> list[float]:
        """A point in the box."""
        fractions = [self.draw.random() for _ in range(3)]
        x, y, z = (f * edge for f, edge in zip(fractions, self.edges, strict=True))
        xy, xz, yz = self.tilt
        full = (x + fractions[1] * xy + fractions[2] * xz, y + fractions[2] * yz, z)
        return [
            self.draw.real(c + low - 1e-9, c + low + self.units.length / 4, nice) if self.draw.chance(nice) else float(f"{c + low:.12g}")
            for c, low in zip(full, self.low, strict=True)
        ]

    @property
    def texts(self) -> list[str]:
        """The scripts."""
        return ["\n".join(lines) + "\n" for lines in self.stages]
