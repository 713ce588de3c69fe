"""Shapes of walls, as signed distances: negative in the solid, positive outside, 0 on the surface.

Shapes repeat with the box.  Lengths may be Quantities; an axis is "x", "y", "z" or three components.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
import scipy

from ..base.errors import ParameterError, in_length, optional_package, require, what_is
from ..base.units import checked, keep, to_md
from .flow import AXES
from .formulas import read_formula, values
from .sources import point


class WallShape:
    """Base of the shapes of walls."""

    def __post_init__(self):
        """Keep what there is, checked by its name."""
        what = f"of a {type(self).__name__}"
        for its in fields(self):  # type: ignore[arg-type]  # each shape is a dataclass
            name, value = its.name, getattr(self, its.name)
            if name in ("centre", "size"):
                value = point(value, f"the {name} {what}")
            elif name in ("radius", "end_radius", "length") and value is not None:
                value = checked(value, "length", f"the {name} {what}", positive=name == "length")
            elif name == "axis":
                if isinstance(value, str) and value not in AXES:
                    raise ParameterError(f"the axis {what} must be 'x', 'y', 'z' or three components, not {what_is(value)}")
                value = np.eye(3)[AXES.index(value)] if isinstance(value, str) else point(value, f"the axis {what}")
                if not value.any():
                    raise ParameterError(f"the axis {what} has the length 0")
                value = value / np.linalg.norm(value)
            elif name == "shapes":
                value = tuple(value) if isinstance(value, Sequence) else (value,)
            if name in ("shape", "without", "shapes"):
                _require_shapes(value if name == "shapes" else (value,), f"each shape {what}")
            keep(self, **{name: value})

    def distance(self, points: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """(N,) signed distances, nm, of points (N, 3) in a box with these edges (3,); ParameterError if the shape does not fit into it."""
        raise NotImplementedError

    def marks(self, edges: np.ndarray, spacing: float) -> np.ndarray:
        """(M, 2, 3) points that a grid with this spacing has to show as surface, where the distance there is 0, and normals there."""
        its = [getattr(self, name, ()) for name in ("shape", "without", "shapes")]
        inner = [shape for each in its for shape in (each if isinstance(each, tuple) else (each,))]
        return np.concatenate([np.zeros((0, 2, 3)), *(shape.marks(edges, spacing) for shape in inner)])

    @property
    def title(self) -> str:
        """In words, for messages."""
        return type(self).__name__


def _require_shapes(shapes: Sequence, what: str) -> None:
    wrong = [shape for shape in shapes if not isinstance(shape, WallShape)]
    if wrong or not shapes:
        raise ParameterError(f"{what} must be a shape such as Ball(...), not {what_is(wrong[0] if wrong else shapes)}")


def _from(centre: np.ndarray, points: np.ndarray, edges: np.ndarray, reach: np.ndarray, what: str) -> np.ndarray:
    """Vectors to points from the nearest image of a centre; ParameterError if something that reaches so far from it meets its images."""
    for axis, half, edge in zip(AXES, reach, edges, strict=True):
        if half > 0.5 * edge * (1 + 1e-9):
            raise ParameterError(f"{what} is longer along {axis}, {2 * half:g} nm, than the box, {edge:g} nm; its images would overlap")
    d = points - centre
    return d - edges * np.rint(d / edges)


@dataclass(frozen=True, eq=False)
class Ball(WallShape):
    """A solid ball with a ``centre`` and a ``radius``."""

    centre: np.ndarray
    radius: float

    def distance(self, points, edges):
        return np.linalg.norm(_from(self.centre, points, edges, np.full(3, self.radius), "a ball"), axis=1) - self.radius


@dataclass(frozen=True, eq=False)
class Cone(WallShape):
    """A solid cone or frustum, with the ``centre`` in the middle of its ``axis``, along which the radius changes evenly over the ``length``
    from ``radius`` to ``end_radius`` (0: a tip)."""

    centre: np.ndarray
    axis: str | np.ndarray
    length: float
    radius: float
    end_radius: float = 0.0

    def distance(self, points, edges):
        across = np.sqrt(np.clip(1.0 - np.square(self.axis), 0.0, None))
        reach = 0.5 * self.length * np.abs(self.axis) + max(self.radius, self.end_radius) * across
        d = _from(self.centre, points, edges, reach, "a cone or cylinder")
        # the nearest part may be one of the next image along each axis
        return np.min([self._alone(d - np.where(d > 0, edges, -edges) * other) for other in np.ndindex(2, 2, 2)], axis=0)

    def _alone(self, d: np.ndarray) -> np.ndarray:
        """Distances at vectors (N, 3) from the centre, without images."""
        axis, half, first, change = np.asarray(self.axis), 0.5 * self.length, self.radius, self.end_radius - self.radius
        along = d @ axis
        across = np.linalg.norm(d - np.outer(along, axis), axis=1)
        # in the half plane of the axis: the nearest points of the caps and of the side
        caps = np.hypot(np.maximum(0.0, across - np.where(along < 0, first, self.end_radius)), np.abs(along) - half)
        t = np.clip(((across - first) * change + (along + half) * self.length) / (change**2 + self.length**2), 0.0, 1.0)
        side = np.hypot(across - first - t * change, along + half - t * self.length)
        inside = (np.abs(along) < half) & (across < first + (along + half) / self.length * change)
        return np.where(inside, -1.0, 1.0) * np.minimum(caps, side)


@dataclass(frozen=True, eq=False)
class Cylinder(WallShape):
    """A solid cylinder with an ``axis`` through its ``centre``, and a ``radius``.  Without a ``length`` it goes through the box, along one
    of its axes.  Its :class:`Complement` is a pipe."""

    centre: np.ndarray
    axis: str | np.ndarray
    radius: float
    length: float | None = None

    def __post_init__(self):
        super().__post_init__()
        if self.length is None and np.count_nonzero(self.axis) > 1:
            raise ParameterError("a cylinder without a length goes along an axis of the box, 'x', 'y' or 'z'")

    def distance(self, points, edges):
        if self.length is not None:
            return Cone(self.centre, self.axis, self.length, self.radius, self.radius).distance(points, edges)
        across = np.where(np.asarray(self.axis) == 0.0, 1.0, 0.0)
        return np.linalg.norm(_from(self.centre, points, edges, across * self.radius, "a cylinder") * across, axis=1) - self.radius


@dataclass(frozen=True, eq=False)
class RoundedBox(WallShape):
    """A solid block around a ``centre``, of a ``size`` along each axis (as long as the box: it goes through), whose edges have a
    ``radius``."""

    centre: np.ndarray
    size: np.ndarray
    radius: float = 0.0

    def __post_init__(self):
        super().__post_init__()
        if not (self.size > 0).all() or 2 * self.radius > self.size.min():
            raise ParameterError("the size of a rounded box must be > 0, and at least twice its radius, along each axis")

    def distance(self, points, edges):
        d = np.abs(_from(self.centre, points, edges, 0.5 * self.size, "a rounded box"))
        beyond = np.where(self.size > edges * (1 - 1e-9), -edges.max(), d - (0.5 * self.size - self.radius))
        return np.linalg.norm(np.clip(beyond, 0.0, None), axis=1) + np.minimum(beyond.max(axis=1), 0.0) - self.radius

    def marks(self, edges, spacing):
        normals = np.concatenate([np.eye(3), -np.eye(3)])[np.tile(self.size < edges * (1 - 1e-9), 2)]
        return np.stack([self.centre + 0.5 * self.size * normals, normals], axis=1)


@dataclass(frozen=True, eq=False)
class FormulaShape(WallShape):
    """Solid where a ``formula`` of x, y and z (nm, wrapped into the box), in OpenMM's expression language, is negative, such as
    ``"z - 1 - 0.3*sin(x)"``.  It should change about as evenly as a distance."""

    formula: str

    def __post_init__(self):
        read_formula(str(self.formula), AXES, "a wall")

    def distance(self, points, edges):
        variables = dict(zip(AXES, (points - edges * np.floor(points / edges)).T, strict=True))
        found = np.array(np.broadcast_to(values(read_formula(str(self.formula), AXES, "a wall"), variables), len(points)), dtype=float)
        if not np.isfinite(found).all():
            x, y, z = points[np.argmin(np.isfinite(found))]
            raise ParameterError(f"the formula '{self.formula}' of a wall has no finite value at ({x:g}, {y:g}, {z:g})")
        return found


@dataclass(frozen=True, eq=False)
class GridShape(WallShape):
    """Signed ``distances`` (K, L, M), nm, at the points (k/K, l/L, m/M) of the edges of the box, for anything else, such as a mesh or a
    scan.  Straight lines go between them."""

    distances: np.ndarray

    def __post_init__(self):
        found = np.asarray(to_md(self.distances, "length", "the distances of a wall"))
        if found.ndim != 3 or min(found.shape) < 2:
            raise ParameterError(f"the distances of a wall must be an array of three dimensions, not of shape {found.shape}")
        keep(self, distances=found)

    def distance(self, points, edges):
        return scipy.ndimage.map_coordinates(self.distances, (points / edges * self.distances.shape).T, order=1, mode="grid-wrap")


@dataclass(frozen=True, eq=False)
class MeshShape(WallShape):
    """The solid inside a closed mesh of triangles, from an STL, OBJ or OFF file.  A mesh as long as the box goes on in its next image: its
    flat ends on the faces of the box are no walls.

    Distances, and what is inside (by winding numbers, for any orientation of the mesh), are those of libigl: ``pip install
    openmm-dpd[mesh]``.

    Parameters
    ----------
    file : path-like
    unit : length
        Of the numbers in the file, nm: such files have no unit.
    centre : three lengths, optional
        Where the middle of its extents is; by default the numbers in the file are places in the box.

    Raises
    ------
    ParameterError
        If the file is no mesh, or the mesh has holes or edges with more than two triangles; later, if it is larger than the box or outside
        of it, or has parts that the grid does not show.
    """

    file: str | os.PathLike
    unit: float
    centre: Sequence[float] | np.ndarray | None = None
    #: (V, 3) from the middle of its extents, and (T, 3) of each triangle
    vertices: np.ndarray = field(init=False, repr=False)
    faces: np.ndarray = field(init=False, repr=False)
    as_read: bool = field(init=False, repr=False)  #: Whether it is where the numbers in the file say

    def __post_init__(self):
        require(self.file, str | os.PathLike, "a mesh is in a file, given by its path")
        if not os.path.isfile(self.file):
            raise ParameterError(f"there is no file {os.fspath(self.file)} with a mesh")
        igl, what = optional_package("igl", "mesh", "meshes need"), f"the mesh {os.fspath(self.file)}"
        if str(self.file).lower().endswith(".ply"):  # at polygons, and if they are cut off, libigl ends the process
            raise ParameterError(f"{what} cannot be read: save it as STL, OBJ or OFF")
        try:
            vertices, faces = igl.read_triangle_mesh(os.fspath(self.file))
        except RuntimeError as error:
            raise ParameterError(f"{what} cannot be read as STL, OBJ or OFF: {error}") from None
        unit = checked(self.unit, "length", f"the unit of {what}", positive=True)
        centre = self.centre if self.centre is None else point(self.centre, f"the centre of {what}")
        if not len(faces) or not np.isfinite(vertices).all():
            raise ParameterError(f"{what} has {len(faces)} triangles" + " with places that are no numbers" * bool(len(faces)))
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ParameterError(f"{what} has triangles with corners that are not there: it has {len(vertices)} corners")
        vertices, faces = vertices[np.unique(faces)], np.unique(faces, return_inverse=True)[1].reshape(faces.shape)  # no others
        vertices, _, _, faces = igl.remove_duplicate_vertices(vertices, faces, 1e-6 * float(np.ptp(vertices, axis=0).max()))
        faces, _ = igl.bfs_orient(faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)])
        ends = igl.boundary_facets(faces)[0]
        if len(ends) or not igl.is_edge_manifold(faces)[0]:
            where = f"{len(ends)} edges have one triangle" if len(ends) else "some edges have more than two triangles"
            raise ParameterError(f"{what} is not closed: {where}; mend it in the program that made it")
        middle = unit * 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        keep(self, vertices=unit * vertices - middle, faces=faces, unit=unit, as_read=centre is None)
        keep(self, centre=middle if centre is None else centre)

    @property
    def title(self):
        size = " x ".join(in_length(edge, 3) for edge in np.ptp(self.vertices, axis=0))
        return f"mesh {os.path.basename(self.file)} of {size} (by its unit)"

    def distance(self, points, edges):
        igl, (half, v) = optional_package("igl", "mesh", "meshes need"), (self.vertices.max(axis=0), self.vertices)
        if self.as_read and (np.abs(self.centre - 0.5 * edges) > half + 0.5 * edges).any():
            raise ParameterError(f"the {self.title} is outside the box; give it a centre, or another unit")
        # files have numbers of single precision, so that ends are near the faces of the box, not on them
        d = _from(np.asarray(self.centre), points, edges, half * (1 - 1e-6), f"the {self.title}")
        full = half > 0.5 * edges * (1 - 1e-6)
        solid = np.abs(igl.fast_winding_number(v, self.faces, np.where(full, np.clip(d, (1e-5 - 1) * half, (1 - 1e-5) * half), d))) > 0.5
        ends = full & ((np.abs(v[self.faces]) > half * (1 - 1e-6)).all(axis=1) & (np.ptp(v[self.faces], axis=1) < half))
        sides, best = self.faces[~ends.any(axis=1)], np.full(len(d), np.inf)
        for other in np.ndindex(2, 2, 2) if len(sides) else ():
            image = d - np.where(d > 0, edges, -edges) * other
            near = np.sum(np.maximum(np.abs(image) - half, 0.0) ** 2, axis=1) < best
            best[near] = np.minimum(best[near], igl.point_mesh_squared_distance(image[near], v, sides)[0])
        return np.where(solid, -1.0, 1.0) * np.sqrt(np.minimum(best, np.sum(edges**2)))

    def marks(self, edges, spacing):
        corners = self.vertices[self.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        n = int(np.sum(areas) / spacing**2) + 1
        which = np.searchsorted(np.cumsum(areas), (np.arange(n) + 0.5) * (np.sum(areas) / n)).clip(max=len(areas) - 1)
        s, t = np.outer([0.7548776662466927, 0.5698402909980532], np.arange(n)) % 1.0  # evenly in a square, whose half is the triangle
        s, t = np.where(s + t > 1.0, 1.0 - s, s)[:, None], np.where(s + t > 1.0, 1.0 - t, t)[:, None]
        its = corners[which]
        points = self.centre + (1.0 - s - t) * its[:, 0] + s * its[:, 1] + t * its[:, 2]
        return np.stack([points, normals[which] / areas[which, None]], axis=1)


@dataclass(frozen=True, eq=False)
class Union(WallShape):
    """Solid where any of a sequence of ``shapes`` is."""

    shapes: Sequence[WallShape]

    def distance(self, points, edges):
        return np.min([shape.distance(points, edges) for shape in self.shapes], axis=0)


@dataclass(frozen=True, eq=False)
class Complement(WallShape):
    """Solid where a ``shape`` is not: the fluid fills it."""

    shape: WallShape

    @property
    def title(self):
        return f"complement of {self.shape.title}"

    def distance(self, points, edges):
        return -self.shape.distance(points, edges)


@dataclass(frozen=True, eq=False)
class Difference(WallShape):
    """Solid where the first ``shape`` is and the second, ``without``, is not."""

    shape: WallShape
    without: WallShape

    def distance(self, points, edges):
        return np.maximum(self.shape.distance(points, edges), -self.without.distance(points, edges))


@dataclass(frozen=True, eq=False)
class SolidWall:
    """A wall of any shape from which beads bounce back (no slip), at the point and the time where they would cross it.

    The velocity v of a bead becomes 2 u - v, with the velocity u of the wall at that point.  This keeps the Maxwell distribution about u
    and a uniform density, at any step.  Impulses are recorded, as force and torque (:class:`openmm_dpd.measure.SolidReporter`).  A wall
    exerts no other force: frozen beads behind it keep the first layers as the fluid is (:func:`openmm_dpd.molecules.frozen_layer`).

    The wall is where the distances at the points of a grid, with straight lines between them, are 0.  They are a tenth of the longest
    cutoff apart, or more if that would be more than four million; ``explain()`` has the error.

    Parameters
    ----------
    shape : Ball, Cylinder, Union, ...
        Where the solid is.  It repeats with the box, which may not be tilted.
    velocity, spin : three velocities, three rates, default 0
        Velocity, nm/ps, and angular velocity, rad/ps, in which the shape does not change.  Immobile beads in the solid move with it.
    centre : three lengths, default (0, 0, 0)
        A point of the axis of the spin, to which torques refer.
    """

    shape: WallShape
    velocity: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)

    kind = "bounce-back"
    driven = True
    behind = None

    def __post_init__(self):
        _require_shapes([self.shape], "the shape of a wall")
        for name, dimension in (("velocity", "velocity"), ("spin", "rate"), ("centre", "length")):
            found = np.asarray(to_md(getattr(self, name), dimension, f"the {name} of a wall"))
            if found.shape != (3,):
                raise ParameterError(f"the {name} of a wall must be three components, not {what_is(getattr(self, name))}")
            keep(self, **{name: found})

    @property
    def moves(self) -> bool:
        """Whether it has a velocity anywhere."""
        return bool(np.any(self.velocity) or np.any(self.spin))
