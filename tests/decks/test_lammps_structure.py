"""Computes rdf, msd and gyration: planted configurations, words that name their values, and files number by number beside LAMMPS."""

import lammps_peer
import numpy as np
import pytest
from cases import cases, raises
from test_analysis_structure import trajectory_of
from test_lammps_chunks import BEADS, BLOCK, DECK, FLUID, FREE, PRISM, QUICK, beside_lammps, context_of, request_of

from openmm_dpd.analysis import radial_distribution
from openmm_dpd.base.errors import DeckError
from openmm_dpd.base.geometry import pairs_within
from openmm_dpd.lammps import run_deck


# -- rdf -----------------------------------------------------------------------------------------------------------------------
def test_rdf_is_that_of_the_analysis(tmp_path):
    """Columns in LAMMPS's order: r, then g(r) and the number of neighbours; also where beads have left the box."""
    text = "compute r all rdf 8 * * 1 2 2 2 cutoff 2.4\nvariable g equal c_r[3][2]+c_r[8][7]\nthermo_style custom c_r[4][1] c_r[4][2] v_g\n"
    request = request_of(tmp_path, DECK + text)
    context = context_of(request, shift=(-18.0, 10.0, 6.0))
    table = np.array([[context.compute("r", row, column) for column in range(1, 8)] for row in range(1, 9)])
    positions = request.state.atoms.positions
    trajectory = trajectory_of(positions, ["1"] * 60 + ["2"] * 40, np.diag([6.0, 5.0, 6.0]))
    for column, (first, second) in enumerate(((None, None), ("1", "2"), ("2", "2"))):
        expected = radial_distribution(trajectory, first, second, r_max=2.4, n_bins=8)
        np.testing.assert_allclose(table[:, 0], expected.x)
        np.testing.assert_allclose(table[:, 1 + 2 * column], expected.y, rtol=1e-12)
    i, _, _ = pairs_within(positions[:60], positions[60:], np.diag([6.0, 5.0, 6.0]), 2.4)
    assert table[-1, 4] == pytest.approx(len(i) / 60)
    values = request.thermo.values(context.sample)
    assert list(values.values()) == pytest.approx([table[3, 0], table[3, 1], table[2, 1] + table[7, 6]])


def test_rdf_in_averages(tmp_path):
    """``mode vector`` takes columns, side by side; ``c_r[*]`` is all of them."""
    text = "compute r two rdf 5 2 2\nfix a all ave/time 1 2 10 c_r[*] mode vector\nfix b all ave/time 10 1 10 c_r[2] mode vector\n"
    text += "fix c all ave/time 10 1 10 c_r[3][2] f_a[5][3] f_b[4]\nthermo_style custom f_a[3][2] f_c[1]\n"
    request = request_of(tmp_path, DECK + text)
    averages = request.averages
    assert averages[0].words == ("c_r[1]", "c_r[2]", "c_r[3]")
    one, other = context_of(request, 9), context_of(request, 10)
    other.sample.positions[:] = np.random.default_rng(1).random((100, 3)) * 5
    averages[0].take(one)
    for average in averages:
        average.take(other)
    column = np.array([[context.compute("r", row, 2) for row in range(1, 6)] for context in (one, other)])
    assert averages[0].value(3, 2) == pytest.approx(column[:, 2].mean())
    assert averages[1].value(4) == pytest.approx(column[1, 3])
    assert averages[2].value(1) == pytest.approx(column[1, 2])
    assert averages[2].value(3) == pytest.approx(averages[1].value(4))
    assert averages[0].value(5, 1) == pytest.approx(0.9)  # the longest cutoff of the pair forces is 1


# -- msd and gyration ----------------------------------------------------------------------------------------------------------
def test_displacements_count_from_where_the_compute_stands(tmp_path):
    request = request_of(tmp_path, DECK + "compute m all msd\ncompute c two msd com yes\ncompute g two gyration\n")
    moved = context_of(request, shift=(-18.0, 3.0, 0.5))
    assert [moved.compute("m", k) for k in (1, 2, 3, 4)] == pytest.approx([324, 9, 0.25, 333.25])
    assert [moved.compute("c", k) for k in (1, 2, 3, 4)] == pytest.approx([0, 0, 0, 0], abs=1e-12)
    tensor = np.cov(request.state.atoms.positions[60:].T, bias=True)
    assert moved.compute("g", None) == pytest.approx(np.sqrt(tensor.trace()))
    assert [moved.compute("g", k) for k in range(1, 7)] == pytest.approx(tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])


