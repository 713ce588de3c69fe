"""The stress tensor of every kind of force: beside a live LAMMPS, finite differences of the energy, the Observer's virial, and undisturbed runs."""

from contextlib import nullcontext
from itertools import product

import chains_of_beads as chains
import lammps_peer
import numpy as np
import openmm
import pytest
from fluid_deck import IONS
from judged import any_seed
from openmm import unit
from scenes import beads, same_bits, state_of

import openmm_dpd as dpd
from openmm_dpd.analysis import green_kubo_viscosity, surface_tension
from openmm_dpd.measure import StressReporter
from openmm_dpd.measure.stress_parts import stress_parts

LAMMPS = lammps_peer.needed()
ORTHO, TILTED = np.diag([6.2, 5.9, 6.4]), np.array([[6.2, 0, 0], [1.3, 5.9, 0], [-1.1, 1.7, 6.4]])
SHAPES = pytest.mark.parametrize("box", [ORTHO, TILTED], ids=["orthogonal", "tilted"])
COMPONENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
AXES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def stress_of(scene, platform="Reference", **options) -> np.ndarray:
    """(6,) kinetic and conservative part of one sample."""
    built = dpd.build(scene, dt=0.01, scheme="mvv", platform=platform, seed=1, **options)
    reporter = StressReporter(1, built)
    reporter.report(built.simulation(), None)
    return reporter.regular[0]


def their_pressure(commands: list[str], running=None) -> np.ndarray:
    """(6,) pressure tensor of LAMMPS after these commands, without dissipative and random parts if they ask for none."""
    words = [f"p{name}" for name in COMPONENTS]
    with nullcontext(running) if running else lammps_peer.instance() as lmp:
        lmp.commands_list(commands)
        lmp.commands_list(["thermo_style custom step " + " ".join(words), "run 0 post no"])
        return np.array([lmp.get_thermo(word) for word in words])


def lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.strip()]


def agree(stress, box, theirs, tolerance=1e-9):
    np.testing.assert_allclose(stress / np.prod(np.diag(box)), theirs, atol=tolerance * np.abs(theirs).max(), rtol=0)


# -- LAMMPS --------------------------------------------------------------------------------------------------------------------
BONDED = chains.DECK.replace("lj 1 1 1", "lj 0.5 0.25 1") + "pair_coeff 1 1 25.0 0.0\nfix 1 all nve\n"


@LAMMPS
@SHAPES
def test_bonds_and_angles_against_lammps(tmp_path, box):
    """Three kinds of bonds, two of angles, factors for bonded neighbours, and moving beads."""
    x, bonds, angles = chains.walks(12, 6, box, 6)
    (tmp_path / "data.chains").write_text(chains.data_file(x, bonds, angles, box))
    text = BONDED + "group some id 1:30\nvelocity all set 0.3 -1.2 0.9\nvelocity some set 1.4 0.2 -0.8\n"
    theirs = their_pressure([f"shell cd {tmp_path}", *lines(text)])
    for platform in ("Reference", "CPU"):
        agree(stress_of(chains.scene_of(tmp_path, text), platform), box, theirs)


@LAMMPS
@SHAPES
@pytest.mark.parametrize("points", ["mid", "min"])
def test_segmental_repulsion_against_lammps(tmp_path, box, points):
    text = chains.segment_deck(tmp_path, f"hybrid/overlay dpd 0.0 1.0 33 srp 0.9 * {points}", chains.OVERLAY.replace("4.5", "0.0"), box=box)
    theirs = their_pressure([f"shell cd {tmp_path}", *lines(text)])
    agree(stress_of(chains.scene_of(tmp_path, text, compat="lammps")), box, theirs)


CHARGES = f"""units lj
atom_style full
region box prism 0 8 0 7.5 0 8.5 1.0 -0.5 0.7
{IONS}set atom 17 x 8.2 y 5.1 z 4.0
pair_style dpd/coul/slater/long 0.0 1.0 1 0.25 3.7
pair_coeff * * 25 0
pair_coeff 2 2 25 0 yes
comm_modify vel yes
special_bonds lj 1 1 1 coul 0.5 1 1
bond_coeff 1
create_bonds single/bond 1 1 16
create_bonds single/bond 1 2 17
"""


