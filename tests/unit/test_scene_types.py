"""Tables of many types: what each pair gets, and that a thousand types are no matter of minutes."""

import time
from itertools import combinations_with_replacement

import numpy as np
import pytest

import openmm_dpd as dpd


@pytest.mark.parametrize("seed", range(5))
def test_later_entries_win_and_order_has_no_meaning(seed):
    rng = np.random.default_rng(seed)
    names = list("ABCDE")
    keys = [tuple(rng.choice([*names, "*"], 2)) for _ in range(12)]
    entries = {}
    for number, key in enumerate(dict.fromkeys((str(a), str(b)) for a, b in keys)):
        if key[::-1] not in entries:
            entries[key] = dpd.DPD(A=float(number), gamma=1.0)
    found = dpd.PairTable(entries).resolve(names)

    def naive(pair):
        values = [c for (a, b), c in entries.items() if any((a in (x, "*")) and (b in (y, "*")) for x, y in (pair, pair[::-1]))]
        return values[-1] if values else None

    wanted = {pair: naive(pair) for pair in combinations_with_replacement(names, 2)}
    assert found == {pair: value for pair, value in wanted.items() if value is not None}


def test_kernel_tables_are_symmetric_and_in_the_order_of_the_types():
    values = {("A", "A"): 1.0, ("B", "A"): 2.0, ("B", "B"): 3.0, ("C", "A"): 4.0, ("B", "C"): 5.0}
    pairs = {key: dpd.DPD(A=a, gamma=a / 10) for key, a in values.items()} | {("C", "C"): dpd.NONE}
    scene = dpd.Scene({"A": 1.0, "B": 1.0, "C": 1.0}, list("ABC"), np.eye(3), pairs, kT=1.0, box=[4.0] * 3)
    (table,) = dpd.make_plan(scene, dt=0.01).spec.terms
    np.testing.assert_array_equal(table.A, [[1, 2, 4], [2, 3, 5], [4, 5, 0]])
    np.testing.assert_array_equal(table.gamma, np.array([[1, 2, 4], [2, 3, 5], [4, 5, 0]]) / 10)


def test_many_types_take_no_more_than_their_pairs():
    """45,150 pairs: 0.4 s where this was written; a search through all pairs for each entry would take more than ten minutes."""
    names = [f"T{k}" for k in range(300)]
    pairs = {pair: dpd.DPD(A=25.0, gamma=4.5) for pair in combinations_with_replacement(names, 2)}
    begun = time.process_time()
    scene = dpd.Scene(dict.fromkeys(names, 1.0), names, np.random.default_rng(1).random((300, 3)) * 5, pairs, kT=1.0, box=[5.0] * 3)
    dpd.build(scene, dt=0.01, platform="CPU")
    assert time.process_time() - begun < 20
