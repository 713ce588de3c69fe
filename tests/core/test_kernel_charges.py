"""Kernel of smeared charges: exact lattice sums, OpenMM's forces on the Reference platform, derivatives, threads."""

import warnings
from itertools import combinations

import numpy as np
import openmm
import pytest
import reference_forces as check
from cases import every_pair, raises
from oracle_charges import gaussian_tail, lattice_sum, slater_tail

import openmm_dpd as dpd
from openmm_dpd.base.geometry import AXES_OF_TENSOR, symmetric_products
from openmm_dpd.kernels.charges import cost, pme_cost
from openmm_dpd.kernels.extras import warm_up_extras
from openmm_dpd.kernels.waves import LANES, WEIGHTS, Waves
from openmm_dpd.model.electrostatics import ewald_sum
from openmm_dpd.plan.charge_forces import charge_terms, longest_wave
from openmm_dpd.plan.forces.electrostatics import electrostatic_forces
from openmm_dpd.units import COULOMB

BOXES = {"none": None, "cubic": np.eye(3) * 4.65, "orthorhombic": np.diag([4.7, 6.3, 5.2])}
BOXES["tilted"] = np.array([[6.0, 0, 0], [1.9, 5.5, 0], [-2.8, 2.2, 4.9]])
KINDS = {  # Widths so narrow, or wide, that nothing is left of the clouds at the cutoff, and their tails in the oracle.
    "slater": (dpd.SlaterCharges, {"lamda": 0.13}, slater_tail, 0.13),
    "narrow": (dpd.SlaterCharges, {"lamda": 0.02}, slater_tail, 0.02),
    "gaussian": (dpd.GaussianCharges, {"width": 0.19}, gaussian_tail, 0.19),
}
#: Settings of a sum that is exact to 1e-10 or so, and of one that OpenMM's PME can follow.
EXACT = {"tolerance": 1e-10, "cutoff": 2.3, "alpha": 2.4, "grid": (48, 48, 48)}
SMOOTH = {"tolerance": 1e-7, "cutoff": 2.3, "alpha": 1.7, "grid": (108, 108, 108)}
FACTORS = {(0, 1): 0.0, (1, 2): 0.5, (0, 2): 0.8, (3, 7): 0.25, (4, 9): 0.0, (5, 30): 0.0}

EVERY_KIND = pytest.mark.parametrize("kind", KINDS)
EVERY_BOX = pytest.mark.parametrize("box", BOXES)


def beads(box, n=40, ions=26, seed=1, spread=2, total=0.0):
    """Beads strewn over images of the box, about half of them charged, two bonded ones at the same point."""
    rng = np.random.default_rng(seed)
    vectors = BOXES[box]
    x = rng.random((n, 3)) @ (np.eye(3) * 4.0 if vectors is None else vectors)
    x[7] = x[3]
    if vectors is not None:
        x += rng.integers(-spread, spread + 1, x.shape) @ vectors
    q = np.zeros(n)
    q[:ions] = rng.choice([-1.0, 1.0, 2.0, 0.5], ions)
    q[:ions] += (total - q.sum()) / ions
    order = np.concatenate([np.arange(10), 10 + rng.permutation(n - 10)])
    return np.ascontiguousarray(x), q[order]


def scene(x, q, electrostatics, box):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        pairs = {("W", "W"): dpd.DPD(A=0.0, gamma=1.0)}
        return dpd.Scene({"W": 1.0}, ["W"] * len(x), x, pairs, kT=1.0, box=box, charges=q, electrostatics=electrostatics)


def charges_of(kind, box, **options):
    maker, width, *_ = KINDS[kind]
    return maker(**width, permittivity=0.5 * COULOMB, **({} if box == "none" else options))


def terms_of(kind, box, x, q, factors=None, **options):
    electrostatics = charges_of(kind, box, **(options or EXACT))
    vectors = BOXES[box] if isinstance(box, str) else box
    ewald = None if vectors is None else ewald_sum(electrostatics, vectors, int(np.count_nonzero(q)))
    return charge_terms(scene(x, q, electrostatics, vectors), ewald, factors or {})


def image(d, vectors):
    """The vector of a bond by minimum image, axis by axis as OpenMM has it; far apart in a tilted box it is not the shortest one."""
    for k in (2, 1, 0) if vectors is not None else ():
        d = d - np.round(d[k] / vectors[k, k]) * vectors[k]
    return d


