"""Walls and bodies from files of meshes: distances beside those of shapes, ends on the faces of the box, what is refused."""

import numpy as np
import pytest
from cases import cases
from meshes import BALL, revolved, written

import openmm_dpd as dpd
from openmm_dpd.molecules import body_shape
from openmm_dpd.plan.solids import solids_of
from openmm_dpd.shapes import Ball, Complement, Cone, Cylinder, MeshShape, SolidWall, Union

pytest.importorskip("igl", reason="libigl is not installed: pip install -e '.[mesh]'")
EDGES = np.array([5.0, 6.0, 5.5])
CAN = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def test_distances_are_those_of_the_shapes_that_meshes_follow(tmp_path):
    """A ball across faces of the box, by its unit, half of its triangles turned inside out; a cone whose nearest part is often one of the
    next image; a pipe as long as the box, whose ends are open."""
    x = np.random.default_rng(1).random((2000, 3)) * 3 * EDGES - EDGES
    x[:500, 2] = 0.0  # on the faces that the ends of the pipe are on
    triangles = revolved(BALL)
    triangles[::2] = triangles[::2, ::-1]
    ball, where = MeshShape(written(tmp_path / "ball.stl", triangles), 1.3, (0.2, 5.9, 1.0)), Ball((0.2, 5.9, 1.0), 1.3)
    np.testing.assert_allclose(ball.distance(x, EDGES), where.distance(x, EDGES), atol=0.004)
    cone = revolved([(0, 0), (1.4, 0), (0.3, 4.5), (0, 4.5)])
    cone, where = MeshShape(written(tmp_path / "cone.stl", cone), 1.0, (2.0, 3.0, 2.0)), Cone((2.0, 3.0, 2.0), "z", 4.5, 1.4, 0.3)
    np.testing.assert_allclose(cone.distance(x, EDGES), where.distance(x, EDGES), atol=0.004)
    tube = revolved([(0, 0), (2.0, 0), (2.0, EDGES[2]), (0, EDGES[2])]) + [2.5, 3.0, 0.0]
    pipe = Complement(MeshShape(written(tmp_path / "tube.stl", tube), 1.0))
    np.testing.assert_allclose(pipe.distance(x, EDGES), Complement(Cylinder((2.5, 3.0, 0), "z", 2.0)).distance(x, EDGES), atol=0.004)
    quads = "".join(f"v {a} {b} {c}\n" for a in (0, 1) for b in (0, 1) for c in (0, 1))
    (tmp_path / "cube.obj").write_text(quads + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n")
    (tmp_path / "cube.obj").write_text((tmp_path / "cube.obj").read_text() + "v 9 9 9\n")  # a corner of no triangle
    cube = MeshShape(tmp_path / "cube.obj", 2.0).distance(x[500:], EDGES)
    assert np.array_equal(cube < 0, (x[500:] % EDGES < 2.0).all(axis=1))
    made = solids_of([SolidWall(Union([pipe, cone]))], np.diag(EDGES), 3.0, np.ones(1))
    assert (made.distance(x)[0] < 0).mean() == pytest.approx(
        ((pipe.distance(x, EDGES) < 0) | (where.distance(x, EDGES) < 0)).mean(), abs=0.02
    )


@cases(
    "outline, unit, centre, match",
    (BALL, 10.0, None, "mesh a.stl of 20 nm x 20 nm x 20 nm .by its unit. is longer along x"),
    (BALL, 0.01, (1, 1, 1), "has no surface in the box: all of it is fluid|thinner or nearer"),
    (np.add(BALL, (0, 9)), 1.0, None, "is outside the box; give it a centre, or another unit"),
    (np.multiply(CAN, (1.5, 0.15)), 1.0, (2, 3, 2), "thinner or nearer to each other than the spacing of the grid, 0.2 nm"),
    (BALL[3:], 1.0, (2, 3, 2), "a.stl is not closed: 64 edges have one triangle"),
    ([*CAN, (1.0, 0.0), (1.0, -1.0), (0.0, -1.0)], 1.0, (2, 3, 2), "not closed: some edges have more than two"),
    ([], 1.0, (2, 3, 2), "a.stl has 0 triangles|cannot be read"),
)
def test_what_is_refused(tmp_path, outline, unit, centre, match):
    triangles = revolved(outline) if len(outline) else []
    if "more than two" in match:
        triangles = np.concatenate([revolved(CAN), revolved(CAN) * [1, 1, -1]])
    path = written(tmp_path / "a.stl", triangles)
    with pytest.raises(dpd.ParameterError, match=match):
        solids_of([SolidWall(MeshShape(path, unit, centre))], np.diag(EDGES), 2.0, np.ones(1))
    (tmp_path / "c.off").write_text("OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 900000000\n")
    (tmp_path / "d.PLY").write_text("ply\n")
    others = {"there is no file .*b.stl": tmp_path / "b.stl", "c.off has triangles with corners that are not there": tmp_path / "c.off"}
    for match, file in {**others, "d.PLY cannot be read: save it as STL": tmp_path / "d.PLY", "path, not 7": 7}.items():
        with pytest.raises(dpd.ParameterError, match=match):
            MeshShape(file, 1.0)


def test_bodies_fill_a_mesh(tmp_path):
    """Moments of inertia of a cylinder of radius 2 and length 3, per unit of mass; neighbours are one spacing apart."""
    path = written(tmp_path / "can.stl", revolved(CAN))
    with pytest.raises(dpd.ParameterError, match="room for . beads: give a larger unit"):
        body_shape(path, 1.0, 1.9)
    with pytest.raises(dpd.ParameterError, match="or a file of a mesh, not"):
        body_shape(np.zeros((3, 3)), 1.0, 0.2)
    long = written(tmp_path / "long.stl", revolved(np.multiply(CAN, (2.0, 3.0))))
    x = body_shape(str(long), 1.0, 0.25)
    squares = np.mean(x**2, axis=0)
    np.testing.assert_allclose(squares, [1.0, 1.0, 0.75], rtol=0.05)
    assert len(x) == pytest.approx(12 * np.pi * np.sqrt(2) / 0.25**3, rel=0.05) and np.abs(x.mean(axis=0)).max() < 1e-12