def test_values_equal_naive_loops(tmp_path):
    """g(r) and neighbours of unlike types, squared displacements and gyration tensor, to 1e-10."""
    text = "compute r all rdf 6 1 2 cutoff 2.4\ncompute m two msd com yes\ncompute g all gyration\n"
    request = request_of(tmp_path, DECK + text)
    moment, start = context_of(request), request.state.atoms.positions
    moment.sample.positions[:] += np.random.default_rng(5).normal(0, 0.3, start.shape)
    x, edges, masses = moment.sample.positions, np.array([6.0, 5.0, 6.0]), request.state.bead_masses()
    counts = [0] * 6
    for a in x[:60]:
        for b in x[60:]:
            gap = [(p - q + edge / 2) % edge - edge / 2 for p, q, edge in zip(a, b, edges, strict=True)]
            r = sum(g * g for g in gap) ** 0.5
            if r < 2.4:
                counts[int(r / 0.4)] += 1
    for k in range(6):
        shell = 4 * np.pi / 3 * 0.4**3 * ((k + 1) ** 3 - k**3)
        assert moment.compute("r", k + 1, 2) == pytest.approx(counts[k] * 180.0 / (60 * 40 * shell), rel=1e-10)
        assert moment.compute("r", k + 1, 3) == pytest.approx(sum(counts[: k + 1]) / 60, rel=1e-10)
    two = range(60, 100)
    centres = [sum(masses[k] * y[k] for k in two) / sum(masses[k] for k in two) for y in (start, x)]
    moved = sum(((x[k] - centres[1]) - (start[k] - centres[0])) ** 2 for k in two) / 40
    assert [moment.compute("m", k) for k in (1, 2, 3, 4)] == pytest.approx([*moved, sum(moved)], rel=1e-10)
    centre = sum(m * y for m, y in zip(masses, x, strict=True)) / sum(masses)
    tensor = sum(m * np.outer(y - centre, y - centre) for m, y in zip(masses, x, strict=True)) / sum(masses)
    assert [moment.compute("g", k) for k in range(1, 7)] == pytest.approx(tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], rel=1e-10)


def test_rdf_reaches_as_far_as_the_longest_cutoff(tmp_path):
    """Also that of pair style zero, which has no force."""
    styles = "pair_style hybrid/overlay zero 1.8 dpd 0 1 7\npair_coeff * * zero\npair_coeff * * dpd 25 4.5\ncompute r all rdf 6\n"
    moment = context_of(request_of(tmp_path, DECK + styles))
    assert [moment.compute("r", k, 1) for k in (1, 6)] == pytest.approx([0.15, 1.65])


def test_mean_positions_are_taken_once_a_step(tmp_path):
    request = request_of(tmp_path, DECK + "compute m all msd average yes\n")
    first = context_of(request, 1, shift=(1.0, 0, 0))
    assert [first.compute("m", 1) for _ in range(3)] == pytest.approx([0.25] * 3)  # the mean of the origin and these positions is 1/2
    assert context_of(request, 2, shift=(4.0, 0, 0)).compute("m", 4) == pytest.approx((4 - 5 / 3) ** 2)


def test_mean_positions_do_not_depend_on_who_reads_them(tmp_path):
    """An average that is due at the step of a row does not count its positions twice."""
    text = DECK + "compute m all msd average yes\nthermo 1\nthermo_style custom step c_m[4]\nthermo_modify format float %.17g\n{}run 6\n"
    found = []
    for more in ("", "fix a all ave/time 1 1 1 c_m[4]\n"):
        lines = lammps_peer.printed(tmp_path / "in.deck", text.format(more))
        found.append([line for line in lines if line.split()[:1] in [[str(step)] for step in range(7)]])
    assert found[0] == found[1] and len(found[0]) == 7 and float(found[0][-1].split()[1]) > 0


@cases(
    "text, message",
    ("compute r all rdf 0\n", "number of bins"),
    ("compute r all rdf 10 1\n", "pairs of types"),
    ("compute r all rdf 10 1 3\n", "atom type 3 is out of range"),
    ("compute r all rdf 10 cutoff\n", "one value after cutoff"),
    ("compute r all rdf 10 cutoff 2.6\nfix a all ave/time 1 1 1 c_r[2] mode vector\nrun 1\n", "more than half the smallest width"),
    ("compute r all rdf 10\nthermo_style custom c_r[2]\n", r"table of values; use c_r\[row\]\[column\]"),
    ("compute r all rdf 10\nthermo_style custom c_r[11][2]\n", "has 10 rows and 3 columns"),
    ("compute r all rdf 10\nthermo_style custom c_r[*]\n", "table of values"),
    ("compute r all rdf 10\nfix a all ave/time 1 1 1 c_r mode vector\n", "table of values"),
    ("compute r all rdf 10\nfix a all ave/time 1 1 1 c_r[4] mode vector\n", "has 10 rows and 3 columns"),
    ("compute t all temp\nthermo_style custom c_t[1][1]\n", "has no table of values"),
    ("compute t all temp\nvariable a equal c_t[1][1]\nthermo_style custom v_a\nrun 1\n", "has no table of values"),
    ("compute m all msd com maybe\n", "com"),
    ("compute m all msd\nthermo_style custom c_m\n", "has no single value"),
    ("compute m two msd\ngroup two type 1\nthermo_style custom c_m[4]\nrun 1\n", "had 40 at its definition"),
    ("compute g all gyration x\n", "and no more"),
    (
        "compute k all property/atom x y\ncompute r all reduce sum c_k[2]\nthermo_style custom c_r\nuncompute k\n"
        "compute k all property/atom x\nrun 1\n",
        "compute k .style property/atom. no longer has a column 2",
    ),
)
def test_errors(tmp_path, text, message):
    (tmp_path / "in.deck").write_text(DECK + text)
    raises(DeckError, message, lambda: run_deck(tmp_path / "in.deck", QUICK, out=tmp_path))


