"""Dihedrals and impropers: finite differences, OpenMM's own torsions, a live LAMMPS, decks, export, and bad input."""

from __future__ import annotations

import re
from dataclasses import replace

import chains_of_beads as chains
import lammps_peer
import numpy as np
import openmm
import pytest
from cases import put, refused
from scenes import beads, stepped

import openmm_dpd as dpd
from openmm_dpd.advice.recommend import advice
from openmm_dpd.inputs import scene_from_lammps_data
from openmm_dpd.lammps import RunOptions, deck_scene, export_lammps, run_deck
from openmm_dpd.measure.stress_parts import stress_parts, torsion_sums
from openmm_dpd.model.bonds import bonded_neighbours
from openmm_dpd.molecules import Bend, Spring, Twist, linear, pack
from openmm_dpd.trajectory import read_psf

NO_LAMMPS = lammps_peer.why_missing()
BOX = np.array([[6.2, 0, 0], [1.3, 5.9, 0], [-1.1, 1.7, 6.4]])


def umbrella(k: float, rest: float):
    """By the plane through the first three beads, as LAMMPS's manual has it; to the side of the other two the angle is over pi/2."""

    def energy(x, quad, box) -> float:
        a, b, h = (d / np.linalg.norm(d) for d in (chains.nearest_image(x[bead] - x[quad[0]], box) for bead in quad[1:]))
        normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
        cosine = np.sqrt(1 - (normal @ h) ** 2) * (-1 if h @ (a + b) > 0 else 1)
        least = np.cos(np.radians(rest))
        return k * (1 - cosine) if rest == 0 else 0.5 * k / (1 - least**2) * (cosine - least) ** 2

    return energy


def of_angle(formula):
    return lambda x, quad, box: formula(angle(x, quad, box))


#: LAMMPS's words, and the same as formulas of phi.
OF_PHI = {
    1: ("harmonic 3.0 -1 2", lambda phi: 3.0 * (1 - np.cos(2 * phi))),
    2: (
        "opls 1.0 -2.0 3.0 0.7",
        lambda p: 0.5 * (1 + np.cos(p) - 2 * (1 - np.cos(2 * p)) + 3 * (1 + np.cos(3 * p)) + 0.7 * (1 - np.cos(4 * p))),
    ),
    3: ("multi/harmonic 1.0 2.0 -1.5 0.5 0.3", lambda p: sum(a * np.cos(p) ** k for k, a in enumerate((1.0, 2.0, -1.5, 0.5, 0.3)))),
}
#: For dihedrals and impropers: LAMMPS's words, the same as formulas of positions, and classes with their coefficients.
STYLES = {
    "dihedral": {kind: (words, of_angle(formula)) for kind, (words, formula) in OF_PHI.items()},
    "improper": {
        1: ("harmonic 3.0 70", of_angle(lambda phi: 3.0 * (phi - np.radians(70)) ** 2)),
        2: ("cvff 2.0 -1 3", of_angle(lambda phi: 2.0 * (1 - np.cos(3 * phi)))),
        3: ("umbrella 5.0 40", umbrella(5.0, 40.0)),
        4: ("umbrella 4.0 0", umbrella(4.0, 0.0)),
    },
}
CLASSES = {
    "dihedral": [
        (dpd.HarmonicDihedrals, 3.0, -1, 2),
        (dpd.OPLSDihedrals, 1.0, -2.0, 3.0, 0.7),
        (dpd.MultiHarmonicDihedrals, 1.0, 2.0, -1.5, 0.5, 0.3),
    ],
    "improper": [
        (dpd.HarmonicImpropers, 3.0, np.radians(70)),
        (dpd.CosineImpropers, 2.0, -1, 3),
        (dpd.UmbrellaImpropers, 5.0, np.radians(40)),
        (dpd.UmbrellaImpropers, 4.0, 0.0),
    ],
}
BOTH = pytest.mark.parametrize("what", STYLES)


