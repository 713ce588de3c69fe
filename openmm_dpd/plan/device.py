"""The engine ``device``: pair terms on OpenMM's own device, by the plugin openmm-dpd-device.

It is chosen where the platform is a GPU, the plugin is there and the scene is within it.  What is measured from a State is measured by the
host's kernel.
"""

from collections.abc import Sequence
from functools import cache

import openmm

from ..base.errors import PlanError
from ..base.platforms import opencl_is_a_gpu
from ..kernels.engines import EngineKind, engine_kind, register_engine
from ..model.flow import Wall
from ..model.scene import Scene
from ..model.schemes import Scheme
from ..model.sources import Source
from .forces.device_force import MOST_SOURCES, MOST_SWEPT, why_no_plugin
from .kinds import Kind

#: Largest number of beads: more have no exact numbers in single precision.
MOST_BEADS = 2**24 - 1

#: Precision of OpenMM's GPU platforms unless another one is asked for: positions that are set far from the box, and States of beads that
#: have gone there, keep their digits, of which single precision has 7 from the origin on.  It takes 4 to 9 % longer on an H200.
PRECISION = "mixed"

#: A need of scenes (:meth:`.plan.Plan.needs`).
DRIVEN = "walls that move or have a shape or something behind them"

DEVICE = register_engine(
    EngineKind(
        name="device",
        what="OpenMM's device, by the plugin openmm-dpd-device",
        make=engine_kind("host").make,
        can=frozenset(
            (
                "friction as a force",
                "exact pair updates",
                "Shardlow's pair updates",
                "scenes without a box",
                "tilted boxes",
                "factors of bonded neighbours",
                "immobile beads",
                "particles that are left out",
                "several tables",
                DRIVEN,
                "Lees-Edwards shear",
                "stress",
                "Laplacian",
            )
        ),
    )
)


@cache
def is_gpu(platform: str | None) -> bool:
    """Whether a platform, by its name, is a GPU here."""
    if platform == "OpenCL":
        return opencl_is_a_gpu(openmm.Platform.getPlatformByName(platform))
    return platform in ("CUDA", "HIP")


def chosen_engine(
    engine: str, platform: str | None, scheme: Scheme, kinds: Sequence[Kind], acts: bool, scene: Scene, guided: bool, cut: bool, held: bool
) -> tuple[str, str]:
    """Name of the engine, and why it is that one.

    ``acts``: a pair kernel has something to do, ``guided``: a guide acts within steps, ``cut``: OpenMM has forces with a cutoff other than
    those of charges, ``held``: a pair kernel has to compute the conservative force.

    Raises
    ------
    PlanError
        If the device is asked for and cannot do it.
    """
    if engine == "auto" and not is_gpu(platform):
        return "host", "it runs everything"
    if engine not in ("auto", DEVICE.name):
        return engine, "as asked for"
    beyond = next((kind.name for kind in kinds if kind.device is None), None)
    apart = next((kind.name for kind in kinds if not kind.device_repels), None)
    cut = cut or apart is not None
    mixed = any(kind.fields for kind in kinds) or sum(kind.has_densities for kind in kinds) > 1
    sheared = scene.shear is not None
    sources, species = scene.sources, getattr(scene.internal, "n_species", 0)
    reasons = {
        "OpenMM's own integrator steps": scheme.native,
        "there is no friction and no noise, and no force that OpenMM does not compute": not acts,
        f"it has no {beyond}": beyond is not None,
        f"it leaves the conservative force of {apart} to OpenMM, and here that has to be the pair kernel's": held and apart is not None,
        "beads stay where they are in a shear, and forces of OpenMM's own with a cutoff would put them back into the box": cut and sheared,
        "it has no rigid bodies": bool(scene.bodies),
        "it has no walls that have a shape": not all(isinstance(wall, Wall) for wall in scene.walls),
        "it has no bonds that form and break": bool(scene.reactions),
        "nothing but forces acts within its steps": guided,
        "it has several tables of isothermal terms alone, many-body terms in one of them": len(kinds) > 1 and mixed,
        f"it has pair updates of up to {MOST_SWEPT} species": not scheme.predicts and species > MOST_SWEPT,
        "it has no sources of a kind of its own, and no forces that follow what beads carry": any(type(s) is not Source for s in sources),
        f"it takes no more than {MOST_SOURCES} sources": len(sources) > MOST_SOURCES,
        f"it takes no more than {MOST_BEADS:,} beads": scene.n_beads > MOST_BEADS,
    }
    reason = next((reason for reason, holds in reasons.items() if holds), None) or why_no_plugin(platform)
    if reason is None:
        return DEVICE.name, "the platform is a GPU" if engine == "auto" else "as asked for"
    if engine == "auto":
        return "host", f"not the device: {reason}"
    raise PlanError(f"the engine {DEVICE.name!r} cannot run this scene on the platform {platform}: {reason}")
