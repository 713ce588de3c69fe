"""Used by every room: errors and their wording, units, names of context parameters, geometry, files written whole, averages.

It imports from no other room.
"""
