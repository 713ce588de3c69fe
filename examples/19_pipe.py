"""A pipe with a narrow part: a wall of any shape, given by a formula, with frozen beads of the fluid behind it.

The fluid fills the whole box at first; `frozen_layer` freezes it where the solid is.  A body force drives it along the pipe.  In steady
flow the same number of beads goes through every cross-section, and they are fastest where the pipe is narrow.

    python examples/19_pipe.py        # about two minutes
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

import openmm_dpd as dpd
from openmm_dpd.molecules import frozen_layer
from openmm_dpd.shapes import FormulaShape

OUT = Path("out/19_pipe")
#: Length and edge of the box, radius of the pipe, what its narrow part lacks of that, half length of it, force on a bead.
LENGTH, EDGE, RADIUS, LESS, HALF, FORCE = 16.0, 9.0, 3.8, 1.6, 2.0, 0.1
DT, EQUILIBRATION, STEPS, EVERY = 0.04, 1000, 6000, 10
#: Widths of bins along the pipe and across it.
ALONG, ACROSS = 0.5, 0.25


def radius(z: np.ndarray) -> np.ndarray:
    """Radius of the pipe."""
    return RADIUS - LESS * np.exp(-(((z - LENGTH / 2) / HALF) ** 2))


def pipe(seed: int) -> dpd.Scene:
    """The standard fluid in the pipe."""
    n = round(3 * EDGE**2 * LENGTH)
    positions = np.random.default_rng(seed).random((n, 3)) * [EDGE, EDGE, LENGTH]
    push = dpd.BodyForce((0, 0, FORCE))
    fluid = {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    box = [EDGE, EDGE, LENGTH]
    whole = dpd.Scene({"W": 1.0}, ["W"] * n, positions, fluid, kT=1.0, box=box, body_forces=[push])
    r = f"sqrt((x-{EDGE / 2})^2 + (y-{EDGE / 2})^2)"
    solid = FormulaShape(f"{RADIUS} - {LESS}*exp(-((z-{LENGTH / 2})/{HALF})^2) - {r}")
    return frozen_layer(whole, [dpd.SolidWall(solid)], dt=DT, steps=400, seed=seed)


def main(out: Path = OUT) -> dict[str, float]:
    """Run, print and draw; returns the numbers."""
    out.mkdir(parents=True, exist_ok=True)
    scene = pipe(1)
    built = dpd.build(scene, dt=DT, seed=1)
    simulation = built.simulation()
    simulation.step(EQUILIBRATION)
    shape = round(LENGTH / ALONG), round(RADIUS / ACROSS)
    count, speed = np.zeros(shape), np.zeros(shape)
    for _ in range(STEPS // EVERY):
        simulation.step(EVERY)
        state = simulation.context.getState(positions=True, velocities=True)
        x = state.getPositions(asNumpy=True)._value[scene.mobile] % np.diag(scene.box)
        v = state.getVelocities(asNumpy=True)._value[scene.mobile, 2]
        r, limits = np.hypot(*(x[:, :2] - EDGE / 2).T), [(0, LENGTH), (0, RADIUS)]
        count += np.histogram2d(x[:, 2], r, shape, limits)[0]
        speed += np.histogram2d(x[:, 2], r, shape, limits, weights=v)[0]
    through = speed.sum(axis=1) / ALONG / (STEPS // EVERY)  # beads per unit of time
    middle = shape[0] // 2
    fastest = [speed[k, :4].sum() / count[k, :4].sum() for k in (0, middle)]
    draw(out / "pipe.png", count, speed, through)
    print(f"beads through a cross-section per unit of time   {through.mean():.2f} +- {through.std():.2f} over the cross-sections")
    print(f"velocity on the axis, wide and narrow            {fastest[0]:.3f}, {fastest[1]:.3f}")
    return {"through": through.mean(), "spread": through.std(), "wide": fastest[0], "narrow": fastest[1]}


def draw(path: Path, count: np.ndarray, speed: np.ndarray, through: np.ndarray) -> None:
    """Velocity along the pipe in a plane through its axis, and the flow through cross-sections."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (top, bottom) = plt.subplots(2, 1, figsize=(8.0, 5.6), layout="constrained", height_ratios=(3, 1), sharex=True)
    velocity = np.divide(speed, count, out=np.full(count.shape, np.nan), where=count > 0)
    z, r = np.linspace(0, LENGTH, len(count) + 1), np.linspace(-RADIUS, RADIUS, 2 * count.shape[1] + 1)
    both = np.concatenate([velocity[:, ::-1], velocity], axis=1).T
    drawn = top.pcolormesh(z, r, both, cmap="viridis", vmin=0)
    fine = np.linspace(0, LENGTH, 400)
    for sign, end in ((1, EDGE / 2), (-1, -EDGE / 2)):
        top.fill_between(fine, sign * radius(fine), end, color="0.8", lw=0)
        top.plot(fine, sign * radius(fine), color="0.2")
    figure.colorbar(drawn, ax=top, label="velocity along z")
    top.set(ylabel="distance from the axis", title="Flow through a narrow pipe", xlim=(0, LENGTH), ylim=(-EDGE / 2, EDGE / 2))
    bottom.plot(0.5 * (z[1:] + z[:-1]), through, "o-", ms=3)
    bottom.set(xlabel="z", ylabel="beads per time", ylim=(0, 1.3 * through.max()))
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
