"""Time and memory per bead, from a thousand to a million beads of the standard fluid (density 3, A 25, gamma 4.5).

Every scheme runs at its own step, the longest of docs/atlas.json with both temperatures within 1 %, and so does LAMMPS (the better one of two
skins), in turn, each in a process of its own, all from the same fluid in equilibrium and over as many steps; the best of two rounds counts (of
a million beads there is one).  Memory is the peak of a process less the peak of one in which OpenMM alone holds as many
particles (a Topology, a System, a VerletIntegrator, a Simulation on the same platform), beside a very small
scene.  Writes docs/scaling.json, the picture docs/figures/scaling.png, the table of docs/atlas.md, and those of speeds in README and paper.

    python benchmarks/scaling.py                 # twenty-five minutes on a quiet machine
    python benchmarks/scaling.py --only memory   # that alone, for the sizes of the JSON that is there
    python benchmarks/scaling.py --only page     # picture and tables, from the JSON that is there
"""

from __future__ import annotations

import argparse
import datetime
import functools
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
import openmm.app

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import headline, page, peer  # noqa: E402
from atlas_parts.fluids import FLUIDS, method_of  # noqa: E402
from atlas_parts.summary import machine  # noqa: E402
from atlas_parts.timing import SKINS  # noqa: E402

import openmm_dpd as dpd  # noqa: E402

FLUID, DENSITY = FLUIDS["weak"], 3.0
SIZES = (1000, 10_000, 100_000, 1_000_000)
SCHEMES = ("mvv", "middle", "bababo", "bab3")
#: LAMMPS's methods: what its users have, and its cheapest one.
PEERS = ("LAMMPS dpd + nve", "LAMMPS dpd + mvv/dpd, lambda 0.65")


@functools.cache
def step_of(method: str) -> float:
    """Longest step with both temperatures within 1 %, or the longest one measured."""
    atlas = json.loads((ROOT / "docs" / "atlas.json").read_text(encoding="utf-8"))
    limits = atlas["fluids"][FLUID.name]["methods"][method]["limits"]
    found = min(limits[measure].get("dt") or limits[measure]["at_least"] for measure in ("T_conf", "T_kin"))
    return float(f"{found:.3g}")


def scene_of(beads: int, start: str = "") -> dpd.Scene:
    """Beads on a slightly disordered lattice, which are made in no time and have no hot pairs; or where a file has them."""
    edge = (beads / DENSITY) ** (1 / 3)
    if start:
        with np.load(start) as found:
            positions, velocities = found["positions"], found["velocities"]
    else:
        cells = int(np.ceil(beads ** (1 / 3)))
        rng = np.random.default_rng(1)
        sites = np.stack(np.unravel_index(np.sort(rng.permutation(cells**3)[:beads]), (cells,) * 3), axis=1) * (edge / cells)
        positions, velocities = (sites + 0.1 * rng.random((beads, 3))) % edge, rng.normal(size=(beads, 3))
    pairs = {("W", "W"): dpd.DPD(A=25.0, gamma=4.5)}
    return dpd.Scene({"W": 1.0}, ["W"] * beads, positions, pairs, kT=1.0, box=[edge] * 3, velocities=velocities)


def settle(beads: int, file: Path) -> None:
    """Write a start in equilibrium, after five units of time: from a lattice LAMMPS's lists last longer than they do later."""
    simulation = running("bab3", beads, 2)[0]
    simulation.step(int(5.0 / step_of("bab3")))
    state = simulation.context.getState(positions=True, velocities=True, enforcePeriodicBox=True)
    np.savez(file, positions=state.getPositions(asNumpy=True)._value, velocities=state.getVelocities(asNumpy=True)._value)


