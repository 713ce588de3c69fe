"""Values of single bonds, angles and dihedrals: ``compute property/local``, ``bond/local``, ``angle/local`` and ``dihedral/local``."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import minimum_images
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Compute
from ..styles.words import bonded_styles
from .compute_spec import ComputeSpec

#: Terms by the first letter of the words of property/local: their names, numbers of beads, and with which bead LAMMPS stores them.
_TERMS = {"b": ("bond", 2, 0), "a": ("angle", 3, 1), "d": ("dihedral", 4, 1)}
_PROPERTIES = [f"{of}{word}" for of, (_, n, _) in _TERMS.items() for word in (*(f"atom{k}" for k in range(1, n + 1)), "type")]
#: Words of the other styles.
_WORDS = {
    "bond": ("dist", "dx", "dy", "dz", "engpot", "force", "fx", "fy", "fz"),
    **{"angle": ("theta", "eng"), "dihedral": ("phi",)},
}


def _terms(moment: DeckMoment, compute: Compute, of: str) -> tuple[np.ndarray, np.ndarray]:
    """Types (K,) and beads (K, n) of the terms whose beads are all in the group, in the order of the beads that they are stored with."""
    state, (what, _, owner) = moment.state, _TERMS[of]
    kept = getattr(state, f"{what}s")
    beads = state.atoms.index_of(kept[:, 1:].ravel()).reshape(len(kept), -1)
    order = np.argsort(beads[:, owner], kind="stable")
    order = order[state.group(compute.group)[beads].all(axis=1)[order]]
    return kept[order, 0], beads[order]


def _check(what: str, allowed: Sequence[str], state: DeckState, group: str, words: list[str]) -> None:
    read.count(words, f"compute ID group {what} value value ...", 1, None)
    for word in words:
        read.choice(word, f"a value of compute {what}", allowed)
    if what == "property/local" and len({word[0] for word in words}) > 1:
        raise ParameterError(f"compute property/local: {' '.join(words)} are of different kinds; use a compute for each")


def _properties(moment: DeckMoment, compute: Compute) -> np.ndarray:
    kinds, beads = _terms(moment, compute, compute.arguments[0][0])
    ids = moment.state.atoms.ids[beads]
    return np.stack([kinds if word.endswith("type") else ids[:, int(word[-1]) - 1] for word in compute.arguments], axis=1).astype(float)


def _curves(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Values of bonds, angles or dihedrals, from the curves of their potentials."""
    what, units = compute.style.split("/")[0], moment.units
    kinds, beads = _terms(moment, compute, what[0])
    x, box = moment.folded[0] * units.length, moment.box.vectors * units.length
    d = minimum_images(x[beads[:, 0]] - x[beads[:, 1]], box)
    at, energy, slope = np.linalg.norm(d, axis=1), *np.zeros((2, len(kinds)))
    if what == "angle":
        other = minimum_images(x[beads[:, 2]] - x[beads[:, 1]], box)
        at = np.arctan2(np.linalg.norm(np.cross(d, other), axis=1), np.sum(d * other, axis=1))
    for kind in np.unique(kinds):
        style, values = getattr(moment.state, what).coefficients[kind]
        here, its = kinds == kind, bonded_styles(what).get(style)
        if its is not None and its.kind is not None:
            terms = its.build(beads[here], values)
            at[here] = terms.gradients(x, box)[0] if what == "dihedral" else at[here]
            energy[here], slope[here], _ = terms.curve(at[here])
        elif what == "dihedral":
            raise ParameterError(f"compute {compute.name} (style dihedral/local): dihedral_style {style} has no angles here")
    pull = np.divide(-slope, at, out=np.zeros_like(at), where=at > 0)[:, None] * d / units.force
    found = {"dist": at / units.length, "engpot": energy / units.energy, "force": -slope / units.force, "eng": energy / units.energy}
    found |= {"theta": np.degrees(at), "phi": np.degrees(at)}
    for k, axis in enumerate("xyz"):
        found |= {f"d{axis}": d[:, k] / units.length, f"f{axis}": pull[:, k]}
    return np.stack([found[word] for word in compute.arguments], axis=1)


def _columns(compute: Compute) -> int:
    return len(compute.arguments) if len(compute.arguments) > 1 else 0


#: Computes with values of bonds, angles or dihedrals.
LOCAL: dict[str, ComputeSpec] = {
    "property/local": ComputeSpec(partial(_check, "property/local", _PROPERTIES), local=_properties, columns=_columns),
    **{
        f"{what}/local": ComputeSpec(partial(_check, f"{what}/local", words), local=_curves, columns=_columns)
        for what, words in _WORDS.items()
    },
}
