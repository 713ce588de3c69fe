"""Smeared charges: their parameters and potentials, and the settings of the Ewald sum."""

import math
import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from ..base.errors import ParameterError, in_length, in_units, require, what_is
from ..base.units import COULOMB, keep, whole_number
from .pairs import checked

#: Most points of a PME grid, 512^3 (2 GB on the Reference platform); more are a mistake.
MOST_GRID_POINTS = 512**3
#: Warning about charged beads without electrostatics.
NO_ELECTROSTATICS = "{} charged beads, but the scene has no `electrostatics`: their charges exert no forces (SlaterCharges(...) makes them)"


def special_factors(value, name: str) -> tuple[float, float, float]:
    """Factors of 1-2, 1-3 and 1-4 pairs as floats; ParameterError if they are not three numbers from 0 to 1."""
    try:
        factors = tuple(float(factor) for factor in value)
    except (TypeError, ValueError):
        factors = ()
    if len(factors) != 3 or not all(0 <= factor <= 1 for factor in factors):
        raise ParameterError(f"{name} must be three factors between 0 and 1 (for 1-2, 1-3 and 1-4 pairs), not {what_is(value)}")
    return factors  # type: ignore[return-value]


@dataclass(frozen=True, kw_only=True)
class SmearedCharges:
    """Base of all kinds of smeared charges; :class:`SlaterCharges` explains the parameters."""

    permittivity: float | None = None
    bjerrum_length: float | None = None
    cutoff: float | None = None
    tolerance: float = 1e-4
    alpha: float | None = None
    grid: tuple[int, int, int] | None = None
    bonded_factors: tuple[float, float, float] | None = None
    #: Name of the parameter with the width of the clouds.
    _WIDTH: ClassVar[str] = ""

    def __post_init__(self):
        what = f"of {type(self).__name__}"
        if self._WIDTH:
            keep(self, **{self._WIDTH: checked(getattr(self, self._WIDTH), "length", f"{self._WIDTH} {what}", positive=True)})
        given = [name for name in ("permittivity", "bjerrum_length") if getattr(self, name) is not None]
        if len(given) != 1:
            got = "both are given" if given else "neither is given"
            raise ParameterError(f"{type(self).__name__} needs either a (relative) permittivity or a bjerrum_length; {got}")
        dimensions = {"permittivity": "dimensionless", "bjerrum_length": "length", "cutoff": "length", "alpha": "inverse_length"}
        for name, dimension in dimensions.items():
            if getattr(self, name) is not None:
                keep(self, **{name: checked(getattr(self, name), dimension, f"{name} {what}", positive=True)})
        tolerance = checked(self.tolerance, "dimensionless", f"tolerance {what}")
        if not 1e-10 <= tolerance <= 0.1:
            raise ParameterError(f"tolerance {what} must be between 1e-10 and 0.1, not {what_is(self.tolerance)}")
        keep(self, tolerance=tolerance)
        if self.bonded_factors is not None:
            keep(self, bonded_factors=special_factors(self.bonded_factors, f"bonded_factors {what}"))
        if self.grid is not None:
            if not isinstance(self.grid, (tuple, list, np.ndarray)) or len(self.grid) != 3:
                raise ParameterError(f"grid {what} must be three numbers of points, not {what_is(self.grid)}")
            keep(self, grid=tuple(whole_number(n, f"a number of grid points {what}", 6) for n in self.grid))

    # -- defined by each kind --------------------------------------------------------------------------------------------------
    @property
    def steepness(self) -> float:
        """Inverse length, 1/nm, over which the potential flattens at small distances."""
        raise NotImplementedError

    def series(self, scale: float) -> np.ndarray:
        """Coefficients of the potential in powers of r/scale, with scale at most 1/steepness."""
        raise NotImplementedError

    def potential(self, r):
        """Energy of two unit charges over the Coulomb constant, 1/nm: finite at r = 0, 1/r at large distances."""
        raise NotImplementedError

    def tail(self, r: float) -> float:
        """Relative difference from the force between point charges at a distance r > 0, nm."""
        raise NotImplementedError

    def describe(self) -> str:
        """Kind and width of the clouds, for the plan."""
        raise NotImplementedError

    @property
    def all_images(self) -> bool:
        """Whether there is a lattice sum; if not, pairs within the cutoff interact."""
        return True

    # -- common to all kinds ---------------------------------------------------------------------------------------------------
    def coulomb(self, kT: float) -> float:
        """Coulomb constant e^2/(4 pi eps0 eps_r), kJ/mol nm; kT (kJ/mol) is that of the Bjerrum length, if given."""
        if self.permittivity is not None:
            return COULOMB / self.permittivity
        assert self.bjerrum_length is not None
        return kT * self.bjerrum_length

    def reach(self, tolerance: float) -> float:
        """Distance, nm, beyond which the force is that of point charges to a relative tolerance."""
        low, high = 0.0, 1.0 / self.steepness
        while self.tail(high) > tolerance:
            low, high = high, 2 * high
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.tail(middle) > tolerance else (low, middle)
        return without_last_digits(high)


