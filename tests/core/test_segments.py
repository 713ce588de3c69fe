"""Segmental repulsion in OpenMM: every platform, a live LAMMPS, chains that cannot cross, saved Systems, decks, bad input."""

import re

import chains_of_beads as chains
import lammps_peer
import numpy as np
import pytest
from cases import cases, put, raises, refused
from chains_of_beads import OVERLAY
from openmm import unit
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.base.names import BONDED_GROUP, SEGMENT_GROUP
from openmm_dpd.lammps import read_deck
from openmm_dpd.lammps.styles.srp import srp_settings

LAMMPS = lammps_peer.needed()
BOX = np.array([[6.2, 0, 0], [1.3, 5.9, 0], [-1.1, 1.7, 6.4]])
DISTANCE = pytest.mark.parametrize("distance", ["mid", "min"])


def melt(distance="mid", *, spread=1, seed=5, table=None, bonds=None, **options) -> dpd.Scene:
    """Twenty chains of six in a tilted box."""
    x, pairs, _ = chains.walks(20, 6, BOX, seed, step=0.8, spread=spread)
    segments = dpd.SegmentalRepulsion(A=80, cutoff=0.9, distance=distance, bonds=bonds)
    table = table or {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    return beads(len(x), positions=x, table=table, box=BOX, bonds=[dpd.HarmonicBonds(pairs, 100, 0.8)], segments=segments, **options)


def segment_state(context):
    state = context.getState(energy=True, forces=True, groups={SEGMENT_GROUP})
    force = state.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
    return state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole), force


@DISTANCE
def test_energy_and_forces_on_every_platform(device, distance):
    """Beads in other images of a tilted box; the force of the same kernel on Reference is checked against finite differences elsewhere."""
    scene = melt(distance)
    simulation = dpd.build(scene, dt=0.01, platform=device.platform, seed=1, loop=False).simulation(properties=device.properties)
    energy, force = segment_state(simulation.context)
    expected = chains.segment_energy(scene.positions, scene.segment_pairs, BOX, 80.0, 0.9, distance)
    assert energy == pytest.approx(expected, rel=device.choose(1e-11, 1e-5, 1e-5))
    reference = dpd.build(scene, dt=0.01, platform="Reference", seed=1, loop=False).simulation()
    np.testing.assert_allclose(force, segment_state(reference.context)[1], atol=device.choose(1e-11, 1e-4, 1e-4) * np.abs(force).max())
    simulation.step(30)  # beads leave the box, GPU platforms fold them back
    x = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    expected = chains.segment_energy(x, scene.segment_pairs, BOX, 80.0, 0.9, distance)
    assert segment_state(simulation.context)[0] == pytest.approx(expected, rel=device.choose(1e-11, 1e-4, 1e-4))


def crossed(segments, distance="mid") -> dpd.Scene:
    """A chain along x and one along y, 1.2 apart and on their way through each other; no friction, no noise, soft beads."""
    n, half = 6, 2.5
    x = np.full((2 * n, 3), 6.0)
    x[:n, 0] += 0.8 * (np.arange(n) - half)
    x[n:, 1] += 0.8 * (np.arange(n) - half)
    x[:n, 2] += 0.6
    x[n:, 2] -= 0.6
    v = np.zeros((2 * n, 3))
    v[:n, 2], v[n:, 2] = -1.0, 1.0
    pairs = np.array([(c * n + k, c * n + k + 1) for c in range(2) for k in range(n - 1)])
    bonded = {"bonds": [dpd.HarmonicBonds(pairs, 100, 0.8)]}
    bonded["segments"] = dpd.SegmentalRepulsion(100.0, 0.8, distance) if segments else None
    return beads(2 * n, positions=x, velocities=v, edge=12.0, table={("W", "W"): dpd.DPD(A=4.0)}, kT=0.0, **bonded)


def gap(simulation) -> float:
    z = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)[:, 2]
    return float(z[[2, 3]].mean() - z[[8, 9]].mean())


@pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle", "aboba", "bababo"])
def test_chains_cross_without_and_not_with_segmental_repulsion(scheme):
    gaps = {}
    for segments in (None, "mid", "min"):
        simulation = dpd.build(crossed(segments is not None, segments or "mid"), dt=0.005, scheme=scheme, platform="Reference").simulation()
        seen = []
        for _ in range(40):
            simulation.step(10)
            seen.append(gap(simulation))
        gaps[segments] = np.array(seen)
    assert gaps[None][-1] < -1.0  # through
    for distance in ("mid", "min"):
        assert gaps[distance].min() > 0.1 and gaps[distance][-1] > 0.8  # bounced


@DISTANCE
@pytest.mark.parametrize("scheme", ["mvv", "aboba"])
def test_energy_is_conserved(distance, scheme):
    """Drift over a collision falls with the square of the step: the forces belong to the energy."""
    drifts = []
    for dt in (0.004, 0.002):
        built = dpd.build(crossed(True, distance), dt=dt, scheme=scheme, platform="Reference")
        simulation, observer = built.simulation(), dpd.Observer(built)
        totals = [observer.sample(simulation.context).total]
        for _ in range(40):
            simulation.step(round(0.04 / dt))
            totals.append(observer.sample(simulation.context).total)
        drifts.append(np.ptp(totals))
    assert drifts[1] < 0.4 * drifts[0] and drifts[1] < 2e-3 * totals[0]


def test_some_bonds_only_and_what_is_measured():
    """Segments need not be bonds of the scene, nor all of them."""
    scene = melt(bonds=np.array([(0, 1), (6, 7), (7, 8), (30, 31)]))
    energy, force = segment_state(dpd.build(scene, dt=0.01, platform="Reference").simulation().context)
    assert energy == pytest.approx(chains.segment_energy(scene.positions, scene.segments.bonds, BOX, 80.0, 0.9, "mid"), rel=1e-12)
    assert not force[[2, 3, 20, 50]].any()
    built = dpd.build(melt(), dt=0.01, platform="Reference", seed=1)
    observer, simulation = dpd.Observer(built), built.simulation()
    sample = observer.sample(simulation.context)
    alone = segment_state(dpd.build(melt(table={("W", "W"): dpd.NONE}), dt=0.01, platform="Reference").simulation().context)[0]
    assert sample.pair > alone > 100
    assert "segmental repulsion" in observer.no_laplacian and sample.laplacian is None
    assert "segmental repulsion between the midpoints of 100 bonds: A = 80, cutoff 0.9 nm" in built.explain()


def test_beside_a_repulsion_that_depends_on_temperatures():
    """A sample of an EDPD scene, whose pair force is evaluated anew, has bonds, angles and segments in energy and forces."""
    table, n = {("W", "W"): dpd.EDPD(A=18.75, gamma=4.5, kappa=1e-3)}, 120
    inside = dpd.BeadTemperatures(np.linspace(0.8, 1.2, n), 100.0)
    plain = melt(table=table, internal=inside, velocities=np.zeros((n, 3)), angles=[dpd.CosineAngles([(0, 1, 2)], 3.0)])
    empty = beads(n, positions=plain.positions, table=table, box=BOX, internal=inside, velocities=np.zeros((n, 3)))
    samples, contexts = [], []
    for scene in (empty, plain):
        built = dpd.build(scene, dt=0.01, scheme="mvv", platform="CPU", seed=3, loop=False)
        contexts.append(built.simulation().context)
        samples.append(dpd.Observer(built).sample(contexts[-1]))
    energy, force = segment_state(contexts[1])
    bonded = contexts[1].getState(forces=True, groups={BONDED_GROUP}).getForces(asNumpy=True)._value
    assert samples[1].pair - samples[0].pair == pytest.approx(energy, rel=1e-10)
    np.testing.assert_allclose(samples[1].forces - samples[0].forces, force + bonded, atol=1e-9)


# -- decks ---------------------------------------------------------------------------------------------------------------------
def ours(folder, text, compat="consistent"):
    built = dpd.build(chains.scene_of(folder, text, compat), dt=0.01, platform="Reference", seed=1)
    terms = dpd.force_terms(built)
    return dpd.Observer(built).sample(built.simulation().context), terms["bond"] + terms["conservative"]


