"""Runs of a scene of the suite, and frames that another program has written, to averages of blocks."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import openmm

from ..base.errors import DPDError, ParameterError
from ..base.geometry import minimum_images
from ..base.names import SHEARED
from ..base.openmm_private import bare
from ..kernels.shear import rate_at, sheared_box
from ..lammps import read_lammps_dump
from ..measure.flow import StressReporter
from ..measure.observer import Observer
from ..simulation.build import build
from ..simulation.built import BuiltSystem
from ..simulation.fields import read_fields, write_fields
from .quantities import INTERVAL, LAGS, QUANTITIES, Instant, interval
from .suite import SuiteScene

#: BlockMeans that a run is divided into; a run that is hotter than this many times its temperature breaks down.
BLOCKS, HOT = 8, 5.0


@dataclass(frozen=True)
class BlockMeans:
    """Averages of the blocks of runs.

    Attributes
    ----------
    values : (B, Q) in the order of the scene's quantities; all infinite if the run broke down
    seconds : CPU time of one unit of simulated time; NaN if it is not known
    reason : why the run broke down, or empty
    """

    values: np.ndarray
    seconds: float = np.nan
    reason: str = ""

    @property
    def mean(self) -> np.ndarray:
        """(Q,) averages."""
        return self.values.mean(axis=0)

    @property
    def covariance(self) -> np.ndarray:
        """(Q, Q) of the averages."""
        return np.atleast_2d(np.cov(self.values, rowvar=False)) / len(self.values)


class _Looker:
    """Takes moments of Contexts that run a scene."""

    def __init__(self, its: SuiteScene, built: BuiltSystem):
        self.scene, self.built, self.names = built.plan.scene, built, its.quantities
        self._observer, self._run = Observer(built), list[Instant]()
        self._stress = StressReporter(1, built) if {"tension", "stress"} & set(self.names) else None

    def take(self, simulation: openmm.app.Simulation) -> None:
        """Add the present moment."""
        context = simulation.context
        sample = self._observer.sample(context)
        state = context.getState(positions=True, velocities=True)
        x, v = bare(state.getPositions(asNumpy=True)), bare(state.getVelocities(asNumpy=True))
        path = x
        if self._run:
            step = x - self._run[-1].x
            path = self._run[-1].path + minimum_images(step, self.scene.box)
        fields = read_fields(context, self.built.plan) if {"wave", "difference"} & set(self.names) else {}
        stress = None
        if self._stress is not None:
            self._stress.report(simulation, state)
            stress = self._stress.regular[-1]
        field = np.ravel(next(iter(fields.values()))) if fields else None
        self._run.append(Instant(self.scene, sample, x.copy(), path, v.copy(), field, stress))
        if sample.kT > HOT * sample.target_kT > 0:
            raise ParameterError(f"the kinetic temperature is {sample.kT:.3g}")

    def blocks(self) -> np.ndarray:
        """(B, Q) averages of the blocks."""
        count = len(self._run)
        # before the second lag there is no diffusion
        if count < 2 * BLOCKS or count < 2 * BLOCKS + round(LAGS[1] / interval(self._run)):
            raise ParameterError(f"a run of {count} samples is too short: {2 * BLOCKS} are needed after {LAGS[1]:g} units of time")
        rows = np.array([QUANTITIES[name][1](self._run) for name in self.names]).T
        known = np.flatnonzero(np.isfinite(rows).all(axis=1))
        return np.array([part.mean(axis=0) for part in np.array_split(rows[known[0] :], BLOCKS)])


def run_word(
    its: SuiteScene, word: str, dt: float, *, time: float = 200.0, discard: float = 20.0, seed: int = 1, lam: float = 0.5
) -> BlockMeans:
    """Run a scene of the suite with a scheme or word, and measure it.

    Parameters
    ----------
    its : SuiteScene
    word : str
        Name of a scheme, or a word such as ``"B/2 A/2 O A/2 B/2"``.
    dt : float
        Step size.
    time, discard : float
        Length of the run, after a time that is left out of averages; units of the scene (ps).
    seed : int
        Of the noise.
    lam : float
        Lambda of ``mvv``.

    Raises
    ------
    ParameterError
        If the scheme cannot run the scene.
    """
    built = build(its.scene, dt=dt, scheme=word, lam=lam, platform="CPU", seed=seed)
    simulation = built.simulation(properties={"Threads": "1"})
    looker, every, spent = _Looker(its, built), max(1, round(INTERVAL / dt)), 0.0
    samples = round(time / (every * dt))
    try:
        simulation.step(round(discard / dt))
        for _ in range(samples):
            begun = clock.process_time()
            simulation.step(every)
            spent += clock.process_time() - begun
            looker.take(simulation)
    except (DPDError, openmm.OpenMMException) as error:
        return broken(its, str(error))
    return BlockMeans(looker.blocks(), spent / (samples * every * dt))


def run_frames(its: SuiteScene, path: str | Path, dt: float, *, discard: float = 20.0, seconds: float = np.nan) -> BlockMeans:
    """Measure what another program has written: a text dump of LAMMPS, or one like it, in the units of the deck.

    Parameters
    ----------
    its : SuiteScene
        The scene that the program ran.
    path : str or Path
        Frames with ``id x y z vx vy vz`` every 0.25 units of time, with the columns of fields that the deck names.  In a shear, the box
        is that of LAMMPS, a step ahead of the positions.
    dt : float
        Step size of the run: the dump has the numbers of steps.
    discard : float
        Time that is left out, from the first frame on.
    seconds : float, optional
        CPU time of one unit of simulated time.

    Raises
    ------
    ParameterError
        If there are no velocities or fields, or too few frames.
    """
    frames = read_lammps_dump(path, its.scene)
    if frames.velocities is None:
        raise ParameterError(f"{path} has no velocities (columns vx vy vz)")
    if its.scene.internal is not None and not _GIVEN.keys() & frames.fields.keys():
        raise ParameterError(
            f"{path} does not have the beads' own temperatures, energies or concentrations, as the dump of {its.deck.name} has"
        )
    kept = np.flatnonzero(dt * (frames.steps - frames.steps[0]) >= discard)
    if len(kept) < 10 * BLOCKS or abs(dt * float(np.mean(np.diff(frames.steps[kept]))) - INTERVAL) > 0.1 * INTERVAL:
        raise ParameterError(f"{path} needs {10 * BLOCKS} frames or more after {discard:g} units of time, one every {INTERVAL:g}")

    def box(time: float, ahead: np.ndarray) -> np.ndarray | None:
        """LAMMPS moves the box of a shear on after the forces of a step, before it writes a frame."""
        return None if its.scene.shear is None else sheared_box(ahead, -dt * rate_at(its.scene.shear, time), ahead[1, 0])

    states = (
        State(
            dt * float(frames.steps[k]),
            frames.positions[k],
            frames.velocities[k],
            {name: each[k] for name, each in frames.fields.items()},
            None if frames.boxes is None else box(dt * float(frames.steps[k]), frames.boxes[k]),
        )
        for k in kept
    )
    return run_states(its, states, seconds)


class State(NamedTuple):
    """What a program has at one time: positions and velocities (N, 3), fields by the names of the dump reader, box vectors of a shear."""

    time: float
    x: np.ndarray
    v: np.ndarray
    fields: Mapping[str, np.ndarray] = {}
    box: np.ndarray | None = None


#: Fields of a dump, as :func:`.write_fields` takes them.
_GIVEN = {"u_cond": "u_cond", "u_mech": "u_mech", "temperature": "theta", "c1": "concentrations"}


def run_states(its: SuiteScene, states: Iterable[State], seconds: float = np.nan) -> BlockMeans:
    """Measure states that another program makes one after the other; parameters as in :func:`run_frames`."""
    built = build(its.scene, dt=1e-3, scheme="mvv", platform="CPU", seed=1)  # nothing is stepped
    simulation = built.simulation(properties={"Threads": "1"})
    looker, context = _Looker(its, built), simulation.context
    try:
        for state in states:
            context.setTime(state.time)
            context.setPositions(state.x)
            context.setVelocities(state.v)
            given = {_GIVEN[name]: values[:, None] if name == "c1" else values for name, values in state.fields.items() if name in _GIVEN}
            if given:
                write_fields(context, built.plan, **given)
            if its.scene.shear is not None and state.box is not None:
                context.setPeriodicBoxVectors(*state.box)
                context.setParameter(SHEARED, state.time)
            looker.take(simulation)
    except (DPDError, openmm.OpenMMException) as error:
        return broken(its, str(error))
    return BlockMeans(looker.blocks(), seconds)


def broken(its: SuiteScene, reason: str) -> BlockMeans:
    """A run that broke down."""
    return BlockMeans(np.full((1, len(its.quantities)), np.inf), reason=reason.splitlines()[0])
