"""The layer of tDPD: isothermal DPD whose beads have concentrations that diffuse (formulas: :class:`openmm_dpd.model.tdpd.TDPD`).

Per pair, with w = 1 - r/cutoff, w_c = 1 - r/cutoff_c, f the factor of bonded neighbours, and for every species k with p = exponent_c::

    F    = f A w - f gamma w^s (e.v) + sqrt(f) sigma w^(s/2) xi/sqrt(dt),   sigma^2 = 2 kT gamma                          r < cutoff
    dC_i = -kappa_k w_c^p (C_i - C_j) + epsilon_k w_c^(p/2) (C_i + C_j) xi_k/sqrt(dt),   dC_j = -dC_i                     r < cutoff_c

xi_k is clamped to [-5, 5] and belongs to the bead with the lower index.  Fluxes have no factor.

Sweep form, pair by pair, with e = kappa_k w_c^p dt and h = 2, or 1 beside a bead that does not move, whose concentrations stay::

    e.v   as in :mod:`.sweeps`, with gamma w^s
    dC_i  = -(1 - q) (C_i - C_j)/h + (C_i + C_j) sqrt((1 - q^2) V) xi_k,   dC_j = -dC_i,   1 - q = lost,   V = epsilon_k^2/(2 h kappa_k)

with lost of :mod:`.exchange` (b = 1, or 0 of a bead that does not move), which is 1 - exp(-h e) for two beads alone: of two that move,
C_i/(C_i + C_j) then makes the exact Ornstein-Uhlenbeck step of the equation above.  A step beyond 0 is rejected (and xi_k is not clamped),
which leaves the Gaussian of variance V around 1/2, cut off at 0 and 1, invariant for any dt.  Without noise no step goes beyond 0.  A pair
with a negative concentration, which a source can make, has no noise.  docs/theory_energy.md derives it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..runtime import helper, inlined
from . import columns, exchange, forces, sweeps
from .chunks import look_at, look_up_one, powers
from .columns import Motion, deliver_rates, gather_and_clear_rates, over_pairs
from .dpd import SweptLayer
from .layer import DISSIPATIVE, EXACT, RANDOM, Call, Layer, PairSpec, Sums, table_of
from .noise import clamped, draw_directed
from .pairs import ROUNDS, SECOND, PairList, rows

#: Columns of the coefficient table after the eight of :mod:`.forces`: the range of diffusion; for each species kappa, epsilon and the
#: exponent of the noise's weight.
CUTOFF_C, SPECIES = 8, 9
#: Streams of the pair's random numbers: that of the motion is 0.
FIRST_SPECIES = 1
#: Rows of scratch that :mod:`.forces` and :mod:`.sweeps` leave free here; others behind them.
_NOISE, _MOVING, _OTHER = rows(7)[4:]
_KAPPA, _EPSILON, _RANGE, _EXPONENT, _WEIGHT, _AROUND, _BESIDE, _MOTION, _LOST, _SPECIES = rows(30)[20:]


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
    unit_time: float = np.inf  #: (m/kT)^(1/2) times the longest range of diffusion

    def coefficients(self, kT: float) -> np.ndarray:
        """(T*T, 9 + 3 K) table at the thermal energy kT: sigma^2 = 2 kT gamma; noise has half the exponents."""
        zero, species = np.zeros_like(self.A), np.stack([self.kappa, self.epsilon, 0.5 * self.exponent_c], axis=-1)
        of_dpd = self.A, self.cutoff_F, self.gamma, np.sqrt(2.0 * kT * self.gamma), zero, zero, 0.5 * self.exponent, zero
        return table_of(*of_dpd, self.cutoff_c, species.reshape(*zero.shape, -1))

    def layer(self, spec: PairSpec, number: int) -> Layer:
        """The layer that evaluates these coefficients."""
        return SpeciesLayer(self, spec, number)


class SpeciesLayer(SweptLayer):
    """Evaluates a :class:`SpeciesTable`.  The fields are the concentrations of the species."""

    repeats = True

    def __init__(self, table: SpeciesTable, spec: PairSpec, number: int):
        species = table.kappa.shape[-1]
        assert spec.fields is not None and spec.fields.n_values == species
        rate = float(table.kappa.max()) * table.unit_time
        pairs = PairList(spec.types, spec.inv_mass, table.cutoff, spec.exceptions, passes=not exchange.fast(spec, rate))
        super().__init__(table, number, pairs, False, transverse=False)
        self.pairs.rows_of_scratch += 2 * species
        #: whether no pair is listed that does not repel
        self._short = np.array_equal(table.cutoff, table.cutoff_F)
        # scratch, in the order of the pair list
        self._c, self._other = np.zeros((2, len(self.pairs.order), species))
        self._around = exchange.around(self.pairs, spec, rate, table.kappa, table.cutoff_c, table.exponent_c)

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions, written or added to ``out``; rates (N, K) are dC/dt."""
        motion, reactive = self._motion.arrays(call, out, add), call.which & (DISSIPATIVE | RANDOM)
        if self._short and not reactive:
            return Sums(*forces.conservative_forces(self.pairs, forces.Repulsion(self._at(0.0), motion)))
        values = call.field_values if reactive else np.zeros((0, self._c.shape[1]))
        assert values is not None and call.rates is not None and (call.velocities is not None or not call.which & DISSIPATIVE)
        noise, of_beads = (call.key(self.number), call.rsqrt_dt), (values, self._c, self._other, call.rates)
        return Sums(*species_forces(self.pairs, Diffusion(call.which, False, *noise, self._at(call.kT), *of_beads, motion)))

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """Update velocities pair by pair in place, and add to ``increments`` what the concentrations change by."""
        assert call.field_values is not None and increments is not None
        of_beads = call.field_values, increments, self._other, self._c, v, self._motion.v
        noise = call.kT, call.dt, call.key(self.number)
        sums = self._around.sums if self.pairs.spread else self._around.sums[:, :0]
        given = SpeciesExchange(call.update, False, 0, *noise, self._at(call.kT), *of_beads, sums)
        if self.pairs.spread:
            exchange.sum_around(self.pairs, self._around)
            species_sweep(self.pairs, given)
        else:
            slow_species_sweep(self.pairs, given)

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy."""
        return forces.soft_laplacian(self.pairs, self._at(0.0))


class Diffusion(NamedTuple):
    """What the force form reads and writes beside the pairs: concentrations ``values`` (N, K; of length 0 where none are wanted), sorted
    ``c`` (M, K); their ``rates`` (M, K), and ``changing`` (N, K), where these go to."""

    which: int
    plain: bool  #: Never, see :class:`.forces.Terms`
    key: np.uint64
    rsqrt_dt: float
    coefficients: np.ndarray
    values: np.ndarray
    c: np.ndarray
    rates: np.ndarray
    changing: np.ndarray
    motion: Motion


@helper
def _look_at_species(pairs, data, species, begin, m, scratch):
    """Kappa, epsilon and the weight of the noise of a species, 0 beyond the range; and its noise where it has any, which is the result."""
    values, r, noisy, first, table = scratch.values, pairs.geometry[3], False, SPECIES + 3 * species, data.coefficients
    for row in range(len(table)):
        noisy |= table[row, first + 1] != 0.0
    if noisy:
        draw_directed(FIRST_SPECIES + species, m, scratch, _NOISE)
    look_up_one(table, first, pairs, m, scratch, _KAPPA)
    look_up_one(table, first + 1, pairs, m, scratch, _EPSILON)
    look_up_one(table, CUTOFF_C, pairs, m, scratch, _RANGE)
    look_up_one(table, first + 2, pairs, m, scratch, _EXPONENT)
    for k in range(m):
        values[_WEIGHT + k] = 1.0 - r[begin + k] / values[_RANGE + k]
    powers(m, scratch, _WEIGHT, _EXPONENT)
    for k in range(m):
        values[_WEIGHT + k] = values[_WEIGHT + k] if r[begin + k] < values[_RANGE + k] else 0.0
    return noisy


@inlined
def _of_species(species):
    """Where the rows of a species begin: what the difference, and what the sum of the concentrations is multiplied with."""
    return _SPECIES + np.uint64(2 * species) * SECOND


@helper
def _put_species(species, m, values):
    row = _of_species(species)
    for k in range(m):
        values[row + k] = values[_KAPPA + k]
    for k in range(m):
        values[row + SECOND + k] = values[_EPSILON + k]


@helper
def _diffusion_terms(pairs, data, begin, m, scratch):
    """The terms of DPD, and those of each species."""
    values = scratch.values
    forces.radial_terms(pairs, data, begin, m, scratch)
    dissipative = 1.0 if data.which & DISSIPATIVE else 0.0
    for species in range(data.c.shape[1] if data.which & (DISSIPATIVE | RANDOM) else 0):
        noisy = _look_at_species(pairs, data, species, begin, m, scratch) and (data.which & RANDOM) != 0
        for k in range(m):
            w = values[_WEIGHT + k]
            values[_KAPPA + k] *= dissipative * w * w
            values[_EPSILON + k] = values[_EPSILON + k] * w * data.rsqrt_dt * clamped(values[_NOISE + k]) if noisy else 0.0
        _put_species(species, m, values)


@inlined
def _pair_diffusion(pairs, data, scratch, n, k, column):
    i, j, c, rates, values = pairs.pi[n], pairs.pj[n], data.c, data.rates, scratch.values
    for s in range(c.shape[1] if len(data.values) else 0):
        row = _of_species(s) + k
        flux = values[row + SECOND] * (c[i, s] + c[j, s]) - values[row] * (c[i, s] - c[j, s])
        rates[i, s] += flux
        rates[j, s] -= flux
    return forces.central_force(pairs, data, scratch, n, k, column)


@helper
def _gather(pairs, data, begin, end):
    gather_and_clear_rates(pairs, data, begin, end)
    for k in range(begin, end if len(data.values) else begin):
        for s in range(data.c.shape[1]):
            data.c[k, s] = data.values[pairs.seats[k], s]


species_forces = over_pairs("species_forces", _pair_diffusion, _diffusion_terms, first=_gather, last=deliver_rates, again=columns.on_forces)


class SpeciesExchange(NamedTuple):
    """What the sweep form reads and writes beside the pairs: concentrations are ``values`` and ``increments`` (N, K) added up, sorted
    ``before`` and ``c`` (M, K); ``increments``, ``c`` and ``velocities`` (N, 3) are changed; ``sums``: of :class:`.exchange.Around`."""

    update: int
    plain: bool  #: Never, see :class:`.sweeps.Sweep`
    halvings: int
    kT: float
    dt: float
    key: np.uint64
    coefficients: np.ndarray
    values: np.ndarray
    increments: np.ndarray
    before: np.ndarray
    c: np.ndarray
    velocities: np.ndarray
    v: np.ndarray
    sums: np.ndarray


@helper
def _exchange_terms(pairs, data, begin, m, scratch):
    """The updates of DPD, and for each species what the difference and the sum of concentrations are multiplied with."""
    values = scratch.values
    sweeps.updates(pairs, data, begin, m, scratch)
    look_at(pairs.inv_mass, pairs, begin, m, scratch, _MOVING, _OTHER)
    for k in range(m):
        values[_MOTION + k] = values[_MOVING + k] + values[_OTHER + k]
        values[_MOVING + k] = 1.0 if values[_MOVING + k] > 0.0 else 0.0
        values[_OTHER + k] = 1.0 if values[_OTHER + k] > 0.0 else 0.0
    for species in range(data.c.shape[1]):
        noisy = _look_at_species(pairs, data, species, begin, m, scratch)
        for k in range(m):
            w, both = values[_WEIGHT + k], values[_MOVING + k] + values[_OTHER + k]
            values[_KAPPA + k] = values[_LOST + k] = values[_KAPPA + k] * w * w * data.dt * both
            values[_EPSILON + k] *= values[_EPSILON + k] * w * w * data.dt
        if data.sums.shape[1]:
            look_at(data.sums[species], pairs, begin, m, scratch, _AROUND, _BESIDE)
            for k in range(m):
                y, bi, bj = values[_KAPPA + k], values[_MOVING + k], values[_OTHER + k]
                every = exchange.all_of(y / (bi + bj), bi, bj, values[_AROUND + k] * data.dt, values[_BESIDE + k] * data.dt)
                values[_AROUND + k] = values[_LOST + k] = every if y > 0.0 else 0.0
        sweeps.decays(EXACT, m, scratch, _LOST)
        for k in range(m if data.sums.shape[1] else 0):
            every, alike = values[_AROUND + k], values[_MOVING + k] * values[_OTHER + k]
            moving = exchange.drifted(data.kT, values[_MOTION + k], data.dt, values[_RANGE + k])
            values[_LOST + k] = exchange.part_of(values[_KAPPA + k], every, values[_LOST + k], alike, moving) if every > 0.0 else 0.0
        for k in range(m):
            y, lost, both = values[_KAPPA + k], values[_LOST + k], values[_MOVING + k] + values[_OTHER + k]
            # V (1 - q^2), also where kappa is 0
            part = lost * (2.0 - lost) / (2.0 * y) if y > 0.0 else 1.0
            values[_EPSILON + k] = np.sqrt(values[_EPSILON + k] * part) * values[_NOISE + k] if noisy else 0.0
            values[_KAPPA + k] = lost / both if lost > 0.0 else 0.0
        _put_species(species, m, values)


@inlined
def _pair_exchange(pairs, data, scratch, n, k, column):
    i, j, inv_mass, c, values = pairs.pi[n], pairs.pj[n], pairs.inv_mass, data.c, scratch.values
    gives, takes = inv_mass[i] > 0.0, inv_mass[j] > 0.0
    for s in range(c.shape[1]):
        row = _of_species(s) + k
        ci, cj, shaken = c[i, s], c[j, s], values[row + SECOND]
        flow = -values[row] * (ci - cj)
        if shaken != 0.0 and ci >= 0.0 and cj >= 0.0:
            flow += (ci + cj) * shaken
            if (gives and ci + flow < 0.0) or (takes and cj - flow < 0.0):
                flow = 0.0
        if gives:
            c[i, s] = ci + flow
        if takes:
            c[j, s] = cj - flow
    return sweeps.central_update(pairs, data, scratch, n, k, column)


@helper
def _gather_swept(pairs, data, begin, end):
    sweeps.gather_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        i = pairs.seats[k]
        for s in range(data.c.shape[1]):
            data.before[k, s] = data.c[k, s] = data.values[i, s] + data.increments[i, s]


@helper
def _scatter_swept(pairs, data, begin, end):
    sweeps.scatter_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        for s in range(data.c.shape[1]):
            data.increments[pairs.seats[k], s] += data.c[k, s] - data.before[k, s]


species_sweep = over_pairs("species_sweep", _pair_exchange, _exchange_terms, first=_gather_swept, last=_scatter_swept, rounds=ROUNDS)
slow_species_sweep = over_pairs(
    "slow_species_sweep", _pair_exchange, _exchange_terms, first=_gather_swept, last=_scatter_swept, again=columns.on_velocities
)
