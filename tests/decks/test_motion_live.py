"""Fixes that act within steps, beside a live LAMMPS: thermostats, friction, forces, walls; and that no fix is read without effect."""

from collections.abc import Iterator

import lammps_peer
import numpy as np
import pytest
from cases import put
from fuzz.deck import Deck
from fuzz.draw import Draw
from fuzz.trial import Trial
from test_commands_live import BEADS, FRAMES, RUN

from openmm_dpd.base.errors import DeckError, DPDError
from openmm_dpd.lammps import RunOptions, explain_deck, export_deck
from openmm_dpd.lammps.run.acting import FORCES
from openmm_dpd.lammps.state.box import Box
from openmm_dpd.lammps.state.records import ACTING_FIXES, COUPLED, FIX_VALUES, FORCE_FIXES, REACTING
from openmm_dpd.lammps.state.regions import parse_region

START = BEADS.replace("pair_coeff * * 25 0.5", "pair_coeff * * 25 4.5")
#: Beads some way from the faces, for walls all around.
WALLED = START.replace("atom_modify map yes\n", "atom_modify map yes\nboundary f f f\n").replace("-0.7 1.4 1", "0.7 1.9 1.5")
WALLED = WALLED.replace("pair_coeff * * 25 4.5", "pair_coeff * * 2.5 4.5")
OFF = "unfix 1\ngroup rest subtract all g\n"
MDPD = "pair_style hybrid/overlay mdpd/rhosum mdpd 0 1.2 3\npair_coeff * * mdpd/rhosum 0.9\npair_coeff * * mdpd -40 25 4.5 1.2 0.9\n"
SPHERE = "region s sphere 1 2.5 2.5 1.6 units box\n"


def words(name: str, *values: str) -> str:
    """Thermo output of a fix."""
    return f"thermo_style custom step temp pe etotal fmax fnorm press {' '.join(f'f_{name}{value}' for value in values)}\n{FRAMES}{RUN}"


def wall(style: str, *values: str) -> str:
    return f"fix w all wall/{style}\nfix_modify w energy yes\n" + words("w", "", "[1]", *values) + RUN


