"""Functions for decks: run them, compute forces, explain and recommend."""

import logging
import sys
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...advice.recommend import advice, recommend
from ...base.errors import DeckError, OutputError, ParameterError, read_by
from ...base.file_ledger import ledger_in_use
from ...base.files import BlockFile
from ...base.signals import Signals
from ...io.bead_pictures import bead_picture
from ...io.pictures import thermo_picture
from ...measure import force_terms
from ...model.internal import BeadTemperatures, InternalEnergy
from ...model.scene import Scene
from ...runtime import set_threads
from ..scene.integration import integration
from .building import build_request, connect_barostat
from .check import all_said
from .checkpoint import Checkpoints
from .deck import deck_runs, open_deck
from .guide import DeckGuide
from .options import RunOptions, first_request
from .request import RunRequest
from .result import RunResult, averages_text, results_json
from .runner import DeckRunner

#: Name of the log file.
NAME = "log.txt"


class RunLog:
    """Collects lines (thermo rows, remarks, text of ``print``) in ``log.txt``, if a folder is given, and passes them to ``show``.  With
    ``append`` an existing file is continued.  OutputError if it cannot be written."""

    def __init__(self, show: Callable[[str], None], folder: Path | None, append: bool = False):
        self.show = show
        self._file = None if folder is None else BlockFile(folder / NAME, "the log", append)

    def __call__(self, text: str) -> None:
        """Add a line, except during the replay of a resumed run, whose lines are already there."""
        ledger = ledger_in_use()
        if ledger is not None and ledger.replaying:
            return
        if self._file is not None:
            self._file.write(text + "\n")
        self.show(text)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


_LOGGER = logging.getLogger("openmm_dpd")
#: Panels of the picture, and the dimension of each.
PANELS = {"time": "time", "temperature": "thermal_energy", "pressure": "pressure", "potential energy": "energy", "total energy": "energy"}


def run_deck(
    path: str | Path,
    options: RunOptions | None = None,
    *,
    out: str | Path | None = None,
    log: Callable[[str], None] = lambda _: None,
    variables: Mapping[str, str] | None = None,
    progress: bool = False,
    keep: Callable[[dict], None] = lambda _: None,
    signals: Signals | None = None,
    restart: str | Path | None = None,
    asked: Mapping[str, Any] | None = None,
) -> dict:
    """Run a LAMMPS deck.

    Parameters
    ----------
    path : str or Path
        The deck.
    options : RunOptions, optional
        Settings that override the deck's.
    out : str or Path, optional
        Folder for trajectory (``trajectory.dcd``, ``topology.psf``), log (``log.txt``), checkpoint, final state, pictures (``thermo.png``,
        ``beads.png``) and the deck's output; by default the deck's output goes to the working directory, and nothing else is written.
    log : callable, optional
        Receives the lines of output.
    variables : mapping, optional
        Index variables of the deck (LAMMPS: ``-var``).
    progress : bool
        Show a progress bar on standard error, if that is a terminal.
    keep : callable, optional
        Receives the returned object, even if a run ends early.
    signals : Signals, optional
        Signals that may end a run early (:mod:`openmm_dpd.base.signals`).
    restart : str or Path, optional
        Folder of an interrupted run, or a file of its ``checkpoint``: continue it with its options.  ``options`` and ``variables`` may
        repeat these; only ``threads`` and ``checkpoint`` may differ.
    asked : mapping, optional
        Plain data that checkpoints store for the caller, available as ``Checkpoints(folder).latest().asked``.

    Returns
    -------
    dict
        ``natoms``, ``units``, ``scheme``, ``platform``, ``precision``, ``threads``, ``momentum``, ``runs``: one object per run with
        ``steps`` that were taken, ``stopped`` (None, or why these are not all), ``dt``, ``seconds_per_step``, ``averages_from``
        (a step), ``thermo`` ({word: {mean, sem, first, last}}), ``profiles`` ({fix: {coord, ncount, ...}}), ``averages``
        ({fix: {step, word: value}}) and ``temperature_warning`` (None, or what is wrong with the mean temperature, which the logger
        "openmm_dpd" says too), and the last run's entries at top level.

    Raises
    ------
    DeckError
        For anything in the deck that is unknown, unsupported or wrong, with file and line; before the first run the message has a line for
        everything of the kind in the whole deck (:func:`check_deck`).
    RunError
        If stepping fails, or an output file cannot be written.  Trajectories, dumps and averages then end with whole frames, and the
        state of the last step is kept.
    ParameterError
        If there is nothing to resume, or the options or the deck do not match.
    OutputError
        If the run is complete, but a picture cannot be written; if a file that a resumed run would continue is missing.
    """
    options, folder = options or RunOptions(), None if out is None else Path(out)
    signals, variables, latest = signals or Signals(), dict(variables or {}), None
    if restart is not None:
        folder = Checkpoints.at(Path(restart))
        if out is not None and folder.resolve() != Path(out).resolve():
            raise ParameterError(f"--restart {restart} continues in {folder}, so --out {out} cannot be another folder; omit it")
    checkpoints = None if folder is None else Checkpoints(folder, asked)
    if checkpoints is not None and restart is not None:
        latest = checkpoints.latest()
        options = latest.merged(options)
        latest.check(Path(path), variables)
        variables = latest.variables
        checkpoints.resume(latest)
    elif checkpoints is not None:
        checkpoints.clear()
    elif options.checkpoint:
        raise ParameterError("checkpoints need a folder: give out")
    with nullcontext() if checkpoints is None else checkpoints.ledger.in_use():
        said = RunLog(log, folder, append=latest is not None)
        try:
            runner = DeckRunner(options, said, folder, _bar if progress else None, signals, variables, checkpoints, latest)
            with all_said(path, variables, lambda: runner.results):
                report = _carried_out(Path(path), runner, folder, keep)
        finally:
            with signals.later():
                said.close()
    if checkpoints is not None:
        checkpoints.clear()
    return report


