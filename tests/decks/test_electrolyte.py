"""Charged beads beside LAMMPS: one configuration with its Ewald sum, and the electrolyte deck (electrolyte_reference.json)."""

import json
from pathlib import Path

import numpy as np
import pytest
from fluid_deck import IONS
from judged import any_seed, judge
from lammps_peer import instance, need

import openmm_dpd as dpd
from openmm_dpd.lammps import RunOptions, run_deck

HERE = Path(__file__).parent
DECKS = HERE.parents[1] / "examples" / "decks"
REFERENCE = json.loads((HERE / "electrolyte_reference.json").read_text())

DECK = f"""units lj
atom_style full
comm_modify vel yes
region box block 0 8 0 8 0 8
{IONS}set atom 17 x 0.2 y 5.1 z 4.0
set atom 3 x 4.0 y 4.0 z 4.0
set atom 4 x 4.0 y 4.9 z 4.0
{{styles}}
special_bonds lj 1 1 1 coul {{factor}} 1 1
bond_coeff 1
"""
STYLES = {
    "one": "pair_style dpd/coul/slater/long 0.0 1.0 1 0.25 4.0\npair_coeff * * 25 0\npair_coeff 2 2 25 0 yes",
    "overlay": "pair_style hybrid/overlay dpd 0.0 1.0 1 coul/slater/long 0.25 4.0\npair_coeff * * dpd 25 0\npair_coeff * * coul/slater/long",
}


@pytest.mark.parametrize("factor, styles", [(1.0, ["one", "overlay"]), (0.5, ["overlay"]), (0.0, ["one"])])
def test_one_configuration(factor, styles):
    """Energies, forces and pressure beside LAMMPS's Ewald sum with tight settings; the error function of LAMMPS has 1.5e-7.

    The bonded beads are near each other: LAMMPS applies no factor to pairs beyond the cutoff.
    """
    need()
    bonds, found = [(1, 16), (2, 17), (3, 4)], []
    for style in styles:
        with instance() as lmp:
            lmp.commands_list([line for line in DECK.format(styles=STYLES[style], factor=factor).splitlines() if line.strip()])
            lmp.commands_list([f"create_bonds single/bond 1 {i} {j}" for i, j in bonds])
            lmp.commands_list(["thermo_style custom step pe evdwl ecoul elong press", "thermo_modify norm no", "run 0 post no"])
            theirs = {word: lmp.get_thermo(word) for word in ("pe", "ecoul", "elong", "evdwl", "press")}
            kinds = (("x", 1, 3), ("f", 1, 3), ("q", 1, 1), ("type", 0, 1))
            found.append((theirs, *(np.array(lmp.gather_atoms(name, kind, count)) for name, kind, count in kinds)))
    _, x, _, q, types = found[0]
    n = len(q)
    exact = {"cutoff": 4.0, "tolerance": 1e-7, "bonded_factors": (factor, 1.0, 1.0)}
    clouds = dpd.SlaterCharges(lamda=0.25, permittivity=0.5 * dpd.units.COULOMB, **exact)
    charged = {"charges": q, "bonds": [dpd.HarmonicBonds(np.array(bonds) - 1, 0.0, 0.0)], "electrostatics": clouds}
    beads = ({"1": 1.0, "2": 1.0}, [str(k) for k in types], x.reshape(n, 3), {("*", "*"): dpd.DPD(A=25.0, gamma=0.0)})
    scene = dpd.Scene(*beads, kT=0.0, box=[8.0] * 3, velocities=np.zeros((n, 3)), **charged)
    built = dpd.build(scene, dt=0.01, platform="Reference", scheme="mvv")
    context = built.simulation().context
    sample, total = dpd.Observer(built).sample(context), context.getState(forces=True).getForces(asNumpy=True)._value
    for theirs, places, forces, _, _ in found:
        assert np.array_equal(places, x)
        assert sample.coulomb_real + sample.coulomb_reciprocal == pytest.approx(theirs["ecoul"] + theirs["elong"], rel=2e-6)
        assert sample.pair == pytest.approx(theirs["pe"], rel=1e-6)
        np.testing.assert_allclose(total, forces.reshape(n, 3), atol=1e-6 * np.sqrt(np.mean(forces**2)) * 10)
        assert sample.pressure() == pytest.approx(theirs["press"], rel=2e-6)


def test_first_row_of_the_deck(tmp_path):
    """Real-space part and lattice sum one by one, as the deck sets the splitting parameter."""
    thermo = run_deck(DECKS / "in.electrolyte", RunOptions(threads=1, platform="Reference", steps=0), out=tmp_path)["runs"][0]["thermo"]
    first = REFERENCE["first"]
    assert thermo["evdwl"]["first"] == pytest.approx(first["evdwl"], rel=1e-9)
    # relative to the sum of the energies of the single ions: 1e-5 is the accuracy the deck asks for
    for word in ("ecoul", "elong", "v_coulomb"):
        assert thermo[word]["first"] == pytest.approx(first[word], abs=1e-5 * 44 / 0.25)


@pytest.mark.slow
@any_seed(1)
def test_electrolyte(tmp_path, seed):
    """T, P and the energy of the charges within four standard errors of LAMMPS's."""
    variables = {"nequil": "1000", "nrun": "10000", "every": "20"}
    report = run_deck(DECKS / "in.electrolyte", RunOptions(threads=1, platform="CPU", seed=seed), variables=variables, out=tmp_path)
    found = report["runs"][1]["thermo"]
    z = {}
    for word in ("temp", "press", "v_coulomb", "evdwl"):
        theirs = REFERENCE["production"][word]
        z[word] = (found[word]["mean"] - theirs["mean"]) / np.hypot(found[word]["sem"], theirs["sem"])
    print(z)
    assert max(map(abs, z.values())) < 4, z


@pytest.mark.slow
@pytest.mark.long
@any_seed(5)
@pytest.mark.parametrize("device", ["CPU"])
def test_ion_pairs_do_not_collapse(device, seed):
    """Strong coupling (Bjerrum length 6): the temperature holds, and energies stay above those of ions inside each other."""
    n, edge, ions = 192, 4.0, 20
    rng = np.random.default_rng(4)
    q = np.zeros(n)
    q[:ions], q[ions : 2 * ions] = 1.0, -1.0
    charges = {"charges": q, "electrostatics": dpd.SlaterCharges(lamda=0.25, bjerrum_length=6.0, cutoff=2.0)}
    table = {("W", "W"): dpd.DPD(A=25.0, gamma=4.5)}
    scene = dpd.Scene({"W": 1.0}, ["W"] * n, rng.random((n, 3)) * edge, table, kT=1.0, box=[edge] * 3, **charges)
    built = dpd.build(scene, dt=0.01, platform=device, seed=seed)
    simulation, observer = built.simulation(), dpd.Observer(built)
    simulation.step(1000)
    kT, energy = [], []
    for _ in range(100):
        simulation.step(20)
        sample = observer.sample(simulation.context)
        kT.append(sample.kT)
        energy.append(sample.coulomb_real + sample.coulomb_reciprocal)
    judge(kT, 1.0, error=0.01, beside=0.01)
    assert min(energy) > -6.0 * ions / 0.25 * 1.2 and max(energy) < 0  # no lower than every ion in the middle of an opposite one
