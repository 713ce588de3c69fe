"""Partition coefficients of molecules between two solvents: from theory, from runs, and the repulsion for a given one.

log P = log10 of c_octanol/c_water at infinite dilution; "octanol" stands for any solvent other than water in the model.
"""

import math

import numpy as np
from scipy.optimize import brentq

from ..base.errors import ParameterError
from ..base.units import whole_number
from ..model.pairs import checked
from ..model.scene import Scene
from ..molecules import Molecule
from .estimate import Estimate
from .insertion import excess_chemical_potential
from .insertion_scene import between, check

_LN10 = math.log(10.0)
_FLORY = "Flory, Principles of Polymer Chemistry (1953)"


def _number(value, name: str) -> tuple[float, float | None]:
    """Value and error of a number of either sign, bare (error None) or an Estimate."""
    error = value.error if isinstance(value, Estimate) else None
    return checked(value.value if isinstance(value, Estimate) else value, "dimensionless", name, signed=True), error


def chi_from_log_p(logp, beads: int, *, chi_octanol=0.0, octanol_beads: int = 1, water_beads: int = 1) -> Estimate:
    r"""Flory-Huggins parameter between a molecule's beads and water for a given log P.

    In Flory-Huggins theory a molecule of N_s beads, at infinite dilution in a solvent of molecules of N beads, has the chemical potential

    .. math:: \mu/k_BT = \ln\phi + 1 - N_s/N + N_s \chi ,

    where phi is its volume fraction and chi is per bead.  It is equal in both solvents, w and o, if

    .. math:: \ln\frac{\phi_o}{\phi_w} = N_s (\chi_{sw} - \chi_{so}) + N_s \left(\frac{1}{N_o} - \frac{1}{N_w}\right) .

    The left side is ln 10 log P, since the molecule has the same volume in both.

    Parameters
    ----------
    logp : float or Estimate
        log10 of c_octanol/c_water, of either sign.
    beads : int
        Beads per molecule, N_s.
    chi_octanol : float or Estimate, default 0
        chi between the molecule's beads and the other solvent, averaged over its beads.
    octanol_beads, water_beads : int, default 1
        Beads per solvent molecule, N_o and N_w.

    Returns
    -------
    Estimate
        chi between the molecule's beads and water, which may be negative; its error is that of the arguments, not of the theory.

    Raises
    ------
    ParameterError
        If a value is out of bounds.

    Notes
    -----
    The theory counts the neighbours of single beads.  Bonded beads have fewer contacts, and at infinite dilution chi differs from that of
    mixtures; docs/howto/partition.md shows the resulting error of the partition coefficient.

    References
    ----------
    P. J. Flory, Principles of Polymer Chemistry (1953), chapter XII.

    Examples
    --------
    >>> round(chi_from_log_p(3.9, 1).value, 3)
    8.98
    >>> round(chi_from_log_p(5.15, 3, octanol_beads=3).value, 3)
    4.619
    """
    given = {"beads": beads, "octanol_beads": octanol_beads, "water_beads": water_beads}
    size, octanol, water = (whole_number(value, name, least=1) for name, value in given.items())
    (wanted, error), (chi, chi_error) = _number(logp, "log P"), _number(chi_octanol, "chi_octanol")
    known = [e for e in (None if error is None else _LN10 * error / size, chi_error) if e is not None]
    value = chi + _LN10 * wanted / size + 1 / water - 1 / octanol
    return Estimate(value, math.hypot(*known) if known else None, _FLORY, {})


