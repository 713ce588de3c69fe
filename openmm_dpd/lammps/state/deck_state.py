"""The state of a deck as plain data."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...base.files import digest, writing
from ...base.geometry import weighted_sum
from ...base.units import LJ, UnitSystem
from ..language import arguments as read
from ..language.lexer import Line, Script
from ..language.variables import Variables
from .atoms import Atoms
from .box import Box
from .lattice import Lattice, no_lattice
from .pair_setup import BondedSetup, PairSetup
from .records import NO_SLIDE, Compute, DeckSample, Fix, KspaceSetup, RestartSettings, Slide, Temperature, ThermoSettings, Window, centre_of
from .regions import Region


def bead_fields(atom_style: str, units: UnitSystem) -> dict[str, tuple[str, float]]:
    """By name in :func:`openmm_dpd.simulation.fields.read_fields`: the array of Atoms that holds a field, and its unit."""
    return {
        **{name: (name, 1.0) for name in ("u_cond", "u_mech", "concentrations")},
        "theta": ("temperatures" if "edpd" in atom_style.split() else "thetas", units.thermal_energy),
        "density": ("densities", units.mass / units.length**3),
    }


@dataclass
class DeckState:
    """State of a deck between two commands.  Box, beads, lattice and regions keep the deck's own numbers, since whether a bead lies on a
    face depends on the last bit.  Other numbers are in MD units (nm, Da, ps, kJ/mol) unless stated otherwise."""

    path: Path
    units: UnitSystem = LJ
    atom_style: str = "atomic"  #: After ``hybrid`` several
    dimension: int = 3  #: 2 for beads in the plane z = 0
    sorts: bool = True  #: Whether LAMMPS sorts beads in memory (``atom_modify sort``)
    box: Box | None = None  #: The periodic box, in the deck's unit of length
    periodic: tuple[bool, bool, bool] = (True, True, True)  #: Axes along which the box repeats
    #: Numbers of bead, bond, angle, dihedral and improper types.
    n_types: int = 0
    n_bond_types: int = 0
    n_angle_types: int = 0
    n_dihedral_types: int = 0
    n_improper_types: int = 0
    labels: dict[str, dict[str, int]] = field(default_factory=dict)  #: Types by their labels, for ``atom``, ``bond``, ...
    n_species: int = 0  #: Number of concentrations of ``atom_style tdpd``, 0 for other styles
    masses: dict[int, float] = field(default_factory=dict)  #: Mass of each type that has one, Da
    atoms: Atoms = field(default_factory=Atoms)  #: Arrays in the order of the ids
    bonds: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))  #: (B, 3) bond type and the ids of the two beads
    #: Bonds and angles at the start of the present run, where fixes make and break bonds, and what these fixes knew
    before: dict[str, Any] = field(default_factory=dict)
    #: (A, 4) angle type and the ids of the three beads, the vertex in the middle.  Types of terms that are turned off are negative.
    angles: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int64))
    dihedrals: np.ndarray = field(default_factory=lambda: np.zeros((0, 5), dtype=np.int64))  #: (D, 5) dihedral type and the four ids
    impropers: np.ndarray = field(default_factory=lambda: np.zeros((0, 5), dtype=np.int64))
    groups: dict[str, np.ndarray] = field(default_factory=lambda: {"all": np.zeros(0, dtype=bool)})  #: Members of each, ``all`` too
    dynamic: dict[str, Any] = field(default_factory=dict)  #: What renews each ``group ... dynamic`` during runs
    lattice: Lattice = field(default_factory=no_lattice)
    regions: dict[str, Region] = field(default_factory=dict)
    templates: dict[str, Any] = field(default_factory=dict)  #: The molecules of ``molecule``
    pair: PairSetup = field(default_factory=PairSetup)
    exclusions: list[tuple[str, ...]] = field(default_factory=list)  #: Words after each ``neigh_modify exclude``
    bond: BondedSetup = field(default_factory=BondedSetup)
    angle: BondedSetup = field(default_factory=BondedSetup)
    dihedral: BondedSetup = field(default_factory=BondedSetup)
    improper: BondedSetup = field(default_factory=BondedSetup)
    #: Factors of pair terms between 1-2, 1-3 and 1-4 neighbours, and those of their charges.
    special: tuple[float, float, float] = (0.0, 0.0, 0.0)
    special_charges: tuple[float, float, float] = (0.0, 0.0, 0.0)
    kspace: KspaceSetup | None = None  #: Settings of ``kspace_style``
    dielectric: float = 1.0  #: Relative permittivity: the Coulomb constant is divided by it
    fixes: dict[str, Fix] = field(default_factory=dict)
    restored: dict[str, Any] = field(default_factory=dict)  #: Styles of fixes of a restart file, runs before it, and what they kept
    computes: dict[str, Compute] = field(default_factory=dict)
    #: The predefined compute of the temperature of all beads.
    thermo_temp: Compute = Compute("thermo_temp", "all", "temp", settings=Temperature())
    #: By pressure compute (``thermo_press`` included): id of the temperature compute that ``thermo_modify temp`` has given it.
    pressure_temps: dict[str, str] = field(default_factory=dict)
    dumps: dict[str, Any] = field(default_factory=dict)
    thermo: ThermoSettings = field(default_factory=ThermoSettings)
    timestep: float = LJ.timestep  #: ps
    step: int = 0
    time_origin: tuple[float, int] = (0.0, 0)
    variables: Variables = field(default_factory=Variables)
    skips_jump: bool = False  #: Whether the next jump is skipped because a ``next`` has exhausted its variables
    force_norm: str = "two"  #: Force norm of ``minimize``
    min_style: str = "cg"  #: The argument of ``min_style``
    setup: list[tuple[str, list[str]]] = field(default_factory=list)  #: The commands about interactions so far, with their arguments
    noise_counter: float = 0.0  #: Counter of the noise: each run draws new random numbers
    restarts: dict[int, RestartSettings] = field(default_factory=dict)  #: Settings of ``restart``, by the number of file names
    notes: list[str] = field(default_factory=list)  #: Remarks about the deck, such as options without effect
    whole: np.ndarray | None = None  #: (N, 3) images of beads of bodies that a scene has, counted from those of the deck's positions
    runs: int = 0
    reordered: bool = False  #: Whether LAMMPS would have sorted the beads by position, which it does at the start of a run or minimisation
    last_sample: DeckSample | None = None  #: The last row of the last run, for formulas evaluated between runs
    here: Line | None = None
    output: Path = field(default_factory=Path)
    folder: str = ""  #: Where ``shell cd`` has gone, seen from the output folder
    systems: int = 0  #: Number of ``clear`` commands so far
    carried_out: bool = False  #: Whether runs are carried out and output files are created
    first_run: Any = None  #: RunRequest of the first run, once it is reached
    finished: bool = False  #: Whether the rest of the deck is not read
    scripts: list[Script] = field(default_factory=list)  #: The deck and the open include files, with the position in each
    log: Callable[[str], None] = lambda _: None
    #: Collects errors and remarks (:class:`openmm_dpd.lammps.run.check.Findings`) where a deck is only checked; None: errors are raised.
    findings: Any = None
    generators: dict[str, np.random.Generator] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)  #: Checksums of the files read, taken when they were read

    # -- questions -----------------------------------------------------------------------------------------------------------
    def require_box(self, command: str) -> Box:
        """The box.  ParameterError if it does not exist yet."""
        if self.box is None:
            raise ParameterError(f"{command} needs a simulation box; use create_box or read_data before it")
        return self.box

    def refuse_box(self, command: str) -> None:
        """Raise ParameterError if the box already exists."""
        if self.box is not None:
            raise ParameterError(f"{command} must come before the simulation box is defined")

    def has_atom_style(self, *styles: str) -> bool:
        """Whether the beads have what one of these atom styles has."""
        return not set(styles).isdisjoint(self.atom_style.split())

    def require_atom_style(self, what: str, *styles: str) -> None:
        """Raise ParameterError unless the deck has an atom style that ``what`` needs."""
        if not self.has_atom_style(*styles):
            raise ParameterError(f"{what} needs atom_style {' or '.join(styles)}, but the deck has atom_style {self.atom_style}")

    def species(self, word: str, what: str) -> int:
        """Index of a species, from its number in the deck, which counts from 1."""
        number = read.integer(word, "the number of the species", 1)
        if number > self.n_species:
            raise ParameterError(f"{what}: there is no species {number}; atom_style tdpd has {self.n_species}")
        return number - 1

    def add_label(self, what: str, kind: int, label: str) -> None:
        """Give a type of beads, bonds, ... a label.  ParameterError if it is not one, or belongs to another type."""
        if not label or label[0] in "0123456789#*":
            raise ParameterError(f"the label of {what} type {kind} must not begin with a digit, # or *, but is '{label}'")
        others = {name: number for name, number in self.labels.get(what, {}).items() if number != kind}
        if label in others:
            raise ParameterError(f"the label {label} already belongs to {what} type {others[label]}")
        self.labels[what] = {**others, label: kind}

    def numbered(self, what: str, word: str) -> str:
        """The number of a type as a word, if ``word`` is its label; otherwise the word itself."""
        return str(self.labels.get(what, {}).get(word, word))

    def type_number(self, word: str) -> int:
        """The bead type that a word names."""
        kind = read.integer(word, "the atom type", 1)
        if kind > self.n_types:
            raise ParameterError(f"atom type {kind} is out of range: there are {self.n_types}")
        return kind

    def spacing(self, units: str) -> np.ndarray:
        """The length along each axis that is meant by the option ``units box`` or ``units lattice``."""
        return np.ones(3) if read.choice(units, "units", ("box", "lattice")) == "box" else self.lattice.spacing

    def group(self, name: str) -> np.ndarray:
        """Mask of the members of a group."""
        return read.known(self.groups, name, "group")

    def region(self, name: str, value: Callable[[str], float] | None = None) -> Region:
        """The region with this name, with the present values of its variables; during a run these come from ``value``."""
        found = read.known(self.regions, name, "region")
        return found if found.renewed is None else found.renewed(value)

    def fixes_of(self, *styles: str) -> list[Fix]:
        """The fixes of these styles, in the order of the deck."""
        return [fix for fix in self.fixes.values() if fix.style in styles]

    def temperature(self, **settings: Any) -> Temperature:
        """Settings of a temperature compute of this deck."""
        return Temperature(**{"dimension": self.dimension, "extra": float(self.dimension)} | settings)

    def temperature_compute(self, name: str) -> Compute:
        """The temperature compute with this id.  ParameterError if there is none."""
        found = self.thermo_temp if name == "thermo_temp" else self.computes.get(name)
        if found is None or not isinstance(found.settings, Temperature):
            raise ParameterError(f"'{name}' is not the id of a compute of style temp")
        return found

    def temperature_of_pressure(self, name: str) -> Compute:
        """The compute that supplies the kinetic part of a pressure compute."""
        own = self.computes[name].arguments[0] if name in self.computes else "thermo_temp"
        return self.temperature_compute(self.pressure_temps.get(name, own))

    def bead_masses(self) -> np.ndarray:
        """Mass of every bead in Da; ParameterError if a type has none."""
        if self.has_atom_style("sphere"):
            return self.atoms.solids * self.atoms.volumes * self.units.mass
        if missing := [str(k) for k in range(1, self.n_types + 1) if k not in self.masses]:
            raise ParameterError(f"no mass is set for atom type {', '.join(missing)}; use the mass command or a Masses section")
        return np.array([self.masses[k] for k in range(1, self.n_types + 1)])[self.atoms.types - 1]

    def mass_average(self, vectors: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """Mass-weighted average of (N, 3) vectors over the beads of a mask; 0 if there are none."""
        masses = self.bead_masses()[mask]
        return weighted_sum(masses, vectors[mask]) / masses.sum() if len(masses) else np.zeros(3)

    @property
    def pistons(self) -> list[Fix]:
        """Fixes that move the box as LAMMPS does: npt, and nph where forces have no potential that Monte Carlo moves could judge by."""
        return self.fixes_of("npt", *(("nph",) if any(style.name == "mdpd" for style in self.pair.styles) else ()))

    @property
    def scene_positions(self) -> np.ndarray:
        """(N, 3) positions of a scene (nm), with bodies that are whole."""
        x = self.atoms.positions
        return (x if self.whole is None else x + self.whole @ self.require_box("a run").vectors) * self.units.length

    def in_deck_units(self, positions: np.ndarray) -> np.ndarray:
        """(N, 3) positions of a simulation (nm) in the deck's unit.  Beads that have not moved get back the deck's numbers, bit for bit;
        differences up to the rounding of coordinates as large as the box do not count as motion."""
        mine, found = self.atoms.positions, positions / self.units.length
        if self.whole is not None:
            found = found - self.whole @ self.require_box("a simulation").vectors
        return np.where(np.abs(found - mine) <= np.spacing(np.abs(self.require_box("a simulation").bounds).max()), mine, found)

    def folded(self, positions: np.ndarray, box: Box) -> tuple[np.ndarray, np.ndarray]:
        """Positions (deck units) wrapped into a box, and the number of boxes each bead was moved.  As in LAMMPS, a bead that has not moved
        stays where the deck has put it, even if that is a rounding error outside a tilted box."""
        inside, shifts = box.wrap(positions)
        still = np.all(positions == self.atoms.positions, axis=1)[:, None]
        return np.where(still, positions, inside), np.where(still, 0, shifts)

    def time_at(self, step: int) -> float:
        """Simulated time (ps) at a step."""
        time, origin = self.time_origin
        return time + (step - origin) * self.timestep

    def find_file(self, name: str) -> Path:
        """A file named in the deck, looked up relative to the deck's folder, then to the working directory, then among its own output."""
        name = os.path.normpath(os.path.join(self.folder, name)) if self.folder else name
        for candidate in (self.path.parent / name, Path(name)):
            if candidate.is_file():
                self.inputs.setdefault(str(candidate.resolve()), digest(candidate))
                return candidate
        if (self.output / name).is_file():
            return self.output / name
        raise ParameterError(f"there is no file '{name}' (looked in {self.path.parent} and in the working directory)")

    def placed(self, name: str, folder: str | None = None) -> str:
        """Name of a file or folder of the deck's output, seen from the output folder; ``folder`` is by default that of the last
        ``shell cd``.  ParameterError if it is outside."""
        folder = self.folder if folder is None else folder
        name = os.path.normpath(os.path.join(folder, name)) if folder else name
        self.output_path(name)
        return name

    def output_path(self, name: str, step: int | str | None = None, *, as_it_is: bool = False) -> Path:
        """Path of a file that the deck writes.  ``*`` is replaced by the step (by default the present one) unless ``as_it_is``.  Relative
        names are put into the output folder; absolute ones are used as they are, with a note.  ParameterError if a relative name points
        outside the output folder."""
        if Path(name).is_absolute():
            self.note(f"{name} is an absolute path: the file is not written to the output folder {self.output}")
        elif os.path.normpath(name).split(os.sep)[0] == os.pardir:
            raise ParameterError(
                f"the file '{name}' would lie outside the output folder {self.output}; "
                "remove the '..' and choose the folder (--out), or give an absolute path"
            )
        return self.output / (name if as_it_is else name.replace("*", str(self.step if step is None else step)))

    def output_file(self, name: str, step: int | str | None = None, *, as_it_is: bool = False) -> Path:
        """Path of a file that the deck writes, as from :meth:`output_path`, after creating its folder.  OutputError if that fails.  Where a
        deck is only checked, a file that keeps nothing."""
        path = self.output_path(name, step, as_it_is=as_it_is)
        if self.findings is not None:
            self.findings.written.add(str(path))
            return Path(os.devnull)
        with writing(path.parent, "the folder"):
            path.parent.mkdir(parents=True, exist_ok=True)
        return path

    @property
    def sliding(self) -> float:
        """Velocity (nm/ps) along x with which ``fix deform`` moves the images above the box."""
        height = self.require_box("fix deform").edges[1] * self.units.length
        return sum(fix.parameters.get("rate", 0.0) * height for fix in self.fixes_of("deform"))

    @property
    def moving_box(self) -> bool:
        """Whether a ``fix deform`` changes edges or tilts of the box."""
        return any("deforming" in fix.parameters for fix in self.fixes_of("deform"))

    def box_at(self, step: int, window: Window | None) -> Box | None:
        """The box at a step of the run with this window, if a ``fix deform`` changes its edges or tilts; otherwise None."""
        for fix in self.fixes_of("deform") if window is not None else ():
            if "deforming" in fix.parameters:
                box, dt = self.require_box("fix deform"), self.timestep / self.units.time
                return fix.parameters["deforming"].box_at(box, step, *vars(window).values(), dt)
        return None

    # -- changes -------------------------------------------------------------------------------------------------------------
    def note(self, text: str) -> None:
        """Add a remark, unless it is already there."""
        if text not in self.notes:
            self.notes.append(text)
            if self.findings is not None:
                self.findings.note(text)

    def set_dimension(self, dimension: int) -> None:
        """Choose two or three dimensions."""
        self.dimension = dimension
        self.thermo_temp = replace(self.thermo_temp, settings=self.temperature())

    def set_timestep(self, value: float) -> None:
        """Change the time step; the time simulated so far is kept."""
        self.time_origin = (self.time_at(self.step), self.step)
        self.timestep = value

    def add_atoms(self, new: Atoms) -> None:
        """Append beads; they join the group ``all`` only."""
        self.atoms.append(new)
        for name, mask in self.groups.items():
            self.groups[name] = np.concatenate([mask, np.full(len(new), name == "all")])

    def settle(self, command: str) -> None:
        """Wrap beads into the box, which LAMMPS does only at the start of a run and when it writes a data file.  ParameterError if a bead
        is more than one box away: LAMMPS would lose it."""
        box = self.require_box(command)
        inside, shifts = box.settle(self.atoms.positions)
        lost = np.any(np.abs(shifts) > 1, axis=1)
        if not all(box.periodic):
            lost |= ~box.holds(inside)
        if lost.any():
            bead = int(np.argmax(lost))
            place = " ".join(f"{value:g}" for value in self.atoms.positions[bead])
            raise ParameterError(
                f"{command}: bead {self.atoms.ids[bead]} lies at {place}, so far outside the box that LAMMPS would lose it"
            )
        if command == "run":
            self.atoms.velocities = self.atoms.velocities - np.outer(shifts[:, 1], [self.sliding / self.units.velocity, 0.0, 0.0])
        for fix in self.fixes_of("enforce2d") if command in ("run", "minimize") else ():
            self.atoms.velocities = np.where(np.outer(self.group(fix.group), [False, False, True]), 0.0, self.atoms.velocities)
        if command in ("run", "minimize") and self.sorts:
            self.reordered = True
            if box.triclinic:
                # in between LAMMPS sorts by position, for which it converts to coordinates and back to fractions
                inside = box.places(box.fractions(inside))
        self.take_inside(inside, shifts)

    def take_inside(self, positions: np.ndarray, shifts: np.ndarray) -> None:
        """Store the result of :meth:`Box.settle`: positions in the box, and the number of boxes each was moved."""
        self.atoms.positions = positions
        self.atoms.images = self.atoms.images + shifts

    def write_back(
        self,
        positions: np.ndarray,
        velocities: np.ndarray,
        box: np.ndarray | Box | None = None,
        fields: Mapping[str, np.ndarray] | None = None,
        slide: Slide = NO_SLIDE,
    ) -> None:
        """Store the result of a run: positions (nm), continuous with those of its scene, and velocities (nm/ps).  ``box`` is the new box,
        or its vectors if they have changed (the lower corner stays), ``fields`` the fields of the beads as from
        :func:`openmm_dpd.simulation.fields.read_fields`, ``slide`` the displacement of the images above the box."""
        if isinstance(box, Box):
            self.box = box
        elif box is not None:
            before = self.require_box("a run")
            self.box = before.following(np.asarray(box) / self.units.length, centre_of(self.pistons))
            self.atoms.images = self.box.turned(self.atoms.images, before, slide.axes, slide.distance / self.units.length)
        own = self.require_box("a run")
        (inside, shifts), self.whole = self.folded(self.in_deck_units(positions), own), None
        # walls keep beads inside up to the platform's rounding; the next run needs them exactly inside
        self.take_inside(np.where(own.periodic, inside, np.clip(inside, own.low, np.nextafter(own.high, own.low))), shifts)
        self.atoms.velocities = (np.asarray(velocities, dtype=np.float64) - slide.shift(shifts, slide.speed)) / self.units.velocity
        places = bead_fields(self.atom_style, self.units)
        for name in (fields or {}).keys() - {"bonds"}:  # the deck has those since the last measurement
            place, unit = places[name]
            setattr(self.atoms, place, np.array(fields[name], dtype=np.float64) / unit)  # type: ignore[index]


def pairs_left_out(
    state: DeckState, types: np.ndarray, values: Callable[[np.ndarray], np.ndarray], i: np.ndarray, j: np.ndarray
) -> np.ndarray:
    """Which of the pairs i, j ``neigh_modify exclude`` leaves out; ``types`` has their types, ``values`` picks theirs out of those of all
    beads."""
    out = np.zeros(np.shape(i), dtype=bool)
    for kind, *words in state.exclusions:
        one, other = (types == int(word) if kind == "type" else values(state.group(word)) for word in (words * 2)[:2])
        found = one[i] & other[j] | one[j] & other[i]
        if kind.startswith("molecule"):
            molecules = values(state.atoms.molecules)
            found &= (molecules[i] == molecules[j]) == (kind == "molecule/intra")
        out |= found
    return out
