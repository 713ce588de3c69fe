"""Force form of the pair terms: what LAMMPS's pair styles return.

Per listed pair, with w = 1 - r/rc and f the factor of bonded neighbours::

    C   f A w
    D   - f gamma w^(2s) (e.v)            - f gamma_perp w^(2 s_perp) (v - e (e.v))
    R   sqrt(f) sigma w^s xi0 / sqrt(dt)  + sqrt(f) sigma_perp w^s_perp (xi - e (e.xi)) / sqrt(dt)

The transverse noise vector is the force on the bead with the lower index.
"""

from typing import Any, NamedTuple

import numpy as np

from ..runtime import helper, inlined
from . import columns
from .chunks import look_up, look_up_one, powers
from .columns import (
    Motion,
    add_stress,
    along_flow,
    approach,
    clear,
    deliver,
    factor_of,
    gather_and_clear,
    on_forces,
    over_pairs,
    push,
    push_apart,
    row_of,
)
from .layer import CONSERVATIVE, DISSIPATIVE, LAPLACIAN, RANDOM, STRESS, Sums
from .noise import draw, draw_directed
from .pairs import PairList, rows
from .templates import renamed

#: Columns of the coefficient table, one row per pair of types.
A, CUTOFF, GAMMA, SIGMA, GAMMA_PERP, SIGMA_PERP, EXPONENT, EXPONENT_PERP = range(8)
#: Rows of scratch; the last ones, those of factors and coefficients, are those of sweeps too.
_DRAG, _PUSH, _ENERGY, _NOISE, _HELD, _CURVE, _ACROSS, _ALONG, _X, _Y, _Z, FACTOR, *_COLUMNS = rows(20)
TABLE = tuple(_COLUMNS)
#: Columns of the radial terms, and of the transverse ones.
_RADIAL_COLUMNS, _TRANSVERSE_COLUMNS = (A, CUTOFF, GAMMA, SIGMA, EXPONENT), (GAMMA_PERP, SIGMA_PERP, EXPONENT_PERP)


_NOTHING = np.zeros((0, 3))


class Repulsion(NamedTuple):
    """What the conservative force reads and writes beside the pairs, from a table that begins with A and CUTOFF."""

    coefficients: np.ndarray
    motion: Motion


class Terms(NamedTuple):
    """What the force form reads and writes beside the pairs."""

    which: int  #: Sum of CONSERVATIVE, DISSIPATIVE, RANDOM
    plain: bool  #: Whether all pairs have the same coefficients, the factor 1 and the exponent 1
    key: np.uint64  # key, rsqrt_dt: of the noise
    rsqrt_dt: float
    coefficients: np.ndarray  #: (T*T, 8)
    motion: Motion
    c: np.ndarray = _NOTHING  #: (M, 3) conservative forces alone, which go to ``held`` (N, 3); of length 0 where nobody wants them
    held: np.ndarray = _NOTHING


@inlined
def soft(A, cutoff, r):
    """The conservative term A w with w = 1 - r/cutoff, and its energy."""
    w = 1.0 - r / cutoff
    return A * w, 0.5 * A * w * w * cutoff


@inlined
def _radial(values, k, A, cutoff, gamma, sigma, w, factor, r):
    """Radial terms of the k-th pair of a column: what e.v is multiplied with, the rest, and the energy."""
    force, energy = soft(A, cutoff, r)
    values[_DRAG + k] = factor * gamma * w * w
    values[_PUSH + k] = factor * force + np.sqrt(factor) * sigma * w * values[_NOISE + k]
    values[_ENERGY + k] = factor * energy


@inlined
def _curvature(A, cutoff, r):
    """Laplacian of the energy of a pair for each of its beads, A/rc - 2 A w/r."""
    return A * (3.0 * r - 2.0 * cutoff) / (r * cutoff)


@inlined
def _mobile(pairs, i, j):
    return (1.0 if pairs.inv_mass[i] > 0.0 else 0.0) + (1.0 if pairs.inv_mass[j] > 0.0 else 0.0)


