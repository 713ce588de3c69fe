"""Homogeneous shear by Lees-Edwards boundary conditions."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.errors import ParameterError, require
from ..base.units import keep
from .pairs import checked


@dataclass(frozen=True)
class LeesEdwards:
    r"""Shear along x with a gradient along y: periodic images slide over each other, and the fluid follows.

    The mean velocity is :math:`v_x = \dot\gamma y`, without walls (Lees and Edwards, J. Phys. C 5, 1921 (1972)).  In a box that is tilted
    along x the shear starts from this tilt.  There are three kinds: a constant ``rate``; a rate that changes linearly from ``rate`` to
    ``end_rate`` within ``ramp_time`` and then stays constant; or an oscillation with the strain :math:`\gamma_0 \sin\omega t` of
    ``amplitude`` and ``frequency``.

    Parameters
    ----------
    rate : inverse time, optional
        Shear rate, 1/ps, of either sign.
    end_rate : inverse time, optional
        Rate at the end of a ramp, 1/ps.
    ramp_time : time, optional
        Duration of a ramp, ps.
    amplitude : float, optional
        Strain amplitude.
    frequency : inverse time, optional
        Angular frequency, 1/ps: 2 pi over the period.

    Raises
    ------
    ParameterError
        If a number is out of bounds, or the parameters are not those of one kind.
    """

    rate: float | None = None
    end_rate: float | None = None
    ramp_time: float | None = None
    amplitude: float | None = None
    frequency: float | None = None

    def __post_init__(self):
        given = [name for name in self.__dataclass_fields__ if getattr(self, name) is not None]
        if given not in (["rate"], ["rate", "end_rate", "ramp_time"], ["amplitude", "frequency"]):
            raise ParameterError(
                "LeesEdwards takes rate (constant), rate, end_rate and ramp_time (a ramp), or amplitude and frequency (oscillating), "
                f"not {', '.join(given) or 'nothing'}"
            )
        kinds = {"ramp_time": "time", "amplitude": "dimensionless"}
        for name in given:
            signed = name in ("rate", "end_rate")
            value = checked(getattr(self, name), kinds.get(name, "rate"), f"the shear's {name}", positive=not signed, signed=signed)
            keep(self, **{name: value})

    @property
    def constant(self) -> bool:
        """Whether the rate is constant."""
        return self.amplitude is None and self.ramp_time is None

    def __str__(self) -> str:
        if self.amplitude is not None:
            return f"strain {self.amplitude:g} sin({self.frequency:g} t)"
        ramp = "" if self.ramp_time is None else f" to {self.end_rate:g} within {self.ramp_time:g} ps"
        return f"rate {self.rate:g}{ramp} /ps"


def check_shear(shear: Any, scene: Any) -> None:
    """Raise ParameterError if a scene cannot be sheared, with the reason."""
    if shear is None:
        return
    require(shear, LeesEdwards, "shear must be a LeesEdwards, such as LeesEdwards(rate=0.1)")
    reasons = {
        "it needs a periodic box": scene.box is None,
        "the box it starts from may be tilted along the flow only": scene.box is not None and bool(np.any(scene.box[2, :2])),
        "beads that do not move stand still in the flow": bool(scene.immobile.any()),
        "walls stand still in the flow": bool(scene.walls),
        "forces on single beads depend on places that the flow shifts, or accelerate all of it": bool(scene.body_forces),
        "sources stay where they are while the fluid flows on": bool(scene.sources),
        "`interacting` takes forces from beads, and momentum is lost": scene.interacting is not None,
        "lattice sums of charges have no sheared images": scene.electrostatics is not None,
    }
    wrong = next((reason for reason, holds in reasons.items() if holds), None)
    if wrong is not None:
        raise ParameterError(f"Lees-Edwards shear is not possible in this scene: {wrong}")
