"""An engine that the package does not know, registered here: numpy over all pairs.  It runs every word, is explained, and is refused by name."""

from __future__ import annotations

import io
import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import openmm
import oracle
import pytest
from cases import cases, raises
from fluid_deck import ONE_TYPE
from openmm import app
from scenes import MASSES, PLAIN, chains, fluid, noise_of, state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.__main__ import main
from openmm_dpd.kernels.columns import Totals
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.kernels.engines import ENGINES, EngineKind, engine_kind, register_engine
from openmm_dpd.kernels.interface import Engine
from openmm_dpd.kernels.layer import CONSERVATIVE, DISSIPATIVE, RANDOM, SHARDLOW
from openmm_dpd.kernels.steps import StepLoop
from openmm_dpd.measure import StressReporter
from openmm_dpd.model.schemes import SCHEMES

OWN = "A/4 O/2 A/4 B/3 S/2 A/2 2B/3"
WORDS = [name for name, scheme in SCHEMES.items() if not scheme.native] + [OWN]


class AllPairs(Engine):
    """DPD between all beads, by the loops of ``oracle.py`` with the kernel's noise; sweeps take the pairs in the order of the beads."""

    def __init__(self, spec):
        self.spec, self.number, self.body_scale = spec, 0, 1.0
        self.rates = self.increments = np.zeros((len(spec.types), 0))
        (table,) = spec.terms
        self.terms = oracle.PairParams(table.A, table.gamma, table.gamma_perp, table.exponent, table.exponent_perp, table.cutoff)
        self.x, self.box, self.kept = np.zeros((0, 3)), None, False

    def holds(self, x, box):
        return self.kept and np.array_equal(x, self.x) and np.array_equal(box, self.box)

    def place(self, x, box):
        self.x, self.box, self.kept, self.number = x, box, False, self.number + 1
        self.edges = None if box is None else np.diag(box)

    def keep(self):
        self.x, self.kept = self.x.copy(), True

    def sums(self, which, v, kT, dt, seed, counter, field_values=None, out=None):
        here = self.x, self.spec.types, self.terms, self.edges
        force, energy, virial, drag = np.zeros_like(self.x), 0.0, 0.0, 0.0
        if which & CONSERVATIVE:
            found = oracle.conservative(*here)
            force, energy, virial = force + found.forces, found.energy, found.virial
        if which & DISSIPATIVE:
            found = oracle.dissipative(self.x, self.seen(v), *here[1:])
            force, virial, drag = force + found.forces, virial + found.virial, found.virial
        if which & RANDOM and kT > 0:
            found = oracle.random(*here, kT, dt, self.noise(seed, counter, kT))
            force, virial = force + found.forces, virial + found.virial
        if out is not None:
            out[...] = force
        return Totals(energy, virial, drag)

    def swept(self, v, kT, dt, seed, counter, field_values=None, out=None, update=None):
        rule = oracle.shardlow_update if (self.spec.update if update is None else update) == SHARDLOW else oracle.ou_update
        here = self.spec.inv_mass, self.spec.types, self.terms, self.edges
        pairs = oracle.pair_list(self.x, *here[1:])
        found = oracle.sweep(self.x, self.seen(v), zip(pairs.i, pairs.j, strict=True), *here, kT, dt, self.noise(seed, counter, kT), rule)
        if out is None:
            return found
        out[...] = found
        return out

    def noise(self, seed, counter, kT):
        return noise_of(len(self.spec.types), seed, counter, kT) if kT > 0 else None


CAN = {"DPD", "exact pair updates", "Shardlow's pair updates", "friction as a force", "scenes without a box"}


@pytest.fixture
def register():
    """Registers the engine for the time of a test."""

    def known(can=CAN, **more):
        return register_engine(EngineKind(name="toy", what="numpy over all pairs", make=AllPairs, can=can, **more))

    yield known
    ENGINES.pop("toy", None)


def dimers(**options) -> dpd.Scene:
    """27 pairs of beads, each out of reach of all others: the order of the pairs in a sweep does not matter."""
    rng = np.random.default_rng(8)
    centres = np.array(list(itertools.product(range(3), repeat=3))) * 2.3
    x = np.concatenate([centres + rng.uniform(-0.2, 0.2, (27, 3)), centres + rng.uniform(-0.2, 0.2, (27, 3))])
    return dpd.Scene(MASSES, rng.choice(["A", "B"], 54).tolist(), x, PLAIN, kT=1.0, box=[6.9] * 3, **options)


