"""What a loop over time steps adds to the pair terms: bonds, angles, radial overlays, segments and forces on single beads.

An :class:`Extra` describes one kind of force, an :class:`Evaluator` computes it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, Protocol

import numpy as np

from ..base.errors import RunError, bead_names
from ..runtime import Kernel, announced, get_threads, helper, inlined, meet
from .templates import renamed

_LOGGER = logging.getLogger("openmm_dpd")
#: Fewer terms than this are not worth waking a second thread for: one takes about 10 ns, waking some 10 us where it goes well.
FEW = 4000
#: Terms whose energies are added up one after the other; the sums of these are added up then, so that no number of threads changes a bit.
CHUNK = 256
_NO_BOX = np.zeros((3, 3))


class Evaluator(Protocol):
    """Computes one :class:`Extra`.

    It belongs to one thread at a time, and may hold scratch arrays, nothing that could not be recomputed.
    """

    def add_to(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, scale: float) -> float:
        """Add the forces at the positions x to ``force``, and return the energy (nm, kJ/mol): the same bits for any number of threads.

        Positions (N, 3) are in or beyond the box of reduced vectors (nm): every distance is taken by minimum image.  ``scale`` is the
        factor of forces on single beads; all other kinds ignore it.  RunError if there is no finite energy; what ``force`` holds then
        means nothing.
        """


class Extra(Protocol):
    """Description of one kind of force: immutable, can be pickled, made of contiguous writeable arrays."""

    #: Under which name :func:`openmm_dpd.force_terms` counts it: "bond", "external", "electrostatic" or "conservative".
    term: ClassVar[str]

    def evaluator(self) -> Evaluator:
        """What computes it, with scratch arrays of its own."""

    def few(self) -> tuple[Extra, np.ndarray, np.ndarray]:
        """An :class:`Extra` of this kind for a few beads, with positions and box: evaluating it compiles what this one needs."""


def box_array(box: np.ndarray | None) -> np.ndarray:
    """The box as kernels with :func:`minimum_image` read it: a copy where it cannot be written, since numba compiles another version for
    such a one; zeros without a box."""
    return _NO_BOX if box is None else np.require(box, np.float64, ["C", "W"])


def energy_chunks(terms: int) -> np.ndarray:
    """Scratch for the energies of as many terms, one number per :data:`CHUNK`."""
    return np.zeros((terms + CHUNK - 1) // CHUNK)


def run_terms(kernel: Kernel, many: bool, *arguments) -> list[float]:
    """Call a kernel with one thread, or with several where there is enough to do for them; returns the two numbers that it writes to its
    last argument."""
    found = np.zeros(2)
    kernel(*arguments, found, parts=get_threads() if many else 1)
    return found.tolist()


@inlined
def inverse_edges(box):
    """One over the diagonal of a box; zeros for a box of zeros, which means no box."""
    if box[0, 0] == 0.0:
        return 0.0, 0.0, 0.0
    return 1.0 / box[0, 0], 1.0 / box[1, 1], 1.0 / box[2, 2]


@inlined
def minimum_image(dx, dy, dz, box, inverse):
    """The vector (dx, dy, dz) by minimum image; as it is in a box of zeros."""
    return nearest_image(dx, dy, dz, box[0, 0], box[1, 0], box[1, 1], box[2, 0], box[2, 1], box[2, 2], inverse)


@inlined
def nearest_image(dx, dy, dz, ax, bx, by, cx, cy, cz, inverse):
    """The vector (dx, dy, dz) by minimum image (:func:`minimum_image`), with the box vectors as numbers."""
    turns = np.floor(dz * inverse[2] + 0.5)
    dx -= turns * cx
    dy -= turns * cy
    dz -= turns * cz
    turns = np.floor(dy * inverse[1] + 0.5)
    dx -= turns * bx
    dy -= turns * by
    dx -= np.floor(dx * inverse[0] + 0.5) * ax
    return dx, dy, dz


def bead_rows(beads: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compressed rows of the beads (K, width) of K terms: bead of each row, first slot of each row (one more), slots.  Slot ``width * k +
    p`` is place p of term k.  The slots of a row increase, so that going through a row adds up what acts on its bead in the order in which
    one thread would meet the terms."""
    flat = beads.ravel()
    slots = np.argsort(flat, kind="stable")
    rows, first = np.unique(flat[slots], return_index=True)
    start = np.append(first, len(flat))
    return rows.astype(np.uint32), start.astype(np.uint32), slots.astype(np.uint32)


@inlined
def add_row(force, bead, begin, end, slots, parts):
    """Add the parts of one row to the force on its bead."""
    fx, fy, fz = force[bead, 0], force[bead, 1], force[bead, 2]
    for k in range(begin, end):
        slot = slots[k]
        fx += parts[slot, 0]
        fy += parts[slot, 1]
        fz += parts[slot, 2]
    force[bead, 0], force[bead, 1], force[bead, 2] = fx, fy, fz


