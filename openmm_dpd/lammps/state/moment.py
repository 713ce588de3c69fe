"""The values of a deck at one moment: its state plus a measurement."""

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import symmetric_products
from ...base.units import UnitSystem
from .box import Box
from .deck_state import DeckState, bead_fields
from .records import COUPLED, NO_SLIDE, Compute, DeckSample, Slide, Window as Window, centre_of
from .regions import Region
from .rigid import bound_freedom


class DeckMoment(ABC):
    """A deck at one moment, with a measurement: values in the deck's units, from which the tables of words and computes take theirs.  Names
    (``c_id``, ``v_name``) are looked up by :class:`~openmm_dpd.lammps.values.resolver.Resolver`.  Without a ``sample`` only words that need
    neither forces nor velocities have a value; ``window`` belongs to the run in progress."""

    def __init__(self, state: DeckState, sample: DeckSample | None = None, window: Window | None = None):
        self.state: DeckState = state
        self.sample: DeckSample | None = sample
        self.window: Window | None = window

    @property
    def units(self) -> UnitSystem:
        """The deck's units."""
        return self.state.units

    @property
    def step(self) -> int:
        """Number of the step."""
        return self.state.step if self.sample is None else self.sample.step

    @cached_property
    def box(self) -> Box:
        """The box in the deck's unit of length."""
        box = self.state.require_box("a formula with the box")
        if self.sample is None or self.sample.box is None:
            return box
        return self.state.box_at(self.step, self.window) or box.following(
            self.sample.box / self.units.length, centre_of(self.state.pistons)
        )

    @property
    def measured(self) -> bool:
        """Whether positions and velocities come from a simulation; between runs they are the deck's."""
        return self.window is not None or (self.sample is not None and self.sample.positions is not None)

    @property
    def positions(self) -> np.ndarray:
        """(N, 3) positions in the deck's unit; during a run they are continuous from its start."""
        return self.state.in_deck_units(self.need("positions")) if self.measured else self.state.atoms.positions

    @cached_property
    def folded(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions wrapped into the deck's box (deck units), and the number of boxes each bead was moved."""
        return self.state.folded(self.positions, self.box)

    @cached_property
    def images(self) -> np.ndarray:
        """(N, 3) image flags of :attr:`positions`."""
        if not self.measured or self.state.box_at(self.step, self.window) is not None:
            return self.state.atoms.images
        return self.box.turned(
            self.state.atoms.images, self.state.require_box("image flags"), self.slide.axes, self.slide.distance / self.units.length
        )

    @property
    def unwrapped(self) -> np.ndarray:
        """Unwrapped positions (deck units)."""
        return self.box.unwrap(self.positions, self.images)

    @property
    def slide(self) -> Slide:
        """Displacement and velocity of the images above the box."""
        return NO_SLIDE if self.sample is None else self.sample.slide

    @property
    def velocities(self) -> np.ndarray:
        """(N, 3) velocities in the deck's units, of the beads in the box rather than of their images."""
        if not self.measured:
            return self.state.atoms.velocities
        found, speed = self.need("velocities") / self.units.velocity, self.slide.speed / self.units.velocity
        return found - self.slide.shift(self.folded[1], speed) if speed else found

    @property
    def norm(self) -> float:
        """Divisor of extensive values: the number of beads if thermo output is normalised, 1 otherwise."""
        setting = self.state.thermo.norm
        normalize = self.units.normalize if setting is None else setting
        return float(max(len(self.state.atoms), 1)) if normalize else 1.0

    def need(self, name: str):
        """A value of the sample.  ParameterError if it was not measured."""
        value = None if self.sample is None else self.sample.read(name)
        if value is None:
            if self.sample is None:
                raise ParameterError("an energy, temperature or force is used before a run has measured it")
            raise ParameterError(f"the simulation did not measure {name.replace('_', ' ')}")
        return value

    def field(self, name: str) -> np.ndarray:
        """A field of the beads, with the name and units of :func:`openmm_dpd.simulation.fields.read_fields`.  Fields that the simulation
        does not change are the deck's.  ParameterError if it changes the field, but did not measure it."""
        fields = None if self.sample is None else self.sample.fields
        if fields is not None and name in fields:
            return fields[name]
        if fields is None and self.window is not None and any(style.spec.atom_style for style in self.state.pair.styles):
            raise ParameterError(f"the simulation did not measure {name.replace('_', ' ')}")
        attribute, unit = bead_fields(self.state.atom_style, self.units)[name]
        return getattr(self.state.atoms, attribute) * unit

    def energy(self, name: str) -> float:
        """An energy of the sample in the deck's units."""
        return self.need(name) / self.units.energy

    def region(self, name: str) -> Region:
        """The region with this name, with the values that its variables have at this moment."""
        return self.state.region(name, self.variable_alone)

    @property
    def coupled(self) -> float:
        """Energy that thermostats have taken, in the deck's units."""
        if self.state.fixes_of("nph"):
            raise ParameterError("with fix nph there is no conserved energy here")
        return sum(self.need("acted")[fix.name][0] for fix in self.state.fixes_of(*COUPLED))

    def freedom(self, compute: Compute) -> float:
        """Degrees of freedom counted by a temperature compute.  ParameterError if their number is negative."""
        mask = self.state.group(compute.group)
        n, bound = int(mask.sum()), bound_freedom(self.state, mask)
        found = compute.settings.freedom(n, bound)
        if found < 0 and n:
            raise ParameterError(f"compute {compute.name} (style {compute.style}) counts {found:g} degrees of freedom of its {n} beads")
        return found

    def kinetic(self, compute: Compute) -> float:
        """Kinetic energy (kJ/mol) counted by a temperature compute; 0 if it counts no degree of freedom, as for a single bead."""
        if self.freedom(compute) <= 0:
            return 0.0
        return self.need("kinetic") if compute.name == "thermo_temp" else self.kinetic_of(*self.thermal(compute)[:2])

    def kinetic_of(self, masses: np.ndarray, velocities: np.ndarray) -> float:
        """Sum of m v^2/2 (kJ/mol) over masses (Da) and velocities in the deck's units."""
        return 0.5 * float(np.sum(masses[:, None] * velocities**2)) * self.units.velocity**2

    def thermal(self, compute: Compute) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Masses of the beads of a temperature compute, their thermal velocities, and their bins if these matter."""
        mask, settings = self.state.group(compute.group), compute.settings
        masses, streams = self.state.bead_masses()[mask], any(settings.streaming)
        numbers = settings.numbers(self.box, self.folded[0][mask]) if streams else None
        velocities = self.velocities[mask]
        if settings.deformed:
            heights = self.box.fractions(self.folded[0][mask])
            velocities = velocities - self.slide.shift(heights, self.slide.speed / self.units.velocity)
        return masses, settings.thermal(velocities, masses, numbers), numbers

    def temperature(self, compute: Compute) -> float:
        """Temperature of a temperature compute."""
        dof = self.freedom(compute)
        return 2 * self.kinetic(compute) / (dof * self.units.thermal_energy) if dof > 0 else 0.0

    def thermo_compute(self) -> Compute:
        """The temperature compute that thermo output uses."""
        return self.state.temperature_compute(self.state.thermo.temp)

    def pressure(self, virial: str = "virial") -> float:
        """Pressure printed by thermo output."""
        name = self.state.thermo.press
        if virial == "virial" and name != "thermo_press":
            return self.compute(name, None)
        return self.pressure_of(self.kinetic(self.state.temperature_of_pressure(name)), self.need(virial))

    def pressure_of(self, kinetic: float, virial: float) -> float:
        """Pressure from a kinetic energy and a virial (kJ/mol)."""
        return (2 * kinetic + virial) / (self.state.dimension * (self.box.volume * self.units.length**3)) / self.units.pressure

    def kinetic_tensor(self, compute: Compute) -> np.ndarray:
        """(6,) sums of m v v (kJ/mol), as counted by a temperature compute: xx, yy, zz, xy, xz, yz."""
        if compute.name == "thermo_temp":
            return self.need("kinetic_tensor")
        masses, thermal, _ = self.thermal(compute)
        velocities = thermal * self.units.velocity
        return symmetric_products(masses[:, None] * velocities, velocities)

    def pressure_tensor(self, name: str, kinetic: bool = True, virial: bool = True) -> np.ndarray:
        """(6,) pressure tensor of a pressure compute, with its kinetic and virial parts as asked for: xx, yy, zz, xy, xz, yz."""
        parts = np.zeros(6)
        if kinetic:
            parts += self.kinetic_tensor(self.state.temperature_of_pressure(name))
        if virial:
            parts += self.need("virial_tensor")
        if self.state.dimension == 2:
            parts[[2, 4, 5]] = 0.0
        return parts / (self.box.volume * self.units.length**3) / self.units.pressure

    def pressure_component(self, index: int) -> float:
        """Component (0 to 5) of the pressure tensor, as printed by thermo output."""
        name = self.state.thermo.press
        return self.compute(name, index + 1) if name != "thermo_press" else float(self._tensor[index])

    @cached_property
    def _tensor(self) -> np.ndarray:
        return self.pressure_tensor("thermo_press")  # a formula asks for several components

    # -- names ----------------------------------------------------------------------------------------------------------------
    @abstractmethod
    def compute(self, name: str, index: int | None, column: int | None = None) -> float:
        """Value of ``c_name``, ``c_name[index]`` or ``c_name[index][column]``, not normalised."""

    @abstractmethod
    def variable_alone(self, name: str) -> float:
        """Value of ``v_name`` outside formulas."""

    @abstractmethod
    def bead_values(self, word: str) -> np.ndarray:
        """(N,) values of a word such as ``vx``, of ``c_id``, ``c_id[column]``, or of ``v_name``, an atom-style variable."""

    @abstractmethod
    def local_values(self, word: str) -> np.ndarray:
        """Values of ``c_id`` or ``c_id[column]``, a compute of bonds, angles, dihedrals or impropers, for each of them."""
