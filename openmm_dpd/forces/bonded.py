"""Bonds."""

from __future__ import annotations

from collections.abc import Sequence

import openmm

from ..model.bonds import HarmonicBonds


def harmonic_bond_force(bonds: Sequence[HarmonicBonds], periodic: bool) -> openmm.HarmonicBondForce:
    """HarmonicBondForce of U = k (r - r0)^2; OpenMM's own constant is 2k."""
    force = openmm.HarmonicBondForce()
    force.setName("harmonic bonds")
    for group in bonds:
        for (i, j), k, r0 in zip(group.pairs.tolist(), group.k.tolist(), group.r0.tolist(), strict=True):
            force.addBond(i, j, r0, 2 * k)
    force.setUsesPeriodicBoundaryConditions(periodic)
    return force
