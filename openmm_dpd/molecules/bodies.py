"""Beads of rigid bodies of common shapes or of a mesh, and such bodies at random in a fluid."""

import os

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.geometry import pairs_within
from ..base.units import to_md, whole_number
from ..model.box import box_vectors
from ..model.pairs import checked
from ..model.shapes import MeshShape


def body_shape(shape: str, size, spacing) -> np.ndarray:
    """(n, 3) places of the beads of a body about its centre, nm.

    Parameters
    ----------
    shape : {"sphere", "shell", "rod", "disc", "cube"}, or path-like
        A solid or a hollow sphere, a line along x, a flat disc in the plane of x and y, or a solid cube; or a file with the mesh of a
        solid, for which :class:`openmm_dpd.shapes.MeshShape` says what is read and what is raised.
    size : length
        Radius of a sphere, shell or disc, length of a rod, edge of a cube; for a mesh the unit of the numbers in its file.
    spacing : length
        Distance of neighbours, about.

    Examples
    --------
    >>> from openmm_dpd.molecules import body_shape
    >>> len(body_shape("shell", 1.0, 0.5)), len(body_shape("rod", 2.0, 0.5))
    (58, 5)
    """
    size, spacing = checked(size, "length", "the size of a body", positive=True), checked(spacing, "length", "the spacing", positive=True)
    known = isinstance(shape, str) and shape in ("sphere", "shell", "rod", "disc", "cube")
    if not known and not (isinstance(shape, str | os.PathLike) and os.path.splitext(shape)[1]):
        raise ParameterError(f"the shape of a body must be sphere, shell, rod, disc, cube or a file of a mesh, not {what_is(shape)}")
    if shape == "shell":  # on a spiral, each with the same area
        n = max(4, round(4 * np.pi * size**2 / (0.5 * np.sqrt(3) * spacing**2)))
        z, turn = 1 - (2 * np.arange(n) + 1) / n, np.pi * (3 - np.sqrt(5)) * np.arange(n)
        return size * np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    if shape in ("rod", "cube"):
        line = np.linspace(-0.5 * size, 0.5 * size, round(size / spacing) + 1)
        across = line if shape == "cube" else np.zeros(1)
        return np.stack(np.meshgrid(line, across, across, indexing="ij"), axis=-1).reshape(-1, 3)
    mesh = None
    if not known:
        mesh = MeshShape(shape, size, (0.0, 0.0, 0.0))
        size = float(np.linalg.norm(mesh.vertices, axis=1).max())
    reach = np.arange(-int(2 * size / spacing) - 2, int(2 * size / spacing) + 3)
    cells = np.stack(np.meshgrid(reach, reach, [0] if shape == "disc" else reach, indexing="ij"), axis=-1).reshape(-1, 3)
    found = spacing * cells @ np.array([[1, 0, 0], [0.5, np.sqrt(0.75), 0], [0.5, np.sqrt(1 / 12), np.sqrt(2 / 3)]])  # closest packing
    found = found[np.sum(found**2, axis=1) <= size**2 * (1 + 1e-9)]
    if mesh is not None:
        found = found[(np.abs(found) <= mesh.vertices.max(axis=0)).all(axis=1)]  # distances take long
        found = found[mesh.distance(found, np.full(3, 4 * size)) <= 0]
        if len(found) < 2:
            raise ParameterError(f"the {mesh.title} has room for {len(found)} beads: give a larger unit, or a smaller spacing")
        found -= found.mean(axis=0)
    return found


def suspension(places, count: int, box, *, apart, density: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Bodies at random places and in random directions in a periodic box, without overlap, and beads of a fluid between them.

    Parameters
    ----------
    places : (n, 3) array of lengths
        Beads of a body about its centre, such as :func:`body_shape` makes.
    count : int
        Number of bodies.
    box : (3,) or (3, 3) array of lengths
        Edges or box vectors.
    apart : length
        Least distance between beads of different bodies, and of the fluid from them.
    density : float
        Beads of the fluid per nm^3 of the box, including the room that bodies take.
    seed : int

    Returns
    -------
    bodies : (count, n, 3) array
        Whole, so that they may extend beyond the box; ``Body(range(n * k, n * k + n))`` is body k of a scene that begins with them.
    fluid : (m, 3) array

    Raises
    ------
    ParameterError
        If there is no room for the bodies.
    """
    rng, vectors, x = np.random.default_rng(seed), box_vectors(box), np.asarray(to_md(places, "length", "places"))
    if vectors is None:
        raise ParameterError("a suspension needs a box")
    apart, made = checked(apart, "length", "apart"), np.zeros((0, len(x), 3))
    for _ in range(whole_number(count, "the number of bodies", least=1)):
        for _ in range(300):
            turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
            one = x @ (turn * np.linalg.det(turn)) + rng.random(3) @ vectors
            if not len(made) or not len(pairs_within(one, made.reshape(-1, 3), vectors, apart)[0]):
                made = np.concatenate([made, one[None]])
                break
        else:
            raise ParameterError(f"there is room for {len(made)} bodies, {apart:g} nm apart; give a larger box")
    fluid = rng.random((round(density * float(np.prod(np.diag(vectors)))), 3)) @ vectors
    return made, np.delete(fluid, pairs_within(fluid, made.reshape(-1, 3), vectors, apart)[0], axis=0)
