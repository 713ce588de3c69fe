"""Smaller decks that still fail in the same way."""

from .deck import MARK, Deck
from .trial import Outcome, Trial

#: Lines without which two right programs would write different things.
_KEPT = (f'print "{MARK}', "dump_modify", "neigh_modify", "fix move", "fix 1 all nve", "thermo_modify temp", "atom_modify")


def shrunk(trial: Trial, outcome: Outcome, deck: Deck) -> Outcome:
    """The outcome of a deck without the lines that do not matter."""
    best = outcome
    again = True
    while again:
        again = False
        for stage in range(len(deck.stages)):
            for k in range(len(deck.stages[stage]) - 1, -1, -1):
                if deck.stages[stage][k].startswith(_KEPT):
                    continue
                line = deck.stages[stage].pop(k)
                found = trial.of_deck(outcome.seed, outcome.area, deck)
                if _sort(found) == _sort(outcome):
                    best, again = found, True
                else:
                    deck.stages[stage].insert(k, line)
    return best


def _sort(outcome: Outcome) -> tuple[str, str]:
    """What kind of failure it is, and in which file or with which error."""
    if outcome.kind == "difference":
        return outcome.kind, outcome.message.partition(":")[0]
    lines = outcome.message.splitlines() or [""]
    return outcome.kind, lines[-1] if outcome.kind == "crash" else lines[0].split("'")[0]
