"""The Force of the plugin ``openmm-dpd-device``: pair terms on OpenMM's own device, with no Python in them."""

import importlib
from collections.abc import Callable, Collection, Mapping, Sequence
from fractions import Fraction
from functools import cache
from itertools import pairwise
from pathlib import Path
from shlex import quote
from types import MappingProxyType, ModuleType
from typing import Any, cast
from xml.sax.saxutils import quoteattr

import numpy as np
import openmm

from ...base import names
from ...base.errors import PlanError
from ...base.names import Phase
from ...base.openmm_private import masses_of
from ...kernels.driven import Driven
from ...kernels.eos import EOSTable
from ...kernels.fields import FieldSpec
from ...kernels.layer import PairSpec
from ...kernels.solids import Solids
from ...model.scene import Scene
from ...model.sources import Source
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
        rows.append(cast(list[float], source.row))
        takes |= np.where(True if source.beads is None else source.beads, 1 << k, 0)
    return found | ({"sources": np.clip(rows, -1e30, 1e30), "takes": takes} if rows else {})


def attributes_of(scene: Scene, driven: Driven | Solids | None) -> dict[str, Any]:
    """Attributes of walls that move or have something behind them, of a shear, and of beads on which only body forces act."""
    found: dict[str, Any] = {}
    if isinstance(driven, Driven):
        found["wallMotion"], behind = np.concatenate([driven.velocity, driven.period[:, :, None]], axis=2), driven.continuum
        found |= {} if behind is None else {"behind": behind.tables, "behindAxis": behind.axis, "behindReach": behind.reach}
    if scene.shear is not None and scene.box is not None:
        numbers = "amplitude frequency rate end_rate ramp_time".split()
        found["shear"] = [*(getattr(scene.shear, name) or 0.0 for name in numbers), scene.box[1, 0]]
    if scene.interacting is not None:
        found |= {"alone": ~scene.interacting @ np.array([1, 2, 4]), "bodyGroup": names.EXTERNAL_GROUP}
    return found


def device_force(
    spec: PairSpec,
    tells: Sequence[Callable[[Any], dict[str, np.ndarray]]],
    letters: Sequence[tuple[str, Fraction | float]],
    walls: dict[str, np.ndarray],
    slow: Collection[int],
    *,
    options: ProgramOptions,
    integrator: openmm.Integrator,
    periodic: bool,
    more: Mapping[str, Any] = MappingProxyType({}),
    tolerance: float = TOLERANCE,
) -> openmm.Force:
    """The Force of tables of pair terms.

    Parameters
    ----------
    spec : PairSpec
    tells : sequence of callable
        :attr:`openmm_dpd.plan.kinds.record.Kind.device` of the kind of each table.
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
    more : dict, optional
        What :func:`attributes_of` gives.
    tolerance : float
        See :data:`TOLERANCE`.
    """
    parameters = {names.PHASE: float(Phase.IDLE), names.TAU: options.dt, names.DT: options.dt, names.KT: options.kT, names.COUNTER: 0.0}
    parameters |= {names.SEED: float(options.seed)} | origin(options, integrator) | of_fields(spec.fields)
    parameters |= {name: 0.0 for _, name in options.impulses} | ({names.SHEARED: 0.0} if "shear" in more else {})
    parameters |= {names.BODY_FORCE: 1.0} if "behind" in more else {}  # which does not scale it, as on the host
    start, bead, factor = spec.exceptions
    first = np.repeat(np.arange(len(spec.types)), np.diff(start)) if len(start) else np.zeros(0, int)
    told = [tell(table) for tell, table in zip(tells, spec.terms, strict=True)]
    terms = {name: values for each in told for name, values in each.items()}
    if len(told) > 1:  # one after the other; only many-body terms have what others lack
        none = np.zeros_like(told[0]["A"])
        terms |= {name: np.stack([each.get(name, none) for each in told]) for name in terms if name != "densityWeights"}
    if not options.execution.pushes:
        terms = {name: 0 * values if name == "A" else values for name, values in terms.items() if name not in MANY_BODY}
    lists = {} if spec.fields is None else _carried(spec.fields)
    lists |= {
        **more,
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
        "version": 4 if more or "states" in lists else 3 if "carries" in terms else 2 if "B" in terms else 1,
        "name": names.PAIR_FORCE,
        "forceGroup": options.pair_group,
        "periodic": int(periodic),
        "tolerance": repr(tolerance),
        "numTypes": len(told[0]["A"]),
        "fastGroups": ~sum(1 << group for group in slow),
        "letters": "".join(letter for letter, _ in letters),
    }
    attributes |= {name: " ".join(map(repr, np.ravel(values).tolist())) for name, values in (lists | terms).items()}
    text = "".join(f" {name}={quoteattr(str(value))}" for name, value in attributes.items())
    inside = "".join(f'<Parameter name="{name}" default="{value!r}"/>' for name, value in parameters.items())
    return openmm.XmlSerializer.deserialize(f"<Force{text}><GlobalParameters>{inside}</GlobalParameters></Force>")


def update_force(system: openmm.System, context: openmm.Context) -> None:
    """Give a Context the repulsion and friction that the pair force of a System has.

    Raises
    ------
    PlanError
        If the pair force of either is not the plugin's, or the two differ in anything else.
    """
    theirs = context.getSystem()
    new, old = (next((f for f in each.getForces() if f.getName() == names.PAIR_FORCE), None) for each in (system, theirs))
    if any(force is None or isinstance(force, openmm.PythonForce) for force in (new, old)):
        raise PlanError(
            "only the engine 'device' takes another repulsion and friction in a Context; with others, make a new Simulation, and load the "
            "state of the old one (saveState, loadState)"
        )
    known = {openmm.XmlSerializer.serialize(force) for force in theirs.getForces() if force.getName() != names.PAIR_FORCE}
    for force in system.getForces():
        if force.getName() != names.PAIR_FORCE and openmm.XmlSerializer.serialize(force) not in known:
            raise PlanError(f"the Context has no such {force.getName()}: only repulsion and friction can change in it")
    if not np.array_equal(masses_of(system), masses_of(theirs)):
        raise PlanError("the beads of the Context have other masses: only repulsion and friction can change in it")
    update = getattr(plugin(), "update_force", None)
    if update is None:
        raise PlanError("this openmm-dpd-device is older and cannot change a Context: install it again")
    if wrong := update(new, old, context):
        raise PlanError(wrong.removeprefix("DPDDeviceForce: "))
