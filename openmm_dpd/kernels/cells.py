"""Cells: beads sorted by them, and columns of them shared by threads.

A *column* is all cells with the same (y, z); it owns the pairs of its beads among themselves and with four neighbouring columns.  Its beads
follow each other, so that its pairs lie on few pages of memory; with its cells far from each other a million beads take a fifth longer.
Which thread does which column, and when, is in :mod:`.shares`.
"""

from typing import NamedTuple

import numpy as np

from ..runtime import Kernel, helper, inlined, meet

#: Few cells have more beads.
_FEW, _ONE = np.uint64(8), np.uint64(1)
#: So many beads are put into cells together.
_SOME = np.uint64(1024)


class Grid(NamedTuple):
    """Cells of equal size."""

    box: np.ndarray  #: (3, 3) lower-triangular box vectors; without a box the extent of the grid
    origin: np.ndarray  #: (3,) lower corner
    periodic: bool
    nx: int  # nx, ny, nz: cells along each axis
    ny: int
    nz: int


class _Edges(NamedTuple):
    """What turns positions into units of the (lower-triangular) box vectors and back, as numbers: what is read from an array has to be read
    again after each number that is written."""

    ox: float
    oy: float
    oz: float
    rx: float
    ry: float
    rz: float
    ax: float
    bx: float
    by: float
    cx: float
    cy: float
    cz: float


@inlined
def _edges(grid):
    b, o = grid.box, grid.origin
    return _Edges(o[0], o[1], o[2], 1.0 / b[0, 0], 1.0 / b[1, 1], 1.0 / b[2, 2], b[0, 0], b[1, 0], b[1, 1], b[2, 0], b[2, 1], b[2, 2])


@inlined
def _fractions(px, py, pz, e):
    """Position in units of the box vectors."""
    sz = (pz - e.oz) * e.rz
    sy = (py - e.oy - sz * e.cy) * e.ry
    sx = (px - e.ox - sz * e.cx - sy * e.bx) * e.rx
    return sx, sy, sz


@inlined
def _usable(sx, sy, sz):
    return (abs(sx) < 1e15) & (abs(sy) < 1e15) & (abs(sz) < 1e15)


@helper
def _find_cells(x, beads, grid, begin, end, cell, wrapped, some):
    """Cells of the beads begin:end, and their positions wrapped into the grid; returns whether all positions are usable.  What is read at
    places that are not known before is read on its own, some beads at a time: the rest is then done for several at once."""
    e, nx, ny, nz, periodic = _edges(grid), grid.nx, grid.ny, grid.nz, grid.periodic
    usable = True
    for first in range(np.uint64(begin), np.uint64(end), _SOME):
        last = min(first + _SOME, np.uint64(end))
        for k in range(last - first):
            i = beads[first + k]
            some[0, k], some[1, k], some[2, k] = x[i, 0], x[i, 1], x[i, 2]
        for k in range(last - first):
            px, py, pz = some[0, k], some[1, k], some[2, k]
            sx, sy, sz = _fractions(px, py, pz, e)
            usable &= _usable(sx, sy, sz)
            if periodic:
                tx, ty, tz = np.floor(sx), np.floor(sy), np.floor(sz)
                sx, sy, sz = sx - tx, sy - ty, sz - tz
                # the same turns: a bead on a face must get the position of the cell it was put into
                px -= tz * e.cx + ty * e.bx + tx * e.ax
                py -= tz * e.cy + ty * e.by
                pz -= tz * e.cz
            some[0, k], some[1, k], some[2, k] = px, py, pz
            cell[first + k] = (min(int(sz * nz), nz - 1) * ny + min(int(sy * ny), ny - 1)) * nx + min(int(sx * nx), nx - 1)
        for k in range(last - first):
            wrapped[first + k, 0], wrapped[first + k, 1], wrapped[first + k, 2] = some[0, k], some[1, k], some[2, k]
    return usable