@inlined
def _radial_apart(values, k, A, cutoff, gamma, sigma, w, factor, r):
    _radial(values, k, A, cutoff, gamma, sigma, w, factor, r)
    # rounded as where there is nothing else: samples have the same bits whether a run was cut before them
    values[_HELD + k], values[_ENERGY + k] = soft(factor * A, cutoff, r)
    values[_CURVE + k] = factor * _curvature(A, cutoff, r)


# what is put in
_each: Any = None


def _terms(pairs, data, begin, m, scratch):
    values, g, c = scratch.values, pairs.geometry, data.coefficients
    if data.which & RANDOM:
        draw(data.key, pairs, begin, m, scratch, _NOISE)
    else:
        for k in range(m):
            values[_NOISE + k] = 0.0
    # what is not wanted has the coefficient 0; friction is infinite where sigma is fixed and kT is 0
    conservative = 1.0 if data.which & CONSERVATIVE else 0.0
    dissipative = (data.which & DISSIPATIVE) != 0
    if data.plain:
        a, cutoff, sigma = conservative * c[0, A], c[0, CUTOFF], data.rsqrt_dt * c[0, SIGMA]
        gamma = c[0, GAMMA] if dissipative else 0.0
        for k in range(m):
            _each(values, k, a, cutoff, gamma, sigma, 1.0 - g[3, begin + k] / cutoff, 1.0, g[3, begin + k])
        return
    look_up(c, _RADIAL_COLUMNS, pairs, begin, m, scratch, FACTOR)
    for k in range(m):
        values[_ALONG + k] = 1.0 - g[3, begin + k] / values[TABLE[CUTOFF] + k]
    powers(m, scratch, _ALONG, TABLE[EXPONENT])
    for k in range(m):
        a, cutoff, sigma = conservative * values[TABLE[A] + k], values[TABLE[CUTOFF] + k], data.rsqrt_dt * values[TABLE[SIGMA] + k]
        gamma = values[TABLE[GAMMA] + k] if dissipative else 0.0
        _each(values, k, a, cutoff, gamma, sigma, values[_ALONG + k], values[FACTOR + k], g[3, begin + k])


radial_terms = helper(renamed(_terms, "radial_terms", {"_each": _radial}))
_apart_terms = helper(renamed(_terms, "apart_terms", {"_each": _radial_apart}))


@helper
def draw_across(pairs, begin, m, scratch, x, y, z, along):
    """Three rows of the values: what is across the line between the beads of a pair of a normal random vector, as the first bead has it."""
    values, g = scratch.values, pairs.geometry
    draw_directed(1, m, scratch, x)
    draw_directed(2, m, scratch, y)
    draw_directed(3, m, scratch, z)
    for k in range(m):
        values[along + k] = g[0, begin + k] * values[x + k] + g[1, begin + k] * values[y + k] + g[2, begin + k] * values[z + k]
    for axis, row in ((0, x), (1, y), (2, z)):
        for k in range(m):
            values[row + k] -= values[along + k] * g[axis, begin + k]


@inlined
def across(pairs, v, n, i, j, ev, drag, x, y, z):
    """(x, y, z) less ``drag`` times the relative velocity of a pair across the line between its beads; ``ev`` is that along it."""
    g = pairs.geometry
    tx = x - drag * (along_flow(pairs, n, v[i, 0] - v[j, 0]) - ev * g[0, n])
    ty = y - drag * (v[i, 1] - v[j, 1] - ev * g[1, n])
    tz = z - drag * (v[i, 2] - v[j, 2] - ev * g[2, n])
    return tx, ty, tz


