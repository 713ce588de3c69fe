"""A kind of pair coefficients that the package does not know, registered here: it builds, runs, explains, and refuses what it cannot."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import openmm
import pytest
from cases import raises
from openmm import app
from toy_kind import BOX, PAIRS, Exponential, N, potential, scene, terms

import openmm_dpd as dpd
from openmm_dpd.base import serialized
from openmm_dpd.base.geometry import minimum_images
from openmm_dpd.lammps import export_lammps
from openmm_dpd.measure import StressReporter
from openmm_dpd.model.schemes import SCHEMES
from openmm_dpd.plan import kinds


@pytest.fixture
def register():
    """Registers a kind for the time of a test."""

    def known(**more):
        return kinds.register(kinds.Kind(coefficient=Exponential, terms=terms, **more))

    yield known
    kinds.KINDS.pop(Exponential, None)
    serialized._REGISTERED.discard(Exponential.__module__)


def expected_on(bead, x, types):
    """The formulas once more: energy, force on a bead and its virial."""
    d = minimum_images(x[bead] - np.delete(x, bead, axis=0), BOX)
    r = np.linalg.norm(d, axis=1)
    terms = [PAIRS[tuple(sorted((types[bead], other)))] for k, other in enumerate(types) if k != bead]
    A, width, cutoff = (np.array([getattr(c, name) for c in terms]) for name in ("A", "width", "cutoff"))
    end = np.exp(-cutoff / width)
    push = np.where(r < cutoff, A * (np.exp(-r / width) - end), 0.0)
    energy = np.where(r < cutoff, A * width * (np.exp(-r / width) - end) + A * end * (r - cutoff), 0.0)
    return energy.sum(), (push / r) @ d, push @ r


@pytest.mark.parametrize("choice", ["kernel", "openmm"])
def test_it_has_its_forces_and_energy(register, choice):
    register(potential=potential)
    beads = scene()
    built = dpd.build(beads, dt=0.01, conservative=choice, platform="Reference", seed=1)
    energy, force, virial = map(np.array, zip(*(expected_on(k, beads.positions, beads.types) for k in range(N)), strict=True))
    np.testing.assert_allclose(dpd.force_terms(built)["conservative"], force, rtol=0, atol=1e-10 * np.abs(force).max())
    sample = dpd.Observer(built).sample(built.simulation().context)
    # each pair is met twice
    assert sample.pair == pytest.approx(0.5 * energy.sum(), rel=1e-10)
    assert sample.virial_conservative == pytest.approx(0.5 * virial.sum(), rel=1e-10)
    assert not built.plan.new_engine().repels_by_pairs  # its layer does not say so


def test_its_laplacian_is_a_second_derivative(register):
    register()
    beads, h = scene(), 1e-5
    built = dpd.build(beads, dt=0.01, conservative="kernel", platform="Reference", seed=1)
    sample = dpd.Observer(built).sample(built.simulation().context)
    slope = 0.0
    for bead, axis in np.ndindex(*beads.positions.shape):
        for shift in (h, -h):
            x = beads.positions.copy()
            x[bead, axis] += shift
            slope -= expected_on(bead, x, beads.types)[1][axis] / (2 * shift)
    assert sample.laplacian == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("scheme", [name for name, known in SCHEMES.items() if not known.native])
def test_every_scheme_runs_it(register, scheme):
    register()
    built = dpd.build(scene(), dt=0.01, scheme=scheme, platform="CPU", seed=1)
    simulation = built.simulation()
    before = dpd.Observer(built).sample(simulation.context)
    simulation.step(50)
    after = dpd.Observer(built).sample(simulation.context)
    assert np.abs(after.momentum - before.momentum).max() < 1e-9
    # random positions relax, and the friction keeps the temperature: 3 (N - 1) = 267 degrees of freedom, standard error 0.09
    assert 0.5 < after.kT < 2.0 and after.pair < 0.9 * before.pair


def test_it_is_explained_and_the_kernel_holds_it(register):
    register()
    text = dpd.build(scene(), dt=0.01, platform="CPU", seed=1).explain()
    assert "A - B: Exponential(A = 80, gamma = 2, width = 0.3)" in text
    assert "friction and noise: compiled pair kernel" in text
    assert dpd.make_plan(scene(), dt=0.01, platform="Reference", seed=1).execution.conservative == "kernel"
    message = "conservative='openmm' is not possible: there is no OpenMM force for Exponential"
    raises(dpd.PlanError, message, dpd.make_plan, scene(), dt=0.01, conservative="openmm", platform="Reference", seed=1)


def test_what_it_cannot_is_refused(register, tmp_path):
    register(potential=potential)
    beads = scene()
    choices = {"dt": 0.01, "platform": "Reference", "seed": 1}
    raises(dpd.PlanError, "isothermal DPD only, not Exponential", dpd.build, beads, scheme="native", **choices)
    message = "stress tensor of this scene: the stress of Exponential is not known"
    raises(dpd.ParameterError, message, StressReporter, 1, dpd.build(beads, **choices))
    assert "no steps were measured with Exponential" in dpd.recommend(beads).notes[0]
    raises(dpd.ParameterError, "kind Exponential cannot be exported", lambda: export_lammps(beads, tmp_path, "toy", dt=0.01))
    system = openmm.System()
    for _ in range(4):
        system.addParticle(1.0)
    raises(dpd.ParameterError, "friction must be a DPD", lambda: dpd.add_thermostat(system, Exponential(A=0.0, gamma=4.5), 300, 0.002))
    atoms = (app.Topology(), system, np.zeros((4, 3)))
    raises(dpd.PlanError, "Exponential is for beads alone", dpd.create_mixed_system, beads, *atoms, atoms=["X"] * 4, cross={}, dt=0.01)


def test_systems_with_it_are_read_where_it_is_known(register, tmp_path):
    register()
    system, path = dpd.build(scene(), dt=0.01, platform="CPU", seed=1).system, tmp_path / "system.xml"
    path.write_text(openmm.XmlSerializer.serialize(system), encoding="utf-8")
    assert dpd.load_xml(path).getNumForces() == system.getNumForces()
    serialized._REGISTERED.discard(Exponential.__module__)
    raises(dpd.ParameterError, "asks for toy_kind.ExponentialTable", lambda: dpd.load_xml(path))


def test_a_kind_that_makes_no_sense_is_refused(register):
    raises(dpd.ParameterError, "nothing is known of pair terms Exponential", dpd.make_plan, scene(), dt=0.01, platform="CPU", seed=1)
    register(has_stress=True)
    built = dpd.build(scene(), dt=0.01, platform="CPU", seed=1)
    raises(dpd.ParameterError, "ExponentialLayer has no method tensors, though its kind says has_stress", lambda: StressReporter(1, built))
    raises(dpd.ParameterError, "there is a kind for Exponential already", register)
    raises(dpd.ParameterError, "either terms of the pair kernel or an overlay", lambda: kinds.Kind(coefficient=Exponential))
    raises(dpd.ParameterError, "its per-bead fields", lambda: kinds.Kind(coefficient=dpd.EDPD, terms=terms))


Warm = type("Warm", (dpd.EnergyDPD,), {})  # energies under another name


@pytest.mark.parametrize(
    "wrong", [{"kind": "colour"}, {"eos": None}, {"initial": np.ones((N, 3))}, {"initial": np.ones((N, 2), np.float32)}, {"immobile": None}]
)
def test_fields_that_make_no_sense_are_refused(wrong, monkeypatch):
    known = kinds.KINDS[dpd.EnergyDPD]
    monkeypatch.setitem(kinds.KINDS, Warm, replace(known, coefficient=Warm, fields=lambda scene: replace(known.fields(scene), **wrong)))
    beads = scene({("*", "*"): Warm(A=25.0, sigma=3.0)}, internal=dpd.InternalEnergy(dpd.ConstantHeatCapacity(60.0), 1.0))
    raises(dpd.ParameterError, "fields of Warm must be a whole FieldSpec", lambda: dpd.build(beads, dt=0.01, platform="CPU", seed=1))


COMPILED = """
from typing import Any, NamedTuple
import numpy as np
from openmm_dpd.kernels.columns import over_pairs
from openmm_dpd.runtime.decorators import inlined
from openmm_dpd.kernels.pairs import PairList
FACTOR = {factor}
Data = NamedTuple("Data", [("A", float)])
@inlined
def energy(r, A):
    return FACTOR * A * r{square}
@inlined
def pair(pairs, data, scratch, n, k, column):
    return energy(pairs.geometry[3, n], data.A), 0.0, 0.0
pairs = PairList(np.zeros(2, np.int32), np.ones(2), np.ones((1, 1)), (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)))
pairs.build(np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]), None)
print(over_pairs("outside", pair)(pairs, Data(2.0)).energy)
"""


@pytest.mark.slow
def test_a_compiled_kind_that_is_edited_is_compiled_anew(tmp_path):
    """Each time in a process of its own, with the kernels that the one before has left on disk."""
    for factor, square, expected in ((3.0, "", 3.0), (5.0, "", 5.0), (5.0, "**2", 2.5)):
        (tmp_path / "outside.py").write_text(COMPILED.format(factor=factor, square=square), encoding="utf-8")
        done = subprocess.run([sys.executable, tmp_path / "outside.py"], capture_output=True, text=True)
        assert (done.stdout, done.returncode) == (f"{expected}\n", 0), done.stderr
