"""Other orders of drifts (A), kicks (B) and sweeps (O), to find what beats the schemes of the package: errors at equal steps per force.

Runs on the package's kernels without OpenMM, so that an order is one line of text.  "3B/5" is a kick over three fifths of a step, a prime marks
kicks by the gradient-corrected force F - c h^2 (Hessian of U) F/m, h being the step over the number of forces.  Published methods have letters of
their own: R kicks with friction and noise as forces, of one random number per pair and step; L draws the relative velocities of pairs anew, with
the probability (friction times step) that makes the viscosity similar (Lowe, Europhys. Lett. 47, 145 (1999)); N and P are sweeps with a friction
that follows the temperature of the pairs, N of that alone (pairwise Nose-Hoover-Langevin: Leimkuhler and Shang, J. Comput. Phys. 280, 72
(2015)), P of that added to the fluid's (pairwise adaptive Langevin: the same, J. Comput. Phys. 324, 174 (2016)); their order of substeps is
that of aboba, our choice.  Prints Markdown tables and puts them into docs/atlas.md and, of the published methods, docs/schemes.md.

    python benchmarks/orders.py                # three quarters of an hour on one core
    python benchmarks/orders.py --time 50      # a look
"""

from __future__ import annotations

import argparse
import json
import operator
import re
import sys
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import page  # noqa: E402
from atlas_parts.store import Store, carry_out, key  # noqa: E402
from atlas_parts.summary import short  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.base.errors import DPDError  # noqa: E402
from openmm_dpd.kernels.columns import approach, over_pairs  # noqa: E402
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine  # noqa: E402
from openmm_dpd.plan.plan import make_plan  # noqa: E402
from openmm_dpd.runtime.decorators import inlined  # noqa: E402
from openmm_dpd.stats import block_average, ratio_average  # noqa: E402


@dataclass(frozen=True)
class Order:
    """A step as text, how many new forces it needs, the constant of the gradient correction, and a word about it."""

    text: str
    forces: int = 1
    c: float = 0.0
    what: str = ""


ORDERS = {
    "middle": Order("B A/2 O A/2"),
    "aboba": Order("A/2 B/2 O B/2 A/2"),
    "bababo": Order("B/5 A/2 3B/5 A/2 B/5 O", 2),
    "bab3": Order("3B/25 3A/10 19B/50 2A/5 19B/50 3A/10 3B/25 O", 3),
    "velocity Verlet between half sweeps": Order("O/2 B/2 A B/2 O/2"),
    "half a sweep before and after the kick": Order("A/2 O/2 B O/2 A/2"),
    "aboba, gradient-corrected, c = 1/48": Order("A/2 B'/2 O B'/2 A/2", c=1 / 48),
    "aboba, gradient-corrected, c = -1/48": Order("A/2 B'/2 O B'/2 A/2", c=-1 / 48),
    "middle, gradient-corrected, c = -1/24": Order("B' A/2 O A/2", c=-1 / 24),
    "two leapfrog steps, read as aboba": Order("A/4 B/2 A/2 B/4 O B/4 A/4", 2),
    "four leapfrog steps, read as aboba": Order("A/8 B/4 A/4 B/4 A/4 B/4 A/4 B/8 O B/8 A/8", 4),
    "two leapfrog steps, read after the sweep": Order("B/4 A/2 B/2 A/2 B/4 O", 2),
    "bababo with the weight 191/1000": Order("191B/1000 A/2 618B/1000 A/2 191B/1000 O", 2),
    "bababo with the weight 212/1000": Order("212B/1000 A/2 576B/1000 A/2 212B/1000 O", 2),
    "bababo with half sweeps at both ends": Order("O/2 B/5 A/2 3B/5 A/2 B/5 O/2", 2),
    "three forces, weights for hybrid Monte Carlo": Order(
        "118880B/1000000 296195A/1000000 381120B/1000000 407610A/1000000 381120B/1000000 296195A/1000000 118880B/1000000 O", 3
    ),
    "sweep in the middle of a drift, two kicks": Order("211A/1000 B/2 289A/1000 O 289A/1000 B/2 211A/1000", 2),
    "Peters": Order("B/2 A B/2 O"),
    "Lowe-Andersen": Order("B/2 A B/2 L"),
    "pairwise Nose-Hoover-Langevin": Order("A/2 B/2 N B/2 A/2"),
    "pairwise adaptive Langevin": Order("A/2 B/2 P B/2 A/2"),
    "PRK3-Ruth": Order("7R/24 2A/3 3R/4 -2A/3 -1R/24 A", 3),
}
#: Those of the literature, and schemes of this package that are printed beside them.
PUBLISHED, BESIDE = list(ORDERS)[-5:], ["middle", "bababo", "bab3"]

