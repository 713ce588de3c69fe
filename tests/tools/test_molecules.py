"""Builders of molecules and packed boxes: connectivity, counts, density, lengths, and what is refused."""

import numpy as np
import pytest
from cases import cases, raises, refused
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.molecules import (
    Bend,
    Bilayer,
    CosineBend,
    FENESpring,
    Molecule,
    MorseSpring,
    MultiHarmonicTwist,
    OPLSTwist,
    Scattered,
    Spring,
    Twist,
    bead,
    block_copolymer,
    branched,
    formula,
    grafmueller_2009,
    join,
    like_repulsion,
    linear,
    lipid,
    pack,
    relax,
    ring,
    sequence,
    star,
    surfactant,
    unlike_repulsion,
)

SPRING = Spring(k=50.0, r0=0.7)
PAIRS = {("*", "*"): dpd.DPD(A=25.0, gamma=4.5, cutoff=1.0)}


def pairs_of(molecule) -> list[tuple[int, int]]:
    return [tuple(pair) for pair in molecule.bond_pairs.tolist()]


# -- sequences -------------------------------------------------------------------------------------------------------------------
@cases(
    "text, types",
    ("A", "A"),
    ("A3B2", "A A A B B"),
    ("(AB)2C", "A B A B C"),
    ("(A(BC)2)2", "A B C B C A B C B C"),
    ("NaCl2", "Na Cl Cl"),
    ("A12", " ".join("A" * 12)),
)
def test_sequences(text, types):
    assert sequence(text) == tuple(types.split())


@pytest.mark.parametrize("text", ["", "a", "A-B", "(AB", "AB)", "A0", "2A", "()", "A 2", "A2²"])
def test_texts_that_are_no_sequence(text):
    raises(dpd.ParameterError, "bead types", sequence, text)


# -- connectivity ----------------------------------------------------------------------------------------------------------------
def test_linear_and_ring():
    chain = linear("A3B", SPRING, CosineBend(2.0))
    assert chain.types == ("A", "A", "A", "B") and pairs_of(chain) == [(0, 1), (1, 2), (2, 3)]
    assert chain.angle_triples.tolist() == [[0, 1, 2], [1, 2, 3]]
    assert {bond[2] for bond in chain.bonds} == {SPRING} and {angle[3] for angle in chain.angles} == {CosineBend(2.0)}
    closed = ring("A4", SPRING, Bend(1.0, np.pi / 2))
    assert sorted(map(sorted, pairs_of(closed))) == [[0, 1], [0, 3], [1, 2], [2, 3]]
    assert sorted(closed.angle_triples[:, 1]) == [0, 1, 2, 3]


def test_star_and_free_centre():
    """A single bend leaves the branching point free, a mapping does not."""
    arms = star("C", ["A2"] * 3, SPRING, CosineBend(1.0))
    assert arms.types == ("C", *"AAAAAA")
    assert sorted(map(sorted, pairs_of(arms))) == [[0, 1], [0, 3], [0, 5], [1, 2], [3, 4], [5, 6]]
    assert sorted(arms.angle_triples[:, 1]) == [1, 3, 5]
    assert len(star("C", ["A2"] * 3, SPRING, {("A", "C", "A"): CosineBend(1.0)}).angles) == 3


