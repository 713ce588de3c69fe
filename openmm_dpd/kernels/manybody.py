"""The layer of many-body DPD: attraction, and a repulsion that grows with the local density.

Per listed pair, with w = 1 - r/cutoff, w_d = max(0, 1 - r/cutoff_B) and f the factor of bonded neighbours::

    C   f [ A w + B (rho_i + rho_j) w_d ]
    D   - f gamma w^2 (e.v)
    R   sqrt(f) sigma w xi/sqrt(dt)

A first pass over the pairs adds up the densities rho_i at the listed positions; beads do not count themselves.

- Lucy kernel: rho_i = sum over j of m_j 105/(16 pi h^3) (1 + 3 r/h)(1 - r/h)^3 with h = cutoff_density.  As in LAMMPS bonded neighbours
  count in full for any factor but 0, and the energy is that of the pairs with the densities held fixed.  There is no potential.
- Quadratic kernel: rho_i = sum over j of f 15/(2 pi h^3) (1 - r/h)^2 with h = cutoff_B.  With B and h the same for all pairs that
  interact, the force is minus the gradient of sum over pairs of f A cutoff w^2/2 + sum over i of pi B h^4 rho_i^2/30.  The factor has to
  be in the density as well: only then is there a potential.

Friction and noise are those of DPD, so a sweep is that of :mod:`.sweeps`.  Beads at the same point count in each other's densities, and
so in the energy of the quadratic kernel's densities, but have neither forces nor another energy.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..runtime import helper, inlined
from .columns import Motion, approach, deliver, factor_of, gather_and_clear, over_pairs, push_apart, row_of
from .dpd import SweptLayer
from .forces import CUTOFF, GAMMA, SIGMA, A, soft
from .layer import CONSERVATIVE, DISSIPATIVE, RANDOM, STRESS, Call, Layer, PairSpec, Sums, table_of
from .noise import draw
from .pairs import PairList, rows

#: Columns of the coefficient table after the eight of :mod:`.forces`, which the sweep reads.
B, CUTOFF_B, CUTOFF_DENSITY = 8, 9, 10
(_NOISE,) = rows(1)


@dataclass(frozen=True, eq=False)
class ManyBodyTable:
    """Coefficients of one layer, as (T, T) symmetric arrays (MD units); cutoff 0 means no interaction."""

    A: np.ndarray
    B: np.ndarray
    gamma: np.ndarray
    cutoff: np.ndarray  # Range of attraction and friction, the longest one
    cutoff_B: np.ndarray
    cutoff_density: np.ndarray
    lucy: bool  #: Lucy kernel; otherwise the quadratic one
    mass: np.ndarray  #: (N,) masses of all beads, frozen ones too, which weigh them in the Lucy density; the quadratic one counts beads

    def coefficients(self, kT: float) -> np.ndarray:
        """(T*T, 11) table at the thermal energy kT: sigma^2 = 2 kT gamma."""
        zero, one = np.zeros_like(self.A), np.ones_like(self.A)
        of_dpd = self.A, self.cutoff, self.gamma, np.sqrt(2.0 * kT * self.gamma), zero, zero, one, one
        return table_of(*of_dpd, self.B, self.cutoff_B, self.cutoff_density)

    def layer(self, spec: PairSpec, number: int) -> Layer:
        """The layer that evaluates these coefficients."""
        return ManyBodyLayer(self, spec, number)


class ManyBodyLayer(SweptLayer):
    """Evaluates a :class:`ManyBodyTable`."""

    repeats = True

    def __init__(self, table: ManyBodyTable, spec: PairSpec, number: int):
        pairs = PairList(spec.types, spec.inv_mass, table.cutoff, spec.exceptions)
        pairs.coincident = True
        super().__init__(table, number, pairs, pairs.alike, transverse=False)
        self._n_beads = len(spec.types)
        # the kernels are compiled on a handful of beads, which take the masses of the first ones
        self._mass = np.resize(table.mass, self._n_beads).astype(np.float64)
        # scratch, in the order of the pair list
        self._sorted_mass, self._rho = np.zeros((2, len(pairs.order)))

    def _sorted_densities(self, coefficients: np.ndarray) -> np.ndarray:
        """Densities in the order of the pair list."""
        density_sums(self.pairs, Density(self.table.lucy, coefficients, self._mass, self._sorted_mass, self._rho))
        return self._rho

    @property
    def densities(self) -> np.ndarray:
        """(N,) local densities at the listed positions; 0 for a bead that takes no part."""
        rho = np.zeros(self._n_beads)
        rho[self.pairs.order] = self._sorted_densities(self._at(0.0))
        return rho

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions, written or added to ``out``."""
        pairs = self.pairs
        which, coefficients = call.which, self._at(call.kT)
        rho = self._sorted_densities(coefficients) if which & CONSERVATIVE else np.zeros(0)
        noise = call.key(self.number), call.rsqrt_dt
        share = (0.5, 0.0) if self.table.lucy else (0.25, 0.25)
        motion = self._motion.arrays(call, out, add)
        return Sums(*many_body_forces(pairs, ManyBody(which, *noise, share, coefficients, rho, motion), which & STRESS))

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy; NaN with the Lucy kernel, whose force has no potential."""
        if self.table.lucy:
            return float("nan")
        coefficients = self._at(0.0)
        return many_body_laplacian(self.pairs, coefficients, self._sorted_densities(coefficients))


@inlined
def lucy_weight(r, h):
    """Lucy's kernel, normalised in three dimensions, for r < h."""
    w = 1.0 - r / h
    return 105.0 / (16.0 * np.pi * h**3) * (1.0 + 3.0 * r / h) * w * w * w


