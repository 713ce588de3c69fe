"""From packed molecules to a state that can be run."""

from dataclasses import replace

import numpy as np
import openmm
from openmm import unit

from ..base.errors import ParameterError, RunError, what_is
from ..base.units import to_md, whole_number
from ..kernels.shear import add_flow, rate_at
from ..model.scene import Scene
from ..simulation.build import build

#: A mixture that is hotter than so many times its kT after relaxing has blown up.
HOT = 10.0


def relax(
    scene: Scene, *, iterations: int = 100, steps: int = 0, dt=None, scheme: str = "middle", platform: str | None = None, seed: int = 1
) -> Scene:
    """The scene with beads moved downhill, so that the first steps do not blow up.

    Some iterations of the minimiser of ``built.simulation().minimizeEnergy()`` take overlaps and bent bonds away; it need not converge.
    It lowers the energy in every iteration, moves no bead by more than a tenth of the cutoff, and stretches no FENE bond to its R0.  Then
    follow, if wanted, some steps of the dynamics itself, whose friction takes the rest of the energy up.

    Parameters
    ----------
    scene : Scene
        Any scene; with fixed beads (``mobile``), these stay.
    iterations : int, default 100
        Most iterations of the minimiser; 0 leaves it out.
    steps : int, default 0
        Steps of the dynamics afterwards, with the scene's own thermostat.
    dt : time, optional
        Their step size; needed with ``steps``, half of what the run will use is a good choice.
    scheme, platform, seed
        As for :func:`openmm_dpd.build`.

    Returns
    -------
    Scene
        The same with new positions, and after ``steps`` with velocities too.  Molecules stay whole.

    Raises
    ------
    RunError
        If the energy is not finite at the start or at the end, the steps fail, or the beads end up more than ten times too hot.
    """
    whole_number(iterations, "iterations", least=0)
    whole_number(steps, "steps", least=0)
    if steps and dt is None:
        raise ParameterError("relax needs a step size for its steps: relax(scene, steps=200, dt=0.01)")
    if not isinstance(scene, Scene):
        raise ParameterError(f"relax wants a Scene, such as mixture.scene(...), not {what_is(scene)}")
    size = 0.001 if dt is None else to_md(dt, "time", "dt")
    # at rest: in a shear the box would not be that of the scene any more
    still = scene if scene.shear is None else replace(scene, shear=None, velocities=None)
    simulation = build(still, dt=size, scheme=scheme, platform=platform, seed=seed).simulation()
    context = simulation.context
    if iterations:
        simulation.minimizeEnergy(maxIterations=iterations)
    try:
        simulation.step(steps)
    except openmm.OpenMMException as error:
        raise RunError(f"the steps after the minimisation failed; take more iterations or a smaller dt than {size:g}: {error}") from None
    state = context.getState(positions=True, velocities=True, energy=True)
    energy = state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
    if not np.isfinite(energy):
        raise RunError(f"the potential energy is {energy} after relaxing; take more iterations or a smaller dt than {size:g}")
    # bonds in a periodic box never have an infinite energy, however fast their beads are
    kinetic = state.getKineticEnergy().value_in_unit(unit.kilojoule_per_mole) / (1.5 * scene.n_beads)
    if steps and scene.initial_kT > 0 and not kinetic < HOT * scene.initial_kT:
        raise RunError(
            f"after relaxing, kT is {kinetic:g} instead of {scene.initial_kT:g}; take more iterations or a smaller dt than {size:g}"
        )
    positions = np.array(state.getPositions(asNumpy=True).value_in_unit(unit.nanometer), dtype=np.float64)
    if not steps:
        return replace(scene, positions=positions)
    velocities = np.array(state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond), dtype=np.float64)
    if scene.shear is not None:
        add_flow(velocities, rate_at(scene.shear, 0.0), positions)
    return replace(scene, positions=positions, velocities=velocities)
