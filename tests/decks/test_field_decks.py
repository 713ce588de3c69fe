"""Decks in the manner of those that people publish: they run as in LAMMPS, live, or are refused for the reason that is listed."""

import re
from collections.abc import Iterator

import lammps_peer
import pytest
from field_decks import DECKS, REFUSED
from fuzz.deck import MARK, Deck
from fuzz.draw import Draw
from fuzz.trial import Trial


@pytest.fixture(scope="module")
def trial(tmp_path_factory) -> Iterator[Trial]:
    lammps_peer.need()
    with Trial(tmp_path_factory.mktemp("field")) as found:
        yield found


@pytest.mark.parametrize("name", DECKS)
def test_it_runs_as_in_lammps_or_is_refused_with_the_reason(trial, name):
    text = re.sub(r"(?m)^(run\b)", f'print "{MARK}"\n\\1', DECKS[name].text)
    found = trial.of_deck(0, name, Deck(Draw(0), lines=text.splitlines(), files=DECKS[name].files, accuracy=DECKS[name].accuracy))
    reason = next((said for said, names in REFUSED.items() if name in names), None)
    assert found.kind == ("agree" if reason is None else "ours refuses"), str(found)
    assert reason is None or reason in found.message


def test_refused_decks_exist():
    refused = [name for names in REFUSED.values() for name in names]
    assert set(refused) <= set(DECKS) and len(set(refused)) == len(refused)
