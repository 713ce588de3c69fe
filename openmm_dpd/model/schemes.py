"""Schemes: the substeps of a step, as a word like those in papers.

``A`` is a drift, ``B`` a kick, ``O`` a sweep of exact pair updates, ``S`` one of Shardlow's, each over a part of the step: ``3B/5`` is a
kick over three fifths of it.  To add a scheme, add an entry to :data:`SCHEMES`."""

import re
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from ..base.errors import ParameterError, what_is

_TOKEN = re.compile(r"(\d*)([A-Z])(?:/(\d+))?")
#: Letters of a word, and their meaning.
LETTERS = {"A": "drift", "B": "kick", "O": "sweep of exact pair updates", "S": "sweep of Shardlow's pair updates"}
#: Letters of friction and noise.
SWEEPS = ("O", "S")
#: A letter of a word and its part of the step.
Letter = tuple[str, Fraction]


@dataclass(frozen=True)
class Scheme:
    """A scheme: the substeps of one time step."""

    name: str  #: Name, or the word itself
    letters: tuple[Letter, ...]  #: Empty for schemes that are not words
    reference: str  #: Origin of the scheme
    what: str  #: Description in one line
    # {"sweep", "force", "openmm"}: whether friction and noise are pair updates, forces for a predicted velocity, or those of OpenMM's
    # DPDIntegrator
    friction: str = "sweep"
    # whether constraints and virtual sites are supported: other words evaluate forces at positions before constraints are applied
    constraints: bool = False
    in_lammps: bool = False  #: Whether LAMMPS has the scheme
    measured: bool = True  #: Whether :func:`openmm_dpd.recommend` has its accuracy

    def __str__(self) -> str:
        return self.name

    @property
    def word(self) -> str:
        """The word of the scheme, or "" if it is not a word."""
        return " ".join(spelt(letter) for letter in self.letters)

    @property
    def sweeps(self) -> bool:
        """Whether friction and noise are sweeps of pair updates."""
        return self.friction == "sweep"

    @property
    def predicts(self) -> bool:
        """Whether friction is a force for a velocity predicted with a weight (``lam``)."""
        return self.friction == "force"

    @property
    def native(self) -> bool:
        """Whether OpenMM's own DPDIntegrator carries out the steps."""
        return self.friction == "openmm"

    @property
    def shardlow(self) -> bool:
        """Whether pair updates are Shardlow's."""
        return any(letter == "S" for letter, _ in self.letters)

    @cached_property
    def lag(self) -> float:
        """Part of a step's kick by which velocities at whole steps lag behind positions.

        It is the sum over kicks of the kick times all drifts after it, less 1/2.  For kicks placed evenly between drifts, it is half the
        difference between the kick before the first drift and that after the last.
        """
        left, behind = Fraction(1), Fraction(-1, 2)
        for letter, part in self.motion:
            if letter == "A":
                left -= part
            elif letter == "B":
                behind += part * left
        return float(behind)

    def on_step(self, v, force, inv_mass, dt: float):
        """Velocities (N, 3) at the time of the positions, from those at a whole step and the force there."""
        return v + self.lag * dt * inv_mass[:, None] * force if self.lag else v

    @property
    def motion(self) -> tuple[Letter, ...]:
        """Letters of a step, also for schemes that are not words."""
        return self.letters or (_MIDDLE if self.native else _VERLET)

    def steps(self, thermostat: bool = True) -> tuple[Letter, ...]:
        """Letters of a step: successive drifts or kicks are merged, and sweeps are left out if there is no ``thermostat``.

        Schemes that are not words have the letters of velocity Verlet.
        """
        kept: list[Letter] = []
        for letter, part in self.motion:
            if letter in SWEEPS and not thermostat:
                continue
            if kept and kept[-1][0] == letter and letter not in SWEEPS:  # two sweeps are not one sweep over both parts
                kept[-1] = (letter, kept[-1][1] + part)
            else:
                kept.append((letter, part))
        return tuple(kept)


def spelt(letter: Letter) -> str:
    """A letter and its part as text in a word, such as ``3B/5``."""
    name, part = letter
    return ("" if part.numerator == 1 else str(part.numerator)) + name + ("" if part.denominator == 1 else f"/{part.denominator}")


