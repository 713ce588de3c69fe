"""Scenes from GSD files and frames in HOOMD-blue's schema."""

import os
from copy import deepcopy

import numpy as np

from ...base.errors import ParameterError, optional_package, require
from ...base.geometry import reduced
from ...base.units import unit_system, whole_number
from ...model.scene import Scene
from ...outputs.gsd_file import MOLECULES
from .beads import BeadArrays, scene_from_beads


def scene_from_gsd(source, *, pairs, kT, frame: int = -1, units: str = "lj", **choices) -> Scene:
    """Scene from a GSD file of HOOMD-blue, or of :func:`openmm_dpd.outputs.write_gsd`.

    Types, masses, charges, bonds, angles, dihedrals, the box with its tilt, and velocities are read; positions are unwrapped by their
    images, and the origin moves from the centre of the box to its corner.  In this format zeros may be defaults: velocities or charges that
    are all 0 are ignored.  So are diameters and shapes of types, which are for display.

    Parameters
    ----------
    source : path-like, or gsd.hoomd.Frame
        A file, or a frame of one.
    pairs, kT
        Pair coefficients and thermal energy, see :class:`openmm_dpd.Scene`.
    frame : int, default -1
        Number of the frame in the file; the last one by default.
    units : {"lj", "real", "metal", "si", "cgs", "micro", "nano"}
        Units of the file.  Charges are always in elementary charges; for HOOMD-blue's reduced charges give ``charges``.
    **choices
        Further arguments of :func:`scene_from_beads`; keys of ``bonds``, ``angles`` and ``dihedrals`` may be type names of the file,
        ``{"A-B": Spring(...)}``.  ``leave_out`` accepts ``impropers``, ``constraints``, ``special pairs``,
        ``particles of rigid bodies`` and ``particles that rotate``.

    Raises
    ------
    ParameterError
        If the file cannot be read, there is no such frame, it is two-dimensional, or :func:`scene_from_beads` refuses something.
    """
    system = unit_system(units)
    name, found = _frame(source, frame)
    beads, place = found.particles, found.configuration
    if not beads.N:
        raise ParameterError(f"{name} has no particles")
    if place.dimensions == 2:
        raise ParameterError(f"{name} has two dimensions; a Scene has three")
    edges, (xy, xz, yz) = _float(place.box[:3]), _float(place.box[3:])
    if not np.all(edges > 0):
        raise ParameterError(f"{name} has a box with the edges {edges.tolist()}; they must be > 0")
    vectors = np.array([[edges[0], 0.0, 0.0], [xy * edges[1], edges[1], 0.0], [xz * edges[2], yz * edges[2], edges[2]]])
    velocities, charges = (_float(values) for values in (beads.velocity, beads.charge))
    molecules = found.log.get(MOLECULES)
    arrays = BeadArrays(
        types=[beads.types[k] for k in beads.typeid],
        positions=(_float(beads.position) + beads.image @ vectors + 0.5 * vectors.sum(axis=0)) * system.length,
        source=name,
        masses=_float(beads.mass) * system.mass,
        box=reduced(vectors) * system.length,
        velocities=velocities * system.velocity if velocities.any() else None,
        charges=charges if charges.any() else None,
        molecules=None if molecules is None else np.asarray(molecules).astype(np.int64),
        bonds=np.asarray(found.bonds.group, dtype=np.int64).reshape(-1, 2),
        bond_names=[found.bonds.types[k] for k in found.bonds.typeid],
        angles=np.asarray(found.angles.group, dtype=np.int64).reshape(-1, 3),
        angle_names=[found.angles.types[k] for k in found.angles.typeid],
        dihedrals=np.asarray(found.dihedrals.group, dtype=np.int64).reshape(-1, 4),
        dihedral_names=[found.dihedrals.types[k] for k in found.dihedrals.typeid],
        type_names=list(beads.types),
        beyond=_beyond(found),
    )
    return scene_from_beads(arrays, pairs=pairs, kT=kT, **choices)


def _frame(source, frame: int):
    """Name of the source in errors, and its frame with all properties set."""
    hoomd = optional_package("gsd.hoomd", "gsd", "GSD files need")
    at = whole_number(frame, "the number of a frame")
    if isinstance(source, hoomd.Frame):
        return "the GSD frame", _complete(deepcopy(source))
    require(source, (str, os.PathLike), "expected a GSD file or a gsd.hoomd.Frame")
    try:
        with hoomd.open(os.fspath(source), "r") as file:
            if not -len(file) <= at < len(file):
                raise ParameterError(f"{source} has {len(file)} frames; there is no frame {at}")
            return os.fspath(source), file[at]
    except (OSError, RuntimeError) as error:
        raise ParameterError(f"{source} cannot be read as a GSD file: {error}") from None


def _complete(frame):
    """The frame, with GSD's defaults for properties that were not set (of frames made in Python)."""
    frame.validate()
    for part in (frame.configuration, frame.particles, frame.bonds, frame.angles, frame.dihedrals):
        for name, default in part._default_value.items():
            if getattr(part, name) is None:
                count = getattr(part, "N", 0)
                per_bead = isinstance(default, (np.ndarray, np.generic)) and part is not frame.configuration
                setattr(part, name, np.broadcast_to(default, (count, *np.shape(default))) if per_bead else default)
    return frame


def _beyond(frame) -> dict[str, int]:
    """Features of a frame that a Scene does not support, and their numbers."""
    beads = frame.particles
    turning = np.zeros(beads.N, bool)
    for values in (beads.moment_inertia, beads.angmom):
        turning |= np.any(np.asarray(values) != 0, axis=1)
    counts = {
        "impropers": frame.impropers.N,
        "constraints": frame.constraints.N,
        "special pairs": frame.pairs.N,
        "particles of rigid bodies": np.count_nonzero(np.asarray(beads.body) != -1),
        "particles that rotate": np.count_nonzero(turning),
    }
    return {name: int(count) for name, count in counts.items() if count}


def _float(values) -> np.ndarray:
    return np.asarray(values, dtype=np.float64)
