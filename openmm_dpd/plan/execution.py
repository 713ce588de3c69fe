"""Who computes what in a step, and why: one record, made by :func:`openmm_dpd.plan.plan.make_plan` and nowhere else."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..base.errors import PlanError, bead_names, bead_number
from ..base.geometry import coincident_pairs
from ..model.flow import BodyForce
from ..model.pairs import NONE
from ..model.scene import Scene
from ..model.schemes import Scheme
from ..model.temperature import TemperatureRamp
from .choices import may_miss_pairs
from .kinds import Kind
from .pair_spec import longest

#: What reactions are about, in messages.
REACTING = "bonds that form and break"
#: Platforms where positions, velocities and forces are double precision.
DOUBLE_PLATFORMS = ("Reference", "CPU")


@dataclass(frozen=True)
class Execution:
    """Who computes what in a step, and why.

    Attributes
    ----------
    engine : str
        Name of the pair kernel's engine (:mod:`openmm_dpd.kernels.engines`).
    steps : {"program", "loop", "device", "openmm"}
        How steps are done: one by one by the integrator's program, many at once in a loop over the pair kernel's own arrays, one by one by
        the pair force on the device, or by OpenMM's own integrator.
    conservative : {"kernel", "openmm", "none"}
        What computes the conservative force of the pair terms.
    held : frozenset of str
        What the pair kernel holds of the scene beside its pair terms; the rest is OpenMM's.  Kinds of bonds, angles, ... by name
        ("harmonic bonds"), "overlays", "segments", "body forces", "walls" and "charges".
    precision : {"double", "mixed", "single"}
        What positions and velocities of the platform have at least, unless another precision is asked for.
    slow : bool
        On the device: whether charges and forces of others kick before and after a step, as beside the loop, and not at every ``B``.
    why : dict
        The reason for "engine", "steps", "conservative" and "precision", and for whatever is held or could be.
    """

    steps: str = "program"
    conservative: str = "openmm"
    held: frozenset[str] = frozenset()
    precision: str = "double"
    engine: str = "host"
    slow: bool = False
    why: Mapping[str, str] = field(default_factory=dict, compare=False)

    @property
    def looped(self) -> bool:
        """Whether many steps are done at once, so that a program may only count them."""
        return self.steps == "loop"

    @property
    def on_device(self) -> bool:
        """Whether the pair terms are on OpenMM's device."""
        return self.engine == "device"

    @property
    def pushes(self) -> bool:
        """Whether the pair kernel computes any conservative force."""
        return self.conservative == "kernel" or self.looped


def conservative_place(asked: str, repulsive: bool, thermostat: bool, only: str | None, slower: str, scheme: Scheme) -> tuple[str, str]:
    """Where the conservative force of the pair terms is computed, and why.  ``only`` is the reason why it has to be the kernel, or None;
    ``slower`` why it had better be OpenMM, or empty."""
    if not repulsive:
        return "none", "there is no repulsion"
    if only is not None:
        if scheme.native or asked == "openmm":
            what = "the native scheme" if scheme.native else "conservative='openmm'"
            raise PlanError(f"{what} is not possible: {only}")
        return "kernel", only
    if scheme.native and asked == "kernel":
        raise PlanError("the native scheme has no pair kernel; use conservative='openmm'")
    if asked != "auto":
        return asked, "as asked for"
    if scheme.native or not thermostat:
        return "openmm", "there is no pair kernel"
    return ("openmm", slower) if slower else ("kernel", "it passes over the same pairs anyway")


def why_no_loop(
    conservative: str, thermostat: bool, scheme: Scheme, platform: str | None, loop: bool, compensated: bool, scene: Scene, hosted: bool
) -> str | None:
    """Why the pair kernel cannot carry out whole steps by itself, or None.  ``compensated`` says whether the program has to balance
    energies, ``hosted`` whether the System was made elsewhere."""
    less = f"velocities on the platform {platform} are less than double precision, so that the program balances the energies"
    reasons = {
        "OpenMM's own integrator steps": scheme.native,
        "the forces of a System made elsewhere act as well": hosted,
        "switched off": not loop,
        "on some beads only body forces act": scene.interacting is not None,
        "the conservative force is a CustomNonbondedForce": conservative == "openmm",
        "the pair kernel holds no conservative force": conservative == "none" and not (thermostat and platform in DOUBLE_PLATFORMS),
        less: compensated,
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


def check_whole_steps(what: str, why_no_loop: str | None, platform: str | None) -> None:
    """Raise PlanError if a scene with ``what`` would not run in whole steps with double precision; ``why_no_loop`` is the reason why there
    are no whole steps."""
    if platform not in DOUBLE_PLATFORMS:
        why_no_loop = f"positions that are never folded back lose their digits on the platform {platform}; take CPU or Reference"
    if why_no_loop is not None:
        raise PlanError(f"{what} the pair kernel's whole steps in double precision: {why_no_loop}")


def check_rigid(
    scene: Scene, kinds: Sequence[Kind], layers: Sequence[Mapping], lam: float, why_no_loop: str | None, platform: str | None
) -> None:
    """Raise PlanError if rigid bodies of a scene would not move as such; ``why_no_loop`` as in :func:`check_whole_steps`."""
    if not scene.bodies:
        return
    check_whole_steps("rigid bodies need", why_no_loop, platform)
    beyond = next((kind.name for kind in kinds if kind.name != "DPD"), None)
    if beyond is not None:
        raise PlanError(f"rigid bodies need pairs with friction of isothermal DPD, not of {beyond}")
    if any(c is not NONE and c.gamma_perp for layer in layers for c in layer.values()):
        raise PlanError("friction across the line between beads (gamma_perp) does not act on rigid bodies; leave it out")
    if lam != 0.5:
        raise PlanError("velocities of rigid bodies are not predicted: lam must be 0.5")


def why_parts(
    scene: Scene, bonded: Iterable[str], overlays: bool, looped: bool, few_charges: bool, double: bool
) -> tuple[frozenset[str], dict[str, str]]:
    """What the pair kernel holds of a scene beside its pair terms, and the reason for each part that the scene has.

    ``bonded`` are the names of its kinds of bonds, angles, dihedrals and impropers.
    """
    there = {
        **dict.fromkeys(bonded, True),
        "overlays": overlays,
        "segments": scene.segments,
        "body forces": any(isinstance(term, BodyForce) for term in scene.body_forces),
        "walls": scene.walls,
    }
    why = dict.fromkeys((part for part, found in there.items() if found), "a loop holds all it can" if looped else "there is no loop")
    held = frozenset(why) if looped else frozenset()
    if scene.electrostatics is None:
        return held, why
    if not looped:
        return held, why | {"charges": "there is no loop"}
    if not double:
        return held, why | {"charges": "the platform sums them"}
    if not few_charges:
        return held, why | {"charges": "for so many PME takes less time"}
    return held | {"charges"}, why | {"charges": "so few take less time without a grid"}


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
