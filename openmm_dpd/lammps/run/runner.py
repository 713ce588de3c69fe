"""Carrying out the run commands of a deck with OpenMM."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import openmm
from openmm import app, unit

from ...barostat import EnthalpyBarostat, add_barostat
from ...build import BuiltSystem, build
from ...errors import DeckError, DPDError, OutputError, ParameterError, RunError
from ...fields import read_fields
from ...forces.segments import warm_up_segments
from ...integrators import PIECE
from ...kernels.engine import get_threads, set_threads, warm_up
from ...kinds import kind_for
from ...measure import Sample as Measurement
from ...model.scene import Scene
from ...names import COUNTER
from ...schemes import scheme_of
from ...signals import Signals
from ...stats import MIN_BLOCKS, block_average, ratio_average
from ...watch import has_set_temperature, temperature_warning
from ..language.lexer import located
from ..output.chunk_average import ChunkAverage
from ..output.thermo import ALWAYS
from ..output.time_average import TimeAverage
from ..state.deck_state import DeckState
from ..values.resolver import Resolver
from .options import RunOptions
from .request import RunRequest
from .sampling import CHEAP, Sampler, arrays
from .trajectory import RunTrajectory

_NM, _V = unit.nanometer, unit.nanometer / unit.picosecond

_LOGGER = logging.getLogger("openmm_dpd")


@dataclass
class RunResult:
    """What one run command gave.

    Attributes
    ----------
    request : RunRequest
    platform, precision : str
    seconds : float
        Wall time of stepping and thermo, without compilation, trajectory and pictures.
    steps_done : list of int
        Step numbers of the rows.
    rows : dict of str to list
        Values of each column, in the deck's units.
    conf : list of (gradient2, laplacian)
        Numerator and denominator of the configurational temperature at each row.
    no_laplacian : str or None
        Why there is no configurational temperature.
    target_kT : list of float
        Thermal energy (kJ/mol) that the thermostat is set to at each row.
    kinetic_kT : list of float
        That of the motion of all mobile beads, whatever compute ``temp`` stands for.
    momentum : float
        Largest component of the total momentum at the end, in the deck's units.
    steps_taken : int
        Steps that were carried out.
    stopped : str or None
        Why these are not all.
    profiles : dict
        The last block of every fix ave/chunk: {id: {"coord": [...], "ncount": [...], value: [...]}}.
    time_averages : dict
        The last average of every fix ave/time: {id: {"step": ..., value: ...}}.
    temperature_warning : str or None
        What is wrong with the mean temperature, see :func:`openmm_dpd.watch.temperature_warning`.
    """

    request: RunRequest
    platform: str
    precision: str
    discard: int
    words: tuple[str, ...]
    seconds: float = 0.0
    steps_taken: int = 0
    stopped: str | None = None
    steps_done: list[int] = field(default_factory=list)
    rows: dict[str, list[float]] = field(default_factory=dict)
    conf: list[tuple[float, float]] = field(default_factory=list)
    no_laplacian: str | None = None
    target_kT: list[float] = field(default_factory=list)
    kinetic_kT: list[float] = field(default_factory=list)
    momentum: float = 0.0
    profiles: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    time_averages: dict[str, dict[str, Any]] = field(default_factory=dict)
    temperature_warning: str | None = None

    def add(self, step: int, values: dict[str, float], measured: Measurement) -> None:
        """Append a row."""
        self.steps_done.append(step)
        for word, value in values.items():
            self.rows.setdefault(word, []).append(value)
        self.target_kT.append(measured.target_kT)
        self.kinetic_kT.append(measured.kT)
        units = self.request.state.units
        self.momentum = float(np.abs(measured.momentum).max()) / units.mass / units.velocity
        if measured.laplacian is not None:
            self.conf.append((measured.gradient2, measured.laplacian))

    def take_averages(self) -> None:
        """Take over what the averages of the deck have got so far."""
        averages = self.request.averages
        self.profiles = {average.name: average.profile for average in averages if isinstance(average, ChunkAverage) and average.profile}
        self.time_averages = {average.name: average.report for average in averages if isinstance(average, TimeAverage) and average.report}

    def averages(self) -> dict[str, dict[str, float | None] | None]:
        """{word: {mean, sem, first, last}}; ``temp_conf`` is None if there is no configurational temperature."""
        kept = self._kept()
        result: dict[str, dict[str, float | None] | None] = {}
        for word in self.words:
            if word == "temp_conf":
                result[word] = self._configurational(kept)[0]
                continue
            values = np.array(self.rows[word], dtype=float)
            average = block_average(values[kept])
            result[word] = {"mean": average.mean, "sem": average.sem, "first": float(values[0]), "last": float(values[-1])}
        return result

    def _kept(self) -> np.ndarray:
        """Which rows averages are taken over."""
        return np.array(self.steps_done) - self.request.first_step >= self.discard

    def check_temperature(self, target_kT: float, dof: int) -> None:
        """Compare the temperature with the one that was set."""
        kelvin = self.request.state.units.thermal_energy
        self.temperature_warning = temperature_warning(np.array(self.kinetic_kT)[self._kept()] / kelvin, target_kT / kelvin, dof)

    def _configurational(self, kept: np.ndarray) -> tuple[dict[str, float | None] | None, str | None]:
        """The average, and why there is none, or no error of it."""
        if self.no_laplacian is not None:
            return None, self.no_laplacian
        kelvin = self.request.state.units.thermal_energy
        gradient2, laplacian = np.array(self.conf).T
        if kept.any() and not laplacian[kept].any():
            return None, "no conservative force acts in the rows that are averaged, so the Laplacian is 0"
        try:
            average = ratio_average(gradient2[kept], laplacian[kept], name="the configurational temperature")
        except ParameterError as error:
            return None, str(error)
        lacking = average.sem is None and np.count_nonzero(kept) >= MIN_BLOCKS
        first, last = (float(gradient2[k] / laplacian[k] / kelvin) if laplacian[k] else None for k in (0, -1))
        return {
            "mean": None if average.mean is None else average.mean / kelvin,
            "sem": None if average.sem is None else average.sem / kelvin,
            "first": first,
            "last": last,
        }, "the Laplacian is 0 in all blocks of rows but one, so the standard error is not defined" if lacking else None

    def summary(self) -> dict[str, Any]:
        """One object of the JSON file."""
        request = self.request
        summary: dict[str, Any] = {
            "steps": self.steps_taken,
            "stopped": self.stopped,
            "dt": request.dt / request.state.units.time,
            "seconds_per_step": self.seconds / self.steps_taken if self.steps_taken else None,
            "thermo": self.averages(),
            "profiles": self.profiles,
            "averages": self.time_averages,
            "temperature_warning": self.temperature_warning,
        }
        reason = self._configurational(self._kept())[1]
        if reason is not None:
            summary["temp_conf_reason"] = reason
        return summary


class Pace:
    """How many steps to take before signals are looked at: as many as take about half a second, and at most 640.

    Whole pieces of those steps that an integrator takes back together, so that looking does not change what is computed together.
    """

    LEAST, MOST, SECONDS = PIECE, 64 * PIECE, 0.5

    def __init__(self) -> None:
        self.steps = self.LEAST

    def took(self, steps: int, seconds: float) -> None:
        """Learn from the time of some steps."""
        if steps == self.steps and seconds < 0.5 * self.SECONDS:
            self.steps = min(2 * self.steps, self.MOST)
        elif seconds > 2 * self.SECONDS:
            self.steps = max(self.steps // 2, self.LEAST)


class DeckRunner:
    """The callback of :func:`openmm_dpd.lammps.read_deck`: steps each run, prints thermo rows, writes trajectories.

    Parameters
    ----------
    options : RunOptions
    log : callable
        Takes lines of thermo output and remarks.
    out : Path, optional
        Folder for trajectory, topology and final state; nothing is written without it.
    progress : callable, optional
        ``progress(total)`` returns an object with ``update(steps)`` and ``close()``, such as a tqdm bar.
    signals : Signals, optional
        Those that may end a run early.
    """

    def __init__(
        self,
        options: RunOptions,
        log: Callable[[str], None] = lambda _: None,
        out: Path | None = None,
        progress=None,
        signals: Signals | None = None,
    ):
        self.options, self.log, self.progress, self.signals = options, log, progress, signals or Signals()
        self.results: list[RunResult] = []
        self.counter = 0.0
        self.trajectory = None if out is None else RunTrajectory(out)
        self._notes = 0
        set_threads(options.threads)

    def __call__(self, request: RunRequest) -> None:
        """Carry out one run."""
        options, state = self.options, request.state
        dt = None if options.dt is None else options.dt * state.units.time
        request = request.override(steps=options.steps, dt=dt, scheme=options.scheme, compat=options.compat)
        if options.discard > request.steps:
            # the last step has a row always
            raise RunError(f"{_where(request)}--discard {options.discard} leaves nothing to average of a run of {request.steps} steps")
        scene = request.scene()
        built = build_request(request, scene, options)
        barostat = connect_barostat(request, built)
        self.say_notes(state)
        warm_up(built.plan.spec, self.log)
        warm_up_segments(scene)
        simulation = built.simulation(properties=options.properties(built.plan.platform or ""))
        if barostat is not None:
            simulation.reporters.append(barostat)
        if COUNTER in simulation.context.getParameters():
            # every run draws new noise
            simulation.context.setParameter(COUNTER, self.counter)
        result = self._result(request, simulation, built)
        self.results.append(result)
        with self.signals.later():
            self._carry_out(request, scene, simulation, built, result)
        self.signals.check()
        if result.temperature_warning is not None:
            _LOGGER.warning("%s%s", _where(request), result.temperature_warning)
        if COUNTER in simulation.context.getParameters():
            self.counter = simulation.context.getParameter(COUNTER)

    def close(self) -> None:
        """Close the trajectory."""
        if self.trajectory is not None:
            self.trajectory.close()

    def say_notes(self, state: DeckState) -> None:
        """Log the remarks that are new."""
        for note in state.notes[self._notes :]:
            self.log(f"note: {note}")
        self._notes = len(state.notes)

    def _carry_out(self, request: RunRequest, scene: Scene, simulation: app.Simulation, built: BuiltSystem, result: RunResult) -> None:
        """Take the steps; whatever ends them early, the result and the state of the last step are kept."""
        bar = self.progress(request.steps) if self.progress else None
        begun = simulation.context.getStepCount()
        try:
            self._step_through(request, scene, simulation, built, result, bar)
            result.steps_taken = request.steps
            result.take_averages()
            if self.trajectory is not None:
                self.trajectory.save_state(simulation)
        except BaseException as error:
            result.steps_taken = simulation.context.getStepCount() - begun
            result.take_averages()
            done = f"after step {request.first_step + result.steps_taken} of {request.last_step}"
            if isinstance(error, KeyboardInterrupt):
                result.stopped = f"interrupted by {self.signals.name} {done}"
            else:
                result.stopped = f"{done}: {error}"
            if self.trajectory is not None and result.steps_done:
                self._rescue_state(simulation)
            if isinstance(error, KeyboardInterrupt):
                raise KeyboardInterrupt(result.stopped) from None
            if isinstance(error, (openmm.OpenMMException, RunError, OutputError)):
                raise RunError(f"{_where(request)}the run stopped: {error}") from None
            raise
        finally:
            if bar is not None:
                bar.close()

    def _rescue_state(self, simulation: app.Simulation) -> None:
        """Save the state of a run that ends early, which already has something to report: what goes wrong now comes beside it."""
        assert self.trajectory is not None
        try:
            self.trajectory.save_state(simulation)
        except (OutputError, openmm.OpenMMException) as error:
            _LOGGER.warning("%s", error)

    def _result(self, request: RunRequest, simulation: app.Simulation, built: BuiltSystem) -> RunResult:
        platform = simulation.context.getPlatform()
        name = platform.getName()
        fixed = {"Reference": "double", "CPU": "mixed"}
        words = tuple(dict.fromkeys((*request.thermo.words, *ALWAYS)))
        precision = fixed[name] if name in fixed else platform.getPropertyValue(simulation.context, "Precision")
        return RunResult(request, name, precision, self.options.discard, words)

    def _step_through(
        self, request: RunRequest, scene: Scene, simulation: app.Simulation, built: BuiltSystem, result: RunResult, bar
    ) -> None:
        thermo, dumps, context = request.thermo, request.dumps, simulation.context
        sampler, averages = Sampler(request, built, context), request.averages
        result.no_laplacian = sampler.observer.no_laplacian
        for average in averages:
            average.begin(request.state, request.first_step)
        if thermo.header():
            self.log(thermo.header())
        if self.trajectory is not None:
            self.trajectory.start(scene, request, built)
        step, started, measured, pace = request.first_step, time.perf_counter(), None, Pace()
        while True:
            begun = time.perf_counter()
            sample, rates = None, [average for average in averages if average.next_due == step]
            needs = frozenset().union(*(average.needs(request.state) for average in rates))
            if thermo.due(step) or not needs <= CHEAP:
                sample, measured = sampler.full(step, needs | thermo.needs, begun - started)
            elif rates:
                sample = sampler.cheap(step, needs, begun - started)
            for average in rates:
                average.take(Resolver(request.state, sample, request.window))
            if thermo.due(step):
                assert sample is not None and measured is not None
                values = thermo.values(sample, tuple(w for w in result.words if w != "temp_conf"))
                result.add(step, values, measured)
                self.log(thermo.row(values | {"temp_conf": sample.kT_conf or float("nan")}, sample))
            result.seconds += time.perf_counter() - begun if step > request.first_step else 0.0
            self._write_frames(request, sampler, step)
            if step == request.last_step:
                break
            self.signals.check()
            stop = min([thermo.next_due(step), request.last_step, step + pace.steps, *(dump.next_due(step) for dump in dumps)])
            if self.trajectory is not None:
                stop = min(stop, self.trajectory.next_due(step))
            stop = min([stop, *(average.next_due for average in averages if average.next_due > step)])
            begun = time.perf_counter()
            simulation.step(stop - step)
            spent = time.perf_counter() - begun
            result.seconds += spent
            pace.took(stop - step, spent)
            if bar is not None:
                bar.update(stop - step)
            step = stop
        if thermo.footer():
            self.log(thermo.footer())
        assert measured is not None
        if has_set_temperature(built.plan):
            result.check_temperature(measured.target_kT, measured.dof)
        x, v, box = arrays(context)
        last = None if sample is None else replace(sample, forces=None)
        request.finish(x, v, box=box, sample=last, carried=read_fields(context, built.plan))

    def _write_frames(self, request: RunRequest, sampler: Sampler, step: int) -> None:
        due = [dump for dump in request.dumps if dump.due(step)]
        framed = self.trajectory is not None and self.trajectory.due(step)
        if not due and not framed:
            return
        x, v, box = arrays(sampler.context)
        needs: frozenset[str] = frozenset().union(*(dump.needs(request.state) for dump in due))
        if any(dump.needs_forces for dump in due):
            needs |= {"forces"}
        sample = sampler.cheap(step, needs, 0.0) if needs <= CHEAP else sampler.full(step, needs, 0.0)[0]
        moment = Resolver(request.state, sample, request.window)
        for dump in due:
            dump.write(request.state, step, x, v, sample.forces, box, moment)
        if framed and self.trajectory is not None:
            self.trajectory.write(x, box, sampler.context, step)


def build_request(request: RunRequest, scene: Scene, options: RunOptions) -> BuiltSystem:
    """Build the scene of a run; what cannot be built is an error at the deck's run command."""
    for kind in (kind_for(table.kind) for table in scene.tables if table.kind is not None):
        if scene.compat == "consistent" and kind.unlike_lammps is not None:
            request.state.note(kind.unlike_lammps)
    try:
        return build(
            scene,
            dt=request.dt,
            scheme=request.scheme,
            lam=request.lambda_ if scheme_of(request.scheme).predicts else 0.5,
            conservative=options.conservative,
            platform=options.platform,
            seed=options.seed if options.seed is not None else request.seed,
        )
    except DPDError as error:
        if isinstance(error, DeckError) or request.where is None:
            raise
        raise located(request.where, str(error)) from None


