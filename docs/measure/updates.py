"""What the updates of pairs do to a fluid at rest: do they mix, and how far do beads and momentum get?

Beads of the standard fluid (density 3, A = 25) stay where they are and move on paper only: a sweep is then one matrix Q for all velocities.
Printed for the exact update O, Shardlow's S, the midpoint of all pairs at once ("joint", which needs a solution of all equations) and the
exact flow of all pairs ("flow"):

- ``turned``: the largest negative eigenvalue, which is how much of a velocity comes back reversed after each sweep, beside that of the
  nearest pair of beads by itself;
- ``D``: dt/2 tr[(1 + Q)(1 - Q)^+]/3N, the diffusion of beads that drift in straight lines between sweeps, over its limit of short steps;
- ``viscosity``: the same for the momentum that they carry: rho kT dt (C(0)/2 + C(1) + C(2) + ...), C the autocorrelation of sum v_x v_y.

    python docs/measure/updates.py           # two minutes of one core
"""

from __future__ import annotations

import argparse

import numpy as np
from openmm import unit
from scipy.linalg import expm

import openmm_dpd as dpd

DENSITY, EDGE = 3.0, 4.0
#: gamma dt that is taken for the limit.
SHORT = 0.4


class Frozen:
    """A configuration of the standard fluid: pairs in a random order, weights, directions."""

    def __init__(self, seed: int = 1):
        self.n = round(DENSITY * EDGE**3)
        rng = np.random.default_rng(seed)
        pairs = {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
        scene = dpd.Scene({"W": 1.0}, ["W"] * self.n, rng.random((self.n, 3)) * EDGE, pairs, kT=1, box=[EDGE] * 3)
        simulation = dpd.build(scene, dt=0.03, platform="CPU", seed=seed).simulation()
        simulation.step(2000)
        x = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        apart = x[:, None] - x[None]
        apart -= EDGE * np.round(apart / EDGE)
        r = np.linalg.norm(apart, axis=2)
        i, j = np.nonzero(np.triu(r < 1, 1))
        order = rng.permutation(len(i))
        self.i, self.j = i[order], j[order]
        self.e, self.w = apart[self.i, self.j] / r[self.i, self.j][:, None], 1 - r[self.i, self.j]
        self.friction = np.zeros((3 * self.n, 3 * self.n))
        for a, b, e, w in zip(self.i, self.j, self.e, self.w, strict=True):
            across = np.zeros((self.n, 3))
            across[a], across[b] = e, -e
            self.friction += w * w * np.outer(across, across)

    def sweep(self, update: str, gdt: float) -> np.ndarray:
        """(3N, 3N) matrix of a sweep; ``gdt`` is gamma dt/m."""
        one = np.eye(3 * self.n)
        if update == "joint":
            return np.linalg.solve(one + gdt / 2 * self.friction, one - gdt / 2 * self.friction)
        if update == "flow":
            return expm(-gdt * self.friction)
        x, q = 2 * gdt * self.w**2, one.reshape(self.n, 3, 3 * self.n)
        for a, b, e, lost in zip(self.i, self.j, self.e, factor_lost(update, x) / 2, strict=True):
            impulse = lost * (e @ (q[a] - q[b]))
            q[a] -= np.outer(e, impulse)
            q[b] += np.outer(e, impulse)
        return q.reshape(3 * self.n, 3 * self.n)

    def turned(self, q: np.ndarray) -> float:
        """The largest negative eigenvalue."""
        values = np.linalg.eigvals(q)
        return float(np.abs(values[values.real < 0]).max(initial=0.0))

    def transport(self, q: np.ndarray, dt: float) -> tuple[float, float]:
        """Diffusion and kinetic viscosity at m = kT = 1."""
        one, n = np.eye(3 * self.n), self.n
        rest = one - np.kron(np.ones((n, n)) / n, np.eye(3))  # all but the motion of the whole
        diffusion = dt / 2 * np.trace((one + q) @ np.linalg.pinv(one - q) @ rest) / (3 * n)
        total, power, first = 0.0, rest, 0.0
        for k in range(4000):
            t, now = power.reshape(n, 3, n, 3), 0.0
            for a, b in ((0, 1), (0, 2), (1, 2)):
                now += float(np.sum(t[:, a, :, a] * t[:, b, :, b] + t[:, a, :, b] * t[:, b, :, a])) / (3 * n)
            first = first or now
            total += dt * (0.5 if k == 0 else 1.0) * now
            if now < 1e-4 * first:
                break
            power = q @ power
        return diffusion, DENSITY * total


def factor_lost(update: str, x: np.ndarray) -> np.ndarray:
    """1 - q of a pair."""
    return 1 - np.exp(-x) if update == "O" else x / (1 + x / 2)


def main() -> None:
    """Two tables."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    fluid = Frozen()
    print("| friction | dt | nearest pair, S | turned by S | turned by O |\n| --- | --- | --- | --- | --- |")
    for gamma in (40.5, 135.0, 450.0):
        for dt in (0.03, 0.06, 0.12):
            alone = 1 - factor_lost("S", 2 * gamma * dt * fluid.w.max() ** 2)
            s, o = (fluid.turned(fluid.sweep(update, gamma * dt)) for update in "SO")
            print(f"| {gamma:g} | {dt:g} | {alone:+.2f} | {-s:+.2f} | {-o:+.2f} |", flush=True)
    print("\n| gamma dt | update | D | viscosity, kinetic |\n| --- | --- | --- | --- |")
    limit = fluid.transport(fluid.sweep("joint", SHORT), SHORT / 40.5)
    for gdt in (1.215, 2.43, 4.86):
        for update in ("flow", "joint", "O", "S"):
            found = fluid.transport(fluid.sweep(update, gdt), gdt / 40.5)
            off = " | ".join(f"{100 * (value / short - 1):+.1f} %" for value, short in zip(found, limit, strict=True))
            print(f"| {gdt:g} | {update} | {off} |", flush=True)
    print(f"\nkinetic viscosity of the limit at friction 40.5: {limit[1]:.3f}")


if __name__ == "__main__":
    main()
