"""The oracles of beads with internal energies, and of beads that carry heat and species, against a live LAMMPS, noise included."""

import lammps_peer
import lammps_steps
import numpy as np
import oracle_energy as oe
import oracle_meso as om
import pytest

EDPD = {
    "A": np.array([[25.0, 31.0], [31.0, 18.0]]),
    "gamma": np.array([[4.5, 2.0], [2.0, 9.0]]),
    "power": np.array([[2.0, 0.41], [0.41, 1.2]]),
    "cutoff": np.array([[1.0, 1.2], [1.2, 0.9]]),
    "kappa": np.array([[0.7, 0.2], [0.2, 1.3]]),
    "power_T": np.array([[2.0, 1.0], [1.0, 3.0]]),
    "cutoff_T": np.array([[1.2, 0.8], [0.8, 0.9]]),
}
MOMENTUM = {name: EDPD[name] for name in ("A", "gamma", "power", "cutoff")}
POLYNOMIAL = np.array([0.5, -0.3, 0.8, 0.2])


@pytest.fixture(scope="module")
def live_lammps():
    lammps_peer.need(("pair", "edpd"), ("pair", "tdpd"), ("fix", "mvv/edpd"), ("fix", "edpd/source"), ("fix", "tdpd/source"))


BOX = lammps_steps.peer_box()
X2 = np.array([[5.0, 5, 5], [5.3, 5.2, 4.8]])  # r = 0.412
V2 = np.array([[0.4, -0.3, 1.0], [-0.6, 0.2, 0.3]])
T2, CV2 = np.array([0.8, 1.7]), np.array([3.0, 5.0])

EDPD_CASES = {
    "plain": {},
    "power": {"power_coeffs": POLYNOMIAL},
    "kappa": {"kappa_coeffs": POLYNOMIAL},
    "both": {"power_coeffs": POLYNOMIAL, "kappa_coeffs": POLYNOMIAL[::-1]},
    "smallest power": {"power_coeffs": -100.0 * POLYNOMIAL**2},
    "heat beyond the forces": {"cutoff": 0.38, "cutoff_T": 1.0},
    "odd powers": {"power": 0.41, "power_T": 3.0},
    "unequal masses": {"masses": (1.0, 2.7)},
    "unequal masses, other order": {"masses": (2.7, 1.0)},
    "second bead owns the pair": {"masses": (1.0, 2.7), "x": np.array([[5.0, 5, 5.6], [5.0, 5, 5.0]]), "owner": max},
}


def edpd_line(options):
    line = "pair_coeff * * " + " ".join(str(options[k]) for k in ("A", "gamma", "power", "cutoff", "kappa", "power_T", "cutoff_T"))
    for word in ("power", "kappa"):
        if f"{word}_coeffs" in options:
            line += f" {word} " + " ".join(str(c) for c in options[f"{word}_coeffs"])
    return line