#: Steps between two attempts to change the volume.
VOLUME_INTERVAL = 10


def connect_barostat(request: RunRequest, built: BuiltSystem) -> EnthalpyBarostat | None:
    """The barostat of ``request.barostat``: OpenMM's goes into ``built.system``, before there is a Context; ours is returned.

    Raises
    ------
    DeckError
        If the pressure changes during the run, or is not the same along all axes.
    """
    control = request.barostat
    if control is None:
        return None
    where = request.where
    pressures = {p for p, used in zip(control.start, control.axes, strict=True) if used}
    try:
        if not control.constant or len(pressures) > 1:
            raise ParameterError("fix nph: volume moves have one pressure, the same along all axes and during the whole run")
        choices: dict[str, Any] = {"interval": VOLUME_INTERVAL, "axes": control.axes, "coupled": control.coupled}
        if control.isothermal:
            add_barostat(built, pressures.pop(), **choices)
            return None
        return EnthalpyBarostat(built, pressures.pop(), **choices)
    except DPDError as error:
        raise located(where, str(error)) if where else error from None


def _where(request: RunRequest) -> str:
    return "" if request.where is None else f"{request.where.file}:{request.where.number}: "


def results_json(results: list[RunResult]) -> dict:
    """The object that ``--json`` writes; runs that were cut short before their first row are left out."""
    results = [result for result in results if result.steps_done]
    if not results:
        raise DeckError("the deck has no run")
    last = results[-1]
    runs = [result.summary() for result in results]
    return {
        "natoms": len(last.request.state.atoms),
        "units": last.request.state.units.name,
        "scheme": last.request.scheme,
        "platform": last.platform,
        "precision": last.precision,
        "threads": get_threads(),
        "momentum": last.momentum,
        "runs": runs,
        **runs[-1],
    }
