"""From measured numbers to coefficients."""
