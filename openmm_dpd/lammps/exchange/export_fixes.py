"""Integrators, equations of state, sources, body forces and walls of an exported scene."""

import re
from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.edpd import EDPD
from ...model.energy_dpd import EnergyDPD
from ...model.eos import ConstantHeatCapacity, TabulatedEOS
from ...model.flow import AXES, SPECULAR, BodyForce, PositionForce
from ...model.internal import BeadTemperatures, InternalEnergy
from ...model.mdpd import MDPD
from ...model.pairs import DPD
from ...model.scene import Scene
from ...model.schemes import scheme_of
from ...model.sources import Block, Source
from ...model.tdpd import TDPD
from ...model.temperature import TemperatureRamp
from ..language.lexer import closing_parenthesis
from ..styles.words import Differences, exact, group_lines
from .export_scene import BeadTypes, longest_cutoff

#: Heat capacity of immobile beads, which are reservoirs, in units of k_B.
_RESERVOIR = 1e12
#: Rows of a resampled equation of state.
_EOS_ROWS = 2001
#: Maximum number of different vectors in a body force.
_MOST_VECTORS = 50


@dataclass(frozen=True)
class Integrator:
    """LAMMPS's integrating fix and its lambda, and whether fix shardlow applies friction and noise."""

    fix: str
    lam: float = 0.5
    shardlow: bool = False


def choose_integrator(scene: Scene, scheme: str, lam: float, units: UnitSystem, skin: float, differences: Differences) -> Integrator:
    """The LAMMPS integrator nearest to a scheme; differences are recorded."""
    kinds = {table.kind for table in scene.tables} - {None}
    energy = EnergyDPD in kinds
    chosen = scheme_of(scheme)
    for kind, fix in ((EDPD, "mvv/edpd"), (TDPD, "mvv/tdpd")):
        if kind in kinds:
            if not chosen.predicts:
                differences.add(_no_scheme(repr(chosen.name), f"modified velocity Verlet (fix {fix})", "of such beads"))
            return Integrator(fix, lam)
    wanted = chosen.shardlow or (energy and chosen.sweeps)
    why = _no_shardlow(scene, kinds, skin) if wanted else None
    swept = wanted and why is None
    if chosen.shardlow and why is not None:
        differences.add(f"fix shardlow is not possible, since {why}; the deck uses velocity Verlet (fix nve) with friction as a force")
    elif not chosen.in_lammps:
        instead = "Shardlow's splitting (fix shardlow, then fix nve)" if swept else "velocity Verlet (fix nve) with friction as a force"
        name = "OpenMM's DPDIntegrator" if chosen.native else repr(chosen.name)
        differences.add(_no_scheme(name, instead))
    if swept:
        if any(0 < factor < 1 for factor in scene.bonded_factors) and len(scene.bond_pairs):
            differences.add("LAMMPS's fix shardlow ignores special_bonds: friction and noise of bonded neighbours are not scaled")
        differences.remark(
            f"fix shardlow needs more than {exact(2 * (longest_cutoff(scene) + skin) / units.length)} of box per process along each axis"
        )
        return Integrator("nve", 0.5, True)
    if lam != 0.5 and not energy:
        if units.name == "lj":
            return Integrator("mvv/dpd", lam)
        differences.add(f"lambda = {lam:g} needs units lj in LAMMPS (fix mvv/dpd); the deck uses fix nve (lambda = 0.5)")
    elif lam != 0.5:
        differences.add(f"LAMMPS has no lambda for energy-conserving beads; the deck uses fix nve (lambda = 0.5) instead of {lam:g}")
    return Integrator("nve")


def _no_scheme(name: str, instead: str, where: str = "") -> str:
    return (
        f"LAMMPS has no scheme {name}{' ' * bool(where)}{where}: the deck uses {instead}; at the same step the temperatures differ by "
        "the errors of the schemes, so a shorter step may be needed"
    )


