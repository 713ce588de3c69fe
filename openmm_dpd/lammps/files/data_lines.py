"""Writing LAMMPS data files."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from .atom_styles import JOINED, atom_columns
from .data_file import DataFile


def data_lines(
    data: DataFile,
    title: str,
    styles: Sequence[str],
    n_species: int = 0,
    *,
    coefficients: Iterable[str] = (),
    remarks: Mapping[int, str] | None = None,
) -> Iterator[str]:
    """Lines of a data file, the first one ``title``; every number has all of its digits.

    All of ``data`` is written but for its ``coefficients`` and ``hints``; ``coefficients`` are lines of the Coeffs sections, ``remarks``
    what to say about types, behind their masses; ``styles`` and ``n_species`` as for
    :func:`~openmm_dpd.lammps.files.atom_styles.atom_columns`.
    """
    terms = [(what, getattr(data, f"n_{what}_types"), getattr(data, f"{what}s")) for what in JOINED]
    yield from (title, "", f"{len(data.positions)} atoms", f"{data.n_types} atom types")
    for what, types, rows in terms:
        if len(rows) or types:
            yield from (f"{len(rows)} {what}s", f"{types} {what} types")
    yield ""
    for axis, low, high in zip("xyz", data.box.low.tolist(), data.box.high.tolist(), strict=True):
        yield f"{low!r} {high!r} {axis}lo {axis}hi"
    if data.box.triclinic:
        yield f"{' '.join(map(repr, data.box.tilt.tolist()))} xy xz yz"
    if data.masses:
        yield from ("", "Masses", "")
        for kind, mass in sorted(data.masses.items()):
            yield f"{kind} {float(mass)!r}" + (f" # {remarks[kind]}" if remarks else "")
    yield from coefficients
    arrays = data.columns | dict(zip("xyz", data.positions.T, strict=True))
    columns = [arrays[name] for name in atom_columns(styles, n_species)] + list(data.images.T)
    yield from ("", f"Atoms # {styles[0] if len(styles) == 1 else 'hybrid'}", "")
    for row in zip(*(column.tolist() for column in columns), strict=True):
        yield " ".join(map(repr, row))
    yield from ("", "Velocities", "")
    for identity, velocity in zip(data.columns["id"].tolist(), data.velocities.tolist(), strict=True):
        yield f"{identity} {' '.join(map(repr, velocity))}"
    for what, _, rows in terms:
        if len(rows):
            yield from ("", f"{what.capitalize()}s", "")
            yield from (f"{k} {' '.join(map(str, row))}" for k, row in enumerate(rows.tolist(), start=1))
