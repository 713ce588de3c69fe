"""Compiled pair terms: arrays in, arrays out.  Nothing here knows OpenMM or the model."""