ALONE = ("", "[1]", "[2]", "[3]")
DECKS = {
    "nvt": f"{OFF}fix n all nvt temp 0.5 2 0.1\nthermo_style custom step temp pe ecouple econserve f_n f_n[1] f_n[5] f_n[7] f_n[12]\n{FRAMES}{RUN}{RUN}",
    "nvt of a group": f"{OFF}compute t g temp/partial 1 1 0\nfix m rest nve\nfix n g nvt temp 1 1 0.1 tchain 1 tloop 2 drag 0.3\n"
    "fix_modify n temp t\n" + words("n", *ALONE),
    **{
        f"npt {words_}": f"{OFF}fix n all npt temp {words_}\nthermo_style custom step temp pe press pxx pyy xlo xhi ly lz vol "
        f"{'' if 'iso' in words_.split() else 'f_n ecouple econserve'}\n{FRAMES}{RUN}{RUN}"
        for words_ in (
            "0.5 2 0.1 iso 0.2 0.8 1",
            "1 1 0.1 aniso 0.5 0.5 1.3 couple xy drag 0.3 tchain 1 pchain 2 ploop 2 tloop 2",
            "1 2 0.2 x 0.1 0.9 1 y 0.3 0.3 0.7 z 0.5 0.5 2 fixedpoint 0 1 2",
            "1 1 0.2 z 0.2 0.8 0.6 mtk no",
            "1 1 0.2 x 0.4 0.4 1 y 0.4 0.4 1 couple xy",
            "1 1 0.2 iso 0.5 0.5 1 dilate all nreset 0",
        )
    },
    "columns of a box that changes": f"{OFF}fix n all npt temp 1 1 0.1 iso 0.5 0.5 1\nthermo_style one\n{FRAMES}{RUN}thermo_style yaml\n{RUN}",
    "npt, adapt": "pair_style soft 1.2\npair_coeff * * 40\nvariable x equal 0.7+0.02*step\nfix a all adapt 2 pair soft a * * v_x scale yes\n"
    f"{OFF}fix n all npt temp 1 1 0.1 iso 0.2 0.8 1\nthermo_style custom step temp pe press lx vol\n{FRAMES}{RUN}{RUN}",
    **{
        f"nph {words_}": f"{MDPD}{OFF}fix n all nph {words_}\nthermo_style custom step temp pe press pxx xlo xhi ly vol\n{FRAMES}{RUN}{RUN}"
        for words_ in ("iso 0.2 0.8 1", "x 0.1 0.9 1 z 0.5 0.5 2 pchain 2 ploop 2 drag 0.3 fixedpoint 0 1 2")
    },
    "nvt, lj": f"pair_style lj/cut 1.2\npair_coeff * * 1 0.5\n{OFF}fix n all nvt temp 0.5 2 0.1\n" + words("n", *ALONE),
    "temp/rescale": "fix t g temp/rescale 1 0.5 1 0.01 0.6\n" + words("t", "") + RUN,
    "temp/berendsen": "fix t all temp/berendsen 0.5 1 0.2\nthermo_style custom step temp ecouple econserve\n" + FRAMES + RUN,
    "nve/limit": f"{OFF}fix l all nve/limit 0.012\n" + words("l", "") + RUN,
    "langevin": "fix l g langevin 0 0 0.3 77 scale 2 1.5 tally yes zero yes\n" + words("l", "") + RUN,
    "viscous": f"fix l g viscous 0.7 scale 2 1.5\n{FRAMES}{RUN}",
    "predicted": f"{OFF}fix 1 all mvv/dpd 0.65\nfix l g viscous 0.7\nfix s all spring/self 3\n" + words("s", ""),
    "addforce region": f"{SPHERE}fix a g addforce 1 NULL -2 region s\n".replace("NULL", "0") + words("a", *ALONE),
    "addforce v": "variable p equal 2*sin(step*0.3)\nvariable q atom vx*2+x\nvariable e atom vy\nfix a g addforce v_p v_q 0 energy v_e\n"
    "fix_modify a energy yes\n" + words("a", *ALONE),
    "addforce every": f"fix a g addforce 3 2 1 every 3\n{FRAMES}{RUN}",
    "setforce region": f"{SPHERE}fix a all setforce 0 NULL 0.5 region s\n" + words("a", *ALONE[1:]),
    **{
        f"move {way}": f"{OFF}fix 1 g nve\nfix l rest move {way} units box\n{FRAMES}{RUN}{RUN}"
        for way in (
            "linear 3.5 -2 1.5",
            "linear 3.5 NULL -1.5",
            "wiggle 0.3 NULL -0.2 0.13",
            "rotate 1 2 2 1 2 -1 0.31",
            "transrot 2 -3 1 1 2 2 1 2 -1 0.31",
        )
    },
    "move variable": "variable x equal 2*swiggle(0,0.3,0.2)\nvariable v equal 2*cwiggle(0,0.3,0.2)\nvariable u atom 0.2*x+0.1*vx\n"
    f"{OFF}fix 1 g nve\nfix l rest move variable v_x NULL v_x v_v v_u NULL\n{FRAMES}{RUN}{RUN}",
    "move predicted": f"{OFF}fix 1 g mvv/dpd 0.65\nfix l rest move linear 3.5 NULL -1.5\n{FRAMES}{RUN}",
    **{
        f"adapt {style} {adapted[0][1]}": f"pair_style {style} {settings}\npair_coeff * * {values}\npair_coeff 1 2 {values}\n"
        "variable x equal 0.7+0.02*step\nvariable y equal ramp(1.2,0.9)\n"
        + "".join(f"fix {name} all adapt {n} pair {style} {name} {types} {more}\n" for name, types, n, more in adapted)
        + f"{words('1').replace('f_1', 'evdwl')}{RUN}"
        for style, settings, values, *adapted in (
            ("soft", "1.2", "40", ("a", "* *", 1, "v_x scale yes")),
            ("soft", "1.2", "40", ("a", "1 1*2", 0, "v_x reset yes")),
            ("gauss", "1.2", "-9 2", ("a", "2 2", 3, "v_x")),
            ("yukawa", "2 1.2", "9", ("alpha", "1 2", 1, "v_y scale yes reset yes")),
            ("buck", "1.2", "50 0.3 0.001", ("a", "* *", 4, "v_x scale yes"), ("c", "1 1", 1, "v_x scale yes")),
            ("lj/cut", "1.2", "1 0.5", ("epsilon", "1 *", 2, "v_x"), ("sigma", "2 2", 3, "v_y scale yes reset yes")),
            ("lj/class2", "1.2", "1 0.5", ("epsilon", "* *", 2, "v_x")),
            ("morse", "1.2", "3 2 0.7", ("d0", "* *", 1, "v_x"), ("alpha", "1 2", 1, "v_y"), ("r0", "1 1", 2, "v_x")),
            ("morse/smooth/linear", "1.2", "3 2 0.7", ("d0", "* *", 1, "v_x")),
            ("mie/cut", "1.2", "1 0.5 9 4", ("epsilon", "* *", 1, "v_x"), ("gamR", "1 2", 1, "v_y scale yes")),
        )
    },
    "adapt, overlaid": "variable x equal ramp(0,30)\npair_style hybrid/overlay dpd 0 1.2 3 soft 1.2 soft 0.9\n"
    "pair_coeff * * dpd 0 4.5\npair_coeff * * soft 1 1\npair_coeff * * soft 2 30\nneigh_modify exclude type 1 2\n"
    f"fix a all adapt 2 pair soft:2 a * * v_x pair soft:1 a * * v_x reset yes\n{words('1').replace('f_1', 'evdwl')}{RUN}",
    "friction overlaid on excluded pairs": "pair_style hybrid/overlay soft 1.2 dpd/tstat 0 0 1.2 3\npair_coeff 1 * soft 9\n"
    "pair_coeff 1 1 dpd/tstat 4.5\npair_coeff 2 2 dpd/tstat 4.5\nneigh_modify exclude type 1 1 exclude type 2 2\n"
    + words("1").replace("f_1", "evdwl")
    + RUN,
    "aveforce": f"{SPHERE}fix d g gravity 0.5 chute 30\nfix a g aveforce 1 NULL -2\nfix b all aveforce 0 0 0 region s\n"
    + words("a", *ALONE[1:]),
    "efield": "set group g charge 1.5\nset group rest charge -0.5\nvariable q equal step\nfix a all efield 0.2 v_q -0.3\n"
    + words("a", *ALONE[1:]),
    "spring": "fix a g spring tether 50 1 NULL 2 0.1\nfix b g spring couple rest 5 0.2 0.3 1 0.5\nfix_modify a energy yes\n"
    + words("a", *ALONE, "[4]").replace("f_a ", "f_a f_b f_b[2] f_b[4] "),
    "spring/self": "fix a g spring/self 50\nfix b rest spring/self 20 xz\nfix_modify b energy yes\n" + words("a", "") + RUN,
    "lj93": wall("lj93 zlo -0.2 1.0 0.7 1.5 zhi EDGE 0.6 0.5 1.5 units box", "[2]"),
    "lj126": wall("lj126 zlo EDGE 1.0 0.7 1.5 xhi 3.33 0.6 0.5 1.5 yhi 4.6 1 0.6 2", "[3]"),
    "lj1043": wall("lj1043 xlo -1.17 1.0 0.3 1.5 zhi EDGE 0.6 0.5 1.5", "[2]"),
    "harmonic": "variable m equal 0.1+0.01*step\nvariable e equal 5+step\n" + wall("harmonic zlo v_m v_e 1.0 1.5 zhi 4.9 9 1 1.5", "[2]"),
    "morse": wall("morse zlo EDGE 1.0 1.3 0.7 1.5 yhi EDGE 2 3 0.5 1.5", "[2]"),
}
FLAT = "\n".join(line.rsplit(" ", 3)[0] + " 0 units box" if "single" in line else line for line in START.splitlines()) + "\n"
FLAT = FLAT.replace("velocity all ramp vz 0.3 1 x -1 3 units box\n", "").replace(
    "box\nvelocity all ramp vy 0.3 1.7 z 0 5", "box\nvelocity all ramp vy 0.3 1.7 x -1 3"
)
DECKS["two dimensions"] = f"{OFF}fix n all nvt temp 0.5 2 0.1\nfix l g viscous 0.5\nfix s g spring/self 3\nfix e all enforce2d\n" + words(
    "n", *ALONE
)
REGIONS = {
    "block": "block -1.2 3.1 -0.1 4.2 -0.2 5.3",
    "sphere": "sphere 1 2.3 2.3 4",
    "cylinder": "cylinder z 1 2.2 3 -0.3 5.2",
    "block, outside": "block 1.1 1.2 1.4 1.5 1.9 2.0 side out",
    "sphere, outside": "sphere 1.1 1.4 2 0.1 side out",
    "cylinder, outside": "cylinder x 1.4 2 0.1 1 1.3 side out",
    "cone": "cone z 1 2 3.4 2.9 -0.4 5.3",
    "cone, outside": "cone x 1.4 2 0.15 0.05 1 1.3 side out",
    "plane": "plane 1 2 -1.2 -0.2 0.3 1",
    "plane, outside": "plane 1 2 6.2 -0.2 0.3 1 side out",
    "prism": "prism -1.3 3 0.1 4.3 -0.4 5.2 -0.3 0.4 -0.5",
    "prism, outside": "prism 1.1 1.2 1.4 1.5 1.9 2.1 0.05 -0.04 0.03 side out",
}
PARTS = "region one {} units box\nregion two {} units box\n"
JOINED = {
    "union": ("block -1.2 1.8 -0.1 4.2 -0.2 5.3", "block 1.2 3.1 -0.2 4.1 -0.1 5.4", "union 2 one two"),
    "outsides": ("sphere 1.1 1.4 2 0.1 side out", "block 1.15 1.3 1.4 1.5 1.9 2.0 side out", "intersect 2 one two"),
    "intersect": ("sphere 1 2.3 2.3 4", "plane 1 2 -1.2 -0.2 0.3 1", "intersect 2 one two"),
    "one part twice": ("block -1.2 3.1 -0.1 4.2 -0.2 5.3", "sphere 1 2.3 2.3 4", "union 2 one one"),
    "intersect, outside": ("sphere 1.1 1.4 2 0.1", "cylinder x 1.4 2 0.05 0 2", "intersect 2 one two side out"),
}
DECKS |= {
    f"wall/region {name}": PARTS.format(a, b) + f"region w {both}\n" + wall("region w harmonic 9 1 1.5", "[3]")
    for name, (a, b, both) in JOINED.items()
}
STYLES = ("lj93 1 0.5 1.2", "harmonic 7 1 1.6", "morse 2 1.5 0.6 1.4", "lj126 1 0.4 1.2", "lj1043 1 0.3 1.2", "harmonic 9 1 1.5")
STYLES += ("harmonic 8 1 1.5", "lj93 1 0.4 1.2", "harmonic 5 1 1.7", "morse 2 1.5 0.6 1.4", "harmonic 8 1 1.2", "morse 2 1.5 0.6 1.6")
DECKS |= {
    f"wall/region {name}": f"region w {region} units box\n" + wall(f"region w {style}", "[3]")
    for (name, region), style in zip(REGIONS.items(), STYLES, strict=True)
}
#: LAMMPS (22 July 2025) has their energies, but other forces.
ELLIPSOIDS = {"": "2 2 2 5.5 5 4.5", ", outside": "1.3 1.3 1.3 0.3 0.2 0.1 side out"}
DECKS |= {
    f"wall/region ellipsoid{side}": f"region w ellipsoid {region} units box\nfix w all wall/region w harmonic 9 1 4\nthermo_style custom step "
    "f_w\nrun 0\n"
    for side, region in ELLIPSOIDS.items()
}


