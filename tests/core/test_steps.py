"""One step and ten steps of every scheme on every platform, against the oracle's steps with the same noise and the same order of pairs."""

import numpy as np
import oracle
import pytest
from cases import each_with
from devices import DEVICES
from scenes import BOXES, EXTENDED, PLAIN, chains, factor_of, fluid, listed_pairs, noise_of, oracle_params, run_of, state_of

import openmm_dpd as dpd
from openmm_dpd.base.names import COUNTER
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.plan.plan import make_plan

KT, DT, SEED = 1.3, 0.03, 11
_LATE = {"mvv-0.65": ("mvv", 0.65), "mvv-0": ("mvv", 0.0)}
SCHEMES = {"mvv": ("mvv", 0.5), **_LATE, **{name: (name, 0.5) for name in ("shardlow", "middle", "aboba", "bababo")}}


class Oracle:
    """The oracle's step functions bound to a scene, with the kernel's noise, pair order and count of noise."""

    def __init__(self, scene, scheme: str, lam: float):
        self.scene, self.scheme, self.lam = scene, scheme, lam
        # the first evaluation of mvv draws no new noise: it takes number 0, then each step one more
        self.x, self.counter = scene.positions.copy(), -1 if scheme == "mvv" else 0
        mobile = np.ones(scene.n_beads, bool) if scene.mobile is None else scene.mobile
        self.inv_mass = np.where(mobile, 1 / scene.bead_masses, 0.0)
        # a bead that does not move has the velocity 0 in the step, and its prescribed one for the friction
        self.wall = np.where(mobile[:, None], 0.0, scene.velocities)
        self.v = scene.velocities - self.wall
        self.params, self.factor = oracle_params(scene), factor_of(scene)
        self.engine = PairEngine(make_plan(scene, dt=DT, scheme=scheme, seed=SEED).spec)
        if scheme == "mvv":
            self.f = self._force(self.x, self.v)
        elif scheme == "shardlow":
            self.f = self._conservative(self.x)

    def step(self) -> None:
        common = (self.inv_mass, DT)
        if self.scheme == "mvv":
            self.x, self.v, self.f = oracle.mvv_step(self.x, self.v, self.f, *common, self.lam, self._force)
        elif self.scheme == "shardlow":
            self.x, self.v, self.f = oracle.shardlow_step(self.x, self.v, self.f, *common, self._conservative, self._sweep)
        else:
            step = {"middle": oracle.middle_step, "aboba": oracle.aboba_step, "bababo": oracle.bababo_step}[self.scheme]
            self.x, self.v = step(self.x, self.v, *common, self._conservative, self._sweep)

    def _noise(self):
        self.counter += 1
        return noise_of(self.scene.n_beads, SEED, self.counter, KT)

    def _conservative(self, x):
        return oracle.conservative(x, self.scene.type_ids, self.params, self.scene.box, self.factor).forces

    def _force(self, x, v):
        common = (self.scene.type_ids, self.params, self.scene.box)
        drag = oracle.dissipative(x, v + self.wall, *common, self.factor).forces
        return self._conservative(x) + drag + oracle.random(x, *common, KT, DT, self._noise(), self.factor).forces

    def _sweep(self, x, v):
        self.engine.prepare(x, self.scene.box)
        update = oracle.shardlow_update if self.scheme == "shardlow" else oracle.ou_update
        common = (self.scene.type_ids, self.params, self.scene.box, KT, DT, self._noise(), update, self.factor)
        return oracle.sweep(x, v + self.wall, listed_pairs(self.engine), self.inv_mass, *common) - self.wall


def frozen_and_walls(box=BOXES["ortho"], moving=True):
    """A fifth of the beads do not move; as seen by the friction they have velocities, or not."""
    base = fluid(EXTENDED, box, n=60, kT=KT, seed=5, spread=0)
    mobile = np.arange(60) % 5 > 0
    velocities = base.velocities if moving else np.where(mobile[:, None], base.velocities, 0.0)
    return dpd.Scene(base.masses, base.types, base.positions, EXTENDED, KT, box=box, velocities=velocities, mobile=mobile)


