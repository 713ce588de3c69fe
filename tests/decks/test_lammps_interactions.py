"""Bonds, angles and pair styles of decks beside a live LAMMPS, without noise: every row of thermo output of a few steps."""

import re
from pathlib import Path

import chains_of_beads as chains
import lammps_peer
import numpy as np
from cases import cases, raises
from lammps_peer import printed

from openmm_dpd.base.errors import DeckError, RunError
from openmm_dpd.lammps import export_deck

pytestmark = lammps_peer.needed()

BOX = np.diag([6.0, 6.0, 6.0])
CHAINS = """units lj
atom_style angle
special_bonds lj 0 0.5 0.25
comm_modify vel yes cutoff 3.0
pair_style dpd 0.0 1.0 33
read_data data.chains
bond_style {bond}
{bonds}
angle_style {angle}
{angles}
pair_coeff 1 1 25.0 4.5
fix 1 all nve
timestep 0.002
"""
THERMO = """neigh_modify every 1 delay 0 check yes
thermo_style custom step pe ke ebond emol evdwl ecoul elong press pxx pyy pxy pyz
thermo_modify norm no format float %.15g
thermo 1
run 30
"""


#: Columns of pe, ecoul and elong, which cancel each other, while the error functions of LAMMPS have errors of 1e-7.
CANCEL = [1, 6, 7]


def rows(text: str) -> np.ndarray:
    """The last table of thermo output."""
    lines = text.splitlines()
    titles = max(k for k, line in enumerate(lines) if line.split()[:1] == ["Step"])
    width, found = len(lines[titles].split()), []
    while len(lines[titles + 1 + len(found)].split()) == width and not lines[titles + 1 + len(found)].startswith("Loop"):
        found.append(lines[titles + 1 + len(found)].split())
    return np.array(found, dtype=float)


def theirs(folder: Path, text: str) -> str:
    """LAMMPS's log of a deck."""
    with lammps_peer.instance() as lmp:
        lmp.commands_list([f"shell cd {folder}", "log log.theirs"])
        lmp.commands_string(text)
        lmp.command("log none")
    return (folder / "log.theirs").read_text()


def same_rows(folder: Path, text: str) -> None:
    """Every row of both, to a millionth of the largest value of its column; the deck exported has the same energies and pressures."""
    expected = rows(theirs(folder, text + THERMO))
    found = rows("\n".join(printed(folder / "in.ours", text + THERMO, platform="Reference")))
    scale = np.maximum(np.abs(expected).max(axis=0), 1e-300)
    scale[CANCEL] = scale[CANCEL].max()
    off = np.abs(found - expected).max(axis=0) / scale
    assert len(expected) == 31 and off.max() < 1e-6, off
    written = export_deck(folder / "in.ours", folder / "out", name="again", steps=0)
    again = theirs(written.deck.parent, written.deck.read_text().replace("\nrun ", "\n" + THERMO.replace("run 30\n", "run ")))
    off = np.abs(rows(again)[0] - expected[0]) / scale
    # the parts of a lattice sum depend on how it is split, its pressure on the grid of pppm
    assert off[: CANCEL[1] if "kspace" in text else None].max() < 1e-6, (off, written.deck.read_text())


FLUID = """units lj
atom_style atomic
comm_modify vel yes
lattice sc 0.85
region box block 0 6 0 6 0 6
create_box 2 box
create_atoms 1 region box
mass 1 1.0
mass 2 1.5
group odd id 1:216:2
set group odd type 2
displace_atoms odd move 0.21 -0.13 0.17
pair_style {style}
{coefficients}
fix 1 all nve
timestep 0.002
"""
MIXED = "pair_coeff 1 1 {}\npair_coeff 2 2 {}\npair_modify shift yes mix {}"


@cases(
    "style, coefficients",
    ("soft 1.2", MIXED.format("10", "20 1.4", "sixthpower")),
    ("gauss 2.0", MIXED.format("-10 2", "5 3 1.5", "sixthpower")),
    ("gauss/cut 2.0", MIXED.format("-10 0.5 0.4", "5 0.3 0.5 1.5", "arithmetic")),
    ("yukawa 2.0 2.5", MIXED.format("20", "10 2.2", "arithmetic")),
    ("mie/cut 2.4", MIXED.format("1 0.9 14 7", "2 0.8 12 6 2.2", "sixthpower")),
    ("lj/class2 2.4", MIXED.format("1 0.9", "2 0.8 2.2", "arithmetic")),
    ("lj/smooth/linear 2.4", MIXED.format("1 0.9", "2 0.8 2.2", "geometric")),
    (
        "hybrid morse 2.4 buck 2.4 morse/smooth/linear 2.2",
        "pair_coeff 1 1 morse 3 2 1.1\npair_coeff 1 2 buck 1000 0.3 2\npair_coeff 2 2 morse/smooth/linear 1 3 1\npair_modify shift yes",
    ),
    ("hybrid/overlay soft 1.2 dpd/tstat 0 0 1.3 8", "pair_coeff * * soft 10\npair_coeff * * dpd/tstat 4.5"),
)
def test_radial_potentials(tmp_path, style, coefficients):
    """With LAMMPS's mixing rules and shifts."""
    same_rows(tmp_path, FLUID.format(style=style, coefficients=coefficients))


