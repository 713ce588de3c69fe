"""Scenes from files and topologies of other programs; the public module is :mod:`openmm_dpd.inputs`."""
