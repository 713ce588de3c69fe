"""The layer of many-body DPD: attraction, and a repulsion that grows with the local density.

Per listed pair, with w = 1 - r/cutoff_A, w_d = max(0, 1 - r/cutoff_B) and f the factor of bonded neighbours::

    C   f [ A w + B (rho_i + rho_j) w_d ]
    D   - f gamma w^2 (e.v)
    R   sqrt(f) sigma w xi/sqrt(dt)

A first pass over the pairs adds up the densities rho_i at the listed positions; beads do not count themselves.

- Lucy kernel: rho_i = sum over j of m_j 105/(16 pi h^3) (1 + 3 r/h)(1 - r/h)^3 with h = cutoff_density.  As in LAMMPS bonded neighbours
  count in full whatever their factor, and the energy is that of the pairs with the densities held fixed.  There is no potential.
- Quadratic kernel: rho_i = sum over j of f 15/(2 pi h^3) (1 - r/h)^2 with h = cutoff_B.  With B and h the same for all pairs that
  interact, the force is minus the gradient of sum over pairs of f A cutoff_A w^2/2 + sum over i of pi B h^4 rho_i^2/30.  The factor has to
  be in the density as well: only then is there a potential.

Friction and noise are those of DPD, so a sweep is that of :mod:`.sweeps`.  A pair closer than the list's shortest distance counts nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numba import njit, prange

from ..errors import ParameterError
from .compiled import compiled, serial_and_parallel
from .dpd import sweep_velocities
from .forces import CUTOFF, EXPONENT, EXPONENT_PERP, GAMMA, SIGMA, A
from .layer import CONSERVATIVE, DISSIPATIVE, RANDOM, Call, Forces
from .noise import normal, pair_key
from .threads import run

if TYPE_CHECKING:
    from .engine import PairList, PairSpec

#: Columns of the coefficient table after the eight of :mod:`.forces`, which the sweep reads.
B, CUTOFF_B, CUTOFF_DENSITY = 8, 9, 10
_COLUMNS = 11

#: Stands for the factor 0 of bonded neighbours: a pair list leaves pairs of factor 0 out, but LAMMPS's density counts them.
#: Forces times this are lost in rounding.
_NO_FORCE = 1e-300


@dataclass(frozen=True, eq=False)
class ManyBodyTable:
    """Coefficients of one layer, as (T, T) symmetric arrays (MD units); cutoff 0 means no interaction.

    Attributes
    ----------
    A, B, gamma : (T, T) arrays
    cutoff : (T, T) array
        Range of the pair list.
    cutoff_A, cutoff_B, cutoff_density : (T, T) arrays
        Ranges of attraction and friction, of the repulsion and of the density; the first is the longest and equals ``cutoff``.
    lucy : bool
        Lucy kernel; otherwise the quadratic one.
    mass : (N,) array
        Masses of all beads, frozen ones too, which weigh them in the Lucy density; the quadratic one counts beads.
    conservative : bool
        Whether there is a conservative part at all.

    Raises
    ------
    ParameterError
        If cutoff_A is not the longest range.
    """

    A: np.ndarray
    B: np.ndarray
    gamma: np.ndarray
    cutoff: np.ndarray
    cutoff_A: np.ndarray
    cutoff_B: np.ndarray
    cutoff_density: np.ndarray
    lucy: bool
    mass: np.ndarray
    conservative: bool = True

    def __post_init__(self) -> None:
        # friction has to end before the list does
        for name in ("cutoff", "cutoff_B", "cutoff_density"):
            values = getattr(self, name)
            if np.any(values > self.cutoff_A) or (name == "cutoff" and np.any(values < self.cutoff_A)):
                raise ParameterError(f"cutoff_A = {self.cutoff_A.tolist()} must be the longest range, but {name} = {values.tolist()}")

    def coefficients(self, kT: float) -> np.ndarray:
        """(T*T, 11) table at the thermal energy kT: sigma^2 = 2 kT gamma."""
        table = np.zeros((self.A.size, _COLUMNS))
        for column, values in (
            (A, self.A),
            (CUTOFF, self.cutoff_A),
            (GAMMA, self.gamma),
            (SIGMA, np.sqrt(2.0 * kT * self.gamma)),
            (EXPONENT, np.ones_like(self.A)),
            (EXPONENT_PERP, np.ones_like(self.A)),
            (B, self.B),
            (CUTOFF_B, self.cutoff_B),
            (CUTOFF_DENSITY, self.cutoff_density),
        ):
            table[:, column] = values.ravel()
        return table

    def layer(self, spec: PairSpec, pairs: PairList, number: int) -> ManyBodyLayer:
        """The layer that evaluates these coefficients."""
        if self.lucy:
            start, bead, factor = spec.exceptions
            pairs.spec = replace(spec, exceptions=(start, bead, np.maximum(factor, _NO_FORCE)))
        return ManyBodyLayer(self, spec, pairs, number)


class ManyBodyLayer:
    """Evaluates a :class:`ManyBodyTable`.

    Attributes
    ----------
    has_laplacian : bool
        Whether the conservative force has a potential.
    """

    def __init__(self, table: ManyBodyTable, spec: PairSpec, pairs: PairList, number: int):
        self.table, self.update, self.pairs, self.number = table, spec.update, pairs, number
        self.has_laplacian = not table.lucy
        self._n_beads = len(spec.types)
        # the kernels are compiled on a handful of beads, which take the masses of the first ones
        self._mass = np.resize(table.mass, self._n_beads).astype(np.float64)
        # of the last two temperatures, as in the layer of DPD
        self._coefficients: dict[float, np.ndarray] = {}

    def _at(self, kT: float) -> np.ndarray:
        if kT not in self._coefficients:
            if len(self._coefficients) > 1:
                self._coefficients.clear()
            self._coefficients[kT] = self.table.coefficients(kT)
        return self._coefficients[kT]

    def _sorted_densities(self, coefficients: np.ndarray) -> np.ndarray:
        """Densities in the order of the pair list."""
        pairs = self.pairs
        rho = np.zeros(len(pairs.order))
        run(
            densities,
            densities_parallel,
            self.table.lucy,
            pairs.types,
            pairs.ntypes,
            coefficients,
            np.take(self._mass, pairs.order),
            *pairs.geometry_arguments,
            rho,
        )
        return rho

    @property
    def densities(self) -> np.ndarray:
        """(N,) local densities at the listed positions; 0 for a bead that takes no part."""
        rho = np.zeros(self._n_beads)
        rho[self.pairs.order] = self._sorted_densities(self._at(0.0))
        return rho

    def forces(self, call: Call) -> Forces:
        """Force form at the listed positions."""
        pairs = self.pairs
        which = call.which if self.table.conservative else call.which & ~CONSERVATIVE
        coefficients = self._at(call.kT)
        force = np.zeros((len(pairs.order), 3))
        rho = self._sorted_densities(coefficients) if which & CONSERVATIVE else np.zeros(0)
        v = np.zeros((0, 3)) if call.velocities is None else np.take(call.velocities, pairs.order, axis=0)
        run(
            many_body_forces,
            many_body_forces_parallel,
            which,
            call.key(self.number),
            call.rsqrt_dt,
            0.5 if self.table.lucy else 0.25,
            pairs.order,
            pairs.types,
            pairs.ntypes,
            coefficients,
            *pairs.geometry_arguments,
            v,
            rho,
            force,
            pairs.energy,
            pairs.virial,
        )
        return Forces(pairs.energy.sum(), pairs.virial.sum(), force)

    def sweep(self, call: Call, v: np.ndarray, flow: np.ndarray | None) -> None:
        """Update the velocities (N, 3) pair by pair, in place."""
        scratch = np.empty((len(self.pairs.order), 3))
        sweep_velocities(self.pairs, call.update, call, self.number, self._at(call.kT), v, scratch)

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy; NaN with the Lucy kernel, whose force has no potential."""
        if not self.has_laplacian:
            return float("nan")
        if not self.table.conservative:
            return 0.0
        pairs, coefficients = self.pairs, self._at(0.0)
        rho = self._sorted_densities(coefficients)
        pi, pj, geometry, factors, columns, _, _, start, found = pairs.geometry_arguments
        return laplacian(pairs.types, pairs.ntypes, coefficients, pairs.inv_mass, rho, pi, pj, geometry, factors, columns, start, found)


