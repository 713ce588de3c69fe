"""Many-body DPD: liquids with a free surface (LAMMPS: mdpd with mdpd/rhosum)."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..base.errors import ParameterError, bead_names, require_one
from ..base.units import keep
from .pairs import NONE, PairCoefficient

#: Weight functions of the local density, normalised in three dimensions; h is the range of the density.
DENSITY_KERNELS = {"lucy": "105/(16 pi h^3) (1 + 3 r/h) (1 - r/h)^3", "quadratic": "15/(2 pi h^3) (1 - r/h)^2"}


@dataclass(frozen=True)
class MDPD(PairCoefficient):
    r"""Many-body DPD: attraction, and a repulsion that grows with the local density.

    With w_c = 1 - r/cutoff, w_d = 1 - r/cutoff_B and the density rho_i = sum over j of m_j W(r)::

        F = A w_c + B (rho_i + rho_j) w_d - gamma w_c^2 (e.v) + sigma w_c xi/sqrt(dt),    sigma^2 = 2 kT gamma

    - ``kernel="lucy"`` (LAMMPS): W = 105/(16 pi h^3) (1 + 3 r/h)(1 - r/h)^3 with h = cutoff_density.  The many-body force has no
      potential.  The reported energy is LAMMPS's, A cutoff w_c^2/2 + B cutoff_B (rho_i + rho_j) w_d^2/2 per pair, in which densities are
      treated as constants; it is not conserved.
    - ``kernel="quadratic"`` (Warren): W = 15/(2 pi h^3) (1 - r/h)^2 with h = cutoff_B.  The many-body force is minus the gradient of
      sum over i of pi B h^4 rho_i^2/30, which is the reported energy.  Here rho counts beads, regardless of their masses.

    Parameters
    ----------
    A : force
        Attraction, kJ/mol/nm, usually negative.
    B : force/density
        Many-body repulsion, kJ/mol/nm * nm^3.  With the quadratic kernel it must be equal for all type pairs (Warren's no-go theorem,
        Phys. Rev. E 87, 045303 (2013)); with Lucy's it should be.
    gamma : mass/time
        Friction, Da/ps.
    cutoff, cutoff_B : length
        Ranges of the attraction (and friction) and of the repulsion, nm; cutoff >= cutoff_B.
    cutoff_density : length, optional
        Range of the density, nm; ``cutoff_B`` by default, and always with the quadratic kernel.
    kernel : {"quadratic", "lucy"}

    References
    ----------
    Warren, Phys. Rev. E 68, 066702 (2003); Li et al., Phys. Fluids 25, 072103 (2013).
    """

    A: float
    B: float
    gamma: float
    cutoff: float = 1.0
    cutoff_B: float = 0.75
    cutoff_density: float = None  # type: ignore[assignment]  # filled from cutoff_B
    kernel: str = "quadratic"

    _DIMENSIONS = {
        **{"A": ("force", ""), "B": ("dimensionless", ""), "gamma": ("friction", ">= 0")},
        **dict.fromkeys(("cutoff", "cutoff_B", "cutoff_density"), ("length", "> 0")),
    }

    def __post_init__(self):
        super().__post_init__()
        if self.cutoff_density is None:
            keep(self, cutoff_density=self.cutoff_B)
        require_one(self.kernel, DENSITY_KERNELS, "kernel")
        if self.cutoff_B > self.cutoff:
            raise ParameterError(f"cutoff_B = {self.cutoff_B:g} must not be longer than cutoff = {self.cutoff:g}")
        if self.cutoff_density > self.cutoff:
            raise ParameterError(f"cutoff_density = {self.cutoff_density:g} must not be longer than cutoff = {self.cutoff:g}")
        if self.kernel == "quadratic" and self.cutoff_density != self.cutoff_B:
            raise ParameterError("with the quadratic kernel the density has the range cutoff_B; only then is there a potential")

    @property
    def has_thermostat(self) -> bool:
        return self.gamma > 0.0


def check_many_body(table: Mapping) -> MDPD:
    """One of the coefficients {(type, type): MDPD or NONE} of a table; ParameterError, which names the types, if they do not match.

    All must have the same kernel.  With the quadratic kernel, B and cutoff_B must be equal for all interacting pairs, or the forces have no
    potential (Warren, Phys. Rev. E 87, 045303 (2013)).  Types with NONE do not contribute to each other's density, which is consistent.
    """
    entries = [(pair, c) for pair, c in table.items() if c is not NONE]
    if not entries:
        raise ParameterError("a table of MDPD coefficients needs a pair of types that interacts")
    (first, reference), *others = entries
    same = {"kernel": "one table has one density"}
    if reference.kernel == "quadratic":
        why = "otherwise the many-body forces have no potential; or use kernel='lucy'"
        same |= {"B": why, "cutoff_B": why}
    for pair, c in others:
        for key, reason in same.items():
            one, other = getattr(reference, key), getattr(c, key)
            if one != other:
                raise ParameterError(
                    f"for types ({pair[0]}, {pair[1]}): {key} = {other!r} differs from {one!r} of types ({first[0]}, {first[1]}); "
                    f"give all pairs the same {key}: {reason}"
                )
    return reference


def why_no_openmm_force(table: Mapping, exceptions: dict[tuple[int, int], float], coincident: list[tuple[int, int]]) -> str | None:
    """Why only the pair kernel can compute the conservative force, or None; from a table, factors of bonded neighbours, and beads at the
    same point.  At r = 0 a CustomGBForce returns NaN or nonsense on every platform, even for excluded pairs."""
    if check_many_body(table).kernel != "quadratic":
        return "the force of MDPD with the Lucy kernel derives from no potential"
    scaled = next((pair for pair, factor in exceptions.items() if factor not in (0.0, 1.0)), None)
    if scaled is not None:
        return f"a CustomGBForce cannot scale single pairs, and that of {bead_names(*scaled)} has the factor {exceptions[scaled]:g}"
    if coincident:
        return f"a CustomGBForce has no finite force at r = 0, and {bead_names(*coincident[0])} are at the same point"
    return None
