"""The layer of tDPD: isothermal DPD whose beads have concentrations that diffuse (formulas: :class:`openmm_dpd.model.tdpd.TDPD`).

Per pair, with w = 1 - r/cutoff, w_c = 1 - r/cutoff_c, f the factor of bonded neighbours, and for every species k with p = exponent_c::

    F    = f A w - f gamma w^s (e.v) + sqrt(f) sigma w^(s/2) xi/sqrt(dt),   sigma^2 = 2 kT gamma                          r < cutoff
    dC_i = -kappa_k w_c^p (C_i - C_j) + epsilon_k w_c^(p/2) (C_i + C_j) xi_k/sqrt(dt),   dC_j = -dC_i                     r < cutoff_c

xi_k is clamped to [-5, 5] and belongs to the bead with the lower index.  Fluxes have no factor.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.errors import RunError
from . import forces
from .columns import approach, deliver, factor_of, gather_and_clear, over_pairs, push_apart, row_of, soft
from .compiled import inlined
from .edpd import clamped
from .elementary import power
from .layer import CONSERVATIVE, DISSIPATIVE, RANDOM, Call, Layer, PairSpec, SortedMotion, Sums, table_of
from .noise import normal, pair_key
from .pairs import PairList

#: Columns of the coefficient table; the first two are those of :mod:`.forces`.
A, CUTOFF, GAMMA, EXPONENT, CUTOFF_C = range(5)
#: Streams of the pair's random numbers: that of the motion, and that of the first species.
MOTION, FIRST_SPECIES = range(2)


@dataclass(frozen=True, eq=False)
class SpeciesTable:
    """Coefficients of one layer, as (T, T) symmetric arrays (MD units); ``cutoff`` is the larger of both ranges.  ``exponent`` is that of
    the drag; ``kappa``, ``epsilon`` and ``exponent_c`` are (T, T, K)."""

    A: np.ndarray
    gamma: np.ndarray
    exponent: np.ndarray
    cutoff_F: np.ndarray
    cutoff_c: np.ndarray
    cutoff: np.ndarray
    kappa: np.ndarray
    epsilon: np.ndarray
    exponent_c: np.ndarray

    def layer(self, spec: PairSpec, number: int) -> Layer:
        """The layer that evaluates these coefficients."""
        return SpeciesLayer(self, spec, number)


class SpeciesLayer:
    """Evaluates a :class:`SpeciesTable`.  The fields are the concentrations of the species."""

    def __init__(self, table: SpeciesTable, spec: PairSpec, number: int):
        assert spec.fields is not None and spec.fields.n_values == table.kappa.shape[-1]
        self.pairs, self.number = PairList(spec.types, spec.inv_mass, table.cutoff, spec.exceptions), number
        self._motion = SortedMotion(len(self.pairs.order))
        self.coefficients = table_of(table.A, table.cutoff_F, table.gamma, table.exponent, table.cutoff_c)
        per_species = (table.kappa, table.epsilon, table.exponent_c)
        # (T*T, K, 3): kappa, epsilon and the exponent of the noise weight of each species
        self.exchange = np.stack([array.reshape(-1, array.shape[-1]) for array in per_species], axis=-1)
        self.exchange[..., 2] *= 0.5

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions, written or added to ``out``; rates (M, K) are dC/dt."""
        pairs, m = self.pairs, len(self.pairs.order)
        concentrations = np.zeros((m, self.exchange.shape[1]))
        if call.which & (DISSIPATIVE | RANDOM):
            assert call.field_values is not None and (call.velocities is not None or not call.which & DISSIPATIVE)
            concentrations = np.take(call.field_values, pairs.order, axis=0)
        rates = np.zeros(concentrations.shape)
        noise = call.key(self.number), call.rsqrt_dt
        of_beads = concentrations, rates, *self._motion.arrays(call, out, add)
        given = Diffusion(call.which, call.kT, *noise, self.coefficients, self.exchange, *of_beads)
        found = species_forces(pairs, given)
        return Sums(found.energy, found.virial, found.drag, rates=rates)

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """There is no sweep form."""
        raise RunError("TDPD has no pair updates; only the scheme mvv can run it")

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy."""
        return forces.soft_laplacian(self.pairs, self.coefficients)


class Diffusion(NamedTuple):
    """What the force form reads and writes beside the pairs; ``c``: (M, K) concentrations; see also :class:`.layer.SortedMotion`."""

    which: int
    kT: float
    key: np.uint64
    rsqrt_dt: float
    coefficients: np.ndarray
    exchange: np.ndarray
    c: np.ndarray
    rates: np.ndarray
    seen: np.ndarray
    v: np.ndarray
    f: np.ndarray
    out: np.ndarray
    add: bool


@inlined
def _pair_diffusion(pairs, data, scratch, n, k, column):
    i, j, order, c, which, rates = pairs.pi[n], pairs.pj[n], pairs.order, data.c, data.which, data.rates
    coefficients, exchange = data.coefficients, data.exchange
    row, r = row_of(pairs, i, j), pairs.geometry[3, n]
    pair, energy, virial, drag = data.key, 0.0, 0.0, 0.0
    if which & RANDOM:
        pair = pair_key(data.key, min(order[i], order[j]), max(order[i], order[j]))
    if r < coefficients[row, CUTOFF]:
        factor = factor_of(pairs, n)
        weight = power(1.0 - r / coefficients[row, CUTOFF], 0.5 * coefficients[row, EXPONENT])
        friction = factor * coefficients[row, GAMMA] * weight * weight
        radial = 0.0
        if which & CONSERVATIVE:
            radial, energy = soft(factor * coefficients[row, A], coefficients[row, CUTOFF], r)
        if which & DISSIPATIVE:
            drag = friction * approach(pairs, data.v, n, i, j)
            radial -= drag
        if which & RANDOM:
            radial += np.sqrt(2.0 * data.kT * friction) * data.rsqrt_dt * normal(pair, MOTION)
        virial = push_apart(pairs, data.f, n, i, j, radial)
    if r < coefficients[row, CUTOFF_C] and which & (DISSIPATIVE | RANDOM):
        w = 1.0 - r / coefficients[row, CUTOFF_C]
        scale = data.rsqrt_dt if order[i] < order[j] else -data.rsqrt_dt
        for s in range(c.shape[1]):
            weight = power(w, exchange[row, s, 2])
            flux = 0.0
            if which & DISSIPATIVE:
                flux -= exchange[row, s, 0] * weight * weight * (c[i, s] - c[j, s])
            if which & RANDOM and exchange[row, s, 1] != 0.0:
                xi = clamped(normal(pair, FIRST_SPECIES + s))
                flux += exchange[row, s, 1] * weight * (c[i, s] + c[j, s]) * scale * xi
            rates[i, s] += flux
            rates[j, s] -= flux
    return energy, virial, -drag * r


species_forces = over_pairs("species_forces", _pair_diffusion, first=gather_and_clear, last=deliver)
