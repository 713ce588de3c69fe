"""Pairs within the cutoff, column by column.

The order of pairs is a function of the present positions alone.  A column first copies all beads that its own beads can meet, shifted to
where they meet them, in the order of x, so that what a bead is compared with is one range.  The comparison, in single precision and with a
cutoff that is longer by what rounding can do, gives one bit for each; the bits give the indices of the hits, a fixed number at a time;
the hits of many beads are looked at together, in double precision.  None of these loops has a branch that the processor could not foresee,
and that is what makes them fast.
"""

from typing import NamedTuple

import numpy as np

from ..runtime import Kernel, helper, inlined, meet, merged
from .cells import most_near
from .exceptions import factor_of_beads, leave_out
from .vectors import LANES, bits_set, close_by, copy_shifted, count_up, fetch, lowest_bit

#: Square of the distance (nm^2) below which a pair exerts no force: it is not listed, or with 0 for direction and distance.
R_MIN2 = 1e-20
# The loops below run over unsigned indices: with signed ones numba looks out for indices below zero, and nothing is vectorised.
_WORD, _ONE, _THREE, _STEP = np.uint64(64), np.uint64(1), np.uint64(3), np.uint64(LANES)
#: So many hits of a bead are written down without a question; few beads have more.
_USUAL = np.uint64(8)
#: So many hits fill the space for them, where beads are close together.
_MOST = np.uint64(2048)
#: Into so many parts a batch is divided, of each of which comes one pair after the other; so many hits are collected for it.  Where there
#: are :mod:`.groups`; and where pairs of one bead are to be far apart.
USUAL, GROUPED, SPREAD = (np.uint64(4), np.uint64(384)), (np.uint64(16), np.uint64(384)), (np.uint64(64), np.uint64(768))
_FEW = USUAL[0]
#: Cells of a large layer: beads of several such layers are more than a processor's second cache holds.
_LARGE = 500
#: Numbers on two lines of the processor's cache, which come together.
LINE = 16


class SortedCells(NamedTuple):
    """What pairs are listed from, and what they are listed on.

    The sorted beads and their cells: positions (3, M or more), first bead of each cell, and the :class:`.cells.Grid`.  Which beads are
    pairs: the squares of the cutoffs of all types, of the longest one, of what that can be in single precision, and of the least distance;
    exceptions in compressed rows (of length 0 if there are none), and how far apart the numbers of their beads are at most.  How pairs are
    ordered: :data:`USUAL` or one of the others.  What each thread writes on: see :func:`space_for`.
    """

    xs: np.ndarray
    cells: np.ndarray
    box: np.ndarray
    origin: np.ndarray
    periodic: bool
    nx: int
    ny: int
    nz: int
    cut2: np.ndarray
    longest2: float
    reach2: float
    least2: float
    ntypes: int
    exc_start: np.ndarray
    exc_bead: np.ndarray
    exc_factor: np.ndarray
    exc_apart: np.uint64
    rows: np.uint64
    batch: np.uint64
    near: np.ndarray
    rounded: np.ndarray
    bead: np.ndarray
    who: np.ndarray
    whom: np.ndarray
    factor: np.ndarray
    own: np.ndarray
    others: np.ndarray
    corner: np.ndarray
    shift: np.ndarray


def space_for(parts: int, nx: int, most: int) -> tuple[np.ndarray, ...]:
    """Space of so many threads for so many beads near a column, and nx cells along it: the last items of a :class:`SortedCells`."""
    # a whole word of bits is read beyond the last bead, and a whole vector written
    beads, hits = (parts, most + 64), (parts, most + 64 + int(_MOST))
    copied = np.zeros((parts, 3, most + 64)), np.zeros((parts, 3, most + 64), np.float32), np.zeros(beads, np.uint32)
    found = np.empty(hits, np.uint32), np.empty(hits, np.uint32), np.empty(hits)
    # what is short has room behind it: threads that write on one line of the cache wait for each other all the time
    ends = np.empty((parts, nx + 3 + LINE), np.uint64), np.empty((parts, nx + 3 + LINE), np.uint64)
    return *copied, *found, *ends, np.empty((parts, 5 + LINE), np.int64), np.empty((parts, 5 + LINE, 3))


