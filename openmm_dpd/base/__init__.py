"""What every room may use: errors and their wording, units, names of context parameters, geometry, files that are whole, averages.

It imports from no other room.
"""
