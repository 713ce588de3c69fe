"""Random decks, run by LAMMPS and by openmm_dpd, and compared."""