CASES = {
    "mid": ("hybrid/overlay dpd 0.0 1.0 33 srp 0.9 * mid", OVERLAY),
    "one type": ("hybrid/overlay dpd 0.0 1.0 33 srp 0.9 2 mid exclude yes", OVERLAY),
    "exclude no": ("hybrid/overlay dpd 0.0 1.0 33 srp 0.5 * mid exclude no bptype 2", OVERLAY + " 0.9"),
    "min": ("hybrid/overlay dpd 0.0 1.0 33 srp 0.9 1 min", OVERLAY),
    "min, all": ("hybrid/overlay dpd 0.0 1.0 33 srp 0.9 * min exclude yes", OVERLAY),
    "hybrid": ("hybrid dpd 0.0 1.0 33 srp 0.9 * mid", OVERLAY),
}


@LAMMPS
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("box", [np.diag([6.2, 5.9, 6.4]), BOX], ids=["orthogonal", "tilted"])
def test_decks_against_lammps(tmp_path, name, box):
    """Energies, forces and pressure to 1e-9; the distance min with LAMMPS's points and a list of LAMMPS's that reaches far enough."""
    text = chains.segment_deck(tmp_path, *CASES[name], box=box)
    expected, forces = chains.theirs(tmp_path, text)
    forces = forces[:120]  # then come the placeholders of the bonds
    sample, force = ours(tmp_path, text, compat="lammps")
    np.testing.assert_allclose(force, forces, atol=1e-9 * np.abs(forces).max(), rtol=0)
    found = {"pe": sample.potential, "ebond": sample.bond, "eangle": sample.angle, "evdwl": sample.pair}
    found["press"] = (2 * sample.kinetic + sample.virial_conservative) / (3 * sample.volume)
    for word, value in found.items():
        assert value == pytest.approx(expected[word], rel=1e-9), word
    if "min" in name:
        assert ours(tmp_path, text)[0].pair > 1.0001 * expected["evdwl"]  # the nearest points repel more


def test_notes_of_a_deck(tmp_path):
    """Thermo output is not divided by the number of beads; the distance min has other points than LAMMPS's unless they are asked for."""
    text = chains.segment_deck(tmp_path, *CASES["min"], box=BOX)
    for compat in ("consistent", "lammps"):
        state = read_deck(put(tmp_path / "in.ours", text + "run 0\n"), stop_before_first_run=True, output=tmp_path)
        state.first_run.override(compat=compat).scene()
        assert state.thermo.norm is False and any("thermo output is not normalised" in note for note in state.notes)
        assert any("the nearest points of two bonds are used" in note for note in state.notes) == (compat == "consistent")


def test_settings_of_the_style():
    found = srp_settings("0.8 2 min exclude yes bptype 3".split())
    assert found == {"cutoff": 0.8, "bond_type": 2, "distance": "min", "exclude": True, "bptype": 3}
    expected = {"cutoff": 0.8, "bond_type": None, "distance": "mid", "exclude": False, "bptype": None}
    assert srp_settings("0.8 * mid exclude no".split()) == expected


