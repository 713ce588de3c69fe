"""Decks with a mistake: what LAMMPS refuses must not pass here."""

from ..deck import Deck
from ..draw import SPOILED, Draw
from .averages import averages
from .bonded import bonded
from .flow import flow
from .pairs import pairs
from .runs import runs
from .setup import setup


def mistakes(draw: Draw) -> Deck:
    """A deck of another area with one line spoiled: a word less, a word twice, a number that is none, a line less."""
    deck = draw.pick([averages, bonded, flow, pairs, runs, setup, setup])(draw)
    # what has no meaning here is not looked at
    kept = ("print", "run", "comm_modify", "neighbor", "neigh_modify", "atom_modify", "dump_modify")
    at = draw.pick([k for k, line in enumerate(deck.lines) if not line.startswith(kept)])
    words = deck.lines[at].split()
    numbers = [k for k, word in enumerate(words) if k and word.lstrip("+-").replace(".", "", 1).isdigit()]
    k = draw.whole(1, len(words) - 1) if len(words) > 1 else 0
    kind = draw.random()
    if kind < 0.55 and numbers:
        k = draw.pick(numbers)
        words[k] = draw.pick(SPOILED).replace("{}", words[k])
    elif kind < 0.7:
        del words[k]
    elif kind < 0.8:
        words.insert(k, words[k])
    elif kind < 0.9:
        words[k] = words[k][:-1] + draw.pick("xX1_-")
    else:
        words = []
    deck.lines[at] = " ".join(words)
    return deck
