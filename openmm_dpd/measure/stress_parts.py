"""Parts of stresses and energies beside the pair terms: bonded terms, overlays, charges and motion.

OpenMM has no virials of single forces, and single precision on most platforms; so the kernels do the sums, also of OpenMM's forces.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..base.geometry import AXES_OF_TENSOR, minimum_images, symmetric_products
from ..kernels.charges import ChargeEvaluator
from ..kernels.extras import Extra, warm_up_extras
from ..kernels.motion import moments
from ..model.angles import Torsions
from ..model.schemes import SWEEPS, Letter, Scheme
from ..plan.charge_forces import charge_terms
from ..plan.pair_spec import extras
from ..plan.plan import Plan

#: (x, box) -> (6,) sums of r F (xx, yy, zz, xy, xz, yz; kJ/mol).
Part = Callable[[np.ndarray, np.ndarray | None], np.ndarray]


def stress_parts(plan: Plan) -> list[Part]:
    """Stress functions of bonds and angles, overlays and segments.  Forces on single beads have none."""
    found = beside_pairs(plan)
    return [BondedStress(extra) if extra.term == "bond" else extra.evaluator().stress for extra in found]  # type: ignore[attr-defined]


def beside_pairs(plan: Plan) -> list[Extra]:
    """Kernels of bonds and angles, overlays and segments, compiled."""
    found = [extra for extra in extras(plan.scene, plan.overlays, plan.exceptions) if extra.term != "external"]
    warm_up_extras(found)
    return found


def charge_evaluator(plan: Plan) -> ChargeEvaluator | None:
    """Evaluator of energies and stress of the charges; None without charges."""
    terms = charge_terms(plan.scene, plan.scene.ewald, plan.charge_exceptions)
    warm_up_extras([] if terms is None else [terms])
    return None if terms is None else terms.evaluator()


class BondedStress:
    """Stress of bonded terms of any kind, from their forces alone: each term acts on its own copies of its beads, each of which is the
    minimum image with respect to the bead before it, or to the first one."""

    def __init__(self, terms: Any):
        name = fields(terms)[0].name
        self._beads, self._around = (beads := getattr(terms, name)), getattr(terms, "around", False)
        self._alone = replace(terms, **{name: np.arange(beads.size, dtype=beads.dtype).reshape(beads.shape)}).evaluator()

    def __call__(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """(6,) sums of r F (xx, yy, zz, xy, xz, yz) at positions x (N, 3), kJ/mol."""
        r, force = self._pulls(x, box)
        return symmetric_products(r.reshape(-1, 3), force.reshape(-1, 3))

    def each(self, x: np.ndarray, box: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Beads (T, 2), (T, 3) or (T, 4) of each term, and its own sums (T, 6)."""
        products = np.einsum("tka,tkb->tab", *self._pulls(x, box))
        return self._beads, np.stack([products[:, a, b] for a, b in AXES_OF_TENSOR], axis=1)

    def lines(self, x: np.ndarray, box: np.ndarray | None) -> list[tuple[np.ndarray, np.ndarray]]:
        """Beads (T, 2) and sums (T, 6) of the central forces between beads of which terms of two or three beads are made.

        For three beads they are unique: the derivatives of the energy by the three distances (N. C. Admal and E. B. Tadmor, J. Elasticity
        100, 63 (2010)).  With r and s from the first bead to the others, the force on the second is p r + q (r - s), on the third
        t s + q (s - r)."""
        if self._beads.shape[1] == 2:
            return [self.each(x, box)]
        r, force = self._pulls(x, box)
        parts = np.linalg.pinv(r @ r.transpose(0, 2, 1), rcond=1e-14, hermitian=True) @ (r @ force.transpose(0, 2, 1))  # of r, s; by bead
        q = -0.5 * (parts[:, 1, 0] + parts[:, 0, 1])
        ends = ((0, 1), r[:, 0], parts[:, 0, 0] - q), ((0, 2), r[:, 1], parts[:, 1, 1] - q), ((1, 2), r[:, 0] - r[:, 1], q)
        return [(self._beads[:, pair], np.stack([pull * d[:, a] * d[:, b] for a, b in AXES_OF_TENSOR], axis=1)) for pair, d, pull in ends]

    def _pulls(self, x: np.ndarray, box: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """For each term: its beads relative to the first one, and the forces on them."""
        copies, force = x[self._beads], np.zeros((self._beads.size, 3))
        self._alone.add_to(copies.reshape(-1, 3), box, force, 1.0)
        steps = copies[:, 1:] - copies[:, :1] if self._around else np.diff(copies, axis=1)
        steps = minimum_images(steps.reshape(-1, 3), box).reshape(steps.shape)
        return steps if self._around else np.cumsum(steps, axis=1), force.reshape(copies.shape)[:, 1:]


def bond_sums(plan: Plan, x: np.ndarray, box: np.ndarray | None, mobile: np.ndarray) -> tuple[float, float]:
    """Energy and Laplacian of all bonds at positions x; the Laplacian is U'' + 2U'/r per bond and mobile bead."""
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
    """Energy and Laplacian of all angles at positions x.  With arms of lengths a and b, the squared gradients of theta are 1/a^2 and 1/b^2
    at the ends, 1/a^2 + 1/b^2 - 2 cos(theta)/(ab) at the vertex; its Laplacians are cot(theta)/a^2, cot(theta)/b^2 and, at the vertex,
    cot(theta) (1/a^2 + 1/b^2) - 2/(ab sin(theta))."""
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


def torsion_sums(groups: Sequence[Torsions], x: np.ndarray, box: np.ndarray | None, mobile: np.ndarray) -> tuple[float, float]:
    """Energy and Laplacian of dihedrals or impropers at positions x; their virial is 0.  The Laplacian of the energy is U'' times the
    squared gradients of the angle, and U' times its Laplacians, which are 0 for dihedrals."""
    energy = laplacian = 0.0
    for group in groups:
        phi, gradients, _ = group.gradients(x, box)
        u, slope, curvature = group.curve(phi)
        energy += float(np.sum(u))
        seconds = curvature[:, None] * np.sum(gradients**2, axis=2) + slope[:, None] * group.laplacians(x, box)
        laplacian += float(np.sum(mobile[group.quads] * seconds))
    return energy, laplacian


def kinetic_deficit(scheme: Scheme) -> float:
    """Deficit of <m v^2> for velocities at whole steps, in units of dt^2 <F^2/m>, by the scheme.

    A sweep thermostats the velocities at its place in the word; a harmonic bond shows, to second order in the step, what those at whole
    steps have.  One step is then a linear map that, started at any letter of the word, conserves a quadratic form.  The weight of v^2 in it
    is 1 - (omega dt)^2 times the sum of a b a' over all drifts a, kicks b and drifts a' in this order.  The deficit is the difference
    between the sums started at the sweeps and at whole steps: 1/4 for ``middle``, -1/4 for ``aboba``, whose velocities are too hot, 0 for
    ``bababo`` and ``shardlow``, which sweep at whole steps.  It holds at any friction if the letters on both sides of a sweep mirror each
    other, else at weak friction.  Where friction is a force (``mvv``) it is 0.
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
    deficit: float,
    mass: np.ndarray,
    v: np.ndarray,
    force: np.ndarray | None,
    dt: float,
    inv_mass: np.ndarray,
    product: Callable = lambda weights, vectors: moments(weights, vectors)[:6],
):
    r"""Kinetic part of the stress.

    .. math:: \mathbf K = \sum m \mathbf v \mathbf v + c\, \Delta t^2 \sum \mathbf F \mathbf F/m

    with c from :func:`kinetic_deficit`.  For ``middle``, c = 1/4, it is the mean over the half steps before and after, as in leapfrog
    programs, and exactly kT in each direction for a harmonic bond.

    ``deficit`` is c; ``mass`` (N,) in Da; ``v`` (N, 3) the velocities at the time of the positions, nm/ps; ``force`` (N, 3) the
    conservative forces there, kJ/mol/nm (None only if c is 0); ``dt`` in ps; ``inv_mass`` (N,) is 0 for immobile beads.  ``product``
    combines m and v, and 1/m and F: by default into (6,) sums xx, yy, zz, xy, xz, yz, kJ/mol.
    """
    stress = product(mass, v)
    return stress if not deficit or force is None else stress + deficit * dt**2 * product(inv_mass, force)


def needs_forces(scheme: Scheme) -> bool:
    """Whether the velocities at the time of the positions, or the kinetic stress, depend on forces."""
    return scheme.lag != 0.0 or kinetic_deficit(scheme) != 0.0
