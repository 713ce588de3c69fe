"""fix addforce, fix setforce, fix wall/reflect and boundary f: what they mean, what is refused, and both beside a live LAMMPS."""

from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import cases, put

from openmm_dpd import BodyForce, DeckError, PositionForce
from openmm_dpd.lammps import RunOptions, read_deck, run_deck
from openmm_dpd.lammps.commands.output import data_file_lines
from openmm_dpd.lammps.run.runner import DeckRunner
from openmm_dpd.model.flow import SPECULAR, Wall

live = lammps_peer.needed()

#: A box that does not begin at 0, and beads of two types and masses that fill it; some of them a box away.
START = """units {units}
boundary {boundary}
region b block -3 4 -2 4 1 8 units box
create_box 2 b
create_atoms 1 random 90 4711 NULL
create_atoms 2 random 90 4712 NULL
mass 1 1
mass 2 2.5
velocity all create 1.0 87287
region low block INF INF INF INF INF 4.5 units box
group low region low
group two type 2
pair_style dpd 0.0 1.0 1
pair_coeff * * 25 4.5
comm_modify vel yes
timestep 0.01
"""


def deck(text: str, boundary: str = "p p p", units: str = "lj") -> str:
    return START.format(units=units, boundary=boundary) + text


def ours(tmp_path, text: str):
    (tmp_path / "in.deck").write_text(text)
    runner = DeckRunner(RunOptions(platform="Reference", threads=1, conservative="openmm"))
    return read_deck(tmp_path / "in.deck", run_callback=runner.carry_out, output=tmp_path), runner


def first_scene(tmp_path, text: str):
    return read_deck(put(tmp_path / "in.deck", text), stop_before_first_run=True).first_run.scene()


def error(tmp_path, text: str) -> str:
    with pytest.raises(DeckError) as caught:
        first_scene(tmp_path, text)
    return str(caught.value)


# -- what the fixes mean -------------------------------------------------------------------------------------------------------
def test_addforce_is_a_body_force_of_the_group(tmp_path):
    scene = first_scene(tmp_path, deck("fix 1 all nve\nfix 2 low addforce 0.1 -0.2 0\nfix 3 two addforce 0 0 0\nrun 1\n"))
    (term,) = scene.body_forces
    assert isinstance(term, BodyForce) and term.force.tolist() == [0.1, -0.2, 0]
    assert term.beads.tolist() == (scene.positions[:, 2] < 4.5).tolist()


def test_addforce_with_units(tmp_path):
    scene = first_scene(tmp_path, deck("fix 1 all nve\nfix 2 all addforce 1 0 0\nrun 1\n", units="real").replace(" 1.0 1\n", " 2.0 1\n"))
    assert scene.body_forces[0].force[0] == pytest.approx(41.84, rel=1e-6)  # kcal/mol/angstrom in kJ/mol/nm; LAMMPS's own constants


def test_addforce_of_a_variable_follows_the_position(tmp_path):
    text = 'variable h equal 4.5\nvariable f atom "0.1*(z<v_h)-0.1*(z>=v_h)"\nfix 1 all nve\nfix 2 all addforce v_f 0 v_h\nrun 1\n'
    (term,) = first_scene(tmp_path, deck(text)).body_forces
    assert isinstance(term, PositionForce) and term.beads.all() and term.corner.tolist() == [-3, -2, 1]


def test_addforce_of_the_mass_is_one_force_per_type(tmp_path):
    text = "variable g atom -0.3*mass\nfix 1 all nve\nfix 2 all addforce 0 0 v_g\nrun 1\n"
    assert len(first_scene(tmp_path, deck(text)).body_forces) == 2


def test_setforce_holds_beads_still(tmp_path):
    scene = first_scene(tmp_path, deck("velocity low set 0 0 0\nfix 1 all nve\nfix 2 low setforce 0 0 0\nrun 1\n"))
    assert scene.mobile.tolist() == (scene.positions[:, 2] >= 4.5).tolist()


def test_walls_at_the_faces(tmp_path):
    text = "fix 1 all nve\nfix 2 all wall/reflect zlo EDGE zhi 7.9 units box\nrun 1\n".replace("7.9", "8.0")
    scene = first_scene(tmp_path, deck(text, "p p f"))
    assert scene.walls == (Wall("z", 1.0, "above", SPECULAR), Wall("z", 8.0, "below", SPECULAR))
    assert scene.box[2, 2] == 14 and scene.box[0, 0] == 7  # empty room behind the walls


