"""Words of other versions of LAMMPS, and what concerns LAMMPS alone, beside a live LAMMPS: same rows, same files."""

from collections.abc import Iterator

import lammps_peer
import pytest
from cases import cases, put, raises
from fuzz.deck import Deck
from fuzz.draw import Draw
from fuzz.trial import Trial
from test_commands_live import BEADS, FRAMES, RUN

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import check_deck, read_deck

SYSTEM = BEADS.format(units="lj", box="block -1 3 0 4 0 5")
#: What stands in a deck, and what LAMMPS is given in its place.
OLD = {
    "suffixes": ("pair_style dpd/omp 0 1.2 3", "pair_style dpd 0 1.2 3"),
    "communicate": ("communicate single vel yes", "comm_modify mode single vel yes"),
    "ave/spatial": (
        "fix s g ave/spatial 1 2 4 x lower 1.1 z lower 2 vx density/number units box ave running file s.txt",
        "compute s_spatial g chunk/atom bin/2d x lower 1.1 z lower 2 units box\n"
        "fix s g ave/chunk 1 2 4 s_spatial vx density/number ave running file s.txt",
    ),
}
SWEEP = f"""clear
variable k loop 3
label again
clear
{SYSTEM.replace("create_atoms 2 single 2.3 3.4 1.5 units box", 'if "$k > 1" then "create_atoms 2 single 2.3 3.4 1.5 units box"')}
velocity all scale $k
shell mkdir at.$k there
shell cd at.$k
dump d all custom 5 frames.txt id type x vx
dump e all custom 5 *.txt id type x vx
dump_modify e sort id format float %.15g pbc yes
fix t all ave/time 1 2 5 c_thermo_temp file t.txt
write_dump all custom first.txt id x modify sort id
shell cd ../there
dump_modify d sort id format float %.15g pbc yes
print "step $(step) of system $k, $(count(all)) beads" append said.txt
{RUN}
write_data kept.data
shell cd ..
next k
jump SELF again
clear
pair_style dpd 0.0 1.2 3
read_data there/kept.data
pair_coeff 1 2 20 0.5
comm_modify vel yes
fix 1 all nve
timestep 0.01
thermo 5
{FRAMES}
{RUN}
"""
DECKS = {
    **{name: (SYSTEM + new + "\n" + FRAMES + RUN, {new: old}) for name, (old, new) in OLD.items()},
    "clear": (SWEEP, {}),
    "respa": (SYSTEM + "run_style respa 2 1\n" + RUN, {}),
    "balance": (SYSTEM + "balance 1.1 shift x 5 1.1\nfix b all balance 5 1.1 shift x 5 1.1\n" + RUN + "unfix b\n" + RUN, {}),
}
SUFFIXES = {"fix 1 all nve": "fix 1 all nve/kk", "pair_style dpd": "pair_style hybrid dpd/gpu", "* * 25": "* * dpd/opt 25"}
DECKS["more suffixes"] = (SYSTEM + RUN, SUFFIXES)


@pytest.fixture(scope="module")
def trial(tmp_path_factory) -> Iterator[Trial]:
    lammps_peer.need()
    with Trial(tmp_path_factory.mktemp("words")) as found:
        yield found


@cases("text, ours", DECKS)
def test_both_programs_write_the_same(trial, text, ours):
    deck = Deck(Draw(1))
    deck.lines[:], deck.ours = text.splitlines(), ours
    outcome = trial.of_deck(0, "words", deck)
    assert outcome.kind == "agree", outcome.message


REFUSED = {
    "shell": ("shell rm x\n", "only cd, mkdir and echo; decks cannot run programs"),
    "outside": ("shell cd ..\n", "would lie outside the output folder"),
    "far outside": ("shell mkdir a/../../b\n", "would lie outside the output folder"),
    "respa": ("run_style respa 2 4 bond 1 pair 2\n", "or respa whose levels have the same step, is supported, not 'respa 2 4 bond"),
    "suffix of what there is not": ("fix 2 all langevn/kk 1 1 1 7\n", "fix style 'langevn' is not supported"),
    "group of communicate": ("communicate single group g\n", "comm_modify group must be all"),
    "ave/spatial": ("fix 2 all ave/spatial 1 2\n", "fix ave/spatial needs 3 values"),
}


@cases("text, message", REFUSED)
def test_refused(tmp_path, text, message):
    raises(DeckError, message, read_deck, put(tmp_path / "in.deck", SYSTEM + text), output=tmp_path / "out")


def test_one_note_for_each(tmp_path):
    text = (
        "".join(f"{old}\n" for old, _ in OLD.values()).replace("pair_style dpd/omp", "fix 2 g setforce/kk")
        + "balance 1 shift x 1 1\nrun 0\n"
    )
    notes = [found.message for found in check_deck(put(tmp_path / "in.deck", "clear\n" + SYSTEM + text)) if found.kind == "note"]
    expected = "atom_modify neigh_modify styles communicate comm_modify fix balance"
    assert sorted(note.partition(" ")[0] for note in notes) == sorted(expected.split()), notes
