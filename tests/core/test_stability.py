"""Where a scheme fails and another does not, and that a failure is an error and not a trajectory."""

import numpy as np
import openmm
import pytest
from cases import cases, raises
from devices import DEVICES
from judged import any_seed, bounded, judge, ratios
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.lammps import RunOptions, run_deck
from openmm_dpd.plan.forces.pair_force import runaway

N, EDGE = 375, 5.0
TOO_FAST = "more than the cutoff"


def fluid(gamma: float, A: float = 25.0, kT: float = 1.0) -> dpd.Scene:
    """The standard fluid on random points."""
    return beads(N, edge=EDGE, table={("W", "W"): dpd.DPD(A=A, gamma=gamma)}, kT=kT)


def simulation(scene: dpd.Scene, scheme: str, dt: float, settle: float = 5.0, seed: int = 4):
    """A simulation of the scene after some time with ``middle`` at a small step, at a further step with another scheme."""
    first = dpd.build(scene, dt=0.01, scheme="middle", platform="CPU", seed=seed - 1).simulation(properties={"Threads": "1"})
    first.step(round(settle / 0.01))
    state = first.context.getState(positions=True, velocities=True)
    built = dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=seed)
    made = built.simulation(properties={"Threads": "1"})
    made.context.setPositions(state.getPositions())
    made.context.setVelocities(state.getVelocities())
    return made, dpd.Observer(built)


