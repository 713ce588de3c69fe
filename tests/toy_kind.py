"""A kind of pair coefficients that the package does not know.

Exponential repulsion with ordinary friction: with E(r) = exp(-r/width) - exp(-cutoff/width) and w = 1 - r/cutoff::

    F = A E(r) - gamma w^2 (e.v) + sigma w xi/sqrt(dt)
"""

from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from scenes import BOXES, MASSES

import openmm_dpd as dpd
from openmm_dpd.kernels.dpd import DPDLayer, TermTable
from openmm_dpd.kernels.layer import CONSERVATIVE
from openmm_dpd.model.pairs import PairCoefficient
from openmm_dpd.plan.forces.expressions import PairExpression, parameters, type_pairs

BOX, N = BOXES["ortho"], 90


@dataclass(frozen=True)
class Exponential(PairCoefficient):
    A: float
    gamma: float = 0.0
    width: float = 0.4
    cutoff: float = 1.0

    @property
    def has_thermostat(self) -> bool:
        return self.gamma > 0


@dataclass(frozen=True, eq=False)
class ExponentialTable:
    friction: TermTable
    A: np.ndarray
    width: np.ndarray

    @property
    def cutoff(self) -> np.ndarray:
        return self.friction.cutoff

    def layer(self, spec, number):
        return ExponentialLayer(self, spec, number)


class ExponentialLayer:
    """Friction and noise are those of DPD, the repulsion is added in numpy."""

    def __init__(self, table, spec, number):
        self._table, self._spec = table, spec
        self._friction = DPDLayer(table.friction, spec, number)
        self.pairs = self._friction.pairs

    def _pairs(self):
        i, j, e, r, factor = self.pairs.listed()
        at = self._spec.types[i], self._spec.types[j]
        return i, j, e, r, factor * self._table.A[at], self._table.width[at], self._table.cutoff[at]

    def forces(self, call, out, add):
        sums = self._friction.forces(call, out, add)
        if not call.which & CONSERVATIVE:
            return sums
        i, j, e, r, A, width, cutoff = self._pairs()
        end = np.exp(-cutoff / width)
        force = A * (np.exp(-r / width) - end)
        np.add.at(out, i, force[:, None] * e)
        np.add.at(out, j, -force[:, None] * e)
        energy = np.sum(width * force + A * end * (r - cutoff))
        # the Laplacian that came with the friction is not that of this repulsion
        return replace(sums, energy=sums.energy + float(energy), virial=sums.virial + float(force @ r), laplacian=None)

    def sweep(self, call, v, increments):
        self._friction.sweep(call, v, increments)

    def laplacian(self):
        i, j, _, r, A, width, cutoff = self._pairs()
        mobile = (self._spec.inv_mass[i] > 0).astype(float) + (self._spec.inv_mass[j] > 0)
        curve = A * np.exp(-r / width) / width - 2.0 * A * (np.exp(-r / width) - np.exp(-cutoff / width)) / r
        return float(mobile @ curve)


def terms(table, beads):
    one, zero = np.ones((len(beads.names),) * 2), np.zeros((len(beads.names),) * 2)
    names = ("gamma", "cutoff", "A", "width")
    gamma, cutoff, A, width = (type_pairs(table, beads.names, attrgetter(name), 0.0) for name in names)
    return ExponentialTable(TermTable(zero, gamma, np.full_like(A, np.nan), zero, one, one, cutoff), A, np.where(width > 0, width, 1.0))


def potential(table, names):
    columns = {"A": ("A", 0.0), "d": ("width", 1.0), "rc": ("cutoff", 1.0)}
    text, functions = parameters({at: type_pairs(table, names, attrgetter(name), other) for at, (name, other) in columns.items()})
    energy, cutoff = f"step(rc-r)*A*(d*(exp(-r/d)-exp(-rc/d))+exp(-rc/d)*(r-rc)){text}", max(c.cutoff for c in table.values())
    return PairExpression(name="exponential", energy=energy, cutoff=cutoff, functions=functions, skips_coincident=True)


PAIRS = {
    ("A", "A"): Exponential(A=60.0, gamma=4.5),
    ("A", "B"): Exponential(A=80.0, gamma=2.0, width=0.3),
    ("B", "B"): Exponential(A=40.0, gamma=9.0, width=0.5, cutoff=1.2),
}


def scene(pairs=PAIRS, **options) -> dpd.Scene:
    rng = np.random.default_rng(3)
    types = rng.choice(["A", "B"], N).tolist()
    return dpd.Scene(MASSES, types, rng.random((N, 3)) @ BOX, pairs, kT=1.0, box=BOX, **options)
