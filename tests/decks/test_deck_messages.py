"""What goes wrong in a deck is said in its units, with its ids, and in its words; scripts read nm and numbers from 0."""

import threading

import numba
import numpy as np
import pytest
from cases import cases, raises
from judged import any_seed

import openmm_dpd as dpd
from openmm_dpd.lammps import RunOptions, deck_scene, explain_deck, run_deck
from openmm_dpd.runtime import notice

#: Two beads with the ids 7 and 3, bonded, and one of another type far from them; lengths are those of the deck.
DATA = "two bonded beads\n\n3 atoms\n1 bonds\n2 atom types\n1 bond types\n0 {edge} xlo xhi\n0 {edge} ylo yhi\n0 {edge} zlo zhi\n\nMasses\n"
DATA += "\n1 1.0\n2 1.0\n\nAtoms\n\n7 1 1 1 1 1\n3 1 1 {x} 1 1\n5 2 2 4 4 4\n\nBonds\n\n1 1 7 3\n"

START = "units {units}\natom_style bond\nboundary {boundary}\nbond_style fene\nread_data data.two\nbond_coeff 1 30 1.5 0 1\n"
START += "pair_style dpd {temp} {cutoff} 1\npair_coeff * * 25 4.5\n"


def deck(folder, text="fix 1 all nve\nrun 5\n", x=1.9, edge=6.0, **settings):
    values = {"units": "lj", "boundary": "p p p", "temp": 1.0, "cutoff": 1.0} | settings
    (folder / "data.two").write_text(DATA.format(x=x, edge=edge), encoding="utf-8")
    (folder / "in.two").write_text(START.format(**values) + text, encoding="utf-8")
    return folder / "in.two"


WRONG = {
    "bond, lj": (dict(x=2.6), "in.two:10: the FENE bond between beads 7 and 3 is 1.6 long, which is not less than its R0 of 1.5; move"),
    "bond, real": (dict(x=2.6, units="real"), "beads 7 and 3 is 1.6 Angstrom long, which is not less than its R0 of 1.5 Angstrom; move"),
    "bond in a run": (
        dict(text="velocity all set 100 0 0\ngroup one id 7\nvelocity one set 0 0 0\nfix 1 all nve\nrun 5\n", x=1.6),
        "step 2: the FENE bond between beads 7 and 3 is 1.59536 long, which is not less than its R0 of 1.5; the step size may be",
    ),
    "wall": (
        dict(boundary="p p f", text="fix 1 all nve\nfix 2 all wall/reflect zlo 2 zhi EDGE units box\nrun 1\n"),
        "bead 3 starts at z = 1, beyond a wall (2 such beads); the gap is from 2 to 6. Beads of the wall itself are frozen where no fix",
    ),
    "runaway": (
        dict(text="group one id 5\nvelocity one set 900 0 0\nfix 1 all nve\nrun 1\n", units="metal", cutoff=0.5),
        "bead 5 moves 0.9 Angstrom in one step of 0.001 ps, more than the cutoff of 0.5 Angstrom",
    ),
}


@cases("settings, message", WRONG)
def test_decks_read_their_own_units_ids_and_words(tmp_path, settings, message):
    with pytest.raises(dpd.DPDError) as caught:
        run_deck(deck(tmp_path, **settings), RunOptions(platform="CPU", threads=1))
    assert message in str(caught.value) and " nm" not in str(caught.value)


def test_scripts_read_nm_and_numbers_from_0(tmp_path):
    """Those that take a deck's scene, too."""
    scene = deck_scene(deck(tmp_path, units="real"))
    bonds = [dpd.FENEBonds([(0, 2)], 30.0, 0.05)]
    with pytest.raises(dpd.ParameterError, match=r"beads 0 and 2 \(counted from 0\) is 0.09 nm long.*R0 of 0.05 nm"):
        dpd.Scene(masses={"W": 1.0}, types=["W"] * 3, positions=scene.positions, pairs={}, bonds=bonds, kT=1.0, box=scene.box)


