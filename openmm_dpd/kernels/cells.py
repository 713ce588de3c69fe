"""Pairs within the cutoff: bin the beads into cells, sort them, and list the pairs column by column.

The order of pairs is a function of the present positions alone.  A *column* is all cells with the same (y, z); it owns the pairs of its
beads among themselves and with four neighbouring columns.  Blocks of columns are coloured so that two blocks of one colour never touch the
same bead: threads can work on the blocks of one colour in any order, and the sums and sweeps come out bit for bit the same for any number
of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from scipy.spatial import cKDTree

from .compiled import compiled, serial_and_parallel

#: Square of the distance (nm^2) below which a pair exerts no force.
R_MIN2 = 1e-20


@njit(inline="always")
def _fractions(px, py, pz, box, origin):
    """Position in units of the (lower-triangular) box vectors."""
    sz = (pz - origin[2]) / box[2, 2]
    sy = (py - origin[1] - sz * box[2, 1]) / box[1, 1]
    sx = (px - origin[0] - sz * box[2, 0] - sy * box[1, 0]) / box[0, 0]
    return sx, sy, sz


@compiled
def bin_beads(x, beads, box, origin, periodic, ncell, cell, count, order, xs):
    """Counting sort of the beads by cell (x fastest), stable in the bead's index.

    Parameters
    ----------
    x : (N, 3) positions; beads : (M,) indices of the beads that take part
    box : (3, 3) lower-triangular box vectors; without a box the extent of the grid
    origin : (3,) lower corner of the grid; ncell : (3,) cells along each axis
    cell : (M,) scratch; count : (ncells + 1,) out: first sorted bead of each cell
    order : (M,) out: index of each sorted bead; xs : (M, 3) out: its position, wrapped into the grid

    Returns
    -------
    int
        -1, or the index of the first bead whose position is not finite.
    """
    nx, ny, nz = ncell
    for k in range(nx * ny * nz + 1):
        count[k] = 0
    for k in range(len(beads)):
        i = beads[k]
        sx, sy, sz = _fractions(x[i, 0], x[i, 1], x[i, 2], box, origin)
        if not (abs(sx) < 1e15 and abs(sy) < 1e15 and abs(sz) < 1e15):
            return i
        if periodic:
            sx -= np.floor(sx)
            sy -= np.floor(sy)
            sz -= np.floor(sz)
        cx = min(int(sx * nx), nx - 1)
        cy = min(int(sy * ny), ny - 1)
        cz = min(int(sz * nz), nz - 1)
        cell[k] = (cz * ny + cy) * nx + cx
        count[cell[k] + 1] += 1
    for k in range(nx * ny * nz):
        count[k + 1] += count[k]
    for k in range(len(beads)):
        i = beads[k]
        place = count[cell[k]]
        count[cell[k]] += 1
        order[place] = i
        px, py, pz = x[i, 0], x[i, 1], x[i, 2]
        if periodic:
            # the same turns as above: a bead on a face must get the position of the cell it was put into
            sx, sy, sz = _fractions(px, py, pz, box, origin)
            tx, ty, tz = np.floor(sx), np.floor(sy), np.floor(sz)
            px -= tz * box[2, 0] + ty * box[1, 0] + tx * box[0, 0]
            py -= tz * box[2, 1] + ty * box[1, 1]
            pz -= tz * box[2, 2]
        xs[place, 0] = px
        xs[place, 1] = py
        xs[place, 2] = pz
    # the scatter moved every count to the end of its cell, which is where the next one starts
    for k in range(nx * ny * nz, 0, -1):
        count[k] = count[k - 1]
    count[0] = 0
    return -1


def colours(ny: int, nz: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns in blocks, blocks in colours: (columns, first column of each block, first block of each colour).

    Column (y, z) touches y-1..y+1 and z..z+1.  Blocks are at least two columns wide in y and one in z, and there is an even number of them
    (or one) along either axis, so that neighbouring blocks can alternate between two colours, around the periodic box too, and blocks
    of one colour never touch the same bead.  Four colours at most: every colour costs the threads a rendezvous.
    """

    def edges(n: int, width: int) -> np.ndarray:
        count = n // width - (n // width) % 2 if n >= 2 * width else 1
        return np.array([n * k // count for k in range(count + 1)])

    y_edges, z_edges = edges(ny, 2), edges(nz, 1)
    blocks: list[list[list[int]]] = [[], [], [], []]
    for bz in range(len(z_edges) - 1):
        for by in range(len(y_edges) - 1):
            inside = [z * ny + y for z in range(z_edges[bz], z_edges[bz + 1]) for y in range(y_edges[by], y_edges[by + 1])]
            blocks[2 * (bz % 2) + by % 2].append(inside)
    ordered = [block for colour in blocks for block in colour]
    columns = np.array([column for block in ordered for column in block], dtype=np.int64)
    block_start = np.concatenate([[0], np.cumsum([len(block) for block in ordered])]).astype(np.int64)
    colour_start = np.concatenate([[0], np.cumsum([len(colour) for colour in blocks if colour])]).astype(np.int64)
    return columns, block_start, colour_start


@njit(inline="always")
def _factor(exc_start, exc_bead, exc_factor, i, j):
    """Factor of the bonded neighbours i, j; 1 if they are none."""
    for k in range(exc_start[i], exc_start[i + 1]):
        if exc_bead[k] == j:
            return exc_factor[k]
    return 1.0


@njit(inline="always")
def _put(i, j, dx, dy, dz, r2, factor, n, end, pi, pj, geometry, factors):
    """Write pair number n if there is room; the caller counts it anyway, and learns how much room it takes."""
    if n < end:
        r = np.sqrt(r2)
        pi[n] = i
        pj[n] = j
        inverse = 1.0 / r
        geometry[n, 0] = dx * inverse
        geometry[n, 1] = dy * inverse
        geometry[n, 2] = dz * inverse
        geometry[n, 3] = r
        if len(factors):
            factors[n] = factor


@njit
def _neighbour_ranges(cx, cy, cz, ncell, box, periodic, count, first, last, shift):
    """Sorted beads in half of the cells around (cx, cy, cz), as ranges with the lattice vector to add to each; returns how many."""
    nx, ny, nz = ncell
    n = 0
    for side in range(5):
        # the own column (only the next cell along x), then (y+1, z), (y-1, z+1), (y, z+1), (y+1, z+1)
        y = cy + (0 if side == 0 else 1 if side == 1 else side - 3)
        z = cz + (0 if side < 2 else 1)
        sx, sy, sz = 0.0, 0.0, 0.0
        if y < 0 or y >= ny or z >= nz:
            if not periodic:
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
        row = (z * ny + y) * nx
        lower = cx + 1 if side == 0 else max(cx - 1, 0)
        upper = min(cx + 1, nx - 1)
        if lower <= upper:
            first[n], last[n] = count[row + lower], count[row + upper + 1]
            shift[n, 0], shift[n, 1], shift[n, 2] = sx, sy, sz
            n += 1
        if periodic and cx == 0 and side > 0:
            first[n], last[n] = count[row + nx - 1], count[row + nx]
            shift[n, 0], shift[n, 1], shift[n, 2] = sx - box[0, 0], sy, sz
            n += 1
        if periodic and cx == nx - 1:
            first[n], last[n] = count[row], count[row + 1]
            shift[n, 0], shift[n, 1], shift[n, 2] = sx + box[0, 0], sy, sz
            n += 1
    return n


def _list_pairs(
    xs, order, types, ntypes, cut2, cut2max, exc, box, periodic, ncell, count, columns, start, found, pi, pj, geometry, factors
):
    """List all pairs, column by column; column c writes to start[c]:start[c+1] and reports in found[c] how many there are."""
    nx, ny, nz = ncell
    for task in prange(len(columns)):
        column = columns[task]
        first, last = np.empty(12, np.int64), np.empty(12, np.int64)
        shift = np.empty((12, 3))
        n, end = start[column], start[column + 1]
        for cx in range(nx):
            cell = column * nx + cx
            if count[cell] == count[cell + 1]:
                continue
            ranges = _neighbour_ranges(cx, column % ny, column // ny, ncell, box, periodic, count, first, last, shift)
            first[ranges], last[ranges] = 0, count[cell + 1]  # the rest of the own cell
            shift[ranges, 0], shift[ranges, 1], shift[ranges, 2] = 0.0, 0.0, 0.0
            for i in range(count[cell], count[cell + 1]):
                first[ranges] = i + 1
                for k in range(ranges + 1):
                    xi, yi, zi = xs[i, 0] - shift[k, 0], xs[i, 1] - shift[k, 1], xs[i, 2] - shift[k, 2]
                    for j in range(first[k], last[k]):
                        dx = xi - xs[j, 0]
                        dy = yi - xs[j, 1]
                        dz = zi - xs[j, 2]
                        r2 = dx * dx + dy * dy + dz * dz
                        if r2 < cut2max and r2 >= R_MIN2:
                            if ntypes > 1 and r2 >= cut2[types[i] * ntypes + types[j]]:
                                continue
                            factor = 1.0
                            if len(exc[0]):
                                factor = _factor(exc[0], exc[1], exc[2], order[i], order[j])
                                if factor == 0.0:
                                    continue
                            _put(i, j, dx, dy, dz, r2, factor, n, end, pi, pj, geometry, factors)
                            n += 1
        found[column] = n - start[column]


list_pairs, list_pairs_parallel = serial_and_parallel(_list_pairs)


@compiled
def list_pairs_small_box(xs, order, types, ntypes, cut2, cut2max, exc, box, start, found, pi, pj, geometry, factors):
    """All pairs by minimum image, for boxes too narrow for three cells; one column holds them all."""
    n, end = start[0], start[1]
    for i in range(len(order)):
        for j in range(i + 1, len(order)):
            dx, dy, dz = xs[i, 0] - xs[j, 0], xs[i, 1] - xs[j, 1], xs[i, 2] - xs[j, 2]
            turns = np.floor(dz / box[2, 2] + 0.5)
            dx -= turns * box[2, 0]
            dy -= turns * box[2, 1]
            dz -= turns * box[2, 2]
            turns = np.floor(dy / box[1, 1] + 0.5)
            dx -= turns * box[1, 0]
            dy -= turns * box[1, 1]
            dx -= np.floor(dx / box[0, 0] + 0.5) * box[0, 0]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < cut2max and r2 >= R_MIN2:
                if ntypes > 1 and r2 >= cut2[types[i] * ntypes + types[j]]:
                    continue
                factor = 1.0
                if len(exc[0]):
                    factor = _factor(exc[0], exc[1], exc[2], order[i], order[j])
                    if factor == 0.0:
                        continue
                _put(i, j, dx, dy, dz, r2, factor, n, end, pi, pj, geometry, factors)
                n += 1
    found[0] = n - start[0]


def coincident_pairs(x: np.ndarray, box: np.ndarray | None, distance: float) -> list[tuple[int, int]]:
    """Pairs (i < j) of beads closer than a (very short) distance, through the periodic box."""
    if box is None:
        tree = cKDTree(x)
    else:
        fractional = np.linalg.solve(box.T, x.T).T % 1.0
        # beads on two sides of a face are copied across it, so that the search itself needs no periodicity
        margin = distance / np.diag(box).min() * 4
        copies, owners = [fractional], [np.arange(len(x))]
        for axis in range(3):
            points, owner = np.concatenate(copies), np.concatenate(owners)
            near = points[:, axis] < margin
            shifted = points[near].copy()
            shifted[:, axis] += 1.0
            copies.append(shifted)
            owners.append(owner[near])
        tree, owner = cKDTree(np.concatenate(copies) @ box), np.concatenate(owners)
        found = {tuple(sorted((int(owner[i]), int(owner[j])))) for i, j in tree.query_pairs(distance)}
        return sorted((i, j) for i, j in found if i != j)
    return sorted((int(i), int(j)) for i, j in tree.query_pairs(distance))
