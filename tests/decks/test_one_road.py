"""build, add_thermostat and create_mixed_system return the same kind of object, which Observer and reporters take; decks and scripts agree."""

from io import StringIO

import numpy as np
import openmm
import pytest
from cases import put, raises
from openmm import app, unit
from scenes import state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.base.errors import read_by
from openmm_dpd.lammps import RunOptions, deck_forces, explain_deck, read_deck, run_deck
from openmm_dpd.lammps.files.data_file import read_data_file
from openmm_dpd.units import BOLTZMANN

N, EDGE, DT, T = 64, 2.0, 0.002, 300.0
BEADS = {("oil", "oil"): dpd.DPD(A=50, gamma=20, cutoff=0.6)}
X = np.stack(np.meshgrid(*[np.arange(4) * EDGE / 4] * 3), axis=-1).reshape(-1, 3) + 0.05


def argon(count: int = N, constrained: bool = False) -> tuple[app.Topology, openmm.System]:
    """Atoms with a soft repulsion of OpenMM's own."""
    system, topology = openmm.System(), app.Topology()
    system.setDefaultPeriodicBoxVectors(*(EDGE * np.eye(3)))
    topology.setUnitCellDimensions(openmm.Vec3(EDGE, EDGE, EDGE) * unit.nanometer)
    chain, force = topology.addChain(), openmm.CustomNonbondedForce("50*(1-r/0.6)^2")
    force.setNonbondedMethod(force.CutoffPeriodic)
    force.setCutoffDistance(0.6)
    for _ in range(count):
        system.addParticle(39.9)
        force.addParticle([])
        topology.addAtom("Ar", app.Element.getBySymbol("Ar"), topology.addResidue("Ar", chain))
    if constrained:
        system.addConstraint(0, 1, 0.4)
        force.addExclusion(0, 1)
    system.addForce(force)
    return topology, system


def beads() -> dpd.Scene:
    return dpd.Scene({"oil": 40.0}, ["oil"] * N, X, BEADS, kT=T * unit.kelvin, box=[EDGE] * 3)


def thermostat(**choices) -> dpd.BuiltSystem:
    topology, system = argon()
    friction = dpd.DPD(gamma=20, cutoff=0.6)
    return dpd.add_thermostat(system, friction, T, DT, seed=1, platform="Reference", topology=topology, positions=X, **choices)


def mixed() -> dpd.BuiltSystem:
    topology, system = argon(8)
    cross = {("Ar", "oil"): dpd.DPD(A=50, gamma=20, cutoff=0.6)}
    choices = {"dt": DT, "seed": 1, "platform": "Reference"}
    return dpd.create_mixed_system(beads(), topology, system, X[:8] + 0.2, atoms=["Ar"] * 8, cross=cross, **choices)


WAYS = {"build": lambda: dpd.build(beads(), dt=DT, seed=1, platform="Reference"), "thermostat": thermostat, "mixed": mixed}


@pytest.mark.parametrize("way", WAYS)
def test_all_ways_have_the_same_face(way):
    built = WAYS[way]()
    assert isinstance(built, dpd.BuiltSystem) and isinstance(built.plan, dpd.Plan)
    simulation = built.simulation()
    assert simulation.integrator is built.integrator and simulation.system.getNumParticles() == built.system.getNumParticles()
    out, friction = StringIO(), "friction and noise: compiled pair kernel"
    assert friction in built.explain() and "program middle" in built.explain() and f"seed of the noise: {1}" in built.explain()
    assert ("particles of a System made elsewhere" in built.explain()) == (way != "build")
    simulation.reporters.append(dpd.DPDReporter(out, 5, built))
    before = dpd.Observer(built).sample(simulation.context)
    simulation.step(10)
    after = dpd.Observer(built).sample(simulation.context)
    mass = np.array([m._value for m in map(built.system.getParticleMass, range(built.system.getNumParticles()))])
    state = simulation.context.getState(velocities=True, energy=True)
    v = state.getVelocities(asNumpy=True)._value
    assert after.kT == pytest.approx(float(mass @ (v**2).sum(axis=1)) / (3 * len(mass) - 3), rel=1e-12)
    assert after.potential == pytest.approx(state.getPotentialEnergy()._value, rel=1e-9)
    assert after.target_kT == pytest.approx(BOLTZMANN * T) and after.volume == EDGE**3
    np.testing.assert_allclose(after.momentum, before.momentum, atol=1e-9)
    rows = np.genfromtxt(StringIO(out.getvalue()), delimiter=",", names=True)
    assert rows["step"].tolist() == [5, 10] and rows["kT"][-1] == pytest.approx(after.kT, rel=1e-8)
    assert ("kT_beads" in (rows.dtype.names or ())) == (way == "mixed")


