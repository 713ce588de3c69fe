"""From the state of a deck to a :class:`~openmm_dpd.model.scene.Scene`, including bead fields and sources."""

import numpy as np

from ...base.errors import read_by
from ...model.eos import EquationOfState
from ...model.internal import BeadTemperatures, Concentrations, Internal, InternalEnergy
from ...model.scene import Scene
from ...model.shear import LeesEdwards
from ...model.sources import Source
from ...model.temperature import TemperatureRamp
from ..language.lexer import errors_at, located
from ..state.deck_state import DeckState
from ..state.moment import Window
from ..state.records import COUPLED, FORCE_FIXES, GUIDED, REACTING, Fix
from ..state.rigid import bodies_of, make_whole
from ..styles.charges import electrostatics_of
from ..styles.pair_styles import pair_tables
from ..styles.srp import segments_of
from .axes import SAME, Axes, axes_of
from .exclusion import scene_pairs
from .flow import PLAIN, body_forces_of, interacting_beads, walls_of
from .integration import integration
from .reacting import bonded_terms, lasting, reactions_of


def build_scene(
    state: DeckState, window: Window | None = None, compat: str = "consistent", mobile: np.ndarray | None = None, axes: Axes = SAME
) -> Scene:
    """The scene that the deck describes at this point; it must have a box, beads and pair coefficients.

    Temperature ramps extend over the steps of ``window``; without it the temperature is that of the start.  ``compat`` selects the heat of
    edpd, ``mobile`` the beads that move: by default those of the integrating fixes.  DeckError, with file and line, if something is missing
    or cannot be expressed: unset type pairs or masses, different temperatures, a cutoff longer than half the box ...
    """
    box = state.require_box("a run")
    if not len(state.atoms):
        raise located(state.here, "there are no beads")
    masses = state.bead_masses()
    if state.bond.style == "none" and len(state.bonds):
        state.note("there are bonds but no bond_style: they have no energy and only count for special_bonds")
    if (
        len(state.bonds)
        and any(0 < f < 1 for f in state.special)
        and any(style.name in ("dpd/fdt", "dpd/fdt/energy") for style in state.pair.styles)
    ):
        state.note(
            "dpd/fdt: the noise of bonded neighbours scales with the square root of the special_bonds factor (LAMMPS: with the factor)"
        )
    if state.dimension == 2:
        _check_plane(state)
    mobile = integration(state).mobile if mobile is None else mobile
    make_whole(state)
    atoms, units = state.atoms, state.units
    vectors, shear = box.reduced_vectors * units.length, shear_of(state)
    with errors_at(state.here), read_by(state):
        reactions = reactions_of(state, state.step if window is None else window.first)
        pairs = scene_pairs(state, pair_tables(state))
        return Scene(
            masses={name: state.masses.get(k, 1.0) for name, k in pairs.of_deck.items()},
            types=pairs.types,
            positions=axes.of_scene(state.scene_positions),
            pairs=pairs.tables,
            kT=deck_kT(state, window),
            box=axes.box_of_scene(vectors),
            velocities=axes.of_scene(atoms.velocities * units.velocity),
            bead_masses=masses,
            charges=atoms.charges if np.any(atoms.charges) else None,
            **{f"{what}s": bonded_terms(state, what, lasting(state, what)) for what in ("bond", "angle", "dihedral", "improper")},
            segments=segments_of(
                state, compat, {fix.name: each.bonds for fix, each in zip(state.fixes_of(*REACTING), reactions, strict=True)}
            ),
            bonded_factors=bonded_factors(state),
            mobile=None if mobile.all() else mobile,
            molecules=np.maximum(atoms.molecules, 0) if np.any(atoms.molecules) else None,  # -1 means none, as 0 does
            internal=internal_of(state),
            sources=sources_of(state, vectors),
            compat=compat,
            body_forces=body_forces_of(state),
            walls=walls_of(state, mobile),
            electrostatics=electrostatics_of(state),
            interacting=interacting_beads(state, mobile),
            shear=shear if axes == axes_of(state) else None,
            bodies=bodies_of(state),
            reactions=reactions,
        )


def _check_plane(state: DeckState) -> None:
    """Raise DeckError if beads are not in the plane z = 0, or may leave it: forces between beads in a plane are in the plane."""
    if state.atoms.positions[:, 2].any():
        raise located(state.here, "in two dimensions all beads must have z = 0")
    if state.atoms.velocities[:, 2].any():
        raise located(state.here, "beads have velocities along z, so they would leave the plane: set them to 0, or use fix enforce2d")
    for style in state.pair.styles:
        if "cutoff_charges" in style.settings:
            raise located(style.where, f"pair style {style.name}: lattice sums of charges need three dimensions")
        if any(found.values.get("gamma_perp") for found in style.coefficients.values()):
            raise located(style.where, f"pair style {style.name}: in two dimensions the friction across pairs must be 0: its noise has a z")


