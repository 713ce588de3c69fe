"""Heat and species carried by beads (eDPD, tDPD, pair updates of energies), slowly and plainly: the answer that faster code has to reproduce.

Conventions are those of `oracle_energy`: loops over ordered pairs, symmetric (T, T) coefficients, one mass per
bead, explicit noise matrices (symmetric for forces, antisymmetric for fluxes). In eDPD temperatures are energies
(k_B = 1), Cv is a pure number and the bead's internal energy is Cv T.

``compat="lammps"`` gives what LAMMPS computes, ``compat="consistent"`` what the equations ask for.
"""

from collections import namedtuple
from collections.abc import Callable

import numpy as np
from oracle_energy import TermSums, antisymmetric_noise, harmonic_mean, matrices, ordered_pairs, symmetric_noise
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

HEAT_NOISE_LIMIT = 5.0  # larger heat and species noise is cut to this
POWER_MIN = 0.01  # smallest drag exponent of eDPD
COMPAT = ("lammps", "consistent")


def _check_compat(compat: str) -> None:
    if compat not in COMPAT:
        raise ValueError(f"compat must be one of {COMPAT}, not {compat!r}")


def _clamped(xi: float) -> float:
    return float(np.clip(xi, -HEAT_NOISE_LIMIT, HEAT_NOISE_LIMIT))


def _weight(r: float, cutoff: float, power: float) -> float:
    """``(1 - r/rc)^power`` inside the cutoff, 0 outside."""
    return (1.0 - r / cutoff) ** power if r < cutoff else 0.0


# --------------------------------------------------------------------------------------------------- eDPD
class EdpdRates(namedtuple("EdpdRates", "terms q_conductive q_viscous_deterministic q_viscous_random q_random")):
    """Forces, and energy per time (N,) into each bead (``Cv dT/dt = q``), by origin; ``q_viscous`` has a part with noise."""

    @property
    def q_viscous(self) -> np.ndarray:
        """Heat from the pair's kinetic energy."""
        return self.q_viscous_deterministic + self.q_viscous_random

    @property
    def q(self) -> np.ndarray:
        """All heat."""
        return self.q_conductive + self.q_viscous + self.q_random


def temperature_polynomial(coefficients, mean_temperature: float) -> float:
    """``1 + c1 y + c2 y^2 + c3 y^3 + c4 y^4``, ``y = Tm - 1``; 1 without coefficients."""
    y = mean_temperature - 1.0
    return 1.0 if coefficients is None else 1.0 + sum(float(c) * y**k for k, c in enumerate(coefficients, start=1))


def _polynomial_of(table, a: int, b: int):
    """Four coefficients of a type pair from a (4,) or (T, T, 4) array or None."""
    if table is None:
        return None
    table = np.asarray(table, dtype=float)
    return table if table.ndim == 1 else table[a, b]


def _conduction(r, T_i, T_j, cv_cv_k, power_T, cutoff_T) -> tuple[float, float]:
    """``K wT^2 (1/T_i - 1/T_j)`` and ``sqrt(2 K) wT``, ``K = Cv_i Cv_j k Tm^2``."""
    K, w_T = cv_cv_k * (0.5 * (T_i + T_j)) ** 2, _weight(r, cutoff_T, 0.5 * power_T)
    return K * w_T**2 * (1.0 / T_i - 1.0 / T_j), np.sqrt(2.0 * K) * w_T


