"""Bonds, angles and dihedrals of a scene in LAMMPS's words."""

from collections.abc import Iterator

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.scene import Scene
from ...plan.kinds import bonded_kind
from ..files.atom_styles import JOINED
from ..styles.bonded_styles import bonded_styles
from ..styles.writing import exact
from .export_beads import Bonded

#: Most types of bonds, angles or dihedrals.
_MOST_TYPES = 100000


def bonded_types(scene: Scene, what: str, units: UnitSystem) -> Bonded:
    """The bonds, angles or dihedrals (``what``) of a scene, with one type for each set of coefficients."""
    types: dict[tuple[str, str], int] = {}
    rows = [np.zeros((0, JOINED[what][0] + 1), dtype=np.int64)]
    for term in getattr(scene, f"{what}s"):
        style = bonded_kind(type(term)).style
        if style is None:
            raise ParameterError(f"{what}s of kind {type(term).__name__} cannot be exported to LAMMPS")
        beads, values = term.beads, np.column_stack(bonded_styles(what)[style].columns.of(term, units))
        different, which = np.unique(values, axis=0, return_inverse=True)
        numbered = [types.setdefault((style, exact(row)), len(types) + 1) for row in different]
        if len(beads):
            rows.append(np.column_stack([np.array(numbered)[which.ravel()], beads]))
    if len(types) > _MOST_TYPES:
        raise ParameterError(f"the {what}s have {len(types)} different sets of coefficients; at most {_MOST_TYPES} types are exported")
    return Bonded(np.concatenate(rows), tuple(types))


def style_lines(what: str, terms: Bonded) -> Iterator[str]:
    """``bond_style``, ``angle_style`` or ``dihedral_style``, and the coefficients."""
    if not len(terms.rows):
        return
    styles = list(dict.fromkeys(style for style, _ in terms.types))
    yield f"{what}_style {'hybrid ' if len(styles) > 1 else ''}{' '.join(styles)}"
    for k, (style, words) in enumerate(terms.types, start=1):
        yield f"{what}_coeff {k} {style + ' ' if len(styles) > 1 else ''}{words}"


def longest_bond(scene: Scene) -> float:
    """Length of the longest bond at the start or at rest, nm; of all that an angle or a dihedral reaches across, together."""
    lengths = [0.0]
    for bonds in scene.bonds:
        if len(bonds.pairs):
            lengths.append(float(bonds.lengths(scene.positions, scene.box).max()))
            lengths.append(float(np.max(bonds.longest())))
    return (3.0 if scene.dihedrals else 2.0 if scene.angles else 1.0) * max(lengths)