@inlined
def quadratic_weight(r, h):
    """Warren's kernel, normalised in three dimensions, for r < h."""
    w = 1.0 - r / h
    return 7.5 / (np.pi * h**3) * w * w


class Density(NamedTuple):
    """What the sums of densities read and write beside the pairs; ``masses`` (N,) are in the order of numbers."""

    lucy: bool
    coefficients: np.ndarray
    masses: np.ndarray
    mass: np.ndarray
    rho: np.ndarray


@helper
def _begin(pairs, data, begin, end):
    for k in range(begin, end):
        data.mass[k], data.rho[k] = data.masses[pairs.order[k]], 0.0


@inlined
def _pair_density(pairs, data, scratch, n, k, column):
    i, j, r, rho = pairs.pi[n], pairs.pj[n], pairs.geometry[3, n], data.rho
    h = data.coefficients[row_of(pairs, i, j), CUTOFF_DENSITY]
    if r < h:
        if data.lucy:
            weight = lucy_weight(r, h)
            rho[i] += data.mass[j] * weight
            rho[j] += data.mass[i] * weight
        else:
            weight = quadratic_weight(r, h) * factor_of(pairs, n)
            rho[i] += weight
            rho[j] += weight
    return 0.0, 0.0, 0.0


density_sums = over_pairs("density_sums", _pair_density, first=_begin)


class ManyBody(NamedTuple):
    """What the force form reads and writes beside the pairs; ``share``: part of the repulsion's force times w_d that is energy,
    of beads that are apart and of beads at the same point."""

    which: int
    key: np.uint64
    rsqrt_dt: float
    share: tuple[float, float]
    coefficients: np.ndarray
    rho: np.ndarray
    motion: Motion


@helper
def _noise(pairs, data, begin, m, scratch):
    if data.which & RANDOM:
        draw(data.key, pairs, begin, m, scratch, _NOISE)


@inlined
def _pair_force(pairs, data, scratch, n, k, column):
    i, j, c, which = pairs.pi[n], pairs.pj[n], data.coefficients, data.which
    row, factor, r = row_of(pairs, i, j), factor_of(pairs, n), pairs.geometry[3, n]
    w = 1.0 - r / c[row, CUTOFF]
    radial, energy, drag = 0.0, 0.0, 0.0
    if which & CONSERVATIVE:
        radial, energy = soft(factor * c[row, A] if r > 0.0 else 0.0, c[row, CUTOFF], r)
        cutoff_B = c[row, CUTOFF_B]
        if r < cutoff_B:
            wd = 1.0 - r / cutoff_B
            many = factor * c[row, B] * (data.rho[i] + data.rho[j]) * wd
            energy += data.share[0 if r > 0.0 else 1] * many * wd * cutoff_B
            radial += many
    if which & DISSIPATIVE:
        drag = factor * c[row, GAMMA] * w * w * approach(pairs, data.motion.v, n, i, j)
        radial -= drag
    if which & RANDOM:
        radial += np.sqrt(factor) * data.rsqrt_dt * c[row, SIGMA] * w * scratch.values[_NOISE + k]
    return energy, push_apart(pairs, data.motion.f, n, i, j, radial), -drag * r


many_body_forces = over_pairs("many_body_forces", _pair_force, _noise, first=gather_and_clear, last=deliver)


class Curvature(NamedTuple):
    """What the Laplacian reads and writes beside the pairs; ``slope``: (M, 3) gradients of the densities in units of theirs."""

    coefficients: np.ndarray
    rho: np.ndarray
    slope: np.ndarray


@inlined
def _pair_laplacian(pairs, data, scratch, n, k, column):
    i, j, c, g, rho = pairs.pi[n], pairs.pj[n], data.coefficients, pairs.geometry, data.rho
    row, factor = row_of(pairs, i, j), factor_of(pairs, n)
    rc, h, r = c[row, CUTOFF], c[row, CUTOFF_B], g[3, n]
    if r == 0.0:
        return 0.0, 0.0, 0.0
    second = factor * c[row, A] * (1.0 / rc - 2.0 * (1.0 - r / rc) / r)
    if r < h:
        wd = 1.0 - r / h
        scale = 15.0 * c[row, B] / (np.pi * c[row, CUTOFF_B] ** 4)  # 2c (15/(pi h^4))^2, see many_body_laplacian
        second += scale * (factor * wd) ** 2 + factor * c[row, B] * (rho[i] + rho[j]) * (1.0 / h - 2.0 * wd / r)
        # the same scale for all pairs that have one
        scale = np.sqrt(scale) * factor * wd
        for a in range(3):
            data.slope[i, a] += scale * g[a, n]
            data.slope[j, a] -= scale * g[a, n]
    return ((pairs.inv_mass[i] > 0.0) + (pairs.inv_mass[j] > 0.0)) * second, 0.0, 0.0


_laplacian_of_pairs = over_pairs("many_body_laplacian", _pair_laplacian, parallel=False)


def many_body_laplacian(pairs: PairList, coefficients: np.ndarray, rho: np.ndarray) -> float:
    """Sum over the mobile beads of the Laplacian of the conservative energy, quadratic kernel.  A pair's attraction gives A/rc - 2 A w/r
    per mobile bead, as in DPD.  For the sum of c rho^2 with c = pi B h^4/30, a mobile bead i has 2c [ |grad_i rho_i|^2 + sum over j of (f
    W')^2 + (rho_i + rho_j) f (W'' + 2 W'/r) ] with W' = -15 w_d/(pi h^4), W'' = 15/(pi h^5); so 2c W' = -B w_d."""
    slope = np.zeros((len(rho), 3))  # sqrt(2c) grad_i rho_i
    total = _laplacian_of_pairs(pairs, Curvature(coefficients, rho, slope))[0]
    return total + float(np.sum(slope[pairs.arrays.inv_mass > 0.0] ** 2))
