"""Sweep form of the pair terms: the relative velocity of each pair is updated in turn at fixed positions.

With im = 1/m_i + 1/m_j, g = f gamma w^(2s) and x = g im dt, a pair exchanges the impulse (on i, radially; the transverse part
likewise with its own g and two noise components)::

    exact     dp = ( -(1 - q) (e.v) + sqrt((1 - q^2) kT im) xi ) / im,   q = exp(-x)            Ornstein-Uhlenbeck
    shardlow  dp = ( -g dt (e.v) + sqrt(2 kT g dt) xi ) / (1 + x/2)                             explicit half + implicit half

Both leave the Maxwell distribution of the pair unchanged for any dt and any gamma, and conserve momentum to rounding.  The second
is the closed form of Shardlow's two halves (Shardlow, SIAM J. Sci. Comput. 24, 1267 (2003), scheme S1, as in LAMMPS's fix shardlow) and
equals the first with q = (1 - x/2)/(1 + x/2).
"""

import math
from typing import NamedTuple

import numpy as np

from ..runtime import helper, inlined
from .chunks import look_at, look_up, look_up_one, powers
from .columns import Totals, along_flow, approach, change, if_sheared, on_velocities, over_pairs
from .elementary import exp
from .forces import CUTOFF, EXPONENT, EXPONENT_PERP, FACTOR, GAMMA, GAMMA_PERP, TABLE, across, draw_across
from .layer import EXACT, SHARDLOW
from .noise import draw
from .pairs import PairList, rows

#: Rows of scratch.
_LOST, _KICK, _NOISE, _ACROSS, _X, _Y, _Z, _ALONG, _MASS, _OTHER = rows(10)


class Sweep(NamedTuple):
    """What the sweep form reads and writes beside the pairs."""

    update: int  #: EXACT or SHARDLOW
    plain: bool  #: Whether all pairs have the same coefficients and masses, the factor 1 and the exponent 1
    halvings: int  # For plain pairs: after so many halvings their x is 0.5 at most
    kT: float
    dt: float
    key: np.uint64  #: Of the noise
    coefficients: np.ndarray  #: (T*T, 8)
    velocities: np.ndarray  #: (N, 3) updated in place
    v: np.ndarray  #: (M, 3) scratch for the sorted velocities


@inlined
def _decay_below_half(x):
    """1 - exp(-x) for x up to 0.5.  It is 2 t/(1 + t) with t = tanh(x/2), whose continued fraction gives all digits here for a third of the
    time."""
    y = 0.5 * x
    y2 = y * y
    above = y * (10395.0 + y2 * (1260.0 + y2 * 21.0))
    return 2.0 * above / (above + 10395.0 + y2 * (4725.0 + y2 * (210.0 + y2)))


@inlined
def decay(update, x):
    """1 - q: the part of a relative velocity that one update with x = g im dt takes away."""
    if update != EXACT:
        return x / (1.0 + 0.5 * x)
    return 1.0 - exp(-x) if x > 0.5 else _decay_below_half(x)


@helper
def decays(update, m, scratch, row):
    """Put :func:`decay` in the place of each x in a row of the values."""
    values, far = scratch.values, np.uint64(0)
    for k in range(m):
        far += np.uint64(values[row + k] > 0.5)
    if update != EXACT:
        for k in range(m):
            values[row + k] = values[row + k] / (1.0 + 0.5 * values[row + k])
    elif far:
        for k in range(m):
            x = values[row + k]
            exact, near = 1.0 - exp(-x), _decay_below_half(x)
            values[row + k] = exact if x > 0.5 else near
    else:  # nearly always, and twice as fast
        for k in range(m):
            values[row + k] = _decay_below_half(values[row + k])


@inlined
def relaxed(old, lost, variance, xi):
    """A number of mean 0 and that variance after an update that takes the part ``lost`` of it away: 1 - q^2 = lost (2 - lost)."""
    return old * (1.0 - lost) + np.sqrt(lost * (2.0 - lost) * variance) * xi


def halvings(update: int, x: float) -> int:
    """How often x has to be halved to be 0.5 at most, if the update has to know."""
    part, exponent = math.frexp(min(x, 1e9))
    return exponent + (part > 0.5) if update == EXACT and x > 0.5 else 0


@helper
def _plain_updates(pairs, data, begin, m, values):
    """Fill the rows as :func:`updates` does, for pairs that are all alike: without branches, so that loops are vectorised."""
    c, r = data.coefficients, pairs.geometry[3]
    im = 2.0 * pairs.inv_mass[0]
    cutoff, rate, heat = c[0, CUTOFF], c[0, GAMMA] * im * data.dt, data.kT * im
    part, share = 0.5**data.halvings, 1.0 / im
    if data.update == EXACT:
        for k in range(m):
            w = 1.0 - r[begin + k] / cutoff
            values[_LOST + k] = _decay_below_half(part * (rate * w * w))
        for _ in range(data.halvings):
            for k in range(m):
                values[_LOST + k] *= 2.0 - values[_LOST + k]  # of twice x
    else:
        for k in range(m):
            w = 1.0 - r[begin + k] / cutoff
            values[_LOST + k] = decay(SHARDLOW, rate * w * w)
    for k in range(m):
        lost = values[_LOST + k]
        values[_KICK + k] = np.sqrt(lost * (2.0 - lost) * heat) * values[_NOISE + k] * share
        values[_LOST + k] = lost * share


@inlined
def _look_up_lost(pairs, data, begin, m, scratch, row, gamma, exponent):
    """Put the part of a relative velocity that an update takes away to a row of the values, with rows of friction and exponent."""
    values, r = scratch.values, pairs.geometry[3]
    for k in range(m):
        values[row + k] = 1.0 - r[begin + k] / values[TABLE[CUTOFF] + k]
    powers(m, scratch, row, exponent)
    for k in range(m):
        w = values[row + k]
        values[row + k] = values[FACTOR + k] * values[gamma + k] * w * w * values[_MASS + k] * data.dt
    decays(data.update, m, scratch, row)