@inlined
def _neighbours(cy, cz, grid, corner, shift):
    """The column (cy, cz) and the four whose beads it meets.  Writes for each its first cell, and the lattice vector to add; returns how
    many there are."""
    nx, ny, nz = grid.nx, grid.ny, grid.nz
    box = grid.box
    n = 0
    for side in range(5):
        # the column itself, then (y+1, z), (y-1, z+1), (y, z+1), (y+1, z+1)
        y = cy + (0 if side == 0 else 1 if side == 1 else side - 3)
        z = cz + (0 if side < 2 else 1)
        sx, sy, sz = 0.0, 0.0, 0.0
        if y < 0 or y >= ny or z >= nz:
            if not grid.periodic:
                continue
            if z >= nz:
                z = 0
                sx, sy, sz = box[2, 0], box[2, 1], box[2, 2]
            if y < 0:
                y = ny - 1
                sx -= box[1, 0]
                sy -= box[1, 1]
            elif y >= ny:
                y = 0
                sx += box[1, 0]
                sy += box[1, 1]
        corner[n] = (z * ny + y) * nx
        shift[n, 0], shift[n, 1], shift[n, 2] = sx, sy, sz
        n += 1
    return n


@helper
def _gather(xs, cy, cz, grid, count, neighbours, own, others, near, bead):
    """Copy all beads near the column (cy, cz) one after the other: for each x from -1 to nx its own beads, then those of its neighbours.
    The own beads of cell x are own[x + 1]:others[x + 1], the others are others[x + 1]:own[x + 2].  What is copied beyond the end of a cell
    is written over by the next one."""
    nx = grid.nx
    corner, shift = neighbours
    x, y, z = xs[0], xs[1], xs[2]
    bx, by, bz = near[0], near[1], near[2]
    columns = _neighbours(cy, cz, grid, corner, shift)
    n = np.uint64(0)
    for cx in range(-1, nx + 1):
        own[cx + 1] = others[cx + 1] = n
        turn = 0.0
        at = cx
        if cx < 0 or cx == nx:
            if not grid.periodic:
                continue
            turn, at = (-grid.box[0, 0], nx - 1) if cx < 0 else (grid.box[0, 0], 0)
        for k in range(columns):
            if k == 0 and cx < 0:
                continue  # these pairs are found from the other end
            begin, end = count[corner[k] + at], count[corner[k] + at + 1]
            to = n
            for j in range(begin, end, _STEP):
                copy_shifted(x, j, shift[k, 0] + turn, bx, to)
                copy_shifted(y, j, shift[k, 1], by, to)
                copy_shifted(z, j, shift[k, 2], bz, to)
                count_up(j, bead, to)
                to += _STEP
            n += end - begin
            if k == 0:
                others[cx + 1] = n
    own[nx + 2] = n


@inlined
def _below(n):
    """The lowest n bits of a word (n may be beyond both of its ends)."""
    return (_ONE << np.uint64(max(n, 0))) - _ONE if n < 64 else ~np.uint64(0)


@inlined
def _round(near, grid, beads, rounded):
    """Positions in single precision, from the corner of the grid."""
    for axis in range(3):
        corner = grid.origin[axis]
        for k in range(beads):
            rounded[axis, k] = np.float32(near[axis, k] - corner)


@inlined
def _collect(bits, s, first, who, whom, n):
    """Write down the hits of bead s; returns how many there are then."""
    hits = bits_set(bits)
    for q in range(_USUAL):
        whom[n + q] = first + lowest_bit(bits)
        bits &= bits - _ONE
    for q in range(_USUAL):
        who[n + q] = s
    for q in range(_USUAL, max(hits, _USUAL)):
        who[n + q], whom[n + q] = s, first + lowest_bit(bits)
        bits &= bits - _ONE
    return n + hits


@helper
def _keep(rule, order, types, near, bead, hits, m):
    """Leave out what the cutoffs of the types and the exceptions leave out, and what only seems to be near enough; returns how many are
    left, with their factors."""
    who, whom, factor = hits
    n = np.uint64(0)
    for q in range(m):
        s, k = who[q], whom[q]
        i, j = bead[s], bead[k]
        dx, dy, dz = near[0, s] - near[0, k], near[1, s] - near[1, k], near[2, s] - near[2, k]
        r2 = dx * dx + dy * dy + dz * dz
        kept = (r2 < (rule.cut2[types[i] * rule.ntypes + types[j]] if rule.ntypes > 1 else rule.longest2)) & (r2 >= rule.least2)
        if len(rule.exc_start) and kept:
            factor[n] = factor_of_beads(rule, order[i], order[j])
            kept = factor[n] != 0.0
        who[n], whom[n] = s, k
        n += np.uint64(kept)
    return n


