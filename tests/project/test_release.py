"""The release kit: one version everywhere, what is packed, workflows and their commands, the recipe, the paper and its references."""

import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

import openmm_dpd as dpd

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pytest needs it there

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed: pip install -e '.[test]'")

ROOT = Path(__file__).resolve().parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def text(name: str) -> str:
    """Of a file, from the root."""
    return (ROOT / name).read_text(encoding="utf-8")


PROJECT = tomllib.loads(text("pyproject.toml"))["project"]
RECIPE = yaml.safe_load(text("recipe/recipe.yaml"))
CITATION = yaml.safe_load(text("CITATION.cff"))
_, _head, PAPER = text("paper/paper.md").split("---\n", 2)
PAPER_HEAD = yaml.safe_load(_head)


def test_version_name_and_licence_are_the_same_everywhere():
    assert "version" in PROJECT["dynamic"] and "version" not in PROJECT  # read from the package
    changes = re.findall(r"^## (\S+)", text("CHANGELOG.md"), flags=re.MULTILINE)
    assert [str(CITATION["version"]), RECIPE["context"]["version"], changes[0]] == [dpd.__version__] * 3
    (name,) = re.findall(r"^Copyright \(c\) \d+ (.*)$", text("LICENSE"), flags=re.MULTILINE)
    assert PROJECT["authors"] == CITATION["authors"] == [{"name": name}]
    assert [author["name"] for author in PAPER_HEAD["authors"]] == [name]
    assert f'author = "{name}"' in text("docs/conf.py")
    assert PROJECT["license"] == CITATION["license"] == RECIPE["about"]["license"] == "MIT"


# -- recipe ----------------------------------------------------------------------------------------------------------------------
def requirement(line: str) -> str:
    """``numpy >=1.26`` as ``numpy>=1.26``, with the names that PyPI has."""
    return line.replace(" ", "").replace("matplotlib-base", "matplotlib")  # conda's matplotlib brings Qt


def test_recipe_needs_what_the_package_needs():
    run = [line for line in RECIPE["requirements"]["run"] if not line.startswith("python ")]
    assert sorted(map(requirement, run)) == sorted(PROJECT["dependencies"])
    assert ">=" + RECIPE["context"]["python_min"] == PROJECT["requires-python"]
    (backend,) = tomllib.loads(text("pyproject.toml"))["build-system"]["requires"]
    assert backend in map(requirement, RECIPE["requirements"]["host"])
    assert RECIPE["build"]["python"]["entry_points"] == [f"{name} = {what}" for name, what in PROJECT["scripts"].items()]
    files = [name for test in RECIPE["tests"] for name in test.get("files", {}).get("source", [])]
    assert files and not [name for name in [*files, RECIPE["about"]["license_file"]] if not (ROOT / name).is_file()]


def test_the_plugin_is_for_one_openmm_everywhere():
    """Where it is built, where it runs, in its recipe, and in the words of its pages."""
    plugin, recipe = tomllib.loads(text("plugin/pyproject.toml")), yaml.safe_load(text("recipe/device/recipe.yaml"))
    ((needed,), (backend, also)) = plugin["project"]["dependencies"], plugin["build-system"]["requires"]
    needs = {name: [line.replace(" ", "") for line in lines] for name, lines in recipe["requirements"].items()}
    assert also == needed and needs["host"] == ["python", "pip", backend, needed] and needs["run"] == ["python", needed]
    assert recipe["context"]["version"] == plugin["project"]["version"] and plugin["project"]["authors"] == PROJECT["authors"]
    assert all(f"OpenMM {needed[8:11]}" in text(page) for page in ("docs/howto/device.md", "plugin/README.md"))


# -- workflows -------------------------------------------------------------------------------------------------------------------
def steps(path: Path) -> list[dict]:
    """Of all jobs of a workflow."""
    return [step for job in yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].values() for step in job["steps"]]


def documented() -> set[str]:
    """Lines of the script of continuous integration, and of the command blocks of CONTRIBUTING.md."""
    blocks = re.findall(r"^```bash\n(.*?)^```$", text("CONTRIBUTING.md"), flags=re.MULTILINE | re.DOTALL)
    return {line.strip() for block in [text(".ci/run"), *blocks] for line in block.splitlines()}


def test_every_dependency_has_one_lower_bound_and_no_other():
    """The oldest versions are installed from these, and tried every night."""
    extras = PROJECT["optional-dependencies"]
    wanted = [*PROJECT["dependencies"], *(line for lines in extras.values() for line in lines)]
    assert len(wanted) > 20 and not [line for line in wanted if not re.fullmatch(r"[\w.-]+>=[\d.]+", line)]
    jobs = yaml.safe_load(text(".github/workflows/nightly.yml"))["jobs"]
    assert PROJECT["requires-python"] == ">=" + jobs["oldest"]["steps"][1]["with"]["python-version"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_commands_of_a_workflow_are_those_of_the_project(path):
    commands = [line for step in steps(path) if "run" in step for line in step["run"].splitlines()]
    assert commands and not [line for line in commands if line not in documented()]


def test_what_runs_tests_keeps_compiled_kernels():
    """From one run to the next, by what is compiled."""
    jobs = [job["steps"] for path in WORKFLOWS for job in yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].values()]
    kept = [[step["with"]["path"] for step in steps if "actions/cache" in step.get("uses", "")] for steps in jobs]
    assert all(places == ["~/.cache/openmm_dpd"] * ("pytest" in str(steps)) for steps, places in zip(jobs, kept, strict=True))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_need_no_secrets_and_may_only_read(path):
    source = path.read_text(encoding="utf-8")
    assert "secrets" not in source and yaml.safe_load(source)["permissions"] == {"contents": "read"}
    assert all(step["uses"].startswith("actions/") for step in steps(path) if "uses" in step)


