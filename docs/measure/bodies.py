"""Rigid bodies in the standard fluid: temperatures of their translation and rotation, and what they cost.

python docs/measure/bodies.py temperatures sphere --gamma 40.5 --dt 0.05 --samples 20000
python docs/measure/bodies.py depletion
python docs/measure/bodies.py cost
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.base.geometry import minimum_images
from openmm_dpd.molecules import body_shape, relax, suspension
from openmm_dpd.stats import block_average

EDGE, FREE, BODIES = 4.0, 110, 8
GOLDEN = (1 + 5**0.5) / 2
_CORNERS = np.array([[0, a, b * GOLDEN] for a in (-1, 1) for b in (-1, 1)])
#: Places and masses of the beads of a body: the corners of an icosahedron, a rod, and a lump whose masses are 1 to 1000.
SHAPES = {
    "sphere": (0.4 * np.concatenate([np.roll(_CORNERS, k, axis=1) for k in range(3)]), np.ones(12)),
    "rod": (np.outer(np.arange(5) - 2.0, [0.4, 0, 0]), np.ones(5)),
    "lump": (np.random.default_rng(3).normal(size=(6, 3)) * 0.5, np.array([1.0, 3.0, 10.0, 30.0, 100.0, 1000.0])),
}


def scene(
    places: np.ndarray, masses: np.ndarray, gamma: float, rigid: bool = True, edge: float = EDGE, free: int = FREE, count: int = BODIES
) -> dpd.Scene:
    """Bodies in random places of a fluid."""
    rng, n = np.random.default_rng(5), len(places)
    turned = [places @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + rng.random(3) * edge for _ in range(count)]
    x = np.concatenate([*turned, rng.random((free, 3)) * edge])
    types, mass = ["C"] * (n * count) + ["W"] * free, np.concatenate([np.tile(masses, count), np.ones(free)])
    bodies = [dpd.Body(range(n * k, n * k + n)) for k in range(count)] if rigid else []
    pairs = {pair: dpd.DPD(A=25, gamma=gamma) for pair in (("C", "C"), ("C", "W"), ("W", "W"))}
    return dpd.Scene({"C": 1.0, "W": 1.0}, types, x, pairs, 1.0, box=[edge] * 3, bead_masses=mass, bodies=bodies)


def temperatures(shape: str, gamma: float, dt: float, samples: int, every: int, scheme: str, count: int) -> None:
    """Print the temperatures of translation, rotation and of the fluid, without what the total momentum takes.

    More bodies take the places of free beads.
    """
    of = scene(*SHAPES[shape], gamma, free=FREE - len(SHAPES[shape][0]) * (count - BODIES), count=count)
    simulation = dpd.build(of, dt=dt, scheme=scheme, seed=7, platform="CPU").simulation()
    simulation.minimizeEnergy(maxIterations=50)
    simulation.step(5000)
    n, m, total, rows = len(SHAPES[shape][0]), SHAPES[shape][1], of.bead_masses.sum(), []
    inertia = 3 - of.shapes[0].in_line
    for _ in range(samples):
        simulation.step(every)
        v = np.array(simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value)
        its = v[: n * count].reshape(count, n, 3)
        centre = np.einsum("k,bka->ba", m, its) / m.sum()
        turning = np.einsum("k,bka,bka->", m, its - centre[:, None], its - centre[:, None]) / (inertia * count)
        going = np.mean(centre**2) / (1 / m.sum() - 1 / total)
        rows.append((going, turning, np.mean(v[n * count :] ** 2) / (1 - 1 / total)))
    found = [block_average(column) for column in np.array(rows).T]
    print(f"{shape} {scheme} gamma {gamma:g} dt {dt:g}: " + ", ".join(f"{a.mean:.4f} +- {a.sem:.4f}" for a in found), flush=True)


def cost() -> None:
    """Print the time of a step of 10,125 beads of which 5 % are in spheres over that where they are free, from the best of alternating pieces."""
    made = {}
    for rigid in (False, True):
        of = scene(*SHAPES["sphere"], 4.5, rigid, edge=15.0, free=9621, count=42)
        made[rigid] = dpd.build(of, dt=0.02, seed=7, platform="CPU").simulation()
        made[rigid].minimizeEnergy(maxIterations=30)
        made[rigid].step(1000)
    best = dict.fromkeys(made, np.inf)
    for _ in range(40):
        for rigid, simulation in made.items():
            begun = time.process_time()
            simulation.step(40)
            best[rigid] = min(best[rigid], (time.process_time() - begun) / 40)
    print(f"{1e3 * best[False]:.3f} ms free, {1e3 * best[True]:.3f} ms in bodies, ratio {best[True] / best[False]:.3f}")


#: Spheres (several would stick together), their radius, and the time between frames.
COLLOIDS, RADIUS, FRAME = 1, 1.2, 0.5
DECK = """units lj
atom_style molecular
comm_modify vel yes cutoff 4.0
read_data data.colloids
pair_style dpd 1.0 1.0 34387
pair_coeff * * 25.0 4.5 1.0
pair_coeff 1 2 25.0 {friction} 1.0
group stiff type 1
group water type 2
neighbor 0.4 bin
neigh_modify delay 0 every 1 exclude molecule/intra stiff
velocity all create 1.0 4928
fix b stiff rigid/nve molecule
fix w water nve
timestep {dt}
run {wait}
dump d stiff custom {every} frames.txt id xu yu zu
dump_modify d sort id format float %.10g
run {steps}
"""


def diffusion(dt: float, frames: int, lags: list[int], friction: float, lammps: bool) -> None:
    """Print how fast a hollow sphere spreads in translation and rotation from each lag (in frames) to the next.  The fluid around it remembers
    for long: at short lags this is less than the diffusion coefficient of translation."""
    edge, shell = 7.0, body_shape("shell", RADIUS, 0.45)
    spheres, fluid = suspension(shell, COLLOIDS, [edge] * 3, apart=0.5, density=3.0, seed=2)
    far = [np.linalg.norm(minimum_images(fluid - sphere.mean(axis=0), np.diag([edge] * 3)), axis=1) > RADIUS for sphere in spheres]
    fluid, n, every, wait = fluid[np.all(far, axis=0)], len(shell), round(FRAME / dt), round(40 / dt)
    x, inside = np.concatenate([spheres.reshape(-1, 3), fluid]), n * COLLOIDS
    pairs = {("C", "C"): dpd.DPD(A=25, gamma=4.5), ("C", "W"): dpd.DPD(A=25, gamma=friction), ("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    bodies = [dpd.Body(range(n * k, n * k + n)) for k in range(COLLOIDS)]
    of = dpd.Scene({"C": 1.0, "W": 1.0}, ["C"] * inside + ["W"] * len(fluid), x, pairs, 1.0, box=[edge] * 3, bodies=bodies)
    of = relax(of, iterations=50)
    if lammps:
        with tempfile.TemporaryDirectory() as folder:
            folded = of.positions - edge * np.floor(of.positions / edge)
            image = np.floor(of.positions / edge).astype(int)
            lines = [
                f"{k + 1} {k // n + 1 if k < inside else 0} {1 + (k >= inside)} {' '.join(map(repr, row.tolist()))} {' '.join(map(str, i))}"
                for k, (row, i) in enumerate(zip(folded, image.tolist(), strict=True))
            ]
            head = f"# colloids\n\n{len(x)} atoms\n2 atom types\n\n" + "".join(f"0 {edge} {a}lo {a}hi\n" for a in "xyz")
            Path(folder, "data.colloids").write_text(f"{head}\nMasses\n\n1 1.0\n2 1.0\n\nAtoms # molecular\n\n" + "\n".join(lines) + "\n")
            Path(folder, "in.colloids").write_text(DECK.format(dt=dt, friction=friction, every=every, wait=wait, steps=every * frames))
            subprocess.run(["lmp", "-in", "in.colloids", "-log", "none", "-screen", "none"], cwd=folder, check=True)
            rows = [
                line.split() for line in Path(folder, "frames.txt").read_text().splitlines() if len(line.split()) == 4 and line[0] != "I"
            ]
        found = np.array(rows, dtype=float)[:, 1:].reshape(-1, COLLOIDS, n, 3)
    else:
        simulation = dpd.build(of, dt=dt, scheme="middle", seed=3, platform="CPU").simulation()
        simulation.step(wait)
        taken = []
        for _ in range(frames):
            simulation.step(every)
            taken.append(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value[:inside].reshape(COLLOIDS, n, 3))
        found = np.array(taken)
    centres = found.mean(axis=2)
    first, second = found[:, :, 0] - centres, found[:, :, n // 3] - centres
    axes = [first / np.linalg.norm(first, axis=2, keepdims=True)]
    second -= axes[0] * np.sum(axes[0] * second, axis=2, keepdims=True)
    axes += [
        second / np.linalg.norm(second, axis=2, keepdims=True),
        np.cross(axes[0], second / np.linalg.norm(second, axis=2, keepdims=True)),
    ]
    for short, long in pairwise(lags):
        last, apart = len(centres) - long, FRAME * (long - short)
        squares = [np.mean(np.sum((centres[lag:] - centres[:-lag]) ** 2, axis=2)[:last], axis=1) for lag in (short, long)]
        going = block_average((squares[1] - squares[0]) / (6 * apart))
        turned = [np.mean([np.sum(a[lag:] * a[:-lag], axis=2)[:last].mean(axis=1) for a in axes], axis=0) for lag in (short, long)]
        means = [each.mean() for each in turned]
        turning = np.log(means[0] / means[1]) / (2 * apart)
        error = block_average(turned[0] / means[0] - turned[1] / means[1]).sem / (2 * apart)
        text = f"{going.mean:.4f} +- {going.sem:.4f}, {turning:.4f} +- {error:.4f}"
        print(f"{'LAMMPS' if lammps else 'here'} dt {dt:g}, from {FRAME * short:g} to {FRAME * long:g}: {text}", flush=True)


def depletion(distances: list[float], steps: int, every: int = 20) -> None:
    """Print the mean force by which a fluid pushes apart two held hollow spheres, less what their beads do to each other; and the pressure of
    that fluid."""
    box, shell, gone = np.array([12.0, 6.0, 6.0]), body_shape("shell", RADIUS, 0.45), []
    n, pairs = len(shell), {("*", "*"): dpd.DPD(A=25, gamma=4.5)}
    free = np.random.default_rng(3).random((round(3.0 * box.prod()), 3)) * box
    for distance in distances:
        centres = 0.5 * box + [[-0.5 * distance, 0, 0], [0.5 * distance, 0, 0]]
        spheres = [shell + centres[0], shell * [-1, 1, 1] + centres[1]]
        fluid = free[np.min([np.linalg.norm(free - centre, axis=1) for centre in centres], axis=0) > RADIUS]
        bodies = [dpd.Body(range(n * k, n * k + n), moves="", turns=False) for k in range(2)]
        types, x = ["C"] * (2 * n) + ["W"] * len(fluid), np.concatenate([*spheres, fluid])
        of = relax(dpd.Scene({"C": 1.0, "W": 1.0}, types, x, pairs, 1.0, box=box, bodies=bodies), iterations=50)
        apart = spheres[1][:, None] - spheres[0][None]
        r = np.linalg.norm(apart, axis=2)
        direct = np.sum(25 * np.maximum(1 - r, 0) * apart[:, :, 0] / r)
        simulation, rows = dpd.build(of, dt=0.05, scheme="middle", seed=3, platform="CPU").simulation(), []
        simulation.step(2000)
        for _ in range(steps // every):
            simulation.step(every)
            state = simulation.context.getState(forces=True, positions=True)
            force, place = (each._value[:, 0] for each in (state.getForces(asNumpy=True), state.getPositions(asNumpy=True)))
            rows.append((0.5 * (force[n : 2 * n].sum() - force[:n].sum()) - direct, np.mean(np.abs(place - 12 * np.rint(place / 12)) < 1)))
        pushed, far = (block_average(column) for column in np.array(rows).T)
        gone.append(far.mean * len(x) / (2 * box[1] * box[2]))
        print(f"distance {distance:g}: {pushed.mean:.2f} +- {pushed.sem:.2f}; density far away {gone[-1]:.4f}", flush=True)
    x = np.random.default_rng(4).random((round(np.mean(gone) * 512), 3)) * 8
    built = dpd.build(dpd.Scene({"W": 1.0}, ["W"] * len(x), x, pairs, 1.0, box=[8.0] * 3), dt=0.05, scheme="middle", seed=3, platform="CPU")
    simulation, observer = built.simulation(), dpd.Observer(built)
    simulation.step(2000)
    found = []
    for _ in range(steps // (5 * every)):
        simulation.step(every)
        found.append(observer.sample(simulation.context).pressure())
    mean = block_average(np.array(found))
    print(f"pressure at the density {len(x) / 512:.4f}: {mean.mean:.3f} +- {mean.sem:.3f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["temperatures", "diffusion", "depletion", "cost"])
    parser.add_argument("shape", nargs="?", choices=SHAPES, default="sphere")
    parser.add_argument("--gamma", type=float, default=4.5)
    parser.add_argument("--dt", type=float, default=0.05)
    parser.add_argument("--samples", type=int, default=20000)
    parser.add_argument("--every", type=int, default=4)
    parser.add_argument("--scheme", default="bababo")
    parser.add_argument("--bodies", type=int, default=BODIES)
    parser.add_argument("--frames", type=int, default=4000)
    parser.add_argument("--lags", type=int, nargs="+", default=[4, 16, 48])
    parser.add_argument("--friction", type=float, default=18.0)
    parser.add_argument("--distances", type=float, nargs="+", default=[2.6, 2.8, 3.0, 3.2, 3.4, 3.8])
    parser.add_argument("--steps", type=int, default=60000)
    parser.add_argument("--lammps", action="store_true")
    given = parser.parse_args()
    if given.what == "cost":
        cost()
    elif given.what == "depletion":
        depletion(given.distances, given.steps)
    elif given.what == "diffusion":
        diffusion(given.dt, given.frames, given.lags, given.friction, given.lammps)
    else:
        temperatures(given.shape, given.gamma, given.dt, given.samples, given.every, given.scheme, given.bodies)
