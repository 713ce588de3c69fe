"""Beads of a scene beside atoms of a force field in one System."""

import copy
import random
from functools import cache
from io import StringIO

import numpy as np
import openmm
import pytest
from cases import cases, raises
from judged import any_seed
from openmm import app, unit

import openmm_dpd as dpd

EDGE = 2.6
KT = 300 * dpd.units.BOLTZMANN
#: N-methylacetamide without hydrogens: its ends are the caps of a peptide.
SOLUTE = """\
ATOM      1  CH3 ACE A   1       0.000   0.000   0.000  1.00  0.00           C
ATOM      2  C   ACE A   1       1.520   0.000   0.000  1.00  0.00           C
ATOM      3  O   ACE A   1       2.144  -1.060   0.000  1.00  0.00           O
ATOM      4  N   NME A   2       2.116   1.195   0.000  1.00  0.00           N
ATOM      5  C   NME A   2       3.559   1.334   0.000  1.00  0.00           C
END
"""
PLATFORMS = ["Reference", "CPU"]
FRICTION = {"gamma": 60.0, "cutoff": 0.65}
STRONG = {"gamma": 600.0, "cutoff": 0.65}  # Among beads: their kinetic energy forgets with 13/ps.


@cache
def _atoms():
    """N-methylacetamide and three TIP4P-Ew waters, PME, constraints, no dispersion correction."""
    pdb = app.PDBFile(StringIO(SOLUTE))
    field = app.ForceField("amber14-all.xml", "amber14/tip4pew.xml")
    modeller = app.Modeller(pdb.topology, pdb.positions)
    random.seed(1)  # hydrogens start at random places
    modeller.addHydrogens(field, platform=openmm.Platform.getPlatformByName("Reference"))
    water = app.Modeller(app.Topology(), [] * unit.nanometer)
    water.addSolvent(field, boxSize=openmm.Vec3(1, 1, 1) * unit.nanometer, model="tip4pew")
    water.delete(list(water.topology.residues())[3:])
    modeller.add(water.topology, [p + openmm.Vec3(1.3, 1.3, 1.3) * unit.nanometer for p in water.positions])
    modeller.topology.setUnitCellDimensions(openmm.Vec3(EDGE, EDGE, EDGE) * unit.nanometer)
    choices = {"nonbondedMethod": app.PME, "nonbondedCutoff": 0.9 * unit.nanometer, "constraints": app.HBonds}
    system = field.createSystem(modeller.topology, removeCMMotion=False, **choices)
    (nonbonded,) = [force for force in system.getForces() if isinstance(force, openmm.NonbondedForce)]
    nonbonded.setUseDispersionCorrection(False)
    return modeller.topology, system, np.array(modeller.positions.value_in_unit(unit.nanometer))


def atoms():
    topology, system, x = _atoms()
    return topology, copy.deepcopy(system), x


def classes(topology: app.Topology) -> list[str | None]:
    """Water oxygen, unseen hydrogens and virtual sites of water, everything else."""
    names = {"O": "water", "H1": None, "H2": None, "M": None}
    return [names[atom.name] if atom.residue.name == "HOH" else "solute" for atom in topology.atoms()]


def beads(x: np.ndarray, n: int = 190, close: float | None = None, **changes) -> dpd.Scene:
    """Soft beads of two types, a few of them bonded and without repulsion between bonded neighbours; not on top of the atoms at x."""
    positions = np.random.default_rng(5).random((4 * n, 3)) * EDGE
    d = positions[:, None] - x[None]
    d -= EDGE * np.rint(d / EDGE)
    positions = positions[np.linalg.norm(d, axis=2).min(axis=1) > 0.25][:n]
    if close is not None:
        positions[11] = positions[10] + [close, 0, 0]
    settings = {"pairs": {("*", "*"): dpd.DPD(A=60, **STRONG), ("V", "W"): dpd.DPD(A=90, **STRONG)}, "kT": KT, "box": [EDGE] * 3}
    settings |= {"bonds": [dpd.HarmonicBonds([[0, 1], [1, 2], [3, 4]], k=50, r0=0.4)], "bonded_factors": (0.0, 0.5, 1.0), **changes}
    return dpd.Scene({"W": 36.0, "V": 54.0}, ["W"] * (n - 40) + ["V"] * 40, positions, **settings)