#: Frictions, steps per force, and whole steps of the published methods and of what is beside them.
FRICTIONS, STEPS, WHOLE = (4.5, 40.5), (0.05, 0.06, 0.07), (0.03, 0.05, 0.08, 0.1, 0.15)

#: A kinetic temperature that is off by more counts as a breakdown.
BROKEN = 1.0

TOKEN = re.compile(r"(-?\d*)([A-Z])('?)(?:/(\d+))?")

#: Inertia of the adaptive friction for each degree of freedom, in units of time squared, and the rate at which noise of its own relaxes it.
INERTIA, RELAXATION = 1.0, 1.0


def parsed(order: Order) -> list[tuple[str, float, float]]:
    """(letter, part of the step, constant of the gradient correction) of each substep."""
    steps = []
    for word in order.text.split():
        number, letter, prime, divisor = TOKEN.fullmatch(word).groups()
        steps.append((letter, float(Fraction(int(number or 1), int(divisor or 1))), order.c if prime else 0.0))
    return steps


class Hessian(NamedTuple):
    """A repulsion of strength A and cutoff 1, a vector of each bead, and where the product goes."""

    A: float
    g: np.ndarray
    out: np.ndarray


@inlined
def _hessian_times(pairs, data, scratch, n, k, column):
    i, j, r = pairs.pi[n], pairs.pj[n], pairs.geometry[3, n]
    across = -data.A * (1 - r) / r
    along = (data.A - across) * approach(pairs, data.g, n, i, j)
    for a in range(3):
        h = across * (data.g[i, a] - data.g[j, a]) + along * pairs.geometry[a, n]
        data.out[i, a] += h
        data.out[j, a] -= h
    return 0.0, 0.0, 0.0


hessian_times = over_pairs("hessian_times", _hessian_times, parallel=False)


@njit
def along(e, v, w):
    """e.(v - w)."""
    return e[0] * (v[0] - w[0]) + e[1] * (v[1] - w[1]) + e[2] * (v[2] - w[2])


@njit
def pair_updates(letter, v, first, second, e, r, gamma, adaptive, dt, rng):
    """The sweeps L, N and P over all pairs in turn; masses and kT are 1, the cutoff is 1.  Changes v, returns the adaptive friction.

    In a pair e.v relaxes with the rate 2 f w^2; N and P drive f by (e.v)^2 - 2, weighted by w^2, half of it before and half after the sweep.
    """
    for half in range(2):
        if letter != "L":
            excess = 0.0
            for n in range(len(r)):
                ev = along(e[n], v[first[n]], v[second[n]])
                excess += (1 - r[n]) ** 2 * (ev * ev - 2.0)
            adaptive += 0.5 * dt * excess / (INERTIA * 3 * len(v))
            if letter == "N":
                q = np.exp(-0.5 * RELAXATION * dt)
                adaptive = q * adaptive + np.sqrt((1 - q * q) / (INERTIA * 3 * len(v))) * rng.normal()
        for n in range(len(r) if half == 0 else 0):
            i, j = first[n], second[n]
            w2 = (1 - r[n]) ** 2
            ev = along(e[n], v[i], v[j])
            if letter == "L":
                new = np.sqrt(2.0) * rng.normal() if rng.random() < gamma * dt else ev
            else:
                rate = 2 * w2 * (adaptive + (gamma if letter == "P" else 0.0))
                noise = 8 * gamma * w2 * (-np.expm1(-2 * rate * dt) / (2 * rate)) if letter == "P" and rate != 0.0 else 0.0
                new = np.exp(-rate * dt) * ev + (np.sqrt(noise) * rng.normal() if noise else 0.0)
            for a in range(3):
                v[i, a] += 0.5 * (new - ev) * e[n, a]
                v[j, a] -= 0.5 * (new - ev) * e[n, a]
    return adaptive


