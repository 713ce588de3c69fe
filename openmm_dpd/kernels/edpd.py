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
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.errors import RunError
from ..base.wording import bead_names, bead_number, in_number
from .columns import approach, deliver, factor_of, gather_and_clear, over_pairs, push_apart, row_of, soft
from .compiled import inlined
from .elementary import power
from .layer import CONSERVATIVE, DISSIPATIVE, RANDOM, Call, Layer, PairSpec, SortedMotion, Sums, table_of
from .noise import normal, pair_key
from .pairs import PairList

#: Columns of the coefficient table; the last two are where four coefficients of a polynomial begin.
A, CUTOFF, GAMMA, EXPONENT, KAPPA, EXPONENT_T, CUTOFF_T, EXPONENT_POLYNOMIAL = range(8)
KAPPA_POLYNOMIAL = EXPONENT_POLYNOMIAL + 4
#: Streams of the pair's random numbers.
MOTION, HEAT = range(2)
#: Smallest exponent of the drag, and largest noise of a flux.
SMALLEST_EXPONENT, LARGEST_NOISE = 0.01, 5.0


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

    def coefficients(self) -> np.ndarray:
        """(T*T, 15) table."""
        single = self.A, self.cutoff_F, self.gamma, self.exponent, self.kappa, self.exponent_T, self.cutoff_T
        return table_of(*single, self.exponent_polynomial, self.kappa_polynomial)

    def layer(self, spec: PairSpec, number: int) -> Layer:
        """The layer that evaluates these coefficients."""
        return ThermalLayer(self, spec, number)


class ThermalLayer:
    """Evaluates a :class:`ThermalTable`.  The first column of the fields is the temperature."""

    def __init__(self, table: ThermalTable, spec: PairSpec, number: int):
        assert spec.fields is not None and spec.fields.capacity is not None
        self.pairs = PairList(spec.types, spec.inv_mass, table.cutoff, spec.exceptions)
        self.number, self.lammps, self.capacity = number, table.lammps, spec.fields.capacity
        self.coefficients, self._motion = table.coefficients(), SortedMotion(len(self.pairs.order))

    def forces(self, call: Call, out: np.ndarray, add: bool) -> Sums:
        """Force form at the listed positions, written or added to ``out``; rates (M, 1) are dT/dt."""
        assert call.field_values is not None
        pairs, m = self.pairs, len(self.pairs.order)
        temperature = self._temperatures(call.field_values)
        # the heat of the noise depends on velocities too
        assert call.velocities is not None or not call.which & (DISSIPATIVE | RANDOM)
        capacity = np.take(self.capacity, pairs.order)
        heat, failed = np.zeros(m), np.full(len(pairs.arrays.found), -1)
        noise = call.key(self.number), call.rsqrt_dt
        of_beads = self.coefficients, capacity, temperature
        motion = self._motion.arrays(call, out, add)
        given = Heat(call.which, self.lammps, *noise, *of_beads, heat, failed, *motion)
        totals = thermal_forces(pairs, given)
        if failed.max(initial=-1) >= 0:
            self._raise_conduction(int(failed[failed >= 0][0]), temperature)
        return Sums(totals.energy, totals.virial, totals.drag, rates=(heat / capacity)[:, None])

    def _temperatures(self, field_values: np.ndarray) -> np.ndarray:
        """(M,) temperatures in the order of the list; RunError if one is not > 0."""
        order = self.pairs.order
        temperature = np.take(field_values[:, 0], order)
        bad = np.flatnonzero(~(temperature > 0.0))
        if len(bad):
            bead = order[bad].min()
            raise RunError(
                f"the temperature of bead {bead_number(bead)} is {in_number(field_values[bead, 0], 'thermal_energy')}; it must be > 0 (the "
                "step size may be too large, or the heat capacity too small for the noise of the heat)"
            )
        return temperature

    def _raise_conduction(self, n: int, temperature: np.ndarray) -> None:
        pairs = self.pairs.arrays
        i, j = pairs.pi[n], pairs.pj[n]
        mean = 0.5 * (temperature[i] + temperature[j])
        row = self.coefficients[pairs.types[i] * pairs.ntypes + pairs.types[j]]
        kappa = row[KAPPA] * float(np.polynomial.polynomial.polyval(mean - 1.0, [1.0, *row[KAPPA_POLYNOMIAL : KAPPA_POLYNOMIAL + 4]]))
        between = bead_names(pairs.order[i], pairs.order[j])
        raise RunError(
            f"the heat conduction coefficient is {kappa:g} at the temperature {in_number(mean, 'thermal_energy')} of {between}; "
            "kappa_polynomial must keep it >= 0 at every temperature of the run"
        )

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """There is no sweep form."""
        raise RunError("EDPD has no pair updates; only the scheme mvv can run it")

    def laplacian(self) -> float:
        """NaN: not defined for forces that depend on temperatures."""
        return np.nan


@inlined
def clamped(xi):
    """Noise of a flux, limited as in LAMMPS."""
    return min(LARGEST_NOISE, max(-LARGEST_NOISE, xi))


@inlined
def temperature_factor(coefficients, row, first, y):
    """1 + c1 y + c2 y^2 + c3 y^3 + c4 y^4."""
    c = coefficients
    return 1.0 + y * (c[row, first] + y * (c[row, first + 1] + y * (c[row, first + 2] + y * c[row, first + 3])))


