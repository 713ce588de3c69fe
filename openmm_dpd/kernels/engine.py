"""The pair engine: positions, velocities and parameters in; forces, impulses and sums out.

:class:`PairSpec` is the immutable description of the pair terms (it is what travels inside a serialized System);
:class:`PairEngine` holds scratch arrays and the pair lists of the last positions it saw, nothing that could not be recomputed.
"""

from __future__ import annotations

import os
import threading
import time
from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np

from ..errors import RunError
from . import cells, forces, sweeps
from .forces import CONSERVATIVE, CUTOFF, DISSIPATIVE, EXPONENT, EXPONENT_PERP, GAMMA, GAMMA_PERP, RANDOM, SIGMA, SIGMA_PERP, A
from .noise import call_key

# Threads of GNU OpenMP that spin while they wait stall each other, and OpenMM's own, wherever there are fewer free cores than threads
# (a step can take ten times as long); the variable is read when the library is loaded, at the first parallel call, and a user's own
# choice is kept.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

#: Numba's default threading layer must not be entered from two threads at once.
_PARALLEL_LOCK = threading.Lock()

_MOST_THREADS: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
_thread_count: int | None = None


def set_threads(threads: int | None) -> None:
    """Number of threads the pair kernel uses (None: all cores this process may run on)."""
    global _thread_count
    _thread_count = None if threads is None else max(1, min(int(threads), _MOST_THREADS))


def get_threads() -> int:
    """Number of threads the pair kernel uses."""
    if _thread_count is not None:
        return _thread_count
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(available, _MOST_THREADS))


@dataclass(frozen=True, eq=False)
class TermTable:
    """Coefficients of one layer of DPD terms, as (T, T) symmetric arrays (MD units).

    ``gamma`` holds NaN where sigma is the fixed quantity, ``sigma`` holds NaN where gamma is; cutoff 0 means no interaction.
    """

    A: np.ndarray
    gamma: np.ndarray
    sigma: np.ndarray
    gamma_perp: np.ndarray
    exponent: np.ndarray
    exponent_perp: np.ndarray
    cutoff: np.ndarray

    def coefficients(self, kT: float) -> np.ndarray:
        """(T*T, 8) table at the thermal energy kT: sigma^2 = 2 kT gamma, whichever of the two is fixed."""
        fixed_sigma = np.isnan(self.gamma)
        table = np.zeros((self.A.size, 8))
        with np.errstate(divide="ignore", invalid="ignore"):
            gamma = np.where(fixed_sigma, np.where(self.sigma > 0, self.sigma**2 / (2 * kT), 0.0), self.gamma)
        sigma = np.where(fixed_sigma, self.sigma, np.sqrt(2 * kT * np.where(fixed_sigma, 0.0, self.gamma)))
        for column, values in (
            (A, self.A),
            (CUTOFF, self.cutoff),
            (GAMMA, gamma),
            (SIGMA, sigma),
            (GAMMA_PERP, self.gamma_perp),
            (SIGMA_PERP, np.sqrt(2 * kT * self.gamma_perp)),
            (EXPONENT, self.exponent),
            (EXPONENT_PERP, self.exponent_perp),
        ):
            table[:, column] = values.ravel()
        return table


