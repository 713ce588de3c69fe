"""Springs, bends and twists: the bonds, angles and dihedrals of molecules, as values."""

from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from ..model.angles import CosineAngles, HarmonicAngles, HarmonicDihedrals, MultiHarmonicDihedrals, OPLSDihedrals
from ..model.bonds import WCA_END, BondedTerms, FENEBonds, HarmonicBonds, MorseBonds


@dataclass(frozen=True)
class _Term:
    """One bond, angle or dihedral: the model's class for many of them checks it and converts its units."""

    KIND: ClassVar[Any]
    _BEADS: ClassVar[tuple[int, ...]]

    def __post_init__(self):
        checked = self.KIND([self._BEADS], **self.coefficients())
        for field in fields(self):
            object.__setattr__(self, field.name, float(getattr(checked, field.name)[0]))

    def coefficients(self) -> dict[str, float]:
        """Coefficients by name, in MD units."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def many(cls, beads: np.ndarray, terms: list) -> BondedTerms:
        """Bonds, angles or dihedrals of a scene between these beads, one row each, with the coefficients of these terms."""
        names = [field.name for field in fields(cls)]
        return cls.KIND(beads, **{name: np.array([getattr(term, name) for term in terms]) for name in names})


@dataclass(frozen=True)
class AnySpring(_Term):
    """Base of springs.  Each kind is a frozen dataclass with the coefficients of ``KIND``, its class in the model."""

    _BEADS = (0, 1)

    def length(self, spacing: float) -> float:
        """Initial length of the bond, nm: its rest length, or ``spacing`` if that is 0 or does not exist."""
        return getattr(self, "r0", 0.0) or spacing


@dataclass(frozen=True)
class Spring(AnySpring):
    """Harmonic bond, U = k (r - r0)^2, without a factor 1/2 (:class:`openmm_dpd.HarmonicBonds`).

    Much of the DPD literature writes U = (1/2) C (r - l0)^2 or F = -C r; halve such a constant: ``Spring(k=C / 2, r0=l0)``.

    Parameters
    ----------
    k : energy/length^2
        Force constant, kJ/mol/nm^2, >= 0.
    r0 : length
        Rest length, nm, >= 0.
    """

    k: float
    r0: float
    KIND = HarmonicBonds


@dataclass(frozen=True)
class FENESpring(AnySpring):
    """Finitely extensible bond (:class:`openmm_dpd.FENEBonds`).

    Parameters
    ----------
    k : energy/length^2
        Force constant, kJ/mol/nm^2, >= 0.
    R0 : length
        Maximum length, nm, > 0.
    epsilon : energy, default 0
        Strength of the repulsion between the two beads, kJ/mol.
    sigma : length, default 1
        Range of the repulsion, nm.
    """

    k: float
    R0: float
    epsilon: float = 0.0
    sigma: float = 1.0
    KIND = FENEBonds

    def length(self, spacing: float) -> float:
        """Initial length of the bond, nm: the range of the repulsion, or ``spacing`` without one, but at most 0.7 R0."""
        return min(WCA_END * self.sigma if self.epsilon > 0 else spacing, 0.7 * self.R0)


@dataclass(frozen=True)
class MorseSpring(AnySpring):
    """Morse bond, U = D (1 - exp(-alpha (r - r0)))^2 (:class:`openmm_dpd.MorseBonds`).

    Parameters
    ----------
    D : energy
        Depth of the well, kJ/mol.
    alpha : 1/length
        Inverse width of the well, 1/nm.
    r0 : length
        Rest length, nm.
    """

    D: float
    alpha: float
    r0: float
    KIND = MorseBonds


@dataclass(frozen=True)
class AnyBend(_Term):
    """Base of bends.  Each kind is a frozen dataclass with the coefficients of ``KIND``, its class in the model."""

    _BEADS = (0, 1, 2)

    def angles(self, count: int, rng: np.random.Generator, kT: float) -> np.ndarray:
        """Random angles (rad) with the density sin(theta) exp(-U/kT), (count,); those of least energy for kT = 0."""
        grid = np.linspace(0.0, np.pi, 2001)
        energy = self.KIND([self._BEADS], **self.coefficients()).curve(grid)[0]
        if kT == 0:
            return np.full(count, grid[np.argmin(energy)])
        weight = np.sin(grid) * np.exp(-(energy - energy.min()) / kT)
        cumulative = np.concatenate([[0.0], np.cumsum(weight[1:] + weight[:-1])])
        return np.interp(rng.random(count) * cumulative[-1], cumulative, grid)


@dataclass(frozen=True)
class Bend(AnyBend):
    """Harmonic angle, U = k (theta - theta0)^2, without a factor 1/2 (:class:`openmm_dpd.HarmonicAngles`).

    Parameters
    ----------
    k : energy/angle^2
        Force constant, kJ/mol/rad^2, >= 0.
    theta0 : angle
        Rest angle; a bare number is in radians, and pi is a straight chain.
    """

    k: float
    theta0: float
    KIND = HarmonicAngles


@dataclass(frozen=True)
class CosineBend(AnyBend):
    """Bending stiffness, U = k (1 + cos theta), with its minimum for a straight chain (:class:`openmm_dpd.CosineAngles`).

    The literature on DPD lipids writes k (1 - cos phi), with phi = 0 for a straight chain; k is the same.

    Parameters
    ----------
    k : energy
        Stiffness, kJ/mol, >= 0.
    """

    k: float
    KIND = CosineAngles


@dataclass(frozen=True)
class AnyTwist(_Term):
    """Base of twists.  Each kind is a frozen dataclass with the coefficients of ``KIND``, its class in the model."""

    _BEADS = (0, 1, 2, 3)


@dataclass(frozen=True)
class Twist(AnyTwist):
    """Cosine dihedral, U = k [1 + d cos(n phi)], with phi = pi for trans (:class:`openmm_dpd.HarmonicDihedrals`).

    Parameters
    ----------
    k : energy
        Force constant, kJ/mol.
    d : 1 or -1
        Sign: with 1 the energy is highest at n phi = 0.
    n : int
        Periodicity.
    """

    k: float
    d: float
    n: float

    KIND = HarmonicDihedrals


@dataclass(frozen=True)
class OPLSTwist(AnyTwist):
    """OPLS dihedral, U = 1/2 {K1 [1 + cos phi] + K2 [1 - cos 2 phi] + K3 [1 + cos 3 phi] + K4 [1 - cos 4 phi]}
    (:class:`openmm_dpd.OPLSDihedrals`).

    Parameters
    ----------
    K1, K2, K3, K4 : energy
        Coefficients, kJ/mol.
    """

    K1: float
    K2: float
    K3: float
    K4: float

    KIND = OPLSDihedrals


@dataclass(frozen=True)
class MultiHarmonicTwist(AnyTwist):
    """Dihedral U = A1 + A2 cos phi + A3 cos^2 phi + A4 cos^3 phi + A5 cos^4 phi (:class:`openmm_dpd.MultiHarmonicDihedrals`).

    Parameters
    ----------
    A1, A2, A3, A4, A5 : energy
        Coefficients, kJ/mol.
    """

    A1: float
    A2: float
    A3: float
    A4: float
    A5: float

    KIND = MultiHarmonicDihedrals


def many_terms(beads: np.ndarray, terms: list) -> list:
    """Bonds, angles or dihedrals of a scene, one object for each kind, from terms and their beads, one row each."""
    found = []
    kinds: list[Any] = list(dict.fromkeys(map(type, terms)))
    for kind in kinds:
        chosen = np.array([type(term) is kind for term in terms])
        found.append(kind.many(beads[chosen], [term for term in terms if type(term) is kind]))
    return found