@LAMMPS
def test_charges_against_lammps():
    """Its Ewald sum of 1e-8 beside PME of 1e-5; bonded neighbours count half, some of them in other images of a tilted box."""
    with lammps_peer.instance() as lmp:
        theirs = their_pressure(lines(CHARGES), lmp)
        x, q = (np.array(lmp.gather_atoms(name, 1, count)) for name, count in (("x", 3), ("q", 1)))
    box = np.array([[8.0, 0, 0], [1.0, 7.5, 0], [-0.5, 0.7, 8.5]])
    options = {"cutoff": 3.7, "tolerance": 1e-5, "bonded_factors": (0.5, 1.0, 1.0)}
    charges = dpd.SlaterCharges(lamda=0.25, permittivity=0.5 * dpd.units.COULOMB, **options)
    charged = {"charges": q, "bonds": [dpd.HarmonicBonds([(0, 15), (1, 16)], 0.0, 0.0)], "electrostatics": charges}
    x = x.reshape(-1, 3)
    scene = beads(60, positions=x, table={("W", "W"): dpd.DPD(A=25.0)}, box=box, velocities=np.zeros((60, 3)), **charged)
    agree(stress_of(scene), box, theirs, 2e-5)


def two_types(n=90, seed=4):
    """Positions at least 0.45 apart, types and box."""
    rng, x = np.random.default_rng(seed), []
    while len(x) < n:
        place = rng.random(3) @ TILTED
        if all(np.linalg.norm(chains.nearest_image(place - other, TILTED)) > 0.45 for other in x):
            x.append(place)
    return np.array(x), np.arange(n) % 2


@LAMMPS
@pytest.mark.parametrize("style", ["lj/cut", "mdpd"])
def test_partners_and_many_body_against_lammps(style):
    """Lennard-Jones cut off where it is not 0, with other ranges for each pair of types; many-body DPD with LAMMPS's density."""
    x, types = two_types()
    names = [str(k + 1) for k in types]
    if style == "lj/cut":
        values = {("1", "1"): (1.0, 0.5, 1.25), ("1", "2"): (0.7, 0.6, 1.4), ("2", "2"): (1.3, 0.45, 1.0)}
        commands = ["pair_style lj/cut 1.4", *(f"pair_coeff {a} {b} {e} {s} {c}" for (a, b), (e, s, c) in values.items())]
        pairs = [{key: dpd.LennardJones(*row) for key, row in values.items()}, {("*", "*"): dpd.DPD(gamma=1.0)}]
    else:
        attractions = (("1", "1", -40), ("1", "2", -30), ("2", "2", -35))
        commands = ["pair_style hybrid/overlay mdpd/rhosum mdpd 0.0 1.2 9872", "pair_coeff * * mdpd/rhosum 0.75"]
        commands += [f"pair_coeff {a} {b} mdpd {A} 25.0 0.0 1.2 0.75" for a, b, A in attractions]
        pairs = {(a, b): dpd.MDPD(A=A, B=25, gamma=4.5, cutoff=1.2, cutoff_B=0.75, kernel="lucy") for a, b, A in attractions}
    rows = zip(types, x.tolist(), strict=True)
    bead = [f"create_atoms {t + 1} single {' '.join(map(repr, place))} units box" for t, place in rows]
    setup = ["units lj", f"atom_style {'mdpd' if style == 'mdpd' else 'atomic'}", "comm_modify vel yes"]
    setup += ["region box prism 0 6.2 0 5.9 0 6.4 1.3 -1.1 1.7", "create_box 2 box", *bead, "mass * 1.0", *commands]
    theirs = their_pressure(setup)
    scene = dpd.Scene({"1": 1.0, "2": 1.0}, names, x, pairs, 1.0, box=TILTED, velocities=np.zeros_like(x))
    agree(stress_of(scene), TILTED, theirs)


