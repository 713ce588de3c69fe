"""Walls of any shape: flow in a pipe, between cylinders, across cylinders, and no bead behind a wall.

    python docs/measure/solid_walls.py pipe       (about four minutes: Hagen and Poiseuille)
    python docs/measure/solid_walls.py couette    (about four minutes: an inner cylinder that turns)
    python docs/measure/solid_walls.py array      (about ten minutes: drag on a cylinder in a square array)
    python docs/measure/solid_walls.py passes     (about five minutes: ten million bead-steps)
    python docs/measure/solid_walls.py cost       (a minute: CPU time of a step beside that between planes, 24,000 beads, one thread)

The fluid is by default the standard one (A = 25, gamma = 4.5, density 3, kT = 1), the scheme ``middle``.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from time import process_time

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.molecules import frozen_layer
from openmm_dpd.shapes import Ball, Complement, Cone, Cylinder, Difference, RoundedBox, SolidWall, Union
from openmm_dpd.stats import block_average

LENGTH, WIDTH = 10.0, 0.25
PAIRS = {("W", "W"): dpd.DPD(A=25, gamma=4.5)}


def fluid_with(walls: list[SolidWall], box: np.ndarray, force: tuple[float, float, float]) -> dpd.Scene:
    """A fluid in a box around walls, with the frozen beads of :func:`frozen_layer`, or with so much more friction than in the fluid."""
    x = np.random.default_rng(given.seed).random((round(given.density * float(np.prod(box))), 3)) * box
    pair, push = dpd.DPD(A=given.A, gamma=given.gamma), [dpd.BodyForce(force)] if any(force) else []
    pairs, types = {("W", "W"): pair}, None
    if given.more is not None:
        pairs |= {("W", "S"): replace(pair, gamma=given.gamma * given.more), ("S", "S"): dpd.NONE}
        types = {"W": "S"}
    masses = {"W": 1.0} if types is None else {"W": 1.0, "S": 1.0}
    fluid = dpd.Scene(masses, ["W"] * len(x), x, pairs, kT=1.0, box=box, body_forces=push)
    return frozen_layer(fluid, walls, dt=given.dt, seed=given.seed, types=types)


def around(radius: float, inner: float | None, spin: float, force: float) -> tuple[dpd.Scene, float]:
    """A fluid in a pipe, around an inner cylinder if there is one: a scene, and the middle of its box."""
    edge = 2 * radius + 2.2
    box, middle = np.array([edge, edge, LENGTH]), 0.5 * edge
    centre = (middle, middle, 0.0)
    walls = [SolidWall(Complement(Cylinder(centre, "z", radius)), centre=centre)]
    if inner:
        walls.append(SolidWall(Cylinder(centre, "z", inner), spin=(0, 0, spin), centre=centre))
    return fluid_with(walls, box, (0, 0, force)), middle


class Rings:
    """Density, velocity along and around the axis, and temperature in rings, as means over parts of a run."""

    def __init__(self, scene: dpd.Scene, middle: float, inner: float, outer: float):
        self.mobile, self.middle, self.period = scene.mobile, middle, float(scene.box[0, 0])
        self.edges = np.linspace(inner, outer, round((outer - inner) / WIDTH) + 1)
        self.parts: list[np.ndarray] = []

    def add(self, context) -> None:
        """Take one sample into the last part."""
        state = context.getState(positions=True, velocities=True)
        x = state.getPositions(asNumpy=True)._value[self.mobile, :2] - self.middle
        v = state.getVelocities(asNumpy=True)._value[self.mobile]
        x -= self.period * np.rint(x / self.period)
        r = np.hypot(*x.T)
        around, across = (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) / r, (x * v[:, :2]).sum(axis=1) / r
        self.parts[-1] += [np.histogram(r, self.edges, weights=w)[0] for w in (np.ones(len(r)), v[:, 2], around, across**2)]
        self.samples += 1

    def run(self, simulation, steps: int, parts: int, every: int = 10) -> None:
        """Run, in parts."""
        self.samples = 0
        for _ in range(parts):
            self.parts.append(np.zeros((4, len(self.edges) - 1)))
            for _ in range(steps // parts // every):
                simulation.step(every)
                self.add(simulation.context)

    def table(self, rows: np.ndarray, parts: int) -> tuple[np.ndarray, ...]:
        """Mean square radii of the rings, densities, and velocities along and around the axis."""
        count = rows[0] / (self.samples * parts / len(self.parts))
        squares = 0.5 * (self.edges[1:] ** 2 + self.edges[:-1] ** 2)
        return squares, count / (np.pi * np.diff(self.edges**2) * LENGTH), rows[1] / rows[0], rows[2] / rows[0], rows[3] / rows[0]


def with_error(rings: Rings, of) -> list[tuple[float, float]]:
    """Numbers of the whole run, with the standard errors of its parts."""
    whole, n = of(sum(rings.parts), len(rings.parts)), len(rings.parts)
    single = np.array([of(part, 1) for part in rings.parts])
    return list(zip(whole, single.std(axis=0, ddof=1) / np.sqrt(n), strict=True))


def pipe(radius: float, force: float) -> None:
    """Viscosity from the curvature of the profile away from the wall and from the flux, and the slip."""
    scene, middle = around(radius, None, 0.0, force)
    built = dpd.build(scene, dt=given.dt, seed=given.seed, platform="CPU")
    simulation, rings = built.simulation(), Rings(scene, middle, 0.0, radius)
    simulation.step(round(1.2 * radius**2 / given.dt))
    rings.run(simulation, round(given.time / given.dt), 20)

    def of(rows, parts):
        squares, density, along, _, _ = rings.table(rows, parts)
        inside = slice(0, -round(1.0 / WIDTH))  # the last cutoff is left out
        weight = np.sqrt(rows[0][inside])
        top, curve = np.linalg.lstsq(np.stack([weight, weight * squares[inside]], 1), weight * along[inside], rcond=None)[0]
        flux = (density * along * np.pi * np.diff(rings.edges**2)).sum() / density[inside].mean()
        rho = density[inside].mean()
        return -rho * force / (4 * curve), np.pi * rho * force * radius**4 / (8 * flux), (top + curve * radius**2) / top, top

    names = ("viscosity from the curve", "viscosity from the flux", "slip/largest velocity", "largest velocity")
    for name, (value, error) in zip(names, with_error(rings, of), strict=True):
        print(f"{name:26s} {value:8.4f} +- {error:.4f}")
    _, density, _, _, kT = rings.table(sum(rings.parts), len(rings.parts))
    print(f"density / mean inside, last four rings of {WIDTH}:", np.round(density[-4:] / density[: -round(1 / WIDTH)].mean(), 3))
    print("temperature across, last four rings:", np.round(kT[-4:], 3))


def couette(inner: float, outer: float, spin: float) -> None:
    """The angular velocity A + B/r^2 that Navier and Stokes give without slip, beside the measured one."""
    scene, middle = around(outer, inner, spin, 0.0)
    built = dpd.build(scene, dt=given.dt, seed=given.seed, platform="CPU")
    simulation, rings = built.simulation(), Rings(scene, middle, inner, outer)
    simulation.step(round(1.5 * (outer - inner) ** 2 / given.dt))
    rings.run(simulation, round(given.time / given.dt), 20)
    b = spin * inner**2 * outer**2 / (outer**2 - inner**2)
    a = -b / outer**2
    r = 0.5 * (rings.edges[1:] + rings.edges[:-1])
    found = np.array(with_error(rings, lambda rows, parts: rings.table(rows, parts)[3]))
    _, density, _, _, _ = rings.table(sum(rings.parts), len(rings.parts))
    print("    r  density   u around +- error   expected")
    for row in zip(r, density, *found.T, a * r + b / r, strict=True):
        print("{:5.2f}  {:.3f}   {:.4f} +- {:.4f}   {:.4f}".format(*row))
    wanted = a * r + b / r
    weight = 1.0 / found[:, 1] ** 2
    scale = np.sum(weight * wanted * found[:, 0]) / np.sum(weight * wanted**2)
    error, off = 1 / np.sqrt(np.sum(weight * wanted**2)), np.abs(found[:, 0] - wanted).max() / (spin * inner)
    print(f"measured / expected profile {scale:.4f} +- {error:.4f}, largest difference {off:.4f} of the speed of the cylinder")


def array(radius: float, edge: float, force: float, viscosity: float) -> None:
    """Drag on a cylinder in a square array, per length, viscosity and mean velocity, beside the series of Sangani and Acrivos (Int. J.
    Multiphase Flow 8, 193 (1982))."""
    box, middle = np.array([edge, edge, 6.0]), 0.5 * edge
    scene = fluid_with([SolidWall(Cylinder((middle, middle, 0.0), "z", radius))], box, (force, 0, 0))
    simulation = dpd.build(scene, dt=given.dt, seed=given.seed, platform="CPU").simulation()
    simulation.step(round(100 / given.dt))
    rows, every = [], 5
    for _ in range(round(given.time / given.dt / every)):
        simulation.step(every)
        rows.append(simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value[scene.mobile, 0].sum())
    flow, part = block_average(np.array(rows) / (3 * np.prod(box))), np.pi * radius**2 / edge**2
    drag, error = 3 * force * edge**2 / (viscosity * flow.mean), flow.sem / flow.mean
    series = 4 * np.pi / (-0.5 * np.log(part) - 0.738 + part - 0.887 * part**2 + 2.038 * part**3)
    print(f"solid part {part:.4f}, mean velocity {flow.mean:.4f} +- {flow.sem:.4f}")
    print(f"drag {drag:.2f} +- {drag * error:.2f}, series {series:.2f}, ratio {drag / series:.4f} +- {drag / series * error:.4f}")


def passes(seeds: int, steps: int, n: int) -> None:
    """Shapes at random with steps up to 0.2: beads whose distance changes its sign."""
    edges, total, wrong = np.array([5.0, 6.0, 5.5]), 0, 0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)

        def part(rng=rng):
            centre, axis = rng.random(3) * edges, rng.normal(size=3)
            makers = [
                lambda: Ball(centre, rng.uniform(0.4, 1.6)),
                lambda: Cylinder(centre, axis, rng.uniform(0.3, 1.0), rng.uniform(0.3, 2.5)),
                lambda: Cone(centre, axis, rng.uniform(0.5, 2.5), rng.uniform(0.5, 1.2), rng.uniform(0, 0.6)),
                lambda: RoundedBox(centre, rng.uniform(0.4, 3.0, 3), 0.2),
            ]
            return makers[rng.integers(4)]()

        parts = [part() for _ in range(4)]
        shape = (Union(parts), Difference(Union(parts[:2]), Union(parts[2:])), Complement(Union(parts)))[seed % 3]
        x = rng.random((40 * n, 3)) * edges
        probe = dpd.make_plan(
            dpd.Scene({"W": 1.0}, ["W"], [[0, 0, 0]], PAIRS, 1.0, edges, mobile=[False], walls=[SolidWall(shape)]), dt=0.01
        )
        x = x[probe.driven.distance(x)[0] > 0.01][:n]
        pairs = {("W", "W"): dpd.DPD(A=float(rng.choice([0.0, 5.0])), gamma=20)}
        dt = (0.02, 0.05, 0.1, 0.2)[seed % 4]
        scene = dpd.Scene({"W": 1.0}, ["W"] * len(x), x, pairs, 1.0, edges, walls=[SolidWall(shape)])
        built = dpd.build(scene, dt=dt, seed=seed, platform="CPU")
        simulation = built.simulation()
        for _ in range(20):
            simulation.step(steps // 20)
            now = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
            wrong += int(np.count_nonzero(built.plan.driven.distance(now)[0] <= 0))
        total += len(x) * steps
    print(f"{total:.3g} bead-steps, {wrong} beads behind a wall")


def cost() -> None:
    """Pieces of ten steps in turn; the best of each counts."""
    dpd.set_threads(1)
    box, rng = np.array([20.0, 20.0, 22.0]), np.random.default_rng(1)
    x = rng.random((24000, 3)) * [20, 20, 19.99] + [0, 0, 1.005]
    slab = SolidWall(RoundedBox((10, 10, 0), (20, 20, 2.0)))
    bar = SolidWall(Cylinder((0, 0, 0), "z", 0.1))
    apart = x[np.hypot(*((x - box * np.rint(x / box))[:, :2].T)) > 0.2]
    several = {
        "planes": (x, [dpd.Wall("z", 1.0, "above"), dpd.Wall("z", 21.0, "below")]),
        "a shape": (x, [slab]),
        "two": (apart, [slab, bar]),
    }
    simulations = {}
    for name, (places, walls) in several.items():
        scene = dpd.Scene({"W": 1.0}, ["W"] * len(places), places, PAIRS, 1.0, box, walls=walls)
        simulations[name] = dpd.build(scene, dt=0.02, seed=1, platform="CPU").simulation()
        simulations[name].step(20)
    best = dict.fromkeys(simulations, np.inf)
    for _ in range(25):
        for name, simulation in simulations.items():
            begun = process_time()
            simulation.step(10)
            best[name] = min(best[name], process_time() - begun)
    for name, time in best.items():
        print(f"{name:8s} {100 * time:6.2f} ms a step, {time / best['planes']:.3f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("pipe", "couette", "array", "passes", "cost"))
    parser.add_argument("--radius", type=float, default=6.0)
    parser.add_argument("--time", type=float, default=2500.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--more", type=float, help="friction with frozen beads over that within the fluid")
    parser.add_argument("--A", type=float, default=25.0)
    parser.add_argument("--gamma", type=float, default=4.5)
    parser.add_argument("--density", type=float, default=3.0)
    parser.add_argument("--dt", type=float, default=0.04)
    parser.add_argument("--viscosity", type=float, default=0.837, help="of the bulk, for the drag on a cylinder")
    parser.add_argument("--push", type=float, default=1.0, help="force on a bead times the square of the radius")
    given = parser.parse_args()
    if given.what == "pipe":
        pipe(given.radius, given.push / given.radius**2)
    elif given.what == "couette":
        couette(2.5, 6.0, 0.4)
    elif given.what == "array":
        array(2.0, 10.0, 0.05 * given.push, given.viscosity)
    elif given.what == "cost":
        cost()
    else:
        passes(48, 1000, 250)