@pytest.fixture(scope="module")
def trial(tmp_path_factory) -> Iterator[Trial]:
    lammps_peer.need()
    with Trial(tmp_path_factory.mktemp("motion")) as found:
        yield found


@pytest.mark.parametrize("name", DECKS)
def test_both_programs_write_the_same(trial, name):
    deck, body = Deck(Draw(1)), DECKS[name]
    walls = "fix w all wall/" in body
    units = "real" if name in ("langevin", "efield") else "lj"
    flat = name == "two dimensions"
    start = (WALLED if walls else FLAT if flat else START).format(
        units=units, box="block -1 3 0 4 -0.5 0.5" if flat else "block -1 3 0 4 0 5"
    )
    start = start.replace("atom_modify", "dimension 2\natom_modify") if flat else start
    style = {"efield": "charge"}.get(name, "mdpd" if "predicted" in name or "mdpd" in body else "atomic")
    start = start.replace("atom_modify", f"atom_style {style}\natom_modify")
    if "rest" in body and OFF not in body:
        body = OFF.replace("unfix 1\n", "") + body
    if walls:  # no bead gets as far as this one, without which LAMMPS would lose those that do
        body = "fix r all wall/reflect xlo EDGE xhi EDGE ylo EDGE yhi EDGE zlo EDGE zhi EDGE\n" + body
    deck.lines[:] = (start + body).splitlines()
    outcome = trial.of_deck(0, "commands", deck)
    assert outcome.kind == "agree", outcome.message


