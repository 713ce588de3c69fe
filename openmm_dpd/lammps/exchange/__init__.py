"""Export of scenes as decks for LAMMPS, and import of LAMMPS output as arrays, scenes and trajectories."""