def edpd_pair(
    x, v, T, cv, types, masses, A, gamma, power, cutoff, kappa, power_T, cutoff_T, box, dt, xi=None, xi_T=None,
    power_coeffs=None, kappa_coeffs=None, compat="consistent", owner: Callable[[int, int], int] = min,
) -> EdpdRates:  # fmt: skip
    """Forces and heat of eDPD.

    With ``Tm = (T_i + T_j)/2``, ``s = max(0.01, power P(Tm))``, ``k = kappa P'(Tm)`` (`temperature_polynomial`),
    ``w = 1 - r/rc``, ``wR = w^(s/2)``, ``sigma^2 = 4 gamma T_i T_j/(T_i + T_j)``,
    ``wT = (1 - r/rcT)^(power_T/2)``, ``K = Cv_i Cv_j k Tm^2``, ``mu = 1/m_i + 1/m_j``:

    - ``F = [A Tm w - gamma wR^2 (e.v_ij) + sigma wR xi/sqrt(dt)] e``, ``U = A Tm rc w^2/2``
    - ``q_conductive_i = K wT^2 (1/T_i - 1/T_j)``, opposite for j
    - ``q_random_i = sqrt(2 K) wT xi_T/sqrt(dt)``, opposite for j, xi_T cut to [-5, 5]
    - ``q_viscous_i = {wR^2 [gamma (e.v_ij)^2 - sigma^2 mu/2] - sigma wR (e.v_ij) xi/sqrt(dt)}/2``, the same for j

    ``compat="consistent"``: as written. ``xi_T`` is a noise of its own. Viscous heat acts where drag and noise act
    (r < rc), conduction and its noise where they have weight (r < rcT), whichever cutoff is larger, so that each
    fluctuation has its dissipation over the same range and D + R keep kinetic energy + sum Cv T on average
    (the force A Tm w is not in that balance: U depends on T and no heat flows for it).

    ``compat="lammps"``: ``xi_T = xi[i, j]`` as seen from the owner of the pair (``xi_T`` must be None);
    ``q_viscous = {wR^2 [gamma (e.v_ij)^2 - sigma^2/m] - sigma wR (e.v_ij) xi}/(Cv_i + Cv_j)``, m the mass of the owner,
    for both beads; no heat of any kind beyond ``min(rc, rcT)``. (For ``rcT <= r < rc`` LAMMPS leaves the owner's q alone
    and adds left-over numbers to the other's; here nothing is added.)

    Parameters
    ----------
    x, v, T, cv, types, masses : (N, 3), (N, 3), and (N,) each
    A, gamma, power, cutoff, kappa, power_T, cutoff_T : numbers or symmetric (T, T) matrices
    xi, xi_T : symmetric and antisymmetric (N, N) noise; None means no noise
    power_coeffs, kappa_coeffs : None, (4,), or (T, T, 4)
    owner : which of two beads LAMMPS has in the first place of its neighbour list: as observed, the smaller index within a bin,
        the one that is lower (in z first) between bins. Only for ``compat="lammps"``
    """
    _check_compat(compat)
    lammps = compat == "lammps"
    if lammps and xi_T is not None:
        raise ValueError("LAMMPS has no heat noise of its own: give xi only")
    n, root_dt = len(x), np.sqrt(dt)
    A, gamma, power, cutoff, kappa, power_T, cutoff_T = matrices(types, A, gamma, power, cutoff, kappa, power_T, cutoff_T)
    xi, xi_T = symmetric_noise(xi, n), antisymmetric_noise(xi_T, n)
    sums, heat = TermSums(n), np.zeros((4, n))
    for i, j, a, b, r, e in ordered_pairs(x, types, np.maximum(cutoff, cutoff_T), box):
        rc, mean = cutoff[a, b], 0.5 * (T[i] + T[j])
        inside = r < rc
        if inside:
            w = 1.0 - r / rc
            s = max(POWER_MIN, power[a, b] * temperature_polynomial(_polynomial_of(power_coeffs, a, b), mean))
            sigma = np.sqrt(2.0 * gamma[a, b] * harmonic_mean(T[i], T[j]))
            drag, noise = gamma[a, b] * w**s, sigma * w ** (0.5 * s)
            ev = float(np.dot(e, v[i] - v[j]))
            sums.add(i, r, e, (A[a, b] * mean * w, -drag * ev, noise * xi[i, j] / root_dt), 0.5 * A[a, b] * mean * rc * w**2)
        if lammps and inside and r < cutoff_T[a, b]:
            share = 1.0 / (cv[i] + cv[j])
            heat[1, i] += share * (drag * ev**2 - noise**2 / masses[owner(i, j)])
            heat[2, i] -= share * noise * ev * xi[i, j]
        if not lammps and inside:
            mu = 1.0 / masses[i] + 1.0 / masses[j]
            heat[1, i] += 0.5 * (drag * ev**2 - 0.5 * noise**2 * mu)
            heat[2, i] -= 0.5 * noise * ev * xi[i, j] / root_dt
        if r < cutoff_T[a, b] and (inside or not lammps):
            k = kappa[a, b] * temperature_polynomial(_polynomial_of(kappa_coeffs, a, b), mean)
            flux, amplitude = _conduction(r, T[i], T[j], cv[i] * cv[j] * k, power_T[a, b], cutoff_T[a, b])
            z = xi_T[i, j] if not lammps else (xi[i, j] if i == owner(i, j) else -xi[i, j])
            heat[0, i] += flux
            heat[3, i] += amplitude * _clamped(z) / root_dt
    return EdpdRates(sums.terms(), *heat)