def test_twists():
    """A single twist leaves the branching point free, a mapping does not; three bonds of a triangle are no dihedral."""
    twist = Twist(1.0, -1, 2)
    assert linear("A5", SPRING, twist=twist).dihedrals == ((0, 1, 2, 3, twist), (1, 2, 3, 4, twist))
    assert not ring("A3", SPRING, twist=twist).dihedrals
    assert sorted(map(sorted, ring("A4", SPRING, twist=twist).dihedral_quads.tolist())) == [[0, 1, 2, 3]] * 4
    arms = star("C", ["A3"] * 3, SPRING, twist=twist)
    assert arms.dihedral_quads.tolist() == [[0, 1, 2, 3], [0, 4, 5, 6], [0, 7, 8, 9]]
    assert len(star("C", ["A3"] * 3, SPRING, twist={("A", "C", "A", "A"): twist}).dihedrals) == 6
    chain = block_copolymer("A2B2", SPRING, twist={("*", "*", "*", "*"): twist, ("B", "B", "A", "A"): OPLSTwist(1, 2, 3, 4)})
    assert chain.dihedrals == ((0, 1, 2, 3, OPLSTwist(1, 2, 3, 4)),)
    one, two = surfactant("H", "T3", SPRING, twist=twist), lipid("H2", ["T3", "T3"], SPRING, twist=twist)
    assert (len(one.dihedrals), len(two.dihedrals)) == (1, 5) and "1 dihedrals" in repr(one)
    assert len(branched("B3", {2: "A"}, SPRING, twist=twist).dihedrals) == 1
    both = Molecule(("A",) * 4, chain.bonds, dihedrals=((0, 1, 2, 3, twist), (3, 2, 1, 0, MultiHarmonicTwist(1, 2, 3, 4, 5))))
    assert len(both.dihedrals) == 2


def test_branched():
    comb = branched("B3", {1: "A2", 2: ["A", "C2"]}, SPRING)
    assert comb.types == ("B", "B", "B", "A", "A", "A", "C", "C")
    assert pairs_of(comb) == [(0, 1), (1, 2), (1, 3), (3, 4), (2, 5), (2, 6), (6, 7)]
    assert formula(surfactant("H2", "T4", SPRING).types) == "H2T4"
    one = lipid("H3", ["T4", "T2"], SPRING, tails_at=[2, 2])
    assert pairs_of(one)[2:4] == [(2, 3), (3, 4)] and (2, 7) in pairs_of(one)
    assert block_copolymer("A6B4", SPRING).n_beads == 10


def test_springs_and_bends_by_types():
    """Later entries before earlier ones, in either direction, and bonds without a spring refused."""
    soft, hard = Spring(1.0, 0.5), Spring(9.0, 0.5)
    chain = linear("A2B", {("*", "*"): soft, ("B", "A"): hard}, {("B", "A", "A"): CosineBend(3.0)})
    assert [bond[2] for bond in chain.bonds] == [soft, hard]
    assert [angle[:3] for angle in chain.angles] == [(0, 1, 2)]
    raises(dpd.ParameterError, "between types 'A' and 'B'", lambda: linear("A2B", {("A", "A"): soft}))


def test_lipid_of_the_literature():
    """Head H-H-H in a row, a tail at the second and at the third head bead, bends at H-T-T and T-T-T only, constants halved."""
    model = grafmueller_2009()
    molecule = model.molecule
    assert formula(molecule.types) == "H3T8"
    assert sorted(map(sorted, pairs_of(molecule))) == [[0, 1], [1, 2], [1, 3], [2, 7], [3, 4], [4, 5], [5, 6], [7, 8], [8, 9], [9, 10]]
    assert {bond[2] for bond in molecule.bonds} == {Spring(64.0, 0.5)}
    found = {tuple(angle[:3]) for angle in molecule.angles} | {tuple(angle[2::-1]) for angle in molecule.angles}
    assert {(1, 3, 4), (3, 4, 5), (4, 5, 6), (2, 7, 8), (7, 8, 9), (8, 9, 10)} <= found and len(molecule.angles) == 6
    pairs = model.pairs()
    assert pairs["H", "T"].A == 35.0 and pairs["T", "W"].A == 75.0 and pairs["T", "T"].gamma == 4.5
    assert model.pairs(gamma=9.0)["W", "W"].gamma == 9.0
    assert len(grafmueller_2009(6).molecule.types) == 15


def test_repulsions_of_groot_and_warren():
    assert like_repulsion() == 25.0
    assert unlike_repulsion(2.86) == pytest.approx(35.0)
    assert unlike_repulsion(0.689, density=5.0) == pytest.approx(16.0)


