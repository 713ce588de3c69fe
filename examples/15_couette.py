"""Couette flow: the standard DPD fluid between two walls in relative motion, and the forces on the walls.

Behind each wall there is a virtual fluid of the same kind: its mean repulsion and its friction act on the beads nearby
(docs/theory_flow.md).  So the fluid keeps its density and temperature up to the wall, without slip.  The shear stress on the walls over
the shear rate is the viscosity; published for rho = 3, a = 25, gamma = 4.5, kT = 1: about 0.85, and the pressure is 23.64.

    python examples/15_couette.py        # about a minute
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

import openmm_dpd as dpd
from openmm_dpd.analysis import CouetteFit, VelocityProfile, couette_viscosity
from openmm_dpd.measure import ProfileReporter, WallReporter

OUT = Path("out/15_couette")
DENSITY, A, GAMMA = 3.0, 25.0, 4.5
PUBLISHED_VISCOSITY, PUBLISHED_PRESSURE = 0.85, 23.64

#: The channel and the solid, as thick as the cutoff, that separates it from its image; velocities of the walls, +SPEED and -SPEED.
GAP, SOLID, EDGE, SPEED = 10.0, 1.0, 6.0, 1.5
DT, EQUILIBRATION, STEPS, EVERY, SLABS = 0.03, 3000, 40000, 10, 55
#: Steps between two forces on the walls: the exchange of a wall with the first layer cancels over time.
WALLS_EVERY = 400


def channel(seed: int) -> dpd.Scene:
    """Beads at random places between z = 0 and z = GAP."""
    n = round(DENSITY * EDGE**2 * GAP)
    positions = np.random.default_rng(seed).random((n, 3)) * [EDGE, EDGE, GAP]
    behind = {"behind": "W", "density": DENSITY}
    walls = [
        dpd.Wall("z", 0.0, "above", velocity=(-SPEED, 0, 0), **behind),
        dpd.Wall("z", GAP, "below", velocity=(SPEED, 0, 0), **behind),
    ]
    table = {("W", "W"): dpd.DPD(A=A, gamma=GAMMA)}
    return dpd.Scene({"W": 1.0}, ["W"] * n, positions, table, kT=1.0, box=[EDGE, EDGE, GAP + SOLID], walls=walls)


def main(out: Path = OUT) -> dict[str, float]:
    """Run, print and draw; returns the numbers."""
    out.mkdir(parents=True, exist_ok=True)
    built = dpd.build(channel(1), dt=DT, seed=1)
    simulation = built.simulation()
    simulation.step(EQUILIBRATION)
    slabs, walls = ProfileReporter(EVERY, built, axis="z", component="x", bins=SLABS), WallReporter(WALLS_EVERY, built)
    simulation.reporters += [slabs, walls]
    simulation.step(STEPS)
    profile = slabs.profile
    fit = couette_viscosity(profile, walls.shear(), channel=(0, GAP), skip=1.5)
    imposed, pressure = 2 * SPEED / GAP, float(walls.pressure.mean())
    draw(out / "couette.png", profile, fit)
    print(f"viscosity, Couette flow    {fit.viscosity:.3f} +- {fit.error:.3f}  (published {PUBLISHED_VISCOSITY})")
    print(f"shear rate over imposed    {fit.rate / imposed:.3f} +- {fit.rate_error / imposed:.3f}")
    print(f"pressure on the walls      {pressure:.2f}  (published {PUBLISHED_PRESSURE})")
    return {
        "viscosity": fit.viscosity,
        "error": fit.error,
        "rate": fit.rate / imposed,
        "rate_error": fit.rate_error / imposed,
        "pressure": pressure,
    }


def draw(path: Path, profile: VelocityProfile, fit: CouetteFit) -> None:
    """Velocity with the line through it, and density and temperature up to the walls."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4.0), layout="constrained")
    there = profile.centres < GAP
    z = profile.centres[there]
    left.plot([0, GAP], [-SPEED, SPEED], color="0.6", ls="--", label="from wall to wall")
    left.plot([0, GAP], fit.ends, color="C1", label="line, fitted")
    left.errorbar(z, profile.velocity[there], 2 * profile.error[there], fmt="o", ms=3, color="C0", label="slabs, 2 standard errors")
    left.set(xlabel="z", ylabel="velocity along x", title=f"Couette flow: viscosity {fit.viscosity:.3f} ± {fit.error:.3f}", xlim=(0, GAP))
    left.legend(frameon=False)
    right.axhspan(0.97, 1.03, color="0.9", lw=0, label="3 %")
    right.plot(z, profile.density[there] / DENSITY, "o-", ms=3, color="C0", label="density/3")
    right.plot(z, profile.kT[there], "s-", ms=3, color="C3", label="temperature")
    right.set(xlabel="z", title="up to the walls", xlim=(0, GAP), ylim=(0.8, 1.2))
    right.legend(frameon=False, ncols=3, loc="lower center")
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
