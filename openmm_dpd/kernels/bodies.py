"""Rigid bodies beside passes over beads: drifts, and pairs of which a bead is in a body.

Such a pair is updated as in :mod:`.sweeps`, with the sum im of what an impulse along e changes at both places: 1/m for a bead, and for a
body with its centre at X (components of e along which it is held are 0 in the first term)::

    e^2/M + (r x e) I^-1 (r x e),   r = x - X
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import RunError, bead_number
from ..runtime import Kernel, helper
from . import motion, rigid
from .columns import factor_of, row_of
from .elementary import power
from .forces import CUTOFF, EXPONENT, GAMMA
from .moment import Moment
from .noise import normal, pair_key
from .pairs import PairList
from .rigid import INVERSE, MOVES, SPEED, SPIN, BodyBeads, carry_bodies, cross, frame, keep_beads, look_at_bodies, write_beads
from .solids import Solids
from .sweeps import decay


@dataclass(frozen=True, eq=False)
class BodySpec:
    """B bodies of M beads in all: the part that never changes, as :class:`.rigid.BodyBeads` has it."""

    beads: np.ndarray  #: (M,) int64 beads, body by body
    start: np.ndarray
    mass: np.ndarray
    places: np.ndarray  #: Along the principal axes; the third for those in line
    numbers: np.ndarray  #: 1/I3 of beads in line is 1/I1, so that they do not turn about their line
    marks: np.ndarray
    frames: np.ndarray
    spins: np.ndarray

    @staticmethod
    def of(shapes: Any) -> BodySpec:
        """From some :class:`openmm_dpd.model.bodies.Shape`."""
        numbers, marks, frames, spins = [], [], np.zeros((len(shapes), 3, 3)), np.zeros((len(shapes), 3, 3))
        start = np.cumsum([0] + [len(shape.mass) for shape in shapes])
        for first, shape, its, spin in zip(start.tolist(), shapes, frames, spins, strict=False):
            inverse = shape.body.turns / np.where(shape.moments > 0.0, shape.moments, shape.moments[0])
            squares, mass, beads = np.sum(shape.places**2, axis=1), shape.mass.sum(), np.zeros(4)
            if shape.given is not None:
                middle = shape.mass @ shape.places / mass
                arms = np.sqrt(shape.mass)[:, None] * (shape.places - middle)
                spin[:] = np.linalg.pinv(np.sum(arms**2) * np.eye(3) - arms.T @ arms, rcond=1e-9, hermitian=True)
                mass, beads = shape.given, np.array([mass, *middle])
            numbers.append([1.0 / mass, *((axis in shape.body.moves) / mass for axis in "xyz"), *inverse, np.sqrt(squares.max()), *beads])
            # three beads that are far from each other, and far from a line
            a = int(np.argmax(squares))
            b = int(np.argmax(np.sum((shape.places - shape.places[a]) ** 2, axis=1)))
            aside = np.cross(shape.places - shape.places[a], shape.places[b] - shape.places[a])
            c = -1 if shape.in_line else int(np.argmax(np.sum(aside**2, axis=1)))
            frame.py_func(shape.places, a, b, c, its)
            marks.append([first + a, first + b, first + c if c >= 0 else -1])
        beads, mass, places = (np.concatenate(each) for each in zip(*((s.body.beads, s.mass, s.places) for s in shapes), strict=True))
        return BodySpec(beads, start, mass, places, np.array(numbers), np.array(marks), frames, spins)


class PairsOfBodies(NamedTuple):
    """What the sweep over pairs with beads of bodies reads and writes beside the pairs; the first numbers are those of
    :class:`.sweeps.Sweep`."""

    update: int
    kT: float
    dt: float
    key: np.uint64
    coefficients: np.ndarray
    velocities: np.ndarray  #: (N, 3)
    bodies: BodyBeads


@helper
def _at_point(bodies, b, member, inv_mass, ex, ey, ez, vx, vy, vz):
    """What an impulse along e changes at a bead: the inverse mass there, the velocity along e; and of a body the change of the angular
    velocity.  A free bead has b < 0, and the velocity (vx, vy, vz)."""
    if b < 0:
        return inv_mass, ex * vx + ey * vy + ez * vz, 0.0, 0.0, 0.0
    r, u, w, i, n = bodies.arms[member], bodies.state[b, SPEED:], bodies.state[b, SPIN:], bodies.state[b, INVERSE:], bodies.numbers[b]
    tx, ty, tz = cross(r[0], r[1], r[2], ex, ey, ez)
    sx, sy, sz = i[0] * tx + i[3] * ty + i[4] * tz, i[3] * tx + i[1] * ty + i[5] * tz, i[4] * tx + i[5] * ty + i[2] * tz
    im = ex * ex * n[MOVES] + ey * ey * n[MOVES + 1] + ez * ez * n[MOVES + 2] + tx * sx + ty * sy + tz * sz
    return im, ex * u[0] + ey * u[1] + ez * u[2] + tx * w[0] + ty * w[1] + tz * w[2], sx, sy, sz


@helper
def _push(bodies, b, v, row, inv_mass, impulse, e, s):
    """Give an impulse along e to a bead; s is its change of the angular velocity per impulse."""
    for a in range(3):
        if b < 0:
            v[row, a] += impulse * inv_mass * e[a]
        else:
            bodies.state[b, SPEED + a] += impulse * bodies.numbers[b, MOVES + a] * e[a]
            bodies.state[b, SPIN + a] += impulse * s[a]


def _sweep(pairs, data, part, parts, team):
    """Update all pairs of which a bead is in a body, one after the other."""
    bodies, c, v, g = data.bodies, data.coefficients, data.velocities, pairs.geometry
    half = pairs.ntypes // 2
    for column in range(len(pairs.found)):
        for n in range(pairs.start[column], pairs.start[column] + pairs.found[column]):
            i, j = pairs.pi[n], pairs.pj[n]
            if pairs.types[i] < half and pairs.types[j] < half:
                continue
            one, other = pairs.order[i], pairs.order[j]
            a, b = bodies.body[one], bodies.body[other]
            row, r = row_of(pairs, i, j), g[3, n]
            if a == b or r >= c[row, CUTOFF] or c[row, GAMMA] == 0.0:
                continue
            ex, ey, ez, p, q = g[0, n], g[1, n], g[2, n], pairs.seats[i], pairs.seats[j]
            im, vi, xi, yi, zi = _at_point(bodies, a, bodies.member[one], pairs.inv_mass[i], ex, ey, ez, v[p, 0], v[p, 1], v[p, 2])
            jm, vj, xj, yj, zj = _at_point(bodies, b, bodies.member[other], pairs.inv_mass[j], ex, ey, ez, v[q, 0], v[q, 1], v[q, 2])
            both = im + jm
            if not both > 0.0:
                continue
            w = 1.0 - r / c[row, CUTOFF]
            w = w if c[row, EXPONENT] == 1.0 else power(w, c[row, EXPONENT])
            lost = decay(data.update, factor_of(pairs, n) * c[row, GAMMA] * w * w * both * data.dt)
            impulse = -lost / both * (vi - vj)
            if data.kT > 0.0:
                impulse += np.sqrt(lost * (2.0 - lost) * data.kT * both) * normal(pair_key(data.key, one, other), 0) / both
            _push(bodies, a, v, p, pairs.inv_mass[i], impulse, (ex, ey, ez), (xi, yi, zi))
            _push(bodies, b, v, q, pairs.inv_mass[j], -impulse, (ex, ey, ez), (xj, yj, zj))
    return 0


_sweep_kernel = Kernel(_sweep)


class Bodies:
    """Moves all bodies of a :class:`BodySpec` among N beads; what it holds could be recomputed."""

    def __init__(self, spec: BodySpec, count: int):
        self.spec, members = spec, len(spec.beads)
        body, member = np.full(count, -1, np.int32), np.zeros(count, np.int32)
        body[spec.beads], member[spec.beads] = np.repeat(np.arange(len(spec.marks)), np.diff(spec.start)), np.arange(members)
        #: (N,) which beads are in bodies
        self.inside_bodies = body >= 0
        known = spec.start, spec.mass, spec.places, spec.numbers, spec.marks, spec.frames, spec.spins
        before, was, arms = np.zeros((3, members, 3))
        scratch = before, was, arms, np.zeros((len(spec.marks), 18)), np.zeros_like(spec.frames)
        self.beads = BodyBeads(spec.beads.copy(), *known, *scratch, body, member, np.zeros(1, np.int64))

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        """See :meth:`.pairs.PairList.seat`."""
        self.beads.rows[:] = places[self.spec.beads]

    def keep(self, x: np.ndarray, v: np.ndarray) -> None:
        """Remember the positions (N, 3) from which bodies will drift, and their velocities before beads are kicked."""
        keep_beads(self.beads, x, v)

    def carry(self, x: np.ndarray, v: np.ndarray, time: float, kicked: bool = True) -> None:
        """Drift for a time from the positions that are kept, with the bodies' part of the velocities (N, 3), and write both; for the time 0
        write velocities alone.  The beads were ``kicked`` since velocities were kept.  RunError if a body is not rigid any more."""
        if carry_bodies(self.beads, x, v, time, kicked):
            bead = self.spec.beads[self.beads.wrong[0]]
            raise RunError(
                f"body {self.beads.body[bead]} is not rigid: bead {bead_number(bead)} is not at its place; positions that are set "
                "must be those of whole bodies, in the shape that they have in the scene"
            )

    def inside(self, x: np.ndarray, force: np.ndarray) -> float:
        """Sum over the bodies' beads of r F, r from their centres: what the forces that keep the bodies rigid cancel in the virial."""
        self.look(x, x)
        return float(np.sum(self.beads.arms * force[self.spec.beads]))

    def centred(self, values: np.ndarray, x: np.ndarray | None = None) -> np.ndarray:
        """Accelerations (N, 3), or velocities at positions x, in which beads of bodies have that of the centre, along the axes where it
        moves; times the root of its mass over theirs, so that squares times masses of beads are those of the body."""
        spec, out = self.spec, values.copy()
        found = np.add.reduceat(spec.mass[:, None] * values[spec.beads], spec.start[:-1]) * spec.numbers[:, MOVES : MOVES + 3]
        given = spec.numbers[:, rigid.BEADS] > 0.0
        if given.any() and x is not None:
            self.look(x, values)
            found[given] = self.beads.state[given, SPEED : SPEED + 3]
        found[given] /= np.sqrt(spec.numbers[given, rigid.BEADS] * spec.numbers[given, rigid.INV_MASS])[:, None]
        out[spec.beads] = np.repeat(found, np.diff(spec.start), axis=0)
        return out

    def look(self, x: np.ndarray, v: np.ndarray) -> None:
        """Read the bodies' motion at positions and velocities (N, 3), before pairs are swept over."""
        look_at_bodies(self.beads, x, v)

    def sweep(self, pairs: PairList, update: int, kT: float, dt: float, key: np.uint64, coefficients: np.ndarray, v: np.ndarray) -> None:
        """Update the pairs of a list of which a bead is in a body, in the velocities (N, 3) of free beads and the motion of bodies."""
        terms = PairsOfBodies(update, kT, dt, key, coefficients, v, self.beads)
        _sweep_kernel(pairs.arrays, terms, memory=pairs.memory)

    def write(self, v: np.ndarray) -> None:
        """Write the velocities (N, 3) of the bodies' beads after sweeps."""
        write_beads(self.beads, v)


def move_all(
    bodies: Bodies | None, walls: Any, m: Moment, force: np.ndarray, inv_mass: np.ndarray, kick: float, time: float, limit: float
) -> int:
    """Kick and drift the beads of a moment (see :func:`.motion.move`), those of bodies together, and up to walls that have a shape."""
    bounces = time != 0.0 and isinstance(walls, Solids)
    if bodies is not None:
        bodies.keep(m.x, m.v)
    found = motion.move(m.x.ravel(), m.v.ravel(), force, inv_mass, kick, 0.0 if bounces else time, limit)
    if bounces:
        walls.drift(m.x, m.v, time, m.impulses)
    if bodies is not None:
        bodies.carry(m.x, m.v, time)
    return found


def accelerate_all(bodies: Bodies | None, m: Moment, force: np.ndarray, inv_mass: np.ndarray, kick: float) -> None:
    """Write the accelerations of the beads of a moment, and kick them (see :func:`.motion.accelerate`), those of bodies together."""
    assert m.acc is not None
    if bodies is not None:
        bodies.keep(m.x, m.v)
    motion.accelerate(m.acc.ravel(), m.v.ravel(), force, inv_mass, kick)
    if bodies is not None and kick:
        bodies.carry(m.x, m.v, 0.0)
