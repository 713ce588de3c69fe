"""Steps at which diffusion or viscosity of the standard fluid are off by some error, from measured ones (benchmarks/transport.py)."""

import json
from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from .stability_table import Groups

#: Quantities, with the place of their errors in a row of the table.
MEASURED = {"diffusion": 1, "viscosity": 2}

#: Names of their limits of short steps in the table.
_LIMITS = {"diffusion": "D", "viscosity": "eta"}

#: Draws of the measured errors, for the error of a step.
_DRAWS = 100


class MeasuredStep(NamedTuple):
    """A step and its standard error."""

    dt: float
    error: float


class TransportTable:
    """Errors of diffusion and viscosity by friction, scheme and step.

    Parameters
    ----------
    data : mapping
        ``points``: of each friction ``gamma``, the limits of short steps ``D`` and ``eta``, [value, standard error], and ``schemes``:
        {scheme: [[dt, [error of D, standard error], [of viscosity, ...]], ...]}, whose errors have that of the limit in them.
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
        """Longest step, rc (m/kT)^(1/2), up to which an error stays within a bound, between frictions with straight lines in log-log."""
        found = [self.crossing(gamma, scheme, error, quantity) for gamma in self.frictions]
        x, where = np.log(self.frictions), np.log(at.friction)
        dt = float(np.exp(np.interp(where, x, np.log([step.dt for step in found]))))
        relative = float(np.interp(where, x, [step.error / step.dt for step in found]))
        return MeasuredStep(dt, relative * dt)

    def error(self, scheme: str, at: Groups, dt: float, quantity: str) -> float:
        """Signed error at a step, beyond the longest measured one with its square; between frictions linear in their log."""
        found = []
        for gamma in self.frictions:
            steps, _, curves = self._curves(gamma, scheme, quantity)
            found.append(np.interp(dt, np.append(0.0, steps), np.append(0.0, curves[0])) * max(1.0, dt / steps[-1]) ** 2)
        return float(np.interp(np.log(at.friction), np.log(self.frictions), found))

    def crossing(self, gamma: float, scheme: str, error: float, quantity: str) -> MeasuredStep:
        """The step of one friction that was measured."""
        steps, shortest, curves = self._curves(gamma, scheme, quantity)
        over = np.abs(curves) > error
        found = np.where(over.any(axis=1), steps[over.argmax(axis=1)], steps[-1])
        # below the shortest step nothing but the order is known
        first = np.abs(curves[:, 0])
        found = np.where(over[:, 0], shortest * (error / np.where(over[:, 0], first, 1.0)) ** 0.5, found)
        return MeasuredStep(float(found[0]), float(found[1:].std()))

    def _curves(self, gamma: float, scheme: str, quantity: str) -> tuple[np.ndarray, float, np.ndarray]:
        """Steps (n,), the first of them, and errors there (1 + draws, n): c2 dt^2 + c4 dt^4 through the measured ones, and draws of them.

        A tenth of an error is left to what the curve cannot follow.  The error of the limit of short steps is common to all of them.
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
    """The table that comes with the package."""
    return TransportTable(json.loads(files(__package__).joinpath("transport.json").read_text()))