# -- finite differences of the energy ------------------------------------------------------------------------------------------
def everything(name: str) -> dpd.Scene:
    """Chains with one kind of force each, in a tilted box, beads at rest."""
    x, bonds, angles = chains.walks(12, 6, TILTED, 8, step=0.8)
    rest = {"positions": x, "box": TILTED, "velocities": np.zeros_like(x)}
    r = np.linspace(0.3, 1.5, 200)
    friction = dpd.PairTable({("W", "W"): dpd.DPD(gamma=2.0)})
    q = np.resize([1.0, -1.0, 0.0], len(x))
    gaussian = dpd.GaussianCharges(width=0.4, bjerrum_length=2.0, cutoff=2.7, alpha=1.5, grid=(40, 40, 40), tolerance=1e-6)
    factors = {"bonds": [dpd.HarmonicBonds(bonds, 0.0, 0.0)], "bonded_factors": (0.0, 0.5, 1.0)}
    options = {
        "bonds": {"bonds": [dpd.FENEBonds(bonds[::2], 30, 2.5, 0.8, 0.9), dpd.MorseBonds(bonds[1::2], 12, 1.7, 0.6)]},
        "angles": {"angles": [dpd.HarmonicAngles(angles[::2], 6, 110 * unit.degree), dpd.CosineAngles(angles[1::2], 4)]},
        "segments": {"bonds": [dpd.HarmonicBonds(bonds, 20, 0.8)], "segments": dpd.SegmentalRepulsion(80, 0.9, "min")},
        "table": {"table": [{("W", "W"): dpd.TabulatedPair(r, 3 * (1.5 - r) ** 3, forces=9 * (1.5 - r) ** 2)}, friction], **factors},
        "many-body": {"table": {("W", "W"): dpd.MDPD(A=-40, B=25, gamma=4.5)}, **factors},
        "charges": {"charges": q, "electrostatics": gaussian, **factors},
    }[name]
    return beads(len(x), **rest | options)


@pytest.mark.parametrize("name", ["bonds", "angles", "segments", "table", "many-body", "charges"])
def test_finite_differences_of_the_energy(name):
    """All six components against the energy of strained scenes on the Reference platform."""
    scene, h = everything(name), 1e-5
    built = dpd.build(scene, dt=0.01, scheme="mvv", platform="Reference", seed=1)
    context, groups = built.simulation().context, built.integrator.getIntegrationForceGroups()

    def energy(strain) -> float:
        context.setPeriodicBoxVectors(*(TILTED @ strain))
        context.setPositions(scene.positions @ strain)
        return context.getState(energy=True, groups=groups).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)

    expected = []
    for first, second in AXES:
        strain = np.zeros((3, 3))
        strain[second, first] = h
        expected.append(-(energy(np.eye(3) + strain) - energy(np.eye(3) - strain)) / (2 * h))
    found = stress_of(scene)
    # charges: the pair force ends at the cutoff with 1e-6 of a pair's energy
    np.testing.assert_allclose(found, expected, atol=(3e-5 if name == "charges" else 2e-7) * np.abs(found).max(), rtol=0)


@pytest.mark.parametrize("name", ["bonds", "angles", "segments", "table", "many-body", "charges"])
@pytest.mark.parametrize("platform", ["Reference", "CPU"])
def test_trace_is_the_virial(name, platform):
    """Of the conservative and of the dissipative part, with moving beads, against the Observer."""
    scene = everything(name)
    built = dpd.build(scene, dt=0.001, scheme="aboba", platform=platform, seed=1)
    simulation = built.simulation()
    simulation.context.setVelocities(np.random.default_rng(1).normal(size=(scene.n_beads, 3)))
    reporter = StressReporter(1, built)
    reporter.report(simulation, None)
    sample = dpd.Observer(built).sample(simulation.context)
    assert reporter.regular[0, :3].sum() == pytest.approx(3 * sample.pressure(full=False) * sample.volume, rel=1e-9)
    assert reporter.friction[0, :3].sum() == pytest.approx(sample.virial_dissipative, rel=1e-9)
    np.testing.assert_allclose(reporter.pressures[0] * sample.volume, reporter.regular[0], rtol=1e-12)
    assert reporter.edges[0].tolist() == np.diag(TILTED).tolist()
    assert reporter.instantaneous > 0


