"""Trajectories, topologies, PDB files and plots: written, read with mdtraj, drawn."""