REPULSION = {("solute", "*"): dpd.DPD(A=80, **FRICTION), ("water", "*"): dpd.DPD(A=60, **FRICTION)}
REPULSION["solute", "V"] = dpd.DPD(A=20, gamma=5, cutoff=0.5)


def mixed(topology, system, x, scene=None, **choices) -> dpd.MixedSystem:
    """Beads among the atoms; all but one argument of many are the same in most tests."""
    choices = {"atoms": classes(topology), "cross": REPULSION, "platform": "Reference", "seed": 3, **choices}
    return dpd.create_mixed_system(scene or beads(x), topology, system, x, **choices)


ATTRACTION = {("solute", "V"): dpd.LennardJones(epsilon=0.4, sigma=0.3, cutoff=0.8), ("water", "*"): dpd.NONE, ("solute", "W"): dpd.NONE}


def forces(context: openmm.Context, groups=-1) -> np.ndarray:
    return context.getState(forces=True, groups=groups).getForces(asNumpy=True)._value


def context_of(system, positions, platform: str, integrator=None) -> openmm.Context:
    properties = {"Threads": "1"} if platform == "CPU" else {}
    integrator = integrator or openmm.VerletIntegrator(0.001)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform), properties)
    context.setPositions(positions)
    context.computeVirtualSites()
    return context


def cross_forces(x: np.ndarray, names: list, scene: dpd.Scene, attraction: bool = True) -> tuple[np.ndarray, float]:
    """Forces and energy of the cross terms, written out."""
    n = len(x)
    force, energy = np.zeros((n + scene.n_beads, 3)), 0.0
    for i, name in enumerate(names):
        for j, kind in enumerate(scene.types) if name else ():
            d = x[i] - scene.positions[j]
            d -= EDGE * np.rint(d / EDGE)
            r = np.linalg.norm(d)
            terms = []
            soft = (20.0, 0.5) if (name, kind) == ("solute", "V") else ({"solute": 80.0, "water": 60.0}[name], 0.65)
            if r < soft[1]:
                terms.append((soft[0] * (1 - r / soft[1]), 0.5 * soft[0] * soft[1] * (1 - r / soft[1]) ** 2))
            if attraction and (name, kind) == ("solute", "V") and r < 0.8:
                s6 = (0.3 / r) ** 6
                terms.append((24 * 0.4 * (2 * s6**2 - s6) / r, 4 * 0.4 * (s6**2 - s6)))
            for size, part in terms:
                force[i] += size * d / r
                force[n + j] -= size * d / r
                energy += part
    return force, energy


@pytest.mark.parametrize("platform", [*PLATFORMS, pytest.param("OpenCL", marks=pytest.mark.slow)])
def test_forces_are_those_of_the_parts(platform):
    """Atoms alone, beads alone, and the cross terms written out add up to the whole; two beads nearly coincide."""
    if platform not in {openmm.Platform.getPlatform(k).getName() for k in range(openmm.Platform.getNumPlatforms())}:
        pytest.skip(f"there is no platform {platform} here")
    single = platform != "Reference"
    topology, system, x = atoms()
    scene, names = beads(x, close=1e-5), classes(topology)
    whole = mixed(topology, system, x, scene=scene, atoms=names, cross=[REPULSION, ATTRACTION], dt=0.002, platform=platform, seed=1)
    assert whole.n_atoms == len(x) == topology.getNumAtoms() and whole.topology.getNumAtoms() == len(x) + scene.n_beads
    alone = context_of(system, x, platform)
    x = alone.getState(positions=True).getPositions(asNumpy=True)._value
    context = context_of(whole.system, np.concatenate([x, scene.positions]), platform)
    built = dpd.build(scene, dt=0.002, conservative="openmm", platform=platform, seed=1)
    theirs = context_of(built.system, scene.positions, platform)
    cross, energy = cross_forces(x, names, scene)
    expected = cross + np.concatenate([forces(alone), forces(theirs)])
    found = forces(context, whole.integrator.getIntegrationForceGroups())
    assert np.abs(cross[: len(x)]).max() > 50 and np.abs(cross[len(x) :]).max() > 20
    np.testing.assert_allclose(found, expected, atol=(1e-4 if single else 1e-6) * np.abs(expected).max())
    parts = [c.getState(energy=True).getPotentialEnergy()._value for c in (alone, theirs)]
    total = context.getState(energy=True).getPotentialEnergy()._value
    assert total == pytest.approx(sum(parts) + energy, abs=0.05 if single else 1e-6)


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("groups", [False, True])
def test_custom_nonbonded_forces_of_the_atoms_leave_beads_out(platform, groups):
    """... even where two beads are so close that the expression overflows, and with a definition after the expression."""
    topology, system, x = atoms()
    force = openmm.CustomNonbondedForce("a1*a2*s^12; s=0.3/r")
    force.addPerParticleParameter("a")
    for k in range(len(x)):
        force.addParticle([0.1 + 0.01 * k])
    force.setNonbondedMethod(force.CutoffPeriodic)
    force.setCutoffDistance(0.9)
    (nonbonded,) = [other for other in system.getForces() if isinstance(other, openmm.NonbondedForce)]
    for k in range(nonbonded.getNumExceptions()):
        force.addExclusion(*nonbonded.getExceptionParameters(k)[:2])
    if groups:
        force.addInteractionGroup(range(6), range(6, len(x)))
    else:
        force.setForceGroup(3)
    system.addForce(force)
    scene = beads(x, close=1e-7)
    whole = mixed(topology, system, x, scene=scene, dt=0.002, platform=platform, seed=1)
    alone = context_of(system, x, platform)
    context = context_of(whole.system, np.concatenate([x, scene.positions]), platform)
    found = forces(context, {force.getForceGroup() for force in system.getForces()})
    reference = forces(alone)
    np.testing.assert_allclose(found[: len(x)], reference, atol=1e-6 * np.abs(reference).max() if platform == "Reference" else 2e-2)
    np.testing.assert_array_equal(found[len(x) :], 0)
    assert np.isfinite(forces(context, whole.integrator.getIntegrationForceGroups())).all()