def deck_kT(state: DeckState, window: Window | None) -> float | TemperatureRamp:
    """The temperature (or ramp) common to all pair styles with a thermostat, as an energy; 0 if there is none.  If beads have internal
    temperatures and no style sets another, it is their mean, which scales the trial drift.  DeckError if two styles have different
    temperatures."""
    styles = [style for style in state.pair.styles if style.spec.thermostat and "start" in style.settings]
    if not styles:
        baths = state.fixes_of(*COUPLED)
        return internal_scale(state) or (baths[0].parameters["kT"][0] if baths else 0.0)
    # styles without friction have no noise and no temperature; if no style has any, the first one counts
    frictions = ("gamma", "gamma_perp", "sigma")
    active = [any(found.values.get(name) for found in style.coefficients.values() for name in frictions) for style in styles]
    styles = [style for style, has in zip(styles, active, strict=True) if has] or styles[:1]
    wanted = [(style.settings["start"], style.settings["stop"]) for style in styles]
    for style, pair in zip(styles, wanted, strict=True):
        if pair != wanted[0]:
            raise located(
                style.where,
                f"pair styles {styles[0].name} and {style.name} have different temperatures "
                f"({wanted[0][0]:g} to {wanted[0][1]:g} and {pair[0]:g} to {pair[1]:g}); a scene has one temperature",
            )
    start, stop = (value * state.units.thermal_energy for value in wanted[0])
    if start == stop or window is None or window.end == window.begin:
        return start
    return TemperatureRamp(start, stop, window.begin - window.first, window.end - window.first)


def bonded_factors(state: DeckState) -> tuple[float, float, float]:
    """Factors of bonded neighbours.  In LAMMPS bonds of style quartic take the conservative pair terms of their beads off, which the
    factors 1 1 1 that they need have put there; DeckError where a factor of 0 would do anything else."""
    setup = state.bond
    for style in state.pair.styles:
        if style.name == "mdpd/rhosum" and any(f == 0 and q != 0 for f, q in zip(state.special, state.special_charges, strict=True)):
            raise style.error("a factor 0 of special_bonds lj needs one of coul: only then does LAMMPS leave neighbours out of densities")
    if "quartic" not in setup.styles or not len(state.bonds):
        return state.special if len(state.bonds) or state.fixes_of(*REACTING) else (1.0, 1.0, 1.0)
    others = {setup.coefficients[kind][0] for kind in np.unique(state.bonds[:, 0]).tolist() if kind in setup.coefficients} - {"quartic"}
    reasons = {
        "it needs units lj: its repulsion has sigma = epsilon = 1": state.units.name != "lj",
        "it needs special_bonds lj 1 1 1, as in LAMMPS": set(state.special) != {1.0},
        f"it cannot be combined with bonds of style {', '.join(sorted(others))} in one deck": bool(others),
        "it needs pair styles without friction and charges, since bonded beads keep these": any(
            style.spec.thermostat or "cutoff_charges" in style.settings for style in state.pair.styles
        ),
    }
    for reason in (reason for reason, holds in reasons.items() if holds):
        raise located(setup.where, f"bond_style quartic: {reason}")
    return (0.0, 1.0, 1.0)


def shear_of(state: DeckState) -> LeesEdwards | None:
    """The shear of ``fix deform``, or None.  DeckError if it is combined with an incompatible fix."""
    fixes = state.fixes_of("deform")
    if state.moving_box:
        _check_moving_box(state, fixes)
        return None
    for other in (*fixes[1:], *state.fixes_of("nph", "momentum", *BOUND, "wall/reflect", *SOURCE_FIXES)):
        if fixes:
            raise other.error(f"{other.style} cannot be combined with fix deform ({fixes[0].name}); remove one of them")
    if not fixes or not fixes[0].parameters["rate"]:
        return None
    return LeesEdwards(rate=fixes[0].parameters["rate"])


