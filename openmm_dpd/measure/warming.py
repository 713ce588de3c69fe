"""Compile kernels ahead of the first run: a few steps and a sample of a small scene of each kind."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..base.errors import PlanError
from ..kernels.extras import warm_up_extras
from ..model import edpd, electrostatics, energy_dpd, eos, internal, mdpd, pairs, point_charges, radial, segments, tdpd
from ..model.bonds import HarmonicBonds
from ..model.scene import Scene
from ..plan.kinds import BONDED_KINDS
from ..simulation.build import build
from .observer import Observer

_BEADS = 120
#: A scheme whose friction is a force, and one with sweeps.
_SCHEMES = ("mvv", "middle")


def _scenes() -> Iterator[tuple[str, Scene]]:
    """Name and scene of each kind of model that has its own kernels."""
    edge = (_BEADS / 3.0) ** (1 / 3)
    grid = np.stack(np.unravel_index(np.arange(_BEADS), (5, 5, 5)), axis=1) * (edge / 5.0)

    def scene(pair, names: str = "A", **more: Any) -> Scene:
        its = {(a, b): pair for a in names for b in names if a <= b}
        return Scene(dict.fromkeys(names, 1.0), list(names) * (_BEADS // len(names)), grid, its, kT=1.0, box=np.full(3, edge), **more)

    pairs_of_beads = np.arange(_BEADS).reshape(-1, 2)
    chains: dict[str, Any] = {
        "bonds": [HarmonicBonds(pairs_of_beads, *np.ones((2, len(pairs_of_beads))))],
        "segments": segments.SegmentalRepulsion(A=1.0, cutoff=0.5),
    }
    points = point_charges.PointCharges(bjerrum_length=1.0, cutoff=0.5 * edge)
    lj, wave = pairs.LennardJones(epsilon=1e-6, sigma=0.2, cutoff=0.6), radial.RadialPair("gauss", {"A": 1.0, "B": 2.0}, cutoff=0.6)
    clouds = electrostatics.SlaterCharges(lamda=0.5, bjerrum_length=1.0, cutoff=0.5 * edge)
    plain, charges = pairs.DPD(A=25, gamma=4.5), np.repeat([1.0, -1.0, 0.0], [2, 2, _BEADS - 4])
    yield "DPD", scene(plain)
    yield "DPD of several types, with bonds and segments", scene(plain, "AB", **chains)
    yield "DPD with charges", scene(plain, charges=charges, electrostatics=clouds)
    yield "Lennard-Jones with point charges", scene(lj, charges=charges, electrostatics=points)
    yield "radial potentials by formulas", scene(wave)
    yield "DPD with transverse friction", scene(pairs.DPD(A=25, gamma=4.5, gamma_perp=4.5), "AB")
    yield "many-body DPD", scene(mdpd.MDPD(A=-40, B=25, gamma=4.5))
    tables = eos.TabulatedEOS.from_functions(lambda theta: 60.0 * theta, (0.1, 10.0))
    for name, curve in (("DPD with internal energies", eos.ConstantHeatCapacity(60.0)), ("the same with tables", tables)):
        yield name, scene(energy_dpd.EnergyDPD(A=25, sigma=3.0, kappa=1.0), internal=internal.InternalEnergy(curve, np.ones(_BEADS)))
    yield "eDPD", scene(edpd.EDPD(A=18.75, gamma=4.5, kappa=1e-5), internal=internal.BeadTemperatures(1.0, 1e5))
    yield "tDPD", scene(tdpd.TDPD(A=18.75, gamma=4.5, kappa=(1.0,)), internal=internal.Concentrations(np.ones((_BEADS, 1))))
    fast = tdpd.TDPD(A=18.75, gamma=4.5, kappa=(100.0,))
    yield "tDPD with fast exchange", scene(fast, internal=internal.Concentrations(np.ones((_BEADS, 1))))


def warm(log: Callable[[str], None]) -> None:
    """Compile and store all kernels for steps and samples of every kind of scene; ``log`` gets a line for each."""
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
    log("bonds, angles, dihedrals and impropers of each kind")
    kinds = [(kind.kernel, kind.width, len(kind.terms._DIMENSIONS)) for kind in BONDED_KINDS.values()]
    warm_up_extras([kernel(np.arange(width, dtype=np.uint32)[None, :], np.ones((n, 1))) for kernel, width, n in kinds])
