"""Random chains for tests of bonds, angles and segmental repulsion, their energies in plain numpy, and LAMMPS on the same beads."""

from itertools import combinations, product
from pathlib import Path
from typing import Any

import lammps_peer
import numpy as np
from cases import put

import openmm_dpd as dpd
from openmm_dpd.lammps import read_deck

#: LAMMPS's hybrid bonds of three types and angles of two, and the same as formulas of r and theta.
BONDS = {1: "harmonic 20.0 0.7", 2: "fene 30.0 1.5 0.8 0.9", 3: "morse 12.0 1.7 0.6"}
ANGLES = {1: "harmonic 6.0 110.0", 2: "cosine 4.0"}
DECK = f"""units lj
atom_style angle
newton on
special_bonds lj 1 1 1
comm_modify vel yes cutoff 3.0
bond_style hybrid harmonic fene morse
angle_style hybrid harmonic cosine
pair_style dpd 0.0 1.0 33
read_data data.chains
{chr(10).join(f"bond_coeff {kind} {text}" for kind, text in BONDS.items())}
{chr(10).join(f"angle_coeff {kind} {text}" for kind, text in ANGLES.items())}
"""


def fene(r: float) -> float:
    """Spring and repulsion of bond type 2."""
    energy = -0.5 * 30.0 * 1.5**2 * np.log(1 - (r / 1.5) ** 2)
    if r < 2 ** (1 / 6) * 0.9:
        energy += 4 * 0.8 * ((0.9 / r) ** 12 - (0.9 / r) ** 6) + 0.8
    return energy


BOND_ENERGY = {1: lambda r: 20.0 * (r - 0.7) ** 2, 2: fene, 3: lambda r: 12.0 * (1 - np.exp(-1.7 * (r - 0.6))) ** 2}
ANGLE_ENERGY = {1: lambda theta: 6.0 * (theta - np.radians(110.0)) ** 2, 2: lambda theta: 4.0 * (1 + np.cos(theta))}


def walks(chains: int, length: int, box: np.ndarray, seed: int, step: float = 0.95, spread: int = 1) -> tuple[np.ndarray, ...]:
    """Positions of random walks strewn over images of the box bead by bead, bonds (B, 2) and angles (A, 3)."""
    rng = np.random.default_rng(seed)
    x, bonds, angles = [], [], []
    for _ in range(chains):
        place = rng.random(3) @ box
        for k in range(length):
            move = rng.normal(size=3)
            place = place + step * (0.8 + 0.4 * rng.random()) * move / np.linalg.norm(move) * (k > 0)
            n = len(x)
            x.append(place + rng.integers(-spread, spread + 1, 3) @ box)
            bonds += [(n - 1, n)] if k > 0 else []
            angles += [(n - 2, n - 1, n)] if k > 1 else []
    return np.array(x), np.array(bonds), np.array(angles)


