"""An exported scene in LAMMPS's terms: the data file (types, box, beads, and what joins them), the styles of bonded and pair
interactions, and commands for charges."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem, thermal_energies
from ...model.internal import BeadTemperatures, Concentrations, InternalEnergy
from ...model.pairs import NONE
from ...model.scene import Scene
from ...plan.kinds import bonded_kind, kind_for
from ..files.data_file import JOINED, DataFile
from ..state.box import Box
from ..styles.charges import QQR2E
from ..styles.pair_styles import EXPORTS
from ..styles.words import Differences, Pair, PairExport, StyleUse, bonded_styles, exact, lammps_seed

#: Mass of immobile beads, if LAMMPS would otherwise change their velocities by friction or use their mass for heat.
HEAVY = 1e15
#: Largest image flag of common LAMMPS builds.
_LARGEST_IMAGE = 511
#: Maximum number of bead types, since LAMMPS stores tables of type pairs.
_MOST_TYPES = 2000


@dataclass(frozen=True, eq=False)
class BeadTypes:
    """LAMMPS's atom types: one for each bead type of the scene, or several if its masses differ."""

    of_bead: np.ndarray  #: (N,) type of each bead, counted from 1
    names: tuple[str, ...]  #: Bead type of the scene for each type
    masses: tuple[float, ...]  #: Da
    frozen: tuple[bool, ...]  #: Whether the beads of each type are immobile (only set where this matters)

    def __len__(self) -> int:
        return len(self.names)

    def span(self, name: str) -> str:
        """The LAMMPS types of a bead type, as an argument of pair_coeff."""
        mine = [k for k, other in enumerate(self.names, start=1) if other == name]
        return str(mine[0]) if len(mine) == 1 else f"{mine[0]}*{mine[-1]}"


def lammps_types(scene: Scene, apart: bool = False) -> BeadTypes:
    """Atom types of a scene.  With ``apart`` immobile beads have separate types with a mass too large to be moved.  ParameterError if there
    are more masses than LAMMPS's tables of type pairs allow."""
    frozen = np.zeros(scene.n_beads, bool) if scene.mobile is None or not apart else ~scene.mobile
    of_bead = np.zeros(scene.n_beads, dtype=np.int64)
    names, masses, still = list[str](), list[float](), list[bool]()
    spare = unused_type(scene)
    for k, (name, mass) in enumerate(scene.masses.items()):
        if name == spare:
            continue
        members = scene.type_ids == k
        kinds = [(value, False) for value in np.unique(scene.bead_masses[members & ~frozen]).tolist()]
        kinds += [(HEAVY, True)] if np.any(members & frozen) else []
        for value, stays in kinds or [(mass, False)]:
            names.append(name)
            masses.append(value)
            still.append(stays)
            of_bead[members & frozen if stays else members & ~frozen & (scene.bead_masses == value)] = len(names)
    if len(names) > _MOST_TYPES:
        raise ParameterError(
            f"the beads have {len(names)} different masses and types, and LAMMPS needs an atom type for each; "
            f"it stores tables of type pairs, so at most {_MOST_TYPES} are exported. Round the masses in `bead_masses`"
        )
    return BeadTypes(of_bead, tuple(names), tuple(masses), tuple(still))


def unused_type(scene: Scene) -> str | None:
    """The last type of a scene with segments, if no bead has it and it has no interactions: then it is the bond type of a deck."""
    last = scene.type_names[-1]
    if scene.segments is None or np.any(scene.type_ids == len(scene.masses) - 1):
        return None
    resolved = [table.resolve(scene.type_names) for table in scene.tables]
    meets = any(last in pair and c is not NONE for table in resolved for pair, c in table.items())
    return None if meets else last


def atom_styles(scene: Scene, mdpd: bool = False) -> tuple[str, ...]:
    """Atom style of a scene: one name, or several for ``hybrid``; ``mdpd`` if ``fix mvv/dpd``, which requires that style, moves the
    beads."""
    own = {InternalEnergy: "dpd", BeadTemperatures: "edpd", Concentrations: "tdpd"}.get(type(scene.internal))
    if own is None and (mdpd or any(kind_for(table.kind).has_densities for table in scene.tables if table.kind is not None)):
        own = "mdpd"
    charged, bonded = scene.charges is not None, bool(len(scene.bond_pairs)) or scene.molecules is not None
    rest: str | None = None
    others = any(len(group.beads) for group in scene.bonded[len(scene.bonds) :])
    if bonded or others:
        rest = "full" if charged else "molecular" if others else "bond"
    elif charged:
        rest = "charge"
    return tuple(style for style in (own, rest) if style) or ("atomic",)


