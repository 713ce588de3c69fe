"""The commands that sum charges up: dielectric, kspace_style and special_bonds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...model.scene import Scene
from ...units import UnitSystem
from ..styles.charges import QQR2E
from ..styles.writing import exact


def charge_lines(scene: Scene, units: UnitSystem, of_deck: bool) -> Iterator[str]:
    """The commands dielectric and kspace_style.

    LAMMPS's accuracy is relative to the force between two unit charges at a unit distance without a dielectric; that of a scene is relative
    to the forces that there are.  A deck keeps its own number.
    """
    charges = scene.electrostatics
    if charges is None:
        return
    assert scene.charges is not None
    strength = charges.coulomb(scene.initial_kT) / (units.energy * units.length)
    yield f"dielectric {exact(QQR2E[units.name] / strength)}"
    if scene.box is None:
        return
    accuracy = charges.tolerance
    if not of_deck:
        charged = scene.charges[scene.charges != 0]
        distance = (float(np.linalg.det(scene.box)) / max(1, len(charged))) ** (1 / 3) / units.length
        force = strength * float(np.mean(charged**2)) / distance**2 if len(charged) else 1.0
        accuracy *= min(1.0, force / QQR2E[units.name])
    yield f"kspace_style pppm {exact(accuracy)}"


def special_line(scene: Scene) -> str:
    """The special_bonds command; charges may have factors of their own."""
    factors = getattr(scene.electrostatics, "special", None)
    if factors is None or tuple(factors) == tuple(scene.special):
        return "special_bonds lj/coul " + " ".join(map(exact, scene.special))
    return f"special_bonds lj {' '.join(map(exact, scene.special))} coul {' '.join(map(exact, factors))}"
