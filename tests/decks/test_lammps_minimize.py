"""minimize: where it ends, beside a live LAMMPS where there is one minimum, and when it stops."""

from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import cases, put, raises
from test_lammps_moving import chains

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import explain_deck

LAMMPS = lammps_peer.needed()

CRYSTAL = """lattice fcc 1.1
region b block 0 3 0 3 0 3
create_box 1 b
create_atoms 1 box
mass 1 1
comm_modify vel yes
pair_style lj/cut 2.0
pair_coeff 1 1 1 1
variable jx atom 0.03*sin(id*1.3)
variable jy atom 0.03*cos(id*2.1)
displace_atoms all move v_jx v_jy 0.02
group held id 1
fix h held setforce 0 0 0
"""
CHAINS = "units real\natom_style molecular\nspecial_bonds lj 0 0 0\nbond_style harmonic\nangle_style harmonic\nread_data start.data\n"
CHAINS += "bond_coeff 1 30 0.7\nangle_coeff 1 4 110\nmass 1 1\ncomm_modify vel yes cutoff 3\npair_style zero 1.2\npair_coeff * *\n"


def ours(folder: Path, text: str) -> tuple[list[list[float]], list[str]]:
    """Rows of thermo output, and all lines."""
    put(folder / "start.data", chains())
    lines = lammps_peer.printed(folder / "in", text)
    return [[float(w) for w in line.split()] for line in lines if line.split()[:1] and line.split()[0].isdigit()], lines


#: Forces of fixes, which beads follow.
PUSHED = CRYSTAL + "fix s all spring/self 5\nfix_modify s energy yes\nfix t all setforce NULL NULL 0\n"
PUSHED += "group few id 5:9\nfix u few addforce 0.1 0 0\n"


@LAMMPS
@pytest.mark.parametrize(
    ("start", "words"),
    [(CRYSTAL, "pe press pxx pxy fnorm"), (CHAINS, "pe ebond eangle"), (PUSHED, "pe press pxx pxy")],
    ids=["crystal", "chains", "pushed"],
)
@pytest.mark.parametrize("style", ["cg", "fire"])
def test_the_minimum_is_lammps_s(tmp_path, monkeypatch, start, words, style):
    """The first row, and the last one as far as the tolerance of the forces says."""
    style = "fire" if start is PUSHED else style  # LAMMPS's line searches go by an energy without that of all fixes
    text = f"{start}thermo_style custom step {words}\nthermo_modify format float %.12g\nmin_style {style}\nminimize 0 1e-4 5000 50000\n"
    rows, lines = ours(tmp_path, text + "run 0\n")
    monkeypatch.chdir(tmp_path)
    with lammps_peer.instance() as lmp:
        lmp.commands_string(f"{text}\nvariable last equal step")
        expected = [lmp.get_thermo(word) for word in words.split()]
    assert any("force tolerance after" in line for line in lines)
    assert len(rows) == 3 and rows[1] == pytest.approx(rows[2], abs=1e-9)
    np.testing.assert_allclose(rows[1][1:], expected, atol=2e-4 * max(1, np.abs(expected).max()))
    assert rows[1][1] == pytest.approx(expected[0], abs=1e-8 * max(1, abs(expected[0])))
    assert rows[0][1] > rows[1][1]


@cases(
    "numbers, reason",
    ("0 0 5 1000", "max iterations after 5 iterations"),
    ("0 0 1000 4", "max force evaluations after 4 iterations"),
    ("0 0 0 9", "max iterations after 0 iterations"),
    ("0.5 0 100 100", "energy tolerance after 1 iterations"),
    ("0 1e9 100 100", "force tolerance after 1 iterations"),
    ("0 0 100 0", "max force evaluations after 1 iterations"),
)
def test_when_it_stops(tmp_path, numbers, reason):
    """The step has advanced by the iterations, and dumps have beginning and end."""
    rows, lines = ours(tmp_path, f"{CRYSTAL}dump d all custom 1000 d.txt id x y z\nminimize {numbers}\nundump d\nrun 0\n")
    assert any(reason in line for line in lines)
    steps = int(reason.split()[-2])
    assert [row[0] for row in rows] == [0, steps, steps]
    assert (tmp_path / "d.txt").read_text().count("TIMESTEP") == (2 if steps else 1)


def test_held_beads_stay_and_velocities_do_not_change(tmp_path):
    text = f"{CRYSTAL}write_data a.data\nvelocity all set 1 2 3 units box\nminimize 0 1e-3 100 100\nwrite_data b.data\nrun 0\n"
    ours(tmp_path, text)
    first, last = ((tmp_path / name).read_text() for name in ("a.data", "b.data"))
    place = [[line.split()[2:5] for line in text.splitlines() if line.startswith("1 1 ")][0] for text in (first, last)]
    assert place[0] == place[1] and first.split("Velocities")[0] != last.split("Velocities")[0]
    assert {tuple(line.split()[1:]) for line in last.split("Velocities")[1].splitlines() if line} == {("1.0", "2.0", "3.0")}