def without_last_digits(value: float) -> float:
    """A setting rounded to ten digits, since further digits depend on the C library."""
    return float(f"{value:.10g}")


def _direct(r, scale: float, coefficients: np.ndarray, outer) -> np.ndarray:
    """A function of the distance, from its series below ``scale`` and the formula ``outer`` above."""
    r = np.asarray(r, dtype=float)
    near = np.polynomial.polynomial.polyval(np.minimum(r, scale) / scale, coefficients)
    return np.where(r < scale, near, outer(np.maximum(r, scale)))


@dataclass(frozen=True)
class SlaterCharges(SmearedCharges):
    r"""Charges smeared over exponential clouds (LAMMPS: ``coul/slater/long``, ``dpd/coul/slater/long``).

    .. math:: U = \frac{q_i q_j}{4\pi\epsilon_0\epsilon_r r} \left[1 - \left(1 + \frac{r}{\lambda}\right) e^{-2r/\lambda}\right]

    with lambda = ``lamda`` (beta = 1/lamda in other papers).  At r = 0 the energy is q_i q_j/(4 pi eps0 eps_r lamda) and the force 0, so
    opposite charges do not collapse onto each other.

    In a periodic box the interaction with all images is summed: by a CustomNonbondedForce up to the cutoff, and by OpenMM's PME for the
    rest.  Beyond the cutoff charges act as point charges.  The pair energy has a step there, (1 + r/lamda) exp(-2 r/lamda) of q_i q_j/(4 pi
    eps0 eps_r r), and is not shifted, as in LAMMPS.  By default the cutoff is so long that the relative error of the force there,
    (1 + 2 r/lamda + 2 (r/lamda)^2) exp(-2 r/lamda), is at most the tolerance.  Without a box there is no cutoff and no lattice sum.

    Bonded neighbours with a factor f in ``bonded_factors`` have f times the full smeared energy: the lattice sum's share of the pair is
    subtracted exactly, at any distance.  LAMMPS does so up to the cutoff only, and releases before mid 2022 subtracted the energy of
    point charges.

    Parameters
    ----------
    lamda : length
        Width of the clouds, > 0, LAMMPS's lambda.  Papers that write exp(-2 beta* r/R) have lamda = R/beta*.
    permittivity : float, optional
        Relative permittivity eps_r; give this or the Bjerrum length.
    bjerrum_length : length, optional
        Distance at which two unit point charges have the energy kT, with the scene's kT at the first step.  If the temperature changes
        later, the permittivity is kept.
    cutoff : length, optional
        Cutoff of the real-space part, nm, at most half the box.  By default it follows from the tolerance, and has some 40 charges within
        its range, so that the grid is not too fine.
    tolerance : float, default 1e-4
        Bound of the relative root mean square error of the forces between charges; it determines the cutoff, alpha and the grid.
    alpha : inverse length, optional
        Splitting parameter of the Ewald sum; by default from the tolerance.
    grid : three int, optional
        Points of the PME grid; by default from the tolerance.
    bonded_factors : three floats, optional
        Factors of the charges' interaction for pairs one, two and three bonds apart; by default those of the scene.

    Raises
    ------
    ParameterError
        If a value is out of bounds or not finite, or permittivity and Bjerrum length are both given or both missing.
    """

    lamda: float
    _WIDTH = "lamda"

    @property
    def steepness(self) -> float:
        return 1.0 / self.lamda

    def series(self, scale: float) -> np.ndarray:
        # 1 - (1 + y/2) exp(-y) = sum over n > 0 of (-1)^n (n/2 - 1) y^n/n!, with y = 2 r/lamda
        y = 2 * scale / self.lamda
        return np.array([(-1) ** n * (n / 2 - 1) * y**n / math.factorial(n) for n in range(1, 40)]) / scale

    def potential(self, r):
        scale = self.lamda
        return _direct(r, scale, self.series(scale), lambda x: (1 - (1 + x / self.lamda) * np.exp(-2 * x / self.lamda)) / x)

    def tail(self, r: float) -> float:
        y = 2 * r / self.lamda
        return math.exp(-y) * (1 + y + y * y / 2)

    def describe(self) -> str:
        return f"Slater charges, lambda = {in_length(self.lamda)}"


