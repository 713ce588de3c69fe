"""Pair, bond and angle styles: their words, and the terms of the model that they become."""
