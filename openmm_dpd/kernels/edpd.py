"""The layer of eDPD: DPD whose beads have temperatures and exchange heat (formulas: :class:`openmm_dpd.model.edpd.EDPD`).

Per pair, with T_m = (T_i + T_j)/2, w = 1 - r/cutoff, w_T = 1 - r/cutoff_T, s and k the polynomials at T_m, f the factor of bonded
neighbours, 1/Theta = (1/T_i + 1/T_j)/2, sigma^2 = 2 gamma Theta, K = C_i C_j k T_m^2, im = 1/m_i + 1/m_j (k_B = 1)::

    F       = f A T_m w - f gamma w^s (e.v) + sqrt(f) sigma w^(s/2) xi/sqrt(dt)                                          r < cutoff
    q_visc  = {f w^s [gamma (e.v)^2 - sigma^2 im/2] - sqrt(f) sigma w^(s/2) (e.v) xi/sqrt(dt)}/2  to each of the two     r < cutoff
    q_cond  = K w_T^p (1/T_i - 1/T_j) + sqrt(2 K) w_T^(p/2) xi_T/sqrt(dt)                         to i, minus it to j    r < cutoff_T

xi_T is a number of its own, clamped to [-5, 5], and belongs to the bead with the lower index.  Viscous heat has the factors of the forces,
because it is what they do; conduction has none.  With ``lammps`` heat and factors are those of LAMMPS's code: xi_T is xi, clamped;
q_visc = {w^s [gamma (e.v)^2 - sigma^2/m_i] - sigma w^(s/2) (e.v) xi}/(C_i + C_j) with i the bead of lower index, without a factor; the
noise of the force has f, not sqrt(f); and no heat of either kind flows at r >= min(cutoff, cutoff_T).

Sweep form, pair by pair: motion and temperatures, then conduction.  Each keeps the weight T_i^C_i T_j^C_j of the pair invariant for any dt.
With a = 1/C (0 for a bead that does not move: its temperature stays):

- motion*: the exact Ornstein-Uhlenbeck step (or Shardlow's) of e.v, half of what K = (e.v)^2/(2 im) loses to each bead, and a Metropolis
  test.  Theta and T_m are those of T_i + a_i (K/2 - Theta/4) and the same of j, which depend on what the update keeps, T_i + a_i K/2 and
  T_j + a_j K/2, alone.
- *conduction*: with T = (a_j T_i + a_i T_j)/(a_i + a_j), which the exchange keeps, as T_m, n = (T_i - T_j)/(a_i + a_j) the energy that bead
  i has too much, and b = (a_i - a_j)/T, the exact step of z = 3 [(1 + b n)^(1/3) - 1]/b at the rate k w_T^p (C_i + C_j), with the variance
  T^2/(a_i + a_j), and a Metropolis test.  What it takes away is that of :mod:`.exchange`, with e = C_i C_j k w_T^p dt and b = a.
  In z the weight is Gaussian up to the fourth order, which favours the way to equilibrium: with
  z = n most moves of beads of large and different C would be rejected far from there.  Where C are the same b = 0 and z = n.

docs/theory_energy.md derives it.  Noise is not clamped here: the weight needs all of it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.errors import RunError, bead_names, bead_number, in_number
from ..runtime import helper, inlined, merged
from . import columns, exchange
from .chunks import look_at, look_up
from .columns import Motion, approach, change, clear, deliver, factor_of, over_pairs, push_apart, row_of, soft
from .elementary import exp, log_of, power
from .energy_updates import exchanged, gained, passes
from .fields import NO_INCREMENTS, count_failed, sort_temperatures
from .layer import CONSERVATIVE, DISSIPATIVE, EXACT, RANDOM, Call, Layer, PairSpec, SortedMotion, Sums, table_of
from .noise import clamped, directed, draw, draw_directed, draw_normals, draw_uniforms
from .pairs import ROUNDS, SECOND, PairList, rows
from .sweeps import decay, gather_velocities, relaxed, scatter_velocities

#: Columns of the coefficient table; the last two are where four coefficients of a polynomial begin.
A, CUTOFF, GAMMA, EXPONENT, KAPPA, EXPONENT_T, CUTOFF_T, EXPONENT_POLYNOMIAL = range(8)
KAPPA_POLYNOMIAL = EXPONENT_POLYNOMIAL + 4
#: Streams of the pair's random numbers.
MOTION, HEAT, MOTION_TEST, HEAT_TEST = range(4)
#: Rows of scratch.  What e.v is multiplied with, all else of the force, the energy; of the energy that each bead gets, which is (RUB e.v -
#: SHAKE) e.v - LOSS; what flows to the first bead; ...
_DRAG, _PUSH, _ENERGY, _RUB, _SHAKE, _LOSS, _FLUX, *_BESIDE = rows(32)
_XI, _XI_T, _SIGN, _TI, _TJ, _MI, _MJ, _CI, _CJ, _FACTOR = _BESIDE[:10]
_TABLE, (_LOG, _TEST, _TEST_T, _ALL, _DRIFT, _SUM, _OTHER) = tuple(_BESIDE[10:]), (_PUSH, _ENERGY, _RUB, _SHAKE, _LOSS, _TI, _TJ)
#: Smallest exponent of the drag.
SMALLEST_EXPONENT = 0.01


@dataclass(frozen=True, eq=False)
class ThermalTable:
    """Coefficients of one layer, as (T, T) symmetric arrays, polynomials (T, T, 4) (MD units); ``cutoff`` is the larger of both ranges.
    ``lammps`` says whether heat is computed as LAMMPS's code does."""

    A: np.ndarray
    gamma: np.ndarray
    kappa: np.ndarray
    exponent: np.ndarray
    exponent_T: np.ndarray
    cutoff_F: np.ndarray
    cutoff_T: np.ndarray
    cutoff: np.ndarray
    exponent_polynomial: np.ndarray
    kappa_polynomial: np.ndarray
    lammps: bool = False
    unit_time: float = np.inf  #: (m/kT)^(1/2) times the longest range of conduction

    def coefficients(self) -> np.ndarray:
        """(T*T, 15) table."""
        single = self.A, self.cutoff_F, self.gamma, self.exponent, self.kappa, self.exponent_T, self.cutoff_T
        return table_of(*single, self.exponent_polynomial, self.kappa_polynomial)

    def layer(self, spec: PairSpec, number: int) -> Layer:
        """The layer that evaluates these coefficients."""
        return ThermalLayer(self, spec, number)