@helper
def _any_terms(pairs, data, begin, m, scratch):
    """Radial and transverse terms: what the velocity across the line is multiplied with, and the noise."""
    values, r, noisy, dissipative = scratch.values, pairs.geometry[3], data.which & RANDOM, (data.which & DISSIPATIVE) != 0
    radial_terms(pairs, data, begin, m, scratch)
    if noisy:
        draw_across(pairs, begin, m, scratch, _X, _Y, _Z, _ALONG)
    for column in _TRANSVERSE_COLUMNS:
        look_up_one(data.coefficients, column, pairs, m, scratch, TABLE[column])
    for k in range(m):
        values[_ALONG + k] = 1.0 - r[begin + k] / values[TABLE[CUTOFF] + k]
    powers(m, scratch, _ALONG, TABLE[EXPONENT_PERP])
    for k in range(m):
        w, factor = values[_ALONG + k], values[FACTOR + k]
        scale = np.sqrt(factor) * data.rsqrt_dt * values[TABLE[SIGMA_PERP] + k] * w
        values[_ACROSS + k] = factor * values[TABLE[GAMMA_PERP] + k] * w * w if dissipative else 0.0
        values[_X + k] = scale * values[_X + k] if noisy else 0.0
        values[_Y + k] = scale * values[_Y + k] if noisy else 0.0
        values[_Z + k] = scale * values[_Z + k] if noisy else 0.0


@helper
def _repulsion_terms(pairs, data, begin, m, scratch):
    values, r, c = scratch.values, pairs.geometry[3], data.coefficients
    if pairs.ntypes == 1 and not len(pairs.factors):
        for k in range(m):
            values[_PUSH + k], values[_ENERGY + k] = soft(c[0, A], c[0, CUTOFF], r[begin + k])
    else:
        look_up(c, (A, CUTOFF), pairs, begin, m, scratch, FACTOR)
        for k in range(m):
            a, cutoff = values[FACTOR + k] * values[TABLE[A] + k], values[TABLE[CUTOFF] + k]
            values[_PUSH + k], values[_ENERGY + k] = soft(a, cutoff, r[begin + k])


@inlined
def _conservative(pairs, data, scratch, n, k, column):
    virial = push_apart(pairs, data.motion.f, n, pairs.pi[n], pairs.pj[n], scratch.values[_PUSH + k])
    return scratch.values[_ENERGY + k], virial, 0.0


@inlined
def central_force(pairs, data, scratch, n, k, column):
    i, j, values = pairs.pi[n], pairs.pj[n], scratch.values
    drag = values[_DRAG + k] * approach(pairs, data.motion.v, n, i, j)
    virial = push_apart(pairs, data.motion.f, n, i, j, values[_PUSH + k] - drag)
    return values[_ENERGY + k], virial, -drag * pairs.geometry[3, n]


@inlined
def _any(pairs, data, scratch, n, k, column):
    i, j, g, v, values = pairs.pi[n], pairs.pj[n], pairs.geometry, data.motion.v, scratch.values
    ex, ey, ez, ev = g[0, n], g[1, n], g[2, n], approach(pairs, v, n, i, j)
    drag = values[_DRAG + k] * ev
    radial = values[_PUSH + k] - drag
    # perpendicular to e: these add nothing to r.F
    tx, ty, tz = across(pairs, v, n, i, j, ev, values[_ACROSS + k], values[_X + k], values[_Y + k], values[_Z + k])
    push(data.motion.f, i, j, radial * ex + tx, radial * ey + ty, radial * ez + tz)
    if len(pairs.stress):
        x, y, z = g[3, n] * ex, g[3, n] * ey, g[3, n] * ez
        add_stress(pairs.stress, column, (x * tx, y * ty, z * tz, x * ty, x * tz, y * tz))
    return values[_ENERGY + k], radial * g[3, n], -drag * g[3, n]


# the usual cases apart: what need not be asked for each pair is a third of the time
conservative_forces = over_pairs("conservative_forces", _conservative, _repulsion_terms, first=clear, last=deliver, again=on_forces)
_central_forces = over_pairs("central_forces", central_force, radial_terms, first=gather_and_clear, last=deliver, again=on_forces)
_any_forces = over_pairs("any_forces", _any, _any_terms, first=gather_and_clear, last=deliver, again=on_forces)


def pair_forces(pairs: PairList, terms: Terms, transverse: bool, more: int) -> Sums:
    """Compute the forces.  ``transverse`` says whether there are transverse terms, ``more`` whether STRESS and LAPLACIAN are wanted."""
    if len(terms.c):
        return Sums(*_parted_forces(pairs, terms, more & STRESS))
    if terms.which != CONSERVATIVE:
        return Sums(*(_any_forces if transverse else _central_forces)(pairs, terms, more & STRESS))
    given = Repulsion(terms.coefficients, terms.motion)
    return Sums(*(_curved_forces if more & LAPLACIAN else conservative_forces)(pairs, given, more & STRESS))


