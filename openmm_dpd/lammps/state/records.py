"""The arguments of single commands as plain data (fixes, computes, temperatures, pressure, minimisation, thermo output), and samples."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...base.errors import DeckError, ParameterError
from ...base.geometry import weighted_sum
from ..language.lexer import Line, located
from .box import Box


@dataclass(frozen=True)
class Fix:
    """A fix: id, group, style, parameters, and the line that defines it."""

    name: str
    group: str
    style: str
    parameters: dict
    where: Line

    def error(self, message: str) -> DeckError:
        """An error about this fix."""
        return located(self.where, f"fix {self.name}: {message}")


#: Fixes that change the forces on single beads; their parameter ``force`` has three formulas, some may be NULL.
FORCE_FIXES = ("addforce", "setforce", "gravity")
#: Other fixes that change forces, or add friction, which only a guide of whole steps does.
ACTING_FIXES = (
    *("aveforce", "efield", "spring", "spring/self", "viscous", "langevin", "wall/region"),
    *("wall/lj93", "wall/lj126", "wall/lj1043", "wall/harmonic", "wall/morse"),
)
#: Fixes that take energy from beads or give it to them; thermo word ``ecouple`` is its sum.
COUPLED = ("nvt", "npt", "temp/rescale", "temp/berendsen", "langevin")
#: Fixes that only a guide of whole steps carries out, and all that one may.
GUIDING = (*ACTING_FIXES, *COUPLED, "nve/limit", "move", "adapt")
GUIDED = (*FORCE_FIXES, *GUIDING)
#: Fixes that make and break bonds.
FORMING = ("bond/create", "bond/create/angle")
REACTING = (*FORMING, "bond/break")
#: Bonds of a bead by one fix where it names no maxbond, and LAMMPS has no limit: a run in which one gets as many stops.
NO_LIMIT = 15
#: Values of fixes by style: whether there is a scalar, the length of the vector (None: it varies), and whether that is a sum over beads.
FIX_VALUES: dict[str, tuple[bool, int | None, bool]] = {
    **{"addforce": (True, 3, True), "setforce": (False, 3, True), "aveforce": (False, 3, True), "efield": (True, 3, True)},
    **{"spring": (True, 4, True), "spring/self": (True, 0, True), "wall/region": (True, 3, True), "nvt": (True, None, False)},
    **dict.fromkeys(("temp/rescale", "temp/berendsen", "langevin", "nve/limit", "npt"), (True, 0, True)),
    **dict.fromkeys(REACTING, (False, 2, False)),
    **dict.fromkeys([style for style in ACTING_FIXES if style.startswith("wall/") and style != "wall/region"], (True, None, True)),
}


class Valued:
    """A fix with values that formulas can use."""

    name: str
    #: Shape of the values of ``f_id`` (), ``f_id[i]`` (n) or ``f_id[i][j]`` (n, m); None where a size may change.
    shape: tuple[int | None, ...]
    what: str  #: Description of the values for error messages

    @property
    def size(self) -> int:
        """Number of values of ``f_id[*]``."""
        return (self.shape[0] or 0) if len(self.shape) == 1 else 0

    def is_extensive(self, *indices: int) -> bool:
        """Whether thermo output divides this value by the number of beads when it is normalised."""
        return False

    def check_index(self, *indices: int) -> None:
        """Raise ParameterError unless the fix has a value with these indices."""
        if len(indices) != len(self.shape):
            usage = f"f_{self.name}" + ("", f"[1] to f_{self.name}[{self.size}]", "[row][column]")[len(self.shape)]
            raise ParameterError(f"f_{self.name}: {self.what}; use {usage}")
        if any(index < 1 or (size is not None and index > size) for index, size in zip(indices, self.shape, strict=True)):
            raise ParameterError(f"f_{self.name}{''.join(f'[{index}]' for index in indices)} is out of range: {self.what}")


class FixValues(Valued):
    """The values of a fix that acts: an energy, a total force and the like."""

    def __init__(self, fix: Fix):
        self.name, (self._scalar, length, self._extensive) = fix.name, FIX_VALUES[fix.style]
        if length is None:  # one for each wall, or four for each thermostat of a chain
            length = len(fix.parameters.get("faces", ())) or 4 * len(fix.parameters["numbers"]) // 3
        self.shape, self.what = (length,), f"fix {fix.style} has {'a value and ' * self._scalar}a vector of {length}"

    def check_index(self, *indices: int) -> None:
        """Raise ParameterError unless the fix has a value with these indices."""
        if indices or not self._scalar:
            super().check_index(*indices)

    def is_extensive(self, *indices: int) -> bool:
        """Whether it is a sum over beads."""
        return self._extensive or not indices


@dataclass(frozen=True)
class Compute:
    """A compute: id, group, style, arguments, and the settings that ``ComputeSpec.prepare`` makes of them."""

    name: str
    group: str
    style: str
    arguments: tuple[str, ...] = ()
    settings: Any = None


@dataclass(frozen=True)
class KspaceSetup:
    """Settings of ``kspace_style`` and ``kspace_modify``: accuracy, gewald (1/nm), mesh, and the line."""

    accuracy: float = 1e-4
    gewald: float | None = None
    mesh: tuple[int, ...] | None = None
    where: Line | None = None


@dataclass
class RestartSettings:
    """Settings of ``restart``: interval, file names (``*`` is replaced by the step), and the number of files written so far."""

    every: int
    files: tuple[str, ...]
    written: int = 0


@dataclass
class ThermoSettings:
    """Settings of thermo output: columns, interval, normalisation, computes and formats."""

    words: list[str] = field(default_factory=lambda: ["step", "temp", "epair", "emol", "etotal", "press"])
    every: int = 0
    norm: bool | None = None
    temp: str = "thermo_temp"
    press: str = "thermo_press"
    layout: str = "one"
    custom: bool = False  #: Whether the deck names the columns
    lost: str = "error"
    formats: dict[str | int, str] = field(default_factory=dict)
    headers: dict[str | int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Window:
    """First step of a run, and the first and last step of its ramps (options ``start`` and ``stop``)."""

    first: int
    begin: int
    end: int


@dataclass(frozen=True)
class Slide:
    """Displacement of the images above the box since the run began, and their velocity, due to ``fix deform``; in MD units."""

    distance: float
    speed: float
    plane: str = "xy"  #: Axis along which they slide, and axis along which they are above

    @property
    def axes(self) -> tuple[int, int]:
        """Numbers of these axes."""
        return "xyz".index(self.plane[0]), "xyz".index(self.plane[1])

    def shift(self, images: np.ndarray, amount: float) -> np.ndarray:
        """(N, 3) what an amount for the next image adds, where beads are in the images (N, 3)."""
        flow, gradient = self.axes
        return np.outer(images[:, gradient], np.where(np.arange(3) == flow, amount, 0.0))


#: Slide without a shear.
NO_SLIDE = Slide(0.0, 0.0)


@dataclass(frozen=True)
class DeckSample:
    """One measurement, in MD units (nm, Da, ps, kJ/mol).  None means not measured; words that need the value raise an error."""

    step: int  #: Number of the step, as the deck counts
    kinetic: float | None = None  #: Kinetic energy of all beads
    pair_energy: float | None = None  #: Conservative pair energy, charges included
    #: Energy of the charges within it: short-ranged part and lattice sum.
    short_energy: float | None = 0.0
    lattice_energy: float | None = 0.0
    #: Energy of the bonds, the angles, the dihedrals and the impropers.
    bond_energy: float | None = 0.0
    angle_energy: float | None = 0.0
    dihedral_energy: float | None = 0.0
    improper_energy: float | None = 0.0
    #: Sum of r.F over what LAMMPS counts in ``press`` with this scheme: pairs and bonds, and with ``mvv`` the dissipative and random
    #: parts as well.
    virial: float | None = None
    virial_full: float | None = None  #: Sum of r.F that always includes the dissipative and random parts
    #: (6,) xx, yy, zz, xy, xz, yz of the virial that ``virial`` counts, and of the sum of m v v over all beads.
    virial_tensor: np.ndarray | None = None
    kinetic_tensor: np.ndarray | None = None
    #: Euclidean norm of all force components, and the largest absolute one.
    force_norm: float | None = None
    force_max: float | None = None
    kT_conf: float | None = None  #: Configurational temperature as an energy
    box: np.ndarray | None = None  #: (3, 3) box vectors; the deck's box if None
    slide: Slide = NO_SLIDE  #: Slide of the images above the box
    #: (N, 3) positions and velocities.
    positions: np.ndarray | None = None
    velocities: np.ndarray | None = None
    forces: np.ndarray | None = None  #: (N, 3) total forces; friction and noise are included where they are forces (``mvv``)
    #: Values of the fixes that act, by name: the scalar and then the vector, in the deck's units.
    acted: Mapping[str, list[float]] | None = None
    fix_energy: float | None = 0.0  #: Energy of the fixes that ``fix_modify energy yes`` counts
    #: Fields of the beads, as from :func:`openmm_dpd.simulation.fields.read_fields`; empty if there are none.
    fields: Mapping[str, np.ndarray] | None = None
    #: By part, (N, 7) energies and r F of the beads, as from :func:`.measure.of_beads.bead_shares`.
    shares_of_beads: Mapping[str, np.ndarray] | None = None
    #: Beads and values of the conservative pair forces, as from :func:`.measure.of_beads.pair_terms`.
    pair_terms: Sequence[tuple[np.ndarray, np.ndarray]] | None = None
    cpu: float = 0.0  #: Seconds since the run began

    def read(self, name: str) -> Any:
        """The value with this name; None if it was not measured."""
        return getattr(self, name)


@dataclass(frozen=True)
class Temperature:
    """Settings of a temperature compute."""

    counted: tuple[bool, bool, bool] = (True, True, True)  #: Velocity components that are counted
    streaming: tuple[bool, bool, bool] = (False, False, False)  #: Components from which the mass-weighted mean of the bin is subtracted
    bins: tuple[int, int, int] = (1, 1, 1)  #: Numbers of bins along x, y and z
    deformed: bool = False  #: Whether the flow of a ``fix deform`` is subtracted
    table: bool = False  #: Whether the compute has a table of the bins (``out bin``) instead of a vector
    extra: float = 3.0  #: Degrees of freedom to subtract in total (``compute_modify extra/dof``)
    dimension: int = 3

    @property
    def count(self) -> int:
        """Number of bins."""
        return math.prod(self.bins)

    def freedom(self, n: int, bound: int = 0) -> float:
        """Degrees of freedom of n beads, of which rigid bodies take some."""
        counted = sum(self.counted[: self.dimension])
        return counted * n - counted / self.dimension * (self.extra + bound) - sum(self.streaming) * self.count

    def numbers(self, box: Box, positions: np.ndarray) -> np.ndarray:
        """(N,) bin of each bead, x fastest; positions are in the box."""
        low, edges = (0.0, 1.0) if box.triclinic else (box.low, box.edges)
        x = box.fractions(positions) if box.triclinic else positions
        cells = ((x - low) * (np.array(self.bins) / edges)).astype(np.int64)
        return np.clip(cells, 0, np.array(self.bins) - 1) @ np.array([1, self.bins[0], self.bins[0] * self.bins[1]])

    def thermal(self, velocities: np.ndarray, masses: np.ndarray, numbers: np.ndarray | None) -> np.ndarray:
        """(N, 3) counted part of the velocities; ``numbers`` are the bins, needed if a streaming velocity is subtracted."""
        if numbers is not None and any(self.streaming):
            momentum = np.zeros((self.count, 3))
            np.add.at(momentum, numbers, masses[:, None] * velocities)
            mean = momentum[numbers] / np.bincount(numbers, masses, self.count)[numbers, None]
            velocities = velocities - np.where(self.streaming, mean, 0.0)
        return velocities if all(self.counted) else np.where(self.counted, velocities, 0.0)


#: Norms of a force vector (N, 3): its length, the largest force on a bead, the largest component.
NORMS = {
    "two": lambda force: float(np.linalg.norm(force)),
    "max": lambda force: float(np.linalg.norm(force, axis=1).max(initial=0.0)),
    "inf": lambda force: float(np.abs(force).max(initial=0.0)),
}

#: Values of min_style, and those that start and end with beads at rest.
MIN_STYLES = ("cg", "hftn", "sd", "quickmin", "fire", "fire/old")
DAMPED = ("quickmin", "fire", "fire/old")
#: LAMMPS adds this to the energies when it computes a relative change.
_LEAST_ENERGY = 1e-8


@dataclass(frozen=True)
class StoppingRule:
    """The four arguments of ``minimize``, in the deck's units, and the norm of ``min_modify``."""

    energy: float  #: Tolerance of the relative energy change in an iteration
    force: float  #: Tolerance of the force norm
    #: Maximum numbers of iterations and of force evaluations; an iteration counts as at least one evaluation.
    iterations: int
    evaluations: int
    norm: str = "two"

    def reached(self, iterations: int, before: float, energy: float, force: np.ndarray) -> str | None:
        """Why the minimisation stops after an iteration from the energy ``before`` to ``energy``; None if it continues."""
        if abs(energy - before) < self.energy * 0.5 * (abs(energy) + abs(before) + _LEAST_ENERGY):
            return "energy tolerance"
        if NORMS[self.norm](force) < self.force:
            return "force tolerance"
        if iterations >= self.iterations:
            return "max iterations"
        return "max force evaluations" if iterations >= self.evaluations else None


