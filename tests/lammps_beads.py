"""The beads that a deck makes, in a live LAMMPS and by the deck reader."""

from pathlib import Path

import lammps_peer
import numpy as np

from openmm_dpd.lammps import read_deck


def theirs(folder: Path, text: str) -> tuple[np.ndarray, dict[str, int]]:
    """Beads (id type x y z ix iy iz vx vy vz) after a deck, sorted by id, and the sizes of the groups."""
    columns = "id type x y z ix iy iz vx vy vz"
    with lammps_peer.instance() as lmp:
        lmp.command(f"shell cd {folder}")
        lmp.commands_string(text)
        lmp.command(f"write_dump all custom {folder}/final.dump {columns} modify sort id format float %25.17g")
        groups = {}
        for name in filter(None, lmp.available_ids("group")):
            lmp.command(f"variable size_of_{name} equal count({name})")
            groups[name] = int(lmp.extract_variable(f"size_of_{name}"))
    lines = (folder / "final.dump").read_text().splitlines()
    rows = lines[lines.index(next(line for line in lines if line.startswith("ITEM: ATOMS"))) + 1 :]
    return np.array([row.split() for row in rows], dtype=float).reshape(-1, 11), groups


def ours(folder: Path, text: str, **options):
    """State of the deck at its end, or at its first run if there is one run only; nothing is simulated."""
    path = folder / "in.ours"
    path.write_text(text, encoding="utf-8")
    return read_deck(path, stop_before_first_run=text.count("\nrun ") < 2, output=folder, **options)


def same_beads(folder: Path, text: str, velocities: bool = True) -> None:
    expected, groups = theirs(folder, text)
    state = ours(folder, text)
    atoms = state.atoms
    assert len(atoms) == len(expected) > 0
    assert np.array_equal(atoms.ids, expected[:, 0]) and np.array_equal(atoms.types, expected[:, 1])
    np.testing.assert_array_equal(atoms.positions, expected[:, 2:5])  # to the last bit: whether a bead on a face is inside depends on it
    assert np.array_equal(atoms.images, expected[:, 5:8])
    if velocities:
        np.testing.assert_allclose(atoms.velocities, expected[:, 8:], rtol=1e-13, atol=1e-13)
    assert {name: int(mask.sum()) for name, mask in state.groups.items()} == groups
