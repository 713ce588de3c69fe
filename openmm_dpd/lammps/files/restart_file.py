"""Restart files: the state that a later deck can continue from, in a format of this package (a zip of numpy arrays and a JSON text)."""

import io
import json
import zipfile
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UNIT_SYSTEMS
from ..state.atoms import Atoms
from ..state.box import Box
from ..state.deck_state import DeckState
from .data_file import JOINED

#: Format identifier in the file; its number changes with the contents.
FORMAT = "openmm-dpd restart 6"
#: Attributes of DeckState that are stored as plain numbers and words.
_PLAIN = (
    "labels dimension atom_style sorts n_types n_bond_types n_angle_types n_dihedral_types n_improper_types n_species timestep step runs "
    "reordered noise_counter"
).split()
#: First bytes of LAMMPS's own restart files.
LAMMPS_MAGIC = b"LammpS RestartT"


def restart_bytes(state: DeckState) -> bytes:
    """Content of a restart file, with all numbers bit for bit: box, beads, bonds, groups, step and time, commands about interactions, and
    the counter of the noise."""
    box = state.require_box("a restart file")
    header = {name: getattr(state, name) for name in _PLAIN} | {
        "format": FORMAT,
        "units": state.units.name,
        "periodic": list(state.periodic),
        "time_origin": list(state.time_origin),
        "box": [box.low.tolist(), box.high.tolist(), box.tilt.tolist(), box.triclinic],
        "masses": sorted(state.masses.items()),
        "groups": list(state.groups),
        "setup": [*state.setup, *_adapted(state)],
        "fixes": {
            fix.name: [fix.style, state.runs, {name: fix.parameters[name] for name in ("numbers", "edges") if name in fix.parameters}]
            for fix in state.fixes_of("nvt", "npt", "temp/rescale", "temp/berendsen")
        },
    }
    arrays = {f"atoms/{item.name}": getattr(state.atoms, item.name) for item in fields(Atoms)}
    arrays |= {f"group/{k}": mask for k, mask in enumerate(state.groups.values())}
    arrays |= {"header": np.array(json.dumps(header))} | {f"{what}s": getattr(state, f"{what}s") for what in JOINED}
    content = io.BytesIO()
    np.savez(content, **arrays)
    return content.getvalue()


def _adapted(state: DeckState) -> Iterator[tuple[str, list[str]]]:
    """Commands that set the coefficients which differ from those of the deck, bit for bit."""
    for style in state.pair.styles:
        same = [each for each in state.pair.styles if each.name == style.name]
        named = [style.name] * state.pair.mode.startswith("hybrid") + [str(same.index(style) + 1)] * (len(same) > 1)
        for (i, j), found in style.coefficients.items():
            values = [*found.values.values(), style.cutoff(found)]
            if found.adapted:
                yield "pair_coeff", [str(i), str(j), *named, *map(repr, values)]


def load_restart(state: DeckState, path: Path) -> list[tuple[str, list[str]]]:
    """Load a restart file into the state and return its commands about interactions.  ParameterError if it is not a restart file of this
    package."""
    content = path.read_bytes()
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as found:
            arrays = {name: found[name] for name in found.files}
        header = json.loads(str(arrays.pop("header")))
        if header["format"] != FORMAT:
            raise ParameterError(f"'{path.name}' has the format '{header['format']}'; this version reads '{FORMAT}'")
        _take(state, header, arrays)
        return [(name, list(words)) for name, words in header["setup"]]
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, ParameterError):
            raise
        raise ParameterError(f"'{path.name}' is not a restart file of this package, or is damaged ({error})") from None


def _take(state: DeckState, header: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    low, high, tilt, triclinic = header["box"]
    x, y, z = header["periodic"]
    state.restored = header.get("fixes", {})
    for name in _PLAIN:
        setattr(state, name, header[name])
    state.set_dimension(state.dimension)
    state.periodic = (x, y, z)
    state.box = Box(low, high, tilt, triclinic, state.periodic, state.dimension == 2)
    state.units = UNIT_SYSTEMS[header["units"]].for_box(float(state.box.edges.max()))
    time, step = header["time_origin"]
    state.time_origin = (time, step)
    state.masses = {kind: mass for kind, mass in header["masses"]}
    state.atoms = Atoms(**{item.name: arrays[f"atoms/{item.name}"] for item in fields(Atoms)})
    for name in (f"{what}s" for what in JOINED):
        setattr(state, name, arrays[name])
    state.groups = {name: arrays[f"group/{k}"] for k, name in enumerate(header["groups"])}
