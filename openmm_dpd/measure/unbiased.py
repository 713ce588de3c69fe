"""The kinetic temperature in a strong shear, relative to the flow that the beads have, not to the one that was imposed."""

import numpy as np

from ..base.errors import ParameterError
from ..base.geometry import sums_in_slices
from ..base.units import whole_number
from ..simulation.built import BuiltSystem
from .flow import BuiltReporter
from .present import Present


class UnbiasedTemperatureReporter(BuiltReporter):
    """Reporter that records a profile-unbiased temperature of a Lees-Edwards shear, in ``kT`` (kJ/mol, one value per sample).

    Velocities are taken relative to the mean velocity of the beads in each of the columns along x, the direction of the flow, into which
    the y-z plane is divided; a column with n beads has 3 (n - 1) degrees of freedom.  At strong shear the flow is not linear everywhere
    and beads may move in strings; their motion together counts as heat in temperatures relative to the linear flow, as
    :class:`DPDReporter` has them, and not here (Evans and Morriss, Phys. Rev. Lett. 56, 2172 (1986)).

    Parameters
    ----------
    interval : int
        Steps between samples.
    built : BuiltSystem
        A built scene with a Lees-Edwards shear.
    columns : int, default 5
        Number of columns along y, and along z; each should be at least a cutoff wide.

    Raises
    ------
    ParameterError
        If the scene has no shear, or the number is below 1.
    """

    def __init__(self, interval: int, built: BuiltSystem, columns: int = 5):
        super().__init__(interval, built)
        if built.plan.scene.shear is None:
            raise ParameterError("a profile-unbiased temperature needs a scene with a LeesEdwards shear")
        self.columns, self.kT = whole_number(columns, "the number of columns", least=1), list[float]()
        self._present = Present(built)

    def report(self, simulation, state):
        """Take one sample."""
        present, n = self._present, self.columns
        present.look(simulation.context)
        assert present.box is not None
        force, v = present.seen()
        parts = present.x[:, 1:] / np.diag(present.box)[1:]
        y, z = np.minimum((n * (parts - np.floor(parts))).astype(np.int64), n - 1).T
        column, count = n * y + z, n * n
        mass, beads = sums_in_slices(column, present.mass, count), sums_in_slices(column, None, count)
        momenta = np.array([sums_in_slices(column, present.mass * along, count) for along in v.T])
        own = np.sum(momenta**2, axis=0)[mass > 0] / mass[mass > 0]
        twice = present.kinetic_stress(v, force)[:3].sum() - own.sum()
        self.kT.append(float(twice / (3 * np.maximum(beads - 1, 0).sum())))
