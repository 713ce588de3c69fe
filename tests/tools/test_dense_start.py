"""Soft starts of molecules of a force field: no overlaps left, minimisation and constant pressure go on from there, bad input is refused."""

import copy
import io
from pathlib import Path

import numpy as np
import openmm
import pytest
from cases import raises, script
from openmm import app, unit

from openmm_dpd.base.errors import ParameterError, PlanError, RunError
from openmm_dpd.molecules import PiercingWarning, find_piercings, relax_dense
from openmm_dpd.molecules.soft_system import atom_diameters, excluded_pairs

ROOT = Path(__file__).resolve().parents[2]
NM = unit.nanometer


dense = script(ROOT / "docs" / "measure" / "dense_systems.py")


def array(positions) -> np.ndarray:
    return np.array(positions.value_in_unit(NM))


def check(topology, system, x, picoseconds: float, iterations: int, **options):
    """Soft start, minimisation and constant pressure at 2 fs; the result of the first and the temperature at the end."""
    before = openmm.XmlSerializer.serialize(system)
    done = relax_dense(system, topology, x, platform="CPU", **options)
    assert openmm.XmlSerializer.serialize(system) == before
    assert np.isfinite(array(done.positions)).all()
    # hydrogen bonds and ions of opposite charge come closer than their diameters say in any liquid
    assert done.overlap_before > 0.8 and done.overlap_after < 0.3
    assert done.energy_after < 1e-3 * done.energy_before
    assert not done.unresolved and (not topology.getNumBonds() or find_piercings(topology, done.positions) == [])
    for k in range(system.getNumConstraints()):
        i, j, distance = system.getConstraintParameters(k)
        assert np.linalg.norm(array(done.positions)[i] - array(done.positions)[j]) == pytest.approx(distance.value_in_unit(NM), rel=1e-5)
    run = openmm.XmlSerializer.deserialize(before)
    barostat = openmm.MonteCarloBarostat(1 * unit.bar, 300 * unit.kelvin, 25)
    barostat.setRandomNumberSeed(1)
    run.addForce(barostat)
    integrator = openmm.LangevinMiddleIntegrator(300, 1, 0.002)
    integrator.setRandomNumberSeed(1)
    simulation = app.Simulation(topology, run, integrator, openmm.Platform.getPlatformByName("CPU"))
    simulation.context.setPositions(done.positions)
    simulation.minimizeEnergy(maxIterations=iterations)
    simulation.context.setVelocitiesToTemperature(300, 1)
    simulation.step(round(picoseconds / 0.002))
    moving = sum(system.getParticleMass(k)._value > 0 for k in range(len(x)))
    kinetic = simulation.context.getState(energy=True).getKineticEnergy().value_in_unit(unit.kilojoule_per_mole)
    return done, 2 * kinetic / ((3 * moving - system.getNumConstraints()) * 0.00831446)


@pytest.mark.slow
def test_benzene():
    """Rings in rings at the start.  After a minimisation vibrations take up half of the heat, and 0.2 ps are short beside the friction."""
    topology, system, x = dense.hydrocarbons(lambda rng: dense.benzene(), 60, 0.87, 2)
    assert len(find_piercings(topology, x)) > 5
    done, temperature = check(topology, system, x, 0.2, 40, steps=40)
    assert len(done.resolved) > 5 and str(done.resolved[0]).startswith("the bond A")
    assert [stage.strength for stage in done.stages[:9]] == pytest.approx(np.geomspace(10, 1000, 9))
    assert f"{len(done.resolved)} freed, 0 left" in repr(done) and "freed" in done._repr_html_()
    assert 100 < temperature < 400


@pytest.mark.slow
def test_water_with_virtual_sites():
    """TIP4P-Ew: the site is where its atoms say.  After 40 iterations of the minimiser the water still heats itself, to 380 K."""
    topology, system, x = dense.solution(app.ForceField("amber14/tip4pew.xml"), [], 290, 2.06, 3)
    done, temperature = check(topology, system, x, 0.1, 120, steps=30)
    o, h1, h2, m = array(done.positions).reshape(-1, 4, 3).transpose(1, 0, 2)
    assert np.abs((h1 + h2 - 2 * o) * np.linalg.norm(m[0] - o[0]) / np.linalg.norm(h1 + h2 - 2 * o, axis=1)[:, None] - (m - o)).max() < 1e-5
    assert 100 < temperature < 400


