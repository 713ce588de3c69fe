"""The pressure tensor of decks beside a live LAMMPS (which parts count, with which velocities, and through which words), and what averages
are divided by."""

from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import raises
from test_lammps_thermo_live import both, numbers

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, run_deck

LAMMPS = lammps_peer.needed()

WORDS = "pxx pyy pzz pxy pxz pyz"
BEADS = """region box {box}
create_box 2 box
create_atoms 1 random 90 33 NULL overlap 0.3 maxtry 500
set atom 1*40 type 2
group ga id 1:50
mass 1 1.0
mass 2 1.7
comm_modify vel yes
velocity ga set 1 -0.7 0.4
velocity all ramp vy -1 1 z 0 4 sum yes
timestep 0.01
"""
BOXES = {"orthogonal": "block 0 4 0 4.5 0 4.2", "tilted": "prism 0 4 0 4.5 0 4.2 0.7 -1.1 0.6"}
STYLES = {
    "dpd": "pair_style dpd 0.0 1.0 3\npair_coeff * * 25 4.5\npair_coeff 1 2 40 2\nfix 1 all nve\n",
    "predicted": "pair_style dpd 0.0 1.0 3\npair_coeff * * 25 4.5\nfix 1 all mvv/dpd 0.65\n",
    "transverse": "pair_style dpd/ext 0.0 1.0 3\npair_coeff * * 25 4.5 3.0 0.5 1.0 1.0\nfix 1 all nve\n",
    "two thermostats": "pair_style hybrid/overlay lj/cut 1.0 dpd/tstat 0.0 0.0 1.0 3\npair_coeff * * lj/cut 1 0.4\n"
    "pair_coeff * * dpd/tstat 2.0\nfix 1 all nve\n",
    "frozen": "pair_style dpd 0.0 1.0 3\npair_coeff * * 25 4.5\nvelocity ga set 0 0 0\nfix 0 ga setforce 0 0 0\nfix 1 all nve\n",
    "moving wall": "pair_style dpd 0.0 1.0 3\npair_coeff * * 25 4.5\ngroup rest subtract all ga\nfix 1 rest nve\n",
}


def values(path: Path) -> np.ndarray:
    """All numbers of a file of averages."""
    return np.array([word for line in path.read_text().splitlines() if line[0] != "#" for word in line.split()], float)


def decks(folder: Path, style: str, box: str = "orthogonal") -> str:
    """Create the beads once, in LAMMPS, so that both sides have the same; the beginning of a deck."""
    atoms = f"atom_style {'mdpd' if style == 'predicted' else 'atomic'}\n"
    with lammps_peer.instance() as lmp:
        lmp.commands_string(atoms)
        lmp.commands_string(BEADS.format(box=BOXES[box]))
        lmp.command(f"write_data {folder}/start.data nocoeff")
    return f"{atoms}read_data {folder}/start.data\ncomm_modify vel yes\ngroup ga id 1:50\ntimestep 0.01\n{STYLES[style]}"


@LAMMPS
@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("style", STYLES)
def test_words_and_computes(tmp_path, style, box):
    """Rows of a run: friction counts with the velocities that the forces saw, and computes and averages say the same."""
    text = f"""{decks(tmp_path, style, box)}
compute ta ga temp
compute pp all pressure ta
compute pv all pressure NULL virial
compute pk all pressure thermo_temp ke
compute pb all pressure thermo_temp
variable mean equal (pxx+pyy+pzz)/3
variable v equal c_pv[4]+c_pb[6]
fix a all ave/time 1 2 2 c_pv[1] c_pv[*] c_pb[5] v_mean c_thermo_press[2] file f.scalars format " %.10g"
fix b all ave/time 2 1 2 c_pp c_pk c_thermo_press mode vector file f.vectors format " %.10g"
thermo 1
thermo_style custom step press temp ke etotal {WORDS} c_pp[*] c_pk[1] c_pk[4] c_pv[2] c_pv[6] v_mean v_v c_thermo_press[4] c_thermo_temp[1] c_thermo_temp[5] c_ta[4]
thermo_modify format float %.12g
run 4
"""
    theirs, ours = both(tmp_path, text)
    a, b = (np.array([row.split() for row in rows[1:]], float) for rows in (theirs, ours))
    assert a.shape == b.shape == (5, 27)
    np.testing.assert_allclose(b, a, rtol=0, atol=2e-10 * np.abs(a).max())
    for name in ("f.scalars", "f.vectors"):
        there, here = (values(tmp_path / side / name) for side in ("theirs", "ours"))
        np.testing.assert_allclose(here, there, rtol=0, atol=2e-9 * np.abs(there).max())


