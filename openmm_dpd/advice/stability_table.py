"""The measured table of usable steps, and its interpolation in dimensionless groups.

Units of the table: cutoff rc, mass m of the lightest bead, thermal energy kT; so a step is in units of rc (m/kT)^(1/2).  For every scheme,
the table has the steps at which the configurational and the kinetic temperature are 1, 5 and 10 % off, and the step that blows up, on a
plane of friction and repulsion and on lines of density, mass ratio, exponent and heat capacity (made by benchmarks/stability.py).  Another
table has errors of diffusion and viscosity of the standard fluid (made by benchmarks/transport.py), a third, in the form of the first, the
steps at which the total energy drifts by so much per bead and time (made by benchmarks/conservation.py).
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import ParameterError

#: Errors for which the table has steps.
LEVELS = (0.01, 0.05, 0.10)
#: Largest allowed fraction of the step that blows up.
SAFE = 0.7
_LINES = ("rho", "mass", "s", "cv")
#: Heat capacity (k_B) from which on beads are thermostats, and noise alone makes steps differ from theirs.
_THERMOSTAT = 1000.0
#: Largest lengthening of a step, in the logarithm, by corrections along lines: errors that pass through 0 make single steps too long.
_LONGER = math.log(1.1)


@dataclass(frozen=True)
class Groups:
    r"""Dimensionless groups of one species in its surroundings."""

    gamma: float  #: gamma rc/(m kT)^(1/2), friction, the mean over its neighbours
    a: float  #: A rc/kT, repulsion, the same
    rho: float = 3.0  #: N rc^3/V, density
    mass: float = 1.0  #: largest over smallest mass of the beads
    s: float = 1.0  #: exponent of the noise weight
    cv: float | None = None  #: heat capacity of a bead over k_B, or None
    unit_time: float = 1.0  #: rc (m/kT)^(1/2), ps
    own: float = 1.0  #: mass of the species over that of the lightest bead

    @property
    def friction(self) -> float:
        """Drag on a bead in its surroundings, as the gamma that gives it at density 3 and exponent 1; nearly 0 without friction."""
        return max(drag(self.gamma, self.rho, self.s), 1e-9)

    @property
    def moving(self) -> "Groups":
        """Groups in units of the species' own mass, for what its beads do themselves."""
        return replace(self, gamma=self.gamma / self.own**0.5, unit_time=self.unit_time * self.own**0.5, mass=1.0, own=1.0)


def drag(gamma: float, rho: float, s: float) -> float:
    r"""Drag on a bead in surroundings of reduced density rho, as the gamma that gives it at density 3 and exponent 1.  It is proportional
    to gamma rho times the integral of w^(2s), B(3, 2s + 1) = 2/((2s + 1)(2s + 2)(2s + 3)), which is 1/30 at s = 1."""
    s2 = 2 * s
    return gamma * rho / 3.0 * 60.0 / ((s2 + 1) * (s2 + 2) * (s2 + 3))