def test_a_push_off_by_a_soft_repulsion_that_grows(tmp_path):
    """What stands for fix adapt: LAMMPS's rows of each piece of the run, and of the next after the coefficient has changed."""
    text = FLUID.format(style="soft 1.2", coefficients="pair_coeff * * 1.0\nvariable A equal 1+0.5*step")
    text += THERMO.replace("run 30", 'run 30 every 5 "pair_coeff * * ${A}"')
    expected, found = rows(theirs(tmp_path, text)), rows("\n".join(printed(tmp_path / "in.ours", text, platform="Reference")))
    assert expected[-1, 0] == 30 and len(expected) == 6
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


@cases(
    "style, coefficients",
    ("lj/cut/coul/cut 2.2 3.0", "pair_coeff 1 1 1 1.0\npair_coeff 2 2 2 0.9 2.0 3.0\npair_modify shift yes"),
    ("lj/cut/coul/debye 1.5 2.2 3.0", "pair_coeff * * 1 1.0 2.0 3.0"),
    ("hybrid/overlay dpd 0 1.2 7 coul/cut/soft 2 0.5 3.0", "pair_coeff * * dpd 25 4.5\npair_coeff * * coul/cut/soft 0.7 3.0"),
    ("coul/cut/soft 0 0.5 3.0", "pair_coeff * * 0.4"),
    (
        "hybrid/overlay dpd 0 1.2 7 coul/long/soft 2 0.5 3.0",
        "pair_coeff * * dpd 25 4.5\npair_coeff * * coul/long/soft 1\nkspace_style ewald 1e-7\nkspace_modify gewald 1.2",
    ),
    ("hybrid/overlay dpd 0 1.2 7 coul/debye 0.7 3.0", "pair_coeff * * dpd 25 4.5\npair_coeff * * coul/debye"),
    (
        "hybrid/overlay dpd 0 1.2 7 coul/long 3.0",
        "pair_coeff * * dpd 25 4.5\npair_coeff * * coul/long\npair_modify table 0\nkspace_style ewald 1e-7\nkspace_modify gewald 1.2",
    ),
)
def test_point_charges(tmp_path, style, coefficients):
    text = FLUID.format(style=style, coefficients=coefficients).replace("atom_style atomic", "atom_style charge")
    same_rows(tmp_path, text.replace("timestep", "set type 1 charge 1\nset type 2 charge -1\ndielectric 0.5\ntimestep"))


def test_softened_charges_with_a_lattice_sum(tmp_path):
    """LAMMPS's energy; its forces are not the derivative of that, those here are (tests/core/test_kernel_charges.py)."""
    coefficients = "pair_coeff * * 0.6\nkspace_style ewald 1e-8\nkspace_modify gewald 1.2"
    text = FLUID.format(style="coul/long/soft 2 0.5 3.0", coefficients=coefficients).replace("atom_style atomic", "atom_style charge")
    text = text.replace("timestep", "set type 1 charge 1\nset type 2 charge -1\ntimestep") + "thermo_style custom step pe fnorm press\n"
    text += "thermo_modify norm no format float %.15g\nrun 0\n"
    (_, energy, norm, _), *_ = rows(theirs(tmp_path, text))
    (_, found, ours, _), *_ = rows("\n".join(printed(tmp_path / "in.ours", text, platform="Reference")))
    assert abs(found / energy - 1) < 1e-6 and abs(ours / norm - 1) > 1e-3


