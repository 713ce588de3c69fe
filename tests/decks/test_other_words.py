"""Words of other versions of LAMMPS, and what concerns LAMMPS alone, beside a live LAMMPS: same rows, same files."""

from collections.abc import Iterator

import lammps_peer
import pytest
from cases import cases, put, raises
from fuzz.deck import Deck
from fuzz.draw import Draw
from fuzz.trial import Trial
from test_commands_live import BEADS, FRAMES, RUN

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, check_deck, read_deck, run_deck

SYSTEM = BEADS.format(units="lj", box="block -1 3 0 4 0 5")
#: What stands in a deck, and what LAMMPS is given in its place.
OLD = {
    "suffixes": ("pair_style dpd/omp 0 1.2 3", "pair_style dpd 0 1.2 3"),
    "communicate": ("communicate single vel yes", "comm_modify mode single vel yes"),
    "porosity": ("delete_atoms porosity all NULL 0.3 77 compress no", "delete_atoms random fraction 0.3 no all NULL 77 compress no"),
    "ave/spatial": (
        "fix s g ave/spatial 1 2 4 x lower 1.1 z lower 2 vx density/number units box ave running file s.txt",
        "compute s_spatial g chunk/atom bin/2d x lower 1.1 z lower 2 units box\n"
        "fix s g ave/chunk 1 2 4 s_spatial vx density/number ave running file s.txt",
    ),
}
SWEEP = f"""clear
variable k loop 3
label again
clear
{SYSTEM.replace("create_atoms 2 single 2.3 3.4 1.5 units box", 'if "$k > 1" then "create_atoms 2 single 2.3 3.4 1.5 units box"')}
velocity all scale $k
shell mkdir at.$k there
shell cd at.$k
dump d all custom 5 frames.txt id type x vx
dump e all custom 5 *.txt id type x vx
dump_modify e sort id format float %.15g pbc yes
fix t all ave/time 1 2 5 c_thermo_temp file t.txt
write_dump all custom first.txt id x modify sort id
shell cd ../there
dump_modify d sort id format float %.15g pbc yes
print "step $(step) of system $k, $(count(all)) beads" append said.txt
{RUN}
write_data kept.data
shell cd ..
next k
jump SELF again
clear
pair_style dpd 0.0 1.2 3
read_data there/kept.data
pair_coeff 1 2 20 0.5
comm_modify vel yes
fix 1 all nve
timestep 0.01
thermo 5
{FRAMES}
{RUN}
"""
VECTORS = """compute m all momentum
compute r all rdf 6 * *
variable v vector [1,-2.5,3e2]
variable w vector c_m+v_v*2
variable u vector sqrt(abs(v_w))^2-2.5
variable i internal 2.5
variable t timer
fix a all ave/correlate 1 4 5 c_m[1] c_m[2] type full ave running
variable e equal sum(v_v)+max(v_w)*min(v_u)-ave(v_w)
fix b all ave/time 1 1 1 v_v[1] v_e v_i file b.txt format " %.15g"
variable c equal trap(f_a[3])
variable s equal sum(c_r[2])+slope(v_v)+trap(v_w)
variable x atom v_v[2]*x
compute x all reduce sum v_x
thermo_style custom step v_v[2] v_w[3] v_i v_e v_c v_s c_x
"""
AFTER = 'variable i internal -1\nprint "${v} ${i} $(v_v[3]-v_i) $(v_t>0)" append said.txt\n'
CHANGED = 'change_box all x final -1 3.5 y final 0 4.5 units box\nprint "$(lx) $(vol)" append said.txt\n' + (
    "write_dump all custom changed.txt id x ix xu modify sort id format float %.12g\n"
)
COPIED = (
    'replicate 1 2 1\nprint "$(ly) $(vol)" append said.txt\nwrite_dump all custom copied.txt id y iy modify sort id format float %.12g\n'
)
LISTED = """print "3 # of a set" append tags.txt
print "1 2.5" append tags.txt
print "3 -1" append tags.txt
print "4 1e-1" append tags.txt
print "1" append tags.txt
print "1 7" append tags.txt
variable f atomfile tags.txt
variable h atom v_f>0
variable y atom v_f*x-v_f
group h variable h
group k variable f
compute y h reduce sum v_y v_f
thermo_style custom step c_y[1] c_y[2]
print "$(count(h)) $(count(k))" append said.txt
write_dump all custom listed.txt id v_f modify sort id
"""
DECKS = {
    "changed box": (SYSTEM + RUN + CHANGED + RUN, {}),
    "copied box": (SYSTEM + RUN + COPIED + RUN, {}),
    "atomfile": (SYSTEM + LISTED + RUN, {}),
    "vectors": (SYSTEM + VECTORS + RUN + AFTER + RUN, {}),
    **{name: (SYSTEM + new + "\n" + FRAMES + RUN, {new: old}) for name, (old, new) in OLD.items()},
    "clear": (SWEEP, {}),
    "respa": (SYSTEM + "run_style respa 2 1\n" + RUN, {}),
    "balance": (SYSTEM + "balance 1.1 shift x 5 1.1\nfix b all balance 5 1.1 shift x 5 1.1\n" + RUN + "unfix b\n" + RUN, {}),
}
MOLECULES = "atom_style bond\n" + SYSTEM + "set type 1 mol 1\nset type 2 mol 2\nneigh_modify exclude molecule/intra g\n" + FRAMES + RUN
DECKS["exclude molecule"] = (MOLECULES, {"exclude molecule/intra": "exclude molecule"})
SUFFIXES = {"fix 1 all nve": "fix 1 all nve/kk", "pair_style dpd": "pair_style hybrid dpd/gpu", "* * 25": "* * dpd/opt 25"}
DECKS["more suffixes"] = (SYSTEM + RUN, SUFFIXES)