def without_rotation(positions: np.ndarray, velocities: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """(N, 3) velocities without the rotation about the centre of mass; positions must be unwrapped."""
    x = positions - weighted_sum(masses, positions) / masses.sum()
    angular = np.sum(masses[:, None] * np.cross(x, velocities), axis=0)
    inertia = np.sum(masses * np.sum(x * x, axis=1)) * np.eye(3) - (masses[:, None] * x).T @ x
    omega = np.linalg.lstsq(inertia, angular, rcond=None)[0]
    return velocities - np.cross(omega, x)


@dataclass(frozen=True)
class MomentumRemoval:
    """What ``fix momentum`` removes."""

    every: int  #: Interval in steps
    linear: tuple[bool, bool, bool]  #: Components of the momentum
    angular: bool  #: Whether the rotation about the centre of mass is removed as well
    rescale: bool  #: Whether velocities are then rescaled to keep the kinetic energy

    def applied(self, positions: np.ndarray, velocities: np.ndarray, masses: np.ndarray) -> np.ndarray:
        """(N, 3) velocities after the removal; positions must be unwrapped."""
        v = velocities - np.where(self.linear, weighted_sum(masses, velocities) / masses.sum(), 0.0)
        if self.angular:
            v = without_rotation(positions, v, masses)
        before, after = (np.sum(masses[:, None] * u * u) for u in (velocities, v))
        return v * np.sqrt(before / after) if self.rescale and after > 0 else v


Three = tuple[float, float, float]


@dataclass(frozen=True)
class PressureControl:
    """The pressure imposed on the box."""

    axes: tuple[bool, bool, bool]  #: Edges of the box that may change
    coupled: bool  #: Whether all edges change by the same factor
    #: Pressure along each axis at the start and end of the run, kJ/mol/nm^3 (0 for fixed edges).
    start: Three
    stop: Three
    plane: bool = False  #: Whether x and y change by one factor and z by another, where there is no tension
    damps: Three = (0.0, 0.0, 0.0)  #: Times in which the edges follow, ps
    isothermal: bool = False  #: Whether a thermostat holds the temperature; otherwise the enthalpy is constant

    @property
    def constant(self) -> bool:
        """Whether the pressure is constant during the run."""
        return self.start == self.stop


def centre_of(pistons: list[Fix]) -> np.ndarray | None:
    """The point that fixes scale the box about, if there is one."""
    return next((np.array(fix.parameters["piston"]["about"]) for fix in pistons), None)