@pytest.mark.parametrize("case", EDPD_CASES.values(), ids=EDPD_CASES.keys())
def test_edpd_pair_and_step_with_their_noise_equal_lammps(live_lammps, case):
    seed, dt, lam, steps = 4711, 0.01, 0.65, 3
    options = {"A": 18.75, "gamma": 4.5, "power": 2.0, "cutoff": 1.0, "kappa": 0.02, "power_T": 2.0, "cutoff_T": 1.0} | case
    masses, start = np.array(options.pop("masses", (1.3, 1.3))), options.pop("x", X2)
    beads = [f"set atom {k} edpd/temp {t} edpd/cv {c}" for k, t, c in zip((1, 2), T2, CV2, strict=True)]
    fixes = [f"fix 1 all mvv/edpd {lam}", "fix 2 all edpd/source cuboid 5 5 5 0.2 9 9 0.3", f"timestep {dt}"]
    commands = [*beads, f"pair_style edpd 1.0 {seed}", edpd_line(options), *fixes]
    peer = lammps_steps.run("edpd", start, V2, (0, 1), masses, commands, steps, {"T": "edpd/temp/atom"})
    noise = iter(lammps_steps.lammps_normals(seed, steps + 1))
    source_on = iter([False] + [True] * steps)  # the source is not there at setup

    def at(x, v, T):
        xi = lammps_steps.two_bead_noise(next(noise), True)
        got = om.edpd_pair(x, v, T, CV2, (0, 0), masses, **options, box=BOX, dt=dt, xi=xi, compat="lammps")
        source = om.edpd_source(om.in_cuboid(x, [5, 5, 5], [0.2, 9, 9]), 0.3, CV2)
        at.terms = got.terms
        return got.terms.forces, got.q + (source if next(source_on) else 0.0)

    state = om.EdpdState(start, V2, T2, *at(start, V2, T2))
    for _ in range(steps):
        state = om.mvv_edpd_step(state.x, state.v, state.T, state.f, state.q, masses, CV2, dt, lam, at)
    assert np.all(np.abs(state.T - T2)[: 2 if "cutoff" not in case else 1] > 1e-3)
    np.testing.assert_allclose(peer.x, state.x, rtol=1e-13)
    np.testing.assert_allclose(peer.v, state.v, rtol=1e-10)
    np.testing.assert_allclose(peer.f, state.f, rtol=1e-9)
    np.testing.assert_allclose(peer.values["T"], state.T, rtol=1e-11)
    assert peer.pe == pytest.approx(at.terms.energy, rel=1e-11)
    assert peer.press == pytest.approx(oe.pressure(masses, state.v, at.terms, BOX), rel=1e-10)


def test_edpd_conduction_among_many_beads_equals_lammps(live_lammps):
    """Cv 1e16 and kappa Cv^2 as large make the heat noise 1e-8 of the conduction; no drag, hence no noise in the forces."""
    n, dt, steps = 60, 0.01, 2
    rng = np.random.default_rng(12)
    x, v = rng.uniform(4.0, 6.5, (n, 3)), rng.normal(size=(n, 3))
    T, cv, types = rng.uniform(0.7, 1.8, n), 1e16 * rng.uniform(1.0, 2.0, n), np.arange(n) % 2
    beads = [f"set atom {k} edpd/temp {t} edpd/cv {c}" for k, (t, c) in enumerate(zip(T, cv, strict=True), start=1)]
    options = EDPD | {"gamma": 0.0, "kappa": EDPD["kappa"] * 1e-16, "cutoff_T": EDPD["cutoff"]}
    words = {p: [options[k][p] for k in ("cutoff", "kappa", "power_T", "cutoff_T")] for p in ((0, 0), (0, 1), (1, 1))}
    terms = [f"pair_coeff {a + 1} {b + 1} {EDPD['A'][a, b]} 0.0 2.0 {' '.join(map(str, values))}" for (a, b), values in words.items()]
    fixes = ["fix 1 all mvv/edpd 0.5", f"timestep {dt}", "neigh_modify every 1 delay 0 check no"]
    commands = [*beads, "pair_style edpd 1.2 99", *terms, *fixes]
    peer = lammps_steps.run("edpd", x, v, types, (1.0, 2.7), commands, steps, {"T": "edpd/temp/atom"})
    masses = np.array([1.0, 2.7])[types]

    def at(x, v, T):
        got = om.edpd_pair(x, v, T, cv, types, masses, **options, box=BOX, dt=dt)
        return got.terms.forces, got.q

    state = om.EdpdState(x, v, T, *at(x, v, T))
    for _ in range(steps):
        state = om.mvv_edpd_step(state.x, state.v, state.T, state.f, state.q, masses, cv, dt, 0.5, at)
    assert np.abs(state.T - T).max() > 1e-3
    np.testing.assert_allclose(peer.v, state.v, atol=1e-9)
    np.testing.assert_allclose(peer.values["T"], state.T, atol=1e-8)


def tdpd_line(a, b, options):
    head = " ".join(str(options[k][a, b]) for k in ("A", "gamma", "power", "cutoff"))
    species = " ".join(f"{k[a, b]} {e} {p}" for k, e, p in zip(options["kappa"], options["epsilon"], options["power_C"], strict=True))
    return f"pair_coeff {a + 1} {b + 1} {head} {options['cutoff_C']} {species}"


