"""The pairs of one layer of terms at one set of positions, in coloured columns (see :mod:`.cells` and :mod:`.listing`)."""

from typing import NamedTuple

import numpy as np

from ..errors import RunError
from ..geometry import widths
from . import cells, listing
from .threads import dispatch, get_threads

#: Exceptions of a list without any: bonded neighbours in compressed rows, start (N + 1,), bead (E,), factor (E,).
Exceptions = tuple[np.ndarray, np.ndarray, np.ndarray]


def no_exceptions() -> Exceptions:
    """Exceptions of beads that have none: the rows have no start."""
    return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)


def compressed_exceptions(factors: dict[tuple[int, int], float], n_beads: int) -> Exceptions:
    """Factors of pairs of beads as exceptions, which stand there in both directions."""
    if not factors:
        return no_exceptions()
    rows = sorted([(i, j, f) for (i, j), f in factors.items()] + [(j, i, f) for (i, j), f in factors.items()])
    first = np.array([row[0] for row in rows])
    start = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=n_beads))])
    return start.astype(np.int64), np.array([row[1] for row in rows], np.int64), np.array([row[2] for row in rows])


class Pairs(NamedTuple):
    """What the loops over pairs read, M beads sorted into cells.

    Attributes
    ----------
    order : (M,) array
        Index of each sorted bead; the pairs count sorted beads.
    types, inv_mass : (M,) arrays
    ntypes : int
    pi, pj : (room,) arrays of uint32
        Beads of each pair.
    geometry : (4, room) array
        Unit vector from j to i, and distance.
    factors : (room,) array
        Factors of bonded neighbours; of length 0 if there are none.
    columns, block_start, colour_start : arrays
        Columns in blocks, blocks in colours.
    start, found : arrays
        Column c has the pairs start[c]:start[c] + found[c].
    energy, virial : arrays
        A number for each column, see :mod:`.columns`.
    """

    order: np.ndarray
    types: np.ndarray
    inv_mass: np.ndarray
    ntypes: int
    pi: np.ndarray
    pj: np.ndarray
    geometry: np.ndarray
    factors: np.ndarray
    columns: np.ndarray
    block_start: np.ndarray
    colour_start: np.ndarray
    start: np.ndarray
    found: np.ndarray
    energy: np.ndarray
    virial: np.ndarray


class Scratch(NamedTuple):
    """Space for what is computed for all pairs of a column at once, for each thread: four rows of numbers; hashes; indices."""

    values: np.ndarray
    bits: np.ndarray
    tail: np.ndarray


