"""Isothermal DPD, and many-body DPD."""

import numpy as np

from ...base.geometry import coincident_pairs
from ...kernels.dpd import TermTable
from ...kernels.manybody import ManyBodyTable
from ...model.mdpd import MDPD, check_many_body, why_no_openmm_force
from ...model.pairs import DPD, NONE
from ...model.scene import Scene
from ..choices import listed
from ..forces.expressions import attraction_expression, density_force, dpd_expression
from .record import BeadData, Kind, Resolved, register, symmetric_arrays


def _fixed_sigma(c: DPD) -> bool:
    return c.sigma is not None and c.gamma is None


def _terms(table: Resolved, beads: BeadData) -> TermTable:
    fixed = {"gamma": lambda c: np.nan if _fixed_sigma(c) else c.gamma or 0.0, "sigma": lambda c: c.sigma if _fixed_sigma(c) else np.nan}
    return TermTable(**symmetric_arrays(table, beads.names, "A gamma_perp exponent exponent_perp cutoff", **fixed))


def _why_not_native(c: DPD) -> str | None:
    if c.gamma is None and c.sigma:
        return "sigma is fixed, and it keeps gamma fixed"
    if c.gamma_perp:
        return "there is transverse friction"
    if c.exponent != 1.0 and c.gamma:
        return f"the noise exponent is {c.exponent:g}, and it only knows 1"
    return None


def _frictions(c: DPD, kT: float) -> list[tuple[float, float]]:
    """Along the line of centres, and in the two directions across."""
    gamma = (c.sigma or 0.0) ** 2 / (2 * kT) if c.gamma is None else c.gamma
    return [(gamma, c.exponent), (2.0 * c.gamma_perp, c.exponent_perp)]


def on_device(table: TermTable) -> dict[str, np.ndarray]:
    fixed = np.isnan(table.gamma)  # then the device's sigma is not negative
    friction = {"gamma": np.where(fixed, 0.0, table.gamma), "sigma": np.where(fixed, table.sigma, -1.0), "gammaAcross": table.gamma_perp}
    return friction | {"A": table.A, "exponent": table.exponent, "exponentAcross": table.exponent_perp, "cutoff": table.cutoff}


register(
    Kind(
        coefficient=DPD,
        terms=_terms,
        potential=dpd_expression,
        why_not_native=_why_not_native,
        has_stress=True,
        beside_atoms=True,
        thermostat=True,
        frictions=_frictions,
        device=on_device,
    )
)


def _many_body_terms(table: Resolved, beads: BeadData) -> ManyBodyTable:
    arrays = symmetric_arrays(table, beads.names, "A B gamma cutoff cutoff_B cutoff_density")
    return ManyBodyTable(**arrays, lucy=check_many_body(table).kernel == "lucy", mass=beads.masses.copy())


def _many_body_on_device(table: ManyBodyTable) -> dict[str, np.ndarray]:
    one = np.ones_like(table.A)
    plain = TermTable(table.A, table.gamma, np.full_like(one, np.nan), 0 * one, one, one, table.cutoff)
    many = {"B": table.B, "cutoffB": table.cutoff_B, "cutoffDensity": table.cutoff_density}
    return on_device(plain) | many | {"densityWeights": table.mass if table.lucy else np.zeros(0)}


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
        terms=_many_body_terms,
        potential=attraction_expression,
        density_force=density_force,
        why_kernel_only=_why_kernel_only,
        why_no_laplacian=_why_no_potential,
        why_no_potential=_why_no_potential,
        has_stress=True,
        has_densities=True,
        device=_many_body_on_device,
    )
)
