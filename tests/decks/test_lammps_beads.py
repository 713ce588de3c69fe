"""Boxes, lattices, regions, groups, set and velocity."""

import numpy as np
import pytest
from cases import cases, put, raises

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import read_deck


def state_of(tmp_path, text: str):
    return read_deck(put(tmp_path / "in.deck", text), stop_before_first_run=True)


# -- boxes and lattices ------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("style", "per_cell"), [("sc", 1), ("bcc", 2), ("fcc", 4), ("diamond", 8), ("hcp", 4)])
def test_lattices_fill_the_box_with_the_reduced_density(tmp_path, style, per_cell):
    state = state_of(tmp_path, f"lattice {style} 0.85\nregion b block 0 4 0 3 0 5\ncreate_box 1 b\ncreate_atoms 1 box\n")
    assert len(state.atoms) == 60 * per_cell
    assert len(state.atoms) / state.box.volume == pytest.approx(0.85)
    distances = np.linalg.norm(state.atoms.positions - state.atoms.positions[0], axis=1)
    nearest = {"sc": 1, "bcc": 3**0.5 / 2, "fcc": 2**-0.5, "diamond": 3**0.5 / 4, "hcp": 1}[style]
    assert np.sort(distances)[1] == pytest.approx(nearest * state.lattice.spacing[0])


def test_a_lattice_constant_in_other_units(tmp_path):
    text = "units metal\nlattice fcc 3.52 origin 0.25 0 0\nregion b block 0 2 0 2 0 2\ncreate_box 1 b\ncreate_atoms 1 box\n"
    state = state_of(tmp_path, text + "mass 1 1\npair_style none\n")
    np.testing.assert_allclose(state.box.edges, 7.04)
    np.testing.assert_allclose(np.diag(state.first_run.scene().box), 0.704)
    assert len(state.atoms) == 32
    np.testing.assert_allclose(state.atoms.positions[0], [0.88, 0, 0])


def test_a_prism_makes_a_tilted_box(tmp_path):
    state = state_of(tmp_path, "region b prism 0 5 1 5 2 8 1.5 -0.5 2\ncreate_box 1 b\nlattice sc 1.0\ncreate_atoms 1 box\n")
    np.testing.assert_allclose(state.box.vectors, [[5, 0, 0], [1.5, 4, 0], [-0.5, 2, 6]])
    assert len(state.atoms) == 120


def test_a_box_tilted_too_far_is_reduced_for_the_scene(tmp_path):
    text = "region b prism 0 5 0 5 0 5 4.0 0 0\ncreate_box 1 b\ncreate_atoms 1 single 1 1 1\nmass 1 1\npair_style dpd 1 1 1\n"
    text += "pair_coeff 1 1 1 1\nfix 1 all nve\n"
    state = state_of(tmp_path, text)
    assert state.first_run.scene().box[1].tolist() == [-1.0, 5.0, 0.0]
    assert any("tilted by more than half an edge" in note for note in state.notes)


def test_random_beads_depend_on_the_seed_and_stay_in_the_region(tmp_path):
    text = """region b block -3 5 0 4 0 6 units box
region half sphere 0 2 2 1.5
create_box 2 b
create_atoms 1 random 300 17 half
create_atoms 2 random 300 17 NULL
create_atoms 1 random 300 17 NULL
create_atoms 1 random 20 5 NULL overlap 0.4 maxtry 500
"""
    x = state_of(tmp_path, text).atoms.positions
    assert x.shape == (920, 3)
    assert np.all(np.linalg.norm(x[:300] - [0, 2, 2], axis=1) <= 1.5)
    assert np.array_equal(x[300:600], x[600:900])  # the same seed gives the same points
    low, high = np.array([-3, 0, 0]), np.array([5, 4, 6])
    assert np.all((x >= low) & (x < high))
    # uniform: the mean of 300 numbers is within 4 standard errors of the centre
    np.testing.assert_array_less(np.abs(x[300:600].mean(axis=0) - (low + high) / 2), 4 * (high - low) / np.sqrt(12 * 300))
    gaps = x[900:, None] - x[None]
    gaps -= np.round(gaps / (high - low)) * (high - low)
    distance = np.linalg.norm(gaps, axis=2)
    distance[np.arange(20), 900 + np.arange(20)] = np.inf
    assert distance.min() >= 0.4


