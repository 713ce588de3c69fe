"""What a deck prints and writes: thermo output, averages, dumps, data files."""
