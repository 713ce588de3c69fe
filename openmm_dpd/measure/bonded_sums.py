"""Energies and Laplacians of bonds, angles and dihedrals, summed in double precision."""

import numpy as np

from ..plan.plan import Plan


def bond_sums(plan: Plan, x: np.ndarray, box: np.ndarray | None, mobile: np.ndarray) -> tuple[float, float]:
    """Energy and Laplacian of all bonds at the positions x; the Laplacian is U'' + 2U'/r per bond and mobile bead."""
    energy = laplacian = 0.0
    for bonds in plan.scene.bonds:
        r = bonds.lengths(x, box)
        u, slope, curvature = bonds.curve(r)
        energy += float(np.sum(u))
        ends = mobile[bonds.pairs].sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            laplacian += float(np.sum(ends * np.where(r > 1e-10, curvature + 2 * slope / r, 0.0)))
    return energy, laplacian


def angle_sums(plan: Plan, x: np.ndarray, box: np.ndarray | None, mobile: np.ndarray) -> tuple[float, float]:
    """Energy and Laplacian of all angles at the positions x.  With the arms a and b, the gradient of theta has the squares 1/a^2 and 1/b^2
    at the ends and 1/a^2 + 1/b^2 - 2 cos(theta)/(ab) at the vertex, its Laplacians are cot(theta)/a^2, cot(theta)/b^2 and cot(theta) (1/a^2
    + 1/b^2) - 2/(ab sin(theta))."""
    energy = laplacian = 0.0
    for angles in plan.scene.angles:
        theta, a, b = angles.arms(x, box)
        u, slope, curvature = angles.curve(theta)
        energy += float(np.sum(u))
        weights = mobile[angles.triples].astype(float)
        with np.errstate(divide="ignore", invalid="ignore"):
            cosine, sine = np.cos(theta), np.maximum(np.sin(theta), 1e-8)
            squares = np.stack([1 / a**2, 1 / a**2 + 1 / b**2 - 2 * cosine / (a * b), 1 / b**2], axis=1)
            seconds = np.stack([cosine / a**2, cosine * (1 / a**2 + 1 / b**2) - 2 / (a * b), cosine / b**2], axis=1) / sine[:, None]
            each = np.sum(weights * (curvature[:, None] * squares + slope[:, None] * seconds), axis=1)
        laplacian += float(np.sum(np.where(np.minimum(a, b) > 1e-10, each, 0.0)))
    return energy, laplacian


def dihedral_sums(plan: Plan, x: np.ndarray, box: np.ndarray | None, mobile: np.ndarray) -> tuple[float, float]:
    """Energy and Laplacian of all dihedrals at the positions x; their virial is 0.  The angle has no Laplacian with respect to any of its
    beads, so that of the energy is U'' times the squares of the gradients."""
    energy = laplacian = 0.0
    for dihedrals in plan.scene.dihedrals:
        phi, gradients, _ = dihedrals.gradients(x, box)
        u, _, curvature = dihedrals.curve(phi)
        energy += float(np.sum(u))
        laplacian += float(np.sum(curvature * np.sum(mobile[dihedrals.quads] * np.sum(gradients**2, axis=2), axis=1)))
    return energy, laplacian
