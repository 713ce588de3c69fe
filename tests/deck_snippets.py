"""A small deck for every compute, fix, output style, variable style and command that decks may have, by the package's own tables."""

from collections.abc import Callable
from itertools import product

from openmm_dpd.lammps.commands.fixes import STYLES as FIXES
from openmm_dpd.lammps.language.variables import STYLES as VARIABLES
from openmm_dpd.lammps.output.dumps import STYLES as DUMPS
from openmm_dpd.lammps.output.thermo import STYLES as LAYOUTS
from openmm_dpd.lammps.run.deck import COMMANDS
from openmm_dpd.lammps.values.computes import COMPUTES

_RUNS = "timestep 0.01\nthermo 3\nBEFORE\nrun 7\nBETWEEN\nrun 6\n"
BASES = {  # Decks that a snippet is put into: what is in front of its two runs, and perhaps between them.
    "fluid": """units lj
comm_modify vel yes
HEAD
region box block 0 3 0 3 0 3 units box
create_box 2 box
create_atoms 1 random 22 4243 box
create_atoms 2 random 20 4244 box
mass 1 1.0
mass 2 2.0
pair_style dpd 1.0 1.0 34387
pair_coeff * * 25.0 4.5
velocity all create 1.0 87287
fix move all nve
"""
    + _RUNS,
    "energy": """units lj
atom_style dpd
comm_modify vel yes
lattice sc 3
region box block 0 3 0 3 0 3
create_box 1 box
create_atoms 1 box
mass 1 1.0
velocity all create 1.0 87287
set atom * dpd/theta 1.0
pair_style dpd/fdt/energy 1.0 34387
pair_coeff * * 25.0 3.0 0.5
HEAD
fix move all nve
"""
    + _RUNS,
    "edpd": """units lj
atom_style edpd
comm_modify vel yes
region box block 0 3.4 0 3.4 0 3.4 units box
create_box 1 box
create_atoms 1 random 100 4243 box
mass 1 1.0
set atom * edpd/temp 1.0
set atom * edpd/cv 200.0
velocity all create 1.0 87287
pair_style edpd 1.58 34387
pair_coeff * * 18.75 4.5 0.41 1.58 1.41e-5 2.0 1.58
fix move all mvv/edpd 0.55
"""
    + _RUNS,
    "tdpd": """units lj
atom_style tdpd 2
comm_modify vel yes
region box block 0 3.4 0 3.4 0 3.4 units box
create_box 1 box
create_atoms 1 random 100 4243 box
mass 1 1.0
set atom * cc 1 1.0
set atom * cc 2 0.5
velocity all create 1.0 87287
pair_style tdpd 1.0 1.58 34387
pair_coeff * * 18.75 4.5 0.41 1.58 1.58 1.0 1e-5 2.0 3.0 1e-5 2.0
fix move all mvv/tdpd 0.5
"""
    + _RUNS,
    "bonds": """units lj
atom_style angle
comm_modify vel yes
special_bonds lj 1.0 1.0 1.0
bond_style harmonic
angle_style harmonic
read_data data.chain extra/atom/types 1
mass 2 1.0
bond_coeff 1 50 0.5
angle_coeff 1 5 180
pair_style dpd 1.0 1.0 34387
pair_coeff * * 25.0 4.5
velocity all create 1.0 87287
fix move all nve
"""
    + _RUNS.replace("3", "2"),
}