def walk(seed=6, box=BOX):
    """Positions, bonds, angles and dihedrals of twelve chains of six."""
    x, bonds, angles = chains.walks(12, 6, box, seed)
    return x, bonds, angles, np.array([[6 * c + k + m for m in range(4)] for c in range(12) for k in range(3)])


def made(what, quads):
    """Dihedrals or impropers of all kinds in turn."""
    return [kind(quads[k :: len(CLASSES[what])], *values) for k, (kind, *values) in enumerate(CLASSES[what])]


def scene(what="dihedral", **options) -> dpd.Scene:
    x, bonds, _, quads = walk()
    table = {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    bonds = [dpd.HarmonicBonds(bonds, 30, 0.9)]
    return beads(len(x), positions=x, table=table, box=BOX, bonds=bonds, **{f"{what}s": made(what, quads)}, **options)


def angle(x, quad, box=BOX) -> float:
    """By projection: the angle between the outer bonds seen along the middle one."""
    i, j, k, m = (x[bead] for bead in quad)
    f, g, h = (chains.nearest_image(d, box) for d in (i - j, k - j, m - k))
    g = g / np.linalg.norm(g)
    u, w = f - (f @ g) * g, h - (h @ g) * g
    return float(np.arccos(np.clip(u @ w / np.linalg.norm(u) / np.linalg.norm(w), -1, 1)))


def energy_of(what, x, quads, box=BOX) -> float:
    return float(sum(STYLES[what][k % len(STYLES[what]) + 1][1](x, quad, box) for k, quad in enumerate(quads)))


@BOTH
@pytest.mark.parametrize("loop", [True, False])
def test_forces_are_the_gradient(what, loop):
    x, _, _, quads = walk()
    built = dpd.build(scene(what), dt=0.005, platform="Reference", conservative="kernel", seed=1, loop=loop)
    without = dpd.build(replace(scene(), dihedrals=(), impropers=()), dt=0.005, platform="Reference", seed=1)
    force = dpd.force_terms(built)["bond"] - dpd.force_terms(without)["bond"]
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-10)
    h = 1e-5
    for bead, axis in ((0, 0), (1, 1), (8, 2), (15, 0), (40, 1), (71, 2)):
        step = np.zeros_like(x)
        step[bead, axis] = h
        slope = (energy_of(what, x + step, quads) - energy_of(what, x - step, quads)) / (2 * h)
        assert force[bead, axis] == pytest.approx(-slope, rel=1e-5, abs=1e-5)


@BOTH
@pytest.mark.parametrize("scheme", ["middle", "mvv"])
def test_loop_and_program_go_the_same_way(what, scheme):
    ends = []
    for loop in (True, False):
        built = dpd.build(scene(what), dt=0.005, scheme=scheme, platform="Reference", conservative="kernel", seed=1, loop=loop)
        simulation = stepped(built.simulation(), 20)
        ends.append(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-12)


@BOTH
def test_they_are_measured(what):
    """Energy, stress (its trace is 0) and Laplacian."""
    beads_, h = scene(what), 1e-4
    groups = made(what, walk()[3])
    x, _, _, quads = walk()
    mobile = np.ones(len(x), bool)
    mobile[3] = False
    energy, laplacian = torsion_sums(groups, x, BOX, mobile)
    assert energy == pytest.approx(energy_of(what, x, quads), rel=1e-12)
    built = dpd.build(beads_, dt=0.005, platform="Reference", seed=1)
    sample = dpd.Observer(built).sample(built.simulation().context)
    assert getattr(sample, what) == sample.dihedral + sample.improper == energy
    assert sample.potential == pytest.approx(sample.pair + sample.bond + energy, rel=1e-14)
    second = 0.0
    for bead, axis in np.ndindex(x.shape):
        if mobile[bead]:
            step = np.zeros_like(x)
            step[bead, axis] = h
            second += sum(torsion_sums(groups, x + s, BOX, mobile)[0] for s in (step, -step)) - 2 * energy
    assert laplacian == pytest.approx(second / h**2, rel=1e-5)
    alone = dpd.make_plan(beads(len(x), positions=x, box=BOX, **{f"{what}s": groups}), dt=0.005, seed=1)
    stress = sum(part(x, BOX) for part in stress_parts(alone))
    assert abs(stress[:3].sum()) < 1e-10 * np.abs(stress).max()
    for component, (a, b) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
        ends = []
        for size in (1e-5, -1e-5):
            strain = np.eye(3)
            strain[b, a] += size  # keeps box vectors lower triangular
            ends.append(torsion_sums(groups, x @ strain, BOX @ strain, mobile)[0])
        assert stress[component] == pytest.approx(-(ends[0] - ends[1]) / 2e-5, rel=1e-5, abs=1e-5)