class Fluid:
    """The standard fluid, stepped by any order."""

    def __init__(self, gamma: float, beads: int, seed: int):
        edge = (beads / 3.0) ** (1 / 3)
        rng = np.random.default_rng(seed)
        self.x, self.v, self.box = rng.random((beads, 3)) * edge, rng.normal(size=(beads, 3)), np.diag([edge] * 3)
        self.v -= self.v.mean(axis=0)
        scene = dpd.Scene({"W": 1.0}, ["W"] * beads, self.x, {("W", "W"): dpd.DPD(A=25, gamma=gamma)}, kT=1.0, box=[edge] * 3)
        self.engine, self.seed, self.counter = PairEngine(make_plan(scene, dt=0.01, seed=1).spec), seed, 0
        self.gamma, self.adaptive, self.rng = gamma, 0.0, rng

    def force(self) -> tuple[float, np.ndarray]:
        """Energy and conservative force."""
        self.engine.prepare(self.x, self.box)
        return self.engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0)[:2]

    def _corrected(self, scale: float) -> np.ndarray:
        force, pairs = self.force()[1], self.engine.lists[0]
        if not scale:
            return force
        bent = np.zeros_like(force)
        hessian_times(pairs, Hessian(25.0, force[pairs.order], bent))
        result = force.copy()
        result[pairs.order] -= scale * bent
        return result

    def run(self, order: Order, dt: float, steps: int) -> None:
        """Some steps; a force serves all kicks at the same positions."""
        substeps, h, force = parsed(order), dt / order.forces, None
        for _ in range(steps):
            self.counter += 1
            for letter, part, c in substeps:
                if letter == "A":
                    self.x += part * dt * self.v
                    force = None
                elif letter == "B":
                    force = self._corrected(c * h * h) if force is None else force
                    self.v += part * dt * force
                elif letter == "R":
                    self.engine.prepare(self.x, self.box)
                    every = CONSERVATIVE | DISSIPATIVE | RANDOM
                    self.v += part * dt * self.engine.forces(every, self.v, 1.0, dt, self.seed, self.counter)[1]
                elif letter != "O":
                    self.engine.prepare(self.x, self.box)
                    self.update(letter, self.engine.lists[0].listed()[:4], part * dt)
                else:
                    self.engine.prepare(self.x, self.box)
                    self.counter += 1
                    self.v += self.engine.sweep(self.v, 1.0, part * dt, self.seed, self.counter)

    def update(self, letter: str, pairs: tuple[np.ndarray, ...], dt: float) -> None:
        """A sweep that the package does not have, over pairs: first and second bead, directions, distances."""
        self.adaptive = pair_updates(letter, self.v, *pairs, self.gamma, self.adaptive, dt, self.rng)

    def sample(self) -> tuple[float, ...]:
        """Energy per bead, |force|^2, Laplacian, kinetic temperature."""
        energy, force = self.force()
        n = len(self.x)
        return energy / n, float((force**2).sum()), self.engine.laplacian(), float((self.v**2).sum() / (3 * n - 3))


def work(job: dict) -> dict:
    """Averages of one order at one step."""
    dpd.set_threads(1)
    order, dt, fluid = ORDERS[job["method"]], job["dt"], Fluid(job["gamma"], job["beads"], 1)
    fluid.run(ORDERS["aboba"], 0.02, 600)
    every, rows = max(1, round(0.2 / dt)), []
    try:
        fluid.run(order, dt, round(10 / dt))
        for _ in range(round(job["time"] / dt / every)):
            fluid.run(order, dt, every)
            rows.append(fluid.sample())
    except DPDError as error:
        return job | {"failed": str(error).splitlines()[0][:80]}
    energy, above, below, kinetic = np.array(rows).T
    averages = {"T_kin": block_average(kinetic), "T_conf": ratio_average(above, below), "U": block_average(energy)}
    return job | {name: [a.mean, a.sem] for name, a in averages.items()}


def short_of(result: dict) -> dict:
    """A result with numbers of a few digits."""
    return {name: [short(v, 5) for v in value] if isinstance(value, list) else value for name, value in result.items() if name != "part"}


