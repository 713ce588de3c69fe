"""Slow, obviously correct DPD in numpy: the answer that faster code has to reproduce.

Everything is written directly from the equations, as loops over pairs found by an O(N^2) search.

Conventions: ``r_ij = x_i - x_j`` (minimum image), ``v_ij = v_i - v_j``, ``e = r_ij/r``, ``F`` is the force
on i and ``F_j = -F``; every pair is visited once, as ``i < j``. ``w = 1 - r/rc``. Units are any consistent
set; temperatures enter and leave as energies ``kT``. Types are counted from 0. ``box`` is None, three edges
(3,), or a (3, 3) array whose rows are the vectors a, b, c of a lower-triangular cell.
"""

from __future__ import annotations

import itertools
from collections import namedtuple
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

Factor = Callable[[int, int], float]  # f(i, j): scales C and D by f, R by sqrt(f); 0 means no interaction
Noise = Callable[[int, int, int], float]  # noise(i, j, k), i < j: N(0,1); k = 0 radial, 1..3 transverse

R_MIN = 1e-10  # closer pairs have no direction and are left out
_IMAGES = np.array(list(itertools.product((-1, 0, 1), repeat=3)), dtype=float)


@dataclass(frozen=True)
class PairParams:
    """Symmetric (T, T) arrays. ``s`` is the exponent of the NOISE weight; drag goes as ``w**(2 s)``."""

    A: np.ndarray
    gamma: np.ndarray
    gamma_perp: np.ndarray
    s: np.ndarray
    s_perp: np.ndarray
    cutoff: np.ndarray

    def __post_init__(self) -> None:
        for name in ("A", "gamma", "gamma_perp", "s", "s_perp", "cutoff"):
            array = np.asarray(getattr(self, name), dtype=float)
            if array.ndim != 2 or not np.array_equal(array, array.T):
                raise ValueError(f"{name} must be a symmetric (T, T) array, not {array}")
            object.__setattr__(self, name, array)

    @classmethod
    def build(cls, n_types: int = 1, *, A=0.0, gamma=0.0, gamma_perp=0.0, s=1.0, s_perp=1.0, cutoff=1.0) -> PairParams:
        """Coefficients given as a number (the same for all pairs of types) or as a (T, T) array."""
        values = (A, gamma, gamma_perp, s, s_perp, cutoff)
        return cls(*(np.broadcast_to(np.asarray(a, dtype=float), (n_types, n_types)).copy() for a in values))


Pairs = namedtuple("Pairs", "i j r e")  # Pairs i < j with their distance r (P,) and unit vector e (P, 3) from j to i.
Conservative = namedtuple("Conservative", "energy forces virial laplacian virial_tensor")  # Result of `conservative`.
PairForces = namedtuple("PairForces", "forces virial virial_tensor")  # Result of `dissipative` and `random`.