# -- values ----------------------------------------------------------------------------------------------------------------------
def test_molecules_are_values_named_by_their_formula():
    assert linear("A4", SPRING) == linear("A4", Spring(50.0, 0.7))
    assert len({linear("A4", SPRING), linear("A4", SPRING), linear("A5", SPRING)}) == 2
    assert linear("A4", SPRING) != linear("A4", Spring(50.0, 0.71))
    assert formula(sequence("A3BA3")) == "A3BA3"
    assert linear("A3BA3", SPRING).name == "A3BA3"
    assert linear("A3", SPRING, name="PEO").name == "PEO"


def test_units():
    kJ, nm = unit.kilojoule_per_mole, unit.nanometer
    spring = Spring(50.0 * kJ / nm**2, 7.0 * unit.angstrom)
    assert spring.k == pytest.approx(50.0) and spring.r0 == pytest.approx(0.7)
    assert CosineBend(1.0 * unit.kilocalorie_per_mole).k == pytest.approx(4.184)
    assert Bend(1.0, 180.0 * unit.degree).theta0 == pytest.approx(np.pi)
    assert bead("Na", charge=1.0 * unit.elementary_charge).charges == (1.0,)
    mixture = pack({linear("A4", SPRING): 2}, box=[30.0 * unit.angstrom] * 3, density=0.003 / unit.angstrom**3, seed=1)
    assert mixture.n_beads == 81


test_bad_molecules = refused(
    dpd.ParameterError,
    (lambda: Spring(-1.0, 0.7), "bond k must be >= 0"),
    (lambda: Spring(1.0, 1.0 * unit.picosecond), "r0"),
    (lambda: Bend(1.0, 90.0), "degree"),
    (lambda: FENESpring(10.0, 0.0), "R0 must be > 0"),
    (lambda: linear("A3", 50.0), "spring must be one of"),
    (lambda: linear("A3", SPRING, SPRING), "bend must be one of"),
    (lambda: linear("A4", SPRING, twist=Bend(1, 2)), "twist must be one of Twist, OPLSTwist, MultiHarmonicTwist"),
    (lambda: linear("A4", SPRING, twist={("A", "A"): Twist(1, 1, 1)}), "keys of 4 types"),
    (lambda: Twist(1, 2, 1), "dihedral d must be 1 or -1"),
    (lambda: Molecule(("A", "A"), ((0, 1, SPRING),), dihedrals=((0, 1, 0, 1, Twist(1, 1, 1)),)), "different beads"),
    (lambda: linear("A3", {("A",): SPRING}), "keys of 2 types"),
    (lambda: linear([], SPRING), "type of each bead"),
    (lambda: linear(["A", "*"], SPRING), "type of each bead"),
    (lambda: linear("A3", SPRING, name="two words"), "without blanks"),
    (lambda: linear("A3", SPRING, charges=[1.0]), "3 beads"),
    (lambda: ring("A2", SPRING), "at least 3"),
    (lambda: block_copolymer("A6", SPRING), "at least two types"),
    (lambda: star("C", ["A2"] * 2, SPRING), "at least 3 arms"),
    (lambda: star("C", "A2", SPRING), "at least 3 arms"),
    (lambda: branched("B3", {3: "A"}, SPRING), "beads 0 to 2"),
    (lambda: branched("B3", ["A"], SPRING), "must map"),
    (lambda: star("C", 5, SPRING), "at least 3 arms"),
    (lambda: lipid("H3", "T4", SPRING), "list with one entry"),
    (lambda: lipid("H3", 2, SPRING), "list with one entry"),
    (lambda: lipid("H3", ["T4"], SPRING, tails_at=1), "as many"),
    (lambda: linear("A3", SPRING, charges=1.0), "3 beads"),
    (lambda: linear("A(A1000)1000000", SPRING), "more than 10000000 beads"),
    (lambda: join("A3", None, SPRING), "must be pairs of beads"),
    (lambda: join("A3", [(0, 1, 2)], SPRING), "joins two beads"),
    (lambda: join("A3", [(0, 1), (1.5, 2)], SPRING), "whole number"),
    (lambda: lipid("H3", ["T4"], SPRING, tails_at=[0, 1]), "as many"),
    (lambda: Molecule(("A", "A")), "is not connected"),
    (lambda: Molecule(("A", "A"), ((0, 2, SPRING),)), "different beads of 0 to 1"),
    (lambda: Molecule(("A", "A"), ((0, 0, SPRING),)), "different beads"),
    (lambda: Molecule(("A", "A"), ((0, 1, SPRING), (1, 0, SPRING))), "twice"),
    (lambda: Molecule(("A", "A"), ((0, 1),)), "bead indices and one of"),
    (lambda: Molecule(("A", "A"), ((0, 1.0, SPRING),)), "whole number"),
    (lambda: join("A3", [(0, 1), (1, 3)], SPRING), "names no bead"),
    (lambda: grafmueller_2009(0), "at least 1"),
    (lambda: unlike_repulsion(1.0, density=4.0), "densities 3 and 5"),
    (lambda: unlike_repulsion(1.0, density="x"), "densities 3 and 5"),
    (lambda: unlike_repulsion(float("nan")), "chi holds nan"),
)


