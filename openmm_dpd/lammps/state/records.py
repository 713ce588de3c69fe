"""What single commands of a deck say, as plain data: fixes, computes, temperatures, pressure, minimisation, thermo output; and a sample."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...base.errors import DeckError, ParameterError
from ...base.geometry import weighted_sum
from ..language.lexer import Line, located
from .box import Box


@dataclass(frozen=True)
class Fix:
    """One fix: its id, group and style, its parameters and its place."""

    name: str
    group: str
    style: str
    parameters: dict
    where: Line

    def error(self, message: str) -> DeckError:
        """An error about this fix."""
        return located(self.where, f"fix {self.name}: {message}")


#: Fixes that change the forces on single beads; their parameter ``force`` has three formulas, or NULL.
FORCE_FIXES = ("addforce", "setforce", "gravity")
#: Those whose vector is the total force on their group before they act.
VECTOR_FIXES = ("addforce", "setforce")


class Valued:
    """A fix with values that formulas name."""

    name: str
    #: How many values ``f_id`` (no index), ``f_id[i]`` or ``f_id[i][j]`` has by each index; None where that may change.
    shape: tuple[int | None, ...]
    what: str  #: What they are, for errors

    @property
    def size(self) -> int:
        """Number of values of ``f_id[*]``."""
        return (self.shape[0] or 0) if len(self.shape) == 1 else 0

    def is_extensive(self, *indices: int) -> bool:
        """Whether thermo output divides such a value by the number of beads when it normalises."""
        return False

    def check_index(self, *indices: int) -> None:
        """ParameterError unless there is such a value."""
        if len(indices) != len(self.shape):
            usage = f"f_{self.name}" + ("", f"[1] to f_{self.name}[{self.size}]", "[row][column]")[len(self.shape)]
            raise ParameterError(f"f_{self.name}: {self.what}; use {usage}")
        if any(index < 1 or (size is not None and index > size) for index, size in zip(indices, self.shape, strict=True)):
            raise ParameterError(f"f_{self.name}{''.join(f'[{index}]' for index in indices)} is out of range: {self.what}")


@dataclass(frozen=True)
class ForceVector(Valued):
    """The vector of a fix addforce or setforce: the total force on its group before it acted."""

    name: str
    shape = (3,)
    what = "its values are the three components of the force before it acts"

    def is_extensive(self, *indices: int) -> bool:
        """It is a sum over beads."""
        return True


@dataclass(frozen=True)
class Compute:
    """One compute as the deck defines it: id, group, style, arguments, and what ``ComputeSpec.prepare`` made of them."""

    name: str
    group: str
    style: str
    arguments: tuple[str, ...] = ()
    settings: Any = None


@dataclass(frozen=True)
class KspaceSetup:
    """What ``kspace_style`` and ``kspace_modify`` said: accuracy, gewald (1/nm), mesh, and the line."""

    accuracy: float = 1e-4
    gewald: float | None = None
    mesh: tuple[int, ...] | None = None
    where: Line | None = None


@dataclass
class RestartSettings:
    """What ``restart`` said: interval, names of files, of which ``*`` becomes the step, and how many are written already."""

    every: int
    files: tuple[str, ...]
    written: int = 0


@dataclass
class ThermoSettings:
    """What thermo output looks like: columns, interval, normalisation, computes to use and formats."""

    words: list[str] = field(default_factory=lambda: ["step", "temp", "epair", "emol", "etotal", "press"])
    every: int = 0
    norm: bool | None = None
    temp: str = "thermo_temp"
    press: str = "thermo_press"
    layout: str = "one"
    formats: dict[str | int, str] = field(default_factory=dict)
    headers: dict[str | int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Slide:
    """How far the images above the box have slid along x since a run began, and how fast they do: of a ``fix deform``, in MD units."""

    distance: float
    speed: float


#: Without a shear.
NO_SLIDE = Slide(0.0, 0.0)


@dataclass(frozen=True)
class DeckSample:
    """One measurement, in MD units (nm, Da, ps, kJ/mol).  None means not measured; a thermo word that needs it then raises."""

    step: int  #: Number of the step, as the deck counts
    kinetic: float | None = None  #: Kinetic energy of all beads
    pair_energy: float | None = None  #: Conservative pair energy, charges included
    #: Of it, the short-ranged part and the lattice sum of charges.
    short_energy: float | None = 0.0
    lattice_energy: float | None = 0.0
    #: Energy of the bonds, the angles and the dihedrals.
    bond_energy: float | None = 0.0
    angle_energy: float | None = 0.0
    dihedral_energy: float | None = 0.0
    #: Sum of r.F over everything that LAMMPS counts in ``press`` with this scheme: pairs and bonds, and with ``mvv`` the dissipative and
    #: random parts as well.
    virial: float | None = None
    virial_full: float | None = None  #: The same, always with the dissipative and random parts
    #: (6,) xx, yy, zz, xy, xz, yz of what ``virial`` counts, and of the sum of m v v over all beads.
    virial_tensor: np.ndarray | None = None
    kinetic_tensor: np.ndarray | None = None
    #: Euclidean norm of all force components, and the largest absolute one.
    force_norm: float | None = None
    force_max: float | None = None
    kT_conf: float | None = None  #: Configurational temperature as an energy
    box: np.ndarray | None = None  #: (3, 3) box vectors; the deck's box if None
    slide: Slide = NO_SLIDE  #: Of the images above it
    #: (N, 3), needed by computes on groups and of single beads only.
    positions: np.ndarray | None = None
    velocities: np.ndarray | None = None
    forces: np.ndarray | None = None  #: (N, 3) total forces, with friction and noise where they are forces (``mvv``)
    before: Mapping[str, np.ndarray] | None = None  #: Total force on the group of each fix addforce and setforce before it acted
    #: The beads' fields, as :func:`openmm_dpd.simulation.fields.read_fields` gives them; empty if there are none.
    fields: Mapping[str, np.ndarray] | None = None
    cpu: float = 0.0  #: Seconds since the run began

    def read(self, name: str) -> Any:
        """A value by its name; None if it was not measured."""
        return getattr(self, name)


@dataclass(frozen=True)
class Temperature:
    """Settings of a compute of temperature."""

    counted: tuple[bool, bool, bool] = (True, True, True)  #: Components of the velocities that count
    streaming: tuple[bool, bool, bool] = (False, False, False)  #: Components from which the mean of the bin, weighted by mass, is taken off
    bins: tuple[int, int, int] = (1, 1, 1)  #: Numbers of bins along x, y and z
    deformed: bool = False  #: Whether the flow of a ``fix deform`` is taken off
    table: bool = False  #: Whether the compute has a table of the bins (``out bin``) instead of a vector
    extra: float = 3.0  #: Degrees of freedom of all beads together that do not count (``compute_modify extra/dof``)

    @property
    def count(self) -> int:
        """Number of bins."""
        return math.prod(self.bins)

    def freedom(self, n: int) -> float:
        """Degrees of freedom of n beads."""
        counted = sum(self.counted)
        return counted * n - counted / 3 * self.extra - sum(self.streaming) * self.count

    def numbers(self, box: Box, positions: np.ndarray) -> np.ndarray:
        """(N,) bin of each bead, those along x one after the other; positions in the box."""
        low, edges = (0.0, 1.0) if box.triclinic else (box.low, box.edges)
        x = box.fractions(positions) if box.triclinic else positions
        cells = ((x - low) * (np.array(self.bins) / edges)).astype(np.int64)
        return np.clip(cells, 0, np.array(self.bins) - 1) @ np.array([1, self.bins[0], self.bins[0] * self.bins[1]])

    def thermal(self, velocities: np.ndarray, masses: np.ndarray, numbers: np.ndarray | None) -> np.ndarray:
        """(N, 3) what counts of velocities; ``numbers`` are the bins, needed where something streams."""
        if numbers is not None and any(self.streaming):
            momentum = np.zeros((self.count, 3))
            np.add.at(momentum, numbers, masses[:, None] * velocities)
            mean = momentum[numbers] / np.bincount(numbers, masses, self.count)[numbers, None]
            velocities = velocities - np.where(self.streaming, mean, 0.0)
        return velocities if all(self.counted) else np.where(self.counted, velocities, 0.0)


#: What a force vector (N, 3) is measured by: its length, the longest force on a bead, the largest component.
NORMS = {
    "two": lambda force: float(np.linalg.norm(force)),
    "max": lambda force: float(np.linalg.norm(force, axis=1).max(initial=0.0)),
    "inf": lambda force: float(np.abs(force).max(initial=0.0)),
}

#: Values of min_style, and those whose motion begins at rest and ends there.
MIN_STYLES = ("cg", "hftn", "sd", "quickmin", "fire", "fire/old")
DAMPED = ("quickmin", "fire", "fire/old")
#: LAMMPS adds it to the energies that a change is compared with.
_LEAST_ENERGY = 1e-8


@dataclass(frozen=True)
class StoppingRule:
    """The four numbers of ``minimize``, in the deck's units, and the norm of ``min_modify``."""

    energy: float  #: Largest change of the energy in an iteration, over its mean size
    force: float  #: Largest norm of the forces
    #: At most so many iterations; an iteration counts as one evaluation at least.
    iterations: int
    evaluations: int
    norm: str = "two"

    def reached(self, iterations: int, before: float, energy: float, force: np.ndarray) -> str | None:
        """Why it stops after an iteration that led from an energy to another one; None if it goes on."""
        if abs(energy - before) < self.energy * 0.5 * (abs(energy) + abs(before) + _LEAST_ENERGY):
            return "energy tolerance"
        if NORMS[self.norm](force) < self.force:
            return "force tolerance"
        if iterations >= self.iterations:
            return "max iterations"
        return "max force evaluations" if iterations >= self.evaluations else None