@pytest.mark.parametrize("platform", ["Reference", "CPU", pytest.param("OpenCL", marks=pytest.mark.slow)])
def test_atoms_of_one_element_need_no_bonds(platform):
    """Argon at random places, without a box; atoms of mass 0 and fixed ones stay."""
    if platform not in [openmm.Platform.getPlatform(k).getName() for k in range(openmm.Platform.getNumPlatforms())]:
        pytest.skip(f"OpenMM has no platform {platform} here")
    topology, system, force = app.Topology(), openmm.System(), openmm.NonbondedForce()
    chain = topology.addChain()
    for k in range(60):
        topology.addAtom("AR", app.element.argon, topology.addResidue("AR", chain))
        system.addParticle(39.9 if k else 0.0)
        force.addParticle(0, 0.34, 1.0)
    system.addForce(force)
    x = np.random.default_rng(1).random((60, 3)) * 1.0
    x[30] = x[40]  # no direction to go
    done = relax_dense(system, topology, x, steps=30, fixed=[7], platform=platform)
    moved = np.linalg.norm(array(done.positions) - x, axis=1)
    assert np.all(moved[[0, 7]] <= (1e-7 if platform == "OpenCL" else 0)) and np.all(np.delete(moved, [0, 7]) > 1e-3)
    assert done.overlap_before == 1 and done.overlap_after < 0.1 and np.isinf(done.energy_before._value)
    assert done.resolved == done.unresolved == () and done.replaced == ("NonbondedForce",)


def test_peptides_keep_their_handedness():
    """Two peptides in each other: every C-alpha as it was, every peptide bond trans."""
    topology, system, x = dense.solution(app.ForceField(*dense.AMBER), [dense.piece("test.pdb", 0, 12)] * 2, 0, 1.9, 1)
    done = relax_dense(system, topology, x, steps=20, platform="CPU")
    assert done.overlap_before > 0.6 and done.overlap_after < 0.3
    y, residues = array(done.positions), list(topology.residues())
    places = [{atom.name: atom.index for atom in residue.atoms()} for residue in residues]

    def hand(z, at) -> float:
        return np.sign(np.linalg.det([z[at[name]] - z[at["CA"]] for name in ("N", "C", "CB")]))

    def trans(z, one, other) -> bool:
        ca, c, n, ca2 = z[one["CA"]], z[one["C"]], z[other["N"]], z[other["CA"]]
        return np.dot(np.cross(c - ca, n - c), np.cross(n - c, ca2 - n)) < 0

    chiral = [at for at in places if "CB" in at]
    assert len(chiral) > 20 and all(hand(y, at) == hand(x, at) for at in chiral)
    peptide_bonds = [(one, other) for one, other in zip(places, places[1:], strict=False) if "OXT" not in one]
    assert len(peptide_bonds) == 22 and all(trans(x, *ends) and trans(y, *ends) for ends in peptide_bonds)


def threaded(size: int):
    """A chain of united atoms through a ring of them."""
    edge, angle = 3.0, 2 * np.pi * np.arange(size) / size
    ring = 0.077 / np.sin(np.pi / size) * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    k = np.arange(12)
    chain = np.column_stack([0.0838 * (k % 2) - 0.042, 0 * k, 0.1292 * (k - 5.5)])
    topology = app.Topology()
    for x, closed in ((ring, True), (chain, False)):
        unit_ = topology.addChain()
        kinds = ["CH2" if closed or 0 < n < len(x) - 1 else "CH3" for n in range(len(x))]
        atoms = [topology.addAtom("C", app.element.carbon, topology.addResidue(kind, unit_)) for kind in kinds]
        for one, other in zip(atoms, atoms[1:] + atoms[: int(closed)], strict=False):
            topology.addBond(one, other)
    dense.cube(topology, edge)
    choices = {"nonbondedMethod": app.CutoffPeriodic, "nonbondedCutoff": 1.0, "constraints": app.AllBonds}
    system = app.ForceField(io.StringIO(dense.UNITED)).createSystem(topology, **choices)
    return topology, system, np.concatenate([ring, chain]) + edge / 2


@pytest.mark.parametrize("size, pushes", [(6, 0), (8, 0), (14, 1)])
def test_rings_are_freed(size, pushes):
    """Small ones by the repulsion; a large one holds its chain, which is pushed out of it."""
    topology, system, x = threaded(size)
    done = relax_dense(system, topology, x, steps=40, max_ring=14, platform="CPU")
    assert len(done.resolved) >= 1 and done.unresolved == ()
    assert (len(done.stages) > 9) == (pushes > 0)
    assert find_piercings(topology, done.positions, max_ring=14) == []
    assert done.overlap_after < 0.2


def test_what_cannot_be_freed_is_told():
    topology, system, x = threaded(6)
    with pytest.warns(PiercingWarning, match=r"bonds still pass through 1 rings: the bond C-C of CH2 12/CH2 13 of chain 2 passes"):
        done = relax_dense(system, topology, x, steps=5, fixed=[*range(6), 11, 12], platform="CPU")
    assert len(done.unresolved) == 1 and done.resolved == ()
    assert np.array_equal(array(done.positions)[:6], x[:6])