def test_all_forces_exclude_the_same_pairs():
    """As GPU platforms want it; and one cutoff in each of the force groups."""
    topology, system, x = atoms()
    before = openmm.XmlSerializer.serialize(system)
    whole = dpd.create_mixed_system(beads(x), topology, system, x, atoms=classes(topology), cross=[REPULSION, ATTRACTION], dt=0.002, seed=1)
    excluded, cutoffs = [], {}
    for force in whole.system.getForces():
        if isinstance(force, openmm.NonbondedForce):
            excluded.append({tuple(sorted(force.getExceptionParameters(k)[:2])) for k in range(force.getNumExceptions())})
        elif isinstance(force, openmm.CustomNonbondedForce):
            excluded.append({tuple(sorted(force.getExclusionParticles(k))) for k in range(force.getNumExclusions())})
        else:
            continue
        cutoffs.setdefault(force.getForceGroup(), set()).add(force.getCutoffDistance()._value)
    assert len(excluded) == 3 and excluded[0] == excluded[1] == excluded[2]
    n = len(x)
    assert {(n, n + 1), (n, n + 2), (n + 3, n + 4)} < excluded[0]
    assert all(len(found) == 1 for found in cutoffs.values())
    assert openmm.XmlSerializer.serialize(system) == before, "the System given must stay as it is"


def rows_of(whole: dpd.MixedSystem, simulation: app.Simulation, n: int, every: int) -> dict[str, np.ndarray]:
    rows = []
    for _ in range(n):
        simulation.step(every)
        rows.append(whole.temperatures(simulation.context))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def independent_temperatures(whole: dpd.MixedSystem, context: openmm.Context, n: int) -> dict[str, float]:
    """2K/f of atoms, beads and all in kJ/mol, from nothing but the System: n particles are atoms."""
    system = whole.system
    v = context.getState(velocities=True).getVelocities(asNumpy=True)._value
    twice = np.array([system.getParticleMass(k)._value * float(v[k] @ v[k]) for k in range(system.getNumParticles())])
    moving = [system.getParticleMass(k)._value > 0 for k in range(system.getNumParticles())]
    free = {"atoms": 3 * sum(moving[:n]) - system.getNumConstraints(), "beads": 3 * sum(moving[n:])}
    every = free["atoms"] + free["beads"]
    sums = {"atoms": twice[:n].sum(), "beads": twice[n:].sum()}
    return {name: sums[name] / (free[name] * (every - 3) / every) for name in sums} | {"all": twice.sum() / (every - 3)}


