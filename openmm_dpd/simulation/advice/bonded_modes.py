"""Vibrations of bonds and angles of a scene: their frequencies, and the steps that a scheme can take with them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order

from ...base.geometry import minimum_images
from ...model.angles import Angles
from ...model.bonds import Bonds
from ...model.scene import Scene
from ...model.schemes import Scheme
from .mode_errors import exact_for_springs, largest_stable, tabulated_errors
from .stability_table import SAFE

#: Terms around the stiffest one whose vibrations are looked at.
_MOST = 300
#: Points of a thermal distribution; part of it beyond which a curvature is never met.
_POINTS, _RARE = 2001, 1e-3
#: Part of the largest stable step for other terms than springs, and a scheme that has no error with springs: measured for ``middle``, which
#: is 5 % off with stiff angles and 3 % with FENE bonds at 0.7, and 2 and 0.6 % at half of that.
_UNKNOWN = 0.4
#: Parts of a thermal distribution that errors are averaged over.
_PARTS = 25


@dataclass(frozen=True, eq=False)
class Modes:
    """Vibrations of one kind of bonded terms, near the stiffest of them."""

    what: str  #: "bonds" or "angles"
    omega: np.ndarray  #: (n,) frequencies, rad/ps, with the thermal mean of each curvature
    #: (m,) curvatures of the stiffest term over its thermal range, in equal parts, beside their mean; (1,) for a harmonic term.
    fluctuation: np.ndarray
    fastest: float  #: Frequency where the stiffest term is at the stiffest point of its thermal range, rad/ps

    def errors(self, scheme: Scheme, dt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r"""Errors of configurational and kinetic temperature at the steps dt (k,), ps; infinite over :meth:`longest`.

        Configurational temperatures weigh modes by omega^2, their share of the Laplacian; a term that is not harmonic is taken for harmonic
        ones, as stiff as it is at the points of its thermal range.
        """
        squares = np.outer(self.fluctuation, self.omega**2).ravel()
        squares = squares[squares > 0]
        conf, kin = tabulated_errors(scheme, np.sqrt(squares) * dt[:, None])
        conf, kin = np.sum(conf * squares, axis=1) / squares.sum(), np.mean(kin, axis=1)
        beyond = dt > self.longest(scheme)
        return np.where(beyond, np.inf, conf), np.where(beyond, np.inf, kin)

    def longest(self, scheme: Scheme) -> float:
        """Longest step that is stable by a margin, ps; a larger one for terms about which a word that is exact for springs says nothing."""
        springs = self.what == "bonds" and len(self.fluctuation) == 1
        return (SAFE if springs or not exact_for_springs(scheme) else _UNKNOWN) * largest_stable(scheme) / self.fastest

    def step(self, scheme: Scheme, error: float) -> float:
        """Longest step at which, and below which, both temperatures are within an error, ps."""
        steps = self.longest(scheme) * np.geomspace(1e-3, 1.0, 600)
        conf, kin = self.errors(scheme, steps)
        within = np.maximum(np.abs(conf), np.abs(kin)) <= error
        return float(steps[-1] if within.all() else steps[max(int(np.argmin(within)) - 1, 0)])


def bonded_modes(scene: Scene, around: float = 0.0) -> list[Modes]:
    """Vibrations of the bonds, and those of the angles; a kind without any, or without stiffness, is left out.

    Parameters
    ----------
    scene : Scene
    around : float
        omega^2 that the surroundings of a bead add to each vibration, 1/ps^2
        (:func:`openmm_dpd.simulation.advice.scene_groups.surroundings`).
    """
    bonds = [_terms(group, scene.initial_kT) for group in scene.bonds if len(group.pairs)]
    angles = [_terms(group, scene.initial_kT) for group in scene.angles if len(group.triples)]
    found = []
    if bonds:
        found.append(_modes("bonds", bonds, np.array([[1.0, -1.0]]), scene, around))
    if angles:
        one, other = (1 / arm for arm in _arms(np.concatenate([terms.beads for terms in angles]), bonds, scene))
        found.append(_modes("angles", angles, np.stack([one, -(one + other), other], axis=1), scene, around))
    return [modes for modes in found if modes is not None]


@dataclass(frozen=True, eq=False)
class _Terms:
    """Bonds or angles of one group, each an entry: beads; mean and largest curvature; thermal length; parts of the distribution."""

    beads: np.ndarray
    mean: np.ndarray
    largest: np.ndarray
    length: np.ndarray
    parts: np.ndarray


def _terms(group: Bonds | Angles, kT: float) -> _Terms:
    r"""Curvatures U'' of terms over their thermal range: mean, largest, and those of equal parts of it beside the mean.  The density is
    exp(-U/kT) times r^2 for the length r of a bond, and sin(theta) for an angle, that of a term alone.  The length is that for which 1/r^2
    has its mean."""
    values = np.column_stack([getattr(group, name) for name in group._DIMENSIONS])
    different, which = np.unique(values, axis=0, return_inverse=True)
    kind: Any = type(group)
    one = kind(np.tile(np.arange(group.beads.shape[1]), (len(different), 1)), *different.T)
    x = one.reach(kT) * ((np.arange(_POINTS) + 0.5) / _POINTS)[:, None]
    energy, _, curvature = (np.broadcast_to(part, x.shape) for part in one.curve(x))
    weight = one.density(x) * np.exp((energy.min(axis=0) - energy) / kT)
    weight /= weight.sum(axis=0)
    order = np.argsort(curvature, axis=0)
    rising = np.maximum(np.take_along_axis(curvature, order, axis=0), 0.0)
    below = np.cumsum(np.take_along_axis(weight, order, axis=0), axis=0)

    def at(fractions: np.ndarray) -> np.ndarray:
        """Curvatures below which these fractions of the distributions lie."""
        ranks = [np.minimum(np.searchsorted(part, fractions), _POINTS - 1) for part in below.T]
        return np.stack([rising[rank, k] for k, rank in enumerate(ranks)])

    mean = np.maximum(np.sum(weight * curvature, axis=0), 0.0)
    parts = at((np.arange(_PARTS) + 0.5) / _PARTS) / np.where(mean > 0, mean, 1.0)[:, None]
    length = np.sum(weight / x**2, axis=0) ** -0.5
    return _Terms(group.beads, *(part[which.ravel()] for part in (mean, at(np.array([1 - _RARE]))[:, 0], length, parts)))


def _arms(triples: np.ndarray, bonds: list[_Terms], scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of both arms of angles: those of the bonds, or as they lie where there is none."""
    known = {frozenset(pair): length for terms in bonds for pair, length in zip(terms.beads.tolist(), terms.length, strict=True)}
    arms = []
    for end in (0, 2):
        ends = triples[:, [end, 1]]
        apart = scene.positions[ends[:, 0]] - scene.positions[ends[:, 1]]
        lying = np.linalg.norm(minimum_images(apart, scene.box), axis=1)
        arms.append(np.array([known.get(frozenset(pair), length) for pair, length in zip(ends.tolist(), lying, strict=True)]))
    return arms[0], arms[1]