@inlined
def _count_chunk(x, beads, grid, scratch, chunk):
    """Cells of one chunk of the beads, and how many of them are in each; returns whether all positions are usable."""
    cell, wrapped, place = scratch.cell, scratch.wrapped, scratch.place[chunk]
    m, chunks = len(beads), len(scratch.place)
    begin, end = m * chunk // chunks, m * (chunk + 1) // chunks
    usable = _find_cells(x, beads, grid, begin, end, cell, wrapped, scratch.some[chunk])
    place[:] = 0
    if usable:
        for k in range(np.uint64(begin), np.uint64(end)):
            place[cell[k]] += np.uint32(1)
    return usable


@inlined
def _place_chunk(beads, names, scratch, chunk):
    """Write down which beads of one chunk belong where; and their numbers, and the cells of these, if they are not sorted by them."""
    cell, place, rows = scratch.cell, scratch.place[chunk], scratch.rows
    m, chunks = len(beads), len(scratch.place)
    for k in range(np.uint64(m * chunk // chunks), np.uint64(m * (chunk + 1) // chunks)):
        n = place[cell[k]]
        place[cell[k]] = n + np.uint32(1)
        rows[n] = k
        if len(names):
            scratch.numbers[n + _FEW], scratch.cells[n + _FEW] = names[beads[k]], cell[k]


@helper
def _sort_cells(numbers, cells, count, first, last, to):
    """Where the beads of the places in these cells go, so that they are in the order of their numbers in each.  Most cells have few beads:
    then each is compared with as many places before and behind, without a branch, so that several are treated at once."""
    for place in range(np.uint64(count[first]), np.uint64(count[last])):
        at, n = place + _FEW, np.uint32(place)
        for q in range(_ONE, _FEW):
            n -= np.uint32((cells[at - q] == cells[at]) & (numbers[at - q] > numbers[at]))
            n += np.uint32((cells[at + q] == cells[at]) & (numbers[at + q] < numbers[at]))
        to[place] = n
    for k in range(np.uint64(first), np.uint64(last)):
        begin, end = np.uint64(count[k]), np.uint64(count[k + 1])
        for place in range(begin, end if end - begin > _FEW else begin):
            n = np.uint32(begin)
            for other in range(begin, end):
                n += np.uint32(numbers[other + _FEW] < numbers[place + _FEW])
            to[place] = n


@inlined
def _fill_in(beads, scratch, begin, end, named, order, seats, xs, of_beads, sorted_types, sorted_inv_mass):
    """Put the beads of the places from begin to end where they belong."""
    wrapped, rows = scratch.wrapped, scratch.rows
    for place in range(np.uint64(begin), np.uint64(end)):
        k = rows[place]
        i, n = beads[k], np.uint64(scratch.to[place]) if named else place
        xs[0, n], xs[1, n], xs[2, n] = wrapped[k, 0], wrapped[k, 1], wrapped[k, 2]
        seats[n] = i
        order[n] = scratch.numbers[place + _FEW] if named else i
        if len(of_beads.types):
            sorted_types[n] = of_beads.types[i]
        if len(of_beads.inv_mass):
            sorted_inv_mass[n] = of_beads.inv_mass[i]


class OfBeads(NamedTuple):
    """What is sorted with the positions: (N,) arrays, of length 0 where all beads have the same."""

    types: np.ndarray
    inv_mass: np.ndarray


class CellScratch(NamedTuple):
    """For M beads in as many chunks as the threads share them in."""

    cell: np.ndarray  #: (M,)
    wrapped: np.ndarray  #: (M, 3) positions in the grid
    some: np.ndarray  #: (chunks, 3, SOME) positions that are treated together
    rows: np.ndarray  #: (M,) the bead that was put in each place
    numbers: np.ndarray  # numbers, cells: (M + 2 FEW,) its number and its cell where beads are named; no place has the first and last FEW
    cells: np.ndarray
    to: np.ndarray  #: (M,) the place that its number gives it
    place: np.ndarray  #: (chunks, ncells)
    usable: np.ndarray  # usable, beads_in: (chunks,)
    beads_in: np.ndarray


def scratch_for(wrapped: np.ndarray, named: bool, chunks: int, cells: int) -> CellScratch:
    """Scratch of its sizes; ``wrapped`` (M, 3) may be anybody's in between."""
    beads, some = len(wrapped), np.zeros((chunks, 3, int(_SOME)))
    padded, its = (beads + 2 * int(_FEW), beads) if named else (0, 0)
    of_names = np.zeros(padded, np.uint32), np.full(padded, 2**32 - 1, np.uint32), np.zeros(its, np.uint32)
    of_chunks = np.zeros((chunks, cells), np.uint32), np.zeros(chunks, np.bool_), np.zeros(chunks, np.uint32)
    return CellScratch(np.zeros(beads, np.uint32), wrapped, some, np.zeros(beads, np.uint32), *of_names, *of_chunks)


def first_unusable(x: np.ndarray, beads: np.ndarray, grid: Grid) -> int:
    """The first bead whose position is not finite, or so far away that it is in no cell."""
    edges = _edges.py_func(grid)
    with np.errstate(invalid="ignore", over="ignore"):
        return int(beads[np.argmin(_usable.py_func(*_fractions.py_func(*x[beads].T, edges)))])


@helper
def most_near(count, layer):
    """How many beads can be near a column, at most: they lie in two layers of so many cells, and none is copied more than twice (across a
    face along x)."""
    most = np.uint64(0)
    for k in range(0, len(count) - layer, layer):
        most = max(most, count[k + layer] - count[k])
    return 4 * np.int64(most)


@inlined
def _beads_in(place, first, last):
    """How many beads are in cells."""
    total = np.uint32(0)
    for chunk in range(np.uint64(place.shape[0])):
        for k in range(np.uint64(first), np.uint64(last)):
            total += place[chunk, k]
    return total


@inlined
def _first_places(place, count, first, last, total):
    """From the number of beads of each chunk in each of these cells to the place of the first of them; ``total`` are in those before."""
    for k in range(np.uint64(first), np.uint64(last)):
        count[k] = total
        for chunk in range(np.uint64(place.shape[0])):
            here = place[chunk, k]
            place[chunk, k] = total
            total += here


def _bin_beads(x, beads, names, of_beads, grid, scratch, count, order, seats, xs, sorted_types, sorted_inv_mass, found, part, parts, team):
    """Counting sort of the ``beads`` that take part by cell (x fastest, then y), and by their numbers in each.  Writes ``count`` (ncells +
    1,), the first sorted bead of each cell; ``order`` (M,), the number of each sorted bead, and ``seats`` (M,), its row in other arrays;
    ``xs`` (3, M or more), its position, wrapped into the grid; and what else is sorted.  Returns 1 where a position is not finite;
    ``found`` gets how many beads can be near a column."""
    place, usable = scratch.place, scratch.usable
    for chunk in range(part, len(usable), parts):
        usable[chunk] = _count_chunk(x, beads, grid, scratch, chunk)
    meet(team, parts)
    for chunk in range(len(usable)):
        if not usable[chunk]:
            return 1
    cells, before = len(count) - 1, np.uint64(0)
    first, last = cells * part // parts, cells * (part + 1) // parts
    if parts > 1:
        scratch.beads_in[part] = _beads_in(place, first, last)
        meet(team, parts)
        for k in range(part):
            before += scratch.beads_in[k]
    _first_places(place, count, first, last, before)
    if part == 0:
        count[cells] = len(beads)
    meet(team, parts)
    for chunk in range(part, len(usable), parts):
        _place_chunk(beads, names, scratch, chunk)
    meet(team, parts)
    if part == 0:
        found[0] = most_near(count, grid.nx * grid.ny)
    if len(names):
        _sort_cells(scratch.numbers, scratch.cells, count, first, last, scratch.to)
    _fill_in(beads, scratch, count[first], count[last], len(names) > 0, order, seats, xs, of_beads, sorted_types, sorted_inv_mass)
    return 0


bin_beads = Kernel(_bin_beads)
