"""Contact angles of drops of a many-body DPD liquid on a plane wall, beside Young's equation with measured tensions.

    python docs/measure/contact_angle.py            # twenty minutes; prints a table

The wall attracts beads by a Morse potential of their height alone, so tensions follow from films without any model.  With P the tensor of
motion and forces between beads, A the area of a film and f the force of the wall on a bead at height z,

    tension of all surfaces of a film = <(Pzz - (Pxx + Pyy)/2) V/A> + <sum of (z - Z) f>/A,

for any Z, since the forces of the wall sum to 0 on average; the second term replaces what is missing in Pzz, whose mean is then 0.  A free
film has twice the tension g of the liquid, one on the wall g + g_wall, and Young's equation is cos(angle) = -g_wall/g: without beads in the
vapour, the dry wall has no tension.  The surface of the wall is where a liquid of constant density would end that has as many beads as there
are: the dividing surface of Gibbs without adsorption.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from openmm import app

import openmm_dpd as dpd
from openmm_dpd.analysis import contact_angle, density_profile
from openmm_dpd.measure import StressReporter
from openmm_dpd.stats import Average, block_average
from openmm_dpd.trajectory import load_topology, write_psf

LIQUID = dpd.MDPD(A=-40, B=25, gamma=4.5, cutoff=1.0, cutoff_B=0.75, kernel="quadratic")
STEEPNESS, PLACE, DT, DENSITY = 2.0, 1.0, 0.02, 6.0


def wall(depth: float, height: float) -> dpd.PositionForce:
    """Force of the potential depth ((1 - e)^2 - 1), e = exp(-2 (z - 1)); and a lid, without which a bead that evaporates would go round
    through the periodic boundary, and gain energy from the wall each time."""
    e = f"exp(-{STEEPNESS}*(z-{PLACE}))"
    return dpd.PositionForce(("0", "0", f"-{2 * depth * STEEPNESS}*(1-{e})*{e}-100*max(0,z-{height - 1})"))


def pull(depth: float, z: np.ndarray) -> np.ndarray:
    """The force of the wall at heights z."""
    e = np.exp(-STEEPNESS * (z - PLACE))
    return -2 * depth * STEEPNESS * (1 - e) * e


def built(edges, low, box, depth: float | None, seed: int) -> dpd.BuiltSystem:
    """A block of liquid, on a cubic lattice, in an empty box, with a wall or not."""
    spacing = DENSITY ** (-1 / 3)
    axes = [np.arange(spacing / 2, edge, spacing) for edge in edges]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + low
    forces = [] if depth is None else [wall(depth, box[2])]
    scene = dpd.Scene({"L": 1.0}, ["L"] * len(x), x, {("L", "L"): LIQUID}, kT=1.0, box=box, body_forces=forces)
    return dpd.build(scene, dt=DT, scheme="middle", seed=seed)


def run(system: dpd.BuiltSystem, first: int, steps: int, every: int, folder: Path, *reporters):
    """The trajectory of ``steps`` steps after ``first``, in chunks."""
    import mdtraj

    write_psf(folder / "film.psf", names=system.plan.scene.types, masses=system.plan.scene.bead_masses)
    simulation = system.simulation()
    simulation.step(first)
    simulation.reporters += [app.DCDReporter(str(folder / "film.dcd"), every, enforcePeriodicBox=False), *reporters]
    simulation.step(steps)
    simulation.reporters.clear()
    topology = load_topology(folder / "film.psf")
    return lambda: mdtraj.iterload(str(folder / "film.dcd"), top=topology, chunk=50)


def film(depth: float | None, steps: int, seed: int) -> tuple[Average, float]:
    """Tension of all surfaces of a film, and height of the surface of the wall."""
    width, height = 8.0, 14.0
    system = built((width, width, 7.0), (0, 0, 0.9 if depth else 3.5), (width, width, height), depth, seed)
    stress = StressReporter(10, system)
    with tempfile.TemporaryDirectory() as folder:
        frames = run(system, 3000, steps, 10, Path(folder), stress)
        p = stress.pressures
        sums = (p[:, 2] - 0.5 * (p[:, 0] + p[:, 1])) * height
        if depth is None:
            return block_average(sums), 0.0
        z = np.concatenate([piece.xyz[:, :, 2] for piece in frames()]).astype(float)
        sums += np.sum((z - PLACE) * pull(depth, z), axis=1) / width**2
        profile = density_profile(frames(), n_bins=140)["L"]
    inside = (profile.x > 3.0) & (profile.x < 6.0)
    bulk = profile.y[inside].mean()
    return block_average(sums), 4.5 - profile.y[profile.x < 4.5].sum() * 0.1 / bulk


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=30000)
    parser.add_argument("--depths", type=float, nargs="+", default=[0.8, 1.4])
    options = parser.parse_args()
    free, _ = film(None, options.steps, seed=1)
    tension, error = free.mean / 2, free.sem / 2
    print(f"tension of the liquid {tension:.3f}({error:.3f})", flush=True)
    print(
        "| depth | surface | tension of the wall | angle by Young's equation | angle of the drop | difference | radius |\n"
        + "| --- " * 7
        + "|"
    )
    for depth in options.depths:
        both, surface = film(depth, options.steps, seed=2)
        on_wall = both.mean - tension
        cosine = -on_wall / tension
        # of -(both - g)/g = 1 - both/g
        off = np.hypot(both.sem / tension, both.mean * error / tension**2)
        young, young_error = np.degrees(np.arccos(cosine)), np.degrees(off / np.sqrt(1 - cosine**2))
        with tempfile.TemporaryDirectory() as folder:
            frames = run(built((11, 11, 4), (3.5, 3.5, surface), (18, 18, 14), depth, 3), 5000, options.steps, 50, Path(folder))
            found = contact_angle(frames(), surface=surface, n_bins=(30, 46), skip=1.0)
        angle = found.angle
        print(
            f"| {depth:g} | {surface:.3f} | {on_wall:+.2f}({np.hypot(both.sem, error):.2f}) | {young:.1f}({young_error:.1f}) | {angle.mean:.1f}({angle.sem:.1f}) "
            f"| {angle.mean - young:+.1f}({np.hypot(angle.sem, young_error):.1f}) | {found.radius.mean:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