def data_file(what, x, bonds, angles, quads, box) -> str:
    text = chains.data_file(x, bonds, angles, box, bond_types=1, angle_types=1).replace("Atoms # angle", "Atoms # molecular")
    text = text.replace(" angles\n", f" angles\n{len(quads)} {what}s\n", 1)
    text = text.replace(" angle types\n", f" angle types\n{len(STYLES[what])} {what} types\n", 1)
    rows = [f"{k + 1} {k % len(STYLES[what]) + 1} " + " ".join(str(bead + 1) for bead in quad) for k, quad in enumerate(quads.tolist())]
    return text + "\n".join(["", f"{what.capitalize()}s", "", *rows, ""])


DECKS = {
    what: f"""units lj
atom_style molecular
newton on
special_bonds lj 0 0.5 0.25
comm_modify vel yes cutoff 3.0
bond_style harmonic
angle_style cosine
{what}_style hybrid {" ".join(dict.fromkeys(words.split()[0] for words, _ in styles.values()))}
pair_style dpd 0.0 1.0 33
read_data data.chains
bond_coeff 1 30 0.9
angle_coeff 1 2.0
{chr(10).join(f"{what}_coeff {kind} {text}" for kind, (text, _) in styles.items())}
pair_coeff 1 1 25.0 0.0
velocity all set 0 0 0
fix 1 all nve
timestep 0.002
thermo_modify norm no
compute parts all pe dihedral improper
compute share all pe/atom improper
compute shares all stress/atom NULL improper
compute sums all reduce sum c_share c_shares[*]
compute far all reduce max c_share c_shares[*]
"""
    for what, styles in STYLES.items()
}
WORDS = (
    "pe",
    "ebond",
    "eangle",
    "edihed",
    "eimp",
    "emol",
    "evdwl",
    "press",
    "pxx",
    "pyy",
    "pzz",
    "pxy",
    "pxz",
    "pyz",
    "dihedrals",
    "impropers",
)
COLUMNS = ("c_parts", *(f"c_{name}[{k}]" for name in ("sums", "far") for k in range(1, 8)))


@pytest.mark.skipif(NO_LAMMPS is not None, reason=str(NO_LAMMPS))
@pytest.mark.parametrize("box", [np.diag([6.2, 5.9, 6.4]), BOX], ids=["orthogonal", "tilted"])
@pytest.mark.parametrize("steps", [0, 20])
@BOTH
def test_against_lammps(tmp_path, box, steps, what):
    """Energies, pressure and its tensor with every style; forces at step 0."""
    x, bonds, angles, quads = walk(box=box)
    (tmp_path / "data.chains").write_text(data_file(what, x, bonds, angles, quads, box))
    text = DECKS[what] + f"thermo_style custom step {' '.join((*WORDS, *COLUMNS))}\nthermo_modify norm no format float %.15g\n"
    with lammps_peer.instance() as lmp:
        lmp.command(f"shell cd {tmp_path}")
        lmp.commands_string(text)
        lmp.commands_list(["dump f all custom 1 forces.txt id fx fy fz", "dump_modify f sort id format float %.17g", f"run {steps}"])
        expected = {word: lmp.get_thermo(word) for word in WORDS}
        expected |= {name: value for name, value in lmp.last_thermo().items() if name in COLUMNS}
    deck = put(tmp_path / "in.chains", text + f"run {steps}\n")
    report = run_deck(deck, RunOptions(platform="Reference", threads=1), out=tmp_path / "out")
    rows = {word: values["last"] for word, values in report["runs"][0]["thermo"].items()}
    assert expected["edihed" if what == "dihedral" else "eimp"] != 0
    for word, value in expected.items():
        assert rows[word] == pytest.approx(value, rel=1e-8, abs=1e-8), word
    forces = np.loadtxt(tmp_path / "forces.txt", skiprows=9, max_rows=len(x))[:, 1:]
    terms = dpd.force_terms(dpd.build(deck_scene(deck), dt=0.002, platform="Reference", seed=1))
    np.testing.assert_allclose(terms["bond"] + terms["conservative"], forces, rtol=0, atol=1e-9 * np.abs(forces).max())


