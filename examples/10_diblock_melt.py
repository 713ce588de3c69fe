"""A melt of symmetric diblock copolymers: the peak of its structure factor, compared with the random phase approximation.

In chains A5B5 the repulsion between A and B is stronger by a few units; all else is equal.  Their composition fluctuates most at the wave
number q* at which the two connected blocks can separate farthest.  In the random phase approximation (RPA; L. Leibler, Macromolecules 13,
1602 (1980)) q* follows from the shape of one chain alone,

    S(q) = 4 / (F(q) - 2 chi),   F = (S_AA + S_BB + 2 S_AB) / (S_AA S_BB - S_AB^2),

where S_AA, S_BB and S_AB are scattering functions of a single chain per bead, here those of a Gaussian chain of ten beads with the
measured radius of gyration.  S is that of the difference of A and B, which tends to 1 for large q.  The parameter chi = 0.306 (a_AB - a)
is from Groot and Warren, J. Chem. Phys. 107, 4423 (1997), for chains.  RPA holds for weak repulsion; as the melt approaches the ordering
transition, the peak grows less than predicted and moves to smaller q.

    python examples/10_diblock_melt.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import mdtraj
import numpy as np
from openmm import app
from scipy.optimize import curve_fit, minimize_scalar

import openmm_dpd as dpd
from openmm_dpd.analysis import structure_factor
from openmm_dpd.molecules import Spring, block_copolymer, pack, relax
from openmm_dpd.trajectory import load, load_topology

OUT = Path("out/10_diblock_melt")
BLOCK, CHAINS, DENSITY = 5, 300, 3.0
A_LIKE, EXCESS, GAMMA = 25.0, (0.0, 1.0, 2.0), 4.5
SPRING = Spring(k=2.0, r0=0.0)  # U = 2 r^2, that is a force of -4 r
DT, EQUILIBRATION, STEPS, EVERY = 0.05, 1000, 3000, 40
CHI_SLOPE, Q_MAX, SEED = 0.306, 3.6, 1

CHAIN = block_copolymer(f"A{BLOCK}B{BLOCK}", SPRING)


def simulate(excess: float, out: Path) -> mdtraj.Trajectory:
    """Trajectory of a melt with this excess repulsion between A and B."""
    melt = pack({CHAIN: CHAINS}, solvent=None, density=DENSITY, seed=SEED)
    pairs = {("*", "*"): dpd.DPD(A=A_LIKE, gamma=GAMMA), ("A", "B"): dpd.DPD(A=A_LIKE + excess, gamma=GAMMA)}
    start = relax(melt.scene(pairs=pairs, kT=1.0))
    simulation = dpd.build(start, dt=DT, scheme="middle", seed=SEED).simulation()
    simulation.step(EQUILIBRATION)
    melt.write_psf(out / "melt.psf")
    path = out / f"melt_{excess:g}.dcd"
    simulation.reporters.append(app.DCDReporter(str(path), EVERY))
    simulation.step(STEPS)
    simulation.reporters.clear()  # closes the file
    return load(path, load_topology(out / "melt.psf"))


def composition_factor(trajectory: mdtraj.Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wave numbers, and the structure factor of the difference of A and B with its standard error."""
    aa, bb, ab = (structure_factor(trajectory, a, b, q_max=Q_MAX, width=1e-3) for a, b in (("A", None), ("B", None), ("A", "B")))
    return aa.x, 0.5 * (aa.y + bb.y) - ab.y, np.sqrt(0.25 * (aa.sem**2 + bb.sem**2) + ab.sem**2)


def chain_size(trajectory: mdtraj.Trajectory) -> float:
    """Root mean square radius of gyration; chains are whole in the file, and all masses are equal."""
    x = trajectory.xyz.astype(np.float64).reshape(len(trajectory), CHAINS, 2 * BLOCK, 3)
    return float(np.sqrt(np.mean(np.sum((x - x.mean(axis=2, keepdims=True)) ** 2, axis=3))))


def rpa_denominator(q, size: float) -> np.ndarray:
    """F(q) of a Gaussian chain of discrete beads with this radius of gyration."""
    n = 2 * BLOCK
    bond_squared = 6 * n * size**2 / (n**2 - 1)
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    waves = np.exp(-(np.asarray(q)[..., None, None] ** 2) * bond_squared * apart / 6) / n
    aa, bb = waves[..., :BLOCK, :BLOCK].sum(axis=(-2, -1)), waves[..., BLOCK:, BLOCK:].sum(axis=(-2, -1))
    ab = waves[..., :BLOCK, BLOCK:].sum(axis=(-2, -1))
    return (aa + bb + 2 * ab) / (aa * bb - ab**2)


def rpa_peak(size: float) -> float:
    """q* of the random phase approximation."""
    return float(minimize_scalar(lambda q: float(rpa_denominator(q, size)), bounds=(0.2 / size, 6 / size), method="bounded").x)


def peak(q: np.ndarray, s: np.ndarray, sem: np.ndarray) -> tuple[float, float]:
    """Position and height of the maximum: the RPA's own shape fitted to all points, with free size, height and chi."""

    def shape(q, size, scale, chi):
        return scale * 4 / (rpa_denominator(q, size) - 2 * chi)

    found, _ = curve_fit(shape, q, s, p0=(1.3, 1.0, 0.1), sigma=np.maximum(sem, 0.02 * s))
    top = rpa_peak(found[0])
    return top, float(shape(top, *found))


def picture(path: Path, found: dict) -> None:
    """Structure factors and the random phase approximation."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6.0, 4.4), layout="constrained", dpi=150)
    line = np.linspace(0.3, Q_MAX, 200)
    for (excess, (q, s, sem, size)), colour in zip(found.items(), ("#7fb2d9", "#1f5a99", "#c0392b", "0.3"), strict=False):
        axis.errorbar(q, s, yerr=sem, fmt="o", markersize=3.5, color=colour, label=f"$a_{{AB}} - a$ = {excess:g}")
        axis.plot(line, 4 / (rpa_denominator(line, size) - 2 * CHI_SLOPE * excess), color=colour, linewidth=1)
        axis.axvline(rpa_peak(size), color=colour, linewidth=0.6, linestyle=":")
    axis.plot([], [], color="0.3", linewidth=1, label="RPA, nothing fitted")
    axis.set(xlabel="wave number q", ylabel="structure factor of the composition", xlim=(0, Q_MAX), ylim=(0, None))
    axis.legend(frameon=False)
    axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """Run all melts, analyse, draw."""
    out.mkdir(parents=True, exist_ok=True)
    found, numbers = {}, {}
    for excess in EXCESS:
        trajectory = simulate(excess, out)
        q, s, sem = composition_factor(trajectory)
        size = chain_size(trajectory)
        found[excess] = q, s, sem, size
        top = rpa_peak(size)
        place, height = peak(q, s, sem)
        numbers |= {
            f"Rg_{excess:g}": size,
            f"peak_at_{excess:g}": place,
            f"peak_at_{excess:g}_rpa": top,
            f"height_{excess:g}": height,
            f"height_{excess:g}_rpa": float(4 / (rpa_denominator(top, size) - 2 * CHI_SLOPE * excess)),
        }
    picture(out / "diblock.png", found)
    return numbers


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:16s} {value:.3f}")
    print(f"picture: {OUT / 'diblock.png'}")
