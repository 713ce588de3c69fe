"""A drop of a many-body DPD liquid on a wall, and its contact angle.

The wall attracts beads by a potential of their height alone, here that of Morse: the deeper it is, the flatter the drop.  A block of liquid
becomes a cap of a ball.  Its density in rings around its own axis gives the circle of half the density, and that the contact angle
(docs/measure/contact_angle.py compares such angles with Young's equation).

    python examples/20_drop_on_wall.py        # two minutes
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from openmm import app

import openmm_dpd as dpd
from openmm_dpd.analysis import ContactAngle, contact_angle
from openmm_dpd.trajectory import load, write_psf

OUT = Path("out/20_drop_on_wall")
#: Box, block of liquid, depth of the potential, height of its minimum, height of the surface of the wall (Gibbs's dividing surface).
BOX, BLOCK, DEPTH, PLACE, SURFACE = (18.0, 18.0, 14.0), (10.0, 10.0, 4.0), 0.8, 1.0, 0.65
DT, EQUILIBRATION, STEPS, EVERY = 0.02, 5000, 15000, 50


def drop() -> dpd.Scene:
    """A block of liquid on the wall, on a cubic lattice."""
    spacing = 6.0 ** (-1 / 3)
    axes = [np.arange(spacing / 2, edge, spacing) for edge in BLOCK]
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + [4.0, 4.0, SURFACE]
    liquid = dpd.MDPD(A=-40, B=25, gamma=4.5, cutoff=1.0, cutoff_B=0.75, kernel="quadratic")
    e = f"exp(-2*(z-{PLACE}))"  # U = DEPTH ((1 - e)^2 - 1)
    # with a lid: a bead that evaporates would go round through the periodic boundary, and gain energy from the wall each time
    wall = dpd.PositionForce(("0", "0", f"-{4 * DEPTH}*(1-{e})*{e}-100*max(0,z-{BOX[2] - 1})"))
    return dpd.Scene({"L": 1.0}, ["L"] * len(positions), positions, {("L", "L"): liquid}, kT=1.0, box=BOX, body_forces=[wall])


def main(out: Path = OUT) -> dict[str, float]:
    """Run, print and draw; returns the numbers."""
    out.mkdir(parents=True, exist_ok=True)
    scene = drop()
    built = dpd.build(scene, dt=DT, scheme="middle", seed=1)
    write_psf(out / "drop.psf", names=scene.types, masses=scene.bead_masses)
    simulation = built.simulation()
    simulation.step(EQUILIBRATION)
    simulation.reporters.append(app.DCDReporter(str(out / "drop.dcd"), EVERY, enforcePeriodicBox=False))
    simulation.step(STEPS)
    found = contact_angle(load(out / "drop.dcd", out / "drop.psf"), surface=SURFACE, n_bins=(30, 46), skip=1.0)
    draw(out / "drop.png", found)
    print(f"contact angle  {found.angle.mean:.1f} +- {found.angle.sem:.1f} degrees, radius {found.radius.mean:.2f}")
    return {"angle": found.angle.mean, "error": found.angle.sem, "radius": found.radius.mean, "density": found.density.mean}


def draw(path: Path, found: ContactAngle) -> None:
    """Density in a plane through the axis, the circle, and the tangent where it meets the wall."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(8.0, 4.6), layout="constrained")
    r, z, density = *np.moveaxis(found.profile.x, 2, 0), found.profile.y
    r, z, density = (np.concatenate([part[::-1], part]) for part in (np.abs(r), z, density))
    r[: len(r) // 2] *= -1
    drawn = axis.pcolormesh(r, z, density, cmap="viridis", vmin=0, vmax=1.3 * found.density.mean, shading="nearest", rasterized=True)
    figure.colorbar(drawn, ax=axis, label="density")
    axis.contour(r, z, density, levels=[0.5 * found.density.mean], colors="white", linewidths=1.2)
    turn = np.linspace(0, 2 * np.pi, 400)
    x, y = found.radius.mean * np.sin(turn), found.surface + found.height.mean + found.radius.mean * np.cos(turn)
    above = np.where(y > found.surface, y, np.nan)
    axis.plot(x, above, color="#e8743b", linewidth=2, linestyle="--")
    foot, angle = np.sqrt(found.radius.mean**2 - found.height.mean**2), np.radians(found.angle.mean)
    axis.plot([foot, foot - 3 * np.cos(angle)], [found.surface, found.surface + 3 * np.sin(angle)], color="#e8743b", linewidth=2)
    axis.axhspan(0, found.surface, color="0.75", zorder=3)
    title = f"Half density (white), circle and tangent (orange): {found.angle.mean:.1f} degrees"
    axis.set(xlabel="distance from the axis", ylabel="height", aspect="equal", ylim=(0, 12), title=title)
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
