"""Beads whose energy depends on a local density (mDPD), slowly and plainly: what faster code has to reproduce.

Conventions are those of `oracle_energy`: loops over ordered pairs, symmetric (T, T) coefficients, explicit noise.

Which potential belongs to ``F_ij = B (rho_i + rho_j) (1 - r/rd)``? For ``U = sum_i psi(rho_i)`` with
``rho_i = sum_{j != i} w(r_ij)`` (no self term) every pair feels ``F = -[psi'(rho_i) + psi'(rho_j)] w'(r)``. Warren's
kernel ``w = 15/(2 pi rd^3) (1 - r/rd)^2`` has ``w' = -15/(pi rd^4) (1 - r/rd)``, so
``psi'(rho) 15/(pi rd^4) = B rho``, hence ``psi = (pi rd^4/30) B rho^2``. Summed over pairs the same energy is
``sum (B rd/4) (rho_i + rho_j) (1 - r/rd)^2``: half of what LAMMPS reports as its B term. A self term
``w(0)`` in rho would add ``2 B w(0) (1 - r/rd)`` to each pair and is left out, as in LAMMPS.
With the Lucy kernel ``w'`` is not proportional to ``1 - r/rd``, so LAMMPS's force has no potential.

Several types: ``B_ij (rho_i + rho_j)`` has a potential only if B is the same for all pairs of types. What has one is
``(b_i rho_i + b_j rho_j) wd`` with one b per type, and densities that count the neighbour types with weights; the
range rd may then differ between pairs of types if the force carries its kernel's slope. `many_body` does all of these.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from oracle_energy import Terms, TermSums, matrices, ordered_pairs, symmetric_noise

# ------------------------------------------------------------------------------------------------ kernels


class Kernel(NamedTuple):
    """Density kernel ``w(r, h)`` and its slope ``dw/dr``; both are only asked for r < h, integral over space 1."""

    w: Callable[[float, float], float]
    slope: Callable[[float, float], float]


# (105/(16 pi h^3)) (1 + 3 r/h)(1 - r/h)^3 and its slope -(315/(4 pi h^5)) r (1 - r/h)^2
LUCY = Kernel(
    lambda r, h: 105.0 / (16.0 * np.pi * h**3) * (1.0 + 3.0 * r / h) * (1.0 - r / h) ** 3,
    lambda r, h: -315.0 / (4.0 * np.pi * h**5) * r * (1.0 - r / h) ** 2,
)
# (15/(2 pi h^3)) (1 - r/h)^2 and its slope -(15/(pi h^4)) (1 - r/h)
WARREN = Kernel(
    lambda r, h: 15.0 / (2.0 * np.pi * h**3) * (1.0 - r / h) ** 2,
    lambda r, h: -15.0 / (np.pi * h**4) * (1.0 - r / h),
)


def _weights(types, weight) -> np.ndarray:
    """(T, T), not necessarily symmetric: ``weight[a, b]`` is what a neighbour of type b adds to a bead of type a."""
    weight, n_types = np.asarray(weight, dtype=float), int(np.max(types)) + 1
    return np.full((n_types, n_types), float(weight)) if weight.ndim == 0 else weight


def local_density(x, types, cutoff, box, kernel: Kernel = WARREN, masses=None, weight=1.0) -> np.ndarray:
    """``rho_i = sum_{j != i, r < h} c_ab m_j w(r, h)``, h the cutoff of the pair of types; no self term.

    Parameters
    ----------
    masses : (N,) or None, which counts every bead as 1
    weight : number or (T, T) matrix ``c_ab``, bead type a, neighbour type b; need not be symmetric

    Returns
    -------
    rho : (N,)
    """
    (cutoff,), weight = matrices(types, cutoff), _weights(types, weight)
    masses = np.ones(len(x)) if masses is None else np.asarray(masses, dtype=float)
    rho = np.zeros(len(x))
    for i, j, a, b, r, _ in ordered_pairs(x, types, cutoff, box):
        rho[i] += weight[a, b] * masses[j] * kernel.w(r, cutoff[a, b])
    return rho


def lucy_density(x, types, masses, cutoff, box) -> np.ndarray:
    """``rho_i = sum_{j != i} m_j (105/(16 pi h^3)) (1 + 3r/h)(1 - r/h)^3``, as pair mdpd/rhosum."""
    return local_density(x, types, cutoff, box, LUCY, masses)


def warren_density(x, types, cutoff, box) -> np.ndarray:
    """``rho_i = sum_{j != i} (15/(2 pi rd^3)) (1 - r/rd)^2``; every bead counts as 1."""
    return local_density(x, types, cutoff, box, WARREN)


# ---------------------------------------------------------------------------------- forces from densities


def mdpd_pair(x, v, rho, types, A, B, gamma, cut_A, cut_B, kT, box, dt, xi=None) -> Terms:
    """Forces of mDPD from given densities, as pair mdpd.

    With ``wA = 1 - r/cut_A``, ``wB = max(0, 1 - r/cut_B)``, ``sigma^2 = 2 kT gamma``, for ``r < cut_A``:
    ``F = [A wA + B (rho_i + rho_j) wB - gamma wA^2 (e.v_ij) + sigma wA xi/sqrt(dt)] e``; reported energy
    ``A cut_A wA^2/2 + B cut_B (rho_i + rho_j) wB^2/2``, which is not the potential of the force.

    Parameters
    ----------
    rho : (N,) densities, e.g. from `lucy_density` at the same x
    A, B, gamma, cut_A, cut_B : numbers or symmetric (T, T) matrices, ``cut_A >= cut_B``
    xi : symmetric (N, N) noise or None
    """
    n, root_dt = len(x), np.sqrt(dt)
    A, B, gamma, cut_A, cut_B = matrices(types, A, B, gamma, cut_A, cut_B)
    if np.any(cut_B > cut_A):
        raise ValueError("cut_A must not be smaller than cut_B")
    xi, sums = symmetric_noise(xi, n), TermSums(n)
    for i, j, a, b, r, e in ordered_pairs(x, types, cut_A, box):
        w_A, w_B = 1.0 - r / cut_A[a, b], max(0.0, 1.0 - r / cut_B[a, b])
        both = rho[i] + rho[j]
        C = A[a, b] * w_A + B[a, b] * both * w_B
        D = -gamma[a, b] * w_A**2 * float(np.dot(e, v[i] - v[j]))
        R = np.sqrt(2.0 * kT * gamma[a, b]) * w_A * xi[i, j] / root_dt
        energy = 0.5 * A[a, b] * cut_A[a, b] * w_A**2 + 0.5 * B[a, b] * cut_B[a, b] * both * w_B**2
        sums.add(i, r, e, (C, D, R), energy)
    return sums.terms()


class ManyBody(NamedTuple):
    """Energy per bead (N,) ``psi(rho_i)``, forces (N, 3) = -gradient of its sum, and virial (3, 3)."""

    energies: np.ndarray
    forces: np.ndarray
    virial_tensor: np.ndarray

    @property
    def energy(self) -> float:
        """``sum psi``."""
        return float(np.sum(self.energies))


def many_body(x, types, psi, slope, cutoff, box, kernel: Kernel = WARREN, masses=None, weight=1.0) -> ManyBody:
    """``U = sum_i psi(t_i, rho_i)`` and ``F_ij = -[psi'(t_i, rho_i) c_ab m_j + psi'(t_j, rho_j) c_ba m_i] w'(r) e``.

    The force is the gradient of U for any psi, kernel, weights (`local_density`) and symmetric cutoffs.

    Parameters
    ----------
    psi, slope : ``psi(type, rho)`` and ``d psi/d rho``
    """
    rho = local_density(x, types, cutoff, box, kernel, masses, weight)
    (cutoff,), weight = matrices(types, cutoff), _weights(types, weight)
    m = np.ones(len(x)) if masses is None else np.asarray(masses, dtype=float)
    energies = np.array([psi(int(t), float(d)) for t, d in zip(types, rho, strict=True)])
    slopes = np.array([slope(int(t), float(d)) for t, d in zip(types, rho, strict=True)])
    forces, tensor = np.zeros((len(x), 3)), np.zeros((3, 3))
    for i, j, a, b, r, e in ordered_pairs(x, types, cutoff, box):
        force = -(slopes[i] * weight[a, b] * m[j] + slopes[j] * weight[b, a] * m[i]) * kernel.slope(r, cutoff[a, b]) * e
        forces[i] += force
        tensor += 0.5 * np.outer(r * e, force)
    return ManyBody(energies, forces, tensor)


def warren_many_body(x, types, b, rd: float, box) -> ManyBody:
    """``psi_i = (pi rd^4/30) b_i rho_i^2`` with Warren's kernel: ``F = (b_i rho_i + b_j rho_j)(1 - r/rd) e``.

    Parameters
    ----------
    b : number or one number per type; the same for all types is Warren's model with B = b
    rd : one range for all pairs of types
    """
    b = np.broadcast_to(np.asarray(b, dtype=float), (int(np.max(types)) + 1,)) if np.ndim(b) == 0 else np.asarray(b, dtype=float)
    scale = np.pi * rd**4 / 30.0
    return many_body(x, types, lambda t, rho: scale * b[t] * rho**2, lambda t, rho: 2.0 * scale * b[t] * rho, rd, box)


def warren_pair(x, v, types, A, b, gamma, cut_A, rd: float, kT, box, dt, xi=None) -> Terms:
    """Warren's many-body DPD: ``F = [A wA - gamma wA^2 (e.v_ij) + sigma wA xi/sqrt(dt)] e`` + `warren_many_body`.

    The energy is the potential of the conservative force: ``sum A cut_A wA^2/2 + sum_i (pi rd^4/30) b_i rho_i^2``.
    Unlike in `mdpd_pair` rd may be larger than cut_A.
    """
    # mdpd_pair with B = 0 is plain DPD; any cut_B within cut_A will do
    plain = mdpd_pair(x, v, np.zeros(len(x)), types, A, 0.0, gamma, cut_A, float(np.min(cut_A)), kT, box, dt, xi)
    many = warren_many_body(x, types, b, rd, box)
    return Terms(
        plain.conservative + many.forces,
        plain.dissipative,
        plain.random,
        plain.energy + many.energy,
        plain.virial_conservative + many.virial_tensor,
        plain.virial_dissipative,
        plain.virial_random,
    )