def relaxation(x: float, shardlow: bool = False) -> tuple[float, float]:
    """q and 1 - q^2 of an update; Shardlow's q is (1 - x/2)/(1 + x/2)."""
    return ((1 - x / 2) / (1 + x / 2), 2 * x / (1 + x / 2) ** 2) if shardlow else (np.exp(-x), -np.expm1(-2 * x))


def part_exchanged(e: float, yields, around, spread: float) -> float:
    """Part of a difference that an update takes away.  ``e`` flows at a difference of 1, which changes a bead by its ``yields`` (a wall: 0);
    ``around``: sum of e over all neighbours; ``spread``: mean square of the relative motion in the step over that of the range."""
    b, rest = np.asarray(yields, dtype=float), np.asarray(around) - e
    direct = e * b.sum()
    total = direct + (b**2 @ rest) / b.sum()
    returned = direct / total * (1.0 + np.expm1(-total) / total / (1.0 + 10.0 * spread * (total - direct)))
    return min(direct * (1.0 - returned), 1.0 + 0.75 * b.min() / b.max())


def entropy_gain(cv, T, energy) -> float:
    """``Cv ln(T'/T)`` of a bead that gets an energy; ``energy/T`` of one that keeps its temperature (``cv`` infinite)."""
    return energy / T if np.isinf(cv) else cv * np.log((T + energy / cv) / T)


