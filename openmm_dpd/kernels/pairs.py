"""The pairs of one layer of terms at one set of positions, in columns (see :mod:`.cells` and :mod:`.listing`)."""

from typing import Any, NamedTuple

import numpy as np

from ..base.errors import RunError, bead_number
from ..base.geometry import most_tilted, widths
from ..runtime import threads_for
from . import cells, listing
from .exceptions import Exceptions, most_apart, no_exceptions
from .shares import Shares, abreast, blocks_of, by_colours, share_out

#: From so many beads on all their pairs are more than what the processor has at hand: to list them again is faster than to read them.
MANY = 50_000
#: After so many lists of many beads it is looked again how the work is shared.
_SHARED = 20


class Pairs(NamedTuple):
    """What the loops over pairs read, M beads sorted into cells."""

    order: np.ndarray  #: (M,) number of each sorted bead; the pairs count sorted beads
    seats: np.ndarray  #: (M,) its row in arrays of beads: the same number, where these have them in the order of their numbers
    types: np.ndarray  # (M,)
    inv_mass: np.ndarray  #: (M,)
    ntypes: int
    pi: np.ndarray  # pi, pj: (room,) uint32, beads of each pair
    pj: np.ndarray
    geometry: np.ndarray  #: (4, room) unit vector from j to i, and distance
    factors: np.ndarray  #: (room,) factors of bonded neighbours; of length 0 if there are none
    start: np.ndarray  # start, found: column c has the pairs start[c]:start[c] + found[c]
    found: np.ndarray
    sums: np.ndarray  #: (columns, 5) sums over the pairs of each column, see :mod:`.columns`
    stress: np.ndarray  #: (columns, 6) its stress tensor; of length 0 where none is asked for
    #: An array with the rate of a Lees-Edwards shear, to whose flow velocities are relative; 0 without any: then loops are compiled apart
    flow: np.ndarray | int = 0


#: Rounds in which sweeps go through a list that is spread.
ROUNDS = 4
#: So many pairs are computed together: few enough for the processor to have all of them at hand.
CHUNK = 128


def rows(count: int) -> tuple[np.uint64, ...]:
    """Where so many rows of numbers of a chunk begin.  So far apart they do not compete for the same places in a cache, and since compilers
    know the distance, loops are vectorised whatever rows they read and write."""
    return tuple(np.uint64((CHUNK + 8) * k) for k in range(count))


#: Where the second row begins.
SECOND = rows(2)[1]


class Scratch(NamedTuple):
    """Space for what is computed for many pairs at once, for each thread, in :func:`rows`."""

    values: np.ndarray  #: Numbers
    bits: np.ndarray  #: Keys of the noise of the pairs; of one of their streams; the sign of a number that has a direction
    indices: np.ndarray  #: Rows of the table of coefficients; pairs that are to be looked at again


def _without_room(columns: int) -> tuple[np.ndarray, ...]:
    """So many columns that have no room for pairs yet: the last items of :class:`Pairs`."""
    return np.zeros(columns + 1, np.uint64), np.zeros(columns, np.uint64), np.zeros((columns, 5)), np.zeros((0, 6))


