"""Area per lipid, thickness and bending modulus of a bilayer without tension.

The lipid is that of ``examples/09_lipid_bilayer.py``, in a box of 14 x 14 x 9 (or another edge) whose area changes at constant volume.
A run goes on where the last one with the same ``--out`` stopped, so it can be made of pieces:

    python docs/measure/bending_modulus.py --out out/bending --steps 50000      # repeat; 3 minutes each on one core
    python docs/measure/bending_modulus.py --out out/bending --steps 0          # the numbers

Prints them with standard errors, and the modulus for several largest wave numbers of the fit.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mdtraj
from openmm import app

import openmm_dpd as dpd
from openmm_dpd.analysis import area_per_lipid, bending_modulus, bilayer_thickness, density_profile, height_spectrum
from openmm_dpd.molecules import Bilayer, grafmueller_2009, pack, relax
from openmm_dpd.trajectory import load_topology

HEIGHT, AREA, DT, EVERY, INTERVAL = 9.0, 1.39, 0.04, 50, 25
EQUILIBRATION = 200.0  # time units that are left out
MODEL = grafmueller_2009()


def run(out: Path, steps: int, edge: float, seed: int) -> None:
    """Begin, or go on from the checkpoint; every piece is a trajectory of its own."""
    lipids, box = round(2 * edge**2 / AREA), [edge, edge, HEIGHT]
    mixture = pack({MODEL.molecule: Bilayer(lipids)}, solvent="W", density=MODEL.density, box=box, seed=seed)
    scene, checkpoint = mixture.scene(pairs=MODEL.pairs(), kT=1.0), out / "end.chk"
    if not checkpoint.exists():
        scene = relax(scene)
        mixture.write_psf(out / "bilayer.psf")
    built = dpd.build(scene, dt=DT, scheme="middle", seed=seed)
    dpd.add_barostat(built, surface_tension=0, zmode="constant volume", interval=INTERVAL)
    simulation = built.simulation()
    if checkpoint.exists():
        simulation.loadCheckpoint(str(checkpoint))
    piece = out / f"piece_{simulation.currentStep:09d}.dcd"
    simulation.reporters.append(app.DCDReporter(str(piece), EVERY))
    simulation.step(steps)
    simulation.saveCheckpoint(str(checkpoint))


def joined(out: Path, topology, every: float, left_out: float) -> mdtraj.Trajectory:
    """All pieces, frames ``every`` so long, but for the time at the beginning."""
    trajectory = mdtraj.join([mdtraj.load(str(piece), top=topology) for piece in sorted(out.glob("piece_*.dcd"))])
    return trajectory[round(left_out / every) :]


def print_sizes(trajectory: mdtraj.Trajectory, every: float) -> None:
    """Time, area per lipid and thickness."""
    area, thickness = area_per_lipid(trajectory, "H"), bilayer_thickness(trajectory, "H", "T")
    print(f"{trajectory.n_frames} frames, {trajectory.n_frames * every:g} units of time")
    print(f"area per lipid  {area.mean:.4f}({area.sem:.4f})")
    print(f"thickness       {thickness.mean:.4f}({thickness.sem:.4f})")


def print_spectrum(trajectory: mdtraj.Trajectory, largest: tuple[float, ...]) -> None:
    """Height fluctuations, and kappa/kT from waves up to each of the ``largest`` wave numbers."""
    spectrum = height_spectrum(trajectory, "H", "T", q_max=largest[-1])
    curve = spectrum.curve
    print("\nq       A<|h_q|^2>  error    kT/(q^4 A<|h_q|^2>)")
    for q, power, error in zip(curve.x, curve.y, curve.sem, strict=True):
        print(f"{q:.3f}  {power:9.4f}  {error:8.4f}  {1 / (power * q**4):6.2f}")
    print("\nq_max   kappa/kT, tension fitted     kappa/kT, tension 0")
    for q_max in largest:
        free, zero = (bending_modulus(spectrum, 1.0, q_max=q_max, tension=tension) for tension in (None, 0.0))
        fitted = f"{free.kappa.mean:.2f}({free.kappa.sem:.2f}), {free.tension.mean:+.2f}({free.tension.sem:.2f})"
        print(f"{q_max:.2f}    {fitted:28s} {zero.kappa.mean:.3f}({zero.kappa.sem:.3f})")


def analyse(out: Path) -> None:
    """Print what all pieces together say."""
    topology = load_topology(out / "bilayer.psf")
    trajectory = joined(out, topology, EVERY * DT, EQUILIBRATION)
    print_sizes(trajectory, EVERY * DT)
    water = density_profile(trajectory, "W", n_bins=60, centre="T")["W"].y
    far = water[[0, 1, 2, -3, -2, -1]].mean()
    edges = trajectory.unitcell_lengths.mean(axis=0)
    count = len(topology.select("name W"))
    print(f"water           {far:.3f} far from the bilayer, which takes {edges[2] - count / (far * edges[0] * edges[1]):.3f} of the height")
    print_spectrum(trajectory, (0.7, 0.95, 1.05, 1.4))


def main() -> None:
    """A piece of the run, then the numbers."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/bending_modulus"))
    parser.add_argument("--steps", type=int, default=50_000)
    parser.add_argument("--edge", type=float, default=14.0, help="of the box at the start")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.steps:
        run(options.out, options.steps, options.edge, options.seed)
    analyse(options.out)


if __name__ == "__main__":
    main()
