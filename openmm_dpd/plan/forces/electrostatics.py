"""Smeared charges as OpenMM forces: PME of point charges for the lattice, and a pair force for all that is short-ranged.

A pair and its images have the energy sum over images of C q q s(R), with s(R) = 1/R beyond the cutoff.  A NonbondedForce without its
direct space holds the part erf(alpha R)/R of every pair, bonded or not, and the self energies; the pair force holds s(r) - erf(alpha r)/r
up to the cutoff.  Pairs with a factor f of ``bonded_factors`` are excluded from the pair force, and a bond force gives them
f s(r) - erf(alpha r)/r.

Both parts of that difference are 1/r minus something, and in single precision nothing would be left of them at small r.  So below a
distance of the width of the charges the expression is one polynomial, and above it holds no difference of nearly equal numbers:

    E(r) = P(min(r, r0)) + Q(max(r, r0)) - Q(r0)

which is smooth to the rounding of its coefficients, and finite everywhere.
"""

import math
from dataclasses import dataclass

import numpy as np
import openmm

from ...base.names import COULOMB_GROUP, LATTICE_GROUP
from ...base.units import COULOMB
from ...model.electrostatics import EwaldSum, SlaterCharges, SmearedCharges, erf_series, short_series
from ...model.point_charges import PointCharges


@dataclass(frozen=True)
class Radial:
    """A function of r: a polynomial in r/scale below ``scale``, ``outer`` (an expression in ``far``) above."""

    coefficients: np.ndarray  #: Of the powers of r/scale
    outer: str  #: Expression
    scale: float  #: nm

    def text(self, name: str) -> str:
        """Definitions of ``name``, and of what it needs, for the end of an expression."""
        kept = np.trim_zeros(np.where(np.abs(self.coefficients) < 1e-18 * np.abs(self.coefficients).max(), 0.0, self.coefficients), "b")
        # a sum of powers: of nested products (Horner) OpenMM's derivative is so long that a Context takes a tenth of a second
        powers = "+".join(f"({c!r})*near_{name}^{k}" for k, c in enumerate(kept.tolist()) if c)
        edge = float(np.sum(kept))
        return (
            f"; {name}={powers}+({self.outer.replace('far', f'far_{name}')})-({edge!r})"
            f"; near_{name}=min(r,{self.scale!r})/{self.scale!r}; far_{name}=max(r,{self.scale!r})"
        )


@dataclass(frozen=True)
class Singular:
    """A function of r that is infinite at 0, or softened there."""

    expression: str

    def text(self, name: str) -> str:
        """See :class:`Radial`."""
        return f"; {name}={self.expression}"


def smeared(charges: SmearedCharges, scale: float) -> Radial | Singular:
    """s(r) = U/(C q q)."""
    if isinstance(charges, PointCharges):
        if charges.soft:
            return Singular(f"{charges.strength!r}/sqrt(r^2+{charges.softness**2!r})")
        return Singular(f"exp({-charges.screening!r}*r)/r" if charges.screening else "1/r")
    k = charges.steepness
    outer = f"(1-(1+{k!r}*far)*exp({-2 * k!r}*far))/far" if isinstance(charges, SlaterCharges) else f"erf({k!r}*far)/far"
    return Radial(charges.series(scale), outer, scale)


def lattice_part(alpha: float, scale: float) -> Radial:
    """erf(alpha r)/r, the part of the lattice sum."""
    return Radial(erf_series(alpha, scale), f"erf({alpha!r}*far)/far", scale)


def difference(charges: SmearedCharges, alpha: float, scale: float) -> Radial | Singular:
    """s(r) - erf(alpha r)/r, without a difference of nearly equal numbers at any distance."""
    if alpha == 0.0:
        return smeared(charges, scale)
    if isinstance(charges, PointCharges):
        return Singular(f"erfc({alpha!r}*r)*({smeared(charges, scale).expression})")  # type: ignore[union-attr]
    k = charges.steepness
    cloud = f"(1+{k!r}*far)*exp({-2 * k!r}*far)" if isinstance(charges, SlaterCharges) else f"erfc({k!r}*far)"
    return Radial(short_series(charges, alpha, scale), f"(erfc({alpha!r}*far)-{cloud})/far", scale)


