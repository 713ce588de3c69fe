"""Excess chemical potentials of molecules in soft solvents beside published ones: numbers of docs/validation.md.

    python docs/measure/insertion.py monomers
    python docs/measure/insertion.py dimers
    python docs/measure/insertion.py chains --stiffness 4 --time 400
    python docs/measure/insertion.py size
    python docs/measure/insertion.py alkanes

monomers: mu_ex of one bead for all repulsions up to 50, ratios of two solvents, and differences to a bead of the solvent.  dimers: two
beads on a spring.  chains: ln K of chains between two solvents.  size: the same molecule in two boxes.  alkanes: repulsion from log P, and
log P with it.  Solvent A = 25, density 3; reduced units, rc = m = kT = 1.
"""

from __future__ import annotations

import argparse

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.molecules import Molecule, Spring, linear, pack
from openmm_dpd.parameters import (
    chi_from_log_p,
    excess_chemical_potential,
    log_p,
    repulsion_from_chi,
    repulsion_from_log_p,
)

#: Patrick B. Warren, github.com/patrickbwarren/python3-HNC-solver, dimer_data.ods (Widom insertion): mu_ex of a bead by A_01.
MONOMERS = {5: 2.98545, 10: 5.67323, 15: 8.08463, 20: 10.2407, 25: 12.1628, 30: 13.8741, 35: 15.4002, 40: 16.7716, 45: 18.0212, 50: 19.1793}
MONOMER_ERRORS = (0.0001, 0.0003, 0.0006, 0.0014, 0.0032, 0.0071, 0.0141, 0.0243, 0.0368, 0.0505)

#: The same file: mu_ex of two beads at distances 0, 0.1, ..., 1, for A_01 = 25 and 30.
RIGID = {
    25: (19.1818, 19.3457, 19.7478, 20.3507, 21.0799, 21.8455, 22.5759, 23.2185, 23.7309, 24.0873, 24.297),
    30: (21.3183, 21.5232, 22.017, 22.7695, 23.6846, 24.6415, 25.5547, 26.3621, 27.0225, 27.5032, 27.8),
}

#: Hendrikse, Amador and Wilson, Phys. Chem. Chem. Phys. 27, 1554 (2025), as transcribed in the same repository: ln K by (A, B).
HENDRIKSE_MONOMERS = {(25, 35): (3.244, 0.016), (25, 40): (4.697, 0.007), (30, 35): (1.528, 0.008), (30, 40): (2.938, 0.026)}
#: ... and by number of beads and l0.
HENDRIKSE = {
    (2, 0.4): {(25, 30): (2.418, 0.040), (30, 35): (1.990, 0.035), (32.5, 40): (2.556, 0.038)},
    (2, 0.6): {(25, 30): (2.787, 0.007), (30, 35): (2.354, 0.012), (32.5, 40): (3.131, 0.022), (30, 40): (4.443, 0.069)},
    (2, 1.0): {(25, 30): (3.394, 0.029), (30, 35): (2.956, 0.044), (32.5, 40): (3.946, 0.223)},
    (3, 0.4): {(25, 30): (2.963, 0.008), (30, 35): (2.452, 0.050), (32.5, 37): (1.966, 0.032)},
    (3, 0.6): {(25, 30): (4.016, 0.098), (30, 35): (3.166, 0.013), (32.5, 37): (2.880, 0.077)},
    (4, 0.6): {(30, 35): (4.239, 0.057), (32.5, 36): (2.407, 0.045)},
}

#: Wijmans, Smit and Groot, J. Chem. Phys. 114, 7644 (2001), Fig. 5 as digitised in github.com/patrickbwarren/SunlightHNC, by dA.
WIJMANS = {2: 0.699745, 4: 1.370293, 8: 2.6384122, 12: 3.7897591, 16: 4.853515, 20: 5.8296797, 24: 6.7182534}

#: log P as the package chemicals has them (butane: SYRRES, 2006; octane: CRC Handbook, 95th ed., 2014), and beads of three waters by volume.
ALKANES = {"butane": (2.89, 2), "octane": (5.15, 3)}
SPRING = Spring(k=20.0, r0=0.5)


def box_of(edge: float, A: float, *, own: float = 25.0) -> dpd.Scene:
    """A solvent W and coefficients of beads A with the repulsion A to it."""
    pairs = {("*", "*"): dpd.DPD(A=25, gamma=4.5), ("A", "A"): dpd.DPD(A=own, gamma=4.5), ("A", "W"): dpd.DPD(A=A, gamma=4.5)}
    return pack({}, box=[edge] * 3, solvent="W", seed=7).scene(pairs=pairs, kT=1.0, masses={"W": 1.0, "A": 1.0})


def monomers(options: argparse.Namespace) -> None:
    """One bead."""
    top = 50.0
    found = excess_chemical_potential(Molecule(("A",)), box_of(7.0, top), copies=8, time=options.time, seed=options.seed)
    print(f"density far from the copies over the wanted one: {found.densities.mean():.5f}")
    for (A, published), error in zip(MONOMERS.items(), MONOMER_ERRORS, strict=True):
        here = found.at(A / top)
        print(f"A = {A}: {here.value:.3f}({here.error:.3f}), Warren {published:.3f}({error:.3f})")
    for (one, other), (published, error) in HENDRIKSE_MONOMERS.items():
        here = found.at(other / top, one / top)
        print(f"ln K {one}/{other}: {here.value:.3f}({here.error:.3f}), Hendrikse et al. {published}({error})")
    for dA, published in WIJMANS.items():
        here = found.at((25 + dA) / top, 0.5)
        print(f"dA = {dA}: {here.value:.3f}({here.error:.3f}), Wijmans et al. {published:.3f}")


