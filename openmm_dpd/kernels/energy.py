"""The layer of energy-conserving DPD: friction heats the beads, and beads exchange heat.

Force form (rates per pair; w = 1 - r/rc, 1/Theta = (1/theta_i + 1/theta_j)/2, gamma = sigma^2/(2 Theta), im = 1/m_i + 1/m_j)::

    F       = A w - gamma w^2 (e.v) + sigma w xi/sqrt(dt)
    du_mech = [gamma w^2 (e.v)^2 - sigma^2 w^2 im/2 - sigma w (e.v) xi/sqrt(dt)]/2           to each of the two
    du_cond = kappa w^2 (1/theta_i - 1/theta_j) + sqrt(2 kappa) w xi_q/sqrt(dt)               to i, minus it to j

Sweep form, pair by pair.  The pair's kinetic energy of relative motion K = (e.v)^2/(2 im) and its internal energies change together:
each bead gets half of what K loses, so that the energy is conserved to rounding for any dt.

- *frozen* (fix shardlow): Shardlow's update at the temperatures the beads had before the sweep, and an Euler step of conduction.
- *exact*: the update leaves the weight exp(S_i + S_j) of the pair invariant for any dt.  For the motion, e.v performs the exact
  Ornstein-Uhlenbeck step with a Theta that depends only on what the update conserves (u_i + K/2 and u_j + K/2); its Gaussian weight
  exp(-K/Theta) is not quite the true one, exp(S_i + S_j), and a Metropolis test with the ratio of both puts that right.  Heat likewise,
  with the Gaussian around the equilibrium share of u_i + u_j, of which an update takes away what :mod:`.exchange` has for e = kappa w^2 dt
  and b = -S'' there.  As dt -> 0 the noise amplitudes are sigma and sqrt(2 kappa), and for constant noise the drift follows from the
  invariant weight, so this is the same stochastic equation.  A rejected move is no error; a move to an energy out of range is always
  rejected.  docs/theory_energy.md derives it; the idea of the test is Stoltz's (J. Comput. Phys. 340, 451
  (2017)).

For bonded neighbours with a factor f the forces have f A, f sigma^2 (so that friction and noise stay in balance); conduction has no factor.
"""

from dataclasses import dataclass

import numpy as np

from ..base.errors import RunError, bead_number, in_units
from . import energy_pairs, exchange, forces
from .eos import CONSTANT, EOSTable
from .fields import NO_INCREMENTS, sort_energies
from .layer import DISSIPATIVE, EXACT, RANDOM, Call, Layer, PairSpec, SortedMotion, Sums, table_of
from .pairs import PairList


@dataclass(frozen=True, eq=False)
class EnergyTable:
    """Coefficients of one layer, as (T, T) symmetric arrays (MD units); cutoff 0 means no interaction."""

    A: np.ndarray
    sigma: np.ndarray
    kappa: np.ndarray
    cutoff: np.ndarray
    unit_time: float = np.inf  #: (m/kT)^(1/2) times the longest range

    def layer(self, spec: PairSpec, number: int) -> Layer:
        """The layer that evaluates these coefficients."""
        return EnergyLayer(self, spec, number)


class EnergyLayer:
    """Evaluates an :class:`EnergyTable`.  The first two columns of the fields are the conductive and the mechanical energy."""

    repeats = True

    def __init__(self, table: EnergyTable, spec: PairSpec, number: int):
        assert spec.fields is not None and isinstance(spec.fields.eos, EOSTable)
        self.fields, self.eos, self.number = spec.fields, spec.fields.eos, number
        self.pairs = PairList(spec.types, spec.inv_mass, table.cutoff, spec.exceptions, passes=not spec.sweeps)
        self.coefficients = table_of(table.A, table.cutoff, table.sigma, table.kappa)
        # scratch, in the order of the pair list
        self._constant = bool((self.eos.curve == CONSTANT).all())
        self._motion, m = SortedMotion(self.pairs), len(self.pairs.order)
        self._u, self._inverse, self._capacity = np.zeros((3, m))
        self._curve, self._changes = np.zeros(m, np.int32), np.zeros((m, 2))
        # -dS'/du at the start is C/u^2
        bent = self.eos.capacity / np.maximum(self.fields.initial.sum(axis=1), 1e-150) ** 2
        rate = float(table.kappa.max() * bent[~self.fields.immobile].max(initial=0.0)) * table.unit_time if self._constant else np.inf
        rate = 0.0 if spec.update != EXACT else rate
        self._around = exchange.around(self.pairs, spec, rate, table.kappa, table.cutoff, np.full_like(table.kappa, 2.0))
        self.pairs.grouped = spec.sweeps and spec.update == EXACT and self._constant

    def _find_temperatures(self, energies: np.ndarray, increments: np.ndarray, when: str) -> None:
        """Sort internal energies, and 1/theta; RunError if an energy has none."""
        order, seats, eos = self.pairs.order, self.pairs.seats, self.eos
        if sort_energies(order, seats, energies, increments, eos.capacity, eos.curve, *eos.curves, self._u, self._inverse):
            bad = np.flatnonzero(np.isnan(eos.of(order).thetas(self._u)))
            first = bad[order[bad].argmin()]
            raise RunError(
                f"the internal energy {in_units(self._u[first], 'energy')} of bead {bead_number(order[first])} {when} is outside its "
                "equation of state; the step size may be too large for this scheme (middle, aboba and bababo never leave the range)"
            )

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions, written or added to ``out``."""
        pairs, motion = self.pairs, self._motion.arrays(call, out, add)
        if not call.which & (DISSIPATIVE | RANDOM):
            return Sums(*forces.conservative_forces(pairs, forces.Repulsion(self.coefficients, motion)))
        assert call.field_values is not None and call.rates is not None and (call.velocities is not None or not call.which & DISSIPATIVE)
        self._find_temperatures(call.field_values, NO_INCREMENTS, "within the step")
        noise = call.key(self.number), call.rsqrt_dt
        of_beads = self._inverse, self._changes, call.rates
        return Sums(*energy_pairs.energy_forces(pairs, energy_pairs.Rates(call.which, *noise, self.coefficients, *of_beads, motion)))

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """Update velocities pair by pair in place, and add to ``increments`` the conductive and mechanical energy each bead got."""
        assert call.field_values is not None and increments is not None
        self._find_temperatures(call.field_values, increments, "before the sweep")
        of_beads = v, increments, self.eos.capacity, self.eos.curve, *self.eos.curves, self.fields.immobile
        in_order = self._motion.v, self._u, self._inverse, self._capacity, self._curve, self._changes
        exact = call.update == EXACT
        sweep = energy_pairs.EXACT_SWEEPS[self._constant, self.pairs.spread] if exact else energy_pairs.frozen_sweep
        if exact and self.pairs.spread:
            exchange.sum_around(self.pairs, self._around)
        noise = call.update, call.dt, call.key(self.number)
        sweep(self.pairs, energy_pairs.Exchange(*noise, self.coefficients, *of_beads, *in_order, self._around.sums[0]))
        if not exact:
            self._find_temperatures(call.field_values, increments, "after the sweep")

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy."""
        return forces.soft_laplacian(self.pairs, self.coefficients)
