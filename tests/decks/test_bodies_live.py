"""Decks with rigid bodies beside a live LAMMPS, without noise, and what decks with bodies are refused."""

from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import cases, put
from lammps_peer import theirs

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, run_deck

EDGE, FREE = 5.0, 260


def data_file() -> str:
    """Lumps of five beads, rods of three and pairs, of unequal masses, one after the other, wherever the faces of the box are; then free beads."""
    rng, rows, molecule = np.random.default_rng(4), [], 0
    for beads in (5, 5, 3, 2, 5, 3, 2):
        molecule += 1
        places = rng.normal(size=(beads, 3)) * 0.4 if beads != 3 else np.outer(np.arange(3), rng.normal(size=3) * 0.4)
        for k, place in enumerate(places + rng.random(3) * EDGE + EDGE * (molecule == 2)):
            rows.append((molecule, 1 + k % 2, place))
    rows += [(0, 3, place) for place in rng.random((FREE, 3)) * EDGE]
    atoms = []
    for k, (molecule, kind, place) in enumerate(rows):
        image = np.floor(place / EDGE).astype(int)
        x, i = " ".join(f"{value:.15g}" for value in place - EDGE * image), " ".join(map(str, image))
        atoms.append(f"{k + 1} {molecule} {kind} {x} {i}")
    v = rng.normal(size=(len(rows), 3))
    speeds = [f"{k + 1} {' '.join(f'{value:.15g}' for value in row)}" for k, row in enumerate(v)]
    head = f"# bodies\n\n{len(rows)} atoms\n3 atom types\n\n" + "".join(f"0 {EDGE} {a}lo {a}hi\n" for a in "xyz")
    return (
        f"{head}\nMasses\n\n1 1.0\n2 7.5\n3 1.0\n\nAtoms # molecular\n\n"
        + "\n".join(atoms)
        + "\n\nVelocities\n\n"
        + "\n".join(speeds)
        + "\n"
    )