def exact(kind, x, q, vectors, factors):
    """Energy, forces and virial from exact lattice sums and plain sums over pairs; the Coulomb constant is 2."""
    _, _, tail, width = KINDS[kind]
    potential = charges_of(kind, "none").potential
    if vectors is None:
        energy, forces, virial = 0.0, np.zeros_like(x), 0.0
        corrections = {pair: factors.get(pair, 1.0) for pair in combinations(range(len(x)), 2)}
    else:
        energy, forces, virial = lattice_sum(x, q, vectors, tail, width, accuracy=13.0)
        corrections = {pair: factor - 1.0 for pair, factor in factors.items()}
    for (i, j), factor in corrections.items():
        d = image(x[i] - x[j], vectors)
        r, qq = float(np.linalg.norm(d)), factor * q[i] * q[j]
        energy += qq * float(potential(r))
        if r > 1e-9:
            pull = qq * (1 - tail(r, width)[1]) / r**3 * d
            forces[i] += pull
            forces[j] -= pull
            virial += float(pull @ d)
    return 2 * energy, 2 * forces, 2 * virial


@every_pair("kind, box, total", list(KINDS), list(BOXES), (0.0, 1.5))
def test_exact_sums(kind, box, total):
    """Beads beyond the box, exceptions, a pair at the same point, a net charge."""
    x, q = beads(box, total=total)
    terms = terms_of(kind, box, x, q, FACTORS)
    energy, forces, virial = exact(kind, x, q, BOXES[box], FACTORS)
    found, force = check.evaluate([terms], x, BOXES[box])
    assert found == pytest.approx(energy, abs=1e-8 * np.abs(q).sum())
    np.testing.assert_allclose(force, forces, rtol=0, atol=1e-8 * np.abs(forces).max())
    parts = terms.evaluator().parts(x, BOXES[box])
    assert sum(parts[:2]) == pytest.approx(found, rel=1e-13)
    assert parts[2][:3].sum() == pytest.approx(virial, abs=1e-7 * np.abs(q).sum())
    assert (parts[1] == 0.0) == (box == "none")


@pytest.mark.parametrize("kind", ["slater", "gaussian"])
@EVERY_BOX
def test_openmm_gives_the_same(kind, box):
    """Energies of both parts and forces, as far as PME goes."""
    x, q = beads(box, seed=2, total=0.5)
    electrostatics, vectors = charges_of(kind, box, **SMOOTH), BOXES[box]
    ewald = None if vectors is None else ewald_sum(electrostatics, vectors, int(np.count_nonzero(q)))
    terms = charge_terms(scene(x, q, electrostatics, vectors), ewald, FACTORS)
    forces = electrostatic_forces(electrostatics, q, electrostatics.coulomb(1.0), ewald, FACTORS | {(11, 12): 1.0}, listed=False)
    check.check_agreement([terms], forces, x, vectors, 2e-6)
    short, lattice, stress = terms.evaluator().parts(x, vectors)
    pme = [force for force in forces if isinstance(force, openmm.NonbondedForce)]
    size = float(np.sum(q**2))
    if vectors is not None:
        assert lattice == pytest.approx(check.reference(pme, x, vectors)[0], abs=2e-7 * size)
    else:
        assert not pme and lattice == 0.0
        np.testing.assert_allclose(stress, symmetric_products(x, check.evaluate([terms], x, None)[1]), rtol=1e-9, atol=1e-9 * size)


@pytest.mark.parametrize("listed", [{}, {"tolerance": 1e-5}, {"tolerance": 1e-7}])
@pytest.mark.parametrize("box", ["cubic", "tilted"])
def test_the_error_is_that_of_the_cutoff(box, listed):
    """Waves that are left out make a relative error of forces below 1e-6, or below the tolerance."""
    x, q = beads(box, n=60, ions=50)
    options = {**EXACT, **listed} if listed else {**EXACT, "tolerance": 1e-4}
    errors = min(options["tolerance"], 1e-6)
    terms = terms_of("slater", box, x, q, **options)
    energy, forces, virial = exact("slater", x, q, BOXES[box], {})
    found, force = check.evaluate([terms], x, BOXES[box])
    assert 1e-4 * errors < np.sqrt(np.sum((force - forces) ** 2) / np.sum(forces**2)) < errors
    assert found == pytest.approx(energy, rel=errors)
    assert terms.evaluator().parts(x, BOXES[box])[2][:3].sum() == pytest.approx(virial, rel=20 * errors)


