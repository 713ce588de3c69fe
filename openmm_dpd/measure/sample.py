"""Measured quantities of one configuration, as :class:`openmm_dpd.Observer` returns them."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..base.errors import fact_table
from ..kernels.motion import largest, moments


@dataclass(frozen=True, kw_only=True)
class SystemSample:
    """Measured quantities of one configuration of any System; MD units (nm, Da, ps, kJ/mol).

    Attributes
    ----------
    step, time : steps done, and time
    n_mobile, dof : mobile particles and their degrees of freedom (:doc:`/theory`; of a System :func:`openmm_dpd.degrees_of_freedom`)
    kinetic, potential : energies
    volume : nm^3, or None without a box
    box : (3, 3) box vectors, or None
    momentum : (3,) total momentum
    target_kT : thermal energy the thermostat is set to
    kT_atoms, kT_beads : kinetic temperatures of the particles of a System made elsewhere and of the beads beside them, each with its own
        degrees of freedom; None for a scene, or where there are no beads
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
        return f"<{type(self).__name__} of step {self.step}: {self.n_mobile} mobile {self._particles}, {energies}>"

    def _repr_html_(self) -> str:
        facts = {
            "step": self.step,
            "time": f"{self.time:g} ps",
            f"mobile {self._particles}": self.n_mobile,
            "kT": f"{self.kT:.6g} kJ/mol",
            "set kT": f"{self.target_kT:g} kJ/mol",
            "potential energy": f"{self.potential:.8g} kJ/mol",
            "volume": None if self.volume is None else f"{self.volume:g} nm^3",
        }
        return fact_table(type(self).__name__, facts)

    @property
    def kT(self) -> float:
        """Kinetic temperature as an energy, kJ/mol: 2K over the degrees of freedom."""
        return 2.0 * self.kinetic / self.dof if self.dof else 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class Sample(SystemSample):
    """Measured quantities of one configuration of a scene: a :class:`SystemSample` term by term (pressures in kJ/mol/nm^3).

    Attributes
    ----------
    pair, bond, angle, dihedral, improper : potential energies; ``pair`` includes segmental repulsion and charges
    coulomb_real, coulomb_reciprocal : short-range and lattice energy of the charges, as included in ``pair`` (0 without a box)
    other : potential energy of foreign forces in the System, which virials and pressures leave out
    virial_conservative, virial_dissipative, virial_random : sums of r_ij . F_ij; the last is 0 where noise is no force (all but ``mvv``)
    gradient2 : sum over mobile beads of the conservative force F squared; of F (F - f) where body forces and buoyancy f act
    laplacian : sum over mobile beads of the Laplacian of the potential energy, or None (see ``no_laplacian``)
    kinetic_on_step : kinetic energy from velocities at the time of the positions (``middle`` keeps them half a kick behind)
    kinetic_pressure : kinetic energy in pressures, ``kinetic_on_step`` corrected for the scheme (see :doc:`/theory`)
    mobile : (N,) which beads move
    forces : (N, 3) total forces, of immobile beads as well (with friction and noise where they are forces, in ``mvv``)
    untaken : (N, 3) total forces if all forces acted on all beads (see ``Scene.interacting``)
    internal : sum of the internal energies, u (EnergyDPD) or C T (EDPD); None if the beads have none
    conductive : conductive part of the internal energy (EnergyDPD)
    theta : harmonic mean of the internal temperatures, N/sum(1/theta), as an energy
    """

    pair: float
    bond: float
    angle: float
    dihedral: float
    improper: float
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
        """Euclidean norm of the forces on all mobile beads, kJ/mol/nm."""
        return float(moments(self.mobile.astype(float), self.forces)[:3].sum()) ** 0.5

    @property
    def force_max(self) -> float:
        """Largest force component on a mobile bead by magnitude, kJ/mol/nm."""
        return largest(self.forces[self.mobile])

    @property
    def total(self) -> float:
        """Potential plus kinetic plus internal energy, kJ/mol, which energy-conserving DPD conserves."""
        return self.potential + self.kinetic_on_step + (self.internal or 0.0)

    @property
    def kT_conf(self) -> float | None:
        """|grad U|^2 / lap U of this configuration, kJ/mol; for a mean, average numerator and denominator first.  None without lap U."""
        return None if not self.laplacian else self.gradient2 / self.laplacian

    def pressure(self, full: bool = True) -> float | None:
        """(2K + W)/(3V), kJ/mol/nm^3, with K = ``kinetic_pressure``; W of all pair terms, or the conservative ones.  None without a box."""
        if self.volume is None:
            return None
        virial = self.virial_conservative + ((self.virial_dissipative + self.virial_random) if full else 0.0)
        return (2.0 * self.kinetic_pressure + virial) / (3.0 * self.volume)
