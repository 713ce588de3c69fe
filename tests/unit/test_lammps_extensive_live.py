"""What thermo output divides by the number of beads in the values of averages, beside a live LAMMPS: there is no noise, so all numbers agree."""

import lammps_peer
import pytest
from test_lammps_thermo_live import both, numbers

pytestmark = lammps_peer.needed()

#: Averages of every kind of value: sums over beads and others, single ones and vectors, of computes, variables and other averages.
DECK = """units {units}
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
UNITS = {"lj": {"lattice": 0.8, "cutoff": 1.2, "sigma": 0.9, "dt": 0.001}, "real": {"lattice": 3.0, "cutoff": 4.0, "sigma": 3.0, "dt": 0.1}}


@pytest.mark.parametrize("norm", ["", "norm no", "norm yes"])
@pytest.mark.parametrize("units", UNITS)
def test_averages_of_sums_over_beads_are_divided_by_their_number(tmp_path, units, norm):
    theirs, ours = both(tmp_path, DECK.format(units=units, norm=norm, **UNITS[units]))
    assert numbers(ours) == pytest.approx(numbers(theirs), rel=1e-6, abs=1e-9)
    for name in ("f.1", "f.2", "f.4"):  # files have the sums as they are
        found, expected = ([line.split() for line in (tmp_path / which / name).read_text().splitlines()] for which in ("ours", "theirs"))
        assert [line for line in found if line[0] == "#"] == [line for line in expected if line[0] == "#"]
        for line, other in zip(found, expected, strict=True):
            assert line[0] == "#" or [float(word) for word in line] == pytest.approx([float(word) for word in other], rel=2e-5)
