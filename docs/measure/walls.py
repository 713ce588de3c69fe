"""Walls with a fluid behind them: shear rate, density, temperature and stress in a channel, and the table of what beads feel near a wall.

python docs/measure/walls.py 78 3 --gamma 4.5 --time 2000         one row: repulsion and density, in units of rc, kT and the mass
python docs/measure/walls.py 25 3 --chains 2                      all beads in chains of ten with k = 2
python docs/measure/walls.py 25 3 --unlike 28                     half of the beads of a type that repels the other by this
python docs/measure/walls.py 78 3 --tau 0.01                      find the force anew, by iteration, and the slip with this tau
python docs/measure/walls.py 15 3 --times 4 --rate 0.4 --time 2400 the slip with so many times the tau of the table
python docs/measure/walls.py --write                              fit both to docs/walls.json, into openmm_dpd/plan/continuum.json
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import scipy
from numpy.polynomial import Chebyshev, polynomial

import openmm_dpd as dpd
from openmm_dpd.measure import WallReporter
from openmm_dpd.plan import continuum

ROWS = Path(__file__).parents[1] / "walls.json"
#: The numbers of terms of the force, of slices of 0.05 along the normal, and of those that make a layer; slices, and those in the middle.
EDGE, GAP, WAIT, BLOCKS, TERMS, FINE, LAYER = 4.0, 8.0, 40.0, 8, 8, 160, 4
MIDS = (np.arange(FINE) + 0.5) * GAP / FINE
INNER = np.abs(MIDS - GAP / 2) < 1.5
#: Powers that are fitted: of a beyond the first, and 1/n, in the force; of ln a, 1/n and the friction, each, in the logarithm of tau.
IN_FORCE, IN_TIME = (3, 3), [*((i, j, 0) for i in range(3) for j in range(2)), (0, 0, 1), (1, 0, 1)]


def channel(given, A: float, rho: float, time: float):
    """Histograms of beads, their velocities and kinetic energies across the flow, and beads of the type behind the wall, (blocks, 4, FINE),
    and the forces on the walls."""
    rng, n, bonds = np.random.default_rng(given.seed), round(rho * EDGE**2 * GAP), []
    x = rng.random((n, 3)) * [EDGE, EDGE, GAP]
    if given.chains:
        n -= n % 10
        x = np.cumsum(np.concatenate([x[: n // 10, None], rng.normal(size=(n // 10, 9, 3)) * 0.3], axis=1), axis=1).reshape(-1, 3)
        x[:, 2] = GAP - np.abs(GAP - np.abs(x[:, 2]))
        bonds = [dpd.HarmonicBonds([(i, i + 1) for i in range(n) if i % 10 < 9], k=given.chains, r0=0.0)]
    u = given.rate * GAP / 2
    walls = [dpd.Wall("z", z, side, velocity=(v, 0, 0), behind="W", density=rho) for z, side, v in ((0, "above", -u), (GAP, "below", u))]
    same, box = dpd.DPD(A=A, gamma=given.gamma), (EDGE, EDGE, GAP + 1)
    pairs = {("W", "W"): same, ("W", "B"): dpd.DPD(A=given.unlike or A, gamma=given.gamma), ("B", "B"): same}
    behind = np.arange(n) % 2 == 0 if given.unlike else np.ones(n, bool)
    scene = dpd.Scene({"W": 1.0, "B": 1.0}, np.where(behind, "W", "B").tolist(), x, pairs, kT=1.0, box=box, walls=walls, bonds=bonds)
    built = dpd.build(scene, dt=0.005, scheme="bababo", seed=given.seed, platform="CPU")
    simulation = built.simulation()
    simulation.step(1000)
    simulation.integrator.setStepSize(given.dt)
    simulation.step(round(WAIT / given.dt))
    forces, every, found = WallReporter(round(1 / given.dt), built), round(0.2 / given.dt), np.zeros((BLOCKS, 4, FINE))
    simulation.reporters.append(forces)
    for block in found:
        for _ in range(int(time / BLOCKS / every / given.dt)):
            simulation.step(every)
            state = simulation.context.getState(positions=True, velocities=True)
            z, v = state.getPositions(asNumpy=True)._value[:, 2], state.getVelocities(asNumpy=True)._value
            cell = np.clip((z * FINE / GAP).astype(int), 0, FINE - 1)
            for row, weights in zip(block, (None, v[:, 0], (v[:, 1] ** 2 + v[:, 2] ** 2) / 2, behind), strict=True):
                row += np.bincount(cell, weights=weights, minlength=FINE)
    return found, forces


def measures(found, forces, rate: float) -> dict[str, tuple]:
    """By name, mean and standard error: rate over the imposed one, slip length, viscosity, pressure, and layers beside the middle."""
    fit, error = np.abs(MIDS - GAP / 2) < GAP / 2 - 1.5, lambda rows: np.std(rows, axis=0, ddof=1) / BLOCKS**0.5
    u = found[:, 1] / np.maximum(found[:, 0], 1)
    slopes = np.array([np.polyfit(MIDS[fit], row[fit], 1, w=found[0, 0, fit] ** 0.5)[0] for row in u])
    count, square, its = (((part + part[:, ::-1]).reshape(BLOCKS, -1, LAYER).sum(axis=2)) for part in found[:, [0, 2, 3]].swapaxes(0, 1))
    inner = INNER[LAYER // 2 :: LAYER]
    density, heat = count / count[:, inner].mean(axis=1, keepdims=True), square / count
    share = its / count
    heat /= heat[:, inner].mean(axis=1, keepdims=True)
    ratio, ratio_error, stress, pressure = slopes.mean() / rate, error(slopes) / rate, forces.shear(), forces.pressure
    return {
        "rate": (ratio, ratio_error),
        "slip": (GAP / 2 * (1 / ratio - 1), GAP / 2 * ratio_error / ratio**2),
        "viscosity": (
            stress.mean() / slopes.mean(),
            np.hypot(stress.std() / len(stress) ** 0.5, stress.mean() * ratio_error) / slopes.mean(),
        ),
        "pressure": (pressure.mean(), pressure.std() / len(pressure) ** 0.5),
        "density": (density.mean(axis=0)[:6], error(density)[:6]),
        "kT": (heat.mean(axis=0)[:4], error(heat)[:4]),
        "share": (np.append(share.mean(axis=0)[:6], share[:, inner].mean()), error(share)[:6]),
    }


def lacking(A: float, rho: float, count) -> np.ndarray:
    """Chebyshev coefficients of the force that keeps the density flat, less that of now: to first order, the potential of the wall lacks
    kT [ln rho - (c * (rho - rho_0))], with the direct correlations c of the fluid."""
    r, _, h = continuum.fluid_structure(dpd.DPD(A=A, gamma=1), rho, 1.0)
    k, ratio = np.pi / continuum.RANGE * np.arange(1, continuum.POINTS), count + count[::-1]
    c = scipy.fft.dst(k * h / (1 + rho * h), type=1) / (4 * np.pi * continuum.RANGE * r)
    planes = np.interp(np.abs(MIDS[:, None] - MIDS), r, 2 * np.pi * r[0] * np.cumsum((c * r)[::-1])[::-1])
    ratio = ratio / ratio[INNER].mean()
    energy = np.log(ratio) - planes @ (ratio - 1) * rho * GAP / FINE
    near, span = MIDS < continuum.REACH, [0, continuum.REACH]
    x = Chebyshev([0.5, 0.5], span)
    terms = [x * (1 - x) ** 2 * Chebyshev.basis(k, span) for k in range(TERMS)]
    design = np.stack([term(MIDS[near]) for term in terms], axis=1)
    factors = np.linalg.lstsq(design, energy[near] - energy[INNER].mean(), rcond=None)[0]
    return -sum(factor * term for factor, term in zip(factors, terms, strict=True)).deriv().coef


def new_row(given, A: float, rho: float) -> dict:
    """The force found in two steps, and the slip with it."""
    force, wide = np.zeros(TERMS + 2), [[0, 1e9]] * 3
    for time in (given.time / 4, given.time, given.time):
        table = {"force": (force / A)[None, None].tolist(), "time": [[[float(np.log(given.tau))]]], "range": wide}
        continuum.wall_measures = lambda table=table: table
        found, forces = channel(given, A, rho, time)
        row = {"A": A, "rho": rho, "gamma": given.gamma, "tau": given.tau, "force": force.tolist()}
        force = force + lacking(A, rho, found[:, 0].sum(axis=0))
    return row | {"slip": measures(found, forces, given.rate)["slip"]}


def slip_row(given, A: float, rho: float) -> dict:
    """The slip with so many times the tau of the table."""
    table = continuum.wall_measures() | {"range": [[0, 1e9]] * 3}
    table["time"] = np.array(table["time"])
    table["time"][0, 0, 0] += np.log(given.times)
    continuum.wall_measures = lambda: table
    tau = float(np.exp(polynomial.polyval3d(np.log(A), 1.0 / rho, given.gamma, table["time"])))
    return {"A": A, "rho": rho, "gamma": given.gamma, "tau": tau, "slip": measures(*channel(given, A, rho, given.time), given.rate)["slip"]}


def write(rows: list[dict]) -> None:
    """Least squares over all rows.  The friction that tau adds is about as A^2 rho^2 tau; so is slip beside tau_0 - tau, with powers that are
    fitted, too.  What the blocks of a run say of its error is an estimate: none counts as less than 0.03."""
    A, rho, force = (np.array([row[name] for row in rows if "force" in row]) for name in ("A", "rho", "force"))
    design = np.stack([A**i * rho**-j for i in range(IN_FORCE[0]) for j in range(IN_FORCE[1])], axis=1)
    force = np.linalg.lstsq(design, force / A[:, None], rcond=None)[0]
    A, rho, gamma, tau, slip, error = np.array(
        [[*(row[n] for n in ("A", "rho", "gamma", "tau")), *row["slip"]] for row in rows if "slip" in row]
    ).T
    powers = np.transpose([np.log(A) ** i * rho**-j * gamma**k for i, j, k in IN_TIME])

    def left(factors):
        return slip - np.exp(factors[-3:] @ [np.ones(len(A)), np.log(A), np.log(rho)]) * (np.exp(powers @ factors[:-3]) - tau)

    start = [*np.linalg.lstsq(powers, np.log(tau), rcond=None)[0], -9.0, 2.0, 2.0]
    factors = scipy.optimize.least_squares(lambda its: left(its) / np.hypot(error, 0.03), start, loss="soft_l1", x_scale="jac").x
    time = np.zeros(np.max(IN_TIME, axis=0) + 1)
    time[tuple(np.transpose(IN_TIME))] = factors[:-3]
    digits = np.vectorize(lambda value: float(f"{value:.9g}"))
    found = {
        "script": "docs/measure/walls.py",
        "range": [[15, 80], [3, 6], [4, 45]],
        "force": digits(force.reshape(*IN_FORCE, -1)).tolist(),
    }
    found["time"] = digits(time).tolist()
    for row in np.column_stack([A, rho, gamma, tau, slip, error, left(factors)]):
        print(*np.round(row, 4))
    Path(continuum.__file__).with_suffix(".json").write_text(json.dumps(found) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fluid", type=float, nargs="*", help="A and density")
    for name, default in {
        "gamma": 4.5,
        "time": 1000.0,
        "dt": 0.03,
        "rate": 0.2,
        "seed": 1,
        "chains": None,
        "unlike": None,
        "tau": None,
        "times": None,
    }.items():
        parser.add_argument(f"--{name}", type=int if name == "seed" else float, default=default)
    parser.add_argument("--write", action="store_true")
    given, rows = parser.parse_args(), json.loads(ROWS.read_text()) if ROWS.exists() else []
    if given.write:
        write(rows)
    elif given.tau or given.times:
        rows.append((new_row if given.tau else slip_row)(given, *given.fluid))
        ROWS.write_text("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n", encoding="utf-8")
    else:
        for name, (mean, error) in measures(*channel(given, *given.fluid, given.time), given.rate).items():
            print(f"{name:9} {np.round(mean, 4)} +- {np.round(np.max(error), 4)}")


if __name__ == "__main__":
    main()