@inlined
def _friction(which, lammps, coefficients, row, factor, r, ti, tj, ev, rsqrt_dt, xi, inverse_mass, capacities):
    """Friction with noise and friction alone of a pair within the cutoff, and its viscous heat for each of the two.  ``inverse_mass`` is
    1/m_i + 1/m_j, or 1/m of the bead with the lower index for lammps; ``capacities`` is C_i + C_j."""
    s = max(
        SMALLEST_EXPONENT, coefficients[row, EXPONENT] * temperature_factor(coefficients, row, EXPONENT_POLYNOMIAL, 0.5 * (ti + tj) - 1.0)
    )
    weight = power(1.0 - r / coefficients[row, CUTOFF], 0.5 * s)
    friction = coefficients[row, GAMMA] * weight * weight
    strength = 4.0 * friction * ti * tj / (ti + tj)
    share, mass_term, rate = (1.0 / capacities, 1.0, 1.0) if lammps else (0.5, 0.5, rsqrt_dt)
    # LAMMPS puts f on the noise of the forces too, and none on the heat
    noise_factor, heat_factor, heat_noise_factor = (factor, 1.0, 1.0) if lammps else (np.sqrt(factor), factor, np.sqrt(factor))
    radial, drag, heat = 0.0, 0.0, 0.0
    if which & DISSIPATIVE:
        drag = factor * friction * ev
        radial -= drag
        heat += share * heat_factor * (friction * ev * ev - mass_term * strength * inverse_mass)
    if which & RANDOM:
        kick = np.sqrt(strength) * xi
        radial += noise_factor * kick * rsqrt_dt
        heat -= share * heat_noise_factor * ev * kick * rate
    return radial, drag, heat


@inlined
def _conduction(which, coefficients, row, r, ti, tj, kappa, rsqrt_dt, xi):
    """Heat that flows to i from j; ``kappa`` is C_i C_j k, ``xi`` as bead i sees it."""
    weight = power(1.0 - r / coefficients[row, CUTOFF_T], 0.5 * coefficients[row, EXPONENT_T])
    strength = kappa * (0.5 * (ti + tj) * weight) ** 2
    flux = 0.0
    if which & DISSIPATIVE:
        flux += strength * (1.0 / ti - 1.0 / tj)
    if which & RANDOM:
        flux += np.sqrt(2.0 * strength) * rsqrt_dt * clamped(xi)
    return flux


class Heat(NamedTuple):
    """What the force form reads and writes beside the pairs; ``failed``: a pair of each column whose conduction is negative, or -1.  See
    also :class:`.layer.SortedMotion`."""

    which: int
    lammps: bool
    key: np.uint64
    rsqrt_dt: float
    coefficients: np.ndarray
    capacity: np.ndarray
    temperature: np.ndarray
    heat: np.ndarray
    failed: np.ndarray
    seen: np.ndarray
    v: np.ndarray
    f: np.ndarray
    out: np.ndarray
    add: bool


@inlined
def _pair_heat(pairs, data, scratch, n, k, column):
    i, j, order, c, which, lammps, heat = pairs.pi[n], pairs.pj[n], pairs.order, data.coefficients, data.which, data.lammps, data.heat
    row, factor, r = row_of(pairs, i, j), factor_of(pairs, n), pairs.geometry[3, n]
    ti, tj = data.temperature[i], data.temperature[j]
    inside, near = r < c[row, CUTOFF], r < c[row, CUTOFF_T]
    lower = order[i] < order[j]
    radial, energy, drag, gain = 0.0, 0.0, 0.0, 0.0
    pair, xi = data.key, 0.0
    if which & RANDOM:
        pair = pair_key(data.key, min(order[i], order[j]), max(order[i], order[j]))
        xi = normal(pair, MOTION) if inside else 0.0
    if inside and which & CONSERVATIVE:
        radial, energy = soft(factor * c[row, A] * 0.5 * (ti + tj), c[row, CUTOFF], r)
    if inside and which & (DISSIPATIVE | RANDOM):
        ev = approach(pairs, data.v, n, i, j)
        im = pairs.inv_mass[i] + pairs.inv_mass[j]
        if lammps:
            im = pairs.inv_mass[i] if lower else pairs.inv_mass[j]
        capacities = data.capacity[i] + data.capacity[j]
        rubbed, drag, gain = _friction(which, lammps, c, row, factor, r, ti, tj, ev, data.rsqrt_dt, xi, im, capacities)
        radial += rubbed
        gain = 0.0 if lammps and not near else gain
    if near and (inside or not lammps) and which & (DISSIPATIVE | RANDOM):
        kappa = c[row, KAPPA] * temperature_factor(c, row, KAPPA_POLYNOMIAL, 0.5 * (ti + tj) - 1.0)
        if kappa < 0.0 and data.failed[column] < 0:
            data.failed[column] = n
        drawn = xi if lammps or not which & RANDOM else normal(pair, HEAT)
        kappa *= data.capacity[i] * data.capacity[j]
        flux = _conduction(which, c, row, r, ti, tj, kappa, data.rsqrt_dt, drawn if lower else -drawn)
        heat[i] += flux
        heat[j] -= flux
    heat[i] += gain
    heat[j] += gain
    return energy, push_apart(pairs, data.f, n, i, j, radial), -drag * r


thermal_forces = over_pairs("thermal_forces", _pair_heat, first=gather_and_clear, last=deliver)
