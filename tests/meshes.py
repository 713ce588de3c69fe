"""Meshes of triangles that tests write: bodies of revolution, as STL files."""

from pathlib import Path

import numpy as np

BALL = [(np.sin(t), -np.cos(t)) for t in np.linspace(0.0, np.pi, 33)]


def revolved(outline, sides: int = 64) -> np.ndarray:
    """(T, 3, 3) corners of the triangles of a body of revolution about z, from points (r, z) from one end to the other."""
    turn = 2 * np.pi * np.arange(sides + 1) / sides
    rings = np.array([np.stack([r * np.cos(turn), r * np.sin(turn), np.full(sides + 1, z)], axis=1) for r, z in outline])
    a, b, c, d = rings[:-1, :-1], rings[:-1, 1:], rings[1:, 1:], rings[1:, :-1]
    found = np.concatenate([np.stack(three, axis=2).reshape(-1, 3, 3) for three in ((a, b, c), (a, c, d))])
    return found[np.linalg.norm(np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]), axis=1) > 1e-12]


def written(path: Path, triangles) -> Path:
    """An STL file of triangles (T, 3, 3)."""
    facets = ("".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in each) for each in triangles)
    path.write_text("solid s\n" + "".join(f"facet normal 0 0 0\nouter loop\n{each}endloop\nendfacet\n" for each in facets) + "endsolid s\n")
    return path
