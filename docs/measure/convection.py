"""Natural convection in a square cavity with a hot and a cold side: the Nusselt number beside that of de Vahl Davis.

    python docs/measure/convection.py diffusivity            # of what the beads carry
    python docs/measure/convection.py cavity --rayleigh 1e4  # five minutes

The standard fluid carries one species of tDPD, which the left side keeps at 1 and the right side at 0; the other sides exchange none.  A
Buoyancy drives it.  Its diffusivity (of motion and exchange) follows from the decay of a sine wave, its kinematic viscosity is 0.279
(docs/howto/flow.md).  With the mean velocity u along x, the mean value c and its gradient in pure conduction, the flux through every vertical
plane makes the Nusselt number 1 + <u c>/(diffusivity * gradient), with the mean over the cavity of the product in small cells.
"""

from __future__ import annotations

import argparse

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.stats import block_average

A, GAMMA, DENSITY, KAPPA, DT = 25.0, 4.5, 3.0, 3.9, 0.04
VISCOSITY = 0.837 / DENSITY
#: G. de Vahl Davis, Int. J. Numer. Meth. Fluids 3, 249 (1983), table V: mean Nusselt number at a Prandtl number of 0.71.
TABLE = {1e3: 1.118, 1e4: 2.243}
#: How much more friction, and exchange, there is with beads of the walls.
MORE, EXCHANGE = 7.0, 10.0
DEPTH, LAYER = 4.0, 1.0


def fluid(kappa: float = KAPPA, gamma: float = GAMMA) -> dpd.TDPD:
    """The standard fluid, with one species."""
    return dpd.TDPD(A=A, gamma=gamma, kappa=kappa)


