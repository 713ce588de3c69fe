"""What the texts say: their scripts run, their commands and files exist, their tables are complete, and the documentation builds."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cases import cases
from deck_snippets import TABLES as OF_DECKS

import openmm_dpd as dpd
from openmm_dpd import __main__ as cli
from openmm_dpd.base.names import Phase
from openmm_dpd.lammps.commands.beads import GROUP_STYLES, SETTERS
from openmm_dpd.lammps.commands.interactions import HYBRID
from openmm_dpd.lammps.commands.output import THERMO_OPTIONS
from openmm_dpd.lammps.files.data_file import ATOM_STYLES, JOINED
from openmm_dpd.lammps.state.lattice import CELLS
from openmm_dpd.lammps.state.regions import REGION_STYLES
from openmm_dpd.lammps.styles.pair_styles import PAIR_STYLES
from openmm_dpd.lammps.styles.words import bonded_styles
from openmm_dpd.lammps.values.words import WORDS
from openmm_dpd.model.schemes import SCHEMES
from openmm_dpd.units import UNIT_SYSTEMS

ROOT = Path(__file__).resolve().parents[2]
TEXTS = [*(ROOT / name for name in ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md")), *sorted((ROOT / "docs").rglob("*.md"))]
DECKS = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "decks").glob("*.md")}


def blocks(text: str, language: str) -> list[str]:
    """Contents of the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


WITH_SCRIPTS = [path for path in TEXTS if path.name != "README.md" and blocks(path.read_text(encoding="utf-8"), "python")]


# -- scripts ---------------------------------------------------------------------------------------------------------------------
#: Pages whose runs are shorter here, and by how much: numbers of steps, of rounds of them and of units of time.
SHORTER = dict.fromkeys(
    ("bodies", "constant_pressure", "heat_species", "mixed", "molecules", "partition", "sampling", "schemes", "thermostat"), 10
)
SHORTER |= {"flow": 2, "membranes": 3, "shear": 2, "suite": 2}
LENGTHS = re.compile(r"((?:\.step\((?:simulation, )?|for _ in range\(|\"(?:time|settle)\": |, time=))(\d{2,})")


def script_of(path: Path) -> str:
    """All Python blocks of a page, in their order, as one script."""
    code = "\n".join(blocks(path.read_text(encoding="utf-8"), "python"))
    return LENGTHS.sub(lambda found: f"{found[1]}{round(int(found[2]) / SHORTER.get(path.stem, 1))}", code)


#: Scripts that take more than a second.
LONGEST = ("dense_start", "flow", "mixed", "parameters", "partition", "sampling", "shear", "suite", "thermostat")
TAKEN = [pytest.param(path, marks=pytest.mark.slow) if path.stem in LONGEST else path for path in WITH_SCRIPTS]


