"""The conservative DPD force as a CustomNonbondedForce: U = A rc (1 - r/rc)^2 / 2 for r < rc, zero at the cutoff."""

from collections.abc import Mapping

from .expressions import PairExpression, radial_expression


def dpd_expression(table: Mapping, names: list[str]) -> PairExpression:
    """Expression of one table of coefficients with A and cutoff."""
    energy, virial, columns = "0.5*A*rc*(1-r/rc)^2", "A*r*(1-r/rc)", {"A": (lambda c: c.A, 0.0)}
    return radial_expression("DPD conservative", table, names, energy, virial, columns, skips_coincident=True)
