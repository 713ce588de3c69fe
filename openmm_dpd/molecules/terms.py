"""Springs, bends and twists: one bond, angle or dihedral of a molecule, as a value."""

from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from ..model.angles import CosineAngles, HarmonicAngles, HarmonicDihedrals, MultiHarmonicDihedrals, OPLSDihedrals
from ..model.bonds import WCA_END, BondedTerms, FENEBonds, HarmonicBonds, MorseBonds


@dataclass(frozen=True)
class _Term:
    """One bond, angle or dihedral: checked, and turned into MD units, by the class of the model that holds many of them."""

    KIND: ClassVar[Any]
    _BEADS: ClassVar[tuple[int, ...]]

    def __post_init__(self):
        checked = self.KIND([self._BEADS], **self.coefficients())
        for field in fields(self):
            object.__setattr__(self, field.name, float(getattr(checked, field.name)[0]))

    def coefficients(self) -> dict[str, float]:
        """Coefficients by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def many(cls, beads: np.ndarray, terms: list) -> BondedTerms:
        """The bonds, angles or dihedrals of a scene between these beads, one row each, with the coefficients of these terms."""
        names = [field.name for field in fields(cls)]
        return cls.KIND(beads, **{name: np.array([getattr(term, name) for term in terms]) for name in names})


@dataclass(frozen=True)
class AnySpring(_Term):
    """A bond.  A kind is a frozen dataclass under it with the coefficients of its class of the model, ``KIND``."""

    _BEADS = (0, 1)

    def length(self, spacing: float) -> float:
        """Length (nm) at which a builder places the bond: its rest length, or ``spacing`` where that is 0 or there is none."""
        return getattr(self, "r0", 0.0) or spacing


@dataclass(frozen=True)
class Spring(AnySpring):
    """Harmonic bond, U = k (r - r0)^2, without a factor 1/2 (:class:`openmm_dpd.HarmonicBonds`).

    Much of the DPD literature writes U = (1/2) C (r - l0)^2 or F = -C r; halve such a constant: ``Spring(k=C / 2, r0=l0)``.

    Parameters
    ----------
    k : energy/length^2
        kJ/mol/nm^2, >= 0.
    r0 : length
        Rest length in nm, >= 0.
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
        kJ/mol/nm^2, >= 0.
    R0 : length
        Largest length in nm, > 0.
    epsilon : energy, default 0
        Repulsion of the two beads, kJ/mol.
    sigma : length, default 1
        Range of the repulsion, nm.
    """

    k: float
    R0: float
    epsilon: float = 0.0
    sigma: float = 1.0
    KIND = FENEBonds

    def length(self, spacing: float) -> float:
        """Where the repulsion begins, or ``spacing``, but at most 0.7 R0."""
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
        Rest length in nm.
    """

    D: float
    alpha: float
    r0: float
    KIND = MorseBonds


@dataclass(frozen=True)
class AnyBend(_Term):
    """An angle, as :class:`AnySpring` is a bond."""

    _BEADS = (0, 1, 2)

    def angles(self, count: int, rng: np.random.Generator, kT: float) -> np.ndarray:
        """Angles (radians) with the density sin(theta) exp(-U/kT); those of least energy for kT = 0, (count,)."""
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
        kJ/mol/rad^2, >= 0.
    theta0 : angle
        Rest angle; bare numbers are radians.  pi is a straight chain.
    """

    k: float
    theta0: float
    KIND = HarmonicAngles


@dataclass(frozen=True)
class CosineBend(AnyBend):
    """Bending stiffness, U = k (1 + cos theta), least for a straight chain (:class:`openmm_dpd.CosineAngles`).

    The literature on DPD lipids writes k (1 - cos phi), with phi = 0 for a straight chain: the same k.

    Parameters
    ----------
    k : energy
        kJ/mol, >= 0.
    """

    k: float
    KIND = CosineAngles


@dataclass(frozen=True)
class AnyTwist(_Term):
    """A dihedral, as :class:`AnySpring` is a bond."""

    _BEADS = (0, 1, 2, 3)


@dataclass(frozen=True)
class Twist(AnyTwist):
    """One wave, U = k [1 + d cos(n phi)], phi = pi for trans (:class:`openmm_dpd.HarmonicDihedrals`).

    Parameters
    ----------
    k : energy
        kJ/mol.
    d : 1 or -1
        Sign: with 1 the energy is highest where n phi = 0.
    n : int
        Waves in a turn.
    """

    k: float
    d: float
    n: float

    KIND = HarmonicDihedrals


@dataclass(frozen=True)
class OPLSTwist(AnyTwist):
    """Four waves, U = 1/2 {K1 [1 + cos phi] + K2 [1 - cos 2 phi] + K3 [1 + cos 3 phi] + K4 [1 - cos 4 phi]}
    (:class:`openmm_dpd.OPLSDihedrals`).

    Parameters
    ----------
    K1, K2, K3, K4 : energy
        kJ/mol.
    """

    K1: float
    K2: float
    K3: float
    K4: float

    KIND = OPLSDihedrals


@dataclass(frozen=True)
class MultiHarmonicTwist(AnyTwist):
    """U = A1 + A2 cos phi + A3 cos^2 phi + A4 cos^3 phi + A5 cos^4 phi (:class:`openmm_dpd.MultiHarmonicDihedrals`).

    Parameters
    ----------
    A1, A2, A3, A4, A5 : energy
        kJ/mol.
    """

    A1: float
    A2: float
    A3: float
    A4: float
    A5: float

    KIND = MultiHarmonicDihedrals


def many_terms(beads: np.ndarray, terms: list) -> list:
    """Bonds, angles or dihedrals of a scene, one object for each kind, from the beads of each term, one row each, and the terms."""
    found = []
    kinds: list[Any] = list(dict.fromkeys(map(type, terms)))
    for kind in kinds:
        chosen = np.array([type(term) is kind for term in terms])
        found.append(kind.many(beads[chosen], [term for term in terms if type(term) is kind]))
    return found
