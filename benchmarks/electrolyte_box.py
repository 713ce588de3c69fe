"""The electrolyte of in.electrolyte in its own box of 375 beads and in one of 3,000, beside LAMMPS, at the same error of the energy.

The steps are those at which the potential energy is off by 1 % of kT (docs/atlas.json): how an error grows with the step does not depend on
the size of the box.  What is timed is one step, in one chain on the same cores, the best of several rounds.

    python benchmarks/electrolyte_box.py --threads 1
    python benchmarks/electrolyte_box.py --threads 2
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import openmm_dpd as dpd

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import peer  # noqa: E402
from atlas_parts.fluids import DECKS, FLUIDS  # noqa: E402

FLUID = FLUIDS["electrolyte"]
LAMMPS = "LAMMPS dpd + charges + nve"


def tiled(scene: dpd.Scene, times: int) -> dpd.Scene:
    """So many copies of a scene without bonds along each edge of its box."""
    cells = np.stack(np.meshgrid(*[np.arange(times)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) @ scene.box
    n = len(cells)
    return replace(
        scene,
        types=list(scene.types) * n,
        positions=(scene.positions[None] + cells[:, None]).reshape(-1, 3),
        velocities=np.tile(scene.velocities, (n, 1)),
        box=scene.box * times,
        charges=np.tile(scene.charges, n),
        bead_masses=None,
    )


def longest_steps() -> dict[str, float]:
    """Step of each method at which the potential energy is off by 1 % of kT."""
    atlas = json.loads((ROOT / "docs" / "atlas.json").read_text(encoding="utf-8"))
    methods = atlas["fluids"]["electrolyte"]["methods"]
    return {name: entry["limits"]["U"]["dt"] for name, entry in methods.items() if entry["limits"].get("U", {}).get("dt")}


def ours(scene: dpd.Scene, scheme: str, dt: float, steps: int, threads: int) -> float:
    """ms per step, after a time of 2."""
    built = dpd.build(scene, dt=0.01, scheme=scheme, platform="CPU", seed=1)
    simulation = built.simulation(properties={"Threads": str(threads)})
    simulation.step(200)
    simulation.integrator.setStepSize(dt)
    simulation.step(20)
    begun = time.perf_counter()
    simulation.step(steps)
    return (time.perf_counter() - begun) / steps * 1e3


def lammps(times: int, dt: float, steps: int, threads: int) -> float:
    """The same of LAMMPS, with its own start."""
    lines = []
    for line in peer.deck_lines(FLUID.deck):
        lines.append(line)
        if line.split()[:1] == ["read_data"] and times > 1:
            lines.append(f"replicate {times} {times} {times}")
    lines += ["thermo 1000000", "run 200", f"timestep {dt!r}", "run 20", f"run {steps}"]
    with tempfile.TemporaryDirectory() as folder:
        return peer.timed(lines, Path(folder), DECKS, steps, threads)


def main() -> None:
    """Print a line for each box and method."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--steps", type=int, default=300, help="in the small box; an eighth in the large one")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--schemes", nargs="+", default=["middle", "aboba", "bababo"])
    options = parser.parse_args()
    dpd.set_threads(options.threads)
    limits, scene = longest_steps(), FLUID.scene(0, 1)
    for times in (1, 2):
        box, steps = tiled(scene, times), max(20, options.steps // times**3)
        best: dict[str, float] = {}
        for _ in range(options.rounds):
            found = {LAMMPS: lammps(times, limits[LAMMPS], steps, options.threads)}
            found |= {scheme: ours(box, scheme, limits[scheme], steps, options.threads) for scheme in options.schemes}
            best = {name: min(ms, best.get(name, np.inf)) for name, ms in found.items()}
        per_time = {name: ms / limits[name] for name, ms in best.items()}
        for name, ms in best.items():
            ratio = per_time[LAMMPS] / per_time[name]
            print(
                f"{box.n_beads} beads, {options.threads} core(s), {name}: dt {limits[name]:.4f}, {ms:.3f} ms a step, {ratio:.2f} times as fast"
            )


if __name__ == "__main__":
    main()
