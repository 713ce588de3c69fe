"""Pair lists: every pair once, for any box, images and number of threads."""

import itertools

import numpy as np
import oracle
import pytest
from cases import raises
from scenes import BOX, BOXES, EXTENDED, TABLES, chains, factor_of, fluid, listed_pairs, oracle_params, ready

from openmm_dpd import RunError
from openmm_dpd.base.geometry import coincident_pairs
from openmm_dpd.kernels.dpd import TermTable
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, STRESS, PairEngine, PairSpec
from openmm_dpd.kernels.shares import Shares, abreast, apart, blocks_of, by_colours, share_out
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.runtime import threads as thread_count
from openmm_dpd.runtime.threads import set_threads


def engine_of(scene, **choices) -> PairEngine:
    return PairEngine(make_plan(scene, dt=0.01, seed=1, **choices).spec)


def table_of(cutoff: float, types: int = 1) -> TermTable:
    def full(value):
        return np.full((types, types), float(value))

    return TermTable(full(25), full(4.5), full(np.nan), full(0), full(1), full(1), full(cutoff))


def simple_engine(n: int, cutoff: float = 1.0) -> PairEngine:
    return PairEngine(PairSpec(np.zeros(n, np.int32), np.ones(n), (table_of(cutoff),)))


def unordered(pairs) -> list[tuple[int, int]]:
    return sorted((min(p), max(p)) for p in pairs)


def oracle_pairs(x, box, cutoff=1.0) -> list[tuple[int, int]]:
    found = oracle.pair_list(x, np.zeros(len(x), int), oracle.PairParams.build(cutoff=cutoff), box)
    return sorted(zip(found.i.tolist(), found.j.tolist(), strict=True))


@BOX
@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES.keys())
@pytest.mark.parametrize("density", [0.3, 3.0])
def test_every_pair_is_listed_once(box, table, density):
    scene = fluid(table, box, density, seed=3)
    engine = ready(engine_of(scene), scene.positions, box)
    found = oracle.pair_list(scene.positions, scene.type_ids, oracle_params(scene), box)
    pairs = listed_pairs(engine)
    assert unordered(pairs) == sorted(zip(found.i.tolist(), found.j.tolist(), strict=True))
    assert len(pairs) > 2


@BOX
def test_geometry_of_the_listed_pairs(box):
    """Unit vector from j to i and distance, by minimum image."""
    scene = fluid(EXTENDED, box, seed=5)
    engine = ready(engine_of(scene), scene.positions, box)
    found = oracle.pair_list(scene.positions, scene.type_ids, oracle_params(scene), box)
    expected = {(i, j): (*e, r) for i, j, r, e in zip(*found, strict=True)}
    pairs = engine.lists[0]
    rows = pairs.rows
    for (i, j), row in zip(listed_pairs(engine), rows, strict=True):
        got = np.array(pairs.arrays.geometry[:, row])
        if i > j:
            i, j, got[:3] = j, i, -got[:3]
        np.testing.assert_allclose(got, expected[i, j], rtol=0, atol=1e-13 * (1 + np.abs(scene.positions).max()))


@pytest.mark.parametrize("seed", range(6))
def test_lattice_beads_exactly_on_the_faces_of_a_tilted_box(seed):
    """Positions k/5 of each box vector plus whole boxes: rounding may put a bead on either side of a face, but must not lose its pairs."""
    rng = np.random.default_rng(seed)
    edges = rng.uniform(3.3, 5.0, 3)
    box = np.diag(edges)
    tilt = rng.uniform(-0.5, 0.5, 3) if seed % 3 else np.array([0.5, -0.5, 0.5])
    box[1, 0], box[2, 0], box[2, 1] = tilt[0] * edges[0], tilt[1] * edges[0], tilt[2] * edges[1]
    lattice = np.array(list(itertools.product(range(5), repeat=3))) / 5.0
    x = (lattice + rng.integers(-2, 3, lattice.shape)) @ box
    engine = ready(simple_engine(len(x)), x, box)
    # pairs at the cutoff itself may fall on either side of it by rounding
    inside, outside = (set(oracle_pairs(x, box, cutoff)) for cutoff in (1 - 1e-9, 1 + 1e-9))
    pairs = unordered(listed_pairs(engine))
    assert len(pairs) == len(set(pairs))
    assert inside <= set(pairs) <= outside


