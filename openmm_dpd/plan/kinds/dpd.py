"""Isothermal DPD."""

import numpy as np

from ...kernels.dpd import TermTable
from ...model.pairs import DPD
from ..forces.expressions import dpd_expression
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
    )
)
