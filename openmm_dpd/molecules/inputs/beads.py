"""The one way from beads of any source to a Scene."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ...base.errors import ParameterError, what_is
from ...base.units import to_md
from ...model.scene import Scene
from .arrays import BeadArrays
from .bonded import scene_terms


def scene_from_beads(
    beads: BeadArrays,
    *,
    pairs,
    kT,
    masses=None,
    bonds=None,
    angles=None,
    dihedrals=None,
    positions=None,
    box=None,
    periodic: bool = True,
    velocities=None,
    charges=None,
    leave_out: Sequence[str] = (),
    **options,
) -> Scene:
    """A Scene of beads that were read from somewhere: what all functions of this module end in.

    Parameters
    ----------
    beads : BeadArrays
        The beads.
    pairs, kT
        As for :class:`openmm_dpd.Scene`; no file has them.
    masses : mass, or mapping of types to masses, optional
        One mass for all types, or the mass of each type; by default those of the source.
    bonds : spring or mapping, optional
        What the bonds of the source are: one spring for all (:class:`~openmm_dpd.molecules.Spring`,
        :class:`~openmm_dpd.molecules.FENESpring`, :class:`~openmm_dpd.molecules.MorseSpring`), springs by the types of two beads,
        ``{("*", "*"): Spring(...), ("A", "B"): Spring(...)}`` with later entries before earlier ones, or, where the source names types of
        bonds (GSD and data files), springs by these names, ``{"A-B": Spring(...)}``.  A sequence of :class:`openmm_dpd.HarmonicBonds` and
        its neighbours takes the place of the bonds of the source.
    angles : bend or mapping, optional
        What the angles are, likewise with three types or with names.  Where the source lists angles, each of these needs a bend; where it
        lists none, bends act between bonds as in :func:`openmm_dpd.molecules.join`.
    dihedrals : twist or mapping, optional
        What the dihedrals are, as for angles, with four types or with names.
    positions, velocities, charges : arrays, optional
        In the place of those of the source, with units or in nm, nm/ps and e.
    box : (3,) or (3, 3) array of lengths, optional
        In the place of that of the source.
    periodic : bool, default True
        False: no periodic box, even if the source has one.
    leave_out : sequence of str, optional
        What is not to be taken over: ``"bonds"``, ``"angles"``, ``"dihedrals"``, and what a Scene cannot hold, by the name that the
        error has for it.
    **options
        Further arguments of :class:`openmm_dpd.Scene`: ``bonded_factors``, ``electrostatics``, ``mobile``, ``molecules``, ...

    Raises
    ------
    ParameterError
        If something is missing (a mass, the spring of two types, a box, positions), the source has what a Scene cannot hold, a table names
        types that there are not, or the Scene refuses a value.
    """
    if not len(beads.types):
        raise ParameterError(f"{beads.source} has no beads")
    left_out = _left_out(beads, leave_out)
    for name, given in (("bonds", bonds), ("angles", angles), ("dihedrals", dihedrals)):
        if name in left_out and given is not None:
            raise ParameterError(f"{name} are given, and leave_out names them; one of these is too much")
    types = list(dict.fromkeys(beads.types))
    by_type, single = _masses(beads, types, masses)
    springs: Sequence = () if "bonds" in left_out else scene_terms(beads, bonds, "bond")
    bends: Sequence = () if "angles" in left_out else scene_terms(beads, angles, "angle", springs)
    twists: Sequence = () if "dihedrals" in left_out else scene_terms(beads, dihedrals, "dihedral", springs)
    return Scene(
        masses=by_type,
        types=beads.types,
        positions=_given(positions, beads.positions, "positions", beads.source),
        pairs=pairs,
        kT=kT,
        box=_box(beads, box, periodic),
        velocities=beads.velocities if velocities is None else velocities,
        bead_masses=single,
        charges=beads.charges if charges is None else charges,
        bonds=springs,
        angles=bends,
        dihedrals=twists,
        **{"molecules": beads.molecules, "residues": beads.residues, **options},
    )


def _left_out(beads: BeadArrays, leave_out: Sequence[str]) -> set[str]:
    if isinstance(leave_out, str) or not isinstance(leave_out, Iterable):
        raise ParameterError(f"leave_out must be a sequence of names, such as ('angles',), not {what_is(leave_out)}")
    left = set(leave_out)
    unknown = sorted(map(str, left - {"bonds", "angles", "dihedrals", *beads.beyond}))
    if unknown:
        there = ", ".join(["bonds", "angles", "dihedrals", *beads.beyond])
        raise ParameterError(f"leave_out names {', '.join(unknown)}; what can be left out of {beads.source} is {there}")
    for name, count in beads.beyond.items():
        if name not in left:
            raise ParameterError(
                f"{beads.source} has {count} {name}, which a Scene cannot hold; leave_out=({name!r},) goes on without them"
            )
    return left


def _given(value, found, name: str, source: str):
    if value is None and found is None:
        raise ParameterError(f"{source} has no {name}; give {name}=...")
    return found if value is None else value


def _box(beads: BeadArrays, box, periodic: bool):
    if not periodic:
        if box is not None:
            raise ParameterError("a box is given and periodic=False; give one of them")
        return None
    if box is None and beads.box is None:
        raise ParameterError(f"{beads.source} has no periodic box; give box=[...], or periodic=False for none")
    return beads.box if box is None else box


def _masses(beads: BeadArrays, types: list[str], masses) -> tuple[dict[str, Any], Any]:
    """Masses by type, and of the single beads where those of one type differ."""
    order = list(dict.fromkeys([*(beads.type_names or ()), *types]))
    if masses is None and isinstance(beads.masses, Mapping):
        masses = beads.masses
    if isinstance(masses, Mapping):
        missing = [name for name in types if name not in masses]
        if missing:
            raise ParameterError(f"masses has no mass of the bead type {what_is(missing[0])}; it has {', '.join(map(str, masses))}")
        return {name: masses[name] for name in [*(n for n in order if n in masses), *(n for n in masses if n not in order)]}, None
    if masses is not None:
        return dict.fromkeys(order, masses), None
    if beads.masses is None:
        raise ParameterError(f"{beads.source} has no masses; give masses=... (Da), one for all types or {{type: mass}}")
    single = np.asarray(to_md(beads.masses, "mass", f"the masses of {beads.source}"))
    if single.shape != (len(beads.types),):
        raise ParameterError(f"{beads.source} has {len(beads.types)} types of beads, but masses of shape {single.shape}")
    bad = np.flatnonzero(~(single > 0))
    if len(bad):
        raise ParameterError(
            f"{beads.source} has the mass {single[bad[0]]:g} for bead {bad[0]} of type {beads.types[bad[0]]!r}; give masses={{type: mass}}"
        )
    first = {name: k for k, name in reversed(list(enumerate(beads.types)))}
    by_type = {name: float(single[first[name]]) for name in order if name in first}
    same = np.array_equal(single, [by_type[name] for name in beads.types])
    return by_type, None if same else single