def edpd_sweep(
    v, T, cv, types, masses, gamma, power, cutoff, kappa, power_T, cutoff_T, order, geometry, dt, xi, xi_T, drawn, drawn_T,
    power_coeffs=None, kappa_coeffs=None, shardlow=False,
):  # fmt: skip
    """Velocities and temperatures after one sweep of pair updates, for the pairs of ``order`` in turn; beads of infinite mass are walls.

    In energies ``u = Cv T`` (of a wall: whatever makes its T), for each pair, with ``mu = 1/m_i + 1/m_j``:

    - motion: ``b = u + K/2`` of both, ``K = (e.v)^2/(2 mu)``; T_m and Theta of the temperatures at ``b - Theta(b)/4``; Ornstein-Uhlenbeck
      step of e.v with the rate ``gamma w^s mu`` and the variance ``Theta mu``; Metropolis test against ``exp(S_i + S_j)``
    - heat: at ``s = u_i + u_j``; balanced where both have the temperature ``s/(Cv_i + Cv_j)``, with the variance of the energy there,
      ``T^2/(1/Cv_i + 1/Cv_j)``; Ornstein-Uhlenbeck step of ``z``, ``(1 + b n) = (1 + b z/3)^3``, ``b = (1/Cv_i - 1/Cv_j)/T``, which
      loses :func:`part_exchanged` of what flows, ``k wT Cv_i Cv_j dt``; Metropolis test

    Parameters
    ----------
    geometry : (i, j) -> (distance, unit vector from j to i)
    drawn, drawn_T : (N, N) uniform numbers of the tests; a move is accepted if the ratio is above
    """
    v, T = np.array(v), np.array(T)
    gamma, power, cutoff, kappa, power_T, cutoff_T = matrices(types, gamma, power, cutoff, kappa, power_T, cutoff_T)
    masses = np.asarray(masses)
    yields = np.where(np.isinf(masses), np.inf, cv)  # heat capacity of what the bead's temperature follows
    around = np.zeros(len(T))
    for i, j in [*order, *((j, i) for i, j in order)]:
        k = types[i], types[j]
        around[i] += kappa[k] * _weight(geometry(i, j)[0], cutoff_T[k], power_T[k]) * cv[i] * cv[j] * dt
    for i, j in order:
        a, b = types[i], types[j]
        mu, (r, e), ci, cj = 1 / masses[i] + 1 / masses[j], geometry(i, j), yields[i], yields[j]
        if mu == 0:
            continue
        if r < cutoff[a, b]:
            ev = e @ (v[i] - v[j])
            K = ev**2 / (2 * mu)
            whole = T[i] + 0.5 * K / ci, T[j] + 0.5 * K / cj
            quarter = 0.25 * harmonic_mean(*whole)
            mean = whole[0] - quarter / ci, whole[1] - quarter / cj
            mean = mean if min(mean) > 0 else whole
            theta = harmonic_mean(*mean)
            s = max(POWER_MIN, power[a, b] * temperature_polynomial(_polynomial_of(power_coeffs, a, b), np.mean(mean)))
            x = gamma[a, b] * (1 - r / cutoff[a, b]) ** s * mu * dt
            q, rest = relaxation(x, shardlow)
            new = q * ev + np.sqrt(rest * theta * mu) * xi[i, j]
            gain = 0.5 * (K - new**2 / (2 * mu))
            if T[i] + gain / ci > 0 and T[j] + gain / cj > 0:
                ratio = np.exp(entropy_gain(ci, T[i], gain) + entropy_gain(cj, T[j], gain) - 2 * gain / theta)
                if drawn[i, j] < ratio:
                    v[i] += (new - ev) / mu / masses[i] * e
                    v[j] -= (new - ev) / mu / masses[j] * e
                    T[i], T[j] = T[i] + gain / ci, T[j] + gain / cj
        if r < cutoff_T[a, b]:
            shares = np.array([0.0 if np.isinf(c) else 1 / c for c in (ci, cj)])
            balanced = (shares[1] * T[i] + shares[0] * T[j]) / shares.sum()
            variance, bend = balanced**2 / shares.sum(), (shares[0] - shares[1]) / balanced
            k = kappa[a, b] * temperature_polynomial(_polynomial_of(kappa_coeffs, a, b), balanced)
            # of what an exchange of heat dn does to n = (T_i - T_j)/(1/C_i + 1/C_j), the rate of K (1/T_i - 1/T_j)
            e, warmer = k * cv[i] * cv[j] * dt, k / kappa[a, b] if kappa[a, b] else 0.0
            e, moved = e * _weight(r, cutoff_T[a, b], power_T[a, b]), balanced * mu * (dt / cutoff_T[a, b]) ** 2
            lost = part_exchanged(e, shares, warmer * around[[i, j]], moved) if e else 0.0
            q, rest = 1.0 - lost, lost * (2.0 - lost)
            n = (T[i] - T[j]) / shares.sum()
            root = lambda n: np.cbrt(1 + bend * n)  # noqa: B023, E731
            z = 3 * (root(n) - 1) / bend if bend else n
            new_z = q * z + np.sqrt(rest * variance) * xi_T[i, j]
            new = ((1 + bend * new_z / 3) ** 3 - 1) / bend if bend else new_z
            flow = new - n
            if 1 + bend * new_z / 3 > 0 and T[i] + flow * shares[0] > 0 and T[j] - flow * shares[1] > 0:
                exponent = entropy_gain(ci, T[i], flow) + entropy_gain(cj, T[j], -flow) + (new_z**2 - z**2) / (2 * variance)
                if drawn_T[i, j] < np.exp(exponent) * (root(new) / root(n)) ** 2:
                    T[i], T[j] = T[i] + flow * shares[0], T[j] - flow * shares[1]
    return v, T


