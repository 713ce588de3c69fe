"""Smeared charges in the pair kernel: the energies and forces of :mod:`openmm_dpd.plan.forces.electrostatics`, without OpenMM's PME.

The kernel sums over all waves up to one beyond which the relative error of the forces is the scene's tolerance, or 1e-6 if that is less.
So there is no error of a grid, and what remains is that of the cutoff in real space.
"""

import math
from collections.abc import Callable

import numpy as np

from ..kernels.charge_pairs import Quintics
from ..kernels.charges import ChargeTerms, cost, pme_cost
from ..kernels.elementary import erfc, exp
from ..model.electrostatics import EwaldSum, SlaterCharges, SmearedCharges, erf_series, short_series, without_last_digits
from ..model.point_charges import PointCharges
from ..model.scene import Scene
from .pair_spec import Factors

#: Largest relative error of forces for lack of the waves beyond the last one.
LARGEST_ERROR = 1e-6
#: Largest errors of the polynomials, in units of the steepness, and of their slopes, in units of its square.
VALUE_ERROR, SLOPE_ERROR = 5e-13, 1e-10
#: A function of an array of distances: its values, first and second derivatives.
Radial = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


def charge_terms(scene: Scene, ewald: EwaldSum | None, exceptions: Factors) -> ChargeTerms | None:
    """The kernel's form of the charges of a scene, from ``Scene.ewald`` and ``Plan.charge_exceptions``; None if it has none."""
    charges = scene.electrostatics
    if charges is None or scene.charges is None:
        return None
    beads = np.flatnonzero(scene.charges).astype(np.int64)
    number = {int(bead): k for k, bead in enumerate(beads)}
    bonded = {(number[i], number[j]): f for (i, j), f in sorted(exceptions.items()) if i in number and j in number and f != 1.0}
    bare, soft2 = float(isinstance(charges, PointCharges)), -1.0
    if isinstance(charges, PointCharges) and charges.soft:
        bare, soft2, whole = charges.strength, charges.softness**2, Quintics(np.eye(1, 6), 1.0)
    elif isinstance(charges, PointCharges):
        whole = _without_point(charges.screening, 0.0, 1.0 if ewald is None else ewald.cutoff)
    else:
        whole = quintics(_whole(charges), charges.reach(1e-17), charges.steepness)
    if ewald is None or ewald.alpha == 0.0:
        short, cutoff, alpha, k_max = whole, math.inf if ewald is None else ewald.cutoff, 0.0, 0.0
    elif isinstance(charges, PointCharges):
        short, cutoff, alpha = _without_point(0.0, ewald.alpha, ewald.cutoff), ewald.cutoff, ewald.alpha
        if charges.soft:
            short = quintics(lambda r: _error_function(alpha, r), cutoff, alpha)
        k_max = longest_wave(alpha, min(charges.tolerance, LARGEST_ERROR))
    else:
        short, cutoff, alpha = quintics(_difference(charges, ewald), ewald.cutoff, charges.steepness), ewald.cutoff, ewald.alpha
        k_max = longest_wave(alpha, min(charges.tolerance, LARGEST_ERROR))
    q, constant = scene.charges[beads].astype(np.float64), charges.coulomb(scene.initial_kT)
    pairs, factors = np.array(list(bonded), np.int64).reshape(-1, 2), np.array(list(bonded.values()), np.float64)
    return ChargeTerms(beads, q, constant, short, cutoff, alpha, k_max, whole, pairs, factors, bare, soft2)


def few_charges(scene: Scene) -> bool:
    """Whether the kernel's direct sum over waves takes less time than OpenMM's PME."""
    if scene.electrostatics is None or scene.charges is None:
        return False
    count, ewald = int(np.count_nonzero(scene.charges)), scene.ewald
    if ewald is None or ewald.alpha == 0.0:
        return count < 2000
    k_max = longest_wave(ewald.alpha, min(scene.electrostatics.tolerance, LARGEST_ERROR))
    return cost(count, scene.box, k_max, ewald.cutoff) < pme_cost(ewald.grid, scene.n_beads)


def longest_wave(alpha: float, error: float) -> float:
    """Wave vector (1/nm) up to which the waves make a relative error of forces that is no larger: exp(-k^2/(4 alpha^2)) = error.  The
    forces of charges without order have the error sqrt(alpha/k) exp(-k^2/(4 alpha^2)) or less."""
    return without_last_digits(2.0 * alpha * math.sqrt(-math.log(error)))


