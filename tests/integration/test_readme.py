"""What the README says: its script and its commands run as they are printed, its numbers are those of the pages behind it."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Contents of the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


INSTALL, DECK, TEST = (block.splitlines() for block in blocks("bash"))


def page(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_it_is_short():
    assert len(README.splitlines()) <= 110


def test_script_is_the_first_example():
    """... which test_examples.py runs; at most 15 lines of code."""
    (script,) = blocks("python")
    assert script == page("examples/01_dpd_fluid.py")
    assert len([line for line in script.splitlines() if line.strip()]) <= 15


def test_every_command_is_run():
    """By the next test, or by what decides whether a change lands (with options that make it print less or more)."""
    assert all(line.startswith(("python -m venv", "pip install")) for line in INSTALL)
    assert all(line.startswith("openmm-dpd ") for line in DECK)
    decides = [re.sub(r" -q| --durations=\d+", "", line) for line in page(".ci/run").splitlines()]
    install, tests = TEST
    assert tests in decides
    (extras,) = re.findall(r"\[(.*)\]", install)
    (installed,) = [line for line in decides if line.startswith("pip install")]
    assert set(extras.split(",")) <= set(re.findall(r"\[(.*)\]", installed)[0].split(","))
    inline = [line for line in re.findall(r"`([^`\n]+)`", README) if line.startswith(("pip", "sphinx-build"))]
    assert inline and not [line for line in inline if line not in page(".github/workflows/docs.yml")]


@pytest.mark.slow
def test_install_and_deck_as_printed(tmp_path):
    """The lines of the two blocks, in one shell, in a copy of what they need; dependencies are those that are installed here."""
    pytest.importorskip("setuptools", minversion="77", reason="setuptools >= 77 is not installed: pip install -e '.[test]'")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    for name in ("openmm_dpd", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    present = os.pathsep.join(path for path in sys.path if path.endswith(("site-packages", "dist-packages")))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    # nothing is downloaded: pip takes setuptools and all dependencies from here ("0" is its way to say that builds are not isolated)
    environment |= {"PYTHONPATH": present, "PIP_NO_DEPS": "1", "PIP_NO_BUILD_ISOLATION": "0", "PIP_NO_INDEX": "1"}
    script = "\n".join(["set -eu", *INSTALL, "rm -r openmm_dpd build", *DECK])
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in (tmp_path / "out" / "dpd").iterdir()} >= {
        "trajectory.dcd",
        "topology.psf",
        "final_state.xml",
        "thermo.png",
    }
    assert (tmp_path / "out" / "dpd.json").is_file()
    assert "program mvv" in done.stdout


def test_commands_name_decks_that_exist():
    assert all((ROOT / word).is_file() for line in DECK for word in shlex.split(line) if word.startswith("examples/"))


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


def test_speed_is_that_of_the_atlas():
    """Times less wall time on one core at 1 % of the configurational temperature; whole numbers, below the bound where it is one."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page("docs/atlas.md").splitlines() if "| yes |" in line]
    gains = {(fluid, beside): gain for fluid, beside, cores, _, _, gain, _ in rows if cores == "1"}

    def of_temperature(beside: str) -> float:
        return float(gains["standard fluid, friction 4.5", beside].lstrip("> ").split()[0])

    text = " ".join(README.partition("**Speed.**")[2].partition("## Limits")[0].split())
    pair, shardlow, native = (int(number) for number in re.findall(r"a (\d+)th", text))
    assert pair == round(of_temperature("LAMMPS dpd + nve"))
    assert shardlow == round(of_temperature("LAMMPS dpd/fdt + shardlow"))
    assert native <= of_temperature("OpenMM DPDIntegrator, CPU")
    beside_lammps = [float(gain.lstrip("> ").split()[0]) for (_, beside), gain in gains.items() if "LAMMPS" in beside]
    (electrolyte,) = re.findall(r"the same error costs (\d+) times less", page("docs/atlas.md"))
    assert f"{round(min(beside_lammps))} to {electrolyte} times less time than LAMMPS" in README
