"""Beads with an internal energy (DPDE), slowly and plainly: the answer that faster code has to reproduce.

Everything is written from the equations, as loops over pairs found by an O(N^2) search. Conventions are those
of `oracle`; further: coefficients are symmetric (T, T) matrices, masses are one per bead, temperatures
``theta`` are in kelvin (or any unit) and ``k_B`` turns them into energies, so it is always an argument.
Noise is explicit: ``xi`` is a symmetric (N, N) matrix (it multiplies e_ij, which is antisymmetric), ``xi_q``
and other heat noises are antisymmetric. Sums run over all ordered pairs, so that conservation is a result,
not an assumption. ``F dt`` with a random part ``~ dt**(-1/2)`` is the impulse of one step.
"""

from collections import namedtuple
from collections.abc import Iterable, Iterator

import numpy as np
import oracle


class Terms(namedtuple("Terms", "conservative dissipative random energy virial_conservative virial_dissipative virial_random")):
    """Pair forces by origin (N, 3), ``sum over pairs r_ij[a] F[b]`` of each, and the pair energy as the pair style reports it."""

    @property
    def forces(self) -> np.ndarray:
        """C + D + R."""
        return self.conservative + self.dissipative + self.random

    @property
    def virial_tensor(self) -> np.ndarray:
        """C + D + R, (3, 3)."""
        return self.virial_conservative + self.virial_dissipative + self.virial_random

    @property
    def virial(self) -> float:
        """Trace of `virial_tensor`."""
        return float(np.trace(self.virial_tensor))


class TermSums:
    """Adds up `Terms` over ordered pairs: each call gives the force on i; half of every energy and virial."""

    def __init__(self, n: int) -> None:
        self.forces = np.zeros((3, n, 3))
        self.virials = np.zeros((3, 3, 3))
        self.energy = 0.0

    def add(self, i: int, r: float, e: np.ndarray, scalars: tuple[float, float, float], energy: float) -> None:
        """Central forces ``C e, D e, R e`` on i and the energy of the whole pair."""
        for k, scalar in enumerate(scalars):
            self.forces[k, i] += scalar * e
            self.virials[k] += 0.5 * r * scalar * np.outer(e, e)
        self.energy += 0.5 * energy

    def terms(self) -> Terms:
        """The sums."""
        return Terms(*self.forces, self.energy, *self.virials)


def pressure(masses, v, terms: Terms, box) -> float:
    """``P = (sum m v^2 + virial)/(3 V)``, virial = ``sum r_ij . F`` of C + D + R."""
    return oracle.pressure(masses, v, terms.virial, box)


# ------------------------------------------------------------------------------------------------- helpers
def symmetric_noise(xi, n: int) -> np.ndarray:
    """The (n, n) matrix ``xi``, which must be symmetric; None means zeros."""
    xi = np.zeros((n, n)) if xi is None else np.asarray(xi, dtype=float)
    if xi.shape != (n, n) or not np.array_equal(xi, xi.T):
        raise ValueError(f"the noise of the forces must be a symmetric ({n}, {n}) matrix")
    return xi


def antisymmetric_noise(xi, n: int) -> np.ndarray:
    """The (n, n) matrix ``xi``, which must be antisymmetric; None means zeros."""
    xi = np.zeros((n, n)) if xi is None else np.asarray(xi, dtype=float)
    if xi.shape != (n, n) or not np.array_equal(xi, -xi.T):
        raise ValueError(f"the noise of the fluxes must be an antisymmetric ({n}, {n}) matrix")
    return xi


def matrices(types, *coefficients) -> list[np.ndarray]:
    """Coefficients as symmetric (T, T) arrays, T = max(types) + 1 or more; a number is for all pairs of types."""
    n_types = int(np.max(types)) + 1
    result = []
    for coefficient in coefficients:
        matrix = np.asarray(coefficient, dtype=float)
        matrix = np.full((n_types, n_types), float(matrix)) if matrix.ndim == 0 else matrix
        if matrix.ndim != 2 or len(matrix) < n_types or not np.array_equal(matrix, matrix.T):
            raise ValueError(f"a coefficient must be a number or a symmetric matrix of {n_types} types, not {matrix}")
        result.append(matrix)
    return result


def ordered_pairs(x, types, cutoff: np.ndarray, box, least: float = oracle.R_MIN) -> Iterator[tuple[int, int, int, int, float, np.ndarray]]:
    """Yield (i, j, type_i, type_j, r, e_ij) for both orders of every pair with ``least <= r < cutoff``."""
    types = np.asarray(types)
    pairs = oracle.pair_list(x, types, oracle.PairParams.build(len(cutoff), cutoff=cutoff), box, least)
    for i, j, r, e in zip(*pairs, strict=True):
        yield int(i), int(j), int(types[i]), int(types[j]), float(r), e
        yield int(j), int(i), int(types[j]), int(types[i]), float(r), -e