# ----------------------------------------------------------------------------------------- beads with internal energies
# An equation of state: 1/theta, minus its slope, and the entropy as functions of the energy, and between which energies they are.
State = namedtuple("State", "inverse slope entropy low high")


def capacity_state(cv: float) -> State:
    """``u = cv theta``."""
    return State(lambda u: cv / u, lambda u: cv / u**2, lambda u: cv * np.log(u), 1e-9, 1e9)


def reservoir_state(theta: float) -> State:
    """One temperature at all energies."""
    return State(lambda u: 1.0 / theta, lambda u: 0.0, lambda u: u / theta, -1e9, 1e9)


def curve_state(energies, thetas) -> State:
    """A monotone cubic 1/theta through points."""
    inverse = PchipInterpolator(energies, 1.0 / np.asarray(thetas))
    slope = inverse.derivative()
    return State(inverse, lambda u: -slope(u), inverse.antiderivative(), energies[0], energies[-1])


def energy_sweep(
    v, u_cond, u_mech, states, types, masses, sigma, kappa, cutoff, order, geometry, dt, xi, xi_q, drawn, drawn_q, shardlow=False
):  # fmt: skip
    """Velocities, conducted and mechanical energies after one sweep of pair updates, for the pairs of ``order`` in turn.

    As :func:`edpd_sweep`, with ``S`` and ``theta`` of the ``states`` of the beads; for the heat, the Gaussian around the energies at which both
    have one temperature, with the variance ``1/(-S_i'' - S_j'')`` there.  ``shardlow``: temperatures are those before the sweep, and the heat is
    an Euler step.
    """
    v, energies = np.array(v), np.column_stack([u_cond, u_mech])
    sigma, kappa, cutoff = matrices(types, sigma, kappa, cutoff)
    masses, around = np.asarray(masses), np.zeros(len(v))
    before = np.array([state.inverse(u) for state, u in zip(states, energies.sum(axis=1), strict=True)])
    weight = lambda i, j: max(0.0, 1.0 - geometry(i, j)[0] / cutoff[types[i], types[j]])  # noqa: E731
    for i, j in order:
        around[[i, j]] += kappa[types[i], types[j]] * weight(i, j) ** 2 * dt
    for i, j in order:
        mu, e, w, of, pair = 1 / masses[i] + 1 / masses[j], geometry(i, j)[1], weight(i, j), (types[i], types[j]), (states[i], states[j])
        if mu == 0 or w == 0:
            continue
        u = energies[[i, j]].sum(axis=1)
        mean = lambda u: 2.0 / sum(state.inverse(each) for state, each in zip(pair, u, strict=True))  # noqa: B023, E731
        inside = lambda u: all(state.low < each < state.high for state, each in zip(pair, u, strict=True))  # noqa: B023, E731
        entropy = lambda u: sum(state.entropy(each) for state, each in zip(pair, u, strict=True))  # noqa: B023, E731
        ev = e @ (v[i] - v[j])
        K = ev**2 / (2 * mu)
        whole = u + 0.5 * K
        less = whole - 0.25 * mean(whole)
        theta = 2.0 / (before[i] + before[j]) if shardlow else mean(less) if inside(less) else mean(whole)
        q, rest = relaxation(0.5 * (sigma[of] * w) ** 2 / theta * mu * dt, shardlow)
        new = q * ev + np.sqrt(rest * theta * mu) * xi[i, j]
        gain = 0.5 * (K - new**2 / (2 * mu))
        if shardlow or (inside(u + gain) and drawn[i, j] < np.exp(entropy(u + gain) - entropy(u) - 2 * gain / theta)):
            v[i] += (new - ev) / mu / masses[i] * e
            v[j] -= (new - ev) / mu / masses[j] * e
            energies[[i, j], 1] += np.where(np.isinf(masses[[i, j]]), 0.0, gain)
            u = u + gain
        flow = kappa[of] * w**2 * dt * (before[i] - before[j]) + np.sqrt(2 * kappa[of] * dt) * w * xi_q[i, j]
        if not shardlow:
            low, high = max(pair[0].low, u.sum() - pair[1].high), min(pair[0].high, u.sum() - pair[1].low)
            share = brentq(lambda s: pair[0].inverse(s) - pair[1].inverse(u.sum() - s), low, high, xtol=1e-13)  # noqa: B023
            slopes = pair[0].slope(share), pair[1].slope(u.sum() - share)
            spread = mu * (dt / cutoff[of]) ** 2 / pair[0].inverse(share)
            lost, old = part_exchanged(kappa[of] * w**2 * dt, slopes, around[[i, j]], spread), u[0] - share
            new = (1 - lost) * old + np.sqrt(lost * (2 - lost) / sum(slopes)) * xi_q[i, j]
            moved = u + (new - old) * np.array([1, -1])
            takes = inside(moved) and drawn_q[i, j] < np.exp(entropy(moved) - entropy(u) + 0.5 * (new**2 - old**2) * sum(slopes))
            flow = (new - old) * takes
        energies[[i, j], 0] += np.where(np.isinf(masses[[i, j]]), 0.0, flow * np.array([1, -1]))
    return v, *energies.T


