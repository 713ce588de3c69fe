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
from .columns import Totals, along_flow, approach, change, factor_of, if_sheared, on_velocities, over_pairs, row_of
from .elementary import exp, power
from .forces import CUTOFF, EXPONENT, EXPONENT_PERP, GAMMA, GAMMA_PERP
from .layer import EXACT, SHARDLOW
from .noise import draw, normal
from .pairs import PairList

#: Rows of the scratch of a column.
_LOST, _KICK, _UNUSED, _NOISE = range(4)


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
    """Fill the rows as :func:`_updates` does, for pairs that are all alike: without branches, so that loops are vectorised."""
    c, r = data.coefficients, pairs.geometry[3]
    im = 2.0 * pairs.inv_mass[0]
    cutoff, rate, heat = c[0, CUTOFF], c[0, GAMMA] * im * data.dt, data.kT * im
    part, share = 0.5**data.halvings, 1.0 / im
    if data.update == EXACT:
        for k in range(m):
            w = 1.0 - r[begin + k] / cutoff
            values[_LOST, k] = _decay_below_half(part * (rate * w * w))
        for _ in range(data.halvings):
            for k in range(m):
                values[_LOST, k] *= 2.0 - values[_LOST, k]  # of twice x
    else:
        for k in range(m):
            w = 1.0 - r[begin + k] / cutoff
            values[_LOST, k] = decay(SHARDLOW, rate * w * w)
    for k in range(m):
        lost = values[_LOST, k]
        values[_KICK, k] = np.sqrt(lost * (2.0 - lost) * heat) * values[_NOISE, k] * share
        values[_LOST, k] = lost * share


@helper
def _updates(pairs, data, begin, m, scratch):
    """The impulse of a radial update is KICK - LOST (e.v); 1 - q^2 = lost (2 - lost)."""
    values, c, inv_mass = scratch.values, data.coefficients, pairs.inv_mass
    draw(data.key, pairs, begin, m, scratch)
    if data.plain:
        _plain_updates(pairs, data, begin, m, values)
        return
    for k in range(m):
        n = begin + k
        i, j = pairs.pi[n], pairs.pj[n]
        im = inv_mass[i] + inv_mass[j]
        if im == 0.0:
            values[_LOST, k] = values[_KICK, k] = 0.0
            continue
        row = row_of(pairs, i, j)
        w = power(1.0 - pairs.geometry[3, n] / c[row, CUTOFF], c[row, EXPONENT])
        lost = decay(data.update, factor_of(pairs, n) * c[row, GAMMA] * w * w * im * data.dt)
        values[_KICK, k] = np.sqrt(lost * (2.0 - lost) * data.kT * im) * values[_NOISE, k] / im
        values[_LOST, k] = lost / im


@inlined
def _transverse_impulse(pairs, data, key, n, i, j):
    """Impulse of the transverse update on bead i, with its own g and two noise components; ``key`` is that of the pair."""
    c, g, v, order, inv_mass = data.coefficients, pairs.geometry, data.v, pairs.order, pairs.inv_mass
    im, row = inv_mass[i] + inv_mass[j], row_of(pairs, i, j)
    if im == 0.0 or c[row, GAMMA_PERP] == 0.0:
        return 0.0, 0.0, 0.0
    ex, ey, ez = g[0, n], g[1, n], g[2, n]
    w = power(1.0 - g[3, n] / c[row, CUTOFF], c[row, EXPONENT_PERP])
    lost = decay(data.update, factor_of(pairs, n) * c[row, GAMMA_PERP] * w * w * im * data.dt)
    scale = np.sqrt(lost * (2.0 - lost) * data.kT * im) / im
    if order[i] > order[j]:
        scale = -scale
    lost /= im
    zx, zy, zz = normal(key, 1), normal(key, 2), normal(key, 3)
    along, ev = ex * zx + ey * zy + ez * zz, approach(pairs, v, n, i, j)
    dx = -lost * (along_flow(pairs, n, v[i, 0] - v[j, 0]) - ev * ex) + scale * (zx - along * ex)
    dy = -lost * (v[i, 1] - v[j, 1] - ev * ey) + scale * (zy - along * ey)
    dz = -lost * (v[i, 2] - v[j, 2] - ev * ez) + scale * (zz - along * ez)
    return dx, dy, dz


@inlined
def _central(pairs, data, scratch, n, k, column):
    i, j, g, v = pairs.pi[n], pairs.pj[n], pairs.geometry, data.v
    ex, ey, ez = g[0, n], g[1, n], g[2, n]
    # every number is read once: the processor could not know that they are still the same
    xi, yi, zi, xj, yj, zj = v[i, 0], v[i, 1], v[i, 2], v[j, 0], v[j, 1], v[j, 2]
    lost = scratch.values[_LOST, k] * (ex * along_flow(pairs, n, xi - xj) + ey * (yi - yj) + ez * (zi - zj))
    impulse = scratch.values[_KICK, k] - lost
    di, dj = impulse * pairs.inv_mass[i], impulse * pairs.inv_mass[j]
    v[i, 0], v[i, 1], v[i, 2] = xi + di * ex, yi + di * ey, zi + di * ez
    v[j, 0], v[j, 1], v[j, 2] = xj - dj * ex, yj - dj * ey, zj - dj * ez
    return 0.0, if_sheared(pairs, -lost * g[3, n]), 0.0


@inlined
def _any(pairs, data, scratch, n, k, column):
    i, j, g, v, inv_mass = pairs.pi[n], pairs.pj[n], pairs.geometry, data.v, pairs.inv_mass
    lost = scratch.values[_LOST, k] * approach(pairs, v, n, i, j)
    impulse = scratch.values[_KICK, k] - lost
    tx, ty, tz = _transverse_impulse(pairs, data, scratch.bits[k], n, i, j)
    change(v, i, j, inv_mass[i], inv_mass[j], impulse * g[0, n] + tx, impulse * g[1, n] + ty, impulse * g[2, n] + tz)
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


_central_sweep = over_pairs("central_sweep", _central, _updates, first=gather_velocities, last=scatter_velocities, again=on_velocities)
_any_sweep = over_pairs("any_sweep", _any, _updates, first=gather_velocities, last=scatter_velocities, again=on_velocities)


def sweep(pairs: PairList, terms: Sweep, transverse: bool) -> Totals:
    """Update the velocities; ``transverse`` says whether there are transverse terms.  In a shear the stress tensor is the sum of r times
    the impulses of the friction along the lines between beads, without noise."""
    return (_any_sweep if transverse else _central_sweep)(pairs, terms, isinstance(pairs.flow, np.ndarray))