@pytest.mark.parametrize("platform", PLATFORMS)
def test_observer_and_reporter(platform):
    """Rigid water with a virtual site beside beads: temperatures with the degrees of freedom counted here, energies, momentum; the file."""
    topology, system, x = atoms()
    whole = mixed(topology, system, x, dt=0.001, platform=platform)
    simulation = whole.simulation(properties={"Threads": "1"} if platform == "CPU" else None)
    simulation.minimizeEnergy(maxIterations=30)
    theirs, mine = StringIO(), StringIO()
    simulation.reporters.append(app.StateDataReporter(theirs, 2, kineticEnergy=True, potentialEnergy=True, totalEnergy=True, volume=True))
    simulation.reporters.append(dpd.DPDReporter(mine, 2, whole))
    simulation.step(4)
    sample = dpd.Observer(whole).sample(simulation.context)
    wanted = independent_temperatures(whole, simulation.context, len(x))
    assert sum(system.isVirtualSite(k) for k in range(len(x))) == 3 and system.getNumConstraints() > 9
    assert {"atoms": sample.kT_atoms, "beads": sample.kT_beads, "all": sample.kT} == pytest.approx(wanted, rel=1e-9)
    assert whole.temperatures(simulation.context)["beads"] == pytest.approx(wanted["beads"] / dpd.units.BOLTZMANN, rel=1e-9)
    state = simulation.context.getState(energy=True, velocities=True)
    mass = np.array([m._value for m in map(whole.system.getParticleMass, range(whole.system.getNumParticles()))])
    assert sample.potential == pytest.approx(state.getPotentialEnergy()._value, rel=1e-6)
    assert sample.kinetic == pytest.approx(state.getKineticEnergy()._value, rel=1e-6)
    np.testing.assert_allclose(sample.momentum, mass @ state.getVelocities(asNumpy=True)._value, atol=1e-10)
    assert sample.target_kT == pytest.approx(KT) and sample.volume == pytest.approx(EDGE**3)
    rows, expected = (np.genfromtxt(StringIO(out.getvalue().replace('"', "")), delimiter=",", names=True) for out in (mine, theirs))
    assert rows.dtype.names == ("step", "time", "kT", "kT_atoms", "kT_beads", "potential_energy", "kinetic_energy", "total_energy", "volume", "momentum")  # fmt: skip
    assert rows["step"].tolist() == [2, 4] and rows["kT_beads"][-1] == pytest.approx(sample.kT_beads, rel=1e-8)
    for name, other in (("potential", "Potential"), ("kinetic", "Kinetic"), ("total", "Total")):
        (column,) = [key for key in expected.dtype.names if key.startswith(other)]
        np.testing.assert_allclose(rows[f"{name}_energy"], expected[column], rtol=1e-6, atol=1e-3, err_msg=name)


def test_what_is_not_measured_of_atoms_and_beads():
    """No pressure, no configurational temperature, no forces term by term: absent or an error, and never a number."""
    topology, system, x = atoms()
    whole = mixed(topology, system, x, dt=0.001)
    observer = dpd.Observer(whole)
    sample = observer.sample(whole.simulation().context)
    absent = ("pressure", "virial_conservative", "pair", "bond", "total", "kT_conf", "forces")
    assert not any(hasattr(sample, name) for name in absent) and np.isfinite(sample.potential)
    assert "Laplacian" in (observer.no_laplacian or "")
    for columns in (["step", "pressure"], ["kT_conf"], ["conserved_energy"]):
        with pytest.raises(dpd.ParameterError, match=f"{columns[-1]} are not measured for a System made elsewhere; .*kT_beads"):
            dpd.DPDReporter(StringIO(), 2, whole, columns)
    with pytest.raises(dpd.ParameterError, match="columns kT_beads are not measured for a scene; choose"):
        dpd.DPDReporter(StringIO(), 2, dpd.build(beads(x), dt=0.001, platform="Reference"), ["step", "kT_beads"])
    raises(dpd.ParameterError, "force_terms separates the terms of a scene only, .*getState", lambda: dpd.force_terms(whole))


