"""The potential of many-body DPD with the quadratic kernel, as OpenMM forces.

The attraction is a CustomNonbondedForce.  The repulsion is a CustomGBForce: a computed value rho_i, summed over pairs, and the energy
pi B h^4 rho_i^2/30 of each bead.  With the Lucy kernel there is no potential, and the pair kernel computes the force.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import openmm

from ...model.mdpd import check_many_body
from .expressions import PairExpression, dpd_expression, type_pairs, type_table


def attraction_expression(table: Mapping, names: list[str]) -> PairExpression:
    """The attraction A cutoff w^2/2 of one table of MDPD coefficients {(type, type): MDPD or NONE}."""
    return replace(dpd_expression(table, names), name="MDPD attraction")


def density_force(
    table: Mapping, names: list[str], types: np.ndarray, exclusions: list[tuple[int, int]], periodic: bool
) -> openmm.CustomGBForce:
    """The energy sum over i of pi B h^4 rho_i^2/30, rho_i = sum over j of 15/(2 pi h^3) (1 - r/h)^2, as a CustomGBForce.  Bonded neighbours
    in ``exclusions`` do not count in each other's density.  ParameterError if the coefficients do not go together."""
    coefficient = check_many_body(table)
    h = coefficient.cutoff_B
    interacts = type_pairs(table, names, lambda c: 1.0, 0.0)
    typed = not np.all(interacts == 1.0)
    force = openmm.CustomGBForce()
    force.setName("MDPD density")
    if typed:
        force.addPerParticleParameter("type")
        force.addTabulatedFunction("interacts", type_table(interacts)())
    factor = "interacts(type1, type2)*" if typed else ""
    force.addComputedValue("rho", f"{factor}step(h-r)*{7.5 / (np.pi * h**3)!r}*(1-r/h)^2; h={h!r}", force.ParticlePair)
    force.addEnergyTerm(f"{np.pi * coefficient.B * h**4 / 30!r}*rho^2", force.SingleParticle)
    for kind in types.tolist():
        force.addParticle([kind] if typed else [])
    for i, j in exclusions:
        force.addExclusion(i, j)
    force.setNonbondedMethod(force.CutoffPeriodic if periodic else force.CutoffNonPeriodic)
    force.setCutoffDistance(h)
    return force