@pytest.mark.parametrize("path", TAKEN, ids=lambda path: path.stem)
def test_scripts_of_a_page_run(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    code = script_of(path)
    if "gsd" in code:
        pytest.importorskip("gsd", reason="gsd is not installed: pip install -e '.[gsd]'")
    try:
        exec(compile(code, str(path), "exec"), {"__name__": "page"})
    finally:
        dpd.set_threads(None)


def test_pages_that_ought_to_have_scripts_have_them():
    expected = "start run_deck build_scene inputs look thermostat restart analyse temperature contexts schemes units"
    assert {path.stem for path in WITH_SCRIPTS} >= set(expected.split())


# -- commands --------------------------------------------------------------------------------------------------------------------
LINES = {line for path in TEXTS for block in blocks(path.read_text(encoding="utf-8"), "bash") for line in block.splitlines()}
COMMAND_LINES = sorted(line for line in LINES if line.startswith("openmm-dpd"))


@pytest.mark.parametrize("line", COMMAND_LINES)
def test_command_lines_are_accepted(line):
    """The parser takes them, and their decks exist; tests/project/test_readme.py runs those of the README."""
    options = cli._parser().parse_args(shlex.split(line)[1:])
    assert options.command == "score" or (ROOT / options.deck).is_file()


def test_every_option_of_run_is_described():
    page = (ROOT / "docs" / "howto" / "run_deck.md").read_text(encoding="utf-8")
    with pytest.raises(SystemExit):
        cli._parser().parse_args(["run", "--no-such-option"])
    helped = subprocess.run([sys.executable, "-m", "openmm_dpd", "run", "--help"], capture_output=True, text=True, check=True).stdout
    for option in set(re.findall(r"--[a-z]+", helped)) - {"--help"}:
        assert f"`{option}" in page or f" {option}" in page or f"{option} " in page, option


# -- tables ----------------------------------------------------------------------------------------------------------------------
def column(page: str, title: str, row: str = "", at: int = 1, last: str = "") -> str:
    """Cells of the tables of a section, or up to the section ``last``, in the rows that begin with a word."""
    section = DECKS[page].partition(f"## {title}\n")[2].partition(f"\n## {last}")[0]
    return "\n".join(line.split("|")[at] for line in section.splitlines() if line.startswith(f"| `{row}"))


IGNORED = re.sub(r"\(.*?\)", "", DECKS["commands"].partition("without effect: ")[2].partition("\n\n")[0], flags=re.S)
TABLES = {  # What pages list, and what there is.
    "commands": (column("commands", "The script", last="Files") + IGNORED, OF_DECKS["command"]),
    "pair styles": (column("styles", "Pair styles"), {*PAIR_STYLES, *HYBRID, "none"}),
    **{kind: (column("styles", f"{kind.capitalize()}s"), OF_DECKS[kind]) for kind in ("compute", "dump")},
    "fix": (column("styles", "Fixes"), OF_DECKS["fix"]),
    "thermo words": (DECKS["styles"].partition("## Thermo words")[2].partition("`v_name`")[0] + "`press_full` `temp_conf`", WORDS),
    "variables": (re.sub(r"\(.*?\)", "", DECKS["commands"].partition("Styles are ")[2].partition(" removes")[0]), OF_DECKS["variable"]),
    "set": (DECKS["commands"].partition("and sets\n")[2].partition(".\n")[0], SETTERS),
    **{
        f"{what}s": (column("styles", "Bonds, angles, dihedrals and impropers", what, 2), {*bonded_styles(what), "none"}) for what in JOINED
    },
}
_OPTIONS = {
    "atom_style": {*ATOM_STYLES, "hybrid"},
    "lattice": {*CELLS, "custom", "none"},
    "region": {*REGION_STYLES, "union", "intersect", "delete"},
}
_OPTIONS |= {"group": {*GROUP_STYLES, "subtract", "clear", "delete", "static", "dynamic"}, "thermo`": {*OF_DECKS["layout"], "custom"}}
_OPTIONS |= {"thermo_modify": THERMO_OPTIONS, "units": UNIT_SYSTEMS}
TABLES |= {command: (column("commands", "Box and beads", command, 2, "Runs"), there) for command, there in _OPTIONS.items()}


@cases("listed, there", TABLES)
def test_pages_list_what_a_deck_may_use_and_nothing_else(listed, there):
    assert {name.split()[0] for name in re.findall(r"`([^`]+)`", listed)} == set(there)


def test_cells_of_the_pages_about_decks_are_short():
    rows = [line for page in DECKS.values() for line in page.splitlines() if line.startswith("|")]
    assert len(rows) > 60 and not [cell for row in rows for cell in row.split("|") if len(cell) > 110]


def test_every_scheme_and_phase_is_described():
    schemes, steps = (ROOT / "docs" / "schemes.md").read_text(encoding="utf-8"), (ROOT / "docs" / "steps.md").read_text(encoding="utf-8")
    assert not [name for name in SCHEMES if f"| `{name}` |" not in schemes]
    assert not [phase.name for phase in Phase if phase.name not in steps]


def test_the_listing_of_a_step_is_what_explain_prints():
    positions = np.random.default_rng(1).random((81, 3)) * 3
    scene = dpd.Scene({"W": 1}, ["W"] * 81, positions, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1, box=[3, 3, 3])
    built = dpd.build(scene, dt=0.04, conservative="openmm", platform="CPU", seed=7)
    assert built.program is not None and built.program.describe() in built.explain(program=True)
    assert built.program.describe() in (ROOT / "docs" / "steps.md").read_text(encoding="utf-8")


def test_units_are_the_ones_in_the_code():
    """Numbers of docs/units.md."""
    from openmm_dpd.units import BAR_PER_MD_PRESSURE, BOLTZMANN, COULOMB, UNIT_SYSTEMS

    page = (ROOT / "docs" / "units.md").read_text(encoding="utf-8")
    for text, value in (("120.27 K", 1 / BOLTZMANN), ("16.605 bar", BAR_PER_MD_PRESSURE), ("138.935 kJ/mol", COULOMB)):
        assert text in page
        assert float(text.split()[0]) == pytest.approx(value, abs=5e-3)
    rows = {"length": "length", "time": "time", "energy": "energy", "temperature to kT": "thermal_energy"}
    rows |= {"`A`": "force", "`gamma`": "friction", "`sigma`": "noise", "pressure": "pressure"}
    table = page.partition("## LAMMPS unit styles")[2]
    for name, attribute in rows.items():
        (line,) = re.findall(rf"^\| {re.escape(name)}, [^|]*\|(.*)\|$", table, flags=re.MULTILINE)
        for system, text in zip(("lj", "real", "metal"), line.split("|"), strict=True):
            assert float(text) == pytest.approx(getattr(UNIT_SYSTEMS[system], attribute), rel=1e-6), (name, system)


# -- claims of the theory --------------------------------------------------------------------------------------------------------
def stationary(before, after, decay: float) -> np.ndarray:
    """Covariance that a step keeps: ``before``, then v <- decay v + noise of unit Maxwell variance, then ``after``."""
    step = after @ np.diag([1.0, decay]) @ before
    noise = after @ np.diag([0.0, 1 - decay**2]) @ after.T
    n = len(step)
    return np.linalg.solve(np.eye(n * n) - np.kron(step, step), noise.ravel()).reshape(n, n)


def test_variances_of_the_harmonic_oscillator():
    """The table of docs/theory.md: variances of x and v for each order of the substeps."""
    dt, decay = 0.5, 0.9
    a = dt**2 / 4

    def drift(h):
        return np.array([[1.0, h], [0.0, 1.0]])

    def kick(h):
        return np.array([[1.0, 0.0], [-h, 1.0]])

    middle = stationary(drift(dt / 2) @ kick(dt), drift(dt / 2), decay)
    aboba = stationary(kick(dt / 2) @ drift(dt / 2), drift(dt / 2) @ kick(dt / 2), decay)
    verlet = stationary(kick(dt / 2) @ drift(dt) @ kick(dt / 2), np.eye(2), decay)
    for covariance, expected in ((middle, (1, 1)), (aboba, (1, 1 / (1 - a))), (verlet, (1 / (1 - a), 1))):
        assert np.diag(covariance) == pytest.approx(expected, rel=1e-12)


def test_what_constraints_take_away():
    """docs/constraints.md: the covariance lost in a step is P S (Sigma - Sigma_c) S^T P^T, not negative, and of second order."""
    rng = np.random.default_rng(1)
    n = 6
    sigma = np.diag(1 / rng.uniform(1, 3, n))
    constraints = rng.normal(size=(2, n))
    projection = np.eye(n) - sigma @ constraints.T @ np.linalg.inv(constraints @ sigma @ constraints.T) @ constraints
    right = projection @ sigma @ projection.T
    assert np.allclose(right, projection @ sigma, atol=1e-14)
    root = rng.normal(size=(n, n))
    lost = []
    for epsilon in (2e-3, 1e-3):
        sweep = np.eye(n) - epsilon * sigma @ root @ root.T
        noise = sigma - sweep @ sigma @ sweep.T
        after = projection @ (sweep @ right @ sweep.T + noise) @ projection.T
        expected = projection @ sweep @ (sigma - right) @ sweep.T @ projection.T
        assert np.allclose(right - after, expected, atol=1e-15)
        assert np.linalg.eigvalsh(expected).min() > -1e-15
        lost.append(np.linalg.norm(expected))
    assert lost[0] / lost[1] == pytest.approx(4, rel=1e-10)


# -- files -----------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_named_in_a_text_exist(path):
    named = re.findall(r"(?<![\w/])((?:tests|examples|benchmarks|docs|openmm_dpd)/[\w./-]*\w)", path.read_text(encoding="utf-8"))
    assert not [name for name in named if not (ROOT / name).exists() and not name.startswith("docs/_build")]


def test_gallery_has_every_example_and_small_pictures():
    page, folder = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8"), ROOT / "docs" / "figures" / "gallery"
    examples = sorted((ROOT / "examples").glob("[0-9]*.py"))
    assert examples and not [path.name for path in examples if f"<../examples/{path.name}>" not in page]
    drawing = {path.stem for path in examples if "savefig" in path.read_text(encoding="utf-8")} | {"in.dpd"}
    pictures = {path.name.removesuffix(".png"): path for path in folder.glob("*.png")}
    assert set(pictures) == drawing and not [name for name in pictures if f"(figures/gallery/{name}.png)" not in page]
    assert max(path.stat().st_size for path in pictures.values()) < 60_000


@pytest.mark.slow
def test_documentation_builds_without_warnings_and_needs_no_network(tmp_path):
    for module in ("sphinx", "myst_nb", "furo", "sphinx-mathjax-offline"):
        pytest.importorskip(module, reason=f"{module} is not installed: pip install -e '.[docs]'")
    options = ["-W", "--keep-going", "-q", "-b", "html", "-d", str(tmp_path / "trees")]
    command = [sys.executable, "-m", "sphinx", *options, str(ROOT / "docs"), str(tmp_path / "html")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    html = tmp_path / "html"
    pages = {path.relative_to(html).as_posix(): path.read_text(encoding="utf-8") for path in html.rglob("*.html")}
    assert {"api/build.html", "search.html", "notebooks/first_fluid.html"} <= set(pages)
    loaded = [source for page in pages.values() for source in re.findall(r"<(?:script|link|img)[^>]* (?:src|href)=\"([^\"]*)\"", page)]
    assert loaded and not [source for source in loaded if source.startswith(("http", "//"))]
    (mathematics,) = set(re.findall(r"src=\"([^\"?]*mathjax[^\"?]*)", pages["theory.html"]))
    assert (tmp_path / "html" / mathematics).stat().st_size > 1_000_000
    assert "<img" in pages["notebooks/first_fluid.html"].partition("Two temperatures")[0]  # a stored picture
