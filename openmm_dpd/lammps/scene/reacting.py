"""Bonds that ``fix bond/create`` and ``fix bond/break`` make and break: from the deck to reactions, and back."""

import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...kernels.formed import ARMS, FORMED, bonds_in, both_ways, left_of, of_sorts
from ...kernels.reactions import counts_in
from ...model.bonds import HarmonicBonds
from ...model.reactions import BondBreaking, BondFormation, ReactiveBonds
from ..language.lexer import errors_at, located
from ..state.deck_state import DeckState
from ..state.records import FORMING, NO_LIMIT, REACTING, Fix
from ..styles.words import bonded_styles
from .flow import depends_on

#: Terms that come and go with bonds, and the number of their beads.
_TERMS = (("angle", 3), ("dihedral", 4), ("improper", 4))
_FLAT = ("none", "zero")


def reacting_types(state: DeckState) -> list[int]:
    """Bond types that fixes make and break, in the order of the fixes."""
    return list(dict.fromkeys(fix.parameters["bond"] for fix in state.fixes_of(*REACTING)))


def at_start(state: DeckState, what: str) -> np.ndarray:
    """Bonds, angles, ... at the start of the present or the next run: a type and ids of beads."""
    return state.before.get(what, getattr(state, f"{what}s"))


def _sorts(state: DeckState) -> list[tuple[int, str]]:
    """Sorts of bonds by type and name of the fix that makes them ("" without one), in the order of the fixes: each counts for itself."""
    return list(dict.fromkeys((fix.parameters["bond"], _maker(state, fix)) for fix in state.fixes_of(*REACTING)))


def _makers(state: DeckState, kind: int) -> list[str]:
    return [fix.name for fix in state.fixes_of(*FORMING) if fix.parameters["bond"] == kind]


def _maker(state: DeckState, fix: Fix) -> str:
    return fix.name if fix.style in FORMING else (*_makers(state, fix.parameters["bond"]), "")[0]


def noted(state: DeckState) -> dict[str, tuple[np.ndarray, np.ndarray] | None]:
    """What fixes that make bonds know, None before their first run: ids of the beads of their bonds (B, 2), and once more for each other
    bond that they count."""
    return {fix.name: fix.parameters.get("noted") for fix in state.fixes_of(*FORMING)}


def _bonds(state: DeckState, kind: int, maker: str = "") -> tuple[np.ndarray, np.ndarray]:
    """What :func:`noted` has of a sort of bonds, at the start of a run.  The first maker has those of the type that no other one has made;
    in its first run a fix counts all that there are."""
    bonds, known, others = at_start(state, "bond"), state.before.get("noted", noted(state)), _makers(state, kind)[1:]
    pairs = np.unique(np.sort(bonds[bonds[:, 0] == kind, 1:], axis=1), axis=0)
    made = [its[0] for name in ([maker] if maker in others else others) if (its := known[name]) is not None]
    mine = np.isin(pairs @ [1 << 32, 1], np.concatenate([np.zeros((0, 2), int), *made]) @ [1 << 32, 1]) == (maker in others)
    return pairs[mine], pairs[~mine].ravel() if known.get(maker) is None else known[maker][1]


def _going(state: DeckState, what: str, kinds: Sequence[int] | None = None) -> np.ndarray:
    """Which angles, dihedrals or impropers at the start have a bond of some types, or that fixes break: they go with it."""
    kinds = [fix.parameters["bond"] for fix in state.fixes_of("bond/break")] if kinds is None else kinds
    bonds, terms = at_start(state, "bond"), at_start(state, what).astype(np.int64)
    pairs = bonds[np.isin(bonds[:, 0], kinds), 1:].astype(np.int64)
    known = [*(pairs @ [1 << 32, 1]), *(pairs @ [1, 1 << 32])]
    return np.any([np.isin(terms[:, 1 + a] * (1 << 32) + terms[:, 1 + b], known) for a, b in ARMS[what]], axis=0)


