"""Down the potential energy of a Context, on any platform: L-BFGS with steps of bounded length, each of which lowers the energy.

The bound is for starts where beads overlap, whose forces ask for steps that are too long.  A place without a finite energy, such as one
where a FENE bond is longer than its R0, is never taken.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import openmm
from openmm import unit

from ..base.errors import RunError
from ..base.openmm_private import masses_of, virtual_sites
from ..base.signals import CTRL_C

#: Steps, with the changes of the slope, that the curvature is taken from, and lengths of a step that are tried.
MEMORY, TRIES = 8, 30
#: Part of the energy that may be rounding: CPU and GPU platforms compute in single precision.
NOISE = 1e-7
#: Relative error that springs in the place of constraints may leave, their strength at first (kJ/mol/nm^2), and how often they are tried,
#: ten times as strong each time.
SLACK, STRENGTH, TURNS = 1e-4, 1e6, 4


def descend(
    context: openmm.Context,
    tolerance: float,
    iterations: int,
    reporter: Any = None,
    *,
    longest: float = np.inf,
    impossible: Callable[[np.ndarray], str | None] = lambda x: None,
    held: Sequence[int] | np.ndarray = (),
) -> None:
    """Move the particles of a Context down its potential energy; velocities stay as they are.

    Constraints are springs on the way and hold at the end; particles of mass 0 stay, but for virtual sites, and so do those that are
    ``held``, by their indices. It ends at a root mean
    square of the forces on particles that move (``tolerance``, kJ/mol/nm), after so many ``iterations`` (0 for any number), or where
    ``reporter.report``, which is called after every iteration as by OpenMM's minimiser, returns True. No particle moves farther than
    ``longest`` (nm) in one iteration. ``impossible`` says why there is no energy at positions (N, 3), or None.

    RunError if the energy at the start is not finite; nothing has moved then.

    References
    ----------
    D. C. Liu and J. Nocedal, Math. Program. 45, 503 (1989).
    """
    slope = _Slope(context, impossible)
    slope.mobile[np.asarray(held, dtype=np.int64)] = False
    x, before = slope.start, np.inf
    try:
        for _ in range(TURNS):
            x = _lowest(slope, x, tolerance, iterations, reporter, longest)
            error = slope.springs(x)[1]
            if error <= SLACK or error >= before:
                break
            before, slope.strength = error, 10 * slope.strength
            x = slope.start if error > 100 * SLACK else x  # too far to come back
        slope.place(x)
        if len(slope.tied):
            context.applyConstraints(context.getIntegrator().getConstraintTolerance())
    except BaseException:
        slope.place(slope.start)
        raise


def follow(
    forces: Callable[[np.ndarray], np.ndarray], x: np.ndarray, longest: float, done: Callable[[np.ndarray, np.ndarray], bool]
) -> np.ndarray:
    """Move particles from positions x (N, 3) along their forces (N, 3), which need not derive from an energy, until ``done(x, force)``.

    No component of a move is longer than ``longest`` (nm); a place where forces are not finite is not taken.  Returns the last positions.

    References
    ----------
    E. Bitzek, P. Koskinen, F. Gaehler, M. Moseler and P. Gumbsch, Phys. Rev. Lett. 97, 170201 (2006).
    """
    force, v = forces(x), np.zeros_like(x)
    dt = first = np.sqrt(0.1 * longest / max(float(np.abs(force).max(initial=0.0)), 1e-300))
    turn, uphill = 0.1, 0
    while dt > 1e-9 * first:
        CTRL_C.check()
        if np.vdot(force, v) > 0:
            uphill += 1
            v = (1 - turn) * v + turn * np.linalg.norm(v) / np.linalg.norm(force) * force
            if uphill > 5:
                dt, turn = min(1.1 * dt, 100 * first), 0.99 * turn
        elif v.any():
            v, turn, uphill, dt = np.zeros_like(x), 0.1, 0, 0.5 * dt
        v = v + dt * force
        v *= min(1.0, longest / max(dt * float(np.abs(v).max()), 1e-300))
        there, after = x + dt * v, forces(x + dt * v)
        if not np.isfinite(after).all():
            v, dt = np.zeros_like(x), 0.5 * dt
            continue
        x, force = there, after
        if done(x, force):
            break
    return x


class _Slope:
    """Energy and gradient of a Context, with springs in the place of constraints."""

    def __init__(self, context: openmm.Context, impossible: Callable[[np.ndarray], str | None]):
        system, self.context, self.impossible = context.getSystem(), context, impossible
        self.mobile, self.sites = masses_of(system) > 0, bool(virtual_sites(system).any())
        self.groups = context.getIntegrator().getIntegrationForceGroups()
        rows = [system.getConstraintParameters(k) for k in range(system.getNumConstraints())]
        self.tied = np.array([row[:2] for row in rows], dtype=np.int64).reshape(-1, 2)
        self.distances = np.array([row[2].value_in_unit(unit.nanometer) for row in rows])
        self.strength = STRENGTH
        context.applyConstraints(SLACK)
        self.start = np.array(context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer))

    def place(self, x: np.ndarray) -> None:
        self.context.setPositions(x)
        if self.sites:
            self.context.computeVirtualSites()

    def springs(self, x: np.ndarray) -> tuple[float, float, np.ndarray]:
        """Energy of the springs, largest relative error of their lengths, and their gradient at the first end of each."""
        ends = x[self.tied[:, 0]] - x[self.tied[:, 1]]
        length = np.linalg.norm(ends, axis=1)
        longer = length - self.distances
        error = float(np.max(np.abs(longer) / self.distances, initial=0.0))
        return 0.5 * self.strength * float(longer @ longer), error, (self.strength * longer / length)[:, None] * ends

    def __call__(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Energy and gradient; infinite where there is none."""
        if self.impossible(x) is None:
            self.place(x)
            state = self.context.getState(energy=True, forces=True, groups=self.groups)
            energy, _, pull = self.springs(x)
            energy += state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
            gradient = -state.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
            np.add.at(gradient, self.tied[:, 0], pull)
            np.subtract.at(gradient, self.tied[:, 1], pull)
            gradient[~self.mobile] = 0.0
            if np.isfinite(energy) and np.all(np.isfinite(gradient)):
                return energy, gradient
        return np.inf, np.zeros_like(x)


