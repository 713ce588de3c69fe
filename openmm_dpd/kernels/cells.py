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
def _fractions(px, py, pz, box, inverse, origin):
    """Position in units of the (lower-triangular) box vectors; inverse holds one over the diagonal of the box."""
    sz = (pz - origin[2]) * inverse[2]
    sy = (py - origin[1] - sz * box[2, 1]) * inverse[1]
    sx = (px - origin[0] - sz * box[2, 0] - sy * box[1, 0]) * inverse[0]
    return sx, sy, sz


def _bin_beads(x, beads, types, inv_mass, box, origin, periodic, ncell, cell, place, bad, count, order, xs, sorted_types, sorted_inv_mass):
    """Counting sort of the beads by cell (y fastest, then x), stable in the bead's index.

    Parameters
    ----------
    x : (N, 3) positions; beads : (M,) indices of the beads that take part
    types, inv_mass : (N,) what is sorted with the positions
    box : (3, 3) lower-triangular box vectors; without a box the extent of the grid
    origin : (3,) lower corner of the grid; ncell : (3,) cells along each axis
    cell : (M,) scratch; place : (chunks, ncells) scratch; bad : (chunks,) scratch: the threads share the beads in as many chunks
    count : (ncells + 1,) out: first sorted bead of each cell
    order : (M,) out: index of each sorted bead; xs : (M, 3) out: its position, wrapped into the grid
    sorted_types, sorted_inv_mass : (M,) out

    Returns
    -------
    int
        -1, or the index of the first bead whose position is not finite.
    """
    nx, ny, nz = ncell
    m, chunks = len(beads), len(bad)
    inverse = (1.0 / box[0, 0], 1.0 / box[1, 1], 1.0 / box[2, 2])
    for chunk in prange(chunks):
        bad[chunk] = -1
        for k in range(nx * ny * nz):
            place[chunk, k] = 0
        for k in range(m * chunk // chunks, m * (chunk + 1) // chunks):
            i = beads[k]
            sx, sy, sz = _fractions(x[i, 0], x[i, 1], x[i, 2], box, inverse, origin)
            if not (abs(sx) < 1e15 and abs(sy) < 1e15 and abs(sz) < 1e15):
                bad[chunk] = i
                break
            if periodic:
                sx -= np.floor(sx)
                sy -= np.floor(sy)
                sz -= np.floor(sz)
            cx = min(int(sx * nx), nx - 1)
            cy = min(int(sy * ny), ny - 1)
            cz = min(int(sz * nz), nz - 1)
            cell[k] = (cz * nx + cx) * ny + cy
            place[chunk, cell[k]] += 1
    for chunk in range(chunks):
        if bad[chunk] >= 0:
            return bad[chunk]
    # from the number of beads of each chunk in each cell to the place of the first of them
    total = 0
    for k in range(nx * ny * nz):
        count[k] = total
        for chunk in range(chunks):
            here = place[chunk, k]
            place[chunk, k] = total
            total += here
    count[nx * ny * nz] = total
    for chunk in prange(chunks):
        for k in range(m * chunk // chunks, m * (chunk + 1) // chunks):
            i, n = beads[k], place[chunk, cell[k]]
            place[chunk, cell[k]] += 1
            px, py, pz = x[i, 0], x[i, 1], x[i, 2]
            if periodic:
                # the same turns as above: a bead on a face must get the position of the cell it was put into
                sx, sy, sz = _fractions(px, py, pz, box, inverse, origin)
                tx, ty, tz = np.floor(sx), np.floor(sy), np.floor(sz)
                px -= tz * box[2, 0] + ty * box[1, 0] + tx * box[0, 0]
                py -= tz * box[2, 1] + ty * box[1, 1]
                pz -= tz * box[2, 2]
            xs[n, 0] = px
            xs[n, 1] = py
            xs[n, 2] = pz
            order[n] = i
            sorted_types[n] = types[i]
            sorted_inv_mass[n] = inv_mass[i]
    return -1


bin_beads, bin_beads_parallel = serial_and_parallel(_bin_beads)


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
def _neighbour_rows(cy, cz, ncell, box, periodic, row, width, shift):
    """The column (cy, cz) and the four whose beads it meets, as rows of cells that follow each other in the order of cells.

    Writes for each row its first cell at x = 0, how many cells it takes there, and the lattice vector to add; returns how many rows.
    """
    nx, ny, nz = ncell
    n = 0
    for side in range(5):
        # the column itself, then (y+1, z), (y-1, z+1), (y, z+1), (y+1, z+1)
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
        cell = z * nx * ny + y
        if n > 1 and cell == row[n - 1] + width[n - 1]:
            width[n - 1] += 1
            continue
        row[n], width[n] = cell, 1
        shift[n, 0], shift[n, 1], shift[n, 2] = sx, sy, sz
        n += 1
    return n


# The loops below run over unsigned indices: with signed ones numba looks out for indices below zero, and nothing is vectorised.


@njit
def _copy(xs, begin, end, sx, sy, sz, n, bx, by, bz, bead):
    """Append sorted beads begin:end, shifted, to the n beads there are; returns how many there are then."""
    for j in range(begin, end):
        bx[n] = xs[j, 0] + sx
        by[n] = xs[j, 1] + sy
        bz[n] = xs[j, 2] + sz
        bead[n] = j
        n += np.uint64(1)
    return n


@njit
def _gather(xs, cy, cz, ncell, box, periodic, count, rows, own, others, bx, by, bz, bead):
    """Copy all beads near the column (cy, cz) one after the other: for each x from -1 to nx its own beads, then those of its neighbours.

    The own beads of cell x are own[x + 1]:others[x + 1], the others are others[x + 1]:own[x + 2].
    """
    nx, ny, nz = ncell
    row, width, shift = rows
    n_rows = _neighbour_rows(cy, cz, ncell, box, periodic, row, width, shift)
    n = np.uint64(0)
    for cx in range(-1, nx + 1):
        own[cx + 1] = others[cx + 1] = n
        turn = 0.0
        at = cx
        if cx < 0 or cx == nx:
            if not periodic:
                continue
            turn, at = (-box[0, 0], nx - 1) if cx < 0 else (box[0, 0], 0)
        for k in range(n_rows):
            if k == 0 and cx < 0:
                continue  # these pairs are found from the other end
            cell = row[k] + at * ny
            n = _copy(xs, count[cell], count[cell + width[k]], shift[k, 0] + turn, shift[k, 1], shift[k, 2], n, bx, by, bz, bead)
            if k == 0:
                others[cx + 1] = n
    own[nx + 2] = n


@njit
def _mark(x, y, z, begin, end, cut2, bx, by, bz, hit):
    """Set hit[k] to 1 for those of the beads begin:end that are closer than the cutoff, to 0 for the others."""
    for k in range(begin, end):
        dx = x - bx[k]
        dy = y - by[k]
        dz = z - bz[k]
        hit[k] = dx * dx + dy * dy + dz * dz < cut2


@njit
def _collect(begin, end, hit, near):
    """Indices of the hits among begin:end; without a branch, which the processor could not foresee.  Returns how many there are."""
    n = np.uint64(0)
    for k in range(begin, end):
        near[n] = k
        n += hit[k]
    return n


def _list_pairs(xs, order, types, ntypes, cut2, cut2max, exc, box, periodic, ncell, count, tasks, start, found, pi, pj, geometry, factors):
    """List all pairs, column by column; column c writes to start[c]:start[c+1] and reports in found[c] how many there are.

    Returns whether there was room for all of them.  The threads share the columns in as many parts as there are tasks.  A column first
    copies all beads it meets, shifted to where it meets them, in the order of x: what a bead is compared with is then one range.
    """
    nx, ny, nz = ncell
    # the beads near a column lie in two layers of cells, and none of them is copied more than twice (across a face along x)
    most = 0
    for z in range(nz):
        most = max(most, 4 * (count[(z + 1) * nx * ny] - count[z * nx * ny]))
    for task in prange(tasks):
        bx, by, bz, hit = np.empty(most), np.empty(most), np.empty(most), np.empty(most, np.uint64)
        bead, near = np.empty(most, np.uint32), np.empty(most, np.uint32)
        own, others = np.empty(nx + 3, np.uint64), np.empty(nx + 3, np.uint64)
        rows = np.empty(5, np.int64), np.empty(5, np.int64), np.empty((5, 3))
        for column in range(ny * nz * task // tasks, ny * nz * (task + 1) // tasks):
            _gather(xs, column % ny, column // ny, ncell, box, periodic, count, rows, own, others, bx, by, bz, bead)
            n, end = start[column], start[column + 1]
            for cx in range(nx):
                begin, stop = others[cx], own[cx + 3]
                for s in range(own[cx + 1], others[cx + 1]):
                    i, x, y, z = bead[s], bx[s], by[s], bz[s]
                    bx[s] = np.inf  # this bead has met all it has to meet
                    _mark(x, y, z, begin, stop, cut2max, bx, by, bz, hit)
                    for q in range(_collect(begin, stop, hit, near)):
                        k = near[q]
                        j = bead[k]
                        dx, dy, dz = x - bx[k], y - by[k], z - bz[k]
                        r2 = dx * dx + dy * dy + dz * dz
                        if r2 < R_MIN2 or (ntypes > 1 and r2 >= cut2[types[i] * ntypes + types[j]]):
                            continue
                        factor = 1.0
                        if len(exc[0]):
                            factor = _factor(exc[0], exc[1], exc[2], order[i], order[j])
                            if factor == 0.0:
                                continue
                        _put(i, j, dx, dy, dz, r2, factor, n, end, pi, pj, geometry, factors)
                        n += np.uint64(1)
            found[column] = n - start[column]
    enough = True
    for column in range(ny * nz):
        enough = enough and found[column] <= start[column + 1] - start[column]
    return enough


list_pairs, list_pairs_parallel = serial_and_parallel(_list_pairs)


@compiled
def list_pairs_small_box(xs, order, types, ntypes, cut2, cut2max, exc, box, start, found, pi, pj, geometry, factors):
    """All pairs by minimum image, for boxes too narrow for three cells; one column holds them all.  Returns whether there was room."""
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
                n += np.uint64(1)
    found[0] = n - start[0]
    return n <= end


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
