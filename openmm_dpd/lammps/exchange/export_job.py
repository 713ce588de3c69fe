"""Choices of an export, checked."""

import re
from dataclasses import MISSING, dataclass, fields

import numpy as np

from ...choices import checked_seed
from ...errors import ParameterError
from ...model.flow import PositionForce, gaps
from ...model.internal import InternalEnergy
from ...model.scene import Scene
from ...schemes import scheme_of
from ...units import UnitSystem, to_md, unit_system, whole_number
from ..styles.writing import Differences
from .export_beads import BeadTypes, Bonded, atom_styles, lammps_types, longest_cutoff, species_of
from .export_bonded import bonded_types, longest_bond
from .export_fixes import Integrator, choose_integrator

#: What of a Scene is exported; anything else that a scene holds is an error, never left out.
_KNOWN = frozenset(
    "masses types positions pairs kT box velocities bead_masses charges bonds bonded_factors mobile molecules internal sources compat "
    "angles dihedrals segments body_forces walls electrostatics residues interacting".split()
)

_NAME = re.compile(r"[A-Za-z0-9_.+-]+")


@dataclass(frozen=True, eq=False)
class Job:
    """All choices of one export, checked."""

    scene: Scene
    units: UnitSystem
    name: str
    dt: float
    steps: int
    every: int
    seed: int
    corner: np.ndarray
    integrator: Integrator
    types: BeadTypes
    styles: tuple[str, ...]
    differences: Differences
    skin: float
    bonds: Bonded
    angles: Bonded
    dihedrals: Bonded
    images: np.ndarray | None = None

    @property
    def n_species(self) -> int:
        """Number of concentrations of each bead."""
        return species_of(self.scene)

    @property
    def some_stay(self) -> bool:
        """Whether there are beads that never move."""
        return self.scene.mobile is not None and not self.scene.mobile.all()


def _refuse_unknown(scene: Scene) -> None:
    for item in fields(scene):
        if not item.init or item.name in _KNOWN:
            continue
        value = getattr(scene, item.name)
        default = item.default if item.default is not MISSING else None
        if value is not None and not (isinstance(value, (tuple, str, int, float)) and value == default):
            raise ParameterError(f"`{item.name}` of the scene cannot be exported to LAMMPS: {value!r}")


def make_job(scene: Scene, name, dt, steps, scheme, lam, seed, every, units, corner, images=None) -> Job:
    _refuse_unknown(scene)
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ParameterError(f"the name of an export has letters, digits and _ . + - only, not {name!r}")
    if dt is None:
        raise ParameterError("dt, the step size, is missing; it is needed to export a scene")
    step = to_md(dt, "time", "dt")
    if not isinstance(step, float) or step <= 0:
        raise ParameterError(f"dt must be one time > 0, not {dt!r}")
    scheme = scheme_of(scheme).name
    weight = to_md(lam, "dimensionless", "lam")
    if not isinstance(weight, float) or not 0 <= weight <= 1:
        raise ParameterError(f"lam (lambda of the modified velocity Verlet scheme) must be between 0 and 1, but is {lam!r}")
    number_of_steps = whole_number(steps, "steps", 0)
    interval = max(1, number_of_steps // 100) if every is None else whole_number(every, "every", 1)
    system, differences = unit_system(units), Differences()
    longest = longest_cutoff(scene)
    skin = 0.3 * longest if longest else 0.3 * system.length
    if scene.segments is not None and scene.segments.distance == "min":
        # LAMMPS lists segments by the distance of their midpoints, and misses pairs whose nearest points only are in range
        skin = max(skin, 1.3 * longest_bond(scene))
        differences.remark("the neighbour skin is wide, so that LAMMPS does not miss segments whose midpoints are far apart")
    # fix shardlow wants room for twice the cutoff and the skin in every process
    narrow = min(skin, 0.1 * longest)
    integrator = choose_integrator(scene, scheme, weight, system, narrow, differences)
    skin = narrow if integrator.shardlow else skin
    styles = atom_styles(scene, integrator.fix == "mvv/dpd")
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
        types=lammps_types(scene, integrator.shardlow or isinstance(scene.internal, InternalEnergy)),
        styles=styles,
        differences=differences,
        skin=skin,
        bonds=bonded_types(scene, "bond", system),
        angles=bonded_types(scene, "angle", system),
        dihedrals=bonded_types(scene, "dihedral", system),
        images=images,
    )


def _corner(scene: Scene, corner) -> np.ndarray:
    if corner is None:
        given = [s.corner for s in scene.sources] + [t.corner for t in scene.body_forces if isinstance(t, PositionForce)]
        corner = given[0] if given else np.zeros(3)
    found = np.array(to_md(corner, "length", "corner"), dtype=np.float64)
    if found.shape != (3,):
        raise ParameterError(f"corner must be three lengths, not {corner!r}")
    for axis, gap in gaps(scene.walls, scene.box).items():
        if gap.period is not None:
            # the box ends in the middle of the solid
            found[axis] = 0.5 * (gap.low + gap.high - gap.period)
    return found