def electrostatic_forces(
    charges: SmearedCharges, q: np.ndarray, constant: float, ewald: EwaldSum | None, factors: dict[tuple[int, int], float], *, listed: bool
) -> list[openmm.Force]:
    """All forces of smeared charges; without ``ewald`` there is no periodic box and no cutoff.  ``factors`` are of the smeared interaction
    of pairs that are excluded from the pair force: bonded neighbours, and beads that start at the same point (factor 1).  ``listed``: it
    uses the neighbour list of all beads rather than all pairs of charged beads."""
    # where the polynomial ends: the series of both parts still converge fast there
    of_clouds = [1.0 / charges.steepness] if charges.steepness < math.inf else []
    of_waves = [1.0 / ewald.alpha, ewald.cutoff] if ewald is not None and ewald.alpha else []
    scale = min([*of_clouds, *of_waves], default=0.0)
    short = smeared(charges, scale) if ewald is None else difference(charges, ewald.alpha, scale)
    whole = smeared(charges, scale).text("whole")
    if ewald is None:
        bonded = f"factor*whole{whole}"
    elif ewald.alpha == 0.0:
        bonded = f"step({ewald.cutoff!r}-r)*factor*whole{whole}"
    else:
        soft = isinstance(charges, PointCharges) and charges.soft
        image = f"; image=erf({ewald.alpha!r}*r)*whole{whole}" if soft else f"{whole}{lattice_part(ewald.alpha, scale).text('image')}"
        bonded = f"(factor*whole-image){image}"
    pairs = f"{constant!r}*charge1*charge2*"
    bonds = {pair: factor for pair, factor in sorted(factors.items()) if q[pair[0]] * q[pair[1]] != 0}
    made: list[openmm.Force] = [_pair_force(f"{pairs}short{short.text('short')}", q, ewald, factors, listed)]
    if bonds:
        made.append(_bond_force(f"{constant!r}*qq*{bonded}", q, bonds, ewald))
    if ewald is not None and ewald.alpha:
        made.append(lattice_force(q, constant, ewald, factors))
    return made


def _pair_force(text: str, q: np.ndarray, ewald, factors, listed: bool) -> openmm.CustomNonbondedForce:
    force = openmm.CustomNonbondedForce(text)
    force.setName("smeared charges")
    force.addPerParticleParameter("charge")
    for charge in q.tolist():
        force.addParticle([charge])
    for i, j in sorted(factors):
        force.addExclusion(i, j)
    if not listed:
        ions = np.flatnonzero(q).tolist()
        force.addInteractionGroup(ions, ions)
    if ewald is None:
        force.setNonbondedMethod(force.NoCutoff)
    else:
        force.setNonbondedMethod(force.CutoffPeriodic)
        force.setCutoffDistance(ewald.cutoff)
    force.setForceGroup(COULOMB_GROUP)
    return force


def _bond_force(text: str, q: np.ndarray, factors: dict[tuple[int, int], float], ewald) -> openmm.CustomBondForce:
    force = openmm.CustomBondForce(text)
    force.setName("smeared charges (exceptions)")
    force.addPerBondParameter("factor")
    force.addPerBondParameter("qq")
    for (i, j), factor in factors.items():
        force.addBond(i, j, [factor, float(q[i] * q[j])])
    force.setUsesPeriodicBoundaryConditions(ewald is not None)
    force.setForceGroup(COULOMB_GROUP)
    return force


def lattice_force(q: np.ndarray, constant: float, ewald: EwaldSum, factors: dict[tuple[int, int], float]) -> openmm.NonbondedForce:
    """PME of point charges without its direct space.  The CPU platform needs the same exclusions in all pair forces.  Without the direct
    space they change nothing on any platform: the pairs stay in the lattice sum, and the bond force takes them out."""
    force = openmm.NonbondedForce()
    force.setName("smeared charges (lattice)")
    force.setNonbondedMethod(force.PME)
    force.setIncludeDirectSpace(False)
    force.setCutoffDistance(ewald.cutoff)
    force.setPMEParameters(ewald.alpha, *ewald.grid)
    force.setUseDispersionCorrection(False)
    for charge in (q * math.sqrt(constant / COULOMB)).tolist():
        force.addParticle(charge, 1.0, 0.0)
    for i, j in sorted(factors):
        force.addException(i, j, 0.0, 1.0, 0.0)
    force.setForceGroup(LATTICE_GROUP)
    force.setReciprocalSpaceForceGroup(LATTICE_GROUP)
    return force


def needs_list(q: np.ndarray, ewald: EwaldSum | None, box: np.ndarray | None) -> bool:
    """Whether a neighbour list of all beads means less work than all pairs of charged beads."""
    if ewald is None or box is None:
        return False
    ions = int(np.count_nonzero(q))
    # lists are built with a margin, and made again now and then
    neighbours = 4.19 * (1.25 * ewald.cutoff) ** 3 * len(q) / float(np.prod(np.diag(box)))
    return ions * ions > 2 * len(q) * min(neighbours, len(q))
