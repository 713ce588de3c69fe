"""Reporters of forces on walls: the impulses that they have taken up, which the Context keeps."""

import numpy as np
from openmm import unit

from ..base.errors import ParameterError, what_is
from ..base.names import IMPULSES
from ..kernels.driven import Driven
from ..kernels.solids import Solids
from ..model.flow import AXES
from ..simulation.built import BuiltSystem
from .flow import BuiltReporter
from .observer import require_built


class _Impulses(BuiltReporter):
    """Records context parameters with impulses, by their names in an array (..., 3)."""

    def __init__(self, interval: int, built: BuiltSystem, names: np.ndarray):
        super().__init__(interval, built)
        self._names, self._rows = names, list[tuple[float, np.ndarray]]()

    def report(self, simulation, state):
        """Take one sample; the first one starts the record."""
        state = simulation.context.getState(parameters=True)
        values = state.getParameters()
        taken = np.reshape([values[name] for name in self._names.ravel()], self._names.shape)
        self._rows.append((state.getTime().value_in_unit(unit.picosecond), taken))

    @property
    def times(self) -> np.ndarray:
        """(n,) time at the end of each interval, ps."""
        return np.array([time for time, _ in self._rows[1:]])

    @property
    def _rates(self) -> np.ndarray:
        spans = np.diff([time for time, _ in self._rows]).reshape(-1, *[1] * self._names.ndim)
        return np.diff([taken for _, taken in self._rows], axis=0).reshape(-1, *self._names.shape) / spans


class SolidReporter(_Impulses):
    """Reporter that records the force and the torque of bounces on each :class:`openmm_dpd.SolidWall`, as impulses per time over all steps
    since the last report.

    The Context keeps the sums, so they continue after a restart.  The fluid has lost the momentum that walls have gained, to rounding.
    Forces on frozen beads behind a wall are not in them.  ``interval`` is the number of steps between samples; ParameterError if the built
    scene has no such walls.
    """

    def __init__(self, interval: int, built: BuiltSystem):
        solids = built.plan.driven
        if not isinstance(solids, Solids):
            raise ParameterError("SolidReporter needs a scene with walls of a shape, SolidWall")
        super().__init__(interval, built, np.reshape(list(solids.impulses.values()), solids.shape))

    @property
    def forces(self) -> np.ndarray:
        """(n, S, 3) mean force on each wall in each interval, kJ/mol/nm."""
        return self._rates[:, :, 0]

    @property
    def torques(self) -> np.ndarray:
        """(n, S, 3) mean torque on each wall in each interval, about its centre, kJ/mol."""
        return self._rates[:, :, 1]


class WallReporter(_Impulses):
    """Reporter that records the forces on two walls, for :func:`.couette_viscosity`.

    A force is the impulse of reflections, repulsion and friction per time, over all steps since the last report.  The Context keeps the
    sums, so they continue after a restart.  The fluid has lost the momentum that the walls have gained, to rounding.

    Parameters
    ----------
    interval : int
        Steps between samples; the error of the stress is small over some units of time, as exchange with the first layer cancels.
    built : BuiltSystem
        A built scene in which a wall has a velocity, which may be (0, 0, 0), or a continuum behind it.
    axis : {"x", "y", "z"}
        Normal of the walls, one at each end.

    Raises
    ------
    ParameterError
        If there are no two walls along the axis whose forces are recorded, or no periodic box.
    """

    def __init__(self, interval: int, built: BuiltSystem, axis: str = "z"):
        require_built(built, "WallReporter")
        driven = built.plan.driven
        if axis not in AXES or not isinstance(driven, Driven) or not driven.there[AXES.index(axis)].all():
            raise ParameterError(
                f"there are no two walls along {what_is(axis)} whose forces are recorded; give one of them a velocity, such as (0, 0, 0), "
                "or beside walls of a shape take SolidReporter"
            )
        box = built.plan.scene.box
        if box is None:
            raise ParameterError("the area of walls, over which forces are taken, needs a periodic box; the scene has none")
        self._axis = AXES.index(axis)
        super().__init__(interval, built, np.array([[IMPULSES[self._axis, side, k] for k in range(3)] for side in range(2)]))
        self.area = float(np.prod(np.delete(np.diag(box), self._axis)))

    @property
    def forces(self) -> np.ndarray:
        """(n, 2, 3) mean force on the lower and on the upper wall in each interval, kJ/mol/nm."""
        return self._rates

    def shear(self, component: str = "x") -> np.ndarray:
        """(n,) shear stress, viscosity times shear rate, from the drag on the two walls (mean of both), kJ/mol/nm^3."""
        if component not in AXES or AXES.index(component) == self._axis:
            raise ParameterError(f"component must be a direction in the plane of the walls, not {what_is(component)}")
        along = self.forces[:, :, AXES.index(component)]
        return 0.5 * (along[:, 0] - along[:, 1]) / self.area

    @property
    def pressure(self) -> np.ndarray:
        """(n,) pressure of the fluid on the walls, mean of both, kJ/mol/nm^3."""
        across = self.forces[:, :, self._axis]
        return 0.5 * (across[:, 1] - across[:, 0]) / self.area
