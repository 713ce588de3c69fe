"""The loop over all pairs: columns, in the order of :mod:`.shares`, and the pairs of each.

It is written here once.  What is done with a column and with a pair is put in when it is compiled::

    first(pairs, data, begin, end)              for the sorted beads begin:end, before all else
    before(pairs, data, begin, m, scratch)      for the next pairs of a column, begin:begin + m: what can be done for many at once
    pair(pairs, data, scratch, n, k, column)    for each pair number n, the k-th of these: returns energy, virial, virial of friction
    last(pairs, data, begin, end)               for the sorted beads begin:end, after all else

``pairs`` is a :class:`.pairs.Pairs`, ``data`` a NamedTuple of the caller's.  Where the list has room for stress tensors, virials are added
up as tensors too: forces are along the line between the two beads, and what else there is a pair adds itself.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import types

from ..runtime import Kernel, Tape, by_types, helper, inlined, meet
from .groups import grouped_columns, seats_for
from .listing import fetch_around, has_room, list_some, look_around
from .pairs import CHUNK, PairList, Scratch
from .templates import renamed

#: As a number that numba knows to be positive.
_CHUNK = np.uint64(CHUNK)


class Totals(NamedTuple):
    """Sums over pairs: energy; r_ij . F_ij of all terms, and of friction alone.  And if asked for (6,) r_ij F_ij (xx, yy, zz, xy, xz, yz),
    the Laplacian of the energy, and r_ij . F_ij of the conservative terms alone."""

    energy: float
    virial: float
    drag: float
    stress: np.ndarray | None = None
    laplacian: float | None = None
    conservative: float | None = None


#: Velocities where there is no friction.
_NO_VELOCITIES = np.zeros((0, 3))


class Motion(NamedTuple):
    """Forces and velocities in the order of a pair list: ``motion`` of ``data`` where pairs exert forces."""

    f: np.ndarray  #: (M, 3) forces
    out: np.ndarray  #: (N, 3) where they go to, by the numbers of beads
    add: bool = True  #: Whether they are added to what is there
    v: np.ndarray = _NO_VELOCITIES  #: (M, 3) velocities, if pairs look at them
    seen: np.ndarray = _NO_VELOCITIES  #: (N, 3) where they come from; of length 0: they are 0


@inlined
def add_stress(stress, column, tensor):
    """Add (xx, yy, zz, xy, xz, yz) to the stress tensor of a column."""
    # central forces make the last three symmetric; transverse ones on average only, and LAMMPS takes this half
    for k in range(6):
        stress[column, k] += tensor[k]


@inlined
def _with(tensor, g, n, virial):
    """A tensor (xx, yy, zz, xy, xz, yz) and that of a force along the line between the beads of a pair."""
    x, y, z = virial * g[0, n], virial * g[1, n], virial * g[2, n]
    xx, yy, zz, xy, xz, yz = tensor
    return xx + x * g[0, n], yy + y * g[1, n], zz + z * g[2, n], xy + x * g[1, n], xz + x * g[2, n], yz + y * g[2, n]


@inlined
def nothing(pairs, data, begin, m, scratch):
    """There is nothing that can be done for many pairs at once."""


def _column(pairs, data, space, source, column, part, turn):
    """One column; with several rounds what is computed together in this one."""
    energy, virial, drag, laplacian, conservative = 0.0, 0.0, 0.0, 0.0, 0.0
    tensor = drags = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if _TENSOR:
        pairs.stress[column :: len(pairs.found)] = 0.0
    cell, bead, goes_on = np.int64(0), np.uint64(0), True
    if _LISTS:
        room = np.uint64(len(pairs.pi) // len(source.bead))
        look_around(source, part, column)
        pairs.found[column] = 0
    while goes_on:
        if _LISTS:
            begin = np.uint64(part) * room
            cell, bead, stop = list_some(pairs, source, part, cell, bead, begin, begin + room)
            pairs.found[column] += stop - begin
            goes_on = cell < source.nx and pairs.found[column] <= room
            stop = stop if stop <= begin + room else begin  # what there was no room for is not there
        else:
            begin, goes_on = pairs.start[column], False
            stop = begin + pairs.found[column]
        for here in range(begin + np.uint64(turn) * _CHUNK, stop, _ROUNDS * _CHUNK):
            last = min(here + _CHUNK, stop)
            _before(pairs, data, here, last - here, space)
            for n in range(here, last):
                more = _pair(pairs, data, space, n, n - here, column)
                energy += more[0]
                virial += more[1]
                drag += more[2]
                if _PARTS:
                    laplacian += more[3]
                    conservative += more[4]
                if _TENSOR:
                    tensor = _with(tensor, pairs.geometry, n, more[1])
                if _DRAGS:
                    drags = _with(drags, pairs.geometry, n, more[2])
    if _TENSOR:
        add_stress(pairs.stress, column, tensor)
    if _DRAGS:
        add_stress(pairs.stress, len(pairs.found) + column, drags)
    sums = pairs.sums
    sums[column, 0], sums[column, 1], sums[column, 2], sums[column, 3], sums[column, 4] = energy, virial, drag, laplacian, conservative


def _share(pairs, data, scratch, shares, source, part, parts, team):
    """The columns of one thread."""
    space = Scratch(scratch.values[part], scratch.bits[part], scratch.indices[part])
    columns, turns = shares.columns, len(shares.first)
    for turn in range(_ROUNDS * turns):
        first = shares.first[turn % turns]
        for mine in range(part, len(first) - 1, parts):
            if _GROUPED:
                _columns(pairs, data, space, source, columns[first[mine] : first[mine + 1]], part, turn // turns)
                continue
            for n in range(first[mine], first[mine + 1]):
                if _LISTS:
                    fetch_around(source, _written(data), columns[min(n + 1, len(columns) - 1)])
                _columns(pairs, data, space, source, columns[n], part, turn // turns)
        meet(team, parts)


@helper
def _enough(pairs, source):
    """Whether each column had room for its pairs."""
    room = np.uint64(len(pairs.pi) // len(source.bead))
    for column in range(len(pairs.found)):
        if pairs.found[column] > room:
            return False
    return True


def _over_pairs(pairs, data, scratch, shares, source, found, part, parts, team):
    begin, end = len(pairs.order) * part // parts, len(pairs.order) * (part + 1) // parts
    if _LISTS and not has_room(source):
        return 1
    if _BEGINS:
        _first(pairs, data, begin, end)
    meet(team, parts)
    _share(pairs, data, scratch, shares, source, part, parts, team)
    if _LISTS and not _enough(pairs, source):
        return 1
    if _ENDS:
        _last(pairs, data, begin, end)
    if part == 0:
        found[:] = 0.0
        for column in range(len(pairs.found)):
            for k in range(len(found)):
                found[k] += pairs.sums[column, k]
    return 0


# what over_pairs() puts in
_before: Any = nothing
_pair: Any = None
_columns: Any = None
_written: Any = None
_first: Any = None
_last: Any = None
_BEGINS = _ENDS = _LISTS = _GROUPED = _TENSOR = _DRAGS = _PARTS = False
_ROUNDS = np.uint64(1)


def over_pairs(
    name: str,
    pair: Callable,
    before: Callable = nothing,
    *,
    first: Callable | None = None,
    last: Callable | None = None,
    parallel: bool = True,
    again: Callable | None = None,
    rounds: int = 1,
    drags: bool = False,
    parts: bool = False,
    grouped: bool = False,
) -> Callable:
    """Function (list of pairs, data) -> :class:`Totals`, which goes through all pairs; compiled under a name of its own.

    With a third argument that is true it gives the stress tensor too; where it ``drags`` two, that of the friction's virial as well.  The
    function ``pair`` returns energy and two virials, one that ``parts`` the Laplacian and the conservative virial too.

    Where beads are many, loops that can be done ``again`` from the start, and say by data -> array (M, 3) what ``pair`` writes on, list the
    pairs of each column when they come to it (see :class:`.pairs.PairList`).  There ``pair`` changes nothing that ``first`` does not set.

    A loop of several ``rounds`` goes around so often, with other pairs of each column every time; it sums nothing, nor does one that is
    ``grouped``: there ``pair`` is called for each of the :mod:`.groups`, with its first pair and how many it has in the place of n and k.
    """
    around = {"_first": first, "_BEGINS": first is not None, "_last": last, "_ENDS": last is not None}

    @cache
    def kernel(tensor: bool, lists: bool) -> Kernel:
        """Those with tensors, and those that list, apart: many runs ask for none, and to compile all takes seconds."""
        word = f"{name}{'_tensor' * tensor}{'_lists' * lists}"
        inside = {"_pair": pair, "_before": before, "_LISTS": lists, "_TENSOR": tensor, "_DRAGS": drags, "_PARTS": parts}
        inside["_ROUNDS"] = np.uint64(rounds)
        column = inlined(renamed(grouped_columns if grouped else _column, f"{word}_column", inside))
        of_shares = {"_columns": column, "_LISTS": lists, "_written": again, "_ROUNDS": rounds, "_GROUPED": grouped}
        share = helper(renamed(_share, f"{word}_share", of_shares))
        return Kernel(renamed(_over_pairs, word, {"_share": share, "_LISTS": lists} | around))

    def call(pairs: PairList, data: NamedTuple, tensor: Any = False) -> Totals:
        lists = again is not None and not pairs.stored
        loop, sums = kernel(bool(tensor), lists), np.empty(5)
        while True:
            arrays, source = pairs.passing() if lists else (pairs.arrays, seats_for(pairs) if grouped else 0)
            if isinstance(pairs.flow, np.ndarray):
                arrays = arrays._replace(flow=pairs.flow)
            if tensor:
                arrays = arrays._replace(stress=np.zeros((1 + drags, len(arrays.found), 6)).reshape(-1, 6))
            shares, threads = pairs.shares(pairs.threads), pairs.threads if parallel else 1
            if not loop(arrays, data, pairs.scratch, shares, source, sums, parts=threads, memory=pairs.memory):
                break
            pairs.make_passing_room()
        Tape.note(sums, *(arrays.stress,) * bool(tensor))
        stress = None
        if tensor:
            pairs.tensors = arrays.stress
            found = arrays.stress.reshape(1 + drags, -1, 6).sum(axis=1)
            stress = found if drags else found[0]
        energy, virial, drag, *apart = sums.tolist()
        return Totals(energy, virial, drag, stress, *(apart if parts else ()))

    return call


@inlined
def row_of(pairs, i, j):
    """Row of two beads in a table of coefficients."""
    return 0 if pairs.ntypes == 1 else pairs.types[i] * pairs.ntypes + pairs.types[j]


@inlined
def factor_of(pairs, n):
    """Factor of bonded neighbours."""
    return pairs.factors[n] if len(pairs.factors) else 1.0


def _flows(pairs):
    """Whether a type of :class:`.pairs.Pairs` has a flow: decided when loops are compiled, so that those without are as ever."""
    return isinstance(pairs.types[pairs.fields.index("flow")], types.Array)


def along_flow(pairs, n, u):
    """The relative velocity u of a pair along x, with what the flow adds between the places of the two beads: rate times y_i - y_j."""
    raise NotImplementedError("for compiled code")


@by_types(along_flow)
def _along_flow(pairs, n, u):
    if _flows(pairs):
        return lambda pairs, n, u: u + pairs.flow[0] * (pairs.geometry[3, n] * pairs.geometry[1, n])
    return lambda pairs, n, u: u


def if_sheared(pairs, number):
    """A number where there is a flow, 0 where nobody wants it."""
    raise NotImplementedError("for compiled code")


@by_types(if_sheared)
def _if_sheared(pairs, number):
    return (lambda pairs, number: number) if _flows(pairs) else (lambda pairs, number: 0.0)


@inlined
def approach(pairs, v, n, i, j):
    """Relative velocity along the line between the beads of a pair."""
    g = pairs.geometry
    return g[0, n] * along_flow(pairs, n, v[i, 0] - v[j, 0]) + g[1, n] * (v[i, 1] - v[j, 1]) + g[2, n] * (v[i, 2] - v[j, 2])


@inlined
def push(f, i, j, fx, fy, fz):
    """Add a force to bead i, and the opposite one to bead j (another one: what is read first need not wait for what is written)."""
    xi, yi, zi, xj, yj, zj = f[i, 0], f[i, 1], f[i, 2], f[j, 0], f[j, 1], f[j, 2]
    f[i, 0], f[i, 1], f[i, 2] = xi + fx, yi + fy, zi + fz
    f[j, 0], f[j, 1], f[j, 2] = xj - fx, yj - fy, zj - fz


@inlined
def change(v, i, j, wi, wj, dx, dy, dz):
    """Give wi (dx, dy, dz) to bead i, and take wj (dx, dy, dz) from bead j."""
    xi, yi, zi, xj, yj, zj = v[i, 0], v[i, 1], v[i, 2], v[j, 0], v[j, 1], v[j, 2]
    v[i, 0], v[i, 1], v[i, 2] = xi + wi * dx, yi + wi * dy, zi + wi * dz
    v[j, 0], v[j, 1], v[j, 2] = xj - wj * dx, yj - wj * dy, zj - wj * dz


@inlined
def on_forces(data):
    """The array on which pairs write: forces."""
    return data.motion.f


@inlined
def on_velocities(data):
    """The array on which pairs write: velocities."""
    return data.v


@inlined
def clear(pairs, data, begin, end):
    """Begin with no force ``f`` (M, 3)."""
    f = data.motion.f
    for k in range(begin, end):
        f[k, 0] = f[k, 1] = f[k, 2] = 0.0


@inlined
def gather(pairs, data, begin, end):
    """Sort the velocities ``seen`` (N, 3), 0 if there are none, into ``v`` (M, 3)."""
    seen, v, seats = data.motion.seen, data.motion.v, pairs.seats
    for k in range(begin, end):
        if len(seen):
            i = seats[k]
            v[k, 0], v[k, 1], v[k, 2] = seen[i, 0], seen[i, 1], seen[i, 2]
        else:
            v[k, 0] = v[k, 1] = v[k, 2] = 0.0


@inlined
def gather_and_clear(pairs, data, begin, end):
    """:func:`clear` forces and :func:`gather` velocities."""
    clear(pairs, data, begin, end)
    gather(pairs, data, begin, end)


@inlined
def _put(f, out, add, seats, begin, end):
    for k in range(begin, end):
        i = seats[k]
        if add:
            out[i, 0] += f[k, 0]
            out[i, 1] += f[k, 1]
            out[i, 2] += f[k, 2]
        else:
            out[i, 0], out[i, 1], out[i, 2] = f[k, 0], f[k, 1], f[k, 2]


@inlined
def deliver(pairs, data, begin, end):
    """Write the forces ``f`` to ``out`` (N, 3), or add them there."""
    _put(data.motion.f, data.motion.out, data.motion.add, pairs.seats, begin, end)


@inlined
def gather_and_clear_rates(pairs, data, begin, end):
    """:func:`gather_and_clear`, and begin with no ``rates`` (M, K) of fields."""
    gather_and_clear(pairs, data, begin, end)
    for k in range(begin, end):
        for column in range(data.rates.shape[1]):
            data.rates[k, column] = 0.0


@inlined
def deliver_rates(pairs, data, begin, end):
    """:func:`deliver`, and add the ``rates`` to ``changing`` (N, K)."""
    deliver(pairs, data, begin, end)
    for k in range(begin, end):
        for column in range(data.rates.shape[1]):
            data.changing[pairs.seats[k], column] += data.rates[k, column]


@inlined
def gather_and_clear_both(pairs, data, begin, end):
    """:func:`gather_and_clear` where conservative forces ``c`` (M, 3) are added up apart too."""
    gather_and_clear(pairs, data, begin, end)
    for k in range(begin, end):
        data.c[k, 0] = data.c[k, 1] = data.c[k, 2] = 0.0


@inlined
def deliver_both(pairs, data, begin, end):
    """:func:`deliver`, and the forces ``c`` to ``held`` (N, 3)."""
    deliver(pairs, data, begin, end)
    _put(data.c, data.held, data.motion.add, pairs.seats, begin, end)


@inlined
def push_apart(pairs, f, n, i, j, radial):
    """Add a force along the line between two beads; returns its virial."""
    g = pairs.geometry
    push(f, i, j, radial * g[0, n], radial * g[1, n], radial * g[2, n])
    return radial * g[3, n]
