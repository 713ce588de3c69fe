"""Pairs of eDPD: forces and heat, and sweeps (equations: :mod:`.edpd`)."""

from typing import NamedTuple

import numpy as np

from ..runtime import helper, inlined, merged
from . import columns, exchange
from .chunks import look_at, look_up
from .columns import Motion, approach, change, clear, deliver, factor_of, over_pairs, push_apart, row_of
from .elementary import exp, log_of, power
from .energy_updates import exchanged, gained, passes
from .eos import near_log_ratio
from .forces import soft
from .groups import EIGHT
from .layer import CONSERVATIVE, DISSIPATIVE, EXACT, RANDOM
from .noise import clamped, directed, draw, draw_directed, draw_normals, draw_uniforms
from .pairs import ROUNDS, SECOND, rows
from .sweeps import decay, gather_velocities, relaxed, scatter_velocities

#: Columns of the coefficient table; the last two are where four coefficients of a polynomial begin.
A, CUTOFF, GAMMA, EXPONENT, KAPPA, EXPONENT_T, CUTOFF_T, EXPONENT_POLYNOMIAL = range(8)
KAPPA_POLYNOMIAL = EXPONENT_POLYNOMIAL + 4
_COLUMNS = tuple(range(KAPPA_POLYNOMIAL + 4))
#: Streams of the pair's random numbers.
MOTION, HEAT, MOTION_TEST, HEAT_TEST = range(4)
#: Rows of scratch.  What e.v is multiplied with, all else of the force, the energy; of the energy that each bead gets, which is (RUB e.v -
#: SHAKE) e.v - LOSS; what flows to the first bead; ...
_DRAG, _PUSH, _ENERGY, _RUB, _SHAKE, _LOSS, _FLUX, *_BESIDE = rows(32)
_XI, _XI_T, _SIGN, _TI, _TJ, _MI, _MJ, _CI, _CJ, _FACTOR = _BESIDE[:10]
_TABLE, (_LOG, _TEST, _TEST_T, _ALL, _DRIFT, _SUM, _OTHER) = tuple(_BESIDE[10:]), (_PUSH, _ENERGY, _RUB, _SHAKE, _LOSS, _TI, _TJ)
_EV, _SHARE, _ALIKE = _SIGN, _TABLE[A], _FACTOR  # e.v, then the impulse; 1/im; the capacity of both beads, or no number
#: Smallest exponent of the drag.
SMALLEST_EXPONENT = 0.01


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
def _write_down(failed, column, i, j, mean):
    """The first pair whose conductivity is negative."""
    if failed[column, 0] == 0.0:
        failed[column, 0], failed[column, 1], failed[column, 2] = i + 1, j, mean


@inlined
def _look_around(pairs, data, begin, m, scratch):
    """Fill the rows that both forms have in common."""
    look_up(data.coefficients, _COLUMNS, pairs, begin, m, scratch, _FACTOR)
    look_at(pairs.inv_mass, pairs, begin, m, scratch, _MI, _MJ)
    look_at(data.capacity, pairs, begin, m, scratch, _CI, _CJ)


class Heat(NamedTuple):
    """What the force form reads and writes beside the pairs; ``rates``: (M, 1) heat that flows; ``failed``: (columns, 3) of a pair
    whose conduction is negative 1 + the first bead, or 0, the second one, and its temperature; ``changing``: (N, 1) where rates go to."""

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
        values[_XI_T + k], values[_SIGN + k] = 0.0, 1.0
    draw(data.key, pairs, begin, m, scratch, _XI)
    directed(m, scratch, _SIGN)
    if not data.which & RANDOM:
        for k in range(m):
            values[_XI + k] = 0.0
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
        _write_down(data.failed, column, i, j, 0.5 * (values[_TI + k] + values[_TJ + k]))
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


@inlined
def _moved(values, k, update, ti, tj, ai, aj):
    """Relative velocity after an update, energy that each bead gets, Theta."""
    ev, quarter = values[_EV + k], 0.25 * values[_SHARE + k]
    si, sj = ti + ai * (quarter * ev * ev), tj + aj * (quarter * ev * ev)
    rest = 0.5 * si * sj / (si + sj)
    rest = rest if (si > ai * rest) & (sj > aj * rest) else 0.0
    si, sj = si - ai * rest, sj - aj * rest
    theta = 2.0 * si * sj / (si + sj)
    lost = decay(update, values[_DRAG + k] * exp(_exponent_at(values, k, 0.5 * (si + sj)) * values[_LOG + k]))
    new = relaxed(ev, lost, theta * (values[_MI + k] + values[_MJ + k]), values[_XI + k])
    return new, quarter * (ev - new) * (ev + new), theta


@inlined
def _lost(values, k, warmer, mean, alike):
    """The part of a difference that conduction takes away."""
    every = values[_ALL + k] * warmer
    return exchange.part_of(values[_FLUX + k] * warmer, every, decay(EXACT, every), alike, values[_DRIFT + k] * mean)


