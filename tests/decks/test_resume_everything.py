"""Every compute, fix, output style, variable style and command: interrupted at random moments and resumed, all files bit for bit."""

import zlib

import pytest
from deck_snippets import FILES, SNIPPETS, TABLES, WORDS
from decks.fuzz.deck import Deck
from decks.fuzz.draw import Draw
from decks.fuzz.interruptions import Interruptions
from interrupted_runs import WITH_SIGNALS

pytestmark = WITH_SIGNALS


@pytest.mark.parametrize("kind", TABLES)
def test_there_is_a_deck_for_all_that_decks_may_have(kind):
    assert (WORDS if kind == "command" else set(SNIPPETS[kind])) == TABLES[kind]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in SNIPPETS for name in SNIPPETS[kind]], ids=lambda word: word)
def test_what_is_interrupted_goes_on_bit_for_bit(tmp_path, kind, name):
    text = SNIPPETS[kind][name]
    stages = [SNIPPETS[kind]["write_restart"], text] if name == "read_restart" else [text]
    made = Deck(Draw(0), stages=[], files=FILES)
    made.stages = [stage.splitlines() for stage in stages]
    outcome = Interruptions(tmp_path / "decks").of_deck(zlib.crc32(name.encode()), kind, made)
    assert outcome.kind == "agree", str(outcome)
