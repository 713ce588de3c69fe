"""Parts of stresses and energies beside the pair terms: bonded terms, overlays, charges and motion.

OpenMM has no virials of single forces, and on most platforms single precision: the kernels sum, whoever computes the forces in the run.
"""

from collections.abc import Callable
from dataclasses import fields, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..base.geometry import minimum_images, symmetric_products
from ..kernels.charges import ChargeEvaluator
from ..kernels.extras import warm_up_extras
from ..kernels.motion import second_moments
from ..model.schemes import SWEEPS, Letter, Scheme
from ..plan.charge_forces import charge_terms
from ..plan.pair_spec import extras
from ..plan.plan import Plan

#: (x, box) -> (6,) sums of r F (xx, yy, zz, xy, xz, yz; kJ/mol).
Part = Callable[[np.ndarray, np.ndarray | None], np.ndarray]


def stress_parts(plan: Plan) -> list[Part]:
    """Of bonds and angles, overlays and segments.  Forces on single beads have none."""
    found = [extra for extra in extras(plan.scene, plan.overlays, plan.exceptions) if extra.term != "external"]
    warm_up_extras(found)
    return [BondedStress(extra) if extra.term == "bond" else extra.evaluator().stress for extra in found]  # type: ignore[attr-defined]


def charge_evaluator(plan: Plan) -> ChargeEvaluator | None:
    """What gives energies and stress of the charges; None if there are none."""
    terms = charge_terms(plan.scene, plan.scene.ewald, plan.charge_exceptions)
    warm_up_extras([] if terms is None else [terms])
    return None if terms is None else terms.evaluator()


class BondedStress:
    """Of bonded terms of any kind, from their forces alone: each term acts on copies of its beads that belong to no other.  Each bead of a
    term is next to the one before it by minimum image."""

    def __init__(self, terms: Any):
        name = fields(terms)[0].name
        self._beads = beads = getattr(terms, name)
        self._alone = replace(terms, **{name: np.arange(beads.size, dtype=beads.dtype).reshape(beads.shape)}).evaluator()

    def __call__(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """(6,) sums of r F at the positions x."""
        copies, force = x[self._beads], np.zeros((self._beads.size, 3))
        self._alone.add_to(copies.reshape(-1, 3), box, force, 1.0)
        steps = minimum_images(np.diff(copies, axis=1).reshape(-1, 3), box).reshape(len(copies), -1, 3)
        return symmetric_products(np.cumsum(steps, axis=1).reshape(-1, 3), force.reshape(copies.shape)[:, 1:].reshape(-1, 3))


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


def kinetic_deficit(scheme: Scheme) -> float:
    """What velocities of the moment of the positions lack in <m v^2>, in units of dt^2 <F^2/m>.

    A sweep sets the temperature of the velocities that it is shown; to second order in the step a harmonic bond says what those of whole
    steps have.  One step is a linear map there, and read from any place of the word it conserves a quadratic form, in which the weight of
    v^2 goes with how far a velocity drifts in a step: 1 - (omega dt)^2 times the sum of a b a' over all drifts a, kicks b and drifts a' in
    this order.  This is the difference of these sums, read from the sweeps and from whole steps: 1/4 for ``middle``, -1/4 for ``aboba``,
    whose velocities are too hot, 0 for ``bababo`` and ``shardlow``, which sweep at whole steps.  It holds at any friction where the letters
    on both sides of a sweep mirror each other, else at weak friction.  Where friction is a force (``mvv``) velocities of whole steps are
    taken as they are.
    """
    letters = scheme.motion
    places = [(n, part) for n, (name, part) in enumerate(letters) if name in SWEEPS]
    swept = sum((part * _drift_kick_drift(letters[n:] + letters[:n]) for n, part in places), Fraction(0))
    return float(swept - _drift_kick_drift(letters)) if places else 0.0


def _drift_kick_drift(letters: tuple[Letter, ...]) -> Fraction:
    """The sum of a b a' over drifts a, kicks b and drifts a' in this order."""
    drifted, kicked, found = Fraction(0), Fraction(0), Fraction(0)
    for name, part in letters:
        if name == "A":
            found += kicked * part
            drifted += part
        elif name == "B":
            kicked += drifted * part
    return found


def kinetic_stress(
    deficit: float, mass: np.ndarray, v: np.ndarray, force: np.ndarray | None, dt: float, inv_mass: np.ndarray, product=second_moments
):
    r"""Kinetic part of the stress.

    .. math:: \mathbf K = \sum m \mathbf v \mathbf v + c\, \Delta t^2 \sum \mathbf F \mathbf F/m

    with c from :func:`kinetic_deficit`.  For ``middle``, c = 1/4, it is the mean over the half steps before and after, as leapfrog programs
    have it, and of a harmonic bond exactly kT in each direction.

    ``deficit`` is c; ``mass`` (N,) in Da; ``v`` (N, 3) the velocities of the moment of the positions, nm/ps; ``force`` (N, 3) the
    conservative forces there, kJ/mol/nm, None only where c is 0; ``dt`` in ps; ``inv_mass`` (N,) is 0 where there is none.  ``product``
    says what is made of m and v, and of 1/m and F: by default (6,) sums xx, yy, zz, xy, xz, yz, kJ/mol.
    """
    stress = product(mass, v)
    return stress if not deficit or force is None else stress + deficit * dt**2 * product(inv_mass, force)


def needs_forces(scheme: Scheme) -> bool:
    """Whether velocities of the positions' moment, or this, depend on forces."""
    return scheme.lag != 0.0 or kinetic_deficit(scheme) != 0.0