def peak() -> float:
    """Largest memory of this process so far, bytes."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def steps_for(beads: int) -> int:
    """So many that LAMMPS makes several lists: some ten seconds on one core, and of a million beads twice that."""
    return int(np.clip(2e7 / beads, 40, 4000))


def running(kind: str, beads: int, threads: int, start: str = "") -> tuple[openmm.app.Simulation, float]:
    """A scene that is ready to step, and how long that took to make."""
    dpd.set_threads(threads)
    begun = time.perf_counter()
    built = dpd.build(scene_of(beads, start), dt=step_of(kind), scheme=kind, platform="CPU", seed=1)
    return built.simulation(properties={"Threads": str(threads)}), time.perf_counter() - begun


def speed(kind: str, beads: int, threads: int, start: str) -> dict:
    """Nanoseconds per bead and step, in this process."""
    simulation, building = running(kind, beads, threads, start)
    steps = steps_for(beads)
    simulation.step(max(20, steps // 5))
    begun = time.perf_counter()
    simulation.step(steps)
    return {"ns": 1e9 * (time.perf_counter() - begun) / steps / beads, "build": building}


def memory(kind: str, beads: int) -> dict:
    """Peak of the memory of this process with a scheme, or with OpenMM alone (kind "openmm")."""
    # what Python, numba and the compiled kernels take at any size
    running("middle", 375, 1)[0].step(5)
    if kind != "openmm":
        running(kind, beads, 1)[0].step(5)
        return {"peak": peak()}
    topology, system = openmm.app.Topology(), openmm.System()
    chain = topology.addChain()
    for _ in range(beads):
        topology.addAtom("W", None, topology.addResidue("W", chain))
        system.addParticle(1.0)
    platform = openmm.Platform.getPlatformByName("CPU")
    simulation = openmm.app.Simulation(topology, system, openmm.VerletIntegrator(0.01), platform, {"Threads": "1"})
    simulation.context.setPositions(scene_of(beads).positions)
    simulation.step(5)
    return {"peak": peak()}


def lammps(name: str, beads: int, threads: int, start: str) -> float:
    """Nanoseconds per bead and step of a method of LAMMPS."""
    method, dt, steps = method_of(FLUID.name, name), step_of(name), steps_for(beads)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        data = folder / "data"
        data.write_text(peer.data_file(scene_of(beads, start), method))
        decks = [peer.timing_lines(FLUID, method, data, dt, steps, skin) for skin in SKINS]
        return 1e6 * min(peer.timed(deck, folder, folder, steps, threads) for deck in decks) / beads


def spawned(what: str, kind: str, beads: int, threads: int = 1, start: str = "") -> dict:
    """A measurement in a new process."""
    command = [sys.executable, __file__, "--child", what, kind, str(beads), str(threads), start]
    environment = os.environ | {"OMP_NUM_THREADS": str(threads), "NUMBA_NUM_THREADS": str(threads)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise SystemExit(f"{kind}, {beads} beads: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout.splitlines()[-1])


def times(beads: int, threads: list[int]) -> dict:
    """Times of one size: of everything in turn, the best of all rounds."""
    row: dict = {"beads": beads, "ns": {name: {} for name in (*SCHEMES, *PEERS)}, "build": {}}
    with tempfile.TemporaryDirectory() as place:
        start = f"{place}/start.npz"
        spawned("settle", "bab3", beads, start=start)
        for count in map(str, threads):
            for _ in range(2 if beads < 500_000 else 1):
                for name in SCHEMES:
                    found = spawned("speed", name, beads, int(count), start)
                    row["ns"][name][count] = min(found["ns"], row["ns"][name].get(count, np.inf))
                    row["build"][name] = found["build"]
                for name in PEERS:
                    row["ns"][name][count] = min(lammps(name, beads, int(count), start), row["ns"][name].get(count, np.inf))
    return row


def ratio(data: dict, row: dict, peer: str, cores: str) -> float:
    """How many times less wall time the cheapest scheme takes for the same simulated time than a method of LAMMPS, each at its own step."""
    cost = {name: row["ns"][name][cores] / data["steps"][name] for name in row["ns"]}
    return cost[peer] / min(cost[name] for name in SCHEMES)


def memories(beads: int) -> dict:
    """Bytes per bead beside OpenMM's own."""
    alone = spawned("memory", "openmm", beads)["peak"]
    return {scheme: (spawned("memory", scheme, beads)["peak"] - alone) / beads for scheme in SCHEMES}


