"""Kernels of bonds and angles: OpenMM's own forces on the Reference platform, derivatives, threads, and what has no energy."""

import chains_of_beads as chains
import numpy as np
import pytest
import reference_forces as check
from cases import cases, raises
from reference_forces import BOXES
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.base.errors import RunError
from openmm_dpd.kernels.bonded import angle
from openmm_dpd.kernels.extras import _kernel, warm_up_extras
from openmm_dpd.plan.kinds import bonded_forces
from openmm_dpd.plan.pair_spec import extras
from openmm_dpd.runtime.threads import set_threads


def varied(low, high, count):
    """A different coefficient for each term."""
    return np.random.default_rng(count).uniform(low, high, count)


KINDS = {  # Kind -> terms for the bonds (B, 2) or angles (K, 3) of a chain.
    "harmonic": lambda b, a: {"bonds": [dpd.HarmonicBonds(b, varied(10, 60, len(b)), varied(0, 1, len(b)))]},
    "fene": lambda b, a: {"bonds": [dpd.FENEBonds(b, varied(10, 60, len(b)), varied(1.2, 2, len(b)))]},
    "fene with repulsion": lambda b, a: {"bonds": [dpd.FENEBonds(b, 30.0, 1.5, np.arange(len(b)) % 3 * 0.4, varied(0.6, 1.1, len(b)))]},
    "morse": lambda b, a: {"bonds": [dpd.MorseBonds(b, varied(5, 20, len(b)), varied(1, 3, len(b)), varied(0.3, 1, len(b)))]},
    "nonlinear": lambda b, a: {"bonds": [dpd.NonlinearBonds(b, varied(5, 20, len(b)), varied(0.6, 1, len(b)), varied(0.4, 1, len(b)))]},
    "quartic": lambda b, a: {"bonds": [dpd.QuarticBonds(b, varied(500, 900, len(b)), -0.55, varied(0.2, 0.4, len(b)), 1.3, 3.0)]},
    "harmonic angle": lambda b, a: {"angles": [dpd.HarmonicAngles(a, varied(2, 8, len(a)), varied(0, np.pi, len(a)))]},
    "cosine angle": lambda b, a: {"angles": [dpd.CosineAngles(a, varied(2, 8, len(a)))]},
    "delta and squared angles": lambda b, a: {
        "angles": [
            dpd.CosineDeltaAngles(a[::2], varied(2, 8, len(a[::2])), varied(0, np.pi, len(a[::2]))),
            dpd.CosineSquaredAngles(a[1::2], varied(2, 8, len(a[1::2])), varied(0, np.pi, len(a[1::2]))),
        ]
    },
    "periodic angles": lambda b, a: {
        "angles": [dpd.PeriodicAngles(a, varied(2, 8, len(a)), 1 - np.arange(len(a)) % 2 * 2, 1 + np.arange(len(a)) % 6)]
    },
    "all": lambda b, a: {
        "bonds": [dpd.HarmonicBonds(b[::3], 20, 0.7), dpd.FENEBonds(b[1::3], 30, 1.5, 0.8, 0.9), dpd.MorseBonds(b[2::3], 12, 1.7, 0.6)],
        "angles": [dpd.HarmonicAngles(a[::2], 6.0, 1.9), dpd.CosineAngles(a[1::2], 4.0)],
    },
}
EVERY_KIND = pytest.mark.parametrize("kind", KINDS)


def chain_scene(kind, box, number=50, length=8):
    """Random chains strewn over images of a box, their positions, and box vectors."""
    vectors = BOXES[box]
    edges = np.diag([5.0] * 3) if vectors is None else vectors
    x, bonds, angles = chains.walks(number, length, edges, 3, step=0.8, spread=0 if vectors is None else 2)
    return beads(len(x), positions=x, box=vectors, **KINDS[kind](bonds, angles)), x, vectors


def terms_of(scene):
    return extras(scene, (), {})


@EVERY_KIND
@pytest.mark.parametrize("box", BOXES)
def test_openmm_gives_the_same_and_forces_are_the_gradient(kind, box):
    scene, x, vectors = chain_scene(kind, box)
    forces = bonded_forces((*scene.bonds, *scene.angles), vectors is not None)
    check.check_agreement(terms_of(scene), forces, x, vectors)
    check.check_gradient(terms_of(scene), x, vectors, every=13)
    check.check_total_force(terms_of(scene), x, vectors)


@EVERY_KIND
def test_the_same_bits_for_any_number_of_threads(kind, two_threads):
    scene, x, vectors = chain_scene(kind, "tilted", number=700)
    check.check_threads(terms_of(scene), x, vectors)
    check.check_pickle(terms_of(scene), x, vectors)


def test_a_bead_with_many_bonds(two_threads):
    """A star, whose centre is in every term, and beads without any."""
    x = np.random.default_rng(2).random((700, 3)) * 0.8
    bonds = np.array([(0, k) for k in range(1, 600)])
    angles = np.array([(k, 0, k + 1) for k in range(1, 599)])
    scene = beads(700, positions=x, box=None, bonds=[dpd.HarmonicBonds(bonds, 30.0, 0.4)], angles=[dpd.CosineAngles(angles, 3.0)])
    check.check_threads(terms_of(scene), x, None)
    check.check_total_force(terms_of(scene), x, None)
    _, force = check.evaluate(terms_of(scene), x, None)
    assert not force[600:].any()


