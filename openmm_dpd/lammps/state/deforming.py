"""Boxes whose edges and tilts a ``fix deform`` changes during a run, as functions of the step."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from .box import Box

#: Edges and tilts, with the axis in whose lattice spacings they are.
PARTS = {"x": 0, "y": 1, "z": 2, "xy": 0, "xz": 0, "yz": 1}


@dataclass(frozen=True)
class Course:
    """Where a run is: the fraction of its ramp that is over, and the time since that began and in all of it."""

    fraction: float
    time: float
    duration: float


#: New (low, high) of an edge from its (low, high) at the start, or (0, tilt) and the length that it shears, the values, and the course.
Way = Callable[[float, float, float, list[float], Course], tuple[float, float]]


def _about(low: float, high: float, edge: float) -> tuple[float, float]:
    return 0.5 * (low + high - edge), 0.5 * (low + high + edge)


def _wave(values: list[float], course: Course) -> float:
    return values[0] * math.sin(2 * math.pi * course.time / values[1])


#: What may be done to an edge: number of values, whether they are lengths, and the new ends.
EDGES: dict[str, tuple[int, bool, Way]] = {
    "final": (2, True, lambda a, b, _, v, c: (a + c.fraction * (v[0] - a), b + c.fraction * (v[1] - b))),
    "delta": (2, True, lambda a, b, _, v, c: (a + c.fraction * v[0], b + c.fraction * v[1])),
    "scale": (1, False, lambda a, b, _, v, c: _about(a, b, (b - a) * (1 + c.fraction * (v[0] - 1)))),
    "vel": (1, True, lambda a, b, _, v, c: _about(a, b, b - a + c.fraction * c.duration * v[0])),
    "erate": (1, False, lambda a, b, _, v, c: _about(a, b, (b - a) * (1 + c.fraction * c.duration * v[0]))),
    "trate": (1, False, lambda a, b, _, v, c: _about(a, b, (b - a) * math.exp(c.time * v[0]))),
    "wiggle": (2, True, lambda a, b, _, v, c: _about(a, b, b - a + _wave(v, c))),
    "volume": (0, False, lambda a, b, _, v, c: (a, b)),
}
#: The same of a tilt, which is the second end.
TILTS: dict[str, tuple[int, bool, Way]] = {
    "final": (1, True, lambda _, t, h, v, c: (0.0, t + c.fraction * (v[0] - t))),
    "delta": (1, True, lambda _, t, h, v, c: (0.0, t + c.fraction * v[0])),
    "vel": (1, True, lambda _, t, h, v, c: (0.0, t + c.fraction * c.duration * v[0])),
    "erate": (1, False, lambda _, t, h, v, c: (0.0, t + c.fraction * c.duration * v[0] * h)),
    "trate": (1, False, lambda _, t, h, v, c: (0.0, t * math.exp(c.time * v[0]))),
    "wiggle": (2, True, lambda _, t, h, v, c: (0.0, t + _wave(v, c))),
}


@dataclass(frozen=True)
class Deforming:
    """What a ``fix deform`` does to the box, every so many steps."""

    every: int
    changes: dict[str, tuple[str, list[float]]]  #: By edge or tilt: the way and its values, in the deck's units
    remaps: bool  #: Whether beads of the group move with the box
    initial: Box  #: The box at the fix command

    def box_at(self, box: Box, step: int, first: int, begin: int, end: int, dt: float) -> Box:
        """The box (deck units) at a step of a run that starts at ``first`` with ``box``, while ramps last from ``begin`` to ``end``."""
        done = step // self.every * self.every
        if done <= first:
            return box
        start = box if first == begin else self.initial
        course = Course((done - begin) / max(end - begin, 1), (done - begin) * dt, (end - begin) * dt)
        low, high, tilt = box.low.copy(), box.high.copy(), box.tilt.copy()
        for part, (way, values) in self.changes.items():
            if len(part) == 1:
                k = PARTS[part]
                low[k], high[k] = EDGES[way][2](float(start.low[k]), float(start.high[k]), 0.0, values, course)
            else:
                k = ("xy", "xz", "yz").index(part)
                tilt[k] = TILTS[way][2](0.0, float(start.tilt[k]), float(start.edges["xyz".index(part[1])]), values, course)[1]
        kept = [PARTS[part] for part, (way, _) in self.changes.items() if way == "volume"]
        others = [k for k in range(3) if k not in kept]
        factor = float(np.prod((high - low)[others] / start.edges[others])) ** (-1.0 / max(len(kept), 1))
        for k in kept:
            low[k], high[k] = _about(float(start.low[k]), float(start.high[k]), float(start.edges[k]) * factor)
        return replace(box, low=low, high=high, tilt=tilt)


def parse_deforming(words: list[str], spacing: Callable[[str], np.ndarray]) -> tuple[dict, dict[str, str]]:
    """Changes of a ``fix deform`` and its other options, from the words after the interval."""
    changes: dict[str, tuple[str, list[str]]] = {}
    options = {"remap": "x", "units": "lattice", "flip": "yes"}
    while words:
        keyword, *words = words
        if keyword in PARTS:
            (way,), words = read.taken(words, 1, f"fix deform {keyword}")
            table = EDGES if len(keyword) == 1 else TILTS
            size, _, _ = read.style(table, f"fix deform {keyword}", way)
            changed, words = read.taken(words, size, f"fix deform {keyword} {way}")
            changes[keyword] = way, changed
        else:
            read.choice(keyword, "an option of fix deform", [*PARTS, *options])
            (options[keyword],), words = read.taken(words, 1, f"fix deform {keyword}")
    read.choice(options["remap"], "remap", ("x", "v", "none"))
    scale, found = spacing(options["units"]), {}
    for part, (way, given) in changes.items():
        lengths = (EDGES if len(part) == 1 else TILTS)[way][1]
        values = [read.number(word, f"a value of fix deform {part} {way}") for word in given]
        # the period of a wiggle is a time
        found[part] = (
            way,
            [value * (float(scale[PARTS[part]]) if lengths and not (way == "wiggle" and k) else 1.0) for k, value in enumerate(values)],
        )
    if not found:
        raise ParameterError(
            "fix deform changes nothing; expected 'fix ID all deform 1 xy erate R remap v', or edges or tilts with remap x"
        )
    return found, options
