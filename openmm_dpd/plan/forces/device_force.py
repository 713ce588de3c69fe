"""The Force of the plugin ``openmm-dpd-device``: pair terms on OpenMM's own device, with no Python in them."""

import importlib
from collections.abc import Callable, Collection, Sequence
from fractions import Fraction
from functools import cache
from itertools import pairwise
from pathlib import Path
from shlex import quote
from types import ModuleType
from typing import Any, cast
from xml.sax.saxutils import quoteattr

import numpy as np
import openmm

from ...base import names
from ...base.names import Phase
from ...kernels.eos import EOSTable
from ...kernels.fields import FieldSpec
from ...kernels.layer import PairSpec
from ...model.sources import Block, Source, Sphere
from ..made import of_fields, origin
from ..program_options import ProgramOptions

#: How exactly the linear systems of pair updates are solved: what is left, relative to what a midpoint step changes.
TOLERANCE = 5e-4
#: How many sources there may be, bits of a number that say which act on a bead; and how many species in a pair update.
MOST_SOURCES, MOST_SWEPT = 31, 3
#: Attributes of many-body terms, which are all conservative.
MANY_BODY = ("B", "cutoffB", "cutoffDensity", "densityWeights")


@cache
def plugin() -> ModuleType | str:
    """The plugin, its libraries loaded, or the reason why there is none."""
    try:
        return importlib.import_module("openmm_dpd_device")
    except ImportError as error:
        if error.name != "openmm_dpd_device":
            return str(error)
        source = Path(__file__).resolve().parents[3] / "plugin"
        there = (source / "CMakeLists.txt").is_file()
        how = f": pip install {quote(str(source))}" if there else ", in a copy of the project: pip install ./plugin"
        return f"the package openmm-dpd-device is not installed; to install it{how}"


def why_no_plugin(platform: str | None) -> str | None:
    """Why the plugin cannot be used on a platform, or None."""
    found = plugin()
    if isinstance(found, str):
        return found
    name = "Reference" if platform == "CPU" else platform
    if name in found.loaded:
        return None
    return found.failed.get(name, f"openmm-dpd-device knows no platform {platform}")


def _states(eos: EOSTable) -> np.ndarray:
    """Equations of state as plugin/engine/fields.cc reads them."""
    zero = np.zeros_like(eos.capacity)
    beads = np.column_stack([eos.capacity, eos.curve, zero, zero])
    for k, (first, end) in enumerate(pairwise(eos.start)):
        beads[eos.curve == k, :2] = end - first - 1, first
    zero = np.zeros_like(eos.nodes)
    pieces = np.column_stack([eos.nodes, eos.pieces[:, 4], zero, zero, eos.pieces[:, :4]])
    return np.concatenate([beads.ravel(), pieces.ravel()])


def _carried(fields: FieldSpec) -> dict[str, Any]:
    """Attributes of what beads carry."""
    found: dict[str, Any] = {"carried": fields.initial, "capacities": () if fields.capacity is None else fields.capacity}
    if fields.eos is not None:
        found |= {"capacities": np.ones(len(fields.initial)), "states": _states(fields.eos)}
    rows, takes = [], np.zeros(len(fields.initial), np.int64)
    for k, source in enumerate(cast(Sequence[Source], fields.sources)):
        region = source.region
        low, high = (region.low, region.high) if isinstance(region, Block) else (region.centre, [region.radius**2, 0.0, 0.0])
        rows.append([*source.corner, float(isinstance(region, Sphere)), *low, source.rate, *high, float(source.species)])
        takes |= np.where(True if source.beads is None else source.beads, 1 << k, 0)
    return found | ({"sources": np.clip(rows, -1e30, 1e30), "takes": takes} if rows else {})


def device_force(
    spec: PairSpec,
    tell: Callable[[Any], dict[str, np.ndarray]],
    letters: Sequence[tuple[str, Fraction | float]],
    walls: dict[str, np.ndarray],
    slow: Collection[int],
    *,
    options: ProgramOptions,
    integrator: openmm.Integrator,
    periodic: bool,
    tolerance: float = TOLERANCE,
) -> openmm.Force:
    """The Force of one table of terms of isothermal DPD, many-body or not.

    Parameters
    ----------
    spec : PairSpec
    tell : callable
        :attr:`openmm_dpd.plan.kinds.record.Kind.device` of the kind of its only table.
    letters : tuple of (letter, part of the step)
        The word of a whole step, empty if the program goes line by line; ("V", lam) is modified velocity Verlet.
    walls : dict
        What :func:`openmm_dpd.simulation.programs.walls.planes` gives, or empty.
    slow : collection of int
        Force groups that may hold forces that kick before and after such a step, and not at every ``B``.
    options, integrator
        As for :func:`openmm_dpd.plan.forces.pair_force.pair_force`.
    periodic : bool
        Whether there is a box.
    tolerance : float
        See :data:`TOLERANCE`.
    """
    parameters = {names.PHASE: float(Phase.IDLE), names.TAU: options.dt, names.DT: options.dt, names.KT: options.kT, names.COUNTER: 0.0}
    parameters |= {names.SEED: float(options.seed)} | origin(options, integrator) | of_fields(spec.fields)
    start, bead, factor = spec.exceptions
    first = np.repeat(np.arange(len(spec.types)), np.diff(start)) if len(start) else np.zeros(0, int)
    terms = tell(spec.terms[0])
    if not options.execution.pushes:
        terms = {name: 0 * values if name == "A" else values for name, values in terms.items() if name not in MANY_BODY}
    lists = {} if spec.fields is None else _carried(spec.fields)
    lists |= {
        "types": spec.types,
        "exceptionBeads": np.stack([first, bead], axis=1) if len(first) else (),
        "exceptionFactors": factor if len(first) else (),
        "wallVelocity": () if spec.wall_velocity is None else spec.wall_velocity,
        "walls": np.stack(list(walls.values())) if walls else (),
        "slowKicks": options.slow_kicks,
        "parts": [float(part) for _, part in letters],
    }
    attributes: dict[str, object] = {
        "type": "DPDDeviceForce",
        # an older plugin refuses what it does not know
        "version": 4 if "states" in lists else 3 if "carries" in terms else 2 if "B" in terms else 1,
        "name": names.PAIR_FORCE,
        "forceGroup": options.pair_group,
        "periodic": int(periodic),
        "tolerance": repr(tolerance),
        "numTypes": len(terms["A"]),
        "fastGroups": ~sum(1 << group for group in slow),
        "letters": "".join(letter for letter, _ in letters),
    }
    attributes |= {name: " ".join(map(repr, np.ravel(values).tolist())) for name, values in (lists | terms).items()}
    text = "".join(f" {name}={quoteattr(str(value))}" for name, value in attributes.items())
    inside = "".join(f'<Parameter name="{name}" default="{value!r}"/>' for name, value in parameters.items())
    return openmm.XmlSerializer.deserialize(f"<Force{text}><GlobalParameters>{inside}</GlobalParameters></Force>")