def temperatures(scene: dpd.Scene, scheme: str, dt: float, time: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic and configurational temperature over a time."""
    made, observer = simulation(scene, scheme, dt, seed=seed)
    every = max(1, round(0.12 / dt))
    made.step(round(3.0 / dt))
    rows = []
    for _ in range(round(time / dt / every)):
        made.step(every)
        s = observer.sample(made.context)
        rows.append((s.kT, s.gradient2, s.laplacian))
    kT, above, below = np.array(rows).T
    return kT, ratios(above, below)


@any_seed(4)
def test_strong_friction_at_a_long_step(seed):
    """gamma dt = 2.4: velocity Verlet blows up, middle (1 % off in the long run) is within 2 % in both temperatures, beside the noise."""
    scene = fluid(40.5)
    made, _ = simulation(scene, "mvv", 0.06, seed=seed)
    raises(openmm.OpenMMException, TOO_FAST, lambda: made.step(500))
    kinetic, configurational = temperatures(scene, "middle", 0.06, 60.0, seed)
    judge(kinetic, 1.0, error=0.006, beside=0.02)
    judge(configurational, 1.0, error=0.01, beside=0.02)


@any_seed(4)
def test_weak_friction_at_a_long_step(seed):
    """gamma 4.5, dt 0.08: in its configurations velocity Verlet is 31 % too hot; aboba is 2 % too cold, hence within 3 % and the noise."""
    scene = fluid(4.5)
    hot, _, bound = bounded(temperatures(scene, "mvv", 0.08, 40.0, seed)[1])
    assert hot - bound > 1.10
    judge(temperatures(scene, "aboba", 0.08, 60.0, seed)[1], 1.0, error=0.01, beside=0.03)


@any_seed(4)
@pytest.mark.parametrize("gamma", [4.5, pytest.param(40.5, marks=pytest.mark.slow)])
def test_two_forces_to_a_sweep_at_a_step_where_all_others_fail(gamma, seed):
    """dt 0.12: one force per step flies apart or is off by more than a tenth; bababo has both temperatures within 1 % and the noise."""
    scene = fluid(gamma)
    raises(openmm.OpenMMException, TOO_FAST, lambda: simulation(scene, "mvv", 0.12, seed=seed)[0].step(500))
    assert temperatures(scene, "aboba", 0.12, 40.0, seed)[0].mean() > 1.2
    kinetic, configurational = temperatures(scene, "bababo", 0.12, 80.0, seed)
    judge(kinetic, 1.0, error=0.009, beside=0.01)
    judge(configurational, 1.0, error=0.01, beside=0.01)


@cases("scheme, dt", ("mvv", 0.06), ("mvv", 0.3), ("shardlow", 0.3), ("middle", 0.4), ("aboba", 0.4), ("bababo", 0.4))
def test_every_scheme_that_blows_up_says_so(scheme, dt):
    """Soft beads never become NaN: without a check this would run on at a million times the temperature."""
    made, _ = simulation(fluid(40.5), scheme, dt)
    raises(openmm.OpenMMException, r"bead \d+ moves .* nm in one step.*times what it should be.*step size", lambda: made.step(500))


@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
@pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle", "aboba", "bababo"])
def test_a_step_in_which_beads_cross_the_box_is_an_error(scheme, conservative):
    """At these steps the box is crossed before ten thermal speeds are reached, so velocities folded into it would look harmless."""
    for edge, dt in ((5.0, 0.5), (3.0, 0.5), (3.0, 2.0)):
        scene = beads(round(3 * edge**3), edge=edge)
        made = dpd.build(scene, dt=dt, scheme=scheme, conservative=conservative, platform="CPU", seed=4).simulation(None, {"Threads": "1"})
        raises(openmm.OpenMMException, TOO_FAST, made.step, 200)


@pytest.mark.parametrize("device", [device for device in DEVICES if device.precision in ("", "single")], ids=str, indirect=True)
@pytest.mark.parametrize("box", [[5.0] * 3, [[5.0, 0, 0], [1.5, 5.0, 0], [-1.0, 2.0, 5.0]]], ids=["ortho", "tilted"])
def test_such_a_step_is_an_error_on_every_platform(device, box):
    """Also in a tilted box, with beads that start far outside of it, and where OpenMM's own list of neighbours folds beads back."""
    edges = np.diag([5.0] * 3) if np.ndim(box) == 1 else np.array(box)
    rng = np.random.default_rng(1)
    x = (rng.random((N, 3)) + rng.integers(-3, 4, (N, 3))) @ edges
    scene = beads(N, positions=x, box=box)
    built = dpd.build(scene, dt=0.5, scheme="mvv", conservative="openmm", platform=device.platform, seed=4)
    made = built.simulation(None, device.properties)
    raises(openmm.OpenMMException, TOO_FAST, lambda: made.step(200))


def test_a_deck_that_blows_up_is_an_error_with_its_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [
        "units lj", "region box block 0 5 0 5 0 5", "create_box 1 box", "create_atoms 1 random 375 7 box", "mass 1 1.0",
        "velocity all create 1.0 3", "pair_style dpd 1.0 1.0 5", "pair_coeff 1 1 25 40.5 1.0", "fix 1 all nve", "timestep 0.06", "run 500",
    ]  # fmt: skip
    (tmp_path / "in.hot").write_text("\n".join(lines) + "\n")
    with pytest.raises(dpd.RunError, match=r"in\.hot:11: the run stopped: .*more than the cutoff"):
        run_deck(tmp_path / "in.hot", RunOptions(platform="CPU", threads=1))
    dpd.set_threads(None)


# -- what is no failure ------------------------------------------------------------------------------------------------------------
def kinetic(built: dpd.BuiltSystem, properties: dict, samples: int) -> np.ndarray:
    """Kinetic temperatures of every second step."""
    made, observer = built.simulation(properties=properties), dpd.Observer(built)
    rows = []
    for _ in range(samples):
        made.step(2)
        rows.append(observer.sample(made.context).kT)
    return np.array(rows)


@any_seed(1)
@pytest.mark.parametrize("device", [device for device in DEVICES if device.precision in ("", "single")], ids=str, indirect=True)
def test_an_ideal_gas_whose_beads_cross_the_box_in_a_step_keeps_its_temperature(device, seed):
    """The friction sees the velocities, not what is left of them in the box."""
    x = np.random.default_rng(1).random((81, 3)) * 3
    scene = dpd.Scene({"W": 1.0}, ["W"] * 81, x, {("W", "W"): dpd.DPD(gamma=4.5)}, kT=1.0, box=[3.0] * 3)

    built = dpd.build(scene, dt=2.0, scheme="middle", platform=device.platform, seed=seed)
    judge(kinetic(built, device.properties, 300), 1.0, error=0.01)  # 240 degrees of freedom: 9.1 % for one sample


def test_a_start_from_overlapping_points_is_no_failure():
    """Random points heat up to a few times the temperature; the friction takes it out again."""
    built = dpd.build(fluid(4.5, A=100.0), dt=0.01, scheme="middle", platform="CPU", seed=4)
    made, observer = built.simulation(properties={"Threads": "1"}), dpd.Observer(built)
    made.step(10)
    assert observer.sample(made.context).kT > 4
    made.step(290)
    assert 0.9 < observer.sample(made.context).kT < 1.5


def test_the_check_by_itself():
    """Not finite; faster than both bounds; only one of them; beads that do not move."""
    inv_mass, still = np.array([1.0, 1.0, 0.0]), np.zeros((3, 3))
    assert runaway(still, inv_mass, 1.0, 0.01, 1.0) is None
    rows = ((1, 101.0, 0.01, True), (1, 99.0, 0.01, False), (1, 9.0, 0.5, False), (1, 11.0, 0.5, True), (2, 1e3, 0.5, False))
    for bead, speed, dt, wrong in rows:
        v = still.copy()
        v[bead, 1] = speed
        assert (runaway(v, inv_mass, 1.0, dt, 1.0) is not None) == wrong, (bead, speed, dt)
    v = still.copy()
    v[0, 0] = np.nan
    assert "not finite" in runaway(v, inv_mass, 1.0, 0.01, 1.0)
    v[0, 0] = 101.0
    text = runaway(v, inv_mass, 2.0, 0.01, 1.0)
    moved = "bead 0 moves 1.01 nm in one step of 0.01 ps, more than the cutoff of 1 nm"
    assert text == f"{moved}; the kinetic temperature is 850 times what it should be"
    assert "temperature" not in runaway(v, inv_mass, 0.0, 0.01, 1.0)
