"""Published models, as data."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..base.errors import ParameterError, what_is
from ..base.units import whole_number
from ..model.pairs import DPD, checked
from .builders import lipid
from .molecule import Molecule
from .terms import CosineBend, Spring


@dataclass(frozen=True)
class Model:
    """A molecule and the repulsion between all types, in reduced units: r_c = 1 nm, kT = 1 kJ/mol, m = 1 Da.

    Attributes
    ----------
    molecule : Molecule
    repulsion : mapping of (str, str) to float
        a_ij, for every pair of types and the solvent.
    gamma : float
        Friction.
    density : float
        Beads per r_c^3.
    source : str
        Where the numbers were published.
    """

    molecule: Molecule
    repulsion: Mapping[tuple[str, str], float]
    gamma: float
    density: float
    source: str

    def pairs(self, gamma: float | None = None) -> dict[tuple[str, str], DPD]:
        """Pair coefficients for ``Scene(pairs=...)``, with another friction than the published one if given."""
        friction = self.gamma if gamma is None else gamma
        return {pair: DPD(A=a, gamma=friction, cutoff=1.0) for pair, a in self.repulsion.items()}


def grafmueller_2009(tail: int = 4) -> Model:
    """H3(T_n)2 lipid with two stiff tails in water W; four tail beads make a lipid like DMPC.

    Repulsion a_ij (kT/r_c) H-H 30, T-T 10, W-W 25, H-T 35, H-W 30, T-W 75; friction 4.5; density 3.  Bonds (1/2) k2 (r - l0)^2 with
    k2 = 128 and l0 = 0.5, that is ``Spring(k=64, r0=0.5)`` here.  Bends k3 (1 - cos phi), k3 = 15, phi = 0 for a straight tail, at every
    H-T-T and T-T-T, that is ``CosineBend(15)``.  The second and the third of the three head beads in a row carry a tail each.

    Grafmueller, Shillcock and Lipowsky, Biophys. J. 96, 2658 (2009), with the numbers as they are in the bilayer that is distributed
    with Osprey-DPD, the program of one of the authors.
    """
    whole_number(tail, "the number of beads in a tail", least=1)
    bend = CosineBend(15.0)
    molecule = lipid("H3", [["T"] * tail] * 2, Spring(64.0, 0.5), {("H", "T", "T"): bend, ("T", "T", "T"): bend})
    repulsion = {("H", "H"): 30.0, ("T", "T"): 10.0, ("W", "W"): 25.0, ("H", "T"): 35.0, ("H", "W"): 30.0, ("T", "W"): 75.0}
    return Model(molecule, repulsion, 4.5, 3.0, "Grafmueller, Shillcock and Lipowsky, Biophys. J. 96, 2658 (2009)")


def like_repulsion(density: float = 3.0) -> float:
    """a_ii = 75 kT/(rho r_c^4), in reduced units; Groot and Warren, J. Chem. Phys. 107, 4423 (1997)."""
    return 75.0 / checked(density, "dimensionless", "density", positive=True)


def unlike_repulsion(chi: float, density: float = 3.0) -> float:
    """a_ij from a Flory-Huggins parameter: a_ii + chi/0.286 at density 3, a_ii + chi/0.689 at density 5; chi is per bead.

    Groot and Warren, J. Chem. Phys. 107, 4423 (1997).  For single beads; chains: :func:`openmm_dpd.parameters.repulsion_from_chi`.
    """
    slopes = {3.0: 0.286, 5.0: 0.689}
    if density not in (3, 5):
        raise ParameterError(f"the relation of a to chi is known for the densities 3 and 5, not {what_is(density)}")
    return like_repulsion(density) + checked(chi, "dimensionless", "chi", signed=True) / slopes[float(density)]