@pytest.mark.parametrize("cutoff_C", [1.0, 0.5, 1.5])
def test_tdpd_pair_and_step_with_their_noise_equal_lammps(live_lammps, cutoff_C):
    seed, dt, lam, steps, kT = 4711, 0.01, 0.65, 3, 0.7
    C, masses = np.array([[1.0, 2.0], [0.4, 5.0]]), np.array([1.0, 2.7])
    options = {**MOMENTUM, "cutoff_C": cutoff_C, "kappa": [EDPD["kappa"], 2 * EDPD["kappa"]], "epsilon": [0.1, 0.2], "power_C": [2.0, 1.0]}
    beads = [f"set atom {k + 1} cc {s + 1} {C[k, s]}" for k in range(2) for s in range(2)]
    pairs = [f"pair_style tdpd {kT} 1.0 {seed}", *(tdpd_line(a, b, options) for a, b in ((0, 0), (0, 1), (1, 1)))]
    commands = [*beads, *pairs, f"fix 1 all mvv/tdpd {lam}", "fix 2 all tdpd/source 2 sphere 5 5 5 1.0 0.3", f"timestep {dt}"]
    peer = lammps_steps.run("tdpd 2", X2, V2, (0, 1), masses, commands, steps, {"C1": "tdpd/cc/atom 1", "C2": "tdpd/cc/atom 2"})
    noise = iter(lammps_steps.pair_noise(seed, steps + 1, 3))
    source_on = iter([False] + [True] * steps)

    def at(x, v, C):
        xi, *xi_C = next(noise)
        xi_C = [lammps_steps.two_bead_noise(z, False) for z in xi_C]
        drawn = {"xi": lammps_steps.two_bead_noise(xi, True), "xi_C": xi_C}
        got = om.tdpd_pair(x, v, C, (0, 1), **options, kT=kT, box=BOX, dt=dt, **drawn, compat="lammps")
        source = om.tdpd_source(om.in_sphere(x, [5, 5, 5], 1.0), 1, 0.3, 2)
        at.terms = got.terms
        return got.terms.forces, got.Q + (source if next(source_on) else 0.0)

    state = om.TdpdState(X2, V2, C, *at(X2, V2, C))
    for _ in range(steps):
        state = om.mvv_tdpd_step(state.x, state.v, state.C, state.f, state.Q, masses, dt, lam, at)
    np.testing.assert_allclose(peer.v, state.v, rtol=1e-10)
    np.testing.assert_allclose(np.stack([peer.values["C1"], peer.values["C2"]], axis=1), state.C, rtol=1e-12)
    assert np.abs(state.C - C).max() > 1e-3
    assert peer.press == pytest.approx(oe.pressure(masses, state.v, at.terms, BOX), rel=1e-10)


def test_tdpd_without_noise_equals_lammps_for_many_beads(live_lammps):
    n, dt, steps, lam = 60, 0.01, 3, 0.65
    rng = np.random.default_rng(12)
    x, v, C = rng.uniform(4.0, 6.5, (n, 3)), rng.normal(size=(n, 3)), rng.uniform(size=(n, 3))
    types = np.arange(n) % 2
    masses = np.array([1.0, 2.7])[types]
    kappa = [EDPD["kappa"] * k for k in (1, 2, 3)]
    options = {**MOMENTUM, "cutoff_C": 0.85, "kappa": kappa, "epsilon": [0.0] * 3, "power_C": [2.0, 1.0, 0.5]}
    beads = [f"set atom {k + 1} cc {s + 1} {C[k, s]}" for k in range(n) for s in range(3)]
    pairs = ["pair_style tdpd 0.0 1.2 99", *(tdpd_line(a, b, options) for a, b in ((0, 0), (0, 1), (1, 1)))]
    commands = [*beads, *pairs, f"fix 1 all mvv/tdpd {lam}", f"timestep {dt}", "neigh_modify every 1 delay 0 check no"]
    peer = lammps_steps.run("tdpd 3", x, v, types, (1.0, 2.7), commands, steps, {f"C{k}": f"tdpd/cc/atom {k}" for k in (1, 2, 3)})

    def at(x, v, C):
        got = om.tdpd_pair(x, v, C, types, **options, kT=0.0, box=BOX, dt=dt, compat="lammps")
        at.terms = got.terms
        return got.terms.forces, got.Q

    state = om.TdpdState(x, v, C, *at(x, v, C))
    for _ in range(steps):
        state = om.mvv_tdpd_step(state.x, state.v, state.C, state.f, state.Q, masses, dt, lam, at)
    np.testing.assert_allclose(peer.v, state.v, atol=1e-10)
    np.testing.assert_allclose(np.stack([peer.values[f"C{k}"] for k in (1, 2, 3)], axis=1), state.C, atol=1e-11)
    assert peer.pe == pytest.approx(at.terms.energy, rel=1e-11)
    assert peer.press == pytest.approx(oe.pressure(masses, state.v, at.terms, BOX), rel=1e-9)