@BOX
def test_order_of_pairs_is_a_function_of_the_positions(box):
    """Another engine, an engine that saw other positions before, and the second call all list the same order."""
    scene, other = fluid(EXTENDED, box, seed=3), fluid(EXTENDED, box, 4.0, n=fluid(EXTENDED, box, seed=3).n_beads, seed=8)
    fresh, used = engine_of(scene), engine_of(scene)
    used.prepare(other.positions, None if box is None else box * 1.3)
    for engine in (fresh, used, used):
        engine.prepare(scene.positions, box)
    assert listed_pairs(fresh) == listed_pairs(used)


@BOX
def test_order_of_pairs_does_not_depend_on_the_rows_of_beads(box):
    """Nor where more beads are in a cell than are compared at once."""
    scene = fluid(EXTENDED, box, seed=3)
    x = scene.positions.copy()
    x[::3] = x[0] + 0.1 * (x[::3] - x[0])
    names = np.random.default_rng(4).permutation(len(x)).astype(np.uint32)
    plain, seated = ready(engine_of(scene), x, box), engine_of(scene)
    seated.seat(names, np.argsort(names).astype(np.uint32))
    ready(seated, np.ascontiguousarray(x[names]), box)
    assert listed_pairs(plain) == listed_pairs(seated) and np.array_equal(plain.sorted_beads(), seated.sorted_beads())


@BOX
@pytest.mark.parametrize("density", [0.3, 3.0])
def test_same_bits_for_one_and_two_threads(box, density, two_threads):
    scene = fluid(EXTENDED, box, density, seed=6)
    results = []
    for threads in (1, 2):
        set_threads(threads)
        engine = engine_of(scene)
        for _ in range(3):
            engine.prepare(scene.positions, box)
            energy, force, virial = engine.forces(CONSERVATIVE | DISSIPATIVE | RANDOM, scene.velocities, 1.0, 0.01, 5, 9)
            results.append((energy, virial, force, engine.sweep(scene.velocities, 1.0, 0.01, 5, 9)))
    for other in results[1:]:
        assert other[:2] == results[0][:2]
        assert np.array_equal(other[2], results[0][2]) and np.array_equal(other[3], results[0][3])


@BOX
@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES.keys())
def test_same_bits_where_loops_list_the_pairs(box, table, two_threads):
    """As with many beads, with tensors and without, for one and two threads, where columns become full.  In the narrowest boxes, which have no
    columns, pairs are stored."""
    scene = fluid(table, box, seed=6)
    stored, late = engine_of(scene), engine_of(scene)
    late.lists[0].many = True
    thin = scene.positions * 1.2, None if box is None else box * 1.2
    for threads in (1, 2):
        set_threads(threads)
        for place in (thin, (scene.positions, box), thin):
            found = []
            for engine in (stored, late):
                engine.prepare(*place)
                assert engine.lists[0].stored == (engine is stored or (box is not None and engine.lists[0].grid(*place)[3:] == (1, 1, 1)))
                sums = engine.sums(
                    CONSERVATIVE | DISSIPATIVE | RANDOM | STRESS, scene.velocities, 1.0, 0.01, 5, 9, out=(force := 0.0 * place[0])
                )
                swept = engine.swept(scene.velocities, 1.0, 0.01, 5, 9)
                found.append([*sums[:4], force, swept, engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0)[1]])
            assert all(map(np.array_equal, *found))


def test_one_thread_alone_does_what_two_would(monkeypatch, two_threads):
    """Where there are not cores enough, with room for two."""
    scene, found = fluid(TABLES["dpd"], BOXES["ortho"], seed=6), []
    set_threads(2)
    for until in (0.0, np.inf):
        monkeypatch.setattr(thread_count._WATCH, "until", until)
        engine = engine_of(scene)
        for _ in range(2):
            engine.prepare(scene.positions, BOXES["ortho"])
            forces = engine.forces(CONSERVATIVE | DISSIPATIVE, scene.velocities, 1.0, 0.01, 5, 9)
            found.append([*forces, engine.sweep(scene.velocities, 1.0, 0.01, 5, 9)])
    for other in found[1:]:
        assert all(map(np.array_equal, found[0], other))


