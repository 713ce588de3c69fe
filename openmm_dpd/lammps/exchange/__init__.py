"""The way back: scenes as decks for LAMMPS, and what LAMMPS writes as arrays, scenes and trajectories."""
