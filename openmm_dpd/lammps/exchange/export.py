"""Export of a scene as a LAMMPS deck and data file, to be run elsewhere, such as on a cluster."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.errors import ParameterError, require
from ...base.files import write_whole, writing
from ...model.scene import Scene
from ...model.schemes import scheme_of
from ...plan.plan import Plan
from ...simulation.built import BuiltSystem
from ..run.options import RunOptions, first_request
from ..scene.axes import SAME
from ..scene.flow import guided
from ..state.records import GUIDED
from .export_job import DUMP, FINAL, Job, export_texts, make_job


@dataclass(frozen=True)
class LammpsExport:
    """Files that an export wrote."""

    deck: Path  #: ``in.NAME``
    data: Path  #: ``data.NAME``
    tables: tuple[Path, ...]  #: Table files that the deck reads
    dump: Path  #: Trajectory that LAMMPS will write next to the deck; see :func:`openmm_dpd.lammps.read_lammps_dump`
    final: Path  #: Data file that LAMMPS will write at the end, next to the deck
    differences: tuple[str, ...]  #: Differences from the scene in LAMMPS (also in comments of the deck)


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
    """Write ``directory/in.NAME`` and ``directory/data.NAME``, which LAMMPS runs unchanged on any number of processes.

    Parameters
    ----------
    source : Scene, Plan or BuiltSystem
        A plan supplies step size, scheme, lambda and seed.
    directory : str or Path
        Created if it does not exist; files of an earlier export are replaced.
    name : str
        Letters, digits and ``_ . + -``.
    dt : time
        Step size (bare numbers: ps); required for a Scene.
    steps : int
        Number of steps of the run.
    scheme : str, optional
        A name or a word; ``mvv``, LAMMPS's own, by default for a Scene.  A scheme that LAMMPS lacks is replaced by the nearest one, with a
        warning.
    lam : float, optional
        Lambda of ``mvv``.
    seed : int, optional
        Seed of the noise, and of velocities that the scene lacks.
    every : int, optional
        Steps between frames and between lines of output; a hundredth of the steps by default.
    units : {"lj", "real", "metal", "si", "cgs", "micro", "nano"}
        Units of deck and data file.  ``lj`` writes the numbers of the scene unchanged: nm, Da, ps, kJ/mol, k_B = 1.
    corner : three lengths, optional
        Lower corner of the box; by default that of the sources, or the origin.

    Raises
    ------
    ParameterError
        If an argument is out of bounds, the folder is not writable, or LAMMPS has no equivalent of a part of the scene.

    Warns
    -----
    ExportWarning
        For each difference from the scene in LAMMPS; comments of the deck list them, too.
    """
    if isinstance(source, BuiltSystem):
        source = source.plan
    if isinstance(source, Plan):
        options = source.options
        dt, scheme = (options.dt if dt is None else dt), scheme or options.scheme.name
        lam, seed = (options.lam if lam is None and scheme_of(scheme).predicts else lam), (options.seed if seed is None else seed)
        if source.options.guided:
            raise ParameterError(f"{source.options.guided} act within steps and cannot be exported")
        source = source.scene
    require(source, Scene, "expected a Scene, a Plan or what build() made")
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

    Groups, formulas, output and further runs are not exported; a deck that LAMMPS can read needs no export.

    Parameters
    ----------
    path : str or Path
        The deck.
    directory : str or Path
        Folder of the new files; ``in.NAME`` in it must not be the deck itself.
    name : str, optional
        By default the deck's name without ``in.``.
    dt : float, optional
        Time step in the deck's units.
    steps, scheme, seed, every
        See :func:`export_lammps`; by default those of the deck's first run.
    variables : mapping, optional
        Index variables of the deck.
    """
    path = Path(path)
    name = name or path.name.removeprefix("in.")
    target = Path(directory) / f"in.{name}"
    if target.exists() and path.exists() and target.resolve() == path.resolve():
        raise ParameterError(f"{target} is the deck itself; give another folder or name")
    request = first_request(path, RunOptions(dt=dt, steps=steps, scheme=scheme, compat=compat), variables)
    scene, state = request.scene(), request.state
    if state.dimension == 2:
        raise ParameterError("a deck in two dimensions cannot be exported; LAMMPS can run the deck itself")
    if state.moving_box:
        raise ParameterError("a box that fix deform changes with remap x or none cannot be exported; LAMMPS can run the deck itself")
    if request.axes != SAME:
        raise ParameterError(f"a shear in the plane {request.axes.plane} cannot be exported; LAMMPS can run the deck itself")
    if guided(state):
        which = [f"fix {fix.name} ({fix.style})" for fix in state.fixes_of(*GUIDED)]
        raise ParameterError(f"{', '.join(which)}: what acts within steps cannot be exported; run the deck itself in LAMMPS")
    corner = state.require_box("an export").low * state.units.length
    lam = request.lambda_ if scheme_of(request.scheme).predicts else 0.5
    run = (request.dt, request.steps, request.scheme, lam, request.seed if seed is None else seed, every)
    job = make_job(scene, name, *run, state.units, corner, state.atoms.images)
    if request.barostat is not None:
        raise ParameterError("fix nph cannot be exported; run the deck itself in LAMMPS, or remove the fix")
    if not np.array_equal(state.atoms.ids, np.arange(1, len(state.atoms) + 1)):
        job.differences.remark("ids are renumbered from 1 without gaps, in the order of the deck's ids")
    job.differences.remark(f"this is only the first run of {state.path.name}")
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
