"""Shapes of rigid bodies, and bodies in a fluid."""

import numpy as np
from cases import cases, refused

import openmm_dpd as dpd
from openmm_dpd.base.geometry import pairs_within
from openmm_dpd.molecules import body_shape, suspension


@cases(
    "shape, size, beads, inertia",
    ("sphere", 1.5, None, (0.4 * 2.25, 0.4 * 2.25, 0.4 * 2.25)),
    ("shell", 2.0, None, (2 / 3 * 4, 2 / 3 * 4, 2 / 3 * 4)),
    ("rod", 3.0, 13, (0, 0.875, 0.875)),
    ("disc", 2.0, None, (1, 1, 2)),
    ("cube", 1.5, 7**3, (0.5, 0.5, 0.5)),
)
def test_shapes_have_the_moments_of_inertia_of_solids(shape, size, beads, inertia):
    """Per unit of mass, those of points on edges exactly, others within what a spacing of 0.25 makes; neighbours are not much nearer than that."""
    x = body_shape(shape, size, 0.25)
    assert beads is None or len(x) == beads
    squares = np.mean(x**2, axis=0)
    found = squares.sum() - squares
    np.testing.assert_allclose(found, inertia, rtol=0.1, atol=1e-12)
    assert np.abs(x.mean(axis=0)).max() < 1e-3
    nearest = np.full(len(x), np.inf)
    i, j, r = pairs_within(x, None, None, 0.4)
    np.minimum.at(nearest, i, r)
    np.minimum.at(nearest, j, r)
    assert 0.18 < nearest.min() and nearest.max() < 0.3


def test_bodies_in_a_fluid_do_not_overlap():
    shape, box = body_shape("rod", 2.0, 0.4), np.diag([6.0, 5.0, 7.0])
    bodies, fluid = suspension(shape, 8, box, apart=0.6, density=2.0, seed=3)
    assert bodies.shape == (8, 6, 3) and 0.6 * 2 * 210 < len(fluid) < 2 * 210
    assert not len(pairs_within(fluid, bodies.reshape(-1, 3), box, 0.6)[0])
    i, j, _ = pairs_within(bodies.reshape(-1, 3), None, box, 0.6)
    assert np.array_equal(i // 6, j // 6)
    lengths = np.linalg.norm(bodies - bodies[:, :1], axis=2)
    np.testing.assert_allclose(lengths, np.linalg.norm(shape - shape[0], axis=1)[None].repeat(8, axis=0))


test_what_is_refused = refused(
    dpd.ParameterError,
    (lambda: body_shape("egg", 1.0, 0.3), "must be sphere, shell"),
    (lambda: body_shape("rod", 0.0, 0.3), "size of a body must be > 0"),
    (lambda: body_shape("rod", 1.0, 0.0), "spacing must be > 0"),
    (lambda: suspension(body_shape("rod", 2.0, 0.5), 9, [2.5] * 3, apart=1.0, density=1.0), "there is room for"),
)