def _terms(x, box, beads, p, rows, start, slots, pieces, energies, moved, force, found, part, parts, team):
    """Add the forces of all terms.  One thread does one after the other; several first write down what each term does, and then each takes
    a bead and adds up its row, in the same order, and so does one where terms have ``moved``."""
    inverse, direct = inverse_edges(box), parts == 1 and not moved
    for chunk in range(len(energies) * part // parts, len(energies) * (part + 1) // parts):
        begin, end = chunk * CHUNK, min((chunk + 1) * CHUNK, len(beads))
        first = begin if direct else 0
        energies[chunk] = _part(x, box, inverse, beads, p, begin, end, pieces, first)
        for n in range(begin, end if direct else begin):
            for place in range(_width):
                bead, slot = beads[n, place], (n - begin) * _width + place
                force[bead, 0] += pieces[slot, 0]
                force[bead, 1] += pieces[slot, 1]
                force[bead, 2] += pieces[slot, 2]
    meet(team, parts)
    total = 0.0
    for chunk in range(len(energies)):
        total += energies[chunk]
    if not np.isfinite(total):
        if part == 0:
            found[0] = total
        return 1
    if not direct:
        for row in range(len(rows) * part // parts, len(rows) * (part + 1) // parts):
            add_row(force, rows[row], start[row], start[row + 1], slots, pieces)
    if part == 0:
        found[0] = total
    return 0


# what _kernel() puts in
_part: Any = None
_width = 0


@cache
def _kernel(kind: Any) -> Kernel:
    """Kernel of a class of terms."""
    names = {"_formula": inlined(kind.formula)}
    part = {"_part": helper(renamed(kind.part, f"{kind.__name__}_part", names), bare=False), "_width": len(kind.sample)}
    return Kernel(renamed(_terms, f"{kind.__name__}_terms", part), bare=False)


@dataclass(frozen=True, eq=False)
class BondedKernel:
    """Terms between a few beads each, all of one kind: bonds, angles, dihedrals or impropers.  A subclass for each kind has its formula."""

    term: ClassVar[str] = "bond"
    #: Compiled with ``formula`` in the place of ``_formula``: ``part(x, box, inverse, beads, p, begin, end, parts, first)`` writes the
    #: forces of the terms from ``begin`` to ``end`` to rows of ``parts``, that of bead k of term n to row ``width * (n - first) + k``, and
    #: returns their energy.
    part: ClassVar[Callable]
    formula: ClassVar[Callable]  #: Energy and its slope, of one term
    called: ClassVar[str] = "a term"  #: In messages
    around: ClassVar[bool] = False  #: Whether images are those nearest to the first bead, rather than to the bead before
    sample: ClassVar[tuple[tuple[float, float, float], ...]]  #: Positions of the beads of one term
    beads: np.ndarray  #: (K, width) uint32, beads of each term
    parameters: np.ndarray  #: (n, K) float64, coefficients of each term

    def evaluator(self) -> TermEvaluator:
        """What computes it."""
        return TermEvaluator(self)

    def between(self, beads: np.ndarray) -> BondedKernel:
        """Terms of these beads (K, width), all like the first one here."""
        return replace(self, beads=beads, parameters=np.repeat(self.parameters[:, :1], len(beads), axis=1))

    def few(self) -> tuple[BondedKernel, np.ndarray, np.ndarray]:
        """One term."""
        width = len(self.sample)
        one = type(self)(np.arange(width, dtype=np.uint32)[None, :], np.ones((len(self.parameters), 1)))
        return one, np.array(self.sample), np.diag([4.0] * 3)

    def what_is_wrong(self, x: np.ndarray, box: np.ndarray | None) -> str:
        """Which term has no finite energy at the positions x."""
        broken = self.beads[~np.isfinite(x[self.beads]).all(axis=(1, 2))]
        which = f"of the {bead_names(*broken[0])} " if len(broken) else ""
        return f"{self.called} {which}has no finite energy"


class TermEvaluator:
    """Computes bonded terms; from so many as ``fewest`` on several threads share the work."""

    repeats = True

    def __init__(self, terms: BondedKernel):
        kind: Any = type(terms)
        beads = terms.beads
        self.terms, self.fewest, self._kernel = terms, FEW, _kernel(kind)
        # all of these are its own: they change with the seats
        rows, self._moved = bead_rows(beads), False
        self._arguments = beads.copy(), terms.parameters.copy(), *rows, np.zeros((beads.size, 3)), energy_chunks(len(beads))
        self._rows = [each.astype(np.int64) for each in rows]

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        """See :meth:`.pairs.PairList.seat`.  Rows, and terms by their first beads, come in the order of the seats, but slots of a row do so
        as ever."""
        (rows, start, slots), width = self._rows, self.terms.beads.shape[1]
        row_of = np.full(len(names), -1)
        row_of[rows] = np.arange(len(rows))
        taken = row_of[names]
        taken = taken[taken >= 0]
        length = np.diff(start)[taken]
        begin = np.append(0, np.cumsum(length))
        of_rows = slots[np.repeat(start[taken] - begin[:-1], length) + np.arange(len(slots))]
        order = of_rows[of_rows % width == 0] // width
        to = np.empty_like(order)  # the new number of each term
        to[order] = np.arange(len(order))
        terms = places[self.terms.beads[order]], self.terms.parameters[:, order]
        of_beads = places[rows[taken]], begin, to[of_rows // width] * width + of_rows % width
        for here, new in zip(self._arguments[:5], (*terms, *of_beads), strict=True):
            here[...] = new
        self._moved = True

    def add_to(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, scale: float) -> float:
        """See :class:`Evaluator`; RunError if a term has no finite energy: a position is not finite, or a bond has a length without one."""
        many = len(self.terms.beads) >= self.fewest
        energy = run_terms(self._kernel, many, x, box_array(box), *self._arguments, self._moved, force)[0]
        if not math.isfinite(energy):
            raise RunError(self.terms.what_is_wrong(x, box))
        return energy


def warm_up_extras(extras: Sequence[Extra]) -> None:
    """Compile what these need, or load it from the cache."""
    for extra in extras:
        small, x, box = extra.few()
        evaluator = small.evaluator()
        with announced(f"{extra.term} forces", 10 if extra.term == "electrostatic" else 5, _LOGGER.warning):
            with suppress(RunError):  # what the numbers are is of no consequence
                evaluator.add_to(x, box, np.zeros_like(x), 1.0)
