"""What this package takes from inside OpenMM's Python layer, which may change with any release: nothing else does.

``tests/unit/test_private_interfaces.py`` tries each part, and prints what to do where one has changed:

- ``bare``: ``quantity.value_in_unit_system(openmm.unit.md_unit_system)`` is the same, as a copy.
- ``vectors``: ``np.array(state.getPositions(asNumpy=True).value_in_unit(openmm.unit.nanometer))`` is the same, velocities alike.
- ``context_of``: use OpenMM's own way from an integrator to its Context if there is one now; else let ``simulation()`` of ``built.py`` call
  ``integrator.bind(simulation.context)``, and say in the documentation that other Contexts have to do so too.
- ``xtc_write_frame``: ``mdtraj.formats.XTCTrajectoryFile`` writes frames too.
"""

from gc import get_objects
from typing import Any

import numpy as np
import openmm
from openmm.app.internal.xtc_utils import xtc_write_frame


def bare(quantity: Any) -> Any:
    """What a Quantity in OpenMM's own units holds, not copied: that would take longer than the arithmetic of some steps."""
    return quantity._value


def vectors(state: openmm.State, kind: int) -> np.ndarray:
    """(N, 3) positions or velocities of a State, in MD units, as an array that is the caller's; faster than those with units."""
    found = np.empty((state._getNumParticles(), 3))
    state._getVectorAsNumpy(kind, found)
    return found


def context_of(integrator: openmm.Integrator) -> openmm.Context | None:
    """The Context that was made with an integrator, None without one.  OpenMM has no way from an integrator to its Context, so all of them
    get asked: it takes milliseconds to look for them, and to ask Python who refers to the integrator takes five times as long."""
    contexts = (one for one in get_objects() if issubclass(type(one), openmm.Context))
    return next((one for one in contexts if getattr(one, "_integrator", None) is integrator), None)


__all__ = ["bare", "context_of", "vectors", "xtc_write_frame"]
