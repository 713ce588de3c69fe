"""Units and boxes: all rows of thermo output beside a live LAMMPS, in runs without noise."""

from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import cases, put, raises
from test_lammps_thermo_live import both

from openmm_dpd.base.errors import DeckError, RunError
from openmm_dpd.lammps import RunOptions, export_deck, read_deck
from openmm_dpd.lammps.run.runner import DeckRunner

pytestmark = lammps_peer.needed()


def same_rows(folder, text: str, steps: int = 30) -> np.ndarray:
    """The rows of a deck, after they are compared with LAMMPS's."""
    theirs, ours = both(folder, f"{text}\nthermo 1\nthermo_modify format float %.15g\nrun {steps}\n")
    assert theirs[0] == ours[0] and len(ours) == steps + 2
    found, expected = (np.array([row.split() for row in rows[1:]], dtype=float) for rows in (ours, theirs))
    # components of tensors that are 0 by symmetry have rounding errors only
    scale = np.abs(expected).max(axis=0) * 1e-4 + 1e-9 * (np.abs(expected).max(axis=0) < 1e-9)
    rough = np.argwhere(np.abs(found - expected) > 1e-8 * np.maximum(np.abs(expected), scale))
    assert not len(rough), [(ours[0].split()[k], found[n, k], expected[n, k]) for n, k in rough[:5]]
    return found


def run(path: Path, text: str) -> list[str]:
    """Lines that a deck prints; its files are beside it."""
    lines: list[str] = []
    read_deck(
        put(path, text), run_callback=DeckRunner(RunOptions(platform="Reference", threads=1), lines.append).carry_out, output=path.parent
    )
    return "\n".join(lines).splitlines()


# -- units --------------------------------------------------------------------------------------------------------------------------
UNITS = """units {0}
atom_style atomic
comm_modify vel yes
neighbor {1} bin
neigh_modify every 1 delay 0 check yes
lattice sc {1}
region box block 0 5 0 4 0 4
timestep {2}
create_box 1 box
create_atoms 1 box
mass 1 {3}
velocity all ramp vx {4} z 0 4
velocity all ramp vy {4} x 0 5
pair_style dpd 0.0 {5} 99
pair_coeff 1 1 {6}
fix 1 all nve
thermo_style custom step time temp press pe ke etotal enthalpy density vol pxx pyy fmax dt lx
"""
REDUCED = ("0.7", "0.02", "1.0", "-1 1", "1.0", "25.0 4.5")
#: Beads of three molecules of water; velocities are in lattice units.
REAL = {
    "si": ("0.45e-9", "1e-14", "9e-26", "-2e11 2e11", "0.7e-9", "1.5e-10 1e-12"),
    "cgs": ("0.45e-7", "1e-14", "9e-23", "-2e11 2e11", "0.7e-7", "1.5e-5 1e-9"),
    "micro": ("0.45e-3", "1e-8", "9e-11", "-2e5 2e5", "0.7e-3", "1.5e-1 1e-3"),
    "nano": ("0.45", "1e-5", "9e-5", "-200 200", "0.7", "150 1e-3"),
}


@cases("name, values", ("si", REDUCED), *REAL.items())
def test_units(tmp_path, name, values):
    assert 0 < same_rows(tmp_path, UNITS.format(name, *values))[-1, 2]


def test_reduced_numbers_are_exported_as_they_are(tmp_path):
    deck = put(tmp_path / "in.si", UNITS.format("si", *REDUCED) + "run 3\n")
    made = export_deck(deck, tmp_path / "out").deck.read_text(encoding="utf-8")
    assert all(f"\n{line}" in made for line in ("units si", "timestep 0.02\n", "pair_coeff * * 25.0 4.5 1.0\n"))