# -- parts ---------------------------------------------------------------------------------------------------------------------
def test_one_angle_by_hand():
    """A right angle with arms 1 and 2 along x and y: the ends pull with U'/arm across their arms, and only xy is left."""
    assert stress_parts(dpd.make_plan(beads(), dt=0.01, seed=1)) == []
    x = np.array([[1.0, 0, 0], [0, 0, 0], [0, 2, 0]])
    angle = dpd.HarmonicAngles([(0, 1, 2)], 3.0, 2.0)
    slope = 2 * 3.0 * (np.pi / 2 - 2.0)
    (part,) = stress_parts(dpd.make_plan(beads(3, positions=x, edge=9.0, angles=[angle]), dt=0.01, seed=1))
    np.testing.assert_allclose(part(x, np.eye(3) * 9), [0, 0, 0, slope, 0, 0], atol=1e-14)
    straight = np.array([[1.0, 1, 1], [2.0, 1, 1], [3.0, 1, 1]])
    for kind in (dpd.CosineAngles([(0, 1, 2)], 4.0), dpd.HarmonicAngles([(0, 1, 2)], 4.0, np.pi)):
        (part,) = stress_parts(dpd.make_plan(beads(3, positions=straight, edge=9.0, angles=[kind]), dt=0.01, seed=1))
        np.testing.assert_allclose(part(straight, np.eye(3) * 9), 0, atol=1e-12)


def test_a_box_tilted_to_the_limit():
    """OpenMM takes no box beyond; no strained one is needed."""
    box = np.array([[5.0, 0, 0], [2.5, 5.0, 0], [-2.5, 2.5, 5.0]])
    q = np.resize([1.0, -1.0], 60)
    x = np.random.default_rng(3).random((60, 3)) @ box
    charges = dpd.SlaterCharges(0.25, bjerrum_length=1.0)
    scene = beads(60, positions=x, box=box, charges=q, electrostatics=charges, velocities=np.zeros_like(x))
    found = stress_of(scene)
    assert np.all(np.isfinite(found))
    built = dpd.build(scene, dt=0.01, scheme="mvv", platform="Reference", seed=1)
    sample = dpd.Observer(built).sample(built.simulation().context)
    assert found[:3].sum() == pytest.approx(sample.virial_conservative, rel=1e-11)


# -- runs ----------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("name", "scheme"), [*product(["charges", "segments", "many-body"], ["middle"]), ("table", "mvv")])
@pytest.mark.parametrize("platform", ["Reference", "CPU"])
def test_a_reporter_does_not_disturb_the_run(name, scheme, platform):
    """The same bits with and without it, and after a restart in the middle of a run with it."""
    ends, checkpoint = [], None
    for mode in ("alone", "watched", "continued"):
        built = dpd.build(everything(name), dt=0.002, scheme=scheme, platform=platform, seed=5)
        # PME has threads of its own on the CPU platform, whose sums are in no fixed order otherwise
        simulation = built.simulation(properties={"Threads": "1", "DeterministicForces": "true"} if platform == "CPU" else {})
        if mode != "alone":
            simulation.reporters.append(StressReporter(1, built))
        if mode == "continued":
            simulation.context.loadCheckpoint(checkpoint)
        else:
            simulation.step(3)
        checkpoint = simulation.context.createCheckpoint()
        simulation.step(4)
        ends.append(state_of(simulation.context))
    assert same_bits(ends[0], ends[1]) and same_bits(ends[0], ends[2])


@any_seed(2)
def test_tension_and_viscosity_take_what_it_records(seed):
    """A run with bonds, and edges of a box that a barostat changes."""
    bonds = [dpd.HarmonicBonds(np.arange(60).reshape(-1, 2), 20.0, 0.6)]
    scene = beads(192, edge=4.0, positions=np.random.default_rng(4).random((192, 3)) * 4, bonds=bonds)
    built = dpd.build(scene, dt=0.02, platform="CPU", seed=seed)
    built.system.addForce(openmm.MonteCarloBarostat(23.0 * 16.605, 120.27, 5))
    simulation = built.simulation()
    reporter = StressReporter(1, built)
    simulation.reporters.append(reporter)
    simulation.step(250)
    tension = surface_tension(reporter.pressures, reporter.edges[:, 2])
    assert np.ptp(reporter.edges[:, 2]) > 0 and np.isfinite(tension.sem)
    assert abs(tension.mean) < 4 * tension.sem + 3.0
    assert np.isfinite(green_kubo_viscosity(reporter, t_max=0.2).viscosity)