@helper
def _exchange_terms(pairs, data, begin, m, scratch):
    """What does not depend on velocities and temperatures, and all random numbers."""
    values, r, exact = scratch.values, pairs.geometry[3], data.update == EXACT
    _look_around(pairs, data, begin, m, scratch)
    look_at(data.sums, pairs, begin, m, scratch, _SUM, _OTHER)
    draw(data.key, pairs, begin, m, scratch, _XI)
    draw_directed(HEAT, m, scratch, _XI_T)
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
        values[_SHARE + k], values[_ALIKE + k] = 1.0 / im, ci if exact & (bi == bj) & (bi > 0.0) else np.nan
        values[_DRIFT + k] = exchange.drifted(1.0, im, data.dt, values[_TABLE[CUTOFF_T] + k])
        values[_ALL + k] = exchange.all_of(e, bi, bj, ci * values[_SUM + k] * data.dt, cj * values[_OTHER + k] * data.dt)


@merged
def _pair_exchange(pairs, data, scratch, n, k, column):
    i, j, g, inv_mass, values = pairs.pi[n], pairs.pj[n], pairs.geometry, pairs.inv_mass, scratch.values
    t, v, ai, aj = data.temperature, data.v, data.yielding[i], data.yielding[j]
    if values[_DRAG + k] > 0.0:
        values[_EV + k] = ev = approach(pairs, v, n, i, j)
        new, gain, theta = _moved(values, k, data.update, t[i], t[j], ai, aj)
        ni, nj, step = t[i] + ai * gain, t[j] + aj * gain, (new - ev) * values[_SHARE + k]
        exponent = gained(t[i], ni, gain, ai) + gained(t[j], nj, gain, aj) - 2.0 * gain / theta if min(ni, nj) > 0.0 else -np.inf
        if passes(exponent, values[_TEST + k]):
            change(v, i, j, step * inv_mass[i], step * inv_mass[j], g[0, n], g[1, n], g[2, n])
            t[i], t[j] = ni, nj
    if values[_FLUX + k] > 0.0:
        mean = (aj * t[i] + ai * t[j]) / (ai + aj)
        warmer = _conductivity(values, k, mean)
        if warmer < 0.0:
            _write_down(data.failed, column, i, j, mean)
        elif warmer > 0.0:
            lost = _lost(values, k, warmer, mean, exchange.alike(ai, aj))
            flow = exchanged(lost, mean, t[i], t[j], ai, aj, values[_XI_T + k], values[_TEST_T + k])
            t[i] += ai * flow
            t[j] -= aj * flow
    return 0.0, 0.0, 0.0


@merged
def _group_exchange(pairs, data, scratch, first, count, column):
    """Beads of one capacity, without branches: no numbers where a test is not passed at once, or a temperature changes by a fifth."""
    values, t, v, inv_mass, g = scratch.values, data.temperature, data.v, pairs.inv_mass, pairs.geometry
    end = first + (count + EIGHT - np.uint64(1)) // EIGHT * EIGHT  # eight further; a compiler that knew it would write loops out
    for k in range(first, end):
        i, j = pairs.pi[k], pairs.pj[k]
        values[_EV + k], values[_TI + k], values[_TJ + k] = approach(pairs, v, k, i, j), t[i], t[j]
    for k in range(first, end):
        ev, ti, tj, c, a = values[_EV + k], values[_TI + k], values[_TJ + k], values[_ALIKE + k], 1.0 / values[_ALIKE + k]
        new, gain, theta = _moved(values, k, EXACT, ti, tj, a, a)
        ni, nj = ti + a * gain, tj + a * gain
        passed = values[_TEST + k] < 1.0 + (c * near_log_ratio(ni * nj, ti * tj) - 2.0 * gain / theta)
        values[_TI + k], values[_TJ + k] = ni if passed & (ni > 0.0) else np.nan, nj
        values[_EV + k] = (new - ev) * values[_SHARE + k]
    for k in range(first, end):
        ti, tj, c, a = values[_TI + k], values[_TJ + k], values[_ALIKE + k], 1.0 / values[_ALIKE + k]
        mean = 0.5 * (ti + tj)
        warmer = _conductivity(values, k, mean)
        old, variance = 0.5 * c * (ti - tj), 0.5 * c * mean * mean
        new = relaxed(old, _lost(values, k, warmer, mean, 1.0), variance, values[_XI_T + k])
        flow = new - old
        ni, nj = ti + a * flow, tj - a * flow
        passed = values[_TEST_T + k] < 1.0 + (c * near_log_ratio(ni * nj, ti * tj) + 0.5 * flow * (new + old) / variance)
        values[_TI + k], values[_TJ + k] = ni if passed & (warmer > 0.0) else np.nan, nj
    for k in range(first, first + count):
        i, j, step = pairs.pi[k], pairs.pj[k], values[_EV + k]
        if values[_TI + k] == values[_TI + k]:
            t[i], t[j] = values[_TI + k], values[_TJ + k]
            change(v, i, j, step * inv_mass[i], step * inv_mass[j], g[0, k], g[1, k], g[2, k])
        else:
            _pair_exchange(pairs, data, scratch, k, k, column)


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


_ENDS = {"first": _gather_swept, "last": _scatter_swept, "grouped": True}
thermal_sweep = over_pairs("thermal_sweep", _group_exchange, _exchange_terms, rounds=ROUNDS, **_ENDS)
slow_thermal_sweep = over_pairs("slow_thermal_sweep", _group_exchange, _exchange_terms, **_ENDS)