@pytest.mark.parametrize(("style", "rest"), [("cg", False), ("hftn", False), ("fire", True), ("quickmin", True)])
def test_damped_motion_ends_at_rest(tmp_path, style, rest):
    ours(tmp_path, f"{CRYSTAL}velocity all set 1 2 3 units box\nmin_style {style}\nminimize 0 1e-3 100 100\nwrite_data b.data\nrun 0\n")
    found = {tuple(line.split()[1:]) for line in (tmp_path / "b.data").read_text().split("Velocities")[1].splitlines() if line}
    assert found == {("0.0", "0.0", "0.0") if rest else ("1.0", "2.0", "3.0")}


def test_steps_of_a_minimisation_take_no_time(tmp_path):
    text = f"{CRYSTAL}timestep 0.01\nfix 1 all nve\nthermo_style custom step time\nrun 2\nminimize 0 0 3 100\nrun 1\n"
    rows, _ = ours(tmp_path, text)
    np.testing.assert_allclose(rows, [[0, 0], [2, 0.02], [2, 0.02], [5, 0.05], [5, 0.02], [6, 0.03]])  # LAMMPS's, with its rows of minimize


def test_no_forces_no_way(tmp_path):
    """LAMMPS counts the iteration in which it finds that."""
    rows, lines = ours(tmp_path, CRYSTAL.replace("pair_coeff 1 1 1 1", "pair_coeff 1 1 0 1") + "minimize 0 0 100 100\nrun 0\n")
    assert any("forces are zero after 1 iterations" in line for line in lines) and [row[0] for row in rows] == [0, 1, 1]


@pytest.mark.parametrize("norm", ["two", "max", "inf"])
def test_norms(tmp_path, norm):
    """The force that is left is below the tolerance in the norm that was chosen, and not far below."""
    text = f"{CRYSTAL}unfix h\nthermo_style custom step fnorm fmax\nthermo_modify norm no\nmin_modify norm {norm} dmax 0.2\nminimize 0 0.1 500 5000\nrun 0\n"
    rows, _ = ours(tmp_path, text)
    total, largest = rows[1][1:]
    assert total < 0.1 if norm == "two" else largest < 0.1 < total if norm == "inf" else largest < 0.1


def test_what_does_not_run_says_that_it_does_not_minimise_either(tmp_path, caplog):
    path = tmp_path / "in.shown"
    assert "note: minimize is not carried out here" in explain_deck(put(path, f"{CRYSTAL}minimize 0 0 5 5\nfix 1 all nve\nrun 0\n"))
    assert f"{path}:14: minimize is not carried out here" in caplog.text


WRONG = {
    "minimize 0 0 10\n": "expected 'minimize etol ftol maxiter maxeval'",
    "minimize -1 0 10 10\n": "etol must be >= 0",
    "min_style hftn\nmin_modify norm max\nminimize 0 0 1 1\n": "hftn does not support 'min_modify norm max'",
    "min_style lbfgs\n": "the style of min_style must be one of",
    "min_modify norm three\n": "norm must be one of",
    "minimize 0 1 1 1\n": "has no run command",
}


@pytest.mark.parametrize("text", WRONG)
def test_mistakes(tmp_path, text):
    raises(DeckError, WRONG[text], lambda: ours(tmp_path, CRYSTAL + text))


DROP = """atom_style mdpd
comm_modify vel yes
lattice fcc 6
region b block 0 3 0 3 0 3
create_box 1 b
create_atoms 1 box
mass 1 1
variable jx atom 0.03*sin(id*1.3)
displace_atoms all move v_jx v_jx 0.0
pair_style hybrid/overlay mdpd/rhosum mdpd 0.0 1 3
pair_coeff * * mdpd/rhosum 0.75
pair_coeff * * mdpd -40 25 18 1.0 0.75
"""


@LAMMPS
def test_many_body_beads_follow_their_forces(tmp_path, monkeypatch):
    text = f"{DROP}thermo_style custom step pe press fnorm\nthermo_modify format float %.12g\nmin_style fire\nminimize 0 1e-4 5000 50000\n"
    rows, lines = ours(tmp_path, text + "run 0\n")
    monkeypatch.chdir(tmp_path)
    with lammps_peer.instance() as lmp:
        lmp.commands_string(f"{text}")
        expected = [lmp.get_thermo(word) for word in ("pe", "press")]
    assert any("force tolerance after" in line for line in lines)
    assert any("follow their forces" in line for line in lines)
    np.testing.assert_allclose(rows[1][1:3], expected, rtol=1e-5)
