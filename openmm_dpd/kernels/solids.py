"""Walls of any shape: beads bounce back from them at the point where they would cross.

A wall is where distances on a grid, with straight lines between its points along each axis, are 0; it is solid where they are negative.  So
all that asks where the wall is has one answer.  In a drift a bead goes straight, in stretches not longer than a cell of the grid.  At the
end of the first that ends in a solid, bisection finds the last point outside that numbers can tell; there the velocity becomes 2 u - v,
with the velocity u of the wall at that point, and the rest of the drift goes on with it, so many times (:data:`TRIES`) that it stays at the
last point in corners.  No bead crosses, therefore.  What a bead gains the wall loses: beads add it up in blocks whose size no number
of threads changes, and the blocks one after the other.  Beads of a wall that moves go with it, exactly, however a drift is divided.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..base.errors import RunError, bead_number, in_length
from ..base.names import SOLID
from ..runtime import Kernel, helper, inlined, meet, threads_for
from .elementary import sine
from .motion import over_beads
from .rigid import cross

#: Bounces of a bead in one drift; halvings of a stretch; beads in a block; cells in one; columns of a wall: angular velocity, centre.
TRIES, HALVINGS, BLOCK, SPAN, SPIN, CENTRE = 8, 40, 64, 4, 3, 6


@dataclass(frozen=True, eq=False)
class Carried:
    """Beads that walls take along: the part that never changes.  Their velocities follow from where they are."""

    wall: np.ndarray  #: (N,) int64 which wall a bead belongs to; -1 for those that none takes along
    motion: np.ndarray  #: (S, 9) as in :class:`Solids`
    edges: np.ndarray  #: (3,) of the box, nm

    def move(self, x: np.ndarray, time: float) -> None:
        """Move them from positions x (N, 3) on for a time."""
        _carry(x, self.wall, self.motion, self.edges, time)

    def see(self, x: np.ndarray, v: np.ndarray) -> None:
        """Write their velocities at positions (N, 3) to v (N, 3)."""
        _see_carried(v, x, self.wall, self.motion, self.edges)


@dataclass(frozen=True, eq=False)
class Solids:
    """S walls in a box with the edges of a grid: the part that never changes."""

    distances: np.ndarray  #: (S, K, L, M) float32 at the points of the grid, nm
    lowest: np.ndarray  #: (S, ...) float32, the lowest of them in blocks of SPAN cells along each axis, which stay in the cache
    edges: np.ndarray  #: (3,) of the box, nm
    slopes: np.ndarray  #: (S,) what the gradient of the distances never exceeds
    motion: np.ndarray  #: (S, 9) velocity, angular velocity and the point that the axis goes through
    inv_mass: np.ndarray  #: (N,) 1/mass, 0 for beads that do not move
    slack: float  #: Depth in a wall at which a bead may start, as positions are rounded, nm
    carried: Carried | None = None  #: Beads that walls take along, if there are any
    steady: ClassVar[bool] = True
    continuum: ClassVar[None] = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of what is recorded: impulse and angular impulse on each wall."""
        return len(self.slopes), 2, 3

    @property
    def impulses(self) -> dict[tuple[int, ...], str]:
        """Names of what is recorded, by wall, kind and component."""
        return {place: SOLID.format(place[0], ("force", "torque")[place[1]], "xyz"[place[2]]) for place in np.ndindex(self.shape)}

    def distance(self, x: np.ndarray) -> np.ndarray:
        """(S, N) distances at positions (N, 3)."""
        found = np.zeros((len(self.slopes), len(x)))
        _distances(self.distances, self.edges, np.ascontiguousarray(x, dtype=np.float64), found)
        return found

    def velocity(self, number: int, x: np.ndarray) -> np.ndarray:
        """(N, 3) velocities of a wall at positions (N, 3)."""
        found = np.zeros((len(x), 3))
        Carried(np.full(len(x), number), self.motion, self.edges).see(np.ascontiguousarray(x, dtype=np.float64), found)
        return found

    def drift(self, x: np.ndarray, v: np.ndarray, time: float, impulses: np.ndarray) -> None:
        """Let beads drift and bounce; what walls get of momentum is added to the impulses (S, 2, 3).  RunError if a bead starts in one."""
        parts = threads_for(len(x))
        wrong, taken = np.full(parts, -1), np.zeros((-(-len(x) // BLOCK), *impulses.shape))
        here = self.distances, self.lowest, self.edges, self.slopes, self.motion, self.slack
        if _drift_kernel(x, v, self.inv_mass, time, *here, taken, impulses, wrong, parts=parts):
            bead = int(wrong.max())
            depth = -self.distance(x[bead : bead + 1]).min()
            raise RunError(
                f"bead {bead_number(bead)} is in a wall, {in_length(depth, 3)} deep; beads that are set or minimised stay outside"
            )
        if self.carried is not None:
            self.carried.move(x, time)


@inlined
def _place(x, edge, count):
    """Point of a grid below a coordinate, the next one, and the place between them."""
    place = x / edge
    place = (place - np.floor(place)) * count
    low = int(place)
    if not 0 <= low < count:  # rounding, or no number
        low, place = 0, 0.0
    return low, low + 1 if low + 1 < count else 0, place - low


@inlined
def _block(x, scale, count):
    """Block of :attr:`Solids.lowest` that a coordinate is in; ``scale`` is the inverse of the length with so many points."""
    place = x * scale
    low = int((place - np.floor(place)) * count)
    return low // SPAN if 0 <= low < count else 0


@helper
def _distance(distances, edges, s, x, y, z):
    """Distance from a wall."""
    _, nx, ny, nz = distances.shape
    i, k, a = _place(x, edges[0], nx)
    j, m, b = _place(y, edges[1], ny)
    n, o, c = _place(z, edges[2], nz)
    low = (1.0 - b) * ((1.0 - c) * distances[s, i, j, n] + c * distances[s, i, j, o])
    low += b * ((1.0 - c) * distances[s, i, m, n] + c * distances[s, i, m, o])
    high = (1.0 - b) * ((1.0 - c) * distances[s, k, j, n] + c * distances[s, k, j, o])
    high += b * ((1.0 - c) * distances[s, k, m, n] + c * distances[s, k, m, o])
    return (1.0 - a) * low + a * high


@helper
def _entered(distances, edges, bar, x, y, z):
    """The wall in which a point is deepest, beyond the depth ``bar`` where the drift began; -1 if it is in none."""
    wall, deepest = -1, bar
    for s in range(len(distances)):
        here = _distance(distances, edges, s, x, y, z)
        if here <= deepest and (here < deepest or wall < 0):
            wall, deepest = s, here
    return wall


@helper
def _first_stretch(distances, edges, bar, x, y, z, dx, dy, dz):
    """Part of a straight way up to the last point before it enters a wall, and the wall; (1, -1) if it enters none."""
    _, nx, ny, nz = distances.shape
    cells = max(abs(dx) * nx / edges[0], abs(dy) * ny / edges[1], abs(dz) * nz / edges[2])
    stretches = int(min(cells, 1e6)) + 1
    low = 0.0
    for k in range(1, stretches + 1):
        high = k / stretches
        wall = _entered(distances, edges, bar, x + high * dx, y + high * dy, z + high * dz)
        if wall >= 0:
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                there = _entered(distances, edges, bar, x + middle * dx, y + middle * dy, z + middle * dz)
                if there >= 0:
                    high, wall = middle, there
                else:
                    low = middle
            return low, wall
        low = high
    return 1.0, -1


@inlined
def _nearest(d, edge):
    return d - edge * np.rint(d / edge)


@inlined
def _speed(motion, edges, s, x, y, z):
    """Vector to a point from the centre of a wall, and the velocity that the wall has there."""
    m = motion[s]
    rx, ry, rz = _nearest(x - m[CENTRE], edges[0]), _nearest(y - m[CENTRE + 1], edges[1]), _nearest(z - m[CENTRE + 2], edges[2])
    ux, uy, uz = cross(m[SPIN], m[SPIN + 1], m[SPIN + 2], rx, ry, rz)
    return rx, ry, rz, m[0] + ux, m[1] + uy, m[2] + uz


@over_beads
def _see_carried(begin, end, v, x, wall, motion, edges):
    for i in range(begin, end):
        if wall[i] >= 0:
            _, _, _, v[i, 0], v[i, 1], v[i, 2] = _speed(motion, edges, wall[i], x[i, 0], x[i, 1], x[i, 2])


@over_beads
def _carry(begin, end, x, wall, motion, edges, time):
    """Along with the velocity of a wall, and on a circle about its axis n by an angle a: r + sin(a) n x r + (1 - cos(a)) n x (n x r)."""
    for i in range(begin, end):
        if wall[i] < 0:
            continue
        m = motion[wall[i]]
        rx, ry, rz, ux, uy, uz = _speed(motion, edges, wall[i], x[i, 0], x[i, 1], x[i, 2])
        spin = np.sqrt(m[SPIN] * m[SPIN] + m[SPIN + 1] * m[SPIN + 1] + m[SPIN + 2] * m[SPIN + 2])
        x[i, 0], x[i, 1], x[i, 2] = x[i, 0] + time * m[0], x[i, 1] + time * m[1], x[i, 2] + time * m[2]
        if spin > 0.0:
            half = sine(0.25 / np.pi * time * spin)
            along, across = sine(0.5 / np.pi * time * spin) / spin, 2.0 * half * half / (spin * spin)
            ux, uy, uz = ux - m[0], uy - m[1], uz - m[2]
            wx, wy, wz = cross(m[SPIN], m[SPIN + 1], m[SPIN + 2], ux, uy, uz)
            x[i, 0] += along * ux + across * wx
            x[i, 1] += along * uy + across * wy
            x[i, 2] += along * uz + across * wz


def _drift(x, v, inv_mass, time, distances, lowest, edges, slopes, motion, slack, taken, impulses, wrong, part, parts, team):
    """Drift and bounce; see :meth:`Solids.drift`."""
    blocks, bad = len(taken), False
    _, nx, ny, nz = distances.shape
    sx, sy, sz = 1.0 / edges[0], 1.0 / edges[1], 1.0 / edges[2]
    for block in range(blocks * part // parts, blocks * (part + 1) // parts):
        its = taken[block]
        its[:] = 0.0
        for i in range(block * BLOCK, min(len(x), (block + 1) * BLOCK)):
            if inv_mass[i] == 0.0:
                continue
            px, py, pz, left = x[i, 0], x[i, 1], x[i, 2], time
            way = time * np.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1] + v[i, 2] * v[i, 2])
            near, depth = False, 0.0
            a, b, c = _block(px, sx, nx), _block(py, sy, ny), _block(pz, sz, nz)
            for s in range(len(slopes)):
                near |= not lowest[s, a, b, c] > slopes[s] * way
            if near:
                near = False
                for s in range(len(slopes)):
                    here = _distance(distances, edges, s, px, py, pz)
                    near |= not here > slopes[s] * way
                    depth = min(depth, here)
            if not near:
                for k in range(3):
                    x[i, k] += time * v[i, k]
                continue
            if depth < -slack:
                wrong[part], bad = i, True
                continue
            for _ in range(TRIES):
                dx, dy, dz = left * v[i, 0], left * v[i, 1], left * v[i, 2]
                part_of_it, s = _first_stretch(distances, edges, depth, px, py, pz, dx, dy, dz)
                px, py, pz = px + part_of_it * dx, py + part_of_it * dy, pz + part_of_it * dz
                if s < 0:
                    break
                left *= 1.0 - part_of_it
                rx, ry, rz, ux, uy, uz = _speed(motion, edges, s, px, py, pz)
                scale = 2.0 / inv_mass[i]
                gx, gy, gz = v[i, 0] - ux, v[i, 1] - uy, v[i, 2] - uz
                tx, ty, tz = cross(rx, ry, rz, gx, gy, gz)
                for k, pushed, turned in ((0, gx, tx), (1, gy, ty), (2, gz, tz)):
                    v[i, k] -= 2.0 * pushed
                    its[s, 0, k] += scale * pushed
                    its[s, 1, k] += scale * turned
            x[i, 0], x[i, 1], x[i, 2] = px, py, pz
    meet(team, parts)
    if part == 0:
        for block in range(blocks):
            for s in range(len(slopes)):
                for k in range(3):
                    impulses[s, 0, k] += taken[block, s, 0, k]
                    impulses[s, 1, k] += taken[block, s, 1, k]
    return 1 if bad else 0


def _distances_at(distances, edges, x, found, part, parts, team):
    for i in range(len(x)):
        for s in range(len(distances)):
            found[s, i] = _distance(distances, edges, s, x[i, 0], x[i, 1], x[i, 2])
    return 0


_drift_kernel, _distances = Kernel(_drift), Kernel(_distances_at)
