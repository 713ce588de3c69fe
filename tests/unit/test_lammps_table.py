"""Pair table files."""

from dataclasses import replace

import numpy as np
import pytest
from cases import cases, put, raises
from scipy.interpolate import CubicSpline

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps.files.table_file import read_table, tabulated_pair
from openmm_dpd.units import LJ, REAL


def energy(r):
    return 3 * np.exp(-r * r) - np.exp(-2 * (r - 1.5) ** 2)


def force(r):
    return 6 * r * np.exp(-r * r) - 4 * (r - 1.5) * np.exp(-2 * (r - 1.5) ** 2)


def section(keyword: str, parameters: str, r: np.ndarray, column: np.ndarray | None = None, noise: float = 0.0) -> str:
    column = r if column is None else column
    wiggle = noise * np.cos(7.3 * np.arange(len(r)))
    rows = [f"{k + 1} {column[k]:.10g} {energy(r[k]):.14g} {force(r[k]) + wiggle[k]:.14g}" for k in range(len(r))]
    return "\n".join([f"# {keyword}", "", keyword, parameters, "", *rows, ""])


@pytest.fixture
def table(tmp_path):
    even = np.linspace(0.1, 3.0, 201)
    square = np.sqrt(np.linspace(0.1**2, 3.0**2, 400))
    path = tmp_path / "table"
    path.write_text(
        section("FIRST", "N 5 R 1 2", np.linspace(1, 2, 5))
        + section("EVEN", "N 201 R 0.1 3.0 FPRIME 0 0", even, column=np.round(even, 2))  # R overrides the rounded column
        + section("COLUMN", "N 201", even)
        + section("BARE", "N 201 R", even)
        + section("SQUARE", "N 400 RSQ 0.1 3.0", square, column=np.zeros(400))
        + section("NOISY", "N 201 R 0.1 3.0", even, noise=1.0)
        + section("BITS", "N 201 BITMAP 0.1 3.0", even)
        + section("SHORT", "N 20 R 1 2", np.linspace(1, 2, 10))
    )
    return path


@pytest.mark.parametrize("keyword", ["EVEN", "COLUMN", "BARE", "SQUARE"])
def test_every_form_gives_the_same_potential(table, keyword):
    pair, remark = tabulated_pair(read_table(table, keyword), None, LJ)
    assert remark is None if keyword != "EVEN" else "FPRIME has no effect" in remark
    assert pair.cutoff == pytest.approx(3.0)
    r = np.linspace(0.3, 2.9, 77)
    spline = CubicSpline(pair.distances, pair.energies)
    np.testing.assert_allclose(spline(r), energy(r), atol=2e-5)
    np.testing.assert_allclose(-spline(r, 1), force(r), atol=1e-3)


@pytest.mark.parametrize("slopes", ["", " FPRIME {:.12g} {:.12g}"])
def test_few_uneven_rows(tmp_path, slopes):
    """A spline goes through forces too: between 40 points they are right to 1e-3, near the ends where their slopes are given."""
    r, h = np.sqrt(np.linspace(0.5**2, 3.0**2, 40)), 1e-6
    ends = [(force(end + h) - force(end - h)) / (2 * h) for end in (r[0], r[-1])]
    path = put(tmp_path / "few", section("FEW", f"N 40{slopes.format(*ends)}", r))
    pair, remark = tabulated_pair(read_table(path, "FEW"), None, LJ)
    inner = pair.distances > (0.0 if slopes else 1.0)
    assert remark is None and len(pair.distances) > 60
    np.testing.assert_allclose(pair.forces[inner], force(pair.distances[inner]), atol=1e-3)


def test_units_and_cutoff(table):
    pair, _ = tabulated_pair(read_table(table, "EVEN"), 2.0, REAL)
    assert pair.cutoff == pytest.approx(0.2)
    assert pair.distances[0] == pytest.approx(0.01)
    assert pair.energies[0] == pytest.approx(energy(0.1) * 4.184, rel=1e-6)
    assert pair.forces[0] == pytest.approx(force(0.1) * 41.84, rel=1e-6)


def test_forces_that_are_not_the_slope_define_the_potential(table):
    """LAMMPS moves the beads by the forces of the file, not by its energies."""
    even = read_table(table, "EVEN")
    data = replace(even, forces=1.5 * even.forces)
    pair, remark = tabulated_pair(data, None, LJ)
    assert "energies are replaced" in remark
    np.testing.assert_allclose(pair.forces, data.forces)
    inner = slice(2, -2)
    np.testing.assert_allclose(-np.gradient(pair.energies, pair.distances)[inner], data.forces[inner], atol=0.05 * np.ptp(data.forces))


def test_forces_with_kinks_are_kept(table):
    """Coarse-grained tables have forces that jump about the slope of the energies; their integral is what counts."""
    pair, remark = tabulated_pair(read_table(table, "NOISY"), None, LJ)
    assert remark is None
    np.testing.assert_allclose(pair.forces, read_table(table, "NOISY").forces)


@cases(
    "keyword, message",
    ("NONE", r"there is no table NONE in it; found FIRST, EVEN, COLUMN, BARE, SQUARE, NOISY, BITS, SHORT"),
    ("BITS", r"table BITS is stored as BITMAP, which is not supported"),
)
def test_missing_and_unsupported(table, keyword, message):
    raises(DeckError, message, lambda: read_table(table, keyword))


def test_rows_that_are_missing_or_not_numbers(tmp_path):
    path = put(tmp_path / "table", "A\nN 3 R 1 2\n\n1 1 0 0\n2 1.5 x 0\n3 2 0 0\n")
    raises(DeckError, r"table:5: expected 'index r energy force'", lambda: read_table(path, "A"))
    raises(DeckError, r"table A announces 3 rows, but has 2", lambda: read_table(put(path, "A\nN 3 R 1 2\n\n1 1 0 0\n2 1.5 0 0\n"), "A"))
    path.write_text("A\nN 3\n\n1 1 0 0\n2 1.5 0 0\n3 1.2 0 0\n")
    raises(DeckError, r"table:5: the distances of table A must be > 0 and increase", lambda: read_table(path, "A"))
    raises(DeckError, r"table:2: expected the parameters 'N points", lambda: read_table(put(path, "A\nM 3\n\n1 1 0 0\n"), "A"))


def test_a_cutoff_beyond_the_table(table):
    raises(ValueError, "lies beyond the table", lambda: tabulated_pair(read_table(table, "EVEN"), 3.5, LJ))