class ThermalLayer:
    """Evaluates a :class:`ThermalTable`.  The first column of the fields is the temperature."""

    repeats = True

    def __init__(self, table: ThermalTable, spec: PairSpec, number: int):
        assert spec.fields is not None and spec.fields.capacity is not None
        self.pairs = PairList(spec.types, spec.inv_mass, table.cutoff, spec.exceptions)
        self.number, self.lammps, self.capacity = number, table.lammps, spec.fields.capacity
        self.coefficients, self._motion = table.coefficients(), SortedMotion(self.pairs)
        # scratch, in the order of the pair list, and for each column
        self._before, self._temperature, self._capacity, self._other = np.zeros((4, len(self.pairs.order)))
        rate = float(table.kappa.max() * self.capacity.max()) * table.unit_time
        self._around = exchange.around(self.pairs, spec, rate, table.kappa, table.cutoff_T, table.exponent_T, self._capacity)
        self._failed = np.zeros((0, 2))

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions, written or added to ``out``; rates (N, 1) are dT/dt."""
        # the heat of the noise depends on velocities too
        assert call.rates is not None and (call.velocities is not None or not call.which & (DISSIPATIVE | RANDOM))
        self._begin(call, NO_INCREMENTS)
        noise = call.key(self.number), call.rsqrt_dt
        of_beads = self._capacity, self._temperature, self._other[:, None], self._failed, call.rates
        given = Heat(call.which, self.lammps, *noise, self.coefficients, *of_beads, self._motion.arrays(call, out, add))
        if not call.which & (DISSIPATIVE | RANDOM):
            return Sums(*thermal_repulsion(self.pairs, given))
        found = Sums(*thermal_forces(self.pairs, given))
        self._check_conduction()
        return found

    def _begin(self, call: Call, increments: np.ndarray) -> None:
        """Sort temperatures and heat capacities; RunError if a temperature is not > 0.  No pair has failed yet."""
        assert call.field_values is not None
        if len(self._failed) != len(self.pairs.arrays.found):
            self._failed = np.zeros((len(self.pairs.arrays.found), 2))
        order, found = self.pairs.order, (self._before, self._temperature, self._capacity, self._failed)
        if sort_temperatures(order, self.pairs.arrays.seats, call.field_values, increments, self.capacity, *found):
            bad = np.flatnonzero(~(self._before > 0.0))
            first = bad[order[bad].argmin()]
            raise RunError(
                f"the temperature of bead {bead_number(order[first])} is {in_number(self._before[first], 'thermal_energy')}; it must be > "
                "0 (the step size may be too large, the heat capacity too small for its noise, or a source take what is not there)"
            )

    def _check_conduction(self) -> None:
        if not count_failed(self.pairs.order, self._failed):
            return
        pairs, failed = self.pairs.arrays, self._failed[np.flatnonzero(self._failed[:, 0])[0]]
        n, mean = int(failed[0]) - 1, failed[1]
        i, j = pairs.pi[n], pairs.pj[n]
        row = self.coefficients[pairs.types[i] * pairs.ntypes + pairs.types[j]]
        kappa = row[KAPPA] * float(np.polynomial.polynomial.polyval(mean - 1.0, [1.0, *row[KAPPA_POLYNOMIAL : KAPPA_POLYNOMIAL + 4]]))
        between = bead_names(pairs.order[i], pairs.order[j])
        raise RunError(
            f"the heat conduction coefficient is {kappa:g} at the temperature {in_number(mean, 'thermal_energy')} of {between}; "
            "kappa_polynomial must keep it >= 0 at every temperature of the run"
        )

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """Update velocities pair by pair in place, and add to ``increments`` what the temperatures change by."""
        assert increments is not None
        self._begin(call, increments)
        if self.pairs.spread:
            exchange.sum_around(self.pairs, self._around)
        of_beads = self._capacity, self._other, self._before, self._temperature, self._failed, increments, v, self._motion.v
        sweep = thermal_sweep if self.pairs.spread else slow_thermal_sweep
        sweep(self.pairs, ThermalExchange(call.update, call.dt, call.key(self.number), self.coefficients, *of_beads, self._around.sums[0]))
        self._check_conduction()

    def laplacian(self) -> float:
        """NaN: not defined for forces that depend on temperatures."""
        return np.nan


@inlined
def temperature_factor(values, first, k, y):
    """1 + c1 y + c2 y^2 + c3 y^3 + c4 y^4, with the coefficients of a pair in four rows."""
    second, third, fourth = first + SECOND, first + SECOND + SECOND, first + SECOND + SECOND + SECOND
    return 1.0 + y * (values[first + k] + y * (values[second + k] + y * (values[third + k] + y * values[fourth + k])))


@inlined
def _exponent_at(values, k, mean):
    """s at the mean temperature of a pair."""
    return max(SMALLEST_EXPONENT, values[_TABLE[EXPONENT] + k] * temperature_factor(values, _TABLE[EXPONENT_POLYNOMIAL], k, mean - 1.0))


@inlined
def _conductivity(values, k, mean):
    """k at the mean temperature of a pair over that at the temperature 1."""
    return temperature_factor(values, _TABLE[KAPPA_POLYNOMIAL], k, mean - 1.0)


@inlined
def _write_down(failed, column, n, mean):
    """The first pair whose conductivity is negative."""
    if failed[column, 0] == 0.0:
        failed[column, 0], failed[column, 1] = n + 1, mean


@inlined
def _look_around(pairs, data, begin, m, scratch):
    """Fill the rows that both forms have in common."""
    look_up(data.coefficients, len(_TABLE), pairs, begin, m, scratch, _FACTOR)
    look_at(pairs.inv_mass, pairs, begin, m, scratch, _MI, _MJ)
    look_at(data.capacity, pairs, begin, m, scratch, _CI, _CJ)


class Heat(NamedTuple):
    """What the force form reads and writes beside the pairs; ``rates``: (M, 1) heat that flows; ``failed``: (columns, 2) 1 + the number of
    a pair whose conduction is negative, or 0, and its temperature; ``changing``: (N, 1) where rates go to."""

    which: int
    lammps: bool
    key: np.uint64
    rsqrt_dt: float
    coefficients: np.ndarray
    capacity: np.ndarray
    temperature: np.ndarray
    rates: np.ndarray
    failed: np.ndarray
    changing: np.ndarray
    motion: Motion


@inlined
def _pair_repulsion(pairs, data, scratch, n, k, column):
    i, j, c, t, r = pairs.pi[n], pairs.pj[n], data.coefficients, data.temperature, pairs.geometry[3, n]
    row = row_of(pairs, i, j)
    if r >= c[row, CUTOFF]:
        return 0.0, 0.0, 0.0
    radial, energy = soft(factor_of(pairs, n) * c[row, A] * 0.5 * (t[i] + t[j]), c[row, CUTOFF], r)
    return energy, push_apart(pairs, data.motion.f, n, i, j, radial), 0.0


@helper
def _heat_terms(pairs, data, begin, m, scratch):
    """All but what depends on velocities."""
    values, r, lammps, rsqrt_dt = scratch.values, pairs.geometry[3], data.lammps, data.rsqrt_dt
    conservative, dissipative = 1.0 if data.which & CONSERVATIVE else 0.0, 1.0 if data.which & DISSIPATIVE else 0.0
    _look_around(pairs, data, begin, m, scratch)
    look_at(data.temperature, pairs, begin, m, scratch, _TI, _TJ)
    for k in range(m):
        values[_XI + k], values[_XI_T + k], values[_SIGN + k] = 0.0, 0.0, 1.0
    directed(pairs, begin, m, scratch, _SIGN)
    if data.which & RANDOM:
        draw(data.key, pairs, begin, m, scratch, _XI)
    if data.which & RANDOM and not lammps:
        draw_normals(HEAT, m, scratch, _XI_T)
    for k in range(m):
        ti, tj, cutoff, factor = values[_TI + k], values[_TJ + k], values[_TABLE[CUTOFF] + k], values[_FACTOR + k]
        mean, w = 0.5 * (ti + tj), max(0.0, 1.0 - r[begin + k] / cutoff)
        weight = power(w, 0.5 * _exponent_at(values, k, mean))
        friction = values[_TABLE[GAMMA] + k] * weight * weight
        strength = 4.0 * friction * ti * tj / (ti + tj)
        force = conservative * factor * values[_TABLE[A] + k] * mean * w
        kick = np.sqrt(strength) * values[_XI + k]
        if lammps:
            # LAMMPS puts f on the noise of the forces too, and none on the heat, of which there is none beyond the range of conduction
            share = 1.0 / (values[_CI + k] + values[_CJ + k]) if r[begin + k] < values[_TABLE[CUTOFF_T] + k] else 0.0
            loss, push, shaken = values[_MI + k] if values[_SIGN + k] > 0.0 else values[_MJ + k], factor, share
        else:
            share = 0.5 * factor
            loss, push, shaken = 0.5 * (values[_MI + k] + values[_MJ + k]), np.sqrt(factor), 0.5 * np.sqrt(factor) * rsqrt_dt
        values[_DRAG + k] = dissipative * factor * friction
        values[_PUSH + k] = force + push * kick * rsqrt_dt
        values[_ENERGY + k] = 0.5 * force * w * cutoff
        values[_RUB + k] = dissipative * share * friction
        values[_SHAKE + k] = shaken * kick
        values[_LOSS + k] = dissipative * share * loss * strength
    for k in range(m):
        ti, tj, cutoff = values[_TI + k], values[_TJ + k], values[_TABLE[CUTOFF_T] + k]
        if lammps:
            cutoff = min(cutoff, values[_TABLE[CUTOFF] + k])
        mean, w = 0.5 * (ti + tj), max(0.0, 1.0 - r[begin + k] / values[_TABLE[CUTOFF_T] + k])
        weight = mean * power(w, 0.5 * values[_TABLE[EXPONENT_T] + k])
        kappa = values[_TABLE[KAPPA] + k] * _conductivity(values, k, mean)
        strength = kappa * (values[_CI + k] * values[_CJ + k]) * (weight * weight)
        xi = values[_SIGN + k] * clamped(values[_XI + k] if lammps else values[_XI_T + k])
        flux = dissipative * strength * (1.0 / ti - 1.0 / tj) + np.sqrt(2.0 * strength) * rsqrt_dt * xi
        flux = np.nan if kappa < 0.0 else flux
        values[_FLUX + k] = flux if r[begin + k] < cutoff else 0.0


@inlined
def _pair_heat(pairs, data, scratch, n, k, column):
    i, j, values, rates, flux = pairs.pi[n], pairs.pj[n], scratch.values, data.rates, scratch.values[_FLUX + k]
    if flux != flux:
        _write_down(data.failed, column, n, 0.5 * (values[_TI + k] + values[_TJ + k]))
    ev = approach(pairs, data.motion.v, n, i, j)
    drag, gain = values[_DRAG + k] * ev, (values[_RUB + k] * ev - values[_SHAKE + k]) * ev - values[_LOSS + k]
    rates[i, 0] += gain + flux
    rates[j, 0] += gain - flux
    return values[_ENERGY + k], push_apart(pairs, data.motion.f, n, i, j, values[_PUSH + k] - drag), -drag * pairs.geometry[3, n]


@helper
def _deliver(pairs, data, begin, end):
    deliver(pairs, data, begin, end)
    for k in range(begin, end):
        data.changing[pairs.seats[k], 0] += data.rates[k, 0] / data.capacity[k]


thermal_repulsion = over_pairs("thermal_repulsion", _pair_repulsion, first=clear, last=deliver)
thermal_forces = over_pairs("thermal_forces", _pair_heat, _heat_terms, first=columns.gather_and_clear_rates, last=_deliver)


class ThermalExchange(NamedTuple):
    """What the sweep form reads and writes beside the pairs: ``velocities`` (N, 3) and ``increments`` (N, 1) are changed; sorted, M:
    ``capacity``, ``yielding`` (1/capacity, 0 where the temperature stays), temperatures ``before`` and ``temperature``, which is changed;
    ``failed`` as in :class:`Heat`; ``sums``: of :class:`.exchange.Around`."""

    update: int
    dt: float
    key: np.uint64
    coefficients: np.ndarray
    capacity: np.ndarray
    yielding: np.ndarray
    before: np.ndarray
    temperature: np.ndarray
    failed: np.ndarray
    increments: np.ndarray
    velocities: np.ndarray
    v: np.ndarray
    sums: np.ndarray


@merged
def _rubbed(values, k, update, ev, im, ti, tj, ai, aj):
    """(Relative velocity after an update, energy that each bead gets); the old velocity and 0 if the move is rejected."""
    quarter = 0.25 / im
    half = quarter * ev * ev
    si, sj = ti + ai * half, tj + aj * half
    rest = 0.5 * si * sj / (si + sj)
    if si > ai * rest and sj > aj * rest:
        si, sj = si - ai * rest, sj - aj * rest
    theta, xi, drawn = 2.0 * si * sj / (si + sj), values[_XI + k], values[_TEST + k]
    lost = decay(update, values[_DRAG + k] * exp(_exponent_at(values, k, 0.5 * (si + sj)) * values[_LOG + k]))
    new = relaxed(ev, lost, theta * im, xi)
    gain = quarter * (ev - new) * (ev + new)
    ni, nj = ti + ai * gain, tj + aj * gain
    if not (ni > 0.0 and nj > 0.0):
        return ev, 0.0
    exponent = gained(ti, ni, gain, ai) + gained(tj, nj, gain, aj) - 2.0 * gain / theta
    return (new, gain) if passes(exponent, drawn) else (ev, 0.0)


@helper
def _exchange_terms(pairs, data, begin, m, scratch):
    """What does not depend on velocities and temperatures, and all random numbers."""
    values, r = scratch.values, pairs.geometry[3]
    _look_around(pairs, data, begin, m, scratch)
    look_at(data.sums, pairs, begin, m, scratch, _SUM, _OTHER)
    draw(data.key, pairs, begin, m, scratch, _XI)
    draw_directed(HEAT, pairs, begin, m, scratch, _XI_T)
    draw_uniforms(MOTION_TEST, m, scratch, _TEST)
    draw_uniforms(HEAT_TEST, m, scratch, _TEST_T)
    for k in range(m):
        im, near = values[_MI + k] + values[_MJ + k], r[begin + k] < values[_TABLE[CUTOFF] + k]
        w = 1.0 - r[begin + k] / values[_TABLE[CUTOFF] + k]
        values[_LOG + k] = log_of(w if near else 1.0, 0.0)
        values[_DRAG + k] = values[_FACTOR + k] * values[_TABLE[GAMMA] + k] * im * data.dt if near else 0.0
        near, ci, cj = r[begin + k] < values[_TABLE[CUTOFF_T] + k], values[_CI + k], values[_CJ + k]
        w = power(1.0 - r[begin + k] / values[_TABLE[CUTOFF_T] + k], values[_TABLE[EXPONENT_T] + k])
        e, bi, bj = values[_TABLE[KAPPA] + k] * w * ci * cj * data.dt, 1.0 / ci, 1.0 / cj
        bi, bj = bi if values[_MI + k] > 0.0 else 0.0, bj if values[_MJ + k] > 0.0 else 0.0
        values[_FLUX + k] = e * (bi + bj) if near else 0.0
        values[_DRIFT + k] = exchange.drifted(1.0, im, data.dt, values[_TABLE[CUTOFF_T] + k])
        values[_ALL + k] = exchange.all_of(e, bi, bj, ci * values[_SUM + k] * data.dt, cj * values[_OTHER + k] * data.dt)


@merged
def _pair_exchange(pairs, data, scratch, n, k, column):
    i, j, g, inv_mass, values = pairs.pi[n], pairs.pj[n], pairs.geometry, pairs.inv_mass, scratch.values
    t, v, ai, aj = data.temperature, data.v, data.yielding[i], data.yielding[j]
    if values[_DRAG + k] > 0.0:
        im, ev = inv_mass[i] + inv_mass[j], approach(pairs, v, n, i, j)
        new, gain = _rubbed(values, k, data.update, ev, im, t[i], t[j], ai, aj)
        change(v, i, j, (new - ev) * inv_mass[i] / im, (new - ev) * inv_mass[j] / im, g[0, n], g[1, n], g[2, n])
        t[i] += ai * gain
        t[j] += aj * gain
    if values[_FLUX + k] > 0.0:
        mean = (aj * t[i] + ai * t[j]) / (ai + aj)
        warmer = _conductivity(values, k, mean)
        if warmer < 0.0:
            _write_down(data.failed, column, n, mean)
        elif warmer > 0.0:
            every, alike, moving = values[_ALL + k] * warmer, exchange.alike(ai, aj), values[_DRIFT + k] * mean
            lost = exchange.part_of(values[_FLUX + k] * warmer, every, decay(EXACT, every), alike, moving)
            flow = exchanged(lost, mean, t[i], t[j], ai, aj, values[_XI_T + k], values[_TEST_T + k])
            t[i] += ai * flow
            t[j] -= aj * flow
    return 0.0, 0.0, 0.0


@helper
def _gather_swept(pairs, data, begin, end):
    gather_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        data.yielding[k] = 1.0 / data.capacity[k] if pairs.inv_mass[k] > 0.0 else 0.0


@helper
def _scatter_swept(pairs, data, begin, end):
    scatter_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        data.increments[pairs.seats[k], 0] += data.temperature[k] - data.before[k]


thermal_sweep = over_pairs("thermal_sweep", _pair_exchange, _exchange_terms, first=_gather_swept, last=_scatter_swept, rounds=ROUNDS)
slow_thermal_sweep = over_pairs("slow_thermal_sweep", _pair_exchange, _exchange_terms, first=_gather_swept, last=_scatter_swept)
