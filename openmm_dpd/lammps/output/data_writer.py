"""The present state of a deck as a data file."""

from collections.abc import Iterator

from ..files.atom_styles import ARRAYS, JOINED
from ..files.data_file import DataFile, data_lines
from ..state.deck_state import DeckState
from ..styles.bonded_styles import bonded_styles


def data_file_lines(state: DeckState, *, pair: str | None = "ii") -> Iterator[str]:
    """Lines of a data file with the deck's present state.  ``pair`` says whose coefficients: ``ii`` of like types, ``ij`` of all pairs,
    None of none.  Those of hybrid styles and tables do not fit into a data file and are left out."""
    box, atoms = state.require_box("write_data"), state.atoms
    arrays = {column: getattr(atoms, name) for column, name in ARRAYS.items()}
    data = DataFile(
        n_types=state.n_types,
        box=box,
        columns={"id": atoms.ids, "type": atoms.types} | arrays | {f"c{k}": c for k, c in enumerate(atoms.concentrations.T, start=1)},
        positions=atoms.positions,
        images=atoms.images,
        velocities=atoms.velocities,
        masses={kind: mass / state.units.mass for kind, mass in state.masses.items()} if len(state.masses) == state.n_types else {},
        **{name: getattr(state, name) for what in JOINED for name in (f"n_{what}_types", f"{what}s")},  # type: ignore[arg-type]
    )
    title = f"LAMMPS data file written by openmm-dpd, timestep = {state.step}, units = {state.units.name}"
    return data_lines(data, title, (state.atom_style,), state.n_species, coefficients=_coefficients(state, pair))


def _coefficients(state: DeckState, pair: str | None) -> Iterator[str]:
    if pair is not None:
        yield from _pair_coefficients(state, pair)
        for what in JOINED:
            yield from _bonded_coefficients(state, what)


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


def _bonded_coefficients(state: DeckState, what: str) -> Iterator[str]:
    setup, known = getattr(state, what), bonded_styles(what)
    if not setup.coefficients or setup.style == "zero":
        return
    if len(setup.coefficients) < getattr(state, f"n_{what}_types"):
        state.note(f"write_data: {what} coefficients are not written, since some types have none")
        return
    yield from ("", f"{what.capitalize()} Coeffs # {setup.style}", "")
    for kind, (style, values) in sorted(setup.coefficients.items()):
        words = known[style].words(values, state.units) if style != "none" else []
        yield " ".join([str(kind), *([style] if setup.style == "hybrid" else []), *words])
