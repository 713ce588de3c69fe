"""Segmental repulsion: pairs of bonds within reach of each other, from the pair lists of their midpoints.

Segment s goes from bead i to bead j, x_i and x_j = x_i + arm, with its midpoint m in between.  With the contact points m + t arm,
-1/2 <= t <= 1/2, of two segments and the vector d from the second to the first::

    F = A (1 - d/cutoff) d/|d|,   U = 1/2 A cutoff (1 - d/cutoff)^2   for d < cutoff
    f_i += (1/2 - t) F,   f_j += (1/2 + t) F   for the first segment, the opposite for the second

``MID``: t = 0.  ``NEAREST``: the nearest points of the two segments; the force is the gradient of U.  ``CLAMPED``: the nearest points of
the two straight lines, each moved to the end of its own segment by itself, as LAMMPS's ``srp min`` has it; where one is moved these are not
the nearest points, and the force is not quite the gradient of U.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from ..base.errors import RunError, bead_names, in_length
from ..runtime import Kernel, helper, inlined
from .columns import add_stress, over_pairs
from .exceptions import no_exceptions
from .extras import bead_rows, box_array, inverse_edges, minimum_image
from .pairs import PairList

MID, NEAREST, CLAMPED = range(3)
#: Distance (nm) below which a contact has no direction, and exerts no force.
D_MIN = 1e-10
_NO_BOX = b"none"


@dataclass(frozen=True, eq=False)
class SegmentSpec:
    """Repulsion between bonds: the part of the kernel's input that never changes, an :class:`.extras.Extra`."""

    term: ClassVar[str] = "conservative"
    n_beads: int
    pairs: np.ndarray  #: (S, 2) beads of each segment
    A: float  # A, cutoff: force at d = 0 (kJ/mol/nm) and range (nm)
    cutoff: float
    rule: int  #: ``MID``, ``NEAREST`` or ``CLAMPED``
    exclude_adjoining: bool = True  #: Whether segments that share a bead leave each other alone

    def evaluator(self) -> SegmentEngine:
        """What computes it."""
        return SegmentEngine(self)

    def between(self, beads: np.ndarray) -> SegmentSpec:
        """The same between these bonds (S, 2)."""
        return replace(self, pairs=beads)

    def few(self) -> tuple[SegmentSpec, np.ndarray, np.ndarray]:
        """Two bonds."""
        half = 0.25 * self.cutoff
        x = np.array([[0.0, 0, 0], [half, 0, 0], [0, half, 0], [half, half, half]]) + self.cutoff
        return replace(self, n_beads=4, pairs=np.array([[0, 1], [2, 3]])), x, np.diag([8.0 * self.cutoff] * 3)


