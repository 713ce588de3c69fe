"""Output of a deck: thermo output, averages and dumps."""
