"""Many-body liquids in the dimensionless groups of their table of steps: friction, and stiffness at the density that they choose."""

import json
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from ...model.scene import Scene
from ...plan.kinds import kind_for
from .stability_table import Groups, StabilityTable

#: Range of the repulsion, of that of the attraction, that was measured; what measures others.
RANGE = 0.75
_SCRIPT = "benchmarks/many_body.py measures steps of such liquids"


def liquid_density(a: float, b: float, reach: float = RANGE) -> float:
    """Density of the liquid at no pressure, N rc^3/V; 0 if there is none.

    Warren's equation of state, Phys. Rev. E 68, 066702 (2003): p = rho + alpha a rho^2 + 2 alpha b reach^4 (rho^3 - 4.16 rho^2 + 18),
    alpha = 0.101.

    Parameters
    ----------
    a, b : float
        A rc/kT and B/(kT rc^2), rc being the cutoff of the attraction.
    reach : float
        Cutoff of the repulsion over rc.
    """
    many = 0.202 * b * reach**4
    roots = np.roots([many, 0.101 * a - 4.16 * many, 1.0, 18.0 * many])
    return max(0.0, *(float(root.real) for root in roots if abs(root.imag) < 1e-9))


def stiffness(a: float, b: float, rho: float) -> float:
    """b rho^2: the many-body repulsion's part of omega^2 goes with it."""
    return b * rho**2


def is_many_body(scene: Scene) -> bool:
    """Whether many-body coefficients, and nothing else, act between beads."""
    return bool(scene.tables) and all(table.kind is not None and kind_for(table.kind).has_densities for table in scene.tables)


def many_body_groups(scene: Scene, moves: np.ndarray) -> tuple[list[Groups], list[str]]:
    """As :func:`~openmm_dpd.simulation.advice.scene_groups.groups`, for one liquid, with the stiffness in place of the repulsion."""
    present = {scene.type_names[k] for k in np.unique(scene.type_ids)}
    found = {c for pair, c in scene.tables[0].resolve(scene.type_names).items() if present.issuperset(pair)}
    why = None
    if len(scene.tables) > 1 or len(found) > 1:
        why = "several many-body liquids"
    elif scene.bonds or scene.angles or scene.dihedrals or scene.electrostatics is not None:
        why = "many-body beads with bonds or charges"
    if why:
        return [], [f"no steps were measured with {why}: halve the step until your results stay the same ({_SCRIPT})"]
    assert scene.box is not None
    coefficient: Any = found.pop()
    kT, mass = scene.initial_kT, float(scene.bead_masses[moves].min())
    rc, reach = coefficient.cutoff, coefficient.cutoff_B / coefficient.cutoff
    if coefficient.kernel != "quadratic" or abs(reach - RANGE) > 1e-6:
        return [], [f"many-body steps were measured only with the quadratic kernel and cutoff_B = {RANGE:g} cutoff ({_SCRIPT})"]
    if coefficient.gamma <= 0:
        return [], ["there is no friction"]
    a, b = coefficient.A * rc / kT, coefficient.B / (kT * rc**2)
    rho = max(liquid_density(a, b), scene.n_beads * rc**3 / float(np.prod(np.diag(scene.box))))
    ratio = float(scene.bead_masses[moves].max()) / mass
    reduced = coefficient.gamma * rc / (mass * kT) ** 0.5
    return [Groups(reduced, stiffness(a, b, rho), mass=ratio, unit_time=rc * (mass / kT) ** 0.5)], []


@lru_cache(maxsize=1)
def shipped_many_body() -> StabilityTable:
    """The table that comes with the package."""
    return StabilityTable(json.loads(files(__package__).joinpath("many_body.json").read_text()))
