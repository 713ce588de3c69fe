r"""The motion of rigid bodies: compiled passes over them.

The state is positions and velocities of beads.  Every pass reads centre X, rotation R, velocity V and angular momentum L of a body from
them, and writes them back::

    X = sum m x / M,   V = sum m v / M,   L = sum m (x - X) x v,   x = X + R s,   v = V + I^-1 L x (x - X)

with the places s of the beads along its principal axes, and R from three beads that are far apart.  So kicks may act on single beads: to
read and write velocities afterwards is the kick of the body.  Where mass, centre and tensor of inertia of a body are given, and are not
those of its beads, V and L are those before the kick, which the velocities of beads at that time show, and the impulses that the beads have
got since then.  In a drift a body turns by the exact rotation of a symmetric top, and before and after it for half the time about its
second axis, as the rest of the kinetic energy asks for::

    T = [ L^2/(2 I1) + (1/I3 - 1/I1) L3^2/2 ] + (1/I2 - 1/I1) L2^2/2

This is exact for spheres, rods and symmetric tops, and of second order for others (Dullweber, Leimkuhler and McLachlan, J. Chem. Phys.
107, 5840 (1997); Touma and Wisdom, Astron. J. 107, 1189 (1994)).
"""

from typing import NamedTuple

import numpy as np

from ..runtime import Kernel, helper, inlined
from .elementary import sine

#: Part of its size by which beads may be away from where they should be in a body.
TOLERANCE = 1e-3
#: Columns of the numbers of a body: 1/M, 1/M along the axes where it moves, 1/moments of inertia (0 if it does not turn), size, and the
#: mass of its beads if its own is given (else 0), with their centre in its axes.
INV_MASS, MOVES, TURNS, SIZE, BEADS, MIDDLE = 0, 1, 4, 7, 8, 9
#: Columns of its state: centre, velocity, angular momentum, angular velocity, inverse tensor of inertia (xx, yy, zz, xy, xz, yz).
CENTRE, SPEED, MOMENTUM, SPIN, INVERSE = 0, 3, 6, 9, 12


class BodyBeads(NamedTuple):
    """What kernels read and write of all bodies, M beads in B bodies."""

    rows: np.ndarray  #: (M,) int64 row of each bead in arrays of beads
    start: np.ndarray  #: (B + 1,) the first bead of each body
    mass: np.ndarray  #: (M,)
    places: np.ndarray  #: (M, 3)
    numbers: np.ndarray  #: (B, 12)
    marks: np.ndarray  #: (B, 3) which of the M beads show the rotation; the third is -1 if they are in line
    frames: np.ndarray  #: (B, 3, 3) the :func:`frame` of their places
    spins: np.ndarray  #: (B, 3, 3) in the body's axes, its angular velocity per angular momentum of its beads, where the former are given
    before: np.ndarray  #: (M, 3) positions before a drift
    was: np.ndarray  #: (M, 3) velocities before a kick
    arms: np.ndarray  #: (M, 3) vectors from the centres, while pairs are swept over
    state: np.ndarray  #: (B, 18)
    turn: np.ndarray  #: (B, 3, 3) rotations
    body: np.ndarray  #: (N,) int32 body of each bead, by its number; -1 for free ones
    member: np.ndarray  #: (N,) int32 which of the M beads it is
    wrong: np.ndarray  #: (1,) int64 bead that is not at its place


