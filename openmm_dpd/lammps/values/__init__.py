"""Values that columns and formulas can name: thermo words, computes, variables."""