@pytest.fixture(scope="module")
def trial(tmp_path_factory) -> Iterator[Trial]:
    lammps_peer.need()
    with Trial(tmp_path_factory.mktemp("words")) as found:
        yield found


@cases("text, ours", DECKS)
def test_both_programs_write_the_same(trial, text, ours):
    deck = Deck(Draw(1))
    deck.lines[:], deck.ours = text.splitlines(), ours
    outcome = trial.of_deck(0, "words", deck)
    assert outcome.kind == "agree", outcome.message


REFUSED = {
    "shell": ("shell rm x\n", "only cd, mkdir and echo; decks cannot run programs"),
    "outside": ("shell cd ..\n", "would lie outside the output folder"),
    "far outside": ("shell mkdir a/../../b\n", "would lie outside the output folder"),
    "respa": ("run_style respa 2 4 bond 1 pair 2\n", "or respa whose levels have the same step, is supported, not 'respa 2 4 bond"),
    "suffix of what there is not": ("fix 2 all langevn/kk 1 1 1 7\n", "fix style 'langevn' is not supported"),
    "group of communicate": ("communicate single group g\n", "comm_modify group must be all"),
    "label": ("labelmap atom 1 1a\n", "the label of atom type 1 must not begin with a digit"),
    "label twice": ("labelmap atom 1 a 2 a\n", "the label a already belongs to atom type 1"),
    "short atomfile": (
        'print "2" append t.txt\nprint "1 2" append t.txt\nvariable f atomfile t.txt\n',
        "t.txt: expected 2 lines of an id and a value, but found 1",
    ),
    "next of an atomfile": ('print "0" append t.txt\nvariable f atomfile t.txt\nnext f\n', "variable f is atomfile-style; only"),
    "atomfile as a number": (
        'print "0" append t.txt\nvariable f atomfile t.txt\nprint "${f}"\n',
        "f is atomfile-style: it has a value for every",
    ),
    "no label": ("labelmap atom 1 W\nlabelmap clear\nmass W 1\n", "expected atom type as a number or a range such as .*, not 'W'"),
    "a whole vector": ("variable v vector [1,2]\nthermo_style custom v_v\n", "variable v is vector-style; only equal-style"),
    "a vector in a formula": (
        "variable v vector [1,2]\nprint $(v_v+1)\n",
        "variable v is vector-style: use v_v.i., or a function such as sum",
    ),
    "no such value": ("variable v vector [1,2]\nprint $(v_v[3])\n", "v_v.3. is out of range: the vector has 2 values"),
    "lengths": ("variable v vector [1,2]+[1,2,3]\nprint ${v}\n", "variable v: cannot evaluate the formula"),
    "internal": ("variable v internal 1+1\n", "expected a number for variable v, not '1.1'"),
    "ave/spatial": ("fix 2 all ave/spatial 1 2\n", "fix ave/spatial needs 3 values"),
}


@cases("text, message", REFUSED)
def test_refused(tmp_path, text, message):
    raises(DeckError, message, read_deck, put(tmp_path / "in.deck", SYSTEM + text), output=tmp_path / "out")


def test_one_note_for_each(tmp_path):
    text = (
        "".join(f"{old}\n" for old, _ in OLD.values()).replace("pair_style dpd/omp", "fix 2 g setforce/kk")
        + "balance 1 shift x 1 1\nrun 0\n"
    )
    notes = [found.message for found in check_deck(put(tmp_path / "in.deck", "clear\n" + SYSTEM + text)) if found.kind == "note"]
    expected = "atom_modify neigh_modify styles communicate comm_modify delete_atoms fix balance"
    assert sorted(note.partition(" ")[0] for note in notes) == sorted(expected.split()), notes


