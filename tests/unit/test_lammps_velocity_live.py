"""``velocity set`` with variables beside a live LAMMPS."""

import lammps_peer
import numpy as np
import pytest
from cases import cases, put

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import read_deck

LAMMPS = lammps_peer.needed()

#: The lattice has not the unit as its spacing: numbers are multiplied by it, values of variables are not.
DECK = """lattice sc 0.5
region b block 0 2 0 2 0 2
create_box 1 b
create_atoms 1 box
mass 1 1
group some id 2:6
variable a atom x+2*vy
variable old atom vx-z
variable e equal 3-count(some)
variable chain equal v_e*2
velocity all set 0.5 0.25 1
velocity all ramp vz -1 1 y 0 2
"""
COMMANDS = (
    "velocity all set v_a v_old v_e",
    "velocity some set v_a NULL v_chain units box",
    "velocity some set v_old 0.5 v_a sum yes",
    "velocity all set NULL v_a -1 sum yes units box\nvelocity some set v_a v_old 0",
)


@LAMMPS
@pytest.mark.parametrize("text", COMMANDS)
def test_velocities_of_variables(tmp_path, text):
    state = read_deck(put(tmp_path / "in.deck", DECK + text + "\nquit\n"), stop_before_first_run=True)
    with lammps_peer.instance() as lmp:
        lmp.commands_string(DECK + text)
        expected = np.array(lmp.gather_atoms("v", 1, 3)).reshape(-1, 3)
    assert np.ptp(expected[:, 0]) > 0.1
    np.testing.assert_allclose(state.atoms.velocities, expected, rtol=1e-12, atol=1e-12)


@cases(
    "text, message",
    ("variable s string 3\nvelocity all set v_s 0 0", "velocity set: variable s is string-style"),
    ("velocity all set v_none 0 0", "none"),
    ("variable t equal temp\nvelocity all set v_t 0 0", "needs a run"),
    ("variable q equal 1/(count(some)-5)\nvelocity all set v_q 0 0", "division by zero|1/"),
)
def test_other_variables_are_refused(tmp_path, text, message):
    path = put(tmp_path / "in.deck", DECK + text + "\n")
    with pytest.raises(DeckError, match=rf"in.deck:\d+: .*({message})"):
        read_deck(path)