@pytest.mark.parametrize("k_max", [9.0, 6.93])  # at the second one rows begin with a single wave
@pytest.mark.parametrize("box", ["cubic", "tilted"])
def test_every_wave_once(box, k_max):
    """All waves of half a sphere, each with its weight."""
    vectors, alpha = BOXES[box], 1.3
    waves = Waves.of(vectors, k_max, alpha, 1.0)
    found = {}
    for block, (first, n3, deep, row) in enumerate(waves.blocks.tolist()):
        for n1 in range(deep):
            for lane in range(LANES):
                for side, sign in enumerate((1, -1)):
                    weight = waves.weights[WEIGHTS * (row + n1) + LANES * side + lane]
                    if weight:
                        assert n1 < waves.depth[LANES * block + lane]
                        assert (sign * n1, first + lane, n3) not in found
                        found[sign * n1, first + lane, n3] = weight
    most = 12
    n = np.array(np.meshgrid(*[np.arange(-most, most + 1)] * 3, indexing="ij")).reshape(3, -1).T
    k2 = np.sum((2 * np.pi * n @ np.linalg.inv(vectors).T) ** 2, axis=1)
    inside = (k2 > 0) & (k2 <= k_max**2)
    assert np.abs(n[inside]).max() < most
    assert 2 * len(found) == inside.sum()
    volume = np.prod(np.diag(vectors))
    for wave, square in zip(n[inside].tolist(), k2[inside], strict=True):
        assert (tuple(wave) in found) != (tuple(-m for m in wave) in found)
        if tuple(wave) in found:
            weight = 4 * np.pi / volume * np.exp(-square / (4 * alpha**2)) / square
            assert found[tuple(wave)] == pytest.approx(weight, rel=1e-10)


@EVERY_KIND
@EVERY_BOX
def test_forces_are_the_gradient_and_sum_up_to_nothing(kind, box):
    x, q = beads(box, seed=3)
    terms = [terms_of(kind, box, x, q, FACTORS)]
    if kind != "narrow":
        check.check_gradient(terms, x, BOXES[box], every=9)
    check.check_total_force(terms, x, BOXES[box])


@EVERY_BOX
def test_the_same_bits_for_any_number_of_threads(box, two_threads):
    x, q = beads(box, n=90, ions=70)
    terms = [terms_of("slater", box, x, q, FACTORS)]
    check.check_threads(terms, x, BOXES[box])
    check.check_pickle(terms, x, BOXES[box])


@pytest.mark.parametrize("box", ["cubic", "tilted"])
def test_the_stress_has_the_slopes_of_the_energy(box):
    """Box and positions strained in six ways, the widths kept."""
    x, q = beads(box, seed=4, spread=0, total=1.0)
    evaluator = terms_of("slater", box, x, q, FACTORS).evaluator()
    vectors, h, force = BOXES[box], 1e-5, np.zeros_like(x)
    stress = evaluator.parts(x, vectors)[2]
    for (first, second), component in zip(AXES_OF_TENSOR, stress, strict=True):
        strain = np.zeros((3, 3))
        strain[second, first] = h
        up, down = (evaluator.add_to(x @ (np.eye(3) + s), vectors @ (np.eye(3) + s), force, 1.0) for s in (strain, -strain))
        assert component == pytest.approx(-(up - down) / (2 * h), rel=1e-6, abs=1e-7 * np.abs(stress).max())