def made(scene, scheme="middle", engine="toy", **choices) -> dpd.BuiltSystem:
    return dpd.build(scene, **{"dt": 0.01, "scheme": scheme, "engine": engine, "platform": "CPU", "seed": 5} | choices)


def same_steps(simulations, monkeypatch) -> tuple[np.ndarray, np.ndarray]:
    """Where 20 steps of the host and then of the toy lead, which is the same place; the host's sums are out of its reach."""
    simulations[0].step(20)
    monkeypatch.setattr(PairEngine, "sums", None)
    monkeypatch.setattr(PairEngine, "swept", None)
    simulations[1].step(20)
    (x, v), (expected_x, expected_v) = (state_of(simulation.context) for simulation in reversed(simulations))
    np.testing.assert_allclose(x, expected_x, rtol=0, atol=1e-11)
    np.testing.assert_allclose(v, expected_v, rtol=0, atol=1e-10)
    return x, v


@pytest.mark.parametrize("choices", [{}, {"loop": False}, {"conservative": "openmm"}], ids=["loop", "program", "openmm"])
@pytest.mark.parametrize("scheme", WORDS)
def test_it_steps_as_the_host_does(register, monkeypatch, scheme, choices):
    register()
    if scheme == "mvv":
        choices = choices | {"lam": 0.65}
    host, toy = (made(dimers(), scheme, engine, **choices) for engine in ("host", "toy"))
    simulations = [host.simulation(), toy.simulation()]
    before = simulations[1].context.getState(positions=True).getPositions(asNumpy=True)._value
    x, _ = same_steps(simulations, monkeypatch)
    assert (toy.integrator.whole is None) == bool(choices.keys() & {"loop", "conservative"})
    assert np.abs(x - before).max() > 0.1  # a lot happened


@pytest.mark.parametrize("scheme", WORDS[::2])
def test_a_fluid_keeps_its_momentum_and_relaxes(register, scheme):
    register()
    scene = fluid(PLAIN, np.diag([3.0, 3.0, 3.0]), n=60, kT=1.0, seed=4, spread=0)
    built = made(scene, scheme, dt=0.02)
    observer, simulation = dpd.Observer(built), built.simulation()
    before = observer.sample(simulation.context)
    simulation.step(25)
    after = observer.sample(simulation.context)
    assert np.abs(after.momentum - before.momentum).max() < 1e-11
    # 3 (N - 1) = 177 degrees of freedom: standard error 0.11
    assert 0.4 < after.kT < 2.0 and after.step == 25


def test_it_is_measured_as_the_host_is(register):
    register()
    scene = dimers()
    host, toy = (made(scene, "mvv", engine) for engine in ("host", "toy"))
    samples = []
    for built in (host, toy):
        simulation = stepped(built.simulation(), 5)
        samples.append(dpd.Observer(built).sample(simulation.context))
        assert dpd.read_fields(simulation.context, built.plan) == {}
    for name in ("kinetic", "pair", "virial_conservative", "virial_dissipative", "virial_random", "gradient2", "forces"):
        expected, found = (getattr(sample, name) for sample in samples)
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-9, err_msg=name)
    expected, found = map(dpd.force_terms, (host, toy))
    for name, force in expected.items():
        np.testing.assert_allclose(found[name], force, rtol=0, atol=1e-10 * np.abs(force).max(), err_msg=name)


def atoms(x) -> tuple[app.Topology, openmm.System]:
    """Atoms at x (N, 3) without forces."""
    system, topology = openmm.System(), app.Topology()
    system.setDefaultPeriodicBoxVectors(*(6.9 * np.eye(3)))
    topology.setUnitCellDimensions(openmm.Vec3(6.9, 6.9, 6.9))
    chain = topology.addChain()
    for _ in x:
        system.addParticle(1.5)
        topology.addAtom("Ar", app.Element.getBySymbol("Ar"), topology.addResidue("Ar", chain))
    return topology, system


def thermostat(engine="toy", types=("Ar",) * 54) -> dpd.BuiltSystem:
    """Friction between the atoms of all dimers."""
    x = dimers().positions
    topology, system = atoms(x)
    friction = {("Ar", "Ar"): dpd.DPD(gamma=9, gamma_perp=2)}
    choices = {"types": types, "topology": topology, "positions": x, "platform": "CPU", "seed": 5, "engine": engine}
    return dpd.add_thermostat(system, friction, 300, 0.01, **choices)


