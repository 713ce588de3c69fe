"""Pairs of energy-conserving DPD: forces and rates, and sweeps (equations: :mod:`.energy`)."""

from typing import NamedTuple

import numpy as np

from ..runtime import helper, inlined, merged
from . import energy_updates, exchange
from .chunks import look_at, look_up
from .columns import Motion, approach, change, deliver_rates, gather_and_clear_rates, on_forces, over_pairs, push_apart
from .eos import near_log_ratio
from .forces import soft
from .groups import EIGHT
from .layer import CONSERVATIVE, DISSIPATIVE, RANDOM
from .noise import draw, draw_directed, draw_uniforms
from .pairs import ROUNDS, rows
from .sweeps import decay, gather_velocities, scatter_velocities
from .templates import renamed

#: Columns of the coefficient table; the first two are those of :mod:`.forces`.
A, CUTOFF, SIGMA, KAPPA = range(4)
#: Streams of the pair's random numbers.
MOTION, HEAT, MOTION_TEST, HEAT_TEST = range(4)
#: Rows of scratch.  Of all forms: noise, 1/m of both beads and their sum, f sigma^2 w^2, kappa w^2, factors, coefficients; then of each.
_XI, _XI_T, _MI, _MJ, _IM, _STRENGTH, _FLUX, _FACTOR, _A, _CUTOFF, _SIGMA, _KAPPA, *_BESIDE = rows(32)
_HERE, _THERE, _PUSH, _ENERGY, _DRAG, _KICK, _LOSS = _BESIDE[:7]
_CI, _CJ, _SUM, _OTHER, _TEST, _TEST_T, _DRIFT, _ALIKE, _EV, _UI, _UJ, _WI, _WJ, _GAIN, _FLOW = _BESIDE[:15]


@helper
def _look_around(pairs, data, begin, m, scratch):
    """Fill the rows of all forms."""
    values, r = scratch.values, pairs.geometry[3]
    look_up(data.coefficients, (A, CUTOFF, SIGMA, KAPPA), pairs, begin, m, scratch, _FACTOR)
    look_at(pairs.inv_mass, pairs, begin, m, scratch, _MI, _MJ)
    draw(data.key, pairs, begin, m, scratch, _XI)
    draw_directed(HEAT, m, scratch, _XI_T)
    for k in range(m):
        w = 1.0 - r[begin + k] / values[_CUTOFF + k]
        amplitude = values[_SIGMA + k] * w
        values[_IM + k] = values[_MI + k] + values[_MJ + k]
        values[_STRENGTH + k], values[_FLUX + k] = values[_FACTOR + k] * (amplitude * amplitude), values[_KAPPA + k] * w * w


class Rates(NamedTuple):
    """What the force form reads (``inverse``: (M,) 1/temperatures) and writes beside the pairs (``rates``: (M, 2), and ``changing``: (N, 2)
    where they go to)."""

    which: int
    key: np.uint64
    rsqrt_dt: float
    coefficients: np.ndarray
    inverse: np.ndarray
    rates: np.ndarray
    changing: np.ndarray
    motion: Motion


@helper
def _rate_terms(pairs, data, begin, m, scratch):
    """All but what depends on velocities."""
    values, r = scratch.values, pairs.geometry[3]
    conservative, dissipative = 1.0 if data.which & CONSERVATIVE else 0.0, 1.0 if data.which & DISSIPATIVE else 0.0
    noisy = data.rsqrt_dt if data.which & RANDOM else 0.0
    _look_around(pairs, data, begin, m, scratch)
    look_at(data.inverse, pairs, begin, m, scratch, _HERE, _THERE)
    for k in range(m):
        here, there, strength, kappa = values[_HERE + k], values[_THERE + k], values[_STRENGTH + k], values[_FLUX + k]
        values[_PUSH + k], values[_ENERGY + k] = soft(
            conservative * values[_FACTOR + k] * values[_A + k], values[_CUTOFF + k], r[begin + k]
        )
        # gamma w^2 = sigma^2 w^2 (1/theta_i + 1/theta_j)/4
        values[_DRAG + k] = dissipative * (0.25 * strength * (here + there))
        values[_LOSS + k] = dissipative * (0.5 * strength * values[_IM + k])
        values[_KICK + k] = np.sqrt(strength) * noisy * values[_XI + k]
        values[_FLUX + k] = dissipative * (kappa * (here - there)) + np.sqrt(2.0 * kappa) * noisy * values[_XI_T + k]


@inlined
def _pair_rates(pairs, data, scratch, n, k, column):
    i, j, values, rates = pairs.pi[n], pairs.pj[n], scratch.values, data.rates
    ev = approach(pairs, data.motion.v, n, i, j)
    drag = values[_DRAG + k] * ev
    heat = 0.5 * (drag * ev - values[_LOSS + k]) - 0.5 * ev * values[_KICK + k]
    rates[i, 0] += values[_FLUX + k]
    rates[j, 0] -= values[_FLUX + k]
    rates[i, 1] += heat
    rates[j, 1] += heat
    virial = push_apart(pairs, data.motion.f, n, i, j, values[_PUSH + k] - drag + values[_KICK + k])
    return values[_ENERGY + k], virial, -drag * pairs.geometry[3, n]