class PairList:
    """Lists the pairs of beads that are within reach of each other.

    Parameters
    ----------
    types : (N,) int32 array
        Type of each particle; -1 for one that takes no part.
    inv_mass : (N,) array
        1/mass, sorted with the beads for who reads the list.
    cutoff : (T, T) array
        Range for each pair of types; 0 means no interaction.
    exceptions : three arrays
        Bonded neighbours in compressed rows: start (N + 1,), bead (E,), factor (E,); start is empty if there are none.
    """

    def __init__(self, types: np.ndarray, inv_mass: np.ndarray, cutoff: np.ndarray, exceptions: Exceptions | None = None):
        self.beads = np.flatnonzero(types >= 0)
        self.ntypes = len(cutoff)
        self.exceptions = no_exceptions() if exceptions is None else exceptions
        self._shape: tuple[int, int, int] | None = None
        self._grid: cells.Grid
        self.set_cutoff(cutoff)
        m = len(self.beads)
        self.order, self.xs = np.zeros(m, np.uint32), np.zeros((3, m + listing.LANES))
        self.types, self.inv_mass = np.zeros(m, np.int32), np.zeros(m)
        mine = inv_mass[self.beads]
        #: 1/mass of all the beads if it is the same, otherwise None.
        self.common_inv_mass: float | None = None
        if m and np.all(mine == mine[0]):
            self.common_inv_mass, self.inv_mass[:] = float(mine[0]), mine[0]
        self._of_beads = cells.OfBeads(types[: 0 if self.ntypes == 1 else None], inv_mass[: None if self.common_inv_mass is None else 0])
        self._sorting: cells.CellScratch | None = None
        # unsigned (like start and found): numba looks out for negative indices otherwise, in every loop over pairs
        self.pi = self.pj = np.zeros(0, np.uint32)
        self.geometry, self.factors = np.zeros((4, 0)), np.zeros(0)
        self._arrays: Pairs | None = None
        self._space: listing.ListingSpace | None = None
        self._longest, self._scratch = 0, Scratch(np.empty((0, 4, 0)), np.empty((0, 0), np.uint64), np.empty((0, 0), np.uint32))

    def set_cutoff(self, cutoff: np.ndarray) -> None:
        """Another range."""
        self.cutoff = float(cutoff.max())
        self._cut2 = np.ascontiguousarray(cutoff.ravel() ** 2)
        self._grid_box: np.ndarray | None = None

    @property
    def alike(self) -> bool:
        """Whether all pairs have the same types and the factor 1."""
        return self.ntypes == 1 and not len(self.exceptions[0])

    def grid(self, x: np.ndarray, box: np.ndarray | None) -> cells.Grid:
        """Cells, no more than twice the beads.  Those of a box are kept for the next call."""
        if box is not None and self._grid_box is not None and np.all(box == self._grid_box):
            return self._grid
        if box is None:
            used = x[self.beads]
            bad = np.flatnonzero(~np.isfinite(used).all(axis=1))
            if len(bad):
                raise RunError(f"the position of bead {self.beads[bad[0]]} is not finite: {used[bad[0]].tolist()}")
            origin = used.min(axis=0)
            wide = np.maximum(used.max(axis=0) - origin, self.cutoff) * (1 + 1e-9)
            extent = np.diag(wide)
        else:
            origin, extent = np.zeros(3), box.copy()
            wide = widths(box)
        ncell = np.maximum((wide / self.cutoff).astype(np.int64), 1)
        while np.prod(ncell, dtype=float) > max(64, 2 * len(self.beads)) and ncell.max() > 3:
            ncell[ncell.argmax()] = max(3, int(ncell.max() * 0.8))
        if box is not None and ncell.min() < 3:
            ncell[:] = 1  # too narrow for cells
        self._grid_box = None if box is None else extent
        self._grid = cells.Grid(extent, origin, box is not None, *(int(n) for n in ncell))
        return self._grid

    def _resize(self, shape: tuple[int, int, int]) -> None:
        if shape == self._shape:
            return
        nx, ny, nz = self._shape = shape
        self.count = np.zeros(nx * ny * nz + 1, np.uint64)
        self.columns, self.block_start, self.colour_start = cells.colours(ny, nz)
        self.found = np.zeros(ny * nz, np.uint64)
        self.energy, self.virial = np.zeros(ny * nz), np.zeros(ny * nz)
        self.start = np.zeros(ny * nz + 1, np.uint64)
        self._arrays = None

    def _make_room(self) -> None:
        """Give every column an eighth more room than it needed, and never less than it had: columns fluctuate."""
        self.start[1:] = np.cumsum(np.maximum(np.diff(self.start), self.found + self.found // 8 + 48))
        room, self._longest = int(self.start[-1]), int(np.diff(self.start).max())
        self.pi, self.pj = np.empty(room, np.uint32), np.empty(room, np.uint32)
        self.geometry = np.empty((4, room))
        self.factors = np.empty(room if len(self.exceptions[0]) else 0)
        self._arrays = None

    def bin(self, x: np.ndarray, grid: cells.Grid, chunks: int) -> None:
        """Sort the beads into cells; the threads share them in so many chunks, whose counts are summed by one thread."""
        sizes = chunks, len(self.count) - 1
        if self._sorting is None or self._sorting.place.shape != sizes:
            self._sorting = cells.scratch_for(len(self.beads), *sizes)
        out = self.count, self.order, self.xs, self.types, self.inv_mass
        bad = dispatch(cells.bin_beads, cells.bin_beads_parallel, x, self.beads, self._of_beads, grid, self._sorting, *out)
        if bad >= 0:
            raise RunError(f"the position of bead {bad} is not finite: {x[bad].tolist()}")

    def list(self, grid: cells.Grid, parts: int) -> None:
        """List the pairs of the sorted beads; the threads share the columns in so many parts."""
        rule = listing.Rule(self._cut2, self.cutoff**2, self.ntypes, *self.exceptions)
        beads = self.xs, self.order, self.types
        most = listing.beads_near(self.count, grid)
        if self._space is None or self._space.own.shape != (parts, grid.nx + 3) or self._space.bead.shape[1] < most + 64:
            self._space = listing.space_for(parts, grid.nx, most + most // 4)
        while True:
            out = listing.Found(self.start, self.found, self.pi, self.pj, self.geometry, self.factors)
            if grid.periodic and (grid.nx, grid.ny, grid.nz) == (1, 1, 1):
                enough = listing.list_pairs_small_box(*beads, grid.box, rule, out)
            else:
                enough = dispatch(listing.list_pairs, listing.list_pairs_parallel, *beads, self.count, grid, rule, self._space, out)
            if enough:
                return
            self._make_room()

    def build(self, x: np.ndarray, box: np.ndarray | None) -> None:
        """List the pairs at the positions x (N, 3)."""
        grid = self.grid(x, box)
        self._resize((grid.nx, grid.ny, grid.nz))
        self.bin(x, grid, min(get_threads(), 8))
        self.list(grid, min(get_threads(), len(self.found)))

    @property
    def arrays(self) -> Pairs:
        """What the loops over pairs read; not valid any more after the next :meth:`build`."""
        if self._arrays is None:
            of_beads = self.order, self.types, self.inv_mass, self.ntypes
            of_pairs = self.pi, self.pj, self.geometry, self.factors
            of_columns = self.columns, self.block_start, self.colour_start, self.start, self.found, self.energy, self.virial
            self._arrays = Pairs(*of_beads, *of_pairs, *of_columns)
        return self._arrays

    @property
    def scratch(self) -> Scratch:
        """Space for the longest column, one for each thread."""
        threads, longest = get_threads(), self._longest + 1
        if self._scratch.tail.shape != (threads, longest):
            numbers = np.empty((threads, 4, longest)), np.empty((threads, longest), np.uint64)
            self._scratch = Scratch(*numbers, np.empty((threads, longest), np.uint32))
        return self._scratch

    def listed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray | float]:
        """Beads i and j, directions e (P, 3), distances and factors of all pairs."""
        rows = self.rows
        e, r = self.geometry[:3, rows].T, self.geometry[3, rows]
        return self.order[self.pi[rows]], self.order[self.pj[rows]], e, r, self.factors[rows] if len(self.factors) else 1.0

    @property
    def rows(self) -> np.ndarray:
        """Numbers of all pairs, in the order in which a loop meets them (see :mod:`.columns`)."""
        ranges = zip(self.start[self.columns].tolist(), self.found[self.columns].tolist(), strict=True)
        return np.concatenate([np.arange(begin, begin + count) for begin, count in ranges])