# ------------------------------------------------------------------------------------------------- geometry
def minimum_image(dr: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """Shortest periodic image of the displacements ``dr`` (..., 3): near the origin, and then the best of all 27 images around it."""
    dr = np.asarray(dr, dtype=float)
    if box is None:
        return dr.copy()
    box = np.asarray(box, dtype=float)
    if box.shape == (3, 3) and not np.any(box - np.diag(np.diag(box))):
        box = np.diag(box)
    if box.shape == (3,):
        return dr - box * np.round(dr / box)
    if box.shape != (3, 3) or np.any(np.triu(box, 1)):
        raise ValueError("box must be None, (3,) edges or (3, 3) rows a, b, c of a lower-triangular cell")
    images = (dr - np.round(dr @ np.linalg.inv(box)) @ box)[..., None, :] + _IMAGES @ box
    best = np.argmin(np.sum(images**2, axis=-1), axis=-1)
    return np.take_along_axis(images, best[..., None, None], axis=-2)[..., 0, :]


def volume(box: np.ndarray) -> float:
    """Volume of a box given as edges or as rows."""
    box = np.asarray(box, dtype=float)
    return float(np.prod(box) if box.shape == (3,) else np.linalg.det(box))


def pair_list(x: np.ndarray, types: np.ndarray, params: PairParams, box: np.ndarray | None, least: float = R_MIN) -> Pairs:
    """All pairs with ``least <= r < cutoff[type_i, type_j]``, from a search over every i < j; a box that is too small is refused."""
    x, types = np.asarray(x, dtype=float), np.asarray(types)
    if box is not None:
        rows = np.asarray(box, dtype=float)
        rows = np.diag(rows) if rows.shape == (3,) else rows
        lengths = np.linalg.norm(_IMAGES @ rows, axis=1)
        if 2.0 * params.cutoff.max() > lengths[lengths > 0].min():
            raise ValueError(f"cutoff {params.cutoff.max()} is more than half of the box {box}")
    i, j = np.triu_indices(len(x), k=1)
    dr = minimum_image(x[i] - x[j], box)
    r = np.sqrt(np.sum(dr**2, axis=1))
    keep = (r >= least) & (r < params.cutoff[types[i], types[j]])
    i, j, r, dr = i[keep], j[keep], r[keep], dr[keep]
    return Pairs(i, j, r, dr / np.maximum(r, 1e-300)[:, None])


def in_order(x: np.ndarray, order: Iterable, box: np.ndarray | None) -> Iterable[tuple[int, int, np.ndarray]]:
    """Pairs (i, j) with the displacement from j to i."""
    i, j = np.array(list(order), int).reshape(-1, 2).T
    return zip(i.tolist(), j.tolist(), minimum_image(x[i] - x[j], box), strict=True)


def _scaled_pairs(x, types, params, box, factor):
    """Yield (i, j, type_i, type_j, r, e, f) of the pairs that interact (f != 0)."""
    for i, j, r, e in zip(*pair_list(x, types, params, box), strict=True):
        f = 1.0 if factor is None else float(factor(int(i), int(j)))
        if f != 0.0:
            yield int(i), int(j), types[i], types[j], float(r), e, f


# ---------------------------------------------------------------------------------------------- pair forces
def conservative(x, types, params: PairParams, box=None, factor: Factor | None = None) -> Conservative:
    """Soft repulsion ``U = f A rc w^2 / 2``, ``F = f A w e``.

    ``virial = sum r_ij . F``, ``virial_tensor[a, b] = sum r_ij[a] F[b]``, and the Laplacian
    ``sum_i lap_i U = sum over pairs 2 (u'' + 2 u'/r)`` with ``u' = -f A w``, ``u'' = f A/rc``.
    """
    energy, laplacian, forces, tensor = 0.0, 0.0, np.zeros_like(x, dtype=float), np.zeros((3, 3))
    for i, j, a, b, r, e, f in _scaled_pairs(x, types, params, box, factor):
        A, rc = f * params.A[a, b], params.cutoff[a, b]
        w = 1.0 - r / rc
        force = A * w * e
        energy += 0.5 * A * rc * w**2
        forces[i] += force
        forces[j] -= force
        tensor += np.outer(r * e, force)
        laplacian += 2.0 * (A / rc - 2.0 * A * w / r)
    return Conservative(energy, forces, float(np.trace(tensor)), laplacian, tensor)


def dissipative(x, v, types, params: PairParams, box=None, factor: Factor | None = None) -> PairForces:
    """Drag ``F = -f gamma w^(2s) (e.v_ij) e - f gamma_perp w^(2 s_perp) P v_ij``, ``P = 1 - e e^T``."""
    forces, tensor = np.zeros_like(x, dtype=float), np.zeros((3, 3))
    for i, j, a, b, r, e, f in _scaled_pairs(x, types, params, box, factor):
        w = 1.0 - r / params.cutoff[a, b]
        v_ij = v[i] - v[j]
        radial = np.dot(e, v_ij) * e
        force = -f * params.gamma[a, b] * w ** (2.0 * params.s[a, b]) * radial
        force = force - f * params.gamma_perp[a, b] * w ** (2.0 * params.s_perp[a, b]) * (v_ij - radial)
        forces[i] += force
        forces[j] -= force
        tensor += np.outer(r * e, force)
    return PairForces(forces, float(np.trace(tensor)), tensor)


def random(x, types, params: PairParams, box, kT: float, dt: float, noise: Noise, factor: Factor | None = None) -> PairForces:
    """Noise ``F = sqrt(f/dt) [sigma w^s z0 e + sigma_perp w^s_perp P (z1, z2, z3)]``, sigma^2 = 2kT gamma."""
    forces, tensor = np.zeros_like(x, dtype=float), np.zeros((3, 3))
    for i, j, a, b, r, e, f in _scaled_pairs(x, types, params, box, factor):
        w = 1.0 - r / params.cutoff[a, b]
        sigma = np.sqrt(2.0 * kT * params.gamma[a, b])
        sigma_perp = np.sqrt(2.0 * kT * params.gamma_perp[a, b])
        z = np.array([noise(i, j, k) for k in (1, 2, 3)])
        force = sigma * w ** params.s[a, b] * noise(i, j, 0) * e
        force = force + sigma_perp * w ** params.s_perp[a, b] * (z - np.dot(e, z) * e)
        force = force * np.sqrt(f / dt)
        forces[i] += force
        forces[j] -= force
        tensor += np.outer(r * e, force)
    return PairForces(forces, float(np.trace(tensor)), tensor)


# ----------------------------------------------------------------------------- velocity updates of one pair
def _check_transverse(g_perp: float, kT: float, z_perp) -> np.ndarray:
    if z_perp is None:
        if g_perp != 0.0 and kT != 0.0:
            raise ValueError("transverse friction at kT > 0 needs a transverse noise vector")
        return np.zeros(3)
    return np.asarray(z_perp, dtype=float)


def ou_update(v_i, v_j, e, inv_m_i, inv_m_j, g_par, g_perp, kT, dt, z_par, z_perp=None):
    """Exact Ornstein-Uhlenbeck update of the relative velocity of one pair over dt.

    With ``m = 1/m_i + 1/m_j`` each component u of v_ij obeys ``du = -g m u dt + sqrt(2 kT g) m dW``, hence
    ``u' = c u + sqrt((1 - c^2) kT m) z``, ``c = exp(-g m dt)``. ``g_par``, ``g_perp`` are full frictions
    (weight and special factor included), ``z_perp`` is a 3-vector of N(0,1) that is projected on the plane
    perpendicular to e. An inverse mass of 0 marks an immovable bead.

    Returns
    -------
    v_i, v_j : updated copies; ``m_i v_i + m_j v_j`` is unchanged.
    """
    inv_m = inv_m_i + inv_m_j
    z_perp = _check_transverse(g_perp, kT, z_perp)
    if inv_m == 0.0:
        return np.array(v_i, dtype=float), np.array(v_j, dtype=float)
    v_ij = np.asarray(v_i, dtype=float) - v_j
    u_par = np.dot(e, v_ij)
    u_perp = v_ij - u_par * e
    c_par, c_perp = np.exp(-g_par * inv_m * dt), np.exp(-g_perp * inv_m * dt)
    # 1 - c^2 = -expm1(-2 g m dt), written so that it keeps its digits for weak friction
    new_par = c_par * u_par + np.sqrt(-np.expm1(-2.0 * g_par * inv_m * dt) * kT * inv_m) * z_par
    noise_perp = z_perp - np.dot(e, z_perp) * e
    new_perp = c_perp * u_perp + np.sqrt(-np.expm1(-2.0 * g_perp * inv_m * dt) * kT * inv_m) * noise_perp
    impulse = ((new_par - u_par) * e + new_perp - u_perp) / inv_m
    return v_i + inv_m_i * impulse, v_j - inv_m_j * impulse


def shardlow_update(v_i, v_j, e, inv_m_i, inv_m_j, g_par, g_perp, kT, dt, z_par, z_perp=None):
    """Shardlow's explicit half, then implicit half with the same noise. Arguments and result as `ou_update`.

    ``G = g dt/2``, ``S = sqrt(2 kT g dt) z/2``; explicit ``a = S - G u``; implicit
    ``b = (S - G u')/(1 + m G)`` with u' the relative velocity after the explicit half. The transverse part is
    the same, normal to e.
    """
    inv_m = inv_m_i + inv_m_j
    z_perp = _check_transverse(g_perp, kT, z_perp)
    G, G_perp = 0.5 * g_par * dt, 0.5 * g_perp * dt
    S = 0.5 * np.sqrt(2.0 * kT * g_par * dt) * z_par
    S_perp = 0.5 * np.sqrt(2.0 * kT * g_perp * dt) * (z_perp - np.dot(e, z_perp) * e)

    v_ij = np.asarray(v_i, dtype=float) - v_j
    u = np.dot(e, v_ij)
    impulse = (S - G * u) * e + S_perp - G_perp * (v_ij - u * e)
    v_i, v_j = v_i + inv_m_i * impulse, v_j - inv_m_j * impulse

    v_ij = v_i - v_j
    u = np.dot(e, v_ij)
    impulse = (S - G * u) / (1.0 + inv_m * G) * e
    impulse = impulse + (S_perp - G_perp * (v_ij - u * e)) / (1.0 + inv_m * G_perp)
    return v_i + inv_m_i * impulse, v_j - inv_m_j * impulse


# ----------------------------------------------------------------------------------------- sweeps and steps
def sweep(
    x, v, order: Iterable[tuple[int, int]], inv_m, types, params: PairParams, box, kT, dt,
    noise: Noise | None, update=ou_update, factor: Factor | None = None,
) -> np.ndarray:  # fmt: skip
    """Update the pairs of ``order`` one after the other at fixed x and return the new velocities.

    ``order`` may contain pairs that do not interact; they are passed over. (j, i) means the same as (i, j):
    the noise is asked for as (smaller, larger), its transverse vector acts on the smaller index. Frictions
    are scaled by f, which scales the noise by sqrt(f). ``noise`` may be None when kT = 0.
    """
    x, v = np.asarray(x, dtype=float), np.array(v, dtype=float)
    for i, j, dr in in_order(x, map(sorted, order), box):
        r = np.sqrt(np.dot(dr, dr))
        a, b = types[i], types[j]
        f = 1.0 if factor is None else float(factor(i, j))
        if r < R_MIN or r >= params.cutoff[a, b] or f == 0.0:
            continue
        w = 1.0 - r / params.cutoff[a, b]
        g_par = f * params.gamma[a, b] * w ** (2.0 * params.s[a, b])
        g_perp = f * params.gamma_perp[a, b] * w ** (2.0 * params.s_perp[a, b])
        z = [0.0] * 4 if kT == 0.0 else [noise(i, j, k) for k in range(4)]
        v[i], v[j] = update(v[i], v[j], dr / r, inv_m[i], inv_m[j], g_par, g_perp, kT, dt, z[0], z[1:])
    return v


# The steps take conservative_force(x), force(x, v) and sweep_at(x, v) -> v (a `sweep` over dt with its order
# and noise bound), so that another implementation can be handed the same noise and order. A bead with inverse
# mass 0 keeps its velocity.


def mvv_step(x, v, f, inv_m, dt, lam, force):
    """Modified velocity Verlet; f = force of the last step, noise included; ``force(x, v)`` is C + D + R."""
    inv_m = np.asarray(inv_m)[:, None]
    v_half = v + 0.5 * dt * inv_m * f
    x = x + dt * v_half
    f = force(x, v + lam * dt * inv_m * f)
    return x, v_half + 0.5 * dt * inv_m * f, f


def shardlow_step(x, v, f, inv_m, dt, conservative_force, sweep_at):
    """One sweep at x(t), then velocity Verlet with the conservative force; f = conservative_force(x(t))."""
    inv_m = np.asarray(inv_m)[:, None]
    v = sweep_at(x, v)
    v_half = v + 0.5 * dt * inv_m * f
    x = x + dt * v_half
    f = conservative_force(x)
    return x, v_half + 0.5 * dt * inv_m * f, f


def word_step(word, x, v, inv_m, dt, conservative_force, sweep_at):
    """Kicks B, drifts A and the sweep O of a word, with their parts of the step; forces are those of the last drift."""
    f = None
    for letter, part in word:
        if letter == "A":
            x, f = x + part * dt * v, None
        elif letter == "B":
            f = conservative_force(x) if f is None else f
            v = v + part * dt * np.asarray(inv_m)[:, None] * f
        else:
            v = sweep_at(x, v)
    return x, v


middle_step = partial(word_step, [("B", 1.0), ("A", 0.5), ("O", 1.0), ("A", 0.5)])
aboba_step = partial(word_step, [("A", 0.5), ("B", 0.5), ("O", 1.0), ("B", 0.5), ("A", 0.5)])
bababo_step = partial(word_step, [("B", 0.2), ("A", 0.5), ("B", 0.6), ("A", 0.5), ("B", 0.2), ("O", 1.0)])


def pressure(m, v, virial: float, box) -> float:
    """P = (sum m v^2 + virial) / (3 V), virial = sum r_ij . F."""
    return float((np.sum(np.asarray(m)[:, None] * np.asarray(v) ** 2) + virial) / (3.0 * volume(box)))
