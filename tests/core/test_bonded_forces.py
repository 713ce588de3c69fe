"""Bonds and angles in OpenMM: on every platform against plain numpy, beside a live LAMMPS, and what happens when a FENE bond breaks."""

import chains_of_beads as chains
import lammps_peer
import numpy as np
import openmm
import pytest
from cases import put, raises
from openmm import unit
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.base.names import BONDED_GROUP
from openmm_dpd.lammps import RunOptions, read_deck, run_deck

LAMMPS = lammps_peer.needed()
BOX = np.array([[6.2, 0, 0], [1.3, 5.9, 0], [-1.1, 1.7, 6.4]])
KINDS = {
    1: lambda p: dpd.HarmonicBonds(p, 20, 0.7),
    2: lambda p: dpd.FENEBonds(p, 30, 1.5, 0.8, 0.9),
    3: lambda p: dpd.MorseBonds(p, 12, 1.7, 0.6),
}


def scene(table=None, **options) -> dpd.Scene:
    """Twelve chains of six with bonds of three kinds and angles of two, beads strewn over images of a tilted box."""
    x, bonds, angles = chains.walks(12, 6, BOX, 5)
    angles = [dpd.HarmonicAngles(angles[::2], 6, 110 * unit.degree), dpd.CosineAngles(angles[1::2], 4)]
    bonded = {"bonds": [KINDS[kind](bonds[kind - 1 :: 3]) for kind in KINDS], "angles": angles}
    return beads(len(x), positions=x, table=table or {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, box=BOX, **bonded, **options)


def energy_of(x, bonds, angles) -> float:
    total = 0.0
    for k, (i, j) in enumerate(bonds):
        total += chains.BOND_ENERGY[k % 3 + 1](np.linalg.norm(chains.nearest_image(x[i] - x[j], BOX)))
    for k, (i, j, m) in enumerate(angles):
        a, b = chains.nearest_image(x[i] - x[j], BOX), chains.nearest_image(x[m] - x[j], BOX)
        total += chains.ANGLE_ENERGY[k % 2 + 1](np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)))
    return total


def test_forces_and_energy_on_every_platform(device):
    """Forces are the gradient of the energy in plain numpy."""
    made = scene()
    _, bonds, angles = chains.walks(12, 6, BOX, 5)
    built = dpd.build(made, dt=0.01, platform=device.platform, seed=1, loop=False)
    force = dpd.force_terms(built, properties=device.properties)["bond"]
    x, h = made.positions, 1e-5
    for bead in (0, 7, 20, 71):
        for axis in range(3):
            step = np.zeros_like(x)
            step[bead, axis] = h
            expected = -(energy_of(x + step, bonds, angles) - energy_of(x - step, bonds, angles)) / (2 * h)
            assert force[bead, axis] == pytest.approx(expected, abs=device.choose(3e-6, 3e-4, 3e-4) * np.abs(force).max())
    simulation = built.simulation(properties=device.properties)
    energy = simulation.context.getState(energy=True, groups={BONDED_GROUP}).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
    assert energy == pytest.approx(energy_of(x, bonds, angles), rel=device.choose(1e-10, 1e-5, 1e-5))
    sample = dpd.Observer(built).sample(simulation.context)
    assert sample.bond + sample.angle == pytest.approx(energy_of(x, bonds, angles), rel=device.choose(1e-12, 1e-5, 1e-5))
    assert sample.potential == pytest.approx(sample.pair + sample.bond + sample.angle)


DECK = chains.DECK + "pair_coeff 1 1 25.0 4.5\nvelocity all set 0 0 0\nfix 1 all nve\n"


@LAMMPS
@pytest.mark.parametrize("box", [np.diag([6.2, 5.9, 6.4]), BOX], ids=["orthogonal", "tilted"])
def test_against_lammps(tmp_path, box, device):
    """Energies, forces and pressure of one configuration with all styles: 1e-9 in double precision, 1e-5 elsewhere."""
    x, bonds, angles = chains.walks(12, 6, box, 6)
    (tmp_path / "data.chains").write_text(chains.data_file(x, bonds, angles, box))
    expected, forces = chains.theirs(tmp_path, DECK)
    made = read_deck(put(tmp_path / "in.chains", DECK + "run 0\n"), stop_before_first_run=True, output=tmp_path).first_run.scene()
    built = dpd.build(made, dt=0.01, platform=device.platform, seed=1)
    terms = dpd.force_terms(built, properties=device.properties)
    tolerance = 1e-9 if device.platform == "Reference" else 1e-5
    np.testing.assert_allclose(terms["bond"] + terms["conservative"], forces, atol=tolerance * np.abs(forces).max(), rtol=0)
    sample = dpd.Observer(built).sample(built.simulation(properties=device.properties).context)
    found = {"pe": sample.potential, "ebond": sample.bond, "eangle": sample.angle, "emol": sample.bond + sample.angle}
    found |= {"evdwl": sample.pair, "press": (2 * sample.kinetic + sample.virial_conservative) / (3 * sample.volume)}
    for word, value in expected.items():
        assert found[word] == pytest.approx(value, rel=tolerance), word


