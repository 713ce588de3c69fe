"""Trajectories, topologies, PDB files and pictures: written, read with mdtraj, drawn."""