def test_a_box_that_changes():
    """One evaluator through several boxes gives the bits of a new one in each, and what is the same box takes the same waves."""
    x, q = beads("cubic", spread=0)
    terms = terms_of("slater", "cubic", x, q)
    evaluator = terms.evaluator()
    for box in (np.eye(3) * 4.6, np.eye(3) * 4.7, BOXES["tilted"], np.diag([7.0, 4.6, 5.5]), np.eye(3) * 4.6):
        force, again, other = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
        energy = evaluator.add_to(x, box, force, 1.0)
        waves = evaluator._waves
        assert evaluator.add_to(x, box.copy(), again, 1.0) == energy and evaluator._waves is waves
        assert terms.evaluator().add_to(x, box, other, 1.0) == energy
        assert np.array_equal(force, other) and np.array_equal(force, again)
        wanted, forces, _ = exact("slater", x, q, box, {})
        assert energy == pytest.approx(wanted, abs=1e-7)
        np.testing.assert_allclose(force, forces, rtol=0, atol=1e-8 * np.abs(forces).max())
    small = np.diag([4.6, 4.6, 4.5])
    raises(dpd.RunError, "narrower than twice the cutoff of the charges, 2.3 nm", evaluator.add_to, x, small, force, 1.0)


@EVERY_KIND
@EVERY_BOX
def test_charges_at_the_same_point(kind, box):
    """Their energy is that of touching clouds, they exert nothing on each other, and nothing happens on the way there."""
    vectors = BOXES[box]
    x = np.array([[1.0, 1, 1], [1.0, 1, 1], [2.5, 2, 1.5]])
    q = np.array([1.0, -1.0, 0.5])
    for factors in ({}, {(0, 1): 0.3}):
        terms, energies = terms_of(kind, box, x, q, factors), []
        for distance in (0.0, 1e-160, 1e-13):
            x[1, 0] = 1.0 + distance
            if distance == 1e-160:
                x[:2, 0] = 0.0, distance
            energy, force = check.evaluate([terms], x, vectors)
            assert np.all(np.isfinite(force))
            energies.append(energy)
            wanted, forces, _ = exact(kind, x, q, vectors, factors)
            assert energy == pytest.approx(wanted, abs=1e-7)
            np.testing.assert_allclose(force, forces, rtol=0, atol=1e-5)
            x[:2, 0] = 1.0


@EVERY_KIND
def test_polynomials(kind):
    """The functions that the kernel has are those of the model, smooth to rounding."""
    x, q = beads("cubic")
    terms, charges = terms_of(kind, "cubic", x, q, **EXACT), charges_of(kind, "cubic", **EXACT)
    k = charges.steepness
    for table, whole in ((terms.whole, True), (terms.short, False)):
        place = (np.arange(9 * len(table.coefficients)) + 0.5) / 9
        r, piece, t = place / table.per_length, place.astype(int), place % 1
        found = np.sum(table.coefficients[piece] * t[:, None] ** np.arange(6), axis=1)
        image = 0.0 if whole else dpd.GaussianCharges(width=0.5 / EXACT["alpha"], permittivity=1.0).potential(r)
        np.testing.assert_allclose(found, charges.potential(r) - image, rtol=0, atol=1e-12 * k)
        ends = table.coefficients.sum(axis=1)[:-1] - table.coefficients[1:, 0]
        slopes = table.coefficients @ np.arange(6)
        assert np.abs(ends).max() < 1e-14 * k and np.abs(slopes[:-1] - table.coefficients[1:, 1]).max() < 1e-14 * k
        assert table.coefficients[0, 1] == 0.0


def test_what_is_no_number():
    x, q = beads("cubic")
    for box in ("cubic", "none"):
        terms = terms_of("slater", box, x, q)
        uncharged, charged = (int(np.flatnonzero((q == 0) == none)[0]) for none in (True, False))
        moved = x.copy()
        moved[uncharged] = np.nan
        assert check.evaluate([terms], moved, BOXES[box])[0] == check.evaluate([terms], x, BOXES[box])[0]
        for bad in (np.nan, np.inf):
            moved[charged, 1] = bad
            raises(dpd.RunError, f"position of bead {charged} is not finite", check.evaluate, [terms], moved, BOXES[box])


def test_scenes_without_charges_and_with_one():
    x, q = beads("cubic")
    assert charge_terms(scene(x, None, None, BOXES["cubic"]), None, {}) is None
    q = np.where(np.arange(len(x)) == 5, 2.0, 0.0)
    for box in ("cubic", "tilted", "none"):
        energy, force = check.evaluate([terms_of("slater", box, x, q)], x, BOXES[box])
        assert energy == pytest.approx(exact("slater", x, q, BOXES[box], {})[0], abs=1e-8) and np.abs(force).max() < 1e-10


