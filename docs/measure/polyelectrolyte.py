"""Size of a polyelectrolyte chain against the fraction of its monomers that is charged, beside published numbers.

One chain of 50 beads with 75 pairs of salt ions and water, 10,125 beads at density 3 in a box of 15: the system of Gonzalez-Melchor,
Mayoral, Velazquez and Alejandre, J. Chem. Phys. 125, 224107 (2006), table II, with the coefficients of the PyGAMD project's validation of
it: a = 78.3 (80.42 between monomers and water), gamma = 4.5, bonds F = -4 r, charges of +1/2 on single monomers, Bjerrum length 1.105,
Slater charges with 1/lambda = 0.929.

    python docs/measure/polyelectrolyte.py --fraction 0.48 --time 2000      # 15 minutes on one core

Prints the root mean square radius of gyration and end-to-end distance with standard errors, again after every tenth of the run.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.molecules import Spring, bead, linear, pack, relax
from openmm_dpd.stats import block_average

LENGTH, SALT = 50, 75
#: Fraction -> rms end-to-end distance and radius of gyration: table II of the paper (with its spread), and PyGAMD.
PUBLISHED = {
    0.0: ("6.5(1.0) 2.9(0.2)", "7.061 2.942"),
    0.24: ("7.2(0.7) 3.1(0.2)", "7.530 3.081"),
    0.48: ("8.3(1.0) 3.5(0.2)", "8.819 3.504"),
    0.76: ("9.6(1.7) 3.9(0.4)", "9.890 3.875"),
    1.0: ("10.9(1.7) 4.4(0.4)", "10.898 4.287"),
}


def scene_of(fraction: float, seed: int) -> dpd.Scene:
    """The chain, salt, counterions and water."""
    charged = round(fraction * LENGTH / 2) * 2  # an even number of halves
    charges = np.zeros(LENGTH)
    # every other monomer first, then the ones between
    charges[np.concatenate([np.arange(0, LENGTH, 2), np.arange(1, LENGTH, 2)])[:charged]] = 0.5
    chain = linear(["P"] * LENGTH, Spring(k=50, r0=0.7), charges=charges)
    ions = {bead("C", charge=1): SALT, bead("A", charge=-1): SALT + charged // 2}
    mixture = pack({chain: 1, **ions}, solvent="W", density=3, box=[15, 15, 15], seed=seed)
    same = dpd.DPD(A=78.3, gamma=4.5)
    scene = mixture.scene(
        masses=1.0,
        pairs={("*", "*"): same, ("P", "W"): dpd.DPD(A=80.42, gamma=4.5)},
        kT=1.0,
        electrostatics=dpd.SlaterCharges(lamda=1 / 0.929, bjerrum_length=1.105, tolerance=1e-3, cutoff=3.64),
    )
    scene = replace(scene, bonds=[dpd.HarmonicBonds(scene.bond_pairs, k=2.0, r0=0.0)])
    return relax(scene, iterations=50)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fraction", type=float, default=0.48, choices=sorted(PUBLISHED))
    parser.add_argument("--time", type=float, default=2000.0)
    parser.add_argument("--discard", type=float, default=200.0)
    parser.add_argument("--dt", type=float, default=0.04)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    dpd.set_threads(1)
    scene = scene_of(options.fraction, options.seed)
    chain = np.unique(scene.bond_pairs)
    built = dpd.build(scene, dt=options.dt, scheme="middle", platform="CPU", seed=options.seed)
    simulation, observer = built.simulation(properties={"Threads": "1"}), dpd.Observer(built)
    every, squares, kT = round(1.0 / options.dt), [], []
    total = round((options.time + options.discard) / (every * options.dt))
    for k in range(total):
        simulation.step(every)
        state = simulation.context.getState(positions=True)
        x = state.getPositions(asNumpy=True)._value[chain]
        if k * every * options.dt >= options.discard:
            squares.append((np.sum((x - x.mean(axis=0)) ** 2) / len(x), np.sum((x[-1] - x[0]) ** 2)))
            if k % 10 == 0:
                kT.append(observer.sample(simulation.context).kT)
        if (k + 1) % (total // 10) == 0 and len(squares) > 50:
            values = [block_average(series) for series in np.array(squares).T]
            (rg, rg_error), (ree, ree_error) = ((v.mean**0.5, v.sem / (2 * v.mean**0.5)) for v in values)
            print(
                f"fraction {options.fraction:g}, t = {len(squares) * every * options.dt:.0f}: Ree {ree:.2f}({ree_error:.2f})  "
                f"Rg {rg:.3f}({rg_error:.3f})  kT {np.mean(kT):.4f};  published: {', '.join(PUBLISHED[options.fraction])}",
                flush=True,
            )


if __name__ == "__main__":
    main()
