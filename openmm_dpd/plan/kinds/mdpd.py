"""Many-body DPD."""

from ...base.neighbours import coincident_pairs
from ...kernels.manybody import ManyBodyTable
from ...model.mdpd import MDPD, check_many_body, why_no_openmm_force
from ...model.pairs import NONE
from ...model.scene import Scene
from ..forces.manybody import attraction_expression, density_force
from ..neighbour_list import listed
from .record import BeadData, Kind, Resolved, register, symmetric_arrays


def _terms(table: Resolved, beads: BeadData) -> ManyBodyTable:
    arrays = symmetric_arrays(table, beads.names, "A B gamma cutoff cutoff_B cutoff_density")
    return ManyBodyTable(**arrays, lucy=check_many_body(table).kernel == "lucy", mass=beads.masses.copy())


def _why_kernel_only(table: Resolved, scene: Scene, exceptions: dict[tuple[int, int], float], platform: str | None) -> str | None:
    close = coincident_pairs(scene.positions, scene.box, 1e-4 * max(c.cutoff for c in table.values()))
    reason = why_no_openmm_force(table, exceptions, close)
    # the only force here that cannot do without a neighbour list
    if reason is None and not listed(platform, scene.box, max(c.cutoff_B for c in table.values() if c is not NONE)):
        return "in this box, small and tilted, the Reference platform can miss pairs of densities; use the kernel or the CPU"
    return reason


def _why_no_potential(table: Resolved) -> str | None:
    return "the many-body force of the Lucy kernel derives from no potential" if check_many_body(table).kernel == "lucy" else None


register(
    Kind(
        coefficient=MDPD,
        terms=_terms,
        potential=attraction_expression,
        density_force=density_force,
        why_kernel_only=_why_kernel_only,
        why_no_laplacian=_why_no_potential,
        why_no_potential=_why_no_potential,
        has_stress=True,
        has_densities=True,
    )
)
