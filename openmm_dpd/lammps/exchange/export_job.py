"""The validated arguments of an export, and the text of its deck."""

import re
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from ...base.errors import ParameterError, what_is
from ...base.units import LJ, UnitSystem, to_md, unit_system, whole_number
from ...kernels.shear import rate_at
from ...model.flow import AXES, PositionForce
from ...model.internal import BeadTemperatures, Concentrations, InternalEnergy
from ...model.scene import Scene
from ...model.schemes import scheme_of
from ...model.sources import Source
from ...model.temperature import TemperatureRamp
from ...plan.choices import checked_seed, checked_step, checked_weight
from ...simulation.build import initial_velocities
from ..files.data_file import JOINED, data_lines
from ..styles.charges import charge_use
from ..styles.srp import segment_use
from ..styles.words import Differences, PairExport, StyleUse, exact, group_lines
from . import export_scene as of_scene
from .export_fixes import Integrator, choose_integrator, eos_lines, flow_lines, integrator_lines, source_lines

#: Attributes of a Scene that can be exported; a scene with any other is an error.
_KNOWN = frozenset(
    "masses types positions pairs kT box velocities bead_masses charges bonds bonded_factors mobile molecules internal sources compat "
    "angles dihedrals segments body_forces walls electrostatics residues interacting shear impropers".split()
)

_NAME = re.compile(r"[A-Za-z0-9_.+-]+")


@dataclass(frozen=True, eq=False)
class Job:
    """All arguments of an export, validated."""

    scene: Scene
    units: UnitSystem
    name: str
    dt: float
    steps: int
    every: int
    seed: int
    corner: np.ndarray
    integrator: Integrator
    types: of_scene.BeadTypes
    styles: tuple[str, ...]
    differences: Differences
    skin: float
    bonds: of_scene.Bonded
    angles: of_scene.Bonded
    dihedrals: of_scene.Bonded
    impropers: of_scene.Bonded
    images: np.ndarray | None = None

    @property
    def n_species(self) -> int:
        """Number of concentrations of each bead."""
        return of_scene.species_of(self.scene)

    @property
    def some_stay(self) -> bool:
        """Whether there are immobile beads."""
        return self.scene.mobile is not None and not self.scene.mobile.all()


def _refuse_unknown(scene: Scene) -> None:
    for item in fields(scene):
        if not item.init or item.name in _KNOWN:
            continue
        value = getattr(scene, item.name)
        default = item.default if item.default is not MISSING else None
        if value is not None and not (isinstance(value, (tuple, str, int, float)) and value == default):
            kinds = ", ".join(dict.fromkeys(type(each).__name__ for each in value)) if isinstance(value, tuple) else what_is(value)
            raise ParameterError(f"`{item.name}` of the scene cannot be exported to LAMMPS: {kinds}")


