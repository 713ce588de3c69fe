"""Scenes from LAMMPS data files alone, without a deck."""

import os
from pathlib import Path

import numpy as np

from ...base.errors import DeckError, ParameterError, what_is
from ...base.units import UnitSystem, unit_system
from ...model.scene import Scene
from ...molecules.inputs.beads import BeadArrays, scene_from_beads
from ..files.data_file import ATOM_STYLES, JOINED, DataFile, read_data_file
from ..language.lexer import read_text
from ..styles.words import bonded_styles

#: Supported atom styles: those without bead fields.
_STYLES = ("atomic", "charge", "bond", "angle", "molecular", "full")


def scene_from_lammps_data(
    path: str | os.PathLike, types=None, *, pairs, kT, units: str = "lj", atom_style: str | None = None, **choices
) -> Scene:
    """A Scene from a LAMMPS data file; pairs, temperature and units, which a deck would define, are arguments.

    Bead k has the k-th smallest id.  Positions are unwrapped.  Coefficients of bonds, angles, dihedrals and impropers are
    those of the file, where their sections say the style (``Bond Coeffs # harmonic``, as ``write_data`` writes it) and ``bonds``,
    ``angles`` or ``dihedrals`` does not say otherwise; sections with pair coefficients are not used.  For a deck there is
    :func:`openmm_dpd.lammps.deck_scene`.

    Parameters
    ----------
    path : path-like
        The data file.
    types : mapping of int to str, optional
        Bead types by LAMMPS's numbers, ``{1: "W", 2: "A"}``; by default they are called ``"1"``, ``"2"``, ...
    pairs, kT
        As for :class:`openmm_dpd.Scene`.
    units : {"lj", "real", "metal", "si", "cgs", "micro", "nano"}
        Units of the file.
    atom_style : str, optional
        One of ``atomic``, ``charge``, ``bond``, ``angle``, ``molecular``, ``full``; by default the comment after ``Atoms #``.
    **choices
        As for :func:`scene_from_beads`; in ``bonds``, ``angles`` and ``dihedrals`` types may be named by their numbers,
        ``{"1": Spring(...)}``.

    Raises
    ------
    DeckError
        With file and line, for what cannot be read, impropers without coefficients among it.
    ParameterError
        As :func:`scene_from_beads`, and if nothing says the atom style.
    """
    path, system = Path(path), unit_system(units)
    data = read_data_file(path, _style(path, atom_style))
    system = system.for_box(float(data.box.edges.max()))
    order = np.argsort(data.columns["id"], kind="stable")
    ids = data.columns["id"][order]
    names = _names(types, data.n_types, path)
    charges = data.columns.get("charge")
    molecules = data.columns.get("molecule")
    numbers = data.columns["type"][order].tolist()
    for what in (f"{term}s" for term in JOINED):
        if choices.get(what) is None and len(getattr(data, what)) and what not in choices.get("leave_out", ()):
            ready = _terms_of_file(path, data, what, ids, system)
            if ready is not None:
                choices[what] = ready
    beads = BeadArrays(
        types=[names[number] for number in numbers],
        positions=(data.positions + data.images @ data.box.vectors)[order] * system.length,
        source=os.fspath(path),
        masses={names[number]: mass * system.mass for number, mass in data.masses.items()} or None,
        box=data.box.reduced_vectors * system.length,
        velocities=data.velocities[order] * system.velocity if "Velocities" in data.hints else None,
        charges=charges[order] if charges is not None and charges.any() else None,
        molecules=molecules[order] if molecules is not None and molecules.any() else None,
        bonds=np.searchsorted(ids, data.bonds[:, 1:]),
        bond_names=[str(kind) for kind in data.bonds[:, 0].tolist()],
        angles=np.searchsorted(ids, data.angles[:, 1:]),
        angle_names=[str(kind) for kind in data.angles[:, 0].tolist()],
        dihedrals=np.searchsorted(ids, data.dihedrals[:, 1:]),
        dihedral_names=[str(kind) for kind in data.dihedrals[:, 0].tolist()],
        type_names=list(names.values()),
        beyond={"impropers": len(data.impropers)} if len(data.impropers) and choices.get("impropers") is None else {},
    )
    return scene_from_beads(beads, pairs=pairs, kT=kT, **choices)


# -- helpers -------------------------------------------------------------------------------------------------------------------
def _style(path: Path, given: str | None) -> str:
    lines = read_text(path, title=True).splitlines()
    hints = [line.partition("#")[2].strip() for line in lines[1:] if line.partition("#")[0].strip() == "Atoms"]
    style = next((hint for hint in hints if hint), given or "")
    if given not in (None, style):
        raise ParameterError(f"{path}: the file says atom_style {style}, not {given}")
    if style in _STYLES:
        return style
    if not style:
        raise ParameterError(f"{path} does not state its atom style after 'Atoms #'; give atom_style, one of {', '.join(_STYLES)}")
    reason = "its beads have fields; read it with a deck" if style in ATOM_STYLES else "unknown"
    raise ParameterError(f"{path}: atom_style {style} cannot be taken ({reason}); it must be one of {', '.join(_STYLES)}")


def _names(types, count: int, path: Path) -> dict[int, str]:
    if types is None:
        return {number: str(number) for number in range(1, count + 1)}
    try:
        names = {number: types[number] for number in range(1, count + 1)}
    except (KeyError, TypeError, IndexError):
        raise ParameterError(f"types must name each of the {count} atom types of {path}, as {{1: 'W'}}, not {what_is(types)}") from None
    if len(types) > count or len(set(names.values())) < count:
        raise ParameterError(f"types must give each of the {count} atom types of {path} a name of its own, not {what_is(types)}")
    return names


def _terms_of_file(path: Path, data: DataFile, what: str, ids: np.ndarray, units: UnitSystem) -> list | None:
    """Bonds, angles, dihedrals or impropers with the coefficients of the file; None if it has none, or does not state their style."""
    section, known = f"{what[:-1].capitalize()} Coeffs", bonded_styles(what[:-1])
    style = data.hints.get(section, "")
    if style not in ("hybrid", *known):
        return None
    found, rows = [], getattr(data, what)
    coefficients = {}
    for number, words in data.coefficients[section]:
        name = words[1] if style == "hybrid" and len(words) > 1 else style
        if name not in known or known[name].kind is None:
            raise DeckError(f"the {what[:-1]} style {name!r} has no coefficients here; give {what}={{...}}", str(path), number)
        try:
            values = known[name].coefficient(words[2 if style == "hybrid" else 1 :], f"{section}: type", units)
        except ParameterError as error:
            raise DeckError(str(error), str(path), number) from None
        coefficients[words[0]] = name, values
    for kind in np.unique(rows[:, 0]).tolist():
        if str(kind) not in coefficients:
            raise DeckError(f"section {section} has no line for {what[:-1]} type {kind}", str(path))
        name, values = coefficients[str(kind)]
        found.append(known[name].build(np.searchsorted(ids, rows[rows[:, 0] == kind, 1:]), values))
    return found
