"""Flory-Huggins parameters of binary fluids of beads and of chains: what openmm_dpd/parameters/chi.json holds, and the tables of docs/validation.md.

    python docs/measure/demixing.py --all --write openmm_dpd/parameters/chi.json
    python docs/measure/demixing.py --density 3 --beads 4 --spring 2 0 --points 2.3 3 --mixed 1.6
    python docs/measure/demixing.py --density 3 --beads 4 --spring 2 0 --mixed 3 --dilute 0.02

Molecules of two kinds with the same repulsion A among themselves and A + dA between them, A = 75/density.  Where they demix, a slab of one
in the other gives chi = ln((1 - phi)/phi)/(1 - 2 phi)/beads from the bulk compositions phi (a part of the beads) on both sides.  Where they
mix, the free energy of mixing does: with half of each kind,

    chi = integral of 4 <sum of (1 - r)^2/2 over unlike pairs>/N from 0 to dA.

With few molecules of one kind (--dilute) the same integral is the free energy of moving one of them from its own fluid into the other, per
bead: chi at infinite dilution, beyond where equal parts demix.

Reduced units, rc = m = kT = 1.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.molecules import Spring, linear, pack
from openmm_dpd.parameters import chi_from_composition, composition_from_chi, measured_chi_slope
from openmm_dpd.stats import ratio_average

#: dA times the density: demixed single beads at each density, and the mixed ones that the integral runs over.
DEMIXED = {3.0: (24.5, 27.0, 33.0, 42.0, 54.0), 5.0: (22.0, 27.0, 33.0, 42.0)}
MIXED = (0.0, 4.0, 8.0, 12.0, 16.0)

#: Beads closer than this to an interface count for no phase.
SKIN = 2.5

#: Beyond this chi times beads the mixed fluid begins to demix, and has fewer unlike pairs for that.
STILL_MIXED = 1.9

#: Roughly chi over what it is to first order in dA; a slab that starts far off takes longer to settle.
GUESS = 0.87

COLUMNS = ("density", "dA", "chi", "error", "from", "time", "seeds")


@dataclass(frozen=True)
class Model:
    """Both kinds: density, repulsion of like beads (75/density by default), chains of so many beads with this spring."""

    density: float
    A: float | None = None
    beads: int = 1
    spring: Spring | None = None

    @property
    def like(self) -> float:
        """A of like beads."""
        return 75.0 / self.density if self.A is None else self.A


def fluid(model: Model, dA: float, box: tuple[float, float, float], slab: bool, seed: int, part: float = 0.5) -> dpd.BuiltSystem:
    """Two kinds: a slab of one half in the other, near the compositions expected, or well mixed, with this part of the first kind."""
    half = round(model.density * np.prod(box) / model.beads / 2)
    chain = linear(["P"] * model.beads, model.spring or Spring(0.0, 0.0))
    mixture = pack({chain: 2 * half}, box=list(box), solvent=None, seed=seed)
    rng = np.random.default_rng(seed)
    if slab:
        z = mixture.positions[:, 2].reshape(2 * half, model.beads).mean(axis=1) % box[2]
        order = np.argsort(np.abs(z - box[2] / 2))
        inside = np.zeros(2 * half, bool)
        inside[order[:half]] = True
        # about as many change sides as will be there in the end, which saves the time to get there
        expected = max(2.05, GUESS * slope(model)[0] * dA * model.beads)
        swapped = round(composition_from_chi(expected) * half)
        inside[rng.choice(order[:half], swapped, replace=False)] = False
        inside[rng.choice(order[half:], swapped, replace=False)] = True
    else:
        inside = rng.permutation(2 * half) < round(2 * half * part)
    types = np.where(np.repeat(inside, model.beads), "P", "Q").tolist()
    like, unlike = dpd.DPD(A=model.like, gamma=4.5), dpd.DPD(A=model.like + dA, gamma=4.5)
    pairs = {("P", "P"): like, ("Q", "Q"): like, ("P", "Q"): unlike}
    scene = dpd.Scene({"P": 1.0, "Q": 1.0}, types, mixture.positions, pairs, kT=1.0, box=list(box), bonds=mixture.bonds)
    dt = 0.05 * min(1.0, (75.0 / model.density / model.like) ** 0.5)
    return dpd.build(scene, dt=dt, scheme="bababo", platform="CPU", seed=seed)


def per_time(built: dpd.BuiltSystem) -> int:
    """Steps in a unit of time."""
    return round(1.0 / built.plan.options.dt)


@lru_cache
def slope(model: Model, *, edge: float = 10.0, time: float = 150.0, seed: int = 1) -> tuple[float, float]:
    """chi/dA to first order, and its standard error."""
    built = fluid(model, 0.0, (edge,) * 3, False, seed)
    unit_steps = per_time(built)
    found = measured_chi_slope(built, steps=round(time * unit_steps), every=unit_steps // 2, settle=50 * unit_steps)
    return found.mean, found.sem


def demixed_chi(model: Model, dA: float, *, edge=8.0, length=24.0, time=400.0, settle=100.0, seed=1) -> tuple[float, float]:
    """chi and its standard error, from the compositions further than SKIN from both interfaces."""
    built = fluid(model, dA, (edge, edge, length), True, seed)
    simulation = built.simulation()
    kind = np.array(built.plan.scene.types) == "P"
    every = per_time(built)
    simulation.step(round(settle) * every)
    minority, whole = [], []
    for _ in range(round(time)):
        simulation.step(every)
        z = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)[:, 2]
        # the middle of the slab, wherever it drifts
        middle = np.angle(np.sum(np.exp(2j * np.pi * z[kind] / length))) * length / (2 * np.pi)
        away = np.abs((z - middle + length / 2) % length - length / 2)
        inner, outer = away < length / 4 - SKIN, away > length / 4 + SKIN
        minority.append(np.sum(inner & ~kind) + np.sum(outer & kind))
        whole.append(np.sum(inner) + np.sum(outer))
    phi = ratio_average(np.array(minority, float), np.array(whole, float))
    chi, near = (chi_from_composition(p, beads=model.beads) for p in (phi.mean, phi.mean * (1 - 1e-4)))
    return chi, abs(near - chi) / (1e-4 * phi.mean) * phi.sem


def demixed_seeds(model: Model, dA: float, *, time: float, seeds: range) -> tuple[float, float]:
    """Mean of slabs with several seeds; the larger of the error of the series and that of the scatter."""
    found = np.array([demixed_chi(model, dA, time=time, seed=seed) for seed in seeds])
    series = float(np.sqrt(np.sum(found[:, 1] ** 2)) / len(found))
    scatter = float(found[:, 0].std(ddof=1) / len(found) ** 0.5) if len(found) > 1 else 0.0
    return float(found[:, 0].mean()), max(series, scatter)


def mixed_chi(model: Model, points: list[float], *, edge=8.0, time=100.0, seed=1, part=0.5) -> list[tuple[float, float]]:
    """chi and its standard error at the third and the fifth of five points, equally far from each other, of which the first is 0."""
    derivatives = []
    for k, dA in enumerate(points):
        built = fluid(model, dA, (edge,) * 3, False, seed + k, part)
        every = per_time(built)
        mean = measured_chi_slope(built, "P", "Q", steps=round(time * every), every=every // 2, settle=20 * every)
        # a molecule has one partner fewer of its own kind than of the other: none of this in an infinite box
        molecules = built.plan.scene.n_beads // model.beads
        derivatives.append((mean.mean * (molecules - 1) / molecules, mean.sem))
    found = []
    for weights in ([1, 4, 1], [1, 4, 2, 4, 1]):  # Simpson's rule over 2 and 4 intervals
        w = np.array(weights) * (points[1] - points[0]) / 3
        means, errors = np.array(derivatives[: len(w)]).T
        found.append((float(w @ means), float(np.linalg.norm(w * errors))))
    return found


class Rows:
    """Rows of the table, printed and written one by one; those that the file has already are not measured again."""

    def __init__(self, path: str | None):
        self.path, self.rows = path, []
        if path and os.path.exists(path):
            with open(path, encoding="utf-8") as file:
                self.rows = json.load(file)["rows"]

    def has(self, model: Model, dA: float, kind: str) -> bool:
        """Whether this one is there."""
        return any(found[:2] == [model.density, round(dA, 6)] and found[4] == kind for found in self.rows)

    def add(self, model: Model, dA: float, found: tuple[float, float], kind: str, time: float, seeds: int = 1) -> None:
        """One more."""
        self.rows.append([model.density, round(dA, 6), round(found[0], 5), round(found[1], 5), kind, time, seeds])
        print(*self.rows[-1], flush=True)
        if self.path:
            head = {"script": "docs/measure/demixing.py --all", "A": "75/density", "scheme": "bababo", "dt": 0.05, "columns": COLUMNS}
            text = ",\n".join(json.dumps(values) for values in sorted(self.rows))
            with open(self.path, "w", encoding="utf-8") as file:
                file.write(json.dumps(head)[:-1] + ', "rows": [\n' + text + "\n]}\n")


def measure(rows: Rows, model: Model, slabs, mixed: list[float], *, time: float, seeds: int) -> None:
    """All rows of a model."""
    first = 1000 * round(model.density)
    if not rows.has(model, 0.0, "slope"):
        rows.add(model, 0.0, slope(model, time=1.5 * time, seed=first), "slope", 1.5 * time)
    if not rows.has(model, mixed[2], "mixed"):
        for dA, found in zip(mixed[2::2], mixed_chi(model, mixed, time=time, seed=first + 1), strict=True):
            if found[0] * model.beads < STILL_MIXED:
                rows.add(model, dA, found, "mixed", time)
    for k, dA in enumerate(slabs):
        start = first + 100 * (k + 1)
        if not rows.has(model, dA, "demixed"):
            found = demixed_seeds(model, dA, time=4 * time, seeds=range(start, start + seeds))
            rows.add(model, dA, found, "demixed", 4 * time, seeds)


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true", help="single beads at both densities of the table")
    parser.add_argument("--density", type=float, default=3.0)
    parser.add_argument("--beads", type=int, default=1, help="beads in a chain")
    parser.add_argument("--spring", type=float, nargs=2, default=(2.0, 0.0), help="k and r0 of U = k (r - r0)^2")
    parser.add_argument("--time", type=float, default=100.0, help="of a mixed fluid; a slab runs four times as long")
    parser.add_argument("--seeds", type=int, default=3, help="slabs at each point")
    parser.add_argument("--points", type=float, nargs="+", help="dA of the slabs")
    parser.add_argument("--mixed", type=float, help="largest dA of the mixed fluids")
    parser.add_argument("--dilute", type=float, help="part of the molecules of the first kind, for chi at infinite dilution and no slabs")
    parser.add_argument("--write", help="JSON file; rows that it has are kept")
    options = parser.parse_args()
    rows = Rows(options.write)
    for density in sorted(DEMIXED) if options.all else [options.density]:
        spring = Spring(*options.spring) if options.beads > 1 else None
        slabs = [value / density for value in DEMIXED.get(density, ())] if options.points is None else options.points
        end = MIXED[-1] / density if options.mixed is None else options.mixed
        mixed = [end * value / MIXED[-1] for value in MIXED]
        model = Model(density, beads=options.beads, spring=spring)
        if options.dilute is not None:
            for dA, found in zip(mixed[2::2], mixed_chi(model, mixed, time=options.time, seed=500, part=options.dilute), strict=True):
                rows.add(model, dA, found, "dilute", options.time)
            continue
        measure(rows, model, slabs, mixed, time=options.time, seeds=options.seeds)


if __name__ == "__main__":
    main()