def lasting(state: DeckState, what: str) -> np.ndarray:
    """Bonds, angles, ... that are there at the start of a run and stay."""
    terms = at_start(state, what)
    return terms[~(np.isin(terms[:, 0], reacting_types(state)) if what == "bond" else _going(state, what))]


def bonded_terms(state: DeckState, what: str, terms: np.ndarray) -> list:
    """Bonds, angles, ... by type, of rows with a type and ids of beads.  Bonds without energy are kept, since they count for
    special_bonds; other terms without energy are left out."""
    setup, known, found = getattr(state, what), bonded_styles(what), []
    for kind in np.unique(terms[:, 0]).tolist():
        style: str = "none"
        values: dict[str, float] = {}
        if setup.style not in ("none", "zero") and kind > 0:
            if kind not in setup.coefficients:
                raise located(setup.where, f"no {what}_coeff for {what} type {kind} ({what}_style {setup.style})")
            style, values = setup.coefficients[kind]
        ids = terms[terms[:, 0] == kind, 1:]
        beads = state.atoms.index_of(ids.ravel()).reshape(ids.shape)
        if style not in ("none", "zero"):
            found.append(known[style].build(beads, values))
        elif what == "bond":
            found.append(HarmonicBonds(beads, np.zeros(len(beads)), np.zeros(len(beads))))
    return found


def _left(state: DeckState) -> list[str]:
    """Terms that come with bonds and of which there are none at the start of a run."""
    makers = [fix.parameters for fix in state.fixes_of(*FORMING)]
    return [what for what, _ in _TERMS if any(its[what] for its in makers) and not len(at_start(state, what))]


def _held(state: DeckState, fix: Fix) -> int:
    """A number that depends on all beads and on the bonds of a sort at the start of a run."""
    pairs, _ = _bonds(state, fix.parameters["bond"], _maker(state, fix))
    return zlib.crc32(np.concatenate([state.atoms.ids, pairs.ravel()]).tobytes())


def _third(state: DeckState, fix: Fix) -> bool:
    """Whether beads that have two bonds or more at the start of a run may get another one."""
    (one, other), (mine, counted) = fix.parameters["types"], _bonds(state, fix.parameters["bond"], _maker(state, fix))
    ids, types, last = state.atoms.ids, state.atoms.types, 1 + state.atoms.ids.max(initial=0)
    bonds, made = (np.bincount(its, minlength=last)[ids] for its in (at_start(state, "bond")[:, 1:].ravel(), [*mine.ravel(), *counted]))
    react = np.isin(types, (one, other)) | any(its.parameters["becomes"] is not None for its in state.fixes_of(*FORMING))
    return bool((react & (bonds > 1) & (made < np.where(types == one, *fix.parameters["most"]))).any())


def _whole(state: DeckState, fix: Fix) -> bool:
    """Whether the group of a fix leaves out no bead that it could act on, also after beads have changed their types."""
    joined = np.isin(state.atoms.types, [kind for its in state.fixes_of(*FORMING) for kind in its.parameters["types"]])
    if fix.style == "bond/break":
        bonds = at_start(state, "bond")
        joined |= np.isin(state.atoms.ids, bonds[bonds[:, 0] == fix.parameters["bond"], 1:])
    return not (joined & ~state.group(fix.group)).any()


def _by_types(state: DeckState) -> bool:
    scales = [fix.parameters[key] for fix in state.fixes.values() for key in ("gammas", "ratios") if key in fix.parameters]
    forces = [word for fix in state.fixes.values() for word in fix.parameters.get("force", ())]
    return any(np.ptp(each) > 0 for each in scales) or any(depends_on(word, state.variables, {"type"}) for word in forces)