@LAMMPS
@pytest.mark.parametrize("words", ["press", "press pxx pyy pzz"])
@pytest.mark.parametrize("platform", ["Reference", "CPU"])
def test_the_pressure_of_potentials_under_a_thermostat_is_in_double_precision(tmp_path, platform, words):
    """With and without the tensor in the same row, whose mean it is."""
    text = f"{decks(tmp_path, 'two thermostats', 'tilted')}thermo_style custom step {words}\nthermo_modify format float %.14g\nthermo 1\nrun 0\n"
    theirs, ours = (np.array(rows[-1].split(), float) for rows in both(tmp_path, text, platform))
    assert ours[1] == pytest.approx(theirs[1], rel=1e-11)
    if len(ours) > 2:
        assert ours[1] == pytest.approx(ours[2:].mean(), rel=1e-12)


@LAMMPS
@pytest.mark.parametrize("modify", ["temp ta", "press pp", "temp ta press pq", "press pq temp ta"])
def test_chosen_temperatures_and_pressures(tmp_path, modify):
    text = f"""{decks(tmp_path, "dpd")}
compute ta ga temp
compute pp all pressure ta
compute pq all pressure thermo_temp ke
thermo_style custom step temp press {WORDS} c_pp[1] c_pq[4] c_thermo_press[1] c_thermo_temp[2]
thermo_modify {modify} format float %.12g
run 0
"""
    theirs, ours = both(tmp_path, text)
    a, b = (np.array(rows[1].split(), float) for rows in (theirs, ours))
    np.testing.assert_allclose(b, a, rtol=0, atol=2e-10 * np.abs(a).max())


def test_noise_is_symmetric_and_counts(tmp_path):
    """With noise no trajectory is LAMMPS's: the trace is three times the pressure, and without friction in the forces it is left out."""
    text = """region box block 0 4 0 4 0 4
create_box 1 box
create_atoms 1 random 100 5 NULL
mass 1 1
velocity all create 1 4
pair_style dpd/fdt 1 1 7
pair_coeff 1 1 25 3
{}
fix 1 all nve
thermo 2
thermo_style custom step press pxx pyy pzz
run 6
"""
    for fix in ("", "fix s all shardlow"):
        lines = lammps_peer.printed(tmp_path / "in.noise", text.format(fix))
        rows = np.array([line.split() for line in lines if line.split()[0].isdigit()], float)
        assert len(rows) == 4
        np.testing.assert_allclose(rows[:, 2:].sum(axis=1), 3 * rows[:, 1], rtol=1e-6)


@pytest.mark.parametrize("line", ["thermo_style custom step press pxy", "fix a all ave/time 1 1 1 c_thermo_press[4]"])
def test_scenes_without_a_tensor_are_refused_at_their_run(tmp_path, line):
    (tmp_path / "in.energy").write_text(
        f"""atom_style tdpd 1
region box block 0 4 0 4 0 4
create_box 1 box
create_atoms 1 random 50 5 NULL
mass 1 1
pair_style tdpd 1 1 7
pair_coeff 1 1 25 4.5 0.5 1 1 0.1 0.0 2
fix 1 all mvv/tdpd
{line}
run 2
""",
        encoding="utf-8",
    )
    with pytest.raises(DeckError, match=r"in.energy:10: (thermo output pxy: )?no stress tensor of this scene: its beads have energies"):
        run_deck(tmp_path / "in.energy", RunOptions(platform="Reference"))