def without_rotation(positions: np.ndarray, velocities: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """(N, 3) velocities without the rotation about the centre of mass; positions on continuous paths."""
    x = positions - weighted_sum(masses, positions) / masses.sum()
    angular = np.sum(masses[:, None] * np.cross(x, velocities), axis=0)
    inertia = np.sum(masses * np.sum(x * x, axis=1)) * np.eye(3) - (masses[:, None] * x).T @ x
    omega = np.linalg.lstsq(inertia, angular, rcond=None)[0]
    return velocities - np.cross(omega, x)


@dataclass(frozen=True)
class MomentumRemoval:
    """What ``fix momentum`` takes out."""

    every: int  #: Interval in steps
    linear: tuple[bool, bool, bool]  #: Components of the momentum
    angular: bool  #: Whether the rotation about the centre of mass goes as well
    rescale: bool  #: Whether the rest is scaled so that the kinetic energy stays

    def applied(self, positions: np.ndarray, velocities: np.ndarray, masses: np.ndarray) -> np.ndarray:
        """(N, 3) velocities of the beads afterwards; positions on continuous paths."""
        v = velocities - np.where(self.linear, weighted_sum(masses, velocities) / masses.sum(), 0.0)
        if self.angular:
            v = without_rotation(positions, v, masses)
        before, after = (np.sum(masses[:, None] * u * u) for u in (velocities, v))
        return v * np.sqrt(before / after) if self.rescale and after > 0 else v


Three = tuple[float, float, float]


@dataclass(frozen=True)
class PressureControl:
    """The pressure that the box follows."""

    axes: tuple[bool, bool, bool]  #: Edges of the box that may change
    coupled: bool  #: Whether all change by the same factor
    #: Pressure along each axis at the beginning and at the end of the run, kJ/mol/nm^3 (0 for edges that stay).
    start: Three
    stop: Three
    isothermal: bool = False  #: Whether a thermostat holds the temperature; otherwise the enthalpy is what stays

    @property
    def constant(self) -> bool:
        """Whether the pressure stays the same during the run."""
        return self.start == self.stop
