"""Radial distribution function of the DPD fluid with mdtraj, and its virial pressure.

Runs the standard fluid (density 3, A = 25, gamma = 4.5, kT = 1), writes a DCD trajectory with a PSF topology, reads it back in chunks and
averages g(r).  The virial theorem gives the pressure

    P = rho kT + (2 pi/3) rho^2 A int r^3 (1 - r) g(r) dr,

which is compared with the mean written by the reporter during the run.

    python examples/02_rdf_mdtraj.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import mdtraj
import numpy as np
from openmm import app

import openmm_dpd as dpd
from openmm_dpd.trajectory import load_topology, write_psf

OUT = Path("out/02_rdf_mdtraj")
N, DENSITY, A, GAMMA, KT, DT = 3000, 3.0, 25.0, 4.5, 1.0, 0.04
EQUILIBRATION, STEPS, EVERY = 1000, 3000, 25
CENTRES, R_MAX, BINS, CHUNK = 300, 3.0, 120, 10


def simulate(out: Path) -> float:
    """Run the fluid; mean conservative pressure from the reporter."""
    edge = (N / DENSITY) ** (1 / 3)
    positions = np.random.default_rng(1).random((N, 3)) * edge
    scene = dpd.Scene({"W": 1.0}, ["W"] * N, positions, {("W", "W"): dpd.DPD(A=A, gamma=GAMMA, cutoff=1.0)}, kT=KT, box=[edge] * 3)
    built = dpd.build(scene, dt=DT, scheme="middle", seed=11)
    write_psf(out / "fluid.psf", names=scene.types, masses=scene.bead_masses)
    simulation = built.simulation()
    simulation.step(EQUILIBRATION)
    simulation.reporters.append(app.DCDReporter(str(out / "fluid.dcd"), EVERY))
    simulation.reporters.append(dpd.DPDReporter(str(out / "fluid.csv"), EVERY, built, ("step", "kT", "pressure_conservative")))
    simulation.step(STEPS)
    return float(np.loadtxt(out / "fluid.csv", delimiter=",", skiprows=1)[:, 2].mean())


def distribution(out: Path) -> tuple[np.ndarray, np.ndarray]:
    """Distances and g(r), averaged over the trajectory in chunks of CHUNK frames."""
    topology = load_topology(out / "fluid.psf")
    # distances of some beads to all others suffice: CENTRES * (N - 1) per frame
    pairs = topology.select_pairs(range(CENTRES), range(N))
    total, frames = np.zeros(BINS), 0
    for piece in mdtraj.iterload(str(out / "fluid.dcd"), top=topology, chunk=CHUNK):
        r, g = mdtraj.compute_rdf(piece, pairs, r_range=(0.0, R_MAX), n_bins=BINS)
        total += g * piece.n_frames
        frames += piece.n_frames
    return r, total / frames


def pressure(r: np.ndarray, g: np.ndarray) -> float:
    """Virial pressure from g(r)."""
    integrand = np.where(r < 1.0, r**3 * A * (1.0 - r) * g, 0.0)
    # mdtraj divides by the number of pairs, N(N - 1)/2, so that g tends to 1 in a finite box, too
    return DENSITY * KT + 2 * np.pi / 3 * DENSITY**2 * (1 - 1 / N) * float(np.sum(integrand) * (r[1] - r[0]))


def picture(path: Path, r: np.ndarray, g: np.ndarray) -> None:
    """Draw g(r)."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6.4, 4.0), layout="constrained", dpi=150)
    axis.axhline(1.0, color="0.75", linewidth=0.8)
    axis.axvline(1.0, color="0.75", linewidth=0.8, linestyle=":")
    axis.text(1.02, 0.08, "cutoff", color="0.4", fontsize=9)
    axis.plot(r, g, color="#1f5a99", linewidth=1.8)
    axis.set(xlabel="distance $r$", ylabel="$g(r)$", xlim=(0, R_MAX), ylim=(0, None))
    axis.set_title(f"DPD fluid, density {DENSITY:g}, $A$ = {A:g}, {N:,} beads", fontsize=11)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """Run, analyse, draw; the two pressures and the first peak."""
    out.mkdir(parents=True, exist_ok=True)
    measured = simulate(out)
    r, g = distribution(out)
    np.savetxt(out / "rdf.csv", np.column_stack([r, g]), delimiter=",", header="r,g", comments="")
    picture(out / "rdf.png", r, g)
    return {"pressure_measured": measured, "pressure_from_rdf": pressure(r, g), "peak_at": float(r[g.argmax()]), "peak": float(g.max())}


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:18s} {value:.4f}")
    print(f"picture: {OUT / 'rdf.png'}")
