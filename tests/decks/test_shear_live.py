"""Decks with ``fix deform ... remap v`` beside a live LAMMPS: trajectories to rounding, and stress and temperature of sheared chains."""

import re
from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import raises
from fuzz.workers import Worker
from judged import any_seed

from openmm_dpd.base.errors import DeckError, ParameterError
from openmm_dpd.lammps import RunOptions, deck_forces, deck_scene, export_deck, run_deck
from openmm_dpd.stats import block_average

RATE, DT, HEIGHT = 1.2, 0.01, 4.0
#: Beads that no face is near to at first.  LAMMPS moves the box at the end of a step: forces see the images where they were a step ago.
#: From such a beginning that is a shear which began a step later, at another tilt.
TITLES = "step c_d c_p[1] c_p[4] c_p temp press pxy pe ke c_m[2] c_m[3]"
DECK = """units lj
comm_modify vel yes cutoff 1.5
region b prism -1 3 -2 2 0 4 {tilt!r} 0 0
create_box 2 b
mass 1 1
mass 2 1.5
{beads}
pair_style dpd 0.0 1.0 34387
pair_coeff * * 25 {gamma}
neighbor 0.3 bin
neigh_modify delay 0 every 1 check no
timestep 0.01
fix 1 all nve
compute d all temp/deform
compute p all pressure d
compute m all msd
fix 2 all deform 1 xy erate {rate} remap v
thermo 10
thermo_style custom {titles}
thermo_modify norm no format float %.15g
dump d all custom 10 dump.txt id y z vx vy vz ix iy iz xu yu zu
dump_modify d sort id format float %.15g pbc yes
"""


def beads(seed: int) -> str:
    """Commands that make 90 beads."""
    draw, lines = np.random.default_rng(seed), []
    for k in range(1, 91):
        lines.append(
            "create_atoms {} single {:.15g} {:.15g} {:.15g}".format(1 + k % 2, *draw.random(3) * [3.6, 2.9, 3.8] + [-0.8, -1.45, 0.1])
        )
        lines.append("set atom {} vx {:.15g} vy {:.15g} vz {:.15g}".format(k, *draw.normal(size=3)))
    return "\n".join(lines)


def rows_of(lines: list[str], width: int) -> np.ndarray:
    return np.array([[float(word) for word in words] for line in lines if len(words := line.split()) == width and words[0].isdigit()])


def frames_of(path: Path) -> np.ndarray:
    """(frames, beads, columns), sorted by id."""
    return np.array(
        [[row.split() for row in part.splitlines()[8:]] for part in path.read_text().split("ITEM: TIMESTEP\n")[1:]], dtype=float
    )


def by_lammps(folder: Path, deck: str) -> list[str]:
    """Rows that LAMMPS prints."""
    lammps_peer.need()
    folder.mkdir(exist_ok=True)
    (folder / "in.deck").write_text(deck, encoding="utf-8")
    worker = Worker("lammps")
    try:
        answer = worker.run(folder, "in.deck", {})
    finally:
        worker.close()
    assert answer.status == "done", answer.message
    return answer.thermo.splitlines()


def by_us(folder: Path, deck: str, **options) -> list[str]:
    folder.mkdir(exist_ok=True)
    return "\n".join(lammps_peer.printed(folder / "in.deck", deck, **options)).splitlines()


