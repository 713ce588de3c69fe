"""Bins along several axes, forces and formulas of single beads, vectors and wildcards in averages; files number by number beside LAMMPS."""

import os
import subprocess
import sys
from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import cases, put, raises

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, RunRequest, read_deck, run_deck
from openmm_dpd.lammps.state.records import DeckSample
from openmm_dpd.lammps.values.resolver import Resolver

BLOCK = "block -2 4 0 5 1 7"
PRISM = "prism -2 4 0 5 1 7 1.3 -0.8 0.9"
BEADS = "atom_style {style}\nregion b {region} units box\ncreate_box 2 b\ncreate_atoms 1 random 60 1 b overlap 0.4 maxtry 500\n"
BEADS += "create_atoms 2 random 40 2 b overlap 0.4 maxtry 500\nmass 1 1.0\nmass 2 2.5\nvelocity all create {T} 5\n"
MOVING = "group two type 2\npair_style dpd 0.0 1.0 7\npair_coeff * * {A} {gamma}\nfix move all nve\ntimestep {dt}\n"
FLUID = MOVING.format(A=10.0, gamma=4.5, dt=0.02)
FREE = MOVING.format(A=0.0, gamma=0.0, dt=0.01)
DECK = BEADS.format(style="atomic", region=BLOCK, T=1.0) + FLUID
QUICK = RunOptions(platform="Reference", threads=1, seed=3)


def request_of(tmp_path, text: str) -> RunRequest:
    request = read_deck(put(tmp_path / "in.deck", text), stop_before_first_run=True, output=tmp_path).first_run
    assert request is not None
    return request


def context_of(request: RunRequest, step: int = 0, shift=(0.0, 0.0, 0.0), **values) -> Resolver:
    """Resolver at a step at which all beads have moved by ``shift``."""
    atoms = request.state.atoms
    sample = DeckSample(step, positions=atoms.positions + np.array(shift), velocities=atoms.velocities, **{"fields": {}, **values})
    return Resolver(request.state, sample, request.window)


def rows_of(path: Path) -> list[list[float]]:
    return [[float(word) for word in line.split()] for line in path.read_text().splitlines() if not line.startswith("#")]


# -- bins --------------------------------------------------------------------------------------------------------------------------
def test_bounds_hold_for_their_own_axis(tmp_path):
    text = "compute ch all chunk/atom bin/2d x lower 1.0 y lower 1.0 bound x -1 3\ncompute no all chunk/atom bin/2d x lower 1 y lower 1 "
    request = request_of(tmp_path, DECK + text + "bound x -1 3 bound y 1 upper discard no\n")
    x, y, _ = request.state.atoms.positions.T
    context = context_of(request)
    inside = (x >= -1) & (x < 3)
    np.testing.assert_array_equal(context.bead_compute("ch", None), np.where(inside, 5 * np.floor(x + 1) + np.floor(y) + 1, 0))
    expected = 4 * np.clip(np.floor(x + 1), 0, 3) + np.clip(np.floor(y - 1), 0, 3) + 1
    np.testing.assert_array_equal(context.bead_compute("no", None), expected)


def test_profile_along_two_axes(tmp_path):
    text = "compute ch all chunk/atom bin/2d x lower 3 z lower 3\nfix p all ave/chunk 1 1 1 ch vx density/number file p.out\n"
    text += "variable a equal f_p[2][2]+10*f_p[2][3]\nthermo_style custom step f_p[2][4] v_a\n"
    request = request_of(tmp_path, DECK + text)
    (average,) = request.averages
    before = request.thermo.values(context_of(request).sample)
    assert (before["f_p[2][4]"], before["v_a"]) == (0, 0)
    average.take(context_of(request))
    atoms = request.state.atoms
    second = (atoms.positions[:, 0] < 1) & (atoms.positions[:, 2] >= 4)
    assert list(average.profile) == ["coord1", "coord2", "ncount", "vx", "density/number"]
    expected = [-0.5, 5.5, second.sum(), atoms.velocities[second, 0].mean(), second.sum() / 45]
    assert [column[1] for column in average.profile.values()] == pytest.approx(expected)
    values = request.thermo.values(context_of(request).sample)
    assert values["v_a"] == pytest.approx(5.5 + 10 * second.sum())
    assert values["f_p[2][4]"] == pytest.approx(atoms.velocities[second, 0].mean())
    assert "# Chunk Coord1 Coord2 Ncount vx density/number\n" in (tmp_path / "p.out").read_text()


