"""Private parts of OpenMM's Python layer, which may change with any release; all uses are in this file.

``tests/core/test_private_interfaces.py`` tries each part, and prints what to do if one has changed:

- ``bare``: ``quantity.value_in_unit_system(openmm.unit.md_unit_system)`` is the same, as a copy.
- ``masses_of``: ``np.array([system.getParticleMass(k).value_in_unit(openmm.unit.dalton) for k in range(n)])`` is the same,
  ``virtual_sites``: ``np.array([system.isVirtualSite(k) for k in range(n)])``.
- ``vectors``: ``np.array(state.getPositions(asNumpy=True).value_in_unit(openmm.unit.nanometer))`` is the same, velocities alike.
- ``hear_calls``: use OpenMM's own way from an integrator to its Context if there is one now; else let ``simulation()`` of
  ``built.py`` call ``integrator.bind(simulation.context)``, and say in the documentation that other Contexts have to do so too.
- ``xtc_write_frame``: ``mdtraj.formats.XTCTrajectoryFile`` writes frames too.
"""

from collections.abc import Callable
from functools import partial, wraps
from typing import Any

import numpy as np
import openmm
from openmm import _openmm
from openmm.app.internal.xtc_utils import xtc_write_frame


def bare(quantity: Any) -> Any:
    """Value of a Quantity in OpenMM's own units, not copied, since a copy takes longer than the arithmetic of some steps."""
    return quantity._value


def masses_of(system: openmm.System) -> np.ndarray:
    """(N,) masses of all particles, Da; to make a Quantity of each takes ten times as long."""
    mass = partial(_openmm.System_getParticleMass, system)
    return np.array(list(map(mass, range(system.getNumParticles()))), dtype=float)


def virtual_sites(system: openmm.System) -> np.ndarray:
    """(N,) which particles are virtual sites."""
    is_one = partial(_openmm.System_isVirtualSite, system)
    return np.array(list(map(is_one, range(system.getNumParticles()))), dtype=bool)


def vectors(state: openmm.State, kind: int) -> np.ndarray:
    """(N, 3) positions or velocities of a State, in MD units, as an array that the caller owns; faster than those with units."""
    found = np.empty((state._getNumParticles(), 3))
    state._getVectorAsNumpy(kind, found)
    return found


def hear_calls(kind: type, name: str, listener: Callable[[openmm.Context], None]) -> None:
    """Call ``listener`` with the Context at the end of a method of an OpenMM class: with ``__init__`` of Context, which subclasses call
    too, for each Context made from now on.  OpenMM has no way from an integrator to its Context, and a search of Python's objects breaks
    what other threads are building."""
    method = getattr(kind, name)

    @wraps(method)
    def heard(*arguments, **more):
        method(*arguments, **more)
        listener(next(one for one in (*arguments, *more.values()) if isinstance(one, openmm.Context)))

    setattr(kind, name, heard)


__all__ = ["bare", "hear_calls", "masses_of", "vectors", "virtual_sites", "xtc_write_frame"]
