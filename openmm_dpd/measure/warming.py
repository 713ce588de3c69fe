"""All kernels compiled ahead of the first run: a few steps of a small scene of each kind, and a sample."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..base.errors import PlanError
from ..model.angles import CosineAngles, HarmonicAngles
from ..model.bonds import FENEBonds, HarmonicBonds, MorseBonds
from ..model.edpd import EDPD
from ..model.electrostatics import SlaterCharges
from ..model.energy_dpd import EnergyDPD
from ..model.eos import ConstantHeatCapacity, TabulatedEOS
from ..model.internal import BeadTemperatures, Concentrations, InternalEnergy
from ..model.mdpd import MDPD
from ..model.pairs import DPD
from ..model.scene import Scene
from ..model.segments import SegmentalRepulsion
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

    one, two, three = np.arange(_BEADS).reshape(-1, 3).T
    first, second, across, bent = (np.stack(beads, axis=1) for beads in ((one, two), (two, three), (one, three), (one, two, three)))
    each = np.ones(_BEADS // 3)
    chains: dict[str, Any] = {
        "bonds": [HarmonicBonds(first, each, each), FENEBonds(second, each, 4.0 * each), MorseBonds(across, each, each, each)],
        "angles": [HarmonicAngles(bent, each, each), CosineAngles(bent[:, [1, 0, 2]], each)],
        "segments": SegmentalRepulsion(A=1.0, cutoff=0.5),
    }
    charges: dict[str, Any] = {
        "charges": np.repeat([1.0, -1.0, 0.0], [2, 2, _BEADS - 4]),
        "electrostatics": SlaterCharges(lamda=0.5, bjerrum_length=1.0, cutoff=0.5 * edge),
    }
    yield "DPD", scene(DPD(A=25, gamma=4.5))
    yield "DPD of several types, with bonds, angles and segments", scene(DPD(A=25, gamma=4.5), "AB", **chains)
    yield "DPD with charges", scene(DPD(A=25, gamma=4.5), **charges)
    yield "DPD with transverse friction", scene(DPD(A=25, gamma=4.5, gamma_perp=4.5), "AB")
    yield "many-body DPD", scene(MDPD(A=-40, B=25, gamma=4.5))
    tables = TabulatedEOS.from_functions(lambda theta: 60.0 * theta, (0.1, 10.0))
    for name, curve in (("DPD with internal energies", ConstantHeatCapacity(60.0)), ("the same with tables", tables)):
        yield name, scene(EnergyDPD(A=25, sigma=3.0, kappa=1.0), internal=InternalEnergy(curve, np.ones(_BEADS)))
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