# -- LAMMPS --------------------------------------------------------------------------------------------------------------------
MEASURED = """comm_modify cutoff 3.5
compute r all rdf 12 cutoff 1.9
compute q two rdf 7 * 2 1*2 2 1 1
compute m all msd
compute c two msd com yes
compute a all msd average yes
compute b two msd com yes average yes
compute g two gyration
fix r all ave/time 2 3 10 c_r[*] mode vector file r.out {form}
fix q all ave/time 10 1 10 c_q[*] mode vector file q.out {form} ave running
fix m all ave/time 5 1 5 c_m[*] c_c[*] c_g c_g[*] file m.out {form}
MEANS
variable late equal c_r[4][2]+c_q[5][3]
variable mean equal f_r[7][2]
fix v all ave/time 10 1 10 v_late v_mean file v.out {form}
thermo 10
thermo_style custom step c_m[4]
run 20
run 0
run 15
compute n all msd com yes
fix n all ave/time 5 1 5 c_n[*] c_m[4] file n.out {form}
run 20
"""


@cases("region, moving, temperature", (BLOCK, FLUID, 1.0), (BLOCK, FREE, 2000.0), (PRISM, FREE, 1000.0), ids=["fluid", "free", "tilted"])
def test_files_equal_lammps(tmp_path, region, moving, temperature):
    """With ``average yes`` LAMMPS 2025 finds beads of a tilted box that have not moved at all displaced: left out there."""
    lammps_peer.need(("pair", "dpd"), ("compute", "rdf"), ("compute", "msd"), ("fix", "ave/time"))
    means = "" if region is PRISM else "fix a all ave/time 5 1 5 c_a[*] c_b[*] file a.out {form}"
    measured = moving + MEASURED.replace("MEANS", means)
    beside_lammps(tmp_path, BEADS.format(style="atomic", region=region, T=temperature), "atomic", measured)


@pytest.mark.parametrize("special", ["0 1 1", "1 0 0", "0.5 1 0"])
def test_bonded_neighbours_equal_lammps(tmp_path, special):
    """Pairs whose factor is 0 are not in the list that the distribution is taken from."""
    lammps_peer.need(("pair", "dpd"), ("compute", "rdf"), ("bond", "harmonic"), ("fix", "ave/time"))
    rng = np.random.default_rng(2)
    x = (rng.random((12, 1, 3)) * 5 + np.cumsum(rng.normal(0, 0.3, (12, 5, 3)), axis=1)).reshape(-1, 3) % 5
    atoms = "".join(f"{k + 1} {k // 5 + 1} {k % 2 + 1} {a:.6f} {b:.6f} {c:.6f}\n" for k, (a, b, c) in enumerate(x))
    ends = [(5 * chain + k, 5 * chain + k + 1) for chain in range(12) for k in range(1, 5)]
    bonds = "".join(f"{k} 1 {i} {j}\n" for k, (i, j) in enumerate(ends, start=1))
    head = "chains\n\n60 atoms\n48 bonds\n2 atom types\n1 bond types\n0 5 xlo xhi\n0 5 ylo yhi\n0 5 zlo zhi\n\nMasses\n\n1 1\n2 1\n\n"
    (tmp_path / "chains.data").write_text(f"{head}Atoms # bond\n\n{atoms}\nBonds\n\n{bonds}")
    text = f"special_bonds lj/coul {special}\nbond_style harmonic\nbond_coeff 1 10 0.5\n{FLUID}comm_modify cutoff 3.5\n"
    text += "compute r all rdf 10 1 2 * * cutoff 1.5\ncompute g two gyration\n"
    text += "fix r all ave/time 5 1 5 c_r[*] mode vector file r.out {form}\nfix g all ave/time 5 1 5 c_g file g.out {form}\nrun 10\n"
    beside_lammps(tmp_path, "atom_style bond\nread_data chains.data\n", "bond", text)
