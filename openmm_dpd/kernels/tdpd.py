"""The layer of tDPD: isothermal DPD whose beads carry concentrations that diffuse (formulas: :class:`openmm_dpd.model.tdpd.TDPD`).

Per pair, with w = 1 - r/cutoff, w_c = 1 - r/cutoff_c, f the factor of bonded neighbours, and for every species k with p = exponent_c::

    F    = f A w - f gamma w^s (e.v) + sqrt(f) sigma w^(s/2) xi/sqrt(dt),   sigma^2 = 2 kT gamma                          r < cutoff
    dC_i = -kappa_k w_c^p (C_i - C_j) + epsilon_k w_c^(p/2) (C_i + C_j) xi_k/sqrt(dt),   dC_j = -dC_i                     r < cutoff_c

xi_k is clamped to [-5, 5] and belongs to the bead with the lower index.  Fluxes have no factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import prange

from ..errors import RunError
from .compiled import compiled, serial_and_parallel
from .edpd import clamped
from .forces import power
from .layer import CONSERVATIVE, DISSIPATIVE, RANDOM, Call, Forces
from .noise import normal, pair_key
from .threads import run

if TYPE_CHECKING:
    from .engine import PairList, PairSpec

#: Columns of the coefficient table.
A, CUTOFF, GAMMA, EXPONENT, CUTOFF_C = range(5)

#: Streams of the pair's random numbers: that of the motion, and that of the first species.
MOTION, FIRST_SPECIES = range(2)


@dataclass(frozen=True, eq=False)
class SpeciesTable:
    """Coefficients of one layer, as (T, T) symmetric arrays (MD units); ``cutoff`` is the larger of both ranges.

    ``exponent`` is that of the drag; ``kappa``, ``epsilon`` and ``exponent_c`` are (T, T, K).
    """

    A: np.ndarray
    gamma: np.ndarray
    exponent: np.ndarray
    cutoff_F: np.ndarray
    cutoff_c: np.ndarray
    cutoff: np.ndarray
    kappa: np.ndarray
    epsilon: np.ndarray
    exponent_c: np.ndarray

    def layer(self, spec: PairSpec, pairs: PairList, number: int) -> SpeciesLayer:
        """The layer that evaluates these coefficients."""
        return SpeciesLayer(self, spec, pairs, number)


class SpeciesLayer:
    """Evaluates a :class:`SpeciesTable`.  The fields are the concentrations of the species."""

    has_laplacian = True

    def __init__(self, table: SpeciesTable, spec: PairSpec, pairs: PairList, number: int):
        assert spec.fields is not None and spec.fields.n_values == table.kappa.shape[-1]
        self.pairs, self.number = pairs, number
        columns = (table.A, table.cutoff_F, table.gamma, table.exponent, table.cutoff_c)
        self.coefficients = np.column_stack([array.ravel() for array in columns])
        per_species = (table.kappa, table.epsilon, table.exponent_c)
        # (T*T, K, 3): kappa, epsilon and the exponent of the noise weight of each species
        self.exchange = np.stack([array.reshape(-1, array.shape[-1]) for array in per_species], axis=-1)
        self.exchange[..., 2] *= 0.5

    def forces(self, call: Call) -> Forces:
        """Force form at the listed positions; rates (M, K) are dC/dt."""
        pairs, m = self.pairs, len(self.pairs.order)
        v, concentrations = np.zeros((m, 3)), np.zeros((m, self.exchange.shape[1]))
        if call.which & (DISSIPATIVE | RANDOM):
            assert call.scalars is not None and (call.velocities is not None or not call.which & DISSIPATIVE)
            concentrations = np.take(call.scalars, pairs.order, axis=0)
        if call.velocities is not None:
            v = np.take(call.velocities, pairs.order, axis=0)
        force, rates = np.zeros((m, 3)), np.zeros(concentrations.shape)
        run(
            species_forces,
            species_forces_parallel,
            call.which,
            call.kT,
            call.key(self.number),
            call.rsqrt_dt,
            pairs.order,
            pairs.types,
            pairs.ntypes,
            self.coefficients,
            self.exchange,
            *pairs.geometry_arguments,
            v,
            concentrations,
            force,
            rates,
            pairs.energy,
            pairs.virial,
        )
        return Forces(pairs.energy.sum(), pairs.virial.sum(), force, rates)

    def sweep(self, call: Call, v: np.ndarray, flow: np.ndarray | None) -> None:
        """There is no sweep form."""
        raise RunError("TDPD has no pair updates; only the scheme mvv can run it")

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy."""
        pairs = self.pairs
        pi, pj, geometry, factors, columns, _, _, start, found = pairs.geometry_arguments
        return species_laplacian(
            pairs.types, pairs.ntypes, self.coefficients, pairs.inv_mass, pi, pj, geometry, factors, columns, start, found
        )


