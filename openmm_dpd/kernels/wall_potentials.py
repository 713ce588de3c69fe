"""Potentials of walls, whose energy need not be 0 at their cutoffs."""

from collections.abc import Callable

import numpy as np


def _powers(r: np.ndarray, epsilon: float, sigma: float, *terms: tuple[float, int]) -> tuple[np.ndarray, np.ndarray]:
    """Energy and force of a sum of c epsilon (sigma/r)^n."""
    parts = [(epsilon * c * (sigma / r) ** n, n) for c, n in terms]
    return sum(part for part, _ in parts), sum(n * part / r for part, n in parts)  # type: ignore[return-value]


def _lj1043(r: np.ndarray, epsilon: float, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    energy, force = _powers(r, 2 * np.pi * epsilon, sigma, (0.4, 10), (-1.0, 4))
    behind = r + 0.61 / np.sqrt(2.0) * sigma
    third = 2 * np.pi * epsilon * np.sqrt(2.0) / 3.0 * sigma**3 / behind**3
    return energy - third, force - 3.0 * third / behind


def _morse(r: np.ndarray, depth: float, alpha: float, r0: float) -> tuple[np.ndarray, np.ndarray]:
    e = np.exp(-alpha * (r - r0))
    return depth * (e * e - 2 * e), 2 * depth * alpha * (e * e - e)


#: Energy and force at a distance r from a wall, by style; the cutoff comes last.
WALLS: dict[str, Callable[..., tuple[np.ndarray, np.ndarray]]] = {
    "lj93": lambda r, epsilon, sigma, cutoff: _powers(r, epsilon, sigma, (2 / 15, 9), (-1.0, 3)),
    "lj126": lambda r, epsilon, sigma, cutoff: _powers(r, epsilon, sigma, (4.0, 12), (-4.0, 6)),
    "lj1043": lambda r, epsilon, sigma, cutoff: _lj1043(r, epsilon, sigma),
    "harmonic": lambda r, epsilon, sigma, cutoff: (epsilon * (cutoff - r) ** 2, 2 * epsilon * (cutoff - r)),
    "morse": lambda r, depth, alpha, r0, cutoff: _morse(r, depth, alpha, r0),
}