def quintics(function: Radial, end: float, steepness: float) -> Quintics:
    """A function as piecewise polynomials up to the distance ``end``, with as many pieces as their largest errors take."""
    pieces = 32
    while True:
        pieces += pieces // 4
        found = Quintics.of(*function(np.linspace(0.0, end, pieces + 1)), end)
        worst = [0.0, 0.0]
        for part in (0.25, 0.5, 0.75):
            powers = part ** np.arange(6)
            slopes = np.concatenate([[0.0], np.arange(1, 6) * powers[:-1]]) * found.per_length
            value, slope, _ = function((np.arange(pieces) + part) / found.per_length)
            worst[0] = max(worst[0], float(np.abs(found.coefficients @ powers - value).max()) / steepness)
            worst[1] = max(worst[1], float(np.abs(found.coefficients @ slopes - slope).max()) / steepness**2)
        if (worst[0] < VALUE_ERROR and worst[1] < SLOPE_ERROR) or pieces > 10_000:
            return found


def _without_point(screening: float, alpha: float, end: float) -> Quintics:
    """What point charges have up to the distance ``end`` beside 1/r: -erf(alpha r)/r, or (exp(-screening r) - 1)/r, or nothing."""
    if alpha:
        series, scale = -erf_series(alpha, 1.0 / alpha), 1.0 / alpha
    elif screening:
        scale = 1.0 / screening
        series = np.array([(-1.0) ** n / math.factorial(n) for n in range(1, 25)]) / scale
    else:
        return Quintics(np.zeros((1, 6)), end)

    def outer(r):
        if alpha:
            value, slope, curvature = _error_function(alpha, r)
            return _over_r(r, value - 1.0, slope, curvature)
        e = exp(-screening * r)
        return _over_r(r, e - 1.0, -screening * e, screening**2 * e)

    return quintics(_joined(series, scale, outer), end, 1.0 / scale)


def _joined(series: np.ndarray, scale: float, outer: Radial) -> Radial:
    """The function that is a power series in r/scale below ``scale``, and the formula ``outer`` above."""
    slopes = np.polynomial.polynomial.polyder(series) / scale
    curvatures = np.polynomial.polynomial.polyder(slopes) / scale

    def function(r):
        near, far = np.minimum(r, scale) / scale, outer(np.maximum(r, scale))
        rows = (np.polynomial.polynomial.polyval(near, part) for part in (series, slopes, curvatures))
        return tuple(np.where(r < scale, inner, beyond) for inner, beyond in zip(rows, far, strict=True))

    return function


def _over_r(r, g, g1, g2):
    """g/r and its two derivatives from g and its two derivatives."""
    value = g / r
    slope = (g1 - value) / r
    return value, slope, (g2 - 2 * slope) / r


def _error_function(steepness: float, r):
    """erfc(steepness r) and its two derivatives."""
    slope = -2 * steepness / math.sqrt(math.pi) * exp(-((steepness * r) ** 2))
    return erfc(steepness * r), slope, -2 * steepness**2 * r * slope


def _cloud(charges: SmearedCharges, r):
    """1 - r s(r) and its two derivatives, s(r) the potential of two smeared unit charges."""
    k = charges.steepness
    if not isinstance(charges, SlaterCharges):
        return _error_function(k, r)
    e = exp(-2 * k * r)
    return (1 + k * r) * e, -k * (1 + 2 * k * r) * e, 4 * k**3 * r * e


def _whole(charges: SmearedCharges) -> Radial:
    """The potential s(r) of two smeared unit charges, a series near r = 0."""
    scale = 1.0 / charges.steepness

    def outer(r):
        cloud, slope, curvature = _cloud(charges, r)
        return _over_r(r, 1 - cloud, -slope, -curvature)

    return _joined(charges.series(scale), scale, outer)


def _difference(charges: SmearedCharges, ewald: EwaldSum) -> Radial:
    """The real-space part s(r) - erf(alpha r)/r, computed without differences of nearly equal numbers."""
    scale = min(1.0 / charges.steepness, 1.0 / ewald.alpha, ewald.cutoff)

    def outer(r):
        rows = zip(_error_function(ewald.alpha, r), _cloud(charges, r), strict=True)
        return _over_r(r, *(image - cloud for image, cloud in rows))

    return _joined(short_series(charges, ewald.alpha, scale), scale, outer)