def in_plane(text: str, plane: str) -> str:
    """A deck with other axes, so that what was sheared in xy is sheared in a plane."""
    axes = plane + ({*"xyz"} - {*plane}).pop()  # what was x, y, z
    order = [axes.index(axis) for axis in "xyz"]
    text = re.sub(r"single (\S+) (\S+) (\S+)", lambda m: "single " + " ".join(m.groups()[k] for k in order), text)
    tilts = r"prism (\S+ \S+) (\S+ \S+) (\S+ \S+) (\S+) 0 0"
    tilt = {"xy": "{} 0 0", "xz": "0 {} 0", "yz": "0 0 {}"}[plane]
    text = re.sub(tilts, lambda m: "prism " + " ".join(m.groups()[k] for k in order) + " " + tilt.format(m[4]), text)
    columns = {"c_p[1]": f"c_p[{'xyz'.index(axes[0]) + 1}]", "c_p[4]": f"c_p[{('xy', 'xz', 'yz').index(plane) + 4}]"}
    columns |= {f"c_m[{k}]": f"c_m[{'xyz'.index(axes[k - 1]) + 1}]" for k in (2, 3)}
    names = {*"y z vx vy vz ix iy iz xu yu zu xy pxy".split()}
    words = (columns.get(word, word.translate(str.maketrans("xyz", axes)) if word in names else word) for word in re.split(r"(\s)", text))
    return "".join(words)


SEVERAL = "run 100\nrun 30\nrun 70 every 60 NULL\nrun 150\n"


@pytest.mark.parametrize(
    ("gamma", "runs", "plane"),
    [(4.5, "run 350\n", "xy"), (1e-30, SEVERAL, "xy"), (4.5, "run 350\n", "xz"), (1e-30, SEVERAL, "yz"), (4.5, "run 350\n", "yz")],
)
def test_sheared_beads_go_where_those_of_lammps_go(gamma, runs, plane, tmp_path):
    """350 steps with four flips: rows, image flags, paths and velocities to 1e-7.  Friction, of which each run begins anew, is left out of
    several runs.  With other beads (seeds 1 to 3) LAMMPS parts at a flip, where it forgets the velocity of a bead that crosses just then."""
    parts, titles = {"beads": beads(8), "gamma": gamma, "rate": RATE, "titles": TITLES}, len(TITLES.split())
    theirs = by_lammps(tmp_path / "lammps", in_plane(DECK.format(tilt=0.0, **parts), plane) + 'print "=== run"\nrun 350\n')
    ours = by_us(tmp_path / "ours", in_plane(DECK.format(tilt=-RATE * HEIGHT * DT, **parts), plane) + runs, platform="CPU")
    a, b = rows_of(theirs, titles), rows_of(ours, titles)
    b = b[np.unique(b[:, 0], return_index=True)[1]]  # a run begins with the row that the one before has ended with
    assert a.shape == b.shape and (np.abs(a - b) < 1e-7 * np.abs(a).max(axis=0)).all()
    one, other = (frames_of(tmp_path / side / "dump.txt") for side in ("lammps", "ours"))
    one[1:, :, 9] -= one[1:, :, 7] * RATE * HEIGHT * DT  # the box of a frame is already that of the next forces
    one[:, :, 6] = other[:, :, 6]  # so beads are folded along x at another place
    assert one.shape == other.shape == (36, 90, 12) and np.abs(one - other).max() < 1e-7
    assert len(np.unique(one[-1, :, 7])) > 2


@pytest.mark.parametrize(
    ("plane", "bath"),
    [
        ("xy", "fix 1 all nvt temp 1.0 0.5 0.2"),
        ("xz", "fix 1 all nvt temp 1.5 1.5 0.1\nfix_modify 1 temp d"),
        ("yz", "fix 1 all nve\nfix 3 all temp/berendsen 0.5 2.0 0.1\nfix_modify 3 temp d\nfix 4 all viscous 0.5 scale 2 2"),
        ("xz", "fix 1 all nve\nfix 3 all langevin 0.0 0.0 0.3 77 tally yes scale 2 0.5"),
    ],
)
def test_thermostats_see_the_flow_as_in_lammps(plane, bath, tmp_path):
    """On velocities with the flow, or relative to it, in any plane: rows and what the bath has taken, to 1e-7, until the box first flips."""
    deck, titles = DECK.replace("fix 1 all nve\n", "").replace("fix 2 all", "{bath}\nfix 2 all"), TITLES + " ecouple"
    parts = {"beads": beads(8), "gamma": 4.5, "rate": RATE, "titles": titles, "bath": bath}
    theirs = by_lammps(tmp_path / "lammps", in_plane(deck.format(tilt=0.0, **parts), plane) + 'print "=== run"\nrun 40\n')
    ours = by_us(tmp_path / "ours", in_plane(deck.format(tilt=-RATE * HEIGHT * DT, **parts), plane) + "run 40\n", platform="CPU")
    a, b = (rows_of(rows, len(titles.split())) for rows in (theirs, ours))
    assert a.shape == b.shape == (5, len(titles.split())) and (np.abs(a - b) < 1e-7 * np.abs(a).max(axis=0)).all()