def log_p(molecule: Molecule, octanol: Scene, water: Scene, **options) -> Estimate:
    r"""log P of a molecule between two solvents,

    .. math:: \log P = \log_{10} \frac{c_o}{c_w} = \frac{\mu_{ex,w} - \mu_{ex,o}}{k_BT \ln 10} ,

    from two runs of :func:`excess_chemical_potential`.

    Parameters
    ----------
    molecule : Molecule
    octanol, water : Scene
        The two solvents, at the same temperature, each with masses and pair coefficients of the molecule's beads.
    **options
        Options of :func:`excess_chemical_potential`: ``time``, ``settle``, ``copies``, ``dt``, ``seed``, ``platform``.

    Returns
    -------
    Estimate
        log P with its standard error.

    Raises
    ------
    ParameterError
        If the temperatures differ, or :func:`excess_chemical_potential` refuses molecule, solvents or options.
    """
    _check_both(molecule, octanol, water)
    there, here = (excess_chemical_potential(molecule, solvent, **options) for solvent in (octanol, water))
    return Estimate((here.value - there.value) / _LN10, math.hypot(here.error, there.error) / _LN10, "openmm_dpd.parameters.log_p", {})


def repulsion_from_log_p(logp, molecule: Molecule, octanol: Scene, water: Scene, **options) -> Estimate:
    r"""Repulsion between a molecule's beads and water for a given log P.

    Two runs are made.  One gives the chemical potential in the other solvent.  The one in water gives it for all repulsions up to that of
    the scene, since one factor switches all of it on; A_sw is where it equals that in the other solvent plus kT ln 10 log P.

    Parameters
    ----------
    logp : float or Estimate
    molecule : Molecule
        A molecule whose beads all repel water with the same A.  (For beads of several kinds, find one repulsion after the other, from
        molecules with one new kind each; if a molecule has several, vary one A until :func:`log_p` is right.)
    octanol, water : Scene
        The two solvents, as in :func:`log_p`.  A between molecule and water is the upper limit of A_sw; the other solvent is not changed.
    **options
        Options of :func:`excess_chemical_potential`.

    Returns
    -------
    Estimate
        A_sw in the units of the scenes (kJ/mol/nm, or reduced), with the standard error of both runs.

    Raises
    ------
    ParameterError
        If the beads of the molecule repel water with different A, no repulsion up to that of the scene gives this log P (the message has
        the range), or :func:`excess_chemical_potential` refuses an argument.
    """
    wanted, given = _number(logp, "log P")
    _check_both(molecule, octanol, water)
    top = _one_repulsion(molecule, water)
    there, here = (excess_chemical_potential(molecule, solvent, **options) for solvent in (octanol, water))
    target = there.value + _LN10 * wanted
    if not 0 <= target <= here.value:
        least, most = -there.value / _LN10, (here.value - there.value) / _LN10
        raise ParameterError(f"A = 0 to {top:g} between {molecule.name} and water gives log P = {least:.2f} to {most:.2f}, not {wanted:g}")
    part = float(brentq(lambda x: here.at(x).value - target, 0.0, 1.0))
    step = 0.02
    low, high = max(0.0, part - step), min(1.0, part + step)
    slope = here.at(high, low).value / (high - low)
    error = math.hypot(here.at(part).error or 0.0, there.error, _LN10 * (given or 0.0)) / slope
    return Estimate(top * part, top * error, "openmm_dpd.parameters.repulsion_from_log_p", {"A": (0.0, top)})


def _check_both(molecule: Molecule, octanol: Scene, water: Scene) -> None:
    for solvent in (octanol, water):
        check(molecule, solvent)
    if octanol.kT != water.kT:
        raise ParameterError(f"the solvents have different temperatures, kT = {octanol.kT} and {water.kT}")


def _one_repulsion(molecule: Molecule, water: Scene) -> float:
    """The common A between the molecule's beads and water; ParameterError if there is none."""
    tables = [table.resolve(water.type_names) for table in water.tables if table.kind is not None]
    present = np.unique(water.type_ids)
    A = sum(between(table, molecule, water)[0][:, present] for table in tables)
    found = sorted(set(np.round(np.ravel(A), 9).tolist()))
    if len(found) != 1 or found[0] <= 0:
        listed = ", ".join(f"{value:g}" for value in found)
        raise ParameterError(f"the beads of {molecule.name} must all repel water with one A > 0, but they have A = {listed}")
    return found[0]