def draw(data: dict, file: Path) -> None:
    """Time and memory per bead against the number of beads."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4.4), layout="constrained")
    rows, beads = data["rows"], [row["beads"] for row in data["rows"]]
    for number, name in enumerate((*SCHEMES, *PEERS)):
        theirs = name in PEERS
        color = ("black", "gray")[PEERS.index(name)] if theirs else f"C{number}"
        for count, style in (("1", "-"), ("2", "--")):
            if count in rows[0]["ns"][name]:
                cost = [1e-3 * row["ns"][name][count] / data["steps"][name] for row in rows]
                cores = "1 core" if count == "1" else f"{count} cores"
                left.plot(beads, cost, style, marker="o", fillstyle="none" if theirs else "full", color=color, label=f"{name}, {cores}")
        if not theirs:
            right.plot(beads, [row["memory"][name] for row in rows], marker="o", color=color, label=name)
    left.set(xscale="log", yscale="log", xlabel="beads", ylabel="microseconds per bead and unit of time", title="cost at 1 %")
    left.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
    left.set_yticks([], minor=True)
    right.axhline(1000, color="gray", linewidth=0.8)
    right.set(xscale="log", xlabel="beads", ylabel="bytes per bead beside OpenMM's own", title="memory")
    right.set_ylim(bottom=0)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize="small")
    figure.savefig(file, dpi=130)
    plt.close(figure)


def text(data: dict) -> str:
    """The table of the page."""
    names = {name: f"`{name}`" for name in SCHEMES} | {name: name.partition(",")[0] for name in PEERS}
    header = ["beads", *(f"{n}, {page.cores_text(c)}" for n in names.values() for c in data["threads"]),
              *(f"ratio to {names[n]}, {page.cores_text(c)}" for n in PEERS for c in data["threads"]), "memory, `middle`", "building, `middle`"]  # fmt: skip
    cells = []
    for row in data["rows"]:
        times = [f"{row['ns'][n][str(c)]:.0f}" for n in names for c in data["threads"]]
        ratios = [f"{ratio(data, row, n, str(c)):.1f}" for n in PEERS for c in data["threads"]]
        cells.append([f"{row['beads']:,}", *times, *ratios, f"{row['memory']['middle']:.0f} B", f"{row['build']['middle']:.1f} s"])
    m = data["machine"]
    steps = ", ".join(f"{text} {data['steps'][n]:g}" for n, text in names.items())
    head = f"{data['date']}, {m['processor']}, {m['cores']} cores; times in nanoseconds per bead and step; steps: {steps}."
    return f"{head}\n\n{page.table(header, cells)}"


def publish(data: dict) -> None:
    """Picture and tables."""
    draw(data, ROOT / "docs" / "figures" / "scaling.png")
    file = ROOT / "docs" / "atlas.md"
    file.write_text(page.replaced(file.read_text(), "scaling", text(data)))
    headline.publish()


def main() -> None:
    """Measure and write, or only one of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", nargs="+", type=int, default=list(SIZES))
    parser.add_argument("--cores", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--only", choices=("memory", "page"))
    parser.add_argument("--dry", action="store_true", help="print only, write nothing")
    parser.add_argument("--child", nargs=5, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        what, kind, beads, threads, start = options.child
        if what == "settle":
            settle(int(beads), Path(start))
        print(
            json.dumps(
                speed(kind, int(beads), int(threads), start) if what == "speed" else memory(kind, int(beads)) if what == "memory" else {}
            )
        )
        return
    file = ROOT / "docs" / "scaling.json"
    data: dict = {"date": str(datetime.date.today()), "machine": machine(), "threads": options.cores, "rows": []}
    data["steps"] = {name: step_of(name) for name in (*SCHEMES, *PEERS)}
    before = json.loads(file.read_text())
    data["chains"] = before["chains"]  # those are benchmarks/chain_speed.py's
    if options.only:
        data = before
    for row in data["rows"] if options.only else (times(beads, options.cores) for beads in options.sizes):
        if options.only != "page":
            row["memory"] = memories(row["beads"])
            print(json.dumps(row), flush=True)
        if not options.only:
            data["rows"].append(row)
    if not options.dry:
        file.write_text(json.dumps(data, indent=1))
        publish(data)


if __name__ == "__main__":
    main()
