"""Units and boxes: all rows of thermo output beside a live LAMMPS, in runs without noise."""

import lammps_peer
import numpy as np
from cases import cases, put
from test_lammps_thermo_live import both

from openmm_dpd.lammps import export_deck

pytestmark = lammps_peer.needed()


def same_rows(folder, text: str, steps: int = 30) -> np.ndarray:
    """The rows of a deck, after they are compared with LAMMPS's."""
    theirs, ours = both(folder, f"{text}\nthermo 1\nthermo_modify format float %.15g\nrun {steps}\n")
    assert theirs[0] == ours[0] and len(ours) == steps + 2
    found, expected = (np.array([row.split() for row in rows[1:]], dtype=float) for rows in (ours, theirs))
    # components of tensors that are 0 by symmetry have rounding errors only
    scale = np.abs(expected).max(axis=0) * 1e-4 + 1e-9 * (np.abs(expected).max(axis=0) < 1e-9)
    rough = np.argwhere(np.abs(found - expected) > 1e-8 * np.maximum(np.abs(expected), scale))
    assert not len(rough), [(ours[0].split()[k], found[n, k], expected[n, k]) for n, k in rough[:5]]
    return found


# -- units --------------------------------------------------------------------------------------------------------------------------
UNITS = """units {0}
atom_style atomic
comm_modify vel yes
neighbor {1} bin
neigh_modify every 1 delay 0 check yes
lattice sc {1}
region box block 0 5 0 4 0 4
timestep {2}
create_box 1 box
create_atoms 1 box
mass 1 {3}
velocity all ramp vx {4} z 0 4
velocity all ramp vy {4} x 0 5
pair_style dpd 0.0 {5} 99
pair_coeff 1 1 {6}
fix 1 all nve
thermo_style custom step time temp press pe ke etotal enthalpy density vol pxx pyy fmax dt lx
"""
REDUCED = ("0.7", "0.02", "1.0", "-1 1", "1.0", "25.0 4.5")
#: Beads of three molecules of water; velocities are in lattice units.
REAL = {
    "si": ("0.45e-9", "1e-14", "9e-26", "-2e11 2e11", "0.7e-9", "1.5e-10 1e-12"),
    "cgs": ("0.45e-7", "1e-14", "9e-23", "-2e11 2e11", "0.7e-7", "1.5e-5 1e-9"),
    "micro": ("0.45e-3", "1e-8", "9e-11", "-2e5 2e5", "0.7e-3", "1.5e-1 1e-3"),
    "nano": ("0.45", "1e-5", "9e-5", "-200 200", "0.7", "150 1e-3"),
}


@cases("name, values", ("si", REDUCED), *REAL.items())
def test_units(tmp_path, name, values):
    assert 0 < same_rows(tmp_path, UNITS.format(name, *values))[-1, 2]


def test_reduced_numbers_are_exported_as_they_are(tmp_path):
    deck = put(tmp_path / "in.si", UNITS.format("si", *REDUCED) + "run 3\n")
    made = export_deck(deck, tmp_path / "out").deck.read_text(encoding="utf-8")
    assert all(f"\n{line}" in made for line in ("units si", "timestep 0.02\n", "pair_coeff * * 25.0 4.5 1.0\n"))
