"""Fields of the beads of a deck (energies, temperatures, concentrations) and their sources, as parts of a Scene."""

import numpy as np

from ...model.eos import EquationOfState
from ...model.internal import BeadTemperatures, Concentrations, Internal, InternalEnergy
from ...model.sources import Source
from ..language.lexer import errors_at, located
from ..state.deck_state import DeckState

EOS_FIXES = ("eos/cv", "eos/table")
SOURCE_FIXES = {"edpd/source": "edpd", "tdpd/source": "tdpd"}


def internal_of(state: DeckState) -> Internal | None:
    """Internal energies (dpd/fdt/energy), temperatures (edpd) or concentrations (tdpd) at the beginning of a run.

    As in LAMMPS every run begins with all internal energy booked as mechanical; the sum is what it was.
    """
    names = [style.name for style in state.pair.styles]
    atoms, units = state.atoms, state.units
    if "dpd/fdt/energy" in names:
        return InternalEnergy(equations_of_state(state), atoms.thetas * units.thermal_energy)
    for fix in state.fixes_of(*EOS_FIXES):
        state.note(f"fix {fix.name} ({fix.style}) has no effect: without pair style dpd/fdt/energy internal energies do not change")
    if "edpd" in names:
        return BeadTemperatures(atoms.temperatures * units.thermal_energy, atoms.capacities)
    return Concentrations(atoms.concentrations) if "tdpd" in names else None


def internal_scale(state: DeckState) -> float:
    """Mean internal temperature as an energy (kJ/mol), 0 if beads have none: the scale of kT where no thermostat sets one."""
    names = [style.name for style in state.pair.styles]
    for name, values in (("dpd/fdt/energy", state.atoms.thetas), ("edpd", state.atoms.temperatures)):
        if name in names and len(values):
            return float(values.mean()) * state.units.thermal_energy
    return 0.0


def equations_of_state(state: DeckState) -> dict[str, EquationOfState]:
    """Equation of state of each bead type; DeckError if a bead has none or two, or beads of one type have different ones."""
    fixes = state.fixes_of(*EOS_FIXES)
    owner = np.full(len(state.atoms), -1)
    for k, fix in enumerate(fixes):
        members = state.group(fix.group)
        twice = members & (owner >= 0)
        if twice.any():
            bead = int(np.argmax(twice))
            other = fixes[owner[bead]].name
            raise fix.error(f"bead {state.atoms.ids[bead]} has an equation of state from fix {other} already; it can have one only")
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
                raise fix.error(f"beads of type {kind} have another equation of state by fix {used[0].name}; give them types of their own")
        by_type[str(kind)] = (used or fixes)[0].parameters["eos"]
    return by_type


def sources_of(state: DeckState, box: np.ndarray) -> list[Source]:
    """Sources of heat or species; places are in the deck's coordinates, ``box`` has the scene's vectors (nm)."""
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