def _check_moving_box(state: DeckState, fixes: list[Fix]) -> None:
    """Raise DeckError if something cannot follow a box whose edges or tilts a ``fix deform`` changes."""
    for other in (*fixes[1:], *state.fixes_of("nph", "wall/reflect", *SOURCE_FIXES)):
        raise other.error(f"{other.style} cannot be combined with fix deform ({fixes[0].name}); remove one of them")
    for other in state.fixes_of(*BOUND):
        known = other.style in FORCE_FIXES and not set(other.parameters) - PLAIN
        if not known or any(word.startswith("v_") for word in other.parameters["force"]):
            what = "a variable force" if other.style in FORCE_FIXES else other.style
            raise other.error(f"{what} cannot follow the box of fix deform ({fixes[0].name}); use addforce or setforce with numbers")
    if electrostatics_of(state) is not None:
        raise fixes[0].error("charges with lattice sums are not supported in a box that changes")


#: Fixes within steps, but for those that act on velocities alone, which beads beside fix deform have, too.
BOUND = tuple(style for style in GUIDED if style not in ("nvt", "temp/rescale", "temp/berendsen", "langevin", "viscous"))
EOS_FIXES = ("eos/cv", "eos/table")
SOURCE_FIXES = {"edpd/source": "edpd", "tdpd/source": "tdpd"}


def internal_of(state: DeckState) -> Internal | None:
    """Internal energies (dpd/fdt/energy), temperatures (edpd) or concentrations (tdpd) at the start of a run.  As in LAMMPS, each run
    starts with all internal energy counted as mechanical; the sum is unchanged."""
    names = [style.name for style in state.pair.styles]
    atoms, units = state.atoms, state.units
    if "dpd/fdt/energy" in names:
        return InternalEnergy(equations_of_state(state), atoms.thetas * units.thermal_energy)
    for fix in state.fixes_of(*EOS_FIXES):
        state.note(f"fix {fix.name} ({fix.style}) has no effect: internal energies only change with pair style dpd/fdt/energy")
    if "edpd" in names:
        return BeadTemperatures(atoms.temperatures * units.thermal_energy, atoms.capacities)
    return Concentrations(atoms.concentrations) if "tdpd" in names else None


def internal_scale(state: DeckState) -> float:
    """Mean internal temperature as an energy (kJ/mol), or 0: the scale of kT if no thermostat sets one."""
    names = [style.name for style in state.pair.styles]
    for name, values in (("dpd/fdt/energy", state.atoms.thetas), ("edpd", state.atoms.temperatures)):
        if name in names and len(values):
            return float(values.mean()) * state.units.thermal_energy
    return 0.0


def equations_of_state(state: DeckState) -> dict[str, EquationOfState]:
    """Equation of state of each bead type.  DeckError if a bead has none or two, or beads of one type have different ones."""
    fixes = state.fixes_of(*EOS_FIXES)
    owner = np.full(len(state.atoms), -1)
    for k, fix in enumerate(fixes):
        members = state.group(fix.group)
        twice = members & (owner >= 0)
        if twice.any():
            bead = int(np.argmax(twice))
            other = fixes[owner[bead]].name
            raise fix.error(f"bead {state.atoms.ids[bead]} already has an equation of state from fix {other}; it can have only one")
        owner[members] = k
    if np.any(owner < 0):
        bead = int(state.atoms.ids[np.argmax(owner < 0)])
        where = next(style.where for style in state.pair.styles if style.name == "dpd/fdt/energy")
        message = f"pair style dpd/fdt/energy needs a fix eos/cv or eos/table for every bead; bead {bead} has none"
        raise located(where, message)
    by_type: dict[str, EquationOfState] = {}
    for kind in range(1, state.n_types + 1):
        used = [fixes[k] for k in np.unique(owner[state.atoms.types == kind]).tolist()]
        for fix in used[1:]:
            if fix.parameters["source"] != used[0].parameters["source"]:
                raise fix.error(f"beads of type {kind} have a different equation of state from fix {used[0].name}; use separate types")
        by_type[str(kind)] = (used or fixes)[0].parameters["eos"]
    return by_type


def sources_of(state: DeckState, box: np.ndarray) -> list[Source]:
    """Sources of heat or species, placed in the deck's coordinates; ``box`` has the scene's vectors (nm)."""
    names = [style.name for style in state.pair.styles]
    found = []
    for fix in state.fixes_of(*SOURCE_FIXES):
        pair = SOURCE_FIXES[fix.style]
        if pair not in names:
            raise fix.error(f"{fix.style} needs pair style {pair}; the deck has {', '.join(names) or 'none'}")
        group = state.group(fix.group)
        with errors_at(fix.where, f"fix {fix.name}: "):
            source = Source(
                fix.parameters["region"],
                fix.parameters["rate"],
                fix.parameters["species"],
                None if group.all() else group,
                state.require_box("a run").low * state.units.length,
            )
            source.check(box, len(state.atoms), max(1, state.n_species))
        found.append(source)
    return found
