"""What the simulation measures for one row of thermo output."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DeckSample:
    """One measurement, in MD units (nm, Da, ps, kJ/mol).  None means not measured; a thermo word that needs it then raises.

    Which optional fields a run needs is listed by ``RunRequest.thermo.needs``.

    Attributes
    ----------
    step : int
        Number of the step, as the deck counts.
    kinetic : float, optional
        Kinetic energy of all beads.
    pair_energy : float, optional
        Conservative pair energy, charges included.
    short_energy, lattice_energy : float, optional
        Of it, the short-ranged part and the lattice sum of charges.
    bond_energy, angle_energy, dihedral_energy : float, optional
        Energy of the bonds, the angles and the dihedrals.
    virial : float, optional
        Sum of r.F over everything that LAMMPS counts in ``press`` with this scheme: pairs and bonds, and with ``mvv`` the
        dissipative and random parts as well.
    virial_full : float, optional
        The same, always with the dissipative and random parts.
    virial_tensor, kinetic_tensor : (6,) arrays, optional
        xx, yy, zz, xy, xz, yz of what ``virial`` counts, and of the sum of m v v over all beads.
    force_norm, force_max : float, optional
        Euclidean norm of all force components, and the largest absolute one.
    kT_conf : float, optional
        Configurational temperature as an energy.
    box : (3, 3) array, optional
        Box vectors; the deck's box if None.
    positions, velocities : (N, 3) arrays, optional
        Needed by computes on groups and of single beads only.
    forces : (N, 3) array, optional
        Total forces, with friction and noise where they are forces (``mvv``).
    before : dict of (3,) arrays, optional
        Total force on the group of each fix addforce and setforce before it acted.
    fields : dict of arrays, optional
        The beads' fields, as :func:`openmm_dpd.fields.read_fields` gives them; empty if there are none.
    cpu : float
        Seconds since the run began.
    """

    step: int
    kinetic: float | None = None
    pair_energy: float | None = None
    short_energy: float | None = 0.0
    lattice_energy: float | None = 0.0
    bond_energy: float | None = 0.0
    angle_energy: float | None = 0.0
    dihedral_energy: float | None = 0.0
    virial: float | None = None
    virial_full: float | None = None
    virial_tensor: np.ndarray | None = None
    kinetic_tensor: np.ndarray | None = None
    force_norm: float | None = None
    force_max: float | None = None
    kT_conf: float | None = None
    box: np.ndarray | None = None
    positions: np.ndarray | None = None
    velocities: np.ndarray | None = None
    forces: np.ndarray | None = None
    before: Mapping[str, np.ndarray] | None = None
    fields: Mapping[str, np.ndarray] | None = None
    cpu: float = 0.0
