"""Write the data files and the pair table that the decks in this folder read.

Run it here (``python make_inputs.py``, one to two minutes); it needs numpy only and its random numbers have
fixed seeds, so that it writes the files already kept beside it (to rounding in the last digits).
Everything is generated: no file comes from another code.

Files written
-------------
table.cg_water        tabulated potential of one-site water, LAMMPS pair-table format (real units)
data.cg_water         2180 water beads, atom_style full, shuffled ids, style hint (real units)
data.dpd_fdt          2000 beads for in.dpd-vv and in.dpde-vv, atom_style dpd, no Masses section (metal units)
data.dpd_shardlow     2000 beads with velocities for in.dpd-shardlow, atom_style dpd (metal units)
data.dpde_shardlow    3000 beads with velocities for in.dpde-shardlow and in.dpdp-shardlow, atom_style dpd (metal units)
data.dpdh             2500 beads with velocities for in.dpdh-shardlow, atom_style dpd (metal units)
table.dpde_eos        internal energy of a bead as a function of its temperature, for in.dpde-table (metal units)
data.chains           60 chains of 8 beads in 480 + 480 solvent, atom_style bond, no style hint (lj units)
data.srp              40 chains of 10 beads among 248 single ones, atom_style angle, a third type for bonds (lj units)
data.electrolyte      331 solvent beads, 22 cations and 22 anions, atom_style charge (lj units)
data.triclinic        900 beads in a tilted box, image flags, beads far outside, velocities (lj units)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent

# One-site water, kcal/mol and Angstrom: a Gaussian core and three Gaussian features that place
# neighbours near 2.85 and 4.7 A.  Every term is below 1e-9 kcal/mol at 9 A, so no switching is needed.
#              height  centre  width
GAUSSIANS = ((45.00, 0.00, 1.15), (-0.45, 2.85, 0.45), (0.12, 3.70, 0.50), (-0.12, 4.70, 0.70))
KT_300 = 8.617343e-5 * 300.0  # eV
TABLE_LO, TABLE_HI, TABLE_POINTS = 0.01, 9.0, 900
EOS_LO, EOS_HI, EOS_POINTS = 10.0, 1200.0, 1191  # K


def water_potential(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Energy U(r) and force -dU/dr of the one-site water, in kcal/mol and kcal/mol/A."""
    energy, force = np.zeros_like(r), np.zeros_like(r)
    for height, centre, width in GAUSSIANS:
        term = height * np.exp(-(((r - centre) / width) ** 2))
        energy += term
        force += term * 2.0 * (r - centre) / width**2
    return energy, force


def write_table(path: Path) -> None:
    """Pair table: a comment, a keyword, ``N .. R lo hi``, a blank line, then ``index r energy force``."""
    r = np.linspace(TABLE_LO, TABLE_HI, TABLE_POINTS)
    energy, force = water_potential(r)
    lines = [
        "# One-site water: sum of Gaussians h*exp(-((r-c)/w)^2), written by make_inputs.py",
        "# UNITS: real",
        "",
        "CG_WATER",
        f"N {TABLE_POINTS} R {TABLE_LO} {TABLE_HI}",
        "",
    ]
    lines += [f"{k + 1} {r[k]:.8f} {energy[k]:.12g} {force[k]:.12g}" for k in range(TABLE_POINTS)]
    path.write_text("\n".join(lines) + "\n")


def spread_points(rng: np.random.Generator, n: int, box: np.ndarray, closest: float) -> np.ndarray:
    """n random points in a periodic orthorhombic box, no two nearer than ``closest`` (rejection)."""
    points = np.empty((n, 3))
    placed = 0
    while placed < n:
        trial = rng.random(3) * box
        gap = points[:placed] - trial
        gap -= box * np.round(gap / box)
        if placed == 0 or np.min(np.sum(gap * gap, axis=1)) > closest**2:
            points[placed] = trial
            placed += 1
    return points


