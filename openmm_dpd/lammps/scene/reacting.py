"""Bonds that ``fix bond/create`` and ``fix bond/break`` make and break: from the deck to reactions, and back."""

import zlib

import numpy as np

from ...base.errors import ParameterError
from ...kernels.reactions import angles_in, bonds_in, both_ways
from ...model.angles import Angles
from ...model.reactions import BondBreaking, BondFormation, ReactiveBonds
from ..language.lexer import errors_at
from ..state.deck_state import DeckState
from ..state.records import REACTING
from ..styles.words import bonded_styles


def reacting_types(state: DeckState) -> list[int]:
    """Bond types that fixes make and break, in the order of the fixes."""
    return list(dict.fromkeys(fix.parameters["bond"] for fix in state.fixes_of(*REACTING)))


def at_start(state: DeckState, what: str) -> np.ndarray:
    """Bonds, angles, ... at the start of the present or the next run: a type and ids of beads."""
    return state.before.get(what, getattr(state, f"{what}s"))


def _pairs(state: DeckState, kind: int) -> np.ndarray:
    """Beads (B, 2) of the bonds of a type at the start of a run."""
    bonds = at_start(state, "bond")
    return state.atoms.index_of(bonds[bonds[:, 0] == kind, 1:].ravel()).reshape(-1, 2)


def _turns(state: DeckState, kind: int) -> bool:
    """Whether a bead of a bond of this type is in an angle, a dihedral or an improper, which LAMMPS takes away with the bond."""
    terms = [terms[:, 1:].ravel() for terms in (at_start(state, "angle"), state.dihedrals, state.impropers)]
    return bool(np.isin(state.atoms.ids[_pairs(state, kind)], np.concatenate(terms)).any())


def _held(state: DeckState, kind: int) -> int:
    """A number that depends on all beads and on the bonds of a type at the start of a run."""
    bonds = at_start(state, "bond")
    pairs = np.unique(np.sort(bonds[bonds[:, 0] == kind, 1:], axis=1), axis=0)
    return zlib.crc32(np.concatenate([state.atoms.ids, pairs.ravel()]).tobytes())


def reactions_of(state: DeckState, step: int) -> list[BondFormation | BondBreaking]:
    """The reactions of a run that begins at a step.  DeckError where a fix cannot act as in LAMMPS."""
    fixes, sorts, found = state.fixes_of(*REACTING), dict[int, ReactiveBonds](), list[BondFormation | BondBreaking]()
    angles: dict[int, Angles | None] = {0: None}
    made = {fix.parameters["bond"] for fix in fixes if fix.style == "bond/create"}
    for fix in fixes:
        given, kind = fix.parameters, fix.parameters["bond"]
        reasons = {
            "its group must be all": fix.group != "all",
            "a factor 0 of special_bonds lj needs one of coul: only then does LAMMPS leave such beads alone": any(
                f == 0 and q != 0 for f, q in zip(state.special, state.special_charges, strict=True)
            ),
            f"bond type {kind} has no coefficients": kind not in state.bond.coefficients,
            "it cannot be combined with fix npt, whose pressure leaves out bonds that form and break": bool(state.fixes_of("npt")),
            "neigh_modify exclude is not supported beside it": bool(state.exclusions),
            "angles and the like of bonds that break are not supported": fix.style == "bond/break" and _turns(state, kind),
            "bonds were broken in a run before, which count for maxbond in LAMMPS; put both into one run": given.get("spent", False),
            f"beads or bonds of type {kind} were added or removed after a run, which changes no count for maxbond in LAMMPS; define it "
            "anew": (given.get("held", now := _held(state, kind)) != now),
        }
        for reason in (reason for reason, holds in reasons.items() if holds):
            raise fix.error(reason)
        bend = given.get("angle", 0) if state.angle.style not in ("none", "zero") else 0  # LAMMPS makes none without a style
        if bend not in angles and bend not in state.angle.coefficients:
            raise fix.error(f"angle type {bend} has no coefficients")
        with errors_at(fix.where, f"fix {fix.name}: "):
            if kind not in sorts:
                style, values = state.bond.coefficients[kind]
                if style in ("none", "zero"):
                    raise ParameterError(f"bonds of style {style} have no energy")
                bond = bonded_styles("bond")[style].build(np.array([[0, 1]]), values)
                sorts[kind] = ReactiveBonds(type(bond), {name: getattr(bond, name)[0] for name in bond._DIMENSIONS}, _pairs(state, kind))
            if bend not in angles:
                style, values = state.angle.coefficients[bend]
                flat = style in ("none", "zero")
                angles[bend] = None if flat else bonded_styles("angle")[style].build(np.array([[0, 1, 2]]), values)
            trials = {"probability": given["probability"], "every": given["every"], "start": -step % given["every"]}
            length = given["length"] * state.units.length
            if fix.style == "bond/create":
                one, other = map(str, given["types"])
                found.append(BondFormation(sorts[kind], (one, other), length, given["most"], angle=angles[bend], **trials))
            else:
                found.append(BondBreaking(sorts[kind], length, spends=kind in made, **trials))
    return found


def take_bonds(state: DeckState, table: np.ndarray) -> None:
    """Give the deck the bonds of a table, see :mod:`openmm_dpd.kernels.reactions`, and the angles that have come with them."""
    kinds = reacting_types(state)
    rows = [state.bonds[~np.isin(state.bonds[:, 0], kinds)]]
    for k, kind in enumerate(kinds):
        ids = state.atoms.ids[bonds_in(table, k).astype(np.int64)]
        rows.append(np.column_stack([np.full(len(ids), kind), ids]))
    state.bonds = np.concatenate(rows)
    bend = next((fix.parameters["angle"] for fix in state.fixes_of("bond/create")), 0)
    if bend and state.angle.style != "none":
        there = at_start(state, "bond")[:, 1:]
        start = both_ways(state.atoms.index_of(there.ravel()).reshape(-1, 2), len(state.atoms))
        ids = state.atoms.ids[angles_in(table, start).astype(np.int64)]
        state.angles = np.concatenate([at_start(state, "angle"), np.column_stack([np.full(len(ids), bend), ids])])


def keep_reacted(state: DeckState, reacted: dict[str, list[float]]) -> None:
    """Note at the end of a run the values of the fixes, where bonds have been broken that the fix which makes them goes on counting, and
    what it has counted."""
    for name, values in reacted.items():
        state.fixes[name].parameters["counts"] = values[1:]
    broken = {fix.parameters["bond"] for fix in state.fixes_of("bond/break") if fix.parameters["counts"][1]}
    for fix in state.fixes_of("bond/create"):
        given, kind = fix.parameters, fix.parameters["bond"]
        given |= {"spent": given.get("spent", False) or kind in broken, "held": _held(state, kind)}


def reacted_values(state: DeckState, reacted: np.ndarray, step: int, first: int) -> dict[str, list[float]]:
    """Values of the fixes at a step of a run: bonds changed by the last trial, and since the fix was made, from those that the reactions
    have changed since the first step, (R, 3)."""
    found = {}
    for fix, (made, broken, last) in zip(state.fixes_of(*REACTING), reacted.tolist(), strict=True):
        before, every = fix.parameters["counts"], fix.parameters["every"]
        found[fix.name] = [0.0, float(last if step // every > first // every else before[0]), float(before[1] + made + broken)]
    return found
