"""Reporters for DPD: 3N - 3 degrees of freedom, configurational temperature, pressure with all pair terms, momentum; and velocities.

OpenMM's StateDataReporter works too, but it uses kelvin and 3N degrees of freedom, and has no pressure.
"""

import logging
import os
from collections.abc import Callable, Sequence
from typing import Any, TextIO

import numpy as np
from openmm import unit

from ..base.errors import ParameterError, require, what_is
from ..base.units import BAR_PER_MD_PRESSURE
from ..io.snapshot import Cadence
from ..kernels.fields import ENERGY, TEMPERATURE
from ..simulation.built import BuiltSystem
from ..simulation.field_file import FieldWriter
from .observer import Observer, require_built
from .temperature import TemperatureWatch, kelvin

_LOGGER = logging.getLogger("openmm_dpd")


def _optional(value: float | None, factor: float = 1.0) -> float:
    return float("nan") if value is None else value * factor


#: Value of each column, in MD units.
COLUMNS: dict[str, Callable[[Any], float]] = {
    "step": lambda s: s.step,
    "time": lambda s: s.time,
    "kT": lambda s: s.kT,
    "temperature": lambda s: kelvin(s.kT),
    "kT_conf": lambda s: _optional(s.kT_conf),
    "kinetic_energy": lambda s: s.kinetic,
    "potential_energy": lambda s: s.potential,
    "total_energy": lambda s: s.kinetic + s.potential,
    "pressure": lambda s: _optional(s.pressure(True)),
    "pressure_conservative": lambda s: _optional(s.pressure(False)),
    "pressure_bar": lambda s: _optional(s.pressure(True), BAR_PER_MD_PRESSURE),
    "volume": lambda s: _optional(s.volume),
    "momentum": lambda s: float(np.abs(s.momentum).max()),
    "internal_energy": lambda s: _optional(s.internal),
    "conductive_energy": lambda s: _optional(s.conductive),
    "theta": lambda s: _optional(s.theta),
    "conserved_energy": lambda s: s.total,
    "kT_atoms": lambda s: _optional(s.kT_atoms),
    "kT_beads": lambda s: _optional(s.kT_beads),
}

#: Columns for a System made elsewhere; those of its parts, atoms and beads, only if there are beads in it.
SYSTEM_COLUMNS = (
    *("step", "time", "kT", "kT_atoms", "kT_beads", "temperature", "potential_energy", "kinetic_energy", "total_energy"),
    *("volume", "momentum"),
)

DEFAULT_COLUMNS = ("step", "time", "kT", "kT_conf", "potential_energy", "kinetic_energy", "pressure", "pressure_conservative", "momentum")


def _reasons(observer: Observer, columns: Sequence[str]) -> dict[str, list[str]]:
    """Columns that are always NaN, by reason."""
    scene, reasons = observer.plan.scene, dict[str, list[str]]()
    no_box = None if scene.box is not None else "there is no box"
    known = {"kT_conf": observer.no_laplacian} | dict.fromkeys(("pressure", "pressure_conservative", "pressure_bar", "volume"), no_box)
    field_kind = None if observer.plan.spec.fields is None else observer.plan.spec.fields.kind
    no_energy = None if field_kind in (ENERGY, TEMPERATURE) else "the beads have no internal energies"
    known |= {"internal_energy": no_energy, "theta": no_energy}
    known["conductive_energy"] = None if field_kind == ENERGY else "the beads have no conductive energies"
    for name in columns:
        reason = known.get(name)
        if reason is not None:
            reasons.setdefault(reason, []).append(name)
    return reasons


class RowReporter(Cadence):
    """Base of reporters that write rows of numbers to a CSV file with a header."""

    _columns: tuple[str, ...]
    _owned = False  # also if __init__ fails early

    def _open(self, file: str | os.PathLike | TextIO, append: bool) -> None:
        """Open the file, and write or check its header."""
        require(append, bool, "append must be True or False")
        if not hasattr(file, "write"):
            require(file, (str, os.PathLike), "file must be a path or a text file open for writing")
        self._unended = False  # whether the header lacks its newline
        begun = self._has_header(file, append)
        self._out: TextIO = open(file, "a" if append else "w") if isinstance(file, (str, os.PathLike)) else file
        self._owned = isinstance(file, (str, os.PathLike))
        if not begun:
            self._write(self._columns)
        elif self._unended:
            self._out.write("\n")

    def _has_header(self, file: str | os.PathLike | TextIO, append: bool) -> bool:
        """Whether the file to append to has a header; ParameterError if it is another one.  An incomplete last row is removed."""
        if isinstance(file, (str, os.PathLike)):
            path: str | os.PathLike = file
            begun = append and os.path.exists(path) and os.path.getsize(path) > 0
        else:
            path = getattr(file, "name", "")
            append = append or "a" in getattr(file, "mode", "")
            begun = append and file.seekable() and file.tell() > 0
        if begun and isinstance(path, (str, os.PathLike)) and os.path.isfile(path):
            with open(path, "rb") as there:
                content = there.read()
            header, rows = content.partition(b"\n")[0].decode(), content[: content.rfind(b"\n") + 1]
            self._unended = not rows
            if header != ",".join(self._columns):
                raise ParameterError(
                    f"cannot append to {os.fspath(path)}: its header is {header!r}, but the columns are {','.join(self._columns)!r}"
                )
            if rows and len(rows) < len(content):  # a crash or a full disk has cut the row, and perhaps its last number
                _LOGGER.warning("%s: the last row is incomplete and is removed", os.fspath(path))
                os.truncate(path, len(rows))
                if hasattr(file, "seek"):
                    file.seek(0, os.SEEK_END)
        return begun

    def _write(self, fields) -> None:
        self._out.write(",".join(fields) + "\n")
        self._out.flush()

    def __del__(self):
        if self._owned:
            self._out.close()


