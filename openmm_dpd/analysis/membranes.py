"""Flat bilayers: thickness and area per lipid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import ParameterError
from ..geometry import widths
from ..stats import Average, block_average
from .frames import axis_number, frames_of, selected, weights_of
from .molecules import molecule_labels
from .profiles import periodic_centre

if TYPE_CHECKING:
    from .frames import Beads, Trajectories


def bilayer_thickness(trajectory: Trajectories, heads: Beads, tails: Beads = None, *, axis: str | int = "z") -> Average:
    r"""Distance between the head groups of the two leaflets of a flat bilayer, D = <z>_upper - <z>_lower.

    Heads above the centre of mass of the bilayer are the upper leaflet, the others the lower one; in every frame their mean heights are
    subtracted.  For symmetric peaks this is the distance between the peaks of the density profile of the heads.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any periodic box.  The bilayer may cross the boundary and drift.
    heads : str, sequence of str, or array of int
        Beads of the head groups.
    tails : str, sequence of str, array of int, or None
        Beads whose centre of mass is the middle of the bilayer; the heads by default.  Needed if the layer of solvent is about as thick as
        the bilayer, because the heads alone do not tell which side of them is inside.
    axis : {"z", "y", "x"} or int
        Box vector across the bilayer; heights are measured normal to the plane of the two others.

    Returns
    -------
    openmm_dpd.stats.Average
        Mean over frames (nm) with its standard error.

    Raises
    ------
    ParameterError
        If there is no box, the beads have no centre along the axis, or all heads are on one side.
    """
    topology, frames = frames_of(trajectory)
    head = selected(topology, heads, "heads")
    middle = head if tails is None else selected(topology, tails, "tails")
    k, masses, values = axis_number(axis), weights_of(topology), []
    for frame in frames:
        s = frame.fractions("a bilayer thickness")[:, k]
        height = s[head] - periodic_centre(s[middle], masses[middle])
        height = height - np.round(height)
        upper = height > 0
        if upper.all() or not upper.any():
            raise ParameterError("all heads are on one side of the middle of the bilayer; check heads, tails and axis")
        values.append((height[upper].mean() - height[~upper].mean()) * widths(frame.need_box("a bilayer thickness"))[k])
    return block_average(values, name="the thickness")


def area_per_lipid(trajectory: Trajectories, lipids: Beads | int, *, axis: str | int = "z") -> Average:
    r"""Area of the box across an axis for each lipid of one leaflet, a = A/(N/2).

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
    lipids : int, str, sequence of str, or array of int
        Number of lipids N in both leaflets, or beads (such as their head groups) whose molecules are counted.
    axis : {"z", "y", "x"} or int
        Box vector across the bilayer.

    Returns
    -------
    openmm_dpd.stats.Average
        Mean over frames (nm^2) with its standard error, which is 0 if the box does not change.

    Raises
    ------
    ParameterError
        If there is no box or no lipid.
    """
    topology, frames = frames_of(trajectory)
    if isinstance(lipids, (bool, np.bool_)):
        raise ParameterError(f"lipids must be their number or beads, not {lipids!r}")
    if isinstance(lipids, (int, np.integer)):
        count = int(lipids)
    else:
        count = len(np.unique(molecule_labels(topology)[selected(topology, lipids, "lipids")]))
    if count < 1:
        raise ParameterError(f"the number of lipids must be above 0, not {count}")
    k = axis_number(axis)
    areas = [np.linalg.det(box) / widths(box)[k] for box in (frame.need_box("an area per lipid") for frame in frames)]
    return block_average(2 * np.array(areas) / count, name="the area per lipid")


__all__ = ["area_per_lipid", "bilayer_thickness"]
