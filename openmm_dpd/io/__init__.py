"""Trajectories, topologies and pictures: written, read with mdtraj, drawn, and written for other programs (``outputs/``)."""
