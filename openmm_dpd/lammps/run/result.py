"""Results of the runs of a deck: rows, averages with errors, and the object for the JSON file."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...base.errors import DeckError, ParameterError
from ...base.stats import MIN_BLOCKS, block_average, equilibrated, ratio_average
from ...base.units import UnitSystem
from ...measure import Sample
from ...measure.temperature import temperature_warning
from ...runtime import get_threads
from ..output.averaging_fixes import ChunkAverage
from ..output.thermo import ALWAYS
from .request import RunRequest


@dataclass
class RunResult:
    """Result of one run."""

    request: RunRequest
    platform: str
    precision: str
    discard: int | None  #: Steps excluded from averages if the run is at least as long; None means those before equilibrium
    words: tuple[str, ...]
    units: UnitSystem = field(init=False)  #: Those of the run, though the deck may have others after a later ``clear``
    seconds: float = 0.0  #: Wall time of stepping and thermo, without compilation, trajectory and pictures
    steps_taken: int = 0  #: Number of steps carried out
    stopped: str | None = None  #: Why the run ended early; None if it did not
    steps_done: list[int] = field(default_factory=list)  #: Step numbers of the rows
    rows: dict[str, list[float]] = field(default_factory=dict)  #: Values of each column, in the deck's units
    #: Numerator and denominator of the configurational temperature at each row.
    conf: list[tuple[float, float]] = field(default_factory=list)
    no_laplacian: str | None = None  #: Why there is no configurational temperature
    target_kT: list[float] = field(default_factory=list)  #: Target thermal energy (kJ/mol) at each row; NaN if nothing sets it
    kinetic_kT: list[float] = field(default_factory=list)  #: Kinetic thermal energy (kJ/mol) of all mobile beads at each row
    momentum: float = 0.0  #: Largest component of the total momentum at the end, in the deck's units
    #: The last block of every fix ave/chunk: {id: {"coord": [...], "ncount": [...], value: [...]}}.
    profiles: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    #: The last average of every fix ave/time and ave/correlate: {id: {"step": ..., value: ...}}.
    time_averages: dict[str, dict[str, Any]] = field(default_factory=dict)
    #: Warning about the mean temperature, see :func:`openmm_dpd.measure.temperature.temperature_warning`.
    temperature_warning: str | None = None

    def __post_init__(self):
        self.units = self.request.state.units

    def add(self, step: int, values: dict[str, float], measured: Sample, target_kT: float) -> None:
        """Append a row."""
        self.steps_done.append(step)
        for word, value in values.items():
            self.rows.setdefault(word, []).append(value)
        self.target_kT.append(target_kT)
        units = self.units
        self.kinetic_kT.append(measured.kT * (3 / self.request.state.dimension))
        self.momentum = float(np.abs(measured.momentum).max()) / units.mass / units.velocity
        if measured.laplacian is not None:
            self.conf.append((measured.gradient2, measured.laplacian))

    def take_averages(self) -> None:
        """Store the averages that the deck's fixes have so far."""
        averages = self.request.averages
        self.profiles = {average.name: average.profile for average in averages if isinstance(average, ChunkAverage) and average.profile}
        self.time_averages = {average.name: average.report for average in averages if average.report}

    def averages(self) -> dict[str, dict[str, float | None] | None]:
        """{word: {mean, sem, first, last}}; ``temp_conf`` is None if there is no configurational temperature."""
        start = self.start()
        result: dict[str, dict[str, float | None] | None] = {}
        for word in self.words:
            if word == "temp_conf":
                result[word] = self._configurational(start)[0]
                continue
            values = np.array(self.rows[word], dtype=float)
            average = block_average(values[start:])
            result[word] = {"mean": average.mean, "sem": average.sem, "first": float(values[0]), "last": float(values[-1])}
        return result

    def start(self) -> int:
        """The first row that is averaged, the same for all columns: given by ``discard``, or the last row that
        :func:`openmm_dpd.base.stats.equilibrated` finds for any column.  A column of the deck that still drifts after half of the rows,
        such as a mean squared displacement, is ignored."""
        if self.discard is not None and self.discard <= self.request.steps:
            late = np.array(self.steps_done) - self.request.first_step >= self.discard
            return int(np.argmax(late)) if late.any() else len(late)
        found = [0]
        for word, rows in self.rows.items():
            if word not in _NO_AVERAGE and np.all(np.isfinite(rows)):
                row = equilibrated(rows)
                found.append(row if word in ALWAYS or row < len(rows) // 2 else 0)
        return max(found)

    def check_temperature(self, target_kT: float, dof: int, sheared: bool) -> None:
        """Compare the mean temperature, in a shear that relative to the flow, with the target."""
        kelvin = self.units.thermal_energy
        # temperature_warning uses the second half of these
        rows = [kT / kelvin for kT in self.kinetic_kT[self.start() if self.discard else 0 :]]
        self.temperature_warning = temperature_warning(rows, target_kT / kelvin, dof, sheared=sheared)

    def _configurational(self, start: int) -> tuple[dict[str, float | None] | None, str | None]:
        """The average configurational temperature, and why it, or its error, is missing."""
        if self.no_laplacian is not None:
            return None, self.no_laplacian
        kelvin = self.units.thermal_energy
        gradient2, laplacian = np.array(self.conf).T
        counted = laplacian[start:]
        if len(counted) and not counted.any():
            return None, "no conservative force acts in the averaged rows, so the Laplacian is 0"
        try:
            average = ratio_average(gradient2[start:], counted, name="the configurational temperature")
        except ParameterError as error:
            return None, str(error)
        lacking = average.sem is None and len(counted) >= MIN_BLOCKS
        first, last = (float(gradient2[k] / laplacian[k] / kelvin) if laplacian[k] else None for k in (0, -1))
        return {
            "mean": None if average.mean is None else average.mean / kelvin,
            "sem": None if average.sem is None else average.sem / kelvin,
            "first": first,
            "last": last,
        }, "the Laplacian is 0 in all blocks of rows but one, so the standard error is not defined" if lacking else None

    def speed(self) -> str:
        """The speed of the run; the line begins like LAMMPS's, so that log parsers find the end of the rows."""
        beads, seconds = len(self.request.state.atoms), self.seconds
        head = f"Loop time of {seconds:.3g} s for {self.steps_taken} steps of {beads} beads (run {self.request.number + 1})"
        if not self.steps_taken or not seconds:
            return head
        rate = self.steps_taken / seconds
        return f"{head}: {rate:.4g} steps/s, {rate * beads:.3g} bead-steps/s"

    def summary(self) -> dict[str, Any]:
        """One run in the JSON file."""
        request = self.request
        summary: dict[str, Any] = {
            "steps": self.steps_taken,
            "stopped": self.stopped,
            "dt": request.dt / self.units.time,
            "seconds_per_step": self.seconds / self.steps_taken if self.steps_taken else None,
            "averages_from": next(iter(self.steps_done[self.start() :]), None),
            "thermo": self.averages(),
            "profiles": self.profiles,
            "averages": self.time_averages,
            "temperature_warning": self.temperature_warning,
        }
        reason = self._configurational(self.start())[1]
        if reason is not None:
            summary["temp_conf_reason"] = reason
        return summary


def averages_text(results: list[RunResult]) -> str:
    """Averages of the last run, with standard errors."""
    result = next((result for result in reversed(results) if result.steps_done), None)
    if result is None:
        return ""
    kept = result.steps_done[result.start() :]
    lines = [f"averages of run {result.request.number + 1} over {len(kept)} rows, from step {kept[0]} on, with standard errors:"]
    for word, found in result.averages().items():
        if word in _NO_AVERAGE or found is None or found["mean"] is None:
            continue
        error = "" if found["sem"] is None else f" +- {found['sem']:.2g}"
        lines.append(f"  {word:<12} {found['mean']:.8g}{error}")
    return "\n".join(lines)


#: Thermo words that are not averaged.
_NO_AVERAGE = ("step", "elapsed", "elaplong", "dt", "time", "cpu", "tpcpu", "spcpu", "atoms", "bonds", "angles", "dihedrals", "impropers")


def results_json(results: list[RunResult]) -> dict:
    """The object that ``--json`` writes, without runs that ended before their first row."""
    results = [result for result in results if result.steps_done]
    if not results:
        raise DeckError("the deck has no run")
    last = results[-1]
    runs = [result.summary() for result in results]
    return {
        "natoms": len(last.request.state.atoms),
        "units": last.units.name,
        "scheme": last.request.scheme,
        "platform": last.platform,
        "precision": last.precision,
        "threads": get_threads(),
        "momentum": last.momentum,
        "runs": runs,
        **runs[-1],
    }