@EVERY_BOX
def test_warming_up_compiles_all(box):
    """Nothing is compiled after that."""
    from openmm_dpd.kernels.charges import charge_forces

    x, q = beads(box)
    terms = terms_of("gaussian", box, x, q, FACTORS)
    warm_up_extras([terms])
    before = charge_forces.versions
    check.evaluate([terms], x, BOXES[box])
    assert charge_forces.versions == before


def test_costs_are_estimated():
    """The order is right: few charges are faster wave by wave, many are not."""
    assert np.exp(-((longest_wave(1.7, 1e-6) / 3.4) ** 2)) == pytest.approx(1e-6)
    k_max, cubes = longest_wave(1.5, 1e-6), {edge: np.eye(3) * edge for edge in (5, 6, 30)}
    assert 10 < cost(44, cubes[5], k_max, 2.0) < 100
    assert cost(44, cubes[5], k_max, 2.0) < 0.2 * pme_cost((63, 63, 63), 375)
    assert cost(20_000, cubes[30], k_max, 2.0) > pme_cost((120, 120, 120), 81_000)
    assert cost(100, None, 0.0, np.inf) < cost(1000, None, 0.0, np.inf)
    assert cost(1000, cubes[5], k_max, 2.0) < cost(1000, cubes[6], 1.5 * k_max, 2.0)


@pytest.mark.parametrize("box", ["none", "tilted"])
@pytest.mark.parametrize("options", [{}, {"screening": 1.7}, {"softness": 0.4, "strength": 0.6}, {"softness": 0.01}, {"strength": 0.6}])
@pytest.mark.parametrize("lattice", [True, False])
def test_point_charges(options, lattice, box):
    """With a lattice sum and with a cutoff, screened or softened or not: OpenMM's, and the derivative of the energy."""
    soft = {name: value for name, value in options.items() if name != "screening"}
    if lattice and soft != options:
        pytest.skip("screened charges have no lattice sum")
    options = {"permittivity": 0.5 * COULOMB, **(SMOOTH if lattice else {"lattice": False, "cutoff": 2.3}), **options}
    if box == "none":
        options = {"permittivity": 0.5 * COULOMB, **soft}
    x, q = beads(box)
    x[7] += 0.3
    electrostatics, vectors = dpd.PointCharges(**options), BOXES[box]
    made = scene(x, q, electrostatics, vectors)
    terms = charge_terms(made, made.ewald, FACTORS)
    check.check_agreement([terms], electrostatic_forces(electrostatics, q, 2.0, made.ewald, FACTORS, listed=False), x, vectors, 2e-6, 2e-6)
    check.check_gradient([terms], x, vectors, every=7)
    if options.get("lattice") is False:
        pairs, energy = np.array(list(combinations(range(len(q)), 2))), 0.0
        r = np.linalg.norm([image(x[i] - x[j], vectors) for i, j in pairs], axis=1)
        f = np.array([FACTORS.get((i, j), 1.0) for i, j in pairs.tolist()])
        energy = np.sum(2.0 * f * q[pairs[:, 0]] * q[pairs[:, 1]] * np.where(r < 2.3, electrostatics.potential(r), 0.0))
        direct = options.get("strength", 1.0) / np.sqrt(r**2 + options.get("softness", 0.0) ** 2)
        np.testing.assert_allclose(electrostatics.potential(r), np.exp(-electrostatics.screening * r) * direct, rtol=1e-14)
        assert check.evaluate([terms], x, vectors)[0] == pytest.approx(energy, rel=1e-10)


def test_point_charges_that_make_no_sense():
    raises(dpd.ParameterError, "screened charges have no lattice sum", dpd.PointCharges, permittivity=1.0, screening=1.0)
    raises(dpd.ParameterError, "without a lattice sum need a cutoff", dpd.PointCharges, permittivity=1.0, lattice=False)
    raises(dpd.ParameterError, "strength of PointCharges must be between 0 and 1, not 2", dpd.PointCharges, permittivity=1.0, strength=2)
    screened = {"permittivity": 1.0, "lattice": False, "cutoff": 1.0, "screening": 1.0}
    raises(dpd.ParameterError, "screened charges are not softened", dpd.PointCharges, **screened, softness=0.1)
