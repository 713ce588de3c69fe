"""OpenMM forces: each function takes parts of a plan and returns a force."""
