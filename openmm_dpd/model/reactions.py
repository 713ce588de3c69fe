"""Bonds that form and break during a run."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from ..base.errors import ParameterError, in_length, require, what_is
from ..base.geometry import widths
from ..base.units import checked, keep, whole_number
from .angles import Angles, Dihedrals, Torsions
from .bonds import Bonds, bead_indices, check_members
from .impropers import Impropers
from .internal import Concentrations


@dataclass(frozen=True, eq=False)
class ReactiveBonds:
    """Bonds of one sort, which reactions make and break.  Reactions with the same object act on the same bonds.

    Parameters
    ----------
    kind, coefficients : class, and mapping of str to number
        HarmonicBonds or another kind of bonds, and its coefficients by name, ``{"k": 50.0, "r0": 0.5}``, the same for all bonds.
    pairs : (B, 2) array of int, optional
        The beads of the bonds that there are at the start.
    counted : (K,) array of int, optional
        Beads each of which has one bond more for its valence, as if it had been broken and went on counting; a bead may come twice.
    """

    kind: Any
    coefficients: Mapping[str, float]
    pairs: np.ndarray = ()  # type: ignore[assignment]  # arrays once constructed
    counted: np.ndarray = ()  # type: ignore[assignment]

    def __post_init__(self):
        if not (isinstance(self.kind, type) and issubclass(self.kind, Bonds) and self.kind is not Bonds):
            raise ParameterError(f"the kind of reactive bonds must be a class such as HarmonicBonds, not {what_is(self.kind)}")
        try:
            one = self.between(np.array([[0, 1]]))
        except TypeError:
            names = ", ".join(self.kind._DIMENSIONS)
            raise ParameterError(f"{self.kind.__name__} has the coefficients {names}, not {what_is(self.coefficients)}") from None
        values = {name: float(getattr(one, name)[0]) for name in self.kind._DIMENSIONS}
        each = [*zip(self.counted, strict=True)] if np.iterable(self.counted) else self.counted
        counted = bead_indices(each, 1, "beads with counted bonds").ravel()
        keep(self, coefficients=values, pairs=bead_indices(self.pairs, 2, "reactive bonds"), counted=counted)

    def __str__(self) -> str:
        return f"{self.kind.__name__} with {', '.join(f'{name} = {value:g}' for name, value in self.coefficients.items())}"

    def between(self, pairs: np.ndarray) -> Bonds:
        """Bonds of this sort between these beads, (B, 2)."""
        return self.kind(pairs, **self.coefficients)

    def curve(self, r: np.ndarray) -> tuple[np.ndarray, ...]:
        """Energies, first and second derivatives at these lengths, (B,) each."""
        return self.between(np.tile([[0, 1]], (len(r), 1))).curve(r)


class _Reaction:
    """Base of what makes and breaks bonds."""

    bonds: ReactiveBonds
    probability: float
    rate: float | None
    every: int
    start: int
    forms: ClassVar[bool]  #: Whether it makes bonds
    what: ClassVar[str]  #: What it is, in messages

    def __post_init__(self):
        require(self.bonds, ReactiveBonds, f"the bonds of a {self.what} must be ReactiveBonds")
        probability = checked(self.probability, "dimensionless", f"the probability of a {self.what}")
        rate = None if self.rate is None else checked(self.rate, "rate", f"the rate of a {self.what}")
        if probability > 1.0 or (rate is not None and probability != 1.0):
            raise ParameterError(f"a {self.what} has a probability of at most 1, or a rate in its place, not {probability:g} and {rate}")
        every = whole_number(self.every, f"the interval between trials of a {self.what}, in steps,", least=1)
        start = whole_number(self.start, f"the first step with a trial of a {self.what}", least=0)
        keep(self, probability=probability, rate=rate, every=every, start=start)

    def __str__(self) -> str:
        values: list[tuple[str, Any, Any]] = [(each.name, getattr(self, each.name), each.default) for each in fields(self)[1:]]  # type: ignore[arg-type]
        long = Angles | Torsions | np.ndarray
        given = [(name, value) for name, value, usual in values if np.size(value) != np.size(usual) or np.any(value != usual)]
        given = [(name, [type(each).__name__ for each in value] if name == "takes" else value) for name, value in given]
        given = [(name, type(value).__name__ if isinstance(value, long) else value) for name, value in given]
        return f"{self.what} of {self.bonds}: {', '.join(f'{name} = {value}' for name, value in given)}"

    def until(self, number: int) -> int:
        """Steps from step ``number`` to the end of the next one with a trial."""
        return max(self.start - number, (self.start - number - 1) % self.every + 1)

    def chance(self, dt: float, factor: Any = 1.0) -> Any:
        """Probability at a trial, where steps have this size and the rate is larger by a factor."""
        return self.probability if self.rate is None else -np.expm1(-self.rate * factor * self.every * dt)


@dataclass(frozen=True, eq=False)
class BondFormation(_Reaction):
    r"""Beads that come close are bonded: for good, or in equilibrium.

    Without an ``energy``, mutual nearest beads that have valences left are bonded with a probability at each trial, one bond for each bead
    at most, as in LAMMPS's ``fix bond/create``.  With an ``energy`` :math:`\varepsilon`, every pair that is close enough is chosen with a
    probability, and if both beads may have this bond, it is there afterwards with the probability
    :math:`1/(1 + e^{(U(r) - \varepsilon)/k_BT})`, whatever was before: bonds are in equilibrium (heat bath; Creutz, Phys. Rev. D 21, 2308
    (1980)).

    Parameters
    ----------
    bonds : ReactiveBonds
        What is made.
    types, valences : two type names, and one int or two
        Types of the two beads, and most bonds of this sort that each may have.
    within : length
        Beads have to be closer than this, nm.
    probability : float, or rate : inverse time
        Probability at a trial, 1 by default; or k in 1 - exp(-k t), t the time between trials, 1/ps.
    energy : energy, optional
        By how much a bond is lower than U(r), kJ/mol, of either sign.
    every, start : int
        Steps between trials, 1 by default, and the step of the first one.  A trial comes after the last drift of a step.
    angle : Angles, optional
        One angle of any kind, whatever its beads: a bond that is made has an angle like this with each other bond of its two beads, as in
        LAMMPS.  It goes with either of its bonds.
    between : two angles, optional
        Least and largest angle, rad, of the bond with each other bond of its two beads: otherwise it is not made.
    first : bool
        Whether ``between`` is about the oldest bond of each bead alone, as in LAMMPS, and not about all of them.
    dihedral : Dihedrals, optional
        One dihedral of any kind: there is one like this along each three bonds in a row with a bond that is made.
    improper : Impropers, optional
        One improper of any kind: a bead first, then each three to which it has bonds, of which at least one is made, in the order in which
        the bonds have come, those of the start first.
    becomes : two type names, optional
        Types that the two beads take as soon as they have the bonds of their valence; None in place of a name for no change.  Masses stay.
    molecules, inside : one int for each bead of the scene, optional, and bool
        Numbers of molecules: bonds are made between different ones only, or ``inside`` of one only.
    """

    bonds: ReactiveBonds
    types: tuple[str, str]
    within: float
    valences: tuple[int, int]
    probability: float = 1.0
    rate: float | None = None
    energy: float | None = None
    every: int = 1
    start: int = 0
    angle: Angles | None = None
    between: tuple[float, float] | None = None
    becomes: tuple[str | None, str | None] | None = None
    dihedral: Dihedrals | None = None
    first: bool = False
    molecules: np.ndarray | None = None
    inside: bool = False
    improper: Impropers | None = None
    forms, what = True, "bond formation"

    def __post_init__(self):
        super().__post_init__()
        given = self.valences if isinstance(self.valences, Sequence) else (self.valences,) * 2
        pairs = {"types": self.types, "valences": given}
        pairs |= {name: its for name in ("becomes", "between") if (its := getattr(self, name)) is not None}
        for name, pair in pairs.items():
            if isinstance(pair, str) or not isinstance(pair, Sequence) or len(pair) != 2:
                raise ParameterError(f"the {name} of a bond formation must be two, one for each bead, not {what_is(pair)}")
        valences = tuple(whole_number(each, "a valence of a bond formation", least=1) for each in given)
        if self.types[0] == self.types[1] and valences[0] != valences[1]:
            raise ParameterError(
                f"both beads of a bond formation are {what_is(self.types[0])}, so their valences are the same, not {valences}"
            )
        if self.types[0] == self.types[1] and self.becomes and self.becomes[0] != self.becomes[1]:
            raise ParameterError(f"both beads of a bond formation are {what_is(self.types[0])}, which become the same, not {self.becomes}")
        if (self.becomes or self.between) and self.energy is not None:
            raise ParameterError("bonds in equilibrium (energy) have no `becomes` and no `between`: there would be no way back")
        if self.between is not None:
            low, high = (checked(each, "angle", "an angle between bonds") for each in self.between)
            if not low < high <= np.pi * (1 + 1e-9):
                raise ParameterError(f"bonds form `between` a smaller angle and one of pi at most, not {low:g} and {high:g}")
            keep(self, between=(low, high))
        within = checked(self.within, "length", "the distance of a bond formation", positive=True)
        if self.bonds.between(np.array([[0, 1]])).overstretched(within * np.array([[0.0, 0, 0], [1 - 1e-9, 0, 0]]), None):
            raise ParameterError(f"a bond formation within {in_length(within)} would make longer bonds than {self.bonds} can be")
        energy = None if self.energy is None else checked(self.energy, "energy", "the energy of a bond formation", signed=True)
        four = "one of four beads"
        for name, kind, one in (
            ("angle", Angles, "HarmonicAngles([[0, 1, 2]], k, theta0)"),
            ("dihedral", Dihedrals, four),
            ("improper", Impropers, four),
        ):
            term = getattr(self, name)
            if term is not None and not (isinstance(term, kind) and len(term.beads) == 1):
                raise ParameterError(f"the {name} of a bond formation must be one {name} such as {one}, not {what_is(term)}")
        if self.molecules is not None:
            keep(self, molecules=np.array([whole_number(each, "the number of a molecule", least=-(2**62)) for each in self.molecules]))
        becomes = self.becomes and tuple(self.becomes)
        keep(self, types=tuple(self.types), valences=valences, becomes=becomes, within=within, energy=energy)

    def weight(self, r: np.ndarray, kT: float) -> np.ndarray:
        """exp((U - energy)/kT) at these lengths: the weight of no bond beside that of one."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return np.exp((self.bonds.curve(r)[0] - self.energy) / np.float64(kT))