A = np.array([[25.0, 31.0], [31.0, 18.0]])
SIGMA = np.array([[3.0, 2.0], [2.0, 4.0]])
KAPPA = np.array([[0.7, 0.2], [0.2, 1.3]])
CUTOFF = np.array([[1.0, 1.2], [1.2, 0.9]])


@pytest.fixture(scope="module")
def with_energies():
    lammps_peer.need(("pair", "dpd/fdt/energy"), ("fix", "shardlow"), ("fix", "eos/cv"), ("fix", "dpd/energy"))


TYPE_MASSES = np.array([1.0, 2.7])
DPD_COLUMNS = {"dpd": "dpd/atom"}


def dpd_commands(theta, seed, scale, fixes, dt, pairs=((0, 0), (0, 1), (1, 1))):
    """``scale`` multiplies sigma^2 and kappa: with temperatures as small, drag and conduction stay and noise goes."""
    beads = [f"set atom {k} dpd/theta {float(t)!r}" for k, t in enumerate(theta, start=1)]
    words = [f"{A[p]} {SIGMA[p] * np.sqrt(scale)} {KAPPA[p] * scale} {CUTOFF[p]}" for p in pairs]
    terms = [f"pair_coeff {a + 1} {b + 1} {values}" for (a, b), values in zip(pairs, words, strict=True)]
    return [*beads, f"pair_style dpd/fdt/energy 1.2 {seed}", *terms, *fixes, f"timestep {dt!r}", "neigh_modify every 1 delay 0 check no"]


@pytest.mark.parametrize("types", [(0, 0), (0, 1), (1, 0)])
def test_two_beads_with_their_noise_equal_lammps_for_three_steps(with_energies, types):
    seed, dt, cv, steps = 4711, 0.01, 2.5, 3
    x, v = np.array([[5.0, 5, 5], [5.3, 5.2, 4.8]]), np.array([[0.4, -0.3, 1.0], [-0.6, 0.2, 0.3]])
    theta, masses = np.array([0.8, 1.7]), TYPE_MASSES[list(types)]
    fixes = ["fix 1 all nve", f"fix 2 all eos/cv {cv}", "fix 3 all dpd/energy"]
    peer = lammps_steps.run("dpd", x, v, types, TYPE_MASSES, dpd_commands(theta, seed, 1.0, fixes, dt), steps, DPD_COLUMNS)

    noise = iter(lammps_steps.pair_noise(seed, steps + 1, 2))

    def at(x, v, theta):
        xi, xi_q = next(noise)
        return oe.dpde_rates(
            x, v, theta, types, masses, A, SIGMA, KAPPA, CUTOFF, lammps_steps.peer_box(), 1.0, dt,
            lammps_steps.two_bead_noise(xi, True), lammps_steps.two_bead_noise(xi_q, False),
        )  # fmt: skip

    eos = oe.constant_cv(cv)
    state = oe.VerletState(x, v, np.zeros(2), eos.u(theta), theta, at(x, v, theta))
    for _ in range(steps):
        state = oe.dpde_verlet_step(state.x, state.v, state.u_cond, state.u_mech, state.rates, masses, dt, eos, at)
    u_cond, u_mech, _, theta_peer = peer.values["dpd"].T
    np.testing.assert_allclose(peer.x, state.x, rtol=1e-13)
    np.testing.assert_allclose(peer.v, state.v, rtol=1e-11)
    np.testing.assert_allclose(peer.f, state.rates.terms.forces, rtol=1e-10)
    np.testing.assert_allclose(u_mech, state.u_mech, rtol=1e-12)
    np.testing.assert_allclose(u_cond, state.u_cond, rtol=1e-11)
    np.testing.assert_allclose(theta_peer, state.theta, rtol=1e-12)
    assert peer.pe == pytest.approx(state.rates.terms.energy, rel=1e-12)
    assert peer.press == pytest.approx(oe.pressure(masses, state.v, state.rates.terms, lammps_steps.peer_box()), rel=1e-11)


