"""Run the notebooks and store their outputs in them: the documentation shows these, it runs nothing.

python docs/notebooks/store.py                   # all
python docs/notebooks/store.py first_fluid.ipynb
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent


def run(path: Path, folder: str | os.PathLike, then: str = "") -> nbformat.NotebookNode:
    """The notebook after a run in this folder, which takes the files that it writes; with ``then``, code for one more cell."""
    notebook = nbformat.read(path, as_version=4)
    if then:
        notebook.cells.append(nbformat.v4.new_code_cell(then))
    environment = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}  # pictures go into the notebook
    resources = {"metadata": {"path": str(folder)}}
    client = NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources, record_timing=False)
    return client.execute(env=environment)


def store(path: Path) -> None:
    """Run a notebook and write it back, without the version of Python."""
    with tempfile.TemporaryDirectory() as folder:
        notebook = run(path, folder)
    notebook.metadata = {"kernelspec": notebook.metadata.kernelspec, "language_info": {"name": "python"}}
    nbformat.write(notebook, path)


if __name__ == "__main__":
    for path in [HERE / name for name in sys.argv[1:]] or sorted(HERE.glob("*.ipynb")):
        store(path)
        print(f"{path.name}: {path.stat().st_size // 1000} kB")