energy_forces = over_pairs("energy_forces", _pair_rates, _rate_terms, first=gather_and_clear_rates, last=deliver_rates, again=on_forces)


class Exchange(NamedTuple):
    """What the sweep form reads and writes beside the pairs.

    Beads where they are, N: ``velocities`` (N, 3) and ``increments`` (N, 2) are changed.  In the order of their numbers: ``capacities`` and
    ``numbers``, equations of state, with the curves ``start``, ``nodes``, ``pieces``; ``immobile``: those whose energies stay.  Sorted, M:
    ``v``, ``u`` and ``frozen`` (internal energies and 1/temperatures before), ``capacity``, ``curve``, ``changes`` (M, 2), and
    ``sums`` of :class:`.exchange.Around`.
    """

    update: int
    dt: float
    key: np.uint64
    coefficients: np.ndarray
    velocities: np.ndarray
    increments: np.ndarray
    capacities: np.ndarray
    numbers: np.ndarray
    start: np.ndarray
    nodes: np.ndarray
    pieces: np.ndarray
    immobile: np.ndarray
    v: np.ndarray
    u: np.ndarray
    frozen: np.ndarray
    capacity: np.ndarray
    curve: np.ndarray
    changes: np.ndarray
    sums: np.ndarray


@helper
def _gather(pairs, data, begin, end):
    order, changes = pairs.order, data.changes
    gather_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        data.capacity[k], data.curve[k] = data.capacities[order[k]], data.numbers[order[k]]
        changes[k, 0] = changes[k, 1] = 0.0


@helper
def _scatter(pairs, data, begin, end):
    order, seats, changes, increments = pairs.order, pairs.seats, data.changes, data.increments
    scatter_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        i, stays = seats[k], data.immobile[order[k]]
        increments[i, 0] = 0.0 if stays else increments[i, 0] + changes[k, 0]
        increments[i, 1] = 0.0 if stays else increments[i, 1] + changes[k, 1]


@inlined
def _give(pairs, data, n, i, j, wi, wj, gain, flow):
    """Change what two beads have: each gets half of what their motion loses, and bead i what bead j gives."""
    u, g, changes = data.u, pairs.geometry, data.changes
    change(data.v, i, j, wi, wj, g[0, n], g[1, n], g[2, n])
    u[i], u[j] = u[i] + gain + flow, u[j] + gain - flow
    changes[i, 1] += gain
    changes[j, 1] += gain
    changes[i, 0] += flow
    changes[j, 0] -= flow


@helper
def _frozen_terms(pairs, data, begin, m, scratch):
    """All but what depends on velocities: temperatures are those of before."""
    values = scratch.values
    _look_around(pairs, data, begin, m, scratch)
    look_at(data.frozen, pairs, begin, m, scratch, _HERE, _THERE)
    for k in range(m):
        im, theta, e = values[_IM + k], 2.0 / (values[_HERE + k] + values[_THERE + k]), values[_FLUX + k] * data.dt
        lost = decay(data.update, 0.5 * values[_STRENGTH + k] / theta * im * data.dt)
        values[_LOSS + k], values[_KICK + k] = lost, np.sqrt(lost * (2.0 - lost) * theta * im) * values[_XI + k]
        values[_FLUX + k] = np.sqrt(2.0 * e) * values[_XI_T + k] + e * (values[_HERE + k] - values[_THERE + k])


@inlined
def _pair_frozen(pairs, data, scratch, n, k, column):
    i, j, values, im = pairs.pi[n], pairs.pj[n], scratch.values, scratch.values[_IM + k]
    if im > 0.0:
        ev = approach(pairs, data.v, n, i, j)
        new = ev * (1.0 - values[_LOSS + k]) + values[_KICK + k]
        gain, step = 0.25 * (ev - new) * (ev + new) / im, new - ev
        _give(pairs, data, n, i, j, step * values[_MI + k] / im, step * values[_MJ + k] / im, gain, values[_FLUX + k])
    return 0.0, 0.0, 0.0


@helper
def _exact_terms(pairs, data, begin, m, scratch):
    """All that does not depend on velocities and energies, and all random numbers."""
    values, dt = scratch.values, data.dt
    _look_around(pairs, data, begin, m, scratch)
    look_at(data.capacity, pairs, begin, m, scratch, _CI, _CJ)
    look_at(data.sums, pairs, begin, m, scratch, _SUM, _OTHER)
    draw_uniforms(MOTION_TEST, m, scratch, _TEST)
    draw_uniforms(HEAT_TEST, m, scratch, _TEST_T)
    for k in range(m):
        im, ci = values[_IM + k], values[_CI + k]
        values[_FLUX + k], values[_SUM + k], values[_OTHER + k] = values[_FLUX + k] * dt, values[_SUM + k] * dt, values[_OTHER + k] * dt
        values[_DRIFT + k] = exchange.drifted(1.0, im, dt, values[_CUTOFF + k])
        values[_ALIKE + k] = ci if (ci == values[_CJ + k]) & (im > 0.0) else np.nan