# -- groups, set, mass --------------------------------------------------------------------------------------------------------
TWENTY = "region b block 0 10 0 10 0 10 units box\ncreate_box 3 b\ncreate_atoms 1 random 10 1 b\ncreate_atoms 2 random 10 2 b\n"
TWENTY += "mass * 1.0\n"


def ids(state, name: str) -> list[int]:
    return state.atoms.ids[state.group(name)].tolist()


def test_set(tmp_path):
    state = state_of(
        tmp_path,
        "atom_style full\n"
        + TWENTY
        + "group few id 1:4\nset group few type 3 charge -0.5\nset atom 5*6 mol 7 x 12.5 vy 2.0\nset type 3 image 1 NULL -1\n"
        "set mol 7 vz -1\npair_style none\nrun 0\n",
    )
    atoms = state.atoms
    assert atoms.types.tolist() == [3] * 4 + [1] * 6 + [2] * 10
    assert atoms.charges.tolist() == [-0.5] * 4 + [0] * 16
    assert atoms.molecules.tolist() == [0] * 4 + [7] * 2 + [0] * 14
    np.testing.assert_allclose(atoms.positions[4:6, 0], 2.5)  # wrapped where the run begins, and said in the image flag
    assert atoms.images[4:6].tolist() == [[1, 0, 0]] * 2 and atoms.images[0].tolist() == [1, 0, -1]
    np.testing.assert_allclose(atoms.velocities[4:6], [[0, 2, -1]] * 2)


def test_set_random_types(tmp_path):
    text = TWENTY.replace("random 10 1", "random 1000 1") + "set type 1 {} 5\n"
    assert int(np.sum(state_of(tmp_path, text.format("type/ratio 3 0.25")).atoms.types == 3)) == 250
    assert int(np.sum(state_of(tmp_path, text.format("type/subset 3 17")).atoms.types == 3)) == 17
    drawn = int(np.sum(state_of(tmp_path, text.format("type/fraction 3 0.25")).atoms.types == 3))
    assert abs(drawn - 250) < 4 * np.sqrt(1000 * 0.25 * 0.75)  # 4 standard errors
    assert drawn != 250


def test_theta_of_atom_style_dpd(tmp_path):
    text = "set group all dpd/theta 300\nvelocity all create 250 3\nset atom 2* dpd/theta NULL\n"
    state = state_of(tmp_path, "units metal\natom_style dpd\n" + TWENTY + text)
    assert state.atoms.thetas[0] == 300
    # the kinetic temperature of each bead; over all of them 250 K (57 of 60 degrees of freedom)
    speed2 = np.sum((state.atoms.velocities * state.units.velocity) ** 2, axis=1)
    np.testing.assert_allclose(state.atoms.thetas[1:], speed2[1:] / (3 * state.units.thermal_energy))
    assert speed2.sum() / (57 * state.units.thermal_energy) == pytest.approx(250)


#: Two beads go, and the last two of LAMMPS's memory take their places.
GAPS = "group few id 2 4\ngroup late id 19 20\ndelete_atoms group few compress no\n"


@pytest.mark.parametrize("command", ["reset_atoms id", "reset_ids", "reset_atom_ids sort no"])
def test_ids_without_gaps(tmp_path, command):
    before, after = state_of(tmp_path, TWENTY + GAPS), state_of(tmp_path, TWENTY + GAPS + command + "\n")
    assert after.atoms.ids.tolist() == list(range(1, 19))
    old = [1, 20, 3, 19, *range(5, 19)]
    np.testing.assert_array_equal(after.atoms.positions, before.atoms.positions[before.atoms.index_of(old)])
    assert ids(after, "late") == [2, 4]


RUN = "pair_style zero 1\npair_coeff * *\nfix 1 all nve\nrun 0\n"


