"""Beads on faces, ids, groups and counts, where one bit or one rule decides: every number is LAMMPS's, live, to the last bit."""

import lammps_peer
import numpy as np
import pytest
from cases import cases, raises
from lammps_peer import ours, same_beads, theirs

from openmm_dpd.base.errors import DeckError

pytestmark = lammps_peer.needed()

FINISH = "\npair_style zero 1.0\npair_coeff * *\nmass * 1.0\nrun 0\n"
THREE = "region b block 0 4 0 4 0 4\ncreate_box 2 b\ncreate_atoms 1 single 1 1 1\ncreate_atoms 2 single 3 3 3\n"
THREE += "create_atoms 2 single 3 1 3\nmass * 1.0\n"
ROW = "region b block 0 8 0 8 0 8\ncreate_box 2 b\n" + "".join(f"create_atoms {1 + k % 2} single {k + 0.5} 1 1\n" for k in range(8))

DECKS = {
    "a region up to the edge, real": "units real\nlattice sc 3.3\nregion box block 1 9 0 6 0 6\ncreate_box 1 box\n"
    "region half block EDGE 5.25 INF INF INF INF\ncreate_atoms 1 region half\n",
    "beads on a face, real": """units real
lattice sc 1.1
region box block 0 8 0 8 0 8
create_box 2 box
create_atoms 1 box
region r block 3 6 INF INF INF INF
region s sphere 3 3 3 2
region c cylinder y 3 3 2 EDGE 5
region o block 2 5 3 6 1 7 side out
group r region r
group s region s
group c region c
group o region o
mass * 1.0
set region r type 2
velocity r set 0.1 0 0.3
""",
    "beads on faces, metal, deleted": """units metal
lattice fcc 3.615 origin 0.3 0.3 0.3
region box block -2.1 3 0 4 0 3
create_box 1 box
create_atoms 1 box
region hole block 0.3 1.3 INF INF 0.8 1.8
delete_atoms region hole
region rest block INF 0.3 0.8 INF INF INF
group rest region rest
""",
    "a region up to the edge of a tilted box": """lattice sc 1.0 origin 0.1 0.1 0.1
region box prism 0 6 0 6 0 6 2 0 0
create_box 1 box
region r block INF EDGE INF INF INF INF
create_atoms 1 region r
region t block EDGE 1.1 EDGE 4.1 1.1 EDGE
group t region t
""",
    "lattices on faces of a tilted box, real": "units real\nlattice bcc 2.7\nregion box prism 0 6 0 5 0 4 1.5 -0.5 1\ncreate_box 1 box\ncreate_atoms 1 box\n"
    "region p prism 1 4 1 3 1 3 0.5 0 0.5\ngroup p region p\n",
    "set beyond the box": THREE
    + "set type 1 z 5.0\nset type 1 z 6.5\nvelocity all ramp vx 0 8 z 0 8\ngroup beyond region b\nset atom 2 image 3 NULL -1\n"
    "set atom 2 y -0.5\n",
    "set beyond a tilted box": THREE.replace("block 0 4 0 4 0 4", "prism 0 4 0 4 0 4 0.7 0 -0.3") + "set type 2 x -1.3\nset atom 1 y 4.6\n",
    "two runs": THREE + FINISH + "set atom 1 x 4.4\nset atom 2 z -1e-17\nregion low block INF INF INF INF INF 0\ngroup low region low\n",
    "two runs in a tilted box": "units real\nlattice fcc 3.3\nregion box prism 0 4 0 4 0 4 0.9 0.3 -0.7\ncreate_box 2 box\n"
    "create_atoms 1 box\n" + FINISH + "region r block 1 2.5 1 2.5 1 2.5\ngroup r region r\n",
    "tilted boxes that are not sorted": "atom_modify sort 0 0\nlattice sc 1\nregion b prism 0 4 0 4 0 4 0.9 0.3 -0.7\ncreate_box 2 b\ncreate_atoms 1 box\n",
    "ids in storage order": ROW
    + "group d id 2 5 8\ndelete_atoms group d\ngroup three id 3\ncreate_atoms 1 single 7 7 7\ngroup f id 1 6\ndelete_atoms group f\ngroup last id 4\n",
    "ids that are kept": ROW
    + "group d id 2 5\ndelete_atoms group d compress no\ncreate_atoms 1 single 7 7 7\ngroup e id 3\ndelete_atoms group e\n",
    "ids of molecules": "atom_style bond\n" + ROW + "group d id 2 5\ndelete_atoms group d\ngroup three id 3\nset atom 3 vx 1.0\n",
    "subtract": ROW
    + "group g id 1 2 3\ngroup h id 1 5\ngroup g subtract all h\ngroup k subtract all k\ngroup h subtract all g h\ngroup m union g h\ngroup m subtract all g\n",
    "regions": """region b block 0 10 0 10 0 10 units box
create_box 1 b
lattice sc 1.0
create_atoms 1 box
region s sphere 5 5 5 2
region o sphere 5 5 5 2 side out
region c cylinder z 2 2 1.5 INF 4
region e block EDGE 1 INF INF 9 EDGE
region u union 2 s c
region i intersect 2 s e
"""
    + "".join(f"group {name} region {name}\n" for name in "soceui"),
    "ellipsoids and prisms": """region b block 0 10 0 10 0 10 units box
create_box 1 b
lattice fcc 1.3
region e ellipsoid 3 3 3 2 1.5 1
region p prism 0 4 1 4 2 5 1 -0.5 0.5
region u intersect 2 e p
region n ellipsoid 3.1 2.2 3 0.9 1.5 1.3 side out
create_atoms 1 region e
create_atoms 1 region p
delete_atoms region u
"""
    + "".join(f"group {name} region {name}\n" for name in "epn"),
    "groups": """lattice sc 0.125
region b block 0 5 0 2 0 2
create_box 3 b
create_atoms 1 box
set atom 11*20 type 2
group light type 1
group some id 1:3 7 10:20:4
group late id > 17
group mid id <> 4 6
group both union some mid
group rest subtract light some mid
group cut intersect light both
group light id 20
group none empty
create_atoms 3 single 1 1.5 1.2
create_atoms 3 single 1 1.5 3 units box
create_atoms 3 single 15 0 0 units box
group third type 3
delete_atoms group mid compress no
""",
    "basis and subset": "lattice bcc 1.0\nregion b block 0 5 0 5 0 5\ncreate_box 2 b\ncreate_atoms 1 box basis 2 2\n",
    "spacings": "lattice custom 1.7 a1 1 0.2 0 a2 0 1.5 0.1 a3 0.3 0 2 basis 0 0 0 basis 0.5 0.5 0.25 origin 0.1 0.7 0 orient x 1 1 0 orient y -1 1 0 orient z 0 0 1\n"
    "region b block -1 4 0 3 0 5\ncreate_box 2 b\ncreate_atoms 1 box basis 2 2\nregion s sphere 1 1 1 1.2\ngroup s region s\n",
}