@inlined
def _inverse_root(square):
    """1/sqrt, to the last digit or two: in single precision, then Newton's rule twice, which takes half as long."""
    y = np.float64(np.float32(1.0) / np.sqrt(np.float32(square)))
    half = 0.5 * square
    y *= 1.5 - half * y * y
    return y * (1.5 - half * y * y)


@inlined
def _put(near, bead, hits, q, out, p):
    """Write hit q as pair p: its beads, and the line between them."""
    g, i, j = out.geometry, hits[0][q], hits[1][q]
    out.pi[p], out.pj[p] = bead[i], bead[j]
    g[0, p], g[1, p], g[2, p] = near[0, i] - near[0, j], near[1, i] - near[1, j], near[2, i] - near[2, j]
    if len(out.factors):
        out.factors[p] = hits[2][q]


@inlined
def _put_all(near, bead, hits, m, n, rows, out):
    """Write hits as pairs number n and following: of each of so many parts in turn."""
    apart = m // rows
    for k in range(apart):
        for row in range(rows):
            _put(near, bead, hits, row * apart + k, out, n + rows * k + row)
    for k in range(rows * apart, m):
        _put(near, bead, hits, k, out, n + k)


@inlined
def _write(near, bead, hits, m, n, rule, out):
    """Write hits as pairs number n and following; returns whether all are near enough.  Pairs that follow each other are of beads that are
    apart, so that what is done with one of them need not wait for the one before it."""
    g, good = out.geometry, True
    rows, longest2, least2 = rule.rows, rule.longest2, rule.least2
    if rows == _FEW:  # known when this is compiled, which saves a tenth of all listing
        _put_all(near, bead, hits, m, n, _FEW, out)
    else:
        _put_all(near, bead, hits, m, n, rows, out)
    for p in range(n, n + m):
        dx, dy, dz = g[0, p], g[1, p], g[2, p]
        r2 = dx * dx + dy * dy + dz * dz
        good &= (r2 < longest2) & (r2 >= least2)
        inverse = _inverse_root(r2) if r2 >= R_MIN2 else 0.0
        g[0, p], g[1, p], g[2, p], g[3, p] = dx * inverse, dy * inverse, dz * inverse, r2 * inverse
    return good


@inlined
def _flush(rule, order, types, near, bead, hits, m, n, room, out):
    """Turn the m hits into pairs number n and following; returns the number of the next one, also where there was no room for all."""
    exact = rule.ntypes > 1
    while True:
        if exact:
            m = _keep(rule, order, types, near, bead, hits, m)
        elif len(rule.exc_start):
            m = leave_out(rule, order, bead, hits, m)
        if n + m > room or _write(near, bead, hits, m, n, rule, out) or exact:
            return n + m
        exact = True


@inlined
def has_room(source):
    """Whether there is room for all beads near a column."""
    return most_near(source.cells, source.nx * source.ny) + 64 <= source.bead.shape[1]