@dataclass(frozen=True, eq=False)
class BondBreaking(_Reaction):
    r"""Bonds break that are too long, or by chance.

    With ``beyond``, at each trial longer bonds that are the longest of both their beads break with a ``probability``, as in LAMMPS's
    ``fix bond/break``.  With a ``rate``, bonds break at the rate :math:`k_0 e^{F x/k_BT}`, F = U'(r) (Bell, Science 200, 618 (1978)).

    Parameters
    ----------
    bonds : ReactiveBonds
        What breaks.
    beyond, probability : length and float
        Length, nm, and probability with which a longer bond breaks at a trial, 1 by default.
    rate, barrier : inverse time and length
        Rate :math:`k_0` without a tension, 1/ps, and distance x to the barrier, nm, 0 by default.
    spends : bool, default False
        Whether a broken bond goes on counting for the valences of its beads, so that they do not react again, as in LAMMPS.
    every, start : int
        Steps between trials, 1 by default, and the step of the first one.  A trial comes after the last drift of a step.
    takes : sequence of Angles, Dihedrals and Impropers
        Each with the same coefficients for all: further terms of the scene, which go with the first bond along them that breaks.
    """

    bonds: ReactiveBonds
    beyond: float | None = None
    probability: float = 1.0
    rate: float | None = None
    barrier: float = 0.0
    spends: bool = False
    every: int = 1
    start: int = 0
    takes: Sequence[Any] = ()
    forms, what = False, "bond breaking"

    def __post_init__(self):
        super().__post_init__()
        barrier = checked(self.barrier, "length", "the barrier of a bond breaking")
        if (self.beyond is None) == (self.rate is None) or (barrier and self.rate is None):
            raise ParameterError("a bond breaking needs a length (beyond), or a rate, and then perhaps a barrier")
        beyond = None if self.beyond is None else checked(self.beyond, "length", "the length of a bond breaking")
        for term in self.takes:
            if not isinstance(term, Angles | Torsions) or (term.coefficients != term.coefficients[:1]).any():
                raise ParameterError(
                    f"what a bond breaking `takes` are Angles, Dihedrals or Impropers of equal coefficients, not {what_is(term)}"
                )
        keep(self, beyond=beyond, barrier=barrier, spends=bool(self.spends), takes=tuple(self.takes))

    def faster(self, r: np.ndarray, kT: float) -> Any:
        """The factor by which tension makes bonds of these lengths break faster."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return np.exp(self.bonds.curve(r)[1] * self.barrier / np.float64(kT)) if self.barrier else 1.0


def terms_like(term: Any, beads: np.ndarray) -> Any:
    """Angles, dihedrals or impropers of these beads (K, 3 or 4), all like one."""
    return type(term)(beads, **{name: getattr(term, name)[0] for name in term._DIMENSIONS})


def terms_formed(reactions: Sequence[Any]) -> list[Any]:
    """The angle, the dihedral and the improper that bonds which some reactions make have with others, if any."""
    first = [each for each in reactions if each.forms][:1]
    return [term for each in first for term in (each.angle, each.dihedral, each.improper) if term is not None]


def terms_taken(reactions: Sequence[Any]) -> list[Any]:
    """Angles, dihedrals and impropers that go with bonds that some reactions break."""
    return [term for each in reactions if not each.forms for term in each.takes]


def types_change(reactions: Sequence[Any]) -> bool:
    """Whether beads change their types when some reactions bond them."""
    return any(each.forms and each.becomes is not None for each in reactions)


def types_in_time(scene: Any) -> list[frozenset[str]]:
    """The types that each bead may have during a run: those that reactions turn into each other, or its own alone."""
    alike = {name: frozenset([name]) for name in scene.type_names}
    for each in scene.reactions:
        for before, after in zip(each.types, each.becomes or (None, None), strict=True) if each.forms else ():
            joined = alike[before] | alike[after or before]
            alike |= dict.fromkeys(joined, joined)
    return [alike[name] for name in scene.types]


def bond_sorts(reactions: Sequence[Any]) -> list[ReactiveBonds]:
    """The sorts of bonds that some reactions act on, in the order in which they come first."""
    return list({id(reaction.bonds): reaction.bonds for reaction in reactions}.values())


def with_first_bonds(scene: Any) -> Any:
    """A scene whose ``bonds`` are all that there are at the start, those that may break among them; itself if none do."""
    now, groups = copy(scene), [bonds.between(bonds.pairs) for bonds in bond_sorts(scene.reactions) if len(bonds.pairs)]
    keep(now, bonds=(*scene.bonds, *groups))
    for term in terms_taken(scene.reactions):
        keep(now, **{(what := f"{term._BEADS[2]}s"): (*getattr(now, what), term)})
    return now if scene.reactions else scene


def check_reactions(scene: Any) -> None:
    """Raise ParameterError if the reactions of a scene are not possible, with the reason."""
    if not scene.reactions:
        return
    charges, alike = scene.electrostatics, (None, (1.0, 1.0, 1.0))
    formations = [reaction for reaction in scene.reactions if reaction.forms]
    later = [pair for each in formations for pair in zip(each.types, each.becomes or (None, None), strict=True) if pair[1] is not None]
    named = [name for each in formations for name in (*each.types, *(each.becomes or ())) if name is not None]
    unknown = [name for name in named if name not in [*scene.masses]]
    farthest, half = max((each.within for each in formations), default=0.0), np.inf if scene.box is None else 0.5 * widths(scene.box).min()
    heated = any(reaction.energy is not None if reaction.forms else reaction.barrier for reaction in scene.reactions)
    terms = terms_formed(scene.reactions)
    broken = {id(reaction.bonds) for reaction in scene.reactions if not reaction.forms or reaction.energy is not None}
    reasons = {
        "all bond formations need the same object as their `angle`, or none, and as their `dihedral` and `improper`": any(
            list(map(id, terms_formed([each]))) != list(map(id, terms)) for each in formations
        ),
        "bonds in equilibrium cannot have an `angle`, `dihedral` or `improper`, and pair terms stay: `bonded_factors` must be (1, 1, 1)": (
            any(each.energy is not None for each in formations) and (bool(terms) or scene.bonded_factors not in alike)
        ),
        "beside an `angle`, a `dihedral` or an `improper`, bonds that are there at the start cannot break": (
            bool(terms) and any(len(bonds.pairs) and id(bonds) in broken for bonds in bond_sorts(scene.reactions))
        ),
        "terms that go with bonds (`takes`) name a bead that is not there": any(
            term.beads.max(initial=0) >= scene.n_beads for term in terms_taken(scene.reactions)
        ),
        "bonds that are made again cannot take terms with them": any(
            not each.forms and each.takes and any(each.bonds is other.bonds for other in formations) for each in scene.reactions
        ),
        f"there is no bead type {what_is(unknown[0] if unknown else None)}": bool(unknown),
        f"beads within {in_length(farthest)} are looked for in a box that is less than twice as wide": farthest > half * (1 + 1e-9),
        "bonds in equilibrium, and those that break over a barrier, need a temperature": heated and scene.initial_kT == 0,
        "rigid bodies are not supported beside them": bool(scene.bodies),
        "charges interact whether beads are bonded or not, so the `bonded_factors` of `electrostatics` must be (1, 1, 1)": (
            charges is not None and (charges.bonded_factors or scene.bonded_factors) not in alike
        ),
        "`molecules` of a bond formation have one number for each bead": any(
            each.molecules is not None and len(each.molecules) != scene.n_beads for each in formations
        ),
        "types that beads take need the masses that the beads have": (
            not unknown and any(scene.masses[old] != scene.masses[new] for old, new in later)
        ),
        "beside a fluid behind a wall, or forces on beads of some `types`, beads cannot change their types": (
            types_change(scene.reactions)
            and any(getattr(each, "behind", getattr(each, "types", None)) is not None for each in (*scene.walls, *scene.body_forces))
        ),
        f"`counted` names a bead of {scene.n_beads} that is not there": any(
            (bonds.counted >= scene.n_beads).any() for bonds in bond_sorts(scene.reactions)
        ),
        "beads have energies or temperatures of their own, and nothing says which of them the energy of a bond comes from": (
            scene.internal is not None and not isinstance(scene.internal, Concentrations)
        ),
    }
    wrong = next((reason for reason, holds in reasons.items() if holds), None)
    if wrong is not None:
        raise ParameterError(f"reactions are not possible in this scene: {wrong}")
    sorts = bond_sorts(scene.reactions)
    there = np.concatenate([scene.bond_pairs, *(bonds.pairs for bonds in sorts)])
    check_members(np.sort(there, axis=1), scene.n_beads, "a reactive bond", "the bond between")
    for group in (bonds.between(bonds.pairs) for bonds in sorts):
        group.check_box(scene.box)
        wrong = group.overstretched(scene.positions, scene.box)
        if wrong is not None:
            raise ParameterError(f"{wrong}; move the beads, or start without this bond")
