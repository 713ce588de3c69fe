"""The plugin openmm-dpd-device on whatever device there is, one table: steps, differences from the host, temperatures, launches' cost, memory.
"arrays" are bytes of the plugin's arrays on the device for each bead, "process" what the process has grown by: OpenMM's arrays, too, where the
device is the CPU, and Python's.

    python benchmarks/device.py                                    # the fastest platform with the plugin
    python benchmarks/device.py --platform CUDA --beads 10000 100000 1000000
    python benchmarks/device.py --platform OpenCL --beads 3000 --seconds 2

Standard fluid: rho = 3, A = 25, gamma = 4.5, rc = 1, dt = 0.04, beside OpenMM's DPDIntegrator on the same device ("native", by turns) and its LangevinMiddleIntegrator
with the same repulsion, which is no DPD.  Rows are appended to --json, which a page of numbers can be made of.
"""

from __future__ import annotations

import argparse
import importlib
import json
import platform as machine
import resource
import time
from pathlib import Path

import numpy as np
import openmm

import openmm_dpd as dpd
from openmm_dpd.plan.forces.device_force import why_no_plugin
from openmm_dpd.simulation.device_check import differences
from openmm_dpd.units import BOLTZMANN

DT, GAMMA = 0.04, 4.5
SCHEMES = ("mvv", "middle", "aboba", "bababo", "shardlow")


def fluid(beads: int) -> dpd.Scene:
    """The standard fluid as it is after long: neighbours have numbers that are far apart."""
    edge = (beads / 3) ** (1 / 3)
    side = int(np.ceil(beads ** (1 / 3)))
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * 3), -1).reshape(-1, 3)[:beads] * (edge / side)
    positions = lattice + np.random.default_rng(1).random((beads, 3)) * (0.3 * edge / side)
    positions = positions[np.random.default_rng(2).permutation(beads)]
    return dpd.Scene({"W": 1}, ["W"] * beads, positions, {("W", "W"): dpd.DPD(A=25, gamma=GAMMA)}, kT=1, box=[edge] * 3)


def langevin(scene: dpd.Scene, platform: str, properties: dict[str, str]) -> openmm.app.Simulation:
    """OpenMM's Langevin dynamics with the same repulsion."""
    built = dpd.build(scene, dt=DT, scheme="native", platform=platform, seed=1)
    integrator = openmm.LangevinMiddleIntegrator(1 / BOLTZMANN, 1, DT)
    simulation = openmm.app.Simulation(built.topology, built.system, integrator, openmm.Platform.getPlatformByName(platform), properties)
    simulation.context.setPositions(built.positions)
    simulation.context.setVelocities(built.velocities)
    return simulation


def times(simulations: list[openmm.app.Simulation], seconds: float) -> list[float]:
    """Seconds per step of each, the best of five by turns, after as many to warm up."""

    def run(simulation: openmm.app.Simulation, n: int) -> float:
        begun = time.perf_counter()
        simulation.step(n)
        simulation.context.getState(velocities=True)
        return (time.perf_counter() - begun) / n

    steps = []
    for simulation in simulations:
        run(simulation, 10)
        steps.append(max(10, int(seconds / max(run(simulation, 20), 1e-7))))
    rounds = [[run(*each) for each in zip(simulations, steps, strict=True)] for _ in range(5)]
    return [min(found) for found in zip(*rounds, strict=True)]


def kinetic_kT(simulation: openmm.app.Simulation, samples: int = 20) -> float:
    """Mean kinetic temperature of some samples, ten steps apart."""
    found = []
    for _ in range(samples):
        simulation.step(10)
        v = simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value
        found.append(np.sum(v**2) / (3 * len(v) - 3))
    return float(np.mean(found))


def resident() -> int:
    """Bytes of this process in memory, those of the device where it is the CPU included."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def arrays() -> int:
    """Bytes of the plugin's arrays on devices."""
    return importlib.import_module("openmm_dpd_device").bytes_of_arrays()


def made(name: str, beads: int, platform: str, precision: str) -> tuple[dict[str, object], openmm.app.Simulation]:
    """A row but for times and temperatures, and its Simulation."""
    scene, properties = fluid(beads), {"Precision": precision} if platform in ("OpenCL", "CUDA", "HIP") else {}
    before, had, begun = resident(), arrays(), time.perf_counter()
    row: dict[str, object] = {"platform": platform, "precision": precision, "beads": beads, "scheme": name}
    if name == "langevin":
        simulation = langevin(scene, platform, properties)
    else:
        engine = "auto" if name == "native" else "device"
        built = dpd.build(scene, dt=DT, scheme=name, platform=platform, seed=1, engine=engine)
        simulation = built.simulation(properties=properties)
    simulation.step(1)
    row["built_s"] = time.perf_counter() - begun
    if name not in ("langevin", "native") and beads <= 100_000:
        row |= {what: error for what, (error, _) in differences(simulation.context, built.plan).items()}
    row["array_bytes_per_bead"] = (arrays() - had) / beads
    row["bytes_per_bead"] = (resident() - before) / beads
    return row, simulation


def measure(names: list[str], beads: int, platform: str, precision: str, seconds: float) -> list[dict[str, object]]:
    """Rows of all schemes, timed by turns."""
    rows, simulations = zip(*(made(name, beads, platform, precision) for name in names), strict=True)
    found = times(list(simulations), seconds)
    native = found[names.index("native")] if "native" in names else float("nan")
    for row, simulation, spent in zip(rows, simulations, found, strict=True):
        row |= {"steps_per_s": 1 / spent, "of_native": spent / native}
        row["kT"] = kinetic_kT(simulation)
    return list(rows)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--platform", default=None)
    parser.add_argument("--precision", nargs="+", default=["single", "mixed"])
    parser.add_argument("--beads", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--schemes", nargs="+", default=[*SCHEMES, "native", "langevin"])
    parser.add_argument("--seconds", type=float, default=2.0, help="of one measurement")
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    here = [openmm.Platform.getPlatform(k) for k in range(openmm.Platform.getNumPlatforms())]
    able = {p.getName(): p.getSpeed() for p in here if why_no_plugin(p.getName()) is None}
    if not able:
        raise SystemExit(f"no platform has the plugin: {why_no_plugin('CUDA')}")
    platform = given.platform or max(able, key=lambda name: able[name])
    if platform not in able:
        raise SystemExit(f"no measurements on {platform}: {why_no_plugin(platform)}")
    print(f"{platform}, {machine.processor() or machine.machine()}, OpenMM {openmm.version.short_version}; dt = {DT}, gamma = {GAMMA}")
    heads = f"{'beads':>9} {'precision':>9} {'scheme':>9} {'steps/s':>10} {'of native':>9} {'kT':>7} {'built, s':>9} {'arrays':>6} {'process':>7}"
    print(f"{heads}  differences from the host")
    rows: list[dict[str, object]] = []
    for beads in given.beads:
        for precision in given.precision if platform != "Reference" else ["double"]:
            found = measure(given.schemes, beads, platform, precision, given.seconds)
            for row in found:
                errors = ", ".join(f"{what} {error:.1e}" for what, error in row.items() if what.startswith(("the ", "its ", "friction")))
                print(
                    f"{beads:9d} {precision:>9} {row['scheme']:>9} {row['steps_per_s']:10.1f} {row['of_native']:9.3f} {row['kT']:7.4f} "
                    f"{row['built_s']:9.2f} {row['array_bytes_per_bead']:6.0f} {row['bytes_per_bead']:7.0f}  {errors}",
                    flush=True,
                )
            rows += found
            if given.json is not None:
                given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
