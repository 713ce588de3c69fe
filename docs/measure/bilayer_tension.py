"""Surface tension of a lipid bilayer at several areas per lipid, from the anisotropy of the pressure.

The bilayer is that of ``examples/09_lipid_bilayer.py``, put together from upright lipids in a box of 7 x 7 x 11; their number sets the area.

    python docs/measure/bilayer_tension.py --lipids 66 70 74 78 --time 400      # 2 minutes for each on one core

Prints the tension with its standard error (for the bilayer as a whole, both leaflets), and where it comes from.
"""

from __future__ import annotations

import argparse

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.analysis import surface_tension
from openmm_dpd.measure import StressReporter
from openmm_dpd.molecules import Bilayer, grafmueller_2009, pack, relax
from openmm_dpd.stats import Average

BOX, DT, EVERY, EQUILIBRATION = (7.0, 7.0, 11.0), 0.04, 3, 100.0


def measure(lipids: int, time: float, dt: float = DT, seed: int = 1, platform: str | None = None) -> tuple[Average, np.ndarray]:
    """Tension, and the mean pressures along x, y and z."""
    model = grafmueller_2009()
    mixture = pack({model.molecule: Bilayer(lipids)}, solvent="W", density=model.density, box=BOX, seed=seed)
    built = dpd.build(relax(mixture.scene(pairs=model.pairs(), kT=1.0)), dt=dt, scheme="middle", seed=seed, platform=platform)
    simulation = built.simulation()
    simulation.step(round(EQUILIBRATION / dt))
    stress = StressReporter(EVERY, built)
    simulation.reporters.append(stress)
    simulation.step(round(time / dt))
    return surface_tension(stress.pressures, stress.edges[:, 2], axis="z", interfaces=1), stress.pressures[:, :3].mean(axis=0)


def main() -> None:
    """One line for each number of lipids."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--lipids", type=int, nargs="+", default=[66, 70, 74, 78], help="in both leaflets together")
    parser.add_argument("--time", type=float, default=400.0)
    parser.add_argument("--dt", type=float, default=DT)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print("lipids  area per lipid  tension   error   P_x     P_y     P_z")
    for lipids in options.lipids:
        tension, pressure = measure(lipids, options.time, options.dt, options.seed)
        area = 2 * BOX[0] * BOX[1] / lipids
        numbers = "  ".join(f"{value:6.3f}" for value in pressure)
        print(f"{lipids:6d}  {area:14.3f}  {tension.mean:7.3f}  {tension.sem or np.nan:6.3f}  {numbers}", flush=True)


if __name__ == "__main__":
    main()