@inlined
def look_around(source, part, column):
    """Copy what the beads of a column can meet into the space of a thread."""
    near, own, others = source.near[part], source.own[part], source.others[part]
    neighbours = source.corner[part], source.shift[part]
    _gather(source.xs, column % source.ny, column // source.ny, source, source.cells, neighbours, own, others, near, source.bead[part])
    _round(near, source, own[source.nx + 2], source.rounded[part])


@helper
def _fetch_column(source, written, column):
    begin, end = source.cells[column * source.nx], source.cells[(column + 1) * source.nx]
    x, y, z = source.xs[0], source.xs[1], source.xs[2]
    for k in range(begin, end, _STEP):
        fetch(x, k)
        fetch(y, k)
        fetch(z, k)
    for k in range(_THREE * begin, _THREE * end, _STEP):
        fetch(written, k)


@helper
def fetch_around(source, written, column):
    """Where layers of cells are so large that the processor has not all around a column at hand, bring nearer what its pairs need:
    positions, and the array (M, 3) on which they write."""
    if source.nx * source.ny < _LARGE:
        return
    ny, y, z = source.ny, column % source.ny, column // source.ny
    for beside in range(5):  # those of _neighbours
        right, up = (beside, 0) if beside < 2 else (beside - 3, 1)
        _fetch_column(source, written, (z + up) % source.nz * ny + (y + right + ny) % ny)


@merged
def list_some(pairs, source, part, cell, s, n, room):
    """List pairs of the column around which a thread has looked: those of its beads from number s on, in this cell, until they are many.
    They get number n and following, as far as there is room, up to ``room``.  Returns cell and bead that are next, and the number of the
    next pair."""
    near, bead, own, others = source.near[part], source.bead[part], source.own[part], source.others[part]
    hits, m, reach2 = (source.who[part], source.whom[part], source.factor[part]), np.uint64(0), np.float32(source.reach2)
    x, y, z = source.rounded[part, 0], source.rounded[part, 1], source.rounded[part, 2]
    while cell < source.nx and m < source.batch:
        start, stop, mine, end = others[cell], own[cell + 3], own[cell + 1], others[cell + 1]
        s = max(s, mine)
        while s < end and m < _MOST:
            for first in range(start, stop, _WORD):
                bits = close_by(x, y, z, first, x[s], y[s], z[s], reach2)
                # not itself and the own beads before it, which have met it, nor what lies beyond the range
                met = _below(np.int64(s + _ONE - first)) & ~_below(np.int64(mine - first))
                m = _collect(bits & ~met & _below(np.int64(stop - first)), s, first, hits[0], hits[1], m)
            s += _ONE
        if s == end:
            cell += 1
    return cell, s, _flush(source, pairs.order, pairs.types, near, bead, hits, m, n, room, pairs)


def _list_pairs(pairs, source, shares, part, parts, team):
    """List all pairs; the threads share the columns.  Returns 1 where there was too little room for them or for the beads near a column."""
    if not has_room(source):
        return 1
    for first in shares.first:
        for mine in range(part, len(first) - 1, parts):
            for n in range(first[mine], first[mine + 1]):
                column = shares.columns[n]
                look_around(source, part, column)
                cell, bead, stop, room = np.int64(0), np.uint64(0), pairs.start[column], pairs.start[column + 1]
                while cell < source.nx:
                    cell, bead, stop = list_some(pairs, source, part, cell, bead, stop, room)
                pairs.found[column] = stop - pairs.start[column]
        meet(team, parts)
    for column in range(len(pairs.found)):
        if pairs.found[column] > pairs.start[column + 1] - pairs.start[column]:
            return 1
    return 0


list_pairs = Kernel(_list_pairs)


def _list_pairs_small_box(pairs, source, part, parts, team):
    """All pairs by minimum image, for boxes too narrow for three cells; one column holds them all.  Returns 1 where there was too little
    room."""
    xs, order, types, box = source.xs, pairs.order, pairs.types, source.box
    n, end = pairs.start[0], pairs.start[1]
    for i in range(len(order)):
        for j in range(i + 1, len(order)):
            dx, dy, dz = xs[0, i] - xs[0, j], xs[1, i] - xs[1, j], xs[2, i] - xs[2, j]
            turns = np.floor(dz / box[2, 2] + 0.5)
            dx -= turns * box[2, 0]
            dy -= turns * box[2, 1]
            dz -= turns * box[2, 2]
            turns = np.floor(dy / box[1, 1] + 0.5)
            dx -= turns * box[1, 0]
            dy -= turns * box[1, 1]
            dx -= np.floor(dx / box[0, 0] + 0.5) * box[0, 0]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < source.longest2 and r2 >= source.least2:
                if source.ntypes > 1 and r2 >= source.cut2[types[i] * source.ntypes + types[j]]:
                    continue
                factor = 1.0
                if len(source.exc_start):
                    factor = factor_of_beads(source, order[i], order[j])
                    if factor == 0.0:
                        continue
                if n < end:
                    inverse = 1.0 / np.sqrt(r2) if r2 >= R_MIN2 else 0.0
                    pairs.pi[n], pairs.pj[n] = i, j
                    g = pairs.geometry
                    g[0, n], g[1, n], g[2, n], g[3, n] = dx * inverse, dy * inverse, dz * inverse, r2 * inverse
                    if len(pairs.factors):
                        pairs.factors[n] = factor
                n += _ONE
    pairs.found[0] = n - pairs.start[0]
    return 1 if n > end else 0


list_pairs_small_box = Kernel(_list_pairs_small_box)
