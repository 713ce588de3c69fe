"""The input as frozen data: pair coefficients and tables, bonds, charges, walls, fields, the scene, words of schemes.

All input is checked here and stored as read-only copies.  There are no OpenMM forces, kernels or programs in this room.
"""