BASES["tilted"] = (
    BASES["fluid"]
    .replace("block 0 3 0 3 0 3", "prism 0 3 0 3 0 3 0.5 0 0")
    .replace("BEFORE", "BEFORE\nfix slide all deform 1 xy erate 9.0 remap v")
)
BASES["spheres"] = (
    BASES["fluid"].replace("HEAD", "atom_style sphere").replace("mass 1 1.0\nmass 2 2.0", "set type 2 diameter 2 density 0.4")
)
BASES["spheres"] = BASES["spheres"].replace("all nve", "all nve/sphere")
BASES["flat"] = BASES["fluid"].replace("HEAD", "dimension 2").replace("block 0 3 0 3 0 3", "block 0 3 0 3 -0.1 0.1")
BASES["dihedrals"] = (
    BASES["bonds"]
    .replace("atom_style angle", "atom_style molecular\ndihedral_style opls\nimproper_style hybrid umbrella cvff")
    .replace("data.chain", "data.turns")
    .replace("angle_coeff 1 5 180", "angle_coeff 1 5 120\ndihedral_coeff 1 1 -2 3 0.5\nimproper_coeff 1 umbrella 2 30")
)


def chains(said: str, style: str, number: int, length: int, place: Callable[[int, int], str]) -> str:
    """A data file of chains with all bonds, angles and dihedrals that they have."""
    kinds = ("atoms", "bonds", "angles", "dihedrals")[:length]
    lines = [said, "", *(f"{number * (length - k)} {kind}" for k, kind in enumerate(kinds)), *(f"1 {kind[:-1]} types" for kind in kinds)]
    lines += [*(f"0 3 {axis}lo {axis}hi" for axis in "xyz"), "", "Masses", "", "1 1.0", "", f"Atoms # {style}", ""]
    lines += [f"{length * m + k + 1} {m + 1} 1 {place(m, k)}" for m in range(number) for k in range(length)]
    for order, kind in enumerate(kinds[1:], start=2):
        lines += ["", kind.capitalize(), ""]
        for n, (m, k) in enumerate(product(range(number), range(length - order + 1)), start=1):
            lines.append(f"{n} 1 " + " ".join(str(length * m + k + j + 1) for j in range(order)))
    return "\n".join(lines) + "\n"


FILES = {  # Files beside the decks.
    "given.txt": "1\n1 5 0.9 0.7 0.5 1 1.2 1.2 0 0 0 0 0 0 0 0.1 0.2 0 0 0\n",
    "data.turns": chains(
        "two chains", "molecular", 2, 4, lambda m, k: f"{0.4 + 0.5 * k} {0.7 + 0.8 * m + 0.3 * (k % 2)} {0.5 + m + 0.2 * (k == 3)}"
    ).replace("1 dihedral types\n", "1 dihedral types\n2 impropers\n1 improper types\n")
    + "\nImpropers\n\n1 1 2 1 3 4\n2 1 6 5 7 8\n",
    "data.chain": chains("three chains", "angle", 3, 3, lambda m, k: f"{0.4 + 0.5 * k} {0.7 + 0.8 * m} {0.5 + m}"),
    "eos.table": "# U(T)\n\nSOFT\nN 3\n\n1 0.1 5.0\n2 2.0 100.0\n3 5.0 400.0\n",
    "dimer.txt": "two beads\n\n2 atoms\n1 bonds\n\nCoords\n\n1 0 0 0\n2 0.4 0 0\n\nTypes\n\n1 1\n2 1\n\nBonds\n\n1 1 1 2\n",
    "beads.txt": "2\n1 3.5\n4 -1\n",
    "more.in": "variable included equal 2*temp\n",
}


_END = "write_data end.data\nwrite_restart end.restart\n"  # All that a deck knows of its beads in the end.


def deck(base: str = "fluid", before: str = "", between: str = "", head: str = "") -> str:
    """A deck."""
    return BASES[base].replace("HEAD", head).replace("BEFORE", before).replace("BETWEEN", between) + _END


def averaged(*words: str, more: str = "") -> str:
    """Averages of values in a file, over windows that a run does not end with."""
    return f"fix a all ave/time 1 2 5 {' '.join(words)} file a.txt {more}"


_HEAT = "fix heat all eos/cv 50.0\nfix bath all shardlow"