@BOTH
def test_decks_and_export(tmp_path, monkeypatch, what):
    """Data files and export keep types, beads and coefficients; bonds alone say which pairs are neighbours."""
    monkeypatch.chdir(tmp_path)
    x, bonds, angles, quads = walk()
    (tmp_path / "data.chains").write_text(data_file(what, x, bonds, angles, quads, BOX))
    deck = put(tmp_path / "in.chains", DECKS[what] + "write_data data.again\nwrite_restart restart.chains\nrun 0\n")
    out = tmp_path / "out"
    run_deck(deck, RunOptions(platform="Reference", threads=1), out=out)
    psf = read_psf(out / "topology.psf")
    assert np.array_equal(np.sort(psf.dihedrals, axis=0), quads) if what == "dihedral" else psf.others == {"impropers": len(quads)}
    assert np.array_equal(np.sort(read_psf(out / "topology.psf").angles, axis=0), angles)
    read = deck_scene(deck)
    own = getattr(read, f"{what}s")
    data = scene_from_lammps_data(out / "data.again", pairs={("*", "*"): dpd.DPD(A=25)}, kT=1)
    settings = re.sub("read_data.*", "", DECKS[what].partition("pair_style")[2]).partition("\n")[2]
    resumed = deck_scene(put(out / "in.resumed", f"read_restart restart.chains\n{settings}run 0\n"))
    for found in (data, resumed):
        for one, other in zip(getattr(found, f"{what}s"), own, strict=True):
            assert type(one) is type(other) and np.array_equal(one.quads, other.quads)
            np.testing.assert_allclose(one.coefficients, other.coefficients, rtol=1e-14)
    assert [type(group) for group in own] == [kind for kind, *_ in CLASSES[what]]
    assert np.array_equal(np.sort(np.concatenate([group.quads for group in own]), axis=0), np.sort(quads, axis=0))
    assert read.bonded_factors == (0.0, 0.5, 0.25)
    factors = dpd.make_plan(read, dt=0.002, seed=1).exceptions
    assert {pair for pair, factor in factors.items() if factor == 0.25} == bonded_neighbours(bonds, len(x))[3]
    export_lammps(read, out, "again", dt=0.002)
    again = deck_scene(out / "in.again")
    for first, second in zip(own, getattr(again, f"{what}s"), strict=True):
        assert type(first) is type(second) and np.array_equal(first.beads, second.beads)
        np.testing.assert_allclose(first.coefficients, second.coefficients, rtol=1e-14)


def test_a_system_with_them_is_read(tmp_path):
    built = dpd.build(scene(), dt=0.005, platform="CPU", seed=1)
    (tmp_path / "system.xml").write_text(openmm.XmlSerializer.serialize(built.system), encoding="utf-8")
    assert dpd.load_xml(tmp_path / "system.xml").getNumForces() == built.system.getNumForces()


