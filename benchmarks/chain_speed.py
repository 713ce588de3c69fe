"""Chains beside LAMMPS at equal accuracy: what a unit of simulated time costs at the steps that are recommended for 1 %.

Chains of ten beads of benchmarks/atlas_parts/scenes.py, 10,000 beads, started from equilibrium.  LAMMPS (dpd + nve, the better one of two
skins) does what ``mvv`` does here, and takes the step that is recommended for it; ``benchmarks/recommended_steps.py --scheme mvv --only NAME``
runs that, and without ``--scheme`` the other.  In turn, the best of some rounds.  Writes the table of docs/atlas.md; a quiet machine is needed.

    python benchmarks/chain_speed.py           # three minutes
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import page, peer  # noqa: E402
from atlas_parts.scenes import FIRST, SCENES  # noqa: E402
from atlas_parts.summary import machine  # noqa: E402
from atlas_parts.timing import SKINS  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.lammps import export_lammps  # noqa: E402

NAMES, BEADS, TIME = ("chains, k 100", "FENE chains, k 30, R0 1.5"), 10_000, 4.0


def equilibrium(scene: dpd.Scene) -> dpd.Scene:
    """The scene some time later, which is enough for the bonds and for what beads are near each other."""
    built = dpd.build(scene, dt=FIRST, scheme="middle", platform="CPU", seed=1)
    simulation = built.simulation()
    simulation.step(round(TIME / FIRST))
    state = simulation.context.getState(positions=True, velocities=True)
    x, v = (array._value for array in (state.getPositions(asNumpy=True), state.getVelocities(asNumpy=True)))
    return dataclasses.replace(scene, positions=x, velocities=v)


def ours(scene: dpd.Scene, scheme: str, dt: float, threads: int) -> float:
    """ms per step."""
    dpd.set_threads(threads)
    simulation = dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=1).simulation(properties={"Threads": str(threads)})
    simulation.step(50)
    begun = time.perf_counter()
    simulation.step(200)
    return (time.perf_counter() - begun) / 200 * 1e3


def lammps(scene: dpd.Scene, dt: float, skin: float, threads: int) -> float:
    """The same of LAMMPS."""
    with tempfile.TemporaryDirectory() as folder:
        deck = export_lammps(scene, folder, "chains", dt=dt, steps=200).deck.read_text()
        head = deck.partition("thermo_style")[0].replace("neighbor 0.3 bin", f"neighbor {skin:g} bin")
        lines = [*head.splitlines(), "comm_modify vel yes cutoff 2.0", "thermo 1000000", "run 50", "run 200"]
        return peer.timed(lines, Path(folder), Path(folder), 200, threads)


def main() -> None:
    """Time and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=2)
    options = parser.parse_args()
    rows = []
    for name in NAMES:
        scene = equilibrium(SCENES[name](BEADS))
        found = dpd.recommend(scene)
        steps, cells = {c.scheme: c.dt for c in found.choices}, []
        best: dict[tuple[str, int], float] = {}
        for _ in range(options.rounds):
            for threads in (1, 2):
                both = {found.scheme: ours(scene, found.scheme, found.dt, threads)}
                both["LAMMPS"] = min(lammps(scene, steps["mvv"], skin, threads) for skin in SKINS)
                best |= {(who, threads): min(ms, best.get((who, threads), np.inf)) for who, ms in both.items()}
        for threads in (1, 2):
            mine, theirs = best[found.scheme, threads], best["LAMMPS", threads]
            cells += [f"{mine:.2f}", f"{theirs:.2f}", f"{theirs / steps['mvv'] / (mine / found.dt):.1f}"]
        rows.append([name, f"`{found.scheme}` {found.dt:.3g}", f"{steps['mvv']:.2g}", *cells])
        print(rows[-1], flush=True)
    columns = [f"{what}, {cores} core(s)" for cores in (1, 2) for what in ("ms per step", "LAMMPS", "times less wall time")]
    head = f"{datetime.date.today()}, {machine()['processor']}, LAMMPS {machine()['lammps']}."
    table = page.table(["chains", "step here", "step of LAMMPS", *columns], rows)
    page.update(ROOT / "docs" / "atlas.md", texts={"chains": f"{head}\n\n{table}"})


if __name__ == "__main__":
    main()
