"""Radial pair potentials given by a formula: one table of them, and the coefficient that names its row.

Every row is a sum of terms a r^-p exp(-b r - c r^2) and, for the soft repulsion, a cosine.  Kernel, OpenMM expression and derivatives are
made from these numbers (:meth:`RadialPair.numbers`), so that a row is all that a further potential needs.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import ParameterError, require, require_one
from ..base.units import keep
from .pairs import PairCoefficient, checked

#: Terms a r^-p exp(-b r - c r^2), by their a, p, b and c.
Terms = list[tuple[float, float, float, float]]


class RadialFormula(NamedTuple):
    """One potential."""

    energy: str  #: In words of mathematics
    dimensions: Mapping[str, tuple[str, str]]  #: Of its coefficients, with their bounds (see :class:`.pairs.PairCoefficient`)
    terms: Callable[..., Terms]  #: Of the coefficients, in this order
    cosine: Callable[..., float] = lambda *_: 0.0  #: Amplitude of cos(pi r/cutoff)
    smooth: bool = False  #: Whether energy and force are shifted to 0 at the cutoff


def _mie(epsilon: float, sigma: float, n: float, m: float) -> Terms:
    size = epsilon * n / (n - m) * (n / m) ** (m / (n - m))
    return [(size * sigma**n, n, 0.0, 0.0), (-size * sigma**m, m, 0.0, 0.0)]


def _morse(D: float, alpha: float, r0: float) -> Terms:
    return [(D * math.exp(2 * alpha * r0), 0.0, 2 * alpha, 0.0), (-2 * D * math.exp(alpha * r0), 0.0, alpha, 0.0)]


_LJ, _MORSE = {"epsilon": ("energy", ">= 0"), "sigma": ("length", "> 0")}, {"D": ("energy", ""), "alpha": ("inverse_length", ">= 0")}
_R0 = {"r0": ("length", ">= 0")}

#: All of them, by LAMMPS's names.
FORMULAS: dict[str, RadialFormula] = {
    "soft": RadialFormula("A [1 + cos(pi r/cutoff)]", {"A": ("energy", "")}, lambda A: [(A, 0.0, 0.0, 0.0)], lambda A: A),
    "gauss": RadialFormula("-A exp(-B r^2)", {"A": ("energy", ""), "B": ("inverse_area", ">= 0")}, lambda A, B: [(-A, 0.0, 0.0, B)]),
    "gauss/cut": RadialFormula(
        "H/(sigma sqrt(2 pi)) exp(-(r - r0)^2/(2 sigma^2))",
        {"H": ("energy*length", ""), "r0": ("length", ""), "sigma": ("length", "> 0")},
        lambda H, r0, sigma: [
            (H / (sigma * math.sqrt(2 * math.pi)) * math.exp(-0.5 * (r0 / sigma) ** 2), 0.0, -r0 / sigma**2, 0.5 / sigma**2)
        ],
    ),
    "morse": RadialFormula("D [exp(-2 alpha (r - r0)) - 2 exp(-alpha (r - r0))]", {**_MORSE, **_R0}, _morse),
    "morse/smooth/linear": RadialFormula("morse, with energy and force shifted to 0 at the cutoff", {**_MORSE, **_R0}, _morse, smooth=True),
    "yukawa": RadialFormula(
        "A exp(-kappa r)/r", {"A": ("energy*length", ""), "kappa": ("inverse_length", ">= 0")}, lambda A, kappa: [(A, 1.0, kappa, 0.0)]
    ),
    "lj/smooth/linear": RadialFormula(
        "LennardJones, with energy and force shifted to 0 at the cutoff", _LJ, lambda e, s: _mie(e, s, 12.0, 6.0), smooth=True
    ),
    "mie/cut": RadialFormula(
        "n/(n - m) (n/m)^(m/(n - m)) epsilon [(sigma/r)^n - (sigma/r)^m]",
        {**_LJ, "n": ("dimensionless", "> 0"), "m": ("dimensionless", "> 0")},
        _mie,
    ),
    "lj/class2": RadialFormula(
        "epsilon [2 (sigma/r)^9 - 3 (sigma/r)^6]", _LJ, lambda e, s: [(2 * e * s**9, 9.0, 0.0, 0.0), (-3 * e * s**6, 6.0, 0.0, 0.0)]
    ),
    "buck": RadialFormula(
        "A exp(-r/rho) - C/r^6",
        {"A": ("energy", ""), "rho": ("length", "> 0"), "C": ("energy*length^6", "")},
        lambda A, rho, C: [(A, 0.0, 1 / rho, 0.0), (-C, 6.0, 0.0, 0.0)],
    ),
}


@dataclass(frozen=True)
class RadialPair(PairCoefficient):
    """A radial potential of :data:`openmm_dpd.model.radial.FORMULAS`, for r < cutoff.

    Parameters
    ----------
    form : str
        Name of the potential: ``"soft"``, ``"gauss"``, ``"morse"``, ``"yukawa"``, ...
    values : mapping
        Its coefficients by name, such as ``{"A": 25.0}``, in MD units or as Quantities.  They are kept as a tuple, in their order.
    cutoff : length
        Range, nm, > 0.
    shift : bool, default False
        Shift the energy to zero at the cutoff (LAMMPS: ``pair_modify shift yes``).  Forces do not change.

    Raises
    ------
    ParameterError
        If there is no such potential, a coefficient is missing, out of bounds or of another dimension.

    Examples
    --------
    >>> RadialPair("gauss", {"A": -5.0, "B": 2.0}, cutoff=2.0).values
    (-5.0, 2.0)
    """

    form: str
    values: Any
    cutoff: float
    shift: bool = False
    _DIMENSIONS = {"cutoff": ("length", "> 0")}

    def __post_init__(self):
        super().__post_init__()
        require_one(self.form, FORMULAS, "form")
        require(self.shift, (bool, np.bool_), "shift must be True or False")
        dimensions = FORMULAS[self.form].dimensions
        given = dict(self.values) if isinstance(self.values, Mapping) else dict(zip(dimensions, self.values, strict=False))
        if set(given) != set(dimensions) or not isinstance(self.values, Mapping) and len(self.values) != len(dimensions):
            raise ParameterError(f"{self.form} has the coefficients {', '.join(dimensions)}; got {', '.join(map(str, given)) or 'none'}")
        found = (checked(given[n], d, n, positive=bound == "> 0", signed=not bound) for n, (d, bound) in dimensions.items())
        keep(self, values=tuple(found))
        try:
            finite = bool(np.isfinite(self.numbers()).all())
        except (OverflowError, ZeroDivisionError):
            finite = False
        if not finite:
            raise ParameterError(f"{self.form} has no finite energy with {', '.join(f'{n} = {v:g}' for n, v in self.parameters.items())}")

    @property
    def parameters(self) -> dict[str, float]:
        """Coefficients by name."""
        return dict(zip(FORMULAS[self.form].dimensions, self.values, strict=True))

    def numbers(self) -> np.ndarray:
        """The constant, the slope of what is linear in r, amplitude and wave number (turns per nm) of the cosine; then a, p, b and c of
        each term."""
        formula = FORMULAS[self.form]
        terms = np.array(formula.terms(*self.values))
        amplitude, turns = formula.cosine(*self.values), 0.5 / self.cutoff
        a, p, b, c = terms.T
        parts = a * self.cutoff**-p * np.exp(-b * self.cutoff - c * self.cutoff**2)
        end = parts.sum() + amplitude * math.cos(2 * math.pi * turns * self.cutoff)
        slope = -np.sum(parts * (p / self.cutoff + b + 2 * c * self.cutoff))
        linear = -slope if formula.smooth else 0.0
        constant = -end - linear * self.cutoff if formula.smooth or self.shift else 0.0
        return np.concatenate([[constant, linear, amplitude, turns], terms.ravel()])