def adjoining(pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Segments that share a bead, as exceptions of factor 0 in compressed rows (see :class:`.pairs.PairList`)."""
    _, start, slots = bead_rows(pairs)
    (of, many), n = (slots // 2, np.diff(start)), np.int64(len(pairs))
    row, found = np.repeat(np.arange(len(many)), many), [np.zeros(0, np.int64)]
    for gap in range(1, many.max(initial=0)):
        first = np.flatnonzero(row[gap:] == row[:-gap])
        found += [of[first] * n + of[first + gap], of[first + gap] * n + of[first]]
    codes = np.unique(np.concatenate(found))
    if not len(codes):
        return no_exceptions()
    return np.searchsorted(codes, np.arange(n + 1) * n), codes % n, np.zeros(len(codes))


@inlined
def _clamp(t):
    return min(0.5, max(-0.5, t))


@inlined
def _products(px, py, pz, a, b, i, j):
    """Products of two arms with themselves, with each other, and with p."""
    aa = a[i, 0] * a[i, 0] + a[i, 1] * a[i, 1] + a[i, 2] * a[i, 2]
    bb = b[j, 0] * b[j, 0] + b[j, 1] * b[j, 1] + b[j, 2] * b[j, 2]
    ab = a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]
    return aa, bb, ab, a[i, 0] * px + a[i, 1] * py + a[i, 2] * pz, b[j, 0] * px + b[j, 1] * py + b[j, 2] * pz


@helper
def _nearest(px, py, pz, a, b, i, j):
    """Places (s, t) of the nearest points m_i + s a and m_j + t b of two segments with p = m_i - m_j.  Where the segments are parallel it
    is the middle of the stretch along which they are equally near."""
    aa, bb, ab, ap, bp = _products(px, py, pz, a, b, i, j)
    if aa < 1e-30 or bb < 1e-30:  # a segment without a length is a point
        s = _clamp(-ap / aa) if aa >= 1e-30 else 0.0
        t = _clamp(bp / bb) if bb >= 1e-30 else 0.0
        return s, t
    det = aa * bb - ab * ab
    if det > 1e-12 * aa * bb:
        s = _clamp((ab * bp - bb * ap) / det)
    else:
        one, other = (0.5 * bb - bp) / ab, (-0.5 * bb - bp) / ab
        s = _clamp(0.5 * (max(-0.5, min(one, other)) + min(0.5, max(one, other))))
    t = (ab * s + bp) / bb
    if t < -0.5 or t > 0.5:
        t = _clamp(t)
        s = _clamp((ab * t - ap) / aa)
    return s, t


@helper
def _clamped(px, py, pz, a, b, i, j):
    """Places of the contact points as LAMMPS's srp has them: each moved to the end of its segment by itself; midpoints where parallel."""
    aa, bb, ab, ap, bp = _products(px, py, pz, a, b, i, j)
    det = aa * bb - ab * ab
    if abs(det) < 1e-10:
        det = np.inf
    return _clamp((ab * bp - bb * ap) / det), _clamp((aa * bp - ab * ap) / det)


class Contacts(NamedTuple):
    """What the loop reads and writes beside the pairs."""

    rule: int
    A: float
    cutoff: float
    arms: np.ndarray  # arms, arm: (S, 3) in the order of the segments, and sorted
    arm: np.ndarray
    f: np.ndarray  #: (S, 6) forces on the first and second bead of each sorted segment
    pieces: np.ndarray  #: (2 S, 3) the same in the order of the segments
    stress: np.ndarray  #: (columns, 6)


@helper
def _lay_down(pairs, data, begin, end):
    """Sort the arms, and begin with no force."""
    for k in range(begin, end):
        s = pairs.order[k]
        data.arm[k, 0], data.arm[k, 1], data.arm[k, 2] = data.arms[s, 0], data.arms[s, 1], data.arms[s, 2]
        data.f[k, :] = 0.0
    if begin == 0:
        data.stress[:] = 0.0


@helper
def _take_up(pairs, data, begin, end):
    """Give the forces back in the order of the segments."""
    for k in range(begin, end):
        s = np.uint64(pairs.order[k])
        for n in range(3):
            data.pieces[np.uint64(2) * s, n] = data.f[k, n]
            data.pieces[np.uint64(2) * s + np.uint64(1), n] = data.f[k, 3 + n]


@inlined
def _share(f, i, s, fx, fy, fz):
    """Add a force at the place s of segment i."""
    f[i, 0] += (0.5 - s) * fx
    f[i, 1] += (0.5 - s) * fy
    f[i, 2] += (0.5 - s) * fz
    f[i, 3] += (0.5 + s) * fx
    f[i, 4] += (0.5 + s) * fy
    f[i, 5] += (0.5 + s) * fz


@inlined
def _contact(pairs, data, scratch, n, k, column):
    i, j, g, arm = pairs.pi[n], pairs.pj[n], pairs.geometry, data.arm
    dx, dy, dz = g[3, n] * g[0, n], g[3, n] * g[1, n], g[3, n] * g[2, n]
    s, t = 0.0, 0.0
    if data.rule == NEAREST:
        s, t = _nearest(dx, dy, dz, arm, arm, i, j)
    elif data.rule == CLAMPED:
        s, t = _clamped(dx, dy, dz, arm, arm, i, j)
    dx += s * arm[i, 0] - t * arm[j, 0]
    dy += s * arm[i, 1] - t * arm[j, 1]
    dz += s * arm[i, 2] - t * arm[j, 2]
    d = np.sqrt(dx * dx + dy * dy + dz * dz)
    if d >= data.cutoff:
        return 0.0, 0.0, 0.0
    w = 1.0 - d / data.cutoff
    energy = 0.5 * data.A * data.cutoff * w * w
    if d < D_MIN:
        return energy if data.rule == NEAREST else 0.0, 0.0, 0.0
    radial = data.A * w / d
    fx, fy, fz = radial * dx, radial * dy, radial * dz
    # the shares of F at both ends of a segment have the contact point as their centre
    add_stress(data.stress, column, (dx * fx, dy * fy, dz * fz, dx * fy, dx * fz, dy * fz))
    _share(data.f, i, s, fx, fy, fz)
    _share(data.f, j, t, -fx, -fy, -fz)
    return energy, radial * d * d, 0.0


segment_forces = over_pairs("segment_forces", _contact, first=_lay_down, last=_take_up)


def _arms(x, box, beads, arms, middles, cutoff, eighths, most, longest, part, parts, team):
    """Vectors along segments, their middles, and the length of the longest one.  Returns 1 where that is beyond ``most``, or reaches not so
    many eighths of the cutoff: in such steps it counts, since the cells of the list are made anew whenever it changes."""
    inverse = inverse_edges(box)
    length2 = 0.0
    for s in range(len(beads)):
        i, j = beads[s, 0], beads[s, 1]
        dx, dy, dz = minimum_image(x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2], box, inverse)
        arms[s, 0], arms[s, 1], arms[s, 2] = dx, dy, dz
        middles[s, 0], middles[s, 1], middles[s, 2] = x[i, 0] + 0.5 * dx, x[i, 1] + 0.5 * dy, x[i, 2] + 0.5 * dz
        here = dx * dx + dy * dy + dz * dz
        length2 = here if not here <= length2 else length2
        if not np.isfinite(here):
            longest[0] = here
            return 1
    longest[0] = np.sqrt(length2)
    return 0 if longest[0] <= most and (eighths < 0.0 or np.ceil(8.0 * longest[0] / cutoff + 1e-9) == eighths) else 1