def _modes(what: str, terms: list[_Terms], slopes: np.ndarray, scene: Scene, around: float) -> Modes | None:
    r"""Frequencies by Wilson's method: eigenvalues of F^1/2 G F^1/2, G = J M^-1 J^T, with the curvatures F and the slopes J of all terms.
    The slopes are those of a straight chain, in which neighbours count most.  (Springs of rest length 0 are such chains in each direction.)
    """
    beads, mean, largest = (np.concatenate([getattr(one, name) for one in terms]) for name in ("beads", "mean", "largest"))
    count, width = beads.shape
    inverse = np.where(scene.immobile, 0.0, 1.0 / np.where(scene.immobile, 1.0, scene.bead_masses))
    entries = np.broadcast_to(slopes, (count, width)) * np.sqrt(mean)[:, None] * np.sqrt(inverse)[beads]
    matrix = sparse.csr_array((entries.ravel(), (np.repeat(np.arange(count), width), beads.ravel())), shape=(count, scene.n_beads))
    squares = matrix @ matrix.T
    alone, with_others = squares.diagonal(), abs(squares).sum(axis=1)
    # where the stiffest term is as stiff as it gets, its neighbours are as stiff as they are in the mean
    ratio = np.divide(largest, mean, out=np.zeros(count), where=mean > 0)
    fastest = alone * ratio + (with_others - alone) * np.sqrt(ratio)
    stiffest = int(np.argmax(fastest))
    if not fastest[stiffest] > 0:
        return None
    near = breadth_first_order(squares, stiffest, directed=False, return_predecessors=False)[:_MOST]
    omega = np.sqrt(np.maximum(np.linalg.eigvalsh(squares[near][:, near].toarray()), 0.0) + around)
    fluctuation = np.unique(np.concatenate([one.parts for one in terms])[stiffest])
    return Modes(what, omega, fluctuation, float(np.sqrt(fastest[stiffest] + around)))