@helper
def updates(pairs, data, begin, m, scratch):
    """The impulse of a radial update is KICK - LOST (e.v); 1 - q^2 = lost (2 - lost)."""
    values = scratch.values
    draw(data.key, pairs, begin, m, scratch, _NOISE)
    if data.plain:
        _plain_updates(pairs, data, begin, m, values)
        return
    look_up(data.coefficients, (CUTOFF, GAMMA, EXPONENT), pairs, begin, m, scratch, FACTOR)
    look_at(pairs.inv_mass, pairs, begin, m, scratch, _MASS, _OTHER)
    for k in range(m):
        values[_MASS + k] += values[_OTHER + k]
    _look_up_lost(pairs, data, begin, m, scratch, _LOST, TABLE[GAMMA], TABLE[EXPONENT])
    for k in range(m):
        lost, im = values[_LOST + k], values[_MASS + k]
        values[_KICK + k] = np.sqrt(lost * (2.0 - lost) * data.kT * im) * values[_NOISE + k] / im if im > 0.0 else 0.0
        values[_LOST + k] = lost / im if im > 0.0 else 0.0


@helper
def _any_updates(pairs, data, begin, m, scratch):
    """Fill the rows as :func:`updates` does, and those of the transverse update, which has a friction and an exponent of its own."""
    values = scratch.values
    updates(pairs, data, begin, m, scratch)
    draw_across(pairs, begin, m, scratch, _X, _Y, _Z, _ALONG)
    for column in (GAMMA_PERP, EXPONENT_PERP):
        look_up_one(data.coefficients, column, pairs, m, scratch, TABLE[column])
    _look_up_lost(pairs, data, begin, m, scratch, _ACROSS, TABLE[GAMMA_PERP], TABLE[EXPONENT_PERP])
    for k in range(m):
        lost, im = values[_ACROSS + k], values[_MASS + k]
        scale = np.sqrt(lost * (2.0 - lost) * data.kT * im) / im if im > 0.0 else 0.0
        values[_X + k] *= scale
        values[_Y + k] *= scale
        values[_Z + k] *= scale
        values[_ACROSS + k] = lost / im if im > 0.0 else 0.0


@inlined
def central_update(pairs, data, scratch, n, k, column):
    i, j, g, v = pairs.pi[n], pairs.pj[n], pairs.geometry, data.v
    ex, ey, ez = g[0, n], g[1, n], g[2, n]
    # every number is read once: the processor could not know that they are still the same
    xi, yi, zi, xj, yj, zj = v[i, 0], v[i, 1], v[i, 2], v[j, 0], v[j, 1], v[j, 2]
    lost = scratch.values[_LOST + k] * (ex * along_flow(pairs, n, xi - xj) + ey * (yi - yj) + ez * (zi - zj))
    impulse = scratch.values[_KICK + k] - lost
    di, dj = impulse * pairs.inv_mass[i], impulse * pairs.inv_mass[j]
    v[i, 0], v[i, 1], v[i, 2] = xi + di * ex, yi + di * ey, zi + di * ez
    v[j, 0], v[j, 1], v[j, 2] = xj - dj * ex, yj - dj * ey, zj - dj * ez
    return 0.0, if_sheared(pairs, -lost * g[3, n]), 0.0


@inlined
def _any(pairs, data, scratch, n, k, column):
    i, j, g, v, inv_mass, values = pairs.pi[n], pairs.pj[n], pairs.geometry, data.v, pairs.inv_mass, scratch.values
    ex, ey, ez, ev = g[0, n], g[1, n], g[2, n], approach(pairs, v, n, i, j)
    lost = values[_LOST + k] * ev
    impulse = values[_KICK + k] - lost
    tx, ty, tz = across(pairs, v, n, i, j, ev, values[_ACROSS + k], values[_X + k], values[_Y + k], values[_Z + k])
    change(v, i, j, inv_mass[i], inv_mass[j], impulse * ex + tx, impulse * ey + ty, impulse * ez + tz)
    return 0.0, if_sheared(pairs, -lost * g[3, n]), 0.0


@inlined
def gather_velocities(pairs, data, begin, end):
    """Sort the velocities (N, 3) into ``v`` (M, 3)."""
    velocities, v, seats = data.velocities, data.v, pairs.seats
    for k in range(begin, end):
        i = seats[k]
        v[k, 0], v[k, 1], v[k, 2] = velocities[i, 0], velocities[i, 1], velocities[i, 2]


@inlined
def scatter_velocities(pairs, data, begin, end):
    """Write them back."""
    velocities, v, seats = data.velocities, data.v, pairs.seats
    for k in range(begin, end):
        i = seats[k]
        velocities[i, 0], velocities[i, 1], velocities[i, 2] = v[k, 0], v[k, 1], v[k, 2]


_central_sweep = over_pairs("central_sweep", central_update, updates, first=gather_velocities, last=scatter_velocities, again=on_velocities)
_any_sweep = over_pairs("any_sweep", _any, _any_updates, first=gather_velocities, last=scatter_velocities, again=on_velocities)


def sweep(pairs: PairList, terms: Sweep, transverse: bool) -> Totals:
    """Update the velocities; ``transverse`` says whether there are transverse terms.  In a shear the stress tensor is the sum of r times
    the impulses of the friction along the lines between beads, without noise."""
    return (_any_sweep if transverse else _central_sweep)(pairs, terms, isinstance(pairs.flow, np.ndarray))