@dataclass(frozen=True, eq=False)
class PairSpec:
    """Everything the kernel has to know that never changes.

    Attributes
    ----------
    types : (N,) int32
        Type of each particle; -1 for one that takes no part in any pair term.
    inv_mass : (N,) float64
        1/mass; 0 for a particle that does not move.
    terms : tuple of TermTable
        Layers, evaluated one after the other.
    update : int
        Pair update of the sweep: ``sweeps.EXACT`` or ``sweeps.SHARDLOW``.
    exceptions : three arrays
        Bonded neighbours in compressed rows: start (N + 1,), bead (E,), factor (E,); start is empty if there are none.
    wall_velocity : (N, 3) float64, or None
        Velocity with which immobile particles take part in the friction.
    """

    types: np.ndarray
    inv_mass: np.ndarray
    terms: tuple[TermTable, ...]
    update: int = sweeps.EXACT
    exceptions: tuple[np.ndarray, np.ndarray, np.ndarray] = field(
        default_factory=lambda: (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
    )
    wall_velocity: np.ndarray | None = None


class PairList:
    """Pairs of one layer of terms at one set of positions, in coloured columns (see :mod:`.cells`)."""

    def __init__(self, spec: PairSpec, table: TermTable):
        self.beads = np.flatnonzero(spec.types >= 0)
        self.cut2 = np.ascontiguousarray(table.cutoff.ravel() ** 2)
        self.ntypes = len(table.A)
        self.cutoff = float(table.cutoff.max())
        self.spec = spec
        m = len(self.beads)
        self.cell, self.order, self.xs = np.zeros(m, np.int64), np.zeros(m, np.int64), np.zeros((m, 3))
        self.types, self.inv_mass = np.zeros(m, np.int32), np.zeros(m)
        self.shape: tuple[int, int, int] | None = None
        self.pi = self.pj = np.zeros(0, np.int32)
        self.geometry, self.factors = np.zeros((0, 4)), np.zeros(0)

    def _grid(self, x: np.ndarray, box: np.ndarray | None):
        """Lower corner, extent and number of cells; no more cells than twice the beads."""
        if box is None:
            used = x[self.beads]
            bad = np.flatnonzero(~np.isfinite(used).all(axis=1))
            if len(bad):
                raise RunError(f"the position of bead {self.beads[bad[0]]} is not finite: {used[bad[0]].tolist()}")
            origin = used.min(axis=0)
            widths = np.maximum(used.max(axis=0) - origin, self.cutoff) * (1 + 1e-9)
            extent = np.diag(widths)
        else:
            origin, extent = np.zeros(3), box
            widths = 1.0 / np.linalg.norm(np.linalg.inv(box), axis=0)
        ncell = np.maximum((widths / self.cutoff).astype(np.int64), 1)
        while np.prod(ncell, dtype=float) > max(64, 2 * len(self.beads)) and ncell.max() > 3:
            ncell[ncell.argmax()] = max(3, int(ncell.max() * 0.8))
        return origin, extent, ncell

    def _resize(self, shape: tuple[int, int, int]) -> None:
        if shape == self.shape:
            return
        nx, ny, nz = self.shape = shape
        self.count = np.zeros(nx * ny * nz + 1, np.int64)
        self.columns, self.block_start, self.colour_start = cells.colours(ny, nz)
        self.found = np.zeros(ny * nz, np.int64)
        self.energy, self.virial = np.zeros(ny * nz), np.zeros(ny * nz)
        self.start = np.zeros(ny * nz + 1, np.int64)

    def _make_room(self) -> None:
        """Give every column a quarter more room than it needed, and never less than it had: columns fluctuate."""
        self.start[1:] = np.cumsum(np.maximum(np.diff(self.start), self.found + self.found // 4 + 48))
        room = int(self.start[-1])
        self.pi, self.pj = np.empty(room, np.int32), np.empty(room, np.int32)
        self.geometry = np.empty((room, 4))
        self.factors = np.empty(room if len(self.spec.exceptions[0]) else 0)

    def build(self, x: np.ndarray, box: np.ndarray | None, parallel: bool) -> None:
        """List the pairs at the positions x (N, 3)."""
        periodic = box is not None
        origin, extent, ncell = self._grid(x, box)
        small = periodic and ncell.min() < 3
        if small:
            ncell[:] = 1
        self._resize((int(ncell[0]), int(ncell[1]), int(ncell[2])))
        bad = cells.bin_beads(x, self.beads, extent, origin, periodic, self.shape, self.cell, self.count, self.order, self.xs)
        if bad >= 0:
            raise RunError(f"the position of bead {bad} is not finite: {x[bad].tolist()}")
        np.take(self.spec.types, self.order, out=self.types)
        np.take(self.spec.inv_mass, self.order, out=self.inv_mass)
        pairs = (self.xs, self.order, self.types, self.ntypes, self.cut2, self.cutoff**2, self.spec.exceptions, extent)
        while True:
            out = (self.start, self.found, self.pi, self.pj, self.geometry, self.factors)
            if small:
                cells.list_pairs_small_box(*pairs, *out)
            else:
                function = cells.list_pairs_parallel if parallel else cells.list_pairs
                function(*pairs, periodic, self.shape, self.count, self.columns, *out)
            if np.all(self.found <= np.diff(self.start)):
                return
            self._make_room()

    @property
    def geometry_arguments(self) -> tuple:
        """What the loops over pairs read."""
        return self.pi, self.pj, self.geometry, self.factors, self.columns, self.block_start, self.colour_start, self.start, self.found


class PairEngine:
    """Evaluates the pair terms of one :class:`PairSpec`.

    One engine belongs to one thread at a time.  All results are the same, bit for bit, for any number of threads.
    """

    def __init__(self, spec: PairSpec):
        self.spec = spec
        self.lists = [PairList(spec, table) for table in spec.terms]
        self._x = np.full((len(spec.types), 3), np.nan)
        self._box: np.ndarray | None = None
        self._coefficients: tuple[float, list[np.ndarray]] = (np.nan, [])

    def prepare(self, x: np.ndarray, box: np.ndarray | None) -> None:
        """List the pairs at positions x; does nothing if they are those of the last call."""
        same_box = self._box is None if box is None else self._box is not None and np.array_equal(box, self._box)
        if same_box and np.array_equal(x, self._x):
            return
        parallel = get_threads() > 1
        self._x[0, 0] = np.nan  # not valid until the lists are complete
        for pairs in self.lists:
            self._run(pairs.build, None, x, box, parallel)
        self._x[...] = x
        self._box = None if box is None else box.copy()

    def forces(self, which: int, v: np.ndarray | None, kT: float, dt: float, seed: int, counter: int):
        """Sum of the chosen terms at the prepared positions.

        Parameters
        ----------
        which : int
            Sum of CONSERVATIVE, DISSIPATIVE, RANDOM.
        v : (N, 3) array
            Velocities the friction sees (not needed for conservative and random forces).
        kT, dt : float
            Thermal energy and time step; the noise has the amplitude sigma/sqrt(dt).
        seed, counter : int
            Key of the noise.

        Returns
        -------
        energy : float
            Conservative energy.
        force : (N, 3) array
        virial : float
            Sum over pairs of r_ij . F_ij.
        """
        force = np.zeros((len(self.spec.types), 3))
        energy = virial = 0.0
        if which & RANDOM and kT == 0.0:
            which &= ~RANDOM
        for layer, (pairs, table) in enumerate(zip(self.lists, self._tables(kT), strict=True)):
            sorted_force = np.zeros((len(pairs.order), 3))
            self._run(
                forces.pair_forces,
                forces.pair_forces_parallel,
                which,
                call_key(seed, counter, layer),
                1.0 / np.sqrt(dt) if which & RANDOM else 0.0,
                pairs.order,
                pairs.types,
                pairs.ntypes,
                table,
                *pairs.geometry_arguments,
                self._sorted_velocities(pairs, v),
                sorted_force,
                pairs.energy,
                pairs.virial,
            )
            if layer == 0:
                force[pairs.order] = sorted_force  # cheaper than adding
            else:
                force[pairs.order] += sorted_force
            energy += pairs.energy.sum()
            virial += pairs.virial.sum()
        return energy, force, virial

    def sweep(self, v: np.ndarray, kT: float, dt: float, seed: int, counter: int) -> np.ndarray:
        """Change of the velocities (N, 3) by one sweep of pair updates at the prepared positions."""
        swept = v if self.spec.wall_velocity is None else self._seen(v)
        swept = swept.copy()
        before = swept.copy()
        for layer, (pairs, table) in enumerate(zip(self.lists, self._tables(kT), strict=True)):
            sorted_v = np.take(swept, pairs.order, axis=0)
            self._run(
                sweeps.sweep,
                sweeps.sweep_parallel,
                self.spec.update,
                kT,
                dt,
                call_key(seed, counter, layer),
                pairs.order,
                pairs.types,
                pairs.ntypes,
                table,
                pairs.inv_mass,
                *pairs.geometry_arguments,
                sorted_v,
            )
            swept[pairs.order] = sorted_v
        return swept - before

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy at the prepared positions."""
        total = 0.0
        for pairs, table in zip(self.lists, self._tables(0.0), strict=True):
            pi, pj, geometry, factors, columns, _, _, start, found = pairs.geometry_arguments
            total += forces.laplacian(pairs.types, pairs.ntypes, table, pairs.inv_mass, pi, pj, geometry, factors, columns, start, found)
        return total

    def _tables(self, kT: float) -> list[np.ndarray]:
        if self._coefficients[0] != kT:
            self._coefficients = (kT, [table.coefficients(kT) for table in self.spec.terms])
        return self._coefficients[1]

    def _seen(self, v: np.ndarray) -> np.ndarray:
        """Velocities with those of immobile beads replaced by their prescribed ones."""
        if self.spec.wall_velocity is None:
            return v
        return np.where(self.spec.inv_mass[:, None] > 0, v, self.spec.wall_velocity)

    def _sorted_velocities(self, pairs: PairList, v: np.ndarray | None) -> np.ndarray:
        return np.zeros((0, 3)) if v is None else np.take(self._seen(v), pairs.order, axis=0)

    @staticmethod
    def _run(serial, parallel, *arguments):
        """Call the parallel version under the lock, with the right number of threads, or the serial one."""
        threads = get_threads()
        if threads == 1:
            return serial(*arguments)
        with _PARALLEL_LOCK:
            numba.set_num_threads(threads)
            return (parallel or serial)(*arguments)


def warm_up(spec: PairSpec, log=lambda _: None) -> None:
    """Compile all the kernels a run of ``spec`` can need (or load them from the cache), saying so if it takes a while.

    Compiled code is kept in the user's cache folder.
    """
    if not spec.terms:
        return
    parallel = get_threads() > 1
    functions: list[Any] = [
        cells.list_pairs_parallel if parallel else cells.list_pairs,
        forces.pair_forces_parallel if parallel else forces.pair_forces,
        sweeps.sweep_parallel if parallel else sweeps.sweep,
    ]
    if all(function.signatures for function in functions):
        return
    begun = time.perf_counter()
    n = 30
    few = PairSpec(np.zeros(n, np.int32), np.ones(n), spec.terms[:1], spec.update)
    x = np.random.default_rng(0).random((n, 3)) * 4 * spec.terms[0].cutoff.max()
    engine = PairEngine(few)
    engine.prepare(x, np.diag([4.0] * 3) * spec.terms[0].cutoff.max())
    engine.forces(CONSERVATIVE | DISSIPATIVE | RANDOM, np.zeros((n, 3)), 1.0, 1.0, 0, 0)
    engine.sweep(np.zeros((n, 3)), 1.0, 1.0, 0, 0)
    engine.laplacian()
    seconds = time.perf_counter() - begun
    if seconds > 2.0:
        log(f"compiled the pair kernel in {seconds:.0f} s (first run only; it is cached)")


__all__ = ["CONSERVATIVE", "DISSIPATIVE", "RANDOM", "PairEngine", "PairSpec", "TermTable", "get_threads", "set_threads", "warm_up"]
