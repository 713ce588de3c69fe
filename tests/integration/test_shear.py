"""Lees-Edwards shear: steps beside the oracle that folds and remaps, the same bits however a run is cut, and what is refused."""

import numpy as np
import oracle
import pytest
from oracle_shear import FoldedShear, folded_state
from scenes import EXTENDED, fluid, listed_pairs, noise_of, oracle_params, state_of

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.model.schemes import read_word, scheme_of
from openmm_dpd.plan.plan import make_plan

EDGES = np.array([3.7, 3.1, 3.4])
T, G = 0.4, 3.0
#: Each kind of shear, with strain and rate written down once more.
SHEARS = {
    "constant": (dpd.LeesEdwards(rate=-2.0), lambda t: -2.0 * t, lambda t: -2.0),
    "ramp": (
        dpd.LeesEdwards(rate=0.5, end_rate=G, ramp_time=T),
        lambda t: 0.5 * t + (G - 0.5) * t * t / (2 * T) if t < T else (G + 0.5) * T / 2 + G * (t - T),
        lambda t: 0.5 + (G - 0.5) * t / T if t < T else G,
    ),
    "oscillating": (dpd.LeesEdwards(amplitude=0.7, frequency=5.0), lambda t: 0.7 * np.sin(5 * t), lambda t: 3.5 * np.cos(5 * t)),
}


def sheared(kind: str, **options) -> dpd.Scene:
    """Random beads of two types, strewn over many images of the box."""
    return fluid(EXTENDED, np.diag(EDGES), n=40, kT=1.3, shear=SHEARS[kind][0], **options)


@pytest.mark.parametrize("kind", SHEARS)
@pytest.mark.parametrize("word", ["middle", "B/5 A/2 3B/5 A/2 B/5 O", "O/2 A/3 B/2 A/3 S/2 B/2 A/3"])
def test_words_step_as_folded_beads_do(kind, word):
    """1e-11 after 12 steps, in which the images have passed each other: friction across the faces, transverse too, and the changing flow."""
    dt, scene, (_, strain, rate) = 0.03, sheared(kind), SHEARS[kind]
    built = dpd.build(scene, dt=dt, scheme=word, platform="Reference", seed=11)
    simulation, kT = built.simulation(), scene.initial_kT
    expected = FoldedShear(scene.positions, scene.velocities, EDGES, scene.type_ids, oracle_params(scene), 1 / scene.bead_masses, strain, rate)
    engine, counter = PairEngine(make_plan(scene, dt=dt, scheme=word, seed=11, platform="CPU").spec), 0
    for _ in range(12):
        for letter, part in scheme_of(word).motion if word == "middle" else read_word(word):
            time = float(part) * dt
            if letter == "A":
                expected.drift(time)
            elif letter == "B":
                expected.kick(time)
            else:
                counter += 1
                engine.prepare(expected.x, expected.lattice())
                noise = noise_of(scene.n_beads, 11, counter, kT)
                update = oracle.shardlow_update if letter == "S" else oracle.ou_update
                expected.sweep(listed_pairs(engine), kT, time, noise, update)
    simulation.step(12)
    x, v = folded_state(*state_of(simulation.context), EDGES, strain(12 * dt), rate(12 * dt))
    off = x - expected.x
    off -= np.round(off / EDGES) * EDGES
    assert np.abs(off).max() < 1e-11 and np.abs(v - expected.v).max() < 1e-11
    assert len(set(expected.turns)) > 3 and abs(strain(12 * dt)) > 0.5


@pytest.mark.parametrize("lam", [0.5, 0.65])
@pytest.mark.parametrize("kind", ["constant", "oscillating"])
def test_friction_as_a_force_is_that_of_folded_beads(kind, lam):
    """The same for ``mvv``."""
    dt, scene, (_, strain, rate) = 0.01, sheared(kind), SHEARS[kind]
    simulation = dpd.build(scene, dt=dt, scheme="mvv", lam=lam, platform="CPU", seed=11).simulation()
    kT, inv_m = scene.initial_kT, 1 / scene.bead_masses[:, None]
    one = FoldedShear(scene.positions, scene.velocities, EDGES, scene.type_ids, oracle_params(scene), inv_m[:, 0], strain, rate)
    f = one.force(True, noise_of(scene.n_beads, 11, 0, kT), kT, dt)
    for step in range(1, 6):
        one.v = one.v + 0.5 * dt * inv_m * f
        predicted = (lam - 0.5) * dt * inv_m * f
        one.drift(dt)
        half = one.v.copy()
        one.v = one.v + predicted
        f = one.force(True, noise_of(scene.n_beads, 11, step, kT), kT, dt)
        one.v = half + 0.5 * dt * inv_m * f
    simulation.step(5)
    x, v = folded_state(*state_of(simulation.context), EDGES, strain(5 * dt), rate(5 * dt))
    off = x - one.x
    off -= np.round(off / EDGES) * EDGES
    assert np.abs(off).max() < 1e-11 and np.abs(v - one.v).max() < 1e-10
