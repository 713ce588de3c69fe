"""The pair engine: positions, velocities and parameters in; forces, impulses and sums out.

:class:`PairSpec` is the immutable description of the pair terms (it is what travels inside a serialized System);
:class:`PairEngine` holds scratch arrays and the pair lists of the last positions it saw, nothing that could not be recomputed.
"""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass, field

import numpy as np

from ..errors import RunError
from . import cells, motion, sweeps
from .dpd import TermTable
from .extras import Extra
from .fields import FieldSpec
from .layer import CONSERVATIVE, DISSIPATIVE, RANDOM, STRESS, Call, Layer, Table
from .threads import get_threads, run, set_threads


@dataclass(frozen=True, eq=False)
class PairSpec:
    """Everything the kernel has to know that never changes.

    Attributes
    ----------
    types : (N,) int32
        Type of each particle; -1 for one that takes no part in any pair term.
    inv_mass : (N,) float64
        1/mass; 0 for a particle that does not move.
    terms : tuple of tables
        Coefficients of the layers, evaluated one after the other.
    update : int
        Pair update of the sweep: ``sweeps.EXACT`` or ``sweeps.SHARDLOW``.
    exceptions : three arrays
        Bonded neighbours in compressed rows: start (N + 1,), bead (E,), factor (E,); start is empty if there are none.
    wall_velocity : (N, 3) float64, or None
        Velocity with which immobile particles take part in the friction.
    fields : FieldSpec or None
        What beads carry beside position and velocity.
    sweeps : bool
        Whether the scheme sweeps over pairs at all.
    extras : tuple of Extra
        Conservative forces beside the pair terms (see :mod:`.extras`).
    """

    types: np.ndarray
    inv_mass: np.ndarray
    terms: tuple[Table, ...]
    update: int = sweeps.EXACT
    exceptions: tuple[np.ndarray, np.ndarray, np.ndarray] = field(
        default_factory=lambda: (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
    )
    wall_velocity: np.ndarray | None = None
    fields: FieldSpec | None = None
    sweeps: bool = True
    extras: tuple[Extra, ...] = ()


class PairList:
    """Pairs of one layer of terms at one set of positions, in coloured columns (see :mod:`.cells`)."""

    def __init__(self, spec: PairSpec, table: Table):
        self.beads = np.flatnonzero(spec.types >= 0)
        self.cut2 = np.ascontiguousarray(table.cutoff.ravel() ** 2)
        self.ntypes = len(table.cutoff)
        self.cutoff = float(table.cutoff.max())
        self.spec = spec
        m = len(self.beads)
        self.cell, self.order, self.xs = np.zeros(m, np.int64), np.zeros(m, np.int64), np.zeros((m, 3))
        self.types, self.inv_mass = np.zeros(m, np.int32), np.zeros(m)
        self.shape: tuple[int, int, int] | None = None
        self.grid: tuple[np.ndarray, np.ndarray, tuple[int, int, int]]
        self.grid_box: np.ndarray | None = None
        self.place = np.zeros((0, 0), np.int64)
        # unsigned (like start and found): numba looks out for negative indices otherwise, in every loop over pairs
        self.pi = self.pj = np.zeros(0, np.uint32)
        self.geometry, self.factors = np.zeros((0, 4)), np.zeros(0)

    def _grid(self, x: np.ndarray, box: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, tuple[int, int, int]]:
        """Lower corner, extent and number of cells; no more cells than twice the beads.  That of a box is kept for the next call."""
        if box is not None and self.grid_box is not None and np.array_equal(box, self.grid_box):
            return self.grid
        if box is None:
            used = x[self.beads]
            bad = np.flatnonzero(~np.isfinite(used).all(axis=1))
            if len(bad):
                raise RunError(f"the position of bead {self.beads[bad[0]]} is not finite: {used[bad[0]].tolist()}")
            origin = used.min(axis=0)
            widths = np.maximum(used.max(axis=0) - origin, self.cutoff) * (1 + 1e-9)
            extent = np.diag(widths)
        else:
            origin, extent = np.zeros(3), box.copy()
            widths = 1.0 / np.linalg.norm(np.linalg.inv(box), axis=0)
        ncell = np.maximum((widths / self.cutoff).astype(np.int64), 1)
        while np.prod(ncell, dtype=float) > max(64, 2 * len(self.beads)) and ncell.max() > 3:
            ncell[ncell.argmax()] = max(3, int(ncell.max() * 0.8))
        if box is not None and ncell.min() < 3:
            ncell[:] = 1  # too narrow for cells
        self.grid_box = None if box is None else extent
        self.grid = origin, extent, (int(ncell[0]), int(ncell[1]), int(ncell[2]))
        return self.grid

    def _resize(self, shape: tuple[int, int, int]) -> None:
        if shape == self.shape:
            return
        nx, ny, nz = self.shape = shape
        self.count = np.zeros(nx * ny * nz + 1, np.uint64)
        self.columns, self.block_start, self.colour_start = cells.colours(ny, nz)
        self.found = np.zeros(ny * nz, np.uint64)
        self.energy, self.virial = np.zeros(ny * nz), np.zeros(ny * nz)
        self.start = np.zeros(ny * nz + 1, np.uint64)

    def _make_room(self) -> None:
        """Give every column an eighth more room than it needed, and never less than it had: columns fluctuate."""
        self.start[1:] = np.cumsum(np.maximum(np.diff(self.start), self.found + self.found // 8 + 48))
        room = int(self.start[-1])
        self.pi, self.pj = np.empty(room, np.uint32), np.empty(room, np.uint32)
        self.geometry = np.empty((room, 4))
        self.factors = np.empty(room if len(self.spec.exceptions[0]) else 0)

    def _bin(self, x: np.ndarray, extent: np.ndarray, origin: np.ndarray, periodic: bool, parallel: bool) -> None:
        """Sort the beads into cells."""
        chunks = min(get_threads(), 8) if parallel else 1  # counts of all chunks are summed by one thread
        if self.place.shape != (chunks, len(self.count) - 1):
            self.place, self.bad = np.zeros((chunks, len(self.count) - 1), np.int64), np.zeros(chunks, np.int64)
        scratch = (self.cell, self.place, self.bad)
        out = (self.count, self.order, self.xs, self.types, self.inv_mass)
        function = cells.bin_beads_parallel if parallel else cells.bin_beads
        bad = function(x, self.beads, self.spec.types, self.spec.inv_mass, extent, origin, periodic, self.shape, *scratch, *out)
        if bad >= 0:
            raise RunError(f"the position of bead {bad} is not finite: {x[bad].tolist()}")

    def build(self, x: np.ndarray, box: np.ndarray | None, parallel: bool) -> None:
        """List the pairs at the positions x (N, 3)."""
        periodic = box is not None
        origin, extent, shape = self._grid(x, box)
        self._resize(shape)
        self._bin(x, extent, origin, periodic, parallel)
        pairs = (self.xs, self.order, self.types, self.ntypes, self.cut2, self.cutoff**2, self.spec.exceptions, extent)
        tasks = min(8 * get_threads(), len(self.found)) if parallel else 1
        while True:
            out = (self.start, self.found, self.pi, self.pj, self.geometry, self.factors)
            if periodic and shape == (1, 1, 1):
                enough = cells.list_pairs_small_box(*pairs, *out)
            else:
                function = cells.list_pairs_parallel if parallel else cells.list_pairs
                enough = function(*pairs, periodic, self.shape, self.count, tasks, *out)
            if enough:
                return
            self._make_room()

    @property
    def geometry_arguments(self) -> tuple:
        """What the loops over pairs read."""
        return self.pi, self.pj, self.geometry, self.factors, self.columns, self.block_start, self.colour_start, self.start, self.found


class PairEngine:
    """Evaluates the pair terms of one :class:`PairSpec`.

    One engine belongs to one thread at a time.  All results are the same, bit for bit, for any number of threads.

    Attributes
    ----------
    rates, flow : (N, K) arrays
        What the last call of :meth:`forces` and :meth:`sweep` gave for the fields of the spec (per time, and in all).
    stress : (6,) array
        Sum over pairs of r_ij F_ij (xx, yy, zz, xy, xz, yz) of the last call of :meth:`forces` with STRESS.
    body_scale : float
        Factor of forces on single beads.
    number : int
        Of the positions that were prepared last: what was computed there is valid while it stays.
    """

    def __init__(self, spec: PairSpec):
        self.spec = spec
        self.lists = [PairList(spec, table) for table in spec.terms]
        self.layers: list[Layer] = [
            table.layer(spec, pairs, k) for k, (table, pairs) in enumerate(zip(spec.terms, self.lists, strict=True))
        ]
        columns = 0 if spec.fields is None else spec.fields.n_values
        self.rates, self.flow = np.zeros((len(spec.types), columns)), np.zeros((len(spec.types), columns))
        self.stress = np.zeros(6)
        self.number = 0
        self.extras, self.body_scale = [extra.evaluator() for extra in spec.extras], 1.0
        self._x = np.full((len(spec.types), 3), np.nan)
        self._box: np.ndarray | None = None

    def prepare(self, x: np.ndarray, box: np.ndarray | None) -> bool:
        """List the pairs at positions x; does nothing and returns False if they are those of the last call."""
        same_box = self._box is None if box is None else self._box is not None and np.array_equal(box, self._box)
        if not x.flags.writeable:
            x = x.copy()  # numba would compile another version for a scene's read-only positions
        if same_box and motion.same(x, self._x):
            return False
        parallel = get_threads() > 1
        self._x[0, 0] = np.nan  # not valid until the lists are complete
        for pairs in self.lists:
            run(pairs.build, None, x, box, parallel)
        self.number += 1
        self._x[...] = x
        self._box = None if box is None else box.copy()
        return True

    def forces(
        self,
        which: int,
        v: np.ndarray | None,
        kT: float,
        dt: float,
        seed: int,
        counter: int,
        scalars: np.ndarray | None = None,
        out: np.ndarray | None = None,
    ):
        """Sum of the chosen terms at the prepared positions.

        Parameters
        ----------
        which : int
            Sum of CONSERVATIVE, DISSIPATIVE, RANDOM, and STRESS for the tensor in ``stress``.
        v : (N, 3) array
            Velocities the friction sees (not needed for conservative and random forces).
        kT, dt : float
            Thermal energy and time step; the noise has the amplitude sigma/sqrt(dt).
        seed, counter : int
            Key of the noise.
        scalars : (N, K) array, optional
            Values of the fields of the spec.
        out : (N, 3) array, optional
            Where the forces are written.

        Returns
        -------
        energy : float
            Conservative energy.
        force : (N, 3) array
        virial : float
            Sum over pairs of r_ij . F_ij, of pair terms alone.
        """
        force = np.empty((len(self.spec.types), 3)) if out is None else out
        force[...] = 0.0
        energy = virial = 0.0
        if which & RANDOM and kT == 0.0 and self.spec.fields is None:
            which &= ~RANDOM
        call = Call(which, None if v is None else self.seen(v), kT, dt, seed, counter, scalars)
        self.rates[...] = 0.0
        self.stress[...] = 0.0
        for number, layer in enumerate(self.layers):
            result, order = layer.forces(call), layer.pairs.order
            if number == 0:
                motion.scatter(result.force, order, force)  # cheaper than adding
            else:
                force[order] += result.force
            if result.rates is not None:
                self.rates[order] += result.rates
            if which & STRESS:
                if result.stress is None:
                    raise RunError("the stress tensor is computed for isothermal DPD terms only")
                self.stress += result.stress
            energy += result.energy
            virial += result.virial
        if which & CONSERVATIVE:
            for extra in self.extras:
                energy += extra.add_to(self._x, self._box, force, self.body_scale)
        if self.spec.fields is not None and which & DISSIPATIVE:
            for source in self.spec.fields.sources:
                source.add_to(self.rates, self._x, self._box)
        return energy, force, virial

    def sweep(
        self,
        v: np.ndarray,
        kT: float,
        dt: float,
        seed: int,
        counter: int,
        scalars: np.ndarray | None = None,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Change of the velocities (N, 3) by one sweep of pair updates at the prepared positions, written to ``out`` if that is given."""
        before = self.seen(v)
        swept = np.empty_like(before) if out is None else out
        self.swept(v, kT, dt, seed, counter, scalars, swept)
        swept -= before
        return swept

    def swept(
        self,
        v: np.ndarray,
        kT: float,
        dt: float,
        seed: int,
        counter: int,
        scalars: np.ndarray | None,
        out: np.ndarray,
        update: int | None = None,
    ) -> None:
        """Velocities after such a sweep, written to ``out``, which may be v; ``update`` is the pair update if not that of the spec."""
        before = self.seen(v)
        if out is not before:
            out[...] = before
        self.flow[...] = 0.0
        call = Call(DISSIPATIVE | RANDOM, None, kT, dt, seed, counter, scalars, self.spec.update if update is None else update)
        for layer in self.layers:
            layer.sweep(call, out, self.flow)

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy at the prepared positions."""
        return sum(layer.laplacian() for layer in self.layers)

    def seen(self, v: np.ndarray) -> np.ndarray:
        """Velocities with those of immobile beads replaced by their prescribed ones."""
        if self.spec.wall_velocity is None:
            return v
        return np.where(self.spec.inv_mass[:, None] > 0, v, self.spec.wall_velocity)


_WARM: set = set()


#: Where a script learns that it waits for the compiler; logging.getLogger("openmm_dpd").setLevel("ERROR") silences it.
_LOGGER = logging.getLogger("openmm_dpd")


def warm_up(spec: PairSpec, log=_LOGGER.warning) -> None:
    """Compile all the kernels a run of ``spec`` can need (or load them from the cache), saying so if it takes a while.

    Compiled code is kept in the user's cache folder.
    """
    kinds = (tuple(type(table) for table in spec.terms), spec.update, spec.fields and spec.fields.kind, get_threads() > 1)
    if not spec.terms or kinds in _WARM:
        return
    _WARM.add(kinds)
    # loading from the cache takes less than that
    notice = threading.Timer(3.0, log, ["compiling the pair kernel, which takes some ten seconds; the next run finds it in the cache"])
    notice.daemon = True
    notice.start()
    try:
        _use_all(spec)
    finally:
        notice.cancel()


def _use_all(spec: PairSpec) -> None:
    """Call every kernel of a spec once."""
    # few enough beads to be quick, in a box with three cells along each edge
    few = np.arange(30) % len(spec.types)
    fields = None if spec.fields is None else spec.fields.of(few)
    small = PairSpec(np.maximum(spec.types[few], 0), np.ones(len(few)), spec.terms, spec.update, fields=fields)
    edge = 4.0 * max(float(table.cutoff.max()) for table in spec.terms)
    engine = PairEngine(small)
    engine.prepare(np.random.default_rng(0).random((len(few), 3)) * edge, np.diag([edge] * 3))
    # everywhere the same, so that no two beads meet that never would
    scalars = None if fields is None else np.tile(fields.initial[:1], (len(few), 1))
    engine.forces(CONSERVATIVE | DISSIPATIVE | RANDOM, np.zeros((len(few), 3)), 1.0, 1e-6, 0, 0, scalars)
    if spec.sweeps:
        engine.sweep(np.zeros((len(few), 3)), 1.0, 1e-6, 0, 0, scalars)
    engine.laplacian()


__all__ = [
    "CONSERVATIVE",
    "DISSIPATIVE",
    "RANDOM",
    "STRESS",
    "PairEngine",
    "PairSpec",
    "TermTable",
    "get_threads",
    "set_threads",
    "warm_up",
]
