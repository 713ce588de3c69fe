"""Conformations of molecules: random ones with all bonds at their lengths, and upright ones for layers."""

from typing import Any

import numpy as np

from ..base.errors import ParameterError
from .molecule import Molecule

#: Clear distance between the middle of a bilayer and the innermost beads of its leaflets, in units of the distance between beads.
GAP = 0.5


def random_shapes(molecule: Molecule, count: int, rng: np.random.Generator, *, spacing: float, kT: float) -> np.ndarray:
    """Random walks along the bonds, centred: (count, n, 3) in nm.  Every bond has the length that its spring gives it
    (:meth:`Spring.length`).  Directions are isotropic; where a bend acts, angles are drawn with its Boltzmann weight at kT; dihedrals are
    drawn evenly, whether a twist acts or not.  Molecules with rings are closed by moving beads until every bond has its length within 2 per
    cent; their bends are left to the minimiser."""
    lengths, bends = _lengths(molecule, spacing), _bends(molecule)
    if len(molecule.bonds) >= molecule.n_beads:
        return _closed_shapes(molecule, count, rng, lengths)
    x = np.zeros((count, molecule.n_beads, 3))
    before: dict[int, int] = {}
    for bead, parent in molecule.tree()[1:]:
        assert parent is not None
        before[bead] = parent
        direction = _directions(count, rng)
        bend = bends.get((before.get(parent), parent, bead))
        if bend is not None:
            back = x[:, before[parent]] - x[:, parent]
            back /= np.linalg.norm(back, axis=1)[:, None]
            across = direction - np.sum(direction * back, axis=1)[:, None] * back
            across /= np.linalg.norm(across, axis=1)[:, None]
            theta = bend.angles(count, rng, kT)[:, None]
            direction = np.cos(theta) * back + np.sin(theta) * across
        x[:, bead] = x[:, parent] + lengths[frozenset((bead, parent))] * direction
    return x - x.mean(axis=1, keepdims=True)


def upright_shape(molecule: Molecule, spacing: float) -> np.ndarray:
    """The molecule upright on its tails, bead 0 on top, the lowest bead at height 0: (n, 3) in nm; all bonds at their lengths."""
    if len(molecule.bonds) >= molecule.n_beads:
        raise ParameterError(f"{molecule.name} has a ring; only molecules without one can be in a layer")
    lengths, tree = _lengths(molecule, spacing), molecule.tree()
    children: dict[int | None, list[int]] = {}
    for bead, parent in tree:
        children.setdefault(parent, []).append(bead)
    x = np.zeros((molecule.n_beads, 3))
    for bead, parent in tree[1:]:
        siblings = children[parent]
        # chains that part spread by 40 degrees to either side
        tilt = np.linspace(-0.7, 0.7, len(siblings))[siblings.index(bead)] if len(siblings) > 1 else 0.0
        x[bead] = x[parent] + lengths[frozenset((bead, parent))] * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    x[:, :2] -= x[:, :2].mean(axis=0)
    x[:, 2] -= x[:, 2].min()
    return x


def _lengths(molecule: Molecule, spacing: float) -> dict[frozenset, float]:
    return {frozenset((i, j)): spring.length(spacing) for i, j, spring in molecule.bonds}  # type: ignore[attr-defined]


def _bends(molecule: Molecule) -> dict[tuple, Any]:
    """Bends by their three beads, in both directions."""
    return {key: bend for i, j, k, bend in molecule.angles for key in ((i, j, k), (k, j, i))}


def _directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Isotropic unit vectors, (count, 3)."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def _closed_shapes(molecule: Molecule, count: int, rng: np.random.Generator, lengths: dict[frozenset, float]) -> np.ndarray:
    """Shapes of a molecule with rings, centred, (count, n, 3): along a single ring a walk that returns, else a small heap, then closed."""
    n, pairs = molecule.n_beads, molecule.bond_pairs
    if np.all(np.bincount(pairs.ravel(), minlength=n) == 2):
        steps = _directions(count * n, rng).reshape(count, n, 3) * np.mean(list(lengths.values()))
        walk = np.cumsum(steps - steps.mean(axis=1, keepdims=True), axis=1)
        x = np.zeros((count, n, 3))
        bead, previous = 0, None
        for place in range(n):
            x[:, bead] = walk[:, place]
            around = [int(other) for pair in pairs if bead in pair for other in pair if other != bead]
            bead, previous = next(other for other in around if other != previous), bead
    else:
        x = rng.normal(size=(count, n, 3)) * max(lengths.values())
    _close(x, molecule, lengths)
    return x - x.mean(axis=1, keepdims=True)


def _close(x: np.ndarray, molecule: Molecule, lengths: dict[frozenset, float]) -> None:
    """Move beads until bonds that close rings have their lengths too."""
    pairs = molecule.bond_pairs
    targets = np.array([lengths[frozenset(pair)] for pair in pairs.tolist()])
    # every bead follows the mean of what its bonds ask for
    share = 1.0 / np.bincount(pairs.ravel(), minlength=molecule.n_beads)
    for _ in range(200 * molecule.n_beads):
        d = x[:, pairs[:, 0]] - x[:, pairs[:, 1]]
        r = np.linalg.norm(d, axis=2)
        if np.all(np.abs(r - targets) < 0.02 * targets):
            return
        correction = 0.5 * ((targets - r) / np.maximum(r, 1e-9))[..., None] * d
        for side, sign in ((0, 1.0), (1, -1.0)):
            move = sign * correction * share[pairs[:, side]][None, :, None]
            np.add.at(x.swapaxes(0, 1), pairs[:, side], move.swapaxes(0, 1))
    raise ParameterError(f"the bonds of {molecule.name} cannot all have their lengths in any shape that was found")
