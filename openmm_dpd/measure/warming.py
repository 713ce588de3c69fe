"""All kernels compiled ahead of the first run: a few steps of a small scene of each kind, and a sample."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..base.errors import PlanError
from ..model.angles import HarmonicAngles
from ..model.bonds import HarmonicBonds
from ..model.edpd import EDPD
from ..model.energy_dpd import EnergyDPD
from ..model.eos import ConstantHeatCapacity
from ..model.internal import BeadTemperatures, Concentrations, InternalEnergy
from ..model.mdpd import MDPD
from ..model.pairs import DPD
from ..model.scene import Scene
from ..model.tdpd import TDPD
from ..simulation.build import build
from .observer import Observer

_BEADS = 120
#: One whose friction is a force, and one that sweeps.
_SCHEMES = ("mvv", "middle")


def _scenes() -> Iterator[tuple[str, Scene]]:
    """A scene of each kind that has kernels of its own, and its name."""
    edge = (_BEADS / 3.0) ** (1 / 3)
    grid = np.stack(np.unravel_index(np.arange(_BEADS), (5, 5, 5)), axis=1) * (edge / 5.0)

    def scene(pair, names: str = "A", **more: Any) -> Scene:
        pairs = {(a, b): pair for a in names for b in names if a <= b}
        return Scene(dict.fromkeys(names, 1.0), list(names) * (_BEADS // len(names)), grid, pairs, kT=1.0, box=np.full(3, edge), **more)

    index = np.arange(_BEADS)
    chains: dict[str, Any] = {
        "bonds": [HarmonicBonds(np.stack([index[::3], index[1::3]], axis=1), *np.full((2, _BEADS // 3), 1.0))],
        "angles": [HarmonicAngles(np.stack([index[::3], index[1::3], index[2::3]], axis=1), *np.full((2, _BEADS // 3), 1.0))],
    }
    yield "DPD", scene(DPD(A=25, gamma=4.5))
    yield "DPD of several types, with bonds and angles", scene(DPD(A=25, gamma=4.5), "AB", **chains)
    yield "DPD with transverse friction", scene(DPD(A=25, gamma=4.5, gamma_perp=4.5), "AB")
    yield "many-body DPD", scene(MDPD(A=-40, B=25, gamma=4.5))
    internal = InternalEnergy(ConstantHeatCapacity(60.0), np.ones(_BEADS))
    yield "DPD with internal energies", scene(EnergyDPD(A=25, sigma=3.0, kappa=1.0), internal=internal)
    yield "eDPD", scene(EDPD(A=18.75, gamma=4.5, kappa=1e-5), internal=BeadTemperatures(1.0, 1e5))
    yield "tDPD", scene(TDPD(A=18.75, gamma=4.5, kappa=(1.0,)), internal=Concentrations(np.ones((_BEADS, 1))))


def warm(log: Callable[[str], None]) -> None:
    """Compile and keep what steps and samples of every kind of scene need; ``log`` gets a line for each."""
    for name, scene in _scenes():
        log(name)
        for scheme in _SCHEMES:
            try:
                built = build(scene, dt=1e-4, scheme=scheme, platform="CPU", seed=1)
            except PlanError:  # not every kind runs with every scheme
                continue
            simulation = built.simulation()
            simulation.step(4)
            Observer(built).sample(simulation.context)
