"""Pressure tensors in slabs of a box."""

import numpy as np

from ..base.errors import ParameterError
from ..base.geometry import AXES_OF_TENSOR
from ..base.slices import axis_number, slicer
from ..base.stats import block_average
from ..kernels.extras import BondedKernel
from ..model.flow import AXES, require_plain_axis
from ..plan.reactions import come_and_go
from ..simulation.built import BuiltSystem
from .flow import BuiltReporter, require_whole_stress
from .of_beads import pair_terms
from .present import Present
from .stress_parts import BondedStress, beside_pairs

#: Why the stress of some terms has no place.
_NOWHERE = {
    **dict.fromkeys(("dihedrals", "impropers"), "as forces between pairs of their beads it diverges where all four lie in a plane"),
    "electrostatics": "the waves of charges lie on no line between beads",
    "segments": "the points where bonds touch are no beads",
}


class SlabStressReporter(BuiltReporter):
    r"""Reporter that records the pressure tensor in slabs, by Irving and Kirkwood's path along the line between two beads.

    .. math::

        \mathbf P(k) V_k = \sum_{i \in k} m \mathbf v \mathbf v + \sum_{\text{pairs}} \ell_{ij}(k)\, \mathbf r_{ij} \mathbf F_{ij}

    where :math:`V_k` is the volume of slab k, and :math:`\ell` the part of the line between the beads that lies in it.  The sum over all
    slabs is the tensor of :class:`StressReporter`, with the same kinetic part; friction and noise are left out, too.  The component along
    the axis is constant in equilibrium, except where a force acts on single beads.  Angles act by the central forces between their three
    beads (:doc:`/theory_flow`).  Between walls it is the stress of the fluid, and of immobile beads with it.

    Parameters
    ----------
    interval : int
        Steps between samples.
    built : BuiltSystem
        A built periodic scene.
    axis : {"z", "y", "x"}
        Axis along which the slabs are stacked; no other box vector points along it, and in a shear no images slide along it (x).
    bins : int, default 50
        Number of slabs in the box.

    Raises
    ------
    ParameterError
        If the scene has no stress tensor, or dihedrals, impropers, charges or segments, with the reason.

    References
    ----------
    J. H. Irving and J. G. Kirkwood, J. Chem. Phys. 18, 817 (1950); in slabs: J. P. R. B. Walton et al., Mol. Phys. 48, 1357 (1983).
    """

    def __init__(self, interval: int, built: BuiltSystem, axis: str = "z", bins: int = 50):
        super().__init__(interval, built)
        require_whole_stress(built.plan)
        scene, self._axis = built.plan.scene, axis_number(axis)
        require_plain_axis(scene.box, AXES[self._axis], "a profile of pressures")
        if scene.shear is not None and AXES[self._axis] == "x":
            raise ParameterError("axis must be 'y' or 'z' in a Lees-Edwards shear, whose images slide along x")
        for name, reason in _NOWHERE.items():
            if getattr(scene, name) or name in [f"{term._BEADS[2]}s" for term, _ in come_and_go(scene)]:
                raise ParameterError(f"the stress of {name} is not known in slabs: {reason}; StressReporter has that of the whole box")
        self._cut, self._present = slicer(axis, bins, None, scene.bead_masses, "bins"), Present(built)
        self._rows: list[np.ndarray] = []
        self._extents: list[np.ndarray] = []

    def report(self, simulation, state):
        """Take one sample."""
        present, cut, k = self._present, self._cut, self._axis
        present.look(simulation.context)
        assert present.box is not None
        edge, (bins,) = present.box[k, k], cut.bins
        force, v = present.seen()
        number, _ = cut.cells(present.x, present.box)
        moving = present.kinetic_stress(v, force, lambda m, a: np.stack([m * a[:, i] * a[:, j] for i, j in AXES_OF_TENSOR]))
        found = [cut.sums(number, row) for row in moving]
        pairs = [(beads, values[:, 1:7]) for beads, values in pair_terms(present, friction=False)]
        bonded = [BondedStress(extra) for extra in beside_pairs(present.plan) if isinstance(extra, BondedKernel)]
        for beads, values in pairs + [line for terms in bonded for line in terms.lines(present.x, present.box)]:
            first, second = (present.x[beads[:, n], k] / edge for n in (0, 1))
            step = second - first - np.rint(second - first)
            for component, shared in zip(found, along_lines(first * bins, step * bins, values, bins), strict=True):
                component += shared
        self._rows.append(np.array(found).T / cut.volumes(present.box)[:, None])
        self._extents.append(cut.extents(present.box))

    @property
    def pressures(self) -> np.ndarray:
        """(n, B, 6) pressure tensors of the slabs in each sample, kJ/mol/nm^3."""
        return np.array(self._rows).reshape(-1, self._cut.count, 6)

    @property
    def centres(self) -> np.ndarray:
        """(B,) middles of the slabs, nm, in a box of the mean length; ParameterError before the first sample."""
        if not self._rows:
            raise ParameterError("SlabStressReporter has no samples yet; run steps with it first")
        return self._cut.coordinates(np.mean(self._extents, axis=0))

    @property
    def tensor(self) -> tuple[np.ndarray, np.ndarray]:
        """(B, 6) mean pressure tensors of the slabs and their standard errors, kJ/mol/nm^3; errors need five samples."""
        rows = self.pressures
        errors = [[block_average(series).sem or np.nan for series in slab] for slab in rows.transpose(1, 2, 0)]
        return rows.mean(axis=0), np.array(errors)

    @property
    def tensions(self) -> np.ndarray:
        """(n, B) tension in each slab and sample, kJ/mol/nm^2: its width times the component along the axis less the mean of the others."""
        rows, width = self.pressures, np.array(self._extents) / self._cut.count
        return width * (1.5 * rows[:, :, self._axis] - 0.5 * rows[:, :, :3].sum(axis=2))


def along_lines(start: np.ndarray, step: np.ndarray, values: np.ndarray, bins: int) -> np.ndarray:
    """(columns, bins) sums of values (T, columns), each spread evenly over a line from ``start`` over ``step`` (T,), in units of the width
    of one of the ``bins`` slabs, which repeat."""
    low, length = np.minimum(start, start + step), np.abs(step)
    first, found = np.floor(low), np.zeros((values.shape[1], bins))
    within = low - first
    n = 0
    while n == 0 or np.any(within + length > n):
        inside = np.minimum(within + length, n + 1) - np.maximum(within, n)
        part = np.divide(inside, length, out=np.full(len(length), float(n == 0)), where=length > 0)
        number = np.mod(first + n, bins).astype(np.int64)
        for column, sums in zip(values.T, found, strict=True):
            sums += np.bincount(number, np.maximum(part, 0.0) * column, bins)
        n += 1
    return found