lay_arms = Kernel(_arms)


def _add_rows(force, rows, start, slots, pieces, part, parts, team):
    """Add up what acts on each bead, and add that to its force."""
    for row in range(len(rows)):
        i, fx, fy, fz = rows[row], 0.0, 0.0, 0.0
        for k in range(start[row], start[row + 1]):
            fx += pieces[slots[k], 0]
            fy += pieces[slots[k], 1]
            fz += pieces[slots[k], 2]
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
    return 0


add_rows = Kernel(_add_rows)


class SegmentEngine:
    """Evaluates one :class:`SegmentSpec`; it belongs to one thread at a time.

    The results are the same, bit for bit, for any number of threads, and depend on the present positions alone.
    """

    repeats = True

    def __init__(self, spec: SegmentSpec):
        self.spec = self.terms = spec
        n = len(spec.pairs)
        exceptions = adjoining(spec.pairs) if spec.exclude_adjoining else no_exceptions()
        self.list = PairList(np.zeros(n, np.int32), np.ones(n), np.array([[spec.cutoff]]), exceptions)
        self._beads = spec.pairs.astype(np.uint32)
        self._rows = bead_rows(self._beads)
        self._middles, arms = np.zeros((n, 3)), np.zeros((n, 3))
        self._data = Contacts(
            spec.rule, spec.A, spec.cutoff, arms, np.zeros((n, 3)), np.zeros((n, 6)), np.zeros((2 * n, 3)), np.zeros((0, 6))
        )
        #: edges of the box that the reach was set in, and the reach; -1 where it does not depend on lengths
        self._box, self._eighths = b"", -1.0

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        """See :meth:`.pairs.PairList.seat`."""
        self._beads[...] = places[self.spec.pairs]
        for here, moved in zip(self._rows, bead_rows(self._beads), strict=True):
            here[...] = moved

    def forces(self, x: np.ndarray, box: np.ndarray | None) -> tuple[float, np.ndarray, np.ndarray]:
        """Energy, forces (N, 3) and sum over contacts of d F (6,) (xx, yy, zz, xy, xz, yz) at positions x (N, 3), in or beyond the box.

        RunError if a position is not finite, or the box too small for the range and the length of the bonds.
        """
        force = np.zeros((self.spec.n_beads, 3))
        return self.add_to(x, box, force, 1.0), force, self._data.stress.sum(axis=0)

    def add_to(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, scale: float) -> float:
        """See :class:`.extras.Evaluator`; RunError as :meth:`forces`."""
        spec, pairs = self.spec, self.list
        longest, most = np.zeros(1), math.inf
        if box is not None and spec.rule != MID:
            most = 0.5 * box.diagonal().min() * (1 + 1e-9) - spec.cutoff
        here = self._beads, self._data.arms, self._middles, spec.cutoff, self._eighths, most
        if lay_arms(x, box_array(box), *here, longest) or self._box != _edges(box):
            self._set_reach(x, float(longest[0]), box)
        pairs.build(self._middles, box)
        if len(self._data.stress) != len(pairs.arrays.found):
            self._data = self._data._replace(stress=np.zeros((len(pairs.arrays.found), 6)))
        energy = segment_forces(pairs, self._data).energy
        add_rows(force, *self._rows, self._data.pieces)
        return energy

    def stress(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """The sum alone; RunError as :meth:`forces`."""
        return self.forces(x, box)[2]

    def shared(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.pairs.PairList.shared`; the beads (P, 4) of both segments of each contact."""
        self.list.tensors = self._data.stress
        segments, values = self.list.shared()
        return self.spec.pairs[segments].reshape(-1, 4), values

    def _set_reach(self, x: np.ndarray, longest: float, box: np.ndarray | None) -> None:
        """Distance of midpoints up to which two segments can meet; it depends on the longest of them where ends can meet."""
        spec, pairs = self.spec, self.list
        if not math.isfinite(longest):
            i, j = spec.pairs[np.isfinite(x[self._beads].sum(axis=(1, 2))).argmin()]
            raise RunError(f"the position of one of the {bead_names(i, j)} is not finite")
        ends_meet = spec.rule != MID
        if box is not None and spec.cutoff + longest * ends_meet > 0.5 * box.diagonal().min() * (1 + 1e-9):
            raise RunError(
                f"segmental repulsion reaches over half the box: the range of {in_length(spec.cutoff)}"
                + (f" and the longest bond of {in_length(longest)}" if ends_meet else "")
                + f" in a box of {' x '.join(map(in_length, box.diagonal()))}"
            )
        eighths = math.ceil(8.0 * longest / spec.cutoff + 1e-9) if ends_meet else -1.0
        reach = spec.cutoff * (1.0 + max(0.0, eighths) / 8.0)
        self._box = b""  # until the list has it
        if reach != pairs.cutoff:
            pairs.set_cutoff(np.array([[reach]]))
        self._eighths, self._box = eighths, _edges(box)


def _edges(box: np.ndarray | None) -> bytes:
    """What the reach depends on of a box."""
    return _NO_BOX if box is None else box.diagonal().tobytes()
