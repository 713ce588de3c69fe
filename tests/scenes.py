"""Small scenes, and what the oracle needs to follow them: coefficients, factors, noise and the order of the pairs."""

from collections.abc import Iterator

import numpy as np
import openmm
import oracle
import pytest
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.kernels import noise as hashed
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.runtime.decorators import compiled

D = dpd.DPD

#: One cutoff, exponent 1, radial terms only.
PLAIN = {("A", "A"): D(A=25, gamma=4.5), ("A", "B"): D(A=31, gamma=2), ("B", "B"): D(A=18, gamma=9)}
EXTENDED = {  # Everything differs.
    ("A", "A"): D(A=25, gamma=4.5, gamma_perp=1.5, exponent_perp=0.6, cutoff=1.0),
    ("A", "B"): D(A=31, gamma=2, gamma_perp=3, exponent=0.5, cutoff=1.2),
    ("B", "B"): D(A=18, gamma=9, gamma_perp=0.7, exponent=0.8, exponent_perp=1.3, cutoff=0.9),
}
PARTIAL = {  # Exponents that some transverse and radial terms lack altogether.
    ("A", "A"): D(A=25, gamma_perp=3, exponent_perp=0.0, cutoff=1.1),
    ("A", "B"): D(gamma=4.5, exponent=2.0, cutoff=0.7),
    ("B", "B"): dpd.NONE,
}
TABLES = {"dpd": PLAIN, "dpd_ext": EXTENDED, "partial": PARTIAL}

#: Cells per edge at the cutoff 1.2 of EXTENDED: none; 3 4 3; 5 4 6; 2 2 2; 1 slab of 2 6 5; 3 and more, tilted; 2 2 2, tilted to the limit.
BOXES = {
    "none": None,
    "ortho": np.diag([3.7, 4.9, 4.1]),
    "wide": np.diag([6.1, 5.0, 7.3]),
    "narrow": np.diag([2.5, 2.6, 2.45]),
    "slab": np.diag([2.41, 7.3, 6.2]),
    "tilted": np.array([[5.2, 0, 0], [1.9, 4.9, 0], [-2.0, 1.8, 4.4]]),
    "tilted_narrow": np.array([[3.2, 0, 0], [1.6, 3.1, 0], [-1.6, 1.55, 3.4]]),
}

#: Parameters that tests of many files have.
BOX = pytest.mark.parametrize("box", BOXES.values(), ids=BOXES.keys())
_NAMED = {name: {"scheme": name} for name in ("shardlow", "middle", "aboba", "bababo")}
SCHEMES = {"mvv": {"scheme": "mvv"}, "mvv-0.65": {"scheme": "mvv", "lam": 0.65}, **_NAMED}
SCHEME = pytest.mark.parametrize("choices", SCHEMES.values(), ids=SCHEMES.keys())

MASSES = {"A": 1.0, "B": 2.7}


def fluid(
    table=EXTENDED, box=BOXES["ortho"], density=2.0, *, n=None, seed=1, kT=1.0, spread=2, masses=MASSES, positions=None, **options
) -> dpd.Scene:
    """Random two-type fluid with velocities (no total momentum), its beads strewn over ``2 spread + 1`` images of the box along each edge.

    The velocities make the relative motion visible: they are those of kT = 1 for any kT of the scene.
    """
    rng = np.random.default_rng(seed)
    if n is None:
        n = min(250, max(40, int(density * (64.0 if box is None else np.prod(np.diag(box))))))
    fractional = rng.random((n, 3))
    x = fractional * (n / density) ** (1 / 3) if box is None else (fractional + rng.integers(-spread, spread + 1, (n, 3))) @ box
    x = x if positions is None else positions
    names = list(masses)
    types = [names[k] for k in rng.integers(0, len(names), n)]
    m = np.array([masses[name] for name in types])
    v = rng.normal(size=(n, 3)) / np.sqrt(m)[:, None]
    v -= np.sum(m[:, None] * v, axis=0) / m.sum()
    return dpd.Scene(masses, types, x, table, kT, box=box, **{"velocities": v, **options})


def chains(box=BOXES["ortho"], *, n=100, bonded_factors=(0.0, 0.5, 0.25), k=0.0, **options) -> dpd.Scene:
    """The random fluid with chains of four beads, a ring and a star in it, bonded beads 0.4 apart."""
    bonds = [(4 * c + a, 4 * c + a + 1) for c in range(10) for a in range(3)]
    bonds += [(40, 41), (41, 42), (42, 43), (40, 43), (50, 51), (50, 52), (50, 53)]
    x = fluid(box=box, n=n, seed=12).positions.copy()
    for (i, j), step in zip(bonds, np.random.default_rng(13).normal(size=(len(bonds), 3)), strict=True):
        x[j] = x[i] + 0.4 * step / np.linalg.norm(step)
    bonds = [dpd.HarmonicBonds(np.array(bonds), k, 0.5)]
    return fluid(box=box, n=n, seed=12, positions=x, bonds=bonds, bonded_factors=bonded_factors, **options)


