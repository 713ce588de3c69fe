"""Lipids in water: self-assembly of a bilayer from a random mixture.

The lipid is that of Grafmueller, Shillcock and Lipowsky, Biophys. J. 96, 2658 (2009): three head beads and two stiff tails of four.  The
model's numbers are in ``openmm_dpd.molecules.grafmueller_2009``.  The box is longer along z than across, and the number of lipids gives a
bilayer across z an area per lipid of 1.40, near 1.38 where its tension vanishes.  For comparison a bilayer is built from upright lipids;
both must end up equally thick.  The thickness is the distance between the mean heights of the heads in the two leaflets.

    python examples/09_lipid_bilayer.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import mdtraj
import numpy as np
from openmm import app

import openmm_dpd as dpd
from openmm_dpd.analysis import bilayer_thickness, density_profile
from openmm_dpd.molecules import Bilayer, Mixture, Scattered, grafmueller_2009, pack, relax
from openmm_dpd.stats import block_average
from openmm_dpd.trajectory import load, load_topology

OUT = Path("out/09_lipid_bilayer")
BOX, LIPIDS = (7.0, 7.0, 11.0), 70
DT, STEPS, EVERY = 0.04, 8000, 40
PROFILE_FROM = 0.5  # averages are over the second half of a run
SEED, SLICES = 1, 88

MODEL = grafmueller_2009()


def mixture(arrangement: Scattered | Bilayer) -> Mixture:
    """Lipids, and water up to the density of the model."""
    return pack({MODEL.molecule: arrangement}, solvent="W", density=MODEL.density, box=BOX, seed=SEED)


def simulate(name: str, arrangement: Scattered | Bilayer, steps: int, out: Path) -> mdtraj.Trajectory:
    """Run from this arrangement, writing topology and trajectory."""
    lipids = mixture(arrangement)
    start = relax(lipids.scene(pairs=MODEL.pairs(), kT=1.0))
    simulation = dpd.build(start, dt=DT, scheme="middle", seed=SEED).simulation()
    lipids.write_psf(out / f"{name}.psf")
    simulation.reporters.append(app.DCDReporter(str(out / f"{name}.dcd"), EVERY))
    simulation.step(steps)
    simulation.reporters.clear()  # closes the file
    return load(out / f"{name}.dcd", load_topology(out / f"{name}.psf"))


def order(trajectory: mdtraj.Trajectory) -> np.ndarray:
    """First Fourier component of the density of the tails along z: 0 if spread evenly, 1 in a thin layer."""
    z = trajectory.xyz[:, trajectory.topology.select("name T"), 2] / trajectory.unitcell_lengths[:, None, 2]
    return np.abs(np.mean(np.exp(2j * np.pi * z), axis=1))


def last(trajectory: mdtraj.Trajectory) -> mdtraj.Trajectory:
    """The part to average over."""
    return trajectory[int(PROFILE_FROM * len(trajectory)) :]


def analyse(assembled: mdtraj.Trajectory, prepared: mdtraj.Trajectory) -> tuple[dict[str, float], dict]:
    """Numbers, and the profiles across the self-assembled bilayer."""
    numbers = {"order_at_start": float(order(assembled)[0]), "order_at_end": block_average(order(last(assembled))).mean}
    for name, trajectory in (("assembled", assembled), ("prepared", prepared)):
        thickness = bilayer_thickness(last(trajectory), "H", "T", axis="z")
        numbers[f"thickness_{name}"], numbers[f"thickness_{name}_error"] = thickness.mean, thickness.sem or 0.0
    profiles = density_profile(last(assembled), axis="z", n_bins=SLICES, centre="T")
    water, heads = profiles["W"], profiles["H"]
    numbers["water_inside"] = float(np.mean(water.y[np.abs(water.x) < 0.5]))
    numbers["peak_to_peak"] = peak(heads.x, heads.y * (heads.x > 0)) - peak(heads.x, heads.y * (heads.x < 0))
    return numbers, profiles


def peak(z: np.ndarray, density: np.ndarray) -> float:
    """Position of a peak: the vertex of a parabola through the logarithms of its upper half."""
    top = density > 0.5 * density.max()
    curvature, slope, _ = np.polyfit(z[top], np.log(density[top]), 2)
    return float(-slope / (2 * curvature))


def draw_beads(axis, trajectory: mdtraj.Trajectory, frame: int, title: str) -> None:
    """Heads and tails of one frame, seen from the side."""
    edges = trajectory.unitcell_lengths[frame]
    for name, colour in (("T", "#c9a227"), ("H", "#1f5a99")):
        x = trajectory.xyz[frame, trajectory.topology.select(f"name {name}")]
        near = x[:, 1] % edges[1] < 0.5 * edges[1]
        axis.scatter(*(x[near][:, [0, 2]] % edges[[0, 2]]).T, s=7, color=colour, linewidths=0)
    axis.set(xlim=(0, edges[0]), ylim=(0, edges[2]), aspect="equal", xticks=[], yticks=[], title=title)


def picture(path: Path, assembled: mdtraj.Trajectory, profiles: dict, thickness: float) -> None:
    """First and last configuration, the time series, and the profiles."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(11.0, 3.8), layout="constrained", dpi=150, width_ratios=[0.8, 0.8, 1.2, 1.5])
    draw_beads(axes[0], assembled, 0, f"t = {DT * EVERY:.1f}")
    draw_beads(axes[1], assembled, -1, f"t = {DT * EVERY * len(assembled):.0f}")
    axes[2].plot(DT * EVERY * np.arange(1, len(assembled) + 1), order(assembled), color="#c9a227")
    axes[2].set(xlabel="time", ylabel="order of the tails along z", ylim=(0, 1))
    for name, label, colour in (("W", "water", "#7fb2d9"), ("H", "heads", "#1f5a99"), ("T", "tails", "#c9a227")):
        axes[3].plot(profiles[name].x, profiles[name].y, color=colour, label=label)
    axes[3].axvspan(-thickness / 2, thickness / 2, color="0.93", zorder=0)
    axes[3].set(xlabel="distance from the middle", ylabel="density", ylim=(0, None))
    axes[3].legend(frameon=False)
    for axis in axes[2:]:
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """Run twice, analyse, draw."""
    out.mkdir(parents=True, exist_ok=True)
    assembled = simulate("assembled", Scattered(LIPIDS), STEPS, out)
    prepared = simulate("prepared", Bilayer(LIPIDS), STEPS // 2, out)
    numbers, profiles = analyse(assembled, prepared)
    picture(out / "bilayer.png", assembled, profiles, numbers["thickness_assembled"])
    return {"area_per_lipid": 2 * BOX[0] * BOX[1] / LIPIDS} | numbers


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:26s} {value:.3f}")
    print(f"picture: {OUT / 'bilayer.png'}")
