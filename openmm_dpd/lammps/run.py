"""Carrying out the run commands of a deck with OpenMM."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import openmm
from openmm import app, unit

from ..build import Built, build
from ..errors import DeckError, DPDError, ParameterError, RunError
from ..kernels.engine import get_threads, set_threads, warm_up
from ..measure import Observer
from ..measure import Sample as Measurement
from ..model.scene import Scene
from ..names import COUNTER
from ..stats import block_average, ratio_average
from .request import RunRequest
from .sample import Sample
from .thermo import ALWAYS
from .trajectory import RunTrajectory

_NM, _V = unit.nanometer, unit.nanometer / unit.picosecond


@dataclass(frozen=True)
class RunOptions:
    """What the command line may override; None leaves it to the deck.

    Attributes
    ----------
    platform, precision : str
        OpenMM platform (default: the fastest) and its precision.
    scheme : str
        Integration scheme of every run.
    dt : float
        Time step of every run, in the deck's units.
    steps : int
        Number of steps of every run.
    seed : int
        Seed of the noise.
    threads : int
        Threads of OpenMM's CPU platform and of the pair kernel.
    discard : int
        Steps at the beginning of each run that are left out of averages.
    conservative : str
        Where the conservative force is computed, see :func:`openmm_dpd.plan.make_plan`.
    """

    platform: str | None = None
    precision: str | None = None
    scheme: str | None = None
    dt: float | None = None
    steps: int | None = None
    seed: int | None = None
    threads: int | None = None
    discard: int = 0
    conservative: str = "auto"

    def __post_init__(self):
        for name, low in (("steps", 0), ("threads", 1), ("discard", 0), ("seed", 0)):
            value = getattr(self, name)
            if value is not None and value < low:
                raise ParameterError(f"{name} must be at least {low}, but is {value}")
        if self.dt is not None and not self.dt > 0:
            raise ParameterError(f"dt must be > 0, but is {self.dt}")

    def properties(self, platform: str) -> dict[str, str]:
        """Platform properties."""
        if platform == "CPU":
            if self.precision not in (None, "mixed"):
                raise ParameterError(f"the CPU platform has one precision (mixed); it cannot run in {self.precision}")
            return {"Threads": str(get_threads())}
        if platform == "Reference":
            if self.precision not in (None, "double"):
                raise ParameterError(f"the Reference platform has one precision (double); it cannot run in {self.precision}")
            return {}
        return {"Precision": self.precision} if self.precision else {}


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
    momentum : float
        Largest component of the total momentum at the end, in the deck's units.
    """

    request: RunRequest
    platform: str
    precision: str
    discard: int
    words: tuple[str, ...]
    seconds: float = 0.0
    steps_done: list[int] = field(default_factory=list)
    rows: dict[str, list[float]] = field(default_factory=dict)
    conf: list[tuple[float, float]] = field(default_factory=list)
    no_laplacian: str | None = None
    target_kT: list[float] = field(default_factory=list)
    momentum: float = 0.0

    def add(self, step: int, values: dict[str, float], measured: Measurement) -> None:
        """Append a row."""
        self.steps_done.append(step)
        for word, value in values.items():
            self.rows.setdefault(word, []).append(value)
        self.target_kT.append(measured.target_kT)
        if measured.laplacian is not None:
            self.conf.append((measured.gradient2, measured.laplacian))

    def averages(self) -> dict[str, dict[str, float | None] | None]:
        """{word: {mean, sem, first, last}}; ``temp_conf`` is None if there is no configurational temperature."""
        kept = np.array(self.steps_done) - self.request.first_step >= self.discard
        result: dict[str, dict[str, float | None] | None] = {}
        for word in self.words:
            if word == "temp_conf":
                result[word] = self._configurational(kept)
                continue
            values = np.array(self.rows[word], dtype=float)
            average = block_average(values[kept])
            result[word] = {"mean": average.mean, "sem": average.sem, "first": float(values[0]), "last": float(values[-1])}
        return result

    def _configurational(self, kept: np.ndarray) -> dict[str, float | None] | None:
        if self.no_laplacian is not None:
            return None
        kelvin = self.request.state.units.thermal_energy
        gradient2, laplacian = np.array(self.conf).T
        if not laplacian[kept].any():
            self.no_laplacian = "no conservative force acts in the rows that are averaged, so the Laplacian is 0"
            return None
        average = ratio_average(gradient2[kept], laplacian[kept])
        first, last = (float(gradient2[k] / laplacian[k] / kelvin) if laplacian[k] else None for k in (0, -1))
        return {
            "mean": None if average.mean is None else average.mean / kelvin,
            "sem": None if average.sem is None else average.sem / kelvin,
            "first": first,
            "last": last,
        }

    def summary(self) -> dict[str, Any]:
        """One object of the JSON file."""
        request = self.request
        summary: dict[str, Any] = {
            "steps": request.steps,
            "dt": request.dt / request.state.units.time,
            "seconds_per_step": self.seconds / request.steps if request.steps else None,
            "thermo": self.averages(),
        }
        if self.no_laplacian is not None:
            summary["temp_conf_reason"] = self.no_laplacian
        return summary


