"""displace_atoms, replicate, velocity set with variables, fix momentum and fix print; random decks of the fuzzer compare them with LAMMPS on top."""

from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import cases, put, raises
from test_lammps_thermo_live import numbers, table

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, read_deck, run_deck
from openmm_dpd.lammps.state.records import MomentumRemoval, without_rotation

LAMMPS = lammps_peer.needed()

CHAINS = """atom_style molecular
special_bonds lj 0 0.5 1
bond_style harmonic
angle_style harmonic
read_data start.data
bond_coeff 1 30 0.7
angle_coeff 1 4 150
mass 1 1
comm_modify vel yes cutoff 3
neighbor 0.5 bin
pair_style dpd 0 1 7
pair_coeff 1 1 25 4.5
fix 1 all nve
timestep 0.01
group tail molecule 2
"""


def chains(box="0 3.1 xlo xhi\n-1 2.2 ylo yhi\n0 3.3 zlo zhi\n0.4 -0.7 0.5 xy xz yz") -> str:
    """Two chains of four beads, one of them across a face of the box, in one tilted box, with image flags."""
    x = [(2.6, 0.1, 1, 0), (3.3, 0.3, 1.2, 0), (3.8, 0.5, 0.8, 0), (4.4, 0.4, 1.1, 0)]
    x += [(1, 1.2, 2.1, 1), (1.2, 1.7, 2.5, 1), (1.1, 2.1, 3.1, 1), (1.5, 2.4, 3.6, 1)]
    atoms = [f"{k} {1 + (k > 4)} 1 {a} {b} {c} {image} 0 0" for k, (a, b, c, image) in enumerate(x, start=1)]
    bonds = [f"{n} 1 {k} {k + 1}" for n, k in enumerate((1, 2, 3, 5, 6, 7), start=1)]
    angles = [f"{n} 1 {k} {k + 1} {k + 2}" for n, k in enumerate((1, 2, 5, 6), start=1)]
    speeds = [f"{k} {0.1 * k:.1f} {-0.2 * k:.1f} {0.5 - 0.1 * k:.1f}" for k in range(1, 9)]
    sections = {"Atoms": atoms, "Velocities": speeds, "Bonds": bonds, "Angles": angles}
    body = "".join(f"\n{name}\n\n" + "\n".join(rows) + "\n" for name, rows in sections.items())
    return f"chains\n\n8 atoms\n6 bonds\n4 angles\n1 atom types\n1 bond types\n1 angle types\n{box}\n{body}"


def both(folder: Path, text: str) -> tuple[list[str], list[str]]:
    """Lines of the log of LAMMPS and of ours; each side writes into its folder."""
    for side in ("theirs", "ours"):
        (folder / side).mkdir()
        (folder / side / "start.data").write_text(chains(), encoding="utf-8")
    with lammps_peer.instance() as lmp:
        lmp.commands_list([f"shell cd {folder}/theirs", "log log"])
        lmp.commands_string(text)
        lmp.command("log none")
    return (folder / "theirs" / "log").read_text().splitlines(), lammps_peer.printed(folder / "ours" / "in", text)


@LAMMPS
@pytest.mark.parametrize("copies", ["2 1 1", "1 2 3", "2 3 2"])
def test_chains_are_copied_whole(tmp_path, copies):
    """Energies of bonds and angles, groups, and the data file with its bonds."""
    text = f"{CHAINS}displace_atoms all rotate 1 0 1 0.2 0.4 1 30 units box\nreplicate {copies}\nwrite_data out.data\nvariable n equal count(tail)\n"
    text += "thermo_style custom step pe ebond eangle press pxy vol v_n\nthermo_modify format float %.13g\nrun 3\n"
    theirs, ours = both(tmp_path, text)
    expected, found = (numbers(table([line for line in side if line[:4] not in ("note", "WARN")])) for side in (theirs, ours))
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)
    there, here = (bonds_of(tmp_path / side / "out.data") for side in ("theirs", "ours"))
    assert there == here and len(there) >= 12


def bonds_of(path: Path) -> list[list[str]]:
    """Type and ids of the bonds of a data file."""
    section = path.read_text().split("Bonds")[1].split("Angles")[0]
    return sorted(line.split()[1:] for line in section.splitlines() if line.strip())


def rows_of(lines: list[str]) -> list[list[str]]:
    """Titles and rows of thermo output, and what was said in between."""
    words = [line.split() for line in lines if line.strip()]
    return [w for w in words if w[0] in ("said", "Step") or (len(w) == 2 and all(c.replace(".", "").isdigit() for c in w))]


@LAMMPS
def test_what_is_printed_and_when(tmp_path):
    """At the first step before the table, then before the row; the momentum is gone by then."""
    text = f"{CHAINS}fix m all momentum 2 linear 1 1 0 rescale\nthermo 2\nthermo_style custom step ke\nthermo_modify format float %.10g\n"
    text += 'fix p all print 2 "said $(step) $(ke:%.8g) $(vcm(all,z):%.8f)" file said.txt\n'
    text += 'fix q all print 3 "q $(step)" title "# here" append q.txt screen no\nrun 5\nrun 1\n'
    text += "unfix p\nfix p all print 2 again screen no file said.txt\nrun 2\n"
    theirs, ours = both(tmp_path, text)
    assert rows_of(ours) == rows_of(theirs)
    assert len(rows_of(ours)) == 3 + 4 + 2 + 6
    for name in ("said.txt", "q.txt"):
        assert (tmp_path / "ours" / name).read_text() == (tmp_path / "theirs" / name).read_text()


