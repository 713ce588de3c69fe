"""Pictures of beads: spheres by type, sticks for bonds, the edges of the box."""

import os
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.geometry import folded, minimum_images, widths
from ..base.units import whole_number
from ..model.pairs import checked
from .pictures import DPI, new_figure, write_picture, write_pixels
from .snapshot import Snapshot
from .spheres import camera, drawn
from .view import COLOURS, default_radii, radii_of

#: Radius of beads whose cutoff is unknown, by the edge of a cube with one bead; of bonds by the least radius; of edges by the box.
_SIZE, _STICK, _EDGE = 0.36, 0.3, 0.002
#: Beads cover the picture more often than this: what is inside is seen in a slice alone, so many times as thick as the largest bead.
_DENSE, _THICK = 6.0, 2.0


class _Beads(NamedTuple):
    """What is drawn; nm."""

    positions: np.ndarray  #: (N, 3)
    types: np.ndarray  #: (N,) numbers of the names
    names: list[str]
    sizes: np.ndarray  #: Radius of each type
    bonds: np.ndarray  #: (B, 2)
    box: np.ndarray | None


def bead_picture(
    path: str | os.PathLike, source, *, state=None, radii=None, view=(65.0, -60.0), thickness=None, pixels: int = 900, title: str = ""
) -> None:
    """Draw beads as spheres with light, shadow and depth into a PNG file: coloured by type, folded into the box, with sticks for bonds.

    Parameters
    ----------
    path : path-like
        PNG file to write.
    source : Scene, BuiltSystem or mdtraj.Trajectory
        A scene, what :func:`openmm_dpd.build` returned, or a trajectory of one frame, whose atom names are the types.
    state : openmm.State or openmm.Context, optional
        Positions and box of a run; by default those of the start.
    radii : length, or mapping of types to lengths, optional
        Radii of the beads; by default a quarter of the cutoff of their type with itself.  0 hides a type.
    view : two float
        Polar and azimuthal angle of the direction to the viewer, in degrees; z points up.
    thickness : length, optional
        Thickness of the slice through the middle of the box that is drawn, along the axis that points to the viewer most.  By default the
        whole box where the beads do not hide each other, else twice the diameter of the largest bead.
    pixels : int
        Longer side of the picture.
    title : str
        A line above.

    Raises
    ------
    ParameterError
        If the source, the state or a radius is not what is described here, or no bead is left to draw.
    OutputError
        If the file cannot be written.
    """
    whole_number(pixels, "the number of pixels", least=1)
    angles = np.asarray(view, dtype=float)
    if angles.shape != (2,) or not np.all(np.isfinite(angles)):
        raise ParameterError(f"view must be two angles in degrees, not {what_is(view)}")
    beads = _of_frame(source, state, radii) if hasattr(source, "n_frames") else _of_scene(source, state, radii)
    if thickness is not None and beads.box is None:
        raise ParameterError("without a box there is no slice through its middle; leave thickness out")
    axes, said = camera(*angles), ""
    shown = beads.sizes[beads.types] > 0.0
    positions = folded(beads.positions, beads.box)
    if beads.box is not None:
        if thickness is None:
            area = np.prod(np.ptp(np.array(_corners(beads.box)) @ axes[:2].T, axis=0))
            dense = np.pi * np.sum(beads.sizes[beads.types] ** 2) > _DENSE * area
            thickness = 2.0 * _THICK * beads.sizes.max(initial=0.0) if dense else None
        if thickness is not None:
            thickness = checked(thickness, "length", "the thickness of the slice")
            axis = int(np.argmax(np.abs(axes[2] @ beads.box.T)))
            part = (positions @ np.linalg.inv(beads.box))[:, axis] - 0.5
            shown &= np.abs(part) * widths(beads.box)[axis] <= 0.5 * thickness
            said = "a slice through the middle of the box"
    if not shown.any():
        raise ParameterError("no bead is left to draw: all are hidden, or outside of the slice")
    colours = np.array([_rgb(COLOURS[k % len(COLOURS)]) for k in range(len(beads.names))])
    stick, edge = (
        _STICK * min(beads.sizes[beads.sizes > 0.0], default=0.0),
        _EDGE * float(0.0 if beads.box is None else np.linalg.norm(beads.box.diagonal())),
    )
    bonds = beads.bonds[shown[beads.bonds].all(1)]
    of_beads = positions, beads.sizes[beads.types], colours[beads.types]
    picture = drawn(*_spheres(*of_beads, shown, [(bonds, stick, None)], beads.box, edge, _rgb("#404040")), axes, pixels)
    figure = new_figure(picture.shape[1] / DPI, picture.shape[0] / DPI + 0.5)
    axis = figure.subplots()
    axis.imshow(picture, interpolation="antialiased")
    axis.set_axis_off()
    for k in np.unique(beads.types[shown]):
        axis.plot([], [], "o", color=colours[k], label=beads.names[k])
    figure.legend(loc="outside lower center", ncols=8, frameon=False, title=said or None, title_fontsize=9)
    if title:
        figure.suptitle(title, fontsize=12)
    write_picture(path, figure)