def reactions_of(state: DeckState, step: int) -> list[BondFormation | BondBreaking]:
    """The reactions of a run that begins at a step.  DeckError where a fix cannot act as in LAMMPS."""
    fixes, sorts, found = state.fixes_of(*REACTING), dict[tuple[int, str], ReactiveBonds](), list[BondFormation | BondBreaking]()
    terms: dict[tuple[str, int], Any] = {}
    for fix in fixes:
        given, kind, maker = fix.parameters, fix.parameters["bond"], _maker(state, fix)
        reasons = {
            "its group must hold all beads of the types that fix bond/create joins, and of bonds that break": not _whole(state, fix),
            "a factor 0 of special_bonds lj needs one of coul: only then does LAMMPS leave such beads alone": any(
                f == 0 and q != 0 for f, q in zip(state.special, state.special_charges, strict=True)
            ),
            f"bond type {kind} has no coefficients": kind not in state.bond.coefficients,
            "it cannot be combined with fix npt, whose pressure leaves out bonds that form and break": bool(state.fixes_of("npt")),
            "neigh_modify exclude is not supported beside it": bool(state.exclusions),
            "angles and the like of bonds that are made again are not supported": (
                fix.style == "bond/break" and bool(maker) and any(_going(state, what, [kind]).any() for what, _ in _TERMS)
            ),
            "LAMMPS keeps angles and the like of bonds that break, unless there are others of them at the start of the run": (
                fix.style == "bond/break" and bool(_left(state))
            ),
            f"several fixes make bonds of type {kind}, and each counts them for itself": fix.name != maker
            and len(_makers(state, kind)) > 1,
            "beads with two bonds at the start of a run may get a third: LAMMPS's own lists have the first for aconstrain and itype": (
                bool(given.get("between") or given.get("improper")) and _third(state, fix)
            ),
            "beads with charges cannot change their types": given.get("becomes") is not None
            and any("cutoff_charges" in style.settings for style in state.pair.styles)
            and bool(np.isin(given["types"], state.atoms.types[state.atoms.charges != 0]).any()),
            "friction and forces that depend on types are not supported beside beads that change them": given.get("becomes") is not None
            and _by_types(state),
            "chunks of types that are found once are not supported beside beads that change them": given.get("becomes") is not None
            and any(its.style == "chunk/atom" and {"type", "once"} <= {*its.arguments} for its in state.computes.values()),
            f"beads or bonds of type {kind} were added or removed after a run, which changes no count for maxbond in LAMMPS; define it "
            "anew": (given.get("held", now := _held(state, fix)) != now),
        }
        for reason in (reason for reason, holds in reasons.items() if holds):
            raise fix.error(reason)
        # LAMMPS makes none without a style
        formed = [(what, given[what], width) for what, width in _TERMS if given.get(what) and getattr(state, what).style not in _FLAT]
        for what, number, _ in formed:
            if number not in getattr(state, what).coefficients:
                raise fix.error(f"{what} type {number} has no coefficients")
        with errors_at(fix.where, f"fix {fix.name}: "):
            if (kind, maker) not in sorts:
                style, values = state.bond.coefficients[kind]
                if style in _FLAT:
                    raise ParameterError(f"bonds of style {style} have no energy")
                bond = bonded_styles("bond")[style].build(np.array([[0, 1]]), values)
                values, place = {name: getattr(bond, name)[0] for name in bond._DIMENSIONS}, state.atoms.index_of
                its, counted = _bonds(state, kind, maker)
                sorts[kind, maker] = ReactiveBonds(type(bond), values, place(its.ravel()).reshape(-1, 2), place(counted))
            for what, number, width in formed:
                style, values = getattr(state, what).coefficients[number]
                if (what, number) not in terms and style not in _FLAT:
                    terms[what, number] = bonded_styles(what)[style].build(np.arange(width)[None], values)
            trials = {"probability": given["probability"], "every": given["every"], "start": -step % given["every"]}
            length = given["length"] * state.units.length
            if fix.style in FORMING:
                one, other = map(str, given["types"])
                later = {"becomes": given["becomes"], "between": given["between"], "first": given["between"] is not None}
                if given["molecule"] != "off":
                    later |= {"molecules": state.atoms.molecules.copy(), "inside": given["molecule"] == "intra"}
                later |= {what: terms.get((what, number)) for what, number, _ in formed}
                found.append(BondFormation(sorts[kind, maker], (one, other), length, given["most"], **later, **trials))
            else:
                # places of bonds that have broken are not used again, as the first one of a bead has to be known
                spends = bool(maker) or any(its.parameters.get("between") or its.parameters.get("improper") for its in fixes)
                taken = [(what, at_start(state, what)[_going(state, what)]) for what, _ in _TERMS if fix is state.fixes_of("bond/break")[0]]
                takes = [term for what, rows in taken for term in bonded_terms(state, what, rows)]
                found.append(BondBreaking(sorts[kind, maker], length, spends=spends, takes=takes, **trials))
    return found