class DPDReporter(RowReporter):
    """Reporter that writes measured quantities to a CSV file.

    After 20, 40, 80, ... rows it compares the kinetic temperature of their second half with the set one, and warns once, through
    ``logging.getLogger("openmm_dpd")``, if they differ (:mod:`openmm_dpd.measure.temperature`).

    Parameters
    ----------
    file : str, path or text file
        File to write.
    interval : int
        Steps between rows.
    built : BuiltSystem
        The result of :func:`openmm_dpd.build`, :func:`openmm_dpd.add_thermostat` or :func:`openmm_dpd.create_mixed_system`.
    columns : sequence of str, optional
        Keys of :data:`COLUMNS`.  Energies are in kJ/mol and pressures in kJ/mol/nm^3, which are the reduced units of a reduced scene;
        ``temperature`` is in kelvin, ``pressure_bar`` in bar.  ``pressure`` includes conservative and dissipative pair forces (and random
        ones in ``mvv``, where noise is a force); ``momentum`` is the largest component of the total.  For beads with internal energies,
        ``internal_energy`` and ``conductive_energy`` are sums, ``theta`` is the harmonic mean temperature (an energy), and
        ``conserved_energy`` is potential plus kinetic plus internal energy.  ``kT_conf`` is the ratio of a single configuration; for a
        precise value, average numerator and denominator separately (:class:`openmm_dpd.measure.Observer`).
        A System made elsewhere has :data:`SYSTEM_COLUMNS`: ``kT_atoms`` and ``kT_beads`` are the temperatures of its parts, ``kT``
        and ``temperature`` that of all particles; pressures and configurational temperature are not measured.
    append : bool, default False
        Append to the file, whose header must have the same columns; a missing or empty file is started anew.  A file object that was
        opened to append is always appended to.

    Raises
    ------
    ParameterError
        If a column is unknown or not measured for this System, the interval is not a whole number >= 1, ``built`` is anything else, or
        the file to append to has another header.
    """

    def __init__(
        self,
        file: str | os.PathLike | TextIO,
        interval: int,
        built: BuiltSystem,
        columns: Sequence[str] | None = None,
        append: bool = False,
    ):
        require_built(built, "DPDReporter")
        plan = built.plan
        parts = {"kT_atoms", "kT_beads"} if plan.host is None or plan.n_atoms == plan.scene.n_beads else set()
        able = [name for name in (COLUMNS if plan.host is None else SYSTEM_COLUMNS) if name not in parts]
        if columns is None:
            columns = DEFAULT_COLUMNS if built.plan.host is None else [name for name in able if name != "temperature"]
        if isinstance(columns, str) or not isinstance(columns, Sequence) or not columns:
            raise ParameterError(f"columns must be a sequence of names such as ('step', 'kT'), not {what_is(columns)}")
        unknown = [str(name) for name in columns if name not in COLUMNS]
        if unknown:
            raise ParameterError(f"unknown columns {', '.join(unknown)}; they must be among {', '.join(COLUMNS)}")
        absent = [name for name in columns if name not in able]
        if absent:
            where = "a scene" if built.plan.host is None else "a System made elsewhere"
            raise ParameterError(f"columns {', '.join(absent)} are not measured for {where}; choose among {', '.join(able)}")
        super().__init__(interval)
        self._columns, self._observer, self._watch = tuple(columns), Observer(built), TemperatureWatch(built.plan)
        self._open(file, append)  # last, so that an error above leaves an existing file as it is
        for reason, names in _reasons(self._observer, self._columns).items():
            _LOGGER.warning("columns of DPDReporter that will be nan: %s (%s)", ", ".join(names), reason)
        if self._observer.uncounted and any(name.startswith("pressure") for name in self._columns):
            _LOGGER.warning("the pressure of DPDReporter leaves out forces that are not the scene's own: %s", self._observer.uncounted)

    def report(self, simulation, state):
        """Write one row."""
        self._add(self._observer.sample(simulation.context))

    def report_within(self, simulation, first: int, end: int) -> bool:
        """Step to step ``end``, and report from step ``first`` on before it; or do nothing and return False, if that cannot be done."""
        return self._observer.within(simulation.context, first, self.interval, end, self._add)

    def _add(self, sample: Any) -> None:
        row = [COLUMNS[name](sample) for name in self._columns]
        self._write([str(value) if isinstance(value, int) else f"{value:.10g}" for value in row])
        wrong = self._watch.add(sample)
        if wrong is not None:
            _LOGGER.warning("step %d: %s", sample.step, wrong)


class VelocityReporter(Cadence):
    """Reporter that writes velocities (nm/ps) to a file; with the interval of the trajectory, frames match.

    Parameters
    ----------
    file : str or path
        File such as ``velocities.npz``, a zip archive with an array per frame; for trajectories in formats without velocities.
    interval : int
        Steps between frames.
    """

    _INCLUDE = ("velocities",)

    def __init__(self, file: str | os.PathLike, interval: int):
        super().__init__(interval)
        self._writer = FieldWriter(file)

    def report(self, simulation, state):
        """Write one frame."""
        velocities = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        time = state.getTime().value_in_unit(unit.picosecond)
        self._writer.write(time, simulation.currentStep, {"velocities": velocities.astype(np.float32)})
