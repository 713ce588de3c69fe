"""All pair styles.  Each file defines how its styles read and write their arguments, and which pair term of the model they become.

A style is one entry of ``STYLES`` in its file; the commands in ``commands/interactions.py`` do not refer to any style by name.
:func:`pair_tables` makes the tables of a scene.
"""

from dataclasses import replace

import numpy as np

from ...model.pairs import NONE, PairTable
from ..language import arguments as read
from ..language.lexer import errors_at, located
from ..state.deck_state import DeckState
from ..state.pair_setup import Coefficient, PairStyle, Spec
from . import charges, dpd, meso, radial, srp
from .words import Exports, cutoff_of, no_force


def _zero_settings(words: list[str]) -> dict:
    read.count(words, "zero cutoff [nocoeff]", 1, 2)
    for word in words[1:]:
        read.choice(word, "the option of pair style zero", ("nocoeff",))
    return {"cutoff": read.positive(words[0], "the cutoff of zero")}


#: Files of styles.
_FILES = (dpd, meso, radial, charges, srp)
#: Pair styles by name.
PAIR_STYLES: dict[str, Spec] = {name: spec for file in _FILES for name, spec in file.STYLES.items()} | {
    "zero": Spec(_zero_settings, lambda style, words, find: ({}, cutoff_of(words, 0)), no_force)
}
#: Export functions, by the kind of a scene's table.
EXPORTS: Exports = {kind: export for file in _FILES for kind, export in getattr(file, "EXPORTS", {}).items()}


#: Coefficients of one pair style by type pair.
Table = dict[tuple[int, int], Coefficient]


def pair_tables(state: DeckState) -> list[PairTable]:
    """One table of pair terms per pair style.  DeckError if a type pair is unset, a style unused, or a cutoff longer than half the box."""
    setup = state.pair
    if setup.mode == "none":
        state.note("pair_style none: beads do not interact")
        return [PairTable({("*", "*"): NONE})]
    tables, missing = setup.resolve(state.n_types)
    if missing:
        listing = ", ".join(f"{i} {j}" for i, j in missing[:10]) + (" ..." if len(missing) > 10 else "")
        names = ", ".join(style.name for style in setup.styles)
        raise located(
            setup.where,
            f"no pair coefficients for type pair{'s' * (len(missing) > 1)} {listing} (pair style {names}); "
            "add a pair_coeff line, or 'pair_coeff i j none' if they do not interact",
        )
    for style, table in zip(setup.styles, tables, strict=True):
        if not table:
            raise located(style.where, f"pair style {style.name} is used by no type pair")
    result = []
    between_bonds = set()
    for style, table in _with_densities(setup.styles, tables):
        if style.spec.of_bonds:
            between_bonds |= set(table)
            continue
        entries: dict = {}
        # a pair_coeff line with wildcards gives one coefficient for many pairs
        terms: dict[int, object] = {}
        for (i, j), coefficient in sorted(table.items()):
            if id(coefficient) not in terms:
                terms[id(coefficient)] = _term(state, style, (i, j), coefficient)
            entries[(str(i), str(j))] = terms[id(coefficient)]
        result.append(entries)
    result = result or [{}]
    for i, j in sorted(setup.excluded | between_bonds):
        result[0].setdefault((str(i), str(j)), NONE)
    return [PairTable(entries) for entries in result]


def _term(state: DeckState, style: PairStyle, pair: tuple[int, int], coefficient: Coefficient) -> object:
    """The pair term of a coefficient.  DeckError if a value is invalid or the cutoff too long."""
    where = coefficient.where or style.where
    if coefficient.adapted:  # what is 0 may change, so that the plan must not leave it out
        coefficient = replace(coefficient, values={name: value or 1e-300 for name, value in coefficient.values.items()})
    with errors_at(where, f"pair style {style.name}, types {pair[0]} {pair[1]}: "):
        term, remark = style.spec.build(style, coefficient, state.units)
    if remark:
        state.note(remark)
    length = state.units.length
    half = 0.5 * float(np.min(np.diag(state.require_box("a run").reduced_vectors))) * length
    cutoff = max(getattr(term, name, 0.0) for name in ("cutoff", "cutoff_T", "cutoff_c"))
    if cutoff > half * (1 + 1e-12):
        raise located(
            where,
            f"the cutoff {cutoff / length:g} of types {pair[0]} {pair[1]} exceeds half the box, {half / length:g}: "
            "a bead would interact with two periodic images of another. Use a larger box or a smaller cutoff",
        )
    return term


def _with_densities(styles: list[PairStyle], tables: list[Table]) -> list[tuple[PairStyle, Table]]:
    """Styles and their tables, with mdpd/rhosum merged into mdpd: its cutoffs become the cutoffs of the densities."""
    sums = [k for k, style in enumerate(styles) if style.name == "mdpd/rhosum"]
    many = [k for k, style in enumerate(styles) if style.name == "mdpd"]
    if not sums and not many:
        return list(zip(styles, tables, strict=True))
    for here, there, other in ((many, sums, "mdpd/rhosum"), (sums, many, "mdpd")):
        if here and len(there) != 1:
            count = f"{len(there)} of them" if there else "none"
            style = styles[here[0]]
            message = (
                f"pair style {style.name} needs one {other} beside it (pair_style hybrid/overlay mdpd/rhosum mdpd ...); there are {count}"
            )
            raise located(style.where, message)
    densities, forces = tables[sums[0]], tables[many[0]]
    for table, partner, lacking in ((densities, forces, "mdpd"), (forces, densities, "mdpd/rhosum")):
        alone = sorted(set(table) - set(partner))
        if alone:
            i, j = alone[0]
            raise located(table[alone[0]].where, f"types {i} {j} have no {lacking} coefficients; both styles need the same type pairs")
    merged = {pair: replace(found, values=found.values | {"cutoff_density": densities[pair].cutoff}) for pair, found in forces.items()}
    return [(style, merged if k == many[0] else tables[k]) for k, style in enumerate(styles) if k != sums[0]]
