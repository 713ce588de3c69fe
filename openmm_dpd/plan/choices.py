"""Checks of what a script chooses besides the scene: step size, weight of the prediction, seed, platform; and of cutoffs in the box."""

import secrets
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import openmm

from ..base.errors import ParameterError, PlanError, in_length, what_is
from ..base.units import to_md, whole_number
from ..model.pairs import checked
from ..model.schemes import SCHEMES, Scheme

#: Names of OpenMM's platforms, present here or not.
PLATFORMS = ("Reference", "CPU", "OpenCL", "CUDA", "HIP")


def checked_step(dt) -> float:
    """The step size, ps; ParameterError unless it is a time > 0."""
    return checked(dt, "time", "dt", positive=True)


def checked_weight(lam) -> float:
    """The weight of the velocity prediction; ParameterError if it is out of bounds."""
    weight = to_md(lam, "dimensionless", "lam")
    if not isinstance(weight, float) or not 0.0 <= weight <= 1.0:
        raise ParameterError(f"lam (lambda of the modified velocity Verlet scheme) must be between 0 and 1, but is {what_is(lam)}")
    return weight


def checked_lam(lam, scheme: Scheme) -> float:
    """The weight of the velocity prediction; ParameterError if it is out of bounds, or the scheme predicts nothing."""
    weight = checked_weight(lam)
    if weight != 0.5 and not scheme.predicts:
        raise ParameterError(f"lam is the weight of the prediction of the scheme {predicting()}; the scheme {scheme.name!r} has none")
    return weight


def predicting() -> str:
    """Names of the schemes that predict velocities."""
    return " or ".join(repr(name) for name, known in SCHEMES.items() if known.predicts)


def checked_seed(seed: int | None) -> int:
    """The seed to use; None draws one from the operating system."""
    if seed is None:
        return secrets.randbelow(2**31 - 1) + 1
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**31:
        raise ParameterError(f"seed must be an integer with 0 <= seed < 2^31, not {what_is(seed)}")
    return int(seed)


def checked_interval(slow_every, why_no_loop: str | None) -> int:
    """Steps between kicks of forces that stay OpenMM's; ``why_no_loop`` is the reason why there is no loop of whole steps, or None."""
    interval = whole_number(slow_every, "slow_every", least=1)
    if interval > 1 and why_no_loop:
        raise PlanError(f"slow_every = {interval} needs the loop of whole steps, which is not used here: {why_no_loop}")
    return interval


def platform_name(platform: openmm.Platform | str | None, known: Sequence[str] = PLATFORMS) -> str | None:
    """Name of a platform, which must be among those known; None for none."""
    name = platform.getName() if isinstance(platform, openmm.Platform) else platform
    if name not in (None, *known):
        raise ParameterError(f"platform must be the name of one of OpenMM's platforms ({', '.join(known)}), not {what_is(name)}")
    return name


def check_cutoffs(box: np.ndarray | None, tables: Iterable[Mapping]) -> None:
    """Raise ParameterError if a cutoff is over half the box."""
    if box is None:
        return
    half = 0.5 * float(np.diag(box).min())
    for table in tables:
        for (a, b), coefficient in table.items():
            if coefficient.cutoff > half * (1 + 1e-12):
                raise ParameterError(
                    f"for types ({a}, {b}): the cutoff {in_length(coefficient.cutoff)} is over half the box, "
                    f"whose smallest width is {in_length(2 * half)}"
                )


#: Boxes are judged as if they were smaller by this factor, so that a barostat may shrink them.
_SHRINKS = 1.1


def may_miss_pairs(box: np.ndarray | None, cutoff: float) -> bool:
    """Whether the neighbour list of OpenMM's Reference platform can miss pairs at this cutoff in a box of reduced vectors (rows).

    It sorts particles into voxels of half a cutoff or a little more, and looks two voxels far, at one image of each voxel.  In a tilted box
    the rows of voxels shift where an image begins.  So the list is right if no row is met by two images, which takes an edge of three
    cutoffs, and if no shift leads further than one box to the side.  Otherwise it can miss pairs; the forces of single pairs are right all
    the same, and without a list (a CustomNonbondedForce with an interaction group) so are their sums.
    """
    if box is None:
        return False
    (a, _, _), (bx, b, _), (cx, cy, c) = box.tolist()
    reach = _SHRINKS * cutoff
    two_images = (bx != 0 and b < 3 * reach) or ((cx != 0 or cy != 0) and c < 3 * reach)
    # two voxels are at most 1.5 cutoffs
    return two_images or abs(bx) + abs(cx) > a - 1.5 * reach or abs(cy) > b - 1.5 * reach


def listed(platform: str | None, box: np.ndarray | None, cutoff: float) -> bool:
    """Whether OpenMM's pair forces with this cutoff can take their pairs from a neighbour list; they go through all pairs otherwise."""
    return platform != "Reference" or not may_miss_pairs(box, cutoff)