def test_many_beads_without_noise_equal_lammps_for_three_steps(with_energies):
    """Temperatures and coefficients scaled by 1e-16 leave noise 1e-7 as large as the rest."""
    scale, dt, steps, cv = 1e-16, 0.01, 3, 2.5e16
    rng = np.random.default_rng(12)
    x, v = rng.uniform(4.0, 6.5, (40, 3)), rng.normal(size=(40, 3))
    types, theta = np.arange(40) % 2, scale * rng.uniform(0.7, 1.8, 40)
    masses = TYPE_MASSES[types]
    fixes = ["fix 1 all nve", f"fix 2 all eos/cv {cv}", "fix 3 all dpd/energy"]
    peer = lammps_steps.run("dpd", x, v, types, TYPE_MASSES, dpd_commands(theta, 99, scale, fixes, dt), steps, DPD_COLUMNS)

    def at(x, v, theta):
        return oe.dpde_rates(x, v, theta, types, masses, A, SIGMA * np.sqrt(scale), KAPPA * scale, CUTOFF, lammps_steps.peer_box(), 1.0, dt)

    eos = oe.constant_cv(cv)
    state = oe.VerletState(x, v, np.zeros(40), eos.u(theta), theta, at(x, v, theta))
    for _ in range(steps):
        state = oe.dpde_verlet_step(state.x, state.v, state.u_cond, state.u_mech, state.rates, masses, dt, eos, at)
    u_cond, u_mech, _, theta_peer = peer.values["dpd"].T
    np.testing.assert_allclose(peer.v, state.v, atol=3e-7)
    np.testing.assert_allclose(peer.f, state.rates.terms.forces, atol=3e-5)
    assert np.abs(state.u_cond).max() > 1e-3
    np.testing.assert_allclose(u_cond, state.u_cond, atol=1e-7)
    np.testing.assert_allclose(u_mech - cv * theta, state.u_mech - cv * theta, atol=1e-6)
    np.testing.assert_allclose(theta_peer, state.theta, rtol=1e-6)


