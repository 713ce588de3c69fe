"""Averages of the plugin openmm-dpd-device beside those of the host: temperatures, energy, pressure and g(r) of every named scheme.

    python benchmarks/device_physics.py                      # a quarter of an hour on two cores and PoCL
    python benchmarks/device_physics.py --platform CUDA --beads 24000 --time 1000
    python benchmarks/device_physics.py --many-body --beads 1000 --time 40   # a liquid of many-body DPD instead
    python benchmarks/device_physics.py --flows --platform Reference --time 240 --schemes middle mvv   # a shear, and walls that move

The standard fluid at gamma = 4.5 and dt = 0.05, each number with its standard error; then the diffusion coefficient of ``middle`` at gamma =
40.5 and dt = 0.1, beside that of the host at a step of 0.02.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts.drivers import ours  # noqa: E402
from atlas_parts.fluids import Method  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.analysis import couette_viscosity, shear_viscosity  # noqa: E402
from openmm_dpd.measure import ProfileReporter, StressReporter, WallReporter  # noqa: E402
from openmm_dpd.model.schemes import SCHEMES  # noqa: E402

QUANTITIES = ("T_kin", "T_conf", "U", "P")


def compared(found: dict, other: dict) -> str:
    """Numbers of two runs, the second as a difference in per cent; of g(r) the largest difference and the largest in standard errors."""
    text = []
    for name in QUANTITIES:
        (mean, error), (reference, uncertain) = found[name], other[name]
        text.append(
            f"{name} {mean:.4f}({error:.4f}) {100 * (mean / reference - 1):+.2f}({100 * np.hypot(error, uncertain) / reference:.2f}) %"
        )
    g, reference = (np.array(run["g"]) for run in (found, other))
    difference = np.abs(g.mean(axis=0) - reference.mean(axis=0))
    error = np.sqrt(sum(blocks.var(axis=0, ddof=1) / len(blocks) for blocks in (g, reference)))
    largest = float(np.max(difference[error > 0] / error[error > 0]))
    return "  ".join(text) + f"  g {difference.max():.4f}, {largest:.1f} errors at most in {len(difference)} bins"


def many_body(given: argparse.Namespace, scheme: str, dt: float, precision: str, kernel: str) -> dict[str, tuple[float, float]]:
    """Mean and standard error of kinetic temperature, energy and pressure of a liquid at density 6; without a precision on the host."""
    edge = (given.beads / 6) ** (1 / 3)
    pairs = {("W", "W"): dpd.MDPD(A=-40, B=25, gamma=4.5, kernel=kernel)}
    start = np.random.default_rng(given.seed).random((given.beads, 3)) * edge
    scene = dpd.Scene({"W": 1}, ["W"] * given.beads, start, pairs, kT=1, box=[edge] * 3)
    where = {"platform": given.platform, "engine": "device"} if precision else {"platform": "CPU", "engine": "host"}
    built = dpd.build(scene, dt=dt, scheme=scheme, seed=given.seed, **where)
    simulation = built.simulation(properties={"Precision": precision} if precision else {"Threads": "1"})
    simulation.minimizeEnergy(maxIterations=20)
    simulation.step(int(5 / dt))
    observer, samples = dpd.Observer(built), []
    for _ in range(int((given.time if precision else 2 * given.time) / dt / 10)):
        simulation.step(10)
        sample = observer.sample(simulation.context)
        samples.append((2 * sample.kinetic / (3 * given.beads - 3), sample.potential / given.beads, sample.pressure()))
    blocks = np.array(samples)[: len(samples) // 20 * 20].reshape(20, -1, 3).mean(axis=1)
    ends = zip(blocks.mean(axis=0), blocks.std(axis=0, ddof=1) / np.sqrt(20), strict=True)
    return dict(zip(("T_kin", "U", "P"), ends, strict=True))


def started(given: argparse.Namespace, scene: dpd.Scene, dt: float, scheme: str, precision: str):
    """A scene built, and its Simulation after 30 ps; without a precision on the host."""
    where = {"platform": given.platform, "engine": "device"} if precision else {"platform": "CPU", "engine": "host"}
    built = dpd.build(scene, dt=dt, scheme=scheme, seed=given.seed, **where)
    numbers = {"Precision": precision} if precision and given.platform != "Reference" else {}
    simulation = built.simulation(properties=numbers if precision else {"Threads": "1"})
    simulation.step(int(30 / dt))
    return built, simulation


def sheared(given: argparse.Namespace, scheme: str, precision: str) -> str:
    """Viscosity of 375 beads in a shear of 0.6."""
    x, fluid = np.random.default_rng(given.seed).random((375, 3)) * 5, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    scene = dpd.Scene({"W": 1}, ["W"] * 375, x, fluid, kT=1, box=[5.0] * 3, shear=dpd.LeesEdwards(rate=0.6))
    built, simulation = started(given, scene, 0.04, scheme, precision)
    stress = StressReporter(2, built)
    simulation.reporters.append(stress)
    simulation.step(int(given.time / 0.04))
    found = shear_viscosity(stress)
    return f"viscosity {found.viscosity:.3f}({found.error:.3f})"


def between_walls(given: argparse.Namespace, scheme: str, precision: str) -> str:
    """Shear rate (0.2 if nothing slips), viscosity and pressure between walls with a fluid behind them."""
    gap, edge, n, fluid = 6.0, 4.0, 288, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    sides = ((0, "above", -0.6), (gap, "below", 0.6))
    walls = [dpd.Wall("z", z, side, velocity=(u, 0, 0), behind="W", density=3.0) for z, side, u in sides]
    x = np.random.default_rng(given.seed).random((n, 3)) * [edge, edge, gap]
    scene = dpd.Scene({"W": 1}, ["W"] * n, x, fluid, kT=1, box=[edge, edge, gap + 1], walls=walls)
    built, simulation = started(given, scene, 0.03, scheme, precision)
    steps = int(given.time / 0.03)
    profile, forces = ProfileReporter(5, built, bins=35), WallReporter(steps // 30, built)
    simulation.reporters += [profile, forces]
    simulation.step(steps)
    fit = couette_viscosity(profile.profile, forces.shear(), channel=(0, gap), skip=1.5)
    pressure = forces.pressure.ravel()
    return (
        f"rate {fit.rate:.3f}({fit.rate_error:.3f})  viscosity {fit.viscosity:.2f}({fit.error:.2f})  "
        f"P {pressure.mean():.2f}({pressure.std(ddof=1) / np.sqrt(pressure.size):.2f})"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--platform", default="OpenCL")
    parser.add_argument("--precision", nargs="+", default=["single", "mixed"])
    parser.add_argument("--schemes", nargs="+", default=[name for name, known in SCHEMES.items() if not known.native])
    parser.add_argument("--beads", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--time", type=float, default=150.0, help="of the device; the host's runs are twice as long")
    parser.add_argument("--many-body", action="store_true")
    parser.add_argument("--flows", action="store_true", help="a shear, and walls but with mvv, of one --precision, and the host as long")
    given = parser.parse_args()
    dpd.set_threads(1)
    for kernel in ("quadratic", "lucy") if given.many_body else ():
        for scheme in given.schemes:
            host = many_body(given, scheme, 0.02, "", kernel)
            for precision in given.precision:
                found = many_body(given, scheme, 0.02, precision, kernel)
                text = (f"{name} {a[0]:.4f}({a[1]:.4f}), host {host[name][0]:.4f}({host[name][1]:.4f})" for name, a in found.items())
                print(f"{kernel:9s} {scheme:9s} {precision:7s} {'  '.join(text)}", flush=True)
    for scheme in given.schemes if given.flows else ():
        for flow in (sheared, between_walls)[: 1 if SCHEMES[scheme].predicts else 2]:
            for precision in (given.precision[-1], ""):
                print(
                    f"{scheme:9s} {flow.__name__:13s} {'device' if precision else 'host':6s} {flow(given, scheme, precision)}", flush=True
                )
    if given.many_body or given.flows:
        return
    job = {"beads": given.beads, "seed": given.seed, "kT": 1.0, "equilibrate": 20.0}

    def run(fluid: str, scheme: str, dt: float, time: float, precision: str = "") -> dict:
        device = {"platform": given.platform, "engine": "device", "precision": precision} if precision else {"engine": "host"}
        times = {"dt": dt, "time": time, "discard": 0.1 * time}
        return ours(job | times | {"fluid": fluid}, Method(scheme, "ours", "", scheme, **device), Path(folder))

    with tempfile.TemporaryDirectory() as folder:
        for scheme in given.schemes:
            host = run("weak", scheme, 0.05, 2 * given.time)
            for precision in given.precision:
                print(f"{scheme:9s} {precision:7s} {compared(run('weak', scheme, 0.05, given.time, precision), host)}", flush=True)
        limit = run("strong", "middle", 0.02, 4 * given.time)["D"]
        found = run("strong", "middle", 0.1, 3 * given.time, given.precision[0])["D"]
        error = np.hypot(found[1], limit[1]) / limit[0]
        print(
            f"D {found[0]:.4f}({found[1]:.4f}), limit {limit[0]:.4f}({limit[1]:.4f}): {100 * (found[0] / limit[0] - 1):+.1f}({100 * error:.1f}) %"
        )


if __name__ == "__main__":
    main()
