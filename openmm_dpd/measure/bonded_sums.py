"""Energies, virials, stress tensors and Laplacians of bonds, angles and dihedrals, summed in double precision."""

import numpy as np

from ..geometry import minimum_images, symmetric_products
from ..plan import Plan


def bond_sums(plan: Plan, x: np.ndarray, box: np.ndarray | None, mobile: np.ndarray) -> tuple[float, float, float]:
    """Energy, virial and Laplacian of all bonds at the positions x.

    The virial is -r U'; the Laplacian is U'' + 2U'/r per bond and mobile bead.
    """
    energy = virial = laplacian = 0.0
    for bonds in plan.scene.bonds:
        r = bonds.lengths(x, box)
        u, slope, curvature = bonds.curve(r)
        energy += float(np.sum(u))
        virial -= float(np.sum(slope * r))
        ends = mobile[bonds.pairs].sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            laplacian += float(np.sum(ends * np.where(r > 1e-10, curvature + 2 * slope / r, 0.0)))
    return energy, virial, laplacian


def angle_sums(plan: Plan, x: np.ndarray, box: np.ndarray | None, mobile: np.ndarray) -> tuple[float, float]:
    """Energy and Laplacian of all angles at the positions x; their virial is 0, since angles do not change when all lengths do.

    With the arms a and b, the gradient of theta has the squares 1/a^2 and 1/b^2 at the ends and 1/a^2 + 1/b^2 - 2 cos(theta)/(ab) at the
    vertex, its Laplacians are cot(theta)/a^2, cot(theta)/b^2 and cot(theta) (1/a^2 + 1/b^2) - 2/(ab sin(theta)).
    """
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
    """Energy and Laplacian of all dihedrals at the positions x; their virial is 0.

    The angle has no Laplacian with respect to any of its beads, so that of the energy is U'' times the squares of the gradients.
    """
    energy = laplacian = 0.0
    for dihedrals in plan.scene.dihedrals:
        phi, gradients, _ = dihedrals.gradients(x, box)
        u, _, curvature = dihedrals.curve(phi)
        energy += float(np.sum(u))
        laplacian += float(np.sum(curvature * np.sum(mobile[dihedrals.quads] * np.sum(gradients**2, axis=2), axis=1)))
    return energy, laplacian


def bonded_stress(plan: Plan, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """(6,) sum over all bonds, angles and dihedrals of r F at the positions x: xx, yy, zz, xy, xz, yz, kJ/mol.

    A bond of the vector r has -U'/r times the product of r with itself.  An angle has the products of its arms with the forces on its
    ends, which with their directions a and b are U'/sin(theta) times ab + ba - cos(theta) (aa + bb); its trace is 0.  So is that of a
    dihedral, where vectors to the beads are multiplied by -U' and the gradients.
    """
    stress = np.zeros(6)
    for bonds in plan.scene.bonds:
        d = minimum_images(x[bonds.pairs[:, 0]] - x[bonds.pairs[:, 1]], box)
        r = np.linalg.norm(d, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            pull = np.where(r > 1e-10, -bonds.curve(r)[1] / r, 0.0)
        stress += symmetric_products(d, pull[:, None] * d)
    for angles in plan.scene.angles:
        theta, *lengths = angles.arms(x, box)
        i, j, k = angles.triples.T
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (minimum_images(x[end] - x[j], box) / long[:, None] for end, long in zip((i, k), lengths, strict=True))
            pull = angles.curve(theta)[1] / np.maximum(np.sin(theta), 1e-8)
        near = np.minimum(*lengths) <= 1e-10
        a[near], b[near] = 0.0, 0.0
        cosine = np.cos(theta)[:, None]
        stress += symmetric_products(pull[:, None] * a, 2 * b - cosine * a) - symmetric_products(pull[:, None] * cosine * b, b)
    for dihedrals in plan.scene.dihedrals:
        phi, gradients, arms = dihedrals.gradients(x, box)
        pulls = -dihedrals.curve(phi)[1][:, None, None] * gradients
        stress += symmetric_products(arms.reshape(-1, 3), pulls.reshape(-1, 3))
    return stress
