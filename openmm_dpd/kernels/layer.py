"""The interface of one layer of pair terms to the engine."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from .columns import Motion
from .exceptions import Exceptions, no_exceptions
from .extras import BondedKernel, Extra
from .fields import FieldSpec
from .noise import told_key
from .pairs import PairList
from .segments import SegmentSpec

#: Which terms an evaluation adds up.
CONSERVATIVE, DISSIPATIVE, RANDOM = 1, 2, 4
#: Added to them: the sum of r_ij F_ij as a tensor is wanted too.
STRESS = 8
#: Added to CONSERVATIVE alone: the sum over mobile beads of the Laplacian of the conservative energy is wanted too.
LAPLACIAN = 16
#: The two pair updates of :mod:`.sweeps`.
EXACT, SHARDLOW = 0, 1
_NO_KEY = np.uint64(0)


class Call(NamedTuple):
    """What pair terms depend on beside the positions."""

    which: int  #: Sum of CONSERVATIVE, DISSIPATIVE, RANDOM, and perhaps STRESS, LAPLACIAN
    velocities: np.ndarray | None  #: (N, 3) or None
    kT: float  # kT, dt: thermal energy and time step; noise as a force has the amplitude sigma/sqrt(dt)
    dt: float
    seed: int  # seed, counter: key of the noise
    counter: int
    field_values: np.ndarray | None = None  #: (N, K) or None; values of the per-bead fields (see :mod:`.fields`)
    update: int = EXACT  # Pair update of a sweep: EXACT or SHARDLOW
    held: np.ndarray | None = None  #: (N, 3), or None; where conservative forces are wanted apart too, written or added as the others
    #: (N, K), or None; change per time of the per-bead fields (for internal energies: conductive, mechanical), to which layers add theirs
    rates: np.ndarray | None = None

    def key(self, number: int) -> np.uint64:
        """Key of the noise of layer number ``number``; 0 where none is asked for."""
        if not self.which & RANDOM:
            return _NO_KEY
        return told_key(self.seed, self.counter, number, self.kT)

    @property
    def rsqrt_dt(self) -> float:
        """1/sqrt(dt), 0 where no noise is asked for."""
        return 1.0 / math.sqrt(self.dt) if self.which & RANDOM else 0.0


@dataclass(frozen=True, eq=False)
class Sums:
    """What the force form of one layer gives beside the forces."""

    energy: float  # energy, virial: conservative energy, and the sum over pairs of r_ij . F_ij of the chosen terms
    virial: float
    drag: float = 0.0  #: The part of the virial that the friction has
    #: (6,) or None; sum over pairs of r_ij F_ij, components xx, yy, zz, xy, xz, yz; only if asked for, and only of layers that have it
    stress: np.ndarray | None = None
    laplacian: float | None = None  #: If it came with the forces; otherwise :meth:`Layer.laplacian` has it
    conservative: float | None = None  #: Virial of the conservative terms alone, where they are written apart


class SortedMotion:
    """Velocities and forces of M beads in the order of a pair list."""

    def __init__(self, pairs: PairList):
        self.v, self.f = pairs.rows_of_beads, np.zeros((len(pairs.order), 3))

    def arrays(self, call: Call, out: np.ndarray, add: bool) -> Motion:
        """What a loop over pairs reads and writes, with the forces going to ``out``."""
        if call.velocities is None or not call.which & (DISSIPATIVE | RANDOM):
            return Motion(self.f, out, add, self.v)
        return Motion(self.f, out, add, self.v, call.velocities)


class Layer(Protocol):
    """One table of pair terms over one list of pairs."""

    @property
    def pairs(self) -> PairList:
        """The list of pairs."""

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions: the forces (N, 3) are written or added to ``out``."""

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """Update velocities (N, 3) pair by pair, in place; add the changes of the fields to ``increments`` (N, K)."""

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy."""


def table_of(*columns: np.ndarray) -> np.ndarray:
    """Table of coefficients with a row for each pair of types, from arrays (T, T) or (T, T, K)."""
    types = columns[0].size
    return np.ascontiguousarray(np.concatenate([column.reshape(types, -1) for column in columns], axis=1))


class Table(Protocol):
    """Coefficients of one layer, immutable: it is pickled into the System."""

    @property
    def cutoff(self) -> np.ndarray:
        """(T, T): range of the pair list; 0 means no interaction."""

    def layer(self, spec: PairSpec, number: int) -> Layer:
        """The layer that evaluates these coefficients, with a list of its pairs."""


@dataclass(frozen=True, eq=False)
class PairSpec:
    """The part of the kernel's input that never changes."""

    types: np.ndarray  # (N,) int32 type of each particle; -1 for one that takes no part in any pair term
    inv_mass: np.ndarray  #: (N,) 1/mass; 0 for a particle that does not move
    terms: tuple[Table, ...]  #: Coefficients of the layers, evaluated one after the other
    update: int = EXACT  # Pair update of the sweep: EXACT or SHARDLOW
    # Bonded neighbours in compressed rows: start (N + 1,), bead (E,), factor (E,); start is empty if there are none
    exceptions: Exceptions = field(default_factory=no_exceptions)
    wall_velocity: np.ndarray | None = None  #: (N, 3), or None; velocity with which immobile particles take part in the friction
    fields: FieldSpec | None = None  #: Per-bead fields, if there are any
    sweeps: bool = True  #: Whether the scheme sweeps over pairs at all
    extras: tuple[Extra, ...] = ()  #: Conservative forces beside the pair terms (see :mod:`.extras`)
    sheared: bool = False  #: Whether there is a Lees-Edwards shear
    carried: Any = None  #: Immobile particles that walls take along, a :class:`.solids.Carried`, if there are any
    bodies: Any = None  #: Rigid bodies, a :class:`.bodies.BodySpec`, if there are any
    sorts: tuple[BondedKernel | SegmentSpec, ...] = ()  #: One bond of each sort that forms and breaks, see :class:`.reactions.BondsSpec`