def test_velocities_of_a_thermostatted_system():
    """They have no total momentum, and exactly the temperature where there are no constraints."""
    built = thermostat()
    sample = dpd.Observer(built).sample(built.simulation().context)
    assert sample.kT == pytest.approx(BOLTZMANN * T, rel=1e-9)
    np.testing.assert_allclose(sample.momentum, 0.0, atol=1e-9)


def test_constraints_hold_from_the_start():
    topology, system = argon(constrained=True)
    x = X.copy()
    built = dpd.add_thermostat(system, dpd.DPD(gamma=20, cutoff=0.6), T, DT, seed=1, platform="Reference", topology=topology, positions=x)
    context = built.simulation().context
    state = context.getState(positions=True, velocities=True)
    x, v = state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value
    assert np.linalg.norm(x[1] - x[0]) == pytest.approx(0.4, rel=1e-5)
    assert abs((x[1] - x[0]) @ (v[1] - v[0])) < 1e-4
    assert dpd.Observer(built).sample(context).dof == 3 * N - 4


def test_particles_left_out_are_told():
    types = [None if k % 4 == 0 else "Ar" for k in range(N)]
    topology, system = argon()
    built = dpd.add_thermostat(system, {("Ar", "Ar"): dpd.DPD(gamma=20, cutoff=0.6)}, T, DT, types=types, seed=1)
    assert f"{N} particles of a System made elsewhere, {N // 4} of them without friction" in built.explain()
    assert built.topology is None and built.positions is None and built.system is system
    raises(dpd.PlanError, "give them to add_thermostat, or make your own app.Simulation", built.simulation)


def test_what_a_system_made_elsewhere_has_not():
    built = thermostat()
    with pytest.raises(dpd.ParameterError, match="kT_atoms are not measured for a System made elsewhere"):
        dpd.DPDReporter(StringIO(), 5, built, ["kT_atoms"])
    raises(dpd.ParameterError, "terms of a System made elsewhere", lambda: dpd.measure.StressReporter(5, built))
    raises(dpd.ParameterError, "getState", lambda: dpd.force_terms(built))
    raises(dpd.PlanError, "already; build it again", lambda: [built.simulation() for _ in range(2)])


@pytest.mark.parametrize("wrong", [X[:-1], X * np.nan])
def test_positions_must_fit(wrong):
    topology, system = argon()
    with pytest.raises(dpd.ParameterError, match="positions"):
        dpd.add_thermostat(system, dpd.DPD(gamma=20, cutoff=0.6), T, DT, topology=topology, positions=wrong)


def test_a_bare_temperature_is_kelvin_and_kT_an_energy():
    context = thermostat().simulation().context
    dpd.set_temperature(context, 310)
    assert context.getParameter("dpd_kT") == pytest.approx(310 * BOLTZMANN)
    dpd.set_kT(context, 2.0)
    assert context.getParameter("dpd_kT") == 2.0
    for call, value in ((dpd.set_temperature, 3.0 * unit.kilojoule_per_mole), (dpd.set_kT, 3.0 / BOLTZMANN * unit.kelvin)):
        call(context, value)
        assert context.getParameter("dpd_kT") == pytest.approx(3.0)
        context.setParameter("dpd_kT", 1.0)


# -- decks and scripts -----------------------------------------------------------------------------------------------------------------
ROADS = {  # Atom style, pair style, words of a pair, fixes, what else is in the line of an atom.
    "dpd": ("atomic", "dpd 1.2 1 7", "{A} {g}", "nve", "xyz"),
    "tstat": ("atomic", "dpd/tstat 1.2 1.2 1.1 7", "{g}", "mvv/dpd 0.65", "xyz"),
    "ext": ("atomic", "dpd/ext 1.2 1 7", "{A} {g} 2 0.5 1.5", "nve", "xyz"),
    "fdt": ("atomic", "dpd/fdt 1.2 1 7", "{A} {g}", "shardlow\nnve", "xyz"),
    "energy": ("dpd", "dpd/fdt/energy 1 7", "{A} {g} 0.5", "eos/cv 50\nshardlow\nnve", "{t} xyz"),
    "edpd": ("edpd", "edpd 1 7", "{A} {g} 0.4 1 0.1 2 0.9", "mvv/edpd 0.55", "{t} 100 xyz"),
    "tdpd": ("tdpd 1", "tdpd 1.2 1 7", "{A} {g} 0.4 1 0.9 0.3 1e-3 1.5", "mvv/tdpd", "xyz {t}"),
    "mdpd": ("mdpd", "hybrid/overlay mdpd/rhosum mdpd 1.2 1 7", "mdpd -{A} 25 {g} 1 0.75", "nve", "0 xyz"),
}
TERMS = {  # The same in a script.
    "dpd": lambda A, g: dpd.DPD(A=A, gamma=g),
    "tstat": lambda A, g: dpd.DPD(gamma=g, cutoff=1.1),
    "ext": lambda A, g: dpd.DPD(A, g, None, 2.0, 0.5, 1.5),
    "fdt": lambda A, g: dpd.DPD(A=A, sigma=g),
    "energy": lambda A, g: dpd.EnergyDPD(A, g, 0.5),
    "edpd": lambda A, g: dpd.EDPD(A, g, 0.1, 1, 0.4, 2, 0.9),
    "tdpd": lambda A, g: dpd.TDPD(A, g, (0.3,), (1e-3,), 0.4, 1, 0.9, (1.5,)),
    "mdpd": lambda A, g: dpd.MDPD(-A, 25, g, kernel="lucy"),
}
FIELDS = {"energy": lambda t: dpd.InternalEnergy(dpd.ConstantHeatCapacity(50.0), t), "edpd": lambda t: dpd.BeadTemperatures(t, 100.0)}
FIELDS["tdpd"] = lambda t: dpd.Concentrations(t[:, None])
LAMBDA = {"tstat": 0.65, "edpd": 0.55}


