"""What a configuration says, as numbers: what :class:`openmm_dpd.Observer` gives."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..base.errors import fact_table
from ..kernels.motion import largest, second_moments


@dataclass(frozen=True, kw_only=True)
class SystemSample:
    """What one configuration of any System says; MD units (nm, Da, ps, kJ/mol).

    Attributes
    ----------
    step, time : steps done and time
    n_mobile, dof : particles that move, and their degrees of freedom (:doc:`/theory`; of a System :func:`openmm_dpd.degrees_of_freedom`)
    kinetic, potential : energies
    volume : nm^3, or None without a box
    box : (3, 3) box vectors or None
    momentum : (3,) total momentum
    target_kT : thermal energy the thermostat is set to
    kT_atoms, kT_beads : kinetic temperatures of the particles of a System made elsewhere and of the beads beside them, each for its own
        degrees of freedom; None of a scene alone, or where there are no beads
    """

    step: int
    time: float
    n_mobile: int
    dof: int
    kinetic: float
    potential: float
    volume: float | None
    box: np.ndarray | None
    momentum: np.ndarray
    target_kT: float
    kT_atoms: float | None = None
    kT_beads: float | None = None
    _particles: ClassVar[str] = "particles"

    def __repr__(self) -> str:
        energies = f"kT = {self.kT:.6g}, potential = {self.potential:.8g}"
        return f"<{type(self).__name__} of step {self.step}: {self.n_mobile} {self._particles} that move, {energies}>"

    def _repr_html_(self) -> str:
        facts = {
            "step": self.step,
            "time": f"{self.time:g} ps",
            f"{self._particles} that move": self.n_mobile,
            "kT": f"{self.kT:.6g} kJ/mol",
            "kT that was set": f"{self.target_kT:g} kJ/mol",
            "potential energy": f"{self.potential:.8g} kJ/mol",
            "volume": None if self.volume is None else f"{self.volume:g} nm^3",
        }
        return fact_table(type(self).__name__, facts)

    @property
    def kT(self) -> float:
        """Kinetic temperature as an energy, 2K over the degrees of freedom."""
        return 2.0 * self.kinetic / self.dof if self.dof else 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class Sample(SystemSample):
    """What one configuration of a scene says: a :class:`SystemSample` term by term (pressures in kJ/mol/nm^3).

    Attributes
    ----------
    pair, bond, angle, dihedral : potential energies; those of segmental repulsion and of charges are in ``pair``
    coulomb_real, coulomb_reciprocal : of it, the short-ranged part of the charges and their lattice sum (0 without a box)
    other : potential energy of forces that somebody else added to the System; these do not count in virials and pressures
    virial_conservative, virial_dissipative, virial_random : sums of r_ij . F_ij; the last is 0 where noise is no force (all but ``mvv``)
    gradient2 : sum over mobile beads of the squared conservative force
    laplacian : sum over mobile beads of the Laplacian of the potential energy, or None (see ``no_laplacian``)
    kinetic_on_step : kinetic energy with the velocities of the same moment as the positions (``middle`` keeps them half a kick behind)
    kinetic_pressure : kinetic energy that pressures count, ``kinetic_on_step`` corrected for the scheme (see :doc:`/theory`)
    mobile : (N,) which beads move
    forces : (N, 3) all forces, of frozen beads as well (with friction and noise where they are forces, in ``mvv``)
    untaken : (N, 3) the same as if all forces acted on all beads (see ``Scene.interacting``)
    internal : sum of the internal energies, u (EnergyDPD) or C T (EDPD); None if the beads have none
    conductive : the conductive part of it (EnergyDPD)
    theta : harmonic mean of the internal temperatures, N/sum(1/theta), as an energy
    """

    pair: float
    bond: float
    angle: float
    dihedral: float
    coulomb_real: float
    coulomb_reciprocal: float
    other: float
    virial_conservative: float
    virial_dissipative: float
    virial_random: float
    gradient2: float
    laplacian: float | None
    kinetic_on_step: float
    kinetic_pressure: float
    mobile: np.ndarray
    forces: np.ndarray
    untaken: np.ndarray
    internal: float | None = None
    conductive: float | None = None
    theta: float | None = None
    _particles: ClassVar[str] = "beads"

    @property
    def force_norm(self) -> float:
        """Length of the vector of all forces on beads that move."""
        return float(second_moments(self.mobile.astype(float), self.forces)[:3].sum()) ** 0.5

    @property
    def force_max(self) -> float:
        """Its largest component."""
        return largest(self.forces[self.mobile])

    @property
    def total(self) -> float:
        """Potential, kinetic and internal energy of one moment: what energy-conserving DPD conserves."""
        return self.potential + self.kinetic_on_step + (self.internal or 0.0)

    @property
    def kT_conf(self) -> float | None:
        """This configuration's |grad U|^2 / lap U; average both before dividing."""
        return None if not self.laplacian else self.gradient2 / self.laplacian

    def pressure(self, full: bool = True) -> float | None:
        """(2K + W)/(3V), K = ``kinetic_pressure``, with all pair terms or with the conservative ones only; None without a box."""
        if self.volume is None:
            return None
        virial = self.virial_conservative + ((self.virial_dissipative + self.virial_random) if full else 0.0)
        return (2.0 * self.kinetic_pressure + virial) / (3.0 * self.volume)
