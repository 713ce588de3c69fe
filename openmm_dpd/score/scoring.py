"""The cost of a scheme at a joint error: the longest step at which all quantities of a scene are within it, and the time of a run there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from ..base.errors import DPDError, ParameterError, require, what_is
from ..base.units import whole_number
from ..model.pairs import checked
from ..model.schemes import scheme_of
from ..simulation.build import build
from .runs import BlockMeans, run_word
from .suite import SuiteScene, load_suite

#: Ratio of steps that are tried, and how many at most.
RATIO, MOST = 1.25, 10
#: Errors below the first of these numbers of standard errors count as half of what is accepted at most; runs with larger ones, below the
#: second, are repeated with other noise, up to some times.
SURE, SURER, REPEATS = 2.0, 4.0, 3


@dataclass(frozen=True)
class Judged:
    """The errors of runs at one step.

    Attributes
    ----------
    dt : step size
    errors, sems : (Q,) deviations from the reference, relative to the scale of each quantity, and their standard errors
    seconds : CPU time of one unit of simulated time
    reason : why the run broke down, or empty
    """

    dt: float
    errors: np.ndarray
    sems: np.ndarray
    seconds: float
    reason: str = ""

    def joint(self, accepted: float) -> float:
        """The largest error; those that noise explains count as half of ``accepted`` at most."""
        if self.reason:
            return np.inf
        return float(np.max(seen(self.errors, self.sems, accepted)))

    def unsure(self, accepted: float) -> bool:
        """Whether a quantity is off by more than is accepted, and none by many standard errors."""
        off = np.abs(self.errors) > accepted
        return not self.reason and bool(off.any()) and not bool((off & (np.abs(self.errors) >= SURER * self.sems)).any())


def judge(its: SuiteScene, dt: float, found: BlockMeans) -> Judged:
    """Errors of a run relative to the reference."""
    if found.reason:
        nothing = np.full(len(its.quantities), np.inf)
        return Judged(dt, nothing, nothing, found.seconds, found.reason)
    sems = np.sqrt(np.diag(found.covariance) + np.diag(its.covariance))
    return Judged(dt, (found.mean - its.reference) / its.scale, sems / its.scale, found.seconds)


def judge_surely(its: SuiteScene, dt: float, run: Callable[[int], BlockMeans], accepted: float) -> Judged:
    """Errors at a step, of as many runs as tell whether they are accepted; ``run`` takes the number of the run, from 0."""
    found = run(0)
    judged = judge(its, dt, found)
    for number in range(1, REPEATS + 1):
        if not judged.unsure(accepted):
            break
        more = run(number)
        if more.reason:
            return judge(its, dt, more)
        found = BlockMeans(np.concatenate([found.values, more.values]), found.seconds)
        judged = judge(its, dt, found)
    return judged


@dataclass(frozen=True)
class Score:
    """What a method costs in one scene.

    Attributes
    ----------
    scene : its name
    runs : tuple of Judged, by step
    limit : longest step at which all errors are within ``accepted``; 0 if none was
    limited_by : the quantity that exceeds it first, or the reason why runs break down; empty if none did
    seconds : CPU time of one unit of simulated time there
    """

    scene: SuiteScene
    runs: tuple[Judged, ...]
    limit: float
    limited_by: str
    seconds: float

    def as_data(self) -> dict[str, Any]:
        """Everything as plain data, for JSON."""
        return {
            "limit": _short(self.limit),
            "limited_by": self.limited_by,
            "us_per_bead": _short(1e6 * self.seconds / self.scene.scene.n_beads),
            "runs": [
                {"dt": _short(run.dt), "failed": run.reason}
                if run.reason
                else {
                    "dt": _short(run.dt),
                    "errors": {
                        name: [_short(error), _short(sem)]
                        for name, error, sem in zip(self.scene.quantities, run.errors, run.sems, strict=True)
                    },
                }
                for run in self.runs
            ],
        }


def _short(value: float) -> float | None:
    return float(f"{value:.3g}") if np.isfinite(value) else None


def forces(word: str) -> int:
    """Force evaluations in a step: kicks that are apart by drifts, step after step."""
    letters = [letter for letter, _ in scheme_of(word).motion if letter in "AB"]
    groups = [letter for letter, _ in groupby(letters)]
    return max(1, groups.count("B") - (len(groups) > 1 and groups[0] == groups[-1] == "B"))


def seen(error: np.ndarray, sem: np.ndarray, accepted: float) -> np.ndarray:
    """Sizes of errors; where one is lost in its noise, at most half of what is accepted: noise is no reason to call a step bad."""
    size = np.abs(error)
    return np.where(size < SURE * sem, np.minimum(size, 0.5 * accepted), size)


def reached(dts: Sequence[float], sizes: Sequence[float], bound: float, least: float) -> float:
    """Where errors reach a bound between the first two steps, by a straight line between logarithms; ``least`` stands for a smaller one."""
    low, high = max(sizes[0], least), sizes[1]
    return float(dts[0] * (dts[1] / dts[0]) ** (np.log(bound / low) / np.log(high / low)))


def climbed(first: float, judged: Callable[[float], Judged], accepted: float) -> list[Judged]:
    """Runs at longer and longer steps up to the first that is not accepted, or at shorter ones down to one that is; sorted by step."""
    runs, ratio = [judged(first)], RATIO
    good = runs[0].joint(accepted) <= accepted
    if not good:
        ratio = 1 / RATIO
    while len(runs) < MOST and (runs[-1].joint(accepted) <= accepted) == good:
        runs.append(judged(runs[-1].dt * ratio))
    return sorted(runs, key=lambda run: run.dt)


def summed_up(its: SuiteScene, runs: Sequence[Judged], accepted: float) -> Score:
    """The step at which the joint error reaches what is accepted, by a straight line between logarithms; before a breakdown the last one
    that is accepted."""
    joints = [run.joint(accepted) for run in runs]
    bad = next((k for k, joint in enumerate(joints) if joint > accepted), None)
    if bad is None or bad == 0:
        limit, why = (runs[-1].dt, "") if bad is None else (0.0, _worst(its, runs[0], accepted))
    else:
        limit = reached([run.dt for run in runs[bad - 1 :]], joints[bad - 1 :], accepted, 0.1 * accepted)
        why = _worst(its, runs[bad], accepted)
    steps = [run.seconds * run.dt for run in runs if np.isfinite(run.seconds)]
    return Score(its, tuple(runs), limit, why, min(steps) / limit if steps and limit else np.nan)


def _worst(its: SuiteScene, run: Judged, accepted: float) -> str:
    if run.reason:
        return run.reason
    return its.quantities[int(np.argmax(seen(run.errors, run.sems, accepted)))]


def scenes_for(suite: Mapping[str, SuiteScene], word: str) -> list[str]:
    """Names of the scenes that a scheme or word can run."""
    found = []
    for name, its in suite.items():
        try:
            build(its.scene, dt=its.step, scheme=word, platform="CPU", seed=1)
        except DPDError:
            continue
        found.append(name)
    return found


def score_word(
    word: str, scenes: Iterable[str] | None = None, *, error: float = 0.01, time: float = 200.0, seed: int = 1, lam: float = 0.5
) -> list[Score]:
    """What a scheme or word costs in scenes of the suite.

    Steps a quarter apart are tried, from the one at which velocity Verlet is about 1 % off (times the force evaluations in a step of the
    word), to the first at which a quantity is off by more than is accepted.  Where noise leaves this open, runs are repeated.

    Parameters
    ----------
    word : str
        Name of a scheme, or a word such as ``"B/2 A/2 O A/2 B/2"``.
    scenes : names, optional
        All that the scheme can run by default.
    error : float
        Relative error that every quantity may have.
    time : float
        Length of each run in units of the scene; standard errors are some 0.2 to 0.5 % with 200.
    seed : int
        Of the noise.
    lam : float
        Lambda of ``mvv``.

    Returns
    -------
    list of Score

    Raises
    ------
    ParameterError
        If a scene is not in the suite, or the scheme cannot run one that is named.
    """
    require(scenes, Iterable | None, "scenes must be names of scenes of the suite")
    suite, scenes = load_suite(), None if scenes is None else list(scenes)
    unknown = [name for name in scenes or () if name not in suite]
    if unknown:
        raise ParameterError(f"there is no scene {what_is(unknown[0])} in the suite; its scenes are {', '.join(suite)}")
    error, time, seed = checked(error, "dimensionless", "error"), checked(time, "time", "time", positive=True), whole_number(seed, "seed")
    if not 0 < error < 1:
        raise ParameterError(f"error must be between 0 and 1, not {what_is(error)}")
    scheme_of(word)
    found = []
    for name in scenes_for(suite, word) if scenes is None else scenes:
        its = suite[name]
        runs = climbed(
            its.step * forces(word),
            lambda dt, its=its: judge_surely(  # type: ignore[misc]
                its, dt, lambda number: run_word(its, word, dt, time=time, seed=seed + number, lam=lam), error
            ),
            error,
        )
        found.append(summed_up(its, runs, error))
    return found
