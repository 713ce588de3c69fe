"""Chunks of beads, ``compute chunk/atom``: bins of the box, shells, molecules, types and other numbers of beads."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import minimum_images
from ...model.flow import AXES
from ..language import arguments as read
from ..state.box import Box
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Compute
from .compute_spec import ComputeSpec
from .per_bead import check_carried

_STYLES = {"bin/1d": 1, "bin/2d": 2, "bin/3d": 3}
#: Styles of shells, and how many values they have.
_SHELLS = {"bin/sphere": 6, "bin/cylinder": 8}
_USAGE = "compute ID group chunk/atom bin/1d|bin/2d|bin/3d x|y|z lower|center|upper|coordinate thickness ..."
_ENDS = ("lower", "center", "upper")
_SIZES = {"units": 1, "discard": 1, "bound": 3, "region": 1, "nchunk": 1, "ids": 1, "limit": 1, "compress": 1, "pbc": 1}
_ONLY = {keyword: (value, "") for keyword, value in (("compress", "no"), ("limit", "0"), ("pbc", "no"), ("ids", "every"))}
#: Those of chunks that are no bins.
_ONLY_NUMBERS = {"limit": ("0", ""), "pbc": ("no", ""), "bound": ("", "there are no bins")}
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
class RadialShells:
    """Shells around a point, or around a line along an axis; lengths are in the deck's unit."""

    origin: tuple[float, ...]  #: NaN along the axis
    low: float
    high: float
    count: int
    periodic: bool = False  #: Whether the nearest image of the centre counts
    axis, reduced, bound = None, False, (None, None)

    @property
    def thickness(self) -> float:
        """Thickness of a shell."""
        return (self.high - self.low) / self.count

    def slices(self, box: Box) -> tuple[float, int, float]:
        """Radius of the first shell, number of shells, and 1."""
        return self.low, self.count, 1.0

    def distances(self, positions: np.ndarray, box: Box) -> np.ndarray:
        """(N,) distances of positions from the point or line."""
        d = positions - np.array(self.origin)
        d = minimum_images(d, box.vectors) if self.periodic else d
        return np.sqrt(np.nansum(d * d, axis=1))


@dataclass(frozen=True, eq=False)
class Bins:
    """Chunks, the last axis fastest: first face, thickness and number of slices of each axis; no axes if they are numbers of beads."""

    starts: tuple[float, ...]
    thicknesses: tuple[float, ...]
    counts: tuple[int, ...]
    volume: float | np.ndarray
    ids: np.ndarray | None = None  #: The number that stands for each, if numbers that no bead has are left out

    @property
    def count(self) -> int:
        """Number of bins."""
        return math.prod(self.counts)

    @property
    def centres(self) -> np.ndarray:
        """(count, axes) coordinates of the centre of each bin."""
        if not self.starts:
            return np.zeros((self.count, 0))
        axes = zip(self.starts, self.thicknesses, self.counts, strict=True)
        grids = np.meshgrid(*(start + (np.arange(count) + 0.5) * thickness for start, thickness, count in axes), indexing="ij")
        return np.stack([grid.ravel() for grid in grids], axis=1)


@dataclass(frozen=True)
class Binning:
    """Settings of a compute chunk/atom."""

    axes: tuple[Slicing | RadialShells, ...]  #: The axes that are cut, slowest first
    #: Treatment of beads beyond the slices: ``no`` (counted in the outermost slice), ``yes`` (left out), ``mixed`` (left out only beyond an
    #: end set by ``bound``).
    discard: str = "mixed"
    region: str | None = None  #: Region that beads must be in to be counted
    word: str | None = None  #: Without axes: the value of beads that is the number of their chunk
    compress: bool = False  #: Whether numbers that no bead has are left out

    def bins(self, box: Box, dimension: int = 3) -> Bins:
        """The bins in a box (deck units)."""
        starts, counts, fractions = zip(*(axis.slices(box) for axis in self.axes), strict=True)
        volume: float | np.ndarray = box.volume * float(np.prod(fractions))
        first, *others = self.axes
        if isinstance(first, RadialShells):
            radii = np.linspace(first.low, first.high, first.count + 1)
            shells = 4.0 / 3.0 * np.diff(radii**3) if dimension == 3 and not others else np.diff(radii**2)
            volume = np.pi * (np.repeat(shells * others[0].thickness, counts[1]) if others else shells)
        bins = Bins(starts, tuple(axis.thickness for axis in self.axes), counts, volume)
        if bins.count > _MOST:
            raise ParameterError(f"compute chunk/atom: {bins.count} bins are too many")
        return bins

    def fixed(self, state: DeckState, group: str) -> tuple[np.ndarray, Bins] | None:
        """As :func:`chunk_numbers`, of chunks that do not change during a run: molecules and types.  None for others."""
        values = {"mol": state.atoms.molecules, "type": state.atoms.types}.get(self.word or "")
        return None if values is None else self.of_values(values, state.group(group), state.require_box("chunks").volume)

    def of_values(self, values: np.ndarray, members: np.ndarray, volume: float) -> tuple[np.ndarray, Bins]:
        """As :func:`chunk_numbers`, where ``values`` are the numbers of chunks; 0 and less is none."""
        found = values.astype(np.int64)
        ids = np.unique(found[members & (found > 0)])
        ids = ids if self.compress else np.arange(1, ids.max(initial=0) + 1)
        place = np.where(members & np.isin(found, ids), np.searchsorted(ids, found), -1)
        return place, Bins((), (), (len(ids),), volume, ids if self.compress else None)