class StabilityTable:
    """Steps by scheme, error and dimensionless groups.

    Parameters
    ----------
    data : mapping
        ``base`` (groups of the base fluid), ``cost`` (time per step of each scheme), and ``points``: the groups, and in ``schemes`` for
        each scheme ``blow``, ``conf`` and ``kin`` ({"1": [step, standard error, ">" or "<" or ""], "5": ..., "10": ...}) and ``sign``.
        Optional are ``levels``, other errors than 1, 5 and 10 %, ``order``, the power of the step below the first (2), and ``dips``: steps,
        times (a rho/3)^(1/2), from which on the configurational temperature of one species is over 1 % too low before it rises.

    Raises
    ------
    ParameterError
        If the plane has fewer than two values of friction or repulsion.
    """

    def __init__(self, data: Mapping[str, Any]):
        self.data, self.base, self.cost = data, data["base"], dict(data["cost"])
        self.plane = [p for p in data["points"] if all(p[name] == self.base[name] for name in _LINES)]
        self._frictions, self._repulsions = (np.array(sorted({float(p[name]) for p in self.plane})) for name in ("gamma", "a"))
        if len(self._frictions) < 2 or len(self._repulsions) < 2:
            raise ParameterError("a table of steps needs a plane of at least two frictions and two repulsions")
        self.schemes = tuple(s for s in self.cost if any(s in p["schemes"] for p in self.plane))
        self._logs: dict[tuple, np.ndarray] = {}
        self.levels, self.order, self.dips = tuple(data.get("levels", LEVELS)), data.get("order", 2), data.get("dips", {})

    def outside(self, at: Groups) -> list[str]:
        """Notes about groups that are outside of the table."""
        found = []
        lines = zip(("density", "mass ratio", "exponent", "heat capacity"), _LINES, strict=True)
        rows = [("friction", self._frictions, at.friction), (self.data.get("a is", "repulsion"), self._repulsions, at.a)]
        for name, known, value in [*rows, *((name, self._values(n), getattr(at, n)) for name, n in lines)]:
            if value is None or (name == "heat capacity" and len(known) and value > known.max()) or (name == "friction" and at.gamma == 0):
                continue  # above the largest heat capacity, beads are thermostats; without friction, as with the least
            if not len(known) or not known.min() * (1 - 1e-9) <= value <= known.max() * (1 + 1e-9):
                span = f"only from {known.min():g} to {known.max():g}" if len(known) else "nor at any other"
                found.append(f"no steps were measured at a {name} of {value:.3g} (reduced units), {span}")
        return found

    def _values(self, name: str) -> np.ndarray:
        return np.array(sorted({p[name] for p in self.data["points"] if p[name] is not None}))

    def step(self, scheme: str, at: Groups, error: float, kind: str) -> float:
        """Step (reduced) at which a temperature reaches an error; ``kind`` is "conf" or "kin".

        Interpolation is linear in log-log between 1 and 10 %; below, the error is proportional to the square of the step, for all schemes
        (a drift of energy to its fourth power).
        """
        steps = np.log(self._levels(scheme, at, kind))
        if error < self.levels[0]:
            return float(np.exp(steps[0]) * (error / self.levels[0]) ** (1 / self.order))
        return float(np.exp(np.interp(np.log(error), np.log(self.levels), steps)))

    def error(self, scheme: str, at: Groups, dt: float, kind: str) -> float:
        """Error of a temperature at a step (reduced), the inverse of :meth:`step`; infinite above 10 %."""
        steps = self._levels(scheme, at, kind)
        if dt < steps[0]:
            return float(self.levels[0] * (dt / steps[0]) ** self.order)
        return float("inf") if dt > steps[-1] * (1 + 1e-6) else float(np.exp(np.interp(np.log(dt), np.log(steps), np.log(self.levels))))

    def spread(self, scheme: str, at: Groups, error: float, kind: str) -> float:
        """Relative standard error of :meth:`step`: that of the nearest point in the plane, at the nearest error."""
        level = min(self.levels, key=lambda one: abs(np.log(one / error)))
        found = self._near(scheme, at)["schemes"][scheme][kind] or {}
        dt, sem, _ = found.get(f"{100 * level:g}") or (1.0, 0.0, "")
        return float(sem / dt)

    def blow(self, scheme: str, at: Groups) -> float:
        """Step (reduced) at which a run blows up."""
        return float(np.exp(self._interpolated(scheme, ("blow",), at)))

    def sign(self, scheme: str, at: Groups, kind: str) -> int:
        """+1 if the temperature is too high, -1 if it is too low, at the nearest point in the plane."""
        return int(self._near(scheme, at)["schemes"][scheme]["sign"][kind])

    def _near(self, scheme: str, at: Groups) -> Mapping[str, Any]:
        """Entry of a scheme at the nearest point in the plane that has it."""
        return min(
            (p for p in self.plane if scheme in p["schemes"]),
            key=lambda p: abs(np.log(p["gamma"] / at.friction)) + abs(p["a"] ** 0.5 - at.a**0.5),
        )

    def _levels(self, scheme: str, at: Groups, kind: str) -> np.ndarray:
        found = [np.exp(self._interpolated(scheme, (kind, f"{100 * level:g}"), at)) for level in self.levels]
        # strictly increasing, so that the interpolation has an inverse
        return np.maximum.accumulate(found) * (1.0 + 1e-9 * np.arange(len(found)))

    def _interpolated(self, scheme: str, path: tuple[str, ...], at: Groups) -> float:
        value = self._on_plane(scheme, path, at.friction, at.a)
        values = {"rho": at.rho, "mass": at.mass, "s": at.s, "cv": at.cv}
        found = sum(self._correction(scheme, path, name, v, at.friction) for name, v in values.items() if v != self.base[name])
        return value + (found if path[0] == "blow" else min(found, _LONGER))

    def _on_plane(self, scheme: str, path: tuple[str, ...], friction: float, a: float) -> float:
        """log(step), bilinear in log(friction) and the root of the repulsion (a frequency); constant beyond the edges."""
        x, y = np.log(self._frictions), np.sqrt(self._repulsions)
        column = [np.interp(np.sqrt(a), y, row) for row in self._grid(scheme, path)]
        return float(np.interp(np.log(friction), x, column))

    def _grid(self, scheme: str, path: tuple[str, ...]) -> np.ndarray:
        """log(step) over friction and repulsion, 2D; a missing point has the value of its neighbour in friction."""
        key = (scheme, *path)
        if key not in self._logs:
            known = {(p["gamma"], p["a"]): _log(p["schemes"][scheme], path) for p in self.plane if scheme in p["schemes"]}
            grid = np.array([[known.get((g, a), np.nan) for a in self._repulsions] for g in self._frictions])
            for column in grid.T:
                have = np.isfinite(column)
                if have.any():
                    column[~have] = np.interp(np.log(self._frictions[~have]), np.log(self._frictions[have]), column[have])
            for row in grid:
                have = np.isfinite(row)
                row[~have] = np.interp(self._repulsions[~have], self._repulsions[have], row[have])
            self._logs[key] = grid
        return self._logs[key]

    def _correction(self, scheme: str, path: tuple[str, ...], name: str, value: float | None, friction: float) -> float:
        """Deviation of log(step) on a line of the table from the plane, interpolated between lines in log(friction)."""
        if value is None or (name == "cv" and value >= _THERMOSTAT):
            return 0.0
        lines: dict[float, list[tuple[float, float]]] = {}
        for p in self.data["points"]:
            others = [n for n in _LINES if n != name]
            if scheme in p["schemes"] and p[name] != self.base[name] and all(p[n] == self.base[n] for n in others):
                at = Groups(p["gamma"], p["a"], p["rho"], p["mass"], p["s"], p["cv"])
                off = _log(p["schemes"][scheme], path) - self._on_plane(scheme, path, at.friction, at.a)
                lines.setdefault(p["gamma"], []).append((float(np.log(p[name])), off))
        found = []
        for gamma, pairs in sorted(lines.items()):
            if self.base[name] is not None:
                pairs = [*pairs, (float(np.log(self.base[name])), 0.0)]
            x, y = np.array(sorted(pairs)).T
            found.append((np.log(gamma), np.interp(np.log(value), x, y)))
        return float(np.interp(np.log(friction), *np.array(found).T)) if found else 0.0