# -- packing ---------------------------------------------------------------------------------------------------------------------
def all_kinds() -> dict:
    bend = CosineBend(4.0)
    return {
        linear("A6B4", SPRING, bend, twist=Twist(2.0, -1, 3)): 7,
        ring("A8", SPRING): 3,
        star("C", ["A3", "B3", "A2"], Spring(20.0, 0.5), bend): 4,
        linear("D4", FENESpring(30.0, 1.5, epsilon=1.0)): 2,
        linear("E3", MorseSpring(100.0, 2.0, 0.6), Bend(10.0, 2.0)): 5,
        bead("Na", charge=1.0): 6,
    }


def test_counts_density_and_connectivity():
    """Every bead, bond, angle and dihedral of every molecule is there once, with its own coefficients, and the density is exact."""
    kinds = all_kinds()
    mixture = pack(kinds, solvent="W", density=3.0, box=[6.0, 7.0, 8.0], seed=1)
    assert mixture.n_beads == 3 * 6 * 7 * 8 and mixture.density == pytest.approx(3.0, rel=1e-12)
    assert len(mixture.types) == len(mixture.molecules) == len(mixture.residues) == len(mixture.charges) == mixture.n_beads
    types, springs = np.array(mixture.types), {}
    for bonds in mixture.bonds:
        for row, pair in enumerate(bonds.pairs.tolist()):
            springs[tuple(pair)] = (type(bonds), bonds.k[row] if hasattr(bonds, "k") else bonds.D[row])
    expected = 0
    for molecule, count in kinds.items():
        beads = mixture.beads(molecule)
        assert beads.shape == (count, molecule.n_beads) == (mixture.count(molecule), molecule.n_beads)
        for row in beads:
            assert tuple(types[row]) == molecule.types
            assert len(set(mixture.molecules[row])) == 1
            for i, j, spring in molecule.bonds:
                assert springs[row[i], row[j]] == (spring.KIND, next(iter(spring.coefficients().values())))
                expected += 1
    assert len(springs) == expected == len(mixture.bond_pairs)
    assert len(mixture.angle_triples) == sum(len(molecule.angles) * count for molecule, count in kinds.items())
    assert len(mixture.dihedral_quads) == sum(len(molecule.dihedrals) * count for molecule, count in kinds.items()) == 7 * 7
    assert mixture.charges.sum() == 6.0 and set(types[mixture.charges > 0]) == {"Na"}
    assert len(np.unique(mixture.molecules)) == mixture.molecules.max() == sum(kinds.values()) + mixture.count("W")


def test_bonds_have_their_lengths_and_molecules_are_whole():
    """Without minimum images: a molecule lies in one piece.  Rings may miss their lengths by 2 per cent."""
    kinds = all_kinds()
    mixture = pack(kinds, box=[6.0] * 3, seed=2)
    for molecule in kinds:
        x = mixture.positions[mixture.beads(molecule)]
        for i, j, spring in molecule.bonds:
            length = np.linalg.norm(x[:, i] - x[:, j], axis=1)
            slack = 0.02 if molecule.name == "A8" else 1e-9
            assert np.allclose(length, spring.length(3 ** (-1 / 3)), rtol=slack), molecule.name
        centres = x.mean(axis=1)
        assert np.all((centres >= 0) & (centres <= 6))


