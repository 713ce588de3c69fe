"""Viscosity of the standard DPD fluid by two methods: reverse Poiseuille flow and equilibrium fluctuations (Green-Kubo).

A force +f drives the beads in the lower half of the box along x, -f those in the upper half.  There are no walls, and in each half the
flow becomes a parabola whose curvature is the force density over the viscosity.  At rest, the viscosity is the time integral of the
autocorrelation of the stress; friction and noise need some care there (docs/theory_flow.md).

Published for rho = 3, a = 25, gamma = 4.5, kT = 1: pressure 23.64, viscosity about 0.85 (within 3 %).

    python examples/11_reverse_poiseuille.py        # about two minutes
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

import openmm_dpd as dpd
from openmm_dpd.analysis import VelocityProfile, green_kubo_viscosity, poiseuille_viscosity
from openmm_dpd.measure import ProfileReporter, StressReporter

OUT = Path("out/11_reverse_poiseuille")
DENSITY, A, GAMMA = 3.0, 25.0, 4.5
PUBLISHED_VISCOSITY, PUBLISHED_PRESSURE = 0.85, 23.64

#: The flow: box, force per bead, step, and steps before and during the measurement.
EDGES, FORCE, DT, EQUILIBRATION, STEPS, EVERY, SLABS = (8.0, 8.0, 10.0), 0.04, 0.04, 1500, 16000, 5, 20

#: At rest: box, step, steps, and the upper limit of the integral.
REST_EDGES, REST_DT, REST_EQUILIBRATION, REST_STEPS, T_MAX = (5.0, 5.0, 5.0), 0.02, 1000, 45000, 2.0


def fluid(edges: tuple[float, float, float], seed: int, **flow) -> dpd.Scene:
    """Beads at random places."""
    n = round(DENSITY * float(np.prod(edges)))
    positions = np.random.default_rng(seed).random((n, 3)) * edges
    return dpd.Scene({"W": 1.0}, ["W"] * n, positions, {("W", "W"): dpd.DPD(A=A, gamma=GAMMA)}, kT=1.0, box=edges, **flow)


def driven() -> VelocityProfile:
    """Profile of the flow along x, in slabs along z."""
    force = dpd.BodyForce((FORCE, 0, 0), pattern="halves", axis="z")
    built = dpd.build(fluid(EDGES, 1, body_forces=[force]), dt=DT, seed=1)
    simulation = built.simulation()
    simulation.step(EQUILIBRATION)
    reporter = ProfileReporter(EVERY, built, axis="z", component="x", bins=SLABS)
    simulation.reporters.append(reporter)
    simulation.step(STEPS)
    return reporter.profile


def at_rest() -> StressReporter:
    """Stress tensors of the fluid at rest."""
    built = dpd.build(fluid(REST_EDGES, 2), dt=REST_DT, seed=2)
    simulation = built.simulation()
    simulation.step(REST_EQUILIBRATION)
    reporter = StressReporter(1, built)
    simulation.reporters.append(reporter)
    simulation.step(REST_STEPS)
    return reporter


def main(out: Path = OUT) -> dict[str, float]:
    """Run, print and draw; returns the numbers."""
    out.mkdir(parents=True, exist_ok=True)
    profile = driven()
    flow = poiseuille_viscosity(profile, FORCE)
    stress = at_rest()
    rest = green_kubo_viscosity(stress, t_max=T_MAX)
    pressure = float(stress.regular[:, :3].mean() / stress.volume)
    draw(out / "profile.png", profile, flow, rest)
    print(f"viscosity, reverse Poiseuille flow  {flow.viscosity:.3f} +- {flow.error:.3f}")
    print(
        f"viscosity, Green-Kubo               {rest.viscosity:.3f} +- {rest.error:.3f}  ({rest.instantaneous:.3f} of it from friction at once)"
    )
    print(f"viscosity, published                {PUBLISHED_VISCOSITY:.2f}")
    print(f"pressure at rest                    {pressure:.2f}  (published {PUBLISHED_PRESSURE})")
    return {
        "flow": flow.viscosity,
        "flow_error": flow.error,
        "rest": rest.viscosity,
        "rest_error": rest.error,
        "instantaneous": rest.instantaneous,
        "pressure": pressure,
        "kT": float(np.mean(profile.kT)),
    }


def draw(path: Path, profile: VelocityProfile, flow, rest) -> None:
    """The profile with its parabolas, and the Green-Kubo integral."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4.0), layout="constrained")
    half = profile.length / 2
    z = np.linspace(0, half, 100)
    parabola = 0.5 * flow.curvature * z * (half - z)
    left.plot(np.concatenate([z, z + half]), np.concatenate([parabola, -parabola]), color="C1", label="parabolas, fitted")
    left.errorbar(profile.centres, profile.velocity, 2 * profile.error, fmt="o", ms=4, color="C0", label="slabs, 2 standard errors")
    left.axhline(0, color="0.7", lw=0.8)
    left.set(
        xlabel="z",
        ylabel="velocity along x",
        title=f"reverse Poiseuille flow: {flow.viscosity:.3f} ± {flow.error:.3f}",
        xlim=(0, profile.length),
    )
    left.legend(frameon=False)
    right.plot(rest.times, rest.integral, color="C0", label="integral up to t")
    right.axhline(PUBLISHED_VISCOSITY, color="C1", ls="--", label="published")
    right.axhspan(
        flow.viscosity - 2 * flow.error, flow.viscosity + 2 * flow.error, color="C1", alpha=0.2, lw=0, label="flow, 2 standard errors"
    )
    right.errorbar([rest.t_max], [rest.viscosity], [2 * rest.error], fmt="o", ms=4, color="C0", capsize=3)
    right.set(
        xlabel="t",
        ylabel="viscosity",
        title=f"Green-Kubo: {rest.viscosity:.3f} ± {rest.error:.3f}",
        ylim=(0, None),
        xlim=(0, 1.05 * rest.t_max),
    )
    right.legend(frameon=False, loc="lower right")
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