def longest_cutoff(scene: Scene) -> float:
    """Longest cutoff of the pair terms, nm."""
    return max((c.cutoff for table in scene.tables for c in table.entries.values()), default=0.0)


def species_of(scene: Scene) -> int:
    """Number of concentrations per bead; 0 if there are none."""
    return scene.internal.n_species if isinstance(scene.internal, Concentrations) else 0


def atom_style_line(styles: tuple[str, ...], n_species: int) -> str:
    """The atom_style command."""
    words = [f"{style} {n_species}" if style == "tdpd" else style for style in styles]
    return f"atom_style {'hybrid ' if len(styles) > 1 else ''}{' '.join(words)}"


@dataclass(frozen=True, eq=False)
class Bonded:
    """Bonds, angles, dihedrals or impropers: ``rows`` are (type, bead indices), ``types`` (style, coefficients) from type 1 on."""

    rows: np.ndarray
    types: tuple[tuple[str, str], ...]

    @property
    def ids(self) -> np.ndarray:
        """Types and bead ids, which count from 1."""
        return self.rows + (np.arange(self.rows.shape[1]) > 0)


def lammps_box(
    scene: Scene, corner: np.ndarray, differences: Differences, flags: np.ndarray | None = None
) -> tuple[Box, np.ndarray, np.ndarray]:
    """Box (nm), wrapped positions, and image flags (with the ``flags`` of a deck added).  Without a box, one around all beads is made."""
    x = scene.positions
    if scene.box is None:
        low, high = x.min(axis=0) - 1.0, x.max(axis=0) + 1.0
        return Box(low, high, np.zeros(3)), x, np.zeros((len(x), 3), dtype=np.int64)
    tilt = np.array([scene.box[1, 0], scene.box[2, 0], scene.box[2, 1]])
    low, edges = np.array(corner, dtype=np.float64), np.diag(scene.box).copy()
    for axis, gap in scene.gaps.items():
        if np.any(tilt):
            raise ParameterError("walls in a tilted box cannot be exported: LAMMPS's tilted boxes are periodic")
        if gap.period is not None and np.all((gap.fold(x[:, axis]) >= gap.low) & (gap.fold(x[:, axis]) <= gap.high)):
            # no bead is in the solid: LAMMPS's box, which is not periodic along this axis, ends at the walls
            low[axis], edges[axis] = gap.low, gap.high - gap.low
    box = Box(low, low + edges, tilt, bool(np.any(tilt)) or scene.shear is not None)
    inside, images = box.wrap(x)
    images = images if flags is None else images + flags
    if np.abs(images).max(initial=0) > _LARGEST_IMAGE:
        differences.add(
            f"some beads are more than {_LARGEST_IMAGE} boxes away, beyond LAMMPS's limit; all image flags start at 0 "
            "(displacements are then relative to the wrapped positions)"
        )
        images = np.zeros_like(images)
    return box, inside, images


def data_file(
    scene: Scene,
    units: UnitSystem,
    types: BeadTypes,
    places: tuple[Box, np.ndarray, np.ndarray],
    velocities: np.ndarray,
    joined: Sequence[Bonded],
    extra_types: int = 0,
) -> DataFile:
    """The data file of a scene; ``places`` are box, positions and image flags (:func:`lammps_box`), ``joined`` what joins beads;
    ``extra_types`` are types that stand for bonds."""
    box, positions, images = places
    n, count = scene.n_beads, len(types)
    columns = {"id": np.arange(1, n + 1), "type": types.of_bead, "rho": np.zeros(n)} | _fields(scene, units)
    columns["molecule"] = np.zeros(n, dtype=np.int64) if scene.molecules is None else scene.molecules
    columns["charge"] = np.zeros(n) if scene.charges is None else scene.charges
    masses = [mass / units.mass for mass in types.masses] + [1.0] * extra_types
    return DataFile(
        n_types=count + extra_types,
        box=box.scaled(1.0 / units.length),
        columns=columns,
        positions=positions / units.length,
        images=images,
        velocities=velocities / units.velocity,
        masses=dict(enumerate(masses, start=1)),
        **{f"n_{what}_types": len(terms.types) for what, terms in zip(JOINED, joined, strict=True)},  # type: ignore[arg-type]
        **{f"{what}s": terms.ids for what, terms in zip(JOINED, joined, strict=True)},  # type: ignore[arg-type]
    )


