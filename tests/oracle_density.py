"""Beads whose energy depends on a local density (mDPD), slowly and plainly: what faster code has to reproduce.

Conventions are those of `oracle_energy`: loops over ordered pairs, symmetric (T, T) coefficients, explicit noise.
"""

from collections import namedtuple

import numpy as np
from oracle_energy import Terms, TermSums, matrices, ordered_pairs, symmetric_noise

# ------------------------------------------------------------------------------------------------ kernels


# Density kernel ``w(r, h)`` and its slope ``dw/dr``; both are only asked for r < h, integral over space 1.
Kernel = namedtuple("Kernel", "w slope")


LUCY = Kernel(  # (105/(16 pi h^3)) (1 + 3 r/h)(1 - r/h)^3 and its slope -(315/(4 pi h^5)) r (1 - r/h)^2
    lambda r, h: 105.0 / (16.0 * np.pi * h**3) * (1.0 + 3.0 * r / h) * (1.0 - r / h) ** 3,
    lambda r, h: -315.0 / (4.0 * np.pi * h**5) * r * (1.0 - r / h) ** 2,
)
# (15/(2 pi h^3)) (1 - r/h)^2 and its slope -(15/(pi h^4)) (1 - r/h)
WARREN = Kernel(lambda r, h: 15.0 / (2.0 * np.pi * h**3) * (1.0 - r / h) ** 2, lambda r, h: -15.0 / (np.pi * h**4) * (1.0 - r / h))


def local_density(x, types, cutoff, box, kernel: Kernel = WARREN, masses=None) -> np.ndarray:
    """``rho_i = sum_{j != i, r < h} m_j w(r, h)`` (N,), h the cutoff of the pair of types; no self term, but beads at
    the same point count; masses None counts beads."""
    (cutoff,) = matrices(types, cutoff)
    masses = np.ones(len(x)) if masses is None else np.asarray(masses, dtype=float)
    rho = np.zeros(len(x))
    for i, j, a, b, r, _ in ordered_pairs(x, types, cutoff, box, 0.0):
        rho[i] += masses[j] * kernel.w(r, cutoff[a, b])
    return rho


# ---------------------------------------------------------------------------------- forces from densities
def mdpd_pair(x, v, rho, types, A, B, gamma, cut_A, cut_B, kT, box, dt, xi=None) -> Terms:
    """Forces of mDPD from given densities, as pair mdpd.

    With ``wA = 1 - r/cut_A``, ``wB = max(0, 1 - r/cut_B)``, ``sigma^2 = 2 kT gamma``, for ``r < cut_A``:
    ``F = [A wA + B (rho_i + rho_j) wB - gamma wA^2 (e.v_ij) + sigma wA xi/sqrt(dt)] e``; reported energy
    ``A cut_A wA^2/2 + B cut_B (rho_i + rho_j) wB^2/2``, which is not the potential of the force.

    Parameters
    ----------
    rho : (N,) densities, from `local_density` at the same x
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
