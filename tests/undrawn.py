"""Runs without matplotlib: their pictures are there, and have no content."""

from collections.abc import Callable

import numpy as np

import openmm_dpd.analysis.pictures  # noqa: F401  # imported later, it would keep what is put in the place of new_figure
from openmm_dpd.base.files import write_whole
from openmm_dpd.io import bead_pictures, pictures

BLANK = b"\x89PNG" + bytes(100_000)


class Figure:
    """A figure, and its axes, on which nothing is drawn."""

    def subplots(self, rows=None, *_, **__):
        if rows is None:
            return self
        axes = np.empty((rows, 1), object)
        axes[:] = self
        return axes

    def __getattr__(self, name: str):
        if name.startswith("_"):  # numpy asks for some
            raise AttributeError(name)
        return lambda *_, **__: None


def draw_nothing(put: Callable = setattr) -> None:
    """Replace what draws by what takes no time; ``put`` sets an attribute.  All else that makes a picture is carried out."""
    for name in ("_draw", "finish_axis"):
        put(pictures, name, lambda *_, **__: None)
    put(bead_pictures, "drawn", lambda *_: np.zeros((2, 2, 4)))
    for room in (pictures, bead_pictures):
        put(room, "new_figure", lambda *_: Figure())
        put(room, "write_picture", lambda path, figure: write_whole(path, BLANK, "the picture"))
    put(bead_pictures, "write_pixels", lambda path, colours: write_whole(path, BLANK, "the picture"))