def make_job(scene: Scene, name, dt, steps, scheme, lam, seed, every, units, corner, images=None) -> Job:
    _refuse_unknown(scene)
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ParameterError(f"the name of an export may contain only letters, digits and _ . + -, not {what_is(name)}")
    if dt is None:
        raise ParameterError("dt, the step size, is required to export a scene")
    step = checked_step(dt)
    scheme = scheme_of(scheme).name
    weight = checked_weight(lam)
    number_of_steps = whole_number(steps, "steps", 0)
    interval = max(1, number_of_steps // 100) if every is None else whole_number(every, "every", 1)
    system, differences = unit_system(units), Differences()
    longest = of_scene.longest_cutoff(scene)
    skin = 0.3 * longest if longest else 0.3 * system.length
    if scene.segments is not None and scene.segments.distance == "min":
        # LAMMPS lists segments by the distance of their midpoints, and misses pairs with only their nearest points in range
        skin = max(skin, 1.3 * of_scene.longest_bond(scene))
        differences.remark("the neighbour skin is large so that LAMMPS does not miss segments whose midpoints are far apart")
    # fix shardlow requires twice the cutoff and skin in every process
    narrow = min(skin, 0.1 * longest)
    integrator = choose_integrator(scene, scheme, weight, system, narrow, differences)
    skin = narrow if integrator.shardlow else skin
    styles = of_scene.atom_styles(scene, integrator.fix == "mvv/dpd")
    return Job(
        scene=scene,
        units=system,
        name=name,
        dt=step,
        steps=number_of_steps,
        every=interval,
        seed=checked_seed(seed),
        corner=_corner(scene, corner),
        integrator=integrator,
        types=of_scene.lammps_types(scene, integrator.shardlow or isinstance(scene.internal, InternalEnergy)),
        styles=styles,
        differences=differences,
        skin=skin,
        **{f"{what}s": of_scene.bonded_types(scene, what, system) for what in JOINED},  # type: ignore[arg-type]
        images=images,
    )


def _corner(scene: Scene, corner) -> np.ndarray:
    if corner is None:
        given = [term.corner for term in (*scene.sources, *scene.body_forces) if isinstance(term, (Source, PositionForce))]
        corner = given[0] if given else np.zeros(3)
    found = np.array(to_md(corner, "length", "corner"), dtype=np.float64)
    if found.shape != (3,):
        raise ParameterError(f"corner must be three lengths, not {what_is(corner)}")
    for axis, gap in scene.gaps.items():
        if gap.period is not None:
            # the box ends in the middle of the solid
            found[axis] = 0.5 * (gap.low + gap.high - gap.period)
    return found


#: Names of the files that LAMMPS writes.
DUMP = "{name}.lammpstrj"
FINAL = "data.{name}.end"


class RunCommand(NamedTuple):
    """One run command: number of steps, temperatures at both ends of its ramp (kJ/mol), and first and last step of the ramp, if there is
    one."""

    steps: int
    start: float
    stop: float
    window: tuple[int, int] | None


def run_commands(job: Job) -> list[RunCommand]:
    """The run commands for one run of the scene, whose temperature ramp may start late or end early."""
    kT, total = job.scene.kT, job.steps
    if not isinstance(kT, TemperatureRamp):
        return [RunCommand(total, kT, kT, None)]
    found = []
    if kT.first_step > 0:
        found.append(RunCommand(min(kT.first_step, total), kT.kT_start, kT.kT_start, None))
    if kT.first_step < total and kT.last_step > 0:
        found.append(RunCommand(min(kT.last_step, total) - max(kT.first_step, 0), kT.kT_start, kT.kT_end, (kT.first_step, kT.last_step)))
    if kT.last_step < total:
        found.append(RunCommand(total - max(kT.last_step, 0), kT.kT_end, kT.kT_end, None))
    return found or [RunCommand(total, kT.at(0), kT.at(0), None)]


def export_texts(job: Job) -> dict[str, str]:
    """Texts of all files, by file name."""
    scene, units, differences = job.scene, job.units, job.differences
    export = PairExport(scene, units, job.integrator.shardlow, job.name, differences)
    uses = of_scene.pair_uses(export)
    segments = segment_use(scene, units, job.bonds.rows, len(job.types), differences)
    places = of_scene.lammps_box(scene, job.corner, differences, job.images)
    eos, eos_table = eos_lines(scene, job.types, units, f"eos.{job.name}", differences)
    velocities, extra = initial_velocities(scene, job.seed, None), int(segments is not None)
    if scene.shear is not None:
        # of the beads in the box rather than of their images
        assert scene.box is not None
        turns = np.round((scene.positions[:, 1] - places[1][:, 1]) / scene.box[1, 1])
        velocities[:, 0] -= turns * rate_at(scene.shear, 0.0) * scene.box[1, 1]
    data = of_scene.data_file(scene, units, job.types, places, velocities, [getattr(job, f"{what}s") for what in JOINED], extra)
    remarks = dict(enumerate([*job.types.names, *["places of bonds"] * extra], start=1))
    title = f"{job.name}, written by openmm-dpd, units = {units.name}"
    lines = data_lines(data, title, job.styles, job.n_species, remarks=remarks)
    charges = charge_use(scene, units, list(dict.fromkeys(job.types.names)), differences)
    uses += [use for use in (charges, segments) if use is not None]
    # made before the header, which lists the differences found
    body = [*_setup(job, uses), *_runs(job, uses, eos)]
    texts = {f"in.{job.name}": [*_header(job), *body], f"data.{job.name}": list(lines)} | export.tables
    if eos_table:
        texts[f"eos.{job.name}"] = eos_table
    return {name: "\n".join(lines) + "\n" for name, lines in texts.items()}


def _header(job: Job) -> Iterator[str]:
    yield f"# {job.name}: written by openmm-dpd.  Run it in its own folder, for example: mpirun -np 16 lmp -in in.{job.name}"
    if job.units is LJ:
        yield "# Numbers are in nm, Da, ps and kJ/mol with k_B = 1, or in the reduced units of the scene"
    yield "# atom types: " + ", ".join(f"{k} = {name}" for k, name in enumerate(job.types.names, start=1))
    for text in job.differences.found:
        yield f"# DIFFERENT: {text}"
    for text in job.differences.remarks:
        yield f"# note: {text}"
    yield ""


def _boundary(job: Job) -> str:
    if job.scene.box is None:
        return "boundary s s s"
    words = ["p", "p", "p"]
    longest = of_scene.longest_cutoff(job.scene)
    for axis, gap in job.scene.gaps.items():
        words[axis] = "f"
        solid = gap.period - (gap.high - gap.low) if gap.period is not None else np.inf
        if solid < longest * (2 if job.some_stay else 1):
            job.differences.add(
                f"along {AXES[axis]} the LAMMPS box ends in the middle of the solid between the walls, which is thinner than the range of "
                "the forces: interactions across it are lost"
            )
    return f"boundary {' '.join(words)}"


def _setup(job: Job, uses: list[StyleUse]) -> Iterator[str]:
    scene, length = job.scene, job.units.length
    yield from (f"units {job.units.name}", _boundary(job), of_scene.atom_style_line(job.styles, job.n_species))
    reach, bond = max([use.cutoff for use in uses], default=0.0) + job.skin, of_scene.longest_bond(scene)
    if scene.segments is not None:
        reach += 1.1 * bond
    ghosts = max(reach, 1.5 * bond + job.skin) if len(scene.bond_pairs) or not uses else 0.0
    yield "comm_modify vel yes" + (f" cutoff {exact(ghosts / length)}" if ghosts else "")
    yield f"neighbor {exact(job.skin / length)} bin"
    yield "neigh_modify every 1 delay 0 check yes"
    if len(scene.bond_pairs):
        yield of_scene.special_line(scene, job.units)
    yield f"read_data data.{job.name}"
    for what in JOINED:
        yield from of_scene.style_lines(what, getattr(job, f"{what}s"))
    yield f"timestep {exact(job.dt / job.units.time)}"


def _runs(job: Job, uses: list[StyleUse], eos: list[str]) -> Iterator[str]:
    """Pair styles, fixes, output and runs."""
    unit = job.units.thermal_energy
    # ramps are relative to the first step, and LAMMPS has no negative steps
    first = max(0, -min((command.window[0] for command in run_commands(job) if command.window), default=0))
    for k, command in enumerate(run_commands(job)):
        yield ""
        if k == 0:
            yield from of_scene.charge_lines(job.scene, job.units, job.images is not None)
        yield from of_scene.pair_lines(uses, job.types, command.start / unit, command.stop / unit, job.seed + 1000 * k)
        if k == 0:
            yield ""
            yield from _fixes(job, eos)
            yield ""
            yield from _output(job, first)
        window = "" if command.window is None else f" start {command.window[0] + first} stop {command.window[1] + first}"
        yield f"run {command.steps}{window}"
    yield f"write_data {FINAL.format(name=job.name)} nocoeff"


def _fixes(job: Job, eos: list[str]) -> Iterator[str]:
    group = "all"
    if job.scene.segments is not None:
        group = "beads"
        yield f"group beads type 1:{len(job.types)}"
    if job.some_stay:
        assert job.scene.mobile is not None
        group = "mobile"
        yield from group_lines("mobile", job.scene.mobile) if job.scene.mobile.any() else ["group mobile empty"]
    yield from integrator_lines(job.scene, job.integrator, group)
    yield from eos
    yield from source_lines(job.scene, job.units, job.corner, job.differences)
    yield from flow_lines(job.scene, job.units, job.corner)
    if group != "all" or job.scene.shear is not None:
        yield f"compute moving {group} temp{'' if job.scene.shear is None else '/deform'}"


def _output(job: Job, first: int) -> Iterator[str]:
    computes, columns = field_columns(job.scene.internal)
    moving = job.scene.segments is not None or job.some_stay or job.scene.shear is not None
    words = "step temp press pe ke etotal vol"
    if isinstance(job.scene.internal, InternalEnergy):
        yield f"compute sums {'mobile' if job.some_stay else 'all'} dpd"
        words += " c_sums[1] c_sums[2] c_sums[4]"
    if first:
        yield f"reset_timestep {first}"
    yield from computes
    yield f"thermo_style custom {words}"
    yield "thermo_modify norm no" + (" temp moving" if moving else "")
    yield f"thermo {job.every}"
    group = "beads" if job.scene.segments is not None else "all"
    chosen = " ".join(["id type x y z ix iy iz vx vy vz", *columns])
    yield f"dump frames {group} custom {job.every} {DUMP.format(name=job.name)} {chosen}"
    yield "dump_modify frames sort id format float %.17g"
    yield ""


def field_columns(internal: Any) -> tuple[list[str], list[str]]:
    """Commands and dump columns for bead fields."""
    if isinstance(internal, InternalEnergy):
        return ["compute internal all dpd/atom"], ["c_internal[1]", "c_internal[2]", "c_internal[4]"]
    if isinstance(internal, BeadTemperatures):
        return ["compute temperature all edpd/temp/atom"], ["c_temperature"]
    if isinstance(internal, Concentrations):
        species = range(1, internal.n_species + 1)
        return [f"compute species{k} all tdpd/cc/atom {k}" for k in species], [f"c_species{k}" for k in species]
    return [], []
