"""The stress tensor of the forces of a scene, summed in double precision from positions and velocities of a Context."""

import numpy as np
import openmm
from openmm import unit

from ..errors import ParameterError
from ..kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, STRESS, PairEngine
from ..plan import Plan
from .scene_samples import SceneSampler
from .stress_parts import engine_spec, stress_parts
from .temperature import noise_state

_NM, _V = unit.nanometer, unit.nanometer / unit.picosecond


class StressSums:
    """Sums of r F over pairs, bonds, angles, bonded segments and charges: xx, yy, zz, xy, xz, yz in kJ/mol.

    Transverse friction makes a tensor asymmetric; as in LAMMPS xy is then the sum of r_x F_y.

    Parameters
    ----------
    plan : Plan
        Of a periodic scene.  Its pair terms are DPD, many-body DPD, Lennard-Jones and tabulated potentials.

    Raises
    ------
    ParameterError
        If the scene has something else.
    """

    def __init__(self, plan: Plan):
        reason = self.why_not(plan)
        if reason is not None:
            raise ParameterError(f"no stress tensor of this scene: {reason}")
        self._plan, self.engine, self._parts = plan, PairEngine(engine_spec(plan)), stress_parts(plan)

    @staticmethod
    def why_not(plan: Plan) -> str | None:
        """Why there is no stress tensor, or None."""
        if plan.scene.box is None:
            return "there is no periodic box"
        if plan.spec.fields is not None:
            return "its beads have energies, temperatures or concentrations"
        unknown = next((kind.name for kind in plan.kinds if kind.stress_terms is None), None)
        return None if unknown is None else f"that of {unknown} is not known"

    def conservative(self, x: np.ndarray, box: np.ndarray) -> np.ndarray:
        """(6,) sums over the conservative forces at positions (N, 3) in a box (3, 3), nm."""
        self.engine.prepare(x, box)
        self.engine.forces(CONSERVATIVE | STRESS, None, 0.0, 1.0, 0, 0)
        stress = self.engine.stress.copy()
        for part in self._parts:
            stress += part(x, box)
        return stress

    def of_friction(self, context: openmm.Context, which: int, v: np.ndarray) -> np.ndarray:
        """(6,) sums over dissipative or random forces at velocities (N, 3) nm/ps, after :meth:`conservative` at the same positions."""
        kT, seed, counter, dt = noise_state(context, self._plan)
        self.engine.forces(which | STRESS, v, kT, dt, seed, counter)
        return self.engine.stress.copy()

    def counted(self, context: openmm.Context, sampler: SceneSampler) -> np.ndarray:
        """(6,) sums over the forces that move the beads: with friction and noise where they are forces (``mvv``)."""
        state = context.getState(positions=True)
        x = state.getPositions(asNumpy=True).value_in_unit(_NM)
        stress = self.conservative(x, state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(_NM))
        if self._plan.options.predicting:
            stress += self.of_friction(context, DISSIPATIVE | RANDOM, sampler.force_velocities(context))
        return stress
