"""Bonds: compiled energies and forces.

With r the length of a bond and d = x_i - x_j, the force on its first bead is -U'(r) d/r; at r = 0 it has no direction and is 0, as with
OpenMM.  The kinds::

    HARMONIC    k, r0                  U = k (r - r0)^2
    FENE        k, R0, epsilon, sigma  U = -1/2 k R0^2 ln(1 - (r/R0)^2), + 4 epsilon [(sigma/r)^12 - (sigma/r)^6] + epsilon
                                       for r < 2^(1/6) sigma
    MORSE       D, alpha, r0           U = D (1 - exp(-alpha (r - r0)))^2
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from ..geometry import minimum_images
from ..wording import bead_names, in_length
from .columns import push
from .compiled import compiled
from .elementary import exp, log
from .extras import CHUNK, Extra, TermEvaluator, by_rows, inverse_edges, minimum_image

HARMONIC, FENE, MORSE = range(3)

#: r/sigma where the repulsion of a FENE bond ends, the minimum of Lennard-Jones.
WCA_END = 2.0 ** (1.0 / 6.0)

# inlined by numba itself: a call that LLVM does not inline takes longer than a bond


@njit(inline="always")
def _morse(r, depth, alpha, rest):
    """Energy and U' of a Morse bond."""
    e = exp(-alpha * (r - rest))
    return depth * (1.0 - e) * (1.0 - e), 2.0 * depth * alpha * e * (1.0 - e)


@njit(inline="always")
def _fene(r, r2, k, longest, epsilon, sigma):
    """Energy and -U'/r of a FENE bond; an infinite energy where there is none."""
    if not r < longest:
        return np.inf, 0.0
    rest = 1.0 - (r / longest) * (r / longest)
    if rest <= 0.0:  # shorter than R0 by less than rounding
        return np.inf, 0.0
    energy, pull = -0.5 * k * longest * longest * log(rest), -k / rest
    if epsilon > 0.0 and r < WCA_END * sigma:
        if r2 == 0.0:
            return np.inf, 0.0
        s2 = sigma * sigma / r2
        s6 = s2 * s2 * s2
        energy += epsilon * (4.0 * s6 * (s6 - 1.0) + 1.0)
        pull += 24.0 * epsilon * s6 * (2.0 * s6 - 1.0) / r2
    return energy, pull


@njit(inline="always")
def _bond_force(x, box, inverse, i, j, kind, p, n):
    """Energy of bond n between the beads i and j, and the force on i."""
    dx, dy, dz = minimum_image(x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2], box, inverse)
    r2 = dx * dx + dy * dy + dz * dz
    r = np.sqrt(r2)
    if kind == FENE:
        energy, pull = _fene(r, r2, p[n, 0], p[n, 1], p[n, 2], p[n, 3])
    else:
        if kind == HARMONIC:
            stretch = r - p[n, 1]
            energy, slope = p[n, 0] * stretch * stretch, 2.0 * p[n, 0] * stretch
        else:
            energy, slope = _morse(r, p[n, 0], p[n, 1], p[n, 2])
        pull = -slope / r if r > 0.0 else 0.0
    return energy, pull * dx, pull * dy, pull * dz


@compiled
def _bonds(x, box, pairs, kinds, p, rows, start, slots, parts, energies, force):
    """Add the forces of all bonds, one after the other; returns the energy.  (Rows, slots and parts are for several threads.)"""
    inverse, total = inverse_edges(box), 0.0
    for chunk in range(len(energies)):
        energy = 0.0
        for n in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(pairs))):
            i, j = pairs[n, 0], pairs[n, 1]
            u, fx, fy, fz = _bond_force(x, box, inverse, i, j, kinds[n], p, n)
            energy += u
            push(force, i, j, fx, fy, fz)
        total += energy
    return total


@njit(error_model="numpy")
def _part(x, box, inverse, pairs, kinds, p, begin, end, parts):
    energy = 0.0
    for n in range(begin, end):
        u, fx, fy, fz = _bond_force(x, box, inverse, pairs[n, 0], pairs[n, 1], kinds[n], p, n)
        energy += u
        parts[2 * n, 0], parts[2 * n, 1], parts[2 * n, 2] = fx, fy, fz
        parts[2 * n + 1, 0], parts[2 * n + 1, 1], parts[2 * n + 1, 2] = -fx, -fy, -fz
    return energy


_bonds_parallel = by_rows("bonds_by_rows", _part)


@dataclass(frozen=True, eq=False)
class BondTerms:
    """All bonds.

    Attributes
    ----------
    pairs : (B, 2) uint32
        Beads of each bond.
    kinds : (B,) uint8
        ``HARMONIC``, ``FENE`` or ``MORSE``.
    parameters : (B, 4) float64
        Coefficients of each bond, in the order in which they are named above.
    """

    term: ClassVar[str] = "bond"

    pairs: np.ndarray
    kinds: np.ndarray
    parameters: np.ndarray

    def evaluator(self) -> TermEvaluator:
        """What computes it."""
        return TermEvaluator(self, self.pairs, (_bonds, _bonds_parallel), _what_is_wrong)

    def few(self) -> tuple[Extra, np.ndarray, np.ndarray]:
        """One bond of two beads."""
        one = BondTerms(np.array([[0, 1]], np.uint32), np.array([HARMONIC], np.uint8), np.ones((1, 4)))
        return one, np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.diag([4.0] * 3)


def _what_is_wrong(terms: BondTerms, x: np.ndarray, box: np.ndarray | None) -> str:
    return f"{_bad_bond(terms, x, box)}; the step size may be too large"


def _bad_bond(terms: BondTerms, x: np.ndarray, box: np.ndarray | None) -> str:
    """Which bond has no finite energy at the positions x, in the words in which a scene with such a bond is refused."""
    r = np.linalg.norm(minimum_images(x[terms.pairs[:, 0]] - x[terms.pairs[:, 1]], box), axis=1)
    fene, (_, longest, epsilon, _) = terms.kinds == FENE, terms.parameters.T
    bad = np.flatnonzero(fene & ~(r < longest))
    if len(bad):
        (i, j), limit = terms.pairs[bad[0]], f"its R0 of {in_length(longest[bad[0]])}"
        return f"the FENE bond between {bead_names(i, j)} is {in_length(r[bad[0]])} long, which is not less than {limit}"
    bad = np.flatnonzero(fene & (r == 0) & (epsilon > 0))
    if len(bad):
        return f"{bead_names(*terms.pairs[bad[0]])} are at the same point, where the repulsion of their FENE bond is infinite"
    bad = np.flatnonzero(~np.isfinite(r))
    n = int(bad[0]) if len(bad) else int(np.argmin(r))
    return f"the bond between {bead_names(*terms.pairs[n])} is {in_length(r[n])} long, where it has no finite energy"