@LAMMPS
def test_a_run_prints_what_lammps_prints(tmp_path):
    """Twenty steps without friction and noise, thermo words of bonds and angles."""
    x, bonds, angles = chains.walks(12, 6, BOX, 6)
    (tmp_path / "data.chains").write_text(chains.data_file(x, bonds, angles, BOX))
    text = DECK.replace("25.0 4.5", "25.0 0.0") + "timestep 0.002\nthermo 10\nthermo_style custom step ebond eangle emol pe press\n"
    with lammps_peer.instance() as lmp:
        lmp.command(f"shell cd {tmp_path}")
        lmp.commands_string(text + "thermo_modify norm no\nrun 20\n")
        expected = {word: lmp.get_thermo(word) for word in ("ebond", "eangle", "emol", "pe", "press")}
    deck = tmp_path / "in.chains"
    extra = "compute e all pe bond angle\nvariable e equal c_e\nthermo_style custom step ebond eangle emol pe press v_e\n"
    deck.write_text(text + extra + "thermo_modify norm no\nrun 20\n")
    report = run_deck(deck, RunOptions(platform="Reference", threads=1), out=tmp_path / "out")
    rows = {word: values["last"] for word, values in report["runs"][0]["thermo"].items()}
    for word, value in expected.items():
        assert rows[word] == pytest.approx(value, rel=1e-8), word
    assert rows["v_e"] == pytest.approx(expected["emol"], rel=1e-8)


@pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle", "aboba", "bababo"])
@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
def test_a_fene_bond_that_breaks_stops_the_run(scheme, conservative):
    """Two beads fly apart: the run ends with the names of the beads before anything is NaN."""
    v = np.vstack([[-40.0, 0, 0], [40.0, 0, 0], np.zeros((18, 3))])
    x = np.vstack([[2.0, 2, 2], [2.8, 2, 2], np.random.default_rng(1).random((18, 3)) * 5])
    made = beads(20, edge=5.0, velocities=v, positions=x, bonds=[dpd.FENEBonds([(0, 1)], 30, 1.5)])
    simulation = dpd.build(made, dt=0.02, scheme=scheme, conservative=conservative, platform="CPU", seed=1).simulation()
    broken = r"the FENE bond between beads 0 and 1 \(counted from 0\) is .* nm long.*R0 of 1.5 nm; the step size"
    raises(openmm.OpenMMException, broken, lambda: simulation.step(3))


def test_the_deck_says_where_a_fene_bond_is_too_long(tmp_path):
    x, bonds, angles = np.array([[1.0, 1, 1], [2.6, 1, 1]]), np.array([[0, 1]]), np.zeros((0, 3), int)
    (tmp_path / "data.chains").write_text(chains.data_file(x, bonds, angles, np.diag([6.0] * 3), bond_types=1))
    text = "atom_style angle\nbond_style fene\nread_data data.chains\nbond_coeff 1 30 1.5 1 1\n"
    text += "pair_style dpd 1 1 1\npair_coeff * * 25 4.5\n"
    deck = put(tmp_path / "in.chains", text + "fix 1 all nve\nrun 10\n")
    long = r"in.chains:8: the FENE bond between beads 1 and 2 is 1.6 long, which is not less than its R0 of 1.5; move"
    raises(dpd.DeckError, long, lambda: run_deck(deck, RunOptions(platform="Reference"), out=tmp_path / "out"))


def test_explain_counts_them():
    text = dpd.explain_plan(dpd.make_plan(scene(), dt=0.01, seed=1))
    assert "20 harmonic bonds, 20 FENE bonds, 20 Morse bonds" in text and "24 harmonic angles" in text and "24 cosine angles" in text
