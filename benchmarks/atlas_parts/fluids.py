"""The fluids of the atlas, the methods that run each of them, and the step sizes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import openmm

import openmm_dpd as dpd
from openmm_dpd.lammps import deck_scene
from openmm_dpd.model.schemes import SCHEMES

DECKS = Path(__file__).resolve().parents[2] / "examples" / "decks"

#: Step sizes of schemes whose friction is a force, of those that sweep, of those that freeze temperatures in a sweep, and of those with two
#: and three forces per step.
DTS = {
    "weak": {
        "force": (0.01, 0.015, 0.02, 0.03, 0.04, 0.06, 0.08),
        "sweep": (0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.10),
        "long": (0.04, 0.06, 0.08, 0.10, 0.11, 0.12, 0.13, 0.14, 0.16),
        "longer": (0.08, 0.12, 0.15, 0.17, 0.18, 0.19, 0.20, 0.22, 0.25),
    },
    "strong": {
        "force": (0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.06),
        "sweep": (0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.10),
        "long": (0.04, 0.06, 0.08, 0.10, 0.11, 0.12, 0.13, 0.14, 0.16),
        "longer": (0.08, 0.12, 0.15, 0.17, 0.18, 0.19, 0.20, 0.22, 0.25),
    },
    "energy": {
        "force": (0.0005, 0.001, 0.003, 0.01),
        "sweep": (0.01, 0.02, 0.03, 0.06, 0.10, 0.15, 0.20, 0.30, 0.40),
        "frozen": (0.01, 0.02, 0.025, 0.03, 0.045, 0.06, 0.10),
        "long": (0.02, 0.06, 0.10, 0.15, 0.20, 0.30, 0.40, 0.50, 0.60),
    },
}

#: Schemes that are compared with others where friction, and nothing else, is what matters.
PLAIN = {"basa", "bababs", "bab3"}


@dataclass(frozen=True)
class Method:
    """One way to run a fluid.

    Attributes
    ----------
    name : key in the results, and label in figures
    kind : "ours", "native" (OpenMM's DPDIntegrator) or "lammps"
    steps : "force", "sweep", "frozen", "long" or "longer", the list of step sizes
    scheme, platform, engine, precision : for kinds that run in OpenMM
    lam : weight of the prediction of velocities, for `mvv` and LAMMPS's mvv/dpd; with 0.5 the latter is nve
    style : LAMMPS pair style (fluids without a deck)
    slow : fewer and shorter runs (DPDIntegrator on the CPU platform takes ten times as long as anything else)
    """

    name: str
    kind: str
    steps: str
    scheme: str = "middle"
    lam: float = 0.5
    platform: str = "CPU"
    engine: str = "auto"
    precision: str = ""
    style: str = ""
    slow: bool = False


@dataclass(frozen=True)
class Fluid:
    """What is run.

    Attributes
    ----------
    name, title : key and heading
    gamma, gamma_perp : friction (fluids without a deck)
    deck : file in examples/decks, or empty
    grid : key of :data:`DTS`
    sample : time between two samples
    lags : lag times of the mean square displacement
    statics : fluids with equal ``statics`` have the same equilibrium, hence one reference
    conserves : whether energy is conserved (there is no set temperature)
    settle_dt : step of the equilibration
    share : length of its runs in times of the usual (an Ewald sum is slow)
    length_unit : nm per LAMMPS length unit, which is also nm/ps per velocity unit
    """

    name: str
    title: str
    gamma: float = 4.5
    gamma_perp: float = 0.0
    deck: str = ""
    grid: str = "weak"
    sample: float = 0.2
    lags: tuple[float, float] = (4.0, 8.0)
    statics: str = "standard"
    conserves: bool = False
    length_unit: float = 1.0
    settle_dt: float = 0.01
    share: float = 1.0
    styles: tuple[str, ...] = field(default=("dpd",))

    def scene(self, beads: int, seed: int, kT: float = 1.0) -> dpd.Scene:
        """The fluid on random points, or as its deck has it."""
        if self.deck:
            scene = deck_scene(DECKS / self.deck)
            return scene if kT == 1.0 or self.conserves else replace(scene, kT=kT * scene.initial_kT)
        edge = (beads / 3.0) ** (1 / 3)
        pairs = {("W", "W"): dpd.DPD(A=25, gamma=self.gamma, gamma_perp=self.gamma_perp, cutoff=1)}
        points = np.random.default_rng(seed).random((beads, 3)) * edge
        return dpd.Scene({"W": 1.0}, ["W"] * beads, points, pairs, kT=kT, box=[edge] * 3)

    def dts(self, method: Method, quick: bool) -> tuple[float, ...]:
        """Step sizes of a method: every other one of the list in a quick run or for a slow method."""
        steps = DTS[self.grid][method.steps]
        return steps[1::2] if quick or method.slow else steps


FLUIDS = {
    fluid.name: fluid
    for fluid in (
        Fluid("weak", "standard fluid, friction 4.5", styles=("dpd", "dpd/fdt")),
        Fluid("strong", "standard fluid, friction 40.5", gamma=40.5, grid="strong", styles=("dpd", "dpd/fdt")),
        Fluid("transverse", "standard fluid, friction 4.5 along and across", gamma_perp=4.5, styles=("dpd/ext",)),
        Fluid(
            "energy",
            "energy-conserving fluid",
            deck="in.dpde-shardlow",
            grid="energy",
            sample=0.6,
            statics="energy",
            conserves=True,
            length_unit=0.1,
            settle_dt=0.05,
            styles=("dpd/fdt/energy",),
        ),
        Fluid(
            "electrolyte",
            "electrolyte with smeared charges",
            deck="in.electrolyte",
            share=0.25,
            statics="electrolyte",
            styles=("dpd + charges",),
        ),
    )
}


def available(fluid: Fluid) -> bool:
    """Whether its deck is there."""
    return not fluid.deck or (DECKS / fluid.deck).exists()


@lru_cache
def methods(name: str) -> tuple[Method, ...]:
    """Every scheme here and every peer that can run a fluid."""
    fluid = FLUIDS[name]
    kinds = {"mvv": "force", "shardlow": "frozen" if fluid.conserves else "force", "bababo": "long", "bababs": "long", "bab3": "longer"}
    left_out = {"native"} | (PLAIN if fluid.conserves or fluid.deck else set())
    ours = [Method(s, "ours", kinds.get(s, "sweep"), s) for s in SCHEMES if s not in left_out]
    if not fluid.conserves:
        ours.insert(1, Method("mvv, lambda 0.65", "ours", "force", "mvv", 0.65))
    peers = [Method(f"LAMMPS {style} + {fix_of(style)}", "lammps", "frozen" if fluid.conserves else "force", style=style) for style in fluid.styles]  # fmt: skip
    if fluid.gamma_perp == 0 and not fluid.deck:
        # with the weight of the prediction that is best for this fluid
        peers.append(Method("LAMMPS dpd + mvv/dpd, lambda 0.65", "lammps", "force", lam=0.65, style="dpd"))
        peers.append(Method("OpenMM DPDIntegrator, CPU", "native", "sweep", "native", slow=True))
        if has_opencl():
            peers.append(Method("OpenMM DPDIntegrator, OpenCL", "native", "sweep", "native", platform="OpenCL", slow=True))
    return (*ours, *peers)


def method_of(fluid: str, name: str) -> Method:
    """The method of a fluid with a name."""
    return next(method for method in methods(fluid) if method.name == name)


def fix_of(style: str) -> str:
    """Name of the LAMMPS integrator that goes with a pair style."""
    return "shardlow" if style.startswith("dpd/fdt") else "nve"


@lru_cache
def has_opencl() -> bool:
    """Whether an OpenCL Context can be made."""
    system = openmm.System()
    system.addParticle(1.0)
    try:
        openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName("OpenCL"))
    except openmm.OpenMMException:
        return False
    return True
