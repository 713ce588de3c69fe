"""The layer of eDPD: DPD whose beads have temperatures and exchange heat (formulas: :class:`openmm_dpd.model.edpd.EDPD`).

Per pair, with T_m = (T_i + T_j)/2, w = 1 - r/cutoff, w_T = 1 - r/cutoff_T, s and k the polynomials at T_m, f the factor of bonded
neighbours, 1/Theta = (1/T_i + 1/T_j)/2, sigma^2 = 2 gamma Theta, K = C_i C_j k T_m^2, im = 1/m_i + 1/m_j (k_B = 1)::

    F       = f A T_m w - f gamma w^s (e.v) + sqrt(f) sigma w^(s/2) xi/sqrt(dt)                                          r < cutoff
    q_visc  = {f w^s [gamma (e.v)^2 - sigma^2 im/2] - sqrt(f) sigma w^(s/2) (e.v) xi/sqrt(dt)}/2  to each of the two     r < cutoff
    q_cond  = K w_T^p (1/T_i - 1/T_j) + sqrt(2 K) w_T^(p/2) xi_T/sqrt(dt)                         to i, minus it to j    r < cutoff_T

xi_T is a number of its own, clamped to [-5, 5], and belongs to the bead with the lower index.  Viscous heat has the factors of the forces,
because it is what they do; conduction has none.  With ``lammps`` heat and factors are those of LAMMPS's code: xi_T is xi, clamped;
q_visc = {w^s [gamma (e.v)^2 - sigma^2/m_i] - sigma w^(s/2) (e.v) xi}/(C_i + C_j) with i the bead of lower index, without a factor; the
noise of the force has f, not sqrt(f); and no heat of either kind flows at r >= min(cutoff, cutoff_T).

Sweep form, pair by pair: motion and temperatures, then conduction.  Each keeps the weight T_i^C_i T_j^C_j of the pair invariant for any dt.
With a = 1/C (0 for a bead that does not move: its temperature stays):

- motion*: the exact Ornstein-Uhlenbeck step (or Shardlow's) of e.v, half of what K = (e.v)^2/(2 im) loses to each bead, and a Metropolis
  test.  Theta and T_m are those of T_i + a_i (K/2 - Theta/4) and the same of j, which depend on what the update keeps, T_i + a_i K/2 and
  T_j + a_j K/2, alone.
- *conduction*: with T = (a_j T_i + a_i T_j)/(a_i + a_j), which the exchange keeps, as T_m, n = (T_i - T_j)/(a_i + a_j) the energy that bead
  i has too much, and b = (a_i - a_j)/T, the exact step of z = 3 [(1 + b n)^(1/3) - 1]/b at the rate k w_T^p (C_i + C_j), with the variance
  T^2/(a_i + a_j), and a Metropolis test.  What it takes away is that of :mod:`.exchange`, with e = C_i C_j k w_T^p dt and b = a.
  In z the weight is Gaussian up to the fourth order, which favours the way to equilibrium: with
  z = n most moves of beads of large and different C would be rejected far from there.  Where C are the same b = 0 and z = n.

docs/theory_energy.md derives it.  Noise is not clamped here: the weight needs all of it.
"""

from dataclasses import dataclass

import numpy as np

from ..base.errors import RunError, bead_names, bead_number, in_number
from . import edpd_pairs, exchange
from .edpd_pairs import KAPPA, KAPPA_POLYNOMIAL
from .fields import NO_INCREMENTS, count_failed, sort_temperatures
from .layer import DISSIPATIVE, RANDOM, Call, Layer, PairSpec, SortedMotion, Sums, table_of
from .pairs import PairList


@dataclass(frozen=True, eq=False)
class ThermalTable:
    """Coefficients of one layer, as (T, T) symmetric arrays, polynomials (T, T, 4) (MD units); ``cutoff`` is the larger of both ranges.
    ``lammps`` says whether heat is computed as LAMMPS's code does."""

    A: np.ndarray
    gamma: np.ndarray
    kappa: np.ndarray
    exponent: np.ndarray
    exponent_T: np.ndarray
    cutoff_F: np.ndarray
    cutoff_T: np.ndarray
    cutoff: np.ndarray
    exponent_polynomial: np.ndarray
    kappa_polynomial: np.ndarray
    lammps: bool = False
    unit_time: float = np.inf  #: (m/kT)^(1/2) times the longest range of conduction

    def coefficients(self) -> np.ndarray:
        """(T*T, 15) table."""
        single = self.A, self.cutoff_F, self.gamma, self.exponent, self.kappa, self.exponent_T, self.cutoff_T
        return table_of(*single, self.exponent_polynomial, self.kappa_polynomial)

    def layer(self, spec: PairSpec, number: int) -> Layer:
        """The layer that evaluates these coefficients."""
        return ThermalLayer(self, spec, number)