# -- values of single beads -----------------------------------------------------------------------------------------------------------
def test_formulas_of_single_beads(tmp_path):
    text = "variable k atom 0.5*mass*(vx^2+vy^2+vz^2)\nvariable hot atom v_k>1&&!(type==2)\n"
    text += "variable f atom ternary(v_hot,fx,-c_p[2])+round(x)\ncompute p all property/atom id y\n"
    text += "compute s two reduce sum v_k\nvariable one equal c_s+x[3]+fy[4]\n"
    request = request_of(tmp_path, DECK + text)
    atoms = request.state.atoms
    forces = np.arange(300.0).reshape(100, 3)
    context = context_of(request, forces=forces)
    energies = 0.5 * np.where(atoms.types == 1, 1.0, 2.5) * np.sum(atoms.velocities**2, axis=1)
    hot = (energies > 1) & (atoms.types == 1)
    assert 0 < hot.sum() < 60
    x, y, _ = atoms.positions.T
    np.testing.assert_allclose(context.bead_variable("k"), energies)
    np.testing.assert_array_equal(context.bead_variable("hot"), hot)
    expected = np.where(hot, forces[:, 0], -y) + np.sign(x) * np.floor(np.abs(x) + 0.5)
    np.testing.assert_allclose(context.bead_variable("f"), expected)
    assert context.variable("one") == pytest.approx(energies[60:].sum() + x[2] + forces[3, 1])


def test_vector_of_compute_temp(tmp_path):
    """Sums of m v_a v_b; thermo output divides them by the number of beads where it normalises, but not the temperature."""
    request = request_of(tmp_path, DECK + "compute t two temp\nthermo_style custom c_t c_t[*]\nthermo_modify norm yes\n")
    atoms = request.state.atoms
    tensor = 2.5 * atoms.velocities[60:].T @ atoms.velocities[60:]
    expected = [tensor.trace() / (3 * 40 - 3), *(tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]] / 100)]
    assert list(request.thermo.values(context_of(request).sample).values()) == pytest.approx(expected)


# -- averages -------------------------------------------------------------------------------------------------------------------------
def test_values_that_are_not_averaged(tmp_path):
    request = request_of(tmp_path, DECK + "variable s equal step\nfix a all ave/time 1 3 10 v_s v_s off 2 ave running\n")
    (average,) = request.averages
    for step in (8, 9, 10, 18, 19, 20):
        average.take(context_of(request, step))
    assert [average.value(1), average.value(2)] == [14, 20]
    assert average.report == {"step": 20, "v_s": 20}


def test_vectors_of_averages(tmp_path):
    text = "compute m all momentum\nfix v all ave/time 1 1 1 c_m mode vector\nfix two all ave/time 1 1 1 c_m c_m mode vector\n"
    text += "fix w all ave/time 1 1 1 f_v mode vector\nfix s all ave/time 1 1 1 f_v[2] c_m[1*2] f_two[3][1]\n"
    text += "thermo_style custom f_s[*] f_w[3] f_two[1][2]\n"
    request = request_of(tmp_path, DECK + text)
    assert request.thermo.words == ("f_s[1]", "f_s[2]", "f_s[3]", "f_s[4]", "f_w[3]", "f_two[1][2]")
    assert set(request.thermo.values(context_of(request).sample).values()) == {0.0}
    request.state.atoms.velocities[:] += [1.0, 2.0, 3.0]
    for average in request.averages:
        average.take(context_of(request))
    expected = [3.2, 1.6, 3.2, 4.8, 4.8, 1.6]  # 100 beads of mass 160: thermo output divides sums over beads by their number
    assert list(request.thermo.values(context_of(request).sample).values()) == pytest.approx(expected)


