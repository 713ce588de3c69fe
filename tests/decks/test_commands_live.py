"""Single commands of decks beside a live LAMMPS: every file and every row of both programs is the same, to nine digits."""

from collections.abc import Iterator

import lammps_peer
import pytest
from fuzz.deck import Deck
from fuzz.draw import Draw
from fuzz.trial import Trial

#: Ten beads of two types in a box that does not begin at 0, with a flow along x.
BEADS = """units {units}
atom_modify map yes
region b {box} units box
create_box 2 b
mass 1 1
mass 2 2.5
create_atoms 1 single 0.3 0.4 1 units box
create_atoms 1 single 0.8 0.6 1 units box
create_atoms 1 single 1.3 2.4 4 units box
create_atoms 1 single 1.8 2.4 3 units box
create_atoms 1 single -0.3 3.4 4 units box
create_atoms 2 single -0.3 3.9 3 units box
create_atoms 2 single 0.3 3.4 1 units box
create_atoms 2 single 2.3 3.4 1.5 units box
create_atoms 2 single -0.7 1.4 1 units box
create_atoms 2 single -0.1 1.4 1 units box
velocity all ramp vx 0 1 y 0 4 units box
velocity all ramp vy 0.3 1.7 z 0 5 units box
velocity all ramp vz 0.3 1 x -1 3 units box
group g id 1:7
comm_modify vel yes
pair_style dpd 0.0 1.2 3
pair_coeff * * 25 0.5
neigh_modify every 1 delay 0 check no
fix 1 all nve
timestep 0.01
thermo 10
thermo_style custom step temp pe fmax
"""
FRAMES = "dump d all custom 2 dump.txt id type x y z vx vy vz fx fy fz\ndump_modify d sort id format float %.15g pbc yes\n"
RUN = 'thermo_modify format float %.15g\nprint "=== run"\nrun 10\n'

DECKS = {
    "temp/partial": "compute t g temp/partial 1 0 1\ncompute p all pressure t\n"
    "thermo_style custom step c_t c_t[1] c_t[2] c_t[5] c_p c_p[3] temp ke press\nthermo_modify temp t norm yes\n" + RUN,
    "temp/profile": """compute t all temp/profile 1 1 0 y 2
compute s g temp/profile 1 0 0 xz 2 2
compute b all temp/profile 1 0 1 xy 2 2 out bin
compute p all pressure s
fix a all ave/time 2 2 4 c_b[*] mode vector file b.txt format " %.15g"
thermo_style custom step c_t c_t[1] c_t[4] c_s c_b c_b[1][1] c_b[4][2] c_p c_p[1] temp press
thermo_modify temp t
"""
    + RUN,
    "temp/profile, tilted": "compute t all temp/profile 1 1 1 xyz 1 2 2\nthermo_style custom step c_t c_t[1] c_t[6]\n" + RUN,
    "compute_modify": "compute t all temp\ncompute_modify t extra/dof 1 dynamic/dof yes\ncompute_modify thermo_temp extra/dof 0\n"
    "thermo_style custom step temp press ke c_t c_thermo_temp c_thermo_press\n" + RUN,
    "gravity vector": f"fix p g gravity 9.5 vector 1 -2 3\nfix q all setforce NULL 0.5 NULL\nfix r all gravity 2 vector 0 1 0\n{FRAMES}{RUN}",
    "gravity chute": f"variable m equal 2*lx\nvariable a equal 30\nfix p all gravity v_m chute v_a\n{FRAMES}{RUN}",
    "gravity spherical": f"fix p g gravity 0.3 spherical 30 -75\nfix q all addforce 0.1 0 0\n{FRAMES}{RUN}",
    "momentum": f"fix m all momentum 1 linear 1 1 1 angular\nfix n g momentum 3 linear 1 0 0 rescale\n{FRAMES}{RUN}{RUN}",
    "ave/correlate": """compute k g ke
compute m all momentum
variable s equal sin(step)
fix a all ave/correlate 2 3 8 c_k v_s c_m[1] file a.txt
fix b all ave/correlate 1 4 5 c_k v_s c_m[*] type upper file b.txt ave running prefactor 2.5
fix c all ave/correlate 1 4 5 c_k v_s c_m[1] type lower file c.txt overwrite ave running start 3 title3 "# rows"
fix d all ave/correlate 1 4 5 c_k v_s c_m[2] type auto/upper file d.txt title1 "# one" title2 "# two"
fix e all ave/correlate 1 4 5 c_k v_s c_m[1] type auto/lower file e.txt title3 "# rows"
fix f all ave/correlate 1 4 10 c_k v_s c_m[1] type full file f.txt
fix h all ave/correlate 3 2 6 c_k v_s c_m[1] type first file h.txt start 7
thermo_style custom step f_b[2][4] f_c[1][3] f_f[4][1] f_f[2][2] f_f[2][3]
"""
    + RUN
    + RUN,
    "write_dump": """write_dump all xyz before.*.xyz modify sort id element A B
write_dump g custom before.txt id type x vx modify sort id format float %.15g
"""
    + RUN
    + """write_dump all atom frame.txt modify sort id scale no image yes pbc yes
write_dump all custom frames.txt id xu vy modify sort id append yes
variable out atom x+3
set group all x v_out
write_dump all custom outside.txt id x ix xu modify sort id pbc yes
write_dump all custom as_it_is.txt id x ix xu modify sort id
write_dump g xtc g.xtc modify unwrap yes
"""
    + RUN
    + "write_dump all custom frames.txt id xu vy modify sort id append yes\n",
    "set with variables": "variable a atom 0.1*x+0.2*id\nvariable k atom 1+(id>4)\nvariable i atom id-3.5\nset group all vx v_a vy v_a\n"
    "set group g x v_a z v_a\nset type 2 vz v_a\nset atom *6 type v_k\nset group all image v_i NULL v_i\n"
    + FRAMES.replace("fz", "fz ix iz xu")
    + RUN,
    "files without content": RUN
    + """fix p all print 50 "x" file p.txt screen no
fix q all print 50 "x" file q.txt title "# only" screen no
fix t all ave/time 50 1 50 c_thermo_temp file t.txt
fix u all ave/correlate 50 1 50 c_thermo_temp file u.txt
dump a all xyz 100 a.xyz
dump b all atom 100 b.txt
dump c all xtc 100 c.xtc
dump e all xyz 100 e.*.xyz
group nobody empty
dump k nobody xtc 1 k.xtc
"""
    + RUN.replace("run 10", "run 3")
    + 'fix r all print 50 "x" file r.txt\ndump f all xyz 100 f.xyz\ndump h all xtc 100 h.xtc\n',
}


@pytest.fixture(scope="module")
def trial(tmp_path_factory) -> Iterator[Trial]:
    lammps_peer.need()
    with Trial(tmp_path_factory.mktemp("commands")) as found:
        yield found


@pytest.mark.parametrize("units", ["lj", "real"])
@pytest.mark.parametrize("name", DECKS)
def test_both_programs_write_the_same(trial, name, units):
    deck = Deck(Draw(1))
    box = "prism -1 3 0 4 0 5 1.1 -0.7 0.9" if "tilted" in name else "block -1 3 0 4 0 5"
    deck.lines[:] = (BEADS.format(units=units, box=box) + DECKS[name]).splitlines()
    outcome = trial.of_deck(0, "commands", deck)
    assert outcome.kind == "agree", outcome.message
    written = {path.name for path in (trial.folder / "ours").iterdir()}
    assert written >= {words.split()[0] for words in DECKS[name].split(" file ")[1:]}