def _species_forces(
    which, kT, key, rsqrt_dt, order, types, ntypes, coefficients, exchange,
    pi, pj, geometry, factors, columns, block_start, colour_start, start, found, v, c, f, rates, energy, virial,
):  # fmt: skip
    n_species = c.shape[1]
    for colour in range(len(colour_start) - 1):
        for block in prange(colour_start[colour], colour_start[colour + 1]):
            for task in range(block_start[block], block_start[block + 1]):
                column = columns[task]
                column_energy, column_virial = 0.0, 0.0
                for n in range(start[column], start[column] + found[column]):
                    i, j = pi[n], pj[n]
                    row = 0 if ntypes == 1 else types[i] * ntypes + types[j]
                    r = geometry[n, 3]
                    pair = key
                    if which & RANDOM:
                        pair = pair_key(key, min(order[i], order[j]), max(order[i], order[j]))
                    if r < coefficients[row, CUTOFF]:
                        ex, ey, ez = geometry[n, 0], geometry[n, 1], geometry[n, 2]
                        factor = factors[n] if len(factors) else 1.0
                        w = 1.0 - r / coefficients[row, CUTOFF]
                        weight = power(w, 0.5 * coefficients[row, EXPONENT])
                        friction = factor * coefficients[row, GAMMA] * weight * weight
                        radial = 0.0
                        if which & CONSERVATIVE:
                            radial = factor * coefficients[row, A] * w
                            column_energy += 0.5 * radial * w * coefficients[row, CUTOFF]
                        if which & DISSIPATIVE:
                            radial -= friction * (ex * (v[i, 0] - v[j, 0]) + ey * (v[i, 1] - v[j, 1]) + ez * (v[i, 2] - v[j, 2]))
                        if which & RANDOM:
                            radial += np.sqrt(2.0 * kT * friction) * rsqrt_dt * normal(pair, MOTION)
                        column_virial += radial * r
                        f[i, 0] += radial * ex
                        f[i, 1] += radial * ey
                        f[i, 2] += radial * ez
                        f[j, 0] -= radial * ex
                        f[j, 1] -= radial * ey
                        f[j, 2] -= radial * ez
                    if r < coefficients[row, CUTOFF_C] and which & (DISSIPATIVE | RANDOM):
                        w = 1.0 - r / coefficients[row, CUTOFF_C]
                        scale = rsqrt_dt if order[i] < order[j] else -rsqrt_dt
                        for k in range(n_species):
                            weight = power(w, exchange[row, k, 2])
                            flux = 0.0
                            if which & DISSIPATIVE:
                                flux -= exchange[row, k, 0] * weight * weight * (c[i, k] - c[j, k])
                            if which & RANDOM and exchange[row, k, 1] != 0.0:
                                xi = clamped(normal(pair, FIRST_SPECIES + k))
                                flux += exchange[row, k, 1] * weight * (c[i, k] + c[j, k]) * scale * xi
                            rates[i, k] += flux
                            rates[j, k] -= flux
                energy[column] = column_energy
                virial[column] = column_virial


species_forces, species_forces_parallel = serial_and_parallel(_species_forces)


@compiled
def species_laplacian(types, ntypes, coefficients, inv_mass, pi, pj, geometry, factors, columns, start, found):
    """As :func:`.forces.laplacian`, of pairs within the range of the forces: the list may reach further."""
    total = 0.0
    for column in columns:
        for n in range(start[column], start[column] + found[column]):
            i, j = pi[n], pj[n]
            row = 0 if ntypes == 1 else types[i] * ntypes + types[j]
            factor = factors[n] if len(factors) else 1.0
            rc, r = coefficients[row, CUTOFF], geometry[n, 3]
            if r < rc:
                mobile = (inv_mass[i] > 0.0) + (inv_mass[j] > 0.0)
                total += mobile * factor * coefficients[row, A] * (1.0 / rc - 2.0 * (1.0 - r / rc) / r)
    return total
