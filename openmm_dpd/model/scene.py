"""The scene: the full input as one value."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..base.errors import ParameterError, bead_number, either, fact_table, require, require_one, what_is
from ..base.units import keep, known_under, thermal_energy, to_md
from .angles import Angles, Dihedrals, check_angles, check_torsions
from .bodies import Body, Shape, check_bodies
from .bonds import BondedTerms, Bonds, check_members
from .box import box_vectors
from .electrostatics import EwaldSum, SmearedCharges, checked_ewald, special_factors
from .flow import BodyForce, Gap, PositionForce, Wall, check_inside
from .impropers import Impropers
from .internal import Internal, check_internal
from .pairs import NONE, PairTable, require_complete
from .planes import checked_walls
from .reactions import BondBreaking, BondFormation, check_reactions
from .segments import SegmentalRepulsion, check_segments, segment_parts
from .shapes import SolidWall
from .shear import LeesEdwards, check_shear
from .sources import Buoyancy, Source
from .temperature import TemperatureRamp


@dataclass(frozen=True, eq=False)
class Scene:
    """A DPD system: beads, box, pair coefficients, bonds and temperature.

    Bare numbers are in OpenMM's MD units (nm, Da, ps, kJ/mol), and Quantities are accepted everywhere.  For reduced units use bare
    numbers: the units are then 1 nm, 1 Da, 1 ps, and kT = 1 is 1 kJ/mol.

    Parameters
    ----------
    masses : mapping of str to mass
        Masses (Da), > 0, of the bead types; their order defines the type numbers.
    types : sequence of N type names
        Type of each bead.
    positions : (N, 3) array of lengths
        Positions, nm, which may be outside the box.
    pairs : PairTable, mapping accepted by it, or a sequence of tables
        Pair coefficients.  Tables of the same or different kinds add up; every pair of types must be in one of them.
    kT : energy, temperature or TemperatureRamp
        Thermal energy; a Quantity in kelvin is multiplied by the gas constant.  0 switches the noise off.
    box : (3,) or (3, 3) array of lengths, optional
        Edges or box vectors, nm.  None: no periodic box.
    velocities : (N, 3) array, optional
        Velocities, nm/ps; by default from the Maxwell distribution (see :func:`openmm_dpd.simulation.build.build`).
    bead_masses : (N,) array, optional
        Masses of the beads, Da, if they differ from those of their types.
    charges : (N,) array, optional
        Elementary charges, also written into topologies.  They exert forces if ``electrostatics`` is given.
    bonds : sequence of HarmonicBonds, FENEBonds, MorseBonds, ...
        Bonds.
    bonded_factors : three floats, default (1, 1, 1)
        Factors f in [0, 1] for pairs one, two and three bonds apart: conservative and dissipative forces are multiplied by f, the noise by
        sqrt(f).  LAMMPS's default is (0, 0, 0), which removes friction and repulsion between bonded beads.
    mobile : (N,) array of bool, optional
        False: the bead is immobile (mass 0 for OpenMM), with its velocity in the friction, as in a moving wall, and in no temperature.
    molecules : (N,) array of int, optional
        Molecule numbers, for the topology.
    internal : InternalEnergy, BeadTemperatures or Concentrations, optional
        Per-bead fields of the pair terms EnergyDPD, EDPD or TDPD, respectively.
    sources : sequence of Source and Buoyancy
        Sources of heat (EDPD) or of a species (TDPD), and forces that follow temperatures or concentrations.
    compat : {"consistent", "lammps"}
        ``"lammps"`` computes as LAMMPS does the heat of EDPD, which does not conserve energy, and the nearest points of two segments.
    angles : sequence of HarmonicAngles, CosineAngles, ...
        Angles between bonds.
    segments : SegmentalRepulsion, optional
        Repulsion between bonds, which keeps chains from crossing.
    body_forces : sequence of BodyForce and PositionForce
        Forces on single beads, which drive a flow.
    walls : sequence of Wall and SolidWall
        Planes that reflect beads, or shapes from which they bounce back.  Planes beside these bounce back and have a constant velocity.
    residues : sequence of N str, optional
        Name of the molecule of each bead, for the topology.
    electrostatics : SlaterCharges, GaussianCharges or PointCharges, optional
        Interaction of the ``charges``, to which ``bonded_factors`` apply as well.  None: no interaction.
    interacting : (N, 3) array of bool, optional
        False: along this axis only ``body_forces`` act on the bead, but no pair terms (including friction and noise), bonds or charges
        (LAMMPS: ``fix setforce``).  The bead still acts on its neighbours, so momentum is not conserved.  Requires ``scheme="mvv"``.
    dihedrals, impropers : sequences of HarmonicDihedrals, OPLSDihedrals, ..., and of HarmonicImpropers, UmbrellaImpropers, ...
        Dihedrals along three successive bonds, and impropers.  They do not affect ``bonded_factors``, which follow from the bonds.
    shear : LeesEdwards, optional
        Shear by sliding images.  ``velocities``, if given, include the flow.
    bodies : sequence of Body
        Rigid bodies: beads that move together.
    reactions : sequence of BondFormation and BondBreaking
        Bonds that form and break, beside ``bonds``, which stay.  They are tried in this order.

    Raises
    ------
    ParameterError
        If input is missing, out of bounds, not finite, contradictory, or has the wrong shape; the message names it.
    """

    masses: Mapping[str, float]
    types: Sequence[str]
    positions: np.ndarray
    pairs: PairTable | Mapping | Sequence[PairTable]
    kT: float | TemperatureRamp
    box: np.ndarray | None = None
    velocities: np.ndarray | None = None
    bead_masses: np.ndarray = None  # type: ignore[assignment]  # filled from the types
    charges: np.ndarray | None = None
    bonds: Sequence[Bonds] = ()
    bonded_factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    mobile: np.ndarray | None = None
    molecules: np.ndarray | None = None
    internal: Internal | None = None
    sources: Sequence[Source | Buoyancy] = ()
    compat: str = "consistent"
    angles: Sequence[Angles] = ()
    segments: SegmentalRepulsion | None = None
    body_forces: Sequence[BodyForce | PositionForce] = ()
    walls: Sequence[Wall | SolidWall] = ()
    residues: Sequence[str] | None = None
    electrostatics: SmearedCharges | None = None
    interacting: np.ndarray | None = None
    dihedrals: Sequence[Dihedrals] = ()
    shear: LeesEdwards | None = None
    impropers: Sequence[Impropers] = ()
    bodies: Sequence[Body] = ()
    reactions: Sequence[BondFormation | BondBreaking] = ()
    type_ids: np.ndarray = field(init=False, repr=False)
    tables: tuple[PairTable, ...] = field(init=False, repr=False)
    gaps: Mapping[int, Gap] = field(init=False, repr=False)  #: Gap between the walls, by the number of the axis
    shapes: tuple[Shape, ...] = field(init=False, repr=False)  #: Of the bodies
    ewald: EwaldSum | None = field(init=False, repr=False)  #: Settings of the lattice sum, if charges interact in a box

    def __post_init__(self):
        def put(name, value):
            keep(self, **{name: value})

        put("masses", self._checked_masses())
        put("types", self._checked_types())
        number = {name: index for index, name in enumerate(self.masses)}
        put("type_ids", np.fromiter((number[name] for name in self.types), dtype=np.int32, count=len(self.types)))
        x = self._per_bead("positions", "length", (3,))
        # OpenMM's Reference neighbour list loses pairs of beads at coordinates such as -3e-19, which occur on lattices
        assert x is not None
        put("positions", np.where(np.abs(x) < 1e-12, 0.0, x))
        put("velocities", self._per_bead("velocities", "velocity", (3,)))
        put("charges", self._per_bead("charges", "charge", ()))
        put("bead_masses", self._checked_bead_masses())
        put("box", box_vectors(self.box))
        if not isinstance(self.kT, TemperatureRamp):
            put("kT", thermal_energy(self.kT))
        put("mobile", self._flags("mobile", np.bool_, "True or False (for indices: numpy.isin(numpy.arange(N), indices))"))
        put("molecules", self._flags("molecules", np.integer, "one whole number"))
        put("residues", self._checked_residues())
        put("interacting", self._checked_interacting())
        self._check_bonds()
        for name, kind in (("angles", Angles), ("dihedrals", Dihedrals), ("impropers", Impropers)):
            self._check_kinds(name, kind)
        check_angles(self.angles, self.n_beads)
        check_torsions((*self.dihedrals, *self.impropers), self.n_beads)
        put("bonded_factors", special_factors(self.bonded_factors, "bonded_factors"))
        put("tables", self._checked_pairs())
        put("pairs", self.tables)
        require(self.sources, Sequence, "sources must be a sequence of sources")
        put("sources", tuple(self.sources))
        check_internal(self.internal, self.sources, self.tables, self.type_ids, self.type_names, self.box)
        self._check_flow()
        put("ewald", checked_ewald(self.electrostatics, self.charges, self.box, self.initial_kT))
        check_shear(self.shear, self)
        self._check_kinds("bodies", Body)
        put("shapes", check_bodies(self.bodies, self))
        self._check_kinds("reactions", BondFormation, BondBreaking)
        check_reactions(self)
        check_segments(self)
        require_one(self.compat, ("consistent", "lammps"), "compat")

    @property
    def immobile(self) -> np.ndarray:
        """(N,) mask of the immobile beads."""
        return np.zeros(self.n_beads, bool) if self.mobile is None else ~self.mobile

    def __repr__(self) -> str:
        facts = self.facts()
        box = "no box" if self.box is None else f"box {facts['box']}, {facts['density']}"
        return f"<Scene of {self.n_beads} beads ({facts['types']}), {box}, {len(self.bond_pairs)} bonds, kT = {facts['kT']}>"

    def _repr_html_(self) -> str:
        return fact_table("Scene", self.facts())

    def facts(self) -> dict[str, object]:
        """Main properties of the scene by name; None for those it does not have."""
        counts = np.bincount(self.type_ids, minlength=len(self.masses)).tolist()
        named = ", ".join(f"{name} {count}" for name, count in zip(self.masses, counts, strict=True))
        ramp = self.kT if isinstance(self.kT, TemperatureRamp) else None
        return {
            "beads": self.n_beads,
            "types": named if len(counts) <= 5 else f"{len(counts)} types",
            "box": None if self.box is None else " x ".join(f"{edge:g}" for edge in np.diag(self.box)) + " nm",
            "density": None if self.box is None else f"{self.n_beads / float(np.prod(np.diag(self.box))):.4g} beads/nm^3",
            "kT": f"{self.initial_kT:g} kJ/mol" if ramp is None else f"{ramp.kT_start:g} to {ramp.kT_end:g} kJ/mol",
            "pair terms": ", ".join(table.kind.__name__ for table in self.tables if table.kind is not None) or None,
            "bonds": len(self.bond_pairs) or None,
            "charges": None if self.charges is None else np.count_nonzero(self.charges),
            "immobile beads": int(self.immobile.sum()) or None,
            "rigid bodies": len(self.bodies) or None,
            "shear": None if self.shear is None else str(self.shear),
        }

    # -- derived ---------------------------------------------------------------------------------------------------------------
    @property
    def kept_momenta(self) -> int:
        """Number of conserved components of momentum; immobile beads, walls and position forces take up momentum."""
        if self.immobile.any() or self.interacting is not None or any(wall.kind == "bounce-back" for wall in self.walls):
            return 0
        places = [force.formulas for force in self.body_forces if isinstance(force, PositionForce)]
        pushed = {axis for formulas in places for axis, formula in zip("xyz", formulas, strict=True) if formula.strip() != "0"}
        pushed |= {"xyz"[k] for source in self.sources if isinstance(source, Buoyancy) for k in np.flatnonzero(source.force)}
        bound = {"xyz"[axis] for axis in self.gaps} | {axis for body in self.bodies for axis in "xyz" if axis not in body.moves}
        return 3 - len(pushed | bound)

    @property
    def freedom(self) -> int:
        """Number of ways in which mobile beads move: three for each, but of a body those of the whole."""
        bound = sum(3 * len(shape.mass) - shape.freedom for shape in self.shapes)
        return 3 * int(np.count_nonzero(~self.immobile)) - bound

    @property
    def n_beads(self) -> int:
        """Number of beads."""
        return len(self.type_ids)

    @property
    def type_names(self) -> list[str]:
        """Names of the bead types, in the order of ``masses``."""
        return list(self.masses)

    @property
    def initial_kT(self) -> float:
        """Thermal energy (kJ/mol) at the first step."""
        return self.kT.at(0) if isinstance(self.kT, TemperatureRamp) else self.kT

    @property
    def bond_pairs(self) -> np.ndarray:
        """Bead indices of all bonds, (B, 2)."""
        return np.concatenate([bonds.pairs for bonds in self.bonds]) if self.bonds else np.zeros((0, 2), dtype=np.int64)

    @property
    def bonded(self) -> tuple[BondedTerms, ...]:
        """All objects with bonds, angles, dihedrals and impropers."""
        return (*self.bonds, *self.angles, *self.dihedrals, *self.impropers)

    @property
    def segment_pairs(self) -> np.ndarray:
        """Bead indices of the bonds that repel each other by ``segments``, (S, 2), at the start."""
        stay, sorts = segment_parts(self)
        return np.concatenate([stay, *(bonds.pairs for bonds in sorts)])

    # -- checks ----------------------------------------------------------------------------------------------------------------
    def _checked_masses(self) -> dict[str, float]:
        if not isinstance(self.masses, Mapping) or not self.masses:
            raise ParameterError("masses must map the name of each bead type to its mass, and name at least one")
        checked = {}
        for name, mass in self.masses.items():
            if not isinstance(name, str) or name in ("", "*"):
                raise ParameterError(f"bead types are named by text other than '*'; `masses` has the name {what_is(name)}")
            value = to_md(mass, "mass", f"the mass of type {what_is(name)}")
            if not isinstance(value, float) or value <= 0:
                raise ParameterError(f"the mass of type {what_is(name)} must be a number > 0, not {what_is(mass)}; `mobile` freezes beads")
            checked[str(name)] = value
        return checked

    def _checked_types(self) -> tuple[str, ...]:
        try:
            types = tuple(self.types)
        except TypeError:
            raise ParameterError(f"types must name the type of each bead, as ['W', 'W', ...]; they are {what_is(self.types)}") from None
        if not types:
            raise ParameterError("a scene needs at least one bead")
        unknown = sorted({name for name in types if isinstance(name, str)} - set(self.masses))
        unknown += [what_is(name) for name in types if not isinstance(name, str)][:1]
        if unknown:
            raise ParameterError(f"unknown bead types {', '.join(unknown)}; `masses` defines {', '.join(self.masses)}")
        return types

    def _checked_residues(self) -> tuple[str, ...] | None:
        if self.residues is None:
            return None
        names = tuple(self.residues) if isinstance(self.residues, Iterable) and not isinstance(self.residues, str) else ()
        if len(names) != self.n_beads or not all(isinstance(name, str) and name for name in names):
            raise ParameterError(f"residues must name the molecule of each of the {self.n_beads} beads by text")
        return names

    def _flags(self, name: str, kind: type, what: str) -> np.ndarray | None:
        """An attribute with one bool or whole number per bead, (N,), or None."""
        if getattr(self, name) is None:
            return None
        array = np.asarray(getattr(self, name))
        if array.shape != (self.n_beads,):
            raise ParameterError(f"{name} must have one entry per bead, {self.n_beads}, not shape {array.shape}")
        if not np.issubdtype(array.dtype, kind):
            raise ParameterError(f"{name} must hold {what} for each bead, not {array.dtype} such as {what_is(array[0])}")
        return array.astype(np.int64 if kind is np.integer else kind)

    def _checked_interacting(self) -> np.ndarray | None:
        """``interacting`` as an array (N, 3), or None if all forces act on all beads."""
        if self.interacting is None:
            return None
        array = np.asarray(self.interacting)
        if array.shape != (self.n_beads, 3) or array.dtype != np.bool_:
            raise ParameterError(f"interacting must be bools of shape {(self.n_beads, 3)}, not {array.dtype} of shape {array.shape}")
        return None if array.all() else array

    def _per_bead(self, name: str, dimension: str, shape: tuple[int, ...]) -> np.ndarray | None:
        """An attribute with values of this shape per bead, in MD units, or None."""
        value = getattr(self, name)
        if value is None:
            if name == "positions":
                raise ParameterError("positions are missing")
            return None
        array = np.array(to_md(value, dimension, name), dtype=np.float64, order="C")
        if array.shape != (self.n_beads, *shape):
            raise ParameterError(
                f"{name} must have shape {(self.n_beads, *shape)} for the {self.n_beads} beads in `types`, not {array.shape}"
            )
        return array

    def _checked_bead_masses(self) -> np.ndarray:
        """Masses of all beads, (N,), Da."""
        if self.bead_masses is None:
            return np.array(list(self.masses.values()))[self.type_ids]
        array = self._per_bead("bead_masses", "mass", ())
        assert array is not None
        if np.any(array <= 0):
            raise ParameterError(
                f"bead {bead_number(np.argmin(array))} has the mass {array.min():g}; masses must be > 0"
                + either(" (freeze beads with `mobile`)", "; beads that no fix moves stay where they are")
            )
        return array

    def _check_bonds(self) -> None:
        self._check_kinds("bonds", Bonds)
        check_members(np.sort(self.bond_pairs, axis=1), self.n_beads, "a bond", "the bond between")
        for bonds in self.bonds:
            bonds.check_box(self.box)
            wrong = bonds.overstretched(self.positions, self.box)
            if wrong is not None:
                raise ParameterError(f"{wrong}; move the beads, or use other bonds until they are close enough")

    def _check_kinds(self, name: str, *kinds: type) -> None:
        """Keep an attribute as a tuple; ParameterError if it is not a sequence of these classes."""
        known = [name for kind in kinds for name in known_under(kind) or [kind.__name__]]
        given, names = getattr(self, name), " or ".join(known)
        if isinstance(given, kinds) or not isinstance(given, Sequence) or isinstance(given, str):
            raise ParameterError(f"{name} must be a sequence of {names}, such as [{known[0]}(...)], not {what_is(given)}")
        keep(self, **{name: tuple(given)})
        for entry in given:
            require(entry, kinds, f"{name} must be a sequence of {names}")

    def _check_flow(self) -> None:
        """Check forces on single beads and walls, and keep the gaps between walls."""
        self._check_kinds("body_forces", BodyForce, PositionForce)
        for term in self.body_forces:
            if isinstance(term, BodyForce):
                term.vectors(self.type_ids, self.type_names, self.box)
            else:
                term.check_values(self.positions, term.mask(self.type_ids, self.type_names), self.box)
        keep(self, **checked_walls(self.walls, self.box))
        check_inside(self.gaps, self.positions, ~self.immobile)

    def _checked_pairs(self) -> tuple[PairTable, ...]:
        """Pair tables; ParameterError if a pair of types is missing, or coefficients contradict the temperature."""
        tables = self.pairs
        require(tables, (PairTable, Mapping, Sequence), "pairs must be a PairTable, a mapping that makes one, or a sequence of them")
        if isinstance(tables, Mapping):
            tables = PairTable(tables)
        if isinstance(tables, PairTable):
            tables = (tables,)
        tables = tuple(table if isinstance(table, PairTable) else PairTable(table) for table in tables)
        require_complete(list(tables), self.type_names)
        temperatures = [self.kT.kT_start, self.kT.kT_end] if isinstance(self.kT, TemperatureRamp) else [self.initial_kT]
        for table in tables:
            for key, coefficient in table.entries.items():
                try:
                    for kT in temperatures if coefficient is not NONE else ():
                        coefficient.check_temperature(kT)
                except ParameterError as error:
                    raise ParameterError(f"for types {key}: {error}") from None
        return tables
