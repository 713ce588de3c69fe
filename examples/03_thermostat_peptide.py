"""Alanine dipeptide in TIP3P water with pairwise friction instead of Langevin dynamics.

The System comes from openmm.app.ForceField as usual: PME, constrained hydrogens, rigid water.  add_thermostat() adds friction and noise
between all atoms within 0.6 nm and returns the integrator.  Unlike Langevin friction it acts on relative velocities only, so momentum is
conserved and the water still flows.  For comparison the same System is run with OpenMM's LangevinMiddleIntegrator.

    python examples/03_thermostat_peptide.py
"""

from __future__ import annotations

from io import StringIO
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
import openmm
from openmm import app, unit

import openmm_dpd as dpd
from openmm_dpd.measure import kelvin
from openmm_dpd.stats import block_average

OUT = Path("out/03_thermostat_peptide")
EDGE = 2.2  # nm
TEMPERATURE, DT = 300 * unit.kelvin, 2 * unit.femtosecond
FRICTION = dpd.DPD(gamma=5 * unit.dalton / unit.picosecond, cutoff=0.6 * unit.nanometer)
ITERATIONS, EQUILIBRATION, STEPS, EVERY = 200, 1500, 3500, 20  # of the minimiser, and steps
PLATFORM = None  # the fastest
VELOCITY = unit.nanometer / unit.picosecond

#: Heavy atoms of ACE-ALA-NME, from standard bond lengths and angles.
PEPTIDE = """\
ATOM      1  CH3 ACE A   1       0.000   0.000   0.000  1.00  0.00           C
ATOM      2  C   ACE A   1       1.520   0.000   0.000  1.00  0.00           C
ATOM      3  O   ACE A   1       2.144  -1.060   0.000  1.00  0.00           O
ATOM      4  N   ALA A   2       2.116   1.195   0.000  1.00  0.00           N
ATOM      5  CA  ALA A   2       3.559   1.334   0.000  1.00  0.00           C
ATOM      6  CB  ALA A   2       3.952   2.711  -0.539  1.00  0.00           C
ATOM      7  C   ALA A   2       4.125   1.141   1.397  1.00  0.00           C
ATOM      8  O   ALA A   2       4.429   2.112   2.088  1.00  0.00           O
ATOM      9  N   NME A   3       4.266  -0.120   1.814  1.00  0.00           N
ATOM     10  C   NME A   3       4.794  -0.441   3.126  1.00  0.00           C
END
"""


def platform() -> openmm.Platform:
    """The platform of both runs."""
    return openmm.Platform.getPlatformByName(PLATFORM or dpd.fastest_platform())


def solvated() -> tuple[app.Modeller, openmm.System]:
    """The peptide in a box of water, and its System."""
    pdb = app.PDBFile(StringIO(PEPTIDE))
    field = app.ForceField("amber14-all.xml", "amber14/tip3p.xml")
    modeller = app.Modeller(pdb.topology, pdb.positions)
    modeller.addHydrogens(field, platform=platform())
    modeller.addSolvent(field, boxSize=openmm.Vec3(EDGE, EDGE, EDGE) * unit.nanometer)
    system = field.createSystem(
        modeller.topology,
        nonbondedMethod=app.PME,
        nonbondedCutoff=0.9 * unit.nanometer,
        constraints=app.HBonds,
        removeCMMotion=False,  # pairwise friction conserves momentum
    )
    return modeller, system


class Rows(NamedTuple):
    """Temperature (K) and largest component of the momentum (Da nm/ps) over time (ps)."""

    times: np.ndarray
    temperatures: np.ndarray
    momenta: np.ndarray


def run(simulation: app.Simulation, modeller: app.Modeller) -> Rows:
    """Minimise, draw velocities without total momentum, equilibrate and run."""
    system, context = simulation.system, simulation.context
    masses = np.array([m.value_in_unit(unit.dalton) for m in map(system.getParticleMass, range(system.getNumParticles()))])
    # total momentum is fixed, hence 3 degrees of freedom fewer than StateDataReporter counts
    freedom = dpd.degrees_of_freedom(system)

    def velocities() -> np.ndarray:
        return context.getState(velocities=True).getVelocities(asNumpy=True).value_in_unit(VELOCITY)

    context.setPositions(modeller.positions)
    simulation.minimizeEnergy(maxIterations=ITERATIONS)
    context.setVelocitiesToTemperature(TEMPERATURE, 7)
    v = velocities()
    context.setVelocities(v - masses @ v / masses.sum())
    simulation.step(EQUILIBRATION)
    rows = []
    for _ in range(STEPS // EVERY):
        simulation.step(EVERY)
        v = velocities()
        temperature = kelvin(float(masses @ (v**2).sum(axis=1)) / freedom)
        rows.append((context.getTime().value_in_unit(unit.picosecond), temperature, np.abs(masses @ v).max()))
    return Rows(*np.array(rows).T)


def picture(path: Path, runs: dict[str, Rows]) -> None:
    """Temperature and momentum of both runs."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (upper, lower) = plt.subplots(2, 1, figsize=(7.0, 4.6), sharex=True, layout="constrained", dpi=150)
    for (name, rows), colour in zip(runs.items(), ("#b3541e", "#1f5a99"), strict=True):
        times = rows.times - rows.times[0]
        upper.plot(times, rows.temperatures, color=colour, linewidth=1.0, label=name)
        lower.plot(times, rows.momenta, color=colour, linewidth=1.5)
    upper.axhline(TEMPERATURE.value_in_unit(unit.kelvin), color="0.3", linewidth=0.8, linestyle="--")
    upper.set(ylabel="temperature [K]")
    upper.legend(frameon=False, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0)
    lower.set(ylabel="total momentum\n[Da nm/ps]", xlabel="time [ps]")
    for axis in (upper, lower):
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """Run with both thermostats; temperatures, their errors, and momenta."""
    out.mkdir(parents=True, exist_ok=True)
    modeller, system = solvated()
    plain = openmm.LangevinMiddleIntegrator(TEMPERATURE, 5 / unit.picosecond, DT)
    plain.setRandomNumberSeed(7)
    runs = {"Langevin, 5/ps": run(app.Simulation(modeller.topology, system, plain, platform()), modeller)}
    # this adds the pair terms to the System
    built = dpd.add_thermostat(system, FRICTION, TEMPERATURE, DT, seed=7, topology=modeller.topology, positions=modeller.positions)
    simulation = built.simulation(platform())
    simulation.reporters.append(dpd.DPDReporter(out / "friction.csv", EVERY, built))
    runs["pairwise friction"] = run(simulation, modeller)
    picture(out / "peptide.png", runs)
    found = {}
    for name, rows in runs.items():
        average = block_average(rows.temperatures)
        found[f"{name}: temperature"] = average.mean
        found[f"{name}: its error"] = float("nan") if average.sem is None else average.sem
        found[f"{name}: momentum"] = float(rows.momenta.max())
    return found


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:32s} {value:.3f}")
    print(f"picture: {OUT / 'peptide.png'}")