@dataclass(frozen=True)
class GaussianCharges(SmearedCharges):
    r"""Charges smeared over Gaussian clouds.

    .. math:: U = \frac{q_i q_j}{4\pi\epsilon_0\epsilon_r r}\, \mathrm{erf}\left(\frac{r}{2 w}\right)

    for clouds of standard deviation w (density proportional to exp(-r^2/(2 w^2))) in every direction.  At r = 0 the energy is
    q_i q_j/(4 pi eps0 eps_r w sqrt(pi)) and the force 0.  :class:`SlaterCharges` explains lattice sum and bonded neighbours.

    Parameters
    ----------
    width : length
        Standard deviation w of a cloud, > 0.
    permittivity, bjerrum_length, cutoff, tolerance, alpha, grid, bonded_factors
        Interaction and settings of the lattice sum, see :class:`SlaterCharges`.

    Raises
    ------
    ParameterError
        If a value is out of bounds or not finite, or permittivity and Bjerrum length are both given or both missing.
    """

    width: float
    _WIDTH = "width"

    @property
    def steepness(self) -> float:
        return 0.5 / self.width

    def series(self, scale: float) -> np.ndarray:
        return erf_series(0.5 / self.width, scale)

    def potential(self, r):
        scale = 2 * self.width
        return _direct(r, scale, self.series(scale), lambda x: scipy.special.erf(0.5 * x / self.width) / x)

    def tail(self, r: float) -> float:
        t = 0.5 * r / self.width
        return math.erfc(t) + 2 * t / math.sqrt(math.pi) * math.exp(-t * t)

    def describe(self) -> str:
        return f"Gaussian charges, width = {in_length(self.width)}"


def erf_series(steepness: float, scale: float) -> np.ndarray:
    """Coefficients of erf(steepness r)/r in powers of r/scale."""
    powers = np.cumprod([1.0, *[-((steepness * scale) ** 2)] * 30])
    found = np.zeros(61)
    found[::2] = [power / (math.factorial(n) * (2 * n + 1)) for n, power in enumerate(powers)]
    return found * 2 * steepness / math.sqrt(math.pi)


def short_series(charges: SmearedCharges, alpha: float, scale: float) -> np.ndarray:
    """Coefficients of s(r) - erf(alpha r)/r in powers of r/scale, with s(r) the potential of the charges."""
    return np.polynomial.polynomial.polysub(charges.series(scale), erf_series(alpha, scale))


@dataclass(frozen=True)
class EwaldSum:
    """Settings of the lattice sum: cutoff (nm), splitting parameter (1/nm, 0 without a lattice sum) and grid points."""

    cutoff: float
    alpha: float
    grid: tuple[int, int, int]


def ewald_sum(charges: SmearedCharges, box: np.ndarray, n_charges: int) -> EwaldSum:
    """Cutoff, alpha and grid for forces within the tolerance.  ParameterError if the cutoff, given or required, is over half the box, or
    cutoff, alpha and grid do not match."""
    half = 0.5 * float(np.diag(box).min())
    cutoff = None if charges.cutoff is None else _within(charges, box)
    if cutoff is None:
        cutoff = charges.reach(charges.tolerance)
        if cutoff > half:
            raise ParameterError(
                f"{type(charges).__name__}: the smearing reaches to {in_length(cutoff, 4)} at the tolerance {charges.tolerance:g}, over "
                f"half the box ({in_length(half, 4)}); use a larger box, narrower charges or a larger tolerance, or set a cutoff and "
                "accept its error"
            )
        # narrow charges need a short cutoff only, which would need a fine grid; some 40 charges in range are a good balance
        balanced = (3 * 40 * float(np.prod(np.diag(box))) / (4 * math.pi * n_charges)) ** (1 / 3)
        cutoff = min(half, max(cutoff, without_last_digits(balanced)))
    # factors fitted to exact sums, see tests/core/test_electrostatics.py
    alpha = charges.alpha or without_last_digits(math.sqrt(-math.log(0.3 * charges.tolerance)) / cutoff)
    grid = charges.grid
    if grid is None:
        spacing = 1.2 * charges.tolerance**0.2 / alpha
        grid = tuple(max(8, math.ceil(width / spacing)) for width in np.linalg.norm(box, axis=1))  # type: ignore[assignment]
    _check_sum(charges, cutoff, alpha, grid, box)  # type: ignore[arg-type]
    return EwaldSum(cutoff, alpha, grid)  # type: ignore[arg-type]