def test_what_decides_is_in_the_workflows():
    """Lint, types and fast tests of .ci/run."""
    commands = {step.get("run") for path in WORKFLOWS for step in steps(path)}
    checks = [line for line in text(".ci/run").splitlines() if line.startswith(("ruff", "mypy", "pytest")) and "slow and" not in line]
    assert len(checks) == 4 and set(checks) <= commands
    assert {path.stem for path in WORKFLOWS} == {"lint", "tests", "docs", "nightly", "device"}


def test_workflows_use_pythons_that_the_package_names():
    named = {line.rpartition(" ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line}
    matrix = yaml.safe_load(text(".github/workflows/tests.yml"))["jobs"]["fast"]["strategy"]["matrix"]["python"]
    assert set(matrix) <= named and PROJECT["requires-python"] == ">=" + min(named, key=lambda name: int(name.partition(".")[2]))
    single = {str(step["with"]["python-version"]) for path in WORKFLOWS for step in steps(path) if "python-version" in step.get("with", {})}
    assert single - {"${{ matrix.python }}"} <= named


# -- paper -----------------------------------------------------------------------------------------------------------------------
BIB = {key: body for key, body in re.findall(r"^@\w+\{(\w+),\n(.*?)^\}$", text("paper/paper.bib"), flags=re.MULTILINE | re.DOTALL)}


@pytest.mark.parametrize("key", BIB)
def test_entries_are_complete(key):
    fields = dict(re.findall(r"^\s+(\w+)\s*= \{(.*?)\},?$", BIB[key], flags=re.MULTILINE | re.DOTALL))
    assert {"author", "title", "year"} <= set(fields) and key.endswith(fields["year"])
    assert ({"journal", "volume", "pages"} <= set(fields)) or "eprint" in fields or "booktitle" in fields
    assert re.fullmatch(r"10\.\d{4,}/\S+", fields.get("doi", "10.0000/none"))
    assert BIB[key].count("{") == BIB[key].count("}")


def test_paper_has_the_sections_of_the_journal():
    """https://joss.readthedocs.io/en/latest/paper.html; its figures and references are there."""
    wanted = ["Summary", "Statement of need", "State of the field", "Software design", "Research impact statement", "AI usage disclosure"]
    found = re.findall(r"^# (.*)$", PAPER, flags=re.MULTILINE)
    assert [name for name in found if name in wanted] == wanted
    assert 750 < len(PAPER.split()) < 1750
    figures = re.findall(r"\]\((\.\./docs/figures/[^)]*)\)", PAPER)
    assert len(figures) == PAPER.count("![") == 2 and all((ROOT / "paper" / name).is_file() for name in figures)
    cited = set(re.findall(r"@(\w+)", PAPER))
    assert len(cited) > 15 and cited == set(BIB)


# -- what is packed --------------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def packed(tmp_path_factory) -> tuple[set[str], set[str], set[str]]:
    """Names of the files that git tracks, and of those in an sdist and a wheel made of them."""
    try:
        import setuptools
    except ImportError:
        setuptools = None
    if setuptools is None or int(setuptools.__version__.partition(".")[0]) < 77:
        pytest.skip("setuptools >= 77 is not installed: pip install -e '.[test]'")
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("needs git and its repository")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    tracked = {name for name in listed.split("\0") if name and (ROOT / name).is_file()}
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("out")
    for name in tracked:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, source / name)
    code = "import sys; out = sys.argv[1]; from setuptools import build_meta as b; b.build_sdist(out); b.build_wheel(out)"
    done = subprocess.run([sys.executable, "-c", code, str(out)], cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    stem = f"openmm_dpd-{dpd.__version__}"
    with tarfile.open(out / f"{stem}.tar.gz") as archive:
        sdist = {member.name.removeprefix(f"{stem}/") for member in archive if member.isfile()}
    with zipfile.ZipFile(out / f"{stem}-py3-none-any.whl") as archive:
        wheel = set(archive.namelist())
    return tracked, sdist, wheel


@pytest.mark.slow
def test_wheel_holds_the_package_and_sdist_the_repository(packed):
    tracked, _, wheel = packed
    package = {name for name in tracked if name.startswith("openmm_dpd/")}
    others = {name for name in package if not name.startswith("openmm_dpd/score/")}  # where the decks of the reference suite are
    assert {Path(name).suffix for name in others} == {".py", ".json", ".typed"} and "openmm_dpd/py.typed" in package
    info = f"openmm_dpd-{dpd.__version__}.dist-info"
    about = ("METADATA", "RECORD", "WHEEL", "entry_points.txt", "licenses/LICENSE", "top_level.txt")
    assert wheel - package == {f"{info}/{name}" for name in about}
    assert package <= wheel
    tracked, sdist, _ = packed
    added = {name for name in sdist - tracked if not name.startswith("openmm_dpd.egg-info/")}
    assert tracked <= sdist and added == {"PKG-INFO", "setup.cfg"}
