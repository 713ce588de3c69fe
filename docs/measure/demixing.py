"""Flory-Huggins parameters of binary fluids, from two runs of a kind: what openmm_dpd/data/chi.json holds.

    python docs/measure/demixing.py --density 3 --write openmm_dpd/data/chi.json

Beads of two kinds with the same repulsion A among themselves and A + dA between them, A = 75/density.  Where they demix, a slab of one in
the other gives chi = ln((1 - phi)/phi)/(1 - 2 phi) from the bulk compositions phi (a part of the beads) on both sides.  Where they mix,
the free energy of mixing does: with half of each kind,

    chi/4 = integral of <sum of (1 - r)^2/2 over unlike pairs>/N from 0 to dA.

Reduced units, rc = m = kT = 1.
"""

from __future__ import annotations

import argparse
import json
import os

import numpy as np
from openmm import unit
from scipy.spatial import cKDTree

import openmm_dpd as dpd
from openmm_dpd.parameters.flory_huggins import composition_from_chi
from openmm_dpd.parameters.state import overlap_energy
from openmm_dpd.stats import block_average, ratio_average

#: Steps of dA times the density: demixed ones, and the mixed ones that the integral runs over.
DEMIXED, MIXED = (24.5, 27.0, 33.0, 42.0), (0.0, 4.0, 8.0, 12.0, 16.0)
SKIN = 2.5

#: Beyond this chi the mixed fluid begins to demix, and has fewer unlike pairs for that.
STILL_MIXED = 1.9

#: Roughly chi over what it is to first order in dA; a slab that starts far off takes longer to settle.
GUESS = 0.87


