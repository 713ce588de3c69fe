"""A melt of molecules with three arms gels: the ends of the arms are bonded when they meet.

Each end has one valence.  As the reaction goes on, molecules join to clusters, and at the gel point one of them fills the box.  Without
rings, as Flory and Stockmayer reckon, that is where half of the ends have reacted; in the melt some arms of one molecule, or of neighbours,
find each other, so the gel comes later.

    python examples/18_network.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

import openmm_dpd as dpd
from openmm_dpd.analysis import gel_fraction, network

OUT = Path("out/18_network")
MOLECULES, DENSITY, RATE = 600, 3.0, 0.1
DT, EVERY, CONVERSION = 0.04, 10, 0.93  # step, steps between trials, and where the run ends


def scene(seed: int = 1) -> dpd.Scene:
    """Molecules of a centre C and three ends E."""
    rng = np.random.default_rng(seed)
    edge = (4 * MOLECULES / DENSITY) ** (1 / 3)
    centres = rng.random((MOLECULES, 1, 3)) * edge
    positions = np.concatenate([centres, centres + 0.5 * rng.normal(size=(MOLECULES, 3, 3))], axis=1).reshape(-1, 3)
    arms = 4 * np.arange(MOLECULES)[:, None, None] + np.array([[0, 1], [0, 2], [0, 3]])
    made = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 20.0, "r0": 0.5})
    return dpd.Scene(
        masses={"C": 1.0, "E": 1.0},
        types=["C", "E", "E", "E"] * MOLECULES,
        positions=positions,
        pairs={("*", "*"): dpd.DPD(A=25.0, gamma=4.5)},
        kT=1.0,
        box=[edge] * 3,
        bonds=[dpd.HarmonicBonds(arms.reshape(-1, 2), k=20.0, r0=0.5)],
        reactions=[dpd.BondFormation(made, ("E", "E"), within=0.8, valences=1, rate=RATE, every=EVERY)],
    )


def react(out: Path) -> np.ndarray:
    """Time, conversion, gel fraction and mean size of the other clusters, (rows, 4)."""
    melt = scene()
    built = dpd.build(melt, dt=DT, platform="CPU", seed=2)
    simulation = built.simulation()
    simulation.reporters.append(dpd.ReactionReporter(out / "events.csv", 10 * EVERY, built))
    ends, first, rows = 3 * MOLECULES, np.arange(melt.n_beads) % 4 == 0, []
    while not rows or rows[-1][1] < CONVERSION:
        simulation.step(EVERY)
        bonds = dpd.read_bonds(simulation.context, built.plan)[:, :2]
        found = network(np.vstack([melt.bond_pairs, bonds]), melt.n_beads, units=first)
        rows.append((simulation.currentStep * DT, 2 * len(bonds) / ends, found.gel, found.mean_size))
    return np.array(rows)


def picture(path: Path, rows: np.ndarray) -> None:
    """Conversion against time; gel and sol against conversion."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    time, conversion, gel, size = rows.T
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.6), layout="constrained", dpi=150)
    left.plot(time, conversion, color="#1f5a99")
    left.set(xlabel="time", ylabel="part of the ends that have reacted", ylim=(0, 1))
    p = np.linspace(0, 1, 400)
    right.plot(p, gel_fraction(p, 3), color="0.5", linewidth=1.2, label="gel: Flory, Stockmayer")
    right.plot(conversion, gel, color="#1f5a99", label="gel: largest cluster")
    right.plot(conversion, size / size.max(), color="#c2571a", linewidth=1.2, label="mean size of the others")
    right.set(xlabel="part of the ends that have reacted", ylabel="part of the molecules", xlim=(0, 1), ylim=(0, 1.02))
    right.legend(frameon=False, loc="upper left", fontsize=8)
    for axis in (left, right):
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """React, draw; the gel fraction where 80 % have reacted, beside theory, and the conversion where the sol's clusters are largest."""
    out.mkdir(parents=True, exist_ok=True)
    rows = react(out)
    picture(out / "network.png", rows)
    return {
        "gel": float(np.interp(0.8, rows[:, 1], rows[:, 2])),
        "gel_in_theory": float(gel_fraction(0.8, 3)),
        "gel_point": float(rows[np.argmax(rows[:, 3]), 1]),
        "time": float(rows[-1, 0]),
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:14s} {value:.3f}")
    print(f"picture: {OUT / 'network.png'}")