@pytest.mark.parametrize("wall", ["", "fix 2 all wall/reflect zhi EDGE\n", "fix 2 all wall/lj93 zhi EDGE 1 1 0.3\n"])
def test_open_ends_reflect_with_a_note(tmp_path, wall):
    state = read_deck(put(tmp_path / "in.deck", deck(f"fix 1 all nve\n{wall}run 1\n", "p p f")), stop_before_first_run=True)
    scene = state.first_run.scene()
    assert scene.walls[-2:] == (Wall("z", 1.0, "above", SPECULAR), Wall("z", 8.0, "below", SPECULAR)) or "reflect" in wall
    assert sorted(wall.position for wall in scene.walls) == [1.0, 8.0]
    reached = "zlo" if wall else "zlo or zhi"
    assert f"beads that reach {reached} are reflected" in " ".join(state.notes)


# -- what is refused -----------------------------------------------------------------------------------------------------------
NVE = "fix 1 all nve\n"
REFUSED = {
    "no variable": (NVE + "fix 2 all addforce v_f 0 0\n", "p p p", "no variable 'f'"),
    "setforce word": (NVE + "fix 2 all setforce null 0 0\n", "p p p", "a component of fix setforce"),
    "setforce vector": (
        NVE + "fix 2 all setforce 1 0 0\nthermo_style custom step f_2[4]\n",
        "p p p",
        "f_2[4] is out of range: fix setforce has a vector of 3",
    ),
    "setforce scalar": (NVE + "fix 2 all setforce 1 0 0\nthermo_style custom step f_2\n", "p p p", "f_2[1] to f_2[3]"),
    "setforce beside shardlow": (
        "pair_style dpd/fdt 1 1 1\npair_coeff * * 25 3\nfix 3 all shardlow\n" + NVE + "fix 2 low setforce NULL NULL 0\nrun 1\n",
        "p p p",
        "fix 2: fix shardlow moves beads regardless of their force",
    ),
    "setforce beside nph": ("fix 1 all nph iso 0 0 1\nfix 2 low setforce NULL NULL 0\nrun 1\n", "p p p", "fix 2: with fix nph"),
    "periodic wall": (NVE + "fix 2 all wall/reflect zlo EDGE\n", "p p p", "boundary p p f"),
    "moving wall": ("variable p equal 2\n" + NVE + "fix 2 all wall/reflect zlo v_p\n", "p p f", "moving walls are not supported"),
    "outside": (NVE + "fix 2 all wall/reflect zlo 0.5 units box\n", "p p f", "outside the box"),
    "open": (NVE + "fix 2 all wall/reflect zlo EDGE\nthermo_modify lost ignore\nrun 1\n", "p p f", "wall/reflect zhi EDGE"),
    "open 2": (
        NVE + "thermo_modify lost warn\nrun 1\n",
        "p f p",
        "lost warn: beads cannot be lost; add 'fix ID all wall/reflect ylo EDGE yhi EDGE'",
    ),
    "group": (NVE + "fix 2 low wall/reflect zlo EDGE zhi EDGE\nrun 1\n", "p p f", "are not in group low"),
    "beyond": (NVE + "fix 2 all wall/reflect zlo 4.5 zhi EDGE units box\nrun 1\n", "p p f", "beyond a wall"),
    "shrink": ("", "p p s", "boundaries must be periodic"),
}


@cases("text, boundary, message", REFUSED)
def test_refused(tmp_path, text, boundary, message):
    assert message in error(tmp_path, deck(text, boundary))