class ThermalLayer:
    """Evaluates a :class:`ThermalTable`.  The first column of the fields is the temperature."""

    repeats = True

    def __init__(self, table: ThermalTable, spec: PairSpec, number: int):
        assert spec.fields is not None and spec.fields.capacity is not None
        self.pairs = PairList(spec.types, spec.inv_mass, table.cutoff, spec.exceptions)
        self.number, self.lammps, self.capacity = number, table.lammps, spec.fields.capacity
        self.coefficients, self._motion = table.coefficients(), SortedMotion(self.pairs)
        # scratch, in the order of the pair list, and for each column
        self._before, self._temperature, self._capacity, self._other = np.zeros((4, len(self.pairs.order)))
        rate = float(table.kappa.max() * self.capacity.max()) * table.unit_time
        self._around = exchange.around(self.pairs, spec, rate, table.kappa, table.cutoff_T, table.exponent_T, self._capacity)
        self._failed, self.pairs.grouped = np.zeros((0, 3)), spec.sweeps

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions, written or added to ``out``; rates (N, 1) are dT/dt."""
        # the heat of the noise depends on velocities too
        assert call.rates is not None and (call.velocities is not None or not call.which & (DISSIPATIVE | RANDOM))
        self._begin(call, NO_INCREMENTS)
        noise = call.key(self.number), call.rsqrt_dt
        of_beads = self._capacity, self._temperature, self._other[:, None], self._failed, call.rates
        given = edpd_pairs.Heat(call.which, self.lammps, *noise, self.coefficients, *of_beads, self._motion.arrays(call, out, add))
        if not call.which & (DISSIPATIVE | RANDOM):
            return Sums(*edpd_pairs.thermal_repulsion(self.pairs, given))
        found = Sums(*edpd_pairs.thermal_forces(self.pairs, given))
        self._check_conduction()
        return found

    def _begin(self, call: Call, increments: np.ndarray) -> None:
        """Sort temperatures and heat capacities; RunError if a temperature is not > 0.  No pair has failed yet."""
        assert call.field_values is not None
        if len(self._failed) != len(self.pairs.arrays.found):
            self._failed = np.zeros((len(self.pairs.arrays.found), 3))
        order, found = self.pairs.order, (self._before, self._temperature, self._capacity, self._failed)
        if sort_temperatures(order, self.pairs.seats, call.field_values, increments, self.capacity, *found):
            bad = np.flatnonzero(~(self._before > 0.0))
            first = bad[order[bad].argmin()]
            raise RunError(
                f"the temperature of bead {bead_number(order[first])} is {in_number(self._before[first], 'thermal_energy')}; it must be > "
                "0 (the step size may be too large, the heat capacity too small for its noise, or a source take what is not there)"
            )

    def _check_conduction(self) -> None:
        if not count_failed(self.pairs.order, self._failed):
            return
        pairs, (first, second, mean) = self.pairs.arrays, self._failed[np.flatnonzero(self._failed[:, 0])[0]]
        i, j = int(first) - 1, int(second)
        row = self.coefficients[pairs.types[i] * pairs.ntypes + pairs.types[j]]
        kappa = row[KAPPA] * float(np.polynomial.polynomial.polyval(mean - 1.0, [1.0, *row[KAPPA_POLYNOMIAL : KAPPA_POLYNOMIAL + 4]]))
        between = bead_names(pairs.order[i], pairs.order[j])
        raise RunError(
            f"the heat conduction coefficient is {kappa:g} at the temperature {in_number(mean, 'thermal_energy')} of {between}; "
            "kappa_polynomial must keep it >= 0 at every temperature of the run"
        )

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """Update velocities pair by pair in place, and add to ``increments`` what the temperatures change by."""
        assert increments is not None
        self._begin(call, increments)
        if self.pairs.spread:
            exchange.sum_around(self.pairs, self._around)
        of_beads = self._capacity, self._other, self._before, self._temperature, self._failed, increments, v, self._motion.v
        sweep = edpd_pairs.thermal_sweep if self.pairs.spread else edpd_pairs.slow_thermal_sweep
        noise = call.update, call.dt, call.key(self.number)
        sweep(self.pairs, edpd_pairs.ThermalExchange(*noise, self.coefficients, *of_beads, self._around.sums[0]))
        self._check_conduction()

    def laplacian(self) -> float:
        """NaN: not defined for forces that depend on temperatures."""
        return np.nan