# -- two dimensions -----------------------------------------------------------------------------------------------------------------
FLAT = """dimension 2
comm_modify vel yes
neighbor 0.4 bin
neigh_modify every 1 delay 0 check yes
lattice {lattice}
region box block 0 8 0 5 {z}
create_box 2 box
create_atoms 1 box
set group all type/fraction 2 0.0 4
mass * 1.0
region low block INF INF INF 2.1 INF INF
group low region low
velocity all ramp vx -1 1 y 0 5
displace_atoms low ramp x 0 0.1 y 0 3
pair_style dpd 0.0 1.0 99
pair_coeff * * 25.0 4.5
fix 1 all nve
{fixes}
compute tl low temp
compute tp all temp/partial 1 0 0
compute pr all temp/profile 1 0 0 y 4
compute g all rdf 8
compute co all coord/atom cutoff 0.8
compute cl all cluster/atom 0.45
compute pl all pair/local dist
compute rs all reduce sum c_co c_cl
compute rp all reduce sum c_pl inputs local
compute tc low temp/com
compute ch all chunk/atom bin/1d y lower 0.5
fix av all ave/chunk 1 5 10 ch density/number density/mass temp vx file prof.txt
compute vir all pressure NULL virial
thermo_style custom step time temp press pe ke etotal enthalpy density vol pxx pyy pzz pxy fmax lx lz cellc zlo c_tl c_tp c_pr c_g[3][2] &
    c_g[6][2] c_g[6][3] c_vir c_vir[1] c_rs[*] c_rp c_tc c_tc[1]
"""


@cases(
    "lattice, z, fixes",
    ("hex 2.0", "-0.1 0.1", "set atom 3 vz 1\nfix 2 all enforce2d"),
    ("sq 2.0", "-0.5 0.5", "fix g all gravity 0.5 chute 30\nfix a low addforce 0.2 0.1 0\nfix s low setforce NULL 0 NULL"),
    ("sq2 1.5 orient x 1 1 0 orient y -1 1 0", "-3 3", "fix g all gravity 0.5 vector 1 2 3\nfix 2 all enforce2d"),
)
def test_two_dimensions(tmp_path, lattice, z, fixes):
    same_rows(tmp_path, FLAT.format(lattice=lattice, z=z, fixes=fixes))
    assert (tmp_path / "ours" / "prof.txt").read_text() == (tmp_path / "theirs" / "prof.txt").read_text()


def test_two_dimensions_with_noise(tmp_path):
    """The plane keeps its temperature, and files and restarts keep the plane."""
    text = (
        FLAT.format(lattice="hex 3.0", z="-0.2 0.2", fixes="")
        .replace("dpd 0.0", "dpd 1.0")
        .replace("ramp vx -1 1 y 0 5", "create 1 5")
        .replace("fix av", "# ")
    )
    lines = run(
        tmp_path / "in.plane", text + "thermo 10\ntimestep 0.02\nrun 300\nwrite_restart r\nwrite_data d\nwrite_dump all custom f id z vz"
    )
    rows = np.array([row.split() for row in lines if row.split()[:1] and row.split()[0].isdigit()], dtype=float)
    assert rows[10:, 2].mean() == pytest.approx(1.0, abs=0.05)
    assert not np.loadtxt(tmp_path / "f", skiprows=9)[:, 1:].any()
    again = run(tmp_path / "in.again", "read_restart r\nfix 1 all nve\nthermo_style custom step temp vol press\nrun 0\n")
    (row,) = (line.split() for line in again if line.split()[:1] == ["300"])
    assert [float(row[1]), float(row[2])] == pytest.approx(rows[-1, [2, 9]].tolist(), rel=1e-6)


