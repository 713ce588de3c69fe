"""What the README says: its script and its commands run as they are printed, its numbers are those of the pages behind it."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from openmm_dpd import __main__ as cli

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Contents of the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


RUN, TEST = (block.splitlines() for block in blocks("bash"))
INLINE = re.findall(r"`([^`\n]+)`", README)


def page(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_it_is_short_and_begins_with_two_lines_for_each_purpose():
    """The script is the first example, which test_examples.py runs; at most 15 lines of code."""
    assert len(README.splitlines()) <= 91
    assert len(RUN) == len(TEST) == 2
    assert re.findall(r"^## (.*)", README, flags=re.MULTILINE)[0] == "Quick start"
    assert len(re.findall(r"^- ", README.partition("## Features")[2].partition("\n## ")[0], flags=re.MULTILINE)) == 5
    (script,) = blocks("python")
    assert script == page("examples/01_dpd_fluid.py")
    assert len([line for line in script.splitlines() if line.strip()]) <= 15


def test_every_command_is_run():
    """By the next test, or by what decides whether a change lands (with options that make it print less or more)."""
    decides = [re.sub(r" -q| --durations=\d+", "", line) for line in page(".ci/run").splitlines()]
    (installed,) = [line for line in decides if line.startswith("pip install")]
    (settings,) = [line.removeprefix("export ") for line in decides if line.startswith("export ")]
    assert TEST[0].endswith(f" && {installed}")
    assert TEST[1].startswith(f"{settings} ") and TEST[1].removeprefix(f"{settings} ") in decides
    building = [line for line in INLINE if line.startswith(("pip", "sphinx-build"))]
    assert building and not [line for line in building if line not in page(".github/workflows/docs.yml")]


def test_restart_and_export_are_commands():
    """The parser takes them; what they do is tested in test_resume.py and test_export.py."""
    lines = [RUN[1], *(line for line in INLINE if line.startswith("openmm-dpd "))]
    run, restart, export, check = (cli._parser().parse_args(shlex.split(line)[1:]) for line in lines)
    assert restart.restart == run.out and restart.deck == run.deck
    assert (ROOT / export.deck).is_file() and check.command == "check"


@pytest.mark.slow
def test_the_main_job_as_printed(tmp_path):
    """The two lines, in one shell, in a copy of what they need; dependencies are those that are installed here."""
    pytest.importorskip("setuptools", minversion="77", reason="setuptools >= 77 is not installed: pip install -e '.[test]'")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    for name in ("openmm_dpd", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    present = os.pathsep.join(path for path in sys.path if path.endswith(("site-packages", "dist-packages")))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    # nothing is downloaded: pip takes setuptools and all dependencies from here ("0" is its way to say that builds are not isolated)
    environment |= {"PYTHONPATH": present, "PIP_NO_DEPS": "1", "PIP_NO_BUILD_ISOLATION": "0", "PIP_NO_INDEX": "1"}
    script = "\n".join(["set -eu", RUN[0], "rm -r openmm_dpd build", RUN[1]])
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    wanted = {"trajectory.dcd", "topology.psf", "final_state.xml", "thermo.png", "beads.png"}
    assert {path.name for path in (tmp_path / "out" / "dpd").iterdir()} >= wanted
    report = json.loads((tmp_path / "out" / "dpd.json").read_text(encoding="utf-8"))
    assert abs(report["thermo"]["temp"]["mean"] - 1.0) < 0.05


def test_accuracy_is_that_of_the_table_of_schemes():
    """The configurational temperature at a step of 0.05."""
    rows = page("docs/schemes.md").partition("Friction $\\gamma$ = 4.5:")[2].partition("Friction $\\gamma$ = 40.5")[0].splitlines()
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows if row.startswith("|")]
    column = cells[0].index("dt 0.05")
    measured, scheme = {}, ""
    for row in cells:
        scheme = row[0] or scheme
        if row[1] == "configurational":
            measured[scheme.removesuffix(", lambda 0.5")] = row[column]
    stated = re.findall(r"(`\w+`)[^`+-]*([+-][\d.]+\([\d.]+\) %)", README.partition("**Accuracy.**")[2].partition("**Speed.**")[0])
    assert len(stated) == 5 and [(scheme, measured[scheme]) for scheme, _ in stated] == stated
