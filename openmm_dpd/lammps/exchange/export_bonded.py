"""Bonds, angles and segmental repulsion of a scene in LAMMPS's words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...errors import ParameterError
from ...model.angles import CosineAngles, HarmonicAngles
from ...model.bonds import FENEBonds, HarmonicBonds, MorseBonds
from ...model.scene import Scene
from ...units import UnitSystem
from .export_beads import Bonded
from .export_pairs import StyleUse
from .export_words import Differences, number, numbers

#: Kind of bond: LAMMPS's style and, in LAMMPS's order, its coefficients with the unit of each.
_BONDS: dict[type, tuple[str, tuple[tuple[str, str], ...]]] = {
    HarmonicBonds: ("harmonic", (("k", "force_constant"), ("r0", "length"))),
    FENEBonds: ("fene", (("k", "force_constant"), ("R0", "length"), ("epsilon", "energy"), ("sigma", "length"))),
    MorseBonds: ("morse", (("D", "energy"), ("alpha", "inverse_length"), ("r0", "length"))),
}

_ANGLES: dict[type, tuple[str, tuple[tuple[str, str], ...]]] = {
    HarmonicAngles: ("harmonic", (("k", "energy"), ("theta0", "degree"))),
    CosineAngles: ("cosine", (("k", "energy"),)),
}

#: Most bond or angle types.
_MOST_TYPES = 100000


def _factor(units: UnitSystem, dimension: str) -> float:
    return {
        "force_constant": units.energy / units.length**2,
        "length": units.length,
        "energy": units.energy,
        "inverse_length": 1.0 / units.length,
        "degree": np.pi / 180.0,
    }[dimension]


def _typed(terms, members: str, kinds: dict, units: UnitSystem, what: str, width: int) -> Bonded:
    """Bonds or angles with one type for each set of coefficients."""
    types: dict[tuple[str, str], int] = {}
    rows = [np.zeros((0, width + 1), dtype=np.int64)]
    for term in terms:
        if type(term) not in kinds:
            raise ParameterError(f"{what}s of kind {type(term).__name__} cannot be exported to LAMMPS")
        style, columns = kinds[type(term)]
        beads = getattr(term, members)
        values = np.column_stack([getattr(term, name) / _factor(units, dimension) for name, dimension in columns])
        different, which = np.unique(values, axis=0, return_inverse=True)
        numbered = [types.setdefault((style, numbers(row)), len(types) + 1) for row in different]
        if len(beads):
            rows.append(np.column_stack([np.array(numbered)[which.ravel()], beads]))
    if len(types) > _MOST_TYPES:
        raise ParameterError(f"the {what}s have {len(types)} different sets of coefficients; at most {_MOST_TYPES} types are exported")
    return Bonded(np.concatenate(rows), tuple(types))


def bond_types(scene: Scene, units: UnitSystem) -> Bonded:
    """All bonds, with a bond type for each set of coefficients."""
    return _typed(scene.bonds, "pairs", _BONDS, units, "bond", 2)


def angle_types(scene: Scene, units: UnitSystem) -> Bonded:
    """All angles, with an angle type for each set of coefficients."""
    return _typed(scene.angles, "triples", _ANGLES, units, "angle", 3)


def style_lines(what: str, terms: Bonded) -> Iterator[str]:
    """``bond_style`` or ``angle_style``, and the coefficients."""
    if not len(terms.rows):
        return
    styles = list(dict.fromkeys(style for style, _ in terms.types))
    yield f"{what}_style {'hybrid ' if len(styles) > 1 else ''}{' '.join(styles)}"
    for k, (style, words) in enumerate(terms.types, start=1):
        yield f"{what}_coeff {k} {style + ' ' if len(styles) > 1 else ''}{words}"


def longest_bond(scene: Scene) -> float:
    """Length of the longest bond at the start or at rest, nm; of both arms together where angles reach across two."""
    lengths = [0.0]
    for bonds in scene.bonds:
        if len(bonds.pairs):
            lengths.append(float(bonds.lengths(scene.positions, scene.box).max()))
            lengths.append(float(np.max(getattr(bonds, "r0", getattr(bonds, "R0", 0.0)))))
    return (2.0 if scene.angles else 1.0) * max(lengths)


def segment_use(scene: Scene, units: UnitSystem, bonds: Bonded, n_types: int, differences: Differences) -> StyleUse | None:
    """Pair style srp, or None.

    Raises
    ------
    ParameterError
        If the segments are no bonds, or some bonds of one type but not all.
    """
    segments = scene.segments
    if segments is None:
        return None
    kind = "*"
    if segments.bonds is not None:
        wanted = {tuple(sorted(pair)) for pair in segments.bonds.tolist()}
        types = {tuple(sorted(row[1:])): row[0] for row in bonds.rows.tolist()}
        lacking = sorted(wanted - set(types))
        if lacking:
            raise ParameterError(f"the segment between beads {lacking[0]} is no bond; LAMMPS's srp acts between bonds, so it must be one")
        used = {types[pair] for pair in wanted}
        members = {pair for pair, number_ in types.items() if number_ in used}
        if wanted != set(types) and (len(used) > 1 or members != wanted):
            raise ParameterError(
                "the segmental repulsion acts on some bonds; LAMMPS's srp takes all bonds or all of one type, so these, and no others, "
                "must have the same coefficients"
            )
        kind = "*" if wanted == set(types) else str(used.pop())
    if segments.distance == "min" and scene.compat != "lammps":
        differences.add("LAMMPS's srp limits the two nearest points one by one, which is not always the least distance (compat='lammps')")
    exclude = "yes" if segments.exclude_adjoining else "no"
    reach = number(segments.cutoff / units.length)
    settings = f"{reach} {kind} {segments.distance} exclude {exclude} bptype {n_types + 1}"
    words = f"{number(segments.A / units.force)} {reach}"
    return StyleUse("srp", settings, {("*", "*"): words}, segments.cutoff)