def test_they_count_in_steps():
    """The stiffest terms limit the step, whichever they are."""
    found = []
    for k in (0.01, 300):
        chain = linear("A6", Spring(30, 0.9), Bend(20, 1.9), twist=Twist(k, 1, 3))
        mixture = pack({chain: 8}, solvent="W", density=3.0, box=[4.0] * 3, seed=1)
        scene_ = mixture.scene(pairs={("*", "*"): dpd.DPD(A=25, gamma=4.5)}, kT=1)
        found.append(dpd.recommend(scene_))
        text = advice(scene_, "mvv", 0.004)
        assert ("dihedral temperature" in text) == (k > 1), text
    (weak, *_), (stiff, *_) = (one.choices for one in found)
    assert weak.limit != "dihedrals" and stiff.limit == "dihedrals" and stiff.dt < weak.dt / 5
    assert not any("dihedral" in note for one in found for note in one.notes)
    bare = scene()
    why = "no angle keeps the beads 0, 1 and 2 (counted from 0) of a dihedral from a line, where its forces are unbounded"
    assert dpd.recommend(bare).scheme is None and why in dpd.recommend(bare).notes
    assert advice(bare, "mvv", 0.01).startswith("no advice about the step: ") and why in advice(bare, "mvv", 0.01)


def test_explained():
    text = dpd.explain_plan(dpd.make_plan(scene(), dt=0.005, seed=1))
    assert "12 harmonic dihedrals\n12 OPLS dihedrals\n12 multi-harmonic dihedrals" in text
    text = dpd.explain_plan(dpd.make_plan(scene("improper"), dt=0.005, seed=1))
    assert "9 harmonic impropers\n9 cosine impropers\n9 umbrella impropers" in text
    assert "no steps were measured with impropers" in dpd.recommend(scene("improper")).notes


QUAD = [(0, 1, 2, 3)]
BAD = {
    "sign": (lambda: dpd.HarmonicDihedrals(QUAD, 1, 2, 1), "dihedral d must be 1 or -1, but is 2"),
    "half a wave": (lambda: dpd.HarmonicDihedrals(QUAD, 1, 1, [1.5]), "dihedral n must be a whole number >= 0; dihedral 0 has 1.5"),
    "three beads": (lambda: dpd.OPLSDihedrals([(0, 1, 2)], 1, 1, 1, 1), r"dihedral quads must be an integer array of shape \(K, 4\)"),
    "a bead twice": (lambda: dpd.OPLSDihedrals([(0, 1, 2, 0)], 1, 1, 1, 1), "names bead 0 twice"),
    "no such bead": (lambda: beads(3, dihedrals=[dpd.HarmonicDihedrals(QUAD, 1, 1, 1)]), "a dihedral names bead 3.*only 3 beads"),
    "no such bead of an improper": (
        lambda: beads(3, impropers=[dpd.HarmonicImpropers(QUAD, 1, 1)]),
        "an improper names bead 3.*only 3 beads",
    ),
    "a dihedral": (
        lambda: beads(4, impropers=[dpd.HarmonicDihedrals(QUAD, 1, 1, 1)]),
        "impropers must be a sequence of HarmonicImpropers or",
    ),
    "inverted": (lambda: dpd.UmbrellaImpropers(QUAD, 1, np.pi), "improper omega0 must be from 0 to less than pi, but is 3.14159"),
    "an angle": (lambda: beads(4, dihedrals=[dpd.CosineAngles([(0, 1, 2)], 1)]), "dihedrals must be a sequence of HarmonicDihedrals or"),
}


test_bad_input = refused(dpd.ParameterError, BAD)


@BOTH
def test_beads_in_line(what):
    """Straight chains have a finite energy and finite forces, in the kernel as in OpenMM's place it takes."""
    x = np.array([[k + 1.0, 1.0, 1.0] for k in range(4)])
    groups = [kind(QUAD, *values) for kind, *values in CLASSES[what]]
    made_ = beads(4, positions=x, **{f"{what}s": groups})
    built = dpd.build(made_, dt=0.005, platform="Reference", conservative="kernel", seed=1)
    assert not dpd.force_terms(built)["bond"].any()
    energy = dpd.Observer(built).sample(context := built.simulation().context).potential
    # as at the angle 0; umbrellas as at a right angle
    assert energy == pytest.approx(sum(float(g.curve(np.array([np.pi / 2 * isinstance(g, dpd.UmbrellaImpropers)]))[0][0]) for g in groups))
    assert context.getState(energy=True).getPotentialEnergy()._value == pytest.approx(energy)
