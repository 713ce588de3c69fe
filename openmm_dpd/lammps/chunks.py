"""Slices of the box: ``compute chunk/atom ... bin/1d``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ParameterError
from . import arguments as read
from .box import Box
from .compute_spec import Compute, ComputeSpec
from .per_bead import folded

if TYPE_CHECKING:
    from .context import Context
    from .state import DeckState

_USAGE = "compute ID group chunk/atom bin/1d x|y|z lower|center|upper|coordinate thickness"
_ENDS = ("lower", "center", "upper")
_SIZES = {"units": 1, "discard": 1, "bound": 3, "region": 1, "nchunk": 1, "ids": 1, "limit": 1, "compress": 1, "static": 1, "pbc": 1}

#: More slices than that are a mistake.
_MOST = 10_000_000


@dataclass(frozen=True)
class Slicing:
    """Settings of ``bin/1d``; lengths in the deck's unit, or in fractions of the edge if ``reduced``.

    Attributes
    ----------
    axis : int
        0, 1 or 2.
    origin : str or float
        ``lower``, ``center``, ``upper``, or the coordinate of the face of some slice.
    thickness : float
    reduced : bool
    discard : str
        What becomes of beads beyond the slices: ``no`` (they count in the last slice), ``yes`` (they are left out), ``mixed`` (left out
        only where ``bound`` has put an end).
    bound : pair of (float or None)
        Ends that are not those of the box.
    region : str or None
        Only beads in this region count.
    """

    axis: int
    origin: str | float
    thickness: float
    reduced: bool = False
    discard: str = "mixed"
    bound: tuple[float | None, float | None] = (None, None)
    region: str | None = None

    def slices(self, box: Box) -> Slices:
        """The slices in a box (deck units)."""
        low, high = (0.0, 1.0) if self.reduced else (float(box.low[self.axis]), float(box.high[self.axis]))
        edge = high - low
        low, high = (end if end is not None else of_box for end, of_box in zip(self.bound, (low, high), strict=True))
        ends = {"lower": low, "center": 0.5 * (low + high), "upper": high}
        origin = ends[self.origin] if isinstance(self.origin, str) else self.origin
        # faces stand at origin + n*thickness; the outermost are those at the ends or just beyond, and a face a rounding error off an end
        # counts as being there
        first = np.floor((low - origin) / self.thickness + 1e-9)
        last = np.ceil((high - origin) / self.thickness - 1e-9)
        if not 1 <= last - first <= _MOST:
            raise ParameterError(
                f"compute chunk/atom: a thickness of {self.thickness:g} gives {last - first:g} slices between {low:g} and {high:g}"
            )
        start = float(origin + first * self.thickness)
        return Slices(start, self.thickness, int(last - first), box.volume * self.thickness / edge)


@dataclass(frozen=True)
class Slices:
    """``count`` slices of one thickness, from ``start`` on, each with the same volume."""

    start: float
    thickness: float
    count: int
    volume: float

    @property
    def centres(self) -> np.ndarray:
        """Coordinates of the middle of each slice."""
        return self.start + (np.arange(self.count) + 0.5) * self.thickness


def parse_slicing(state: DeckState, group: str, words: list[str]) -> Slicing:
    """Settings from the words after ``chunk/atom``.

    Raises
    ------
    ParameterError
        For styles and options that are not supported, or values out of bounds.
    """
    read.count(words, _USAGE, 4, None)
    if words[0] != "bin/1d":
        raise ParameterError(f"compute chunk/atom: only style bin/1d is supported, not '{words[0]}'")
    axis = "xyz".index(read.choice(words[1], "the direction of the slices", ("x", "y", "z")))
    options = {"units": ["lattice"], "discard": ["mixed"]} | dict(read.options(words[4:], _SIZES, "compute chunk/atom"))
    units = read.choice(options["units"][0], "units", ("box", "lattice", "reduced"))
    scale = float(state.lattice.spacing[axis]) if units == "lattice" else 1.0
    origin: str | float = words[2]
    if words[2] not in _ENDS:
        origin = read.number(words[2], "the origin of the slices (or lower, center, upper)") * scale
    box = state.require_box("compute chunk/atom")
    if box.triclinic and units != "reduced":
        raise ParameterError("compute chunk/atom: in a tilted box slices need 'units reduced'")
    for keyword, allowed in (("compress", "no"), ("limit", "0"), ("pbc", "no")):
        if options.get(keyword, [allowed])[0] != allowed:
            raise ParameterError(f"compute chunk/atom: {keyword} {options[keyword][0]} is not supported")
    if "region" in options and options["region"][0] not in state.regions:
        raise ParameterError(f"compute chunk/atom: there is no region '{options['region'][0]}'")
    slicing = Slicing(
        axis=axis,
        origin=origin,
        thickness=read.positive(words[3], "the thickness of the slices") * scale,
        reduced=units == "reduced",
        discard=read.choice(options["discard"][0], "discard", ("yes", "no", "mixed")),
        bound=_bound(options.get("bound"), axis, scale),
        region=options["region"][0] if "region" in options else None,
    )
    slicing.slices(box.scaled(1.0 / state.units.length))
    return slicing


def _bound(words: list[str] | None, axis: int, scale: float) -> tuple[float | None, float | None]:
    if words is None:
        return None, None
    if words[0] != "xyz"[axis]:
        raise ParameterError(f"compute chunk/atom: bound {words[0]}, but the slices are along {'xyz'[axis]}")
    low = None if words[1] == "lower" else read.number(words[1], "the lower bound") * scale
    high = None if words[2] == "upper" else read.number(words[2], "the upper bound") * scale
    if low is not None and high is not None and low >= high:
        raise ParameterError(f"compute chunk/atom: the lower bound {words[1]} is not below the upper one, {words[2]}")
    return low, high


def chunk_numbers(context: Context, compute: Compute, slices: Slices) -> np.ndarray:
    """(N,) number of the slice of each bead, from 0; -1 for beads that are in none, or not in the group of the compute."""
    slicing: Slicing = compute.settings
    positions, _ = folded(context)
    along = (context.box.fractions(positions) if slicing.reduced else positions)[:, slicing.axis]
    number = np.floor((along - slices.start) / slices.thickness).astype(np.int64)
    keep_low = slicing.discard == "no" or (slicing.discard == "mixed" and slicing.bound[0] is None)
    keep_high = slicing.discard == "no" or (slicing.discard == "mixed" and slicing.bound[1] is None)
    number[number < 0] = 0 if keep_low else -1
    number[number >= slices.count] = slices.count - 1 if keep_high else -1
    counted = context.state.group(compute.group)
    if slicing.region is not None:
        counted = counted & context.state.regions[slicing.region].contains(positions)
    return np.where(counted, number, -1)


def _numbers(context: Context, compute: Compute) -> np.ndarray:
    return chunk_numbers(context, compute, compute.settings.slices(context.box)) + 1.0


CHUNKS = ComputeSpec(
    lambda state, group, words: None,  # parse_slicing checks
    per_bead=_numbers,
    needs=("positions",),
    prepare=parse_slicing,
)