def test_explain_is_short_and_in_the_units_of_the_deck(tmp_path):
    path = deck(tmp_path, units="real", temp=300)
    text, options = explain_deck(path, RunOptions(platform="CPU")), RunOptions(platform="CPU")
    pairs = "  1 - 1, 1 - 2, 2 - 2: DPD(A = 25, gamma = 4.5, cutoff = 1)"
    for line in ("box: 6 x 6 x 6 Angstrom", "dt = 1 fs", "temperature 300 K", pairs):
        assert line in text
    assert len(text.splitlines()) <= 20 and " nm" not in text and "kJ" not in text and "--program lists it" in text
    assert "v <- v+" in explain_deck(path, options, program=True)


@pytest.mark.parametrize("cold", [True, False])
def test_only_what_is_compiled_is_announced(monkeypatch, cold):
    """Once.  Numba has an event for functions that it compiles, and none for those that it finds in the cache."""
    said, heard = list[str](), threading.Event()
    monkeypatch.setattr(notice, "PATIENCE", 0.0)
    monkeypatch.setattr(notice, "_SAID", set())
    kernel = numba.njit(lambda x: x + 1)
    if not cold:
        kernel(1)
    for number in (1, 1.0) if cold else (1, 1):
        with notice.announced("eDPD", 20, lambda line: (said.append(line), heard.set())):
            kernel(number)
            heard.wait(10.0 if cold else 0.1)
    assert [line.startswith("compiling the kernels of eDPD, some 20 s") for line in said] == [True] * cold


def test_image_flags_are_given_for_all_beads_or_for_none(tmp_path):
    path = deck(tmp_path)
    text = (tmp_path / "data.two").read_text(encoding="utf-8").replace("3 1 1 1.9 1 1\n", "3 1 1 1.9 1 1 0 0 1\n")
    (tmp_path / "data.two").write_text(text, encoding="utf-8")
    raises(dpd.DeckError, r"data.two:19: atom 3 has image flags, unlike the first atom", deck_scene, path)


@any_seed(1)
def test_averages_begin_in_equilibrium(tmp_path, capsys, seed):
    """A hot start: the rule leaves it out, --discard 0 does not."""
    (tmp_path / "in.hot").write_text(
        "units lj\nregion b block 0 4 0 4 0 4\ncreate_box 1 b\ncreate_atoms 1 random 192 1 b\nmass 1 1\n" + f"pair_style dpd 1 1 {seed}\n"
        "pair_coeff 1 1 25 4.5\ncomm_modify vel yes\nvelocity all create 30 1\nfix 1 all nve\ntimestep 0.02\nthermo 10\nrun 600\nrun 0\n",
        encoding="utf-8",
    )
    said: list[str] = []
    found = run_deck(tmp_path / "in.hot", RunOptions(platform="CPU", threads=1), log=said.append)["runs"]
    whole = run_deck(tmp_path / "in.hot", RunOptions(platform="CPU", threads=1, discard=0))["runs"]
    temp, start = found[0]["thermo"]["temp"], found[0]["averages_from"]
    assert 30 <= start <= 300 and start % 10 == 0 and whole[0]["averages_from"] == 0
    # 573 degrees of freedom: one row scatters by 6 %
    assert abs(temp["mean"] - 1) < 0.03 + 4 * temp["sem"] and whole[0]["thermo"]["temp"]["mean"] > 1.3
    assert temp["first"] == pytest.approx(30) == whole[0]["thermo"]["temp"]["first"]
    rows = (600 - start) // 10 + 1
    (line,) = [line for line in "\n".join(said).splitlines() if line.startswith("averages of")]
    assert line.startswith("averages of run 2 over 1 rows, from step 600 on") and rows >= 31
    assert np.isfinite(temp["sem"])