def test_the_outside_of_a_union_is_the_intersection_of_the_outsides():
    """In LAMMPS (22 July 2025) all distances from the outside of a union are 0."""
    box, known, x = Box(np.zeros(3), np.full(3, 5.0), np.zeros(3)), {}, np.random.default_rng(1).normal(size=(50, 3)) + [1.5, 1.5, 2]
    for name, words in (("a", "sphere 1 1 2 1"), ("b", "block 1 2 1 2 1.5 2.5")):
        for side in ("in", "out"):
            known[name + side] = parse_region(f"{words} side {side} units box".split(), np.ones(3), box, known, float)
    pair = (parse_region(words.split(), np.ones(3), box, known, float) for words in ("union 2 ain bin side out", "intersect 2 aout bout"))
    (found, expected), inside = ([np.column_stack(each) for each in region.distances(x)] for region in pair), known["ain"].contains(x)
    assert np.isfinite(found[0]).any() and not np.isfinite(found[0][inside, 0]).any()
    assert all(np.array_equal(*each) for each in zip(found, expected, strict=True))


@pytest.mark.parametrize("words", ["ellipsoid 1 0.5 0 3 1.5 2", "prism -1 3 0 4 0 5 1.3 -0.7 0.9"])
def test_forces_of_walls_are_those_of_the_nearest_points(words):
    """Directions are the gradients of distances, which are 0 where a bead is put back by them; and of an ellipsoid LAMMPS has no right ones."""
    region, x = parse_region(words.split(), np.ones(3), None, {}, float), np.random.default_rng(1).uniform(-5, 6, (300, 3))
    x[:3] = [[1.7, 0.5, 0], [1.0, 0.7, 0.0], [1.2, 1.0, 1.1]]
    for sees, its in ((region.distances, region.contains(x)), (region.outer, ~region.contains(x))):
        sides = [np.array([side[0] for side in sees(x[its] + move)]) for move in 1e-5 * np.concatenate([np.eye(3), -np.eye(3)])]
        for k, (r, normal) in enumerate(sees(x[its])):
            slopes = np.array([(sides[axis][k] - sides[axis + 3][k]) / 2e-5 for axis in range(3)]).T
            assert np.allclose(slopes[3 * its[0] :], normal[3 * its[0] :], rtol=0, atol=1e-6)
            feet = x[its] - r[:, None] * normal
            assert its.any() and np.all(r >= 0) and np.allclose(np.linalg.norm(normal, axis=1), 1)
            if "ellipsoid" in words:
                assert np.allclose(np.sum(((feet - [1, 0.5, 0]) / [3, 1.5, 2]) ** 2, axis=1), 1, rtol=1e-12)
                around = np.random.default_rng(2).normal(size=(3000, 3))
                around = [1, 0.5, 0] + [3, 1.5, 2] * around / np.linalg.norm(around, axis=1)[:, None]
                assert np.all(r <= np.linalg.norm(x[its, None] - around, axis=2).min(axis=1))


