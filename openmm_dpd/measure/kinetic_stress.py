"""The kinetic part of stress tensors and pressures, of the right mean where velocities at full steps are too cold or too hot."""

from fractions import Fraction

import numpy as np

from ..kernels.motion import second_moments
from ..model.schemes import SWEEPS, Letter, Scheme


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
