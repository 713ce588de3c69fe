"""Scene and choices to a frozen :class:`Plan`, before anything is built: who computes what, and why.

``kinds/`` has a record for each kind of pair coefficients, ``forces/`` the OpenMM forces that a plan asks for.
"""