def test_tables_agree():
    assert set(FORCES) == {*FORCE_FIXES, *ACTING_FIXES}
    assert set(FIX_VALUES) <= {*FORCES, *COUPLED, *REACTING, "nve/limit"}


def test_what_npt_conserves_is_conserved(tmp_path):
    """Under one factor for all edges, where LAMMPS's f_id counts two degrees of freedom too many (it rises by 0.1 per bead here)."""
    text = "units lj\nlattice fcc 0.9\nregion b block 0 3 0 3 0 3\ncreate_box 1 b\ncreate_atoms 1 box\nmass 1 1\nvelocity all create 1 33\n"
    text += "pair_style lj/cut 1.9\npair_coeff * * 1 1\npair_modify shift yes\nfix n all npt temp 1 1 0.2 iso 5 5 0.5\ntimestep 0.002\n"
    lines = lammps_peer.printed(tmp_path / "in.deck", text + "thermo_style custom step econserve vol\nthermo 200\nrun 1000\n")
    rows = np.array([line.split() for line in lines if line.split()[0].isdigit()], dtype=float)
    assert np.ptp(rows[:, 1]) < 1e-3 and np.ptp(rows[:, 2]) > 5


def test_adapted_dpd_has_the_bits_of_its_coefficients(tmp_path):
    """LAMMPS adapts other styles alone."""
    start, rows = START.format(units="lj", box="block -1 3 0 4 0 5").replace("dpd 0.0", "dpd 1.5"), []
    adapt = "variable a equal 30\nvariable b equal 2\nfix l all adapt 3 pair dpd a0 * * v_a pair dpd gamma 1 2 v_b\n"
    for more in ("pair_coeff * * 30 4.5\npair_coeff 1 2 30 2\n", "pair_coeff * * 0 4.5\npair_coeff 1 2 7 9\n" + adapt):
        text = start.replace("pair_coeff * * 25 4.5\n", more)
        rows.append(
            [line for line in lammps_peer.printed(tmp_path / "in.deck", text + words("1").replace("f_1", "")) if line.split()[0].isdigit()]
        )
    assert rows[0] == rows[1] and len(rows[0]) == 2