def parse_chunks(state: DeckState, group: str, words: list[str]) -> Binning:
    """Settings from the words after ``chunk/atom``.  ParameterError for unsupported styles and options, and values out of bounds."""
    read.count(words, _USAGE, 1, None)
    style, box = words[0], state.require_box("compute chunk/atom")
    if style.startswith(("c_", "v_", "f_")) or style in ("type", "molecule"):
        return _numbered(state, "mol" if style == "molecule" else style, words[1:])
    n = _SHELLS[style] if style in _SHELLS else 3 * read.style(_STYLES, "compute chunk/atom", style, *_SHELLS, "type", "molecule", "c_id")
    read.count(words, _USAGE, 1 + n, None)
    only = {keyword: allowed for keyword, allowed in _ONLY.items() if keyword != "pbc" or style != "bin/sphere"}
    given = read.options(words[1 + n :], _SIZES, "compute chunk/atom", only=only)
    options = {"units": ["lattice"], "discard": ["mixed"]} | dict(given)
    _check_options(state, options)
    units = read.choice(options["units"][0], "units", ("box", "lattice", "reduced"))
    if box.triclinic and units != "reduced":
        raise ParameterError("compute chunk/atom: in a tilted box slices need 'units reduced'")
    if style in _SHELLS and (units == "reduced" or style == "bin/cylinder" and words[1] not in AXES):
        raise ParameterError(f"compute chunk/atom {style}: expected an axis x, y or z, and lengths in units of the box or the lattice")
    places = {"bin/sphere": [], "bin/cylinder": [1]}.get(style, list(range(1, 1 + n, 3)))
    axes: list[Any] = [_axis(state, words[k : k + 3], units) for k in places]
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
    region = options["region"][0] if "region" in options else None
    if style in _SHELLS:
        across = [k for k in range(3) if "xyz"[k] not in used]
        at, origin, periodic = 4 if used else 1, [math.nan] * 3, read.switch(options.get("pbc", ["no"])[0], "pbc")
        for axis, word in zip(across, words[at:], strict=False):
            origin[axis] = read.number(word, "the centre of the shells") * _scale(state, axis, units)
        low, high = (read.non_negative(word, "a radius of the shells") * _scale(state, 0, units) for word in words[n - 2 : n])
        if high <= low:
            raise ParameterError(f"compute chunk/atom {style}: the largest radius {words[n - 1]} is not above the smallest")
        axes.insert(0, RadialShells(tuple(origin), low, high, read.integer(words[n], "the number of shells", 1), periodic))
    binning = Binning(tuple(axes), discard, region)
    binning.bins(box)
    return binning


def _numbered(state: DeckState, word: str, words: list[str]) -> Binning:
    """Settings of chunks by numbers of beads."""
    options = dict(read.options(words, _SIZES, "compute chunk/atom", only=_ONLY_NUMBERS))
    _check_options(state, options | {"nchunk": ["every"]})
    if word in ("type", "mol"):
        check_carried(state, word)
    elif (options.get("nchunk", ["every"])[0], options.get("ids", ["every"])[0]) != ("every", "every"):
        raise ParameterError(f"compute chunk/atom {word}: its chunks are found anew each time; nchunk and ids must be every")
    compress = read.switch(options.get("compress", ["no"])[0], "compress")
    return Binning((), "mixed", options["region"][0] if "region" in options else None, word, compress)


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


def chunk_numbers(moment: DeckMoment, compute: Compute, kept: Bins | None = None) -> tuple[np.ndarray, Bins]:
    """(N,) chunk of each bead, from 0; -1 for beads that are in none, or not in the group of the compute; and the chunks, those that are
    ``kept`` if they are given."""
    binning: Binning = compute.settings
    positions, _ = moment.folded
    counted = moment.state.group(compute.group)
    if binning.region is not None:
        counted = counted & moment.region(binning.region).contains(positions)
    if binning.word is not None:
        numbers, bins = binning.of_values(moment.bead_values(binning.word), counted, moment.box.volume)
        return np.where(numbers < (kept or bins).count, numbers, -1), kept or bins
    bins = kept or binning.bins(moment.box, moment.state.dimension)
    # the volumes are those of the last step while a fix changes the box, as in LAMMPS, which does not notice change_box
    if kept and binning.axes[0].reduced and moment.state.fixes_of("deform", "npt", "nph"):
        bins = replace(kept, volume=binning.bins(moment.box).volume)
    fractions = moment.box.fractions(positions) if binning.axes[0].reduced else positions
    total = np.zeros(len(positions), dtype=np.int64)
    for axis, start, count in zip(binning.axes, bins.starts, bins.counts, strict=True):
        place = axis.distances(positions, moment.box) if isinstance(axis, RadialShells) else fractions[:, axis.axis]
        # multiplied by the inverse, as in LAMMPS: the last bit decides to which slice a bead on a face belongs
        number = np.floor((place - start) * (1 / axis.thickness)).astype(np.int64)
        beyond = (number < 0, number >= count)
        for outside, end in zip(beyond, axis.bound, strict=True):
            if binning.discard == "yes" or (binning.discard == "mixed" and end is not None):
                counted = counted & ~outside
        total = total * count + np.clip(number, 0, count - 1)
    return np.where(counted, total, -1), bins


CHUNKS = ComputeSpec(parse_chunks, per_bead=lambda moment, compute: chunk_numbers(moment, compute)[0] + 1.0)