#: Chains of four without repulsion, all beads in chains.
CHAINS = """units lj
atom_style bond
comm_modify vel yes cutoff 2.5
special_bonds lj 1 1 1
bond_style harmonic
read_data data.chains
bond_coeff 1 3.0 0.0
pair_style dpd 1.0 1.0 {seed}
pair_coeff 1 1 0.0 4.5
neighbor 0.3 bin
neigh_modify delay 0 every 1 check yes
timestep 0.02
fix 1 all nve
fix 2 all deform 1 xy erate 0.5 remap v
compute t all temp/profile 1 0 0 y 4
compute p all pressure t
thermo_style custom step c_p[1] c_p[2] c_p[4] c_t
thermo_modify norm no format float %.10g
run 1000
thermo 10
print "=== run"
run {steps}
"""


def chains() -> str:
    """Data file of 94 chains in a box of 5."""
    draw = np.random.default_rng(3)
    places = np.cumsum(np.concatenate([draw.random((94, 1, 3)) * 5, draw.normal(size=(94, 3, 3)) * 6**-0.5], axis=1), axis=1).reshape(-1, 3)
    turns = np.floor(places / 5).astype(int)
    speeds = draw.normal(size=(376, 3)) + np.outer(places[:, 1] - 5 * turns[:, 1], [0.5, 0, 0])
    lines = [
        "chains",
        "",
        "376 atoms",
        "282 bonds",
        "1 atom types",
        "1 bond types",
        *(f"0 5 {axis}lo {axis}hi" for axis in "xyz"),
        "0 0 0 xy xz yz",
    ]
    lines += ["", "Masses", "", "1 1", "", "Atoms # bond", ""]
    for k, (x, n) in enumerate(zip(places - 5 * turns, turns, strict=True)):
        lines.append(f"{k + 1} {k // 4 + 1} 1 " + " ".join(f"{c:.12g}" for c in x) + " {} {} {}".format(*n))
    lines += ["", "Velocities", "", *(f"{k} " + " ".join(f"{c:.12g}" for c in v) for k, v in enumerate(speeds, start=1)), "", "Bonds", ""]
    pairs = [(4 * m + k, 4 * m + k + 1) for m in range(94) for k in (1, 2, 3)]
    return "\n".join([*lines, *(f"{n} 1 {i} {j}" for n, (i, j) in enumerate(pairs, start=1))]) + "\n"


