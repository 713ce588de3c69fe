"""Lattice sums of smeared charges in numpy: exact structure factors and explicit images, independent of the package."""

import math

import numpy as np
from scipy.special import erfc


def slater_tail(r, lamda):
    """1 - (smeared energy over point energy), and the same of the force."""
    y = 2 * np.asarray(r) / lamda
    return (1 + y / 2) * np.exp(-y), (1 + y + y * y / 2) * np.exp(-y)


def gaussian_tail(r, width):
    """The same for Gaussian clouds of the standard deviation ``width``."""
    t = np.asarray(r) / (2 * width)
    e = erfc(t)
    return e, e + 2 / math.sqrt(math.pi) * t * np.exp(-t * t)


def lattice_sum(x, q, box, tail, width, *, alpha=None, accuracy=12.0):
    """Energy, forces and virial (-dE/dlnL at fixed width) of charges with all their images, Coulomb constant 1.

    Parameters
    ----------
    x, q : (N, 3) and (N,) arrays
    box : (3, 3) array of rows
    tail, width : function and its argument
        :func:`slater_tail` or :func:`gaussian_tail`, and the width of the clouds.
    alpha : float, optional
        Splitting parameter; the result does not depend on it.
    accuracy : float
        Exponents down to exp(-accuracy^2/4) or so are kept.
    """
    x, q, box = np.asarray(x, float), np.asarray(q, float), np.asarray(box, float)
    volume = abs(np.linalg.det(box))
    alpha = alpha or 6.0 / np.diag(box).min()
    r_max = max(accuracy / 2 / alpha, 20 * width)
    energy = -alpha / math.sqrt(math.pi) * np.sum(q**2) - math.pi * q.sum() ** 2 / (2 * volume * alpha**2)
    virial = -3 * math.pi * q.sum() ** 2 / (2 * volume * alpha**2)
    forces = np.zeros_like(x)
    reach = [math.ceil(r_max / h) + 1 for h in volume / np.linalg.norm(np.cross(np.roll(box, -1, 0), np.roll(box, -2, 0)), axis=1)]
    images = np.array(np.meshgrid(*[np.arange(-n, n + 1) for n in reach], indexing="ij")).reshape(3, -1).T @ box
    d = x[:, None] - x[None]
    frac = np.linalg.solve(box.T, d.reshape(-1, 3).T).T
    d = (d.reshape(-1, 3) - np.round(frac) @ box).reshape(d.shape)
    qq = np.outer(q, q)
    for shift in images:
        v = d + shift
        r = np.linalg.norm(v, axis=2)
        if not np.any(shift):
            np.fill_diagonal(r, np.inf)
        use = r < r_max
        r = np.where(use, np.maximum(r, 1e-7), 1.0)  # charges at the same point: the vector makes the force 0
        te, tf = tail(r, width)
        t = alpha * r
        e = np.where(use, qq * (erfc(t) - te) / r, 0.0)
        f = np.where(use, qq * (erfc(t) + 2 / math.sqrt(math.pi) * t * np.exp(-t * t) - tf) / r**3, 0.0)
        energy += 0.5 * e.sum()
        virial += 0.5 * float(np.sum(f * r * r))
        forces += np.sum(f[..., None] * v, axis=1)
    k_max = accuracy * alpha
    inverse = 2 * math.pi * np.linalg.inv(box).T
    counts = [math.ceil(k_max / (2 * math.pi) * np.linalg.norm(row)) for row in box]
    n = np.array(np.meshgrid(*[np.arange(-c, c + 1) for c in counts], indexing="ij")).reshape(3, -1).T
    k = n @ inverse
    k2 = np.sum(k * k, axis=1)
    k = k[(k2 > 0) & (k2 < k_max**2)]
    for part in np.array_split(k, max(1, len(k) * len(x) // 2_000_000)):
        k2 = np.sum(part * part, axis=1)
        phase = part @ x.T
        s = np.exp(1j * phase) @ q
        weight = 2 * math.pi / volume * np.exp(-k2 / (4 * alpha**2)) / k2
        energy += float(weight @ np.abs(s) ** 2)
        # d ln(weight)/dlnL at fixed alpha: -3 from the volume, +2 from k^2, k^2/(2 alpha^2) from the exponential
        virial += float(np.sum(weight * np.abs(s) ** 2 * (1 - k2 / (2 * alpha**2))))
        pull = 2 * weight[:, None] * np.imag(np.conj(s)[:, None] * np.exp(1j * phase)) * q
        forces += pull.T @ part
    return energy, forces, virial
