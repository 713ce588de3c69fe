"""Radial potentials that DPD thermostats are laid over: Lennard-Jones, formulas and tables."""

import numpy as np

from ...kernels.radial import FORMULA, Tables
from ...model.pairs import LennardJones, TabulatedPair
from ...model.radial import RadialPair
from ..forces.expressions import (
    energy_spline,
    formula_expression,
    formula_numbers,
    lennard_jones_expression,
    lennard_jones_shift,
    tabulated_expression,
    type_pairs,
)
from .record import Curves, Kind, Resolved, register


def _lennard_jones_curves(table: Resolved, names: list[str]) -> Curves:
    columns = (lambda c: c.epsilon, lambda c: c.sigma, lennard_jones_shift)
    values = np.stack([type_pairs(table, names, column, 0.0) for column in columns], axis=-1)
    return Curves(np.full(values.shape[:2], -1, np.int64), np.ascontiguousarray(values), Tables.of([]))


def _formula_curves(table: Resolved, names: list[str]) -> Curves:
    values = formula_numbers(table, names)
    return Curves(np.full(values.shape[:2], FORMULA, np.int64), values, Tables.of([]))


def _tabulated_curves(table: Resolved, names: list[str]) -> Curves:
    different = list({id(c): c for c in table.values() if c.cutoff > 0}.values())
    numbers = {id(c): k for k, c in enumerate(different)}
    which = type_pairs(table, names, lambda c: numbers[id(c)], -1).astype(np.int64)
    splines = [energy_spline(c) for c in different]
    return Curves(which, np.zeros((*which.shape, 3)), Tables.of([(spline.x, spline.c) for spline in splines]))


for _coefficient, _overlay, _potential in (
    (LennardJones, _lennard_jones_curves, lennard_jones_expression),
    (RadialPair, _formula_curves, formula_expression),
    (TabulatedPair, _tabulated_curves, tabulated_expression),
):
    register(
        Kind(
            coefficient=_coefficient,
            overlay=_overlay,
            potential=_potential,
            why_no_laplacian=lambda _: "a radial potential beside the pair terms has no Laplacian here",
            beside_atoms=True,
        )
    )
