"""The layer of isothermal DPD terms: repulsion, friction and noise, radial and transverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from . import forces, motion, sweeps
from .forces import CUTOFF, EXPONENT, EXPONENT_PERP, GAMMA, GAMMA_PERP, SIGMA, SIGMA_PERP, A
from .layer import STRESS, Call, Forces
from .threads import run

if TYPE_CHECKING:
    from .engine import PairList, PairSpec


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
        """(T*T, 8) table at the thermal energy kT: sigma^2 = 2 kT gamma, whichever of the two is fixed."""
        fixed_sigma = np.isnan(self.gamma)
        table = np.zeros((self.A.size, 8))
        with np.errstate(divide="ignore", invalid="ignore"):
            gamma = np.where(fixed_sigma, np.where(self.sigma > 0, self.sigma**2 / (2 * kT), 0.0), self.gamma)
        sigma = np.where(fixed_sigma, self.sigma, np.sqrt(2 * kT * np.where(fixed_sigma, 0.0, self.gamma)))
        for column, values in (
            (A, self.A),
            (CUTOFF, self.cutoff),
            (GAMMA, gamma),
            (SIGMA, sigma),
            (GAMMA_PERP, self.gamma_perp),
            (SIGMA_PERP, np.sqrt(2 * kT * self.gamma_perp)),
            (EXPONENT, self.exponent),
            (EXPONENT_PERP, self.exponent_perp),
        ):
            table[:, column] = values.ravel()
        return table

    def layer(self, spec: PairSpec, pairs: PairList, number: int) -> DPDLayer:
        """The layer that evaluates these coefficients."""
        return DPDLayer(self, spec, pairs, number)


class DPDLayer:
    """Evaluates a :class:`TermTable` (see :mod:`.forces` and :mod:`.sweeps` for the formulas)."""

    def __init__(self, table: TermTable, spec: PairSpec, pairs: PairList, number: int):
        self.table, self.update, self.pairs, self.number = table, spec.update, pairs, number
        # of the last two temperatures: a step asks for conservative forces, at 0, and for friction
        self._coefficients: dict[float, np.ndarray] = {}
        # scratch, in the order of the pair list
        self._v, self._force = np.zeros((len(pairs.order), 3)), np.zeros((len(pairs.order), 3))

    def _at(self, kT: float) -> np.ndarray:
        if kT not in self._coefficients:
            if len(self._coefficients) > 1:
                self._coefficients.clear()
            self._coefficients[kT] = self.table.coefficients(kT)
        return self._coefficients[kT]

    def forces(self, call: Call) -> Forces:
        """Force form at the listed positions."""
        pairs = self.pairs
        force, v = self._force, self._v
        force[...] = 0.0
        stress = np.zeros((len(pairs.energy) if call.which & STRESS else 0, 6))
        if call.velocities is not None:
            motion.gather(call.velocities, pairs.order, v)
        run(
            forces.pair_forces,
            forces.pair_forces_parallel,
            call.which,
            call.key(self.number),
            call.rsqrt_dt,
            pairs.order,
            pairs.types,
            pairs.ntypes,
            self._at(call.kT),
            *pairs.geometry_arguments,
            v,
            force,
            pairs.energy,
            pairs.virial,
            stress,
        )
        return Forces(pairs.energy.sum(), pairs.virial.sum(), force, stress=stress.sum(axis=0) if len(stress) else None)

    def sweep(self, call: Call, v: np.ndarray, flow: np.ndarray | None) -> None:
        """Update the velocities (N, 3) pair by pair, in place."""
        sweep_velocities(self.pairs, call.update, call, self.number, self._at(call.kT), v, self._v)

    def friction_moment(self, kT: float) -> float:
        """Sum over pairs of f gamma w^(2s) r^2 (radial friction)."""
        pairs = self.pairs
        pi, pj, geometry, factors, columns, _, _, start, found = pairs.geometry_arguments
        return forces.friction_moment(pairs.types, pairs.ntypes, self._at(kT), pi, pj, geometry, factors, columns, start, found)

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy."""
        pairs = self.pairs
        pi, pj, geometry, factors, columns, _, _, start, found = pairs.geometry_arguments
        return forces.laplacian(pairs.types, pairs.ntypes, self._at(0.0), pairs.inv_mass, pi, pj, geometry, factors, columns, start, found)


def sweep_velocities(
    pairs: PairList, update: int, call: Call, number: int, coefficients: np.ndarray, v: np.ndarray, scratch: np.ndarray
) -> None:
    """Update velocities (N, 3) pair by pair, in place; the scratch (M, 3) holds them in the order of the list."""
    motion.gather(v, pairs.order, scratch)
    run(
        sweeps.sweep,
        sweeps.sweep_parallel,
        update,
        call.kT,
        call.dt,
        call.key(number),
        pairs.order,
        pairs.types,
        pairs.ntypes,
        coefficients,
        pairs.inv_mass,
        *pairs.geometry_arguments,
        scratch,
    )
    motion.scatter(scratch, pairs.order, v)
