"""Pressures and tensions over the step, with the kinetic part that the package takes and with that of velocities at full steps.

    python docs/measure/step_pressure.py fluid --schemes mvv middle --steps 0.02 0.04 0.06
    python docs/measure/step_pressure.py dimers --steps 0.01 0.04
    python docs/measure/step_pressure.py lipid --steps 0.01 0.04 --time 800     # half a minute for a run of 20,000 steps on one core

fluid: density 3, A = 25, friction 4.5.  dimers: the same beads in pairs, with bonds of omega = 16.  lipid: 70 lipids in 7 x 7 x 9.  Prints
the pressure, and (of the lipid) the tension; each of them also with velocities of the moment of the positions as they are; then 2K/3N of
both kinetic parts, and how much more of them there is along z than across.
"""

from __future__ import annotations

import argparse

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.base.geometry import symmetric_products
from openmm_dpd.measure import StressReporter
from openmm_dpd.measure.present import Present
from openmm_dpd.molecules import Bilayer, grafmueller_2009, pack, relax
from openmm_dpd.stats import Average, block_average

EVERY, EQUILIBRATION = 0.24, 20.0


def beads(n: int, bonded: bool) -> dpd.Scene:
    """The standard fluid, or the same beads in pairs of which each begins with its bond at its length."""
    rng, edge = np.random.default_rng(1), (n / 3) ** (1 / 3)
    x, bonds = rng.random((n, 3)) * edge, []
    if bonded:
        arms = rng.normal(size=(n // 2, 3))
        x[1::2] = x[::2] + 0.5 * arms / np.linalg.norm(arms, axis=1)[:, None]
        bonds = [dpd.HarmonicBonds(np.arange(n).reshape(-1, 2), 64.0, 0.5)]
    pairs = {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    return dpd.Scene({"W": 1.0}, ["W"] * n, x, pairs, kT=1.0, box=[edge] * 3, bonds=bonds, bonded_factors=(1.0, 1.0, 1.0))


def lipid() -> dpd.Scene:
    """A bilayer that has nearly no tension."""
    model = grafmueller_2009()
    mixture = pack({model.molecule: Bilayer(70)}, solvent="W", density=model.density, box=[7.0, 7.0, 9.0], seed=1)
    return relax(mixture.scene(pairs=model.pairs(), kT=1.0))


def measure(scene: dpd.Scene, scheme: str, dt: float, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n, 3) diagonals of the stress over the volume, of its kinetic part and of that of velocities as they are."""
    built = dpd.build(scene, dt=dt, scheme=scheme, seed=1)
    simulation, reporter, every = built.simulation(), StressReporter(1, built), max(1, round(EVERY / dt))
    simulation.step(round(EQUILIBRATION / dt))
    present, kinetic, plain = Present(built), [], []
    for _ in range(round(time / dt / every)):
        simulation.step(every)
        reporter.report(simulation, None)
        present.look(simulation.context)
        force = present.conservative().force
        v = present.on_step(force)
        kinetic.append(present.kinetic_stress(v, force)[:3])
        plain.append(symmetric_products(scene.bead_masses[:, None] * v, v)[:3])
    return reporter.pressures[:, :3], np.array(kinetic) / reporter.volume, np.array(plain) / reporter.volume


def main() -> None:
    """One line for each scheme and step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("fluid", "dimers", "lipid"))
    parser.add_argument("--schemes", nargs="+", default=["mvv", "shardlow", "middle", "aboba", "bababo"])
    parser.add_argument("--steps", nargs="+", type=float, default=[0.02, 0.04, 0.06])
    parser.add_argument("--time", type=float, default=200.0)
    parser.add_argument("--beads", type=int, default=1500)
    options = parser.parse_args()
    scene = lipid() if options.what == "lipid" else beads(options.beads, options.what == "dimers")
    assert scene.box is not None
    density, height = scene.n_beads / float(np.prod(np.diag(scene.box))), float(scene.box[2, 2])
    along = np.array([-0.5, -0.5, 1.0])
    print("scheme dt | P, of plain velocities | 2K/3N, plain | more along z, plain" + " | tension, plain" * (options.what == "lipid"))
    for scheme in options.schemes:
        for dt in options.steps:
            whole, kinetic, plain = measure(scene, scheme, dt, options.time)
            both = (whole, whole - kinetic + plain)
            series = [part.mean(axis=1) for part in both] + [part.mean(axis=1) / density for part in (kinetic, plain)]
            series += [part @ along / density for part in (kinetic, plain)]
            if options.what == "lipid":
                series += [height * (part @ along) for part in both]
            print(scheme, dt, *(shown(block_average(values)) for values in series), flush=True)


def shown(average: Average) -> str:
    """Mean and standard error."""
    return f"{average.mean:.4f}({average.sem or np.nan:.4f})"


if __name__ == "__main__":
    main()
