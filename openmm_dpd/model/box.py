"""The periodic box of a scene."""

import numpy as np

from ..base.errors import ParameterError
from ..base.units import to_md


def box_vectors(box) -> np.ndarray | None:
    """Box vectors a, b, c as rows (3, 3), in OpenMM's reduced lower-triangular form, or None.  ParameterError if the box is neither three
    edges nor three vectors, an edge is not positive, or the vectors are not in reduced form."""
    if box is None:
        return None
    array = np.asarray(to_md(box, "length", "box"))
    if array.shape == (3,):
        array = np.diag(array)
    if array.shape != (3, 3):
        raise ParameterError(f"box must be three edge lengths or three box vectors, not an array of shape {array.shape}")
    if np.any(np.diag(array) <= 0):
        raise ParameterError(f"every edge of the box must be > 0, but its diagonal is {np.diag(array).tolist()}")
    if np.any(np.abs(np.triu(array, 1)) > 0):
        raise ParameterError("box vectors must be lower triangular: a along x, b in the xy plane")
    a, b, c = array
    # the tolerance admits tilt factors of exactly half an edge, which LAMMPS allows
    slack = 1 + 1e-9
    if 2 * abs(b[0]) > a[0] * slack or 2 * abs(c[0]) > a[0] * slack or 2 * abs(c[1]) > b[1] * slack:
        raise ParameterError(
            "box vectors must be in OpenMM's reduced form (|b_x| <= a_x/2, |c_x| <= a_x/2, |c_y| <= b_y/2); "
            "openmm.app.internal.unitcell.reducePeriodicBoxVectors converts them"
        )
    return array
