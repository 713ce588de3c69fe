"""Conservative, dissipative and random forces of built scenes on every platform: against the oracle and against a live LAMMPS."""

import lammps_peer
import numpy as np
import oracle
import pytest
from devices import DEVICES
from openmm import unit
from scenes import BOXES, EXTENDED, PARTIAL, PLAIN, beads, chains, factor_of, fluid, noise_of, oracle_params, stepped

import openmm_dpd as dpd
from openmm_dpd.base.names import PAIR_GROUP

NO_LAMMPS = lammps_peer.why_missing()
DEVICE_IDS = {"indirect": ["device"], "ids": lambda value: str(value)}
CONSERVATIVE = pytest.mark.parametrize("conservative", ["kernel", "openmm"])
KT, DT = 1.3, 0.02

EXACT, FLOAT = 1e-12, 1e-5  # Relative RMS error of conservative forces: double precision, single precision.


def tolerance(device, conservative: str) -> float:
    """1e-12 where everything is double precision, 1e-5 where positions or forces pass through float32."""
    return EXACT if device.platform == "Reference" or (device.exact and conservative == "kernel") else FLOAT


def relative_rms(got, expected) -> float:
    return float(np.sqrt(np.mean((got - expected) ** 2) / np.mean(expected**2)))


def terms_of(scene, device, conservative, **options):
    built = dpd.build(scene, dt=DT, platform=device.platform, conservative=conservative, seed=9, **options)
    return dpd.force_terms(built, properties=device.properties, counter=4)


@CONSERVATIVE
@pytest.mark.parametrize(
    ("device", "box"), [(d, box) for d in DEVICES for box in ("none", "narrow", "tilted")[0 if d.exact else 1 :]], **DEVICE_IDS
)
def test_forces_equal_the_oracle(device, box, conservative):
    """Two types that differ in everything, beads far outside the box, bonded neighbours with factors 0, 0.5 and 0.25."""
    scene = chains(BOXES[box], table=EXTENDED, kT=KT)
    terms = terms_of(scene, device, conservative)
    params, factor, n = oracle_params(scene), factor_of(scene), scene.n_beads
    x, v, types = scene.positions, scene.velocities, scene.type_ids
    expected = oracle.conservative(x, types, params, scene.box, factor)
    assert relative_rms(terms["conservative"], expected.forces) < tolerance(device, conservative)
    drag = oracle.dissipative(x, v, types, params, scene.box, factor)
    assert relative_rms(terms["dissipative"], drag.forces) < EXACT
    random = oracle.random(x, types, params, scene.box, KT, DT, noise_of(n, 9, 4, KT), factor)
    assert relative_rms(terms["random"], random.forces) < EXACT
    assert not terms["bond"].any()  # k = 0


@CONSERVATIVE
def test_energy_equals_the_oracle(device, conservative):
    """Shifted to zero at the cutoff; what a reporter asks for, with and without the pair force's group."""
    scene = chains(BOXES["tilted"], table=EXTENDED, kT=KT)
    built = dpd.build(scene, dt=DT, platform=device.platform, conservative=conservative, seed=9)
    simulation = built.simulation(properties=device.properties)
    expected = oracle.conservative(scene.positions, scene.type_ids, oracle_params(scene), scene.box, factor_of(scene)).energy
    kilojoule = unit.kilojoule_per_mole
    energy = simulation.context.getState(energy=True).getPotentialEnergy().value_in_unit(kilojoule)
    assert energy == pytest.approx(expected, rel=tolerance(device, conservative))
    alone = simulation.context.getState(energy=True, groups={PAIR_GROUP}).getPotentialEnergy().value_in_unit(kilojoule)
    assert alone == pytest.approx(expected if conservative == "kernel" else 0.0, rel=EXACT if device.exact else FLOAT)


@pytest.mark.parametrize("box", ["none", "ortho", "wide", "slab", "tilted_narrow"])
@pytest.mark.parametrize("table", [PLAIN, EXTENDED, PARTIAL], ids=["dpd", "dpd_ext", "partial"])
@CONSERVATIVE
def test_boxes_and_tables_on_reference(box, table, conservative):
    scene = fluid(table, BOXES[box], kT=KT)
    terms = dpd.force_terms(dpd.build(scene, dt=DT, platform="Reference", conservative=conservative, seed=9))
    params, x, types = oracle_params(scene), scene.positions, scene.type_ids
    assert relative_rms(terms["conservative"], oracle.conservative(x, types, params, scene.box).forces) < EXACT
    assert relative_rms(terms["dissipative"], oracle.dissipative(x, scene.velocities, types, params, scene.box).forces) < EXACT


@pytest.mark.parametrize("what", ["bonds", "charges", "push"])
def test_no_pair_interacts(what, device):
    """All pairs are NONE: what else there is acts, friction and noise are 0, and the scene runs and is measured."""
    more = {
        "bonds": {"bonds": [dpd.HarmonicBonds([[0, 1]], 10.0, 0.5)]},
        "charges": {"charges": [1.0, -1.0, 0.0], "electrostatics": dpd.SlaterCharges(lamda=0.3, bjerrum_length=1.0)},
        "push": {"body_forces": [dpd.BodyForce((2.0, 0.0, 0.0))]},
    }[what]
    x = [[0, 0, 0], [0.6, 0, 0], [0, 0.7, 0]]
    scene = dpd.Scene({"W": 1.0}, ["W"] * 3, x, {("W", "W"): dpd.NONE}, kT=KT, box=[8, 8, 8], **more)
    built = dpd.build(scene, dt=DT, platform=device.platform, seed=9)
    terms = dpd.force_terms(built, properties=device.properties)
    name = {"bonds": "bond", "charges": "electrostatic", "push": "external"}[what]
    assert set(terms) == {name, "conservative", "dissipative", "random"}
    for term in ("conservative", "dissipative", "random"):
        np.testing.assert_array_equal(terms[term], np.zeros((3, 3)), err_msg=term)
    if what == "bonds":  # U = k (r - r0)^2
        np.testing.assert_allclose(terms[name], [[2, 0, 0], [-2, 0, 0], [0, 0, 0]], rtol=0, atol=1e-5)
    else:
        assert (terms[name][0, 0] > 1) and terms[name][2, 1] == 0
    assert np.isfinite(dpd.Observer(built).sample(stepped(built.simulation(properties=device.properties), 3).context).total)


