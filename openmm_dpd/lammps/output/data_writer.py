"""Writing LAMMPS data files."""

from __future__ import annotations

from collections.abc import Iterator

from ..files.data_file import atom_columns
from ..state.bonded_setup import BondedSetup
from ..state.deck_state import DeckState
from ..styles.bonded_styles import ANGLE_STYLES, BOND_STYLES, BondedStyle


def data_file_lines(state: DeckState, *, pair: str | None = "ii") -> Iterator[str]:
    """Lines of a data file with the deck's present state.

    Parameters
    ----------
    state : DeckState
        The deck.
    pair : str, optional
        ``ii``: coefficients of like types, ``ij``: of all pairs, None: no coefficients.  Coefficients of hybrid styles and tables
        do not fit into a data file and are left out.
    """
    box = state.require_box("write_data")
    yield f"LAMMPS data file written by openmm-dpd, timestep = {state.step}, units = {state.units.name}"
    yield ""
    yield f"{len(state.atoms)} atoms"
    yield f"{state.n_types} atom types"
    if len(state.bonds) or state.n_bond_types:
        yield f"{len(state.bonds)} bonds"
        yield f"{state.n_bond_types} bond types"
    if len(state.angles) or state.n_angle_types:
        yield f"{len(state.angles)} angles"
        yield f"{state.n_angle_types} angle types"
    yield ""
    for axis, low, high in zip("xyz", box.low, box.high, strict=True):
        yield f"{float(low)!r} {float(high)!r} {axis}lo {axis}hi"
    if box.triclinic:
        yield " ".join(repr(float(value)) for value in box.tilt) + " xy xz yz"
    if len(state.masses) == state.n_types:
        yield from ("", "Masses", "")
        yield from (f"{kind} {mass / state.units.mass!r}" for kind, mass in sorted(state.masses.items()))
    if pair is not None:
        yield from _pair_coefficients(state, pair)
        yield from _bonded_coefficients(state, "Bond", state.bond, BOND_STYLES, state.n_bond_types)
        yield from _bonded_coefficients(state, "Angle", state.angle, ANGLE_STYLES, state.n_angle_types)
    yield from _atoms(state)
    for section, terms in (("Bonds", state.bonds), ("Angles", state.angles)):
        if len(terms):
            yield from ("", section, "")
            yield from (f"{k} {' '.join(map(str, row))}" for k, row in enumerate(terms.tolist(), start=1))


def _pair_coefficients(state: DeckState, which: str) -> Iterator[str]:
    if state.pair.mode != "single" or state.pair.styles[0].name in ("table", "zero"):
        if state.pair.mode != "none":
            state.note(f"write_data: coefficients of pair style {state.pair.mode} are not written")
        return
    (table,), missing = state.pair.resolve(state.n_types)
    style = state.pair.styles[0]
    wanted = {key: found for key, found in sorted(table.items()) if which == "ij" or key[0] == key[1]}
    if missing or state.pair.excluded:
        state.note("write_data: pair coefficients are not written, since some type pairs have none")
        return
    yield from ("", f"{'PairIJ' if which == 'ij' else 'Pair'} Coeffs # {style.name}", "")
    for (i, j), found in wanted.items():
        types = f"{i} {j}" if which == "ij" else f"{i}"
        yield f"{types} {' '.join(style.words(found))}"


def _bonded_coefficients(state: DeckState, section: str, setup: BondedSetup, known: dict[str, BondedStyle], types: int) -> Iterator[str]:
    if not setup.coefficients or setup.style == "zero":
        return
    if len(setup.coefficients) < types:
        state.note(f"write_data: {section.lower()} coefficients are not written, since some types have none")
        return
    yield from ("", f"{section} Coeffs # {setup.style}", "")
    for kind, (style, values) in sorted(setup.coefficients.items()):
        words = known[style].words(values, state.units) if style != "none" else []
        yield " ".join([str(kind), *([style] if setup.style == "hybrid" else []), *words])


def _atoms(state: DeckState) -> Iterator[str]:
    atoms = state.atoms
    x, y, z = atoms.positions.T
    arrays = {
        "id": atoms.ids,
        "type": atoms.types,
        "molecule": atoms.molecules,
        "charge": atoms.charges,
        "theta": atoms.thetas,
        "x": x,
        "y": y,
        "z": z,
        "rho": atoms.densities,
        "temperature": atoms.temperatures,
        "capacity": atoms.capacities,
        **{f"c{k}": column for k, column in enumerate(atoms.concentrations.T, start=1)},
    }
    names = atom_columns(state.atom_style, state.n_species)
    columns = [arrays[name].tolist() for name in names] + [column.tolist() for column in atoms.images.T]
    yield from ("", f"Atoms # {state.atom_style}", "")
    for row in zip(*columns, strict=True):
        yield " ".join(map(repr, row))
    yield from ("", "Velocities", "")
    for identity, velocity in zip(atoms.ids.tolist(), atoms.velocities.tolist(), strict=True):
        yield f"{identity} {' '.join(map(repr, velocity))}"
