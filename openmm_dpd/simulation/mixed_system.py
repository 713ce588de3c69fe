"""Beads of a scene beside atoms of a force field, in one System.

Every force of the atoms keeps acting on the atoms alone, every pair term of the scene on its beads alone, and what acts between atoms and
beads is in a table of its own, by names of classes of atoms and of bead types.  Nothing is counted twice, because nothing else is added:

- in a NonbondedForce beads have no charge and no well depth;
- the energy of a CustomNonbondedForce is switched off for pairs with a bead, without evaluating to NaN where beads overlap;
- the forces of the scene have no term between two atoms.

All of them exclude the same pairs and have one cutoff in each force group, as GPU platforms want it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np
import openmm
from openmm import app, unit

from ..base.errors import ParameterError, PlanError, require, what_is
from ..base.openmm_private import masses_of, virtual_sites
from ..base.platforms import fastest_platform
from ..base.units import BOLTZMANN
from ..io.trajectory import openmm_topology
from ..model.pairs import NONE, PairTable
from ..model.scene import Scene
from ..model.schemes import scheme_of
from ..plan.choices import platform_name
from ..plan.forces.merging import merged_systems
from ..plan.kinds import KINDS, kind_for
from ..plan.made import Freedom, Host, box_of, check_system, checked_positions
from ..plan.plan import make_plan
from .build import build_plan, run_in
from .built import BuiltSystem
from .thermostat import UNSEEN


class MixedSystem(BuiltSystem):
    """Atoms and beads in one System; the atoms come first.

    A :class:`BuiltSystem`, whose ``plan`` is that of the pair terms: the beads, and the classes of atoms as further types.
    """

    @property
    def n_atoms(self) -> int:
        """Number of particles of the force field; those from here on are beads."""
        return self.plan.n_atoms

    def __repr__(self) -> str:
        return f"<MixedSystem: {self.n_atoms} atoms and {self.plan.scene.n_beads - self.n_atoms} beads, {self.plan!r}>"

    def temperatures(self, context: openmm.Context) -> dict[str, float]:
        """Kinetic temperatures (kelvin) of ``atoms``, ``beads`` and of ``all``, for the degrees of freedom that each of them has.

        The three that the conserved momentum takes are shared between atoms and beads in proportion to the degrees of freedom.
        """
        state = context.getState(velocities=True)
        v = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        return {name: kT / BOLTZMANN for name, kT in Freedom(self.system, self.n_atoms).kinetic_kT(v).items()}


def create_mixed_system(
    scene: Scene,
    topology: app.Topology,
    system: openmm.System,
    positions,
    *,
    atoms: Sequence[str | None],
    cross: PairTable | Mapping | Sequence[PairTable | Mapping],
    dt,
    scheme: str = "middle",
    platform: str | None = None,
    seed: int | None = None,
    engine: str = "auto",
) -> MixedSystem:
    """Put the beads of a scene into a System made elsewhere, by openmm.app.ForceField say, and make the integrator that runs both.

    Parameters
    ----------
    scene : Scene
        The beads, with everything that acts between them; its box and its temperature are those of the whole.
    topology, system, positions
        The atoms.  The System is copied and stays as it is; its box must be that of the scene.
    atoms : sequence of str or None
        Class of each particle of the System, in any names that are not bead types.  None: beads do not see it.
    cross : table, or a sequence of tables
        What acts between classes and bead types, ``{("solute", "W"): DPD(A=..., gamma=...)}``; tables of different kinds are laid over
        each other.  ``"*"`` is all classes beside a bead type, for all bead types beside a class.  Every class needs an entry
        with every bead type (or NONE).  Two classes may have friction (a DPD with A = 0), nothing else, and have none by default.
    dt, scheme, platform, seed, engine
        As in :func:`openmm_dpd.simulation.build.build`; constraints and virtual sites need ``middle``.

    Raises
    ------
    ParameterError, PlanError
        If sizes, boxes or names do not fit, a pair of class and bead type has no entry, two classes have more than friction, the
        System has a force that cannot take further particles, or the scene has something that atoms cannot share (walls, body
        forces, internal energies).

    Notes
    -----
    Virtual sites take no part in friction; conservative cross terms on them go to the atoms they belong to.  Atoms of mass 0 that
    are no virtual sites stay where they are and exert friction on beads, as immobile beads do.

    A dispersion correction of the NonbondedForce (``useDispersionCorrection``) spreads the atoms over the whole box; for few atoms in a
    solvent of beads it means little and is better switched off.
    """
    require(scene, Scene, "expected a Scene")
    _check_scene(scene)
    check_system(system)
    x = checked_positions(topology, system, positions)
    _check_box(scene, system)
    classes = _checked_classes(atoms, len(x), scene.type_names)
    tables = _tables(scene, classes, cross)
    name = platform_name(platform) or fastest_platform()
    if scheme_of(scheme).native:
        raise PlanError("OpenMM's DPDIntegrator has no conservative forces of its own; use scheme='middle'")
    left_out = virtual_sites(system) | np.array([name is None for name in classes])
    whole = _whole(scene, system, x, classes, tables)
    host = Host.of(system, left_out)
    plan = make_plan(whole, dt=dt, scheme=scheme, conservative="openmm", platform=name, seed=seed, engine=engine, host=host)
    built = build_plan(plan)
    merged, own = merged_systems(system, built.system, host.pair_group)
    run_in(built, merged, own, "create_mixed_system()")
    beads = openmm_topology(list(scene.types), scene.molecules, scene.bond_pairs, scene.box, scene.residues)
    modeller = app.Modeller(topology, x * unit.nanometer)
    modeller.add(beads, scene.positions * unit.nanometer)
    modeller.topology.setPeriodicBoxVectors(None if scene.box is None else scene.box * unit.nanometer)
    built.topology = modeller.topology
    return MixedSystem(**{field.name: getattr(built, field.name) for field in fields(BuiltSystem)})


# -- checks --------------------------------------------------------------------------------------------------------------------------
def _check_scene(scene: Scene) -> None:
    for name in ("walls", "body_forces", "internal", "sources", "electrostatics", "interacting", "shear", "bodies", "reactions"):
        if getattr(scene, name) not in (None, ()):
            raise PlanError(f"a scene with `{name}` cannot be put beside atoms")
    for table in scene.tables:
        if table.kind is not None and not kind_for(table.kind).beside_atoms:
            raise PlanError(f"beads beside atoms may have the pair terms {_allowed()}; {table.kind.__name__} is for beads alone")


def _allowed() -> str:
    """Names of the kinds that may be beside atoms."""
    return ", ".join(kind.name for kind in KINDS.values() if kind.beside_atoms)


def _check_box(scene: Scene, system: openmm.System) -> None:
    """The box of the scene is that of the atoms, where these have one."""
    for force in system.getForces():
        if isinstance(force, (openmm.NonbondedForce, openmm.CustomNonbondedForce)):
            bounded = force.getNonbondedMethod() > force.CutoffNonPeriodic
            if bounded != (scene.box is not None):
                has, want = ("a box", "CutoffPeriodic or PME") if scene.box is not None else ("no box", "NoCutoff or CutoffNonPeriodic")
                raise PlanError(
                    f"the scene has {has}, which the {type(force).__name__} of the atoms does not fit; make the System with the "
                    f"nonbondedMethod {want}"
                )
    if scene.box is None:
        return
    box = box_of(system)
    if box is not None and not np.allclose(box, scene.box, atol=1e-5):
        raise ParameterError(
            f"the box of the atoms, {np.diag(box).round(6).tolist()} nm, is not that of the scene, "
            f"{np.diag(scene.box).round(6).tolist()} nm; set that of the Topology before createSystem"
        )


def _checked_classes(atoms, n: int, types: list[str]) -> list[str | None]:
    if isinstance(atoms, str) or not isinstance(atoms, Sequence):
        raise ParameterError(f"atoms must name the class of each particle of the System (or None), not {what_is(atoms)}")
    if len(atoms) != n:
        raise ParameterError(f"atoms names the classes of {len(atoms)} particles, but the System has {n}")
    for name in atoms:
        if name is not None and (not isinstance(name, str) or name in ("", "*", UNSEEN)):
            raise ParameterError(f"a class of atoms is named by text other than '*', or None; `atoms` has {what_is(name)}")
        if name in types:
            raise ParameterError(f"{what_is(name)} is a bead type of the scene; give the class of atoms another name")
    if all(name is None for name in atoms):
        raise ParameterError("beads see none of the atoms: name the class of at least one in `atoms`")
    return list(atoms)


# -- tables --------------------------------------------------------------------------------------------------------------------------
def _tables(scene: Scene, classes: list[str | None], cross) -> list[PairTable]:
    """Tables of the whole: those of the scene, with the cross terms of the same kind in them."""
    names = sorted({name for name in classes if name is not None})
    given = [cross] if isinstance(cross, (PairTable, Mapping)) else cross
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise ParameterError(f"cross must be a table {{(class, bead type): coefficient}}, or a sequence of them, not {what_is(cross)}")
    extra = [table if isinstance(table, PairTable) else PairTable(table) for table in given]
    entries = [(table.kind, _cross_entries(table, names, scene.type_names)) for table in extra]
    covered = {frozenset(pair) for _, found in entries for pair in found}
    missing = [(a, b) for a in names for b in scene.type_names if frozenset((a, b)) not in covered]
    if missing:
        listing = ", ".join(f"({a}, {b})" for a, b in missing[:6]) + (" ..." if len(missing) > 6 else "")
        raise ParameterError(f"no cross terms for {listing}; set them in `cross`, or set them to NONE if they do not interact")
    merged = [(table.kind, dict(table.resolve(scene.type_names))) for table in scene.tables]
    for kind, found in entries:
        # one pass over the pairs serves both: the first table of the scene of the same kind that has no such entry yet
        home = next((own for own_kind, own in merged if own_kind is kind and not set(own) & set(found)), None)
        if home is None:
            merged.append((kind, found))
        else:
            home.update(found)
    # what no table names does not interact: atoms with atoms, unseen atoms with everything (the scene has its own beads)
    every = [*names, UNSEEN, *scene.type_names]
    silent = {(a, b): NONE for k, a in enumerate(every) for b in every[k:]}
    tables = [PairTable(table) for kind, table in merged if kind is not None]
    if not tables:
        raise PlanError("neither the beads nor the cross terms have any pair term")
    first = tables[0]
    named = {frozenset(pair) for table in tables for pair in table.entries}
    tables[0] = PairTable({**{pair: NONE for pair in silent if frozenset(pair) not in named}, **first.entries})
    return tables


def _cross_entries(table: PairTable, names: list[str], types: list[str]) -> dict:
    """Entries of a cross table with wildcards written out, keyed (class, bead type) or (class, class)."""
    if table.kind is not None and not kind_for(table.kind).beside_atoms:
        raise PlanError(f"{table.kind.__name__} cannot act between atoms and beads; use {_allowed()}")
    found: dict[tuple[str, str], object] = {}
    for key, value in table.entries.items():
        for name in key:
            if name not in ("*", *names, *types):
                known = f"classes {', '.join(names)}; bead types {', '.join(types)}"
                raise ParameterError(f"for {key} in `cross`: there is no class of atoms or bead type {what_is(name)} ({known})")
        sides = [name for name in key if name in names], [name for name in key if name in types]
        if len(sides[1]) == 2:
            raise ParameterError(f"for {key} in `cross`: both are bead types; what acts between beads is in the scene")
        if len(sides[0]) == 2:
            if value is not NONE and (not kind_for(type(value)).thermostat or value.has_conservative):
                raise ParameterError(
                    f"for {key} in `cross`: both are classes of atoms, which have forces of their own; "
                    "only friction (a DPD with A = 0) is possible"
                )
            found[tuple(sorted(sides[0]))] = value  # type: ignore[index]
            continue
        for a in sides[0] or names:
            for b in sides[1] or types:
                found[a, b] = value
    return found


# -- the whole -----------------------------------------------------------------------------------------------------------------------
def _whole(scene: Scene, system: openmm.System, x: np.ndarray, classes: list[str | None], tables: list[PairTable]) -> Scene:
    """Scene of all particles: the classes of atoms are further types."""
    n = len(x)
    mass = masses_of(system)
    names = [UNSEEN if name is None else name for name in classes]
    mobile = np.concatenate([mass > 0, ~scene.immobile])
    velocities = None
    if scene.velocities is not None:
        drawn = np.random.default_rng(0xA70).normal(size=(n, 3)) * np.sqrt(scene.initial_kT / np.where(mass > 0, mass, 1.0))[:, None]
        velocities = np.concatenate([np.where(mass[:, None] > 0, drawn, 0.0), scene.velocities])
    segments = scene.segments
    if segments is not None and segments.bonds is not None:
        segments = replace(segments, bonds=scene.segment_pairs + n)
    return Scene(
        masses={**dict.fromkeys([*sorted(set(names) - {UNSEEN}), UNSEEN], 1.0), **scene.masses},
        types=[*names, *scene.types],
        positions=np.concatenate([x, scene.positions]),
        pairs=tables,
        kT=scene.kT,
        box=scene.box,
        velocities=velocities,
        bead_masses=np.concatenate([np.where(mass > 0, mass, 1.0), scene.bead_masses]),
        bonds=[bonds.shifted(n) for bonds in scene.bonds],
        bonded_factors=scene.bonded_factors,
        mobile=None if mobile.all() else mobile,
        angles=[angles.shifted(n) for angles in scene.angles],
        dihedrals=[dihedrals.shifted(n) for dihedrals in scene.dihedrals],
        impropers=[impropers.shifted(n) for impropers in scene.impropers],
        segments=segments,
        compat=scene.compat,
    )