@cases(
    "style, coefficients, message",
    ("coul/cut/soft 2 0.5 3.0", "pair_coeff * * 0.5\npair_coeff 1 2 0.6", "all pairs have one lambda here, not 0.5 and 0.6"),
    ("coul/cut/soft 2 0.5 3.0", "pair_coeff * * 1.5", "lambda must be from 0 to 1, not 1.5"),
    ("coul/long/soft 2 0.5 3.0", "pair_coeff * * 0.5 3.0", "expected 'lambda'"),
    ("coul/long/soft 2 0.5 3.0", "pair_coeff * * 0.5", "pair style coul/long/soft needs a kspace_style"),
    ("coul/cut 3.0", "pair_coeff * *\npair_coeff 1 2 2.0", "all charges have one cutoff here, 3 of pair_style; leave 2 out"),
    ("lj/cut/coul/cut 2.2 3.0", "pair_coeff * * 1 1 2.0", "all charges have one cutoff here, 3 of pair_style; leave 2 out"),
    ("coul/cut 3.0", "pair_coeff * *\nkspace_style ewald 1e-5", "coul/cut has no lattice sum; leave kspace_style out, or use coul/long"),
    ("coul/long 3.0", "pair_coeff * *", "pair style coul/long needs a kspace_style, ewald or pppm"),
    (
        "hybrid/overlay soft 1 coul/cut 3.0",
        "pair_coeff * * soft 1\npair_coeff 1 1 coul/cut",
        "types 1 2 both have charges, but pair style coul/cut",
    ),
)
def test_point_charges_that_are_refused(tmp_path, style, coefficients, message):
    text = FLUID.format(style=style, coefficients=coefficients).replace("atom_style atomic", "atom_style charge")
    raises(DeckError, message, printed, tmp_path / "in.deck", text + "set type 1 charge 1\nset type 2 charge -1\nrun 0\n")


def several(what: str, styles: list[str]) -> dict[str, str]:
    """Commands for hybrid styles, each with a type of its own."""
    names = dict.fromkeys(style.split()[0] for style in styles)
    coefficients = "\n".join(f"{what}_coeff {k} {style}" for k, style in enumerate(styles, start=1))
    return {what: "hybrid " + " ".join(names), f"{what}s": coefficients}


def write_chains(folder: Path, bond_types: int, angle_types: int) -> None:
    x, bonds, angles = chains.walks(20, 6, BOX, 1)
    text = chains.data_file(x, bonds, angles, BOX, bond_types=bond_types, angle_types=angle_types)
    (folder / "data.chains").write_text(text)


def test_bonds_and_angles(tmp_path):
    angles = ["cosine/delta 5 110", "cosine/delta 5 180", "cosine/squared 5 110", "cosine/periodic 5 1 1", "cosine/periodic 5 -1 4"]
    bonds = ["harmonic 30 0.9", "nonlinear 30 0.9 0.7"]
    write_chains(tmp_path, len(bonds), len(angles))
    same_rows(tmp_path, CHAINS.format(**several("bond", bonds), **several("angle", angles)))


def test_quartic_bonds(tmp_path):
    """A bond that breaks ends the run with a reason; friction that bonded beads would keep is refused."""
    x = [[0.7 + 2.6 * i + 0.25 * (-1) ** k, 0.7 + 2.6 * j + 0.1 * k, 0.5 + 0.95 * k] for i in range(3) for j in range(3) for k in range(6)]
    bonds = np.array([(6 * c + k, 6 * c + k + 1) for c in range(9) for k in range(5)])
    text = chains.data_file(np.array(x), bonds, np.zeros((0, 3), int), np.diag([7.8] * 3), bond_types=1, angle_types=1)
    text = text.replace("0 angles\n", "").replace("1 angle types\n", "").replace("# angle", "# bond").replace("\nAngles\n", "")
    (tmp_path / "data.chains").write_text(text)
    deck = re.sub("angle_style.*|{angles}", "", CHAINS).replace("atom_style angle", "atom_style bond").replace("lj 0 0.5 0.25", "lj 1 1 1")
    deck = deck.replace("dpd 0.0 1.0 33", "lj/cut 2.5").replace("25.0 4.5", "1 1").replace("0.002", "0.001")
    quartic = {"bond": "quartic", "bonds": "bond_coeff 1 1200 -0.55 0.25 1.3 34.6878"}
    same_rows(tmp_path, deck.format(**quartic))
    broken = deck.format(**quartic) + "velocity all set 0 0 5\nset atom 3 vz -5\nrun 300\n"
    raises(
        RunError,
        "the quartic bond between beads .* long: a bond that breaks ends a run here.* Rc of 1.3",
        printed,
        tmp_path / "in.broken",
        broken,
    )
    friction = deck.format(**quartic).replace("lj/cut 2.5", "dpd 0 1 33") + "run 0\n"
    raises(DeckError, "it needs pair styles without friction and charges", printed, tmp_path / "in.friction", friction)
