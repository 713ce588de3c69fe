"""Forces, energies and pressure of one configuration, or the beads that a deck makes, from a live LAMMPS, for comparison."""

from collections import namedtuple
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import put
from live_lammps import instance

from openmm_dpd.lammps import RunOptions, read_deck, run_deck

# Forces (N, 3) in input order, total potential and kinetic energy, pressure; in LAMMPS's units.
LammpsForces = namedtuple("LammpsForces", "forces pe ke press")


@cache
def why_missing() -> str | None:
    """None when LAMMPS can be used here, otherwise the reason in words."""
    try:
        with instance() as lmp:
            styles = {name: lmp.has_style("pair", name) for name in ("dpd", "dpd/ext")}
    except (ImportError, OSError) as error:
        return f"LAMMPS cannot be loaded: {error}"
    lacking = [name for name, present in styles.items() if not present]
    return f"this LAMMPS has no pair style {', '.join(lacking)}" if lacking else None


def needed() -> pytest.MarkDecorator:
    """Mark of tests that are skipped without LAMMPS."""
    return pytest.mark.skipif(why_missing() is not None, reason=str(why_missing()))


def need(*styles: tuple[str, str]) -> None:
    """Skip a test where there is no LAMMPS with these styles (category, name)."""
    reason = why_missing()
    if reason is None:
        with instance() as lmp:
            lacking = [name for category, name in styles if not lmp.has_style(category, name)]
        reason = f"this LAMMPS lacks {', '.join(lacking)}" if lacking else None
    if reason is not None:
        pytest.skip(reason)


def _box_commands(box: np.ndarray | None, positions: np.ndarray) -> list[str]:
    if box is None:
        low, high = float(positions.min()) - 1.0, float(positions.max()) + 1.0
        return ["boundary f f f", "region box block" + f" {low!r} {high!r}" * 3]
    box = np.asarray(box, dtype=float)
    if box.shape == (3,):
        edges = " ".join(f"0.0 {float(edge)!r}" for edge in box)
        return ["boundary p p p", f"region box block {edges}"]
    edges = " ".join(f"0.0 {float(edge)!r}" for edge in np.diag(box))
    tilts = " ".join(repr(float(tilt)) for tilt in (box[1, 0], box[2, 0], box[2, 1]))  # xy xz yz
    return ["boundary p p p", f"region box prism {edges} {tilts}"]


def lammps_forces(
    positions: np.ndarray,
    types: Sequence[int],
    masses: Sequence[float],
    velocities: np.ndarray,
    box: np.ndarray | None,
    pair_style: Sequence[str],
    pair_coeff: Sequence[str],
    units: str = "lj",
) -> LammpsForces:
    """Evaluate step 0 in a fresh LAMMPS.

    Parameters
    ----------
    positions, velocities
        (N, 3); handed over as doubles through the library interface, never as text.
    types
        (N,) types counted from 0 (they become LAMMPS types 1, 2, ...).
    masses
        Mass of each TYPE.
    box
        None (not periodic), (3,) edges, or (3, 3) lower-triangular rows.
    pair_style, pair_coeff
        Command lines in LAMMPS's own words and type numbers (from 1), e.g. ``["pair_style dpd 0.0 1.0 1"]``.

    Returns
    -------
    LammpsForces
    """
    positions = np.asarray(positions, dtype=float)
    n = len(positions)
    with instance() as lmp:
        head = [f"units {units}", "newton on", "atom_style atomic", "atom_modify map yes", "comm_modify vel yes"]
        kinds = [f"mass {k} {float(mass)!r}" for k, mass in enumerate(masses, start=1)]
        lmp.commands_list([*head, *_box_commands(box, positions), f"create_box {len(masses)} box", *kinds])
        kept = [int(t) + 1 for t in types], positions.ravel().tolist(), np.asarray(velocities, dtype=float).ravel().tolist()
        created = lmp.create_atoms(n, list(range(1, n + 1)), *kept)
        if created != n:
            raise ValueError(f"LAMMPS took {created} of {n} beads")
        lmp.commands_list([*pair_style, *pair_coeff, "thermo_style custom step pe ke press", "thermo_modify norm no", "run 0 post no"])
        forces = np.array(lmp.gather_atoms("f", 1, 3), dtype=float).reshape(n, 3)  # sorted by id
        return LammpsForces(forces, *(float(lmp.get_thermo(word)) for word in ("pe", "ke", "press")))


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


def printed(path: Path, text: str, **options) -> list[str]:
    """Lines that a run of a deck with this text prints; its files are beside it."""
    lines: list[str] = []
    run_deck(put(path, text), RunOptions(**{"platform": "Reference", "threads": 1, **options}), out=path.parent, log=lines.append)
    return lines


def ours(folder: Path, text: str, **options):
    """State of the deck at its end, or at its first run if there is one run only; nothing is simulated."""
    return read_deck(put(folder / "in.ours", text), stop_before_first_run=text.count("\nrun ") < 2, output=folder, **options)


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