# --------------------------------------------------------------------------------------------------- tDPD
class TdpdRates(namedtuple("TdpdRates", "terms conductive random")):
    """Forces, and change of concentration per time (N, S) by origin (``dC/dt = Q``)."""

    @property
    def Q(self) -> np.ndarray:
        """All of it."""
        return self.conductive + self.random


def _species(values, n_species: int) -> list:
    """One coefficient (a number or a matrix) per species from a number or a sequence of them."""
    values = [values] * n_species if np.ndim(values) == 0 else list(values)
    if len(values) != n_species:
        raise ValueError(f"{len(values)} coefficients for {n_species} species")
    return values


def tdpd_pair(
    x, v, C, types, A, gamma, power, cutoff, cutoff_C, kappa, epsilon, power_C, kT, box, dt, xi=None, xi_C=None, compat="consistent"
) -> TdpdRates:  # fmt: skip
    """Forces and species fluxes of tDPD.

    With ``w = 1 - r/rc``, ``wR = w^(power/2)``, ``sigma^2 = 2 kT gamma``, and for species k
    ``wk = (1 - r/rcC)^(power_C_k/2)``:

    - ``F = [A w - gamma wR^2 (e.v_ij) + sigma wR xi/sqrt(dt)] e``, ``U = A rc w^2/2``
    - ``Q_i,k = -kappa_k wk^2 (C_i,k - C_j,k) + epsilon_k wk (C_i,k + C_j,k) xi_k/sqrt(dt)``, opposite for j,
      xi_k cut to [-5, 5]

    ``compat="lammps"`` drops the flux of pairs with ``r >= rc`` (it matters when rcC > rc).

    Parameters
    ----------
    C : (N, S)
    A, gamma, power, cutoff, cutoff_C : numbers or symmetric (T, T) matrices
    kappa, epsilon, power_C : numbers, or one number or symmetric (T, T) matrix per species
    xi : symmetric (N, N) noise or None
    xi_C : antisymmetric noise of each species (S, N, N) or None
    """
    _check_compat(compat)
    C = np.asarray(C, dtype=float)
    (n, n_species), root_dt = C.shape, np.sqrt(dt)
    A, gamma, power, cutoff, cutoff_C = matrices(types, A, gamma, power, cutoff, cutoff_C)
    kappa, epsilon, power_C = (matrices(types, *_species(a, n_species)) for a in (kappa, epsilon, power_C))
    xi = symmetric_noise(xi, n)
    xi_C = [antisymmetric_noise(None if xi_C is None else xi_C[k], n) for k in range(n_species)]
    sums, conductive, random = TermSums(n), np.zeros_like(C), np.zeros_like(C)
    for i, j, a, b, r, e in ordered_pairs(x, types, np.maximum(cutoff, cutoff_C), box):
        rc = cutoff[a, b]
        if r < rc:
            w = 1.0 - r / rc
            w_R, ev = w ** (0.5 * power[a, b]), float(np.dot(e, v[i] - v[j]))
            R = np.sqrt(2.0 * kT * gamma[a, b]) * w_R * xi[i, j] / root_dt
            sums.add(i, r, e, (A[a, b] * w, -gamma[a, b] * w_R**2 * ev, R), 0.5 * A[a, b] * rc * w**2)
        elif compat == "lammps":
            continue
        if r >= cutoff_C[a, b]:
            continue
        for k in range(n_species):
            w_k = _weight(r, cutoff_C[a, b], 0.5 * power_C[k][a, b])
            conductive[i, k] -= kappa[k][a, b] * w_k**2 * (C[i, k] - C[j, k])
            random[i, k] += epsilon[k][a, b] * w_k * (C[i, k] + C[j, k]) * _clamped(xi_C[k][i, j]) / root_dt
    return TdpdRates(sums.terms(), conductive, random)


