"""Which columns each thread goes through, and in which order.

Blocks of columns are coloured so that two of one colour never touch the same bead, and two that touch the same bead come in the order of
their colours, always: so sums and sweeps have the same bits for any number of threads.  There are two ways to share them out, and the one
that is done sooner is taken.  Threads take their share of one colour, meet, and go on to the next.  Or a thread has layers of its own, and
goes through them in an order in which what it works on stays in its cache: an even layer, then the odd one before it, which touches beads
of the two even ones around it and no others; and in each layer so too, an even block and the odd one before it.  Only the odd layer behind
its last even one has to wait for another thread.
"""

import itertools
from typing import NamedTuple

import numpy as np

from ..runtime import both

#: Threads have colours in common only where they would wait longer than for this part of their work with layers of their own.
_WAITING = 0.03
#: So far a column is looked for that can be done beside another one: to the block after the next.
_AHEAD = 16


class Shares(NamedTuple):
    """The shares of all threads; both arrays are parts of one."""

    #: (turns, threads + 1) where the columns of each thread begin in each turn, and the end; at the end of a turn all meet
    first: np.ndarray
    columns: np.ndarray  #: (columns,) in the order in which they are done


class Blocks(NamedTuple):
    """Columns in blocks, which lie in layers behind each other along z."""

    columns: list[np.ndarray]  #: Of each block
    numbers: np.ndarray  #: (layers, blocks of each) of the blocks


def blocks_of(ny: int, nz: int) -> Blocks:
    """Columns of a grid in blocks.

    Column (y, z) touches y-1..y+1 and z..z+1.  Blocks are at least two columns wide in y and one in z, and there is an even number of them
    (or one) along either axis, so that neighbouring blocks can alternate between two colours, around the periodic box too.  Four colours
    at most, since threads wait for each other at the end of every colour.  Two threads can share four layers or eight, but not
    six.  From ten on any even number can be shared, and ten are better than eight of which three are twice as thick.
    """
    along_y = max(ny // 2 - ny // 2 % 2, 1)
    along_z = nz - 1 if nz % 4 == 3 and nz > 8 else nz - nz % 4 if nz >= 4 else max(nz - nz % 2, 1)
    columns = np.arange(ny * nz).reshape(nz, ny)
    y_edges, z_edges = np.arange(along_y + 1) * ny // along_y, np.arange(along_z + 1) * nz // along_z
    blocks = [block.ravel() for layer in np.split(columns, z_edges[1:-1]) for block in np.split(layer, y_edges[1:-1], axis=1)]
    return Blocks(blocks, np.arange(along_y * along_z).reshape(along_z, along_y))


@both
def apart(column, other, ny, nz):
    """Whether two columns touch no bead both."""
    dy, dz = abs(column % max(ny, 1) - other % max(ny, 1)), abs(column // max(ny, 1) - other // max(ny, 1))
    return min(dy, ny - dy) > 2 or min(dz, nz - dz) > 1


def abreast(shares: Shares, ny: int, nz: int) -> Shares:
    """The same shares, with columns that are :func:`apart` next to each other, two and two, where none has to wait for another one then."""
    for begin, end in itertools.pairwise(np.unique(shares.first).tolist()):
        left, done = shares.columns[begin:end].tolist(), []
        while left:
            done.append(left.pop(0))
            for k, other in enumerate(left[:_AHEAD]):
                if all(apart(other, one, ny, nz) for one in (done[-1], *left[:k])):
                    done.append(left.pop(k))
                    break
        shares.columns[begin:end] = done
    return shares


def by_colours(blocks: Blocks) -> list[np.ndarray]:
    """Numbers of the blocks of each colour."""
    return [blocks.numbers[z::2, y::2].ravel() for z in range(2) for y in range(2)]


def share_out(blocks: Blocks, work: np.ndarray, parts: int) -> Shares:
    """Shares of so many threads, each of about as much of the ``work`` (columns,)."""
    sums = np.add.reduceat(work[np.concatenate(blocks.columns)], np.cumsum([0, *map(len, blocks.columns[:-1])]))
    turns = _layers_each(blocks.numbers, sums, parts)
    if parts > 1 and _time(turns, sums) > (1 + _WAITING) * _time(common := _colours(by_colours(blocks), sums, parts), sums):
        turns = common
    its = [[blocks.columns[k] for k in numbers] for turn in turns for numbers in turn]
    ends = np.cumsum([0, *(sum(map(len, columns)) for columns in its)]).tolist()
    first = [ends[k : k + parts + 1] for k in range(0, len(its), parts)]
    both = np.concatenate([np.ravel(first), *(block for columns in its for block in columns)])
    return Shares(both[: np.size(first)].reshape(-1, parts + 1), both[np.size(first) :])


def _time(turns: list[list[np.ndarray]], work: np.ndarray) -> int:
    """How long all that takes, where threads meet at the end of each turn."""
    return sum(max(int(work[its].sum()) for its in turn) for turn in turns)


def _split(work: np.ndarray, parts: int) -> np.ndarray:
    """Where each of so many threads begins, and the end, so that each gets about as much."""
    middle = 2 * np.cumsum(work) - work
    return np.searchsorted(parts * middle, 2 * work.sum() * np.arange(parts + 1))


def _colours(colours: list[np.ndarray], work: np.ndarray, parts: int) -> list[list[np.ndarray]]:
    """The blocks of each thread in each turn, where a turn is a colour."""
    return [np.split(colour, _split(work[colour], parts)[1:-1]) for colour in colours]


def _even_first(n: int) -> np.ndarray:
    """0 2 1 4 3 ...: each odd one behind the two even ones around it."""
    return np.argsort(np.arange(n) + 1.5 * (np.arange(n) % 2))


def _layers_each(layers: np.ndarray, work: np.ndarray, parts: int) -> list[list[np.ndarray]]:
    """The blocks of each thread in two turns, where each thread has layers of its own: an even number of them, or the only one."""
    layers = layers[:, _even_first(layers.shape[1])]
    cuts = 2 * _split(np.add.reduceat(work[layers].sum(axis=1), np.arange(0, len(layers), 2)), parts)
    its = [layers[begin:end][_even_first(end - begin)] for begin, end in zip(cuts, np.minimum(cuts[1:], len(layers)), strict=False)]
    return [[done[: len(done) - 1 or 1].ravel() for done in its], [done[len(done) - 1 or 1 :].ravel() for done in its]]