class DeckRunner:
    """The callback of :func:`openmm_dpd.lammps.deck.read_deck`: steps each run, prints thermo rows, writes trajectories.

    Parameters
    ----------
    options : RunOptions
    log : callable
        Takes lines of thermo output and remarks.
    out : Path, optional
        Folder for trajectory, topology and final state; nothing is written without it.
    progress : callable, optional
        ``progress(total)`` returns an object with ``update(steps)`` and ``close()``, such as a tqdm bar.
    """

    def __init__(self, options: RunOptions, log: Callable[[str], None] = lambda _: None, out: Path | None = None, progress=None):
        self.options, self.log, self.progress = options, log, progress
        self.results: list[RunResult] = []
        self.counter = 0.0
        self.trajectory = None if out is None else RunTrajectory(out)
        self._notes = 0
        set_threads(options.threads)

    def __call__(self, request: RunRequest) -> None:
        """Carry out one run."""
        options, state = self.options, request.state
        dt = None if options.dt is None else options.dt * state.units.time
        request = request.override(steps=options.steps, dt=dt, scheme=options.scheme)
        if options.discard > request.steps:
            # the last step has a row always
            raise RunError(f"{_where(request)}--discard {options.discard} leaves nothing to average of a run of {request.steps} steps")
        scene = request.scene()
        built = build_request(request, scene, options)
        for note in state.notes[self._notes :]:
            self.log(f"note: {note}")
        self._notes = len(state.notes)
        warm_up(built.plan.spec, self.log)
        simulation = built.simulation(properties=options.properties(built.plan.platform or ""))
        if COUNTER in simulation.context.getParameters():
            # every run draws new noise
            simulation.context.setParameter(COUNTER, self.counter)
        result = self._result(request, simulation, built)
        bar = self.progress(request.steps) if self.progress else None
        try:
            self._step_through(request, scene, simulation, Observer(built), result, bar)
        except openmm.OpenMMException as error:
            raise RunError(f"{_where(request)}the run stopped: {error}") from None
        except RunError as error:
            raise RunError(f"{_where(request)}the run stopped: {error}") from None
        finally:
            if bar is not None:
                bar.close()
        self.results.append(result)
        if COUNTER in simulation.context.getParameters():
            self.counter = simulation.context.getParameter(COUNTER)
        if self.trajectory is not None:
            self.trajectory.save_state(simulation)

    def _result(self, request: RunRequest, simulation: app.Simulation, built: Built) -> RunResult:
        platform = simulation.context.getPlatform()
        name = platform.getName()
        fixed = {"Reference": "double", "CPU": "mixed"}
        words = tuple(dict.fromkeys((*request.thermo.words, *ALWAYS)))
        precision = fixed[name] if name in fixed else platform.getPropertyValue(simulation.context, "Precision")
        return RunResult(request, name, precision, self.options.discard, words)

    def _step_through(
        self, request: RunRequest, scene: Scene, simulation: app.Simulation, observer: Observer, result: RunResult, bar
    ) -> None:
        thermo, dumps, context = request.thermo, request.dumps, simulation.context
        result.no_laplacian = observer.no_laplacian
        if thermo.header():
            self.log(thermo.header())
        if self.trajectory is not None:
            self.trajectory.start(scene, request)
        step, started, measured = request.first_step, time.perf_counter(), None
        while True:
            if thermo.due(step):
                begun = time.perf_counter()
                measured = observer.sample(context)
                sample = thermo_sample(request, measured, context, step, begun - started)
                values = thermo.values(sample, tuple(w for w in result.words if w != "temp_conf"))
                result.add(step, values, measured)
                result.seconds += time.perf_counter() - begun if step > request.first_step else 0.0
                self.log(thermo.row(values | {"temp_conf": sample.kT_conf or float("nan")}, sample))
            self._write_frames(request, context, step)
            if step == request.last_step:
                break
            stop = min([thermo.next_due(step), request.last_step, step + 1000, *(dump.next_due(step) for dump in dumps)])
            if self.trajectory is not None:
                stop = min(stop, self.trajectory.next_due(step))
            begun = time.perf_counter()
            simulation.step(stop - step)
            result.seconds += time.perf_counter() - begun
            if bar is not None:
                bar.update(stop - step)
            step = stop
        assert measured is not None
        result.momentum = float(np.abs(measured.momentum).max()) / request.state.units.mass / request.state.units.velocity
        x, v, _, box = _arrays(context)
        request.finish(x, v, box=box, sample=sample)

    def _write_frames(self, request: RunRequest, context: openmm.Context, step: int) -> None:
        due = [dump for dump in request.dumps if dump.due(step)]
        framed = self.trajectory is not None and self.trajectory.due(step)
        if not due and not framed:
            return
        x, v, f, box = _arrays(context, any(dump.needs_forces for dump in due))
        for dump in due:
            dump.write(request.state, step, x, v, f, box)
        if framed and self.trajectory is not None:
            self.trajectory.write(x, box)


