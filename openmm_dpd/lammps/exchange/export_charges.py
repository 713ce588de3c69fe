"""Smeared charges of a scene in LAMMPS's words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations_with_replacement

import numpy as np

from ...errors import ParameterError
from ...model.electrostatics import GaussianCharges, SlaterCharges, ewald_sum
from ...model.scene import Scene
from ...units import UnitSystem
from .export_pairs import StyleUse
from .export_words import Differences, number

#: LAMMPS's Coulomb constant in each of its unit styles (energy times length per charge squared).
COULOMB_CONSTANTS = {"lj": 1.0, "real": 332.06371, "metal": 14.399645}


def charge_use(scene: Scene, units: UnitSystem, types: list[str], differences: Differences) -> StyleUse | None:
    """Pair style of the charges, or None.

    Raises
    ------
    ParameterError
        If charges and walls are combined: LAMMPS's sums over all images need a periodic box.
    """
    charges = scene.electrostatics
    if charges is None:
        return None
    if scene.walls:
        raise ParameterError("charges between walls cannot be exported: LAMMPS's sums over all images need a box that is periodic")
    width = _width(charges, differences)
    words = dict.fromkeys(combinations_with_replacement(types, 2), "")
    if scene.box is None:
        # no cutoff in the scene, so one that no pair reaches
        reach = 2.0 * float(np.linalg.norm(np.ptp(scene.positions, axis=0))) + 10 * width
        differences.remark(f"charges interact up to a distance of {number(reach / units.length)}, which should be beyond all pairs")
        return StyleUse("coul/slater/cut", f"{number(width / units.length)} {number(reach / units.length)}", words, reach)
    assert scene.charges is not None
    reach = ewald_sum(charges, scene.box, int(np.count_nonzero(scene.charges))).cutoff
    return StyleUse("coul/slater/long", f"{number(width / units.length)} {number(reach / units.length)}", words, reach)


def _width(charges, differences: Differences) -> float:
    """LAMMPS's lambda, nm."""
    if isinstance(charges, SlaterCharges):
        return charges.lamda
    assert isinstance(charges, GaussianCharges)
    width = math.sqrt(math.pi) * charges.width
    differences.add(
        f"the Gaussian charges (width {charges.width:g}) are replaced by Slater charges with lambda = {width:g}, with the same energy "
        "at contact; they reach further out"
    )
    return width


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
    yield f"dielectric {number(COULOMB_CONSTANTS[units.name] / strength)}"
    if scene.box is None:
        return
    accuracy = charges.tolerance
    if not of_deck:
        charged = scene.charges[scene.charges != 0]
        distance = (float(np.linalg.det(scene.box)) / max(1, len(charged))) ** (1 / 3) / units.length
        force = strength * float(np.mean(charged**2)) / distance**2 if len(charged) else 1.0
        accuracy *= min(1.0, force / COULOMB_CONSTANTS[units.name])
    yield f"kspace_style pppm {number(accuracy)}"


def special_line(scene: Scene) -> str:
    """The special_bonds command; charges may have factors of their own."""
    factors = getattr(scene.electrostatics, "special", None)
    if factors is None or tuple(factors) == tuple(scene.special):
        return "special_bonds lj/coul " + " ".join(map(number, scene.special))
    return f"special_bonds lj {' '.join(map(number, scene.special))} coul {' '.join(map(number, factors))}"