def _log(entry: Mapping[str, Any], path: tuple[str, ...]) -> float:
    """log of a step in an entry; without a configurational temperature (no repulsion) that of the kinetic one, or of the blow-up."""
    found: Any = entry
    for word in path:
        found = found[word]
    if found is None:
        return _log(entry, ("kin", path[1]) if path[0] == "conf" else ("blow",))
    return float(np.log(found[0]))


@lru_cache(maxsize=3)
def shipped_table(name: str = "stability") -> StabilityTable:
    """A table that comes with the package: steps for soft beads (``stability``) and many-body liquids (``many_body``), and steps by the
    drift of the energy (``drift``)."""
    return StabilityTable(json.loads(files(__package__).joinpath(f"{name}.json").read_text()))


#: Quantities, with the index of their errors in a row of the table.
MEASURED = {"diffusion": 1, "viscosity": 2}

#: Names in the table of the limits of quantities at short steps.
_LIMITS = {"diffusion": "D", "viscosity": "eta"}

#: Number of draws of the measured errors, for the error of a step.
_DRAWS = 100


class MeasuredStep(NamedTuple):
    """A step size and its standard error."""

    dt: float
    error: float


def _slower(at: Groups) -> float:
    """Vibrations of the fluid of the transport table, A = 25 and density 3, over those of this one; at most 1."""
    return min(1.0, (75.0 / max(at.a * at.rho, 1e-9)) ** 0.5)


