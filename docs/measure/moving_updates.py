"""Diffusion and viscosity with updates of pairs that the package does not have, in the moving fluid (docs/measure/updates.py: at rest).

- ``O``, ``S``: the exact update and Shardlow's, pair by pair, as in the package;
- ``J``: the midpoint of all pairs at once, (1 + L dt/2) v' = (1 - L dt/2) v + noise, by conjugate gradients;
- ``W``: Shardlow's with the friction of a bead's surroundings: x = 2 gamma w^2 dt (1 + 0.1 l), l = gamma dt/3 ((s_i + s_j)/2 - w^2), s_i the
  sum of w^2 over the neighbours of i.

1,000 beads, driven as in benchmarks/transport.py; errors are those beside its limits of short steps.  Prints the table of docs/atlas.md
("Other updates").

    python docs/measure/moving_updates.py           # ten minutes of one core
    python docs/measure/moving_updates.py --time 300
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from numba import njit

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

import orders  # noqa: E402
from transport import BEADS, SPEED  # noqa: E402
from transport_table import DENSITY, EVERY, amplitude, coefficients  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.stats import ratio_average  # noqa: E402

#: Friction, word of one force and step, word of two forces and step.
RUNS = ((40.5, "B A/2 {} A/2", 0.5 / 6), (40.5, "B/5 A/2 3B/5 A/2 B/5 {}", 0.125), (135.0, "B A/2 {} A/2", 0.0625))
#: Residual of the joint midpoint beside its right-hand side.
SMALL = 1e-8


@njit
def times_friction(v, first, second, e, w2):
    """The sum over pairs of w^2 e (e.v), on both beads."""
    out = np.zeros_like(v)
    for n in range(len(first)):
        i, j = first[n], second[n]
        along = w2[n] * (e[n, 0] * (v[i, 0] - v[j, 0]) + e[n, 1] * (v[i, 1] - v[j, 1]) + e[n, 2] * (v[i, 2] - v[j, 2]))
        for a in range(3):
            out[i, a] += along * e[n, a]
            out[j, a] -= along * e[n, a]
    return out


@njit
def joint(v, first, second, e, r, gamma, dt, rng):
    """The midpoint of all pairs at once; Maxwell's distribution stays as it is for any step."""
    w2 = (1 - r) ** 2
    right = v - 0.5 * gamma * dt * times_friction(v, first, second, e, w2)
    for n in range(len(first)):
        push = np.sqrt(2 * gamma * dt * w2[n]) * rng.normal()
        for a in range(3):
            right[first[n], a] += push * e[n, a]
            right[second[n], a] -= push * e[n, a]
    new = v.copy()
    rest = right - new - 0.5 * gamma * dt * times_friction(new, first, second, e, w2)
    way, size, bound = rest.copy(), np.sum(rest * rest), SMALL**2 * np.sum(right * right)
    while size > bound:
        moved = way + 0.5 * gamma * dt * times_friction(way, first, second, e, w2)
        part = size / np.sum(way * moved)
        new += part * way
        rest -= part * moved
        before, size = size, np.sum(rest * rest)
        way = rest + size / before * way
    v[:] = new


@njit
def shardlow(v, first, second, e, r, gamma, dt, rng, rescaled):
    """Pair after pair, relative velocities times q = (1 - x/2)/(1 + x/2) and noise for the rest."""
    around = np.zeros(len(v))
    for n in range(len(first)):
        around[first[n]] += (1 - r[n]) ** 2
        around[second[n]] += (1 - r[n]) ** 2
    for n in range(len(first)):
        i, j, w2 = first[n], second[n], (1 - r[n]) ** 2
        x = 2 * gamma * w2 * dt * (1 + (0.1 * gamma * dt / 3 * (0.5 * (around[i] + around[j]) - w2) if rescaled else 0.0))
        q = (1 - x / 2) / (1 + x / 2)
        ev = np.dot(e[n], v[i] - v[j])
        change = 0.5 * ((q - 1) * ev + np.sqrt(2 * (1 - q * q)) * rng.normal())
        v[i] += change * e[n]
        v[j] -= change * e[n]


class Driven(orders.Fluid):
    """The standard fluid, pushed along x by a sine of z."""

    def __init__(self, gamma: float):
        super().__init__(gamma, BEADS, 1)
        self.wave = 2 * np.pi / self.box[2, 2]
        self.push = SPEED * 0.85 * (1 + 0.02 * gamma) * self.wave**2 / DENSITY

    def force(self) -> tuple[float, np.ndarray]:
        """With the push; the energy is that of the beads."""
        energy, force = super().force()
        force[:, 0] += self.push * np.sin(self.wave * self.x[:, 2])
        return energy, force

    def update(self, letter: str, pairs: tuple[np.ndarray, ...], dt: float) -> None:
        """J, S or W."""
        if letter == "J":
            joint(self.v, *pairs, self.gamma, dt, self.rng)
        else:
            shardlow(self.v, *pairs, self.gamma, dt, self.rng, letter == "W")


def measured(gamma: float, word: str, dt: float, time: float) -> dict[str, tuple[float, float]]:
    """Configurational temperature, diffusion and viscosity, each with its standard error."""
    fluid, order, every = Driven(gamma), orders.Order(word), round(EVERY / dt)
    fluid.run(orders.ORDERS["aboba"], 0.01, 1000)
    fluid.run(order, dt, round(30 / EVERY) * every)
    frames = round(time / EVERY)
    paths, flow, rows = np.empty((frames, BEADS, 3), np.float32), np.empty(frames), []
    for k in range(frames):
        fluid.run(order, dt, every - 1)
        before = fluid.x.copy()
        fluid.run(order, dt, 1)
        paths[k], flow[k] = fluid.x, amplitude(before, fluid.x, fluid.wave, dt)
        force = orders.Fluid.force(fluid)[1]
        rows.append(((force**2).sum(), fluid.engine.laplacian()))
    found, conf = coefficients(paths, flow, fluid.push, fluid.box[0, 0]), ratio_average(*np.array(rows).T)
    return {"T_conf": (conf.mean, conf.sem)} | {name: (found[name], found[f"{name}_error"]) for name in ("D", "eta")}


def main() -> None:
    """Print the table, line by line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--time", type=float, default=1500.0)
    options = parser.parse_args()
    dpd.set_threads(1)
    table = json.loads((ROOT / "openmm_dpd" / "advice" / "transport.json").read_text())
    limits = {point["gamma"]: {"T_conf": [1.0, 0.0]} | {name: point[name] for name in ("D", "eta")} for point in table["points"]}
    print("| friction | order | step | T_conf | diffusion | viscosity |\n| --- | --- | --- | --- | --- | --- |")
    for gamma, word, dt in RUNS:
        for letter in "OSJW":
            found, cells = measured(gamma, word.format(letter), dt, options.time), []
            for name, (value, sem) in found.items():
                limit, error = limits[gamma][name]
                cells.append(f"{100 * (value / limit - 1):+.1f} ± {100 * np.hypot(sem, error) / limit:.1f} %")
            print(f"| {gamma:g} | `{word.format(letter)}` | {dt:.3g} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
