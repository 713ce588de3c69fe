"""The scenes of the reference suite (``benchmarks/reference_suite.py``): how they were made, and what is measured in them."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.lammps import export_lammps

SCENES = Path(__file__).resolve().parents[1] / "openmm_dpd" / "score" / "scenes"


# -- the scenes ----------------------------------------------------------------------------------------------------------------
def random_positions(beads: int, edges: list[float]) -> np.ndarray:
    """(N, 3), nm."""
    return np.random.default_rng(1).random((beads, 3)) * edges


def fluid(pairs, edges=(7.0, 7.0, 7.0), density: float = 3.0, types: dict[str, float] | None = None, **more) -> dpd.Scene:
    """Beads of the types by turns."""
    types = types or {"W": 1.0}
    n = round(density * float(np.prod(edges)))
    pairs = pairs if isinstance(pairs, dict) else {("W", "W"): pairs}
    return dpd.Scene(
        types, [list(types)[k % len(types)] for k in range(n)], random_positions(n, list(edges)), pairs, 1.0, box=list(edges), **more
    )


def mixture() -> dpd.Scene:
    """Three parts of light beads, one of heavy ones that like themselves better and have more friction."""
    n, edge = 1029, 7.0
    names = ["B" if k % 4 == 3 else "A" for k in range(n)]
    pairs = {
        ("A", "A"): dpd.DPD(A=25, gamma=4.5),
        ("A", "B"): dpd.DPD(A=30, gamma=20),
        ("B", "B"): dpd.DPD(A=25, gamma=60),
    }
    return dpd.Scene({"A": 1.0, "B": 3.0}, names, random_positions(n, [edge] * 3), pairs, 1.0, box=[edge] * 3)


def chains(length: int, K: float, r0: float, bend: float = 0.0) -> dpd.Scene:
    """A melt of chains with springs K (r - r0)^2 and, where ``bend`` is given, bend (theta - pi)^2, in LAMMPS's convention."""
    n, edge = 1030 - 1030 % length, 7.0
    rng = np.random.default_rng(2)
    steps = rng.normal(size=(n // length, length, 3))
    if bend:
        steps[:] = steps[:, :1]
    steps *= max(r0, 0.4) / np.linalg.norm(steps, axis=2, keepdims=True)
    steps[:, 0] = rng.random((n // length, 3)) * edge
    first = np.arange(n).reshape(-1, length)
    near, bends = (np.stack([first[:, j : length - w + 1 + j].ravel() for j in range(w)], axis=1) for w in (2, 3))
    angles = [dpd.HarmonicAngles(bends, bend, np.pi)] if bend else []
    x = steps.cumsum(axis=1).reshape(-1, 3)
    pairs = {("C", "C"): dpd.DPD(A=25, gamma=4.5)}
    return dpd.Scene({"C": 1.0}, ["C"] * n, x, pairs, 1.0, box=[edge] * 3, bonds=[dpd.HarmonicBonds(near, K, r0)], angles=angles)


def slab() -> dpd.Scene:
    """Warren's liquid between two free surfaces."""
    n, edge = 864, 5.0
    x = random_positions(n, [edge, edge, 5.76])
    pairs = {("L", "L"): dpd.MDPD(A=-40.0, B=25.0, gamma=18.0, kernel="lucy")}
    return dpd.Scene({"L": 1.0}, ["L"] * n, x, pairs, 1.0, box=[edge, edge, 10.0])


def conducting() -> dpd.Scene:
    """Beads that conserve the energy."""
    inside = dpd.InternalEnergy(dpd.ConstantHeatCapacity(60.0), 1.0)
    return fluid(dpd.EnergyDPD(A=25, sigma=3, kappa=1), internal=inside)


EDGES, CAPACITY = [8.0, 6.0, 6.0], 1e5
BEADS = round(3.0 * np.prod(EDGES))


def heated() -> dpd.Scene:
    """Half of the beads, all over the box, is heated and the other half cooled: heat flows between neighbours, and all of it is conserved.
    (LAMMPS computes the heat of friction in another way, which does not conserve it; with this capacity that does not matter.)"""
    everywhere = dpd.Block([-np.inf] * 3, [np.inf] * 3)
    sources = [dpd.Source(everywhere, sign * 0.1, beads=np.arange(BEADS) // (BEADS // 2) == k) for k, sign in enumerate((1, -1))]
    pairs = dpd.EDPD(A=25, gamma=4.5, kappa=10.0 / CAPACITY, cutoff=1.0, exponent=1.0)
    return fluid(pairs, EDGES, internal=dpd.BeadTemperatures(1.0, CAPACITY), sources=sources)


def sourced() -> dpd.Scene:
    """Half of the box makes a species, the other half destroys as much: the profile is steady."""
    halves = [dpd.Block([low, -np.inf, -np.inf], [low + 4.0, np.inf, np.inf]) for low in (0.0, 4.0)]
    sources = [dpd.Source(half, sign * 0.05) for half, sign in zip(halves, (1, -1), strict=True)]
    pairs = dpd.TDPD(A=25, gamma=4.5, kappa=3.0, cutoff=1.0, exponent=0.5)
    return fluid(pairs, EDGES, internal=dpd.Concentrations(np.ones(BEADS)), sources=sources)


def channel() -> dpd.Scene:
    """A fluid between walls of frozen beads, 1.0 thick at each end of y, that flows along x under its weight."""
    edges, depth = np.array([6.0, 8.0, 6.0]), 1.0
    # the frozen beads are those of an equilibrated fluid
    x = settled(fluid(dpd.DPD(A=25, gamma=4.5), list(edges)), 20.0)[0] % edges
    free = (x[:, 1] >= depth) & (x[:, 1] <= edges[1] - depth)
    order = np.argsort(~free, kind="stable")  # those that move first
    x, free = x[order], free[order]
    v = np.where(free[:, None], np.random.default_rng(3).normal(size=x.shape), 0.0)
    names = np.where(free, "W", "S").tolist()
    pairs = {pair: dpd.DPD(A=25, gamma=4.5) for pair in (("W", "W"), ("S", "W"), ("S", "S"))}
    weight = dpd.BodyForce((0.1, 0.0, 0.0), types="W")
    return dpd.Scene({"W": 1.0, "S": 1.0}, names, x, pairs, 1.0, velocities=v, box=edges.tolist(), mobile=free, body_forces=[weight])


FLUID = ("T_kin", "T_conf", "U", "P", "g_core", "g_shell", "D")
SAME = dict.fromkeys(("T_kin", "T_conf"), 1.0)


@dataclass(frozen=True)
class Frozen:
    """A scene of the suite: what it is, about the step at which velocity Verlet is 1 % off, what is measured, time to settle, and the scheme
    that stands for LAMMPS's fixes; steps of the reference runs in LAMMPS and here, the word of the latter, and how many times as many they are."""

    about: str
    scene: Callable[[], dpd.Scene]
    step: float
    quantities: tuple[str, ...] = FLUID
    settle: float = 50.0
    scheme: str = "mvv"
    shear: float | None = None
    lammps: tuple[float, float] = (1 / 128, 1 / 64)
    ours: tuple[float, float] = (1 / 32, 1 / 16)
    exact: Mapping[str, float] = field(default_factory=lambda: SAME)
    word: str = "bababo"
    times: int = 1


_MIXED = ("T_kin", "T_conf", "U", "P", "g_core", "g_shell", "D_first", "D_second")
_CHAINS = (*FLUID[:-1], "bond", "R2", "D")
SUITE = {
    "standard": Frozen("standard fluid (Groot and Warren 1997), friction 4.5", lambda: fluid(dpd.DPD(A=25, gamma=4.5)), 0.02),
    "viscous": Frozen(
        "standard fluid with friction 40.5",
        lambda: fluid(dpd.DPD(A=25, gamma=40.5)),
        0.01,
        lammps=(1 / 256, 1 / 128),
        ours=(1 / 48, 1 / 24),
    ),
    "stiff": Frozen(
        "repulsion of 78, friction 4.5", lambda: fluid(dpd.DPD(A=78, gamma=4.5)), 0.01, lammps=(1 / 192, 1 / 96), ours=(1 / 48, 1 / 24)
    ),
    "mixture": Frozen("masses 1 and 3, frictions 4.5, 20 and 60", mixture, 0.02, _MIXED, ours=(1 / 48, 1 / 24)),
    "melt": Frozen(
        "chains of five beads with soft springs, K = 2, r0 = 0 (Groot and Warren 1997)", lambda: chains(5, 2.0, 0.0), 0.02, _CHAINS, 300.0
    ),
    "rods": Frozen(
        "chains of five beads with stiff springs, K = 100 (r0 = 0.5), and bending, K = 5",
        lambda: chains(5, 100.0, 0.5, 5.0),
        0.01,
        _CHAINS,
        300.0,
        lammps=(1 / 256, 1 / 128),
        ours=(1 / 64, 1 / 32),
    ),
    "slab": Frozen(
        "many-body liquid (Warren 2003) with LAMMPS's kernel, between free surfaces",
        slab,
        0.01,
        ("T_kin", "g_core", "g_shell", "density", "tension"),
        100.0,
        lammps=(1 / 256, 1 / 128),
        ours=(1 / 64, 1 / 32),
        exact={},
    ),
    "conducting": Frozen(
        "beads with internal energies, conserved, heat capacity 60",
        conducting,
        0.02,
        (*FLUID, "theta", "drift"),
        50.0,
        "shardlow",
        ours=(1 / 48, 1 / 24),
        exact={"drift": 0.0},
    ),
    "heat": Frozen(
        "eDPD, one half of the beads heated, the other half cooled, all mixed",
        heated,
        0.01,
        ("T_kin", "P", "g_core", "g_shell", "D", "difference"),
        lammps=(1 / 192, 1 / 96),
        ours=(1 / 48, 1 / 24),
        exact={},
    ),
    "species": Frozen(
        "tDPD between a source and a sink of a species", sourced, 0.02, ("T_kin", "T_conf", "U", "P", "g_core", "g_shell", "D", "wave")
    ),
    "shear": Frozen(
        "standard fluid in a Lees-Edwards shear of 0.5",
        lambda: fluid(dpd.DPD(A=25, gamma=4.5)),
        0.02,
        ("T_kin", "T_conf", "U", "P", "stress"),
        50.0,
        shear=0.5,
        exact={},
        times=4,
    ),
    "channel": Frozen(
        "standard fluid between walls of frozen beads, driven by a force of 0.1 on each bead",
        channel,
        0.02,
        ("T_kin", "U", "g_core", "g_shell", "layer", "flow"),
        100.0,
        exact={},
    ),
}
_NM, _V = unit.nanometer, unit.nanometer / unit.picosecond


# -- freeze --------------------------------------------------------------------------------------------------------------------
def settled(scene: dpd.Scene, time: float, dt: float = 0.01) -> tuple[np.ndarray, np.ndarray, dict]:
    """Positions, velocities and fields after a time, with short steps first."""
    for step, its in ((0.0005, 0.5), (0.004, 2.0), (dt, time)):
        built = dpd.build(scene, dt=step, scheme="bababo", platform="CPU", seed=1)
        simulation = built.simulation()
        simulation.step(round(its / step))
        state = simulation.context.getState(positions=True, velocities=True)
        x, v = state.getPositions(asNumpy=True).value_in_unit(_NM), state.getVelocities(asNumpy=True).value_in_unit(_V)
        fields = dpd.read_fields(simulation.context, built.plan) if scene.internal is not None else {}
        scene = replace(
            scene, positions=x, velocities=np.where(scene.immobile[:, None], scene.velocities if scene.immobile.any() else v, v)
        )
        if "u_cond" in fields:
            scene = replace(scene, internal=dpd.InternalEnergy(scene.internal.eos, fields["theta"], fields["u_cond"]))
        elif "theta" in fields:
            scene = replace(scene, internal=dpd.BeadTemperatures(fields["theta"], CAPACITY))
        elif "concentrations" in fields:
            scene = replace(scene, internal=dpd.Concentrations(fields["concentrations"]))
    return x, scene.velocities, fields


def freeze(name: str) -> None:
    """Write ``in.NAME`` and ``data.NAME``."""
    kind = SUITE[name]
    scene = kind.scene()
    x, v, fields = settled(scene, kind.settle)
    five = lambda values: np.round(values, 5)  # noqa: E731 - text that can be read
    scene = replace(scene, positions=five(x), velocities=five(v))
    if "u_cond" in fields:
        scene = replace(scene, internal=dpd.InternalEnergy(scene.internal.eos, five(fields["theta"])))
    elif "theta" in fields:
        scene = replace(scene, internal=dpd.BeadTemperatures(five(fields["theta"]), CAPACITY))
    elif "concentrations" in fields:
        scene = replace(scene, internal=dpd.Concentrations(five(fields["concentrations"])))
    if kind.shear:
        scene = replace(
            scene,
            shear=dpd.LeesEdwards(rate=kind.shear),
            velocities=five(v + kind.shear * np.outer(x[:, 1] % 7.0, [1, 0, 0])),
            positions=five(x % 7.0),
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = export_lammps(scene, SCENES, name, dt=0.01, steps=10000, scheme=kind.scheme, seed=4357, every=20)
    lines = [line for line in made.deck.read_text().splitlines() if not line.startswith(("#", "thermo", "write_data", "compute sums"))]
    text = "\n".join(lines)
    for old, new in (
        (r"timestep 0.01", "timestep ${dt}"),
        (r"run 10000", "run ${steps}"),
        (r"custom 20 \S+", "custom ${every} ${frames}"),
        (r"\b4357\b", "${seed}"),
        (r"%\.17g", "%.8g"),
    ):
        text, found = re.subn(old, new, text)
        assert found, (name, old)
    head = [f"# {kind.about}; a scene of the openmm-dpd reference suite", f"# lmp -in in.{name} -var dt 0.02 -var steps 5000", ""]
    head += [
        "variable dt index 0.01",
        "variable steps index 10000",
        "variable every index 20",
        "variable seed index 4357",
        f"variable frames index {name}.lammpstrj",
    ]
    made.deck.write_text("\n".join(head) + "\n" + text.strip("\n") + "\n")
    print(name, scene.n_beads, "beads", len(made.data.read_bytes()), "bytes", flush=True)
