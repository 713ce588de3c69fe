"""Carrying out the run commands of a deck with OpenMM."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import openmm
from openmm import app

from ...build import BuiltSystem
from ...errors import OutputError, RunError
from ...fields import read_fields
from ...forces.segments import warm_up_segments
from ...kernels.engine import set_threads, warm_up
from ...measure.watch import has_set_temperature
from ...model.scene import Scene
from ...names import COUNTER
from ...signals import Signals
from ...watching import PIECE
from ..output.thermo import ALWAYS
from ..state.deck_state import DeckState
from ..values.resolver import Resolver
from .building import build_request, connect_barostat
from .minimizing import carry_out_minimization
from .momentum import MomentumFixes
from .options import FIXED_PRECISION, RunOptions, overridden
from .request import RunRequest
from .restarts import RestartFiles
from .result import RunResult
from .sampling import CHEAP, Sampler, arrays
from .trajectory import RunTrajectory

_LOGGER = logging.getLogger("openmm_dpd")


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
        self.trajectory = None if out is None else RunTrajectory(out)
        self._notes = 0
        set_threads(options.threads)

    def __call__(self, request: RunRequest) -> None:
        """Carry out one run."""
        options, state = self.options, request.state
        if request.minimization is not None:
            self.say_notes(state)
            with self.signals.later():
                carry_out_minimization(request, request.minimization, options, self.log)
            self.signals.check()
            return
        request = overridden(request, options)
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
            simulation.context.setParameter(COUNTER, state.noise_counter)
        result = self._result(request, simulation, built)
        self.results.append(result)
        with self.signals.later():
            self._carry_out(request, scene, simulation, built, result)
        self.signals.check()
        if result.temperature_warning is not None:
            _LOGGER.warning("%s%s", _where(request), result.temperature_warning)
        if COUNTER in simulation.context.getParameters():
            state.noise_counter = simulation.context.getParameter(COUNTER)

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
        words = tuple(dict.fromkeys((*request.thermo.words, *ALWAYS)))
        precision = FIXED_PRECISION.get(name) or platform.getPropertyValue(simulation.context, "Precision")
        return RunResult(request, name, precision, self.options.discard, words)

    def _step_through(
        self, request: RunRequest, scene: Scene, simulation: app.Simulation, built: BuiltSystem, result: RunResult, bar
    ) -> None:
        thermo, dumps, context = request.thermo, request.dumps, simulation.context
        sampler, readers, momentum = Sampler(request, built, context), request.readers, MomentumFixes(request, context)
        result.no_laplacian = sampler.observer.no_laplacian
        for reader in readers:
            reader.begin(request.state, request.first_step)
        if self.trajectory is not None:
            self.trajectory.start(scene, request, built)
        restarts = RestartFiles(request, built, context)
        step, started, measured, pace = request.first_step, time.perf_counter(), None, Pace()
        while True:
            begun = time.perf_counter()
            sample, due = None, [reader for reader in readers if reader.next_due == step]
            needs = frozenset().union(*(reader.needs(request.state) for reader in due))
            if thermo.due(step) or not needs <= CHEAP:
                sample, measured = sampler.full(step, needs | thermo.needs, begun - started)
            elif due:
                sample = sampler.cheap(step, needs, begun - started)
            for reader in due:
                reader.take(Resolver(request.state, sample, request.window))
            if step == request.first_step and thermo.header():
                self.log(thermo.header())
            if thermo.due(step):
                assert sample is not None and measured is not None
                values = thermo.values(sample, tuple(w for w in result.words if w != "temp_conf"))
                result.add(step, values, measured)
                self.log(thermo.row(values | {"temp_conf": sample.kT_conf or float("nan")}, sample))
            result.seconds += time.perf_counter() - begun if step > request.first_step else 0.0
            self._write_frames(request, sampler, step)
            restarts.write(step)
            if step == request.last_step:
                break
            self.signals.check()
            stop = min([thermo.next_due(step), request.last_step, step + pace.steps, *(dump.next_due(step) for dump in dumps)])
            if self.trajectory is not None:
                stop = min(stop, self.trajectory.next_due(step))
            stop = min(
                [stop, momentum.next_due(step), restarts.next_due(step), *(reader.next_due for reader in readers if reader.next_due > step)]
            )
            begun = time.perf_counter()
            simulation.step(stop - step)
            sampler.observer.changed = momentum.act(stop)
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
        request.finish(x, v, box=box, sample=last, fields=read_fields(context, built.plan))

    def _write_frames(self, request: RunRequest, sampler: Sampler, step: int) -> None:
        due = [dump for dump in request.dumps if dump.due(step)]
        framed = self.trajectory is not None and self.trajectory.due(step)
        if not due and not framed:
            return
        needs = frozenset(("positions",)).union(*(dump.needs(request.state) for dump in due))
        sample = sampler.cheap(step, needs, 0.0) if needs <= CHEAP else sampler.full(step, needs, 0.0)[0]
        moment = Resolver(request.state, sample, request.window)
        for dump in due:
            dump.write(moment)
        if framed and self.trajectory is not None:
            assert sample.positions is not None and sample.box is not None
            self.trajectory.write(sample.positions, sample.box, sampler.context, step)


def _where(request: RunRequest) -> str:
    return "" if request.where is None else f"{request.where.file}:{request.where.number}: "