def _carried_out(path: Path, runner: DeckRunner, folder: Path | None, keep: Callable[[dict], None]) -> dict:
    """Carry out the deck and its runs, and return the report."""
    signals = runner.signals
    try:
        with open_deck(path, runner.variables, folder or Path("."), runner.log, carried_out=True) as deck:
            for request in deck_runs(deck):
                runner.carry_out(request)
        runner.say_notes(deck)
        runner.log(averages_text(runner.results))
        signals.end()
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt) and runner.checkpoints is not None:
            stopped = error.args[0] if error.args else f"interrupted by {signals.name}"
            error.args = (stopped, runner.checkpoints.remedy(path, runner.not_resumable))
        if any(result.steps_done for result in runner.results):
            with signals.later():
                try:
                    _hand_over(runner, folder, keep, done=False)
                except OutputError as error:
                    _LOGGER.warning("%s", error)  # in addition to the first error
        raise
    finally:
        with signals.later():
            runner.close()
    return _hand_over(runner, folder, keep, done=True)


def _hand_over(runner: DeckRunner, folder: Path | None, keep: Callable[[dict], None], done: bool) -> dict:
    """Write all outputs that can be written, and return the report.  OutputError with the failures.  Beads are drawn when the deck is done:
    what a checkpoint keeps of them is their state between two runs."""
    report, failed = results_json(runner.results), list[str]()
    outputs: list[Callable[[], None]] = [lambda: keep(report)]
    if folder is not None and runner.trajectory is not None:
        outputs.append(runner.trajectory.write_state)
        outputs.append(lambda: _picture(folder / "thermo.png", runner.results))
        if done and runner.results:
            outputs.append(lambda: _beads(folder / "beads.png", runner.results[-1].request))
    for write in outputs:
        try:
            write()
        except OutputError as error:
            failed.append(str(error))
    if failed:
        raise OutputError("; ".join(failed))
    return report


def _bar(total: int, done: int):
    from tqdm import tqdm

    # disable=None: not if standard error is a file, as in batch jobs
    return tqdm(total=total, initial=done, unit="step", file=sys.stderr, leave=False, dynamic_ncols=True, disable=None)


def deck_scene(path: str | Path, *, variables: Mapping[str, str] | None = None) -> Scene:
    """The scene of a deck's first run, to build it in Python instead of running the deck.

    Fixes that act within steps, such as ``nvt``, are not part of a scene; a warning names them.

    Raises
    ------
    DeckError
        For anything in the deck that is unknown, unsupported or wrong, with file and line.
    """
    request = first_request(path, RunOptions(), variables)
    for fix in request.state.fixes_of("deform") if request.state.moving_box else ():
        raise fix.error("a scene has no box that changes; run the deck")
    if (guide := DeckGuide.of(request)) is not None:
        _LOGGER.warning("%s act within steps of a deck's runs and are not part of its scene", guide.what)
    return request.scene()