def state(simulation) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities."""
    found = simulation.context.getState(positions=True, velocities=True)
    return found.getPositions(asNumpy=True)._value, found.getVelocities(asNumpy=True)._value


def diffusivity(runs: int) -> float:
    """From the decay of sine waves along x in a periodic box."""
    edge, found = 10.0, []
    for seed in range(runs):
        n = round(DENSITY * edge**3)
        x = np.random.default_rng(seed).random((n, 3)) * edge
        scene = dpd.Scene(
            {"W": 1.0}, ["W"] * n, x, {("W", "W"): fluid()}, kT=1.0, box=[edge] * 3, internal=dpd.Concentrations(np.ones((n, 1)))
        )
        built = dpd.build(scene, dt=DT, scheme="middle", seed=seed + 1)
        simulation = built.simulation()
        simulation.step(200)
        wave = np.sin(2 * np.pi * state(simulation)[0][:, 0] / edge)
        dpd.write_fields(simulation.context, built.plan, concentrations=1 + 0.5 * wave[:, None])
        amplitudes = []
        for _ in range(8):
            simulation.step(25)
            c = dpd.read_fields(simulation.context, built.plan)["concentrations"][:, 0]
            amplitudes.append(2 * np.mean((c - 1) * np.exp(2j * np.pi * state(simulation)[0][:, 0] / edge)))
        rate = np.log(np.abs(amplitudes[0]) / np.abs(amplitudes[-1])) / (7 * 25 * DT)
        found.append(rate / (2 * np.pi / edge) ** 2)
    print(f"diffusivity {np.mean(found):.4f}({np.std(found, ddof=1) / runs**0.5:.4f})", flush=True)
    return float(np.mean(found))


def cavity(edge: float, force: float, seed: int) -> dpd.BuiltSystem:
    """Fluid between frozen beads of its own structure: hot (H), cold (K), and two sides without exchange (S)."""
    box = np.array([edge + 2 * LAYER, DEPTH, edge + 2 * LAYER])
    n = round(DENSITY * np.prod(box))
    whole = dpd.Scene(
        {"W": 1.0}, ["W"] * n, np.random.default_rng(seed).random((n, 3)) * box, {("W", "W"): dpd.DPD(A=A, gamma=GAMMA)}, kT=1.0, box=box
    )
    simulation = dpd.build(whole, dt=DT, scheme="middle", seed=seed).simulation()
    simulation.step(300)
    x, v = state(simulation)
    x = x % box
    low, high = LAYER, LAYER + edge
    types = np.full(n, "W")
    types[(x[:, 2] < low) | (x[:, 2] > high)] = "S"
    types[(x[:, 0] < low) & (types == "W")], types[(x[:, 0] > high) & (types == "W")] = "H", "K"
    walls = {("W", "S"): fluid(0.0, MORE * GAMMA), ("W", "H"): fluid(EXCHANGE * KAPPA, MORE * GAMMA)}
    pairs = {("W", "W"): fluid(), **walls, ("W", "K"): walls["W", "H"], **{pair: dpd.NONE for pair in _frozen("SHK")}}
    value = np.where(types == "H", 1.0, np.where(types == "K", 0.0, np.clip(1 - (x[:, 0] - low) / edge, 0, 1)))
    scene = dpd.Scene(
        dict.fromkeys("WSHK", 1.0),
        types.tolist(),
        x,
        pairs,
        kT=1.0,
        box=box,
        velocities=np.where((types == "W")[:, None], v, 0.0),
        mobile=types == "W",
        internal=dpd.Concentrations(value[:, None]),
        sources=[dpd.Buoyancy((0, 0, force), 0.5)] if force else [],
        walls=[dpd.Wall(axis, at, side) for axis in "xz" for at, side in ((low, "above"), (high, "below"))],
    )
    return dpd.build(scene, dt=DT, scheme="middle", seed=seed + 1)


def _frozen(names: str) -> list[tuple[str, str]]:
    return [(a, b) for k, a in enumerate(names) for b in names[k:]]


def convection(edge: float, rayleigh: float, alpha: float, steps: int, seed: int = 1, cells: int = 16, every: int = 10) -> None:
    """Run a cavity; prints the Nusselt number, and the gradient in the middle."""
    force = rayleigh * VISCOSITY * alpha / edge**3
    built = cavity(edge, force, seed)
    simulation, mobile = built.simulation(), built.plan.scene.mobile
    simulation.step(round(0.4 * edge**2 / alpha / DT))
    rows = []
    for _ in range(steps // every):
        simulation.step(every)
        x, v = state(simulation)
        c = dpd.read_fields(simulation.context, built.plan)["concentrations"][mobile, 0]
        place = np.clip(((x[mobile][:, [0, 2]] - LAYER) / edge * cells).astype(int), 0, cells - 1)
        number = place[:, 0] * cells + place[:, 1]
        rows.append([np.bincount(number, weights, cells**2) for weights in (None, v[mobile, 0], v[mobile, 2], c)])
    count, along, up, value = np.array(rows, dtype=float).transpose(1, 0, 2)
    density = count.mean(axis=0)
    u, w, c = (sums.mean(axis=0) / density for sums in (along, up, value))
    columns = c.reshape(cells, cells).mean(axis=1)
    middle = slice(cells // 4, cells - cells // 4)
    slope, offset = np.polyfit((np.arange(cells)[middle] + 0.5) / cells, columns[middle], 1)
    # the mean product of mean fields, and its error by what each frame adds to it through the velocity
    series = (along - u * count) @ (c - c.mean()) / density.sum() + np.sum(density * u * (c - c.mean())) / density.sum()
    flux = block_average(series)
    convective, error = flux.mean * edge / alpha, flux.sem * edge / alpha
    print(
        f"Ra {rayleigh:g}, edge {edge:g}: Nusselt number {1 + convective:.3f}({error:.3f})"
        + (f", table {TABLE[rayleigh]}, off by {100 * ((1 + convective) / TABLE[rayleigh] - 1):+.1f} %" if rayleigh in TABLE else "")
        + f"; slope of the mean value {slope:.3f}, ends {offset:.3f} and {offset + slope:.3f}; "
        f"largest u {u.max() * edge / alpha:.2f}, w {w.max() * edge / alpha:.2f}; density {density.min() / density.mean():.2f} to {density.max() / density.mean():.2f}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["diffusivity", "cavity"])
    parser.add_argument("--rayleigh", type=float, default=1e4)
    parser.add_argument("--edge", type=float, default=16.0)
    parser.add_argument("--alpha", type=float)
    parser.add_argument("--steps", type=int, default=30000)
    parser.add_argument("--runs", type=int, default=6)
    options = parser.parse_args()
    alpha = options.alpha or diffusivity(options.runs)
    if options.what == "cavity":
        convection(options.edge, options.rayleigh, alpha, options.steps)


if __name__ == "__main__":
    main()
