"""Which blocks of columns each thread goes through, and in which order.

Two blocks that touch the same bead come in the order of their colours (see :func:`.cells.colours`), always: so sums and sweeps have the
same bits for any number of threads.  Where threads have few layers of blocks each, all take their share of one colour, meet, and go on to
the next.  Otherwise a thread has layers of its own, and goes through them in an order in which what it works on stays in its cache: an
even layer, then the odd one before it, which touches beads of the two even ones around it and no others; and in each layer so too, an even
block and the odd one before it.  Only the odd layer behind its last even one has to wait for another thread.
"""

from typing import NamedTuple

import numpy as np

from .compiled import helper, inlined

#: Times after which all threads meet.
TURNS = 4
#: Threads that have so many pairs of layers each have layers of their own.
_LAYERS = 4


class Shares(NamedTuple):
    """The shares of all threads."""

    first: np.ndarray  #: (TURNS, threads + 1) where the blocks of each thread begin in each turn, and the end
    blocks: np.ndarray  #: (blocks,) the blocks, in the order in which they are done


def space_for_shares(parts: int, blocks: int) -> Shares:
    """Space for so many threads."""
    return Shares(np.zeros((TURNS, parts + 1), np.int64), np.zeros(blocks, np.int64))


@inlined
def columns_of(pairs, shares, n):
    """The tasks of the n-th block."""
    block = shares.blocks[n]
    return range(pairs.block_start[block], pairs.block_start[block + 1])


@inlined
def _in_turn(begin, end, n):
    """The n-th of the numbers from begin to end, even ones before the odd ones beside them: 0 2 1 4 3 5, or 2 1 4 3."""
    first = n + 1 if begin % 2 else n
    if first == 0 or (n == end - begin - 1 and (end - 1) % 2):
        return begin + n
    return begin + n + (1 if first % 2 else -1)


@inlined
def _width(pairs):
    """How many blocks a layer has."""
    return (len(pairs.block_start) - 1) // pairs.layers


@inlined
def _block_at(pairs, layer, across):
    """Number of a block of a layer, the one with so many others before it."""
    colour = 2 * (layer % 2) + across % 2
    return pairs.colour_start[colour] + layer // 2 * ((_width(pairs) + 1 - across % 2) // 2) + across // 2


@helper
def _work_in(pairs, block):
    """About as many pairs as a block has, and one more for each column: as many as it has room for, or where pairs are not stored as many
    as were found there last."""
    work, stored = np.int64(0), pairs.start[-1] != 0
    for task in range(pairs.block_start[block], pairs.block_start[block + 1]):
        column = pairs.columns[task]
        work += np.int64(pairs.start[column + 1] - pairs.start[column] if stored else pairs.found[column]) + 1
    return work


@helper
def _work_of(pairs, layers, n):
    """The same of the n-th pair of ``layers``, or of the n-th block."""
    if not layers:
        return _work_in(pairs, n)
    work = np.int64(0)
    for layer in range(2 * n, min(2 * n + 2, pairs.layers)):
        for across in range(_width(pairs)):
            work += _work_in(pairs, _block_at(pairs, layer, across))
    return work


@helper
def _split(pairs, layers, begin, end, first, parts):
    """Write where each of so many threads begins (there can be room for more), so that each gets about as much work."""
    work, passed, part = np.int64(0), np.int64(0), 1
    first[:] = end
    first[0] = begin
    if parts == 1:
        return
    for n in range(begin, end):
        work += _work_of(pairs, layers, n)
    for n in range(begin, end):
        here = _work_of(pairs, layers, n)
        while part < parts and parts * (2 * passed + here) >= 2 * work * part:
            first[part] = n
            part += 1
        passed += here


@helper
def _add_layer(pairs, layer, blocks, n):
    """Write the blocks of one layer; returns how many there are then."""
    width = _width(pairs)
    for q in range(width if layer < pairs.layers else 0):
        blocks[n] = _block_at(pairs, layer, _in_turn(0, width, q))
        n += 1
    return n


@helper
def share_out(pairs, shares, parts):
    """Write the shares of so many threads.  The same ones as long as the room is the same, so that a thread finds the pairs that it has
    listed itself in its own cache."""
    first, blocks = shares.first, shares.blocks
    layers = parts == 1 or pairs.layers >= 2 * _LAYERS * parts
    for colour in range(1 if layers else TURNS):
        colours = pairs.colour_start[colour], pairs.colour_start[colour + 1]
        begin, end = (np.int64(0), np.int64((pairs.layers + 1) // 2)) if layers else colours
        _split(pairs, layers, begin, end, first[TURNS - 1 if layers else colour], parts)
    if not layers:
        for block in range(len(blocks)):
            blocks[block] = block
        return
    its, n = first[TURNS - 1], np.int64(0)  # the pairs of layers of each thread
    for turn in range(2):
        for part in range(parts):
            first[turn, part] = n
            begin, end = 2 * its[part], 2 * its[part + 1] - 1
            for k in range(end - begin if turn == 0 else its[part + 1] > its[part]):
                n = _add_layer(pairs, _in_turn(begin, end, k) if turn == 0 else end, blocks, n)
        first[turn, parts] = n
    first[2, :] = first[3, :] = n