def _fields(scene: Scene, units: UnitSystem) -> dict[str, np.ndarray]:
    n, internal = scene.n_beads, scene.internal
    if isinstance(internal, InternalEnergy):
        theta = np.asarray(thermal_energies(internal.thetas, "temperatures"), dtype=np.float64)
        return {"theta": np.broadcast_to(theta, (n,)) / units.thermal_energy}
    if isinstance(internal, BeadTemperatures):
        return {"temperature": internal.values(n)[:, 0] / units.thermal_energy, "capacity": internal.heat_capacities(n)}
    return {f"c{k}": column for k, column in enumerate(internal.values.T, start=1)} if isinstance(internal, Concentrations) else {}


#: Maximum number of bond, angle or dihedral types.
_MOST_BONDED = 100000


#: Bounds of whole numbers.
_WHOLE = ("1 or -1", "a whole number >= 0", "a whole number > 0")


def _word(value: float, whole: bool) -> str:
    return f"{value:.0f}" if whole else exact(value)


def bonded_types(scene: Scene, what: str, units: UnitSystem) -> Bonded:
    """The bonds, angles, dihedrals or impropers (``what``) of a scene, with one type for each set of coefficients."""
    types: dict[tuple[str, str], int] = {}
    rows = [np.zeros((0, JOINED[what][0] + 1), dtype=np.int64)]
    for term in getattr(scene, f"{what}s"):
        style = bonded_kind(type(term)).style
        if style is None:
            raise ParameterError(f"{what}s of kind {type(term).__name__} cannot be exported to LAMMPS")
        columns = bonded_styles(what)[style].columns
        # LAMMPS reads no 2.0 where it wants a whole number
        whole = [term._DIMENSIONS[name][1] in _WHOLE for name in columns.dimensions]
        beads, values = term.beads, np.column_stack(columns.of(term, units))
        different, which = np.unique(values, axis=0, return_inverse=True)
        numbered = [types.setdefault((style, " ".join(map(_word, row, whole))), len(types) + 1) for row in different]
        if len(beads):
            rows.append(np.column_stack([np.array(numbered)[which.ravel()], beads]))
    if len(types) > _MOST_BONDED:
        raise ParameterError(f"the {what}s have {len(types)} different sets of coefficients; at most {_MOST_BONDED} types are exported")
    return Bonded(np.concatenate(rows), tuple(types))


def style_lines(what: str, terms: Bonded) -> Iterator[str]:
    """The commands ``bond_style``, ``angle_style`` or ``dihedral_style``, and the coefficients."""
    if not len(terms.rows):
        return
    styles = list(dict.fromkeys(style for style, _ in terms.types))
    yield f"{what}_style {'hybrid ' if len(styles) > 1 else ''}{' '.join(styles)}"
    for k, (style, words) in enumerate(terms.types, start=1):
        yield f"{what}_coeff {k} {style + ' ' if len(styles) > 1 else ''}{words}"


def longest_bond(scene: Scene) -> float:
    """Length of the longest bond at the start or at rest, nm, multiplied by the number of bonds that an angle or dihedral spans."""
    lengths = [0.0]
    for bonds in scene.bonds:
        if len(bonds.pairs):
            lengths.append(float(bonds.lengths(scene.positions, scene.box).max()))
            lengths.append(float(np.max(bonds.longest())))
    return (3.0 if scene.dihedrals or scene.impropers else 2.0 if scene.angles else 1.0) * max(lengths)


def pair_uses(export: PairExport) -> list[StyleUse]:
    """Styles of all tables, in the order LAMMPS requires."""
    found: list[StyleUse] = []
    for table in export.scene.tables:
        entries = {pair: c for pair, c in table.resolve(export.scene.type_names).items() if c is not NONE}
        if not entries:
            continue
        if table.kind is None or table.kind not in EXPORTS:
            raise ParameterError(f"pair terms of kind {getattr(table.kind, '__name__', None)} cannot be exported to LAMMPS")
        found += EXPORTS[table.kind](export, entries)
    return found