def near_pairs(x: np.ndarray, box: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Index pairs i < j closer than ``reach`` (minimum image), a block of rows at a time."""
    first, second = [], []
    for start in range(0, len(x), 200):
        gap = x[start : start + 200, None, :] - x[None, :, :]
        gap -= box * np.round(gap / box)
        i, j = np.nonzero(np.sum(gap * gap, axis=2) < reach * reach)
        keep = i + start < j
        first.append(i[keep] + start)
        second.append(j[keep])
    return np.concatenate(first), np.concatenate(second)


def relax(
    rng: np.random.Generator,
    x: np.ndarray,
    box: np.ndarray,
    force_over_kt: Callable[[np.ndarray], np.ndarray],
    cutoff: float,
    step: float,
    steps: int,
) -> np.ndarray:
    """Brownian dynamics, so that the decks start near equilibrium: dx = (step^2/2) F/kT + step*xi.

    ``force_over_kt(r)`` is the radial pair force, positive when repulsive; ``step`` is the rms move per axis.
    The step is halved after one half and again after three quarters of the steps (large steps heat).
    The pair list reaches 20 % further than the cutoff and is made anew every ten steps.
    """
    n, half, quarter = len(x), steps // 2, 3 * steps // 4
    for k in range(steps):
        if k in (half, quarter):
            step /= 2.0
        if k % 10 == 0:
            i, j = near_pairs(x, box, 1.2 * cutoff)
        gap = x[i] - x[j]
        gap -= box * np.round(gap / box)
        r = np.sqrt(np.sum(gap * gap, axis=1))
        pull = gap * (np.where(r < cutoff, force_over_kt(r), 0.0) / r)[:, None]
        force = np.stack([np.bincount(i, pull[:, a], n) - np.bincount(j, pull[:, a], n) for a in range(3)], axis=1)
        x = x + 0.5 * step**2 * force + step * rng.standard_normal((n, 3))
    return x - box * np.floor(x / box)


def soft_force(strength: float, cutoff: float, kt: float) -> Callable[[np.ndarray], np.ndarray]:
    """The conservative DPD force over kT as a function of distance."""
    return lambda r: strength / kt * (1.0 - r / cutoff)


def thermal_velocities(rng: np.random.Generator, n: int, variance: float, temperature_dof: int) -> np.ndarray:
    """Gaussian velocities, total momentum zero (equal masses), scaled to the exact mean square.

    ``sum v^2 = temperature_dof * variance`` afterwards, i.e. the temperature counted with
    ``temperature_dof`` degrees of freedom is exact.
    """
    v = rng.standard_normal((n, 3))
    v -= v.mean(axis=0)
    return v * np.sqrt(temperature_dof * variance / np.sum(v * v))


def box_lines(lo: np.ndarray, hi: np.ndarray) -> list[str]:
    """The three ``lo hi xlo xhi`` lines of a data file header."""
    return [f"{lo[k]:.10g} {hi[k]:.10g} {axis}lo {axis}hi" for k, axis in enumerate("xyz")]


def write_water(path: Path) -> None:
    """13^3 lattice sites, 17 of them empty, relaxed at 300 K; ids shuffled so that file order is not id order."""
    rng = np.random.default_rng(20240101)
    n, edge, sites = 2180, 40.31, 13
    grid = np.stack(np.meshgrid(*[np.arange(sites)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    keep = np.sort(rng.permutation(len(grid))[:n])
    x = (grid[keep] + 0.5) * (edge / sites) + rng.uniform(-0.35, 0.35, (n, 3))
    kt = 0.0019872067 * 300.0
    x = relax(rng, x, np.full(3, edge), lambda r: water_potential(r)[1] / kt, 7.0, 0.10, 900)
    ids = rng.permutation(n) + 1
    lines = ["One-site water, 2180 beads, written by make_inputs.py", "", f"{n} atoms", "1 atom types", ""]
    lines += box_lines(np.zeros(3), np.full(3, edge))
    lines += ["", "Masses", "", "1 18.0154  # W", "", "Atoms  # full", ""]
    lines += [f"{i} {i} 1 0.0 {p[0]:.5f} {p[1]:.5f} {p[2]:.5f}" for i, p in zip(ids, x, strict=True)]
    path.write_text("\n".join(lines) + "\n")


def write_fdt(path: Path) -> None:
    """2000 beads at 0.004717 beads/A^3; the mass is given by the deck, theta = 300 K; lower corner not 0."""
    rng = np.random.default_rng(20240102)
    n, theta = 2000, 300.0
    box = np.full(3, 75.13)
    lo = -box / 2
    x = relax(rng, spread_points(rng, n, box, 3.0), box, soft_force(0.075, 8.6, KT_300), 8.6, 0.4, 480) + lo
    lines = ["Beads with an internal temperature, written by make_inputs.py", "", f"{n} atoms", "1 atom types", ""]
    lines += box_lines(lo, lo + box)
    lines += ["", "Atoms # dpd", ""]
    lines += [f"{i + 1} 1 {theta:.1f} {p[0]:.6f} {p[1]:.6f} {p[2]:.6f}" for i, p in enumerate(x)]
    path.write_text("\n".join(lines) + "\n")


@dataclass(frozen=True)
class ColdStart:
    """Beads relaxed at 300 K whose velocities are those of another temperature (kelvin), for the Shardlow decks."""

    title: str
    seed: int
    box: tuple[float, float, float]
    beads: int
    start: float


SHARDLOW = ColdStart("Cold start for a Shardlow run", 20240103, (66.83, 57.89, 105.62), 2000, 128.67)
DPDE_SHARDLOW = ColdStart("Cold start for Shardlow runs at constant energy or pressure", 20240106, (66.83, 57.89, 158.43), 3000, 128.67)
DPDH = ColdStart("Start of a Shardlow run at constant enthalpy", 20240107, (80.93, 80.93, 80.93), 2500, 239.427)


def write_shardlow(path: Path, job: ColdStart) -> None:
    """Theta = 300 K for each bead, velocities for a mass of 100 (the deck overrides the mass in the file)."""
    rng = np.random.default_rng(job.seed)
    n, mass = job.beads, 100.0
    box = np.array(job.box)
    x = relax(rng, spread_points(rng, n, box, 3.0), box, soft_force(0.075, 10.0, KT_300), 10.0, 0.4, 480)
    mvv2e = 1.0364269e-4  # metal: (g/mol) (A/ps)^2 -> eV
    v = thermal_velocities(rng, n, KT_300 * job.start / 300.0 / (mass * mvv2e), 3 * n - 3)
    lines = [f"{job.title}, written by make_inputs.py", "", f"{n} atoms", "1 atom types", ""]
    lines += box_lines(np.zeros(3), box)
    lines += ["", "Masses", "", "1 200.0", "", "Atoms", ""]  # this mass is meant to be overridden
    lines += [f"{i + 1} 1 300.0 {p[0]:.6f} {p[1]:.6f} {p[2]:.6f}" for i, p in enumerate(x)]
    lines += ["", "Velocities", ""]
    lines += [f"{i + 1} {u[0]:.9f} {u[1]:.9f} {u[2]:.9f}" for i, u in enumerate(v)]
    path.write_text("\n".join(lines) + "\n")


def internal_energy(theta: np.ndarray) -> np.ndarray:
    """Energy (eV) inside a bead at temperature theta (K): a constant heat capacity and 48 quantum oscillators.

    U = 12 kB theta + 48 kB theta_E / (exp(theta_E/theta) - 1), theta_E = 500 K.  The heat capacity grows
    from 12 kB (cold) to 60 kB (hot); at 300 K it is 50 kB.
    """
    kb, einstein = KT_300 / 300.0, 500.0
    return kb * (12.0 * theta + 48.0 * einstein / np.expm1(einstein / theta))


def write_eos(path: Path) -> None:
    """Equation of state for fix eos/table: a keyword, ``N n``, a blank line, then ``index T U``."""
    theta = np.linspace(EOS_LO, EOS_HI, EOS_POINTS)
    energy = internal_energy(theta)
    lines = [
        "# U(T) of a bead: 12 kB T + 48 oscillators of 500 K, written by make_inputs.py",
        "# UNITS: metal (K, eV)",
        "",
        "SOFT_BEAD",
        f"N {EOS_POINTS}",
        "",
    ]
    lines += [f"{k + 1} {theta[k]:.10g} {energy[k]:.12g}" for k in range(EOS_POINTS)]
    path.write_text("\n".join(lines) + "\n")


def write_chains(path: Path) -> None:
    """Random-walk chains (bond length 0.8) in solvent; molecule ids; unwrapped chains with image flags."""
    rng = np.random.default_rng(20240104)
    chains, length, solvent, edge = 60, 8, 480, 6.8399038  # 960 beads, density 3
    rows, bonds, atom = [], [], 0
    for chain in range(chains):
        position = rng.random(3) * edge
        for bead in range(length):
            atom += 1
            if bead:
                step = rng.standard_normal(3)
                position = position + 0.8 * step / np.linalg.norm(step)
                # two kinds of bond: the chain ends are type 2
                kind = 2 if bead in (1, length - 1) else 1
                bonds.append((len(bonds) + 1, kind, atom - 1, atom))
            image = np.floor(position / edge).astype(int)
            rows.append((atom, chain + 1, 1, *(position - image * edge), *image))
    for k in range(solvent):
        atom += 1
        rows.append((atom, chains + 1 + k, 2, *(rng.random(3) * edge), 0, 0, 0))
    lines = ["Short chains in solvent, written by make_inputs.py", "", f"{atom} atoms", f"{len(bonds)} bonds"]
    lines += ["2 atom types", "2 bond types", ""] + box_lines(np.zeros(3), np.full(3, edge))
    lines += ["", "Masses", "", "1 1.0", "2 1.0", "", "Atoms", ""]
    lines += [f"{a} {m} {t} {x:.6f} {y:.6f} {z:.6f} {i} {j} {k}" for a, m, t, x, y, z, i, j, k in rows]
    lines += ["", "Bonds", ""] + [" ".join(map(str, bond)) for bond in bonds]
    path.write_text("\n".join(lines) + "\n")


def write_srp(path: Path) -> None:
    """Random walks of ten beads (bond length 0.85) with an angle at every inner bead, and single beads between them."""
    rng = np.random.default_rng(20240108)
    chains, length, single, edge = 40, 10, 248, 6.0  # 648 beads, density 3
    rows, bonds, angles = [], [], []
    for chain in range(chains):
        position = rng.random(3) * edge
        for bead in range(length):
            if bead:
                step = rng.standard_normal(3)
                position = position + 0.85 * step / np.linalg.norm(step)
                bonds.append((len(bonds) + 1, 1, len(rows), len(rows) + 1))
            if bead > 1:
                angles.append((len(angles) + 1, 1, len(rows) - 1, len(rows), len(rows) + 1))
            image = np.floor(position / edge).astype(int)
            rows.append((len(rows) + 1, chain + 1, 1, *(position - image * edge), *image))
    for k in range(single):
        rows.append((len(rows) + 1, chains + 1 + k, 2, *(rng.random(3) * edge), 0, 0, 0))
    lines = [
        "Chains that do not cross, written by make_inputs.py",
        "",
        f"{len(rows)} atoms",
        f"{len(bonds)} bonds",
        f"{len(angles)} angles",
    ]
    lines += ["3 atom types", "1 bond types", "1 angle types", ""] + box_lines(np.zeros(3), np.full(3, edge))
    lines += ["", "Masses", "", "1 1.0", "2 1.0", "3 1.0", "", "Atoms # angle", ""]
    lines += [f"{a} {m} {t} {x:.6f} {y:.6f} {z:.6f} {i} {j} {k}" for a, m, t, x, y, z, i, j, k in rows]
    lines += ["", "Bonds", ""] + [" ".join(map(str, bond)) for bond in bonds]
    lines += ["", "Angles", ""] + [" ".join(map(str, angle)) for angle in angles]
    path.write_text("\n".join(lines) + "\n")


def write_electrolyte(path: Path) -> None:
    """Beads on a disturbed lattice, ions among them at random."""
    rng = np.random.default_rng(20240111)
    edge, sites = 5.0, 8
    kinds = np.array([1] * 331 + [2] * 22 + [3] * 22)
    rng.shuffle(kinds)
    lattice = np.stack(np.meshgrid(*[np.arange(sites)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    places = (rng.permutation(lattice)[: len(kinds)] + 0.5 + rng.uniform(-0.3, 0.3, (len(kinds), 3))) * edge / sites
    lines = ["Solvent and ions, written by make_inputs.py", "", f"{len(kinds)} atoms", "3 atom types", ""]
    lines += box_lines(np.zeros(3), np.full(3, edge)) + ["", "Masses", "", "1 1.0", "2 1.0", "3 1.0", "", "Atoms # charge", ""]
    charges = {1: 0.0, 2: 1.0, 3: -1.0}
    rows = zip(kinds.tolist(), places.tolist(), strict=True)
    lines += [f"{k} {kind} {charges[kind]:g} {x:.6f} {y:.6f} {z:.6f}" for k, (kind, (x, y, z)) in enumerate(rows, start=1)]
    path.write_text("\n".join(lines) + "\n")


def write_triclinic(path: Path) -> None:
    """Tilted box with a lower corner that is not 0; a third of the beads lie in other periodic images."""
    rng = np.random.default_rng(20240105)
    n, lo = 900, np.array([-1.5, 2.25, -4.0])
    edges = np.array([7.0, 6.5, 6.5934066])  # volume 300, density 3
    xy, xz, yz = 1.4, -0.9, 2.1
    vectors = np.array([[edges[0], 0.0, 0.0], [xy, edges[1], 0.0], [xz, yz, edges[2]]])
    kind = np.where(np.arange(n) % 3 == 0, 2, 1)
    mass = np.where(kind == 2, 2.0, 1.0)
    wrapped = rng.random((n, 3)) @ vectors + lo
    image = np.zeros((n, 3), dtype=int)
    image[300:600] = rng.integers(-2, 3, (300, 3))  # flags say where the bead has been
    outside = np.zeros((n, 3), dtype=int)
    outside[600:] = rng.integers(-3, 4, (300, 3))  # no flags, but the coordinates themselves are far away
    x = wrapped + outside @ vectors
    v = rng.standard_normal((n, 3)) / np.sqrt(mass)[:, None]
    v -= (mass @ v / mass.sum())[None, :]
    v *= np.sqrt((3 * n - 3) / np.sum(mass[:, None] * v * v))  # temperature 1 with 3N - 3
    lines = ["Two kinds of beads in a tilted box, written by make_inputs.py", "", f"{n} atoms", "2 atom types", ""]
    lines += box_lines(lo, lo + edges) + [f"{xy} {xz} {yz} xy xz yz"]
    lines += ["", "Masses", "", "1 1.0", "2 2.0", "", "Atoms # atomic", ""]
    lines += [f"{i + 1} {kind[i]} {p[0]:.7f} {p[1]:.7f} {p[2]:.7f} {image[i, 0]} {image[i, 1]} {image[i, 2]}" for i, p in enumerate(x)]
    lines += ["", "Velocities", ""]
    lines += [f"{i + 1} {u[0]:.9f} {u[1]:.9f} {u[2]:.9f}" for i, u in enumerate(v)]
    path.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    write_table(HERE / "table.cg_water")
    write_water(HERE / "data.cg_water")
    write_fdt(HERE / "data.dpd_fdt")
    write_shardlow(HERE / "data.dpd_shardlow", SHARDLOW)
    write_shardlow(HERE / "data.dpde_shardlow", DPDE_SHARDLOW)
    write_shardlow(HERE / "data.dpdh", DPDH)
    write_eos(HERE / "table.dpde_eos")
    write_chains(HERE / "data.chains")
    write_srp(HERE / "data.srp")
    write_electrolyte(HERE / "data.electrolyte")
    write_triclinic(HERE / "data.triclinic")
