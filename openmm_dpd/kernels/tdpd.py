"""The layer of tDPD: isothermal DPD whose beads have concentrations that diffuse (formulas: :class:`openmm_dpd.model.tdpd.TDPD`).

Per pair, with w = 1 - r/cutoff, w_c = 1 - r/cutoff_c, f the factor of bonded neighbours, and for every species k with p = exponent_c::

    F    = f A w - f gamma w^s (e.v) + sqrt(f) sigma w^(s/2) xi/sqrt(dt),   sigma^2 = 2 kT gamma                          r < cutoff
    dC_i = -kappa_k w_c^p (C_i - C_j) + epsilon_k w_c^(p/2) (C_i + C_j) xi_k/sqrt(dt),   dC_j = -dC_i                     r < cutoff_c

xi_k is clamped to [-5, 5] and belongs to the bead with the lower index.  Fluxes have no factor.

Sweep form, pair by pair, with x = kappa_k w_c^p dt and h = 2, or 1 beside a bead that does not move, whose concentrations stay::

    e.v   as in :mod:`.sweeps`, with gamma w^s
    dC_i  = -(1 - q) (C_i - C_j)/h + (C_i + C_j) sqrt((1 - q^2) V) xi_k,   dC_j = -dC_i,   q = exp(-h x),   V = epsilon_k^2/(2 h kappa_k)

Of two beads that move, C_i/(C_i + C_j) makes the exact Ornstein-Uhlenbeck step of the equation above.  A step beyond 0 is rejected (and
xi_k is not clamped), which leaves the Gaussian of variance V around 1/2, cut off at 0 and 1, invariant for any dt.  Without noise no step
goes beyond 0.  A pair with a negative concentration, which a source can make, has no noise.  docs/theory_energy.md derives it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..runtime import helper, inlined, merged
from . import columns, forces
from .columns import Motion, approach, change, deliver_rates, factor_of, gather_and_clear_rates, over_pairs, push_apart, row_of, soft
from .elementary import power
from .layer import CONSERVATIVE, DISSIPATIVE, EXACT, RANDOM, Call, Layer, PairSpec, SortedMotion, Sums, table_of
from .noise import clamped, normal, pair_key
from .pairs import PairList
from .sweeps import decay, gather_velocities, relaxed, scatter_velocities

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

    repeats = True

    def __init__(self, table: SpeciesTable, spec: PairSpec, number: int):
        assert spec.fields is not None and spec.fields.n_values == table.kappa.shape[-1]
        self.pairs, self.number = PairList(spec.types, spec.inv_mass, table.cutoff, spec.exceptions, passes=True), number
        self._motion = SortedMotion(self.pairs)
        self.coefficients = table_of(table.A, table.cutoff_F, table.gamma, table.exponent, table.cutoff_c)
        #: whether no pair is listed that does not repel
        self._short = np.array_equal(table.cutoff, table.cutoff_F)
        per_species = (table.kappa, table.epsilon, table.exponent_c)
        # (T*T, K, 3): kappa, epsilon and the exponent of the noise weight of each species
        self.exchange = np.stack([array.reshape(-1, array.shape[-1]) for array in per_species], axis=-1)
        self.exchange[..., 2] *= 0.5
        # scratch, in the order of the pair list
        self._c, self._other = np.zeros((2, len(self.pairs.order), spec.fields.n_values))

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions, written or added to ``out``; rates (N, K) are dC/dt."""
        motion, reactive = self._motion.arrays(call, out, add), call.which & (DISSIPATIVE | RANDOM)
        if self._short and not reactive:
            return Sums(*forces.conservative_forces(self.pairs, forces.Repulsion(self.coefficients, motion)))
        values = call.field_values if reactive else np.zeros((0, self._c.shape[1]))
        assert values is not None and call.rates is not None and (call.velocities is not None or not call.which & DISSIPATIVE)
        noise = call.key(self.number), call.rsqrt_dt
        tables, of_beads = (self.coefficients, self.exchange), (values, self._c, self._other, call.rates)
        return Sums(*species_forces(self.pairs, Diffusion(call.which, call.kT, *noise, *tables, *of_beads, motion)))

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """Update velocities pair by pair in place, and add to ``increments`` what the concentrations change by."""
        assert call.field_values is not None and increments is not None
        of_beads = call.field_values, increments, self._other, self._c, v, self._motion.v
        given = SpeciesExchange(call.update, call.kT, call.dt, call.key(self.number), self.coefficients, self.exchange, *of_beads)
        species_sweep(self.pairs, given)

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy."""
        return forces.soft_laplacian(self.pairs, self.coefficients)


class Diffusion(NamedTuple):
    """What the force form reads and writes beside the pairs: concentrations ``values`` (N, K; of length 0 where none are wanted), sorted
    ``c`` (M, K); their ``rates`` (M, K), and ``changing`` (N, K), where these go to."""

    which: int
    kT: float
    key: np.uint64
    rsqrt_dt: float
    coefficients: np.ndarray
    exchange: np.ndarray
    values: np.ndarray
    c: np.ndarray
    rates: np.ndarray
    changing: np.ndarray
    motion: Motion


@inlined
def _friction_at(coefficients, row, r, factor):
    """f gamma w^s."""
    weight = power(1.0 - r / coefficients[row, CUTOFF], 0.5 * coefficients[row, EXPONENT])
    return factor * coefficients[row, GAMMA] * weight * weight


@inlined
def _pair_diffusion(pairs, data, scratch, n, k, column):
    i, j, order, c, which, rates = pairs.pi[n], pairs.pj[n], pairs.order, data.c, data.which, data.rates
    coefficients, exchange = data.coefficients, data.exchange
    row, r = row_of(pairs, i, j), pairs.geometry[3, n]
    pair, energy, virial, drag = data.key, 0.0, 0.0, 0.0
    if which & RANDOM:
        pair = pair_key(data.key, order[i], order[j])
    if r < coefficients[row, CUTOFF]:
        factor = factor_of(pairs, n)
        friction = _friction_at(coefficients, row, r, factor)
        radial = 0.0
        if which & CONSERVATIVE:
            radial, energy = soft(factor * coefficients[row, A], coefficients[row, CUTOFF], r)
        if which & DISSIPATIVE:
            drag = friction * approach(pairs, data.motion.v, n, i, j)
            radial -= drag
        if which & RANDOM:
            radial += np.sqrt(2.0 * data.kT * friction) * data.rsqrt_dt * normal(pair, MOTION)
        virial = push_apart(pairs, data.motion.f, n, i, j, radial)
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


@helper
def _gather(pairs, data, begin, end):
    gather_and_clear_rates(pairs, data, begin, end)
    for k in range(begin, end if len(data.values) else begin):
        for s in range(data.c.shape[1]):
            data.c[k, s] = data.values[pairs.seats[k], s]


species_forces = over_pairs("species_forces", _pair_diffusion, first=_gather, last=deliver_rates, again=columns.on_forces)


class SpeciesExchange(NamedTuple):
    """What the sweep form reads and writes beside the pairs: concentrations are ``values`` and ``increments`` (N, K) added up, sorted
    ``before`` and ``c`` (M, K); ``increments``, ``c`` and ``velocities`` (N, 3) are changed."""

    update: int
    kT: float
    dt: float
    key: np.uint64
    coefficients: np.ndarray
    exchange: np.ndarray
    values: np.ndarray
    increments: np.ndarray
    before: np.ndarray
    c: np.ndarray
    velocities: np.ndarray
    v: np.ndarray


@merged
def _exchanged(ci, cj, x, both, spread, xi):
    """What goes to bead i, which moves, from bead j; ``both`` is whether that moves, ``spread`` epsilon^2 w^p dt."""
    h = 2.0 if both else 1.0
    lost = decay(EXACT, h * x)
    flow = -lost * (ci - cj) / h
    if spread > 0.0 and ci >= 0.0 and cj >= 0.0:
        # V (1 - q^2), also where kappa is 0
        part = lost * (2.0 - lost) / (2.0 * h * x) if x > 0.0 else 1.0
        flow += (ci + cj) * np.sqrt(spread * part) * xi
        if not (ci + flow >= 0.0 and (cj - flow >= 0.0 or not both)):
            return 0.0
    return flow


@merged
def _pair_exchange(pairs, data, scratch, n, k, column):
    i, j, order, g, inv_mass, c, v = pairs.pi[n], pairs.pj[n], pairs.order, pairs.geometry, pairs.inv_mass, data.c, data.v
    coefficients, exchange, wi, wj = data.coefficients, data.exchange, inv_mass[i], inv_mass[j]
    im, row, r = wi + wj, row_of(pairs, i, j), g[3, n]
    if im == 0.0:
        return 0.0, 0.0, 0.0
    pair = pair_key(data.key, order[i], order[j])
    if r < coefficients[row, CUTOFF]:
        ev = approach(pairs, v, n, i, j)
        lost = decay(data.update, _friction_at(coefficients, row, r, factor_of(pairs, n)) * im * data.dt)
        impulse = (relaxed(ev, lost, data.kT * im, normal(pair, MOTION)) - ev) / im
        change(v, i, j, wi, wj, impulse * g[0, n], impulse * g[1, n], impulse * g[2, n])
    if r < coefficients[row, CUTOFF_C]:
        w = 1.0 - r / coefficients[row, CUTOFF_C]
        both = wi > 0.0 and wj > 0.0
        mine, other = (i, j) if wi > 0.0 else (j, i)
        sign = 1.0 if order[mine] < order[other] else -1.0
        for s in range(c.shape[1]):
            weight = power(w, exchange[row, s, 2])
            x, spread = exchange[row, s, 0] * weight * weight * data.dt, (exchange[row, s, 1] * weight) ** 2 * data.dt
            xi = sign * normal(pair, FIRST_SPECIES + s) if spread > 0.0 else 0.0
            flow = _exchanged(c[mine, s], c[other, s], x, both, spread, xi)
            c[mine, s] += flow
            if both:
                c[other, s] -= flow
    return 0.0, 0.0, 0.0


@helper
def _gather_swept(pairs, data, begin, end):
    gather_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        i = pairs.seats[k]
        for s in range(data.c.shape[1]):
            data.before[k, s] = data.c[k, s] = data.values[i, s] + data.increments[i, s]


@helper
def _scatter_swept(pairs, data, begin, end):
    scatter_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        for s in range(data.c.shape[1]):
            data.increments[pairs.seats[k], s] += data.c[k, s] - data.before[k, s]


species_sweep = over_pairs("species_sweep", _pair_exchange, first=_gather_swept, last=_scatter_swept, again=columns.on_velocities)
