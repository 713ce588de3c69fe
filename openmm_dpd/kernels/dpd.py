"""The layer of isothermal DPD terms: repulsion, friction and noise, radial and transverse."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import forces, sweeps
from .forces import GAMMA, GAMMA_PERP, SIGMA, SIGMA_PERP
from .layer import CONSERVATIVE, DISSIPATIVE, RANDOM, Call, Layer, PairSpec, SortedMotion, Sums, table_of
from .pairs import PairList

_TERMS = CONSERVATIVE | DISSIPATIVE | RANDOM
#: Each doubling that makes up for a halving rounds once.
_MOST_HALVINGS = 8


def _with_bodies(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The coefficients of T types, of 2T types: those of free beads, then those of beads in bodies; and the same without the friction of
    the latter."""
    types = math.isqrt(len(coefficients))
    whole = np.tile(coefficients.reshape(types, types, -1), (2, 2, 1))
    free = whole.copy()
    for column in (GAMMA, SIGMA):
        free[types:, :, column] = free[:, types:, column] = 0.0
    return whole.reshape(4 * types * types, -1), free.reshape(4 * types * types, -1)


@dataclass(frozen=True, eq=False)
class TermTable:
    """Coefficients of one layer of DPD terms, as (T, T) symmetric arrays (MD units).

    ``gamma`` holds NaN where sigma is the fixed quantity, ``sigma`` holds NaN where gamma is; cutoff 0 means no interaction.
    """

    A: np.ndarray
    gamma: np.ndarray
    sigma: np.ndarray
    gamma_perp: np.ndarray
    exponent: np.ndarray
    exponent_perp: np.ndarray
    cutoff: np.ndarray

    def coefficients(self, kT: float) -> np.ndarray:
        """(T*T, 8) table, columns as in :mod:`.forces`, at the thermal energy kT: sigma^2 = 2 kT gamma, whichever of the two is fixed."""
        fixed_sigma = np.isnan(self.gamma)
        with np.errstate(divide="ignore", invalid="ignore"):
            gamma = np.where(fixed_sigma, np.where(self.sigma > 0, self.sigma**2 / (2 * kT), 0.0), self.gamma)
        sigma = np.where(fixed_sigma, self.sigma, np.sqrt(2 * kT * np.where(fixed_sigma, 0.0, self.gamma)))
        perpendicular = self.gamma_perp, np.sqrt(2 * kT * self.gamma_perp)
        return table_of(self.A, self.cutoff, gamma, sigma, *perpendicular, self.exponent, self.exponent_perp)

    def layer(self, spec: PairSpec, number: int) -> Layer:
        """The layer that evaluates these coefficients."""
        return DPDLayer(self, spec, number)