@pytest.mark.parametrize("make", [lambda: ring("A61", SPRING), lambda: join("A4", [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)], SPRING)])
def test_rings_close(make):
    molecule = make()
    mixture = pack({molecule: 20}, solvent=None, seed=3)
    lengths = mixture.bonds[0].lengths(mixture.positions, None)
    assert np.abs(lengths / 0.7 - 1).max() <= 0.02


def test_springs_without_a_length_and_bends_at_no_temperature():
    """Such springs get the distance between beads, such bends have their angle."""
    mixture = pack({linear("A5", Spring(2.0, 0.0)): 10}, solvent=None, density=5.0, seed=1)
    assert np.allclose(mixture.bonds[0].lengths(mixture.positions, None), 5 ** (-1 / 3))
    assert FENESpring(30.0, 0.5).length(0.7) == pytest.approx(0.35)  # never near R0
    mixture = pack({linear("A6", SPRING, Bend(10.0, 2.0)): 5}, solvent=None, seed=1, kT=0)
    assert np.allclose(mixture.angles[0].arms(mixture.positions, None)[0], 2.0, atol=1e-3)


def test_end_to_end_distance_of_an_ideal_chain():
    """<R^2> = n b^2 for free joints; with a stiffness b^2 [n (1+c)/(1-c) - 2c (1-c^n)/(1-c)^2], c = <-cos theta> = coth(k) - 1/k."""
    bonds, count = 30, 4000
    for bend, c in ((None, 0.0), (CosineBend(3.0), 1 / np.tanh(3.0) - 1 / 3.0)):
        chain = linear(["A"] * (bonds + 1), SPRING, bend)
        x = pack({chain: count}, solvent=None, seed=5).positions.reshape(count, bonds + 1, 3)
        squares = np.sum((x[:, -1] - x[:, 0]) ** 2, axis=1)
        expected = 0.7**2 * (bonds * (1 + c) / (1 - c) - 2 * c * (1 - c**bonds) / (1 - c) ** 2)
        assert abs(squares.mean() - expected) < 4 * squares.std() / np.sqrt(count)
        # directions are isotropic
        components = np.mean((x[:, -1] - x[:, 0]) ** 2, axis=0)
        assert np.allclose(components, expected / 3, atol=4 * np.sqrt(2 / count) * expected / 3)


def test_same_seed_same_mixture():
    kinds = all_kinds()
    first, again, other = (pack(kinds, box=[6.0] * 3, seed=seed).positions for seed in (7, 7, 8))
    assert np.array_equal(first, again) and not np.allclose(first, other)
    drawn = pack(kinds, box=[6.0] * 3)
    assert np.array_equal(drawn.positions, pack(kinds, box=[6.0] * 3, seed=drawn.seed).positions)


def test_regions_and_triclinic_boxes():
    chain = linear("A4", SPRING)
    slab, ball = dpd.Block([0, 0, 2], [8, 8, 4]), dpd.Sphere([4, 4, 6], 1.0)
    mixture = pack({chain: Scattered(20, slab), bead("B"): Scattered(9, ball)}, box=[8.0] * 3, seed=1)
    assert slab.contains(mixture.positions[mixture.beads(chain)].mean(axis=1)).all()
    assert ball.contains(mixture.positions[mixture.beads("B")[:, 0]]).all()
    mixture = pack({linear("A4", SPRING): 10}, box=[[6, 0, 0], [2, 6, 0], [1, 1, 6]], seed=1)
    assert mixture.n_beads == 648
    fractions = mixture.positions[mixture.beads("W")[:, 0]] @ np.linalg.inv(mixture.box)
    assert fractions.min() >= 0 and fractions.max() <= 1 and fractions.std(axis=0) == pytest.approx(12**-0.5, abs=0.03)


