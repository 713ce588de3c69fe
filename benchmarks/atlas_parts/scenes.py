"""Scenes that are no point of the table of steps, and the temperatures of a run of one: for recommended steps.

Reduced units: cutoff 1 (where there is one only), mass of the lightest bead 1, kT 1, density 3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import openmm

import openmm_dpd as dpd
from openmm_dpd import DPD
from openmm_dpd.advice.scene_groups import liquid_density
from openmm_dpd.lammps import deck_scene
from openmm_dpd.molecules import Bend, Bilayer, Spring, Twist, grafmueller_2009, linear, pack, relax
from openmm_dpd.stats import block_average, ratio_average

from .fluids import DECKS

#: Longest step of the run that brings random positions to equilibrium, and its time; stiff bonds take a shorter one.
FIRST, SETTLE = 0.004, 8.0


def fluid(beads: int, pairs, *, rho: float = 3.0, masses: Mapping[str, float] | None = None, **more) -> dpd.Scene:
    """Beads of one type A, or of all types of ``masses`` by turns, on random positions."""
    masses = masses or {"A": 1.0}
    edge = (beads / rho) ** (1 / 3)
    x = np.random.default_rng(1).random((beads, 3)) * edge
    return dpd.Scene(masses, [list(masses)[k % len(masses)] for k in range(beads)], x, pairs, 1.0, box=[edge] * 3, **more)


def slab(beads: int, A: float, B: float, gamma: float) -> dpd.Scene:
    """A many-body liquid between two free surfaces, 1.3 times as thick as it is wide, and vacuum of 3 beside it."""
    edge = (beads / liquid_density(A, B) / 1.3) ** (1 / 3)
    x = np.random.default_rng(1).random((beads, 3)) * [edge, edge, 1.3 * edge]
    return dpd.Scene({"A": 1.0}, ["A"] * beads, x, {("A", "A"): dpd.MDPD(A=A, B=B, gamma=gamma)}, 1.0, box=[edge, edge, 1.3 * edge + 3.0])


def chains(beads: int, bonds: Callable, length: int, rest: float, stiff: float = 0.0, pairs=None, rho: float = 3.0) -> dpd.Scene:
    """Chains of beads in a row, with bonds made by ``bonds(pairs)``: random walks, or, with bending constants ``stiff``, straight ones."""
    rng = np.random.default_rng(2)
    n = beads - beads % length
    edge = (n / rho) ** (1 / 3)
    steps = rng.normal(size=(n // length, length, 3))
    if stiff:
        steps[:] = steps[:, :1]
    steps *= rest / np.linalg.norm(steps, axis=2, keepdims=True)
    steps[:, 0] = rng.random((n // length, 3)) * edge
    first = np.arange(n).reshape(-1, length)
    pairs = pairs or {("A", "A"): DPD(A=25, gamma=4.5)}
    x = steps.cumsum(axis=1).reshape(-1, 3)
    near, bends = (np.stack([first[:, k : length - w + 1 + k].ravel() for k in range(w)], axis=1) for w in (2, 3))
    angles = [dpd.HarmonicAngles(bends, stiff, np.pi)] if stiff else []
    return dpd.Scene({"A": 1.0}, ["A"] * n, x, pairs, 1.0, box=[edge] * 3, bonds=[bonds(near)], angles=angles)


def twisted(beads: int) -> dpd.Scene:
    """Chains of ten with bends and dihedrals."""
    chain = linear("A10", Spring(100, 0.5), Bend(50, 1.9), twist=Twist(20, 1, 3))
    mixture = pack({chain: beads // 10}, box=[(beads / 3.0) ** (1 / 3)] * 3, density=3.0 * (beads // 10 * 10) / beads, seed=2)
    return mixture.scene(pairs={("A", "A"): DPD(A=25, gamma=4.5)}, kT=1.0)


def bilayer(beads: int) -> dpd.Scene:
    """Lipids and water in a box of edges 7, 7 and 9, whatever number of beads is asked for: a bilayer that has nearly no tension."""
    model = grafmueller_2009()
    mixture = pack({model.molecule: Bilayer(70)}, solvent="W", density=model.density, box=[7.0, 7.0, 9.0], seed=1)
    return relax(mixture.scene(pairs=model.pairs(), kT=1.0))


def conserving(beads: int, capacity: float) -> dpd.Scene:
    """Beads with internal energies."""
    inside = dpd.InternalEnergy(dpd.ConstantHeatCapacity(capacity), 1.0)
    return fluid(beads, {("A", "A"): dpd.EnergyDPD(A=25, sigma=3, kappa=1)}, internal=inside)


def exchanging(beads: int, kappa: float, gamma: float) -> dpd.Scene:
    """Beads with a species."""
    pairs = {("A", "A"): dpd.TDPD(A=25, gamma=gamma, kappa=kappa)}
    return fluid(beads, pairs, internal=dpd.Concentrations(np.ones(beads)))


def _one(**values) -> dict:
    return {("A", "A"): DPD(**values)}


def _two(aa: DPD, ab: DPD, bb: DPD) -> dict:
    return {("A", "A"): aa, ("A", "B"): ab, ("B", "B"): bb}


_EQUAL = {"A": 1.0, "B": 1.0}
_COMMON = DPD(A=25, gamma=4.5)

#: Name and scene of a number of beads.
SCENES: dict[str, Callable[[int], dpd.Scene]] = {
    "one entry": lambda n: fluid(n, _one(A=25, gamma=4.5)),
    "soft": lambda n: fluid(n, _one(A=8, gamma=4.5)),
    "stiff": lambda n: fluid(n, _one(A=75, gamma=4.5)),
    "strong friction": lambda n: fluid(n, _one(A=25, gamma=135)),
    "one entry, A 50, friction 9": lambda n: fluid(n, _one(A=50, gamma=9)),
    "repulsion and friction in two layers": lambda n: fluid(n, [_one(A=25), _one(gamma=4.5)]),
    "two layers, A 25 and friction 4.5 each": lambda n: fluid(n, [_one(A=25, gamma=4.5)] * 2),
    "layers of cutoff 1 and 1.3": lambda n: fluid(n, [_one(A=25, gamma=4.5), _one(A=10, gamma=1, cutoff=1.3)]),
    "repulsion of cutoff 1, friction of 1.5": lambda n: fluid(n, [_one(A=25), _one(gamma=1, cutoff=1.5)]),
    "repulsion of cutoff 1, friction of 2": lambda n: fluid(n, [_one(A=40), _one(gamma=3, cutoff=2.0)]),
    "two components, A 25, 35, 60, masses 1:2": lambda n: fluid(
        n, _two(_COMMON, DPD(A=35, gamma=4.5), DPD(A=60, gamma=4.5)), masses={"A": 1.0, "B": 2.0}
    ),
    "stiff pairs without friction": lambda n: fluid(n, _two(_COMMON, DPD(A=60, gamma=0), DPD(A=100, gamma=0)), masses=_EQUAL),
    "friction between unlike beads only": lambda n: fluid(n, _two(DPD(A=50, gamma=0), DPD(A=25, gamma=4.5), DPD(A=50, gamma=0)), masses=_EQUAL),
    "friction 4.5 and 80": lambda n: fluid(n, _two(_COMMON, DPD(A=25, gamma=9), DPD(A=25, gamma=80)), masses=_EQUAL),
    "chains, k 4, rest length 0": lambda n: chains(n, lambda b: dpd.HarmonicBonds(b, 4.0, 0.0), 10, 0.5),
    "chains, k 100": lambda n: chains(n, lambda b: dpd.HarmonicBonds(b, 100.0, 0.5), 10, 0.5),
    "chains, k 1000": lambda n: chains(n, lambda b: dpd.HarmonicBonds(b, 1000.0, 0.5), 10, 0.5),
    "chains, k 100, rest length 0.01": lambda n: chains(n, lambda b: dpd.HarmonicBonds(b, 100.0, 0.01), 10, 0.01),
    "FENE chains, k 30, R0 1.5": lambda n: chains(n, lambda b: dpd.FENEBonds(b, 30.0, 1.5), 10, 0.6),
    "FENE chains with repulsion 1 of range 1": lambda n: chains(n, lambda b: dpd.FENEBonds(b, 30.0, 1.5, 1.0, 1.0), 10, 0.97),
    "FENE chains with repulsion 1 of range 0.5": lambda n: chains(n, lambda b: dpd.FENEBonds(b, 20.0, 1.5, 1.0, 0.5), 10, 0.6),
    "Morse chains, D 50, alpha 8": lambda n: chains(n, lambda b: dpd.MorseBonds(b, 50.0, 8.0, 0.5), 10, 0.5),
    "chains, k 100, angles k 50": lambda n: chains(n, lambda b: dpd.HarmonicBonds(b, 100.0, 0.5), 10, 0.5, 50.0),
    "chains, k 100, angles k 50, dihedrals k 20": twisted,
    "masses 1:100": lambda n: fluid(n, {("*", "*"): _COMMON}, masses={"A": 1.0, "B": 100.0}),
    "masses 1:10": lambda n: fluid(n, {("*", "*"): _COMMON}, masses={"A": 1.0, "B": 10.0}),
    "friction 100, exponent 0.5": lambda n: fluid(n, _one(A=25, gamma=100, exponent=0.5)),
    "friction 200, exponent 0.25": lambda n: fluid(n, _one(A=25, gamma=200, exponent=0.25)),
    "density 5, A 40, friction 10": lambda n: fluid(n, _one(A=40, gamma=10), rho=5.0),
    "friction 1, across 20": lambda n: fluid(n, _one(A=25, gamma=1, gamma_perp=20)),
    "many-body liquid, A -40, B 25, friction 18": lambda n: slab(n, -40.0, 25.0, 18.0),
    "many-body liquid, A -40, B 40, friction 4.5": lambda n: slab(n, -40.0, 40.0, 4.5),
    "many-body liquid, A -30, B 15, friction 9": lambda n: slab(n, -30.0, 15.0, 9.0),
    "lipid bilayer": bilayer,
    "electrolyte, A 78": lambda n: deck_scene(DECKS / "in.electrolyte"),
    "species, kappa 3": lambda n: exchanging(n, 3.0, 4.5),
    "species, kappa 20, friction 20": lambda n: exchanging(n, 20.0, 20.0),
    "heat capacity 60": lambda n: conserving(n, 60.0),
    "heat capacity 10": lambda n: conserving(n, 10.0),
}  # fmt: skip


def drawn(seed: int, beads: int) -> dpd.Scene:
    """A scene drawn at random: a fluid, a mixture or chains, by turns.  A 15 to 80, density 3 to 6, friction 1 to 150, masses 1 to 5, parts of
    10 to 90 %, chains of 5 to 15 beads with k 20 to 400 and rest lengths 0.3 to 0.8."""
    rng = np.random.default_rng([7, seed])

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    rho, kind = float(rng.uniform(3, 6)), ("fluid", "mixture", "chains")[seed % 3]
    coefficients = {(a, b): DPD(A=log(15, 80), gamma=log(1, 150)) for a, b in (("A", "A"), ("A", "B"), ("B", "B"))}
    first = {("A", "A"): coefficients["A", "A"]}
    if kind == "fluid":
        return fluid(beads, first, rho=rho)
    if kind == "chains":
        length, k, rest = int(rng.integers(5, 16)), log(20, 400), float(rng.uniform(0.3, 0.8))
        return chains(beads, lambda b: dpd.HarmonicBonds(b, k, rest), length, rest, pairs=first, rho=rho)
    A = 0.5 * (coefficients["A", "A"].A + coefficients["B", "B"].A) + float(rng.uniform(-5, 15))
    coefficients["A", "B"] = DPD(A=max(A, 15.0), gamma=coefficients["A", "B"].gamma)
    masses, part = {"A": 1.0, "B": float(rng.uniform(1, 5))}, float(rng.uniform(0.1, 0.9))
    edge = (beads / rho) ** (1 / 3)
    types = ["A" if k < part * beads else "B" for k in range(beads)]
    return dpd.Scene(masses, types, rng.random((beads, 3)) * edge, coefficients, 1.0, box=[edge] * 3)


#: One of each kind: those whose potential energy counts, too, and whose cost is compared with that of all other schemes.
TWELVE = (
    "one entry",
    "soft",
    "stiff",
    "strong friction",
    "two components, A 25, 35, 60, masses 1:2",
    "chains, k 4, rest length 0",
    "chains, k 100",
    "FENE chains, k 30, R0 1.5",
    "Morse chains, D 50, alpha 8",
    "chains, k 100, angles k 50",
    "lipid bilayer",
    "electrolyte, A 78",
)


@dataclass(frozen=True)
class Averages:
    """What a run says, each with its standard error."""

    kin: tuple[float, float]  #: Relative deviation of the kinetic temperature
    conf: tuple[float, float] | None  #: and of the configurational one; None where there is no Laplacian (lattice sums, some overlays)
    potential: tuple[float, float]  #: Potential energy per bead, kJ/mol
    spread: float  #: Variance of the potential energy, per bead: kT^2 dU/dkT

    @property
    def temperatures(self) -> list[tuple[float, float]]:
        """The deviations that there are."""
        return [pair for pair in (self.kin, self.conf) if pair is not None]

    def potential_off(self, other: Averages, kT: float) -> tuple[float, float]:
        """Deviation of the potential energy from that of another run, as the relative change of temperature that makes it."""
        scale = kT / other.spread
        return scale * (self.potential[0] - other.potential[0]), scale * float(np.hypot(self.potential[1], other.potential[1]))


def averages(
    scene: dpd.Scene, scheme: str, dt: float, *, longest: float, enough: float = 0.0, steps: int = 0, seed: int = 4
) -> Averages | None:
    """Averages of a run that starts from equilibrium; None if it stops.

    Parameters
    ----------
    scene : Scene
    scheme : str
    dt : float
        Step, ps.
    longest : float
        Longest simulated time, ps.
    enough : float
        Standard error of both temperatures at which measuring may end before.
    steps : int
        Steps that are done at least.
    seed : int
    """
    short = min(FIRST, dt / 2)
    first = dpd.build(scene, dt=short, scheme="middle", platform="CPU", seed=3).simulation(properties={"Threads": "1"})
    first.step(round(SETTLE / short))
    state = first.context.getState(positions=True, velocities=True)
    built = dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=seed)
    simulation, observer = built.simulation(properties={"Threads": "1"}), dpd.Observer(built)
    simulation.context.setPositions(state.getPositions())
    simulation.context.setVelocities(state.getVelocities())
    every = max(1, round(0.12 / dt))
    rows: list[tuple[float, ...]] = []
    try:
        simulation.step(round(8.0 / dt))
        while len(rows) * every * dt < longest:
            for _ in range(200):
                simulation.step(every)
                s = observer.sample(simulation.context)
                target = s.theta or scene.initial_kT
                rows.append((s.kT / target, s.gradient2, (s.laplacian or 0.0) * target, s.potential / scene.n_beads))
            kinetic, above, below, potential = np.array(rows).T
            kin, energy = block_average(kinetic), block_average(potential)
            conf = ratio_average(above, below) if below.any() else kin
            if max(kin.sem, conf.sem) < enough and len(rows) > 2000:
                break
        simulation.step(max(0, steps - simulation.currentStep))
    except (openmm.OpenMMException, dpd.DPDError):
        return None
    spread = float(np.var(potential)) * scene.n_beads
    both = [(one.mean - 1, one.sem) for one in (kin, conf)]
    return Averages(both[0], both[1] if below.any() else None, (energy.mean, energy.sem), spread)
