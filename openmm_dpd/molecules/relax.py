"""Relaxation of packed molecules before a run."""

from dataclasses import replace

import numpy as np
import openmm
from openmm import unit

from ..base.errors import ParameterError, RunError, require
from ..base.units import to_md, whole_number
from ..kernels.shear import add_flow, rate_at
from ..model.scene import Scene
from ..simulation.build import build

#: A mixture that is hotter than this many times its kT after relaxation has blown up.
HOT = 10.0


def relax(
    scene: Scene, *, iterations: int = 100, steps: int = 0, dt=None, scheme: str = "middle", platform: str | None = None, seed: int = 1
) -> Scene:
    """Relax a scene, so that the first steps of a run do not blow up.

    A few iterations of the minimiser (``built.simulation().minimizeEnergy()``) remove overlaps and bent bonds; they need not converge.
    Each iteration lowers the energy, moves no bead by more than a tenth of the cutoff, and stretches no FENE bond to its R0.  Optional
    steps of dynamics follow, whose friction removes the remaining energy.

    Parameters
    ----------
    scene : Scene
        Any scene; immobile beads (``mobile``) stay in place.
    iterations : int, default 100
        Most iterations of the minimiser; 0 for none.
    steps : int, default 0
        Steps of dynamics afterwards, with the scene's own thermostat.
    dt : time, optional
        Step size, required with ``steps``; half of that of the run is a good choice.
    scheme, platform, seed
        Choices for the dynamics, see :func:`openmm_dpd.build`.

    Returns
    -------
    Scene
        The scene with new positions, and with velocities after ``steps``.  Molecules stay whole.

    Raises
    ------
    RunError
        If the energy is not finite at the start or end, the steps fail, or the beads are more than ten times too hot at the end.
    """
    whole_number(iterations, "iterations", least=0)
    whole_number(steps, "steps", least=0)
    if steps and dt is None:
        raise ParameterError("relax needs a step size for its steps, such as relax(scene, steps=200, dt=0.01)")
    require(scene, Scene, "scene must be a Scene, such as mixture.scene(...)")
    if steps and scene.reactions:
        raise ParameterError("in steps of relax bonds would form that its scene does not have; relax without steps")
    size = 0.001 if dt is None else to_md(dt, "time", "dt")
    # at rest: a shear would change the box
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
    # bonds in a periodic box always have a finite energy, however fast their beads are
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