def fluid(density: float, dA: float, box: tuple[float, float, float], slab: bool, seed: int, A: float | None = None) -> dpd.BuiltSystem:
    """Half of the beads of each kind: a slab of one in the other, near the compositions expected, or well mixed."""
    A = 75.0 / density if A is None else A
    count = 2 * round(density * np.prod(box) / 2)
    rng = np.random.default_rng(seed)
    x = rng.random((count, 3)) * box
    if slab:
        order = np.argsort(np.abs(x[:, 2] - box[2] / 2))
        inside = np.zeros(count, bool)
        inside[order[: count // 2]] = True
        # about as many change sides as will be there in the end, which saves the time to get there
        swapped = round(composition_from_chi(GUESS * overlap_energy(A, density) * dA) * count / 2)
        inside[rng.choice(order[: count // 2], swapped, replace=False)] = False
        inside[rng.choice(order[count // 2 :], swapped, replace=False)] = True
    else:
        inside = rng.permutation(count) < count // 2
    like, unlike = dpd.DPD(A=A, gamma=4.5), dpd.DPD(A=A + dA, gamma=4.5)
    pairs = {("P", "P"): like, ("Q", "Q"): like, ("P", "Q"): unlike}
    scene = dpd.Scene({"P": 1.0, "Q": 1.0}, np.where(inside, "P", "Q").tolist(), x, pairs, kT=1.0, box=list(box))
    return dpd.build(scene, dt=0.05 * min(1.0, (75.0 / density / A) ** 0.5), scheme="bababo", platform="CPU", seed=seed)


def positions(simulation) -> np.ndarray:
    """(N, 3)."""
    return simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)


def demixed_chi(density: float, dA: float, *, A=None, edge=8.0, length=24.0, time=400.0, settle=100.0, seed=1) -> tuple[float, float]:
    """chi and its standard error, from the compositions further than SKIN from both interfaces."""
    built = fluid(density, dA, (edge, edge, length), True, seed, A)
    simulation = built.simulation()
    kind = np.array(built.plan.scene.types) == "P"
    every = round(1.0 / built.plan.options.dt)
    simulation.step(round(settle) * every)
    minority, whole = [], []
    for _ in range(round(time)):
        simulation.step(every)
        z = positions(simulation)[:, 2]
        # the middle of the slab, wherever it drifts
        middle = np.angle(np.sum(np.exp(2j * np.pi * z[kind] / length))) * length / (2 * np.pi)
        away = np.abs((z - middle + length / 2) % length - length / 2)
        inner, outer = away < length / 4 - SKIN, away > length / 4 + SKIN
        minority.append(np.sum(inner & ~kind) + np.sum(outer & kind))
        whole.append(np.sum(inner) + np.sum(outer))
    phi = ratio_average(np.array(minority, float), np.array(whole, float))
    log = np.log((1 - phi.mean) / phi.mean)
    slope = -1 / (phi.mean * (1 - phi.mean)) / (1 - 2 * phi.mean) + 2 * log / (1 - 2 * phi.mean) ** 2
    return float(log / (1 - 2 * phi.mean)), float(abs(slope) * phi.sem)


def unlike_overlap(density: float, dA: float, *, edge=8.0, time=60.0, seed=1) -> tuple[float, float]:
    """Mean over time of sum (1 - r)^2/2 over unlike pairs, for each bead, in the mixed fluid, and its standard error."""
    built = fluid(density, dA, (edge, edge, edge), False, seed)
    simulation = built.simulation()
    kind = np.array(built.plan.scene.types) == "P"
    simulation.step(400)
    rows = []
    for _ in range(round(time / 0.5)):
        simulation.step(10)
        x = positions(simulation) % edge
        near = cKDTree(x, boxsize=edge).sparse_distance_matrix(cKDTree(x, boxsize=edge), 1.0, output_type="ndarray")
        near = near[(near["i"] < near["j"]) & (kind[near["i"]] != kind[near["j"]])]
        rows.append(np.sum((1 - near["v"]) ** 2) / 2 / len(x))
    found = block_average(rows)
    return found.mean, found.sem


def main() -> None:
    """Measure one density, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--density", type=float, default=3.0)
    parser.add_argument("--time", type=float, default=400.0)
    parser.add_argument("--points", type=float, nargs="+", help="measure only these slabs: dA times the density")
    parser.add_argument("--write", help="JSON file, read and added to")
    options = parser.parse_args()
    rows: list[list] = []
    if options.write and os.path.exists(options.write):
        with open(options.write, encoding="utf-8") as file:
            rows = json.load(file)["rows"]
    seed = 1000 * round(options.density)
    if options.points is None:
        rows += mixed_rows(options.density, seed)
    for k, value in enumerate(options.points or DEMIXED):
        dA = value / options.density
        chi, error = demixed_chi(options.density, dA, time=options.time, seed=seed + (10 if options.points is None else 20) + k)
        rows.append([options.density, round(dA, 6), round(chi, 5), round(error, 5), "demixed"])
        print(*rows[-1], flush=True)
    if options.write:
        head = {"script": "docs/measure/demixing.py", "A": "75/density", "scheme": "bababo", "time": options.time}
        text = json.dumps(head)[:-1] + ', "columns": ["density", "dA", "chi", "error", "from"], "rows": [\n'
        with open(options.write, "w", encoding="utf-8") as file:
            file.write(text + ",\n".join(json.dumps(row) for row in rows) + "\n]}\n")


def mixed_rows(density: float, seed: int) -> list[list]:
    """Rows of the table from free energies of mixing, and the slope at dA = 0."""
    rows: list[list] = []
    mixed = [unlike_overlap(density, value / density, seed=seed + k) for k, value in enumerate(MIXED)]
    for number in (2, 4):  # Simpson's rule over 2 and 4 intervals
        h = (MIXED[1] - MIXED[0]) / density
        weights = np.array([1, 4, 1] if number == 2 else [1, 4, 2, 4, 1]) * h / 3
        chi = 4 * sum(w * m[0] for w, m in zip(weights, mixed, strict=False))
        error = 4 * np.sqrt(sum((w * m[1]) ** 2 for w, m in zip(weights, mixed, strict=False)))
        if chi < STILL_MIXED:
            rows.append([density, MIXED[number] / density, round(float(chi), 5), round(float(error), 5), "mixed"])
            print(*rows[-1], flush=True)
    rows.append([density, 0.0, round(4 * mixed[0][0], 5), round(4 * mixed[0][1], 5), "slope"])
    print(*rows[-1], flush=True)
    return rows


if __name__ == "__main__":
    main()