def read_word(text: str) -> tuple[Letter, ...]:
    """Letters of a word; ParameterError if they are not a full step."""
    letters: list[Letter] = []
    for token in text.split():
        found = _TOKEN.fullmatch(token)
        if found is None or found[2] not in LETTERS:
            allowed = ", ".join(f"{letter} ({what})" for letter, what in LETTERS.items())
            raise ParameterError(f"{token!r} is no part of a step in the scheme {what_is(text)}; the letters are {allowed}, as in '3B/5'")
        if found[1] and not int(found[1]) or found[3] and not int(found[3]):
            raise ParameterError(f"{token!r} in the scheme {what_is(text)} is no part of a step: a number in it is 0")
        letters.append((found[2], Fraction(int(found[1] or 1), int(found[3] or 1))))
    for group, what in ((("A",), "drifts A"), (("B",), "kicks B"), (SWEEPS, "sweeps O and S")):
        total = sum((part for letter, part in letters if letter in group), Fraction(0))
        if total != 1:
            raise ParameterError(f"the {what} of the scheme {what_is(text)} add up to {total} of a step, not to 1")
    return tuple(letters)


_VERLET = (("B", Fraction(1, 2)), ("A", Fraction(1)), ("B", Fraction(1, 2)))
_MIDDLE = read_word("B A/2 O A/2")  # the order of OpenMM's DPDIntegrator


def _word(name: str, word: str, reference: str, what: str, **properties) -> Scheme:
    return Scheme(name, read_word(word), reference, what, **properties)


_ALL = (
    Scheme(
        "mvv",
        (),
        "Groot and Warren 1997",
        "modified velocity Verlet: friction and noise are forces (LAMMPS: fix nve, fix mvv/dpd)",
        friction="force",
        in_lammps=True,
    ),
    _word(
        "shardlow",
        "S B/2 A B/2",
        "Shardlow 2003, S1",
        "one sweep of Shardlow's pair updates, then velocity Verlet (LAMMPS: fix shardlow)",
        in_lammps=True,
    ),
    _word(
        "middle",
        "B A/2 O A/2",
        "Zhang et al. 2019, with exact pair updates",
        "kick, half drift, sweep of exact pair updates, half drift",
        constraints=True,
    ),
    _word(
        "basa",
        "B A/2 S A/2",
        "Zhang et al. 2019, with Shardlow's pair updates; Jensen and Gronbech-Jensen 2019",
        "as middle, with a sweep of Shardlow's updates: of each pair alone it diffuses as it should at any step",
        constraints=True,
    ),
    _word(
        "aboba",
        "A/2 B/2 O B/2 A/2",
        "Shang 2021, ABOBA, with exact pair updates",
        "half drift, half kick, sweep of exact pair updates, half kick, half drift",
    ),
    _word(
        "bababo",
        "B/5 A/2 3B/5 A/2 B/5 O",
        "McLachlan 1995 with weights for sampling, and exact pair updates",
        "kick, half drift, kick, half drift, kick, sweep of exact pair updates: two forces per step, for steps twice as long",
    ),
    _word(
        "bababs",
        "B/5 A/2 3B/5 A/2 B/5 S",
        "as bababo, with Shardlow's pair updates; Jensen and Gronbech-Jensen 2019",
        "as bababo, with a sweep of Shardlow's updates: half the error of diffusion under strong friction",
    ),
    _word(
        "bab3",
        "3B/25 3A/10 19B/50 2A/5 19B/50 3A/10 3B/25 O",
        "Blanes, Casas and Sanz-Serna 2014, with weights for sampling, and exact pair updates",
        "three forces per step, for steps half as long again as those of bababo: structure, and stiff bonds",
    ),
    Scheme("native", (), "OpenMM", "OpenMM's own DPDIntegrator", friction="openmm"),
)

#: Schemes with a name.
SCHEMES: dict[str, Scheme] = {scheme.name: scheme for scheme in _ALL}


def scheme_of(text: str | Scheme) -> Scheme:
    """Scheme of a name or word (the word of a named scheme is that scheme); ParameterError for anything else."""
    if isinstance(text, Scheme):
        return text
    if not isinstance(text, str) or not text.strip():
        raise ParameterError(f"unknown scheme {what_is(text)}; it must be {_CHOICES}")
    if text in SCHEMES:
        return SCHEMES[text]
    if not any(letter in text.split()[0] for letter in LETTERS):
        raise ParameterError(f"unknown scheme {what_is(text)}; it must be {_CHOICES}")
    letters = read_word(text)
    for scheme in SCHEMES.values():
        if scheme.letters == letters:
            return scheme
    made = Scheme("", letters, "a word of your own", "", measured=False)
    what = ", ".join(LETTERS[letter].replace("sweep", f"sweep over {part}") if part != 1 else LETTERS[letter] for letter, part in letters)
    return Scheme(made.word, letters, made.reference, what, measured=False)


_CHOICES = f"one of {', '.join(SCHEMES)}, or a word such as 'B/2 A/2 O A/2 B/2'"
