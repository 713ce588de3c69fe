"""Kernels of eDPD and tDPD against a live LAMMPS: temperatures, concentrations and velocities after a few steps."""

from __future__ import annotations

import lammps_steps
import numpy as np
import pytest

from openmm_dpd.kernels.edpd import ThermalTable
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine, PairSpec
from openmm_dpd.kernels.fields import FieldSpec
from openmm_dpd.kernels.tdpd import SpeciesTable

BOX, DT, STEPS = lammps_steps.peer_box(), 0.01, 3
MASSES = np.array([1.0, 2.7])


def matrix(a, b, c) -> np.ndarray:
    return np.array([[a, b], [b, c]], dtype=float)


A, GAMMA, EXPONENT, CUTOFF = matrix(25, 31, 18), matrix(4.5, 2, 9), matrix(2, 0.41, 1.2), matrix(1, 1.2, 0.9)
KAPPA, EXPONENT_FLUX = matrix(0.7, 0.2, 1.3), matrix(2, 1, 3)


@pytest.fixture(scope="module", autouse=True)
def live_lammps():
    reason = lammps_steps.why_missing([("pair", "edpd"), ("pair", "tdpd"), ("fix", "mvv/edpd"), ("fix", "mvv/tdpd")])
    if reason:
        pytest.skip(reason)


def thermal_table(lammps: bool, **changes) -> ThermalTable:
    none = np.zeros((2, 2, 4))
    values = {
        "A": A, "gamma": GAMMA, "kappa": KAPPA, "exponent": EXPONENT, "exponent_T": EXPONENT_FLUX, "cutoff_F": CUTOFF, "cutoff_T": CUTOFF,
        "exponent_polynomial": none, "kappa_polynomial": none,
    } | changes  # fmt: skip
    return ThermalTable(cutoff=np.maximum(values["cutoff_F"], values["cutoff_T"]), lammps=lammps, **values)


def engine_of(table, types, values, capacity=None, kind="temperature") -> PairEngine:
    fields = FieldSpec(kind, values, np.zeros(len(types), bool), capacity=capacity)
    return PairEngine(PairSpec(types, 1 / MASSES[types], (table,), fields=fields, sweeps=False))


def stepped(x, v, values, types, rates_at, steps=STEPS):
    """Velocity Verlet of positions, velocities and values: the mvv fixes with lambda = 1/2."""
    m = MASSES[types][:, None]
    f, q = rates_at(x, v, values)
    for _ in range(steps):
        v, values = v + 0.5 * DT * f / m, values + 0.5 * DT * q
        x = x + DT * v
        f, q = rates_at(x, v, values)
        v, values = v + 0.5 * DT * f / m, values + 0.5 * DT * q
    return v, values


def many_beads(n=60):
    rng = np.random.default_rng(12)
    return rng, (np.arange(n) % 2).astype(np.int32), rng.uniform(4.0, 6.5, (n, 3)), rng.normal(size=(n, 3))


def same_change(got, expected, start, tolerance):
    """Differences as a fraction of the largest change, which must not be small."""
    change = np.abs(expected - start).max()
    assert change > 1e-3
    assert np.abs(got - expected).max() < tolerance * change


@pytest.mark.parametrize("lammps", [False, True], ids=["consistent", "lammps"])
def test_conduction(lammps):
    """Without drag the forces have no noise, and with C of 1e24 and kappa 1/C that of the heat is 1e-12 of the conduction."""
    rng, types, x, v = many_beads()
    n, scale = len(x), 1e24
    temperature, capacity = rng.uniform(0.7, 1.8, n), scale * rng.uniform(1.0, 2.0, n)
    peer = lammps_steps.run(
        "edpd", x, v, types, MASSES,
        [
            *(f"set atom {k + 1} edpd/temp {temperature[k]} edpd/cv {capacity[k]}" for k in range(n)),
            "pair_style edpd 1.2 99",
            *(
                f"pair_coeff {a + 1} {b + 1} {A[a, b]} 0 2 {CUTOFF[a, b]} {KAPPA[a, b] / scale} {EXPONENT_FLUX[a, b]} {CUTOFF[a, b]}"
                for a, b in ((0, 0), (0, 1), (1, 1))
            ),
            "fix 1 all mvv/edpd 0.5", f"timestep {DT}", "neigh_modify every 1 delay 0 check no",
        ],
        STEPS, {"T": "edpd/temp/atom"},
    )  # fmt: skip
    table = thermal_table(lammps, gamma=0 * GAMMA, kappa=KAPPA / scale)
    engine = engine_of(table, types, temperature[:, None], capacity)

    def at(x, v, values):
        engine.prepare(x, BOX)
        _, force, _ = engine.forces(CONSERVATIVE | DISSIPATIVE, v, 1.0, DT, 0, 0, values)
        return force, engine.rates.copy()

    v_end, end = stepped(x, v, temperature[:, None], types, at)
    same_change(end[:, 0], peer.values["T"], temperature, 1e-9)
    same_change(v_end, peer.v, v, 1e-9)


