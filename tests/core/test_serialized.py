"""Systems from files: forces of this package are read, other Python code is not run."""

import os
import pickle

import numpy as np
import openmm
import pytest
from cases import cases, put, raises

import openmm_dpd as dpd

N = 30
X = np.random.default_rng(6).random((N, 3)) * 3


def build(platform: str = "CPU", **more) -> dpd.BuiltSystem:
    scene = dpd.Scene({"W": 1.0}, ["W"] * N, X, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[3.0] * 3, **more)
    return dpd.build(scene, dt=0.02, platform=platform, seed=1)


class Planted:
    """What an attacker writes into a file in the place of a force."""

    def __init__(self, call, *arguments):
        self.call, self.arguments = call, arguments

    def __reduce__(self):
        return self.call, self.arguments

    def __call__(self, state):
        raise AssertionError("never evaluated")


BENT, SORT = dpd.HarmonicAngles([[0, 1, 2]], 1.0, 2.0), dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 9.0, "r0": 0.5}, [[0, 1], [1, 2]])


def opened(path) -> None:
    """A function of some module that is not this package's."""
    path.write_text("run")


def system_with(computation) -> str:
    system = openmm.System()
    system.addParticle(1.0)
    system.addForce(openmm.PythonForce(computation, {}))
    return openmm.XmlSerializer.serialize(system)


@pytest.mark.parametrize("platform", ["CPU", "Reference"])
@cases(
    "more",
    {},
    {"bonds": [dpd.FENEBonds([[0, 1], [1, 2]], k=30.0, R0=6.0)], "segments": dpd.SegmentalRepulsion(A=100.0, cutoff=0.5)},
    {"body_forces": [dpd.BodyForce([1.0, 0, 0])], "walls": None},
    ids=["plain", "bonded", "pushed"],
)
def test_forces_of_this_package_are_read(tmp_path, platform, more):
    built = build(platform, **{key: value for key, value in more.items() if value is not None})
    path = put(tmp_path / "system.xml", openmm.XmlSerializer.serialize(built.system))
    assert openmm.XmlSerializer.serialize(dpd.load_xml(path)) == path.read_text()
    with open(path) as file:
        assert dpd.load_xml(file).getNumParticles() == N


@cases(
    "reaction",
    dpd.BondFormation(SORT, ("W", "W"), within=0.5, valences=1, angle=BENT),
    dpd.BondBreaking(SORT, beyond=9.0, takes=[BENT]),
)
def test_forces_with_bonds_that_form_and_break_are_read(tmp_path, reaction):
    built = build(reactions=[reaction], segments=dpd.SegmentalRepulsion(A=100.0, cutoff=0.5))
    path = put(tmp_path / "system.xml", openmm.XmlSerializer.serialize(built.system))
    assert dpd.load_xml(path).getNumForces() == built.system.getNumForces()


@pytest.mark.parametrize("through", ["function", "method of a module", "class"])
def test_planted_code_is_not_run(tmp_path, through):
    target = tmp_path / "witness"
    planted = {"function": Planted(opened, target), "method of a module": Planted(os.mkdir, str(target))}
    text = system_with(planted.get(through, Planted(dpd.DPDReporter, str(target), 10, None)))
    assert not target.exists()
    message = "holds a Python object that is not a force of this package .*it asks for"
    raises(dpd.ParameterError, message, dpd.load_xml, put(tmp_path / "system.xml", text))
    assert not target.exists()
    if through == "function":  # which OpenMM itself does run
        openmm.XmlSerializer.deserialize(text)
        assert target.exists()


def test_names_do_not_lead_out_of_the_package(tmp_path):
    """Protocol 4 looks up names with dots, and every module has others among its names."""
    inside = "openmm_dpd.plan.forces.pair_force"
    for module, name in ((inside, "np.save"), (inside, "engine_kind"), ("openmm_dpd.__main__", "Path")):
        payload = b"\x80\x04" + b"".join(b"\x8c" + bytes([len(word)]) + word.encode() for word in (module, name)) + b"\x93."
        text = system_with(Planted(opened, tmp_path))
        start = text.index('function="') + len('function="')
        text = text[:start] + payload.hex() + text[text.index('"', start) :]
        (tmp_path / "system.xml").write_text(text)
        assert callable(pickle.loads(payload))
        raises(dpd.ParameterError, f"it asks for {module}.{name}", dpd.load_xml, tmp_path / "system.xml")


def test_a_state_is_a_state(tmp_path):
    simulation = build().simulation()
    simulation.step(2)
    simulation.saveState(str(tmp_path / "state.xml"))
    assert dpd.load_xml(tmp_path / "state.xml").getStepCount() == 2
    for name, text, message in (
        ("planted.xml", system_with(Planted(opened, tmp_path / "witness")), "not a force of this package"),
        ("system.xml", openmm.XmlSerializer.serialize(openmm.System()), "no State: the file holds 'System'"),
        ("text.xml", "once upon a time", "not a file of OpenMM's XmlSerializer"),
        ("short.xml", (tmp_path / "state.xml").read_text()[:900], "not a file of OpenMM's XmlSerializer"),
        ("other.xml", "<State type='Stale'/>", "OpenMM cannot read this file"),
    ):
        raises(dpd.ParameterError, message, simulation.loadState, str(put(tmp_path / name, text)))
    assert not (tmp_path / "witness").exists()
    assert simulation.context.getStepCount() == 2
    simulation.loadState(str(tmp_path / "state.xml"))