@cases(
    "text, message",
    ("reset_atoms mol all\n", "reset_atoms mol is not supported"),
    ("reset_atoms image\n", "reset_atoms image is not supported"),
    ("compute m all msd\nreset_atoms id\n", "define it afterwards"),
)
def test_ids_that_lammps_would_give_otherwise(tmp_path, text, message):
    raises(DeckError, message, lambda: read_deck(put(tmp_path / "in.deck", TWENTY + text)))


@pytest.mark.parametrize("command", ["reset_atoms id", "group last id 20\ndelete_atoms group last compress yes"])
@pytest.mark.parametrize("sorting", ["", "atom_modify sort 0 0.0\n"])
def test_new_ids_after_a_run_follow_the_order_of_before(tmp_path, sorting, command):
    """Which is LAMMPS's only where it does not sort; otherwise a note says so."""
    found = read_deck(put(tmp_path / "in.deck", f"{sorting}{TWENTY}{RUN}{GAPS}{command}\n"))
    np.testing.assert_array_equal(found.atoms.positions, state_of(tmp_path, f"{TWENTY}{GAPS}{command}\n").atoms.positions)
    assert any("LAMMPS, which sorts beads by position" in note for note in found.notes) == (not sorting)


def test_masses_by_range(tmp_path):
    assert state_of(tmp_path, TWENTY + "mass 2* 3.5\n").masses == {1: 1.0, 2: 3.5, 3: 3.5}


# -- velocities ---------------------------------------------------------------------------------------------------------------
THOUSAND = "units {units}\nregion b block 0 40 0 40 0 40 units box\ncreate_box 2 b\ncreate_atoms 1 random 600 1 b\n"
THOUSAND += "create_atoms 2 random 400 2 b\nmass 1 1.0\nmass 2 18.0\n"


def kinetic_temperature(state, mask) -> float:
    masses = state.bead_masses()[mask]
    speeds2 = np.sum((state.atoms.velocities[mask] * state.units.velocity) ** 2, axis=1)
    return float(masses @ speeds2) / ((3 * mask.sum() - 3) * state.units.thermal_energy)


@pytest.mark.parametrize("units", ["lj", "real", "metal"])
@pytest.mark.parametrize("options", ["", "dist gaussian", "dist uniform loop geom rot yes", "mom no", "loop local dist gaussian"])
def test_velocity_create(tmp_path, units, options):
    target = {"lj": 1.3, "real": 300.0, "metal": 250.0}[units]
    text = f"group two type 2\nvelocity two set 1 2 3 units box\nvelocity all create {target} 87 {options}\n"
    state = state_of(tmp_path, THOUSAND.format(units=units) + text)
    everything = state.group("all")
    masses, v = state.bead_masses(), state.atoms.velocities * state.units.velocity
    assert kinetic_temperature(state, everything) == pytest.approx(target, rel=1e-12)
    scale = np.sqrt(state.units.thermal_energy * target * masses.sum())
    assert (np.abs(masses @ v / scale).max() < 1e-12) == ("mom no" not in options)
    angular = np.sum(masses[:, None] * np.cross(state.atoms.positions - masses @ state.atoms.positions / masses.sum(), v), axis=0)
    assert (np.abs(angular).max() / scale / state.box.edges[0] < 1e-10) == ("rot yes" in options)
    # equipartition between the types: the ratio of mean m v^2 has a relative standard error of sqrt(2/1800 + 2/1200) at most
    energy = masses * np.sum(v**2, axis=1)
    assert abs(energy[masses > 1].mean() / energy[masses == 1].mean() - 1) < 4 * np.sqrt(2 / 1800 + 2 / 1200)
    reduced = (v * np.sqrt(masses)[:, None]).ravel()  # fourth moment distinguishes the distributions: 3 for Gaussian, 9/5 for uniform
    kurtosis = np.mean(reduced**4) / np.mean(reduced**2) ** 2
    assert abs(kurtosis - (3 if "gaussian" in options else 1.8)) < 4 * (np.sqrt(24 / 3000) if "gaussian" in options else 0.02)