@pytest.mark.parametrize("polynomials", [False, True], ids=["plain", "polynomials"])
def test_one_pair_with_the_noise_that_lammps_draws(polynomials):
    """What noise does is proportional to the pair's number (below 5), so the kernel's is replaced by LAMMPS's; unequal masses."""
    seed, power, kappa = 4711, (0.5, -0.3, 0.8, 0.2), (0.5, -0.3, 0.2, 0.1)
    x, v = np.array([[5.0, 5, 5], [5.3, 5.2, 4.8]]), np.array([[0.4, -0.3, 1.0], [-0.6, 0.2, 0.3]])
    temperature, capacity, types = np.array([0.8, 1.7]), np.array([3.0, 5.0]), np.array([0, 1], np.int32)
    words = f" power {' '.join(map(str, power))} kappa {' '.join(map(str, kappa))}" if polynomials else ""
    peer = lammps_steps.run(
        "edpd", x, v, types, MASSES,
        [
            *(f"set atom {k + 1} edpd/temp {temperature[k]} edpd/cv {capacity[k]}" for k in range(2)),
            f"pair_style edpd 1.0 {seed}", "pair_coeff * * 18.75 4.5 1.4 1.0 0.02 2.0 1.0" + words,
            "fix 1 all mvv/edpd 0.5", f"timestep {DT}",
        ],
        STEPS, {"T": "edpd/temp/atom"},
    )  # fmt: skip
    one = np.ones((2, 2))
    changes = {"A": 18.75, "gamma": 4.5, "exponent": 1.4, "kappa": 0.02, "exponent_T": 2.0, "cutoff_F": 1.0, "cutoff_T": 1.0}
    arrays = {key: value * one for key, value in changes.items()}
    if polynomials:
        arrays |= {"exponent_polynomial": one[..., None] * power, "kappa_polynomial": one[..., None] * kappa}
    engine = engine_of(thermal_table(True, **arrays), types, temperature[:, None], capacity)
    theirs = iter(lammps_steps.lammps_normals(seed, STEPS + 1))
    axis, theta = (x[0] - x[1]) / np.linalg.norm(x[0] - x[1]), 2.0 / np.sum(1.0 / temperature)

    # the kernel's own number, from the force at the start
    engine.prepare(x, BOX)
    drawn = engine.forces(RANDOM, v, 1.0, DT, 0, 0, temperature[:, None])[1][0] @ axis
    w = 1.0 - np.linalg.norm(x[0] - x[1])
    factor = 1.0 if not polynomials else 1.0 + np.polynomial.polynomial.polyval(0.25, (0.0, *power))
    xi = drawn / (np.sqrt(2 * 4.5 * theta / DT) * w ** (0.7 * factor))
    assert 0.01 < abs(xi) < 5.0

    def at(x, v, values):
        engine.prepare(x, BOX)
        force, rates, scale = 0.0, 0.0, next(theirs) / xi
        for which, share in ((CONSERVATIVE, 1.0), (DISSIPATIVE, 1.0), (RANDOM, scale)):
            force = force + share * engine.forces(which, v, 1.0, DT, 0, 0, values)[1]
            rates = rates + share * engine.rates
        return force, rates

    v_end, end = stepped(x, v, temperature[:, None], types, at)
    same_change(end[:, 0], peer.values["T"], temperature, 1e-9)
    same_change(v_end, peer.v, v, 1e-9)


def test_species():
    rng, types, x, v = many_beads()
    n, n_species, cutoff_c = len(x), 3, 0.85
    start = rng.uniform(size=(n, n_species))
    kappa = np.stack([KAPPA * (k + 1) for k in range(n_species)], axis=-1)
    exponent = np.ones((2, 2, 1)) * [2.0, 1.0, 0.5]
    peer = lammps_steps.run(
        f"tdpd {n_species}", x, v, types, MASSES,
        [
            *(f"set atom {k + 1} cc {s + 1} {start[k, s]}" for k in range(n) for s in range(n_species)),
            "pair_style tdpd 0.0 1.2 99",
            *(
                f"pair_coeff {a + 1} {b + 1} {A[a, b]} {GAMMA[a, b]} {EXPONENT[a, b]} {CUTOFF[a, b]} {cutoff_c} "
                + " ".join(f"{kappa[a, b, s]} 0 {exponent[a, b, s]}" for s in range(n_species))
                for a, b in ((0, 0), (0, 1), (1, 1))
            ),
            "fix 1 all mvv/tdpd 0.5", f"timestep {DT}", "neigh_modify every 1 delay 0 check no",
        ],
        STEPS, {f"C{k}": f"tdpd/cc/atom {k}" for k in (1, 2, 3)},
    )  # fmt: skip
    table = SpeciesTable(A, GAMMA, EXPONENT, CUTOFF, np.full((2, 2), cutoff_c), CUTOFF, kappa, 0 * kappa, exponent)
    engine = engine_of(table, types, start, kind="species")

    def at(x, v, values):
        engine.prepare(x, BOX)
        _, force, _ = engine.forces(CONSERVATIVE | DISSIPATIVE | RANDOM, v, 0.0, DT, 0, 0, values)
        return force, engine.rates.copy()

    v_end, end = stepped(x, v, start, types, at)
    same_change(end, np.stack([peer.values[f"C{k}"] for k in (1, 2, 3)], axis=1), start, 1e-9)
    same_change(v_end, peer.v, v, 1e-9)