SCENES = {
    "fluid": lambda: fluid(EXTENDED, BOXES["tilted"], n=70, density=1.0, kT=KT, spread=0),
    "chains": lambda: chains(BOXES["narrow"], n=60, table=EXTENDED, kT=KT),
    "no box": lambda: fluid(PLAIN, None, n=50, kT=KT),
    "moving walls": frozen_and_walls,
    "frozen beads": lambda: frozen_and_walls(moving=False),
}


def compare(scene, device, name, conservative, limits) -> None:
    """Largest errors of positions and velocities after 1 and 10 steps stay below the limits."""
    scheme, lam = SCHEMES[name]
    simulation = run_of(scene, device, dt=DT, scheme=scheme, lam=lam, conservative=conservative, seed=SEED)
    expected, mobile = Oracle(scene, scheme, lam), scene.mobile
    start = state_of(simulation.context)
    for steps, limit in zip((1, 9), limits, strict=True):
        simulation.step(steps)
        for _ in range(steps):
            expected.step()
        x, v = state_of(simulation.context)
        # a GPU platform may have moved a bead by whole boxes
        assert np.abs(oracle.minimum_image(x - expected.x, scene.box)).max() < limit * DT
        moving = slice(None) if mobile is None else mobile
        assert np.abs(v - expected.v)[moving].max() < limit
        if mobile is not None:
            assert np.array_equal(x[~mobile], start[0][~mobile])  # the platforms keep a frozen bead's position to the bit
    assert np.abs(expected.v - scene.velocities).max() > 0.5  # a lot happened
    assert simulation.context.getParameter(COUNTER) == expected.counter


#: Every scene with four schemes in the kernel, two with three beside OpenMM's forces.
EXACT = [(scene, name, "kernel") for scene, name in each_with(SCENES, lambda _: list(SCHEMES), 4)]
EXACT += [(scene, name, "openmm") for scene, name in each_with(("chains", "moving walls"), lambda _: [*SCHEMES][1:], 3)]


@pytest.mark.parametrize(("scene", "name", "conservative"), EXACT)
def test_steps_on_reference(scene, name, conservative):
    """All double precision: 1e-12 after one step, 1e-11 after ten."""
    compare(SCENES[scene](), DEVICES[0], name, conservative, (1e-12, 1e-11))


@pytest.mark.parametrize("name", [name for name in SCHEMES if name != "mvv-0"])
def test_steps_on_cpu(name):
    """With the kernel, the CPU platform is as exact as Reference."""
    compare(frozen_and_walls(), DEVICES[1], name, "kernel", (1e-12, 1e-11))


def floats():
    """Every scheme and both ways of the conservative force in single and mixed precision; a few of each in the others."""
    chosen = {"kernel": ("mvv", "mvv-0.65", "shardlow", "middle", "aboba", "bababo"), "openmm": ("mvv", "aboba", "bababo")}
    few = {"kernel": ("mvv", "middle"), "openmm": ("mvv-0.65", "shardlow")}
    for device in DEVICES[1:]:
        names = {"openmm": chosen["kernel"]} if device.exact else few if device.precision == "double" else chosen
        yield from ((device, name, conservative) for conservative, schemes in names.items() for name in schemes)


@pytest.mark.parametrize(("device", "name", "conservative"), floats(), indirect=["device"], ids=lambda value: str(value))
def test_steps_where_forces_pass_through_float32(device, name, conservative):
    """Velocities of order 1, forces of order 100: 2e-6 in mixed and double precision, 1e-4 where positions, and so the drifts, are single."""
    limit = device.choose(2e-6, 2e-6, 1e-4)
    compare(SCENES["moving walls"](), device, name, conservative, (limit, 10 * limit))
