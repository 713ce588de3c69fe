"""Sweep form of the pair terms: the relative velocity of each pair is updated in turn at fixed positions.

With im = 1/m_i + 1/m_j, g = f gamma w^(2s) and x = g im dt, a pair exchanges the impulse (on i, radially; the transverse part
likewise with its own g and two noise components)::

    exact     dp = ( -(1 - q) (e.v) + sqrt((1 - q^2) kT im) xi ) / im,   q = exp(-x)            Ornstein-Uhlenbeck
    shardlow  dp = ( -g dt (e.v) + sqrt(2 kT g dt) xi ) / (1 + x/2)                             explicit half + implicit half

Both leave the Maxwell distribution of the pair unchanged for any dt and any gamma, and conserve momentum to rounding.  The second
is the closed form of Shardlow's two halves (Shardlow, SIAM J. Sci. Comput. 24, 1267 (2003), scheme S1, as in LAMMPS's fix shardlow) and
equals the first with q = (1 - x/2)/(1 + x/2).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from .compiled import serial_and_parallel
from .forces import CUTOFF, EXPONENT, EXPONENT_PERP, GAMMA, GAMMA_PERP, power
from .noise import normal, pair_key

#: The two pair updates.
EXACT, SHARDLOW = 0, 1


@njit(inline="always")
def decay(update, x):
    """1 - q: the part of a relative velocity that one update with x = g im dt takes away."""
    if update != EXACT:
        return x / (1.0 + 0.5 * x)
    if x > 0.5:
        return -np.expm1(-x)
    # 1 - exp(-x) = 2 t/(1 + t) with t = tanh(x/2), whose continued fraction gives all digits here for a third of the time
    y = 0.5 * x
    y2 = y * y
    above = y * (10395.0 + y2 * (1260.0 + y2 * 21.0))
    return 2.0 * above / (above + 10395.0 + y2 * (4725.0 + y2 * (210.0 + y2)))


def _sweep(
    update,
    kT,
    dt,
    key,
    order,
    types,
    ntypes,
    coefficients,
    inv_mass,
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
):
    for colour in range(len(colour_start) - 1):
        for block in prange(colour_start[colour], colour_start[colour + 1]):
            for task in range(block_start[block], block_start[block + 1]):
                column = columns[task]
                for n in range(start[column], start[column] + found[column]):
                    i, j = pi[n], pj[n]
                    im = inv_mass[i] + inv_mass[j]
                    if im == 0.0:
                        continue
                    row = 0 if ntypes == 1 else types[i] * ntypes + types[j]
                    ex, ey, ez = geometry[n, 0], geometry[n, 1], geometry[n, 2]
                    factor = factors[n] if len(factors) else 1.0
                    w = 1.0 - geometry[n, 3] / coefficients[row, CUTOFF]
                    vx, vy, vz = v[i, 0] - v[j, 0], v[i, 1] - v[j, 1], v[i, 2] - v[j, 2]
                    ev = ex * vx + ey * vy + ez * vz
                    low, high = min(order[i], order[j]), max(order[i], order[j])
                    pair = pair_key(key, low, high)
                    wr = power(w, coefficients[row, EXPONENT])
                    lost = decay(update, factor * coefficients[row, GAMMA] * wr * wr * im * dt)
                    # dv is the change of the relative velocity; 1 - q^2 = lost (2 - lost)
                    radial = -lost * ev + np.sqrt(lost * (2.0 - lost) * kT * im) * normal(pair, 0)
                    dx, dy, dz = radial * ex, radial * ey, radial * ez
                    if coefficients[row, GAMMA_PERP] != 0.0:
                        wp = power(w, coefficients[row, EXPONENT_PERP])
                        lost = decay(update, factor * coefficients[row, GAMMA_PERP] * wp * wp * im * dt)
                        scale = np.sqrt(lost * (2.0 - lost) * kT * im)
                        if order[i] > order[j]:
                            scale = -scale
                        zx, zy, zz = normal(pair, 1), normal(pair, 2), normal(pair, 3)
                        along = ex * zx + ey * zy + ez * zz
                        dx += -lost * (vx - ev * ex) + scale * (zx - along * ex)
                        dy += -lost * (vy - ev * ey) + scale * (zy - along * ey)
                        dz += -lost * (vz - ev * ez) + scale * (zz - along * ez)
                    wi, wj = inv_mass[i] / im, inv_mass[j] / im
                    v[i, 0] += wi * dx
                    v[i, 1] += wi * dy
                    v[i, 2] += wi * dz
                    v[j, 0] -= wj * dx
                    v[j, 1] -= wj * dy
                    v[j, 2] -= wj * dz


sweep, sweep_parallel = serial_and_parallel(_sweep)
