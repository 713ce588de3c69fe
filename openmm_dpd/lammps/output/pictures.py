"""Pictures of a deck: the settings of ``dump image`` and ``dump movie``, and of their ``dump_modify``."""

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...io.bead_pictures import draw_spheres
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..values.resolver import Resolver

Colour = tuple[float, ...]
#: Colours of types in turn.
_COLOURS = ("red", "green", "blue", "yellow", "aqua", "cyan")
#: Keywords of dump image, and how many values each has; those of the last two rows are without effect here.
_SIZES = {"atom": 1, "adiam": 1, "bond": 2, "size": 2, "view": 2, "zoom": 1, "box": 2}
_SIZES |= {"autobond": 2, "axes": 3, "body": 3, "center": 4, "ellipsoid": 4, "fix": 4, "fsaa": 1, "grid": 1, "line": 2, "persp": 1}
_SIZES |= {"shiny": 1, "ssao": 3, "subbox": 2, "tri": 3, "up": 3}
#: The same of dump_modify.
MODIFIED = {"acolor": 2, "adiam": 2, "bcolor": 2, "bdiam": 2, "backcolor": 1, "boxcolor": 1, "color": 4}
MODIFIED |= {"bitrate": 1, "framerate": 1, "boxopacity": 1, "backcolor2": 1, "atrans": 2, "btrans": 2}


@dataclass
class PictureSettings:
    """What a picture shows: words of dump image by keyword; diameters and colours of types, by keyword of dump_modify and type; colours by
    name, as red, green and blue from 0 to 1."""

    words: dict[str, list[str]]
    of_types: dict[tuple[str, int], Any] = field(default_factory=dict)
    named: dict[str, Colour] = field(default_factory=lambda: {"backcolor": (0.0, 0.0, 0.0), "boxcolor": (1.0, 1.0, 0.0)})

    def rgb(self, name: str) -> Colour:
        """A colour by its name.  ParameterError if there is none."""
        from matplotlib.colors import CSS4_COLORS, to_rgb

        if name not in self.named and name not in CSS4_COLORS:
            raise ParameterError(f"there is no colour '{name}'{read.near(name, [*self.named, *CSS4_COLORS])}")
        return self.named.get(name) or to_rgb(name)

    def modify(self, state: DeckState, keyword: str, values: list[str]) -> None:
        """Take a keyword of dump_modify."""
        if keyword in ("acolor", "bcolor", "adiam", "bdiam"):
            count, what = (state.n_types, "atom type") if keyword[0] == "a" else (state.n_bond_types, "bond type")
            names = values[1].split("/")
            for k, kind in enumerate(read.numeric_range(values[0], count, what)):
                of_type = read.positive(values[1], keyword) if keyword.endswith("diam") else self.rgb(names[k % len(names)])
                self.of_types[keyword, kind] = of_type
        elif keyword == "color":
            self.named[values[0]] = tuple(read.non_negative(word, "a part of a colour") for word in values[1:])
        elif keyword in self.named:
            self.named[keyword] = self.rgb(values[0])
        else:
            state.note(f"dump_modify {keyword} has no effect on pictures here")


def picture_name(state: DeckState, style: str, file: str) -> str:
    """Name of the files of a dump image or movie, with a ``*`` for the step."""
    if (style == "image") != ("*" in file):
        raise ParameterError(f"dump {style} '{file}': " + ("put a * into the name" if style == "image" else "remove the *"))
    found = str(Path(file).with_suffix(".png" if style == "image" else ".*.png"))
    if found != file:
        state.note(f"dump {style}: pictures are PNG files, {found}" + (", which ffmpeg joins to a film" if style == "movie" else ""))
    return found


def parse_picture(state: DeckState, words: list[str]) -> PictureSettings:
    """Settings from the words after the file of ``dump image``; those for colour and diameter are checked by the caller."""
    given = dict(read.options(words[2:], _SIZES, "dump image"))
    found = {
        "atom": ["yes"],
        "bond": ["none", "1"],
        "size": ["512", "512"],
        "view": ["60", "30"],
        "zoom": ["1"],
        "box": ["yes", "0.02"],
    } | given
    if "element" in words[:2]:
        state.note("dump image: colours and diameters are those of types, not of elements")
    read.choice(found["bond"][0], "the colour of bonds", ("atom", "type", "none"))
    numbers = [*found["view"], *found["zoom"], *found["size"], found["box"][1], *found.get("adiam", [])]
    for word in [*numbers, *([] if found["bond"][1] in ("atom", "type", "none") else [found["bond"][1]])]:
        state.variables.get(word[2:]) if word.startswith("v_") else read.number(word, "a number of dump image")
    for keyword in given.keys() - {"atom", "adiam", "bond", "size", "view", "zoom", "box"}:
        state.note(f"dump image: {keyword} has no effect here")
    return PictureSettings(found | {"shown": ["type" if word == "element" else word for word in words[:2]]})


def draw_frame(settings: PictureSettings, moment: Resolver, mask: np.ndarray, path: Path) -> None:
    """Draw the beads of a mask into a PNG file."""
    state, box, words, of_types = moment.state, moment.box, settings.words, settings.of_types
    types, mask = state.atoms.types, mask & read.switch(words["atom"][0], "atom")
    number = {key: [moment.variable_alone(w[2:]) if w[:2] == "v_" else float(w) for w in words[key]] for key in ("view", "zoom", "size")}
    colour, diameter = words["shown"]
    usual = [settings.rgb(name) for name in _COLOURS]
    colours = np.array([of_types.get(("acolor", kind), usual[(kind - 1) % 6]) for kind in types.tolist()]).reshape(-1, 3)
    if colour != "type":
        values = moment.bead_values(colour)
        low, high = (values[mask].min(), values[mask].max()) if mask.any() else (0.0, 1.0)
        part = np.clip((values - low) / max(high - low, 1e-300), 0.0, 1.0)
        colours = np.stack([part, np.zeros_like(part), 1.0 - part], axis=1)
    diameters = np.array([of_types.get(("adiam", kind), 1.0) for kind in types.tolist()])
    if "adiam" in words or diameter != "type":
        diameters = np.full(len(types), float(words["adiam"][0])) if "adiam" in words else moment.bead_values(diameter)
    ends, place, sticks = state.atoms.index_of(state.bonds[:, 1:].ravel()).reshape(-1, 2), np.cumsum(mask) - 1, defaultdict(list)
    for kind, pair in zip(state.bonds[:, 0].tolist() if "none" not in words["bond"] else (), ends.tolist(), strict=False):
        if mask[pair].all():
            sticks[kind].append(place[pair])
    thick = {
        kind: of_types.get(("bdiam", kind), 0.5) if words["bond"][1] in ("atom", "type") else float(words["bond"][1]) for kind in sticks
    }
    shades = {kind: None if words["bond"][0] == "atom" else of_types.get(("bcolor", kind), usual[(kind - 1) % 6]) for kind in sticks}
    draw_spheres(
        path,
        (moment.folded[0] - box.low)[mask],
        0.5 * diameters[mask],
        colours[mask],
        [(np.array(pairs), 0.5 * thick[kind], shades[kind]) for kind, pairs in sticks.items()],
        box.vectors,
        view=number["view"],
        size=[int(value) for value in number["size"]],
        height=2.0 * float(np.ptp(box.bounds, axis=0).max()) / number["zoom"][0],
        edge=0.5 * float(words["box"][1]) * float(box.edges.min()) * read.switch(words["box"][0], "box"),
        edge_colour=settings.named["boxcolor"],
        background=settings.named["backcolor"],
    )
