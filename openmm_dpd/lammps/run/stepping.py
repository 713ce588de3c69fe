"""The steps of one run: what is measured and written when, and how an early end loses nothing."""

import io
import time
from collections.abc import Callable, Sequence
from copy import copy
from typing import Any

import numpy as np
import openmm
from openmm import app

from ...base.errors import RunError
from ...base.files import write_whole
from ...base.names import COUNTER, LEFT
from ...base.signals import Signals
from ...measure import Sample
from ...measure.temperature import has_set_temperature, sets_temperature
from ...model.scene import Scene
from ...simulation.build import BuiltSystem
from ...simulation.fields import read_fields
from ...simulation.watching import PIECE
from ..files.restart_file import restart_bytes
from ..scene.reacting import keep_reacted, noted
from ..state.records import DeckSample, Fix, MomentumRemoval
from ..state.rigid import keep_rigid
from ..values.resolver import Resolver
from .moving_box import MovingBox, measured
from .request import RunRequest
from .result import RunResult
from .sampling import WITHIN, LiveSample, Sampler, arrays, slide_of
from .trajectory import RunTrajectory


class RestartFiles:
    """Writes the files of ``restart N``; each has what ``write_restart`` would write if the run ended at that step."""

    def __init__(self, request: RunRequest, built: BuiltSystem, context: openmm.Context, sampler: Sampler):
        self._request, self._built, self._context, self._sampler = request, built, context, sampler
        self._settings = list(request.state.restarts.values())

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a file is due; the last step of the run if there is none."""
        return min(((step // each.every + 1) * each.every for each in self._settings), default=self._request.last_step)

    def write(self, step: int) -> None:
        """Write the files that are due.  OutputError if this fails."""
        due = [each for each in self._settings if step % each.every == 0 and step != self._request.first_step]
        if not due:
            return
        if (guide := self._sampler.guide) is not None:
            guide.keep(self._sampler.numbers(), done=False)
        state = copy(self._request.state)
        state.atoms = copy(state.atoms)
        x, v, box = arrays(self._context, self._request.axes)
        state.write_back(
            x,
            v,
            state.box_at(step, self._request.window) or box,
            read_fields(self._context, self._built.plan),
            slide_of(self._built, self._context, self._request.axes),
        )
        state.step, state.runs = step, state.runs + 1
        if COUNTER in self._context.getParameters():
            state.noise_counter = self._context.getParameter(COUNTER)
        for each in due:
            name = each.files[each.written % len(each.files)]
            each.written += 1
            write_whole(state.output_file(name, step), restart_bytes(state), "the restart file")


class MomentumFixes:
    """The ``fix momentum`` of a run, which change velocities at the end of steps that are multiples of their intervals.  DeckError if one
    acts on immobile beads, or comes after a fix that reads values at the end of a step, which in LAMMPS would see the unchanged
    velocities."""

    def __init__(self, request: RunRequest, context: openmm.Context):
        self._request, self._context = request, context
        self._found: list[tuple[MomentumRemoval, np.ndarray]] = []
        readers: list[Fix] = []
        for fix in request.state.fixes.values():
            if "reader" in fix.parameters:
                readers.append(fix)
            if fix.style == "momentum":
                self._found.append((fix.parameters["momentum"], self._members(fix, readers)))

    def _members(self, fix: Fix, readers: list[Fix]) -> np.ndarray:
        members = self._request.state.group(fix.group)
        if np.any(members & ~self._request.mobile):
            raise fix.error(f"group {fix.group} contains immobile beads; remove them from the group")
        if readers:
            which = f"fix {readers[0].name} ({readers[0].style})"
            raise fix.error(f"it comes after {which}, which would see the old velocities; put it before that fix")
        return members

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a fix acts; the last step of the run if there is none."""
        return min([(step // removal.every + 1) * removal.every for removal, _ in self._found], default=self._request.last_step)

    def act(self, step: int) -> np.ndarray | None:
        """Change the velocities if a fix is due, and return the change (nm/ps), or None."""
        due = [(removal, mask) for removal, mask in self._found if step % removal.every == 0 and mask.any()]
        if not due:
            return None
        x, v, box = arrays(self._context)
        state, before, v = self._request.state, v, np.array(v)
        unwrapped = Resolver(state, DeckSample(step, positions=x, velocities=v, box=box), self._request.window).unwrapped
        for removal, mask in due:
            v[mask] = removal.applied(unwrapped[mask] * state.units.length, v[mask], state.bead_masses()[mask])
        self._context.setVelocities(v)
        integrator: Any = self._context.getIntegrator()
        if LEFT + "v" in map(integrator.getPerDofVariableName, range(integrator.getNumPerDofVariables())):
            # as in LAMMPS, the next half kick uses the old forces
            integrator.setPerDofVariableByName(LEFT + "v", arrays(self._context)[1])
        return v - before


class Pace:
    """The number of steps between two checks for signals: as many as take about half a second, at most 5,120.  It is a multiple of the
    integrator's replay interval, so that checking does not change which steps are computed together."""

    LEAST, FASTER, MOST, SECONDS = PIECE, 8, 512 * PIECE, 0.5

    def __init__(self) -> None:
        self.steps = self.LEAST

    def took(self, steps: int, seconds: float) -> None:
        """Adapt to the time that some steps took."""
        if steps == self.steps and self.FASTER * seconds < self.SECONDS:
            self.steps = min(self.FASTER * self.steps, self.MOST)
        elif seconds > 2 * self.SECONDS:
            self.steps = max(self.steps // 2, self.LEAST)


class DeckSteps:
    """One run in progress: ``result`` collects rows, ``log`` lines of thermo output; ``signals`` may end it after any step.
    ``keep(present)`` stores a checkpoint, with what :meth:`resume` needs, after a signal and every ``interval`` steps."""

    def __init__(
        self,
        request: RunRequest,
        simulation: app.Simulation,
        built: BuiltSystem,
        result: RunResult,
        *,
        log: Callable[[str], None],
        trajectory: RunTrajectory | None,
        signals: Signals,
        keep: Callable[[dict[str, Any]], None],
        interval: int | None,
    ):
        self.request, self.simulation, self.built, self.result = request, simulation, built, result
        self.log, self.trajectory, self.signals, self.keep, self.interval = log, trajectory, signals, keep, interval
        self.thermo, self.dumps, self.readers = request.thermo, request.dumps, request.readers
        self.momentum, self.sampler = MomentumFixes(request, simulation.context), Sampler(request, built, simulation.context)
        self.restarts = RestartFiles(request, built, simulation.context, self.sampler)
        self.moving = MovingBox(request, built, simulation.context)
        result.no_laplacian = (
            self.sampler.observer.no_laplacian if self.request.state.dimension == 3 else "it is not defined in two dimensions"
        )
        self._asked: dict[Any, set[str]] = {}  #: What each reader has read of the last sample
        self._sample: LiveSample | None = None
        self._measured: Sample | None = None

    def begin(self, scene: Scene) -> None:
        """Do everything that is due before the first step."""
        if scene.reactions:
            state = self.request.state
            state.before = {what: getattr(state, f"{what}s") for what in ("bond", "angle", "dihedral", "improper")} | {
                "noted": noted(state)
            }
        for reader in self.readers:
            reader.begin(self.request.state, self.request.first_step)
        for dump in self.dumps:
            dump.begin(self.request.state)
        if self.trajectory is not None:
            self.trajectory.start(scene, self.request, self.built)
        self._started = time.perf_counter()
        self._look(self.request.first_step)
        self.result.seconds = 0.0

    def resume(self, scene: Scene, present: dict[str, Any]) -> None:
        """Restore an interrupted run."""
        try:
            self.simulation.loadCheckpoint(io.BytesIO(present["context"]))
        except openmm.OpenMMException as error:
            raise RunError(f"the checkpoint was written by another version of OpenMM, or on another kind of device ({error})") from None
        if self.trajectory is not None:
            self.trajectory.start(scene, self.request, self.built)
        self._started = time.perf_counter() - present["elapsed"]

    def step_from(self, step: int, update: Callable[[int], None]) -> None:
        """Take all steps after ``step``; ``update`` receives the numbers of steps taken."""
        pace, last = Pace(), self.request.last_step
        while step < last:
            if self.signals.seen or (self.interval and step % self.interval == 0):
                elapsed = time.perf_counter() - self._started
                self.keep({"step": step, "context": self.simulation.context.createCheckpoint(), "elapsed": elapsed})
            self.signals.check()
            begun = time.perf_counter()
            stop = self._within(step, step + pace.steps)
            if stop is None:
                stop = min(step + pace.steps, self._next(step))
                self.simulation.step(stop - step)
            self.sampler.observer.present.changed = self._changed(self.momentum.act(stop))
            sample = self._change_box(stop)
            spent = time.perf_counter() - begun
            self.result.seconds += spent
            pace.took(stop - step, spent)
            update(stop - step)
            step = stop
            self._look(step, sample)

    def _changed(self, changed: np.ndarray | None) -> np.ndarray | None:
        """What was added to the velocities after the forces of the last step: by fix momentum, and by a guide."""
        more = None if self.sampler.guide is None else self.sampler.guide.changed
        return changed if more is None else more + (0.0 if changed is None else changed)

    def finish(self) -> None:
        """Do everything that is due after the last step, and return the beads to the deck."""
        if self.thermo.footer():
            self.log(self.thermo.footer())
        assert self._measured is not None
        if has_set_temperature(self.built.plan):
            dof, sheared = self._measured.dof * self.request.state.dimension // 3, self.built.plan.scene.shear is not None
            self.result.check_temperature(self._measured.target_kT, dof, sheared)
        context, guide = self.simulation.context, self.sampler.guide
        if guide is not None:
            guide.keep(self.sampler.numbers())
        if self.built.plan.scene.reactions:
            self.request.state.before = {}
            keep_reacted(self.request.state, self.sampler.reacted(self.request.last_step))
        x, v, box = arrays(context, self.request.axes)
        last = None if self._sample is None else self._sample.kept()
        slide = slide_of(self.built, context, self.request.axes)
        self.request.finish(
            x, v, box=self.moving.box(self.request.last_step) or box, sample=last, fields=read_fields(context, self.built.plan), slide=slide
        )
        keep_rigid(self.request.state)

    def _within(self, step: int, last: int) -> int | None:
        """If only averages are due next, which can be sampled within a run, take steps up to the next one at which something else is due,
        and return it."""
        first = min((reader.next_due for reader in self.readers if reader.next_due > step), default=last)
        its = [reader for reader in self.readers if reader.next_due == first]
        even, asked = {getattr(each, "even", (0, 0)) for each in its}, set().union(*(self._asked.get(each, {"all"}) for each in its))
        if len(even) != 1 or not any(asked <= known for known in WITHIN) or self.request.state.fixes_of("adapt"):
            return None
        ((every, until),) = even
        stop = int(min(last, until, self._next(step, its)))

        def take(sample: DeckSample) -> None:
            for reader in its:
                moment = Resolver(self.request.state, sample, self.thermo.window)
                vars(moment).update(constant)
                reader.take(moment)
                if "box" in vars(moment):
                    constant["box"] = vars(moment)["box"]

        constant = dict[str, Any]()
        return stop if first < stop and self.sampler.within(step, first, every, stop, take) else None

    def _next(self, step: int, besides: Sequence[Any] = ()) -> int:
        """The next step at which something is due, ``besides`` some readers."""
        due = [
            self.request.last_step,
            self.thermo.next_due(step),
            self.momentum.next_due(step),
            self.moving.next_due(step),
            self.restarts.next_due(step),
        ]
        due += [dump.next_due(step) for dump in self.dumps]
        due += [reader.next_due for reader in self.readers if reader.next_due > step and reader not in besides]
        if self.trajectory is not None:
            due.append(self.trajectory.next_due(step))
        if self.interval:
            due.append((step // self.interval + 1) * self.interval)
        return min(due)

    def _change_box(self, step: int) -> LiveSample | None:
        """Change the box if that is due; as in LAMMPS, output has the forces and energies before that."""
        if not self.moving.due(step):
            return None
        sample, dumped = None, any(dump.due(step) for dump in self.dumps)
        if self.thermo.due(step) or dumped or any(reader.next_due == step for reader in self.readers):
            sample = measured(self.sampler, self.sampler.sample(step, time.perf_counter() - self._started))
        self.moving.act(step, sample)
        return sample

    def _look(self, step: int, sample: LiveSample | None = None) -> None:
        """Measure, average, print and write what is due at a step; ``sample`` if there is one already."""
        begun = time.perf_counter()
        state, sampler, thermo, result = self.request.state, self.sampler, self.thermo, self.result
        sample = self._sample = sample or sampler.sample(step, begun - self._started)
        if thermo.due(step):
            self._measured = sampler.measure(sample)
        for reader in self.readers:
            if reader.next_due == step:
                sample.asked = self._asked[reader] = set()
                reader.take(Resolver(state, sample, thermo.window))
        if step == self.request.first_step and thermo.header():
            self.log(thermo.header())
        if thermo.due(step):
            assert self._measured is not None
            values = thermo.values(sample, tuple(w for w in result.words if w != "temp_conf"))
            result.add(step, values, self._measured, self._measured.target_kT if sets_temperature(self.built.plan) else np.nan)
            self.log(thermo.row(values | {"temp_conf": sample.kT_conf or float("nan")}, sample))
        result.seconds += time.perf_counter() - begun
        self._write_frames(sample)
        self.restarts.write(step)

    def _write_frames(self, sample: LiveSample) -> None:
        moment = Resolver(self.request.state, sample, self.thermo.window)
        for dump in self.dumps:
            if dump.due(sample.step):
                dump.write(moment)
        if self.trajectory is not None and self.trajectory.due(sample.step):
            assert sample.positions is not None and sample.box is not None
            self.trajectory.write(sample.positions, sample.box, self.sampler.context, sample.step, sample.slide)