def given_file() -> str:
    """A file with other masses, centres, inertias and velocities of the first four molecules: two lumps, a rod and a pair."""
    text, rng, lines = data_file(), np.random.default_rng(3), []
    atoms = np.array([line.split() for line in text.partition("molecular\n\n")[2].partition("\n\nVel")[0].splitlines()], dtype=float)
    for molecule in (1, 2, 3, 4):
        x = (atoms[:, 3:6] + EDGE * atoms[:, 6:9])[atoms[:, 1] == molecule]
        mass, centre = rng.uniform(10.0, 40.0), x.mean(axis=0) + (0.1 * rng.normal(size=3) if molecule < 3 else 0.0)
        if molecule < 3:
            points = rng.normal(size=(8, 3))
            inertia, momentum = np.sum(points**2) * np.eye(3) - points.T @ points, rng.normal(size=3) * 4
        else:
            line = (x[1] - x[0]) / np.linalg.norm(x[1] - x[0])
            inertia, momentum = 3.0 * np.eye(3) - 1.8 * np.outer(line, line), 4 * np.cross(line, rng.normal(size=3))
        image = np.floor(centre / EDGE).astype(int)
        tensor = (inertia[a, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        values = [mass, *(centre - EDGE * image), *tensor, *rng.normal(size=3), *momentum]
        lines.append(" ".join([str(molecule), *(f"{value:.17g}" for value in values), *map(str, image)]))
    return "# bodies that overlap\n\n4\n" + "\n".join(lines) + "\n"


DECK = """units lj
atom_style molecular
atom_modify map yes
comm_modify vel yes cutoff 4.0
read_data data.bodies
pair_style dpd 0.0 1.0 34387
pair_coeff * * 25.0 4.5 1.0
pair_coeff 1*2 3 40.0 20.0 1.2
group stiff type 1 2
group water type 3
group first molecule 1
group second molecule 2 3
FIX
fix w water nve
timestep 0.001
thermo 20
compute body stiff temp
compute some first temp
variable e equal pe
thermo_style custom step temp pe ke press c_body c_some
thermo_modify norm no
run 0
fix p all print 20 "$(step) $(temp:%.12g) $(pe:%.12g) $(ke:%.12g) $(press:%.12g) $(c_body:%.12g) $(c_some:%.12g)" file rows.txt screen no
dump d all custom 100 end.dump id type xu yu zu vx vy vz
dump_modify d sort id format float %.17g
run 100
"""
HOLD = "velocity first set 0 0 0\nvelocity second set 0.3 -0.2 0.1\n"
FIXES = {
    "molecules": "fix b stiff rigid/nve molecule\nneigh_modify exclude molecule/intra stiff",
    "pushed": "fix push second addforce 9.0 2.0 0.5\nfix down stiff gravity 5 vector 0 0 -1\nfix b stiff rigid/nve molecule",
    "small, inner pairs": "fix b stiff rigid/nve/small molecule",
    "small, given": "fix b stiff rigid/nve/small molecule infile given.txt",
    "given, tilted": "change_box all triclinic\nchange_box all xy final 0.7 xz final -0.4 yz final 0.5\n"
    "fix b stiff rigid/nve molecule infile given.txt",
    "single": "fix b first rigid/nve single\nneigh_modify exclude group first first",
    "groups, held, pushed": f"{HOLD}fix push first addforce 1.0 2.0 0.5\nfix down second gravity 0.5 vector 0 0 -1\n"
    "fix b stiff rigid/nve group 2 first second force 1 off on off torque 1 off off off",
}


def rows_of(folder: Path) -> np.ndarray:
    lines = (folder / "rows.txt").read_text().splitlines()
    return np.array([line.split() for line in lines if not line.startswith("#")], dtype=float)


def last_frame(folder: Path, step: int = 100) -> np.ndarray:
    lines = (folder / "end.dump").read_text().partition(f"TIMESTEP\n{step}\n")[2].partition("ITEM: ATOMS")[2].splitlines()[1:]
    return np.array([line.split() for line in lines], dtype=float)


@lammps_peer.needed()
@cases("fix", FIXES)
def test_bodies_move_as_lammps_moves_them(tmp_path, fix):
    """1e-6 over 100 steps in positions; the pressure is that of the moment, and LAMMPS's a mean over two half steps."""
    lammps_peer.need(("fix", "rigid/nve"))
    text = DECK.replace("FIX", fix)
    (tmp_path / "lammps").mkdir()
    for folder in (tmp_path / "lammps", tmp_path):
        put(folder / "data.bodies", data_file())
        put(folder / "given.txt", given_file())
    theirs(tmp_path / "lammps", text)
    run_deck(put(tmp_path / "in.bodies", text), RunOptions(platform="Reference", threads=1), out=tmp_path)
    found, expected = last_frame(tmp_path), last_frame(tmp_path / "lammps")
    np.testing.assert_allclose(found[:, 2:5], expected[:, 2:5], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[:, 5:], expected[:, 5:], rtol=0, atol=1e-5)
    ours, rows = rows_of(tmp_path), rows_of(tmp_path / "lammps")
    np.testing.assert_allclose(np.delete(ours, 4, axis=1), np.delete(rows, 4, axis=1), rtol=1e-6)
    if not {"off", "given.txt"}.intersection(fix.split()):  # LAMMPS counts the forces that hold a body, at its place in the box
        np.testing.assert_allclose(ours[1:, 4], rows[1:, 4], rtol=2e-3)


def with_unseen_mass() -> tuple[str, str, str]:
    """The data file, the same with one bead more in the first lump, which is heavy and exerts no force, and the ``infile`` in its place."""
    head, _, rest = data_file().replace("3 atom types", "4 atom types").replace("3 1.0\n", "3 1.0\n4 30.0\n").partition("molecular\n\n")
    atoms, speeds = (part.splitlines() for part in rest.split("\n\nVelocities\n\n"))
    rows, rng = np.array([line.split() for line in atoms[:5]], dtype=float), np.random.default_rng(8)
    x, m = rows[:, 3:6] + EDGE * rows[:, 6:9], np.append(np.where(rows[:, 2] == 1, 1.0, 7.5), 30.0)
    x = np.vstack([x, x.mean(axis=0) + 0.7 * rng.normal(size=3)])
    centre, speed, spin = m @ x / m.sum(), rng.normal(size=3), 2 * rng.normal(size=3)
    arms = np.sqrt(m)[:, None] * (x - centre)
    inertia = np.sum(arms**2) * np.eye(3) - arms.T @ arms
    moving = [f"{k + 1} {' '.join(map(repr, row.tolist()))}" for k, row in enumerate(speed + np.cross(spin, x - centre))]
    last, at = len(atoms) + 1, x[5] % EDGE
    unseen = f"{last} 1 4 {' '.join(map(repr, at.tolist()))} {' '.join(map(str, np.rint((x[5] - at) / EDGE).astype(int)))}"
    files = []
    for more, v in (((), ()), ((unseen,), (f"{last} {moving[5].partition(' ')[2]}",))):
        text = head.replace(f"{last - 1} atoms", f"{last - 1 + len(more)} atoms") + "molecular\n\n" + "\n".join([*atoms, *more])
        files.append(text + "\n\nVelocities\n\n" + "\n".join([*moving[:5], *speeds[5:], *v]) + "\n")
    tensor = [inertia[a, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    row = " ".join(f"{value:.17g}" for value in [m.sum(), *centre, *tensor, *speed, *(inertia @ spin)])
    return *files, f"1\n1 {row} 0 0 0\n"


@lammps_peer.needed()
def test_the_pressure_of_given_bodies_is_that_of_lammps_where_a_bead_without_forces_has_their_mass(tmp_path):
    """LAMMPS's own with ``infile`` is another one: it takes the forces that hold a body from the masses of its beads, at their places."""
    deck = DECK.replace("* * 25.0 4.5 1.0", "1*3 1*3 25.0 4.5 1.0\npair_coeff * 4 0.0 0.0").replace("stiff type 1 2", "stiff type 1 2 4")
    few, whole, given = with_unseen_mass()
    for name, data, fix in (("lammps", whole, ""), ("infile", few, " infile given.txt"), ("ours", few, " infile given.txt")):
        folder = tmp_path / name
        folder.mkdir()
        put(folder / "data.bodies", data)
        put(folder / "given.txt", given)
        text = deck.replace("FIX", f"fix b stiff rigid/nve molecule{fix}")
        if name == "ours":
            run_deck(put(folder / "in.bodies", text), RunOptions(platform="Reference", threads=1), out=folder)
        else:
            theirs(folder, text)
    expected, theirs_given, ours = (rows_of(tmp_path / name)[1:, 4] for name in ("lammps", "infile", "ours"))
    np.testing.assert_allclose(ours, expected, rtol=2e-3)
    assert np.abs(theirs_given / expected - 1).max() > 0.02


@lammps_peer.needed()
@cases("style", "rigid", pytest.param("rigid/small", marks=pytest.mark.slow))
def test_an_iteration_of_lammps_and_the_splitting_here_differ_to_second_order(tmp_path, style):
    """Without friction: with it LAMMPS's forces see angular velocities of the orientation half a step before, a difference of first order."""
    off = []
    for n in (100, 200):
        text = (
            DECK.replace("FIX", f"fix b stiff {style} molecule infile given.txt")
            .replace("25.0 4.5", "25.0 0")
            .replace("40.0 20.0", "40.0 0")
        )
        text = (
            text.replace("timestep 0.001", f"timestep {0.1 / n}")
            .replace("run 100", f"run {n}")
            .replace("all custom 100", f"all custom {n}")
        )
        folders = tmp_path / f"lammps{n}", tmp_path / str(n)
        for folder in folders:
            folder.mkdir()
            put(folder / "data.bodies", data_file())
            put(folder / "given.txt", given_file())
        theirs(folders[0], text)
        run_deck(put(folders[1] / "in.bodies", text), RunOptions(platform="Reference", threads=1), out=folders[1])
        found, expected = (last_frame(folder, n)[:, 2:5] for folder in folders)
        off.append(np.abs(found - expected).max())
    assert off[0] < 1e-6 and 3.8 < off[0] / off[1] < 4.2, off


LOCAL = "id mol mass x y z xu yu zu vx vy vz fx fy fz ix iy iz tqx tqy tqz omegax omegay omegaz angmomx angmomy angmomz inertiax inertiay inertiaz"


@lammps_peer.needed()
def test_values_of_bodies_are_those_of_lammps(tmp_path):
    fix = FIXES["small, given"] + f"\ncompute l stiff rigid/local b {LOCAL}\ncompute k all ke/rigid b\n"
    fix += "compute m first rigid/local b mol\ncompute e all erotate/rigid b\ncompute s all reduce sum c_m inputs local\n"
    fix += "neigh_modify every 1 delay 0 check no\ndump l all local 20 local.txt index c_l[*]\ndump_modify l format float %.12g\n"
    text = DECK.replace("FIX", fix).replace("$(temp:%.12g)", "$(c_k:%.12g) $(c_e:%.12g) $(c_s)")
    (tmp_path / "lammps").mkdir()
    for folder in (tmp_path / "lammps", tmp_path):
        put(folder / "data.bodies", data_file())
        put(folder / "given.txt", given_file())
    theirs(tmp_path / "lammps", text)
    run_deck(put(tmp_path / "in.bodies", text), RunOptions(platform="Reference", threads=1), out=tmp_path)
    np.testing.assert_allclose(rows_of(tmp_path)[:, 1:4], rows_of(tmp_path / "lammps")[:, 1:4], rtol=1e-6)
    found, expected = ((folder / "local.txt").read_text().partition("TIMESTEP\n20\n")[2] for folder in (tmp_path, tmp_path / "lammps"))
    tables = [[line.split() for line in text.splitlines() if line[:1].isdigit() and len(line.split()) > 9] for text in (found, expected)]
    frames = [np.array(table, float).reshape(-1, 7, 31)[:, :, 1:] for table in tables]  # LAMMPS has its own order of bodies
    frames = [np.array([frame[np.argsort(frame[:, 0])] for frame in its]) for its in frames]
    assert len(frames[1]) == 5
    np.testing.assert_allclose(*frames, rtol=1e-6, atol=1e-6)


@cases(
    "fix, match",
    ("fix b stiff rigid/nve molecule\ncompute l all rigid/local b x", "must be a fix rigid/small or rigid/nve/small"),
    ("fix b stiff rigid/nve molecule\nfix m all momentum 10 linear 1 1 1", "momentum changes single beads"),
    ("fix b stiff rigid/nve molecule\nfix t stiff temp/berendsen 1 1 1", "temp/berendsen changes single beads"),
    ("fix b water rigid/nve molecule", "in no molecule"),
    ("fix b stiff rigid/nve molecule langevin 1", "set velocities"),
    ("fix b stiff rigid/nve molecule torque * on off off", "about all axes, or about none"),
    ("fix b stiff rigid/nve molecule force * off off off", "it is held there"),
    ("fix b stiff rigid/small single", "rigid/small"),
    ("fix b stiff rigid/nve molecule\nminimize 0 0 10 10", "one by one"),
    ("fix b stiff rigid/nve molecule\nfix s all shardlow", "shardlow needs pair style"),
    ("fix b stiff rigid/nve molecule infile given.txt reinit yes", "with infile, reinit is no"),
    ("fix b stiff rigid/nve molecule infile given.txt force * off off off", "it is held there"),
    ("fix b stiff rigid/nve group 3 first second stiff infile given.txt", "given.txt:7: body 4: there are 3, from 1 to 3"),
    ("fix b stiff rigid/nve molecule infile off.txt", "the beads of the body of .* are in line: its centre must be there"),
    ("fix b stiff rigid/nve molecule infile big.txt", "fix b: a body has a mass > 0 and moments of inertia >= 0, none above"),
    ("fix b stiff rigid/nve molecule infile half.txt", "half.txt:2: .* images are whole, not 1, 0, 0.5, 0"),
    ("fix b stiff rigid/nve molecule infile short.txt", "short.txt:3: it announces 4 bodies, but has 3"),
    ("fix b stiff rigid/nve molecule reinit no\nrun 2\nvelocity first set 1 0 0", "its beads have changed since its last run"),
    ("group lone id 1\nfix b lone rigid/nve single", "two at least"),
)
def test_what_is_refused(tmp_path, fix, match):
    put(tmp_path / "data.bodies", data_file())
    head, lines = "1\n", given_file().splitlines(keepends=True)
    put(tmp_path / "given.txt", "".join(lines))
    put(tmp_path / "short.txt", "".join(lines[:-1]))
    put(tmp_path / "off.txt", head + lines[-1].replace(" ", " 9", 2).replace(" 9", " ", 1))
    put(tmp_path / "half.txt", head + "1 5 1 1 1 1 1 1 0 0 0 0 0 0 0 0 0 0 0.5 0\n")
    put(tmp_path / "big.txt", head + "1 5 1 1 1 1 1 9 0 0 0 0 0 0 0 0 0 0 0 0\n")
    with pytest.raises(DeckError, match=match):
        run_deck(put(tmp_path / "in.bodies", DECK.replace("FIX", fix)), RunOptions(platform="Reference", threads=1), out=tmp_path)
