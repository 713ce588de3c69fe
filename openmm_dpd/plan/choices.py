"""Checks of what a script chooses beside the scene: step size, weight of the prediction, seed, platform, and cutoffs beside the box."""

import secrets
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import openmm

from ..base.errors import ParameterError, PlanError, what_is
from ..base.units import to_md, whole_number
from ..base.wording import in_length
from ..model.pairs import checked
from ..model.schemes import SCHEMES, Scheme

#: Names of OpenMM's platforms, present here or not.
PLATFORMS = ("Reference", "CPU", "OpenCL", "CUDA", "HIP")


def checked_step(dt) -> float:
    """The step size, ps."""
    return checked(dt, "time", "dt", positive=True)


def checked_lam(lam, scheme: Scheme) -> float:
    """The weight of the prediction; one that is given to a scheme that has none is an error."""
    weight = to_md(lam, "dimensionless", "lam")
    if not isinstance(weight, float) or not 0.0 <= weight <= 1.0:
        raise ParameterError(f"lam (lambda of the modified velocity Verlet scheme) must be between 0 and 1, but is {what_is(lam)}")
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
    """How often forces that stay OpenMM's kick; ``why_no_loop`` is the reason why there is no loop of whole steps."""
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