def harmonic_mean(a: float, b: float) -> float:
    """``1/h = (1/a + 1/b)/2``."""
    return 2.0 / (1.0 / a + 1.0 / b)


# ------------------------------------------------------------------------------- rates (pair dpd/fdt/energy)
class DpdeRates(namedtuple("DpdeRates", "terms mech_deterministic mech_random cond_deterministic cond_random")):
    """Forces, and energy per time (N,) that goes into each bead, by origin."""

    @property
    def du_mech(self) -> np.ndarray:
        """Rate of the mechanical part of the internal energy."""
        return self.mech_deterministic + self.mech_random

    @property
    def du_cond(self) -> np.ndarray:
        """Rate of the conducted part of the internal energy."""
        return self.cond_deterministic + self.cond_random


def dpde_rates(x, v, theta, types, masses, A, sigma, kappa, cutoff, box, k_B, dt, xi=None, xi_q=None) -> DpdeRates:
    """Forces and heat of energy-conserving DPD with a constant sigma.

    ``1/Theta = (1/theta_i + 1/theta_j)/2``, ``gamma = sigma^2/(2 k_B Theta)``, ``w = 1 - r/rc``,
    ``mu = 1/m_i + 1/m_j``:

    - ``F = [A w - gamma w^2 (e.v_ij) + sigma w xi/sqrt(dt)] e``, ``U = A rc w^2/2``
    - ``du_mech_i = [gamma w^2 (e.v_ij)^2 - sigma^2 mu w^2/2 - sigma w (e.v_ij) xi/sqrt(dt)]/2``, the same for j
    - ``du_cond_i = kappa (1/theta_i - 1/theta_j) w^2 + sqrt(2 k_B kappa) w xi_q/sqrt(dt)``, opposite for j

    Parameters
    ----------
    x, v, theta, types, masses : (N, 3), (N, 3), (N,), (N,), (N,)
    A, sigma, kappa, cutoff : numbers or symmetric (T, T) matrices
    xi, xi_q : symmetric and antisymmetric (N, N) noise; None means no noise
    """
    n, root_dt = len(x), np.sqrt(dt)
    A, sigma, kappa, cutoff = matrices(types, A, sigma, kappa, cutoff)
    xi, xi_q = symmetric_noise(xi, n), antisymmetric_noise(xi_q, n)
    sums, heat = TermSums(n), np.zeros((4, n))
    for i, j, a, b, r, e in ordered_pairs(x, types, cutoff, box):
        w = 1.0 - r / cutoff[a, b]
        g = sigma[a, b] ** 2 / (2.0 * k_B * harmonic_mean(theta[i], theta[j])) * w**2
        s = sigma[a, b] * w
        ev = float(np.dot(e, v[i] - v[j]))
        mu = 1.0 / masses[i] + 1.0 / masses[j]
        sums.add(i, r, e, (A[a, b] * w, -g * ev, s * xi[i, j] / root_dt), 0.5 * A[a, b] * cutoff[a, b] * w**2)
        heat[0, i] += 0.5 * (g * ev**2 - 0.5 * s**2 * mu)
        heat[1, i] += -0.5 * s * ev * xi[i, j] / root_dt
        heat[2, i] += kappa[a, b] * (1.0 / theta[i] - 1.0 / theta[j]) * w**2
        heat[3, i] += np.sqrt(2.0 * k_B * kappa[a, b]) * w * xi_q[i, j] / root_dt
    return DpdeRates(sums.terms(), *heat)


# ------------------------------------------------------------------------------------- equations of state
Eos = namedtuple("Eos", "u theta")  # Internal energy of the beads as a function of their temperatures, and its inverse; arrays (N,) both.


def constant_cv(cv) -> Eos:
    """``u = cv theta``; cv is a number or one number per bead."""
    cv = np.asarray(cv, dtype=float)

    def theta_of(u):
        theta = np.asarray(u, dtype=float) / cv
        if np.any(theta <= 0.0):
            raise ValueError(f"internal temperature {theta.min()} is not positive")
        return theta

    return Eos(lambda theta: cv * np.asarray(theta, dtype=float), theta_of)


# Result of `dpde_verlet_step`; ``rates`` are those that open the next step.
VerletState = namedtuple("VerletState", "x v u_cond u_mech theta rates")