def test_steps_are_halved_and_runaways_stop():
    """A spring that is too stiff for 2 fs, and one that is too stiff for any step tried."""
    for constant, flies in ((2e7, False), (1e13, True)):
        topology, system, x = threaded(6)
        spring = openmm.CustomExternalForce(f"{constant}*z^2")
        spring.addParticle(17)
        system.addForce(spring)
        if flies:
            message = "repulsion of 10 kJ/mol blows up even with a step of 6.25e-05 ps: .*bead 17"
            raises(RunError, message, relax_dense, system, topology, x, steps=20, platform="CPU")
        else:
            done = relax_dense(system, topology, x, steps=20, platform="CPU")
            assert done.stages[0].halvings > 0 and done.stages[0].dt == 0.002 / 2 ** done.stages[0].halvings
            assert abs(array(done.positions)[17, 2]) < 0.01


def test_sizes_of_elements():
    """Where the Lennard-Jones terms are in a CustomNonbondedForce, as CHARMM's are, elements say how large atoms are; it is replaced too."""
    topology, system, x = threaded(6)
    force = next(force for force in system.getForces() if isinstance(force, openmm.NonbondedForce))
    for k in range(18):
        force.setParticleParameters(k, 0, 1, 0)
    other = openmm.CustomNonbondedForce("1/r^12")
    for _ in range(18):
        other.addParticle()
    other.setNonbondedMethod(other.CutoffPeriodic)
    for further in (other, openmm.MonteCarloBarostat(1, 300), openmm.CMMotionRemover()):
        system.addForce(further)
    for i, j in excluded_pairs(system).tolist():
        other.addExclusion(i, j)
    list(topology.atoms())[5].element = app.element.hydrogen
    sizes = atom_diameters(system, topology)
    assert sizes[4] == pytest.approx(0.34) and sizes[5] == pytest.approx(0.1)  # Bondi's radius of carbon is 0.17 nm
    assert relax_dense(system, topology, x, steps=5, platform="CPU").replaced == ("CustomNonbondedForce", "NonbondedForce")
    list(topology.atoms())[2].element = None
    raises(ParameterError, "the size of atom C of CH2 3 is unknown", lambda: relax_dense(system, topology, x))


def test_bad_input():
    topology, system, x = threaded(6)

    def refused(match: str, kind=ParameterError, **changed):
        given = {"system": system, "topology": topology, "positions": x} | changed
        raises(kind, match, lambda: relax_dense(given.pop("system"), given.pop("topology"), given.pop("positions"), **given))

    def with_force(force) -> openmm.System:
        changed = openmm.XmlSerializer.clone(system)
        changed.addForce(force)
        return changed

    refused(r"shape \(18, 3\)", positions=x[:-1])
    refused(r"positions holds nan at index \(3, 1\)", positions=np.where((np.arange(18) == 3)[:, None] & [0, 1, 0], np.nan, x))
    refused("expected an openmm.System", system=None)
    refused("the Topology must have the 18 particles", topology=app.Topology())
    refused("temperature must be one temperature > 0", temperature=0)
    refused("steps must be at least 1", steps=0)
    refused("fixed must hold indices of atoms from 0 to 17", fixed=[18])
    refused("diameters must be 18 lengths", diameters=[0.3])
    refused("so nothing would repel", diameters=[0.0] * 18)
    refused("the repulsion reaches 1.65 nm, more than half the smallest width of the box, 3 nm", diameters=[1.5] * 18)
    refused("there is no platform 'CPUX' here", platform="CPUX")
    refused("the System has a GayBerneForce", PlanError, system=with_force(openmm.GayBerneForce()))
    refused("the System has 2 NonbondedForces", PlanError, system=with_force(openmm.NonbondedForce()))
    cut = x.copy()
    cut[17] += [0, 0, 3.0]
    refused("the bond of C of CH2 17 and C of CH3 18 is .* the box cuts the molecule", positions=cut)

    def box_of(edge: float | None) -> app.Topology:
        changed = copy.deepcopy(topology)
        changed.setPeriodicBoxVectors(None if edge is None else np.eye(3) * edge * NM)
        return changed

    refused("but the Topology has no box", topology=box_of(None))
    refused("but the Topology has one with the diagonal", topology=box_of(4.0))
    vacuum = openmm.XmlSerializer.clone(system)
    next(f for f in vacuum.getForces() if isinstance(f, openmm.NonbondedForce)).setNonbondedMethod(openmm.NonbondedForce.NoCutoff)
    refused("the NonbondedForce is not periodic", system=vacuum)
    bare = app.Topology()
    residue = bare.addResidue("ALL", bare.addChain())
    for _ in range(18):
        bare.addAtom("X", None, residue)
    dense.cube(bare, 3.0)
    refused("the System has bonds, but the Topology has none", topology=bare)


#: The one that continuous integration runs.
SHORT = "polyethylene, 10 x C100, united atoms"


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name == SHORT else pytest.mark.long) for name in dense.SYSTEMS])
def test_ten_systems(name):
    """Those of docs/howto/dense_start.md, with a shorter run at constant pressure."""
    topology, system, x = dense.SYSTEMS[name]()
    _, temperature = check(topology, system, x, 2.0, 200)
    assert 250 < temperature < 400  # not yet in equilibrium; a run that blows up has thousands