class TransportTable:
    """Table of errors of diffusion and viscosity over friction, scheme and step.

    Parameters
    ----------
    data : mapping
        ``points``: for each friction ``gamma``, the limits at short steps ``D`` and ``eta``, [value, standard error], and ``schemes``:
        {scheme: [[dt, [error of D, standard error], [of viscosity, ...]], ...]}, whose standard errors include that of the limit.
    """

    def __init__(self, data: Mapping[str, Any]):
        self.points = {float(point["gamma"]): point["schemes"] for point in data["points"]}
        self._common = {float(point["gamma"]): {q: point[n][1] / point[n][0] for q, n in _LIMITS.items()} for point in data["points"]}
        self.frictions = np.array(sorted(self.points))
        self.schemes = tuple(sorted(set.intersection(*(set(schemes) for schemes in self.points.values()))))

    def covers(self, at: Groups) -> bool:
        """Whether the friction of a fluid is within the table."""
        return bool(self.frictions[0] * (1 - 1e-9) <= at.friction <= self.frictions[-1] * (1 + 1e-9))

    def step(self, scheme: str, at: Groups, error: float, quantity: str) -> MeasuredStep:
        """Longest step, rc (m/kT)^(1/2), up to which an error stays within a bound; linear in log-log between frictions.

        In fluids stiffer than the measured ones it goes with their vibrations, (a rho)^(-1/2); in softer ones it is that of the measured.
        """
        found = [self.crossing(gamma, scheme, error, quantity) for gamma in self.frictions]
        x, where = np.log(self.frictions), np.log(at.friction)
        dt = float(np.exp(np.interp(where, x, np.log([step.dt for step in found]))))
        relative = float(np.interp(where, x, [step.error / step.dt for step in found]))
        return MeasuredStep(dt * _slower(at), relative * dt * _slower(at))

    def error(self, scheme: str, at: Groups, dt: float, quantity: str) -> tuple[float, bool]:
        """Signed error at a step, or at the longest measured one, and whether the step lies beyond that; linear in log(friction)."""
        curves = [self._curves(gamma, scheme, quantity) for gamma in self.frictions]
        x, where, dt = np.log(self.frictions), np.log(at.friction), dt / _slower(at)
        found = [np.interp(dt, np.append(0.0, steps), np.append(0.0, errors[0])) for steps, _, errors in curves]
        longest = float(np.interp(where, x, [steps[-1] for steps, _, _ in curves]))
        return float(np.interp(where, x, found)), dt > longest

    def crossing(self, gamma: float, scheme: str, error: float, quantity: str) -> MeasuredStep:
        """Step at which an error is reached, for one of the measured frictions."""
        steps, shortest, curves = self._curves(gamma, scheme, quantity)
        over = np.abs(curves) > error
        found = np.where(over.any(axis=1), steps[over.argmax(axis=1)], steps[-1])
        # below the shortest step only the order is known
        first = np.abs(curves[:, 0])
        found = np.where(over[:, 0], shortest * (error / np.where(over[:, 0], first, 1.0)) ** 0.5, found)
        return MeasuredStep(float(found[0]), float(found[1:].std()))

    def _curves(self, gamma: float, scheme: str, quantity: str) -> tuple[np.ndarray, float, np.ndarray]:
        """Steps (n,), the shortest measured one, and errors (1 + draws, n): c2 dt^2 + c4 dt^4 fitted to measured errors and their draws.

        A tenth of each error is added to its standard error, as the curve is not exact.  All share the error of the short-step limit.
        """
        dt, off, sem = np.array(sorted((row[0], *row[MEASURED[quantity]]) for row in self.points[gamma][scheme])).T
        steps = np.linspace(dt[0], dt[-1], 200)
        terms, at_steps = ((x[:, None] / dt[-1]) ** np.array([2, 4]) for x in (dt, steps))
        weight = 1 / np.hypot(sem, 0.1 * off)
        rng, common = np.random.default_rng(0), self._common[gamma][quantity]
        own = np.sqrt(np.maximum(sem**2 - common**2, 0.0))
        draws = np.vstack([off, rng.normal(off, own, (_DRAWS, len(dt))) + rng.normal(0.0, common, (_DRAWS, 1))])
        coefficients = np.linalg.lstsq(terms * weight[:, None], (draws * weight).T, rcond=None)[0]
        return steps, float(dt[0]), (at_steps @ coefficients).T


@lru_cache(maxsize=1)
def shipped_transport() -> TransportTable:
    """The table of errors of diffusion and viscosity that comes with the package."""
    return TransportTable(json.loads(files(__package__).joinpath("transport.json").read_text()))