SNIPPETS: dict[str, dict[str, str]] = {
    "compute": {
        "temp": deck(before="compute c all temp\n" + averaged("c_c", "c_c[1]")),
        "temp/com": deck(before="compute c all temp/com\n" + averaged("c_c", "c_c[1]")),
        "temp/partial": deck(before="compute c all temp/partial 1 0 1\ncompute_modify c extra/dof 2\n" + averaged("c_c", "c_c[2]")),
        "temp/deform": deck("tilted", "compute c all temp/deform\nthermo_modify temp c\n" + averaged("c_c", "c_thermo_press[5]"))
        .replace("0.5 0 0", "0 0.5 0")
        .replace(" xy ", " xz "),
        "temp/profile": deck(
            before="compute c all temp/profile 1 1 1 xyz 2 1 2\nthermo_modify temp c\n" + averaged("c_c", "c_thermo_press")
        ),
        "ke": deck(before="compute c all ke\n" + averaged("c_c", more="ave running")),
        "pe": deck(before="compute c all pe pair\n" + averaged("c_c", more="ave window 2")),
        "pressure": deck(before="compute c all pressure thermo_temp\n" + averaged("c_c", "c_c[4]", "c_thermo_press[1]")),
        "com": deck(before="compute c all com\n" + averaged("c_c", more="mode vector")),
        "momentum": deck(before="group one type 1\ncompute c one momentum\n" + averaged("c_c[*]")),
        "dpd": deck("energy", "compute c all dpd\n" + averaged("c_c[*]"), head=_HEAT),
        "reduce": deck(before="compute c all reduce max vx y\n" + averaged("c_c[1]", "c_c[2]", more="off 2")),
        "chunk/atom": deck(before="compute c all chunk/atom bin/1d x lower 0.7 units box\nfix a all ave/chunk 1 2 5 c vx temp file a.txt"),
        "com/chunk": deck(
            "bonds", "compute m all chunk/atom molecule\ncompute c all com/chunk m\n" + averaged("c_c[*]", more="mode vector")
        ),
        "vcm/chunk": deck(before="compute m all chunk/atom type\ncompute c all vcm/chunk m\n" + averaged("c_c[1][2]")),
        "msd/chunk": deck("bonds", "compute m all chunk/atom molecule\ncompute c all msd/chunk m\n" + averaged("c_c[2][4]")),
        "gyration/chunk": deck("bonds", "compute m all chunk/atom molecule\ncompute c all gyration/chunk m\n" + averaged("c_c[3]")),
        "property/chunk": deck(
            before="compute m all chunk/atom bin/sphere 1 1 1 0 1.4 3\ncompute c all property/chunk m count coord1\n"
            + averaged("c_c[2][1]")
        ),
        "vacf": deck(before="compute c all vacf\n" + averaged("c_c[4]")),
        "coord/atom": deck(before="compute c all coord/atom cutoff 0.6 1 2\ndump d all custom 2 d.txt id c_c[*]"),
        "cluster/atom": deck(
            before="compute c all cluster/atom 0.5\ncompute h all chunk/atom c_c compress yes\nfix a all ave/chunk 1 2 2 h vx file a.txt"
        ),
        "fragment/atom": deck("bonds", "compute c all fragment/atom\ndump d all custom 2 d.txt id c_c"),
        "aggregate/atom": deck("bonds", "compute c all aggregate/atom 0.4\ndump d all custom 2 d.txt id c_c"),
        "group/group": deck(before="group one type 1\ncompute c one group/group all\n" + averaged("c_c", "c_c[2]")),
        "rdf": deck(before="compute c all rdf 10 1 2 * *\n" + averaged("c_c[*]", more="mode vector")),
        "msd": deck(before="compute c all msd average yes\ncompute d all msd com yes\n" + averaged("c_c[4]", "c_d[4]")),
        "gyration": deck(before="compute c all gyration\n" + averaged("c_c", "c_c[5]")),
        "property/atom": deck(before="compute c all property/atom xu vx\ndump d all custom 2 d.txt id c_c[1] c_c[2]"),
        "ke/atom": deck(before="compute c all ke/atom\ncompute r all reduce sumsq c_c\n" + averaged("c_r")),
        "reduce/region": deck(before="region r block 0 1 0 3 0 3 units box\ncompute c all reduce/region r max vx y\n" + averaged("c_c[*]")),
        "property/local": deck("bonds", "compute c all property/local aatom2 atype\ndump d all local 2 d.txt c_c[1]"),
        "pair/local": deck(
            "bonds", "compute c all pair/local dist force\ncompute i all property/local patom1\ndump d all local 2 d.txt c_i c_c[*]"
        ),
        "bond/local": deck("bonds", "compute c all bond/local dist force\ndump d all local 2 d.txt index c_c[*]"),
        "angle/local": deck("bonds", "compute c all angle/local eng\ncompute r all reduce max c_c inputs local\n" + averaged("c_r")),
        "improper/local": deck("dihedrals", "compute c all improper/local chi\ndump d all local 2 d.txt c_c"),
        "dihedral/local": deck("dihedrals", "compute c all dihedral/local phi\ndump d all local 2 d.txt c_c"),
        **{
            style: deck(
                "bonds",
                "unfix move\nfix bodies all rigid/small molecule\nneigh_modify exclude molecule/intra all\n"
                f"compute c all {style} bodies{more}",
            )
            for style, more in {
                **{style: "\n" + averaged("c_c") for style in ("ke/rigid", "erotate/rigid")},
                "rigid/local": " id xu fy omegaz\ndump d all local 2 d.txt c_c[*]",
            }.items()
        },
        "pe/atom": deck(before="compute c all pe/atom pair\ncompute r all reduce max c_c\n" + averaged("c_r")),
        "stress/atom": deck(before="compute c all stress/atom thermo_temp\ndump d all custom 2 d.txt id c_c[1] c_c[4]"),
        "dpd/atom": deck("energy", "compute c all dpd/atom\ndump d all custom 2 d.txt id c_c[1] c_c[4]", head=_HEAT),
        "edpd/temp/atom": deck("edpd", "compute c all edpd/temp/atom\ndump d all custom 2 d.txt id c_c"),
        "tdpd/cc/atom": deck("tdpd", "compute c all tdpd/cc/atom 2\ndump d all custom 2 d.txt id c_c"),
    },
    "fix": {
        "nve": deck(before="group one type 1\nunfix move\nfix move one nve"),
        "mvv/dpd": deck(before="unfix move\nfix move all mvv/dpd 0.65"),
        "mvv/edpd": deck("edpd"),
        "mvv/tdpd": deck("tdpd"),
        "shardlow": deck("energy", head=_HEAT),
        "dpd/energy": deck("energy", head="fix heat all eos/cv 50.0\nfix inside all dpd/energy"),
        "eos/cv": deck("energy", "dump d all custom 3 d.txt id uCond uMech dpdTheta", head=_HEAT),
        "eos/table": deck("energy", head="fix heat all eos/table linear eos.table 3 SOFT\nfix bath all shardlow"),
        "edpd/source": deck("edpd", "fix warm all edpd/source cuboid 1 1 1 2 2 2 0.1"),
        "tdpd/source": deck("tdpd", "fix warm all tdpd/source 1 sphere 1.5 1.5 1.5 1 0.1"),
        "nph": deck("energy", head=f"{_HEAT}\nfix box all nph iso 20.0 20.0 1.0").replace("fix move all nve\n", ""),
        "addforce": deck(before="variable push atom 0.5*(x<1)\nfix push all addforce v_push 0 0.5\n" + averaged("f_push[1]")),
        "gravity": deck(before="variable g equal 0.1*PI\nfix down all gravity v_g vector 1 0 1"),
        "setforce": deck(before="group one id 1 2\nfix hold one setforce 0 NULL 0"),
        "enforce2d": deck("flat", "fix plane all enforce2d\nset atom 3 vz 0.4\n" + averaged("c_thermo_temp", "c_thermo_press[1]")),
        "wall/reflect": deck(head="boundary p p f", before="fix wall all wall/reflect zlo EDGE zhi EDGE"),
        "deform": deck(
            "tilted",
            "unfix move\nfix move all nvt temp 1 0.5 0.2\ncompute c all msd\ndump d all custom 2 d.txt id x ix vx xu\n"
            + averaged("c_c[1]", "c_thermo_press[4]"),
        ),
        "balance": deck(before="fix b all balance 5 1.1 shift x 5 1.1"),
        "npt": deck(before="unfix move\nfix move all npt temp 1.0 2.0 0.5 x 20.0 30.0 1.0 y 25 25 0.7 tchain 2\n" + averaged("f_move")),
        "nvt": deck(before="unfix move\nfix move all nvt temp 1.0 0.5 0.1 tchain 2\n" + averaged("f_move", "f_move[3]")),
        "nve/sphere": deck("spheres", "dump d all custom 2 d.txt id mass radius x"),
        "nve/limit": deck(before="unfix move\nfix move all nve/limit 0.01\n" + averaged("f_move")),
        "move": deck(
            before="group one type 1\ngroup two type 2\nunfix move\nfix move one nve\nvariable v atom 0.1*vx\n"
            "fix turn two move variable NULL v_v NULL v_v NULL NULL",
            between="unfix turn\nfix turn two move wiggle 0.1 NULL 0.1 0.3 units box",
        ),
        "adapt": deck(
            before="variable a equal 10+2*step\nfix push all adapt 2 pair dpd a0 1 * v_a pair dpd gamma 2 2 v_a",
            between="pair_coeff 1 1 20.0 4.0\nunfix push\nfix push all adapt 4 pair dpd a0 * * v_a scale yes reset yes",
        ),
        **{
            style: deck(
                "bonds",
                "group stiff molecule 1:3\ngroup two molecule 2\nvelocity two set 0 0 0\ngroup soft subtract all stiff\nunfix move\n"
                f"fix move soft nve\nfix bodies stiff {style} molecule{more}\nneigh_modify exclude molecule/intra stiff",
            )
            for style, more in {
                **{"rigid": " force 2 off off off torque 2 off off off", "rigid/nve": " force 2 on off off torque 2 off off off"},
                **{"rigid/small": " infile given.txt", "rigid/nve/small": " reinit no"},
            }.items()
        },
        "langevin": deck(before="fix bath all langevin 1.0 1.0 0.5 42 tally yes zero yes\n" + averaged("f_bath")),
        "viscous": deck(before="fix slow all viscous 0.5 scale 2 3.0"),
        "temp/rescale": deck(before="fix heat all temp/rescale 2 2.0 1.0 0.01 0.5\n" + averaged("f_heat")),
        "temp/berendsen": deck(before="fix heat all temp/berendsen 2.0 1.0 0.1\nfix_modify heat temp thermo_temp"),
        "aveforce": deck(before="region r block 0 1 INF INF INF INF units box\nfix push all aveforce 0 NULL 1 region r"),
        "efield": deck(
            head="atom_style charge",
            before="set type 1 charge 0.5\nvariable e equal step\nfix push all efield 0.5 v_e 0\n" + averaged("f_push[2]"),
        ),
        "spring": deck(before="group one type 1\nfix pull one spring tether 10 1 1 NULL 0.1\n" + averaged("f_pull", "f_pull[4]")),
        "spring/self": deck(before="fix pull all spring/self 5\nfix_modify pull energy yes\n" + averaged("f_pull")),
        **{
            f"wall/{style}": deck(
                head="boundary p p f",
                before=f"fix soft all wall/{style} zlo -1.2 {values} zhi 4.2 {values} units box\nfix wall all wall/reflect zlo EDGE zhi EDGE",
            )
            for style, values in {
                **dict.fromkeys(("lj93", "lj126", "lj1043", "harmonic"), "1.0 1.0 2.5"),
                "morse": "1.0 1.5 1.5 2.5",
            }.items()
        },
        "wall/region": deck(before="region r sphere 1.5 1.5 1.5 0.1 side out units box\nfix soft all wall/region r harmonic 5.0 1.0 1.5"),
        "bond/create": deck(
            "dihedrals",
            before="fix f all bond/create 2 1 1 0.6 1 iparam 3 2 jparam 3 2 prob 0.7 77 atype 1 dtype 1\n"
            "fix g all bond/create 3 1 2 0.7 1 iparam 2 1 jparam 3 1 atype 1 dtype 1\n" + averaged("f_f[2]", "f_g[2]"),
        ),
        "bond/create/angle": deck(
            "bonds",
            before="delete_bonds all bond 1 remove special\nfix f all bond/create/angle 1 1 1 0.7 1 iparam 2 1 jparam 2 1 aconstrain 60 180\n"
            + averaged("f_f[2]"),
        ),
        "bond/break": deck(
            "bonds",
            before="delete_bonds all angle 1 remove\nfix b all bond/break 2 1 0.55\npair_style hybrid dpd 1.0 1.0 341 srp/react 1.2 * mid b\n"
            "pair_coeff 1 1 dpd 25.0 4.5\npair_coeff 1 2 none\npair_coeff 2 2 srp/react 60.0\n" + averaged("f_b[2]"),
        ),
        "momentum": deck(before="fix still all momentum 3 linear 1 1 1 angular rescale"),
        "print": deck(before='fix say all print 2 "at $(step) $(temp)" file say.txt title begun'),
        "ave/time": deck(before=averaged("c_thermo_temp", more="overwrite") + "\nfix b all ave/time 1 2 5 f_a append b.txt start 4"),
        "ave/correlate": deck(
            before="fix c all ave/correlate 1 3 6 c_thermo_temp c_thermo_press type auto/upper ave running file a.txt\n"
            "fix d all ave/correlate 2 2 4 c_thermo_temp c_thermo_temp type full ave running overwrite file b.txt"
        ),
        "ave/histo": deck(before="fix a all ave/histo 1 2 4 -2 2 5 vx mode vector ave running file a.txt"),
        "vector": deck(
            before="fix a all vector 2 c_thermo_temp c_thermo_press\nthermo_style custom step",
            between='print "$(trap(f_a[1])) $(f_a[2][2])" append said.txt',
        ),
        "store/state": deck(
            before="fix a all store/state 3 x vy\nfix b all store/state 0 xu\nvariable v atom x-f_b\ndump d all custom 2 d.txt id f_a[*] v_v f_b"
        ),
        "ave/chunk": deck(
            before="compute c all chunk/atom bin/2d x lower 0.7 z center 1.1 units box\n"
            "fix a all ave/chunk 1 2 5 c vx density/number file a.txt ave window 2 norm sample"
        ),
    },
    "dump": {
        "atom": deck(before="dump d all atom 2 d.txt\ndump e all atom 3 d.*.txt"),
        "custom": deck(before="dump d all custom 2 d.txt id x vx\ndump_modify d first yes every 3", between="undump d"),
        "dcd": deck(before="dump d all dcd 2 d.dcd\ndump_modify d unwrap yes"),
        "xtc": deck(before="dump d all xtc 2 d.xtc\ndump_modify d precision 10000"),
        "xyz": deck(before="dump d all xyz 2 d.xyz\ndump_modify d element C O"),
        "local": deck("bonds", "compute c all property/local batom1 btype\ndump d all local 2 d.txt index c_c[*]"),
        "image": deck("bonds", "dump d all image 2 d.*.png type mass bond atom 0.2\ndump_modify d acolor 1 blue"),
        "movie": deck(before="variable v equal 10*step\ndump d all movie 3 d.mpg vx type view v_v 30"),
        "atom/gz": deck(before="dump d all atom/gz 2 d.gz"),
        "custom/gz": deck(before="dump d all custom/gz 2 d.gz id element\ndump_modify d thresh x < 1 units yes time yes delay 4"),
        "xyz/gz": deck(before="dump d all xyz/gz 2 d.*.gz\ndump_modify d pad 4"),
        "local/gz": deck("bonds", "compute c all angle/local theta\ndump d all local/gz 2 d.gz c_c"),
    },
    "layout": {
        "one": deck(before="thermo_style one"),
        "multi": deck(before="thermo_style multi", between="thermo_modify norm no"),
        "yaml": deck(before="thermo_style yaml"),
    },
    "variable": {
        "equal": deck(before='variable v equal "random(0,1,77) + temp"\nthermo_style custom step v_v', between="print $(v_v)"),
        "atom": deck(before="variable v atom x*vx\ncompute c all reduce sum v_v\n" + averaged("c_c")),
        "atomfile": deck(before="variable v atomfile beads.txt\ncompute c all reduce sum v_v\n" + averaged("c_c")),
        "vector": deck(before="variable v vector [1,2]\nvariable w vector v_v*2\nthermo_style custom step v_v[2]", between="print ${w}"),
        "internal": deck(before="variable v internal 2", between="print ${v}"),
        "timer": deck(before="variable v timer", between="print $(v_v>0)"),
        "string": deck(before="variable v string first", between='variable v string "$(temp)"\nprint ${v}'),
        "index": deck(before="variable v index a b", between="next v\nprint ${v}"),
        "loop": deck(before="variable v loop 2", between="label again\nrun 2\nnext v\njump SELF again"),
        "format": deck(before="variable v equal temp\nvariable w format v %.3f", between="print ${w}"),
        "getenv": deck(before="variable v getenv HOME\nprint ${v}"),
        "delete": deck(before="variable v equal temp", between="variable v delete\nvariable v string new\nprint ${v}"),
    },
    "command": {
        "boundary": deck(
            head="boundary p p p\ndimension 3\natom_style atomic\natom_modify sort 0 0\nneighbor 0.3 bin\nneigh_modify every 1"
        ),
        "echo": deck(
            head="echo none\ninfo system\nlog none\nnewton on\npackage omp 1\nprocessors * * *\nsuffix off\ntimer off\ncomm_style brick"
        ),
        "clear": "clear\n" + deck(between="balance 1.1 shift x 2 1.1\nshell mkdir sub\nshell cd sub") + "clear\n" + deck(),
        "labelmap": deck(
            head="",
            before="labelmap atom 1 A 2 B\ngroup g type B\nset type A vx 0.1",
            between="mass B 3\nlabelmap atom 1 C\npair_coeff C B 20 4.5",
        ),
        "run_style": deck(before="run_style verlet\nmin_style cg\nmin_modify norm inf", between="minimize 1e-3 1e-3 5 20"),
        "delete_atoms": deck(head="atom_modify sort 0 0", between="group gone id 3 4\ndelete_atoms group gone\nreset_atoms id"),
        "reset_ids": deck(
            head="atom_modify sort 0 0", between="group gone id 3\ndelete_atoms group gone compress no\nreset_ids\nreset_atom_ids"
        ),
        "write_dump": deck(between="write_dump all custom now.txt id x vx modify sort id"),
        "group": deck(
            before="region r block 0 1.5 INF INF INF INF\ngroup g dynamic all region r every 2\nvariable n equal count(g)\nvariable right atom x > 1\ngroup e variable right\n"
            "fix a g ave/time 1 2 5 v_n file a.txt\ndump d g custom 3 d.txt id x",
            between="group g static",
        ),
        "molecule": deck(
            "bonds",
            "molecule m dimer.txt\ncreate_atoms 0 random 3 17 NULL mol m 18",
            "create_atoms 0 single 1 1 1 mol m 4\ncreate_bonds many all all 1 0.3 0.5\ndelete_bonds all bond 1 any",
        ).replace("lj 1.0 1.0 1.0", "lj/coul 0 1 1"),
        "read_data": deck("bonds", "read_data data.chain add append shift 0 0 0.5 nocoeff", "read_data data.chain add 30 5 shift 0 0.4 0"),
        "set": deck(between="variable v atom 0.1*id\nset atom * vx v_v\nset atom 1*3 type 2\nmass 2 1.5\nvelocity all scale 0.5"),
        "displace_atoms": deck(between="displace_atoms all random 0.1 0.1 0.1 31 units box"),
        "change_box": deck(
            between="change_box all triclinic x scale 1.2 y volume z volume xy final 0.5 remap boundary p p p units box\n"
            "dump d all custom 2 d.txt id x xu ix\nfix grow all deform 2 x scale 1.1 xz delta 0.2 yz wiggle 0.1 0.2"
        ),
        "replicate": deck(before="replicate 1 1 2", between="velocity all scale $(temp)"),
        "pair_modify": deck(before="pair_modify shift no", between="pair_coeff * * 20.0 4.0"),
        "write_restart": deck(before="restart 3 a.*.restart", between="write_restart b.restart\nrestart 4 c.restart d.restart"),
        "reset_timestep": deck(between="reset_timestep 3\ntimestep 0.02\nthermo_modify format float %.12g"),
        "uncompute": deck(before="compute c all temp\nthermo_style custom step c_c", between="thermo_style one\nuncompute c"),
        "write_data": deck(between="write_data between.data", before="dump d all atom 2 d.txt"),
        "print": deck(between='print "$(temp)" append said.txt\nprint "$(step)" append said.txt screen no'),
        "include": deck(before="include more.in", between='if "$(v_included) > 0" then "run 2" else "run 3"'),
        "quit": deck(between="run 4 every 2 NULL\nrun 3 every 1 \"print '$(temp)'\"\nquit"),
        "bond_style": deck("bonds", "thermo_style custom step temp ebond eangle\ndump d all custom 2 d.txt id xu"),
        "dihedral_style": deck("dihedrals", "thermo_style custom step temp eangle edihed\ndump d all custom 2 d.txt id xu"),
        "improper_style": deck(
            "dihedrals",
            "compute c all pe/atom improper\ncompute d all property/local itype iatom1\ncompute r all reduce max c_c\n"
            "thermo_style custom step temp eimp emol impropers c_r",
            between="improper_coeff 1 cvff 3.0 -1 2\ndelete_bonds all improper 1 undo",
        ),
        "read_restart": "read_restart b.restart\nfix move all nve\nthermo 2\nrun 5\nrun 4\n",
        "pair_style": deck(
            head="atom_style charge",
            before="group spare id 1 2\ndelete_atoms group spare\nset type 1 charge 0.5\nset type 2 charge -0.5\n"
            "pair_style hybrid/overlay dpd 1.0 1.0 341 coul/long/soft 1 0.3 1.4\npair_coeff * * dpd 25.0 4.5\n"
            "pair_coeff * * coul/long/soft 0.8\nkspace_style ewald 1e-3\nthermo_style custom step temp ecoul elong",
            between="kspace_style none\npair_style hybrid/overlay dpd 1.0 1.0 341 coul/cut/soft 2 0.3 1.4\npair_coeff * * dpd 25.0 4.5\n"
            "pair_coeff * * coul/cut/soft 0.8",
        ),
        "kspace_style": deck(
            head="atom_style charge",
            before="group spare id 1 2\ndelete_atoms group spare\nset type 1 charge 0.5\nset type 2 charge -0.5\n"
            "pair_style dpd/coul/slater/long 1.0 1.0 341 0.25 1.4\npair_coeff * * 25.0 4.5 yes\n"
            "kspace_style ewald 1e-3\nkspace_modify gewald 2.5\ndielectric 0.2",
        ),
    },
}

#: What there is of each kind; commands by the words that lines of all decks begin with.
TABLES: dict[str, set[str]] = {"compute": set(COMPUTES), "fix": set(FIXES), "dump": set(DUMPS), "layout": set(LAYOUTS)}
TABLES |= {"variable": set(VARIABLES), "command": set(COMMANDS)}

WORDS = {line.split()[0] for kind in SNIPPETS.values() for text in kind.values() for line in text.splitlines() if line}