def mixed(engine="toy", names=("Ar",) * 27) -> dpd.BuiltSystem:
    """Dimers of a bead and an atom."""
    pairs = dimers()
    topology, system = atoms(pairs.positions[27:])
    scene = dpd.Scene(MASSES, pairs.types[:27], pairs.positions[:27], PLAIN, kT=1.0, box=pairs.box)
    choices = {"atoms": names, "cross": {("Ar", "*"): dpd.DPD(A=25, gamma=9)}, "dt": 0.01, "platform": "CPU", "seed": 5, "engine": engine}
    return dpd.create_mixed_system(scene, topology, system, pairs.positions[27:], **choices)


@pytest.mark.parametrize("way", [thermostat, mixed])
def test_atoms_have_it_too(register, monkeypatch, way):
    register()
    simulations = [way(engine).simulation() for engine in ("host", "toy")]
    for simulation in simulations:
        simulation.context.setVelocitiesToTemperature(300, 1)
    before = state_of(simulations[0].context)[1]
    _, v = same_steps(simulations, monkeypatch)
    assert np.abs(v - before).max() > 0.1
    for left_out in (lambda: thermostat(types=("Ar", None) * 27), lambda: mixed(names=("Ar", None) * 13 + ("Ar",))):
        raises(dpd.PlanError, "the engine 'toy' cannot run this scene: it has no particles that are left out$", left_out)
    raises(dpd.ParameterError, "engine must be 'auto' or one of 'host', 'device', 'toy', not 'gpu'", lambda: way("gpu"))


DECK = ONE_TYPE.replace("192", "40").replace("block 0 4 0 4 0 4", "prism 0 3 0 3 0 3 {tilt} 0 0") + "timestep 0.01\nthermo 5\nrun 10\n"


def test_decks_have_it_too(register, monkeypatch, tmp_path, capsys):
    register()
    monkeypatch.chdir(tmp_path)
    for name, tilt in (("in.toy", 0), ("in.tilted", 0.3)):
        Path(name).write_text(DECK.format(tilt=tilt), encoding="utf-8")
    reports = []
    for engine in ("host", "toy"):
        words = ["--engine", engine, "--platform", "CPU", "--threads", "1", "--json", f"{engine}.json"]
        assert main(["forces", "in.toy", *words]) == 0
        forces = json.loads(Path(f"{engine}.json").read_text(encoding="utf-8"))["terms"]
        assert main(["run", "in.toy", "--quiet", "--out", engine, *words]) == 0
        reports.append((forces, json.loads(Path(f"{engine}.json").read_text(encoding="utf-8"))["thermo"]))
        monkeypatch.setattr(PairEngine, "sums", None)
    (forces, thermo), (expected_forces, expected) = reversed(reports)
    for name, force in expected_forces.items():
        np.testing.assert_allclose(forces[name], force, rtol=0, atol=1e-9, err_msg=name)
    assert expected.pop("temp_conf") and thermo.pop("temp_conf") is None  # it has no Laplacian
    for word, values in expected.items():
        assert thermo[word]["last"] == pytest.approx(values["last"], rel=1e-9, abs=1e-9), word
    capsys.readouterr()
    assert main(["explain", "in.toy", "--engine", "toy", "--platform", "CPU"]) == 0
    assert "engine of the pair kernel: toy (as asked for)" in capsys.readouterr().out
    for command in ("run", "explain"):
        assert main([command, "in.tilted", "--engine", "toy"]) == 1
        assert "in.tilted:14: the engine 'toy' cannot run this scene: it has no tilted boxes" in capsys.readouterr().err
        assert main([command, "in.toy", "--engine", "gpu"]) == 1
        assert "error: --engine must be 'auto' or one of 'host', 'device', 'toy', not 'gpu'" in capsys.readouterr().err


@pytest.mark.parametrize("way", [lambda: made(dimers()), thermostat, mixed], ids=["build", "thermostat", "mixed"])
def test_it_is_explained(register, way):
    register()
    text = way().explain()
    assert "friction and noise: numpy over all pairs behind a PythonForce" in text
    assert "engine of the pair kernel: toy (as asked for)" in text
    assert "engine of the pair kernel: host (" in made(dimers(), engine="auto").explain()