def dpde_verlet_step(x, v, u_cond, u_mech, rates: DpdeRates, masses, dt, eos: Eos, rates_at) -> VerletState:
    """Velocity Verlet of positions, velocities and internal energies (fix dpd/energy with fix nve and an eos).

    ``v += dt/2 F/m``, ``x += dt v``, ``u += dt/2 du``, ``theta = theta(u_cond + u_mech)``; new F and du at
    x(t+dt), v(t+dt/2), theta(t+dt/2); ``v += dt/2 F/m``, ``u += dt/2 du``; theta from the final u.  ``rates`` are those of the last
    evaluation, ``rates_at(x, v, theta)`` has the noise of this step bound.
    """
    m = np.asarray(masses, dtype=float)[:, None]
    v = v + 0.5 * dt * rates.terms.forces / m
    x = x + dt * v
    u_cond = u_cond + 0.5 * dt * rates.du_cond
    u_mech = u_mech + 0.5 * dt * rates.du_mech
    rates = rates_at(x, v, eos.theta(u_cond + u_mech))
    v = v + 0.5 * dt * rates.terms.forces / m
    u_cond = u_cond + 0.5 * dt * rates.du_cond
    u_mech = u_mech + 0.5 * dt * rates.du_mech
    return VerletState(x, v, u_cond, u_mech, eos.theta(u_cond + u_mech), rates)


# ----------------------------------------------------------------------------------------- sweeps over pairs
Sweep = namedtuple("Sweep", "v u_cond u_mech")  # Velocities and internal energies after a sweep.


def _sweep_pairs(x, order: Iterable[tuple[int, int]], types, cutoff, box):
    """Yield (i, j, type_i, type_j, w, e_ij) for the pairs of ``order`` that are within their cutoff."""
    x = np.asarray(x, dtype=float)
    for i, j, dr in oracle.in_order(x, order, box):
        r = float(np.sqrt(np.dot(dr, dr)))
        a, b = int(types[i]), int(types[j])
        if oracle.R_MIN <= r < cutoff[a, b]:
            yield i, j, a, b, 1.0 - r / cutoff[a, b], dr / r


def _conducted(kappa, theta_i, theta_j, w, k_B, dt, xi_q) -> float:
    """Heat into i during dt: ``kappa (1/theta_i - 1/theta_j) w^2 dt + sqrt(2 k_B kappa dt) w xi_q``."""
    return kappa * (1.0 / theta_i - 1.0 / theta_j) * w**2 * dt + np.sqrt(2.0 * k_B * kappa * dt) * w * xi_q


def _kinetic(m_i, v_i, m_j, v_j) -> float:
    return 0.5 * float(m_i * np.dot(v_i, v_i) + m_j * np.dot(v_j, v_j))


def shardlow_energy_sweep(
    x, v, u_cond, u_mech, theta, order, types, masses, sigma, kappa, cutoff, box, k_B, dt, xi, xi_q
) -> Sweep:  # fmt: skip
    """Shardlow's splitting with internal energies, as fix shardlow does it: theta is frozen during the sweep.

    For each pair of ``order`` in turn, with ``G = gamma w^2 dt/2``, ``S = sigma w sqrt(dt) xi/2`` and
    ``gamma = sigma^2/(2 k_B Theta_ij)``:

    - heat: ``dU_c = kappa (1/theta_i - 1/theta_j) w^2 dt + sqrt(2 k_B kappa) w sqrt(dt) xi_q``, to i, and -dU_c to j
    - ``dp = 2 [S - G (e.v_ij)]/(1 + mu G)``, ``v_i += e dp/m_i``, ``v_j -= e dp/m_j`` (explicit and implicit half in one)
    - minus half of the change of the pair's kinetic energy to ``u_mech`` of each

    ``order`` may contain pairs beyond the cutoff; (j, i) means the same as (i, j).
    """
    n = len(x)
    sigma, kappa, cutoff = matrices(types, sigma, kappa, cutoff)
    xi, xi_q = symmetric_noise(xi, n), antisymmetric_noise(xi_q, n)
    v, u_cond, u_mech = (np.array(a, dtype=float) for a in (v, u_cond, u_mech))
    for i, j, a, b, w, e in _sweep_pairs(x, order, types, cutoff, box):
        heat = _conducted(kappa[a, b], theta[i], theta[j], w, k_B, dt, xi_q[i, j])
        u_cond[i] += heat
        u_cond[j] -= heat
        before = _kinetic(masses[i], v[i], masses[j], v[j])
        G = 0.5 * (sigma[a, b] ** 2 / (2.0 * k_B * harmonic_mean(theta[i], theta[j]))) * w**2 * dt
        S = 0.5 * sigma[a, b] * w * np.sqrt(dt) * xi[i, j]
        mu = 1.0 / masses[i] + 1.0 / masses[j]
        dp = 2.0 * (S - G * np.dot(e, v[i] - v[j])) / (1.0 + mu * G)
        v[i] += dp / masses[i] * e
        v[j] -= dp / masses[j] * e
        lost = before - _kinetic(masses[i], v[i], masses[j], v[j])
        u_mech[i] += 0.5 * lost
        u_mech[j] += 0.5 * lost
    return Sweep(v, u_cond, u_mech)
