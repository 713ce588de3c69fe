"""A scene as a LAMMPS deck and data file, to be run somewhere else (a cluster, say)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.errors import ParameterError, what_is
from ...base.files import write_whole, writing
from ...model.scene import Scene
from ...model.schemes import scheme_of
from ...plan.plan import Plan
from ...simulation.built import BuiltSystem
from ..run.options import RunOptions, first_request
from .export_job import DUMP, FINAL, Job, export_texts, make_job


@dataclass(frozen=True)
class LammpsExport:
    """Files that an export wrote."""

    deck: Path  #: ``in.NAME``
    data: Path  #: ``data.NAME``
    tables: tuple[Path, ...]  #: Files of tables that the deck reads
    dump: Path  #: Trajectory that LAMMPS will write, beside the deck; see :func:`openmm_dpd.lammps.read_lammps_dump`
    final: Path  #: Data file that LAMMPS will write at the end, beside the deck
    differences: tuple[str, ...]  #: What LAMMPS will do differently (also comments of the deck)


def export_lammps(
    source: Scene | Plan | BuiltSystem,
    directory: str | Path,
    name: str,
    *,
    dt=None,
    steps: int = 1000,
    scheme: str | None = None,
    lam: float | None = None,
    seed: int | None = None,
    every: int | None = None,
    units: str = "lj",
    corner=None,
) -> LammpsExport:
    """Write ``directory/in.NAME`` and ``directory/data.NAME``, which LAMMPS runs as they are, with any number of processes.

    Parameters
    ----------
    source : Scene, Plan or BuiltSystem
        A plan brings its own step size, scheme, lambda and seed.
    directory : str or Path
        Made if it does not exist; files of an earlier export are replaced.
    name : str
        Letters, digits and ``_ . + -``.
    dt : time
        Step size (bare numbers: ps); needed for a Scene.
    steps : int
        Number of steps of the run.
    scheme : str, optional
        A name or a word; ``mvv`` for a Scene by default, which is LAMMPS's own.  What LAMMPS does not have is replaced by what is nearest,
        with a warning.
    lam : float, optional
        Lambda of ``mvv``.
    seed : int, optional
        Seed of the noise and of velocities that the scene does not give.
    every : int, optional
        Steps between two frames and two lines of output; a hundredth of the steps by default.
    units : {"lj", "real", "metal"}
        Units of deck and data file.  ``lj`` writes the numbers of the scene as they are: 1 nm, 1 Da, 1 ps, 1 kJ/mol, k_B = 1.
    corner : three lengths, optional
        Lower corner of the box; that of the sources, or the origin, by default.

    Raises
    ------
    ParameterError
        If a choice is out of bounds, the folder is not writable, or LAMMPS has nothing like a part of the scene; it is named.

    Warns
    -----
    ExportWarning
        For everything that LAMMPS will do differently; the deck says the same in comments.
    """
    if isinstance(source, BuiltSystem):
        source = source.plan
    if isinstance(source, Plan):
        options = source.options
        dt, scheme = (options.dt if dt is None else dt), scheme or options.scheme.name
        lam, seed = (options.lam if lam is None and scheme_of(scheme).predicts else lam), (options.seed if seed is None else seed)
        source = source.scene
    if not isinstance(source, Scene):
        raise ParameterError(f"expected a Scene, a Plan or what build() made, not {what_is(source)}")
    job = make_job(source, name, dt, steps, scheme or "mvv", 0.5 if lam is None else lam, seed, every, units, corner)
    return _write(job, Path(directory))


def export_deck(
    path: str | Path,
    directory: str | Path,
    *,
    name: str | None = None,
    dt: float | None = None,
    steps: int | None = None,
    scheme: str | None = None,
    seed: int | None = None,
    every: int | None = None,
    compat: str = "consistent",
    variables: Mapping[str, str] | None = None,
) -> LammpsExport:
    """Write the scene of a deck's first run as a deck and a data file, in the deck's units.

    Groups, formulas, output and further runs of the deck are not copied; a deck that LAMMPS reads needs no export.

    Parameters
    ----------
    path : str or Path
        The deck.
    directory : str or Path
        Where to; ``in.NAME`` in it must not be the deck itself.
    name : str, optional
        The deck's name without ``in.`` by default.
    dt : float, optional
        Time step in the deck's units.
    steps, scheme, seed, every
        As in :func:`export_lammps`; those of the deck's first run by default.
    variables : mapping, optional
        Index variables of the deck.
    """
    path = Path(path)
    name = name or path.name.removeprefix("in.")
    target = Path(directory) / f"in.{name}"
    if target.exists() and path.exists() and target.resolve() == path.resolve():
        raise ParameterError(f"{target} is the deck itself; give another folder or another name")
    request = first_request(path, RunOptions(dt=dt, steps=steps, scheme=scheme, compat=compat), variables)
    scene, state = request.scene(), request.state
    corner = state.require_box("an export").low * state.units.length
    lam = request.lambda_ if scheme_of(request.scheme).predicts else 0.5
    run = (request.dt, request.steps, request.scheme, lam, request.seed if seed is None else seed, every)
    job = make_job(scene, name, *run, state.units.name, corner, state.atoms.images)
    if request.barostat is not None:
        raise ParameterError("fix nph of the deck is not exported; LAMMPS reads the deck itself, or export a deck without it")
    if not np.array_equal(state.atoms.ids, np.arange(1, len(state.atoms) + 1)):
        job.differences.remark("ids are counted from 1 without gaps, in the order of the ids of the deck")
    job.differences.remark(f"this is the first run of {state.path.name} only")
    return _write(job, Path(directory))


def _write(job: Job, directory: Path) -> LammpsExport:
    texts = export_texts(job)
    job.differences.warn(3)
    with writing(directory, "the folder"):
        directory.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write_whole(directory / name, text, "the exported file")
    deck, data = f"in.{job.name}", f"data.{job.name}"
    tables = tuple(directory / name for name in texts if name not in (deck, data))
    dump, final = (directory / form.format(name=job.name) for form in (DUMP, FINAL))
    return LammpsExport(directory / deck, directory / data, tables, dump, final, tuple(job.differences.found))
