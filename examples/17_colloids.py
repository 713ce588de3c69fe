"""Colloids as rigid bodies: a hollow sphere of beads is dragged through the standard DPD fluid, at several forces.

The fluid gets the opposite force, so that all is at rest on average.  The velocity against the fluid is proportional to the force.  The ratio is
the friction of the sphere in a cubic array of its images, 6 pi eta R K with 1/K = 1 - 2.837 s + 4.19 s^3 and s = R/L (Hasimoto, J. Fluid
Mech. 5, 317 (1959)), from which the radius follows that the fluid sees.  Viscosity of the fluid at gamma = 4.5: about 0.85.

    python examples/17_colloids.py        # about two minutes
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

import openmm_dpd as dpd
from openmm_dpd.molecules import body_shape, suspension
from openmm_dpd.pictures import bead_picture
from openmm_dpd.stats import block_average

OUT = Path("out/17_colloids")
DENSITY, A, GAMMA, VISCOSITY = 3.0, 25.0, 4.5, 0.85
#: Radius of the beads' centres, their distance, and the edge of the box.
RADIUS, SPACING, EDGE = 1.2, 0.45, 8.0
FORCES, DT, EQUILIBRATION, STEPS, EVERY = (10.0, 20.0, 30.0), 0.04, 500, 10000, 10


def colloids(count: int, edge: float, force: float = 0.0, seed: int = 1) -> dpd.Scene:
    """Spheres in the fluid; a force along x on each, and the opposite one on the fluid."""
    shell = body_shape("shell", RADIUS, SPACING)
    spheres, fluid = suspension(shell, count, [edge] * 3, apart=0.5, density=DENSITY, seed=seed)
    fluid = fluid[np.min(np.linalg.norm(_nearest(fluid[:, None] - spheres.mean(axis=1), edge), axis=2), axis=1) > RADIUS]
    n, inside = len(shell), count * len(shell)
    pairs = {("C", "C"): dpd.DPD(A=A, gamma=GAMMA), ("C", "W"): dpd.DPD(A=A, gamma=4 * GAMMA), ("W", "W"): dpd.DPD(A=A, gamma=GAMMA)}
    pushes = [dpd.BodyForce([force / n, 0, 0], types="C"), dpd.BodyForce([-force * count / len(fluid), 0, 0], types="W")]
    return dpd.Scene(
        {"C": 1.0, "W": 1.0},
        ["C"] * inside + ["W"] * len(fluid),
        np.concatenate([spheres.reshape(-1, 3), fluid]),
        pairs,
        kT=1.0,
        box=[edge] * 3,
        bodies=[dpd.Body(range(n * k, n * k + n)) for k in range(count)],
        body_forces=pushes if force else (),
    )


def _nearest(d: np.ndarray, edge: float) -> np.ndarray:
    return d - edge * np.round(d / edge)


def dragged(force: float) -> tuple[float, float]:
    """Mean velocity of one sphere against the fluid, and its standard error."""
    scene = colloids(1, EDGE, force)
    simulation = dpd.build(scene, dt=DT, seed=1, platform="CPU").simulation()
    simulation.minimizeEnergy(maxIterations=50)
    simulation.step(EQUILIBRATION)
    inside, rows = len(scene.bodies[0].beads), []
    for _ in range(STEPS // EVERY):
        simulation.step(EVERY)
        v = simulation.context.getState(velocities=True).getVelocities(asNumpy=True)[:, 0]._value
        rows.append(v[:inside].mean() - v[inside:].mean())
    average = block_average(rows)
    return average.mean, average.sem


def radius_seen(friction: float) -> float:
    """Radius of a sphere with this friction in a cubic array."""
    radii = np.linspace(0.01, 0.45 * EDGE, 2000)
    s = radii / EDGE
    return float(np.interp(friction, 6 * np.pi * VISCOSITY * radii / (1 - 2.837 * s + 4.19 * s**3), radii))


def main(out: Path = OUT) -> dict[str, float]:
    """Run, print and draw; returns the numbers."""
    out.mkdir(parents=True, exist_ok=True)
    found = np.array([dragged(force) for force in FORCES])
    forces, (velocity, error) = np.array(FORCES), found.T
    weights = 1 / error**2
    friction = float(np.sum(weights * forces**2) / np.sum(weights * forces * velocity))
    chi2 = float(np.mean((velocity - forces / friction) ** 2 * weights))
    radius = radius_seen(friction)
    for row in zip(FORCES, velocity, error, strict=True):
        print("force {:5.1f}: velocity {:.4f} +- {:.4f}".format(*row))
    print(f"friction {friction:.1f}, chi^2 of the line {chi2:.2f}; radius {radius:.2f}, of the beads' centres {RADIUS}")
    draw(out, forces, velocity, error, friction)
    return {"friction": friction, "chi2": chi2, "radius": radius}


def draw(out: Path, forces, velocity, error, friction: float) -> None:
    """A suspension, and velocity against force."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4.2), layout="constrained")
    picture = out / "beads.png"
    bead_picture(picture, colloids(24, 14.0), radii={"C": 0.28, "W": 0.0})
    left.imshow(plt.imread(picture))
    picture.unlink()
    left.set_axis_off()
    left.set_title("rigid hollow spheres (fluid not shown)")
    right.plot([0, forces.max()], [0, forces.max() / friction], color="0.6", label=f"force/{friction:.1f}")
    right.errorbar(forces, velocity, 2 * error, fmt="o", color="C0", label="dragged, 2 standard errors")
    right.set(xlabel="force", ylabel="velocity against the fluid", xlim=(0, None), ylim=(0, None))
    right.legend(frameon=False)
    figure.savefig(out / "colloids.png", dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