def test_velocity_create_on_a_group_leaves_the_others(tmp_path):
    text = THOUSAND.format(units="lj") + "group two type 2\nvelocity all set 1 0 0 units box\nvelocity two create 2.0 5\n"
    state = state_of(tmp_path, text)
    two = state.group("two")
    assert np.array_equal(state.atoms.velocities[~two], np.tile([1.0, 0, 0], (600, 1)))
    assert kinetic_temperature(state, two) == pytest.approx(2.0)


def test_sum_adds_to_what_is_there(tmp_path):
    base = THOUSAND.format(units="lj")
    plain = state_of(tmp_path, base + "velocity all create 2.0 5\n").atoms.velocities
    summed = state_of(tmp_path, base + "velocity all set 1 0 -2 units box\nvelocity all create 2.0 5 sum yes\n").atoms.velocities
    np.testing.assert_allclose(summed, plain + [1, 0, -2])


def test_loop_all_goes_by_id_and_loop_geom_by_position(tmp_path):
    ends = "velocity all create 1.0 5 loop {}\n"  # the same beads in two orders of creation
    box = "region b block 0 9 0 9 0 9 units box\ncreate_box 1 b\nmass 1 1\n"
    points = [f"create_atoms 1 single {x} 1 2\n" for x in (1, 2, 4, 8)]
    for loop, by_position in (("all", False), ("geom", True)):
        one, other = (state_of(tmp_path, box + "".join(order) + ends.format(loop)) for order in (points, points[::-1]))
        assert np.allclose(one.atoms.velocities, other.atoms.velocities[::-1]) == by_position


def test_seeds_matter(tmp_path):
    base = THOUSAND.format(units="lj")
    for loop in ("all", "geom"):
        first, second = (state_of(tmp_path, base + f"velocity all create 1.0 {seed} loop {loop}\n").atoms.velocities for seed in (5, 6))
        assert abs(np.sum(first * second) / np.sum(first**2)) < 4 / np.sqrt(first.size)


def test_velocity_set_ramp_scale_zero(tmp_path):
    text = "lattice sc 0.125\nregion b block 0 4 0 4 0 4\ncreate_box 1 b\ncreate_atoms 1 box\nmass 1 2\nvelocity all set 1.0 NULL -0.5\n"
    text += "velocity all set 1.0 0.5 NULL units box sum yes\n"
    state = state_of(tmp_path, text)
    np.testing.assert_allclose(state.atoms.velocities, np.tile([3, 0.5, -1], (64, 1)))  # the lattice spacing is 2
    state = state_of(tmp_path, text + "velocity all ramp vx 0 2 z 2 6 units box\n")
    np.testing.assert_allclose(state.atoms.velocities[:, 0], np.clip((state.atoms.positions[:, 2] - 2) / 2, 0, 2))
    state = state_of(tmp_path, text + "velocity all scale 0.7\n")
    assert kinetic_temperature(state, state.group("all")) == pytest.approx(0.7)
    state = state_of(tmp_path, text + "velocity all zero linear\n")
    np.testing.assert_allclose(state.atoms.velocities, 0, atol=1e-15)


