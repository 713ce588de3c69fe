"""The notebooks of the documentation run, and find what their text says; what is stored in them is the output of a whole run."""

from pathlib import Path

import pytest
from cases import script
from judged import any_seed, with_seeds

nbformat = pytest.importorskip("nbformat", reason="nbclient is not installed: pip install -e '.[test]'")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed: pip install -e '.[test]'")
pytest.importorskip("ipykernel", reason="ipykernel is not installed: pip install -e '.[test]'")

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))

CHECKS = {  # What a run must have found: code for a last cell, with the notebook's own names.
    # docs/schemes.md has the errors of both schemes from longer runs: bababo at most 0.9(2) % off, mvv at 0.1 by 34.1(4) and 82.8(7) %
    "first_fluid": """
for kinetic, positions in found["bababo"]:
    assert abs(kinetic.mean - 1) < 4 * kinetic.sem + 0.01 and abs(positions.mean - 1) < 4 * positions.sem + 0.01
kinetic, positions = found["mvv"][-1]
assert abs(kinetic.mean - 1.341) < 4 * np.hypot(kinetic.sem, 0.004)
assert abs(positions.mean - 1.828) < 4 * np.hypot(positions.sem, 0.007)
assert dpd.recommend(scene, error=0.01).scheme == "bab3"
""",
    # the size of a chain is 1.42(1) in the stored run
    "polymers": """
assert order(beads)[75:].mean() < 0.4 < 0.9 < order(chains)[75:].mean()
assert abs(size.mean - 1.42) < 4 * np.sqrt(2) * 0.012
assert chi.value < 2 < LENGTH * chi.value
""",
    # thermal noise of the amplitude is sqrt(2 kT/M) = 0.036 nm/ps in each run, that of the momentum sqrt(M kT) = 99 Da nm/ps
    "thermostat": """
amplitude = {kind: rows[20:60, 0].mean() for kind, (rows, _) in found.items()}
assert abs(amplitude["pairwise friction"] - amplitude["none"]) < 4 * np.sqrt(2) * 0.036
assert amplitude["Langevin, 5/ps"] < amplitude["pairwise friction"]  # by 0.2, with an error of 0.05
momentum = {kind: np.abs(rows[:, 2]).max() for kind, (rows, _) in found.items()}
assert momentum["pairwise friction"] < 5 < 20 < momentum["Langevin, 5/ps"]
assert abs(found["pairwise friction"][0][75:, 1].mean() - 300) < 4 * 12
""",
    # means and deviations of twenty seeds of such runs are those of tests/project/test_examples.py
    "membrane": """
assert order[0] < 0.3 and order[len(order) // 2 :].mean() > 0.76
assert abs(thickness["assembled"].mean - 3.519) < 4 * 0.032
assert abs(thickness["prepared"].mean - 3.548) < 0.1
""",
}


def cells(path: Path) -> list:
    """Code cells as they are stored."""
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]


def test_every_notebook_is_checked():
    assert {path.stem for path in NOTEBOOKS} == set(CHECKS)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_outputs_are_those_of_one_whole_run(path):
    stored = cells(path)
    assert [cell.execution_count for cell in stored] == list(range(1, len(stored) + 1))
    outputs = [output for cell in stored for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"]
    assert [output for output in outputs if "image/png" in output.get("data", {})]
    assert path.stat().st_size < 350_000


@pytest.mark.slow
@any_seed(0)
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_and_finds_what_it_says(path, tmp_path, seed):
    store = script(FOLDER / "store.py")
    copy = tmp_path / path.name
    copy.write_text(with_seeds(path.read_text(encoding="utf-8"), seed), encoding="utf-8")
    try:
        done = store.run(copy, tmp_path, then=CHECKS[path.stem])
    except nbclient.exceptions.CellExecutionError as failed:
        raise AssertionError(str(failed)) from failed
    assert [output for cell in done.cells for output in cell.get("outputs", ()) if "image/png" in output.get("data", {})]