def test_a_rigid_rotation_goes_and_nothing_else():
    rng = np.random.default_rng(2)
    x, masses, omega, drift = rng.normal(size=(9, 3)), 1 + rng.random(9), np.array([0.3, -1.0, 0.7]), np.array([1.0, 2.0, -1.0])
    rigid = np.cross(omega, x - masses @ x / masses.sum())
    np.testing.assert_allclose(without_rotation(x, rigid + drift, masses), np.tile(drift, (9, 1)), atol=1e-13)
    v = rng.normal(size=(9, 3))
    left = MomentumRemoval(1, (True, False, True), True, True).applied(x, v, masses)
    assert masses @ np.sum(left**2, axis=1) == pytest.approx(masses @ np.sum(v**2, axis=1))
    np.testing.assert_allclose((masses @ left)[[0, 2]], 0, atol=1e-13)
    np.testing.assert_allclose(np.sum(masses[:, None] * np.cross(x - masses @ x / masses.sum(), left), axis=0), 0, atol=1e-12)


FEW = "region b block 0 4 0 4 0 4\ncreate_box 1 b\ncreate_atoms 1 random 20 5 NULL\nmass 1 1\ngroup some id 1:4\npair_style dpd 1 1 7\n"
FEW += "pair_coeff 1 1 25 4.5\n"
WRONG = {
    "fix 1 all nve\nfix p all print 1 x\nfix m all momentum 1 linear 1 1 1\nrun 1\n": "it comes after fix p",
    "fix 1 some nve\nfix m all momentum 1 angular\nrun 1\n": "contains immobile beads",
    "fix m all momentum 1\n": "removes nothing",
    "fix m all momentum 1 linear 2 0 0\n": "a flag of linear must be one of 0, 1",
    "fix p all print 0 x\n": "at least 1",
    "fix p all print 1 '$(nothing)'\nfix 1 all nve\nrun 1\n": "there is no thermo word 'nothing'",
    "displace_atoms all rotate 0 0 0 0 0 0 5\n": "the axis is zero",
    "displace_atoms all move 1 2\n": "needs 3 values",
    "displace_atoms all ramp x 0 1 y 2 1\n": "must increase",
    "compute d all msd\nreplicate 2 1 1\n": "stores the positions of beads",
    "replicate 0 1 1\n": "at least 1",
}


@pytest.mark.parametrize("text", WRONG)
def test_mistakes(tmp_path, text):
    raises(DeckError, WRONG[text], lambda: run_deck(put(tmp_path / "in.bad", FEW + text), RunOptions(platform="Reference")))


def test_random_displacements_do_not_depend_on_the_group(tmp_path):
    """They lie in the cube that is asked for, and one bead gets the same in any group."""
    found = []
    for group in ("all", "some"):
        text = f"displace_atoms {group} random 0.3 0.1 0 5\nwrite_data {group}.data\nfix 1 all nve\nrun 0\n"
        run_deck(put(tmp_path / "in", FEW + text), RunOptions(platform="Reference"), out=tmp_path)
        lines = (tmp_path / f"{group}.data").read_text().splitlines()
        start = next(k for k, line in enumerate(lines) if line.startswith("Atoms")) + 2
        rows = np.array([line.split()[:5] for line in lines[start:][:20]], float)
        found.append(rows[np.argsort(rows[:, 0]), 2:])
    moved = np.any(found[0] != found[1], axis=1)
    assert not moved[:4].any() and moved[4:].all()


# -- velocity set with variables ---------------------------------------------------------------------------------------------------
#: The lattice has not the unit as its spacing: numbers are multiplied by it, values of variables are not.
LATTICE = """lattice sc 0.5
region b block 0 2 0 2 0 2
create_box 1 b
create_atoms 1 box
mass 1 1
group some id 2:6
variable a atom x+2*vy
variable old atom vx-z
variable e equal 3-count(some)
variable chain equal v_e*2
velocity all set 0.5 0.25 1
velocity all ramp vz -1 1 y 0 2
"""
COMMANDS = (
    "velocity all set v_a v_old v_e",
    "velocity some set v_a NULL v_chain units box",
    "velocity some set v_old 0.5 v_a sum yes",
    "velocity all set NULL v_a -1 sum yes units box\nvelocity some set v_a v_old 0",
)


@LAMMPS
@pytest.mark.parametrize("text", COMMANDS)
def test_velocities_of_variables(tmp_path, text):
    state = read_deck(put(tmp_path / "in.deck", LATTICE + text + "\nquit\n"), stop_before_first_run=True)
    with lammps_peer.instance() as lmp:
        lmp.commands_string(LATTICE + text)
        expected = np.array(lmp.gather_atoms("v", 1, 3)).reshape(-1, 3)
    assert np.ptp(expected[:, 0]) > 0.1
    np.testing.assert_allclose(state.atoms.velocities, expected, rtol=1e-12, atol=1e-12)


@cases(
    "text, message",
    ("variable s string 3\nvelocity all set v_s 0 0", "velocity set: variable s is string-style"),
    ("velocity all set v_none 0 0", "none"),
    ("variable t equal temp\nvelocity all set v_t 0 0", "before a run has measured it"),
    ("variable q equal 1/(count(some)-5)\nvelocity all set v_q 0 0", "division by zero|1/"),
)
def test_other_variables_are_refused(tmp_path, text, message):
    path = put(tmp_path / "in.deck", LATTICE + text + "\n")
    raises(DeckError, rf"in.deck:\d+: .*({message})", read_deck, path)