def build_request(request: RunRequest, scene: Scene, options: RunOptions) -> Built:
    """Build the scene of a run; what cannot be built is an error at the deck's run command."""
    try:
        return build(
            scene,
            dt=request.dt,
            scheme=request.scheme,
            lam=request.lambda_,
            conservative=options.conservative,
            platform=options.platform,
            seed=options.seed if options.seed is not None else request.seed,
        )
    except DPDError as error:
        if isinstance(error, DeckError) or request.where is None:
            raise
        raise DeckError(str(error), request.where.file, request.where.number) from None


def _where(request: RunRequest) -> str:
    return "" if request.where is None else f"{request.where.file}:{request.where.number}: "


def _arrays(context: openmm.Context, forces: bool = False):
    """Positions, velocities, conservative forces (or None) and box vectors."""
    groups = context.getIntegrator().getIntegrationForceGroups()
    state = context.getState(positions=True, velocities=True, forces=forces, groups=groups)
    f = state.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / _NM) if forces else None
    x, v = state.getPositions(asNumpy=True).value_in_unit(_NM), state.getVelocities(asNumpy=True).value_in_unit(_V)
    return x, v, f, state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(_NM)


def thermo_sample(request: RunRequest, measured: Measurement, context: openmm.Context, step: int, cpu: float) -> Sample:
    """A measurement in the form thermo output wants.

    ``virial`` counts what LAMMPS counts: the dissipative and random parts only if they are forces.
    """
    full = measured.virial_conservative + measured.virial_dissipative + measured.virial_random
    needs = request.thermo.needs
    arrays = _arrays(context) if needs & {"positions", "velocities"} else (None, None, None, None)
    return Sample(
        step=step,
        kinetic=measured.kinetic,
        dof=measured.dof,
        pair_energy=measured.pair,
        bond_energy=measured.bond,
        virial=full if request.scheme == "mvv" else measured.virial_conservative,
        virial_full=full,
        force_norm=measured.force_norm,
        force_max=measured.force_max,
        kT_conf=measured.configurational_kT,
        box=measured.box,
        positions=arrays[0],
        velocities=arrays[1],
        cpu=cpu,
    )


def results_json(results: list[RunResult]) -> dict:
    """The object that ``--json`` writes."""
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