def table(results: list[dict], gamma: float, atlas: dict) -> str:
    """Errors of all orders at one friction in per cent, the energy's as that of a temperature."""
    capacity, reference = atlas["fluids"]["weak"]["dU_dkT"][0], atlas["fluids"]["weak"]["reference"]["U"][0]
    rows = []
    for name, order in ((name, order) for name, order in ORDERS.items() if name not in PUBLISHED):
        cells = []
        for h in STEPS:
            found = next(
                (r for r in results if r["method"] == name and r["gamma"] == gamma and np.isclose(r["dt"], h * order.forces)), None
            )
            if found is None:
                cells.append("-")
                continue
            errors = (found["T_conf"][0] - 1, (found["U"][0] - reference) / capacity, found["T_kin"][0] - 1)
            cells.append(", ".join(f"{100 * error:+.1f}" for error in errors))
        rows.append([name, order.text if len(order.text) < 60 else "see the script", str(order.forces), *cells])
    return page.table([f"friction {gamma:g}", "order", "forces", *(f"step per force {h:g}" for h in STEPS)], rows)


def published(results: list[dict], gamma: float) -> str:
    """Deviations of both temperatures, and the energy, of the published methods at one friction, with standard errors."""
    rows = []
    for name in (*BESIDE, *PUBLISHED):
        found = {r["dt"]: r for r in results if r["method"] == name and r["gamma"] == gamma}
        for measure, quantity in (("T_kin", "kinetic"), ("T_conf", "configurational"), ("U", "U/N")):
            cells = []
            for dt in WHOLE:
                if "failed" in found.get(dt, {"failed": ""}) or abs(found[dt]["T_kin"][0] - 1) > BROKEN:
                    cells.append("breaks down" if dt in found else "-")
                    continue
                value, sem = found[dt][measure]
                cells.append(f"{value:.3f}({1000 * sem:.0f})" if measure == "U" else f"{100 * (value - 1):+.1f}({100 * sem:.1f}) %")
            label = f"{name} ({ORDERS[name].forces})" if measure == "T_kin" else ""
            rows.append([label, quantity, *cells])
    return page.table([f"friction {gamma:g}: method (forces)", "quantity", *(f"dt {dt:g}" for dt in WHOLE)], rows)


def main() -> None:
    """Run what is missing, write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beads", type=int, default=1500)
    parser.add_argument("--time", type=float, default=600.0, help="simulated time of each entry")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--methods", nargs="+", default=list(ORDERS), choices=ORDERS, help="only these; the others stay as they are")
    parser.add_argument("--only", choices=("runs", "table"))
    options = parser.parse_args()
    store = Store(ROOT / "out" / "orders" / "results.jsonl")
    same, jobs = {"part": "orders", "beads": options.beads, "time": options.time}, []
    for name in options.methods:
        steps = {round(h * ORDERS[name].forces, 6) for h in STEPS if name not in PUBLISHED} | {
            dt for dt in WHOLE if name in (*PUBLISHED, *BESIDE)
        }
        jobs += [same | {"method": name, "gamma": gamma, "dt": dt} for gamma in FRICTIONS for dt in sorted(steps)]
    if options.only != "table":
        carry_out([job for job in jobs if job not in store], work, store, options.processes, lambda text: print(text, flush=True))
    if options.only != "runs":
        file = ROOT / "docs" / "orders.json"
        fresh = [short_of(store.results[key(job)]) for job in jobs if job in store]
        place = operator.itemgetter("method", "gamma", "dt")
        known = {place(row): row for row in sorted([*json.loads(file.read_text()), *fresh], key=operator.itemgetter("time"))}
        results = [known[at] for at in sorted(known, key=lambda at: (list(ORDERS).index(at[0]), at[1:]))]
        file.write_text("[\n" + ",\n".join(json.dumps(r) for r in results) + "\n]\n")
        atlas = json.loads((ROOT / "docs" / "atlas.json").read_text())
        text = "\n\n".join(table(results, gamma, atlas) for gamma in FRICTIONS)
        print(text)
        page.update(ROOT / "docs" / "atlas.md", texts={"orders": text})
        text = "\n\n".join(published(results, gamma) for gamma in FRICTIONS)
        print(text)
        page.update(ROOT / "docs" / "schemes.md", texts={"published": text})


if __name__ == "__main__":
    main()