# -- beside LAMMPS -------------------------------------------------------------------------------------------------------------
#: Without friction, so that steps can be compared as well; the forces are large enough to be seen.
FORCES = {
    "constant": "fix 2 low addforce 0.7 -0.2 0.1\nfix 3 two addforce 0 0 1.5\n",
    "halves": 'variable f atom "(z<4.5)*2-1"\nfix 2 all addforce v_f 0 0\n',
    "sine": 'variable a equal 1.3\nvariable k equal 2*PI/lz\nvariable f atom "v_a*sin(v_k*(z-zlo))+cos(2*PI*x/lx)"\nfix 2 all addforce v_f 0.3 v_a\n',
    "functions": 'variable f atom "ternary(x>1,round(y)%2,1.5-abs(z-4)^0.5+x^2/10)"\nvariable g atom "(x<0&&y>=1)||!(z<=5)-floor(x)"\n'
    "fix 2 two addforce v_f v_g 0\n",
    "mass": "variable g atom -0.3*mass*type\nfix 2 all addforce 0 0 v_g\n",
    "setforce": "velocity low set 0 0 0\nfix 2 low setforce 0 0 0\n",
    "coasting": "fix 2 low setforce 0 0 0\n",
    "one component": "fix 2 all setforce NULL 0 NULL\n",
    "values": "fix 2 low setforce 1.5 NULL -0.25\nfix 3 two setforce NULL 2 0\n",
    "formula set": 'variable f atom "2*sin(2*PI*z/lz)+type"\nvariable e equal 3/4\nfix 2 low setforce v_f NULL v_e\n',
    "added before": "fix 2 all addforce 0.7 -0.2 0.1\nfix 3 two setforce NULL 0 0.5\n",
    "added after": "fix 2 two setforce NULL 0 0.5\nfix 3 all addforce 0.7 -0.2 0.1\n",
    "one after the other": "fix 2 all setforce 1 2 NULL\nfix 3 low addforce 0.5 0 0.5\nfix 4 two setforce NULL 0 NULL\nfix 5 two addforce 0 0 1\n",
    "pushed at rest": "velocity low set 0 0 0\nfix 2 low setforce 0 0 0\nfix 3 all addforce 0 0 1\n",
    "frozen": "velocity low set 0 0 0\nunfix 1\ngroup rest subtract all low\nfix 1 rest nve\nfix 2 low setforce 5 0 0\nfix 3 all addforce 1 1 1\n",
}

SET = [name for name, text in FORCES.items() if "setforce" in text]  # Those that set forces, and with them total forces before a fix.


def last_frame(path: Path, n: int) -> np.ndarray:
    """(n, 3) forces of the last frame of a dump."""
    return np.array([line.split()[1:] for line in path.read_text().splitlines()[-n:]], dtype=float)


def both(tmp_path, text: str, boundary: str = "p p p", gamma: str = "0", kept: str | None = None):
    """Positions, velocities and forces after the runs of a deck, here and in LAMMPS, in the order of the ids; ours of a file is kept."""
    text = deck(text, boundary).replace("25 4.5", f"25 {gamma}")
    if "mvv/dpd" in text:
        text = text.replace("units lj\n", "units lj\natom_style mdpd\n")
    if gamma != "0":
        text = text.replace("pair_style dpd 0.0", "pair_style dpd 1e-300")
    start = read_deck(put(tmp_path / "in.start", text.partition("run ")[0] + "run 0\n"), stop_before_first_run=True)
    (tmp_path / "data.start").write_text("\n".join(data_file_lines(start, pair=None)) + "\n")
    state, _ = ours(tmp_path, text)
    mine = last_frame(tmp_path / "forces", len(state.atoms))
    (tmp_path / "forces").unlink()
    if kept is not None:
        (tmp_path / kept).rename(tmp_path / f"{kept}.ours")
    with lammps_peer.instance() as lmp:
        lmp.command(f"shell cd {tmp_path}")
        for line in text.splitlines():
            word = line.split()[0]
            if word == "create_box":
                lmp.command("read_data data.start")
            elif word not in ("create_atoms", "velocity"):
                lmp.command(line)
        n = len(state.atoms)
        theirs = [np.array(lmp.gather_atoms(name, 1, 3)).reshape(n, 3) for name in ("x", "v")]
    return state, mine, last_frame(tmp_path / "forces", n), theirs


DUMP = "dump d all custom 1 forces id fx fy fz\ndump_modify d sort id format float %.15g\n"


@live
@pytest.mark.parametrize("name", FORCES)
def test_forces_of_the_first_configuration(tmp_path, name):
    _, mine, theirs, _ = both(tmp_path, "fix 1 all nve\n" + FORCES[name] + DUMP + "run 0\n")
    np.testing.assert_allclose(mine, theirs, rtol=1e-6, atol=1e-5)


