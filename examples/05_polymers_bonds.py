"""Chains of beads with harmonic bonds in a solvent: scaling of the chain size with length.

Chains of several lengths share one box.  The trajectory keeps them whole, mdtraj reads it back in chunks, and the radius of gyration is
computed with the masses in the PSF file.  All beads repel alike, so the solvent is a good one.  The size of a long self-avoiding chain
grows with the number of bonds to a power near 0.59; these are short and few, and the fitted power has an error of some hundredths.

    python examples/05_polymers_bonds.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import mdtraj
import numpy as np
from openmm import app

import openmm_dpd as dpd
from openmm_dpd.stats import block_average
from openmm_dpd.trajectory import compute_rg, load_topology, write_psf

OUT = Path("out/05_polymers_bonds")
EDGE, DENSITY = 8.5, 3.0
CHAINS = {4: 16, 8: 12, 16: 8, 32: 6}  # beads in a chain: number of chains
BOND_K, BOND_R0 = 50.0, 0.7  # U = k (r - r0)^2
MASSES = {"P": 1.5, "W": 1.0}
DT, EQUILIBRATION, STEPS, EVERY, CHUNK = 0.04, 2000, 8000, 40, 20


def random_walk(beads: int, rng: np.random.Generator) -> np.ndarray:
    """Positions of a chain from a random start in the box."""
    steps = rng.normal(size=(beads - 1, 3))
    steps *= BOND_R0 / np.linalg.norm(steps, axis=1)[:, None]
    return rng.random(3) * EDGE + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def scene(seed: int = 1) -> tuple[dpd.Scene, list[range]]:
    """Chains of P in a solvent of W, and the beads of each chain."""
    rng = np.random.default_rng(seed)
    positions, chains, start = [], [], 0
    for beads, count in CHAINS.items():
        for _ in range(count):
            positions.append(random_walk(beads, rng))
            chains.append(range(start, start + beads))
            start += beads
    solvent = round(DENSITY * EDGE**3) - start
    positions.append(rng.random((solvent, 3)) * EDGE)
    bonds = np.array([(bead, bead + 1) for chain in chains for bead in chain[:-1]])
    return (
        dpd.Scene(
            masses=MASSES,
            types=["P"] * start + ["W"] * solvent,
            positions=np.vstack(positions),
            pairs={("*", "*"): dpd.DPD(A=25.0, gamma=4.5, cutoff=1.0)},
            kT=1.0,
            box=[EDGE] * 3,
            bonds=[dpd.HarmonicBonds(bonds, k=BOND_K, r0=BOND_R0)],
        ),
        chains,
    )


def simulate(out: Path) -> list[range]:
    """Run and write trajectory and topology; the beads of each chain."""
    solution, chains = scene()
    built = dpd.build(solution, dt=DT, scheme="middle", seed=3)
    write_psf(out / "chains.psf", names=solution.types, masses=solution.bead_masses, bonds=solution.bond_pairs)
    simulation = built.simulation()
    simulation.step(EQUILIBRATION)
    # OpenMM wraps molecules, not beads, into the box: chains stay whole
    simulation.reporters.append(app.DCDReporter(str(out / "chains.dcd"), EVERY))
    simulation.step(STEPS)
    return chains


def sizes(out: Path, chains: list[range]) -> dict[int, np.ndarray]:
    """Beads in a chain -> radius of gyration (frames,), root mean square over the chains of that length."""
    topology = load_topology(out / "chains.psf")
    polymer = np.arange(chains[-1].stop)
    squares: dict[int, list[np.ndarray]] = {beads: [] for beads in CHAINS}
    for piece in mdtraj.iterload(str(out / "chains.dcd"), top=topology, chunk=CHUNK, atom_indices=polymer):
        of_piece: dict[int, list[np.ndarray]] = {beads: [] for beads in CHAINS}
        for chain in chains:
            of_piece[len(chain)].append(compute_rg(piece.atom_slice(chain)) ** 2)
        for beads, found in of_piece.items():
            squares[beads].append(np.mean(found, axis=0))
    return {beads: np.sqrt(np.concatenate(found)) for beads, found in squares.items()}


def picture(path: Path, rows: np.ndarray, exponent: float, factor: float) -> None:
    """Radius of gyration against the number of bonds."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import FixedLocator, NullLocator, ScalarFormatter

    figure, axis = plt.subplots(figsize=(5.6, 4.2), layout="constrained", dpi=150)
    bonds = rows[:, 0] - 1
    line = np.geomspace(0.8 * bonds.min(), 1.25 * bonds.max(), 50)
    axis.loglog(line, factor * line**exponent, color="0.5", linewidth=1.2, label=f"power {exponent:.2f}")
    axis.errorbar(bonds, rows[:, 1], yerr=rows[:, 2], fmt="o", color="#1f5a99", markersize=6, capsize=3, label="chains")
    axis.set(xlabel="bonds in the chain", ylabel="radius of gyration")
    axis.xaxis.set_major_locator(FixedLocator(bonds))
    axis.yaxis.set_major_locator(FixedLocator(np.arange(0.5, 4.1, 0.5)))
    for direction in (axis.xaxis, axis.yaxis):
        direction.set_major_formatter(ScalarFormatter())
        direction.set_minor_locator(NullLocator())
    axis.legend(frameon=False)
    axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """Run, analyse, draw; radius of gyration for each length, and the exponent."""
    out.mkdir(parents=True, exist_ok=True)
    averages = {beads: block_average(series) for beads, series in sizes(out, simulate(out)).items()}
    rows = np.array([(beads, average.mean, average.sem or 0.0) for beads, average in averages.items()])
    exponent, logarithm = np.polyfit(np.log(rows[:, 0] - 1), np.log(rows[:, 1]), 1)
    picture(out / "chains.png", rows, exponent, float(np.exp(logarithm)))
    return {f"Rg_{int(beads)}": float(mean) for beads, mean, _ in rows} | {"exponent": float(exponent)}


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:10s} {value:.4f}")
    print(f"picture: {OUT / 'chains.png'}")
