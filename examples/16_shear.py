"""A fluid of beads and one of short chains in Lees-Edwards shear: profile, viscosity, normal stress, and dynamic moduli.

The images of the box slide over each other, and the fluid follows them with v_x = rate * y: no walls, no forces, one temperature.  Beads
behave as a Newtonian fluid; chains of ten are stretched along the flow, which lowers the viscosity and causes a tension along x, and in
fast oscillation they store part of the work.

Published for rho = 3, a = 25, gamma = 4.5, kT = 1: viscosity about 0.85 (within 3 %).

    python examples/16_shear.py        # about two minutes
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

import openmm_dpd as dpd
from openmm_dpd.analysis import shear_moduli, shear_viscosity
from openmm_dpd.measure import ProfileReporter, StressReporter

OUT = Path("out/16_shear")
EDGE, CHAIN, DT, PUBLISHED = 5.0, 10, 0.04, 0.85

#: Rates of steady shear; steps before and during the measurement at the first one, fewer at higher ones.
RATES, BEFORE, STEPS = (0.2, 0.5, 1.2), 1500, 12000
#: Amplitude and angular frequencies of oscillations, periods before and during the measurement.
AMPLITUDE, FREQUENCIES, PERIODS = 0.3, (0.5, 1.5, 4.0), (3, 40)


def fluid(length: int, shear: dpd.LeesEdwards) -> dpd.Scene:
    """Chains of this length, at random places."""
    rng, chains = np.random.default_rng(1), int(3 * EDGE**3) // length
    steps = rng.normal(size=(chains, length, 3)) * 0.4
    steps[:, 0] = rng.random((chains, 3)) * EDGE
    bonds = [(length * chain + k, length * chain + k + 1) for chain in range(chains) for k in range(length - 1)]
    return dpd.Scene(
        {"W": 1.0},
        ["W"] * (chains * length),
        np.cumsum(steps, axis=1).reshape(-1, 3),
        {("W", "W"): dpd.DPD(A=25, gamma=4.5)},
        kT=1.0,
        box=[EDGE] * 3,
        bonds=[dpd.HarmonicBonds(bonds, 20.0, 0.7)] if bonds else [],
        shear=shear,
    )


def steady(length: int, rate: float):
    """Viscosity and normal stresses at a rate, and the profile of the flow."""
    built = dpd.build(fluid(length, dpd.LeesEdwards(rate=rate)), dt=DT, seed=1)
    simulation = built.simulation()
    simulation.minimizeEnergy(maxIterations=50)
    simulation.step(BEFORE)
    stress, profile = StressReporter(2, built), ProfileReporter(10, built, axis="y", component="x", bins=10)
    simulation.reporters += [stress, profile]
    simulation.step(int(STEPS * (RATES[0] / rate) ** 0.5))
    return shear_viscosity(stress), profile.profile


def oscillating(length: int, frequency: float):
    """Moduli at a frequency."""
    built = dpd.build(fluid(length, dpd.LeesEdwards(amplitude=AMPLITUDE, frequency=frequency)), dt=DT, seed=2)
    simulation, period = built.simulation(), int(2 * np.pi / frequency / DT)
    simulation.minimizeEnergy(maxIterations=50)
    simulation.step(BEFORE // 3 + PERIODS[0] * period)
    stress = StressReporter(2, built)
    simulation.reporters.append(stress)
    simulation.step(PERIODS[1] * period + period)
    return shear_moduli(stress)


def main(out: Path = OUT) -> dict[str, float]:
    """Run, print and draw; returns the numbers."""
    out.mkdir(parents=True, exist_ok=True)
    flows = {length: [steady(length, rate) for rate in RATES] for length in (1, CHAIN)}
    moduli = {length: [oscillating(length, frequency) for frequency in FREQUENCIES] for length in (1, CHAIN)}
    for length, found in flows.items():
        for flow, _ in found:
            print(
                f"chains of {length:2d}, rate {flow.rate:.1f}: viscosity {flow.viscosity:.3f} +- {flow.error:.3f}, "
                f"first normal stress difference {flow.first_normal:.2f} +- {flow.first_normal_error:.2f}"
            )
    for length, swung in moduli.items():
        for one in swung:
            print(
                f"chains of {length:2d}, frequency {one.frequency:.1f}: G' {one.storage:.2f} +- {one.storage_error:.2f}, "
                f"G'' {one.loss:.2f} +- {one.loss_error:.2f}, G''/frequency {one.loss / one.frequency:.3f}"
            )
    draw(out / "shear.png", flows, moduli)
    slowest, profile = flows[1][0]
    return {
        "viscosity": slowest.viscosity,
        "viscosity_error": slowest.error,
        "chains": flows[CHAIN][0][0].viscosity,
        "chains_error": flows[CHAIN][0][0].error,
        "chains_fast": flows[CHAIN][-1][0].viscosity,
        "normal": flows[CHAIN][-1][0].first_normal,
        "normal_error": flows[CHAIN][-1][0].first_normal_error,
        "storage": moduli[CHAIN][-1].storage,
        "storage_error": moduli[CHAIN][-1].storage_error,
        "slope": float(np.polyfit(profile.centres, profile.velocity, 1)[0]),
        "kT": float(np.mean(profile.kT)),
    }


def draw(path: Path, flows, moduli) -> None:
    """Profiles, viscosities, and moduli."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(11.0, 3.8), layout="constrained")
    for number, (flow, profile) in enumerate(flows[1]):
        left.plot([0, EDGE * flow.rate], [0, EDGE], color=f"C{number}", lw=1)
        name = f"rate {flow.rate:g}"
        left.errorbar(profile.velocity, profile.centres, xerr=2 * profile.error, fmt="o", ms=4, color=f"C{number}", label=name)
    left.set(xlabel="velocity along x", ylabel="y", title="the flow follows the images", ylim=(0, EDGE))
    left.legend(frameon=False)
    for color, (length, found) in enumerate(flows.items()):
        eta, error = [flow.viscosity for flow, _ in found], [2 * flow.error for flow, _ in found]
        name = "beads" if length == 1 else f"chains of {length}"
        middle.errorbar(RATES, eta, error, fmt="o-", ms=4, capsize=3, color=f"C{color}", label=name)
    middle.axhline(PUBLISHED, color="0.6", ls="--", label="beads, published")
    middle.set(xlabel="shear rate", ylabel="viscosity", title="viscosity", ylim=(0, None))
    middle.legend(frameon=False)
    for color, (length, found) in enumerate(moduli.items()):
        name = "beads" if length == 1 else f"chains of {length}"
        loss, storage = [(one.loss, 2 * one.loss_error) for one in found], [(one.storage, 2 * one.storage_error) for one in found]
        right.errorbar(FREQUENCIES, *np.transpose(loss), fmt="s-", ms=4, color=f"C{color}", label=f"G'', {name}")
        right.errorbar(FREQUENCIES, *np.transpose(storage), fmt="o--", ms=4, color=f"C{color}", label=f"G', {name}")
    right.set(xlabel="angular frequency", ylabel="modulus", title="moduli", ylim=(0, None))
    right.legend(frameon=False)
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