@cases(
    "text, message",
    ("boundary p p s", "boundaries must be periodic .p. or, with fix wall/reflect, fixed .f., not .p p s."),
    ("dimension 4", "the dimension must be one of 2, 3, not '4'"),
    ("units electron", "units must be one of lj, real, metal, si, cgs, micro, nano, not 'electron'"),
    ("atom_style body", "the atom style must be one of atomic,"),
    ("lattice sc -1", "the scale of the lattice must be > 0"),
    ("lattice square 1", "the lattice style in 3 dimensions must be one of sc, bcc, fcc, hcp, diamond, custom, none"),
    ("region b block 0 1 0 1 0", "region style block needs 6 values, but 5 follow"),
    ("region b block 0 1 2 1 0 1", "the region's lower y, 2, is above its upper one, 1"),
    ("region b block 0 1 0 EDGE 0 1", "is EDGE, but there is no box yet"),
    ("region b wedge 0", "the region style must be one of"),
    ("region b union 2 a c", "there is no region 'a'; defined so far: none"),
    ("create_box 1 b", "there is no region 'b'"),
    ("region b sphere 0 0 0 1\ncreate_box 1 b", "create_box needs a bounded block or prism"),
    ("region b cylinder z 1 1 1 0 1\ncreate_box 1 b", "create_box needs a bounded block or prism"),
    ("create_atoms 1 box", "create_atoms needs a simulation box"),
    ("mass 1 1.0", "mass needs a simulation box"),
    (TWENTY + "create_atoms 1 box", "need a lattice"),
    (TWENTY + "create_atoms 4 box", "atom type 4 is out of range: there are 3"),
    (TWENTY + "region up block INF INF 1e3 INF INF INF\ncreate_atoms 1 random 10 1 up", "region 'up' and the box have no volume in common"),
    (TWENTY + "create_atoms 1 random 10", "create_atoms random needs 3 values, but 1 follow"),
    (TWENTY + "create_atoms 1 random 10 5 nowhere", "there is no region 'nowhere'"),
    (TWENTY + "create_atoms 1 mesh x", "the style of create_atoms must be one of"),
    (TWENTY + "mass 1 0", "the mass must be > 0, but is 0"),
    (TWENTY + "mass 4 1", "atom type 4 is out of range: there are 3"),
    (TWENTY + "mass 1 nan", "the mass must be finite, but is nan"),
    (TWENTY + "group g cluster 1", "group style 'cluster' is not supported"),
    (TWENTY + "group g type x", "expected a whole number for an atom type, not 'x'"),
    (TWENTY + "group g union h", "there is no group 'h'; defined so far: all"),
    (TWENTY + "group all type 1", "group all always contains all beads"),
    (TWENTY + "set atom 1 mass 2", "has one mass per type; use the mass command"),
    ("atom_style sphere\n" + TWENTY.strip(), "beads of atom_style sphere have masses by diameter and density"),
    ("atom_style sphere\n" + TWENTY.replace("mass * 1.0", "set type * diameter -1").strip(), "no diameter may be negative"),
    (TWENTY + "set atom 1 density 2", "set density needs atom_style sphere"),
    (TWENTY + "set atom 1 charge 2", "set charge needs atom_style charge or full"),
    (TWENTY + "set atom 1 type 4", "atom type 4 is out of range"),
    (TWENTY + "set atom 1 shape 1 1 1", "set has no option 'shape' here"),
    (TWENTY + "velocity all create 1.0", "velocity create needs 2 values, but 1 follow"),
    (TWENTY + "velocity all create -1.0 5", "the temperature must be >= 0"),
    (TWENTY + "velocity all create 1.0 5 dist odd", "dist must be one of uniform, gaussian, not 'odd'"),
    (TWENTY + "velocity all create 1.0 5 mom maybe", "expected yes or no for mom, not 'maybe'"),
    (
        TWENTY + "mass * 1\ndelete_atoms group all\ncreate_atoms 1 single 0 0 0\nset atom 1 x 1\ncreate_atoms 1 random 2147483648 5 NULL",
        "create_atoms random: 2147483648 beads are too many",
    ),
    (TWENTY + "velocity all scale 1.0", "cannot be scaled: its temperature is 0"),
    (TWENTY + "velocity none create 1.0 5", "there is no group 'none'"),
    (TWENTY + "units real", "units must come before the simulation box"),
    (
        "region b block 0 1 0 1 0 1\ncreate_box 1 b\ncreate_atoms 1 single 0 0 0\nvelocity all set 0 0 0\nvelocity all create 1 1",
        "no mass is set for atom type 1",
    ),
    ("neigh_modify exclude type 1", "neigh_modify exclude type needs 2 values"),
    (TWENTY + "group a id 1\nneigh_modify every 1 include a", "neigh_modify include must be all"),
    (TWENTY + "group a id 1\ncomm_modify group a vel yes", "comm_modify group must be all"),
    ("run_style respa 2 2", "only run_style verlet"),
    ("atom_modify id no", "atom_modify id no is not supported"),
    ("restart 100", r"expected 'restart N file \[file\]'"),
)
def test_errors(tmp_path, text, message):
    with pytest.raises(DeckError, match=message) as caught:
        state_of(tmp_path, text + "\n")
    assert caught.value.line == text.count("\n") + 1