def test_shardlow_sweep_without_noise_equals_lammps(with_energies):
    """Separate pairs, so that the order does not matter; one step; noise scaled away as above."""
    scale, dt, cv, n = 1e-16, 0.05, 2.5e16, 16
    rng = np.random.default_rng(3)
    x = np.repeat(2.0 + 3.0 * np.array(np.unravel_index(np.arange(n // 2), (2, 2, 2))).T, 2, axis=0)
    x[1::2] += rng.uniform(0.15, 0.45, (n // 2, 3))
    v, types, theta = rng.normal(size=(n, 3)), rng.integers(0, 2, n), scale * rng.uniform(0.7, 1.8, n)
    masses, box = TYPE_MASSES[types], lammps_steps.peer_box()
    fixes = ["fix 0 all shardlow", "fix 1 all nve", f"fix 2 all eos/cv {cv}"]
    peer = lammps_steps.run("dpd", x, v, types, TYPE_MASSES, dpd_commands(theta, 99, scale, fixes, dt), 1, DPD_COLUMNS)

    order = [(k, k + 1) for k in range(0, n, 2)]
    pairs = (SIGMA * np.sqrt(scale), KAPPA * scale, CUTOFF)
    out = oe.shardlow_energy_sweep(x, v, np.zeros(n), cv * theta, theta, order, types, masses, *pairs, box, 1.0, dt, None, None)

    def force(x):
        return oe.dpde_rates(x, v, theta, types, masses, A, 0.0, 0.0, CUTOFF, box, 1.0, dt).terms.forces

    half = out.v + 0.5 * dt * force(x) / masses[:, None]
    new = half + 0.5 * dt * force(x + dt * half) / masses[:, None]
    np.testing.assert_allclose(peer.x, x + dt * half, atol=1e-8)
    np.testing.assert_allclose(peer.v, new, atol=3e-7)
    u_cond, u_mech, _, theta_peer = peer.values["dpd"].T
    assert np.abs(out.u_cond).max() > 1e-4 and np.abs(out.u_mech - cv * theta).max() > 0.01
    np.testing.assert_allclose(u_cond, out.u_cond, atol=3e-8)
    np.testing.assert_allclose(u_mech - cv * theta, out.u_mech - cv * theta, atol=3e-7)
    np.testing.assert_allclose(theta_peer, (out.u_cond + out.u_mech) / cv, rtol=1e-7)


@pytest.mark.parametrize("types", [(0, 0), (0, 1)])
def test_shardlow_pair_with_noise_equals_lammps(with_energies, types):
    """LAMMPS's own noise is read off the velocities; the energies and the other component of momentum then follow."""
    dt, cv = 0.05, 2.5
    x, v = np.array([[5.0, 5, 5], [5.3, 5.2, 4.8]]), np.array([[0.4, -0.3, 1.0], [-0.6, 0.2, 0.3]])
    theta, masses, box = np.array([0.8, 1.7]), TYPE_MASSES[list(types)], lammps_steps.peer_box()
    commands = dpd_commands(theta, 4711, 1.0, ["fix 0 all shardlow", "fix 1 all nve", f"fix 2 all eos/cv {cv}"], dt)
    peer = lammps_steps.run("dpd", x, v, types, TYPE_MASSES, commands, 1, DPD_COLUMNS)

    def force(x):
        return oe.dpde_rates(x, v, theta, types, masses, A, 0.0, 0.0, CUTOFF, box, 1.0, dt).terms.forces

    def sweep(xi, xi_q):
        return oe.shardlow_energy_sweep(
            x, v, np.zeros(2), cv * theta, theta, [(0, 1)], types, masses, SIGMA, KAPPA, CUTOFF, box, 1.0, dt,
            lammps_steps.two_bead_noise(xi, True), lammps_steps.two_bead_noise(xi_q, False),
        )  # fmt: skip

    after = peer.v - 0.5 * dt * (force(x) + force(peer.x)) / masses[:, None]
    u_cond, u_mech, _, _ = peer.values["dpd"].T
    none, unit = sweep(0.0, 0.0), sweep(1.0, 1.0)
    direction = unit.v[0] - none.v[0]
    xi = np.dot(after[0] - none.v[0], direction) / np.dot(direction, direction)
    xi_q = (u_cond[0] - none.u_cond[0]) / (unit.u_cond[0] - none.u_cond[0])
    assert 0.01 < abs(xi) < 4.5 and 0.01 < abs(xi_q) < 4.5  # N(0,1) numbers, neither absent nor of another scale
    out = sweep(xi, xi_q)
    np.testing.assert_allclose(after, out.v, rtol=1e-9)
    np.testing.assert_allclose(u_mech, out.u_mech, rtol=1e-10)
    np.testing.assert_allclose(u_cond, out.u_cond, rtol=1e-10)


def test_noise_of_lammps_is_normal():
    numbers = np.array(lammps_steps.lammps_normals(2718, 20000))
    error = 1 / np.sqrt(len(numbers))
    assert abs(numbers.mean()) < 4 * error
    assert abs(np.mean(numbers**2) - 1) < 4 * np.sqrt(2) * error
    assert abs(np.mean(numbers[1:] * numbers[:-1])) < 4 * error