SRP = "hybrid/overlay dpd 1 1 3 srp "
MID = SRP + "0.8 * mid"
SWAPPED = "pair_coeff 1 1 srp 80\npair_coeff 2 2 dpd 25 4.5\npair_coeff 1 2 none"
DECK_ERRORS = {
    "alone": ("srp 0.8 * mid", "pair_coeff 2 2 80", "in.ours:12: pair style srp acts between bonds; use it in pair_style hybrid"),
    "words": (SRP + "0.8 *", OVERLAY, "expected 'srp cutoff bond-type|* mid|min"),
    "distance": (SRP + "0.8 * max", OVERLAY, "pair style 'max' is not supported"),
    "exclude": (SRP + "0.8 * min exclude no", OVERLAY, "'exclude no' requires the distance mid"),
    "bond type": (SRP + "0.8 3 mid", OVERLAY, "in.ours:12: pair style srp: bond type 3 is out of range: there are 2"),
    "bptype": (SRP + "0.8 * mid bptype 3", OVERLAY, "bptype 3 is out of range: there are 2 atom types"),
    "beads of the type": (SRP + "0.8 * mid bptype 1", SWAPPED, "120 beads have it"),
    "not none": (MID, "pair_coeff * * dpd 25 4.5\npair_coeff 2 2 srp 80", "types 1 2 have dpd coefficients; set them to none"),
    "other types": (MID, OVERLAY + "\npair_coeff 1 2 srp 80", "coefficients for types 1 2; give them for 2 2"),
    "no coefficient": (MID, "pair_coeff 1 1 dpd 25 4.5\npair_coeff * 2 none", "style srp is used by no type pair"),
    "negative": (MID, OVERLAY.replace("80", "-80"), "in.ours:15: A must be >= 0, but is -80"),
    "no fix": (
        SRP[:-1] + "/react 0.8 * mid f",
        OVERLAY.replace("srp", "srp/react"),
        "there is no fix bond/create or bond/break with the name f",
    ),
    "no name": (SRP[:-1] + "/react 0.8 * mid", OVERLAY.replace("srp", "srp/react"), "expected 'srp/react cutoff bond-type|* mid|min fix"),
    "twice": (SRP + "0.8 * mid srp 0.9 * mid", OVERLAY.replace("srp", "srp 1") + "\npair_coeff 2 2 srp 2 80", "it can be used only once"),
}


@cases("pair, coefficients, message", DECK_ERRORS)
def test_errors_of_decks(tmp_path, pair, coefficients, message):
    deck = chains.segment_deck(tmp_path, pair, coefficients, box=BOX)
    raises(dpd.DeckError, re.escape(message), ours, tmp_path, deck)


S = dpd.SegmentalRepulsion
BAD = {
    "negative A": (lambda: S(-1.0), "A of the segmental repulsion must be >= 0, but is -1"),
    "no cutoff": (lambda: S(1.0, 0.0), "cutoff of the segmental repulsion must be > 0"),
    "an array": (lambda: S([1.0, 2.0]), "A of the segmental repulsion must be a single number"),
    "unit": (lambda: S(1 * unit.nanometer), "A of the segmental repulsion has the unit nanometer, which is no force"),
    "distance": (lambda: S(1.0, 1.0, "nearest"), "must be one of mid, min, not 'nearest'"),
    "sharing": (lambda: S(1.0, 1.0, "min", exclude_adjoining=False), "they must be left out"),
    "truth": (lambda: S(1.0, exclude_adjoining="no"), "must be True or False, not 'no'"),
    "triples": (lambda: S(1.0, bonds=[(0, 1, 2)]), r"segments must be an integer array of shape \(K, 2\)"),
    "twice": (lambda: S(1.0, bonds=[(0, 1), (1, 0)]), "the segment between beads 0 and 1 .counted from 0. is listed twice"),
    "no bonds": (lambda: beads(4, segments=S(1.0)), "acts between bonds, but there are none; list them in `bonds`"),
    "missing bead": (lambda: beads(4, segments=S(1.0, bonds=[(0, 4)])), "a segment names bead 4, but there are only 4 beads"),
    "something else": (lambda: beads(4, segments={"A": 1}), "segments must be a SegmentalRepulsion"),
    "box": (lambda: beads(4, segments=S(1.0, 1.6, bonds=[(0, 1)])), "1.6 nm which is over half the box, whose smallest width is 3 nm"),
}


test_bad_input = refused(dpd.ParameterError, BAD)


def test_a_box_too_small_for_the_nearest_points():
    x = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1, 1], [0.2, 1, 1]]) + 1.0
    bonded = {"positions": x, "bonds": [dpd.HarmonicBonds([(0, 1), (2, 3)], 1, 1)], "edge": 3.0}
    beads(4, **bonded, segments=S(1.0, 0.5, "min"))
    message = "reaches 0.6 nm, with bonds of up to 1 nm, which is over half the box"
    raises(dpd.ParameterError, message, beads, 4, **bonded, segments=S(1.0, 0.6, "min"))