@pytest.mark.parametrize("box", [None, BOXES["tilted"]], ids=["none", "tilted"])
def test_parts_the_work_is_cut_into_do_not_change_the_order(box):
    """Any number of chunks of beads and tasks of columns, also more than there are beads in a cell or columns: the same sorted beads and pairs."""
    scene = fluid(EXTENDED, box, seed=4)
    engine = ready(engine_of(scene), scene.positions, box)
    pairs, expected = engine.lists[0], listed_pairs(engine)
    order, geometry, rows = pairs.order.copy(), pairs.arrays.geometry.copy(), pairs.rows
    grid = pairs.grid(scene.positions, box)
    for parts in (2, 3, 7, 300):
        pairs.order[:], pairs.arrays.geometry[:] = 0, np.nan
        pairs.bin(scene.positions, grid, parts)
        assert np.array_equal(pairs.order, order)
        pairs.arrays.found[:] = 0
        pairs.list(grid, parts)
        assert listed_pairs(engine) == expected
        assert np.array_equal(pairs.arrays.geometry[:, rows], geometry[:, rows])


def touched(column, ny, nz):
    """The columns whose beads a column touches, recomputed from the geometry: (y +- 1, z), and (y - 1 ... y + 1, z + 1), around the box."""
    y, z = column % ny, column // ny
    return {(a % ny, b % nz) for a, b in {(y, z), (y + 1, z), (y - 1, z + 1), (y, z + 1), (y + 1, z + 1)}}


def coloured_blocks(ny, nz):
    """Blocks of columns, the colour of each, and the columns it touches."""
    blocks = blocks_of(ny, nz)
    found = [(blocks.columns[k], colour) for colour, its in enumerate(by_colours(blocks)) for k in its]
    return *zip(*found, strict=True), [set().union(*(touched(column, ny, nz) for column in block)) for block, _ in found]


GRIDS = [(1, 1), (2, 5), (3, 3), (3, 4), (4, 3), (5, 5), (6, 7), (7, 6), (9, 8), (11, 13), (12, 11), (5, 40), (33, 34)]


@pytest.mark.parametrize(("ny", "nz"), GRIDS)
def test_tasks_of_one_colour_never_touch_the_same_column(ny, nz):
    blocks, colours, reach = coloured_blocks(ny, nz)
    assert sorted(np.concatenate(blocks)) == list(range(ny * nz))
    for colour in range(4):
        for first, second in itertools.combinations([its for its, c in zip(reach, colours, strict=True) if c == colour], 2):
            assert not first & second