def pair_lines(uses: list[StyleUse], types: BeadTypes, start: float, stop: float, seed: int) -> Iterator[str]:
    """The commands pair_style, pair_coeff and pair_modify; the temperatures at the ends of the run are in LAMMPS's units."""
    if not uses:
        yield "pair_style none"
        return
    pairs = list(combinations_with_replacement(dict.fromkeys(types.names), 2))
    bare = [pair for pair in pairs if not any(pair in use.coefficients for use in uses)]
    single = len(uses) == 1 and not bare and uses[0].name not in _HYBRID_ONLY
    words, seeds = list[str](), 0
    for use in uses:
        ends = ("0.0", "0.0") if use.constant else (exact(start), exact(stop))
        words.append(f"{use.name} {use.settings.format(start=ends[0], stop=ends[1], seed=lammps_seed(seed, seeds))}".strip())
        seeds += "{seed}" in use.settings
    yield f"pair_style {words[0]}" if single else "pair_style hybrid/overlay " + " &\n  ".join(words)
    for first, second in bare:
        yield f"pair_coeff {types.span(first)} {types.span(second)} none"
    n, bond_placeholders = len(types), any(use.name == "srp" for use in uses)
    everything = f"1*{n}" if bond_placeholders else "*"
    if bond_placeholders:
        yield f"pair_coeff {everything} {n + 1} none"
    for use in uses:
        label = "" if single else f"{_label(use, uses)} "
        if use.name == "srp":
            yield f"pair_coeff {n + 1} {n + 1} srp {use.coefficients['*', '*']}"
        elif len(set(use.coefficients.values())) == 1 and len(use.coefficients) == len(pairs):
            yield f"pair_coeff {everything} {everything} {label}{use.coefficients[pairs[0]]}".rstrip()
        else:
            for first, second in sorted(use.coefficients, key=lambda pair: _acts(use, pair)):
                yield f"pair_coeff {types.span(first)} {types.span(second)} {label}{use.coefficients[first, second]}".rstrip()
        if use.modify:
            yield f"pair_modify {'' if single else f'pair {label}'}{use.modify}"


#: Styles that LAMMPS only supports within hybrid/overlay.
_HYBRID_ONLY = ("mdpd", "mdpd/rhosum", "srp", "coul/slater/long", "coul/slater/cut")


def _label(use: StyleUse, uses: list[StyleUse]) -> str:
    """Name of a style in pair_coeff commands of hybrid/overlay, with a number if there are several."""
    same = [id(other) for other in uses if other.name == use.name]
    return use.name if len(same) == 1 else f"{use.name} {same.index(id(use)) + 1}"


def _acts(use: StyleUse, pair: Pair) -> bool:
    # with fix shardlow, LAMMPS omits all repulsion if the last pair_coeff line has A = 0
    return not use.coefficients[pair].startswith(("0.0 ", "-0.0 "))


# -- charges --------------------------------------------------------------------------------------------------------------------
def charge_lines(scene: Scene, units: UnitSystem, of_deck: bool) -> Iterator[str]:
    """The commands dielectric and kspace_style.  LAMMPS's accuracy is relative to the force between two unit charges at unit distance in
    vacuum, a scene's to the actual forces; the number of a deck is kept."""
    charges = scene.electrostatics
    if charges is None:
        return
    assert scene.charges is not None
    strength = charges.coulomb(scene.initial_kT) / (units.energy * units.length)
    yield f"dielectric {exact(QQR2E[units.name] / strength)}"
    if scene.box is None or not charges.all_images:
        return
    accuracy = charges.tolerance
    if not of_deck:
        charged = scene.charges[scene.charges != 0]
        distance = (float(np.linalg.det(scene.box)) / max(1, len(charged))) ** (1 / 3) / units.length
        force = strength * float(np.mean(charged**2)) / distance**2 if len(charged) else 1.0
        accuracy *= min(1.0, force / QQR2E[units.name])
    yield f"kspace_style pppm {exact(accuracy)}"


def special_line(scene: Scene, units: UnitSystem) -> str:
    """The special_bonds command; charges may have separate factors.  LAMMPS's bonds of style quartic need factors of 1 and take the pair
    terms of their beads off; ParameterError where that is something else."""
    styles = {bonded_kind(type(bonds)).style for bonds in scene.bonds if len(bonds.pairs)}
    if "quartic" in styles:
        friction = any(getattr(c, "has_thermostat", False) for table in scene.tables for c in table.entries.values())
        others = len(styles) > 1 or friction or len(scene.bonded) > len(scene.bonds) or scene.electrostatics is not None
        if others or tuple(scene.bonded_factors) != (0, 1, 1) or units.name != "lj":
            raise ParameterError(
                "quartic bonds are exported in units lj, with bonded_factors (0, 1, 1), and without other bonds, angles, friction and "
                "charges: bonded beads have no other pair terms in LAMMPS"
            )
        return "special_bonds lj/coul 1 1 1"
    factors = getattr(scene.electrostatics, "bonded_factors", None)
    if factors is None or tuple(factors) == tuple(scene.bonded_factors):
        return "special_bonds lj/coul " + " ".join(map(exact, scene.bonded_factors))
    return f"special_bonds lj {' '.join(map(exact, scene.bonded_factors))} coul {' '.join(map(exact, factors))}"