@pytest.mark.parametrize("name", DECKS)
def test_beads_and_groups(tmp_path, name):
    same_beads(tmp_path, DECKS[name] + FINISH)


@pytest.mark.parametrize("seed", range(6))
def test_random_regions_on_random_lattices(tmp_path, seed):
    """Faces of regions at lattice points, in boxes that begin and end at odd numbers."""
    rng = np.random.default_rng(seed)
    style, constant = rng.choice(["sc", "bcc", "fcc", "hcp", "diamond"]), rng.choice([0.7, 1.1, 3.3, 3.615])
    units = ("lj", "real", "metal")[seed % 3]
    low, high = rng.choice([-1.7, -1, 0, 0.3], 3), rng.choice([3, 4.1, 5, 3.3], 3)
    edges = " ".join(f"{a:g} {b:g}" for a, b in zip(low, high, strict=True))
    lines = [f"units {units}", f"lattice {style} {constant} origin {rng.choice([0, 0.1, 0.25])} 0 0.5"]
    lines += [f"region b {'prism ' + edges + ' 0.7 -0.3 0.4' if seed % 2 else 'block ' + edges}", "create_box 1 b", "create_atoms 1 box"]
    for k in range(8):
        a, b = rng.integers(-2, 4, 3) / 2, rng.integers(0, 8, 3) / 2
        centre, radius = rng.integers(-1, 6, 3) / 2, rng.integers(1, 5) / 2
        place = " ".join(f"{value:g}" for value in centre)
        pairs = " ".join(f"{x:g} {x + y:g}" for x, y in zip(a, b, strict=True))
        cylinder = f"cylinder {'xyz'[k % 3]} {' '.join(place.split()[:2])} {radius:g} EDGE 1.5"
        text = (f"block {pairs}", f"sphere {place} {radius:g}", cylinder)
        lines += [f"region r{k} {text[k % 3]}", f"group g{k} region r{k}"]
    same_beads(tmp_path, "\n".join(lines) + FINISH)