def _of_scene(source, state, radii) -> _Beads:
    its = Snapshot.of(source, state)
    names = list(its.scene.type_names)
    sizes = radii_of(names, default_radii(its.scene) if radii is None else radii)
    return _Beads(its.positions, its.scene.type_ids, names, np.array([sizes[name] for name in names]), its.scene.bond_pairs, its.box)


def _of_frame(frame: Any, state, radii) -> _Beads:
    if state is not None:
        raise ParameterError("a frame of a trajectory has its own positions; leave state out")
    if frame.n_frames != 1:
        raise ParameterError(f"a picture shows one frame; the trajectory has {frame.n_frames}: give one of them, trajectory[-1] say")
    found, types = np.unique([atom.name for atom in frame.topology.atoms], return_inverse=True)
    names = found.tolist()
    positions, box = frame.xyz[0].astype(float), None if frame.unitcell_vectors is None else frame.unitcell_vectors[0].astype(float)
    volume = np.prod(np.ptp(positions, axis=0)) if box is None else abs(np.linalg.det(box))
    sizes = radii_of(names, _SIZE * float(volume / len(positions)) ** (1.0 / 3.0) if radii is None else radii)
    bonds = np.array([(one.index, other.index) for one, other in frame.topology.bonds], int).reshape(-1, 2)
    return _Beads(positions, types, names, np.array([sizes[name] for name in names]), bonds, box)


def _rgb(colour: str) -> list[float]:
    return [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]


def _line(begin: np.ndarray, along: np.ndarray, radius: float) -> np.ndarray:
    """(N, 3): centres of spheres that touch each other along lines (L, 3) so closely that they look like rods."""
    count = int(np.ceil(np.linalg.norm(along, axis=1).max(initial=0.0) / (0.5 * radius))) + 1
    return (begin[:, None] + np.linspace(0.0, 1.0, count)[:, None] * along[:, None]).reshape(-1, 3)


def _spheres(positions, sizes, colours, shown, sticks, box, edge, edge_colour) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres, radii and colours of all that is drawn: the beads that are shown; sticks, each of bonds (B, 2), a radius, and a colour or
    None for those of the beads; and edges of the box, of a radius that may be 0."""
    parts = [(positions[shown], sizes[shown], colours[shown])]
    for bonds, radius, colour in sticks if len(positions) else ():
        for first, second in ((0, 1), (1, 0)) if len(bonds) and radius else ():
            # half of each bond from each of its beads
            begin, apart = positions[bonds[:, first]], minimum_images(positions[bonds[:, second]] - positions[bonds[:, first]], box)
            centres = _line(begin, 0.5 * apart, radius)
            of_bonds = colours[bonds[:, first]] if colour is None else np.tile(colour, (len(bonds), 1))
            parts.append((centres, np.full(len(centres), radius), np.repeat(of_bonds, len(centres) // len(bonds), axis=0)))
    if box is not None and edge:
        starts = [(a, np.array(corner) @ np.delete(box, a, 0)) for a in range(3) for corner in ((0, 0), (0, 1), (1, 0), (1, 1))]
        centres = np.concatenate([_line(start[None], box[a][None], edge) for a, start in starts])
        parts.append((centres, np.full(len(centres), edge), np.tile(edge_colour, (len(centres), 1))))
    centres, radii, rgb = (np.concatenate(each) for each in zip(*parts, strict=True))
    return centres, radii, rgb


def draw_spheres(path, positions, radii, colours, sticks, box, *, view, size, height, edge, edge_colour, background) -> None:
    """Draw beads (N, 3) with their radii and colours (N, 3) into a PNG file of ``size`` pixels, without words around it, the box in the
    middle, and ``height`` nm from below to above; ``view`` is as in :func:`bead_picture`, what else there is as in :func:`_spheres`.
    OutputError if it cannot be written."""
    shown = np.ones(len(positions), bool)
    parts = _spheres(positions, radii, colours, shown, sticks, box, edge, edge_colour)
    if len(parts[0]):
        seen = drawn(*parts, camera(*view), max(size), (size, 0.5 * box.sum(axis=0), height))
        colour = seen[..., :3] * seen[..., 3:] + np.asarray(background) * (1.0 - seen[..., 3:])
    else:
        colour = np.tile(np.asarray(background, dtype=float), (size[1], size[0], 1))
    write_pixels(path, colour)


def _corners(box: np.ndarray) -> list[np.ndarray]:
    return [np.array([i, j, k]) @ box for i in (0, 1) for j in (0, 1) for k in (0, 1)]