@pytest.mark.slow
@pytest.mark.long
@any_seed(5)
def test_stress_of_sheared_chains_is_that_of_lammps(seed, tmp_path):
    """Viscosity, first normal stress and temperature of one deck within 4 combined standard errors: 16 %, 56 % and 1 % of them."""
    found = []
    for side, steps in (("lammps", 20_000), ("ours", 40_000)):
        folder = tmp_path / f"{side}{seed}"
        folder.mkdir()
        (folder / "data.chains").write_text(chains(), encoding="utf-8")
        deck = CHAINS.format(seed=seed, steps=steps)
        lines = by_lammps(folder, deck) if side == "lammps" else by_us(folder, deck, platform="CPU")
        _, xx, yy, xy, kT = rows_of(lines, 5)[-steps // 10 :].T
        found.append([block_average(series) for series in (-xy / 0.5, yy - xx, kT)])
    for theirs, ours in zip(*found, strict=True):
        print(theirs, ours)
        assert abs(theirs.mean - ours.mean) < 4 * np.hypot(theirs.sem, ours.sem)


REFUSED = {
    "deform 1 x final 0 1": "fix 2: a scene has no box that changes",
    "deform 1 xz erate 1 xy erate 1 remap v": "constant rate of shear in one plane, 'fix ID all deform 1 xy erate R remap v'",
    "deform 1 z erate 1 remap v": "constant rate of shear in one plane",
    "deform 1 xy erate 1 remap v flip no": "half an edge; remove it",
    "deform 1 remap v": "changes nothing",
    "nvt/sllod temp 1 1 1": "use a pair style as thermostat, fix nve, and fix deform 1 xy erate R remap v",
    "deform 1 xy erate 1 remap v\nfix 3 all momentum 1 linear 1 1 1": "in.deck:{line}: fix 3: momentum cannot be combined with fix deform",
    "deform 1 xy erate 1 remap v\nfix 3 all deform 1 xy erate 1 remap v": "deform cannot be combined with fix deform",
    "deform 1 xy erate 1 remap v\ngroup few id 1\nunfix 1\nfix 1 few nve": "do not move stand still",
}


def test_forces_of_a_plane_are_those_of_the_deck_and_export_is_refused(tmp_path):
    found = {}
    for plane, order in (("xy", [0, 1, 2]), ("xz", [0, 2, 1]), ("yz", [1, 2, 0])):
        text = in_plane(DECK.format(tilt=0.3, beads=beads(2), gamma=4.5, rate=RATE, titles="step"), plane) + "run 1\n"
        (tmp_path / "in.deck").write_text(text, encoding="utf-8")
        terms = deck_forces(tmp_path / "in.deck")
        found[plane] = np.stack([terms["conservative"], terms["dissipative"]])[..., order]
        if plane != "xy":
            np.testing.assert_allclose(found[plane], found["xy"], atol=1e-11)
            with pytest.raises(ParameterError, match=f"a shear in the plane {plane} cannot be exported"):
                export_deck(tmp_path / "in.deck", tmp_path / "out")


@pytest.mark.parametrize("words", REFUSED)
def test_what_is_other_physics_is_refused(words, tmp_path):
    head = DECK.format(tilt=0.0, beads=beads(1), gamma=4.5, rate=0, titles="step").replace("fix 2 all deform 1 xy erate 0 remap v\n", "")
    (tmp_path / "in.deck").write_text(f"{head}fix 2 all {words}\nrun 1\n", encoding="utf-8")
    raises(DeckError, REFUSED[words].format(line=head.count("\n") + 2), lambda: deck_scene(tmp_path / "in.deck"))


def test_a_box_that_cannot_be_tilted_is_refused(tmp_path):
    (tmp_path / "in.deck").write_text(
        "region b block 0 4 0 4 0 4\ncreate_box 1 b\nfix 2 all deform 1 xy erate 1 remap v\n", encoding="utf-8"
    )
    raises(DeckError, "in.deck:3: fix deform xy needs a triclinic box: change_box all triclinic", lambda: deck_scene(tmp_path / "in.deck"))


def test_image_flags_after_a_run_are_those_of_its_last_frame(tmp_path):
    """The tilt of the box turns at step 42; flags must not turn once more when they are read between runs."""
    text = (
        DECK.format(tilt=0.0, beads=beads(1), gamma=4.5, rate=RATE, titles="step xy") + "set atom 3 image 1 -2 0\nset atom 5 image 0 1 0\n"
    )
    columns = text[text.index("id y z") : text.index("dump_modify d")].strip()
    text += f"run 70\nwrite_dump all custom after.txt {columns} modify sort id format float %.15g\n"
    (tmp_path / "in.deck").write_text(text, encoding="utf-8")
    run_deck(tmp_path / "in.deck", RunOptions(platform="Reference"), out=tmp_path / "out")
    last, after = (np.loadtxt((tmp_path / "out" / f"{name}.txt").read_text().splitlines()[-90:]) for name in ("dump", "after"))
    assert len(np.unique(after[:, 6])) > 2
    np.testing.assert_allclose(after, last, rtol=0, atol=1e-9)
