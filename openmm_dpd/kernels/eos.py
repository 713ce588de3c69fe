"""Equations of state for kernels: 1/theta, its slope, and the entropy, of a bead with a given internal energy.

A bead has a constant heat capacity C (u = C theta), or a curve 1/theta(u) of cubic pieces, or it is a reservoir: an immobile bead whose
theta stays as it is.  Entropies are in units of k_B, thetas are thermal energies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime import compiled, helper, inlined, merged

#: Entries of ``curve`` for beads without one.
CONSTANT, RESERVOIR = -1, -2


@dataclass(frozen=True, eq=False)
class EOSTable:
    """Equation of state of each bead."""

    capacity: np.ndarray  #: (N,) heat capacity; theta for a reservoir; unused for a curve
    curve: np.ndarray  #: (N,) int32 CONSTANT, RESERVOIR, or the number of the curve
    start: np.ndarray  #: (C + 1,) first node of each curve
    nodes: np.ndarray  #: (P,) energies at the nodes, all curves one after the other
    pieces: np.ndarray  # (P, 5) per interval: cubic coefficients of 1/theta, highest power first, and the entropy at its left end

    def of(self, beads: np.ndarray) -> EOSTable:
        """The table for a choice of beads."""
        return EOSTable(self.capacity[beads], self.curve[beads], self.start, self.nodes, self.pieces)

    @property
    def curves(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What :func:`inverse_temperature` reads beside the bead's own two numbers."""
        return self.start, self.nodes, self.pieces

    def thetas(self, u: np.ndarray) -> np.ndarray:
        """(N,) thetas at the internal energies u; NaN out of range."""
        return _thetas(self.capacity, self.curve, *self.curves, np.ascontiguousarray(u))


@inlined
def in_range(u, capacity, curve, start, nodes):
    """Whether there is a theta for the energy u."""
    if curve == CONSTANT:
        return u > 0.0
    if curve == RESERVOIR:
        return True
    return nodes[start[curve]] <= u <= nodes[start[curve + 1] - 1]


@helper
def _piece(u, curve, start, nodes):
    """Interval of the curve that holds u, and the distance from its left end."""
    low, high = start[curve], start[curve + 1] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[middle] <= u:
            low = middle
        else:
            high = middle
    return low, u - nodes[low]


@helper
def inverse_temperature(u, capacity, curve, start, nodes, pieces):
    """1/theta; the energy is taken to the nearest end if it is out of range (constant capacity: NaN)."""
    if curve == CONSTANT:
        return capacity / u if u > 0.0 else np.nan
    if curve == RESERVOIR:
        return 1.0 / capacity
    u = min(max(u, nodes[start[curve]]), nodes[start[curve + 1] - 1])
    k, d = _piece(u, curve, start, nodes)
    return ((pieces[k, 0] * d + pieces[k, 1]) * d + pieces[k, 2]) * d + pieces[k, 3]


@helper
def curvature(u, capacity, curve, start, nodes, pieces):
    """-d(1/theta)/du >= 0: minus the second derivative of the entropy."""
    if curve == CONSTANT:
        return capacity / (u * u)
    if curve == RESERVOIR:
        return 0.0
    u = min(max(u, nodes[start[curve]]), nodes[start[curve + 1] - 1])
    k, d = _piece(u, curve, start, nodes)
    return -((3.0 * pieces[k, 0] * d + 2.0 * pieces[k, 1]) * d + pieces[k, 2])


@inlined
def _artanh_over(s):
    """artanh(s)/s by nine terms, in parts that the processor works on side by side."""
    s2 = s * s
    s4 = s2 * s2
    high = (1.0 / 9.0 + s2 * (1.0 / 11.0)) + s4 * ((1.0 / 13.0 + s2 * (1.0 / 15.0)) + s4 * (1.0 / 17.0))
    return ((1.0 + s2 * (1.0 / 3.0)) + s4 * (1.0 / 5.0 + s2 * (1.0 / 7.0))) + (s4 * s4) * high


@inlined
def near_log_ratio(a, b):
    """ln(a/b) of numbers that differ by a fifth at most; no number for others."""
    s = (a - b) / (a + b)
    return 2.0 * s * _artanh_over(s) if abs(s) <= 0.1 else np.nan


@merged
def log_ratio(a, b):
    """ln(a/b) of positive numbers to 1e-14, with fewer divisions than log(a/b): 2 artanh((a - b)/(a + b)), of a root of a/b where that is
    far from 1."""
    s, power = (a - b) / (a + b), 2.0
    if abs(s) > 0.1:
        t = a / b
        while abs(t - 1.0) > 0.2:
            t, power = np.sqrt(t), 2.0 * power
        s = (t - 1.0) / (t + 1.0)
    return power * s * _artanh_over(s)


@helper
def entropy_change(u, new, capacity, curve, start, nodes, pieces):
    """S(new) - S(u), both in range."""
    if curve == CONSTANT:
        return capacity * log_ratio(new, u)
    if curve == RESERVOIR:
        return (new - u) / capacity
    total = 0.0
    for sign, value in ((1.0, new), (-1.0, u)):
        k, d = _piece(value, curve, start, nodes)
        inner = ((0.25 * pieces[k, 0] * d + pieces[k, 1] / 3.0) * d + 0.5 * pieces[k, 2]) * d + pieces[k, 3]
        total += sign * (pieces[k, 4] + inner * d)
    return total


@compiled
def _thetas(capacity, curve, start, nodes, pieces, u):
    theta = np.empty(len(u))
    for i in range(len(u)):
        theta[i] = np.nan
        if in_range(u[i], capacity[i], curve[i], start, nodes):
            theta[i] = 1.0 / inverse_temperature(u[i], capacity[i], curve[i], start, nodes, pieces)
    return theta