def test_the_arc_tangent():
    """To 2 in the last digit, over all angles and both arms of any length."""
    theta = np.concatenate([np.random.default_rng(1).random(2000) * np.pi, 10.0 ** np.arange(-15, 0), np.pi - 10.0 ** np.arange(-15, 0)])
    for size in (1e-9, 1.0, 1e9):
        s, c = size * np.sin(theta), size * np.cos(theta)
        mine = [angle.py_func(*pair) for pair in zip(s.tolist(), c.tolist(), strict=True)]
        np.testing.assert_allclose(mine, np.arctan2(s, c), rtol=5e-16)
    assert [angle.py_func(*pair) for pair in ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (0.0, 0.0))] == [0.0, np.pi / 2, np.pi, 0.0]


def pair(*bonds):
    return beads(2, positions=np.array([[1.0, 1, 1], [1.5, 1, 1]]), bonds=bonds)


@pytest.mark.parametrize("rest", [0.0, 0.7])
def test_beads_at_the_same_point(rest):
    """No force, and the energy of that length, as OpenMM has it."""
    x = np.ones((2, 3))
    for bond in (dpd.HarmonicBonds([(0, 1)], 20.0, rest), dpd.MorseBonds([(0, 1)], 5.0, 2.0, rest), dpd.FENEBonds([(0, 1)], 20.0, 1.0)):
        scene = pair(bond)
        energy, force = check.evaluate(terms_of(scene), x, scene.box)
        expected, expected_force = check.reference(bonded_forces(scene.bonds, True), x, scene.box)
        assert energy == pytest.approx(expected, rel=1e-14, abs=1e-14) and not force.any() and not expected_force.any()


@cases("kind", lambda t: dpd.HarmonicAngles(t, 6.0, 1.9), lambda t: dpd.CosineAngles(t, 4.0), ids=["harmonic", "cosine"])
def test_angles_of_beads_in_line(kind):
    """Straight, folded back, and with an arm of no length: finite, and as OpenMM wherever it has a number."""
    for places in ([0.0, 1.0, 2.5], [0.0, 1.0, 0.5]):
        x = np.array([[place, 0.3 * place, 0.2] for place in places])
        scene = beads(3, positions=x, box=None, angles=[kind([(0, 1, 2)])])
        energy, force = check.evaluate(terms_of(scene), x, None)
        expected, expected_force = check.reference(bonded_forces(scene.angles, False), x, None)
        assert energy == pytest.approx(expected, rel=1e-7, abs=1e-9)
        np.testing.assert_allclose(force, expected_force, atol=1e-6)
    x = np.array([[1.0, 1, 1], [1.0, 1, 1], [1.5, 1, 1]])
    energy, force = check.evaluate(terms_of(scene), x, None)
    assert np.isfinite(energy) and not force.any()


FENE = dpd.FENEBonds([(2, 3), (0, 1), (4, 5)], 20.0, [1.0, 1.0, 1.1], [0.0, 1.0, 0.0], 0.3)


@pytest.mark.parametrize("length", [1.0, 1.2, np.inf, np.nextafter(1.0, 0)])
def test_a_bond_that_is_too_long(length):
    """The words in which the scene refuses it."""
    x = np.array([[0.0, 0, 0], [0.5, 0, 0]] * 3)
    scene = beads(6, positions=x, box=None, bonds=[dpd.HarmonicBonds([(0, 2)], 1.0, 1.0), FENE])
    x[3, 0] = length
    words = FENE.overstretched(x, None)
    if words is None:  # shorter than R0 by less than rounding: 1 - (r/R0)^2 is a number still
        assert np.isfinite(check.evaluate(terms_of(scene), x, None)[0])
        return
    assert "long, which is not less than its R0" in words
    with pytest.raises(RunError) as caught:
        check.evaluate(terms_of(scene), x, None)
    assert str(caught.value) == f"{words}; the step size may be too large"


def test_what_has_no_energy():
    x = np.array([[0.0, 0, 0], [0.5, 0, 0]] * 3)
    scene = beads(6, positions=x, box=None, bonds=[FENE])
    x[1] = x[0]
    with pytest.raises(RunError) as caught:
        check.evaluate(terms_of(scene), x, None)
    assert str(caught.value) == f"{FENE.overstretched(x, None)}; the step size may be too large"
    x[5, 1] = np.nan
    with pytest.raises(RunError, match=r"FENE bond between beads 4 and 5 \(counted from 0\) is nan nm long, which is not less than"):
        check.evaluate(terms_of(scene), x, None)
    with pytest.raises(RunError, match=r"the bond between beads 0 and 1 \(counted from 0\) is nan nm long, where it has no finite energy"):
        check.evaluate(terms_of(pair(dpd.HarmonicBonds([(0, 1)], 1.0, 1.0))), np.full((2, 3), np.nan), None)
    bent = beads(6, positions=np.random.default_rng(1).random((6, 3)), box=None, angles=[dpd.CosineAngles([(0, 1, 2), (3, 4, 5)], 1.0)])
    raises(RunError, "an angle of the beads 3, 4 and 5", lambda: check.evaluate(terms_of(bent), x, None))


@pytest.mark.parametrize("threads", [1, 2])
def test_warming_up_compiles_everything(threads, two_threads):
    """Nothing is left to compile at the first call."""
    set_threads(threads)
    scene, x, _ = chain_scene("all", "none", number=1000)
    warm_up_extras(terms_of(scene))
    kernels = [_kernel(type(terms)) for terms in terms_of(scene)]
    before = [kernel.versions for kernel in kernels]
    assert before == [1] * 5
    box = np.diag([500.0] * 3)
    box.flags.writeable = False
    assert check.evaluate(terms_of(scene), x, box)[0] == pytest.approx(check.evaluate(terms_of(scene), x, None)[0])
    assert [kernel.versions for kernel in kernels] == before