@pytest.mark.slow
@pytest.mark.long
@any_seed(3)
@pytest.mark.parametrize("platform", ["CPU", "Reference"])
def test_temperature_of_atoms_and_of_beads(platform, seed):
    """Both at 300 K; friction between them, none among the atoms."""
    topology, system, x = atoms()
    # a water whose oxygen alone feels friction hardly ever loses its rotation
    names = ["hydrogen" if atom.name in ("H1", "H2") and atom.residue.name == "HOH" else None for atom in topology.atoms()]
    names = [name or other for name, other in zip(names, classes(topology), strict=True)]
    cross = REPULSION | {("hydrogen", "*"): dpd.DPD(**FRICTION)}
    whole = dpd.create_mixed_system(beads(x), topology, system, x, atoms=names, cross=cross, dt=0.002, platform=platform, seed=seed)
    # the CPU platform's PME has threads of its own
    simulation = whole.simulation(properties={"Threads": "1", "DeterministicForces": "true"} if platform == "CPU" else None)
    simulation.minimizeEnergy(maxIterations=100)
    simulation.context.setVelocities(whole.velocities)
    simulation.context.applyVelocityConstraints(1e-6)
    simulation.step(1000)
    samples = 2400 if platform == "CPU" else 600
    found = rows_of(whole, simulation, samples, 5)
    # standard deviations of the means of 2400 samples on CPU, twelve seeds; a run of this length does not know its own error well
    for name, deviation in {"atoms": 11.2, "beads": 2.8, "all": 2.5}.items():
        mean, error = found[name].mean(), deviation * np.sqrt(2400 / samples)
        print(platform, name, mean, error)
        # 0.5 % for the first-order error of pair updates under constraints, beside 4 standard errors
        assert abs(mean - 300) < 1.5 + 4 * error, name


@pytest.mark.parametrize("coupled", [True, False])
def test_friction_between_atoms_and_beads(coupled):
    """Cold atoms far from equilibrium take heat from warm beads through friction of the cross table, and else keep it (no repulsion)."""
    topology, system, x = atoms()
    while system.getNumForces() > 1:
        system.removeForce(0 if not isinstance(system.getForce(0), openmm.NonbondedForce) else 1)
    (nonbonded,) = system.getForces()
    nonbonded.setNonbondedMethod(nonbonded.CutoffPeriodic)
    for k in range(len(x)):
        nonbonded.setParticleParameters(k, 0, 0.1, 0)
    for k in range(nonbonded.getNumExceptions()):
        i, j = nonbonded.getExceptionParameters(k)[:2]
        nonbonded.setExceptionParameters(k, i, j, 0, 0.1, 0)
    cross = {("*", "*"): dpd.DPD(**FRICTION) if coupled else dpd.NONE}
    whole = mixed(topology, system, x, cross=cross, dt=0.002)
    simulation = whole.simulation()
    mass = np.array([m._value for m in map(whole.system.getParticleMass, range(whole.system.getNumParticles()))])
    v = np.array(whole.velocities._value)
    v[: len(x)] = 0
    v[len(x) :] -= mass[len(x) :] @ v[len(x) :] / mass[len(x) :].sum()
    simulation.context.setVelocities(v)

    def momentum():
        return mass @ simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value

    assert whole.temperatures(simulation.context)["atoms"] == 0
    simulation.step(200)
    np.testing.assert_allclose(momentum(), 0, atol=1e-8)
    warm = whole.temperatures(simulation.context)["atoms"]
    assert (80 < warm < 700) if coupled else warm < 1e-12


def test_saved_and_read_back():
    """System and integrator as XML give the same steps, bit for bit; so does a checkpoint."""
    topology, system, x = atoms()
    whole = mixed(topology, system, x, dt=0.001)
    copies = [openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(thing)) for thing in (whole.system, whole.integrator)]
    first = context_of(whole.system, whole.positions, "Reference", whole.integrator)
    second = context_of(copies[0], whole.positions, "Reference", copies[1])
    for context in (first, second):
        context.setVelocities(whole.velocities)
        context.getIntegrator().step(3)
    second.loadCheckpoint(first.createCheckpoint())
    for context in (first, second):
        context.getIntegrator().step(3)
    results = [context.getState(positions=True).getPositions(asNumpy=True)._value for context in (first, second)]
    np.testing.assert_array_equal(*results)


def test_barostat():
    """Volume moves scale beads and molecules; the box of the run changes and the constraints hold."""
    topology, system, x = atoms()
    system.addForce(openmm.MonteCarloBarostat(200 * unit.bar, 300 * unit.kelvin, 5))
    whole = mixed(topology, system, x, dt=0.002, platform="CPU")
    simulation = whole.simulation(properties={"Threads": "1"})
    simulation.minimizeEnergy(maxIterations=30)
    simulation.step(60)
    state = simulation.context.getState(positions=True)
    after = state.getPositions(asNumpy=True)._value
    assert np.isfinite(after).all()
    assert abs(state.getPeriodicBoxVolume()._value / EDGE**3 - 1) > 1e-4
    for k in range(whole.system.getNumConstraints()):
        i, j, distance = whole.system.getConstraintParameters(k)
        assert np.linalg.norm(after[i] - after[j]) == pytest.approx(distance._value, rel=2e-5)