@cases(
    "change, message",
    (("-0.1 0.1", "0 1"), "contain z = 0"),
    (("hex 2.0", "sc 2.0"), "the lattice style in 2 dimensions must be one of sq, sq2, hex, custom, none"),
    (("hex 2.0", "hex 2.0 origin 0 0 0.5"), "outside the plane"),
    (("create_atoms 1 box", "create_atoms 1 single 1 1 0.05"), "all beads must have z = 0"),
    (("fix 1", "set atom 1 vz 1\nfix 1"), "or use fix enforce2d"),
    (("fix 1", "fix 2 all addforce 0 0 1\nfix 1"), "fix addforce: in two dimensions its force along z must be 0"),
    (("fix 1", "fix 2 all spring tether 1 1 2 5 0\nfix 1"), "fix spring: in two dimensions its force along z must be 0"),
    (("dpd 0.0 1.0 99\npair_coeff * * 25.0 4.5", "dpd/ext 0.0 1.0 99\npair_coeff * * 25.0 4.5 4.5 1 1"), "its noise has a z"),
    (("temp/partial 1 0 0", "temp/partial 1 0 1"), "the flag of z must be 0"),
    (("fix 1 all nve", "fix 1 all nph iso 1 1 1"), "fix nph is not supported in two dimensions"),
    (("fix 1", "replicate 1 1 2\nfix 1"), "nz must be 1"),
    (("dimension 2", "dimension 3\nlattice sc 1"), "the lattice style in 3 dimensions"),
    (
        ("dimension 2\ncomm_modify vel yes", "region q block 0 1 0 1 0 1\ncreate_box 2 q\nfix 2 all enforce2d"),
        "enforce2d needs dimension 2",
    ),
)
def test_two_dimensions_refused(tmp_path, change, message):
    text = FLAT.format(lattice="hex 2.0", z="-0.1 0.1", fixes="") + "run 1\n"
    raises(
        DeckError, message, lambda: read_deck(put(tmp_path / "in.bad", text.replace(*change)), stop_before_first_run=True).first_run.scene()
    )


# -- change_box ---------------------------------------------------------------------------------------------------------------------
LATTICE = """units lj
comm_modify vel yes
neighbor 0.3 bin
neigh_modify every 1 delay 0 check yes
lattice fcc 3.0
region box block 0 4 0 4 0 4
create_box 1 box
create_atoms 1 box
mass * 1.0
velocity all ramp vx -1 1 y 0 5
group g id 1:50
"""


