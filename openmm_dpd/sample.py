"""What a configuration says, as numbers: what :class:`openmm_dpd.Observer` gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .html import fact_table


@dataclass(frozen=True)
class Sample:
    """What one configuration says; MD units (nm, Da, ps, kJ/mol; pressures in kJ/mol/nm^3).

    Attributes
    ----------
    step, time : steps done and time
    n_mobile, dof : beads that move, and their degrees of freedom, 3N - 3 (of atoms and beads: :func:`openmm_dpd.degrees_of_freedom`)
    kinetic, pair, bond, angle : energies; those of segmental repulsion and of charges are in ``pair``
    coulomb_real, coulomb_reciprocal : of it, the short-ranged part of the charges and their lattice sum (0 without a box)
    virial_conservative, virial_dissipative, virial_random : sums of r_ij . F_ij
    volume : nm^3, or None without a box
    box : (3, 3) box vectors or None
    gradient2 : sum over mobile beads of the squared conservative force
    force_norm, force_max : length of the vector of all forces, and its largest component (with friction and noise where they are forces, in
        ``mvv``)
    laplacian : sum over mobile beads of the Laplacian of the potential energy, or None (see ``no_laplacian``)
    momentum : (3,) total momentum
    target_kT : thermal energy the thermostat is set to
    kinetic_on_step : kinetic energy with the velocities of the same moment as the positions (``middle`` keeps them half a kick behind)
    internal : sum of the internal energies, u (EnergyDPD) or C T (EDPD); None if the beads have none
    conductive : the conductive part of it (EnergyDPD)
    theta : harmonic mean of the internal temperatures, N/sum(1/theta), as an energy
    forces : (N, 3) all forces, of frozen beads as well (with friction and noise where they are forces, in ``mvv``)
    other : potential energy of forces that somebody else added to the System; these do not count in virials and pressures
    potential_total : potential energy of atoms and beads in one System (:func:`openmm_dpd.create_mixed_system`), or None
    kT_atoms, kT_beads : kinetic temperatures of the parts of such a System, each for its own degrees of freedom, or None

    Of atoms and beads in one System, ``potential_total``, ``kinetic``, ``kT``, ``kT_atoms``, ``kT_beads``, ``momentum``, ``volume``,
    ``box`` and ``target_kT`` are measured; there is no ``forces``, no ``laplacian`` and no ``configurational_kT``, and every other
    number, with the pressure, is NaN.
    """

    step: int
    time: float
    n_mobile: int
    dof: int
    kinetic: float
    pair: float
    bond: float
    virial_conservative: float
    virial_dissipative: float
    virial_random: float
    volume: float | None
    box: np.ndarray | None
    gradient2: float
    force_norm: float
    force_max: float
    laplacian: float | None
    momentum: np.ndarray
    target_kT: float
    kinetic_on_step: float = 0.0
    internal: float | None = None
    conductive: float | None = None
    theta: float | None = None
    forces: np.ndarray | None = None
    angle: float = 0.0
    coulomb_real: float = 0.0
    coulomb_reciprocal: float = 0.0
    other: float = 0.0
    potential_total: float | None = None
    kT_atoms: float | None = None
    kT_beads: float | None = None

    def __repr__(self) -> str:
        return f"<Sample of step {self.step}: {self.n_mobile} beads that move, kT = {self.kT:.6g}, potential = {self.potential:.8g}>"

    def _repr_html_(self) -> str:
        facts = {
            "step": self.step,
            "time": f"{self.time:g} ps",
            "beads that move": self.n_mobile,
            "kT": f"{self.kT:.6g} kJ/mol",
            "kT that was set": f"{self.target_kT:g} kJ/mol",
            "potential energy": f"{self.potential:.8g} kJ/mol",
            "volume": None if self.volume is None else f"{self.volume:g} nm^3",
        }
        return fact_table("Sample", facts)

    @property
    def total(self) -> float:
        """Potential, kinetic and internal energy of one moment: what energy-conserving DPD conserves."""
        return self.potential + self.kinetic_on_step + (self.internal or 0.0)

    @property
    def potential(self) -> float:
        """Potential energy: pairs, bonds, angles, and what somebody else added (everything of atoms beside beads)."""
        if self.potential_total is not None:
            return self.potential_total
        return self.pair + self.bond + self.angle + self.other

    @property
    def kT(self) -> float:
        """Kinetic temperature as an energy, 2K over the degrees of freedom."""
        return 2.0 * self.kinetic / self.dof if self.dof else 0.0

    @property
    def configurational_kT(self) -> float | None:
        """This configuration's |grad U|^2 / lap U; average both before dividing."""
        return None if not self.laplacian else self.gradient2 / self.laplacian

    def pressure(self, full: bool = True) -> float | None:
        """(2K + W)/(3V) with all pair terms, or with the conservative ones only; None without a box."""
        if self.volume is None:
            return None
        virial = self.virial_conservative + ((self.virial_dissipative + self.virial_random) if full else 0.0)
        return (2.0 * self.kinetic + virial) / (3.0 * self.volume)


__all__ = ["Sample"]
