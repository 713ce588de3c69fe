"""Why OpenMM's own DPDIntegrator cannot run a scene."""

from collections.abc import Sequence

import numpy as np

from ..base.neighbours import coincident_pairs
from ..base.wording import bead_names, bead_number
from ..model.pairs import NONE
from ..model.scene import Scene
from ..model.temperature import TemperatureRamp
from .execution import DOUBLE_PLATFORMS
from .kinds import Kind
from .neighbour_list import may_miss_pairs
from .pair_spec import longest


def why_not_native(scene: Scene, kinds: Sequence[Kind], layers: Sequence[dict], scaled: bool, platform: str | None) -> str | None:
    """The reason why the DPDIntegrator cannot run a scene, or None; ``scaled``: bonded neighbours have factors other than 1."""
    if scene.walls:
        return "it cannot reflect beads at walls"
    if len(layers) != 1:
        return f"it holds one table of friction coefficients, and the scene has {len(layers)}"
    (kind,), (layer,) = kinds, layers
    if kind.why_not_native is None:
        return f"it knows isothermal DPD only, not {kind.name}"
    if isinstance(scene.kT, TemperatureRamp):
        return "its temperature cannot follow a ramp within a run"
    if scaled:
        return "it cannot scale the friction of bonded neighbours"
    if scene.mobile is not None and not scene.mobile.all():
        return f"bead {bead_number(np.argmin(scene.mobile))} is immobile, and near beads of mass 0 its velocities become NaN"
    together = coincident_pairs(scene.positions, scene.box, 1e-10)
    if together:
        return f"{bead_names(*together[0])} are at the same point, where its friction is NaN unless their velocities differ"
    if platform in DOUBLE_PLATFORMS and may_miss_pairs(scene.box, longest(layers)):
        return f"in this box, small and tilted, it misses the friction of some pairs on the {platform} platform"
    for (a, b), c in layer.items():
        if c is NONE:
            continue
        reason = kind.why_not_native(c)
        if reason is not None:
            return f"for types ({a}, {b}) {reason}"
    for name, mass in scene.masses.items():
        members = scene.type_ids == scene.type_names.index(name)
        if np.any(scene.bead_masses[members] != mass):
            return f"its friction is a rate, so all beads of type {name} must have the same mass"
    return None