@pytest.mark.parametrize("word", ["c_thermo_press[7]", "c_thermo_pe[1]", "c_thermo_temp[1][2]", "pyx"])
def test_words_that_are_none(tmp_path, word):
    text = f"region b block 0 4 0 4 0 4\ncreate_box 1 b\nthermo_style custom step {word}\nrun 0\n"
    (tmp_path / "in.bad").write_text(text, encoding="utf-8")
    raises(DeckError, r"in.bad:3: ", lambda: run_deck(tmp_path / "in.bad"))


# -- what thermo output divides by the number of beads in the values of averages: there is no noise, so all numbers agree ----------------
#: Averages of every kind of value: sums over beads and others, single ones and vectors, of computes, variables and other averages.
AVERAGED = """units {units}
lattice sc {lattice}
region b block 0 3 0 3 0 3
create_box 1 b
create_atoms 1 box
mass 1 2.0
velocity all ramp vx -1 1 y 0 3
velocity all ramp vy 0.2 1 z 0 3
velocity all ramp vz 0.5 1.4 x 0 3
velocity all ramp vz -0.3 0.1 y 0 3 sum yes
pair_style lj/cut {cutoff}
pair_coeff 1 1 0.5 {sigma}
fix push all addforce 0.3 0.2 -0.1
fix i all nve
timestep {dt}
compute k all ke
compute e all pe
compute m all momentum
compute t all temp
compute p all pressure t
compute r all reduce sum vx vy
compute a all reduce ave vx
compute c all com
compute one all reduce sumsq vz
variable v equal ke*10
fix 1 all ave/time 1 2 5 c_k file f.1
fix 2 all ave/time 1 2 5 c_k c_e c_m[1] c_t c_t[2] c_p c_p[1] c_r[1] c_a c_c[1] v_v c_one off 2 file f.2
fix 3 all ave/time 1 2 5 c_thermo_pe c_thermo_temp c_thermo_temp[1] c_thermo_press c_thermo_press[2]
fix 4 all ave/time 1 2 5 c_t mode vector file f.4
fix 5 all ave/time 5 1 5 f_2 mode vector
fix 6 all ave/time 5 1 5 f_2[2] f_2[6] f_1
fix 7 all ave/time 1 2 5 c_p c_thermo_press mode vector
fix 8 all ave/time 1 2 5 c_t c_thermo_temp mode vector
fix 9 all ave/time 1 2 5 v_v
fix 10 all ave/time 1 2 5 f_push[1] f_push[3]
thermo_style custom step ke c_k f_1 f_2[*] f_3[*] f_4[*] f_5[*] f_6[*] f_7[2][1] f_8[3][2] f_9 f_10[*]
thermo_modify format float %.12g {norm}
thermo 5
run 5
"""
AVERAGED_UNITS = {
    "lj": {"lattice": 0.8, "cutoff": 1.2, "sigma": 0.9, "dt": 0.001},
    "real": {"lattice": 3.0, "cutoff": 4.0, "sigma": 3.0, "dt": 0.1},
}


@LAMMPS
@pytest.mark.parametrize("norm", ["", "norm no", "norm yes"])
@pytest.mark.parametrize("units", AVERAGED_UNITS)
def test_averages_of_sums_over_beads_are_divided_by_their_number(tmp_path, units, norm):
    theirs, ours = both(tmp_path, AVERAGED.format(units=units, norm=norm, **AVERAGED_UNITS[units]))
    assert numbers(ours) == pytest.approx(numbers(theirs), rel=1e-6, abs=1e-9)
    for name in ("f.1", "f.2", "f.4"):  # files have the sums as they are
        found, expected = ([line.split() for line in (tmp_path / which / name).read_text().splitlines()] for which in ("ours", "theirs"))
        assert [line for line in found if line[0] == "#"] == [line for line in expected if line[0] == "#"]
        for line, other in zip(found, expected, strict=True):
            assert line[0] == "#" or [float(word) for word in line] == pytest.approx([float(word) for word in other], rel=2e-5)