def test_bilayer():
    """Heads outside, tails inside, no water between, both leaflets filled evenly, upright molecules with exact bonds."""
    model = grafmueller_2009()
    mixture = pack({model.molecule: Bilayer(83, normal="y", centre=1.0, upper=42)}, box=[7.0, 12.0, 7.0], seed=1)
    assert mixture.n_beads == 1764
    assert np.allclose(mixture.bonds[0].lengths(mixture.positions, None), 0.5)
    y = mixture.positions[mixture.beads(model.molecule)][:, :, 1] - 1.0
    assert np.sum(y[:, 0] > 0) == 42
    heads, ends = np.abs(y[:, 0]), np.abs(y[:, [6, 10]]).max(axis=1)
    assert np.all(heads > ends + 1.0) and np.all(np.sign(y) == np.sign(y[:, :1]))
    water = mixture.positions[mixture.beads("W")[:, 0], 1]
    assert np.all(np.abs((water - 1.0 + 6) % 12 - 6) >= heads.max())
    upper = mixture.positions[mixture.beads(model.molecule)[y[:, 0] > 0]].mean(axis=1)
    quarters = np.histogram2d(upper[:, 0] % 7, upper[:, 2] % 7, bins=2, range=[[0, 7], [0, 7]])[0]
    assert quarters.min() >= 7 and quarters.max() <= 14  # 42 / 4 = 10.5


def test_mixed_bilayer_shares_its_leaflets():
    long, short = grafmueller_2009(4).molecule, grafmueller_2009(3).molecule
    mixture = pack({long: Bilayer(40), short: Bilayer(20)}, box=[6.0, 6.0, 12.0], seed=1)
    heads = [mixture.positions[mixture.beads(kind)][:, 0] for kind in (long, short)]
    assert [np.sum(x[:, 2] > 6) for x in heads] == [20, 10]
    # the 30 sites of a leaflet are not sorted by kind
    assert all(x[x[:, 2] > 6, 0].std() > 0.2 * 6 for x in heads)


def test_a_melt_makes_its_own_box_and_a_solvent_may_have_several_beads():
    mixture = pack({linear("A10", SPRING): 12}, solvent=None, density=3.0, seed=1)
    assert np.allclose(np.diag(mixture.box), 40 ** (1 / 3)) and mixture.density == pytest.approx(3.0)
    mixture = pack({linear("A4", SPRING): 5}, solvent=linear("S3", SPRING), box=[5.0] * 3, seed=1)
    assert mixture.count("S3") == (375 - 20) // 3


CHAIN = linear("A4", SPRING)
test_bad_packing = refused(
    dpd.ParameterError,
    (lambda: pack({CHAIN: 100}, box=[4.0] * 3), "400 beads, but a density of 3 in a volume of 64 nm.3 allows 192"),
    (lambda: pack({CHAIN: 10}), "must be given"),
    (lambda: pack({}, solvent=None), "nothing to pack"),
    (lambda: pack({}, solvent=None, box=[4.0] * 3), "nothing to pack"),
    (lambda: Bilayer(2, normal=["z"]), "normal must be one of x, y, z"),
    (lambda: Bilayer(2, centre=[1.0, 2.0]), "the centre of a bilayer must be a single number"),
    (lambda: pack([CHAIN], box=[4.0] * 3), "must map"),
    (lambda: pack({"W": 10}, box=[4.0] * 3), "single bead"),
    (lambda: pack({CHAIN: -1}, box=[4.0] * 3), "at least 0"),
    (lambda: pack({CHAIN: 2.0}, box=[4.0] * 3), "whole number"),
    (lambda: pack({CHAIN: 1}, box=[4.0] * 3, density=0), "density"),
    (lambda: pack({CHAIN: 1}, box=[4.0] * 3, density=3 / unit.nanometer), "per volume"),
    (lambda: pack({CHAIN: 1}, box=[4.0] * 3, solvent=3), "solvent must be"),
    (lambda: pack({CHAIN: 1}, box=[4.0] * 3, seed=-1), "seed"),
    (lambda: pack({CHAIN: Scattered(1, dpd.Sphere([50, 50, 50], 1))}, box=[4.0] * 3), "no room"),
    (lambda: pack({CHAIN: Scattered(1, "left")}, box=[4.0] * 3), "Block or a Sphere"),
    (lambda: pack({CHAIN: Bilayer(2)}, box=[4.0, 4.0, 2.0]), "does not fit"),
    (lambda: pack({ring("A4", SPRING): Bilayer(2)}, box=[4.0] * 3), "has a ring"),
    (lambda: pack({CHAIN: Bilayer(2)}, box=[[6, 0, 0], [2, 6, 0], [1, 1, 6]]), "orthorhombic"),
    (lambda: pack({CHAIN: Bilayer(2, centre=1), bead("B"): Bilayer(2, centre=9.5)}, box=[4, 4, 10]), "bilayer of A4 and the .* B overlap"),
    (lambda: pack({CHAIN: Bilayer(2), bead("B"): Bilayer(2, normal="x")}, box=[9.0] * 3), "bilayer of A4 and the .* B cross"),
    (lambda: Bilayer(2, normal="w"), "normal must be one of x, y, z"),
    (lambda: Bilayer(2, upper=3), "more than the 2"),
    (lambda: pack({CHAIN: 1}, box=[4.0] * 3, seed=1).beads("X"), "no molecule 'X'.*A4, W"),
)