@cases(
    "scene, scheme, lacks",
    (lambda: fluid(PLAIN, np.array([[3.0, 0, 0], [0.4, 3.0, 0], [0, 0, 3.0]]), n=40), "middle", "tilted boxes"),
    (lambda: replace_pairs(dpd.MDPD(A=-40, B=25, gamma=4.5)), "middle", "MDPD"),
    (lambda: dimers(mobile=np.arange(54) > 3), "middle", "immobile beads"),
    (lambda: chains(np.diag([3.7, 3.6, 3.8]), n=60), "middle", "factors of bonded neighbours"),
    (lambda: bonded(), "middle", "harmonic bonds"),
    (lambda: bonded(body_forces=[dpd.BodyForce((1, 0, 0))]), "mvv", "harmonic bonds"),
    (lambda: dimers(body_forces=[dpd.BodyForce((1, 0, 0))]), "mvv", "body forces"),
)
def test_what_it_lacks_is_refused(register, scene, scheme, lacks):
    """The first thing in the order of ``Plan.needs``; the same scene runs where somebody else does it."""
    register()
    raises(dpd.PlanError, f"the engine 'toy' cannot run this scene: it has no {lacks}$", lambda: made(scene(), scheme))
    made(scene(), scheme, "host")


def bonded(**options) -> dpd.Scene:
    return dimers(bonds=[dpd.HarmonicBonds([[0, 27]], k=10, r0=0.3)], **options)


def replace_pairs(coefficient) -> dpd.Scene:
    scene = dimers()
    return dpd.Scene(MASSES, scene.types, scene.positions, {("*", "*"): coefficient}, kT=1.0, box=scene.box)


def test_what_others_hold_is_not_asked_of_it(register):
    """Steps by the program leave bonds and body forces to OpenMM."""
    register()
    scene = bonded(body_forces=[dpd.BodyForce((1, 0, 0))])
    runs = [stepped(made(scene, "mvv", engine, loop=False).simulation(), 10) for engine in ("host", "toy")]
    np.testing.assert_allclose(*(state_of(simulation.context)[0] for simulation in runs), rtol=0, atol=1e-11)


def test_pair_updates_and_measurements_it_lacks(register):
    register(CAN - {"Shardlow's pair updates"})
    for scheme in ("shardlow", OWN):
        raises(dpd.PlanError, "it has no Shardlow's pair updates", made, dimers(), scheme)
    built = made(dimers())
    raises(dpd.ParameterError, "no stress tensor of this scene: the engine 'toy' has none", lambda: StressReporter(1, built))
    observer = dpd.Observer(built)
    assert observer.no_laplacian == "the engine 'toy' has no Laplacian"
    assert observer.sample(built.simulation().context).laplacian is None


def test_an_engine_with_nothing_to_do_is_refused(register):
    register()
    raises(dpd.PlanError, "the engine 'toy' would have nothing to do: OpenMM's own integrator steps", lambda: made(dimers(), "native"))
    raises(dpd.PlanError, "the engine 'host' would have nothing to do", lambda: made(replace_pairs(dpd.DPD(A=25)), engine="host"))
    raises(dpd.ParameterError, "engine must be 'auto' or one of 'host', 'device', 'toy', not 'gpu'", lambda: made(dimers(), engine="gpu"))
    for name in ("toy", "auto"):
        raises(dpd.ParameterError, f"there is an engine '{name}' already", register_engine, replace(engine_kind("toy"), name=name))


def test_it_brings_its_own_steps(register):
    """A stepper of its own does the steps of the loop."""
    counted = []

    class Counting(StepLoop):
        def run(self, moment, n, *others, **more):
            counted.append(n)
            super().run(moment, n, *others, **more)

    register(stepper=Counting)
    made(dimers()).simulation().step(25)
    assert sum(counted) == 25 and counted[0] == 10  # how many at once depends on their time


def test_a_file_knows_the_engine(register):
    register()
    built = made(dimers())
    text = openmm.XmlSerializer.serialize(built.system)
    force = built.simulation().context.getState(forces=True).getForces(asNumpy=True)._value

    def forces_of(system):
        context = openmm.Context(system, openmm.VerletIntegrator(0.01), openmm.Platform.getPlatformByName("Reference"))
        context.setPositions(dimers().positions)
        return context.getState(forces=True).getForces(asNumpy=True)._value

    np.testing.assert_array_equal(forces_of(dpd.load_xml(io.StringIO(text))), force)
    del ENGINES["toy"]
    message = "engine must be 'auto' or one of 'host', 'device', not 'toy'"
    raises(openmm.OpenMMException, message, lambda: forces_of(dpd.load_xml(io.StringIO(text))))