def _no_shardlow(scene: Scene, kinds: set, skin: float) -> str | None:
    """Why LAMMPS's fix shardlow cannot be used, or None."""
    if scene.box is None or np.any(np.tril(scene.box, -1)):
        return "it needs a periodic box without tilt"
    if np.diag(scene.box).min() <= 2 * (longest_cutoff(scene) + skin):
        return "it needs box edges above twice the cutoff and the skin"
    if scene.interacting is not None:
        return "it changes velocities of beads whose forces are removed"
    if MDPD in kinds or len(kinds & {DPD, EnergyDPD}) != 1 or sum(t.kind in (DPD, EnergyDPD) for t in scene.tables) > 1:
        return "it supports only a single table of DPD or EnergyDPD"
    if isinstance(scene.kT, TemperatureRamp) and scene.kT.kT_start != scene.kT.kT_end:
        return "it has no temperature ramp"
    if DPD in kinds:
        if scene.initial_kT == 0:
            return "it needs a temperature above 0"
        terms = [c for table in scene.tables for c in table.entries.values() if isinstance(c, DPD)]
        if any(c.gamma_perp or c.exponent != 1 for c in terms):
            return "it has no transverse friction and no exponents"
    return None


def integrator_lines(scene: Scene, integrator: Integrator, group: str) -> Iterator[str]:
    """Fixes that move the beads of a group, in the order LAMMPS requires."""
    if integrator.shardlow:
        yield "fix sweep all shardlow"
    yield f"fix move {group} {integrator.fix}" + (f" {exact(integrator.lam)}" if integrator.fix.startswith("mvv/") else "")
    if isinstance(scene.internal, InternalEnergy) and not integrator.shardlow:
        yield "fix heat all dpd/energy"


# -- equations of state --------------------------------------------------------------------------------------------------------
def eos_lines(scene: Scene, types: BeadTypes, units: UnitSystem, file: str, differences: Differences) -> tuple[list[str], list[str]]:
    """Fixes of the equations of state, and the lines of their table file (possibly empty)."""
    if not isinstance(scene.internal, InternalEnergy):
        return [], []
    if scene.internal.conductive is not None and np.any(np.asarray(scene.internal.conductive)):
        differences.add("LAMMPS counts all internal energy as mechanical at the start (u_cond = 0); only the sum is kept")
    by_name = dict(zip(scene.type_names, scene.internal.by_type(scene.type_names), strict=True))
    lines, table, written = list[str](), list[str](), dict[int, str]()
    for k, (name, frozen) in enumerate(zip(types.names, types.frozen, strict=True), start=1):
        group = "all" if len(types) == 1 else f"type{k}"
        if group != "all":
            lines.append(f"group {group} type {k}")
        eos = by_name[name]
        if isinstance(eos, ConstantHeatCapacity) or frozen:
            capacity = _RESERVOIR if frozen or not isinstance(eos, ConstantHeatCapacity) else eos.capacity
            lines.append(f"fix eos{k} {group} eos/cv {exact(capacity * units.boltzmann)}")
            continue
        rows = _eos_rows(eos, units)
        if id(eos) not in written:
            written[id(eos)] = f"EOS_{len(written) + 1}"
            table += ["", written[id(eos)], f"N {len(rows)}", ""]
            table += [f"{n} {exact(theta)} {exact(u)}" for n, (theta, u) in enumerate(rows, start=1)]
        lines.append(f"fix eos{k} {group} eos/table linear {file} {len(rows)} {written[id(eos)]}")
    return lines, ["# equations of state written by openmm-dpd, units = " + units.name, *table] if table else []


def _eos_rows(eos: TabulatedEOS, units: UnitSystem) -> list[tuple[float, float]]:
    """Temperatures and energies, finely and evenly spaced so that LAMMPS's interpolation is exact enough."""
    theta, u = eos.thetas, eos.energies
    if len(theta) < 100 or not np.allclose(np.diff(theta), np.diff(theta).mean(), rtol=1e-6):
        theta = np.linspace(theta[0], theta[-1], _EOS_ROWS)
        u = eos.energy(theta)
    return list(zip((theta / units.thermal_energy).tolist(), (np.asarray(u) / units.energy).tolist(), strict=True))