@njit(inline="always")
def lucy_weight(r, h):
    """Lucy's kernel, normalised in three dimensions, for r < h."""
    w = 1.0 - r / h
    return 105.0 / (16.0 * np.pi * h**3) * (1.0 + 3.0 * r / h) * w * w * w


@njit(inline="always")
def quadratic_weight(r, h):
    """Warren's kernel, normalised in three dimensions, for r < h."""
    w = 1.0 - r / h
    return 7.5 / (np.pi * h**3) * w * w


def _densities(lucy, types, ntypes, coefficients, mass, pi, pj, geometry, factors, columns, block_start, colour_start, start, found, rho):
    for colour in range(len(colour_start) - 1):
        for block in prange(colour_start[colour], colour_start[colour + 1]):
            for task in range(block_start[block], block_start[block + 1]):
                column = columns[task]
                for n in range(start[column], start[column] + found[column]):
                    i, j, r = pi[n], pj[n], geometry[n, 3]
                    row = 0 if ntypes == 1 else types[i] * ntypes + types[j]
                    h = coefficients[row, CUTOFF_DENSITY]
                    if r >= h:
                        continue
                    if lucy:
                        weight = lucy_weight(r, h)
                        rho[i] += mass[j] * weight
                        rho[j] += mass[i] * weight
                    else:
                        weight = quadratic_weight(r, h)
                        if len(factors):
                            weight *= factors[n]
                        rho[i] += weight
                        rho[j] += weight


