"""Reporters for viscosities: stress tensors, and velocities in slabs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, require
from ..base.openmm_private import bare
from ..base.slices import slicer
from ..base.stats import block_average
from ..io.snapshot import Cadence
from ..model.flow import require_plain_axis
from ..model.shear import LeesEdwards
from ..plan.plan import Plan
from ..simulation.built import BuiltSystem
from .observer import require_built
from .present import Present, require_stress
from .stress_parts import needs_forces
from .within import Row, Within

#: Components of a stress tensor, in the order of its array.
COMPONENTS = ("xx", "yy", "zz", "xy", "xz", "yz")


class BuiltReporter(Cadence):
    """Base of reporters that need a built scene; ParameterError for a System made elsewhere."""

    def __init__(self, interval: int, built: BuiltSystem):
        require_built(built, type(self).__name__)
        if built.plan.host is not None:
            raise ParameterError(f"{type(self).__name__} needs a built scene: it does not know the terms of a System made elsewhere")
        super().__init__(interval, "samples")
        self.built = built


def require_whole_stress(plan: Plan) -> None:
    """Raise ParameterError if the stress tensor of a scene is not known, or not symmetric."""
    require_stress(plan)
    if any(np.any(getattr(term, "gamma_perp", 0) > 0) for term in plan.spec.terms):
        raise ParameterError("no stress tensor of this scene: transverse friction makes it asymmetric")


class StressReporter(BuiltReporter):
    r"""Reporter that records stress tensors, for :func:`.green_kubo_viscosity` and :func:`.surface_tension`.

    A sample is S = K + sum over pairs, bonds, angles, bonded segments and charges of r F, the pressure tensor times the volume, in
    kJ/mol.  K is the sum of m v v, corrected for the error of the scheme's velocities at whole steps (:doc:`/theory`).  The random force
    is left out: its contribution to a viscosity is known beforehand (:doc:`/theory_flow`), and that to a pressure is zero on average.  In
    a Lees-Edwards shear, velocities are relative to the flow.  Between walls it is that of the fluid, and of immobile beads with it,
    without what acts on single beads, and in the volume of the whole box.

    Sums are in double precision on the host, from the positions and velocities of the run; the reporter does not change the run.  A sample
    costs an extra pass over the pairs.  Where there are bonds or other forces, the state is copied as well; charges add a direct sum over
    pairs and waves.

    Parameters
    ----------
    interval : int
        Steps between samples; 1 or 2 for a correlation function.
    built : BuiltSystem
        A built periodic scene.  Pair terms may be DPD with radial friction, many-body DPD, Lennard-Jones and
        tabulated potentials; bonds, angles, segmental repulsion and charges are supported.

    Raises
    ------
    ParameterError
        If the scene has anything else.
    """

    def __init__(self, interval: int, built: BuiltSystem):
        super().__init__(interval, built)
        plan = built.plan
        require_whole_stress(plan)
        self._present, self._needs_forces = Present(built), needs_forces(plan.options.scheme)
        self._within = Within(self._present, self._present.mass, 0, tensors=True)
        #: for each sample: kinetic and conservative part, dissipative part, moment of friction, edges of the box, time and rate of a
        #: shear, kT, step size, time, kinetic part
        self._rows: list[tuple[np.ndarray, np.ndarray, float, np.ndarray, float, float, float, float, float, np.ndarray]] = []

    def report(self, simulation, state):
        """Take one sample."""
        present = self._present
        present.look(simulation.context)
        found = present.conservative(present.apart) if self._needs_forces or present.apart else None
        force = None if found is None else found.force
        v = present.on_step(force)
        regular, friction, moment = present.tensors(v, found)
        self._add(regular, present.kinetic_stress(v, force), friction, moment, bare(simulation.context.getState().getTime()))

    def report_within(self, simulation, first: int, end: int) -> bool:
        """Step to step ``end``, and sample from step ``first`` on before it; or do nothing and return False, if that cannot be done."""

        def take(row: Row) -> None:
            self._add(row.tensors[0], self._within.kinetic_stress(row), row.tensors[1], row.affine, row.time)

        return self._within.run(simulation.context, first, self.interval, end, take)

    def _add(self, conservative: np.ndarray, kinetic: np.ndarray, friction: np.ndarray, moment: float, time: float) -> None:
        present = self._present
        now = present.sheared, present.rate, present.kT, present.dt, time
        self._rows.append((conservative + kinetic, friction, moment, np.diag(present.box), *now, kinetic))  # type: ignore[arg-type]

    @property
    def regular(self) -> np.ndarray:
        """(n, 6) kinetic and conservative part of S (xx, yy, zz, xy, xz, yz), kJ/mol."""
        return np.array([row[0] for row in self._rows]).reshape(-1, 6)

    @property
    def kinetic(self) -> np.ndarray:
        """(n, 6) kinetic part of S (xx, yy, zz, xy, xz, yz), kJ/mol."""
        return np.array([row[9] for row in self._rows]).reshape(-1, 6)

    @property
    def friction(self) -> np.ndarray:
        """(n, 6) dissipative part of S (xx, yy, zz, xy, xz, yz), kJ/mol."""
        return np.array([row[1] for row in self._rows]).reshape(-1, 6)

    @property
    def shear(self) -> LeesEdwards | None:
        """The Lees-Edwards shear of the scene, or None."""
        return self.built.plan.scene.shear

    @property
    def sheared(self) -> np.ndarray:
        """(n,) time since the start of the shear at each sample, ps."""
        return np.array([row[4] for row in self._rows])

    @property
    def rates(self) -> np.ndarray:
        """(n,) shear rate at each sample, 1/ps; 0 without a shear."""
        return np.array([row[5] for row in self._rows])

    @property
    def confined(self) -> bool:
        """Whether walls or immobile beads take up momentum."""
        return bool(np.any(self.built.plan.spec.inv_mass == 0) or self.built.plan.scene.walls)

    @property
    def instantaneous(self) -> float:
        r"""Instantaneous viscosity, of the friction alone: :math:`\langle\sum\gamma w^2 r^2\rangle/15V`, kJ/mol ps/nm^3."""
        return float(np.mean(np.array([row[2] for row in self._rows]) / self._volumes)) / 15.0

    @property
    def pressures(self) -> np.ndarray:
        """(n, 6) kinetic and conservative pressure tensors, whose mean is that of the full pressure; kJ/mol/nm^3."""
        return self.regular / self._volumes[:, None]

    @property
    def edges(self) -> np.ndarray:
        """(n, 3) lengths of the box along x, y and z, nm."""
        return np.array([row[3] for row in self._rows]).reshape(-1, 3)

    @property
    def volume(self) -> float:
        """Mean volume, nm^3."""
        return float(np.mean(self._volumes))

    @property
    def _volumes(self) -> np.ndarray:
        return np.prod(self.edges, axis=1)

    @property
    def kT(self) -> float:
        """Thermal energy, kJ/mol; ParameterError if it differs between samples."""
        return self._the_same(6, "thermal energies", "kJ/mol")

    @property
    def time_step(self) -> float:
        """Time between two samples, ps; ParameterError if it is not constant."""
        step = self.interval * self._the_same(7, "step sizes", "ps")
        times = np.array([row[8] for row in self._rows])
        if np.any(np.abs(np.diff(times) - step) > 1e-6 * step + 1e-12 * np.abs(times[1:])):
            raise ParameterError(f"the samples are not evenly spaced, every {step:g} ps; take those of one run without a gap")
        return step

    def _the_same(self, column: int, what: str, unit: str) -> float:
        """The single value in a column of the samples; ParameterError if there is none or more than one."""
        found = {float(row[column]) for row in self._rows}
        if len(found) != 1:
            range_of = f" from {min(found):g} to {max(found):g} {unit}" if found else ""
            raise ParameterError(f"the {len(self._rows)} samples were taken with {len(found)} {what}{range_of}; exactly one is needed")
        return found.pop()


@dataclass(frozen=True, eq=False)
class VelocityProfile:
    """Velocity in slabs along an axis, in cells along two, or in rings around an axis, averaged over samples.

    Attributes
    ----------
    centres, width : (B,) array, float
        Of the slabs, nm.  Along two axes (B, C, 2), and two widths; then the following arrays are (B, C).
    velocity, error : (B,) arrays
        Mean velocity of each slab and its standard error, nm/ps.
    density : (B,) array
        Beads per nm^3.
    kT : (B,) array
        Kinetic temperature about the mean velocity of the slab at each moment, with 3 (n - 1) degrees of freedom for n beads, kJ/mol.
    rows : (n, B) array
        Velocity of each slab in each sample (its momentum over its mean mass).
    length : float
        Length of the box along the axis of the slabs; two of them along two axes, of rings the radius of the largest, and the height.
    """

    centres: np.ndarray
    width: float | np.ndarray
    velocity: np.ndarray
    error: np.ndarray
    density: np.ndarray
    kT: np.ndarray
    rows: np.ndarray
    length: float | np.ndarray

    def __repr__(self) -> str:
        return f"<VelocityProfile of {len(self.rows)} samples in {' x '.join(map(str, self.velocity.shape))} slabs>"


class ProfileReporter(BuiltReporter):
    """Reporter that records velocities in slabs, cells or rings; immobile beads and those of rigid bodies are left out.

    In a Lees-Edwards shear, velocities are those of the beads wrapped into the box.

    Parameters
    ----------
    interval : int
        Steps between samples.
    built : BuiltSystem
        A built periodic scene.
    axis : {"x", "y", "z", "xy", "xz", "yz", "rx", "ry", "rz"}
        Axis along which the slabs are stacked, two axes of cells, or rings around an axis through the middle of the box, and along it
        (:func:`.density_profile`).
    component : {"x", "y", "z", "r", "phi"}
        Component of the velocity; in rings around z ``"r"``, ``"phi"`` or ``"z"``.
    bins : int or two of them, default 20
        Number of slabs in the box, along each axis.
    """

    def __init__(self, interval: int, built: BuiltSystem, axis: str = "z", component: str = "x", bins: int | Sequence[int] = 20):
        super().__init__(interval, built)
        scene = built.plan.scene
        self._cut = slicer(axis, bins, None, scene.bead_masses, "bins")
        require(axis, str, "axis must be one or two of 'x', 'y' and 'z', or 'r' before one of them")
        self._component = self._cut.component(component)
        if scene.box is None:
            raise ParameterError("a velocity profile needs a periodic box")
        for one in axis.replace("r", ""):
            require_plain_axis(scene.box, one, "a velocity profile")
        if scene.shear is not None and (self._cut.around or "x" in axis):
            raise ParameterError("axis must be 'y' or 'z' in a Lees-Edwards shear, whose images slide along x")
        self._flows, self._rates = axis.find("y") if scene.shear is not None and component == "x" else -1, list[float]()
        self._momentum: list[np.ndarray] = []
        self._mass, self._freedom, self._square, self._density = np.zeros((4, self._cut.count))
        self._extents: list[np.ndarray] = []
        self._mobile, self._present = built.plan.spec.inv_mass > 0, Present(built)
        if self._present.bodies is not None:
            self._mobile &= ~self._present.bodies.inside_bodies

    def report(self, simulation, state):
        """Take one sample."""
        present, cut = self._present, self._cut
        present.look(simulation.context)
        assert present.box is not None
        force, v = present.seen()
        mass = self.built.plan.scene.bead_masses[self._mobile]
        cell, along = cut.cells(present.x[self._mobile], present.box, v[self._mobile])
        assert along is not None
        total = cut.sums(cell, mass)
        momentum = np.array([cut.sums(cell, row) for row in mass * along.T])
        self._momentum.append(momentum[self._component])
        self._rates.append(present.rate if self._flows >= 0 else 0.0)
        self._mass += total
        counts = cut.sums(cell)
        self._freedom += 3 * np.maximum(counts - 1, 0)
        self._density += counts / cut.volumes(present.box)
        self._extents.append(cut.extents(present.box))
        squares = present.kinetic_stress(v, force, lambda weight, a: weight * np.sum(a * a, axis=1))
        # a slab's own motion, steady or not, is not heat; its thermal part has three degrees of freedom
        own = np.divide(np.sum(momentum**2, axis=0), total, out=np.zeros(cut.count), where=total > 0)
        self._square += cut.sums(cell, squares[self._mobile]) - own

    @property
    def profile(self) -> VelocityProfile:
        """Averages over the samples so far; ParameterError before the first one."""
        n, cut = len(self._momentum), self._cut
        if n == 0:
            raise ParameterError("ProfileReporter has no samples yet; run steps with it first")
        with np.errstate(divide="ignore", invalid="ignore"):
            rows = np.array(self._momentum) / (self._mass / n)
            kT = self._square / self._freedom
        lengths = np.mean(self._extents, axis=0)
        widths = lengths / cut.bins
        centres = cut.coordinates(lengths)
        if self._flows >= 0:
            rows += np.outer(self._rates, centres if centres.ndim == 1 else centres[..., self._flows].ravel())
        error = np.array([np.nan if not np.all(np.isfinite(row)) else block_average(row).sem or np.nan for row in rows.T])
        averages = (rows.mean(axis=0), error, self._density / n, kT, rows)
        velocity, error, density, kT, rows = (each.reshape(each.shape[:-1] + cut.bins) for each in averages)
        width, length = (widths, lengths) if len(lengths) > 1 else (float(widths[0]), float(lengths[0]))
        return VelocityProfile(centres, width, velocity, error, density, kT, rows, length)
