"""Random decks of every area of commands, run by LAMMPS, live, and by this package: fixed seeds.  More by hand: ``python tests/decks/fuzz --help``."""

from collections.abc import Iterator

import lammps_peer
import pytest
from cases import cases
from fuzz.areas import AREAS
from fuzz.command_line import table
from fuzz.compare import differences
from fuzz.interruptions import Interruptions
from fuzz.trial import FAILURES, Trial
from interrupted_runs import WITH_SIGNALS

DECKS = 120  # Decks of an area of weight 1.


@pytest.fixture(scope="module")
def trial(tmp_path_factory) -> Iterator[Trial]:
    lammps_peer.need()
    with Trial(tmp_path_factory.mktemp("fuzz")) as found:
        yield found


@pytest.mark.slow
@pytest.mark.parametrize("begin, end", [(0.0, 0.3), pytest.param(0.3, 1.0, marks=pytest.mark.long)])
@pytest.mark.parametrize("area", AREAS)
def test_random_decks_agree_or_are_refused(trial, area, begin, end):
    all_of_them = DECKS * AREAS[area][0]
    found = [trial.of(seed, area) for seed in range(round(begin * all_of_them), round(end * all_of_them))]
    failed = [str(outcome) for outcome in found if outcome.kind in FAILURES]
    assert not failed, "\n\n".join(failed)
    agreed = sum(outcome.kind == "agree" for outcome in found)
    # decks with a mistake are refused by both as a rule; of the others most must run, or nothing is compared
    assert agreed >= (0.02 if area == "mistakes" else 0.5) * len(found), table(found)


@pytest.mark.parametrize("area", ["flow", "minimizing", "restarts"])
def test_a_few_random_decks(trial, area):
    """A second of those of above."""
    found = [trial.of(seed, area) for seed in range(8)]
    assert not [str(outcome) for outcome in found if outcome.kind in FAILURES]
    assert sum(outcome.kind == "agree" for outcome in found) >= 6, table(found)


@pytest.mark.slow
@WITH_SIGNALS[0]
@WITH_SIGNALS[1]
def test_random_decks_that_are_interrupted_go_on_bit_for_bit(tmp_path):
    """Twenty of all areas; more by hand with ``--resume``."""
    areas = [*AREAS, "averages", "runs", "control"]
    with Interruptions(tmp_path / "decks") as interruptions:
        found = [interruptions.of(seed, area) for seed, area in enumerate(areas)]
    assert not [str(outcome) for outcome in found if outcome.kind in FAILURES]
    assert sum(outcome.kind == "agree" for outcome in found) >= 12, table(found)


@cases(
    "lammps, ours, differs",
    ("1 2.5", "1 2.5", False),
    ("1 2.5", "1 2.5000000001", False),
    ("1 2.5", "1 2.50000003", True),
    ("0 1e-13", "0 0", False),
    ("0 1e-6", "0 0", True),
    ("Step Temp", "Step temp", True),
    ("1 2\n3 4", "1 2", True),
    ("1 2", "1 2 3", True),
    ("nan", "nan", False),
    ("nan", "1", True),
)
def test_texts_differ_where_words_or_numbers_do(lammps, ours, differs):
    assert bool(differences(lammps, ours)) == differs


def test_a_bead_at_a_face_may_stand_at_either_end():
    titles = "ITEM: ATOMS id x y z xs ys zs xu yu zu ix iy iz\n"
    one = titles + "1 0 1 1 0 0.25 0.25 4 1 1 1 0 0"
    other = titles + "1 4 1 1 1 0.25 0.25 4 1 1 0 0 0"
    assert not differences(one, other)
    assert differences(one, other.replace(" 4 1 1 0 0 0", " 8 1 1 1 0 0"))