def tdpd_sweep(
    v, C, types, masses, gamma, power, cutoff, cutoff_C, kappa, epsilon, power_C, kT, order, geometry, dt, xi, xi_C, shardlow=False
):  # fmt: skip
    """Velocities and concentrations after one sweep of pair updates, for the pairs of ``order`` in turn; beads of infinite mass are walls.

    Motion as in DPD with the rate ``gamma w^power``.  With ``y`` the distance of C_i from what the pair tends to ((C_i + C_j)/2, or C_j if
    that stays), an Ornstein-Uhlenbeck step that loses :func:`part_exchanged` of it, with the variance that noise of the amplitude ``epsilon
    sqrt(w) (C_i + C_j)`` of now has at the rate ``h kappa w``, h = 2 or 1; it is rejected if a concentration would be negative.
    """
    v, C = np.array(v), np.array(C)
    n_species = C.shape[1]
    gamma, power, cutoff, cutoff_C = matrices(types, gamma, power, cutoff, cutoff_C)
    kappa, epsilon, power_C = (matrices(types, *_species(a, n_species)) for a in (kappa, epsilon, power_C))
    around = np.zeros_like(C)
    for i, j in [*order, *((j, i) for i, j in order)]:
        a, b = types[i], types[j]
        for k in range(n_species):
            around[i, k] += kappa[k][a, b] * _weight(geometry(i, j)[0], cutoff_C[a, b], power_C[k][a, b]) * dt
    for i, j in order:
        a, b = types[i], types[j]
        mu, (r, e) = 1 / masses[i] + 1 / masses[j], geometry(i, j)
        if mu == 0:
            continue
        if r < cutoff[a, b]:
            ev = e @ (v[i] - v[j])
            x = gamma[a, b] * (1 - r / cutoff[a, b]) ** power[a, b] * mu * dt
            q, rest = relaxation(x, shardlow)
            new = q * ev + np.sqrt(rest * kT * mu) * xi[i, j]
            v[i] += (new - ev) / mu / masses[i] * e
            v[j] -= (new - ev) / mu / masses[j] * e
        for k in range(n_species):
            w, (one, other) = _weight(r, cutoff_C[a, b], power_C[k][a, b]), (i, j) if np.isfinite(masses[i]) else (j, i)
            moves = np.isfinite(masses[other])
            rate, S = (1 + moves) * kappa[k][a, b] * w, C[i, k] + C[j, k]
            aim = 0.5 * S if moves else C[other, k]
            e, yields = kappa[k][a, b] * w * dt, np.isfinite(masses[[i, j]]).astype(float)
            lost = part_exchanged(e, yields, around[[i, j], k], kT * mu * (dt / cutoff_C[a, b]) ** 2) if e else 0.0
            new = aim + (C[one, k] - aim) * (1.0 - lost)
            noise, positive = epsilon[k][a, b] ** 2 * w, C[i, k] >= 0 and C[j, k] >= 0
            if noise > 0 and positive:
                new += S * np.sqrt(noise * (lost * (2.0 - lost) / (2 * rate) if rate else dt)) * xi_C[k][one, other]
                if new < 0 or (moves and S - new < 0):
                    continue
            change = new - C[one, k]
            C[one, k] += change
            C[other, k] -= change * moves
    return v, C


