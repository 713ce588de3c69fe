"""A film of a many-body DPD liquid pulls itself together into a drop.

The attraction (A < 0) and a repulsion that grows with the local density (B > 0) hold a liquid together without walls, so it has a surface
and a surface tension.  A flat film in an empty box is not in equilibrium: it contracts.  The relative shape anisotropy of its gyration tensor
(mdtraj) falls towards 0, the value of a sphere; local densities tell liquid from surface.

    python examples/07_droplet.py        # half a minute
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import mdtraj
import numpy as np
from openmm import app

import openmm_dpd as dpd
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
    table = {("L", "L"): dpd.MDPD(A=A, B=B, gamma=GAMMA, cutoff=CUTOFF, cutoff_B=CUTOFF_B)}
    return dpd.Scene({"L": 1.0}, ["L"] * len(positions), positions, table, kT=1.0, box=[EDGE] * 3)


def run(out: Path) -> dict[str, np.ndarray]:
    """Run it; times, anisotropy of every frame, and positions and local densities of the first and the last frame."""
    built = dpd.build(film(), dt=DT, scheme="middle", seed=5)
    write_psf(out / "drop.psf", names=built.plan.scene.types, masses=built.plan.scene.bead_masses)
    simulation = built.simulation()
    simulation.reporters.append(app.DCDReporter(str(out / "drop.dcd"), EVERY, enforcePeriodicBox=False))
    simulation.reporters.append(dpd.FieldReporter(out / "fields.npz", EVERY, built))
    simulation.step(STEPS)
    trajectory = mdtraj.load(str(out / "drop.dcd"), top=load_topology(out / "drop.psf"))
    fields = dpd.load_fields(out / "fields.npz")
    # evaporated beads are far away and would dominate the tensor: the drop is where there are neighbours
    anisotropy = []
    for frame, density in zip(trajectory, fields["density"], strict=True):
        liquid = frame.atom_slice(np.flatnonzero(density > 1.0))
        moments = np.linalg.eigvalsh(mdtraj.compute_gyration_tensor(liquid)[0])
        anisotropy.append(1 - 3 * (moments[0] * moments[1] + moments[1] * moments[2] + moments[0] * moments[2]) / moments.sum() ** 2)
    return {
        "time": fields["time"],
        "anisotropy": np.array(anisotropy),
        "first": trajectory.xyz[0],
        "last": trajectory.xyz[-1],
        "density_first": fields["density"][0],
        "density_last": fields["density"][-1],
    }


def draw(path: Path, data: dict[str, np.ndarray]) -> None:
    """Side views of the first and the last frame, coloured by local density, and the anisotropy over time."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (before, after, shape) = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained", width_ratios=(1, 1, 1.2))
    top = float(np.percentile(data["density_last"], 99))
    for axes, name in ((before, "first"), (after, "last")):
        x = data[name] - data[name].mean(axis=0)
        nearest_last = np.argsort(x[:, 1])[::-1]
        dots = axes.scatter(*x[nearest_last][:, [0, 2]].T, c=data[f"density_{name}"][nearest_last], s=6, vmin=0, vmax=top, cmap="viridis")
        axes.set(
            aspect="equal", xlim=(-7, 7), ylim=(-7, 7), xlabel="x", ylabel="z", title=f"t = {data['time'][0 if name == 'first' else -1]:g}"
        )
    figure.colorbar(dots, ax=after, label="local density")
    shape.plot(data["time"], data["anisotropy"], color="black")
    shape.set(xlabel="time", ylabel="relative shape anisotropy", ylim=(0, None), title="0 is a sphere")
    figure.savefig(path, dpi=150)


def main(out: Path = OUT) -> dict[str, float]:
    """Run and draw; anisotropy at the beginning and at the end, and the density inside the drop."""
    out.mkdir(parents=True, exist_ok=True)
    data = run(out)
    draw(out / "drop.png", data)
    centre = data["last"][data["density_last"] > 1.0].mean(axis=0)
    inner = np.linalg.norm(data["last"] - centre, axis=1) < 2.0
    found = {
        "anisotropy_first": float(data["anisotropy"][0]),
        "anisotropy_last": float(data["anisotropy"][-1]),
        "density_inside": float(inner.sum() / (4 / 3 * np.pi * 2.0**3)),
    }
    print("anisotropy {anisotropy_first:.3f} -> {anisotropy_last:.3f}; density inside the drop {density_inside:.2f}".format(**found))
    return found


if __name__ == "__main__":
    main()