# -- sources -------------------------------------------------------------------------------------------------------------------
def source_lines(scene: Scene, units: UnitSystem, corner: np.ndarray, differences: Differences) -> Iterator[str]:
    """Regions, groups and fixes of the sources of heat or species."""
    heat = isinstance(scene.internal, BeadTemperatures)
    for k, source in enumerate(scene.sources, start=1):
        if not isinstance(source, Source):
            raise ParameterError("a buoyancy follows temperatures or concentrations of beads, for which LAMMPS has no fix")
        if not _fits(scene, source.corner, corner):
            raise ParameterError(
                f"the sources have different corners of the box, {np.asarray(source.corner).tolist()} and {corner.tolist()}; "
                "LAMMPS has only one"
            )
        if scene.box is not None and np.any(np.tril(scene.box, -1)):
            differences.remark("sources act on beads at their wrapped positions in LAMMPS's tilted box")
        region = source.region
        if isinstance(region, Block):
            ends = np.column_stack([region.low, region.high]) / units.length
            words = " ".join("INF" if np.isinf(value) else exact(value) for value in ends.ravel())
            yield f"region source{k} block {words} units box"
        else:
            yield f"region source{k} sphere {exact(region.centre / units.length)} {exact(region.radius / units.length)} units box"
        group = yield from _group(f"source{k}", source.beads)
        if heat:
            yield f"fix source{k} {group} edpd/source region source{k} {exact(source.rate * units.time / units.thermal_energy)}"
        else:
            yield f"fix source{k} {group} tdpd/source {source.species + 1} region source{k} {exact(source.rate * units.time)}"
    if scene.sources:
        differences.remark("LAMMPS's sources do not act in the first half step of a run")


def _fits(scene: Scene, given, corner: np.ndarray) -> bool:
    """Whether wrapping into the box gives the same positions for both corners; between walls nothing is wrapped."""
    return bool(np.all(np.delete(np.asarray(given) == corner, list(scene.gaps))))


# -- flow ----------------------------------------------------------------------------------------------------------------------
def flow_lines(scene: Scene, units: UnitSystem, corner: np.ndarray) -> Iterator[str]:
    """Beads with body forces only (fix setforce), body forces (fix addforce), walls (fix wall/reflect) and shear (fix deform).
    ParameterError if LAMMPS has no suitable fix: bounce-back walls, formulas in units other than lj ..."""
    if scene.interacting is not None:
        for k, row in enumerate(np.unique(scene.interacting[~scene.interacting.all(axis=1)], axis=0), start=1):
            group = yield from _group(f"alone{k}", np.all(scene.interacting == row, axis=1))
            yield f"fix alone{k} {group} setforce " + " ".join("NULL" if free else "0.0" for free in row)
    for k, term in enumerate(scene.body_forces, start=1):
        if isinstance(term, BodyForce):
            yield from _body_lines(scene, term, units, f"push{k}")
        else:
            yield from _formula_lines(scene, term, units, corner, f"push{k}")
    if len(scene.walls) and not scene.gaps:
        raise ParameterError("beads bounce back from walls of a shape, for which LAMMPS has no fix; use frozen beads")
    for axis, gap in scene.gaps.items():
        if gap.kind != SPECULAR:
            raise ParameterError(
                f"the walls along {AXES[axis]} reverse velocities (bounce-back), for which LAMMPS has no fix; use frozen beads or "
                "specular walls"
            )
        ends = [(side, place) for side, place in (("lo", gap.low), ("hi", gap.high)) if abs(place) < 1e20]
        yield f"fix wall{AXES[axis]} all wall/reflect " + " ".join(f"{AXES[axis]}{s} {exact(p / units.length)}" for s, p in ends)
    if scene.shear is not None:
        if not scene.shear.constant:
            raise ParameterError(
                f"only a constant shear rate can be exported, not {scene.shear}: with a changing rate LAMMPS only moves the images"
            )
        assert scene.shear.rate is not None
        yield f"fix slide all deform 1 xy erate {exact(scene.shear.rate * units.time)} remap v"