def test_without_a_box_and_with_a_frozen_atom():
    """Argon atoms, the first of mass 0, in a drop of beads; the frozen one stays, and no momentum is counted off."""
    topology, system, force = app.Topology(), openmm.System(), openmm.NonbondedForce()
    chain = topology.addChain()
    for k in range(4):
        topology.addAtom("Ar", app.Element.getBySymbol("Ar"), topology.addResidue("AR", chain))
        system.addParticle(0.0 if k == 0 else 39.9)
        force.addParticle(0, 0.34, 1.0)
    system.addForce(force)
    x = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.4, 0], [0, 0, 0.4]])
    places, table = np.random.default_rng(1).random((20, 3)) + 0.5, {("W", "W"): dpd.DPD(A=60, **FRICTION)}
    scene = dpd.Scene({"W": 36.0}, ["W"] * 20, places, table, kT=KT)
    cross = {("Ar", "W"): dpd.DPD(A=60, **FRICTION)}
    whole = dpd.create_mixed_system(scene, topology, system, x, atoms=["Ar"] * 4, cross=cross, dt=0.002, seed=1)
    assert dpd.degrees_of_freedom(whole.system) == 3 * 23
    simulation = whole.simulation("Reference")
    simulation.step(50)
    after = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
    np.testing.assert_array_equal(after[0], 0)
    assert np.isfinite(after).all() and np.abs(after[1:4] - x[1:]).max() > 1e-3


def test_beads_that_interact_with_atoms_only():
    """... and positions as OpenMM's lists of Vec3."""
    topology, system, x = atoms()
    scene = beads(x, pairs={("*", "*"): dpd.NONE}, bonds=[])
    positions = [openmm.Vec3(*row) for row in x] * unit.nanometer
    whole = mixed(topology, system, positions, scene=scene, dt=0.002)
    found = forces(context_of(whole.system, whole.positions, "Reference"), whole.integrator.getIntegrationForceGroups())
    expected, _ = cross_forces(x, classes(topology), scene, attraction=False)
    np.testing.assert_allclose(found[len(x) :], expected[len(x) :], atol=1e-6 * np.abs(expected).max())
    raises(dpd.PlanError, "this System has a Simulation already", lambda: [whole.simulation("Reference") for _ in range(2)])