def test_report_has_the_last_averages_of_each_run(tmp_path):
    text = "compute m all momentum\nvariable s equal step\nfix s all ave/time 2 3 10 v_s c_m[1]\n"
    text += "fix v all ave/time 5 1 5 c_m mode vector\nrun 10\nrun 14\n"
    report = run_deck(put(tmp_path / "in.deck", DECK + text), QUICK, out=tmp_path)
    assert report["averages"] == report["runs"][1]["averages"]
    assert (report["averages"]["s"]["step"], report["averages"]["s"]["v_s"]) == (20, 18)
    assert report["runs"][0]["averages"]["s"]["v_s"] == 8
    assert report["averages"]["v"]["step"] == 20 and len(report["averages"]["v"]["c_m"]) == 3


@cases(
    "text, message",
    ("compute x all chunk/atom bin/2d x lower 1 x lower 1\n", "each axis can be cut only once, not x, x"),
    ("compute x all chunk/atom bin/3d x lower 1 y lower 1\n", "found 7 arguments"),
    ("compute x all chunk/atom bin/2d x lower 1 y lower 1 bound z 0 1\n", "bound z, but the slices are along x, y"),
    ("compute x all chunk/atom bin/3d x lower .001 y lower .001 z lower .001\n", "bins are too many"),
    # each would give other profiles than LAMMPS if it were passed over
    ("compute x all chunk/atom bin/1d x lower 1 ids once\n", "ids once is not supported"),
    ("compute x all chunk/atom bin/1d x lower 1 ids nfreq\n", "ids nfreq is not supported"),
    ("compute x all property/atom rho\n", "rho needs atom_style mdpd"),
    ("variable a atom vx/0\nfix f all ave/chunk 1 1 1 ch v_a\nrun 1\n", r"in.deck:\d+: variable a: .* divide by zero"),
    ("variable a atom v_a\nfix f all ave/chunk 1 1 1 ch v_a\nrun 1\n", "refers to itself"),
    ("variable a atom c_q[3]\ncompute q all property/atom x y\nfix f all ave/chunk 1 1 1 ch v_a\nrun 1\n", "has 2 values per bead"),
    ("variable a equal 1\nfix f all ave/chunk 1 1 1 ch v_a\n", "variable a is equal-style; only atom-style ones"),
    ("variable a atom vx\nfix f all ave/time 1 1 1 v_a\n", "variable a is atom-style; only equal-style variables"),
    ("variable a atom vx\nprint ${{a}}\n", "atom-style: it has a value for every bead"),
    ("variable a atom random(0,1,5)\nfix f all ave/chunk 1 1 1 ch v_a\nrun 1\n", "random is only supported in equal-style"),
    ("compute k all ke\nfix f all ave/time 1 1 1 c_k[*]\n", "compute k does not have several values"),
    ("compute t all temp\nfix f all ave/time 1 1 1 c_t[7*]\n", "out of range: there are 6"),
    ("compute t all temp\ncompute m all momentum\nfix f all ave/time 1 1 1 c_t c_m mode vector\n", "c_t c_m have different lengths"),
    ("fix f all ave/chunk 1 1 1 ch vx\nthermo_style custom f_f[1]\n", "f_f: the fix has 3 columns; use f_f.row..column."),
    ("fix f all ave/chunk 1 1 1 ch vx\nthermo_style custom f_f[1][4]\n", "the fix has 3 columns"),
)
def test_errors(tmp_path, text, message):
    (tmp_path / "in.deck").write_text(DECK + "compute ch all chunk/atom bin/1d x lower 1.0\n" + text.replace("{{", "{").replace("}}", "}"))
    raises(DeckError, message, lambda: run_deck(tmp_path / "in.deck", QUICK, out=tmp_path))