def _within(charges: SmearedCharges, box: np.ndarray) -> float:
    """The cutoff of charges; ParameterError if it is over half the box."""
    cutoff, width = charges.cutoff, float(np.diag(box).min())
    assert cutoff is not None
    if cutoff > 0.5 * width * (1 + 1e-12):
        name = type(charges).__name__
        raise ParameterError(f"the cutoff {in_length(cutoff)} of {name} is over half the box, whose smallest width is {in_length(width)}")
    return cutoff


def _check_sum(charges: SmearedCharges, cutoff: float, alpha: float, grid: tuple[int, int, int], box: np.ndarray) -> None:
    """Raise ParameterError for settings whose sum is wrong by a tenth or more, or whose grid exceeds memory (OpenMM would crash)."""
    name, width = type(charges).__name__, f"alpha = {in_units(alpha, 'inverse_length', 4)}"
    if math.erfc(alpha * cutoff) > 0.1:
        raise ParameterError(
            f"{name}: with {width} a part of {math.erfc(alpha * cutoff):.2g} of the real-space sum is beyond the cutoff of "
            f"{in_length(cutoff, 4)}; leave alpha out, or make it at least {in_units(1.2 / cutoff, 'inverse_length', 4)}"
        )
    if float(np.prod(np.array(grid, dtype=float))) > MOST_GRID_POINTS:
        raise ParameterError(
            f"{name}: the lattice sum would need a grid of {' x '.join(map(str, grid))} points (cutoff "
            f"{in_length(cutoff, 4)}, {width}, tolerance {charges.tolerance:g}); take a longer cutoff, a larger tolerance, or leave alpha "
            "and grid out"
        )
    coarse = np.linalg.norm(box, axis=1) / np.array(grid) * alpha
    if coarse.max() > 1.5:
        least = np.ceil(np.linalg.norm(box, axis=1) * alpha / 1.5).astype(int)
        raise ParameterError(
            f"{name}: a grid of {' x '.join(map(str, grid))} points is too coarse for {width}; leave it out, or take at "
            f"least {' x '.join(map(str, least))}"
        )


def checked_ewald(charges: SmearedCharges | None, q: np.ndarray | None, box: np.ndarray | None, kT: float) -> EwaldSum | None:
    """Settings of the lattice sum of a scene, or None without interacting charges in a box.  ParameterError if charges, box or kT do not
    allow this electrostatics; a warning if the scene is not neutral."""
    if charges is None:
        return None
    name = type(charges).__name__
    require(charges, SmearedCharges, "electrostatics must be SlaterCharges, GaussianCharges or PointCharges")
    if q is None:
        raise ParameterError(f"electrostatics needs the charges of the beads; give one per bead in `charges` ({name})")
    if not np.any(q):
        raise ParameterError(f"{name}: all charges are 0; give the ions a charge, or leave out `electrostatics`")
    if charges.bjerrum_length is not None and kT == 0:
        raise ParameterError(f"{name}: a Bjerrum length needs a temperature, but kT is 0; give the permittivity")
    if box is None:
        given = [setting for setting in ("cutoff", "alpha", "grid", "screening") if getattr(charges, setting, None)]
        if given:
            raise ParameterError(
                f"{name}: a scene without a periodic box has no lattice sum, and all pairs of charges interact, so that "
                f"{' and '.join(given)} would have no effect; leave that out, or give the scene a box"
            )
        return None
    if not charges.all_images:
        return EwaldSum(_within(charges, box), 0.0, (0, 0, 0))
    settings = ewald_sum(charges, box, int(np.count_nonzero(q)))
    total = float(q.sum())
    if abs(total) > 1e-6 * max(1.0, float(np.abs(q).sum())):
        warnings.warn(
            f"the charges add up to {total:g} e; in a periodic box a uniform background neutralises them, "
            "which changes the energy and the pressure. Add counterions if this is not intended",
            UserWarning,
            stacklevel=4,
        )
    return settings