class CoefficientRows(NamedTuple):
    """A table of coefficients alone."""

    coefficients: np.ndarray


@inlined
def _pair_laplacian(pairs, data, scratch, n, k, column):
    i, j, r = pairs.pi[n], pairs.pj[n], pairs.geometry[3, n]
    row = row_of(pairs, i, j)
    rc = data.coefficients[row, CUTOFF]
    if r >= rc:  # a list may reach further
        return 0.0, 0.0, 0.0
    return _mobile(pairs, i, j) * factor_of(pairs, n) * _curvature(data.coefficients[row, A], rc, r), 0.0, 0.0


@inlined
def _curved(pairs, data, scratch, n, k, column):
    # first: after a force is written all has to be read again
    laplacian = _pair_laplacian(pairs, data, scratch, n, k, column)[0]
    energy, virial, _ = _conservative(pairs, data, scratch, n, k, column)
    return energy, virial, 0.0, laplacian, virial


@inlined
def _parted(pairs, data, scratch, n, k, column):
    i, j, values = pairs.pi[n], pairs.pj[n], scratch.values
    laplacian = _mobile(pairs, i, j) * values[_CURVE + k]
    drag = values[_DRAG + k] * approach(pairs, data.motion.v, n, i, j)
    conservative = push_apart(pairs, data.c, n, i, j, values[_HELD + k])
    virial = push_apart(pairs, data.motion.f, n, i, j, values[_PUSH + k] - drag)
    return values[_ENERGY + k], virial, -drag * pairs.geometry[3, n], laplacian, conservative


_laplacian = over_pairs("laplacian", _pair_laplacian, parallel=False)
_curved_forces = over_pairs("curved_forces", _curved, _repulsion_terms, first=clear, last=deliver, parts=True)
_parted_forces = over_pairs(
    "parted_forces", _parted, _apart_terms, first=columns.gather_and_clear_both, last=columns.deliver_both, parts=True
)


def soft_laplacian(pairs: PairList, coefficients: np.ndarray) -> float:
    """Sum over the mobile beads of the Laplacian of the conservative energy, from a table that begins with A and CUTOFF.  For U = A rc
    w^2/2 it is U'' + 2U'/r per pair and mobile bead."""
    return _laplacian(pairs, CoefficientRows(coefficients))[0]


@helper
def _tensor_terms(pairs, data, begin, m, scratch):
    """Repulsion, and what the velocity along the line is multiplied with."""
    values, r = scratch.values, pairs.geometry[3]
    look_up(data.coefficients, _RADIAL_COLUMNS, pairs, begin, m, scratch, FACTOR)
    for k in range(m):
        values[_ALONG + k] = 1.0 - r[begin + k] / values[TABLE[CUTOFF] + k]
    powers(m, scratch, _ALONG, TABLE[EXPONENT])
    for k in range(m):
        w, factor = values[_ALONG + k], values[FACTOR + k]
        values[_DRAG + k] = factor * values[TABLE[GAMMA] + k] * w * w * r[begin + k]
        values[_PUSH + k], _ = soft(factor * values[TABLE[A] + k], values[TABLE[CUTOFF] + k], r[begin + k])


@inlined
def _pair_tensors(pairs, data, scratch, n, k, column):
    r, drag = pairs.geometry[3, n], scratch.values[_DRAG + k]
    return drag * r, scratch.values[_PUSH + k] * r, -drag * approach(pairs, data.motion.v, n, pairs.pi[n], pairs.pj[n])


_tensors = over_pairs("pair_tensors", _pair_tensors, _tensor_terms, first=columns.gather, drags=True)


def pair_tensors(pairs: PairList, terms: Repulsion) -> tuple[np.ndarray, np.ndarray, float]:
    """(6,) sums over pairs of r F of the repulsion and of the radial friction, and that of f gamma w^(2s) r^2; no forces are written."""
    found = _tensors(pairs, terms, True)
    return *found.stress, found.energy  # type: ignore[misc]  # two tensors
