"""Bins of the box: ``compute chunk/atom ... bin/1d|bin/2d|bin/3d``."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from ..state.box import Box
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Compute
from .compute_spec import ComputeSpec

_STYLES = {"bin/1d": 1, "bin/2d": 2, "bin/3d": 3}
_USAGE = "compute ID group chunk/atom bin/1d|bin/2d|bin/3d x|y|z lower|center|upper|coordinate thickness ..."
_ENDS = ("lower", "center", "upper")
_SIZES = {"units": 1, "discard": 1, "bound": 3, "region": 1, "nchunk": 1, "ids": 1, "limit": 1, "compress": 1, "pbc": 1}
_ONLY = {keyword: (value, "") for keyword, value in (("compress", "no"), ("limit", "0"), ("pbc", "no"), ("ids", "every"))}
#: More bins than this are rejected as a mistake.
_MOST = 10_000_000


@dataclass(frozen=True)
class Slicing:
    """How one axis is cut into slices; lengths are in the deck's unit, or fractions of the edge if ``reduced``."""

    axis: int  #: 0, 1 or 2
    origin: str | float  #: ``lower``, ``center``, ``upper``, or the coordinate of the face of some slice
    thickness: float
    reduced: bool = False
    bound: tuple[float | None, float | None] = (None, None)  #: Lower and upper end; None means the end of the box

    def slices(self, box: Box) -> tuple[float, int, float]:
        """Start of the first slice, number of slices in a box (deck units), and the fraction of its volume in each slice."""
        low, high = (0.0, 1.0) if self.reduced else (float(box.low[self.axis]), float(box.high[self.axis]))
        edge = high - low
        low, high = (end if end is not None else of_box for end, of_box in zip(self.bound, (low, high), strict=True))
        ends = {"lower": low, "center": 0.5 * (low + high), "upper": high}
        origin = ends[self.origin] if isinstance(self.origin, str) else self.origin
        # faces are at origin + n*thickness; the outermost ones are at the ends or just beyond, and a face within rounding of an end counts
        # as being there
        first = np.floor((low - origin) / self.thickness + 1e-9)
        last = np.ceil((high - origin) / self.thickness - 1e-9)
        if not 1 <= last - first <= _MOST:
            raise ParameterError(
                f"compute chunk/atom: a thickness of {self.thickness:g} gives {last - first:g} slices between {low:g} and {high:g}"
            )
        return float(origin + first * self.thickness), int(last - first), self.thickness / edge


@dataclass(frozen=True)
class Bins:
    """Bins with the same volume, ordered with the last axis fastest: first face, thickness and number of slices of each axis."""

    starts: tuple[float, ...]
    thicknesses: tuple[float, ...]
    counts: tuple[int, ...]
    volume: float

    @property
    def count(self) -> int:
        """Number of bins."""
        return math.prod(self.counts)

    @property
    def centres(self) -> np.ndarray:
        """(count, axes) coordinates of the centre of each bin."""
        axes = zip(self.starts, self.thicknesses, self.counts, strict=True)
        grids = np.meshgrid(*(start + (np.arange(count) + 0.5) * thickness for start, thickness, count in axes), indexing="ij")
        return np.stack([grid.ravel() for grid in grids], axis=1)


@dataclass(frozen=True)
class Binning:
    """Settings of a compute chunk/atom."""

    axes: tuple[Slicing, ...]  #: The axes that are cut, slowest first
    #: Treatment of beads beyond the slices: ``no`` (counted in the outermost slice), ``yes`` (left out), ``mixed`` (left out only beyond an
    #: end set by ``bound``).
    discard: str = "mixed"
    region: str | None = None  #: Region that beads must be in to be counted

    def bins(self, box: Box) -> Bins:
        """The bins in a box (deck units)."""
        starts, counts, fractions = zip(*(axis.slices(box) for axis in self.axes), strict=True)
        bins = Bins(starts, tuple(axis.thickness for axis in self.axes), counts, box.volume * float(np.prod(fractions)))
        if bins.count > _MOST:
            raise ParameterError(f"compute chunk/atom: {bins.count} bins are too many")
        return bins