# -- scenes ----------------------------------------------------------------------------------------------------------------------
def test_scene_has_it_all():
    kinds = all_kinds()
    mixture = pack(kinds, box=[6.0] * 3, seed=1)
    said = f"{np.count_nonzero(mixture.charges)} charged beads, but the scene has no `electrostatics`"
    with pytest.warns(UserWarning, match=said):
        scene = mixture.scene(pairs=PAIRS, kT=1.0, bonded_factors=(0.5, 1.0, 1.0))
    assert said in dpd.build(scene, dt=0.01, seed=1).explain()
    assert list(scene.types) == mixture.types and scene.bonded_factors == (0.5, 1.0, 1.0)
    assert set(scene.masses) == {"A", "B", "C", "D", "E", "Na", "W"} and np.array_equal(scene.charges, mixture.charges)
    assert len(scene.bonds) == 3 and len(scene.angles) == 2 and len(scene.dihedrals) == 1
    topology = dpd.build(scene, dt=0.01, platform="Reference", seed=1).topology
    names = [residue.name for residue in topology.residues()]
    assert names[0] == "A6B4" and names[-1] == "W" and topology.getNumBonds() == len(mixture.bond_pairs)
    charged = {"electrostatics": dpd.SlaterCharges(lamda=0.25, bjerrum_length=1.0)}
    raises(TypeError, "presure", lambda: mixture.scene(pairs=PAIRS, kT=1.0, **charged, presure=1.0))
    with pytest.warns(UserWarning, match="the charges add up to 6 e"):  # and nothing else is said
        heavy = mixture.scene(pairs=PAIRS, kT=1.0, masses={name: 2.0 for name in scene.masses}, **charged)
    assert said not in dpd.build(heavy, dt=0.01, seed=1).explain()
    assert heavy.bead_masses.min() == 2.0


def test_names_and_masses_that_are_not_clear():
    short, long = linear("A2", SPRING, name="chain"), linear("A4", SPRING, name="chain")
    mixture = pack({short: 2, long: 3}, box=[4, 4, 4], seed=1)
    assert mixture.beads(long).shape == (3, 4)
    raises(dpd.ParameterError, "2 kinds of molecules have the name 'chain'", lambda: mixture.beads("chain"))
    # the same molecule as solvent: all of them
    assert pack({short: 2}, solvent=short, box=[2, 2, 2], seed=1).count(short) == 12
    raises(dpd.ParameterError, "no mass of the bead type 'W'", lambda: mixture.write_psf("never_written.psf", masses={"A": 1.0}))


