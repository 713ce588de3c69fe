"""What the user means, as frozen data: pair coefficients and tables of them, bonds, charges, walls, fields, the scene, words of schemes.

Everything is checked here and kept as read-only copies.  No OpenMM force, kernel or program.
"""
