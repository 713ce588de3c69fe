"""Computes of chunks: centres, velocities, displacements, gyration and properties of each chunk of a ``compute chunk/atom``."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import AXES_OF_TENSOR
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Compute
from .chunks import Bins, chunk_numbers
from .compute_spec import ComputeSpec


class Chunked(NamedTuple):
    """Settings: the compute chunk/atom, its number of chunks at the definition (1 where beads decide it anew each time), other words, and
    the centres at the definition of a compute msd/chunk."""

    chunks: str
    rows: int
    words: tuple[str, ...] = ()
    origin: np.ndarray | None = None


def known_chunks(state: DeckState, name: str, what: str) -> Compute:
    """The compute chunk/atom with this id.  ParameterError if there is none."""
    compute = state.computes.get(name)
    if compute is None or compute.style != "chunk/atom":
        known = ", ".join(other.name for other in state.computes.values() if other.style == "chunk/atom") or "none"
        raise ParameterError(f"{what}: '{name}' is not the id of a compute chunk/atom; defined are {known}")
    return compute


def _parser(allowed: tuple[str, ...] = (), least: int = 0, reference: bool = False) -> Callable[[DeckState, str, list[str]], Chunked]:
    def parse(state: DeckState, group: str, words: list[str]) -> Chunked:
        read.count(words, f"compute ID group style chunkID{' value' * least} ...", 1 + least, None)
        chunks = known_chunks(state, words[0], "a compute of chunks")
        for word in words[1:]:
            read.choice(word, "a value of a compute of chunks", allowed)
        box, fixed = state.require_box("a compute of chunks"), chunks.settings.fixed(state, chunks.group)
        rows = fixed[1].count if fixed is not None else 1 if chunks.settings.word else chunks.settings.bins(box).count
        if not reference:
            return Chunked(words[0], max(rows, 1), tuple(words[1:]))
        if fixed is None:
            raise ParameterError("compute msd/chunk needs chunks that stay: molecules or types")
        kept = (fixed[0] >= 0) & state.group(group)
        unwrapped = box.unwrap(state.atoms.positions, state.atoms.images)
        return Chunked(words[0], rows, (), _means(fixed[0][kept], rows, state.bead_masses()[kept], unwrapped[kept]))

    return parse


def _means(numbers: np.ndarray, count: int, masses: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(count, ...) mean of vectors over the beads of each chunk, weighted by masses; 0 for chunks without beads."""
    total = np.bincount(numbers, masses, count)
    sums = np.stack([np.bincount(numbers, masses * column, count) for column in vectors.T], axis=1)
    return sums / np.where(total > 0, total, 1.0)[:, None]


def _members(moment: DeckMoment, compute: Compute) -> tuple[np.ndarray, np.ndarray, Bins]:
    """Mask of the beads of the group that are in a chunk, the chunk of each of them, and the chunks."""
    numbers, bins = chunk_numbers(moment, known_chunks(moment.state, compute.settings.chunks, f"compute {compute.name}"))
    kept = (numbers >= 0) & moment.state.group(compute.group)
    return kept, numbers[kept], bins


def _centres(moment: DeckMoment, compute: Compute, vectors: np.ndarray) -> np.ndarray:
    kept, numbers, bins = _members(moment, compute)
    return _means(numbers, bins.count, moment.state.bead_masses()[kept], vectors[kept])


def _displaced(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Squared displacements of the centres along x, y, z, and their sum."""
    centres, origin = _centres(moment, compute, moment.unwrapped), compute.settings.origin
    if len(centres) != len(origin):
        raise ParameterError(f"compute {compute.name}: there are {len(centres)} chunks, but there were {len(origin)} at its definition")
    squares = (centres - origin) ** 2
    return np.column_stack([squares, squares.sum(axis=1)])


def _gyration(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """(count, 6) gyration tensors xx, yy, zz, xy, xz, yz."""
    kept, numbers, bins = _members(moment, compute)
    masses, x = moment.state.bead_masses()[kept], moment.unwrapped[kept]
    d = x - _means(numbers, bins.count, masses, x)[numbers]
    return _means(numbers, bins.count, masses, np.stack([d[:, a] * d[:, b] for a, b in AXES_OF_TENSOR], axis=1))


def _chunk_properties(moment: DeckMoment, compute: Compute) -> np.ndarray:
    _, numbers, bins = _members(moment, compute)
    found = {"count": np.bincount(numbers, minlength=bins.count), "id": np.arange(1, bins.count + 1) if bins.ids is None else bins.ids}
    found |= {f"coord{k}": column for k, column in enumerate(bins.centres.T, start=1)}
    missing = next((word for word in compute.settings.words if word not in found), None)
    if missing is not None:
        raise ParameterError(f"compute {compute.name}: its chunks have no {missing}")
    return np.stack([found[word] for word in compute.settings.words], axis=1).astype(float)


def _listed(prepare, array, vector, columns: Callable[[Compute], int]) -> ComputeSpec:
    """A table, or a vector where there are no columns; a row or value for each chunk."""
    rows = lambda compute, of_table: compute.settings.rows * ((columns(compute) > 0) == of_table)  # noqa: E731
    return ComputeSpec(prepare, vector=vector, array=array, rows=lambda c: rows(c, True), columns=columns, size=lambda c: rows(c, False))


#: Computes of chunks.
OF_CHUNKS: dict[str, ComputeSpec] = {
    "com/chunk": _listed(_parser(), lambda m, c: _centres(m, c, m.unwrapped), None, lambda c: 3),
    "vcm/chunk": _listed(_parser(), lambda m, c: _centres(m, c, m.velocities), None, lambda c: 3),
    "msd/chunk": _listed(_parser(reference=True), _displaced, None, lambda c: 4),
    "gyration/chunk": _listed(
        _parser(("tensor",)), _gyration, lambda m, c: np.sqrt(_gyration(m, c)[:, :3].sum(axis=1)), lambda c: 6 * len(c.settings.words)
    ),
    "property/chunk": _listed(
        _parser(("count", "id", "coord1", "coord2", "coord3"), least=1),
        _chunk_properties,
        lambda m, c: _chunk_properties(m, c)[:, 0],
        lambda c: len(c.settings.words) if len(c.settings.words) > 1 else 0,
    ),
}