def take_bonds(state: DeckState, table: np.ndarray, types: Sequence[str]) -> None:
    """Give the deck the bonds of a table, see :mod:`openmm_dpd.kernels.reactions`, the angles and dihedrals that have come with them, and
    the types of the beads."""
    sorts, place, n = _sorts(state), state.atoms.index_of, len(state.atoms)
    first = of_sorts([place(_bonds(state, *sort)[0].ravel()).reshape(-1, 2) for sort in sorts], n)
    rows = [state.bonds[~np.isin(state.bonds[:, 0], [kind for kind, _ in sorts])]]
    for k, (kind, maker) in enumerate(sorts):
        counts = counts_in(table, k)
        if maker and state.fixes[maker].parameters["unlimited"] and counts.max() >= NO_LIMIT:
            what = f"bead {state.atoms.ids[counts.argmax()]} has {NO_LIMIT} bonds, more than are possible here without maxbond; give one"
            raise state.fixes[maker].error(what)
        ids = np.sort(state.atoms.ids[bonds_in(table, k).astype(np.int64)], axis=1)
        rows.append(np.column_stack([np.full(len(ids), kind), ids]))
        if maker:
            state.fixes[maker].parameters["noted"] = ids, np.repeat(state.atoms.ids, (table == -1 - k).sum(axis=1))
    state.bonds, state.atoms.types = np.concatenate(rows), np.array([*map(int, types)])
    start = both_ways(place(at_start(state, "bond")[:, 1:].ravel()).reshape(-1, 2), n)
    for what, width in _TERMS:
        its = at_start(state, what)[_going(state, what)]
        its = its[left_of(what, place(its[:, 1:].ravel()).reshape(-1, width), first, table)]
        setattr(state, f"{what}s", np.concatenate([lasting(state, what), its]))
        number = next((fix.parameters[what] for fix in state.fixes_of(*FORMING)), 0)
        if number and getattr(state, what).style != "none":
            ids = state.atoms.ids[FORMED[what](table, start).astype(np.int64)]
            setattr(state, f"{what}s", np.concatenate([getattr(state, f"{what}s"), np.column_stack([np.full(len(ids), number), ids])]))


def keep_reacted(state: DeckState, reacted: dict[str, list[float]]) -> None:
    """Note at the end of a run the values of the fixes, and what those that make bonds have counted."""
    for name, values in reacted.items():
        state.fixes[name].parameters["counts"] = values[1:]
    for fix in state.fixes_of(*FORMING):
        fix.parameters["held"] = _held(state, fix)


def reacted_values(state: DeckState, reacted: np.ndarray, step: int, first: int) -> dict[str, list[float]]:
    """Values of the fixes at a step of a run: bonds changed by the last trial, and since the fix was made, from those that the reactions
    have changed since the first step, (R, 3)."""
    found = {}
    for fix, (made, broken, last) in zip(state.fixes_of(*REACTING), reacted.tolist(), strict=True):
        before, every = fix.parameters["counts"], fix.parameters["every"]
        found[fix.name] = [0.0, float(last if step // every > first // every else before[0]), float(before[1] + made + broken)]
    return found
