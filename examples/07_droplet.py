"""A film of a many-body DPD liquid contracts into a drop.

The attraction (A < 0) and a repulsion that grows with the local density (B > 0) hold a liquid together without walls, so it has a surface
and a surface tension.  A flat film in an empty box is not in equilibrium: it contracts.  The relative shape anisotropy of its gyration
tensor (mdtraj) falls towards 0, the value of a sphere, and the local densities distinguish liquid from surface.

    python examples/07_droplet.py        # a quarter of a minute
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import mdtraj
import numpy as np
from openmm import app, unit

import openmm_dpd as dpd
from openmm_dpd.stats import block_average
from openmm_dpd.trajectory import load_topology, write_psf

OUT = Path("out/07_droplet")
EDGE, FILM, DENSITY = 20.0, (12.0, 9.0, 2.4), 6.0
A, B, GAMMA, CUTOFF, CUTOFF_B = -40.0, 25.0, 4.5, 1.0, 0.75
DT, STEPS, EVERY = 0.02, 2000, 25


def film() -> dpd.Scene:
    """A slab of liquid in the middle of an empty box, on a cubic lattice."""
    spacing = DENSITY ** (-1 / 3)
    axes = [np.arange(-width / 2, width / 2, spacing) for width in FILM]
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + EDGE / 2
    liquid = dpd.MDPD(A=A, B=B, gamma=GAMMA, cutoff=CUTOFF, cutoff_B=CUTOFF_B, kernel="quadratic")
    return dpd.Scene({"L": 1.0}, ["L"] * len(positions), positions, {("L", "L"): liquid}, kT=1.0, box=[EDGE] * 3)


def run(out: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and local densities of the start and of every frame."""
    scene = film()
    built = dpd.build(scene, dt=DT, scheme="middle", seed=5)
    write_psf(out / "drop.psf", names=scene.types, masses=scene.bead_masses)
    simulation = built.simulation()
    # reporters start after the first interval
    start = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    density = dpd.read_fields(simulation.context, built.plan)["density"]
    simulation.reporters.append(app.DCDReporter(str(out / "drop.dcd"), EVERY, enforcePeriodicBox=False))
    simulation.reporters.append(dpd.FieldReporter(out / "fields.npz", EVERY, built))
    simulation.step(STEPS)
    xyz = mdtraj.load(str(out / "drop.dcd"), top=load_topology(out / "drop.psf")).xyz
    fields = dpd.load_fields(out / "fields.npz")
    return np.append(0.0, fields["time"]), np.concatenate([[start], xyz]), np.concatenate([[density], fields["density"]])


def anisotropies(out: Path, xyz: np.ndarray, density: np.ndarray) -> np.ndarray:
    """1 - 3 (l1 l2 + l2 l3 + l3 l1)/(l1 + l2 + l3)^2 of every frame, with l the principal moments: 0 for a sphere, 1/4 for a disc."""
    topology = load_topology(out / "drop.psf")
    found = []
    for frame, of_frame in zip(xyz, density, strict=True):
        # a bead without neighbours has left the liquid; far away, it would dominate the tensor
        liquid = mdtraj.Trajectory(frame, topology).atom_slice(np.flatnonzero(of_frame > 0))
        a, b, c = np.linalg.eigvalsh(mdtraj.compute_gyration_tensor(liquid)[0])
        found.append(1 - 3 * (a * b + b * c + c * a) / (a + b + c) ** 2)
    return np.array(found)


def inner_density(xyz: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Beads per volume within half the radius of the drop, in every frame."""
    radius = 0.5 * (3 * len(density[0]) / (4 * np.pi * DENSITY)) ** (1 / 3)
    centres = [frame[of_frame > 0].mean(axis=0) for frame, of_frame in zip(xyz, density, strict=True)]
    inside = [np.sum(np.linalg.norm(frame - centre, axis=1) < radius) for frame, centre in zip(xyz, centres, strict=True)]
    return np.array(inside) / (4 / 3 * np.pi * radius**3)


def draw(path: Path, times: np.ndarray, xyz: np.ndarray, density: np.ndarray, anisotropy: np.ndarray) -> None:
    """Slices of three frames coloured by local density, and the anisotropy over time."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(12.4, 3.3), layout="constrained", dpi=150, width_ratios=(1, 1, 1, 1.1))
    halfway = int(np.argmax(anisotropy < 0.5 * anisotropy[0]))
    shown = (0, halfway, len(times) - 1)
    top, reach = float(np.percentile(density[-1], 99)), 0.55 * max(FILM)
    for axis, k in zip(axes, shown, strict=False):
        x = xyz[k] - xyz[k].mean(axis=0)
        cut = np.flatnonzero(np.abs(x[:, 1]) < 1.0)
        cut = cut[np.argsort(-x[cut, 1])]
        dots = axis.scatter(x[cut, 0], x[cut, 2], c=density[k][cut], s=16, vmin=0, vmax=top, cmap="viridis", linewidth=0)
        axis.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x", title=f"t = {times[k]:g}")
        axis.locator_params(nbins=3)
    axes[0].set_ylabel("z   (beads with |y| < 1)")
    # the density in the forces: weighted neighbour counts within cutoff_B, without the bead itself
    figure.colorbar(dots, ax=axes[:3], label="density of neighbours", pad=0.01)
    curve = axes[3]
    curve.plot(times, anisotropy, color="0.2", linewidth=1.5)
    curve.plot(times[list(shown)], anisotropy[list(shown)], "o", color="#b3541e", markersize=6, clip_on=False, zorder=3)
    curve.set(xlabel="time", ylabel="shape anisotropy (0: sphere)", box_aspect=1, xlim=(0, times[-1]), ylim=(0, None))
    curve.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """Run and draw; anisotropy at the start and over the last quarter, and the density inside the drop over the last half."""
    out.mkdir(parents=True, exist_ok=True)
    times, xyz, density = run(out)
    anisotropy = anisotropies(out, xyz, density)
    draw(out / "drop.png", times, xyz, density, anisotropy)
    inside = block_average(inner_density(xyz, density)[len(times) // 2 :])
    return {
        "anisotropy_first": float(anisotropy[0]),
        "anisotropy_last": float(anisotropy[3 * len(times) // 4 :].mean()),
        "density_inside": float(inside.mean),
        "density_error": float(inside.sem),
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:18s} {value:.4f}")
    print(f"picture: {OUT / 'drop.png'}")