def deck_forces(
    path: str | Path, options: RunOptions | None = None, *, variables: Mapping[str, str] | None = None
) -> dict[str, np.ndarray]:
    """Forces term by term at the first configuration and velocities of a deck.

    Always in force form, for any scheme; in the deck's units and in the order of the atom ids.

    Returns
    -------
    dict of (N, 3) arrays
        ``conservative``, ``dissipative``, ``random``, and ``bond`` if there are bonds or angles.  They sum to the total.  If beads have
        energies, temperatures or concentrations, ``rates_dissipative`` and ``rates_random`` (N, K) are their rates of change.
    """
    options = options or RunOptions()
    set_threads(options.threads)
    request = first_request(path, options, variables)
    built = build_request(request, request.scene(), options)
    terms = force_terms(built, properties=options.properties(built.plan.platform or ""))
    units, internal = request.state.units, built.plan.scene.internal
    terms = {name: values if name.startswith("rates") else request.axes.of_deck(values) for name, values in terms.items()}
    unit = {InternalEnergy: units.energy, BeadTemperatures: units.thermal_energy}.get(type(internal), 1.0)
    return {name: values / (unit / units.time if name.startswith("rates") else units.force) for name, values in terms.items()}


def explain_deck(
    path: str | Path, options: RunOptions | None = None, *, variables: Mapping[str, str] | None = None, program: bool = False
) -> str:
    """The plan for the first run of a deck, with the integrator's program if asked for, the expected accuracy of the step, and notes about
    the deck."""
    options = options or RunOptions()
    with all_said(path, variables):
        request = first_request(path, options, variables)
        built = build_request(request, request.scene(), options)
        connect_barostat(request, built)
    with read_by(request.state):
        text = [built.explain(program=program), "step: " + advice(built.plan.scene, request.scheme, request.dt)]
    return "\n".join([*text, *(f"note: {note}" for note in request.state.notes)])


def recommend_deck(
    path: str | Path, options: RunOptions | None = None, *, error: float = 0.01, variables: Mapping[str, str] | None = None
) -> str:
    """Recommended scheme and step for a deck's first run at an accepted error, and the error of the deck's own.

    Parameters
    ----------
    path : str or Path
    options : RunOptions, optional
        ``scheme`` and ``dt`` replace those of the deck.
    error : float, default 0.01
        Accepted relative error of the temperatures; see :func:`openmm_dpd.recommend`.
    variables : mapping, optional
        Index variables of the deck.

    Returns
    -------
    str
        Steps are in the deck's units.
    """
    request = first_request(path, options or RunOptions(), variables)
    scene = request.scene()
    with read_by(request.state):
        return f"{recommend(scene, error)}\nthe deck's own: {advice(scene, request.scheme, request.dt)}"


def _picture(path: Path, results: list[RunResult]) -> None:
    """Plot temperature, pressure and energies of all runs against time."""
    state = results[-1].request.state
    drawn = ("temp", "press", "pe", "etotal")
    columns: dict[str, list[float]] = {name: [] for name in ("time", *drawn)}
    boundaries, target, counted = [], [], list[bool]()
    elapsed = 0.0
    for result in (result for result in results if result.steps_done):
        request = result.request
        dt = request.dt / result.units.time
        times = [elapsed + (step - request.first_step) * dt for step in result.steps_done]
        elapsed = times[-1]
        boundaries.append(elapsed)
        columns["time"] += times
        for name in drawn:
            columns[name] += result.rows[name]
        target += [kT / result.units.thermal_energy for kT in result.target_kT]
        counted += [row >= result.start() for row in range(len(times))]
    labels = {panel: state.units.unit_names.get(dimension, "") for panel, dimension in PANELS.items()}
    thermo_picture(path, columns, runs=boundaries[:-1], target=target, counted=counted, labels=labels, title=state.path.name)


def _beads(path: Path, request: RunRequest) -> None:
    """Draw the beads that the deck has at its end, if it could go on with them."""
    with suppress(DeckError, ParameterError):
        if len(request.mobile) != len(request.state.atoms):  # some have come or gone since
            request = replace(request, mobile=integration(request.state).mobile)
        bead_picture(path, request.scene(), title=request.state.path.name)
