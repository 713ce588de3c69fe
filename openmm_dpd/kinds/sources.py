"""Sources of heat and of species, as the kernel sees them."""

from __future__ import annotations

import numpy as np

from ..kernels.fields import FieldSource
from ..model.scene import Scene


def field_sources(scene: Scene) -> tuple[FieldSource, ...]:
    """The sources of a scene."""
    return tuple(FieldSource(s.region, s.rate, s.species, s.beads, np.asarray(s.corner)) for s in scene.sources)
