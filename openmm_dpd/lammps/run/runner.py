"""Carries out the runs of a deck with OpenMM."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import openmm
from openmm import app

from ...base.errors import OutputError, ParameterError, RunError
from ...base.names import COUNTER
from ...base.signals import Signals
from ...plan.forces.segments import warm_up_segments
from ...plan.made import BAROSTATS
from ...runtime import set_threads
from ...simulation.build import BuiltSystem
from ..output.thermo import ALWAYS
from ..state.deck_state import DeckState
from .building import build_request, carry_out_minimization, connect_barostat
from .checkpoint import Checkpoints, Latest, recall, recorded, to_bytes
from .deck import at_line
from .options import FIXED_PRECISION, RunOptions, overridden
from .request import RunRequest
from .result import RunResult
from .stepping import DeckSteps
from .trajectory import RunTrajectory

_LOGGER = logging.getLogger("openmm_dpd")


class DeckRunner:
    """Carries out the runs of a deck: takes their steps, prints thermo rows, writes trajectories and checkpoints.

    ``log`` takes lines of thermo output and remarks; nothing is written without the folder ``out``.  ``progress(total, done)`` returns an
    object with ``update(steps)`` and ``close()``, such as a tqdm bar; ``signals`` may end a run early.  ``variables`` are those of the
    command line, for checkpoints.  Until ``latest``, where an interrupted run is resumed, runs are recalled and not carried out.
    """

    def __init__(
        self,
        options: RunOptions,
        log: Callable[[str], None] = lambda _: None,
        out: Path | None = None,
        progress=None,
        signals: Signals | None = None,
        variables: dict[str, str] | None = None,
        checkpoints: Checkpoints | None = None,
        latest: Latest | None = None,
    ):
        self.options, self.log, self.progress, self.signals = options, log, progress, signals or Signals()
        self.variables, self.checkpoints, self.latest = variables or {}, checkpoints, latest
        self.results: list[RunResult] = []  #: Results of the runs begun so far
        self.not_resumable: str | None = None  #: Why an interrupted run cannot be resumed
        self.trajectory = None if out is None else RunTrajectory(out, options.format, options.every)
        self._notes = 0
        set_threads(options.threads)

    def carry_out(self, request: RunRequest) -> None:
        """Carry out one run or minimisation, or recall it.  DeckError, at the line of the command, if this is impossible."""
        with at_line(request.where):
            if request.minimization is None:
                self._run(overridden(request, self.options))
            else:
                self.say_notes(request.state)
                with self.signals.later():
                    carry_out_minimization(request, request.minimization, self.options, self.log)
                self.signals.check()

    def close(self) -> None:
        """Close the trajectory."""
        if self.trajectory is not None:
            self.trajectory.close()

    def say_notes(self, state: DeckState) -> None:
        """Log new remarks."""
        for note in state.notes[self._notes :]:
            self.log(f"note: {note}")
        self._notes = len(state.notes)

    # -- one run ------------------------------------------------------------------------------------------------------------------
    def _run(self, request: RunRequest) -> None:
        options, state, latest = self.options, request.state, self.latest
        if latest is not None and request.number < latest.runs:
            self._recall(request, latest)
            return
        present = None if latest is None or request.number > latest.runs else latest.present
        if present is not None:
            self._check_same(request, present)
            recall(state, present["memory"])
        scene = request.scene()
        built = build_request(request, scene, options)
        barostat = connect_barostat(request, built)
        self._check_resumable(request, built)
        self.say_notes(state)
        built.plan.engine.warm_up(built.plan.spec, self.log)
        warm_up_segments(scene)
        simulation = built.simulation(properties=options.properties(built.plan.platform or ""))
        if barostat is not None:
            simulation.reporters.append(barostat)
        if COUNTER in simulation.context.getParameters():
            # every run draws new noise
            simulation.context.setParameter(COUNTER, state.noise_counter)
        result = self._result(request, simulation, present)
        self.results.append(result)
        with self.signals.later():
            self._take_steps(request, scene, simulation, built, result, present)
            if COUNTER in simulation.context.getParameters():
                state.noise_counter = simulation.context.getParameter(COUNTER)
            self._keep(request, result)
        self.signals.check()
        if result.temperature_warning is not None:
            _LOGGER.warning("%s%s", _where(request), result.temperature_warning)
        self.log(result.speed())

    def _take_steps(self, request: RunRequest, scene, simulation: app.Simulation, built: BuiltSystem, result: RunResult, present) -> None:
        """Take the steps; if they end early, the result and the state of the last step are kept."""
        first = request.first_step if present is None else present["step"]
        bar = self.progress(request.steps, first - request.first_step) if self.progress else None
        try:
            stepper = DeckSteps(
                request,
                simulation,
                built,
                result,
                log=self.log,
                trajectory=self.trajectory,
                signals=self.signals,
                keep=lambda more: self._keep(request, result, more),
                interval=self.options.checkpoint,
            )
            if present is None:
                stepper.begin(scene)
            else:
                self._go_live(present)
                stepper.resume(scene, present)
            stepper.step_from(first, (lambda _: None) if bar is None else bar.update)
            stepper.finish()
            result.steps_taken = request.steps
            result.take_averages()
            if self.trajectory is not None:
                self.trajectory.save_state(simulation)
        except BaseException as error:
            # a Context counts from the start of its run, even when resumed
            result.steps_taken = simulation.context.getStepCount()
            result.take_averages()
            done = f"after step {request.first_step + result.steps_taken} of {request.last_step}"
            result.stopped = f"interrupted by {self.signals.name} {done}" if isinstance(error, KeyboardInterrupt) else f"{done}: {error}"
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
        """Save the state of a run that ends early; errors only give a warning, since the cause of the end is reported."""
        assert self.trajectory is not None
        try:
            self.trajectory.save_state(simulation)
        except (OutputError, openmm.OpenMMException) as error:
            _LOGGER.warning("%s", error)

    def _result(self, request: RunRequest, simulation: app.Simulation, present: dict[str, Any] | None) -> RunResult:
        if present is not None:
            return RunResult(request, **present["result"])
        platform = simulation.context.getPlatform()
        name = platform.getName()
        words = tuple(dict.fromkeys((*request.thermo.words, *ALWAYS)))
        precision = FIXED_PRECISION.get(name) or platform.getPropertyValue(simulation.context, "Precision")
        return RunResult(request, name, precision, self.options.discard, words)

    # -- checkpoints --------------------------------------------------------------------------------------------------------------
    def _check_resumable(self, request: RunRequest, built: BuiltSystem) -> None:
        """Find out whether a run can be resumed.  RunError if not, although checkpoints were requested."""
        if self.checkpoints is None or self.not_resumable is not None:
            return
        self.not_resumable = _why_not(request, built)
        if self.not_resumable is not None and self.options.checkpoint:
            raise RunError(f"{_where(request)}--checkpoint: this run could not be resumed: {self.not_resumable}; omit the option")
        if self.options.checkpoint and not _exact(built):
            request.state.note(
                "a resumed run agrees with an uninterrupted one up to the rounding of this platform's forces, not bit for bit"
            )

    def _keep(self, request: RunRequest, result: RunResult, more: dict[str, Any] | None = None) -> None:
        """Store a checkpoint of a completed run, or of one in progress with the state ``more``."""
        if self.checkpoints is None or self.not_resumable is not None:
            return
        kept = {
            "run": _fingerprint(request),
            "memory": recorded(request.state),
            "result": {name: value for name, value in vars(result).items() if name not in ("request", "units")},
            "notes": self._notes,
            "trajectory": self.trajectory and self.trajectory.progress,
        }
        whole = more is not None or self.trajectory is None or self.trajectory.state_written
        self.checkpoints.save(request.state, self.options, self.variables, kept | (more or {}), done=more is None, whole=whole)

    def _recall(self, request: RunRequest, latest: Latest) -> None:
        """Bring the deck to the end of a completed run."""
        assert self.checkpoints is not None
        kept = self.checkpoints.read(f"run-{request.number + 1}")
        self._check_same(request, kept)
        recall(request.state, kept["memory"])
        self.results.append(RunResult(request, **kept["result"]))
        self._notes = kept["notes"]
        if latest.present is None and request.number + 1 == latest.runs:
            self._go_live(kept)

    def _go_live(self, kept: dict[str, Any]) -> None:
        """Start writing output: the position of the interruption is reached."""
        assert self.checkpoints is not None
        self.checkpoints.ledger.replaying, self._notes = False, kept["notes"]
        if self.trajectory is not None and kept["trajectory"] is not None:
            self.trajectory.resume(kept["trajectory"])

    @staticmethod
    def _check_same(request: RunRequest, kept: dict[str, Any]) -> None:
        if _fingerprint(request) != kept["run"]:
            raise RunError(f"{_where(request)}this run differs from that of the checkpoint; the deck does not do the same each time")


def _fingerprint(request: RunRequest) -> tuple:
    return request.first_step, request.steps, request.dt, request.scheme, len(request.state.atoms)


def _exact(built: BuiltSystem) -> bool:
    """Whether forces have the same bits after a restart.  OpenMM's single-precision forces do not, since they depend on the history of the
    pair list."""
    plan = built.plan
    return plan.platform == "Reference" or (
        plan.platform == "CPU" and plan.execution.looped and (plan.scene.ewald is None or "charges" in plan.execution.held)
    )


def _why_not(request: RunRequest, built: BuiltSystem) -> str | None:
    """Why a run could not be resumed, or None."""
    barostat = next((type(force).__name__ for force in built.system.getForces() if isinstance(force, BAROSTATS)), None)
    if barostat is not None:
        # the platforms Reference and CPU store its random numbers in checkpoints
        return f"OpenMM's {barostat} counts the steps to its next move and adapts the size of moves, neither of which is in a checkpoint"
    try:
        to_bytes(recorded(request.state))
    except ParameterError as error:
        return f"part of the deck cannot be stored ({error})"
    return None


def _where(request: RunRequest) -> str:
    return "" if request.where is None else f"{request.where.file}:{request.where.number}: "