@live
@pytest.mark.parametrize("name", ["constant", "sine", *SET])
def test_steps(tmp_path, name):
    """100 steps of velocity Verlet without friction."""
    state, _, _, (x, v) = both(tmp_path, "fix 1 all nve\n" + FORCES[name] + DUMP.replace(" 1 forces", " 100 forces") + "run 100\n")
    np.testing.assert_allclose(state.atoms.velocities, v, atol=2e-4)
    assert name != "setforce" or not state.atoms.velocities[state.group("low")].any()


def printed(path: Path) -> np.ndarray:
    """Rows that ``fix print`` has written."""
    return np.loadtxt(path, ndmin=2)


@live
@pytest.mark.parametrize("lam", ["nve", "mvv/dpd 0.65"])
@pytest.mark.parametrize("name", SET)
def test_forces_are_set_after_friction(tmp_path, name, lam):
    """Steps with friction: LAMMPS replaces the total force, friction included.  The vectors of the fixes are the forces before them."""
    vector = " ".join(f"f_{fix}[{k}]" for fix in range(2, 6) if f"fix {fix} " in FORCES[name] for k in (1, 2, 3))
    columns = " ".join(f"$({word}:%.15g)" for word in f"step press fmax fnorm {vector}".split())
    text = f"fix 1 all {lam}\n" + FORCES[name].replace("rest nve", f"rest {lam}") + DUMP.replace(" 1 forces", " 10 forces")
    text += f'thermo_style custom step temp press fmax fnorm {vector}\nfix p all print 5 "{columns}" file rows screen no\nrun 0\nrun 10\n'
    state, mine, theirs, (x, v) = both(tmp_path, text, gamma="4.5", kept="rows")
    np.testing.assert_allclose(mine, theirs, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(state.atoms.velocities, v, atol=1e-5)
    moved = state.box.unwrap(state.atoms.positions, state.atoms.images) - x
    np.testing.assert_allclose(moved - state.box.edges * np.round(moved / state.box.edges), 0, atol=1e-5)
    rows, expected = printed(tmp_path / "rows.ours"), printed(tmp_path / "rows")
    np.testing.assert_allclose(rows, expected, rtol=1e-5, atol=1e-3)


def test_schemes_with_pair_updates_are_refused(tmp_path):
    (tmp_path / "in.deck").write_text(deck("fix 1 all nve\nfix 2 low setforce NULL 0 1\nrun 2\n"))
    with pytest.raises(DeckError, match=r"in.deck:\d+: fix 2: .*scheme bababo does not apply friction as a force"):
        run_deck(tmp_path / "in.deck", RunOptions(platform="Reference", scheme="bababo"))


def test_averages_take_the_vector(tmp_path):
    text = "fix 1 all nve\nfix 2 low setforce NULL 0 1\nfix 3 all ave/time 1 2 2 f_2[1] f_2[2] f_2[3]\nthermo 1\nthermo_style custom step f_2[*]\nrun 2\n"
    state, runner = ours(tmp_path, deck(text).replace("25 4.5", "25 0"))
    (result,) = runner.results
    rows = np.array([result.rows[f"f_2[{k}]"] for k in (1, 2, 3)]).T * len(state.atoms)  # divided by the number of beads, as LAMMPS does
    np.testing.assert_allclose(state.fixes["3"].parameters["reader"].values, rows[1:].mean(axis=0), rtol=1e-6)
    assert np.abs(rows).min() > 1e-3


@live
@pytest.mark.parametrize("axes", ["p p f", "f p f"])
def test_steps_between_walls(tmp_path, axes):
    """Beads bounce at the faces as in LAMMPS, and do not see each other through them; pressure and box are the deck's."""
    faces = " ".join(f"{axis}lo EDGE {axis}hi EDGE" for axis, kind in zip("xyz", axes.split(), strict=True) if kind == "f")
    text = f"fix 1 all nve\nfix 2 all wall/reflect {faces}\n{DUMP.replace(' 1 forces', ' 100 forces')}thermo_style custom step pe press vol\nrun 100\n"
    state, mine, theirs, (x, v) = both(tmp_path, text, axes)
    np.testing.assert_allclose(state.atoms.positions, x, atol=2e-5)
    np.testing.assert_allclose(state.atoms.velocities, v, atol=2e-4)
    assert state.box.edges.tolist() == [7, 6, 7]