# ------------------------------------------------------------------------------------------------ sources
def in_sphere(x, centre, radius: float) -> np.ndarray:
    """Beads with ``|x - centre| < radius`` (no periodic images). LAMMPS's source fixes compare with radius^(3/2)."""
    return np.sum((np.asarray(x, dtype=float) - centre) ** 2, axis=1) < radius**2


def in_cuboid(x, centre, lengths) -> np.ndarray:
    """Beads with ``|x - centre| <= lengths/2`` in each direction (no periodic images); ``centre`` is the middle."""
    return np.all(np.abs(np.asarray(x, dtype=float) - centre) <= 0.5 * np.asarray(lengths, dtype=float), axis=1)


def edpd_source(inside, rate: float, cv) -> np.ndarray:
    """Heat ``q_i = rate Cv_i`` of the beads inside: ``rate`` is a dT/dt."""
    return np.where(inside, rate * np.asarray(cv, dtype=float), 0.0)


def tdpd_source(inside, species: int, rate: float, n_species: int) -> np.ndarray:
    """Flux (N, S) with ``Q_i,species = rate`` of the beads inside; species are counted from 0."""
    Q = np.zeros((len(inside), n_species))
    Q[np.asarray(inside), species] = rate
    return Q


# -------------------------------------------------------------------------------------------------- steps
EdpdState = namedtuple("EdpdState", "x v T f q")  # Result of `mvv_edpd_step`; ``f`` and ``q`` open the next step.


def mvv_edpd_step(x, v, T, f, q, masses, cv, dt, lam, rates_at) -> EdpdState:
    """Modified velocity Verlet of velocities and temperatures; ``rates_at(x, v, T) -> (f, q)``, noise and sources included.

    ``vh = v + dt/2 f/m``, ``x += dt vh``, ``Th = T + dt/2 q/Cv``; new f and q at x and at the predictions
    ``v + lam dt f/m``, ``T + lam dt q/Cv``; ``v = vh + dt/2 f/m``, ``T = Th + dt/2 q/Cv``.
    """
    m, cv = np.asarray(masses, dtype=float)[:, None], np.asarray(cv, dtype=float)
    v_half, T_half = v + 0.5 * dt * f / m, T + 0.5 * dt * q / cv
    x = x + dt * v_half
    f, q = rates_at(x, v + lam * dt * f / m, T + lam * dt * q / cv)
    return EdpdState(x, v_half + 0.5 * dt * f / m, T_half + 0.5 * dt * q / cv, f, q)


TdpdState = namedtuple("TdpdState", "x v C f Q")  # Result of `mvv_tdpd_step`; ``f`` and ``Q`` open the next step.


def mvv_tdpd_step(x, v, C, f, Q, masses, dt, lam, rates_at) -> TdpdState:
    """As `mvv_edpd_step` for x and v; ``C += dt/2 Q`` before and after the new f and Q, which are taken at the half-step C.

    ``rates_at(x, v, C) -> (f, Q)``, noise and sources included. lam does not act on C.
    """
    m = np.asarray(masses, dtype=float)[:, None]
    v_half, C = v + 0.5 * dt * f / m, C + 0.5 * dt * Q
    x = x + dt * v_half
    f, Q = rates_at(x, v + lam * dt * f / m, C)
    return TdpdState(x, v_half + 0.5 * dt * f / m, C + 0.5 * dt * Q, f, Q)
