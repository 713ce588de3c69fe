"""Two immiscible fluids: from a random mixture to two layers, and the profile of the interface between them.

Beads A and B differ only in the repulsion between unlike beads, which is stronger.  The box is longer along z than across, so that the
interface ends up perpendicular to z.  The picture shows order growth and density profiles across the layers.

    python examples/04_two_fluids.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from openmm import unit

import openmm_dpd as dpd

OUT = Path("out/04_two_fluids")
BOX = (6.0, 6.0, 10.0)
DENSITY, A_LIKE, A_UNLIKE, GAMMA, DT = 3.0, 25.0, 40.0, 4.5, 0.05
STEPS, EVERY, PROFILE_FROM, BINS = 12000, 25, 0.5, 60


def scene(seed: int = 1) -> dpd.Scene:
    """A random mixture, half and half."""
    rng = np.random.default_rng(seed)
    n = round(DENSITY * BOX[0] * BOX[1] * BOX[2])
    like, unlike = dpd.DPD(A=A_LIKE, gamma=GAMMA, cutoff=1.0), dpd.DPD(A=A_UNLIKE, gamma=GAMMA, cutoff=1.0)
    return dpd.Scene(
        masses={"A": 1.0, "B": 1.0},
        types=["A"] * (n // 2) + ["B"] * (n - n // 2),
        positions=rng.random((n, 3)) * BOX,
        pairs={("*", "*"): like, ("A", "B"): unlike},
        kT=1.0,
        box=BOX,
    )


def first_mode(z: np.ndarray, is_a: np.ndarray) -> complex:
    """First Fourier component of the composition along z; its phase is the position of the layer of A."""
    return complex(np.mean(np.where(is_a, 1.0, -1.0) * np.exp(2j * np.pi * z / BOX[2])))


def profile(z: np.ndarray, centre: float) -> np.ndarray:
    """Density in BINS slabs, with the layer of A shifted to the middle of the box."""
    shifted = (z - centre + 0.5 * BOX[2]) % BOX[2]
    return np.histogram(shifted, bins=BINS, range=(0.0, BOX[2]))[0] * BINS / (BOX[0] * BOX[1] * BOX[2])


def run() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, order parameter, and mean profiles of A and B over the last part of the run."""
    mixture = scene()
    simulation = dpd.build(mixture, dt=DT, scheme="middle", seed=5).simulation()
    is_a = np.array(mixture.types) == "A"
    # two flat layers of equal thickness have 2/pi
    full = 2 / np.pi
    times, order, profiles = [], [], []
    for step in range(0, STEPS + 1, EVERY):
        if step:
            simulation.step(EVERY)
        z = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)[:, 2]
        mode = first_mode(z, is_a)
        times.append(step * DT)
        order.append(abs(mode) / full)
        if step >= PROFILE_FROM * STEPS:
            centre = np.angle(mode) / (2 * np.pi) * BOX[2]
            profiles.append((profile(z[is_a], centre), profile(z[~is_a], centre)))
    mean_a, mean_b = np.mean(profiles, axis=0)
    return np.array(times), np.array(order), mean_a, mean_b


def picture(path: Path, times: np.ndarray, order: np.ndarray, mean_a: np.ndarray, mean_b: np.ndarray) -> None:
    """Order against time, and the profile."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained", dpi=150)
    left.axvspan(PROFILE_FROM * times[-1], times[-1], color="0.94", linewidth=0)
    left.text(0.5 * (1 + PROFILE_FROM) * times[-1], 0.03, "profile", ha="center", color="0.4", fontsize=9)
    left.plot(times, order, color="0.2", linewidth=1.5)
    left.set(xlabel="time", ylabel="order (1: two flat layers)", xlim=(0, times[-1]), ylim=(0, 1.05))
    z = (np.arange(BINS) + 0.5) / BINS * BOX[2] - 0.5 * BOX[2]
    right.plot(z, mean_a + mean_b, color="0.6", linewidth=1.2, label="all")
    right.plot(z, mean_a, color="#1f5a99", linewidth=1.8, label="A")
    right.plot(z, mean_b, color="#b3541e", linewidth=1.8, label="B")
    right.set(xlabel="z from the middle of the layer of A", ylabel="density", xlim=(z[0], z[-1]), ylim=(0, None))
    right.legend(frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0)
    for axis in (left, right):
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """Run and draw; order at the start and at the end, purity of the layers, dip of the density at the interface."""
    out.mkdir(parents=True, exist_ok=True)
    times, order, mean_a, mean_b = run()
    picture(out / "two_fluids.png", times, order, mean_a, mean_b)
    total, middle = mean_a + mean_b, slice(BINS * 4 // 10, BINS * 6 // 10)
    return {
        "order_at_start": float(order[0]),
        "order_at_end": float(order[times >= 0.9 * times[-1]].mean()),
        "purity_of_A": float(mean_a[middle].sum() / total[middle].sum()),
        "lowest_density": float(total.min() / DENSITY),
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:16s} {value:.4f}")
    print(f"picture: {OUT / 'two_fluids.png'}")