class SweptLayer:
    """What layers whose friction and noise are those of DPD have in common.  ``table`` has ``coefficients(kT)``, whose first columns are
    those of :mod:`.forces`, and ``gamma``, NaN where sigma is fixed; ``plain`` is as in :class:`.forces.Terms`; ``transverse`` says
    whether there are transverse terms."""

    #: Whether A w is all of the repulsion.
    repels_by_pairs = False
    #: In a shear: (6,) what the last sweep passed on by friction, see :meth:`.interface.Engine.passed`
    passed: np.ndarray | None = None
    #: Whether its forces can be written with the conservative ones apart.
    parts_forces = False
    #: What sweeps over pairs with beads of rigid bodies, if there are any.
    bodies: Any = None

    def __init__(self, table: Any, number: int, pairs: PairList, plain: bool, transverse: bool):
        self.table, self.number, self.pairs = table, number, pairs
        self._plain, self._transverse, self._motion = plain, transverse, SortedMotion(pairs)
        # of the last two temperatures: a step asks for conservative forces, at 0, and for friction
        self._coefficients: dict[float, tuple[np.ndarray, np.ndarray]] = {}
        # scratch, in the order of the list; made when it is wanted
        self._apart = np.zeros((0, 3))
        self._inv_mass = (pairs.common_inv_mass or None) if plain else None

    def renew(self) -> None:
        """See :meth:`.interface.Engine.renew`."""
        self._coefficients.clear()

    def _at(self, kT: float, free: bool = False) -> np.ndarray:
        """Coefficients; with ``free`` those of the sweep over pairs of free beads, in which beads of bodies have no friction."""
        if kT not in self._coefficients:
            if len(self._coefficients) > 1:
                self._coefficients.clear()
            found = self.table.coefficients(kT)
            self._coefficients[kT] = (found, found) if self.bodies is None else _with_bodies(found)
        return self._coefficients[kT][free]

    def coefficients_at(self, heats: np.ndarray) -> np.ndarray | None:
        """(S, T*T, ...) coefficients at S thermal energies, if sigma alone depends on them."""
        if np.isnan(self.table.gamma).any() or self.bodies is not None:
            return None
        tables = np.repeat(self.table.coefficients(1.0)[None], len(heats), axis=0)
        for sigma, gamma in ((SIGMA, GAMMA), (SIGMA_PERP, GAMMA_PERP)):
            tables[:, :, sigma] = np.sqrt((2 * heats)[:, None] * tables[:, :, gamma])
        return tables

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """Update the velocities (N, 3) pair by pair, in place."""
        coefficients, inv_mass, halvings = self._at(call.kT, True), self._inv_mass, 0
        if inv_mass is not None:
            halvings = sweeps.halvings(call.update, coefficients[0, GAMMA] * 2.0 * inv_mass * call.dt)
        plain = inv_mass is not None and halvings <= _MOST_HALVINGS
        noise = call.kT, call.dt, call.key(self.number)
        terms = sweeps.Sweep(call.update, plain, halvings, *noise, coefficients, v, self._motion.v)
        self.passed = sweeps.sweep(self.pairs, terms, self._transverse).stress
        if self.bodies is not None:
            self.bodies.sweep(self.pairs, call.update, *noise, self._at(call.kT), v)

    def tensors(self, v: np.ndarray, kT: float) -> tuple[np.ndarray, np.ndarray, float]:
        """See :meth:`.interface.Engine.tensors`."""
        call = Call(DISSIPATIVE, v, kT, 1.0, 0, 0)
        return forces.pair_tensors(self.pairs, forces.Repulsion(self._at(kT), self._motion.arrays(call, v, False)))


class DPDLayer(SweptLayer):
    """Evaluates a :class:`TermTable` (see :mod:`.forces` and :mod:`.sweeps` for the formulas)."""

    repels_by_pairs = repeats = True

    def __init__(self, table: TermTable, spec: PairSpec, number: int):
        types, cutoff, bodies = spec.types, table.cutoff, spec.bodies
        if bodies is not None:  # beads of bodies have types of their own
            types, cutoff = types.copy(), np.tile(cutoff, (2, 2))
            types[bodies.beads] += np.where(types[bodies.beads] < 0, 0, len(table.cutoff)).astype(types.dtype)
        pairs = PairList(types, spec.inv_mass, cutoff, spec.exceptions, passes=bodies is None)
        transverse = bool(np.any(table.gamma_perp != 0.0))
        plain = bool(pairs.alike and table.exponent.flat[0] == 1.0 and not transverse)
        super().__init__(table, number, pairs, plain, transverse)
        self.parts_forces = not self._transverse

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions, written or added to ``out``."""
        noise = call.key(self.number), call.rsqrt_dt
        if call.held is not None and not len(self._apart):
            self._apart = np.zeros((len(self.pairs.order), 3))
        apart = () if call.held is None else (self._apart, call.held)
        terms = forces.Terms(call.which & _TERMS, self._plain, *noise, self._at(call.kT), self._motion.arrays(call, out, add), *apart)
        return forces.pair_forces(self.pairs, terms, self._transverse, call.which)

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy."""
        return forces.soft_laplacian(self.pairs, self._at(0.0))
