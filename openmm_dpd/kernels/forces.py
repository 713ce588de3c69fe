"""Force form of the pair terms: what LAMMPS's pair styles return.

Per listed pair, with w = 1 - r/rc and f the factor of bonded neighbours::

    C   f A w
    D   - f gamma w^(2s) (e.v)            - f gamma_perp w^(2 s_perp) (v - e (e.v))
    R   sqrt(f) sigma w^s xi0 / sqrt(dt)  + sqrt(f) sigma_perp w^s_perp (xi - e (e.xi)) / sqrt(dt)

The transverse noise vector is the force on the bead with the lower index.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from .compiled import compiled, serial_and_parallel
from .layer import CONSERVATIVE, DISSIPATIVE, RANDOM
from .noise import normal, pair_key

#: Columns of the coefficient table, one row per pair of types.
A, CUTOFF, GAMMA, SIGMA, GAMMA_PERP, SIGMA_PERP, EXPONENT, EXPONENT_PERP = range(8)


@njit(inline="always")
def power(w, s):
    """w^s, cheap for the common exponent 1."""
    return w if s == 1.0 else w**s


def _pair_forces(
    which,
    key,
    rsqrt_dt,
    order,
    types,
    ntypes,
    coefficients,
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
    f,
    energy,
    virial,
    stress,
):
    for colour in range(len(colour_start) - 1):
        for block in prange(colour_start[colour], colour_start[colour + 1]):
            for task in range(block_start[block], block_start[block + 1]):
                column = columns[task]
                column_energy, column_virial = 0.0, 0.0
                xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for n in range(start[column], start[column] + found[column]):
                    i, j = pi[n], pj[n]
                    row = 0 if ntypes == 1 else types[i] * ntypes + types[j]
                    ex, ey, ez, r = geometry[n, 0], geometry[n, 1], geometry[n, 2], geometry[n, 3]
                    factor = factors[n] if len(factors) else 1.0
                    w = 1.0 - r / coefficients[row, CUTOFF]
                    radial = 0.0
                    fx, fy, fz = 0.0, 0.0, 0.0
                    if which & CONSERVATIVE:
                        radial = factor * coefficients[row, A] * w
                        column_energy += 0.5 * radial * w * coefficients[row, CUTOFF]
                    if which & DISSIPATIVE:
                        vx, vy, vz = v[i, 0] - v[j, 0], v[i, 1] - v[j, 1], v[i, 2] - v[j, 2]
                        ev = ex * vx + ey * vy + ez * vz
                        wr = power(w, coefficients[row, EXPONENT])
                        radial -= factor * coefficients[row, GAMMA] * wr * wr * ev
                        if coefficients[row, GAMMA_PERP] != 0.0:
                            wp = power(w, coefficients[row, EXPONENT_PERP])
                            drag = factor * coefficients[row, GAMMA_PERP] * wp * wp
                            fx -= drag * (vx - ev * ex)
                            fy -= drag * (vy - ev * ey)
                            fz -= drag * (vz - ev * ez)
                    if which & RANDOM:
                        low, high = min(order[i], order[j]), max(order[i], order[j])
                        pair = pair_key(key, low, high)
                        scale = np.sqrt(factor) * rsqrt_dt
                        radial += scale * coefficients[row, SIGMA] * power(w, coefficients[row, EXPONENT]) * normal(pair, 0)
                        if coefficients[row, SIGMA_PERP] != 0.0:
                            scale *= coefficients[row, SIGMA_PERP] * power(w, coefficients[row, EXPONENT_PERP])
                            if order[i] > order[j]:
                                scale = -scale
                            zx, zy, zz = normal(pair, 1), normal(pair, 2), normal(pair, 3)
                            ez_dot = ex * zx + ey * zy + ez * zz
                            fx += scale * (zx - ez_dot * ex)
                            fy += scale * (zy - ez_dot * ey)
                            fz += scale * (zz - ez_dot * ez)
                    # the transverse parts are perpendicular to e and add nothing to r.F
                    column_virial += radial * r
                    fx += radial * ex
                    fy += radial * ey
                    fz += radial * ez
                    if len(stress):
                        xx += r * ex * fx
                        yy += r * ey * fy
                        zz += r * ez * fz
                        # central forces make these symmetric; transverse ones on average only
                        xy += 0.5 * r * (ex * fy + ey * fx)
                        xz += 0.5 * r * (ex * fz + ez * fx)
                        yz += 0.5 * r * (ey * fz + ez * fy)
                    f[i, 0] += fx
                    f[i, 1] += fy
                    f[i, 2] += fz
                    f[j, 0] -= fx
                    f[j, 1] -= fy
                    f[j, 2] -= fz
                energy[column] = column_energy
                virial[column] = column_virial
                if len(stress):
                    stress[column, 0], stress[column, 1], stress[column, 2] = xx, yy, zz
                    stress[column, 3], stress[column, 4], stress[column, 5] = xy, xz, yz


pair_forces, pair_forces_parallel = serial_and_parallel(_pair_forces)


@compiled
def laplacian(types, ntypes, coefficients, inv_mass, pi, pj, geometry, factors, columns, start, found):
    """Sum over the mobile beads of the Laplacian of the conservative energy.

    For U = A rc w^2/2 it is U'' + 2U'/r = A/rc - 2 A w/r per pair and mobile bead.
    """
    total = 0.0
    for column in columns:
        for n in range(start[column], start[column] + found[column]):
            i, j = pi[n], pj[n]
            row = 0 if ntypes == 1 else types[i] * ntypes + types[j]
            factor = factors[n] if len(factors) else 1.0
            rc, r = coefficients[row, CUTOFF], geometry[n, 3]
            mobile = (inv_mass[i] > 0.0) + (inv_mass[j] > 0.0)
            total += mobile * factor * coefficients[row, A] * (1.0 / rc - 2.0 * (1.0 - r / rc) / r)
    return total


@compiled
def friction_moment(types, ntypes, coefficients, pi, pj, geometry, factors, columns, start, found):
    """Sum over pairs of f gamma w^(2s) r^2: a fifteenth of it is the mean stress of an affine shear at rate 1."""
    total = 0.0
    for column in columns:
        for n in range(start[column], start[column] + found[column]):
            row = 0 if ntypes == 1 else types[pi[n]] * ntypes + types[pj[n]]
            r = geometry[n, 3]
            wr = power(1.0 - r / coefficients[row, CUTOFF], coefficients[row, EXPONENT])
            total += (factors[n] if len(factors) else 1.0) * coefficients[row, GAMMA] * wr * wr * r * r
    return total
