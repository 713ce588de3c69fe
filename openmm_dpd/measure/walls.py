"""What walls take up of momentum, recorded during a run: shear stress and pressure."""

from itertools import product

import numpy as np
from openmm import unit

from ..base.errors import ParameterError, what_is
from ..base.names import IMPULSES
from ..model.flow import AXES
from ..simulation.built import BuiltSystem
from .flow import BuiltReporter


class WallReporter(BuiltReporter):
    """Records the forces on two walls, for ``simulation.reporters``, and :func:`.couette_viscosity`.

    They are impulses over time, of reflections, repulsion and friction in all steps since the report before: nothing is missed in between.
    The Context keeps their sums, so that they go on after a restart; the fluid has lost what its walls have got, to rounding.

    Parameters
    ----------
    interval : int
        Steps between samples; for a small error of the stress some units of time, in which what walls and first layer exchange cancels.
    built : BuiltSystem
        A scene in which a wall has a velocity, which may be (0, 0, 0), or something behind it.
    axis : {"x", "y", "z"}
        Of the walls, one at each end.

    Raises
    ------
    ParameterError
        If there are no such walls.
    """

    def __init__(self, interval: int, built: BuiltSystem, axis: str = "z"):
        super().__init__(interval, built)
        driven = built.plan.driven
        if axis not in AXES or driven is None or not driven.there[AXES.index(axis)].all():
            raise ParameterError(
                f"there are no two walls along {what_is(axis)} whose forces are recorded: give one of the walls a velocity, (0, 0, 0) say"
            )
        box = built.plan.scene.box
        if box is None:
            raise ParameterError("forces over the area of walls need a periodic box")
        self._axis, self._rows = AXES.index(axis), list[tuple[float, np.ndarray]]()
        self.area = float(np.prod(np.delete(np.diag(box), self._axis)))

    def report(self, simulation, state):
        """Take one sample; the first is where the record begins."""
        state = simulation.context.getState(parameters=True)
        values, places = state.getParameters(), product(range(2), range(3))
        taken = [values[IMPULSES[self._axis, side, k]] for side, k in places]
        self._rows.append((state.getTime().value_in_unit(unit.picosecond), np.reshape(taken, (2, 3))))

    @property
    def times(self) -> np.ndarray:
        """(n,) when each of the intervals ended, ps."""
        return np.array([time for time, _ in self._rows[1:]])

    @property
    def forces(self) -> np.ndarray:
        """(n, 2, 3) mean force on the lower and on the upper wall in each interval, kJ/mol/nm."""
        spans = np.diff([time for time, _ in self._rows])
        return np.diff([taken for _, taken in self._rows], axis=0).reshape(-1, 2, 3) / spans[:, None, None]

    def shear(self, component: str = "x") -> np.ndarray:
        """(n,) stress that drags the lower wall forwards and the upper one back, mean of both, kJ/mol/nm^3: viscosity times shear rate."""
        if component not in AXES or AXES.index(component) == self._axis:
            raise ParameterError(f"a shear stress has a direction in the plane of the walls, not {what_is(component)}")
        along = self.forces[:, :, AXES.index(component)]
        return 0.5 * (along[:, 0] - along[:, 1]) / self.area

    @property
    def pressure(self) -> np.ndarray:
        """(n,) of the fluid on the walls, mean of both, kJ/mol/nm^3."""
        across = self.forces[:, :, self._axis]
        return 0.5 * (across[:, 1] - across[:, 0]) / self.area
