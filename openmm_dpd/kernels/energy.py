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
from typing import NamedTuple

import numpy as np

from ..base.errors import RunError, bead_number, in_units
from ..runtime import helper, merged
from . import exchange, forces
from .columns import Motion, approach, change, deliver_rates, factor_of, gather_and_clear_rates, over_pairs, push_apart, row_of
from .energy_updates import any_conduction, any_motion, conduction_of_constants, motion_of_constants
from .eos import CONSTANT, EOSTable
from .fields import NO_INCREMENTS, sort_energies
from .forces import soft
from .layer import CONSERVATIVE, DISSIPATIVE, EXACT, RANDOM, Call, Layer, PairSpec, SortedMotion, Sums, table_of
from .noise import normal, pair_key, uniform
from .pairs import ROUNDS, PairList
from .sweeps import decay, gather_velocities, scatter_velocities
from .templates import renamed

#: Columns of the coefficient table; the first two are those of :mod:`.forces`.
A, CUTOFF, SIGMA, KAPPA = range(4)
#: Streams of the pair's random numbers.
MOTION, HEAT, MOTION_TEST, HEAT_TEST = range(4)


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
        self.pairs = PairList(spec.types, spec.inv_mass, table.cutoff, spec.exceptions)
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

    def _find_temperatures(self, energies: np.ndarray, increments: np.ndarray, when: str) -> None:
        """Sort internal energies, and 1/theta; RunError if an energy has none."""
        order, seats, eos = self.pairs.order, self.pairs.arrays.seats, self.eos
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
        return Sums(*energy_forces(pairs, Rates(call.which, *noise, self.coefficients, *of_beads, motion)))

    def sweep(self, call: Call, v: np.ndarray, increments: np.ndarray | None) -> None:
        """Update velocities pair by pair in place, and add to ``increments`` the conductive and mechanical energy each bead got."""
        assert call.field_values is not None and increments is not None
        self._find_temperatures(call.field_values, increments, "before the sweep")
        of_beads = v, increments, self.eos.capacity, self.eos.curve, *self.eos.curves, self.fields.immobile
        in_order = self._motion.v, self._u, self._inverse, self._capacity, self._curve, self._changes
        sweep = _SWEEPS[self._constant, self.pairs.spread]
        if call.update == EXACT and self.pairs.spread:
            exchange.sum_around(self.pairs, self._around)
        noise = call.update, call.dt, call.key(self.number)
        sweep(self.pairs, Exchange(*noise, self.coefficients, *of_beads, *in_order, self._around.sums[0]))
        if call.update != EXACT:
            self._find_temperatures(call.field_values, increments, "after the sweep")

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy."""
        return forces.soft_laplacian(self.pairs, self.coefficients)


class Rates(NamedTuple):
    """What the force form reads (``inverse``: (M,) 1/temperatures) and writes beside the pairs (``rates``: (M, 2), and ``changing``: (N, 2)
    where they go to)."""

    which: int
    key: np.uint64
    rsqrt_dt: float
    coefficients: np.ndarray
    inverse: np.ndarray
    rates: np.ndarray
    changing: np.ndarray
    motion: Motion


@merged
def _pair_rates(pairs, data, scratch, n, k, column):
    i, j, order, c, which, inverse, rates = pairs.pi[n], pairs.pj[n], pairs.order, data.coefficients, data.which, data.inverse, data.rates
    row, factor, r = row_of(pairs, i, j), factor_of(pairs, n), pairs.geometry[3, n]
    w = 1.0 - r / c[row, CUTOFF]
    radial, energy, drag, heat, conducted = 0.0, 0.0, 0.0, 0.0, 0.0
    if which & CONSERVATIVE:
        radial, energy = soft(factor * c[row, A], c[row, CUTOFF], r)
    if which & (DISSIPATIVE | RANDOM):
        strength = factor * (c[row, SIGMA] * w) ** 2
        kappa = c[row, KAPPA] * w * w
        ev = approach(pairs, data.motion.v, n, i, j)
        if which & DISSIPATIVE:
            # gamma w^2 = sigma^2 w^2 (1/theta_i + 1/theta_j)/4
            drag = 0.25 * strength * (inverse[i] + inverse[j]) * ev
            radial -= drag
            heat += 0.5 * (drag * ev - 0.5 * strength * (pairs.inv_mass[i] + pairs.inv_mass[j]))
            conducted += kappa * (inverse[i] - inverse[j])
        if which & RANDOM:
            pair = pair_key(data.key, order[i], order[j])
            kick = np.sqrt(strength) * data.rsqrt_dt * normal(pair, MOTION)
            radial += kick
            heat -= 0.5 * ev * kick
            drawn = np.sqrt(2.0 * kappa) * data.rsqrt_dt * normal(pair, HEAT)
            conducted += drawn if order[i] < order[j] else -drawn
        rates[i, 0] += conducted
        rates[j, 0] -= conducted
        rates[i, 1] += heat
        rates[j, 1] += heat
    return energy, push_apart(pairs, data.motion.f, n, i, j, radial), -drag * r


energy_forces = over_pairs("energy_forces", _pair_rates, first=gather_and_clear_rates, last=deliver_rates)


class Exchange(NamedTuple):
    """What the sweep form reads and writes beside the pairs.

    Beads where they are, N: ``velocities`` (N, 3) and ``increments`` (N, 2) are changed.  In the order of their numbers: ``capacities`` and
    ``numbers``, equations of state, with the curves ``start``, ``nodes``, ``pieces``; ``immobile``: those whose energies stay.  Sorted, M:
    ``v``, ``u`` and ``frozen`` (internal energies and 1/temperatures before), ``capacity``, ``curve``, ``changes`` (M, 2), and
    ``sums`` of :class:`.exchange.Around`.
    """

    update: int
    dt: float
    key: np.uint64
    coefficients: np.ndarray
    velocities: np.ndarray
    increments: np.ndarray
    capacities: np.ndarray
    numbers: np.ndarray
    start: np.ndarray
    nodes: np.ndarray
    pieces: np.ndarray
    immobile: np.ndarray
    v: np.ndarray
    u: np.ndarray
    frozen: np.ndarray
    capacity: np.ndarray
    curve: np.ndarray
    changes: np.ndarray
    sums: np.ndarray


@helper
def _gather(pairs, data, begin, end):
    order, changes = pairs.order, data.changes
    gather_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        data.capacity[k], data.curve[k] = data.capacities[order[k]], data.numbers[order[k]]
        changes[k, 0] = changes[k, 1] = 0.0


@helper
def _scatter(pairs, data, begin, end):
    order, seats, changes, increments = pairs.order, pairs.seats, data.changes, data.increments
    scatter_velocities(pairs, data, begin, end)
    for k in range(begin, end):
        i, stays = seats[k], data.immobile[order[k]]
        increments[i, 0] = 0.0 if stays else increments[i, 0] + changes[k, 0]
        increments[i, 1] = 0.0 if stays else increments[i, 1] + changes[k, 1]


# whether all beads have constant heat capacities
_CONSTANTS = False


def _pair_exchange(pairs, data, scratch, n, k, column):
    i, j, order, g, c, inv_mass = pairs.pi[n], pairs.pj[n], pairs.order, pairs.geometry, data.coefficients, pairs.inv_mass
    update, dt, frozen, u, v, changes = data.update, data.dt, data.frozen, data.u, data.v, data.changes
    im = inv_mass[i] + inv_mass[j]
    if im == 0.0:
        return 0.0, 0.0, 0.0
    row = row_of(pairs, i, j)
    w = 1.0 - g[3, n] / c[row, CUTOFF]
    ci, cj, ki, kj = data.capacity[i], data.capacity[j], data.curve[i], data.curve[j]
    states, curves = (ci, cj, ki, kj), (data.start, data.nodes, data.pieces)
    # drawn here, since each pair waits for the energies that the pair before it left: these cost nothing beside that
    pair = pair_key(data.key, order[i], order[j])
    strength = factor_of(pairs, n) * (c[row, SIGMA] * w) ** 2
    if strength > 0.0:
        ev, xi, drawn = approach(pairs, v, n, i, j), normal(pair, MOTION), uniform(pair, MOTION_TEST)
        if update != EXACT:
            theta = 2.0 / (frozen[i] + frozen[j])
            lost = decay(update, 0.5 * strength / theta * im * dt)
            new = ev * (1.0 - lost) + np.sqrt(lost * (2.0 - lost) * theta * im) * xi
            gain = 0.25 * (ev - new) * (ev + new) / im
        elif _CONSTANTS:
            new, gain = motion_of_constants(ev, im, u[i], u[j], ci, cj, strength, dt, xi, drawn)
        else:
            new, gain = any_motion(ev, im, u[i], u[j], strength, dt, xi, drawn, states, curves)
        wi, wj = (new - ev) * inv_mass[i] / im, (new - ev) * inv_mass[j] / im
        change(v, i, j, wi, wj, g[0, n], g[1, n], g[2, n])
        # each bead gets half of what the motion loses
        u[i] += gain
        u[j] += gain
        changes[i, 1] += gain
        changes[j, 1] += gain
    e = c[row, KAPPA] * w * w * dt
    if e > 0.0:
        xi, drawn = normal(pair, HEAT), uniform(pair, HEAT_TEST)
        xi = -xi if order[i] > order[j] else xi
        given = e, data.sums[i] * dt, data.sums[j] * dt, exchange.drifted(1.0, im, dt, c[row, CUTOFF])
        if update != EXACT:
            flow = np.sqrt(2.0 * e) * xi + e * (frozen[i] - frozen[j])
        elif _CONSTANTS:
            flow = conduction_of_constants(u[i], u[j], given, xi, drawn, ci, cj)
        else:
            flow = any_conduction(u[i], u[j], given, xi, drawn, states, curves)
        u[i] += flow
        u[j] -= flow
        changes[i, 0] += flow
        changes[j, 0] -= flow
    return 0.0, 0.0, 0.0


_of_any, _of_constants = merged(_pair_exchange), merged(renamed(_pair_exchange, "constants_exchange", {"_CONSTANTS": True}))
#: By whether all beads have constant heat capacities, and whether the list is spread.
_SWEEPS = {
    (False, True): over_pairs("energy_sweep", _of_any, first=_gather, last=_scatter, rounds=ROUNDS),
    (False, False): over_pairs("slow_energy_sweep", _of_any, first=_gather, last=_scatter),
    (True, True): over_pairs("constant_sweep", _of_constants, first=_gather, last=_scatter, rounds=ROUNDS),
    (True, False): over_pairs("slow_constant_sweep", _of_constants, first=_gather, last=_scatter),
}
