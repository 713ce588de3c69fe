"""What other programs write as arrays of beads, and scenes made of them; :mod:`openmm_dpd.inputs` has all of it."""
