"""Computes: values of groups of beads that thermo output and formulas can name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ParameterError
from . import arguments as read

if TYPE_CHECKING:
    from .context import Context
    from .state import DeckState


@dataclass(frozen=True)
class Compute:
    """One compute as the deck defines it: id, group, style and parsed arguments."""

    name: str
    group: str
    style: str
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True)
class ComputeSpec:
    """A compute style.

    Attributes
    ----------
    check : callable
        Raises ParameterError if the arguments (state, group, words) are not supported.
    scalar : callable or None
        From (context, compute) to its value in deck units, not normalised.
    vector : callable or None
        The same for an array of values.
    extensive : bool
        Whether thermo output divides it by the number of beads when it normalises.
    needs : tuple of str
        Fields of Sample that it reads.
    """

    check: Callable[[DeckState, str, list[str]], None]
    scalar: Callable[[Context, Compute], float] | None = None
    vector: Callable[[Context, Compute], np.ndarray] | None = None
    extensive: bool = False
    needs: tuple[str, ...] = ()


def _no_arguments(state: DeckState, group: str, words: list[str]) -> None:
    read.count(words, "compute ID group style (and no more)", 0)


def _all_only(style: str, allowed: tuple[str, ...]) -> Callable[[DeckState, str, list[str]], None]:
    def check(state: DeckState, group: str, words: list[str]) -> None:
        if group != "all":
            raise ParameterError(f"compute {style} must use group all")
        for word in words:
            read.choice(word, f"an argument of compute {style}", allowed)

    return check


def _check_pressure(state: DeckState, group: str, words: list[str]) -> None:
    read.count(words, "compute ID all pressure temp-ID|NULL [virial|ke]", 1, 2)
    if words[0] == "NULL" and "virial" not in words[1:]:
        raise ParameterError("compute pressure needs the id of a temperature compute, or NULL with virial")
    if words[0] != "NULL":
        temperature_compute(state, words[0])
    _all_only("pressure", ("virial", "ke"))(state, group, words[1:])


def temperature_compute(state: DeckState, name: str) -> Compute | None:
    """The compute of style temp with this id, None for ``thermo_temp``; ParameterError if it is none."""
    if name == "thermo_temp":
        return None
    if name not in state.computes or state.computes[name].style != "temp":
        raise ParameterError(f"'{name}' is not the id of a compute of style temp")
    return state.computes[name]


def _pe(context: Context, compute: Compute) -> float:
    parts = compute.arguments or ("pair", "bond")
    return sum(context.energy({"pair": "pair_energy", "bond": "bond_energy"}[part]) for part in parts)


def _pressure(context: Context, compute: Compute) -> float:
    kinetic = 0.0
    if "virial" not in compute.arguments[1:]:
        kinetic = context.kinetic(temperature_compute(context.state, compute.arguments[0]))
    return context.pressure_of(kinetic, 0.0 if "ke" in compute.arguments[1:] else context.need("virial"))


def _centre(context: Context, compute: Compute) -> np.ndarray:
    mask, masses = context.state.group(compute.group), context.state.bead_masses()
    atoms = context.state.atoms
    positions = context.need("positions") + atoms.images @ context.state.require_box("compute com").vectors
    return masses[mask] @ positions[mask] / masses[mask].sum() / context.units.length


def _momentum(context: Context, compute: Compute) -> np.ndarray:
    mask, masses = context.state.group(compute.group), context.state.bead_masses()
    return masses[mask] @ context.need("velocities")[mask] / context.units.mass / context.units.velocity


def _dpd(context: Context, compute: Compute) -> np.ndarray:
    thetas = context.state.atoms.thetas[context.state.group(compute.group)]
    # energies of internal degrees of freedom start at 0 and stay there: only an energy-conserving style changes them
    harmonic = len(thetas) / np.sum(1 / thetas) if len(thetas) and np.all(thetas > 0) else 0.0
    return np.array([0.0, 0.0, 0.0, harmonic, float(len(thetas))])


def _check_dpd(state: DeckState, group: str, words: list[str]) -> None:
    _no_arguments(state, group, words)
    if state.atom_style != "dpd":
        raise ParameterError("compute dpd needs atom_style dpd")


#: Compute styles by name.
COMPUTES: dict[str, ComputeSpec] = {
    "temp": ComputeSpec(_no_arguments, lambda context, compute: context.temperature(compute), needs=("velocities",)),
    "ke": ComputeSpec(
        _no_arguments,
        lambda context, compute: context.kinetic(compute) / context.units.energy,
        extensive=True,
        needs=("velocities",),
    ),
    "pe": ComputeSpec(_all_only("pe", ("pair", "bond")), _pe, extensive=True, needs=("pair_energy", "bond_energy")),
    "pressure": ComputeSpec(_check_pressure, _pressure, needs=("virial", "velocities")),
    "com": ComputeSpec(_no_arguments, vector=_centre, needs=("positions",)),
    "momentum": ComputeSpec(_no_arguments, vector=_momentum, extensive=True, needs=("velocities",)),
    "dpd": ComputeSpec(_check_dpd, vector=_dpd),
}

#: Computes that exist without being defined.
BUILT_IN = {
    "thermo_temp": ("temp", False),
    "thermo_press": ("press", False),
    "thermo_pe": ("pe", True),
}