@pytest.mark.parametrize("parts", [1, 2, 3, 5])
@pytest.mark.parametrize("uneven", [False, True], ids=["even", "uneven"])
@pytest.mark.parametrize(("ny", "nz"), GRIDS)
def test_blocks_that_touch_the_same_bead_come_in_the_order_of_their_colours(ny, nz, uneven, parts):
    """Whichever thread does them, one alone too, and where nearly all pairs lie in one layer."""
    blocks, colours, reach = coloured_blocks(ny, nz)
    of_columns: dict[tuple[int, int], list[int]] = {}
    for block, touched in enumerate(reach):
        for column in touched:
            of_columns.setdefault(column, []).append(block)
    both = {pair for its in of_columns.values() for pair in itertools.permutations(its, 2)}
    touching = [(one, other) for one, other in both if colours[one] < colours[other]]
    assert touching or len(reach) == 1
    work = np.full(ny * nz, 10)
    if uneven:
        work[ny * (nz // 2) : ny * (nz // 2 + 1)] = 10_000
    first, columns = share_out(blocks_of(ny, nz), work, parts)
    block_of = {int(column): block for block, its in enumerate(blocks) for column in its}
    when: dict[int, list] = {}
    for (turn, row), part in itertools.product(enumerate(first), range(parts)):
        for n in range(row[part], row[part + 1]):
            when.setdefault(block_of[int(columns[n])], []).append((turn, part, n))
    assert first.shape[1] == parts + 1 and sorted(columns) == list(range(ny * nz))
    for one, other in touching:
        (turn, part, n), (later, its, m) = when[one][-1], when[other][0]
        # turns end with a meeting of all; a thread alone does the shares of all in each
        assert turn < later or (turn == later and part == its and n < m)
    for its in when.values():
        assert {time[:2] for time in its} == {its[0][:2]}


@pytest.mark.parametrize(("ny", "nz"), [(33, 34), (12, 9)])
def test_shares_are_of_as_many_pairs(ny, nz):
    """Of columns with 10 to 1,000 pairs, however they lie; where there are few of them the largest block may be too much for one."""
    work = np.exp(np.random.default_rng(2).uniform(np.log(10), np.log(1000), ny * nz)).astype(int)
    for parts in (2, 3):
        first, columns = share_out(blocks_of(ny, nz), work, parts)
        turns = [max(work[columns[row[p] : row[p + 1]]].sum() for p in range(parts)) for row in first]
        assert sum(turns) < (1.1 if ny == 33 else 1.35) * work.sum() / parts


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize(("ny", "nz"), [(1, 1), (3, 4), (4, 8), (6, 7), (9, 8), (14, 14)])
def test_columns_that_are_done_two_at_a_time_touch_no_bead_both(ny, nz, parts):
    """And those that do come in the order in which they came."""
    reach = [touched(column, ny, nz) for column in range(ny * nz)]
    for one, other in itertools.product(range(ny * nz), repeat=2):
        assert not (apart(one, other, ny, nz) and reach[one] & reach[other])
    usual = share_out(blocks_of(ny, nz), np.full(ny * nz, 10), parts)
    first, columns = abreast(Shares(usual.first, usual.columns.copy()), ny, nz)
    two = 0
    for row, part in itertools.product(usual.first, range(parts)):
        before, after = (its[row[part] : row[part + 1]].tolist() for its in (usual.columns, columns))
        assert sorted(before) == sorted(after)
        for one, other in itertools.combinations(before, 2):
            assert after.index(one) < after.index(other) or not reach[one] & reach[other]
        two += sum(apart(*its, ny, nz) for its in itertools.pairwise(after))
    assert np.array_equal(first, usual.first) and two >= (ny * nz // 3 if ny > 8 else 0)


EDGES = {
    "long": np.diag([3000.0, 4.0, 4.0]),
    "tilted": np.array([[50.0, 0, 0], [-20.0, 40.0, 0], [15.0, -10.0, 30.0]]),
    "none": None,
}


@pytest.mark.parametrize("edge", EDGES)
def test_which_beads_are_pairs_is_exact(edge):
    """Beads that are just within the cutoff, or just beyond it, or nearly or quite in one place: they are looked for in single precision, whose
    digits end at a hundredth of the cutoff in the longest of these boxes.  Without a box they are far from the origin."""
    rng, box = np.random.default_rng(8), EDGES[edge]
    first = rng.random((300, 3)) @ (np.diag([50.0] * 3) if box is None else box) + (1e6 if box is None else 0.0)
    away = rng.normal(size=(300, 3))
    away /= np.linalg.norm(away, axis=1)[:, None]
    far = 1.0 + rng.choice([-1e-3, -1e-4, -1e-6, -1e-8, 1e-8, 1e-6, 1e-4, 1e-3], 300)
    far[:20], far[20:40] = 0.0, 1e-5
    x = np.concatenate([first, first + far[:, None] * away])
    engine = simple_engine(len(x))
    engine.prepare(x, box)
    found = unordered(listed_pairs(engine))
    near = {(k, k + 300) for k in np.flatnonzero((far < 1.0) & (far > 0.0)).tolist()}
    assert {pair for pair in found if pair[1] == pair[0] + 300} == near
    assert len(found) == len(set(found)) == len(oracle_pairs(x, box))


def test_more_pairs_than_there_was_room_for():
    """The list grows when beads collapse into one cell, and the engine can be used again afterwards."""
    rng = np.random.default_rng(7)
    box = np.diag([6.0] * 3)
    spread, heap = rng.random((200, 3)) * 6, 3 + rng.random((200, 3)) * 0.3
    engine = simple_engine(200)
    for x in (spread, heap, spread):
        engine.prepare(x, box)
        assert unordered(listed_pairs(engine)) == oracle_pairs(x, box)
    engine.prepare(heap, box)
    assert len(listed_pairs(engine)) == 200 * 199 // 2


def test_a_new_box_at_the_same_positions_is_noticed():
    x = np.array([[0.1, 0.1, 0.1], [3.9, 0.1, 0.1]])
    engine = simple_engine(2)
    for edge, count in ((4.0, 1), (5.0, 0), (4.0, 1)):
        engine.prepare(x, np.diag([edge, 4.0, 4.0]))
        assert len(listed_pairs(engine)) == count
    engine.prepare(x, None)
    assert len(listed_pairs(engine)) == 0


@pytest.mark.parametrize("box", [None, np.diag([4.0] * 3)], ids=["none", "box"])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_very_few_beads(box, n):
    x = np.array([[0.1, 0.2, 0.3], [3.95, 0.2, 0.3], [0.1, 0.2, 0.9]])[:n]
    engine = ready(simple_engine(n), x, box)
    assert unordered(listed_pairs(engine)) == oracle_pairs(x, box)
    assert engine.sweep(np.zeros((n, 3)), 1.0, 0.01, 1, 1).shape == (n, 3)


@pytest.mark.parametrize("distance", [0.0, 1e-300, 1e-12, 9.9e-11])
@pytest.mark.parametrize("box", [None, np.diag([4.0] * 3), np.diag([2.0] * 3)], ids=["none", "box", "narrow"])
def test_beads_closer_than_1e_10_are_no_pair(distance, box):
    x = np.array([[0.0, 0.0, 0.0], [distance, 0.0, 0.0], [0.5, 0.0, 0.0]])
    engine = ready(simple_engine(3), x, box)
    assert unordered(listed_pairs(engine)) == [(0, 2), (1, 2)]
    x[1, 0] = 2e-10
    engine.prepare(x, box)
    assert unordered(listed_pairs(engine)) == [(0, 1), (0, 2), (1, 2)]


@pytest.mark.parametrize("box", [None, np.diag([4.0] * 3)], ids=["none", "box"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_position_that_is_not_finite_is_named(box, value):
    x = np.random.default_rng(1).random((10, 3))
    x[7, 1] = value
    engine = simple_engine(10)
    raises(RunError, "bead 7", engine.prepare, x, box)
    x[7, 1] = 0.5  # and the engine is not left with a broken list
    engine.prepare(x, box)
    assert unordered(listed_pairs(engine)) == oracle_pairs(x, box)


@pytest.mark.parametrize("far", [1e5, 1e7, 1e10, 1e14])
def test_beads_without_a_box_may_be_far_apart(far):
    """Cells are limited in number, for any extent (a million cells along each edge would overflow their count)."""
    x = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [far, far, -far], [far, 0.25 * far, -far], [far, far + 0.5, -far]])
    engine = ready(simple_engine(len(x)), x, None)
    assert unordered(listed_pairs(engine)) == oracle_pairs(x, None)


def test_few_beads_in_a_huge_box():
    box = np.diag([1e6, 2e6, 3e6])
    x = np.array([[0.2, 0.1, 0.1], [1e6 - 0.3, 0.1, 0.1], [5e5, 1e6, 1e6], [5e5, 1e6, 1e6 + 0.5]])
    engine = ready(simple_engine(len(x)), x, box)
    assert unordered(listed_pairs(engine)) == [(0, 1), (2, 3)]


def test_particles_of_type_minus_one_take_no_part():
    x, types = np.random.default_rng(3).random((40, 3)) * 2, np.where(np.arange(40) % 3 == 0, -1, 0).astype(np.int32)
    x[0] = np.nan  # not even looked at
    engine = ready(PairEngine(PairSpec(types, np.ones(40), (table_of(1.0),))), x, None)
    members = np.flatnonzero(types == 0)
    found = oracle_pairs(x[members], None)
    assert unordered(listed_pairs(engine)) == sorted((int(members[i]), int(members[j])) for i, j in found)
    force = engine.forces(CONSERVATIVE | RANDOM, None, 1.0, 0.1, 1, 1)[1]
    assert np.all(force[types < 0] == 0) and np.all(np.isfinite(force))


@BOX
def test_pairs_with_factor_zero_are_left_out(box):
    scene = chains(box)
    engine = ready(engine_of(scene), scene.positions, box)
    factor = factor_of(scene)
    found = oracle.pair_list(scene.positions, scene.type_ids, oracle_params(scene), box)
    expected = [(i, j) for i, j in zip(found.i.tolist(), found.j.tolist(), strict=True) if factor(i, j) > 0]
    assert unordered(listed_pairs(engine)) == sorted(expected)
    assert len(expected) < len(found.i)


@BOX
def test_coincident_pairs_across_faces(box):
    rng = np.random.default_rng(9)
    frame = np.diag([4.0] * 3) if box is None else box
    x = rng.random((60, 3)) @ frame
    x[10] = x[3]
    x[20] = x[4] + [3e-5, 0, 0]
    x[30] = x[4] - [2e-5, 0, 0]
    x[5], x[40] = 0.0, 0.0 if box is None else frame.sum(axis=0)
    x[50], x[51] = [0, 1.0, 1.0], [1e-5, 1.0, 1.0]
    if box is not None:
        x[51] = x[50] - [1e-5, 0, 0] + frame[0]
        x[20] += 2 * frame[2]
    assert coincident_pairs(x, box, 1e-4) == [(3, 10), (4, 20), (4, 30), (5, 40), (20, 30), (50, 51)]