def parse_binning(state: DeckState, group: str, words: list[str]) -> Binning:
    """Settings from the words after ``chunk/atom``.  ParameterError for unsupported styles and options, and values out of bounds."""
    read.count(words, _USAGE, 1, None)
    n = 3 * read.style(_STYLES, "compute chunk/atom", words[0])
    read.count(words, _USAGE, 1 + n, None)
    given = read.options(words[1 + n :], _SIZES, "compute chunk/atom", only=_ONLY)
    options = {"units": ["lattice"], "discard": ["mixed"]} | dict(given)
    _check_options(state, options)
    units = read.choice(options["units"][0], "units", ("box", "lattice", "reduced"))
    box = state.require_box("compute chunk/atom")
    if box.triclinic and units != "reduced":
        raise ParameterError("compute chunk/atom: in a tilted box slices need 'units reduced'")
    axes = [_axis(state, words[k : k + 3], units) for k in range(1, 1 + n, 3)]
    used = ["xyz"[axis.axis] for axis in axes]
    if len(set(used)) < len(used):
        raise ParameterError(f"compute chunk/atom {words[0]}: each axis can be cut only once, not {', '.join(used)}")
    for keyword, values in given:
        if keyword == "bound":
            if values[0] not in used:
                raise ParameterError(f"compute chunk/atom: bound {values[0]}, but the slices are along {', '.join(used)}")
            k = used.index(values[0])
            axes[k] = replace(axes[k], bound=_bound(values, _scale(state, axes[k].axis, units)))
    discard = read.choice(options["discard"][0], "discard", ("yes", "no", "mixed"))
    binning = Binning(tuple(axes), discard, options["region"][0] if "region" in options else None)
    binning.bins(box)
    return binning


def _check_options(state: DeckState, options: dict[str, list[str]]) -> None:
    if read.choice(options.get("nchunk", ["every"])[0], "nchunk", ("once", "every")) == "once":
        state.note("compute chunk/atom: nchunk once has no effect: bins follow the box if it changes")
    if "region" in options and options["region"][0] not in state.regions:
        raise ParameterError(f"compute chunk/atom: there is no region '{options['region'][0]}'")


def _scale(state: DeckState, axis: int, units: str) -> float:
    return float(state.lattice.spacing[axis]) if units == "lattice" else 1.0


def _axis(state: DeckState, words: list[str], units: str) -> Slicing:
    axis = "xyz".index(read.choice(words[0], "the direction of the slices", ("x", "y", "z")))
    scale = _scale(state, axis, units)
    origin: str | float = words[1]
    if words[1] not in _ENDS:
        origin = read.number(words[1], "the origin of the slices (or lower, center, upper)") * scale
    return Slicing(axis, origin, read.positive(words[2], "the thickness of the slices") * scale, units == "reduced")


def _bound(words: list[str], scale: float) -> tuple[float | None, float | None]:
    low = None if words[1] == "lower" else read.number(words[1], "the lower bound") * scale
    high = None if words[2] == "upper" else read.number(words[2], "the upper bound") * scale
    if low is not None and high is not None and low >= high:
        raise ParameterError(f"compute chunk/atom: the lower bound {words[1]} is not below the upper bound {words[2]}")
    return low, high


def chunk_numbers(moment: DeckMoment, compute: Compute, bins: Bins) -> np.ndarray:
    """(N,) bin of each bead, from 0; -1 for beads that are in no bin or not in the group of the compute."""
    binning: Binning = compute.settings
    positions, _ = moment.folded
    fractions = moment.box.fractions(positions) if binning.axes[0].reduced else positions
    counted = moment.state.group(compute.group)
    if binning.region is not None:
        counted = counted & moment.state.region(binning.region, moment.variable_alone).contains(positions)
    total = np.zeros(len(positions), dtype=np.int64)
    for axis, start, count in zip(binning.axes, bins.starts, bins.counts, strict=True):
        # multiplied by the inverse, as in LAMMPS: the last bit decides to which slice a bead on a face belongs
        number = np.floor((fractions[:, axis.axis] - start) * (1 / axis.thickness)).astype(np.int64)
        beyond = (number < 0, number >= count)
        for outside, end in zip(beyond, axis.bound, strict=True):
            if binning.discard == "yes" or (binning.discard == "mixed" and end is not None):
                counted = counted & ~outside
        total = total * count + np.clip(number, 0, count - 1)
    return np.where(counted, total, -1)


def _numbers(moment: DeckMoment, compute: Compute) -> np.ndarray:
    return chunk_numbers(moment, compute, compute.settings.bins(moment.box)) + 1.0


CHUNKS = ComputeSpec(parse_binning, per_bead=_numbers)