@inlined
def _given(values, k):
    """What the conduction of a pair depends on beside its energies."""
    return values[_FLUX + k], values[_SUM + k], values[_OTHER + k], values[_DRIFT + k]


# whether all beads have constant heat capacities
_CONSTANTS = False


def _pair_exchange(pairs, data, scratch, n, k, column):
    i, j, u, values, im, strength = pairs.pi[n], pairs.pj[n], data.u, scratch.values, scratch.values[_IM + k], scratch.values[_STRENGTH + k]
    if im == 0.0:
        return 0.0, 0.0, 0.0
    ci, cj = values[_CI + k], values[_CJ + k]
    states, curves = (ci, cj, data.curve[i], data.curve[j]), (data.start, data.nodes, data.pieces)
    ev, gain, flow = approach(pairs, data.v, n, i, j), 0.0, 0.0
    new, xi, drawn = ev, values[_XI + k], values[_TEST + k]
    if strength > 0.0:
        if _CONSTANTS:
            new, gain = energy_updates.motion_of_constants(ev, im, u[i], u[j], ci, cj, strength, data.dt, xi, drawn)
        else:
            new, gain = energy_updates.any_motion(ev, im, u[i], u[j], strength, data.dt, xi, drawn, states, curves)
    if values[_FLUX + k] > 0.0:
        xi, drawn = values[_XI_T + k], values[_TEST_T + k]
        if _CONSTANTS:
            flow = energy_updates.conduction_of_constants(u[i] + gain, u[j] + gain, _given(values, k), xi, drawn, ci, cj)
        else:
            flow = energy_updates.any_conduction(u[i] + gain, u[j] + gain, _given(values, k), xi, drawn, states, curves)
    _give(pairs, data, n, i, j, (new - ev) * values[_MI + k] / im, (new - ev) * values[_MJ + k] / im, gain, flow)
    return 0.0, 0.0, 0.0


_of_any, _of_constants = merged(_pair_exchange), merged(renamed(_pair_exchange, "constants_exchange", {"_CONSTANTS": True}))


@merged
def _group_exchange(pairs, data, scratch, first, count, column):
    """Beads of one heat capacity, without branches: no numbers where a test is not passed at once, or an energy changes by a fifth."""
    values, u = scratch.values, data.u
    end = first + (count + EIGHT - np.uint64(1)) // EIGHT * EIGHT  # eight further; a compiler that knew it would write loops out
    for k in range(first, end):
        i, j = pairs.pi[k], pairs.pj[k]
        values[_EV + k], values[_UI + k], values[_UJ + k] = approach(pairs, data.v, k, i, j), u[i], u[j]
    for k in range(first, end):
        ev, ui, uj, c, im = values[_EV + k], values[_UI + k], values[_UJ + k], values[_ALIKE + k], values[_IM + k]
        new, gain, inverse = energy_updates.moved_constants(ev, im, ui, uj, c, c, values[_STRENGTH + k], data.dt, values[_XI + k])
        ni, nj = ui + gain, uj + gain
        passed = values[_TEST + k] < 1.0 + (c * near_log_ratio(ni * nj, ui * uj) - 2.0 * gain * inverse)
        values[_UI + k], values[_UJ + k], values[_GAIN + k] = ni if passed & (ni > 0.0) else np.nan, nj, gain
        values[_WI + k], values[_WJ + k] = (new - ev) * values[_MI + k] / im, (new - ev) * values[_MJ + k] / im
    for k in range(first, end):
        ui, uj, c = values[_UI + k], values[_UJ + k], values[_ALIKE + k]
        flow, exponent = energy_updates.conducted_by_constants(ui, uj, _given(values, k), values[_XI_T + k], c, c)
        ni, nj = ui + flow, uj - flow
        passed = values[_TEST_T + k] < 1.0 + (c * near_log_ratio(ni * nj, ui * uj) + exponent)
        values[_FLOW + k] = flow if passed & (ni > 0.0) else np.nan
    for k in range(first, first + count):
        if values[_FLOW + k] == values[_FLOW + k]:
            _give(pairs, data, k, pairs.pi[k], pairs.pj[k], values[_WI + k], values[_WJ + k], values[_GAIN + k], values[_FLOW + k])
        else:
            _of_constants(pairs, data, scratch, k, k, column)


_ENDS = {"first": _gather, "last": _scatter}
frozen_sweep = over_pairs("frozen_energy_sweep", _pair_frozen, _frozen_terms, **_ENDS)
#: Exact updates, by whether all beads have constant heat capacities, and whether the list is spread.
EXACT_SWEEPS = {
    (False, True): over_pairs("energy_sweep", _of_any, _exact_terms, rounds=ROUNDS, **_ENDS),
    (False, False): over_pairs("slow_energy_sweep", _of_any, _exact_terms, **_ENDS),
    (True, True): over_pairs("constant_sweep", _group_exchange, _exact_terms, rounds=ROUNDS, grouped=True, **_ENDS),
    (True, False): over_pairs("slow_constant_sweep", _group_exchange, _exact_terms, grouped=True, **_ENDS),
}
