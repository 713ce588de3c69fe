"""Chains beside LAMMPS at equal accuracy: what a unit of simulated time costs at the steps that are recommended for 1 %.

Chains of ten beads of benchmarks/atlas_parts/scenes.py, 10,000 beads, started from equilibrium.  LAMMPS (dpd + nve, the better one of two
skins) does what ``mvv`` does here, and takes the step that is recommended for it; ``benchmarks/recommended_steps.py --scheme mvv --only NAME``
runs that, and without ``--scheme`` the other.  In turn, the best of some rounds.  Writes them into docs/scaling.json
and the tables of docs/atlas.md, README and paper; a quiet machine is needed.

    python benchmarks/chain_speed.py           # three minutes
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import headline, page, peer  # noqa: E402
from atlas_parts.scenes import FIRST, SCENES  # noqa: E402
from atlas_parts.summary import machine  # noqa: E402
from atlas_parts.timing import SKINS  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.lammps import export_lammps  # noqa: E402

FILE = ROOT / "docs" / "scaling.json"
NAMES, BEADS, FRICTION, TIME = ("chains, k 100", "FENE chains, k 30, R0 1.5"), 10_000, 4.5, 4.0


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
        steps = {c.scheme: c.dt for c in found.choices}
        best: dict[tuple[str, int], float] = {}
        for _ in range(options.rounds):
            for threads in (1, 2):
                both = {found.scheme: ours(scene, found.scheme, found.dt, threads)}
                both["LAMMPS"] = min(lammps(scene, steps["mvv"], skin, threads) for skin in SKINS)
                best |= {(who, threads): min(ms, best.get((who, threads), np.inf)) for who, ms in both.items()}
        ms = {str(threads): [best[found.scheme, threads], best["LAMMPS", threads]] for threads in (1, 2)}
        ratios = {threads: theirs / steps["mvv"] / (mine / found.dt) for threads, (mine, theirs) in ms.items()}
        row = {"name": name, "beads": BEADS, "friction": FRICTION, "scheme": found.scheme, "dt": found.dt, "theirs": steps["mvv"]}
        rows.append(row | {"ms": ms, "ratios": ratios})
        print(rows[-1], flush=True)
    data = json.loads(FILE.read_text())
    data["chains"] = {"date": str(datetime.date.today()), "machine": machine(), "rows": rows}
    FILE.write_text(json.dumps(data, indent=1))
    page.update(ROOT / "docs" / "atlas.md", texts={"chains": text(data["chains"])})
    headline.publish()


def text(chains: dict) -> str:
    """The table of the page."""
    columns = [f"{what}, {page.cores_text(cores)}" for cores in (1, 2) for what in ("ms per step", "LAMMPS", "speed-up")]
    rows = [
        [row["name"], f"`{row['scheme']}` {row['dt']:.3g}", f"{row['theirs']:.2g}"]
        + [cell for c in ("1", "2") for cell in (*(f"{ms:.2f}" for ms in row["ms"][c]), f"{row['ratios'][c]:.1f}")]
        for row in chains["rows"]
    ]
    head = f"{chains['date']}, {chains['machine']['processor']}, LAMMPS {chains['machine']['lammps']}."
    return f"{head}\n\n{page.table(['chains', 'step here', 'step of LAMMPS', *columns], rows)}"


if __name__ == "__main__":
    main()
