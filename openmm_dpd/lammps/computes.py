"""Computes: values of groups of beads that thermo output and formulas can name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ParameterError
from . import arguments as read
from .chunks import CHUNKS
from .compute_spec import Compute, ComputeSpec
from .per_bead import PER_BEAD, REDUCE, require_atom_style, unwrapped
from .structure_computes import STRUCTURE

if TYPE_CHECKING:
    from .context import Context
    from .state import DeckState


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


#: Parts of the potential energy that compute pe can be asked for.
_PARTS = ("pair", "bond", "angle")


def _pe(context: Context, compute: Compute) -> float:
    return sum(context.energy(f"{part}_energy") for part in compute.arguments or _PARTS)


def temperature_of_pressure(state: DeckState, name: str) -> Compute | None:
    """The compute that a compute of pressure takes its kinetic part from, None for ``thermo_temp``."""
    own = state.computes[name].arguments[0] if name in state.computes else "thermo_temp"
    return temperature_compute(state, state.pressure_temps.get(name, own))


def _pressure(context: Context, compute: Compute) -> float:
    kinetic = 0.0
    if "virial" not in compute.arguments[1:]:
        kinetic = context.kinetic(temperature_of_pressure(context.state, compute.name))
    return context.pressure_of(kinetic, 0.0 if "ke" in compute.arguments[1:] else context.need("virial"))


def _centre(context: Context, compute: Compute) -> np.ndarray:
    mask, masses = context.state.group(compute.group), context.state.bead_masses()
    return masses[mask] @ unwrapped(context)[mask] / masses[mask].sum()


def _kinetic_tensor(context: Context, compute: Compute) -> np.ndarray:
    """Sums of m v_a v_b over the group: xx, yy, zz, xy, xz, yz."""
    mask, masses = context.state.group(compute.group), context.state.bead_masses()
    velocities = context.velocities[mask] * context.units.velocity
    tensor = (masses[mask][:, None] * velocities).T @ velocities / context.units.energy
    return tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _momentum(context: Context, compute: Compute) -> np.ndarray:
    mask, masses = context.state.group(compute.group), context.state.bead_masses()
    return masses[mask] @ context.velocities[mask] / context.units.mass


def _dpd(context: Context, compute: Compute) -> np.ndarray:
    mask, units = context.state.group(compute.group), context.units
    conductive, mechanical = (float(context.carried(name)[mask].sum()) / units.energy for name in ("u_cond", "u_mech"))
    thetas = context.carried("theta")[mask] / units.thermal_energy
    harmonic = len(thetas) / np.sum(1 / thetas) if len(thetas) and np.all(thetas > 0) else 0.0
    # LAMMPS's third energy is chemical: there are no reactions here
    return np.array([conductive, mechanical, 0.0, harmonic, float(len(thetas))])


def _check_dpd(state: DeckState, group: str, words: list[str]) -> None:
    _no_arguments(state, group, words)
    require_atom_style(state, "dpd", "dpd")


#: Compute styles by name.
COMPUTES: dict[str, ComputeSpec] = {
    "temp": ComputeSpec(
        _no_arguments,
        lambda context, compute: context.temperature(compute),
        _kinetic_tensor,
        extensive_vector=True,
        size=lambda compute: 6,
        needs=("velocities",),
    ),
    "ke": ComputeSpec(
        _no_arguments,
        lambda context, compute: context.kinetic_of(context.state.group(compute.group)) / context.units.energy,
        extensive=True,
        needs=("velocities",),
    ),
    "pe": ComputeSpec(_all_only("pe", _PARTS), _pe, extensive=True, needs=tuple(f"{part}_energy" for part in _PARTS)),
    "pressure": ComputeSpec(_check_pressure, _pressure, needs=("virial", "velocities")),
    "com": ComputeSpec(_no_arguments, vector=_centre, size=lambda compute: 3, needs=("positions",)),
    "momentum": ComputeSpec(_no_arguments, vector=_momentum, extensive=True, size=lambda compute: 3, needs=("velocities",)),
    "dpd": ComputeSpec(_check_dpd, vector=_dpd, size=lambda compute: 5, needs=("fields",)),
    "reduce": REDUCE,
    "chunk/atom": CHUNKS,
    **STRUCTURE,
    **PER_BEAD,
}


@dataclass(frozen=True)
class BuiltIn:
    """A compute that exists without being defined: its value, not normalised, and the thermo word whose column ``c_id`` is.

    That word may stand for another compute (``thermo_modify temp`` and ``press``); outside the columns of thermo output the
    built-in one is meant.
    """

    value: Callable[[Context], float]
    word: str


BUILT_IN = {
    "thermo_temp": BuiltIn(lambda context: context.temperature(), "temp"),
    "thermo_press": BuiltIn(lambda context: context.pressure_with("thermo_press", "virial"), "press"),
    "thermo_pe": BuiltIn(lambda context: sum(context.energy(f"{part}_energy") for part in _PARTS), "pe"),
}
