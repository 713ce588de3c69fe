"""The conservative DPD force as a CustomNonbondedForce: U = A rc (1 - r/rc)^2 / 2 for r < rc, zero at the cutoff."""

from __future__ import annotations

from collections.abc import Mapping

from .expressions import PairExpression, parameters, type_pairs


def dpd_expression(table: Mapping, names: list[str]) -> PairExpression:
    """Expression of one table of coefficients with A and cutoff."""
    text, functions = parameters(
        {
            "A": type_pairs(table, names, lambda c: c.A, 0.0),
            "rc": type_pairs(table, names, lambda c: c.cutoff, 1.0),
        }
    )
    return PairExpression(
        name="DPD conservative",
        energy=f"step(rc-r)*0.5*A*rc*(1-r/rc)^2{text}",
        virial=f"step(rc-r)*A*r*(1-r/rc){text}",
        cutoff=max(c.cutoff for c in table.values()),
        functions=functions,
        skips_coincident=True,
    )