densities, densities_parallel = serial_and_parallel(_densities)


def _many_body_forces(
    which,
    key,
    rsqrt_dt,
    share,
    order,
    types,
    ntypes,
    coefficients,
    pi,
    pj,
    geometry,
    factors,
    columns,
    block_start,
    colour_start,
    start,
    found,
    v,
    rho,
    f,
    energy,
    virial,
):
    """``share`` of B cutoff_B (rho_i + rho_j) w_d^2 is the pair's energy: 1/2 with fixed densities, 1/4 for sum pi B h^4 rho_i^2/30."""
    for colour in range(len(colour_start) - 1):
        for block in prange(colour_start[colour], colour_start[colour + 1]):
            for task in range(block_start[block], block_start[block + 1]):
                column = columns[task]
                column_energy, column_virial = 0.0, 0.0
                for n in range(start[column], start[column] + found[column]):
                    i, j = pi[n], pj[n]
                    row = 0 if ntypes == 1 else types[i] * ntypes + types[j]
                    ex, ey, ez, r = geometry[n, 0], geometry[n, 1], geometry[n, 2], geometry[n, 3]
                    factor = factors[n] if len(factors) else 1.0
                    w = 1.0 - r / coefficients[row, CUTOFF]
                    radial = 0.0
                    if which & CONSERVATIVE:
                        radial = factor * coefficients[row, A] * w
                        column_energy += 0.5 * radial * w * coefficients[row, CUTOFF]
                        cutoff_B = coefficients[row, CUTOFF_B]
                        if r < cutoff_B:
                            wd = 1.0 - r / cutoff_B
                            many = factor * coefficients[row, B] * (rho[i] + rho[j]) * wd
                            column_energy += share * many * wd * cutoff_B
                            radial += many
                    if which & DISSIPATIVE:
                        ev = ex * (v[i, 0] - v[j, 0]) + ey * (v[i, 1] - v[j, 1]) + ez * (v[i, 2] - v[j, 2])
                        radial -= factor * coefficients[row, GAMMA] * w * w * ev
                    if which & RANDOM:
                        low, high = min(order[i], order[j]), max(order[i], order[j])
                        radial += np.sqrt(factor) * rsqrt_dt * coefficients[row, SIGMA] * w * normal(pair_key(key, low, high), 0)
                    column_virial += radial * r
                    fx, fy, fz = radial * ex, radial * ey, radial * ez
                    f[i, 0] += fx
                    f[i, 1] += fy
                    f[i, 2] += fz
                    f[j, 0] -= fx
                    f[j, 1] -= fy
                    f[j, 2] -= fz
                energy[column] = column_energy
                virial[column] = column_virial


many_body_forces, many_body_forces_parallel = serial_and_parallel(_many_body_forces)


@compiled
def laplacian(types, ntypes, coefficients, inv_mass, rho, pi, pj, geometry, factors, columns, start, found):
    """Sum over the mobile beads of the Laplacian of the conservative energy, quadratic kernel.

    A pair's attraction gives A/rc - 2 A w/r per mobile bead, as in DPD.  For the sum of c rho^2 with c = pi B h^4/30, a mobile bead i has
    2c [ |grad_i rho_i|^2 + sum over j of (f W')^2 + (rho_i + rho_j) f (W'' + 2 W'/r) ] with W' = -15 w_d/(pi h^4), W'' = 15/(pi h^5); so
    2c W' = -B w_d.
    """
    total, scale = 0.0, 0.0
    # grad_i rho_i = -15/(pi h^4) slope, and scale = 2c (15/(pi h^4))^2
    slope = np.zeros((len(rho), 3))
    for column in columns:
        for n in range(start[column], start[column] + found[column]):
            i, j = pi[n], pj[n]
            row = 0 if ntypes == 1 else types[i] * ntypes + types[j]
            factor = factors[n] if len(factors) else 1.0
            rc, h, r = coefficients[row, CUTOFF], coefficients[row, CUTOFF_B], geometry[n, 3]
            second = factor * coefficients[row, A] * (1.0 / rc - 2.0 * (1.0 - r / rc) / r)
            if r < h:
                wd = 1.0 - r / h
                scale = 15.0 * coefficients[row, B] / (np.pi * h**4)  # the same for all pairs
                second += scale * (factor * wd) ** 2 + factor * coefficients[row, B] * (rho[i] + rho[j]) * (1.0 / h - 2.0 * wd / r)
                for k in range(3):
                    slope[i, k] += factor * wd * geometry[n, k]
                    slope[j, k] -= factor * wd * geometry[n, k]
            total += ((inv_mass[i] > 0.0) + (inv_mass[j] > 0.0)) * second
    for i in range(len(rho)):
        if inv_mass[i] > 0.0:
            total += scale * (slope[i, 0] ** 2 + slope[i, 1] ** 2 + slope[i, 2] ** 2)
    return total