@pytest.mark.parametrize("road", ROADS)
def test_a_deck_and_a_script_are_one_simulation(road, tmp_path):
    """The same plan in words and the same forces, with noise; velocities after some steps bit for bit, positions but for folding."""
    style, pair, words, fixes, more = ROADS[road]
    rng, n, edge, scheme, kinds = np.random.default_rng(5), 80, 3.0, "shardlow" if "shardlow" in fixes else "mvv", ("1", "2")
    x, v, t, types = rng.random((n, 3)) * edge, rng.normal(size=(n, 3)), rng.random(n) + 1, rng.choice(kinds, n).tolist()
    values = {pair: dict(zip("Ag", rng.uniform(2, 20, 2).round(3).tolist(), strict=True)) for pair in (("1", "1"), ("1", "2"), ("2", "2"))}
    box = "".join(f"0 {edge} {axis}lo {axis}hi\n" for axis in "xyz")
    atoms = [f"{k + 1} {types[k]} " + more.format(t=t[k]).replace("xyz", " ".join(map(repr, x[k].tolist()))) for k in range(n)]
    speeds = [f"{k + 1} " + " ".join(map(repr, v[k].tolist())) for k in range(n)]
    header = f"title\n\n{n} atoms\n2 atom types\n{box}\nMasses\n\n1 1\n2 2.5\n\nAtoms\n\n"
    put(tmp_path / "data", header + "\n".join([*atoms, "", "Velocities", "", *speeds, ""]))
    lines = [f"units lj\natom_style {style}\ncomm_modify vel yes\nread_data data\npair_style {pair}"]
    lines += ["pair_coeff * * mdpd/rhosum 0.75"] * (road == "mdpd")
    lines += [f"pair_coeff {a} {b} {words.format(**of)}" for (a, b), of in values.items()]
    lines += [f"fix {k} all {fix}" for k, fix in enumerate(fixes.splitlines())]
    path = put(tmp_path / "in.deck", "\n".join([*lines, "timestep 0.01\nrun 5\nwrite_data end\n"]))
    options = RunOptions(platform="Reference", threads=1, seed=9)
    run_deck(path, options, out=tmp_path / "out")
    end = read_data_file(tmp_path / "out" / "end", style.split()[0], int(road == "tdpd"))
    carried, kT = {"internal": FIELDS.get(road, lambda t: None)(t)}, float(t.mean()) if road in ("energy", "edpd") else 1.2
    pairs = {of: TERMS[road](**numbers) for of, numbers in values.items()}
    scene = dpd.Scene({"1": 1.0, "2": 2.5}, types, x, pairs, kT, [edge] * 3, v, **carried)
    built = dpd.build(scene, dt=0.01, scheme=scheme, lam=LAMBDA.get(road, 0.5), platform="Reference", seed=9)
    forces = [dpd.force_terms(built), deck_forces(path, options)]
    assert all(np.array_equal(*(terms[name] for terms in forces)) for name in forces[0])
    with read_by(read_deck(path, stop_before_first_run=True)):
        assert explain_deck(path, options).startswith(built.explain() + "\n")
    found, order = state_of(stepped(built.simulation(), 5).context), np.argsort(end.columns["id"])
    assert np.array_equal(found[1], end.velocities[order])
    np.testing.assert_allclose((end.positions + end.images * edge)[order], found[0], rtol=0, atol=1e-15)
