"""Molecules of common architectures: chains, rings, stars, combs, block copolymers, surfactants, lipids; and published models, as data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, require, what_is
from ..base.units import whole_number
from ..model.pairs import DPD, checked
from .molecule import Bends, Molecule, Springs, Twists, Types, bead_types, join
from .terms import CosineBend, Spring


def bead(type: str, *, charge=None, name: str = "") -> Molecule:
    """A single bead, such as a solvent bead or an ion, with a charge in elementary charges."""
    return Molecule((type,), name=name, charges=None if charge is None else (charge,))


def linear(types: Types, spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None) -> Molecule:
    """A linear chain.

    Parameters
    ----------
    types : sequence of str, or text
        Types along the chain: ``["A"] * 6 + ["B"] * 4`` or ``"A6B4"`` (:func:`openmm_dpd.molecules.sequence`).
    spring, bend, twist : spring, bend and twist, or mappings from types to them
        Bonds, angles and dihedrals of the chain, see :func:`openmm_dpd.molecules.join`.
    name : str, optional
        Name in topology files.
    charges : sequence, optional
        Charges of the beads in elementary charges.
    """
    names = bead_types(types)
    return join(names, [(k, k + 1) for k in range(len(names) - 1)], spring, bend, twist=twist, name=name, charges=charges)


def block_copolymer(blocks: Types, spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None) -> Molecule:
    """A linear chain of blocks of at least two types, such as ``"A6B4"`` or ``"A3B6A3"``; :func:`linear` explains the parameters."""
    names = bead_types(blocks)
    if len(set(names)) < 2:
        raise ParameterError(f"a block copolymer has blocks of at least two types; {what_is(blocks)} has one (use `linear`)")
    return linear(names, spring, bend, twist=twist, name=name, charges=charges)


def surfactant(
    head: Types, tail: Types, spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None
) -> Molecule:
    """A linear chain with the head first, so that the head points outwards in a :class:`openmm_dpd.molecules.Bilayer`.

    Parameters
    ----------
    head, tail : sequence of str, or text
        Types of the beads, such as ``"H2"`` and ``"T4"``.
    spring, bend, twist, name, charges
        Bonded terms, name and charges of the whole chain, see :func:`linear`.
    """
    return linear(bead_types(head) + bead_types(tail), spring, bend, twist=twist, name=name, charges=charges)


def ring(types: Types, spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None) -> Molecule:
    """A closed chain of at least three beads; :func:`linear` explains the parameters."""
    names = bead_types(types)
    if len(names) < 3:
        raise ParameterError(f"a ring needs at least 3 beads, not {len(names)}")
    return join(names, [(k, (k + 1) % len(names)) for k in range(len(names))], spring, bend, twist=twist, name=name, charges=charges)


def branched(
    backbone: Types,
    branches: Mapping[int, Types | list],
    spring: Springs,
    bend: Bends = None,
    *,
    twist: Twists = None,
    name: str = "",
    charges=None,
) -> Molecule:
    """A chain with side chains.

    Parameters
    ----------
    backbone : sequence of str, or text
        Types along the backbone.
    branches : mapping
        From the index of a backbone bead to the types of its side chain, from the backbone outwards; a list for several side chains at one
        bead: ``{1: "T4", 2: ["T4", "T2"]}``.
    spring, bend, twist : spring, bend and twist, or mappings from types to them
        Bonded terms, see :func:`openmm_dpd.molecules.join`.  A single bend or twist does not act at branching points.
    name, charges : optional
        Name, and charges of the backbone's beads, followed by those of the side chains in the order of ``branches``.
    """
    names = list(bead_types(backbone))
    pairs = [(k, k + 1) for k in range(len(names) - 1)]
    stem = len(names)
    require(branches, Mapping, "branches must map a bead of the backbone to its side chains, such as {1: 'T4'}")
    for place, given in branches.items():
        at = whole_number(place, "the place of a branch")
        if not 0 <= at < stem:
            raise ParameterError(f"a branch is at bead {at}, but the backbone has beads 0 to {stem - 1}")
        for chain in _chains(given):
            pairs.append((at, len(names)))
            pairs += [(len(names) + k, len(names) + k + 1) for k in range(len(chain) - 1)]
            names += chain
    return join(names, pairs, spring, bend, twist=twist, name=name, charges=charges)


def star(
    core: str, arms: Sequence[Types], spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None
) -> Molecule:
    """A star polymer: chains that start from one bead.

    Parameters
    ----------
    core : str
        Type of the central bead.
    arms : list of texts or of sequences of str
        Types of each arm from the core outwards: ``["A8"] * 5``.
    spring, bend, twist, name, charges
        Bonded terms, name and charges (the core's first), see :func:`branched`.
    """
    if isinstance(arms, str) or not isinstance(arms, Sequence) or len(arms) < 3:
        raise ParameterError(f"a star needs a list of at least 3 arms, such as ['A8'] * 3, not {what_is(arms)}")
    return branched([core], {0: list(arms)}, spring, bend, twist=twist, name=name, charges=charges)


def lipid(
    head: Types,
    tails: Sequence[Types],
    spring: Springs,
    bend: Bends = None,
    *,
    tails_at: Sequence[int] | None = None,
    twist: Twists = None,
    name: str = "",
    charges=None,
) -> Molecule:
    """A lipid: a chain of head beads with tails.

    Parameters
    ----------
    head : sequence of str, or text
        Types of the head beads, from the outer end.
    tails : list of texts or of sequences of str
        Types of each tail, such as ``["T4", "T4"]``.
    spring, bend, twist : spring, bend and twist, or mappings from types to them
        Bonded terms, see :func:`openmm_dpd.molecules.join`; usually ``bend={("H", "T", "T"): ..., ("T", "T", "T"): ...}``.
    tails_at : sequence of int, optional
        Head bead of each tail; by default one tail at each of the last head beads.
    name, charges : optional
        Name, and charges of the head beads, followed by those of the tails.
    """
    heads = bead_types(head)
    if isinstance(tails, str) or not isinstance(tails, Sequence) or not tails:
        raise ParameterError(f"tails must be a list with one entry for each tail, such as ['T4', 'T4'], not {what_is(tails)}")
    if tails_at is None:
        tails_at = [max(0, len(heads) - len(tails) + k) for k in range(len(tails))]
    if not isinstance(tails_at, (Sequence, np.ndarray)) or len(tails_at) != len(tails):
        raise ParameterError(f"{len(tails)} tails need as many entries in tails_at, such as {[0] * len(tails)}, not {what_is(tails_at)}")
    branches: dict[int, list] = {}
    for at, tail in zip(tails_at, tails, strict=True):
        branches.setdefault(at, []).append(tail)
    return branched(heads, branches, spring, bend, twist=twist, name=name, charges=charges)


def _chains(given) -> list[tuple[str, ...]]:
    """Types of each side chain at one bead: text is a single chain, a list has one chain per entry."""
    return [bead_types(chain) for chain in (given if isinstance(given, list) else [given])]


@dataclass(frozen=True)
class Model:
    """A published model: a molecule and the repulsion between all types, in reduced units (r_c = 1 nm, kT = 1 kJ/mol, m = 1 Da).

    Attributes
    ----------
    molecule : Molecule
    repulsion : mapping of (str, str) to float
        a_ij for every pair of types, including the solvent.
    gamma : float
        Friction coefficient.
    density : float
        Beads per r_c^3.
    source : str
        Publication.
    """

    molecule: Molecule
    repulsion: Mapping[tuple[str, str], float]
    gamma: float
    density: float
    source: str

    def pairs(self, gamma: float | None = None) -> dict[tuple[str, str], DPD]:
        """Pair coefficients for ``Scene(pairs=...)``, with the published friction or the given one."""
        friction = self.gamma if gamma is None else gamma
        return {pair: DPD(A=a, gamma=friction, cutoff=1.0) for pair, a in self.repulsion.items()}


def grafmueller_2009(tail: int = 4) -> Model:
    """H3(T_n)2 lipid with two stiff tails in water W; four beads per tail represent a lipid like DMPC.

    Repulsion a_ij (kT/r_c) H-H 30, T-T 10, W-W 25, H-T 35, H-W 30, T-W 75; friction 4.5; density 3.  Bonds (1/2) k2 (r - l0)^2 with
    k2 = 128 and l0 = 0.5, that is ``Spring(k=64, r0=0.5)`` here.  Bends k3 (1 - cos phi), k3 = 15, phi = 0 for a straight tail, at every
    H-T-T and T-T-T, that is ``CosineBend(15)``.  The second and third of the three head beads carry a tail each.

    Grafmueller, Shillcock and Lipowsky, Biophys. J. 96, 2658 (2009), with the parameters of the bilayer that is distributed with
    Osprey-DPD, the program of one of the authors.
    """
    whole_number(tail, "the number of beads in a tail", least=1)
    bend = CosineBend(15.0)
    molecule = lipid("H3", [["T"] * tail] * 2, Spring(64.0, 0.5), {("H", "T", "T"): bend, ("T", "T", "T"): bend})
    repulsion = {("H", "H"): 30.0, ("T", "T"): 10.0, ("W", "W"): 25.0, ("H", "T"): 35.0, ("H", "W"): 30.0, ("T", "W"): 75.0}
    return Model(molecule, repulsion, 4.5, 3.0, "Grafmueller, Shillcock and Lipowsky, Biophys. J. 96, 2658 (2009)")


def like_repulsion(density: float = 3.0) -> float:
    """Repulsion of like beads, a_ii = 75 kT/(rho r_c^4), in reduced units; Groot and Warren, J. Chem. Phys. 107, 4423 (1997)."""
    return 75.0 / checked(density, "dimensionless", "density", positive=True)


def unlike_repulsion(chi: float, density: float = 3.0) -> float:
    """Repulsion of unlike beads for a Flory-Huggins parameter per bead: a_ii + chi/0.286 at density 3, a_ii + chi/0.689 at density 5.

    Groot and Warren, J. Chem. Phys. 107, 4423 (1997), for single beads; for chains see :func:`openmm_dpd.parameters.repulsion_from_chi`.
    """
    slopes = {3.0: 0.286, 5.0: 0.689}
    if density not in (3, 5):
        raise ParameterError(f"the relation of a to chi is known for the densities 3 and 5, not {what_is(density)}")
    return like_repulsion(density) + checked(chi, "dimensionless", "chi", signed=True) / slopes[float(density)]