def _explained(tmp_path, before: str, **options) -> str:
    start = START.format(units="lj", box="block -1 3 0 4 0 5")
    start = start.replace("atom_modify", "atom_style mdpd\natom_modify") if "mdpd" in before else start
    return explain_deck(put(tmp_path / "in.deck", start + before + "run 1\n"), RunOptions(**options))


def test_what_acts_within_steps_is_said_and_not_exported(tmp_path):
    text = f"{OFF}fix 1 all nvt temp 1 1 0.1\nfix s all spring/self 1\n"
    assert "within each step, in Python: fixes nvt, spring/self" in _explained(tmp_path, text)
    with pytest.raises(DPDError, match="fix 1 .nvt., fix s .spring/self.: .*cannot be exported"):
        export_deck(tmp_path / "in.deck", tmp_path / "out")


WRONG = {
    "fix l all langevin 1 1 1 7 gjf yes": "gjf yes is not supported",
    "fix l all wall/lj93 zlo EDGE 1 1 1": "the box is periodic along z",
    "fix l all temp/rescale 1 1 1 0 2": "fraction must be at most 1",
    "fix l all nvt temp 0 1 1": "must be above 0",
    "fix l all efield 1 1 1": "needs atom_style charge or full",
    "fix l all spring tether 1 0 0 0": "needs 5|expected",
    "fix l all viscous 1\nfix_modify l energy yes": "has no energy here",
    "fix l all viscous 1\nfix_modify l virial yes": "virial yes is not supported",
    "fix l all adapt 1 pair dpd/ext a0 * * v_x": "a pair style of fix adapt",
    "fix l all adapt 1 kspace v_x": "only pair coefficients can change during a run",
    "variable x equal 1\nfix l all adapt 1 pair soft a * * v_x": "the deck has 0 pair styles soft",
    "variable x atom 1\nfix l all adapt 1 pair dpd a0 * * v_x": "expected an equal-style variable",
    "unfix 1\nfix l all move rotate 0 0 0 0 0 0 1": "the axis of rotation is zero",
    "unfix 1\nfix l all move variable 1 NULL NULL NULL NULL NULL": "a variable of fix move",
    "unfix 1\nfix l all move linear 1 0 0\ntimestep 0.02": "timestep is not possible while fix l .move.",
    "fix l all move linear 1 0 0": "is moved by fix 1 already",
    "unfix 1\nfix l all move linear 1 0 0\ncreate_atoms 1 single 2 2 2\ngroup g id 1:11\nfix l g move linear 1 0 0\n"
    "create_atoms 1 single 2 2 4\ngroup g type 1": "has beads that were made later",
    "unfix 1\nfix 2 g nve\ngroup rest subtract all g\nfix l rest move linear 1 0 0\nfix 2 g npt temp 1 1 1 iso 1 1 1": "style nve; unfix",
    "unfix 1\nfix l all npt temp 1 1 1 iso 1 1 1 nreset 5": "nreset 5 is not supported",
    "unfix 1\nfix l g npt temp 1 1 1 iso 1 1 1": "needs the group all",
    **{
        f"unfix 1\n{MDPD}{more}": message
        for more, message in {
            "fix l g nph iso 1 1 1": "needs all beads",
            "fix l all nph iso 1 1 1 ptemp 2": "ptemp of fix nph is not",
        }.items()
    },
    "variable v equal c_x\nfix l g addforce v_v 0 0": "there is no compute 'x'",
}


@pytest.mark.parametrize("lines", WRONG)
def test_what_is_refused(tmp_path, lines):
    with pytest.raises(DeckError, match=WRONG[lines]):
        _explained(tmp_path, lines + "\n")


def test_a_word_has_no_sum_of_all_forces(tmp_path):
    with pytest.raises(DeckError, match="fix l: it acts on the sum of all forces"):
        _explained(tmp_path, "fix l all viscous 1\n", scheme="middle")