# -- LAMMPS ------------------------------------------------------------------------------------------------------------------------
LIVE = """import ctypes, pathlib, sys
mpi = pathlib.Path(sys.prefix) / "lib" / "libmpi.so.12"
if mpi.exists():
    ctypes.CDLL(str(mpi), ctypes.RTLD_GLOBAL)
import lammps
lammps.lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"]).file("in.deck")
"""
#: LAMMPS folds beads back into the box when it makes its lists, here at every step.
LISTS = "comm_modify vel yes\nneighbor 0.3 bin\nneigh_modify every 1 delay 0 check no\n"
FORM = "format ' %.15g'"

CASES = {  # Name -> (box, forces, temperature, what is measured).
    "schedules": (
        BLOCK,
        FLUID,
        1.0,
        """compute ch all chunk/atom bin/1d x lower 0.5
compute t two temp
compute p all pressure thermo_temp
fix a two ave/chunk 2 3 10 ch vx fy density/number density/mass temp mass file a.out {form}
fix b all ave/time 2 3 10 c_t c_t[*] c_p c_thermo_pe file b.out {form} ave running
fix c all ave/time 10 1 10 c_t file c.out {form}
compute own all chunk/atom bin/1d z upper 0.7
fix d all ave/chunk 1 5 10 own temp norm sample file d.out {form} ave window 2
compute cut all chunk/atom bin/1d x lower 1.0 bound x -1.5 2.2 discard yes
compute k all ke/atom
compute i all property/atom vx type zu iy
compute most two reduce max c_i[1] vx x
fix g two ave/chunk 2 3 10 cut vx density/mass c_k c_i[2] mass norm none file g.out {form} ave window 3
fix h all ave/time 2 2 10 c_most mode vector ave one file h.out {form}
run 0
run 17
fix e all ave/time 1 10 10 c_t file e.out {form}
fix f all ave/time 2 2 10 c_t file f.out {form} start 35
run 6
unfix c
run 27
""",
    ),
    "crossing": (
        BLOCK,
        FREE,
        2000.0,
        """compute ch all chunk/atom bin/1d y lower 0.5
compute two all chunk/atom bin/2d z center 0.7 x 0.3 1.1
variable x equal x[5]
variable top equal bound(two,xmax)
variable bottom equal bound(all,zmin)
variable centre equal xcm(two,x)
compute q all property/atom xu ix x xs
compute r all reduce sum c_q[*]
fix a all ave/chunk 3 4 15 ch vx density/number temp norm none file a.out {form}
fix b two ave/chunk 3 4 15 two vx density/number file b.out {form}
fix c all ave/time 5 1 5 v_x v_top v_bottom v_centre c_r[*] file c.out {form}
run 50
run 40
""",
    ),
    "tilted": (
        PRISM,
        FREE,
        1000.0,
        """compute ch all chunk/atom bin/1d y lower 0.1 units reduced
compute b all chunk/atom bin/3d x lower 0.3 z center 0.2 y 0.13 0.26 units reduced bound z 0.2 0.9
variable x equal x[5]
compute r all reduce max x y z
fix a all ave/chunk 3 4 15 ch vx density/number density/mass file a.out {form}
fix b two ave/chunk 3 4 15 b vx temp norm sample file b.out {form}
fix c all ave/time 5 1 5 v_x c_r[*] file c.out {form}
run 60
""",
    ),
    "formulas": (
        BLOCK,
        FLUID,
        1.0,
        """compute ch all chunk/atom bin/1d x lower 0.5
variable e atom 0.5*mass*vx*vx+(x>1)*fy-!(type==2)
variable g atom v_e^2+c_k+c_q[2]-sqrt(abs(vy))*ln(id)+ternary(y>2,1,-1)*pe/10+round(z)%3
compute k all ke/atom
compute q all property/atom id vz
compute r all reduce sum v_e
compute s two reduce ave v_g fx
compute m all momentum
fix a all ave/chunk 2 3 10 ch v_e v_g c_q[*] file a.out {form}
variable row equal f_a[3][1]+1000*f_a[3][2]
variable late equal f_a[9][4]
fix b all ave/time 2 3 10 c_r c_s[*] c_r file b.out {form} off 4
fix v all ave/time 2 3 10 c_m mode vector file v.out {form} ave window 2
fix w all ave/time 10 1 10 f_v mode vector file w.out {form}
fix x all ave/time 10 1 10 f_v[*] f_b[2*3] file x.out {form}
variable f equal fx[5]
fix y all ave/time 10 1 10 v_f v_row v_late file y.out {form}
run 40
""",
    ),
}