def flexible(A: int, k: float, r0: float, own: float) -> float:
    """mu_ex of two beads on a spring from that of rigid ones, -ln <exp(-mu_ex(r))> over the molecule alone."""
    r = np.linspace(1e-3, 1.6, 4000)
    weight = r**2 * np.exp(-k * (r - r0) ** 2 - 0.5 * own * np.maximum(0, 1 - r) ** 2)
    rigid = np.interp(r, np.linspace(0, 1, 11), RIGID[A])
    return float(-np.log(np.sum(weight * np.exp(-rigid)) / np.sum(weight)))


def dimers(options: argparse.Namespace) -> None:
    """Two beads on a spring, nearly always within 1: beyond, mu_ex is the one at 1 to 0.1."""
    for A in RIGID:
        for own in (0.0, 25.0):
            chain = linear("A2", SPRING)
            found = excess_chemical_potential(chain, box_of(7.0, A, own=own), time=options.time, seed=options.seed)
            print(
                f"A = {A}, {own:g} within: {found.value:.3f}({found.error:.3f}), Warren's rigid ones {flexible(A, SPRING.k, SPRING.r0, own):.3f}",
                flush=True,
            )


def chains(options: argparse.Namespace) -> None:
    """ln K of chains between a solvent that repels them with A and one with B."""
    top = 40.0
    for (beads, r0), pairs in HENDRIKSE.items():
        chain = linear(f"A{beads}", Spring(k=options.stiffness, r0=r0))
        found = excess_chemical_potential(chain, box_of(7.5, top, own=options.own), time=options.time, seed=options.seed)
        for (one, other), (published, error) in pairs.items():
            here = found.at(other / top, one / top)
            print(
                f"N = {beads}, r0 = {r0}, {one}/{other}: {here.value:.3f}({here.error:.3f}), Hendrikse et al. {published}({error})",
                flush=True,
            )


def size(options: argparse.Namespace) -> None:
    """Three bonded beads in two boxes."""
    for edge, copies in ((6.5, 6), (9.0, 6), (9.0, 12)):
        chain = linear("A3", SPRING)
        found = excess_chemical_potential(chain, box_of(edge, 40.0), time=options.time, copies=copies, seed=options.seed)
        print(f"edge {edge}, {copies} copies: {found.value:.3f}({found.error:.3f}), density {found.densities.mean():.5f}", flush=True)


def solvents(A: float) -> tuple[dpd.Scene, dpd.Scene]:
    """Octanol, chains of three beads that are like those of alkanes to these, and water, which repels them with A."""
    like, box = dpd.DPD(A=25.0, gamma=4.5), [6.8] * 3
    pairs = {("*", "*"): like, ("C", "W"): dpd.DPD(A=A, gamma=4.5)}
    masses = dict.fromkeys("COW", 1.0)
    octanol = pack({}, box=box, solvent=linear("O3", SPRING), seed=5).scene(pairs=pairs, kT=1.0, masses=masses)
    return octanol, pack({}, box=box, solvent="W", seed=6).scene(pairs=pairs, kT=1.0, masses=masses)


def alkanes(options: argparse.Namespace) -> None:
    """Repulsion of alkane and water from log P: by Flory-Huggins theory, and by two runs; log P with both."""
    choices = {"time": options.time, "seed": options.seed}
    wanted, beads = ALKANES["octane"]
    chi = chi_from_log_p(wanted, beads, octanol_beads=3)
    theory = 25.0 + repulsion_from_chi(chi).value
    fitted = repulsion_from_log_p(wanted, linear(f"C{beads}", SPRING), *solvents(60.0), **choices)
    print(f"octane, chi = {chi.value:.3f}: A = {theory:.2f} by theory, {fitted.value:.2f}({fitted.error:.2f}) by runs", flush=True)
    choices["seed"] += 100
    for name, (wanted, beads) in ALKANES.items():
        for A in (theory, fitted.value):
            found = log_p(linear(f"C{beads}", SPRING), *solvents(A), **choices)
            print(f"{name}, A = {A:.2f}: log P {found.value:.3f}({found.error:.3f}), experiment {wanted}", flush=True)


def main() -> None:
    """Choose and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    tasks = {"monomers": monomers, "dimers": dimers, "chains": chains, "size": size, "alkanes": alkanes}
    parser.add_argument("what", choices=tuple(tasks))
    parser.add_argument("--time", type=float, default=1000.0, help="length of each run, in units of rc (m/kT)^(1/2)")
    parser.add_argument("--stiffness", type=float, default=4.0, help="k of k (r - r0)^2")
    parser.add_argument("--own", type=float, default=25.0, help="repulsion of the beads of a chain among themselves")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    tasks[options.what](options)


if __name__ == "__main__":
    main()