@cases(
    "changes, error, message",
    ({"scene": "no scene"}, dpd.ParameterError, "expected a Scene"),
    ({"positions": np.zeros((2, 3))}, dpd.ParameterError, r"positions must have shape \(\d+, 3\)"),
    ({"topology": app.Topology()}, dpd.ParameterError, "Topology must have the .* but it has 0 atoms"),
    ({"atoms": ["solute"]}, dpd.ParameterError, "atoms names the classes of 1 particles"),
    ({"atoms": "solute"}, dpd.ParameterError, "atoms must name the class of each particle"),
    ({"rename": "W"}, dpd.ParameterError, "'W' is a bead type of the scene"),
    ({"rename": 3}, dpd.ParameterError, "`atoms` has 3"),
    ({"cross": {("solute", "W"): dpd.DPD(A=1)}}, dpd.ParameterError, r"no cross terms for \(solute, V\), \(water, W\)"),
    ({"cross": {("*", "*"): dpd.DPD(A=1), ("solute", "X"): dpd.NONE}}, dpd.ParameterError, r"no class of atoms or bead type 'X'"),
    ({"cross": {("*", "*"): dpd.DPD(A=1), ("W", "V"): dpd.DPD(A=1)}}, dpd.ParameterError, "both are bead types"),
    ({"cross": {("*", "*"): dpd.DPD(A=1), ("solute", "water"): dpd.DPD(A=1)}}, dpd.ParameterError, "only friction"),
    ({"cross": {("*", "*"): dpd.DPD(A=1, cutoff=2)}}, dpd.ParameterError, "over half the box"),
    ({"cross": 3}, dpd.ParameterError, "cross must be a table.*3"),
    ({"platform": "cpu"}, dpd.ParameterError, "platform must be the name.*'cpu'"),
    ({"scheme": "native"}, dpd.PlanError, "scheme='middle'"),
    ({"scheme": "mvv"}, dpd.PlanError, "use scheme='middle'"),
    ({"edge": 3.0}, dpd.ParameterError, "the box of the atoms, .* is not that of the scene"),
    ({"own": {"box": None}}, dpd.PlanError, "the scene has no box"),
    ({"force": openmm.GBSAOBCForce()}, dpd.PlanError, "GBSAOBCForce, which needs parameters for every particle"),
    ({"force": openmm.CMMotionRemover()}, dpd.PlanError, "removeCMMotion=False"),
    ({"own": {"walls": [dpd.Wall("z", 0, "above"), dpd.Wall("z", EDGE - 1e-3, "below")]}}, dpd.PlanError, "`walls` cannot be put beside"),
    ({"own": {"body_forces": [dpd.BodyForce([1, 0, 0])]}}, dpd.PlanError, "`body_forces` cannot be put beside atoms"),
    ({"own": {"bodies": [dpd.Body([0, 1])]}}, dpd.PlanError, "`bodies` cannot be put beside atoms"),
)
def test_bad_input(changes, error, message):
    topology, system, x = atoms()
    arguments = {"topology": topology, "positions": x, "atoms": classes(topology), "cross": REPULSION, "dt": 0.002}
    arguments["scene"] = beads(x, **changes.get("own", {}))
    if "edge" in changes:
        system.setDefaultPeriodicBoxVectors(*(changes["edge"] * np.eye(3)))
    if "force" in changes:
        system.addForce(changes["force"])
    if "rename" in changes:
        arguments["atoms"] = [changes["rename"] if name == "water" else name for name in arguments["atoms"]]
    arguments |= {name: value for name, value in changes.items() if name in (*arguments, "scheme", "platform")}
    raises(error, message, lambda: dpd.create_mixed_system(system=system, **arguments))


@pytest.mark.parametrize("method", ["NoCutoff", "CutoffNonPeriodic"])
@pytest.mark.parametrize("overlay", [False, True])
def test_without_a_box(method, overlay):
    """Atoms whose forces have no cutoff or one, beside beads: the same forces on both platforms, zero beyond the cutoffs."""
    system, nonbonded, topology = openmm.System(), openmm.NonbondedForce(), app.Topology()
    chain = topology.addChain()
    for _ in range(2):
        system.addParticle(40.0)
        nonbonded.addParticle(0.0, 0.3, 1.0)
        topology.addAtom("Ar", app.element.argon, topology.addResidue("AR", chain))
    nonbonded.setNonbondedMethod(getattr(nonbonded, method))
    system.addForce(nonbonded)
    soft, places = dpd.DPD(A=10.0, gamma=5.0, cutoff=0.8), np.array([[0.5, 0, 0], [0.9, 0, 0], [3, 0, 0], [3.5, 0, 0]])
    tables = [{("W", "W"): soft}, {("W", "W"): dpd.LennardJones(epsilon=0.4, sigma=0.3, cutoff=0.7)}][: 1 + overlay]
    scene = dpd.Scene({"W": 40.0}, ["W"] * 4, places, tables, kT=2.5)
    x = np.array([[0.0, 0, 0], [0.0, 0.33, 0]])
    found = []
    for platform in PLATFORMS:
        whole = dpd.create_mixed_system(scene, topology, system, x, atoms=["a"] * 2, cross={("a", "W"): soft}, dt=0.002, platform=platform)
        simulation = whole.simulation()
        found.append(forces(simulation.context))
        simulation.step(2)
    np.testing.assert_allclose(found[0], found[1], atol=1e-4)
    away = np.array([[-0.4, 0, 0], [0.5, 0, 0], [0.5, -0.33, 0]])  # bead 0 by the other bead and by both atoms
    r = np.linalg.norm(away, axis=1)[:, None]
    expected = 10.0 * (1 - r / 0.8) * away / r
    if overlay:
        expected[0] += 24 * 0.4 * (2 * (0.3 / 0.4) ** 12 - (0.3 / 0.4) ** 6) / 0.4**2 * away[0]
    np.testing.assert_allclose(found[0][2], expected.sum(axis=0), rtol=1e-6)
