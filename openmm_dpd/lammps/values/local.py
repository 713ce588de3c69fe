"""Values of single pairs, bonds, angles, dihedrals and impropers: ``compute property/local``, ``pair/local``, ``bond/local``,
``angle/local``, ``dihedral/local`` and ``improper/local``."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import minimum_images
from ...model.impropers import HarmonicImpropers
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Compute
from ..styles.words import bonded_styles
from .bodies import OF_BODIES
from .compute_spec import ComputeSpec

#: Terms by the first letter of the words of property/local: their names, numbers of beads, and with which bead LAMMPS stores them.
_TERMS = {"b": ("bond", 2, 0), "a": ("angle", 3, 1), "d": ("dihedral", 4, 1), "i": ("improper", 4, 1)}
_PROPERTIES = ["patom1", "patom2", "ptype1", "ptype2"]
_PROPERTIES += [f"{of}{word}" for of, (_, n, _) in _TERMS.items() for word in (*(f"atom{k}" for k in range(1, n + 1)), "type")]
#: Words of the other styles.
_WORDS = {
    "bond": ("dist", "dx", "dy", "dz", "engpot", "force", "fx", "fy", "fz"),
    **{"angle": ("theta", "eng"), "dihedral": ("phi",), "improper": ("chi",)},
    "pair": ("dist", "dx", "dy", "dz", "eng", "force", "fx", "fy", "fz"),
}


def _terms(moment: DeckMoment, compute: Compute, of: str) -> tuple[np.ndarray, np.ndarray]:
    """Types (K,) and beads (K, n) of the terms whose beads are all in the group, in the order of the beads that they are stored with; of
    pairs energies and forces (K, 4) in the place of types."""
    if of == "p":
        beads, values = pairs_of(moment, compute)
        inside = moment.state.group(compute.group)[beads].all(axis=1)
        return values[inside], beads[inside]
    state, (what, _, owner) = moment.state, _TERMS[of]
    kept = getattr(state, f"{what}s")
    beads = state.atoms.index_of(kept[:, 1:].ravel()).reshape(len(kept), kept.shape[1] - 1)
    order = np.argsort(beads[:, owner], kind="stable")
    order = order[state.group(compute.group)[beads].all(axis=1)[order]]
    return kept[order, 0], beads[order]


def pairs_of(moment: DeckMoment, compute: Compute) -> tuple[np.ndarray, np.ndarray]:
    """Beads (P, 2), in the order of the deck, of all pairs within their cutoffs, and their energies and forces on the first bead (P, 4)."""
    terms = moment.need("pair_terms")
    if any(beads.shape[1] > 2 for beads, _ in terms):
        raise ParameterError(f"compute {compute.name} (style {compute.style}): contacts of bonds (srp) belong to no two beads")
    beads = np.concatenate([beads for beads, _ in terms] or [np.zeros((0, 2), dtype=np.int64)])
    values = np.concatenate([values[:, [0, 7, 8, 9]] for _, values in terms] or [np.zeros((0, 4))])
    turned = beads[:, 0] > beads[:, 1]
    values[turned, 1:] *= -1
    found, place = np.unique(np.sort(beads, axis=1), axis=0, return_inverse=True)
    return found, np.stack([np.bincount(place.ravel(), column, len(found)) for column in values.T], axis=1)


def _check(what: str, allowed: Sequence[str], state: DeckState, group: str, words: list[str]) -> tuple[str, ...]:
    read.count(words, f"compute ID group {what} value value ...", 1, None)
    if words[-2:-1] == ["cutoff"] and (what == "pair/local" or words[0] in _PROPERTIES[:4]):
        read.choice(words[-1], "cutoff", ("type",))
        words = words[:-2]
    for word in words:
        read.choice(word, f"a value of compute {what}", allowed)
    if what == "property/local" and len({word[0] for word in words}) > 1:
        raise ParameterError(f"compute property/local: {' '.join(words)} are of different kinds; use a compute for each")
    return tuple(words)


def _properties(moment: DeckMoment, compute: Compute) -> np.ndarray:
    kinds, beads = _terms(moment, compute, compute.settings[0][0])
    atoms = moment.state.atoms
    of_beads = ((atoms.types if "type" in word else atoms.ids)[beads[:, int(word[-1]) - 1]] for word in compute.settings if word[-1] != "e")
    return np.stack([kinds if word[-1] == "e" else next(of_beads) for word in compute.settings], axis=1).astype(float)


def _curves(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Values of pairs, or of bonds, angles, dihedrals or impropers from the curves of their potentials."""
    what, units = compute.style.split("/")[0], moment.units
    kinds, beads = _terms(moment, compute, what[0])
    x, box = moment.folded[0] * units.length, moment.box.reduced_vectors * units.length
    d = minimum_images(x[beads[:, 0]] - x[beads[:, 1]], box)
    at, energy, slope = np.linalg.norm(d, axis=1), *np.zeros((2, len(kinds)))
    if what == "angle":
        other = minimum_images(x[beads[:, 2]] - x[beads[:, 1]], box)
        at = np.arctan2(np.linalg.norm(np.cross(d, other), axis=1), np.sum(d * other, axis=1))
    if what == "improper":  # LAMMPS has this angle for every style
        at = np.abs(HarmonicImpropers(beads, *np.zeros((2, len(beads)))).gradients(x, box)[0])
    for kind in np.unique(kinds) if what not in ("pair", "improper") else ():
        style, values = getattr(moment.state, what).coefficients[kind]
        here, its = kinds == kind, bonded_styles(what).get(style)
        if its is not None and its.kind is not None:
            terms = its.build(beads[here], values)
            at[here] = terms.gradients(x, box)[0] if what == "dihedral" else at[here]
            energy[here], slope[here], _ = terms.curve(at[here])
        elif what == "dihedral":
            raise ParameterError(f"compute {compute.name} (style dihedral/local): dihedral_style {style} has no angles here")
    if what == "pair":
        energy, slope = kinds[:, 0], -np.divide(np.sum(kinds[:, 1:] * d, axis=1), at, out=np.zeros_like(at), where=at > 0)
    pull = np.divide(-slope, at, out=np.zeros_like(at), where=at > 0)[:, None] * d / units.force
    found = {"dist": at / units.length, "engpot": energy / units.energy, "force": -slope / units.force, "eng": energy / units.energy}
    found |= {"theta": np.degrees(at), "phi": np.degrees(at), "chi": np.degrees(at)}
    for k, axis in enumerate("xyz"):
        found |= {f"d{axis}": d[:, k] / units.length, f"f{axis}": pull[:, k]}
    return np.stack([found[word] for word in compute.settings], axis=1)


def _columns(compute: Compute) -> int:
    return len(compute.settings) if len(compute.settings) > 1 else 0


#: Computes with values of pairs, bonds, angles, dihedrals, impropers or bodies.
LOCAL: dict[str, ComputeSpec] = {
    **OF_BODIES,
    "property/local": ComputeSpec(partial(_check, "property/local", _PROPERTIES), local=_properties, columns=_columns),
    **{
        f"{what}/local": ComputeSpec(partial(_check, f"{what}/local", words), local=_curves, columns=_columns)
        for what, words in _WORDS.items()
    },
}
