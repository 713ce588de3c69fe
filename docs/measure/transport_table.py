"""Diffusion and viscosity of one-component fluids at density 3: what openmm_dpd/parameters/transport.json holds.

    python docs/measure/transport_table.py --plane exponent --write openmm_dpd/parameters/transport.json

Each point is one run of 3,000 beads in a cubic box, driven by a force f sin(2 pi z/L) along x.  Viscosity: the amplitude v of the flow,
eta = rho f/(k^2 v), k = 2 pi/L.  Diffusion: mean squared displacements along y and z, across the flow, with the correction for the
finite box.  Reduced units, rc = m = kT = 1.  Points are added to the file; a point that it has is not measured again.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
from collections.abc import Callable

import mdtraj
import numpy as np
from openmm import app, unit

import openmm_dpd as dpd
from openmm_dpd.advice.stability_table import drag
from openmm_dpd.analysis import diffusion_coefficient, mean_squared_displacement
from openmm_dpd.stats import block_average

#: Drag of a bead in its surroundings, as the gamma that gives it with the exponent 1 and without transverse friction.
DRAGS = (2.0, 4.5, 13.5, 40.5, 120.0)

#: Planes through the base fluid, each with all drags: exponent of the noise weights, part of the drag that is transverse, repulsion.
PLANES = {"exponent": (1.0, 0.5, 0.25), "transverse": (0.5, 1.0), "A": (50.0, 80.0)}
BASE = {"A": 25.0, "exponent": 1.0, "transverse": 0.0}
DENSITY, BEADS = 3.0, 3000

#: Time between samples and first and last lag of the fit.
EVERY, FIT = 0.5, (4.0, 12.0)


def coefficient(point: dict) -> dpd.DPD:
    """Pair coefficients of a point: 2 gamma_perp weighs as much as gamma, for there are two directions across."""
    unit_drag = drag(1.0, point.get("density", DENSITY), point["exponent"])
    gamma = point["drag"] * (1 - point["transverse"]) / unit_drag
    gamma_perp = point["drag"] * point["transverse"] / 2 / unit_drag
    exponent = point["exponent"]
    return dpd.DPD(A=point["A"], gamma=gamma, gamma_perp=gamma_perp, exponent=exponent, exponent_perp=exponent)


def step_of(point: dict) -> float:
    """At most 0.05, shorter for stiffer fluids; the friction rate of a bead times the step stays below 1/3."""
    rate = 4 * np.pi / 30 * DENSITY / 3.0 * point["drag"]
    return float(min(0.05 * min(1.0, (25.0 / point["A"]) ** 0.5), 0.33 / rate))


def measure(
    point: dict,
    time: float,
    seed: int,
    beads: int = BEADS,
    dt: float | None = None,
    scheme: str = "bababo",
    speed: float = 0.3,
    lam: float = 0.5,
) -> dict:
    """Diffusion coefficient and viscosity, each with its standard error; the force is one for a flow of about this speed."""
    every = max(1, round(EVERY / (step_of(point) if dt is None else dt)))
    simulation, push, edge = driven(point, seed, beads, EVERY / every, scheme, speed, lam)
    return watched(simulation.step, lambda: positions(simulation), time, every, push, edge)


def watched(step: Callable[[int], object], where: Callable[[], np.ndarray], time: float, every: int, push: float, edge: float) -> dict:
    """Diffusion coefficient and viscosity of a driven fluid, whatever steps it; ``where`` gives positions that do not jump at faces."""
    step(round(30.0 / EVERY) * every)
    frames, wave = round(time / EVERY), 2 * np.pi / edge
    paths, flow = np.empty((frames, *where().shape), np.float32), np.empty(frames)
    for k in range(frames):
        step(every - 1)
        before = where()
        step(1)
        paths[k] = after = where()
        flow[k] = amplitude(before, after, wave, EVERY / every)
    return coefficients(paths, flow, push, edge) | {"dt": EVERY / every}


def driven(
    point: dict, seed: int, beads: int, dt: float, scheme: str, speed: float, lam: float = 0.5
) -> tuple[app.Simulation, float, float]:
    """The fluid of a point that a force drives for a flow of about this speed, the force, and the edge of the box."""
    density = point.get("density", DENSITY)
    edge = (beads / density) ** (1 / 3)
    push = speed * 0.85 * (1 + 0.02 * point["drag"]) * (2 * np.pi / edge) ** 2 / density
    scene = dpd.Scene(
        {"W": 1.0},
        ["W"] * beads,
        np.random.default_rng(seed).random((beads, 3)) * edge,
        {("W", "W"): coefficient(point)},
        kT=1.0,
        box=[edge] * 3,
        body_forces=[dpd.BodyForce([push, 0, 0], pattern="sine", axis="z")],
    )
    # random points overlap, and no long step stands that
    first = dpd.build(scene, dt=0.005, scheme="middle", platform="CPU", seed=seed).simulation()
    first.step(400)
    scene = dataclasses.replace(scene, positions=positions(first))
    return dpd.build(scene, dt=dt, scheme=scheme, lam=lam, platform="CPU", seed=seed).simulation(), push, edge


def amplitude(before: np.ndarray, after: np.ndarray, wave: float, dt: float) -> float:
    """Amplitude of the flow from how far beads get in a step; velocities at the end of a step are too low by up to half of its push, for
    they come after the friction of the whole step, or before a whole kick (docs/theory.md, "Diffusion and viscosity")."""
    return float(2 * np.mean((after - before)[:, 0] * np.sin(0.5 * wave * (before + after)[:, 2])) / dt)


def positions(simulation: app.Simulation) -> np.ndarray:
    """Where the beads are, not wrapped into the box."""
    return simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)


def coefficients(paths: np.ndarray, flow: np.ndarray, push: float, edge: float) -> dict:
    """Diffusion coefficient and viscosity from paths (frames, beads, 3) and the amplitudes of the flow (frames,) at intervals of EVERY."""
    amplitude = block_average(flow)
    eta = paths.shape[1] / edge**3 * push / ((2 * np.pi / edge) ** 2 * amplitude.mean)
    eta_error = eta * amplitude.sem / amplitude.mean
    lags = np.arange(round(FIT[0] / EVERY), round(FIT[1] / EVERY) + 1, 4)
    topology = mdtraj.Topology()
    chain = topology.add_chain()
    for _ in range(paths.shape[1]):
        topology.add_atom("W", mdtraj.element.virtual, topology.add_residue("W", chain))
    moved = mean_squared_displacement(mdtraj.Trajectory(paths, topology), interval=EVERY, lags=lags, axes="yz", unwrap=False)
    found = diffusion_coefficient(moved, FIT, kT=1.0, viscosity=eta, edge=edge)
    return {"D": found.mean, "D_error": found.sem, "eta": eta, "eta_error": eta_error, "amplitude": amplitude.mean}


def points_of(plane: str) -> list[dict]:
    """All points of a plane."""
    return [{**BASE, plane: value, "drag": friction} for value in PLANES[plane] for friction in DRAGS]


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plane", choices=list(PLANES), default="exponent")
    parser.add_argument("--time", type=float, default=300.0, help="length of a run")
    parser.add_argument("--write", help="JSON file, read and added to")
    options = parser.parse_args()
    rows: list[dict] = []
    if options.write and os.path.exists(options.write):
        with open(options.write, encoding="utf-8") as file:
            rows = json.load(file)["rows"]
    for point in points_of(options.plane):
        if any(all(row[name] == value for name, value in point.items()) for row in rows):
            continue
        seed = len(rows) + 1
        found = measure(point, options.time, seed)
        rows.append({**point, **{name: round(value, 5) for name, value in found.items()}, "time": options.time, "seed": seed})
        print(rows[-1], flush=True)
        if options.write:
            _write(options.write, rows)


def _write(path: str, rows: list[dict]) -> None:
    head = {"script": "docs/measure/transport_table.py", "density": DENSITY, "beads": BEADS, "scheme": "bababo"}
    text = json.dumps(head)[:-1] + ', "rows": [\n' + ",\n".join(json.dumps(row) for row in rows) + "\n]}\n"
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


if __name__ == "__main__":
    main()