class PairList:
    """Lists the pairs of beads that are within reach of each other: beads of types >= 0, in the range of two types (0: no interaction).

    An error, or Ctrl-C, may come before any line.  So arrays that have to fit each other are made first, and taken over together in one
    statement, with what says which ones they are; after an error the next :meth:`build` goes on with those before or those after it.

    ``inv_mass`` is sorted with the beads for who reads the list.  If it ``passes`` pairs on, those of ``many`` beads are stored only if
    somebody reads :attr:`arrays`.  Otherwise loops list the pairs of a column when they come to it.
    """

    #: Whether the pairs of a bead are listed far apart, and sweeps go through the list in several rounds.
    spread = False
    #: Whether beads at the same point are a pair, of direction and distance 0; otherwise they are none.
    coincident = False
    #: Whether sweeps go through the list in :mod:`.groups`, and pairs are listed so that these get full.
    grouped = False

    def __init__(
        self, types: np.ndarray, inv_mass: np.ndarray, cutoff: np.ndarray, exceptions: Exceptions | None = None, *, passes: bool = False
    ):
        self._takes_part = types >= 0
        self.beads = np.flatnonzero(self._takes_part).astype(np.uint32)
        self.ntypes = len(cutoff)
        self.exceptions = no_exceptions() if exceptions is None else exceptions
        self._grid: cells.Grid | None = None
        self.set_cutoff(cutoff)
        m = len(self.beads)
        self.order, self._xs, of_sorted = np.arange(m, dtype=np.uint32), np.zeros((3, m + listing.LANES)), np.zeros(m)
        mine = inv_mass[self.beads]
        #: 1/mass of all the beads if it is the same, otherwise None.
        self.common_inv_mass: float | None = None
        if m and np.all(mine == mine[0]):
            self.common_inv_mass, of_sorted[:] = float(mine[0]), mine[0]
        self._of_beads = cells.OfBeads(types[: 0 if self.ntypes == 1 else None], inv_mass[: None if self.common_inv_mass is None else 0])
        self._sorting: cells.CellScratch | None = None
        #: (M, 3) scratch of whoever needs it: positions that are being sorted, then velocities that are
        self.rows_of_beads = np.zeros((m, 3))
        self._names, self.seats = np.zeros(0, np.uint32), self.order
        self._stored = Pairs(self.order, self.seats, np.zeros(m, np.int32), of_sorted, self.ntypes, *self._room(0), *_without_room(1))  # type: ignore[arg-type]
        self._shape, self._count, self._near, self._blocks = (1, 1, 1), np.zeros(2, np.uint64), 0, blocks_of(1, 1)
        self._source: listing.SortedCells | None = None
        self.passes, self.many = passes, passes and m >= MANY
        #: the cells of the beads that are sorted, and whether their pairs are stored; room for a column of each thread, where they are not
        self._placed, self._complete = cells.Grid(np.eye(3), np.zeros(3), False, 1, 1, 1), True
        self._passing = self._room(0)
        self._scratch = Scratch(np.empty((0, 0)), np.empty((0, 0), np.uint64), np.empty((0, 0), np.uint32))
        #: how many rows of numbers there are for each thread
        self.rows_of_scratch = 32
        #: what each thread does, and how many lists there were, see :data:`_SHARED`
        self._shares: Shares | None = None
        self._age = 0
        #: see :class:`Pairs`; and whether the images of the box slide in a shear, which then writes to the box vectors
        self.flow: np.ndarray | int = 0
        self.slides = False
        #: whether each pair is a column of its own, so that loops leave what they sum for each of them; and the last tensors (columns, 6)
        self.apart, self.tensors = False, np.zeros((0, 6))
        #: of kernels that are given the arrays of this list, see :class:`openmm_dpd.runtime.native.Kernel`
        kept = Pairs, Scratch, Shares, listing.SortedCells, cells.Grid, cells.CellScratch, cells.OfBeads
        self.memory: dict[type, Any] = dict.fromkeys(kept)

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        """Take arrays of beads from now on in another order: ``names`` (N,) has the number of the bead in each row, ``places`` (N,) the
        row of each."""
        if not len(self._names):
            types, inv_mass = self._of_beads
            own, rows, seats = cells.OfBeads(types.copy(), inv_mass.copy()), np.empty(len(names), np.uint32), np.empty_like(self.order)
            stored, its = self._stored._replace(seats=seats), self._of_beads
            self._given, self._of_beads, self._names, self.seats, self._stored, self._sorting = its, own, rows, seats, stored, None
        self._names[:] = names
        if len(self.beads) < len(names):
            self.beads[:] = np.flatnonzero(self._takes_part[names])
        for here, given in zip(self._of_beads, self._given, strict=True):
            if len(here):
                np.take(given, names, out=here)

    def leave_out(self, exceptions: Exceptions) -> None:
        """Have other exceptions from the next :meth:`build` on; both these and those before have rows."""
        self.exceptions, self._source = exceptions, None

    def set_types(self, types: np.ndarray) -> None:
        """Have beads of other types (N,), which all take part as before, from the next :meth:`seat` or :meth:`build` on."""
        if self.ntypes > 1 and len(self._names):
            self._given = self._given._replace(types=types)
        elif self.ntypes > 1:
            self._of_beads = self._of_beads._replace(types=types)

    def set_cutoff(self, cutoff: np.ndarray) -> None:
        """Another range."""
        longest, squares = float(cutoff.max()), np.ascontiguousarray(cutoff.ravel() ** 2)
        self.cutoff, self._cut2, self._grid, self._source = longest, squares, None, None

    @property
    def threads(self) -> int:
        """How many threads share the work."""
        return threads_for(len(self.beads))

    @property
    def across(self) -> tuple[int, int]:
        """How many columns there are along y and z."""
        return self._shape[1:]

    @property
    def alike(self) -> bool:
        """Whether all pairs have the same types and the factor 1."""
        return self.ntypes == 1 and not len(self.exceptions[0])

    def grid(self, x: np.ndarray, box: np.ndarray | None) -> cells.Grid:
        """Cells, no more than twice the beads.  Those of a box are kept for the next call.  Where images slide they are those of the most
        tilted box, for all that it becomes."""
        kept = self._grid
        if box is not None and kept is not None and kept.periodic:
            if self.slides and np.array_equal(box.diagonal(), kept.box.diagonal()):
                self._grid = kept = kept if kept.box is box else kept._replace(box=box)
                return kept
            if not self.slides and box.tobytes() == kept.box.tobytes():
                return kept
        if box is None:
            used = x[self.beads]
            bad = np.flatnonzero(~np.isfinite(used).all(axis=1))
            if len(bad):
                raise RunError(f"the position of bead {bead_number(self.beads[bad[0]])} is not finite: {used[bad[0]].tolist()}")
            origin = used.min(axis=0)
            wide = np.maximum(used.max(axis=0) - origin, self.cutoff) * (1 + 1e-9)
            extent = np.diag(wide)
        else:
            origin, extent = np.zeros(3), box if self.slides else box.copy()
            wide = widths(most_tilted(box) if self.slides else box)
        ncell = np.maximum((wide / self.cutoff).astype(np.int64), 1)
        while np.prod(ncell, dtype=float) > max(64, 2 * len(self.beads)) and ncell.max() > 3:
            ncell[ncell.argmax()] = max(3, int(ncell.max() * 0.8))
        if box is not None and ncell.min() < 3:
            ncell[:] = 1  # too narrow for cells
        self._grid = grid = cells.Grid(extent, origin, box is not None, *(int(n) for n in ncell))
        return grid

    def _resize(self, shape: tuple[int, int, int]) -> None:
        if shape != self._shape:
            nx, ny, nz = shape
            resized = Pairs(*self._stored[:9], *_without_room(ny * nz))  # type: ignore[arg-type]  # without the flow
            count, blocks = np.zeros(nx * ny * nz + 1, np.uint64), blocks_of(ny, nz)
            self._stored, self._count, self._shape, self._blocks, self._source, self._shares = resized, count, shape, blocks, None, None

    def _room(self, pairs: int) -> tuple[np.ndarray, ...]:
        """For so many pairs: the items of :class:`Pairs` from ``pi`` to ``factors``."""
        # unsigned: numba looks out for negative indices otherwise, in every loop over pairs
        beads = np.empty(pairs, np.uint32), np.empty(pairs, np.uint32)
        return *beads, np.empty((4, pairs)), np.empty(pairs if len(self.exceptions[0]) else 0)

    def _make_room(self) -> None:
        """Give every column half more room than it needed, and never less than it had: columns fluctuate, and a step that has too little
        is done twice."""
        found, start = self._stored.found, np.zeros_like(self._stored.start)
        start[1:] = np.cumsum(np.maximum(np.diff(self._stored.start), found + found // 2 + 48))
        pi, pj, geometry, factors = self._room(int(start[-1]))
        self._stored, self._shares = self._stored._replace(start=start, pi=pi, pj=pj, geometry=geometry, factors=factors), None

    def make_passing_room(self) -> None:
        """Give each thread room for one column, an eighth more than the fullest one has needed."""
        found = int(self._stored.found.max())
        self._passing = self._room(self.threads * (found + found // 8 + 48))

    def bin(self, x: np.ndarray, grid: cells.Grid, chunks: int) -> None:
        """Sort the beads into cells; the threads share them in so many chunks."""
        sizes = chunks, len(self._count) - 1
        if self._sorting is None or self._sorting.place.shape != sizes:
            self._sorting = cells.scratch_for(self.rows_of_beads, len(self._names) > 0, *sizes)
        out = self._count, self.order, self.seats, self._xs, self._stored.types, self._stored.inv_mass
        found = np.zeros(1, np.int64)
        if cells.bin_beads(x, self.beads, self._names, self._of_beads, grid, self._sorting, *out, found, parts=chunks, memory=self.memory):
            bad = cells.first_unusable(x, self.beads, grid)
            what = "so far away that it is in no cell" if np.isfinite(x[bad]).all() else "not finite"
            raise RunError(f"the position of bead {bead_number(bad)} is {what}: {x[bad].tolist()}")
        self._near = int(found[0])

    def _listing(self, grid: cells.Grid, parts: int) -> listing.SortedCells:
        """What the pairs of the sorted beads are listed from, by so many threads."""
        now = self._source
        fits = now is not None and now.own.shape == (parts, grid.nx + 3 + listing.LINE) and now.bead.shape[1] >= self._near + 64
        if now is None or not fits or now.box is not grid.box:
            # coordinates are at most 2 |box| from the corner: what rounding them can do to a square, and that twice
            edges = np.abs(most_tilted(grid.box) if self.slides else grid.box).sum()
            rounding = np.finfo(np.float32).eps * (16.0 * edges + 8.0 * self.cutoff) * self.cutoff
            squares = self._cut2, self.cutoff**2, self.cutoff**2 + rounding, 0.0 if self.coincident else listing.R_MIN2
            types = self.ntypes if np.ptp(self._cut2) else 1  # one for one range
            rule = *squares, types, *self.exceptions, most_apart(self.exceptions)
            order = listing.SPREAD if self.spread else listing.GROUPED if self.grouped else listing.USUAL
            space = now[-10:] if now is not None and fits else listing.space_for(parts, grid.nx, self._near + self._near // 4)
            self._source = now = listing.SortedCells(self._xs, self._count, *grid, *rule, *order, *space)  # type: ignore[arg-type]
        return now

    def list(self, grid: cells.Grid, parts: int) -> None:
        """List the pairs of the sorted beads, and store them; the threads share the columns in so many parts."""
        source = self._listing(grid, parts)
        while True:
            if grid.periodic and self._shape == (1, 1, 1):
                short = listing.list_pairs_small_box(self._stored, source)
            else:
                short = listing.list_pairs(self._stored, source, self.shares(parts), parts=parts, memory=self.memory)
            if not short:
                break
            self._make_room()
        self._complete = True

    def build(self, x: np.ndarray, box: np.ndarray | None) -> None:
        """Sort the beads at the positions x (N, 3), and list their pairs if loops will not do so."""
        self._complete, threads, grid = False, self.threads, self.grid(x, box)
        self._resize((grid.nx, grid.ny, grid.nz))
        self.bin(x, grid, threads)
        self._placed = grid
        self._age += 1
        if self.many and self._age % _SHARED == 0:
            self._share_again(threads)
        if not self.many or self.apart or (grid.periodic and self._shape == (1, 1, 1)):
            self.list(grid, threads)
        if self.apart:
            self._separate(threads)

    def _separate(self, parts: int) -> None:
        """Make a column of each pair, which the first of so many threads goes through."""
        now, rows = self._stored, self.rows
        count, ends = len(rows), np.concatenate([[0], np.full(parts, len(rows)), np.arange(len(rows))])
        listed = now.pi[rows], now.pj[rows], np.ascontiguousarray(now.geometry[:, rows]), now.factors[rows if len(now.factors) else []]
        one_each = np.arange(count + 1, dtype=np.uint64), np.ones(count, np.uint64), np.zeros((count, 5))
        self._stored = Pairs(*now[:5], *listed, *one_each, *now[12:])  # type: ignore[arg-type, misc]
        self._shares, self._shape = Shares(ends[: parts + 1].reshape(1, -1), ends[parts + 1 :]), (0, 0, 0)

    def shared(self) -> tuple[np.ndarray, np.ndarray]:
        """Where pairs are ``apart``: the beads (P, 2) of each, and (P, 10) what the last loop has found: the energy, the tensor r F (xx,
        yy, zz, xy, xz, yz), and the force along the line between them on the first bead."""
        now, tensors = self.arrays, self.tensors
        if len(tensors) != len(now.sums):  # all forces are along the lines between beads
            (x, y, z), virial = now.geometry[:3], now.sums[:, 1]
            tensors = np.stack([virial * x * x, virial * y * y, virial * z * z, virial * x * y, virial * x * z, virial * y * z], axis=1)
        force = (now.sums[:, 1] / np.maximum(now.geometry[3], 1e-300) * now.geometry[:3]).T
        return self.order[np.stack([now.pi, now.pj], axis=1)], np.column_stack([now.sums[:, 0], tensors, force])

    @property
    def stored(self) -> bool:
        """Whether all pairs at the present positions are stored."""
        return self._complete

    @property
    def arrays(self) -> Pairs:
        """All pairs, as loops read them; not valid any more after the next :meth:`build`."""
        if not self._complete:
            self.list(self._placed, self.threads)
        return self._stored

    def passing(self) -> tuple[Pairs, listing.SortedCells]:
        """Room for the pairs of one column for each thread, and what a loop lists them from."""
        pi, pj, geometry, factors = self._passing
        roomy = self._stored._replace(pi=pi, pj=pj, geometry=geometry, factors=factors)
        return roomy, self._listing(self._placed, self.threads)

    @property
    def scratch(self) -> Scratch:
        """Space for some pairs of each thread."""
        threads = self.threads
        if len(self._scratch.values) != threads:
            length, three = int(rows(self.rows_of_scratch + 1)[-1]), (threads, int(rows(4)[-1]))
            self._scratch = Scratch(np.empty((threads, length)), np.empty(three, np.uint64), np.empty(three, np.uint32))
        return self._scratch

    def shares(self, parts: int) -> Shares:
        """What each of so many threads does.  The same as long as the room is the same, so that a thread finds the pairs that it has listed
        itself in its own cache; where pairs are not stored it is looked at again and again how many there are."""
        if self._shares is None or self._shares.first.shape[1] != parts + 1:
            self._shares = self._shared(parts)
        return self._shares

    def _share_again(self, parts: int) -> None:
        """In the same arrays, so that what has been recorded with them goes on with the new shares, and all at once."""
        now, again = self._shares, self._shared(parts)
        if now is None or now.first.shape != again.first.shape:
            self._shares = again
        else:
            now.columns.base[...] = again.columns.base  # type: ignore[index]  # what both arrays are parts of

    def _shared(self, parts: int) -> Shares:
        """Shares of about as many pairs, or as much room for them; and of columns, where there is none."""
        start, found = self._stored.start, self._stored.found
        shares = share_out(self._blocks, 1 + (np.diff(start) if start[-1] else found).astype(np.int64), parts)
        return abreast(shares, *self.across) if self.grouped else shares

    def listed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray | float]:
        """Beads i and j, directions e (P, 3), distances and factors of all pairs."""
        now, rows = self.arrays, self.rows
        e, r = now.geometry[:3, rows].T, now.geometry[3, rows]
        return self.order[now.pi[rows]], self.order[now.pj[rows]], e, r, now.factors[rows] if len(now.factors) else 1.0

    @property
    def rows(self) -> np.ndarray:
        """Numbers of all pairs, in an order in which a loop may meet them (see :mod:`.columns`)."""
        columns = np.concatenate([self._blocks.columns[k] for colour in by_colours(self._blocks) for k in colour])
        ranges = list(zip(self.arrays.start[columns].tolist(), self.arrays.found[columns].tolist(), strict=True))
        rounds = ROUNDS if self.spread else 1
        its = [np.arange(begin, begin + count)[np.arange(count) // CHUNK % rounds == k] for k in range(rounds) for begin, count in ranges]
        return np.concatenate(its)