@pytest.mark.parametrize("tilt", ["", " 0.9 -0.4 0.3"])
def test_a_data_file_whose_beads_are_far_away_and_in_no_order(tmp_path, tilt):
    rng = np.random.default_rng(5)
    x, ids = rng.uniform(-20, 30, (60, 3)), rng.permutation(60) + 3
    x[:3] = [[-1.0, 0.3, 2.0], [4.1, 5.7, 9.0], [-1.0 - 1e-16, 0.3, 2.0]]
    rows = "".join(f"{i} 1 {' '.join(repr(float(value)) for value in row)}\n" for i, row in zip(ids, x, strict=True))
    header = f"title\n\n60 atoms\n1 atom types\n\n-1 4.1 xlo xhi\n0.3 5.7 ylo yhi\n2 9 zlo zhi\n{tilt}{' xy xz yz' * bool(tilt)}\n"
    (tmp_path / "data").write_text(header + "\nAtoms # atomic\n\n" + rows)
    text = "read_data data\nregion r block 0 2 1 3 2 5\ngroup r region r\nregion e block EDGE EDGE 1 EDGE EDGE EDGE\ngroup e region e\n"
    # new ids go by the order of the file
    same_beads(tmp_path, text + "group some id 5:20\ndelete_atoms group some\ngroup few id 1:10\n" + FINISH)


@pytest.mark.parametrize(("place", "lost"), [("7.99", False), ("8.0", True), ("-4.0", False), ("-4.1", True)])
def test_a_bead_that_lammps_loses_is_an_error(tmp_path, place, lost):
    text = THREE + f"set type 1 z {place}\n" + FINISH
    if not lost:
        same_beads(tmp_path, text)
        return
    raises(Exception, "Lost atoms", lambda: theirs(tmp_path, text))
    lost = f"in.ours:12: run: bead 1 lies at 1 1 {float(place):g}, so far outside the box that LAMMPS would lose it"
    raises(DeckError, lost, lambda: ours(tmp_path, text))


def test_ids_are_kept_after_a_run(tmp_path):
    same_beads(tmp_path, ROW + FINISH + "group d id 2\ndelete_atoms group d compress no\nrun 0\n")


@cases(
    "prepare, count",
    ("create_atoms 1 box ratio 0.77 5", "all"),
    ("create_atoms 1 box ratio 0.5 5", "all"),
    ("create_atoms 1 box\nset type 1 type/ratio 2 0.35 77", "t"),
    ("create_atoms 1 region c\nset group all type/ratio 2 0.5 7", "t"),
    ("create_atoms 1 box\nset type 1 type/ratio 2 0.999 77", "t"),
)
def test_fractions_of_beads(tmp_path, prepare, count):
    text = f"lattice sc 1.0\nregion b block 0 3 0 3 0 3\ncreate_box 2 b\nregion c block 0 2 0 2 0 1\n{prepare}\ngroup t type 2\n{FINISH}"
    _, groups = theirs(tmp_path, text)
    assert int(ours(tmp_path, text).group(count).sum()) == groups[count] > 0
