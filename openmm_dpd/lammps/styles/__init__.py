"""Pair, bond, angle and dihedral styles: their arguments, and the terms of the model that they become."""
