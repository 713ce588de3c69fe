"""The box under a pressure, as ``fix npt`` moves it: Martyna, Tobias and Klein, J. Chem. Phys. 101, 4177 (1994)."""

import numpy as np

from ...base.errors import RunError
from ...kernels import chain
from ...kernels.moment import Moment
from ..state.records import Fix
from ..values.resolver import Resolver
from .acting import ramped, target

#: What it keeps: rates of the logarithms of the edges, virials along the axes, and then the chain of their thermostats.
RATES, VIRIALS, CHAIN = slice(0, 3), slice(3, 6), slice(6, None)


class Piston:
    """Moves the box of a run; ``masses`` (N,) are those of its beads."""

    def __init__(self, fix: Fix, masses: np.ndarray, dt: float, kT: float):
        self.fix, self._kT, self._masses, self._control = fix, kT, masses, fix.parameters["pressure"]
        self._axes, self._damps = np.array(self._control.axes), np.array(self._control.damps)
        self._n, self._damp = len(masses), float(self._damps[self._axes].min())
        self.settings = fix.parameters["piston"]
        self._slower = 1.0 - dt * self.settings["drag"] / self._damp / self.settings["loop"]
        self._degrees = 1.0 if self._control.coupled else float(self._axes.sum())
        #: Masses (3,) of the edges
        self._inertias = np.where(self._axes, (self._n + 1) * kT * self._damps**2, 1.0)

    def start(self, numbers: np.ndarray) -> None:
        """What the thermostats of the edges begin a run with."""
        chained = numbers[CHAIN].reshape(3, -1)
        chained[2, 1:] = chain.pushes(chain.masses(chained.shape[1], self._kT, self._damp, 1.0), chained[1], self._kT)

    def chain(self, numbers: np.ndarray, kT: float, dt: float) -> None:
        """Half a step of the thermostats of the edges."""
        twice, ratio = float(self._inertias @ numbers[RATES] ** 2), np.sqrt(self._kT / kT)  # masses are those of the first step
        settings = self._damp * ratio, self._degrees, twice, self.settings["loop"], self.settings["drag"] * ratio, 1.0
        numbers[RATES] *= chain.half_step(numbers[CHAIN], dt, kT, *settings)

    def targets(self, moment: Resolver) -> np.ndarray:
        """Pressures (3,) along the axes."""
        return np.array([ramped(*ends, moment) for ends in zip(self._control.start, self._control.stop, strict=True)])

    def push(self, numbers: np.ndarray, m: Moment, moment: Resolver) -> None:
        """Half a step of the rates, by the difference of pressures."""
        axes, edges, wanted, twice = self._axes, np.diag(m.box), self.targets(moment), self._masses @ m.v**2  # type: ignore[arg-type]
        volume, start, mean = float(np.prod(edges)), np.array(self.fix.parameters["edges"]), float(wanted[axes].mean())
        found, alike = (twice + numbers[VIRIALS]) / volume, 3 if self._control.coupled else 2 if self._control.plane else 1
        found[:alike] = found[:alike].mean()
        force = (found - mean) * volume - np.prod(start) * (wanted - mean) * (edges / start) ** 2
        force += self.settings["mtk"] * twice[axes].sum() / (axes.sum() * self._n)
        numbers[RATES] = np.where(axes, (numbers[RATES] + 0.5 * m.dt * force / self._inertias) * self._slower, 0.0)

    def slow(self, numbers: np.ndarray, m: Moment) -> None:
        """Half a step of the velocities under the rates."""
        rates = numbers[RATES]
        m.v *= np.exp(-0.5 * m.dt * (rates + self.settings["mtk"] * rates.sum() / (self._axes.sum() * self._n)))

    def scale(self, numbers: np.ndarray, m: Moment, length: float, reach: float) -> None:
        """Half a step of box and positions."""
        factors, about = np.exp(0.5 * m.dt * numbers[RATES]), np.array(self.settings["about"]) * length
        m.x[:] = about + (m.x - about) * factors
        m.box = m.box * factors  # type: ignore[operator]  # it is not tilted
        if np.diag(m.box).min() < 2.0 * reach:
            raise RunError(f"fix {self.fix.name} ({self.fix.style}): the box has become narrower than twice the cutoff")

    def energy(self, numbers: np.ndarray, moment: Resolver) -> float:
        """Energy of edges, their thermostats, and the work against the pressure."""
        kT, wanted, units = target(self.fix, moment), self.targets(moment), moment.units
        eta, rate, _ = numbers[CHAIN].reshape(3, -1)
        start, edges, mean = np.array(self.fix.parameters["edges"]), moment.box.edges * units.length, float(wanted[self._axes].mean())
        energies = kT * eta
        energies[0] *= self._degrees
        energies += 0.5 * chain.masses(len(eta), self._kT, self._damp, 1.0) * rate**2
        kinetic = 0.5 * float(self._inertias @ numbers[RATES] ** 2)
        strain = 0.5 * np.prod(start) * float(((wanted - mean) * (edges / start) ** 2).sum())  # of all axes, as in LAMMPS
        return float(energies.sum()) + kinetic + mean * float(np.prod(edges) - np.prod(start)) + strain
