"""Pair styles with charges."""

import math
from itertools import combinations_with_replacement

import numpy as np

from ...errors import ParameterError
from ...model.electrostatics import GaussianCharges, SlaterCharges, ewald_sum
from ...model.scene import Scene
from ...units import UnitSystem
from ..language import arguments as read
from ..state.pair_setup import Find, PairStyle, Spec, Values
from .columns import cutoff_of, no_force
from .dpd import STYLES as DPD_STYLES
from .writing import Differences, StyleUse, exact

#: Coulomb constant of LAMMPS's unit styles, energy times length per squared charge.
QQR2E = {"lj": 1.0, "real": 332.06371, "metal": 14.399645}


def _dpd_slater_settings(words: list[str]) -> dict:
    """``dpd/coul/slater/long T cut_dpd seed lambda cut_coul``."""
    read.count(words, "dpd/coul/slater/long T cut_dpd seed lambda cut_coul", 5)
    name = "of dpd/coul/slater/long"
    temperature = read.non_negative(words[0], f"the temperature {name}")
    return {
        "start": temperature,
        "stop": temperature,
        "cutoff": read.positive(words[1], f"the cutoff {name}"),
        "seed": read.integer(words[2], f"the seed {name}", 1),
        "lamda": read.positive(words[3], f"lambda {name}"),
        "cutoff_charges": read.positive(words[4], f"the cutoff of the charges {name}"),
    }


def _dpd_slater_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    """``A gamma [yes|no] [cutoff]``."""
    read.count(words, "A gamma [yes|no] [cutoff]", 2, 4)
    values: dict = {key: read.number(word, key) for key, word in zip(("A", "gamma"), words, strict=False)}
    values["charged"] = "yes" if len(words) > 2 and read.switch(words[2], "whether the pair is charged") else "no"
    return values, cutoff_of(words, 3)


def _slater_settings(words: list[str]) -> dict:
    """``coul/slater/long lambda cutoff``."""
    read.count(words, "coul/slater/long lambda cutoff", 2)
    lamda, cutoff = (read.positive(w, f"{what} of coul/slater/long") for w, what in zip(words, ("lambda", "the cutoff"), strict=True))
    return {"lamda": lamda, "cutoff_charges": cutoff}


def _slater_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    """No coefficients: ``pair_coeff * *``."""
    read.count(words, "pair_coeff i j (coul/slater/long has no coefficients)", 0)
    return {}, None


STYLES = {
    # its build makes the DPD part; charges are those of the beads
    "dpd/coul/slater/long": Spec(_dpd_slater_settings, _dpd_slater_coefficient, DPD_STYLES["dpd"].build, thermostat=True),
    "coul/slater/long": Spec(_slater_settings, _slater_coefficient, no_force, own_cutoffs=True),
}


# -- from a scene -------------------------------------------------------------------------------------------------------------
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
        differences.remark(f"charges interact up to a distance of {exact(reach / units.length)}, which should be beyond all pairs")
        return StyleUse("coul/slater/cut", f"{exact(width / units.length)} {exact(reach / units.length)}", words, reach)
    assert scene.charges is not None
    reach = ewald_sum(charges, scene.box, int(np.count_nonzero(scene.charges))).cutoff
    return StyleUse("coul/slater/long", f"{exact(width / units.length)} {exact(reach / units.length)}", words, reach)


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
