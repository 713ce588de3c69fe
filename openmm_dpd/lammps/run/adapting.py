"""Pair coefficients that ``fix adapt`` takes from variables: at the start of a run, and at steps that are multiples of its interval."""

from dataclasses import replace

from ..language.lexer import errors_at
from ..state.deck_state import DeckState
from ..state.records import Fix
from ..values.resolver import Resolver

#: Values of coefficients by number of the pair style, types, and name.
Values = dict[tuple[int, tuple[int, int], str], float]


def put(state: DeckState, values: Values) -> None:
    """Change coefficients of the deck."""
    for (number, pair, name), value in values.items():
        found = state.pair.styles[number].coefficients
        found[pair] = replace(found[pair], values=found[pair].values | {name: value}, adapted=True)


def _present(fix: Fix, state: DeckState, word: str, name: str, first: range, second: range) -> Values:
    """The values that the deck has for a coefficient now."""
    style, _, which = word.partition(":")
    same = [number for number, each in enumerate(state.pair.styles) if each.name == style]
    if len(same) < int(which or 1) or (len(same) > 1 and not which):
        raise fix.error(
            f"the deck has {len(same)} pair styles {style}; expected {style}:N with the number of one, or {style} if it is alone"
        )
    number = same[int(which or 1) - 1]
    given = state.pair.styles[number].coefficients
    found = {(number, (i, j), name): given[i, j].values[name] for i, j in given if i in first and j in second}
    if not found:
        raise fix.error(f"no pair_coeff of style {word} has types {first[0]}:{first[-1]} and {second[0]}:{second[-1]}")
    return found


def begin(state: DeckState, moment: Resolver, run: int) -> None:
    """Set the coefficients of the first step of a run, unless that has been done."""
    for fix in state.fixes_of("adapt"):
        if fix.parameters.get("run") != run:
            fix.parameters["before"] = [(variable, _present(fix, state, *which)) for variable, *which in fix.parameters["pairs"]]
            fix.parameters["run"] = run
            adapt(fix, moment)


def adapt(fix: Fix, moment: Resolver) -> None:
    """Set the coefficients of a moment."""
    now: Values = {}
    with errors_at(fix.where, f"fix {fix.name}: "):
        for variable, before in fix.parameters["before"]:
            value = moment.number(variable)
            now |= {key: value * (old if fix.parameters["scale"] else 1.0) for key, old in before.items()}
    fix.parameters["now"] = now
    put(moment.state, now)


def end(state: DeckState) -> None:
    """Take the coefficients back after a run, where that is wanted."""
    for fix in state.fixes_of("adapt"):
        if fix.parameters["reset"]:
            fix.parameters["now"] = {key: value for _, before in fix.parameters["before"] for key, value in before.items()}
            put(state, fix.parameters["now"])
