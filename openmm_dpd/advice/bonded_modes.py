"""Vibrations of bonds, angles and dihedrals of a scene: their frequencies, and the step sizes that a scheme allows.

The effect of any word on a harmonic vibration is known exactly, from a two by two matrix.
"""

from dataclasses import dataclass, fields
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
import scipy

from ..base.errors import bead_names
from ..base.geometry import minimum_images
from ..model.angles import Angles
from ..model.bonds import BondedTerms
from ..model.scene import Scene
from ..model.schemes import SWEEPS, Scheme

#: Friction of the mode times the step, in sweeps; errors of symmetric words do not depend on it.
_FRICTION = 0.02
#: omega dt at which errors are tabulated; no word with up to ten forces per step is stable beyond.
_GRID = np.linspace(0.0, 20.0, 20001)[1:]


def mode_errors(scheme: Scheme, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r"""Relative errors of the temperatures of a harmonic mode.

    A step maps the state (omega x, v) by a matrix M and adds noise of covariance C.  Both are composed of the letters: A adds ``part theta
    v`` to the first component, B subtracts ``part theta omega x`` from the second, O and S multiply the second by q and add noise of
    variance 1 - q^2.  The sampled covariance is S = M S M^T + C; S_00 - 1 is the error of the configurational temperature, S_11 - 1 that of
    the kinetic one.  Schemes that are not words are treated as velocity Verlet followed by a sweep.

    Parameters
    ----------
    scheme : Scheme
    theta : (n,) array
        omega dt, > 0.

    Returns
    -------
    configurational, kinetic : (n,) arrays
        Relative errors, infinite where the step is unstable.
    """
    letters = [*scheme.motion]
    if not any(letter in SWEEPS for letter, _ in letters):
        letters.append((SWEEPS[0], Fraction(1)))
    total, spread = np.tile(np.eye(2), (len(theta), 1, 1)), np.zeros((len(theta), 2, 2))
    for letter, part in letters:
        one, noise = np.tile(np.eye(2), (len(theta), 1, 1)), np.zeros((2, 2))
        if letter == "A":
            one[:, 0, 1] = float(part) * theta
        elif letter == "B":
            one[:, 1, 0] = -float(part) * theta
        else:
            x = _FRICTION * float(part)
            q = np.exp(-x) if letter == "O" else (1 - x / 2) / (1 + x / 2)
            one[:, 1, 1], noise[1, 1] = q, 1 - q * q
        total, spread = one @ total, one @ spread @ one.transpose(0, 2, 1) + noise
    stable = np.abs(np.linalg.eigvals(total)).max(axis=1) < 1 - 1e-9
    twice = np.einsum("nij,nkl->nikjl", total[stable], total[stable]).reshape(-1, 4, 4)
    found = np.full((len(theta), 4), np.inf)
    found[stable] = np.linalg.solve(np.eye(4) - twice, spread[stable].reshape(-1, 4, 1))[:, :, 0]
    return found[:, 0] - 1, found[:, 3] - 1


@lru_cache
def _table(scheme: Scheme) -> tuple[np.ndarray, np.ndarray, float]:
    """Errors on the grid below the first unstable omega dt, and this omega dt."""
    conf, kin = mode_errors(scheme, _GRID)
    unstable = np.flatnonzero(~np.isfinite(conf))
    end = unstable[0] if len(unstable) else len(_GRID)
    return np.concatenate([[0.0], conf[:end]]), np.concatenate([[0.0], kin[:end]]), float(_GRID[end - 1])


def largest_stable(scheme: Scheme) -> float:
    """Largest omega dt at which a scheme is stable for a harmonic mode."""
    return _table(scheme)[2]


def exact_for_springs(scheme: Scheme) -> bool:
    """Whether a scheme has no temperature error for harmonic modes wherever it is stable."""
    conf, kin, _ = _table(scheme)
    return bool(np.abs(conf).max() < 1e-6 and np.abs(kin).max() < 1e-6)


def tabulated_errors(scheme: Scheme, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors of :func:`mode_errors`, (n,) each, interpolated from a table, which is fast for many values."""
    conf, kin, end = _table(scheme)
    at = np.concatenate([[0.0], _GRID])[: len(conf)]
    return np.where(theta > end, np.inf, np.interp(theta, at, conf)), np.where(theta > end, np.inf, np.interp(theta, at, kin))


#: Number of terms around the stiffest one whose vibrations are considered.
_MOST = 300
#: Points of a thermal distribution, and the fraction of it with the largest curvatures, which is neglected.
_POINTS, _RARE = 2001, 1e-3
#: Largest allowed fraction of the stable step, which is known exactly, at the stiffest point of the thermal range.
_MARGIN = 0.85
#: Largest allowed fraction of the stable step for schemes that are exact for springs, and so have no other limit: for springs, and for
#: other terms.  Measured for ``middle``: 5 % off with stiff angles and 3 % with FENE bonds at 0.7, 2 and 0.6 % at half of that.
_EXACT, _UNKNOWN = 0.7, 0.4

#: Least energy, kT, that must keep an angle from being straight: with less, forces of dihedrals next to it are occasionally too large for
#: any step.  Measured: chains with 8 kT blow up; those with 15, 21, 31 and 77 kT have the predicted error.
_APART = 20.0

#: Number of parts of a thermal distribution over which errors are averaged.
_PARTS = 25


@dataclass(frozen=True, eq=False)
class Modes:
    """Vibrations of one kind of bonded terms around the stiffest one."""

    what: str  #: "bonds", "angles", "dihedrals" or "charges"
    omega: np.ndarray  #: (n,) frequencies, rad/ps, from the thermal mean of each curvature
    #: (m,) curvatures of the stiffest term in equal parts of its thermal range, relative to their mean; (1,) for a harmonic term.
    fluctuation: np.ndarray
    fastest: float  #: Frequency with the stiffest term at the stiffest point of its thermal range, rad/ps
    #: Part of omega^2, 1/ps^2, that does not fluctuate with the terms: that of the surroundings, for dihedrals, which may be weaker.
    steady: float = 0.0

    def errors(self, scheme: Scheme, dt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r"""Relative errors of configurational and kinetic temperature at step sizes dt (k,), ps; infinite above :meth:`longest`.

        Modes count in the configurational temperature by omega^2, their share of the Laplacian.  An anharmonic term is treated as harmonic
        ones with the curvatures of its thermal range.
        """
        squares = np.outer(self.fluctuation, self.omega**2 - self.steady).ravel() + self.steady
        squares = squares[squares > 0]
        conf, kin = tabulated_errors(scheme, np.sqrt(squares) * dt[:, None])
        conf, kin = np.sum(conf * squares, axis=1) / squares.sum(), np.mean(kin, axis=1)
        beyond = dt > self.longest(scheme)
        return np.where(beyond, np.inf, conf), np.where(beyond, np.inf, kin)

    def longest(self, scheme: Scheme) -> float:
        """Longest step, ps, that is stable by a margin; the margin is wider for schemes that are exact for springs."""
        springs = self.what == "bonds" and len(self.fluctuation) == 1
        part = (_EXACT if springs else _UNKNOWN) if exact_for_springs(scheme) else _MARGIN
        return part * largest_stable(scheme) / self.fastest

    def step(self, scheme: Scheme, error: float, kinetic: bool = True) -> float:
        """Longest step, ps, up to which temperatures are within an error; ``kinetic`` includes the kinetic temperature."""
        steps = self.longest(scheme) * np.geomspace(1e-3, 1.0, 600)
        conf, kin = self.errors(scheme, steps)
        within = np.maximum(np.abs(conf), np.abs(kin) if kinetic else 0.0) <= error
        return float(steps[-1] if within.all() else steps[max(int(np.argmin(within)) - 1, 0)])


def bonded_modes(scene: Scene, around: float = 0.0) -> list[Modes]:
    """Vibrations of the bonds, angles and dihedrals of a scene, without kinds that are missing or have no stiffness, and without dihedrals
    for which no step is short enough (:func:`why_no_step`).

    Parameters
    ----------
    scene : Scene
    around : float
        omega^2 that the surroundings of a bead add to each vibration, 1/ps^2 (:func:`openmm_dpd.advice.scene_groups.surroundings`).
    """
    bonds = [_terms(group, scene.initial_kT) for group in scene.bonds if len(group.pairs)]
    angles = [_terms(group, scene.initial_kT) for group in scene.angles if len(group.triples)]
    found = []
    if bonds:
        found.append(_modes("bonds", bonds, np.array([[1.0, -1.0]]), scene, around))
    if angles:
        one, other = (1 / arm for arm in _arms(np.concatenate([terms.beads for terms in angles]), bonds, scene))
        found.append(_modes("angles", angles, np.stack([one, -(one + other), other], axis=1), scene, around))
    if any(len(group.quads) for group in scene.dihedrals) and why_no_step(scene) is None:
        terms, slopes = _twists(bonds, scene)
        found.append(_modes("dihedrals", [terms], slopes, scene, around))
    return [modes for modes in found if modes is not None]


@dataclass(frozen=True, eq=False)
class _Terms:
    """Bonds, angles or dihedrals of one object, one entry each: beads, mean and largest curvature, thermal length, parts of the range."""

    beads: np.ndarray
    mean: np.ndarray
    largest: np.ndarray
    length: np.ndarray
    parts: np.ndarray


def _different(group: BondedTerms) -> tuple[Any, np.ndarray]:
    """The distinct terms of a group, and the number of the distinct term that each one is."""
    values = np.column_stack([getattr(group, name) for name in group._DIMENSIONS])
    different, which = np.unique(values, axis=0, return_inverse=True)
    kind: Any = type(group)
    return kind(np.tile(np.arange(group.beads.shape[1]), (len(different), 1)), *different.T), which.ravel()


def _thermal(group: BondedTerms, kT: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Thermal range of the D distinct terms of a group: points (P, D), their weights and curvatures U'', and the number of each term.

    The density is that of an isolated term: exp(-U/kT) times r^2 for the length r of a bond, or sin(theta) for an angle.
    """
    one, which = _different(group)
    x = one.reach(kT) * ((np.arange(_POINTS) + 0.5) / _POINTS)[:, None]
    energy, _, curvature = (np.broadcast_to(part, x.shape) for part in one.curve(x))
    weight = one.density(x) * np.exp((energy.min(axis=0) - energy) / kT)
    weight /= weight.sum(axis=0)
    return x, weight, curvature, which


def _below(values: np.ndarray, weight: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Quantiles of D weighted distributions at the given fractions, (D, fractions)."""
    order = np.argsort(values, axis=0)
    rising, below = (np.take_along_axis(part, order, axis=0) for part in (values, weight))
    ranks = [np.minimum(np.searchsorted(part, fractions), _POINTS - 1) for part in np.cumsum(below, axis=0).T]
    return np.stack([rising[rank, k] for k, rank in enumerate(ranks)])


def _terms(group: BondedTerms, kT: float) -> _Terms:
    r"""Terms of a group with curvatures U'' over their thermal range: mean, largest, and those of equal parts relative to the mean.

    The thermal length r is that for which 1/r^2 is the mean of 1/r^2.
    """
    x, weight, curvature, which = _thermal(group, kT)
    mean = np.maximum(np.sum(weight * curvature, axis=0), 0.0)
    stiffness = np.maximum(curvature, 0.0)
    parts = _below(stiffness, weight, (np.arange(_PARTS) + 0.5) / _PARTS) / np.where(mean > 0, mean, 1.0)[:, None]
    length = np.sum(weight / x**2, axis=0) ** -0.5
    largest = _below(stiffness, weight, np.array([1 - _RARE]))[:, 0]
    return _Terms(group.beads, *(part[which] for part in (mean, largest, length, parts)))


def _bent(group: Angles, kT: float) -> np.ndarray:
    """1/sin^2 of angles, (K, 2): mean over the thermal range without its rare part, and largest value."""
    x, weight, _, which = _thermal(group, kT)
    inverse = np.broadcast_to(np.sin(x) ** -2, weight.shape)
    largest = _below(inverse, weight, np.array([1 - _RARE]))[:, 0]
    return np.stack([np.sum(weight * np.minimum(inverse, largest), axis=0), largest], axis=1)[which]


def why_no_step(scene: Scene) -> str | None:
    """Why there may be no step short enough for the dihedrals or impropers of a scene, or None."""
    kT, held = scene.initial_kT, set()
    for group in scene.angles:
        one, which = _different(group)
        energy = one.curve(np.linspace(0.0, np.pi, _POINTS)[:, None])[0]
        apart = np.minimum(energy[0], energy[-1]) - energy.min(axis=0) >= _APART * kT
        held |= {(j, frozenset((i, k))) for i, j, k in group.triples[apart[which]].tolist()}
    if scene.impropers:
        return "no steps were measured with impropers"
    for dihedrals in scene.dihedrals:
        for row in dihedrals.quads.tolist():
            for at in (1, 2):
                if (row[at], frozenset((row[at - 1], row[at + 1]))) not in held:
                    three = bead_names(*row[at - 1 : at + 2])
                    return f"no angle keeps the {three} of a dihedral from a line, where its forces are unbounded"
    return None


def _twists(bonds: list[_Terms], scene: Scene) -> tuple[_Terms, np.ndarray]:
    """All dihedrals, and their slopes, with the signs of a trans chain, or of a cis one if the mean cosine is positive.

    Slopes scale with 1/sin of the angles at the two middle beads.
    """
    kT, known, groups = scene.initial_kT, {}, [group for group in scene.dihedrals if len(group.quads)]
    for group in (group for group in scene.angles if len(group.triples)):
        for (i, j, k), found in zip(group.triples.tolist(), _bent(group, kT), strict=True):
            known[j, frozenset((i, k))] = found
    dihedrals = [_terms(group, kT) for group in groups]
    beads, mean, largest, length, parts = (np.concatenate([getattr(one, field.name) for one in dihedrals]) for field in fields(_Terms))
    ranges = [_thermal(group, kT) for group in groups]
    turn = np.concatenate([np.sum(weight * np.cos(x), axis=0)[which] for x, weight, _, which in ranges])[:, None]
    rows = beads.tolist()
    bent = np.array([[known[row[at], frozenset((row[at - 1], row[at + 1]))] for at in (1, 2)] for row in rows])
    inverse, most = bent[:, :, 0], bent[:, :, 1]
    (first, middle), (_, last) = (_arms(beads[:, part], bonds, scene) for part in (slice(3), slice(1, 4)))
    outer = np.sqrt(inverse) / np.stack([first, last], axis=1)
    along = np.sqrt(inverse - 1.0) / middle[:, None]  # of a middle bead, by either plane; angles count as obtuse
    own, other = outer + along, along[:, ::-1]
    inner, side = np.sqrt(own**2 + other**2 + 2.0 * own * other * turn), np.where(turn[:, 0] > 0, -1.0, 1.0)
    slopes = np.stack([outer[:, 0], -inner[:, 0], -side * inner[:, 1], side * outer[:, 1]], axis=1)
    return _Terms(beads, mean, np.maximum(largest, mean * (most / inverse).max(axis=1)), length, parts), slopes


def _arms(triples: np.ndarray, bonds: list[_Terms], scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of both arms of angles: thermal lengths of the bonds, or distances at the start where there is no bond."""
    known = {frozenset(pair): length for terms in bonds for pair, length in zip(terms.beads.tolist(), terms.length, strict=True)}
    arms = []
    for end in (0, 2):
        ends = triples[:, [end, 1]]
        apart = scene.positions[ends[:, 0]] - scene.positions[ends[:, 1]]
        lying = np.linalg.norm(minimum_images(apart, scene.box), axis=1)
        arms.append(np.array([known.get(frozenset(pair), length) for pair, length in zip(ends.tolist(), lying, strict=True)]))
    return arms[0], arms[1]


def _modes(what: str, terms: list[_Terms], slopes: np.ndarray, scene: Scene, around: float) -> Modes | None:
    r"""Modes by Wilson's method: eigenvalues of F^1/2 G F^1/2, G = J M^-1 J^T, with the curvatures F and the slopes J of all terms; None if
    none is stiff.  Slopes are those of a straight chain, in which neighbours couple most.  (Springs of rest length 0 are such chains along
    each axis.)"""
    beads, mean, largest = (np.concatenate([getattr(one, name) for one in terms]) for name in ("beads", "mean", "largest"))
    count, width = beads.shape
    inverse = np.where(scene.immobile, 0.0, 1.0 / np.where(scene.immobile, 1.0, scene.bead_masses))
    entries = np.broadcast_to(slopes, (count, width)) * np.sqrt(mean)[:, None] * np.sqrt(inverse)[beads]
    matrix = scipy.sparse.csr_array((entries.ravel(), (np.repeat(np.arange(count), width), beads.ravel())), shape=(count, scene.n_beads))
    squares = matrix @ matrix.T
    alone, with_others = squares.diagonal(), abs(squares).sum(axis=1)
    # when the stiffest term has its largest curvature, its neighbours have their mean curvatures
    ratio = np.divide(largest, mean, out=np.zeros(count), where=mean > 0)
    fastest = alone * ratio + (with_others - alone) * np.sqrt(ratio)
    stiffest = int(np.argmax(fastest))
    if not fastest[stiffest] > 0:
        return None
    near = scipy.sparse.csgraph.breadth_first_order(squares, stiffest, directed=False, return_predecessors=False)[:_MOST]
    omega = np.sqrt(np.maximum(np.linalg.eigvalsh(squares[near][:, near].toarray()), 0.0) + around)
    fluctuation = np.unique(np.concatenate([one.parts for one in terms])[stiffest])
    return Modes(what, omega, fluctuation, float(np.sqrt(fastest[stiffest] + around)), around if what == "dihedrals" else 0.0)