def test_relax_makes_it_quiet():
    """Forces fall, molecules stay whole, and the first steps stay near kT."""
    model = grafmueller_2009()
    scene = pack({model.molecule: 20}, box=[6.0] * 3, seed=1).scene(pairs=model.pairs(), kT=1.0)
    quiet = relax(scene, iterations=60, platform="CPU")
    largest = []
    for one in (scene, quiet):
        simulation = dpd.build(one, dt=0.02, platform="CPU", seed=1).simulation()
        forces = simulation.context.getState(forces=True).getForces(asNumpy=True)._value
        largest.append(np.sqrt(np.sum(forces**2, axis=1)).max())
    assert largest[1] < 0.2 * largest[0]
    bonds = quiet.bonds[0].lengths(quiet.positions, None)
    assert 0.3 < bonds.min() and bonds.max() < 0.8
    warm = relax(scene, iterations=60, steps=100, dt=0.01, platform="CPU")
    kT = np.mean(warm.velocities**2)
    assert abs(kT - 1) < 0.2  # 648 beads: 0.032 is one standard error; heat that the minimiser left is still on its way out
    assert relax(scene, iterations=0, platform="CPU").velocities is None


@cases(
    "spring",
    FENESpring(20.0, 1.5, 1.0, 0.5),
    FENESpring(30.0, 1.5, 1.0, 1.0),
    FENESpring(100.0, 0.6, 0.0, 1.0),
    MorseSpring(100.0, 3.0, 0.6),
    ids=["fene with a light repulsion", "fene", "short fene", "morse"],
)
def test_chains_start(spring):
    """No bond breaks or goes through the box on the way down, and the first steps run."""
    for molecule, conservative in ((ring("A6", spring), "openmm"), (star("B", ["A3"] * 3, spring), "kernel")):
        scene = pack({molecule: 12}, box=[6.0] * 3, seed=4).scene(pairs=PAIRS, kT=1.0)
        built = dpd.build(scene, dt=0.001, conservative=conservative, loop=conservative == "kernel", platform="CPU", seed=1)
        simulation = built.simulation()
        energies = []
        for iterations in (60, 300, 1):
            energies.append(simulation.context.getState(energy=True).getPotentialEnergy()._value)
            simulation.minimizeEnergy(0.01, iterations)
        assert energies[0] - energies[1] > 0.9 * (energies[0] - energies[2]) > 0
        x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
        (bonds,) = scene.bonds
        np.testing.assert_allclose(bonds.lengths(x, None), bonds.lengths(x, scene.box), atol=1e-6)
        simulation.step(10)


@pytest.mark.parametrize("seed", range(6))
def test_relaxed_fene_chains(seed):
    mixture = pack({linear("A10", FENESpring(20.0, 1.5, 1.0, 0.5)): 20}, solvent="W", density=3, box=[8.0] * 3, seed=seed)
    scene = mixture.scene(masses=1.0, pairs={("*", "*"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0)
    quiet = relax(scene, platform="CPU")
    assert quiet.bonds[0].lengths(quiet.positions, None).max() < 1.2
    assert abs(np.mean(relax(quiet, iterations=0, steps=50, dt=0.01, platform="CPU").velocities ** 2) - 1) < 0.25


def test_relax_keeps_fixed_beads():
    mixture = pack({linear("A4", SPRING): 10}, box=[4.0] * 3, seed=1)
    fixed = np.arange(mixture.n_beads) < 4
    scene = mixture.scene(pairs=PAIRS, kT=1.0, mobile=~fixed)
    quiet = relax(scene, iterations=20, platform="Reference")
    assert np.array_equal(quiet.positions[fixed], scene.positions[fixed])
    assert not np.allclose(quiet.positions[~fixed], scene.positions[~fixed])


def test_relax_says_what_is_wrong():
    mixture = pack({linear("A4", SPRING): 1}, box=[4.0] * 3, seed=1)
    raises(dpd.ParameterError, "scene must be a Scene", lambda: relax(mixture))
    raises(dpd.ParameterError, "step size", lambda: relax(mixture.scene(pairs=PAIRS, kT=1.0), steps=10))
    hard = pack({linear("A4", Spring(1e6, 0.7)): 20}, box=[4.0] * 3, seed=1).scene(pairs=PAIRS, kT=1.0)
    raises(dpd.RunError, "smaller dt than 10", lambda: relax(hard, steps=400, dt=10.0, platform="Reference"))
