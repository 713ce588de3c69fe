"""What a run changes in the state of a deck, as bytes, and back.

The commands of a deck are carried out again when it is resumed, so what they do need not be stored.  What runs do is all in
:data:`PARTS`: beads and box, averages, dumps and computes that remember, random numbers of formulas.
"""

import io
import pickle
from typing import Any

from ...errors import ParameterError
from ...serialized import ARRAYS, DataUnpickler
from ..state.deck_state import DeckState

#: Attributes of :class:`~openmm_dpd.lammps.state.deck_state.DeckState` that runs change, or what is in them.
PARTS = (
    "atoms",
    "box",
    "step",
    "noise_counter",
    "restarts",
    "time_origin",
    "last_sample",
    "generators",
    "notes",
    "fixes",
    "computes",
    "dumps",
)

#: What may be in a checkpoint beside plain values, for writing and reading.  Classes of these packages hold data only: unpickling
#: them cannot do anything else.
_PACKAGES = tuple(
    f"openmm_dpd.{name}" for name in ("model.", "units", *(f"lammps.{part}." for part in "language state output values styles".split()))
)

#: What numpy and the standard library need.
_OTHERS = ARRAYS | {
    ("builtins", "range"),
    ("collections", "deque"),
    *(("numpy.random._pickle", name) for name in ("__generator_ctor", "__bit_generator_ctor")),
    ("numpy.random._pcg64", "PCG64"),
    *(("numpy.random.bit_generator", name) for name in ("SeedSequence", "__pyx_unpickle_SeedSequence")),
    *((module, name) for module in ("pathlib", "pathlib._local") for name in ("Path", "PosixPath", "WindowsPath")),
}


class _StateUnpickler(DataUnpickler):
    packages, registered, others, refusal = _PACKAGES, (), _OTHERS, "{} does not belong into a checkpoint"


def to_bytes(value: Any) -> bytes:
    """Anything that consists of data, which has been read back; ParameterError with what is none, or :func:`from_bytes` would refuse."""
    try:
        content = pickle.dumps(value, protocol=5)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise ParameterError(str(error)) from None
    from_bytes(content)
    return content


def from_bytes(content: bytes) -> Any:
    """What :func:`to_bytes` was given; no code is run, whoever wrote it; ParameterError if it is none."""
    try:
        return _StateUnpickler(io.BytesIO(content)).load()
    except (pickle.UnpicklingError, EOFError, AttributeError, ImportError, IndexError, KeyError, TypeError, ValueError) as error:
        raise ParameterError(str(error)) from None


def recorded(state: DeckState) -> dict[str, Any]:
    """What the runs until now have made of a deck, to be stored at once: it is not a copy."""
    return {name: getattr(state, name) for name in PARTS}


def recall(state: DeckState, parts: dict[str, Any]) -> None:
    """Bring a deck to where its runs had brought it."""
    for dump in state.dumps.values():
        dump.close()  # it is replaced
    for name in PARTS:
        setattr(state, name, parts[name])
