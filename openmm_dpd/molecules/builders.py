"""Molecules of common shapes: chains, rings, stars, combs, block copolymers, surfactants, lipids."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.units import whole_number
from .molecule import Bends, Molecule, Springs, Twists, Types, bead_types, join


def bead(type: str, *, charge=None, name: str = "") -> Molecule:
    """A single bead: a solvent, an ion."""
    return Molecule((type,), name=name, charges=None if charge is None else (charge,))


def linear(types: Types, spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None) -> Molecule:
    """A chain.

    Parameters
    ----------
    types : sequence of str, or text
        Types along the chain: ``["A"] * 6 + ["B"] * 4`` or ``"A6B4"`` (:func:`openmm_dpd.molecules.sequence`).
    spring, bend, twist : spring, bend and twist, or mappings from types to them
        As for :func:`openmm_dpd.molecules.join`.
    name : str, optional
        Name in topology files.
    charges : sequence, optional
        Elementary charges of the beads.
    """
    names = bead_types(types)
    return join(names, [(k, k + 1) for k in range(len(names) - 1)], spring, bend, twist=twist, name=name, charges=charges)


def block_copolymer(blocks: Types, spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None) -> Molecule:
    """A chain of blocks, ``"A6B4"`` or ``"A3B6A3"``; at least two types must appear.  Parameters as for :func:`linear`."""
    names = bead_types(blocks)
    if len(set(names)) < 2:
        raise ParameterError(f"a block copolymer has blocks of at least two types; {what_is(blocks)} has one (use `linear`)")
    return linear(names, spring, bend, twist=twist, name=name, charges=charges)


def surfactant(
    head: Types, tail: Types, spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None
) -> Molecule:
    """A chain with the head first, so that :class:`openmm_dpd.molecules.Bilayer` knows which end points outwards.

    Parameters
    ----------
    head, tail : sequence of str, or text
        Types, such as ``"H2"`` and ``"T4"``.
    spring, bend, twist, name, charges
        As for :func:`linear`.
    """
    return linear(bead_types(head) + bead_types(tail), spring, bend, twist=twist, name=name, charges=charges)


def ring(types: Types, spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None) -> Molecule:
    """A closed chain of at least three beads; parameters as for :func:`linear`."""
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
        Index of a bead of the backbone to the types of its side chain, from the backbone outwards; a list of texts for several side
        chains at one bead: ``{1: "T4", 2: ["T4", "T2"]}``.
    spring, bend, twist : spring, bend and twist, or mappings from types to them
        As for :func:`openmm_dpd.molecules.join`.  A single bend or twist leaves branching points free.
    name, charges : optional
        Beads of the backbone come first, then the side chains in the order of ``branches``.
    """
    names = list(bead_types(backbone))
    pairs = [(k, k + 1) for k in range(len(names) - 1)]
    stem = len(names)
    if not isinstance(branches, Mapping):
        raise ParameterError(f"branches must map a bead of the backbone to its side chains, as {{1: 'T4'}}, not {what_is(branches)}")
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
    """Chains that start from one bead.

    Parameters
    ----------
    core : str
        Type of the bead in the middle.
    arms : list of texts or of sequences of str
        Types of each arm from the core outwards: ``["A8"] * 5``.
    spring, bend, twist, name, charges
        As for :func:`branched`.
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
    """A chain of head beads with tails.

    Parameters
    ----------
    head : sequence of str, or text
        Types of the head beads, from the outer end.
    tails : list of texts or of sequences of str
        Types of each tail, ``["T4", "T4"]``.
    spring, bend, twist : spring, bend and twist, or mappings from types to them
        As for :func:`openmm_dpd.molecules.join`, usually ``bend={("H", "T", "T"): ..., ("T", "T", "T"): ...}``.
    tails_at : sequence of int, optional
        Head bead of each tail; by default one tail at each of the last head beads.
    name, charges : optional
        As for :class:`Molecule`; head beads come first.
    """
    heads = bead_types(head)
    if isinstance(tails, str) or not isinstance(tails, Sequence) or not tails:
        raise ParameterError(f"tails of a lipid are a list with one entry for each tail, such as ['T4', 'T4'], not {what_is(tails)}")
    if tails_at is None:
        tails_at = [max(0, len(heads) - len(tails) + k) for k in range(len(tails))]
    if not isinstance(tails_at, (Sequence, np.ndarray)) or len(tails_at) != len(tails):
        raise ParameterError(f"{len(tails)} tails need as many entries of tails_at, such as {[0] * len(tails)}, not {what_is(tails_at)}")
    branches: dict[int, list] = {}
    for at, tail in zip(tails_at, tails, strict=True):
        branches.setdefault(at, []).append(tail)
    return branched(heads, branches, spring, bend, twist=twist, name=name, charges=charges)


def _chains(given) -> list[tuple[str, ...]]:
    """Side chains at one bead: text is one chain, a list holds one chain in each entry."""
    return [bead_types(chain) for chain in (given if isinstance(given, list) else [given])]
