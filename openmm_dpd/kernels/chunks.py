"""What is looked up and computed for the pairs ``begin:begin + m`` of a list at once, before they act one after the other.

What is looked up somewhere goes to rows of the scratch first, one pass for each number: loops that read nothing but rows are vectorised.
"""

import numpy as np

from ..runtime import helper
from .columns import factor_of, row_of
from .elementary import power
from .pairs import SECOND


@helper
def look_up_one(table, column, pairs, m, scratch, row):
    """Put a column of a table of coefficients to a row of the values; :func:`look_up` has been there before."""
    values, indices = scratch.values, scratch.indices
    if pairs.ntypes > 1:
        for k in range(m):
            values[row + k] = table[indices[k], column]
    else:
        for k in range(m):
            values[row + k] = table[0, column]


@helper
def look_up(table, columns, pairs, begin, m, scratch, row):
    """Put the factors, 0 beyond the cutoff, and some columns of a table of coefficients, the cutoff (the second) among them, to rows of the
    values from this one on; each column has a row of its own."""
    values, cutoff = scratch.values, row + SECOND + SECOND
    if pairs.ntypes > 1:
        for k in range(m):
            scratch.indices[k] = row_of(pairs, pairs.pi[begin + k], pairs.pj[begin + k])
    for column in columns:
        look_up_one(table, column, pairs, m, scratch, row + np.uint64(column + 1) * SECOND)
    for k in range(m):
        values[row + k] = factor_of(pairs, begin + k) if pairs.geometry[3, begin + k] < values[cutoff + k] else 0.0


@helper
def powers(m, scratch, base, exponent):
    """Put a row of the values to the :func:`power` in another one, 0 where it is not above 0."""
    values, ones, roots = scratch.values, np.uint64(0), np.uint64(0)
    for k in range(m):
        s = values[exponent + k]
        values[base + k] = max(0.0, values[base + k])
        ones += np.uint64(s == 1.0)
        roots += np.uint64(s == 0.5)
    if ones < m and ones + roots == m:
        for k in range(m):
            w, root = values[base + k], np.sqrt(values[base + k])
            values[base + k] = w if values[exponent + k] == 1.0 else root
    elif ones < m:
        for k in range(m):
            values[base + k] = power(values[base + k], values[exponent + k])


@helper
def look_at(numbers, pairs, begin, m, scratch, first, second):
    """Put a number of each bead to two rows of the values: those of the first, and of the second beads."""
    for k in range(m):
        scratch.values[first + k], scratch.values[second + k] = numbers[pairs.pi[begin + k]], numbers[pairs.pj[begin + k]]