@cases(
    "changes",
    "x final 0 8",
    "x scale 0.5",
    "x scale 1.1 y volume z volume remap",
    "x scale 1.1 z scale 1.2 y volume remap",
    "triclinic xy final 1.5 remap xz delta 0.3 yz final -0.2 units box",
    "triclinic xy final 3",
    "set x final 0 5 set x final 0 6 remap boundary p f p",
)
def test_beads_in_a_changed_box(tmp_path, changes):
    group = "g" if "scale" in changes else "all"
    text = LATTICE + f"change_box {group} {changes}\n"
    expected, _ = lammps_peer.theirs(tmp_path, text)
    atoms = lammps_peer.ours(tmp_path, text).atoms
    np.testing.assert_allclose(atoms.positions, expected[:, 2:5], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(atoms.images, expected[:, 5:8])


@cases(
    "shape, count",
    {
        "block": ("block 0 4 -1 3 0 5", 900),
        "prism": ("prism 0 4 0 4 0 5 1.5 -1 0.7", 900),
        "line": ("block 0 40 0 1 0 1", 47),
        "few": ("block 0 4 0 4 0 4", 7),
        "plane": ("block 0 9 0 7 -0.5 0.5", 200),
    },
)
def test_ids_by_place(tmp_path, shape, count):
    """Of beads of two kinds and of bonds between them, also where beads were moved out of the box before."""
    text = "dimension 2\n" if "-0.5" in shape else ""
    text += f"atom_style bond\nregion b {shape}\ncreate_box 2 b bond/types 1 extra/bond/per/atom 2 extra/special/per/atom 9\nmass * 1\n"
    text += (
        f"create_atoms 1 random {count} 77 b\ncreate_atoms 2 random 9 5 b\ngroup g id 3 8\ngroup t type 2\nbond_style zero\nbond_coeff *\n"
    )
    text += "create_bonds single/bond 1 2 3\ndisplace_atoms g move 0.9 0.4 0\ndelete_atoms group t bond yes\ncreate_atoms 2 random 9 5 b\n"
    text += "reset_atoms id sort yes\ngroup low id < 6\n"
    expected, sizes = lammps_peer.theirs(tmp_path, text)
    found = lammps_peer.ours(tmp_path, text)
    np.testing.assert_array_equal(found.atoms.ids, expected[:, 0])
    np.testing.assert_array_equal(found.atoms.types, expected[:, 1])
    np.testing.assert_allclose(found.atoms.positions, expected[:, 2:5], rtol=0, atol=1e-14)
    assert {name: int(mask.sum()) for name, mask in found.groups.items()} == sizes


def same_numbers(tmp_path, *names: str) -> None:
    """Files of both programs are the same to the digits that they have."""
    texts = ["".join((tmp_path / its / name).read_text() for name in names) for its in ("ours", "theirs")]
    found, expected = (np.array(text.split()) for text in texts)
    numeric = np.array([word[-1].isdigit() and word[0] != "C" for word in expected])
    assert (found[~numeric] == expected[~numeric]).all()
    np.testing.assert_allclose(found[numeric].astype(float), expected[numeric].astype(float), rtol=0, atol=3e-8)


def test_runs_in_changed_boxes(tmp_path):
    text = (
        LATTICE
        + "displace_atoms all ramp x 0 0.1 y 0 3\npair_style dpd 0.0 1.0 99\npair_coeff * * 25.0 4.5\nfix 1 all nve\ncompute m all msd\n"
        "run 3\nchange_box all triclinic xy final 1.0 remap\n"
        "compute ch all chunk/atom bin/1d z lower 0.25 units reduced\nfix av all ave/chunk 1 4 4 ch density/number file f.chunk\nrun 3\n"
        "change_box all x scale 1.1 y volume remap xz delta 0.2 z scale 1.05 units box\nrun 3\nunfix av\nuncompute ch\n"
        "change_box all xy final 0 xz final 0 remap ortho z final -0.3 5 boundary p p f units box\nfix w all wall/reflect zlo EDGE zhi EDGE\n"
        "thermo_style custom step temp press pe ke etotal enthalpy density vol pxx pyy pzz pxy fmax lx ly xy c_m[4]"
    )
    same_rows(tmp_path, text, 5)
    same_numbers(tmp_path, "f.chunk")


@cases(
    "changes, message",
    ("xy final 1", "put 'triclinic' before it"),
    ("triclinic xy scale 2", "the change of xy must be one of final, delta"),
    ("x volume", "x volume must follow a change of another edge"),
    ("triclinic xy final 1 ortho", "the box is tilted"),
    ("x final 0", "change_box x final needs 2 values"),
    ("tilt xy", "a keyword of change_box must be one of"),
    ("x final 0 3 boundary f p p", "lies outside the box along an axis that is not periodic"),
    ("x final 3 2", "positive length along x"),
)
def test_changes_refused(tmp_path, changes, message):
    raises(
        DeckError, message, lambda: read_deck(put(tmp_path / "in.bad", LATTICE + f"change_box all {changes}\n"), stop_before_first_run=True)
    )


# -- atom_style sphere --------------------------------------------------------------------------------------------------------------
SPHERES = """units lj
atom_style {0}
comm_modify vel yes
region b block 0 5 0 5 0 5
create_box 2 b{1}
create_atoms 1 random 300 4811 b
{2}
set atom 1*100 diameter 0.6
set atom 50*150 density 2.0
set atom 120*170 type 2 mass 3.0
set atom 160*200 diameter 0.0 mass 0.4
variable w atom sin(2*id)
velocity all set v_w 0 v_w
write_data s.data nocoeff
clear
units lj
atom_style {0}
comm_modify vel yes
special_bonds lj 1 1 1
read_data s.data
replicate 1 1 2
pair_style dpd 0.0 1.0 343587
pair_coeff * * 25 2.0
fix 1 all nve
fix 2 all gravity 0.5 vector 0 0 -1
variable m equal mass(all)
variable f atom 0.1*mass*radius
fix 3 all addforce v_f 0 0
fix 4 all langevin 0 0 1.0 77
compute c all property/atom mass radius diameter
compute r all reduce sum c_c[1] c_c[2] c_c[3]
thermo_style custom step temp pe ke press density c_r[1] c_r[2] c_r[3] v_m
timestep 0.01
"""


@cases(
    "style, room, more, fix",
    ("sphere", "", "", "nve"),
    ("hybrid sphere bond", " bond/types 1 extra/bond/per/atom 2", "mass * 7.0\nbond_style zero\nbond_coeff 1", "nve"),
    ("hybrid atomic sphere dpd", "", "mass * 7.0\nset atom * dpd/theta 1.0", "nve/sphere"),
)
def test_spheres_are_points_with_masses_of_their_own(tmp_path, style, room, more, fix):
    text = SPHERES.format(style, room, more)
    same_rows(tmp_path, text if fix == "nve" else text.replace("diameter 0.0", "diameter 0.1").replace("1 all nve", "1 all nve/sphere"), 10)


# -- fix deform ---------------------------------------------------------------------------------------------------------------------
MOVING = (
    LATTICE.replace("block 0 4 0 4 0 4", "prism 0 4 0 4 0 4 0.3 0 0").replace("delay 0 check yes", "delay 0 check no")
    + """velocity all ramp vz -0.5 1 x 0 5
displace_atoms all ramp x 0 0.1 y 0 3
pair_style dpd 0.0 1.0 99
pair_coeff * * 25.0 4.5
timestep 0.01
compute m all msd
fix 1 all nve
fix d {0}
compute ch all chunk/atom bin/1d z lower 0.25 units reduced
fix av all ave/chunk 1 4 5 ch density/number vx file f.chunk
thermo_style custom step time temp press pe ke etotal enthalpy density vol pxx pyy pzz pxy pxz fmax lx ly xlo zhi xy xz yz c_m[4]
dump d all custom 5 f.dump id x y z ix iy iz xu vx fx
dump_modify d sort id format float %.8f pbc yes
run 20 {1}
"""
)


@cases(
    "deform, ramp",
    ("all deform 1 x final 0 5 y delta -0.1 0.2 z scale 0.9", "start 0 stop 35"),
    ("all deform 3 x vel 0.5 y erate -0.2 z trate 0.3 xy final 0.5 xz erate 0.2 yz delta -0.3 units box", ""),
    ("all deform 1 xz wiggle 0.2 0.3 xy trate 0.3 x wiggle 0.1 0.5 y vel 0.1 z volume units box", ""),
    ("all deform 1 x final 0 5.5 y volume z volume units box", ""),
    ("g deform 2 x erate 0.5", ""),
    ("all deform 1 x erate 0.5 yz erate 0.2 remap none", ""),
    ("all deform 1 x erate 0.5\nunfix 1\nfix 1 all nvt temp 1 0.5 0.2\nfix v all viscous 0.3\nfix f all addforce 0.5 0 0.1", ""),
    ("all deform 2 y scale 0.9 xy delta 0.3\nfix b all langevin 0 0 0.3 77\nfix r all temp/rescale 3 1.0 0.5 0.02 0.5", ""),
)
def test_changing_boxes(tmp_path, deform, ramp):
    same_rows(tmp_path, MOVING.format(deform, ramp), 15)
    same_numbers(tmp_path, "f.dump", "f.chunk")


@cases(
    "deform, message",
    ("all deform 1 y erate 1 remap v", "deform y with remap v is not supported: friction"),
    ("all deform 1 xz erate 1 yz erate 1 remap v", "deform xz yz with remap v is not supported: friction"),
    ("all deform 1 xy vel 1 remap v", "deform xy with remap v is not supported: friction"),
    ("all deform 1 x variable v_a v_b", "style 'variable' is not supported"),
    ("all deform 1 x erate 1 flip no", "flip no is not supported"),
    ("all deform 1 remap x", "fix deform changes nothing"),
    ("all deform 1 x erate 1\nfix e all deform 1 y erate 1", "fix e: deform cannot be combined with fix deform"),
    ("all deform 1 x erate 1\ncompute t all temp/deform", "compute temp/deform needs a fix deform with remap v"),
    ("all deform 1 x erate 1\nvariable a atom x\nfix a all addforce v_a 0 0", "fix a: a variable force cannot follow"),
    ("all deform 1 x erate 1\nregion r block 0 2 0 2 0 2\nfix a all addforce 1 0 0 region r", "fix a: a variable force cannot follow"),
    ("all deform 1 x erate 1\nunfix 1\nfix a all nve/limit 0.1", "fix a: nve/limit cannot follow"),
    ("all deform 1 x scale 0.3", "step 16: .*the cutoff"),
    ("all deform 1 xy delta 3", "step 12: the box would be tilted by more than half an edge"),
)
def test_changes_during_runs_refused(tmp_path, deform, message):
    raises((DeckError, RunError), message, lambda: run(tmp_path / "in.bad", MOVING.format(deform, "")))