def _lowest(slope: _Slope, x: np.ndarray, tolerance: float, iterations: int, reporter: Any, longest: float) -> np.ndarray:
    """Positions where the way down ends."""
    energy, gradient = slope(x)
    if not np.isfinite(energy):
        raise RunError(f"there is no way down from here: {slope.impossible(x) or 'the energy is not finite; are two beads at one place?'}")
    known: deque = deque(maxlen=MEMORY)
    done, idle, least = 0, 0, tolerance * np.sqrt(slope.mobile.sum())
    lowest = np.array([energy, np.linalg.norm(gradient)])
    while np.linalg.norm(gradient) > least and (done < iterations or iterations == 0) and idle < TRIES:
        CTRL_C.check()
        found = _step(slope, x, energy, gradient, _way(gradient, known), longest, first=not known)
        if found is None:
            if not known:
                break
            known.clear()
            continue
        step, energy, there = found
        change, x, gradient = there - gradient, x + step, there
        now = np.array([energy, np.linalg.norm(gradient)])
        idle = 0 if np.any(now < lowest) else idle + 1  # rounding is all that is left
        lowest = np.minimum(lowest, now)
        if np.vdot(step, change) > 1e-12 * np.vdot(change, change):
            known.append((step, change))
        if reporter is not None:
            springs, error, _ = slope.springs(x)
            values = {"system energy": energy - springs, "restraint energy": springs, "restraint strength": slope.strength}
            if reporter.report(done, x.ravel(), gradient.ravel(), {**values, "max constraint error": error}):
                break
        done += 1
    return x


def _way(gradient: np.ndarray, known: deque) -> np.ndarray:
    """The way to the minimum of the parabola through slope and known changes; straight down if they define none."""
    way, shares = -gradient, []
    for step, change in reversed(known):
        shares.append(np.vdot(step, way) / np.vdot(step, change))
        way = way - shares[-1] * change
    if known:
        step, change = known[-1]
        way = way * (np.vdot(step, change) / np.vdot(change, change))
    for (step, change), share in zip(known, reversed(shares), strict=True):
        way = way + (share - np.vdot(change, way) / np.vdot(step, change)) * step
    return way


def _step(slope: _Slope, x: np.ndarray, energy: float, gradient: np.ndarray, way: np.ndarray, longest: float, first: bool):
    """A step along a way that lowers the energy, with energy and gradient at its end; None if there is none."""
    down, farthest = np.vdot(way, gradient), np.linalg.norm(way, axis=1).max()
    # before any curvature is known the length of the way means nothing
    part = min(longest, 1.0) / farthest if first else min(1.0, longest / farthest)
    for _ in range(TRIES if down < 0 else 0):
        there, after = slope(x + part * way)
        # where rounding decides about energies, slopes do not lie yet
        flat = abs(there - energy) <= NOISE * abs(energy) and abs(np.vdot(way, after)) <= 0.9 * abs(down)
        if flat or there <= energy + 1e-4 * part * down:
            return part * way, there, after
        part *= np.clip(-0.5 * part * down / (there - energy - part * down), 0.1, 0.5)
    return None