HYBRID = """units lj
atom_style {style}
comm_modify vel yes
region b block 0 6 0 6 0 6 units box
{made}
mass * 1
pair_style {pair}
bond_style harmonic
bond_coeff * 25 0.6
set type 1 {property}
velocity all ramp vx -1 1 y 0 6 units box
fix 1 all {fix}
timestep 0.01
dump d all custom 5 d.txt id mol type x vx
dump_modify d sort id format float %.15g pbc yes
thermo_style custom step temp pe ebond press
thermo 1
"""
MADE = """lattice sc 1.1
create_box 2 b bond/types 1 extra/bond/per/atom 2 extra/special/per/atom 4
create_atoms 1 box basis 1 2
lattice none 1
group odd id 1:200:2
mass * 1
pair_style zero 2
pair_coeff * *
create_bonds many odd odd 1 1.0 1.2"""
PLAIN = dict(pair="dpd 0 1 3\npair_coeff * * 25 0", property="mol 3", fix="nve")
MANY = "hybrid/overlay mdpd/rhosum mdpd 0.0 1.0 77\npair_coeff * * mdpd/rhosum 0.75\npair_coeff * * mdpd -50 25 0.0 1.0 0.75"
STYLES = {
    "bond": dict(PLAIN, style="hybrid bond"),
    "full charge": dict(PLAIN, style="hybrid full charge", property="charge 0.25"),
    "mdpd bond": dict(PLAIN, style="hybrid mdpd bond", pair=MANY, fix="mvv/dpd 0.65"),
    "tdpd angle edpd": dict(PLAIN, style="hybrid tdpd 2 angle edpd", property="edpd/temp 0.9 cc 2 0.3"),
}


LABELS = """units lj
atom_style bond
comm_modify vel yes
region b block 0 6 0 6 0 6 units box
{made}
mass W 1
mass P-1 2.5
pair_style dpd 0 1 3
pair_coeff W W 25 0
pair_coeff W P-1 20 0
pair_coeff P-1 * 15 0.1
bond_style harmonic
bond_coeff W-W 25 0.6
bond_coeff 2 25 0.8
group w type W
group p type P-1 W
set atom 20*60 type P-1
set atom 3*5 type W
velocity all ramp vx -1 1 y 0 6 units box
fix 1 all nve
timestep 0.01
compute r all rdf 5 W P-1 W *
fix r all ave/time 1 2 5 c_r[*] mode vector file r.txt
dump d all custom 5 d.txt id type x vx
dump_modify d sort id format float %.15g pbc yes
thermo_style custom step temp pe ebond press
thermo 1
"""
LABELLED = """lattice sc 1.1
create_box 2 b bond/types 2 extra/bond/per/atom 2 extra/special/per/atom 4
labelmap atom 1 W 2 P-1
labelmap bond 1 W-W 2 P:P
create_atoms W box
group odd id 1:99:2
mass * 1
pair_style zero 2
pair_coeff * *
create_bonds many odd odd 1 1.0 1.2
lattice none 1"""


def test_labels_of_types(trial):
    deck = Deck(Draw(1))
    texts = [LABELS.format(made=made) + RUN for made in (LABELLED, "read_data lammps_now.data", "read_data ours_now.data")]
    deck.stages = [(text + "write_data now.data nocoeff\n").splitlines() for text in texts]
    outcome = trial.of_deck(0, "words", deck)
    assert outcome.kind == "agree", outcome.message


def test_labels_stay_in_restart_files(tmp_path):
    text = (
        SYSTEM + "labelmap atom 1 W 2 P\nwrite_restart r\nwrite_data d nolabelmap\nlabelmap clear\nclear\nread_restart r\nmass W 7\nrun 0\n"
    )
    state = read_deck(put(tmp_path / "in.deck", text), output=tmp_path)
    assert state.masses[1] == 7 and "Labels" not in (tmp_path / "d").read_text()


@cases("settings", STYLES)
def test_hybrid_atom_styles_and_their_data_files(trial, settings):
    """What one program writes, the other reads, too."""
    deck = Deck(Draw(1))
    texts = [HYBRID.format(made=made, **settings) + RUN for made in (MADE, "read_data lammps_now.data", "read_data ours_now.data")]
    deck.stages = [(text + "write_data now.data nocoeff\n").splitlines() for text in texts]
    outcome = trial.of_deck(0, "words", deck)
    assert outcome.kind == "agree", outcome.message


def test_each_run_is_reported_in_its_own_units(tmp_path):
    text = (
        SYSTEM.replace("comm_modify", "timestep 0.01\nmass * 1\ncomm_modify", 1)
        + "pair_style zero 0.4\npair_coeff * *\nfix 1 all nve\nrun 1\n"
    )
    runs = run_deck(put(tmp_path / "in.deck", f"{text}clear\n{text.replace('units lj', 'units real')}"), RunOptions(platform="Reference"))[
        "runs"
    ]
    assert [run["dt"] for run in runs] == pytest.approx([0.01, 0.01])
