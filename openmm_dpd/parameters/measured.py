"""Pressure and energy of a one-component fluid, from a short run."""

from dataclasses import dataclass

import numpy as np

from ..base.stats import Average, block_average
from ..base.units import whole_number
from ..measure import Observer
from ..model.pairs import DPD
from ..model.scene import Scene
from ..simulation.build import build
from .estimate import reduced_number

#: Time before the first sample and between samples, in units of rc (m/kT)^(1/2); soft beads equilibrate within a few units.
SETTLE, EVERY = 5.0, 0.25


@dataclass(frozen=True)
class MeasuredPressure:
    """Measured pressure and energy of a fluid, in reduced units, rc = m = kT = 1.

    Attributes
    ----------
    pressure : openmm_dpd.base.stats.Average
        p rc^3/kT.
    energy : openmm_dpd.base.stats.Average
        Potential energy per bead over kT.
    """

    pressure: Average
    energy: Average


def measured_pressure(
    A, density=3.0, *, beads: int = 1000, time: float = 200.0, dt: float | None = None, seed: int = 1, platform: str = "CPU"
) -> MeasuredPressure:
    """Pressure and energy of a one-component fluid, in reduced units, from a short run.

    Parameters
    ----------
    A : float
        A rc/kT, >= 0.
    density : float
        Beads per rc^3.
    beads : int, default 1000
        Number of beads in a cubic box.
    time : float, default 200
        Length of the run after the first 5 units of time, in rc (m/kT)^(1/2).
    dt : float, optional
        Step size in the same unit; by default 0.05 for A density up to 75, and smaller as 1/(A density)^(1/2) for stiffer fluids.
    seed : int
    platform : str

    Returns
    -------
    MeasuredPressure
        With standard errors of :func:`openmm_dpd.base.stats.block_average`.

    Raises
    ------
    ParameterError
        If a value is out of bounds, or the box is shorter than two cutoffs.
    """
    A, density = reduced_number(A, "A"), reduced_number(density, "density", positive=True)
    time = reduced_number(time, "time", positive=True)
    step = 0.05 * min(1.0, (75.0 / max(A * density, 1e-300)) ** 0.5) if dt is None else reduced_number(dt, "dt", positive=True)
    count = whole_number(beads, "beads", least=1)
    edge = (count / density) ** (1 / 3)
    positions = np.random.default_rng(seed).random((count, 3)) * edge
    scene = Scene({"W": 1.0}, ["W"] * count, positions, {("W", "W"): DPD(A=A, gamma=4.5)}, kT=1.0, box=np.full(3, edge))
    built = build(scene, dt=step, scheme="bababo", platform=platform, seed=seed)
    simulation, observer = built.simulation(), Observer(built)
    every = max(1, round(EVERY / step))
    simulation.step(round(SETTLE / step))
    rows = []
    for _ in range(max(1, round(time / step / every))):
        simulation.step(every)
        sample = observer.sample(simulation.context)
        # the kinetic part is known exactly, kT per bead; the rest is (sum of r . F)/(3 V)
        rows.append((((count - 1) + sample.virial_conservative / 3) / edge**3, sample.potential / count))
    pressure, energy = np.array(rows).T
    return MeasuredPressure(block_average(pressure, name="the pressure"), block_average(energy, name="the energy"))