def test_other_positions_velocities_and_noise_counts():
    scene = fluid(EXTENDED, BOXES["tilted"], kT=KT)
    built = dpd.build(scene, dt=DT, platform="Reference", seed=9)
    x, v = scene.positions + np.random.default_rng(0).normal(size=scene.positions.shape) * 0.1, -2 * scene.velocities
    terms = dpd.force_terms(built, x, v)
    params, types = oracle_params(scene), scene.type_ids
    assert relative_rms(terms["conservative"], oracle.conservative(x, types, params, scene.box).forces) < EXACT
    assert relative_rms(terms["dissipative"], oracle.dissipative(x, v, types, params, scene.box).forces) < EXACT
    first, again, other = (dpd.force_terms(built, counter=counter)["random"] for counter in (1, 1, 2))
    assert np.array_equal(first, again)
    # about 450 components of correlated pairs: 4 standard errors of a correlation of independent numbers are 0.19
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 4 / np.sqrt(first.size)


# -- LAMMPS ----------------------------------------------------------------------------------------------------------------------
def lammps_commands(scene) -> tuple[list[str], list[str]]:
    """Pair style and coefficients of a scene in LAMMPS's words, at T = 0, where LAMMPS has no noise."""
    extended = any(c.gamma_perp or c.exponent != 1 for c in scene.tables[0].entries.values())
    largest = max(c.cutoff for c in scene.tables[0].entries.values())
    style = [f"pair_style {'dpd/ext' if extended else 'dpd'} 0.0 {largest!r} 4711"]
    names, lines = scene.type_names, []
    for (a, b), c in scene.tables[0].resolve(names).items():
        words = [names.index(a) + 1, names.index(b) + 1, c.A, c.gamma or 0.0]
        words += [c.gamma_perp, c.exponent, c.exponent_perp, c.cutoff] if extended else [c.cutoff]
        lines.append("pair_coeff " + " ".join(repr(word) if isinstance(word, float) else str(word) for word in words))
    return style, lines


_SCENES = (("dpd", PLAIN, "ortho tilted"), ("dpd_ext", EXTENDED, "ortho tilted narrow none"))
LAMMPS_SCENES = {f"{style}-{box}": (table, box) for style, table, boxes in _SCENES for box in boxes.split()}


@pytest.fixture(scope="module")
def lammps_results():
    """Total force of each scene, its energy, and the force without friction."""
    if NO_LAMMPS:
        pytest.skip(NO_LAMMPS)
    results = {}
    for name, (table, box) in LAMMPS_SCENES.items():
        scene = fluid(table, BOXES[box], n=150 if box != "narrow" else 60, kT=0.0, spread=0, seed=17)
        masses = [scene.masses[t] for t in scene.type_names]
        calls = [
            lammps_peer.lammps_forces(scene.positions, scene.type_ids, masses, v, scene.box, *lammps_commands(scene))
            for v in (scene.velocities, 0 * scene.velocities)
        ]
        results[name] = scene, calls[0].forces, calls[1].forces, calls[0].pe
    return results


@CONSERVATIVE
@pytest.mark.parametrize(
    ("device", "name"),
    [(d, name) for d in DEVICES for name in LAMMPS_SCENES if d.exact or name in ("dpd-ortho", "dpd_ext-tilted")],
    **DEVICE_IDS,
)
def test_forces_equal_lammps(lammps_results, device, name, conservative):
    """Relative RMS 1e-9 on Reference, 1e-5 on CPU and in the GPU precisions; the dissipative part alone, as a difference, likewise."""
    scene, total, resting, energy = lammps_results[name]
    terms = terms_of(scene, device, conservative)
    limit = 1e-9 if device.platform == "Reference" else 1e-5
    assert set(terms) == {"conservative", "dissipative", "random"}
    assert not terms["random"].any()
    assert relative_rms(terms["conservative"] + terms["dissipative"], total) < limit
    assert relative_rms(terms["conservative"], resting) < limit
    assert relative_rms(terms["dissipative"], total - resting) < 1e-9
    expected = oracle.conservative(scene.positions, scene.type_ids, oracle_params(scene), scene.box).energy
    assert expected == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("shift", [1e3, 1e6])
def test_beads_many_boxes_away(device, shift):
    """A data file may hold beads that diffused a thousand boxes away; they interact all the same, to the rounding of their coordinates."""
    scene = beads()
    moved = scene.positions + np.random.default_rng(3).integers(-1, 2, (81, 3)) * shift * 3
    rounding = 3 * shift * device.choose(2.2e-16, 2.2e-16, 1.2e-7)
    if rounding > 1e-3:
        pytest.skip(f"coordinates of {3 * shift:g} are known to {rounding:.0e} only in single precision")
    terms = terms_of(scene, device, "kernel"), terms_of(beads(positions=moved), device, "kernel")
    assert relative_rms(terms[1]["conservative"], terms[0]["conservative"]) < max(tolerance(device, "kernel"), 30 * rounding)