def beside_lammps(tmp_path, start: str, atom_style: str, text: str) -> None:
    """Run a deck here and in LAMMPS, from one data file, and compare every file that its fixes write."""
    (tmp_path / "ours").mkdir()
    read_deck(put(tmp_path / "in.start", start + "write_data data.start nocoeff\n"), stop_before_first_run=True, output=tmp_path)
    head = f"atom_style {atom_style}\natom_modify map yes\nread_data data.start\n"
    run_deck(put(tmp_path / "in.deck", head + LISTS + text.format(form=FORM)), QUICK, out=tmp_path / "ours")
    subprocess.run([sys.executable, "-c", LIVE], cwd=tmp_path, check=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    found = sorted(tmp_path.glob("*.out"))
    assert len(found) == text.count(" file ")
    for theirs in found:
        mine = tmp_path / "ours" / theirs.name
        headers = [[line for line in path.read_text().splitlines() if line.startswith("#")] for path in (mine, theirs)]
        assert headers[0] == headers[1], theirs.name
        tables = [rows_of(path) for path in (mine, theirs)]
        assert tables[1] and [len(row) for row in tables[0]] == [len(row) for row in tables[1]], theirs.name
        np.testing.assert_allclose(*[np.concatenate(table) for table in tables], rtol=1e-9, atol=1e-9, err_msg=theirs.name)


@pytest.mark.parametrize("name", CASES)
def test_files_equal_lammps(tmp_path, name):
    """No noise: friction at temperature 0, or beads that fly freely and cross the box several times."""
    lammps_peer.need(("pair", "dpd"), ("compute", "chunk/atom"), ("fix", "ave/chunk"), ("fix", "ave/time"))
    region, moving, temperature, text = CASES[name]
    beside_lammps(tmp_path, BEADS.format(style="atomic", region=region, T=temperature), "atomic", moving + text)


def test_densities_of_mdpd_equal_lammps(tmp_path):
    lammps_peer.need(("pair", "mdpd"), ("pair", "mdpd/rhosum"), ("fix", "mvv/dpd"), ("fix", "ave/chunk"))
    text = "pair_style hybrid/overlay mdpd/rhosum mdpd 0.0 1.0 7\npair_coeff * * mdpd/rhosum 0.75\n"
    text += "pair_coeff * * mdpd -40 25 4.5 1.0 0.75\nfix move all mvv/dpd 0.5\ntimestep 0.005\n"
    text += "compute ch all chunk/atom bin/1d x lower 1\ncompute d all property/atom rho\ncompute r all reduce max c_d\n"
    text += "fix a all ave/chunk 2 3 10 ch c_d file a.out {form}\nfix b all ave/time 2 3 10 c_r file b.out {form}\nrun 20\n"
    beside_lammps(tmp_path, BEADS.format(style="mdpd", region=BLOCK, T=1.0), "mdpd", text)