def beads(n: int = 81, *, seed: int = 1, kT: float = 1.0, table=None, edge: float = 3.0, positions=None, **options) -> dpd.Scene:
    """The standard fluid: one type, rho = 3, A = 25, gamma = 4.5."""
    rng = np.random.default_rng(seed)
    table = table or {("W", "W"): D(A=25, gamma=4.5)}
    x = rng.random((n, 3)) * edge if positions is None else positions
    return dpd.Scene({"W": 1.0}, ["W"] * n, x, table, kT, **{"box": [edge] * 3, **options})


# -- what the oracle needs -----------------------------------------------------------------------------------------------------
def oracle_params(scene: dpd.Scene, layer: int = 0) -> oracle.PairParams:
    """The oracle's coefficients of one table of a scene."""
    names = scene.type_names
    arrays = {key: np.zeros((len(names), len(names))) for key in ("A", "gamma", "gamma_perp", "s", "s_perp", "cutoff")}
    for (a, b), c in scene.tables[layer].resolve(names).items():
        if c is dpd.NONE:
            continue
        gamma = c.sigma**2 / (2 * scene.initial_kT) if c.gamma is None and c.sigma else c.gamma or 0.0
        values = {"A": c.A, "gamma": gamma, "gamma_perp": c.gamma_perp, "s": c.exponent, "s_perp": c.exponent_perp, "cutoff": c.cutoff}
        i, j = names.index(a), names.index(b)
        for key, value in values.items():
            arrays[key][i, j] = arrays[key][j, i] = value
    return oracle.PairParams(**arrays)


def factor_of(scene: dpd.Scene):
    """Factor of a pair by the number of bonds between its beads, from powers of the adjacency matrix."""
    n = scene.n_beads
    reach = np.zeros((n, n), bool)
    reach[tuple(scene.bond_pairs.T)] = True
    reach |= reach.T
    factors, known, step = np.ones((n, n)), np.eye(n, dtype=bool), np.eye(n, dtype=bool)
    for special in scene.bonded_factors:
        step = (step.astype(int) @ reach.astype(int)) > 0
        factors[step & ~known] = special
        known |= step
    return lambda i, j: factors[i, j]


@compiled
def _fill(key, table):
    for i in range(table.shape[0]):
        for j in range(i + 1, table.shape[0]):
            pair = hashed.pair_key(key, i, j)
            for k in range(table.shape[2]):
                table[i, j, k] = hashed.normal(pair, k)


def noise_of(n: int, seed: int, counter: int, kT: float, layer: int = 0, streams: int = 4):
    """The kernel's numbers as the oracle's callable noise(i, j, k), i < j."""
    table = np.full((n, n, streams), np.nan)
    _fill(hashed.noise_key(seed, counter, layer, kT), table)
    return lambda i, j, k: table[i, j, k]


def listed_pairs(engine: PairEngine, layer: int = 0) -> list[tuple[int, int]]:
    """Pairs of the prepared positions, in the order in which a sweep takes them."""
    pairs = engine.lists[layer]
    rows = pairs.rows
    return list(zip(pairs.order[pairs.arrays.pi[rows]].tolist(), pairs.order[pairs.arrays.pj[rows]].tolist(), strict=True))


# -- running -------------------------------------------------------------------------------------------------------------------
def run_of(scene: dpd.Scene, device, **choices):
    """Simulation of a scene on a device (see ``openmm_dpd.build`` for the choices)."""
    return dpd.build(scene, platform=device.platform, **{"seed": 11, **choices}).simulation(properties=device.properties)


def state_of(context) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities, nm and nm/ps."""
    state = context.getState(positions=True, velocities=True)
    x = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    v = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
    return np.array(x), np.array(v)


def external_force(expression: str, n: int) -> openmm.Force:
    """A force of the user's on each of n beads."""
    force = openmm.CustomExternalForce(expression)
    for bead in range(n):
        force.addParticle(bead)
    return force


def place(context, x, v) -> None:
    """Give a Context positions and velocities."""
    context.setPositions(x)
    context.setVelocities(v)


def stepped(simulation, n: int):
    """A Simulation after n steps."""
    simulation.step(n)
    return simulation


def step_all(n: int, *simulations) -> None:
    """n steps of each."""
    for simulation in simulations:
        simulation.step(n)


def ready(engine: PairEngine, x, box) -> PairEngine:
    """An engine that knows where beads are."""
    engine.prepare(x, box)
    return engine


def same_bits(first, second) -> bool:
    """Whether two states agree bit for bit."""
    return all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def steps(context, n: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Step one by one, handing out the state after each."""
    for _ in range(n):
        context.getIntegrator().step(1)
        yield state_of(context)