def nearest_image(d: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """The shortest of the 27 images of each vector (..., 3) about its wrapped one."""
    if box is None:
        return d
    wrapped = d - np.round(d @ np.linalg.inv(box)) @ box
    images = wrapped[..., None, :] + np.array(list(product((-1, 0, 1), repeat=3))) @ box
    shortest = np.argmin(np.sum(images**2, axis=-1), axis=-1)
    return np.take_along_axis(images, shortest[..., None, None], axis=-2)[..., 0, :]


def segment_energy(x, segments, box, A, cutoff, distance, sharing=False) -> float:
    """Segmental repulsion, every pair of bonds; the nearest points by a search, not by a formula."""
    first, second = np.transpose(segments)
    arms = nearest_image(x[second] - x[first], box)
    middle, half = x[first] + 0.5 * arms, 0.5 * np.linalg.norm(arms, axis=1)
    pairs, energy = np.array(list(combinations(range(len(segments)), 2))), 0.0
    gaps = nearest_image(middle[pairs[:, 0]] - middle[pairs[:, 1]], box)
    near = np.linalg.norm(gaps, axis=1) < cutoff + half[pairs].sum(axis=1)
    for (p, q), gap in zip(pairs[near].tolist(), gaps[near], strict=True):
        if not sharing and set(segments[p]) & set(segments[q]):
            continue
        d = np.linalg.norm(gap) if distance == "mid" else shortest(gap, arms[p], arms[q])
        energy += 0.5 * A * cutoff * (1 - d / cutoff) ** 2 if d < cutoff else 0.0
    return energy


def shortest(gap: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Distance of two segments whose midpoints are ``gap`` apart: the inner minimum, or that of one end and the other segment."""
    found = [np.linalg.norm(gap + s * a - np.clip((gap + s * a) @ b / (b @ b), -0.5, 0.5) * b) for s in (-0.5, 0.5)]
    found += [np.linalg.norm(gap - t * b + np.clip(-(gap - t * b) @ a / (a @ a), -0.5, 0.5) * a) for t in (-0.5, 0.5)]
    s, t = np.linalg.lstsq(np.array([a, -b]).T, -gap, rcond=None)[0]
    if abs(s) <= 0.5 and abs(t) <= 0.5:
        found.append(np.linalg.norm(gap + s * a - t * b))
    return min(found)


def data_file(x, bonds, angles, box, n_types=1, bond_types=3, angle_types=2) -> str:
    """LAMMPS data file of atom_style angle; types of bonds and angles go round."""
    lines = ["chains", "", f"{len(x)} atoms", f"{len(bonds)} bonds", f"{len(angles)} angles"]
    lines += [f"{n_types} atom types", f"{bond_types} bond types", f"{angle_types} angle types", ""]
    lines += [f"0.0 {edge!r} {axis}lo {axis}hi" for axis, edge in zip("xyz", np.diag(box).tolist(), strict=True)]
    if np.any(np.tril(box, -1)):
        lines.append(f"{float(box[1, 0])!r} {float(box[2, 0])!r} {float(box[2, 1])!r} xy xz yz")
    lines += ["", "Masses", "", *(f"{k + 1} 1.0" for k in range(n_types)), "", "Atoms # angle", ""]
    lines += [f"{k + 1} 1 1 " + " ".join(map(repr, p)) for k, p in enumerate(x.tolist())]
    lines += ["", "Bonds", ""] + [f"{k + 1} {k % bond_types + 1} {i + 1} {j + 1}" for k, (i, j) in enumerate(bonds.tolist())]
    lines += ["", "Angles", ""] + [f"{k + 1} {k % angle_types + 1} {i + 1} {j + 1} {m + 1}" for k, (i, j, m) in enumerate(angles.tolist())]
    return "\n".join(lines) + "\n"


SEGMENTS = """units lj
atom_style angle
newton on
special_bonds lj 1 1 1
comm_modify vel yes cutoff 3.0
neighbor {skin} bin
bond_style harmonic
angle_style cosine
read_data data.chains
bond_coeff * 100 0.8
angle_coeff * 2
pair_style {pair}
{coefficients}
velocity all set 0 0 0
fix 1 all nve
"""
OVERLAY = "pair_coeff 1 1 dpd 25 4.5\npair_coeff 1 2 none\npair_coeff 2 2 srp 80"


def segment_deck(folder: Path, pair: str, coefficients: str = OVERLAY, *, skin: float = 1.1, box: np.ndarray, seed: int = 5) -> str:
    """A deck with segmental repulsion, its data file written beside it: 100 bonds of two types."""
    x, bonds, angles = walks(20, 6, box, seed, step=0.8)
    put(folder / "data.chains", data_file(x, bonds, angles, box, n_types=2, bond_types=2, angle_types=1))
    return SEGMENTS.format(pair=pair, coefficients=coefficients, skin=skin)


def scene_of(folder: Path, text: str, compat: str = "consistent") -> dpd.Scene:
    """The scene in front of a deck's runs."""
    state = read_deck(put(folder / "in.ours", text + "run 0\n"), stop_before_first_run=True, output=folder)
    return state.first_run.override(compat=compat).scene()


WORDS = ("pe", "ebond", "eangle", "emol", "evdwl", "press")


def theirs(folder: Path, deck: str) -> tuple[dict[str, float], np.ndarray]:
    """Thermo words and forces at step 0 of a deck in a live LAMMPS, run in the folder."""
    with lammps_peer.instance() as lmp:
        lmp.command(f"shell cd {folder}")
        lmp.commands_string(deck)
        # during the run: afterwards srp has sorted its beads anew, and their forces are those of others
        lmp.commands_list(["dump forces all custom 1 forces.txt id fx fy fz", "dump_modify forces sort id format float %.17g"])
        lmp.commands_list(["thermo_style custom step " + " ".join(WORDS), "thermo_modify norm no", "run 0 post no"])
        found: dict[str, Any] = {word: lmp.get_thermo(word) for word in WORDS}
    rows = np.loadtxt(folder / "forces.txt", skiprows=9)
    return found, rows[:, 1:]