@inlined
def cross(ax, ay, az, bx, by, bz):
    """Vector product."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def _in_space(turn, x, y, z):
    return (
        turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
        turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
        turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z,
    )


@inlined
def _in_body(turn, x, y, z):
    return _in_space(turn.T, x, y, z)


@inlined
def _spin(turn, rates, x, y, z):
    """R diag(rates) R^T times a vector."""
    a, b, c = _in_body(turn, x, y, z)
    return _in_space(turn, rates[0] * a, rates[1] * b, rates[2] * c)


@helper
def frame(x, a, b, c, out):
    """Write the rotation whose first column points from row a of x to row b, and the second to the side of row c; to any if c < 0."""
    ux, uy, uz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    scale = 1.0 / np.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = scale * ux, scale * uy, scale * uz
    vx, vy, vz = 1.0 * (abs(ux) < 0.9), 1.0 * (abs(ux) >= 0.9), 0.0
    if c >= 0:
        vx, vy, vz = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    along = ux * vx + uy * vy + uz * vz
    vx, vy, vz = vx - along * ux, vy - along * uy, vz - along * uz
    scale = 1.0 / np.sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = scale * vx, scale * vy, scale * vz
    out[0, 0], out[1, 0], out[2, 0] = ux, uy, uz
    out[0, 1], out[1, 1], out[2, 1] = vx, vy, vz
    out[0, 2], out[1, 2], out[2, 2] = cross(ux, uy, uz, vx, vy, vz)


@helper
def _rotate(turn, nx, ny, nz, angle):
    """Turn a body by an angle about a unit vector along its axes."""
    turns = angle / (2.0 * np.pi)
    c, s = sine(turns + 0.25), sine(turns)
    for a in range(3):
        x, y, z = turn[a, 0], turn[a, 1], turn[a, 2]
        along = (1.0 - c) * (x * nx + y * ny + z * nz)
        ox, oy, oz = cross(x, y, z, nx, ny, nz)
        turn[a, 0], turn[a, 1], turn[a, 2] = c * x + s * ox + along * nx, c * y + s * oy + along * ny, c * z + s * oz + along * nz


@helper
def _turn_freely(turn, rates, lx, ly, lz, time):
    """Turn a body with the angular momentum L for a time."""
    size = np.sqrt(lx * lx + ly * ly + lz * lz)
    for half in range(2):
        _rotate(turn, 0.0, 1.0, 0.0, 0.5 * time * (rates[1] - rates[0]) * _in_body(turn, lx, ly, lz)[1])
        if half == 0 and size > 0.0:
            a, b, c = _in_body(turn, lx, ly, lz)
            _rotate(turn, a / size, b / size, c / size, time * rates[0] * size)
            _rotate(turn, 0.0, 0.0, 1.0, time * (rates[2] - rates[0]) * c)


@helper
def _read_given(bodies, b, x, v, kept, kicked):
    """Read centre, velocity and angular momentum of body b, whose mass and inertia are given and whose rotation is known: the motion that
    its beads show, before they were ``kicked`` if so, and what their kicks have added to it."""
    begin, end, n, its, turn = bodies.start[b], bodies.start[b + 1], bodies.numbers[b], bodies.state[b], bodies.turn[b]
    first = begin if kept else bodies.rows[begin]
    mx, my, mz = _in_space(turn, n[MIDDLE], n[MIDDLE + 1], n[MIDDLE + 2])
    cx, cy, cz = 0.0, 0.0, 0.0
    for k in range(begin, end):
        i, part = k if kept else bodies.rows[k], bodies.mass[k] / n[BEADS]
        cx += part * (x[i, 0] - x[first, 0])
        cy += part * (x[i, 1] - x[first, 1])
        cz += part * (x[i, 2] - x[first, 2])
    its[CENTRE], its[CENTRE + 1], its[CENTRE + 2] = x[first, 0] + cx - mx, x[first, 1] + cy - my, x[first, 2] + cz - mz
    ux, uy, uz, lx, ly, lz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    px, py, pz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(begin, end):
        i, j, m = k if kept else bodies.rows[k], bodies.rows[k], bodies.mass[k]
        rx, ry, rz = x[i, 0] - its[0], x[i, 1] - its[1], x[i, 2] - its[2]
        vx, vy, vz = v[j, 0], v[j, 1], v[j, 2]
        if kicked:
            vx, vy, vz = bodies.was[k, 0], bodies.was[k, 1], bodies.was[k, 2]
            gx, gy, gz = m * (v[j, 0] - vx), m * (v[j, 1] - vy), m * (v[j, 2] - vz)
            qx, qy, qz = cross(rx, ry, rz, gx, gy, gz)
            px, py, pz, tx, ty, tz = px + gx, py + gy, pz + gz, tx + qx, ty + qy, tz + qz
        qx, qy, qz = cross(rx - mx, ry - my, rz - mz, m * vx, m * vy, m * vz)
        ux, uy, uz, lx, ly, lz = ux + m * vx, uy + m * vy, uz + m * vz, lx + qx, ly + qy, lz + qz
    a, c, d = _in_body(turn, lx, ly, lz)
    a, c, d = _in_space(bodies.spins[b], a, c, d)
    wx, wy, wz = _in_space(turn, a, c, d)
    qx, qy, qz = cross(wx, wy, wz, mx, my, mz)
    for k, speed, push in ((0, ux / n[BEADS] - qx, px), (1, uy / n[BEADS] - qy, py), (2, uz / n[BEADS] - qz, pz)):
        its[SPEED + k] = (speed if n[MOVES + k] > 0.0 else 0.0) + n[MOVES + k] * push
    if n[TURNS] > 0.0:
        wx, wy, wz = _in_space(turn, a / n[TURNS], c / n[TURNS + 1], d / n[TURNS + 2])
        its[MOMENTUM], its[MOMENTUM + 1], its[MOMENTUM + 2] = wx + tx, wy + ty, wz + tz


@helper
def _read(bodies, b, x, v, kept, kicked):
    """Read centre, velocity, angular momentum and rotation of body b, without what is held; positions are rows of x, or ``kept`` ones.
    If it was ``kicked``, velocities before that are kept, too."""
    begin, end, n, its, turn = bodies.start[b], bodies.start[b + 1], bodies.numbers[b], bodies.state[b], bodies.turn[b]
    first, marks = begin if kept else bodies.rows[begin], bodies.marks[b]
    its[:] = 0.0
    for k in range(begin, end):
        i, j, m = k if kept else bodies.rows[k], bodies.rows[k], bodies.mass[k]
        for a in range(3):
            its[CENTRE + a] += m * (x[i, a] - x[first, a])
            its[SPEED + a] += m * v[j, a]
    for a in range(3):
        its[CENTRE + a] = x[first, a] + n[INV_MASS] * its[CENTRE + a]
        its[SPEED + a] *= n[MOVES + a]
    for k in range(begin, end):
        i, j, m = k if kept else bodies.rows[k], bodies.rows[k], bodies.mass[k]
        lx, ly, lz = cross(x[i, 0] - its[0], x[i, 1] - its[1], x[i, 2] - its[2], v[j, 0], v[j, 1], v[j, 2])
        its[MOMENTUM] += m * lx
        its[MOMENTUM + 1] += m * ly
        its[MOMENTUM + 2] += m * lz
    if n[TURNS] == 0.0:
        its[MOMENTUM : MOMENTUM + 3] = 0.0
    last = marks[2] if kept or marks[2] < 0 else bodies.rows[marks[2]]
    frame(x, marks[0] if kept else bodies.rows[marks[0]], marks[1] if kept else bodies.rows[marks[1]], last, turn)
    for a in range(3):
        turn[a, 0], turn[a, 1], turn[a, 2] = _in_space(bodies.frames[b], turn[a, 0], turn[a, 1], turn[a, 2])
    if n[BEADS] > 0.0:
        _read_given(bodies, b, x, v, kept, kicked)


def _keep(bodies, x, v, part, parts, team):
    """Write down the positions and velocities of all beads of bodies."""
    for k in range(len(bodies.rows)):
        for a in range(3):
            bodies.before[k, a] = x[bodies.rows[k], a]
            bodies.was[k, a] = v[bodies.rows[k], a]
    return 0


def _carry(bodies, x, v, time, kicked, part, parts, team):
    """Let bodies drift for a time from where they were kept; for the time 0 their velocities alone change, to those of bodies.  Returns 1
    where one is not rigid."""
    kept = time != 0.0
    here = bodies.before if kept else x
    for b in range(len(bodies.numbers)):
        _read(bodies, b, here, v, kept, kicked)
        its, turn, rates, far = bodies.state[b], bodies.turn[b], bodies.numbers[b, TURNS:], 0.0
        for k in range(bodies.start[b], bodies.start[b + 1]):
            i = k if kept else bodies.rows[k]
            rx, ry, rz = _in_space(turn, bodies.places[k, 0], bodies.places[k, 1], bodies.places[k, 2])
            off = (here[i, 0] - its[0] - rx) ** 2 + (here[i, 1] - its[1] - ry) ** 2 + (here[i, 2] - its[2] - rz) ** 2
            if not off <= far:
                far, bodies.wrong[0] = off, k
        if not far <= (TOLERANCE * bodies.numbers[b, SIZE]) ** 2:
            return 1
        lx, ly, lz = its[MOMENTUM], its[MOMENTUM + 1], its[MOMENTUM + 2]
        if kept:
            _turn_freely(turn, rates, lx, ly, lz, time)
            for a in range(3):
                its[CENTRE + a] += time * its[SPEED + a]
        wx, wy, wz = _spin(turn, rates, lx, ly, lz)
        for k in range(bodies.start[b], bodies.start[b + 1]):
            i = bodies.rows[k]
            rx, ry, rz = _in_space(turn, bodies.places[k, 0], bodies.places[k, 1], bodies.places[k, 2])
            if kept:
                x[i, 0], x[i, 1], x[i, 2] = its[0] + rx, its[1] + ry, its[2] + rz
            ox, oy, oz = cross(wx, wy, wz, rx, ry, rz)
            v[i, 0], v[i, 1], v[i, 2] = its[SPEED] + ox, its[SPEED + 1] + oy, its[SPEED + 2] + oz
    return 0


def _look(bodies, x, v, part, parts, team):
    """Read all bodies, with arms, angular velocities and inverse tensors of inertia."""
    for b in range(len(bodies.numbers)):
        _read(bodies, b, x, v, False, False)
        its, turn, rates = bodies.state[b], bodies.turn[b], bodies.numbers[b, TURNS:]
        its[SPIN], its[SPIN + 1], its[SPIN + 2] = _spin(turn, rates, its[MOMENTUM], its[MOMENTUM + 1], its[MOMENTUM + 2])
        its[INVERSE], its[INVERSE + 3], its[INVERSE + 4] = _spin(turn, rates, 1.0, 0.0, 0.0)
        _, its[INVERSE + 1], its[INVERSE + 5] = _spin(turn, rates, 0.0, 1.0, 0.0)
        its[INVERSE + 2] = _spin(turn, rates, 0.0, 0.0, 1.0)[2]
        for k in range(bodies.start[b], bodies.start[b + 1]):
            for a in range(3):
                bodies.arms[k, a] = x[bodies.rows[k], a] - its[CENTRE + a]
    return 0


def _write(bodies, v, part, parts, team):
    """Write the velocities of all beads of bodies."""
    for b in range(len(bodies.numbers)):
        its = bodies.state[b]
        for k in range(bodies.start[b], bodies.start[b + 1]):
            i, r = bodies.rows[k], bodies.arms[k]
            ox, oy, oz = cross(its[SPIN], its[SPIN + 1], its[SPIN + 2], r[0], r[1], r[2])
            v[i, 0], v[i, 1], v[i, 2] = its[SPEED] + ox, its[SPEED + 1] + oy, its[SPEED + 2] + oz
    return 0


keep_beads, carry_bodies, look_at_bodies, write_beads = Kernel(_keep), Kernel(_carry), Kernel(_look), Kernel(_write)