def _group(name: str, mask: np.ndarray | None) -> Generator[str, None, str]:
    """Yield commands that define a group, unless it contains all beads; return the name of the group."""
    if mask is None or np.all(mask):
        return "all"
    yield from group_lines(name, mask)
    return name


def _body_lines(scene: Scene, term: BodyForce, units: UnitSystem, name: str) -> Iterator[str]:
    different, which = np.unique(term.vectors(scene.type_ids, scene.type_names, scene.box) / units.force, axis=0, return_inverse=True)
    acting = [row for row in range(len(different)) if np.any(different[row])]
    if len(acting) > _MOST_VECTORS:
        raise ParameterError(f"a body force has {len(acting)} different vectors; at most {_MOST_VECTORS} can be exported, one fix for each")
    for number_, row in enumerate(acting):
        label = name if len(acting) == 1 else f"{name}_{number_ + 1}"
        group = yield from _group(label, which.ravel() == row)
        if term.pattern == "uniform":
            yield f"fix {label} {group} addforce {exact(different[row])}"
            continue
        period, origin = float(scene.box[AXES.index(term.axis)][AXES.index(term.axis)]), term.origin  # type: ignore[index,arg-type]
        place = f"({term.axis}-({exact(origin / units.length)}))/{exact(period / units.length)}"
        shape = f"sin(2.0*PI*{place})" if term.pattern == "sine" else f"(1.0-2.0*(({place}-floor({place}))>=0.5))"
        words = []
        for axis, value in zip("xyz", different[row].tolist(), strict=True):
            if value:
                yield f'variable {label}{axis} atom "({exact(value)})*{shape}"'
            words.append(f"v_{label}{axis}" if value else "0.0")
        yield f"fix {label} {group} addforce {' '.join(words)}"


#: Functions of both OpenMM and LAMMPS: LAMMPS's name by OpenMM's.
_FUNCTIONS = {name: name for name in "sqrt exp sin cos tan asin acos atan abs floor ceil".split()} | {"log": "ln"}


def _formula_lines(scene: Scene, term: PositionForce, units: UnitSystem, corner: np.ndarray, name: str) -> Iterator[str]:
    if units.name != "lj":
        raise ParameterError(f"formulas of position forces can only be exported in units lj, not in units {units.name}")
    if not _fits(scene, term.corner, corner):
        raise ParameterError("the corner of a position force must be that of the exported box")
    group = yield from _group(name, term.mask(scene.type_ids, scene.type_names))
    words = []
    for axis, formula in zip("xyz", term.formulas, strict=True):
        formula = _without_steps(formula)
        for match in re.finditer(r"([A-Za-z_]\w*)\s*\(", formula):
            if match[1] not in _FUNCTIONS:
                raise ParameterError(f"the formula '{formula}' of a position force uses {match[1]}, which LAMMPS does not have")
        try:
            words.append(exact(float(formula)))
        except ValueError:
            text = re.sub(r"\blog\b", "ln", formula)
            yield f'variable {name}{axis} atom "{text}"'
            words.append(f"v_{name}{axis}")
    yield f"fix {name} {group} addforce {' '.join(words)}"


def _without_steps(formula: str) -> str:
    """Replace step(...) by the comparison ((...)>=0.0), which is 1 or 0 in LAMMPS."""
    while match := re.search(r"\bstep\s*\(", formula):
        end = closing_parenthesis(formula, match.end() - 1)
        formula = f"{formula[: match.start()]}(({formula[match.end() : end - 1]})>=0.0){formula[end:]}"
    return formula
