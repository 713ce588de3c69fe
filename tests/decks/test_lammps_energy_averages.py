"""Values of single beads, slices, and averages over steps: computes, fix ave/time, fix ave/chunk, and what a run hands to them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import cases, put, raises
from test_lammps_chunks import QUICK, context_of, request_of

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import read_deck, run_deck
from openmm_dpd.lammps.output.averages import Schedule
from openmm_dpd.lammps.run.sampling import Sampler
from openmm_dpd.runtime.tape import Tape

START = """atom_style {style}
region b block -2 4 0 5 1 7 units box
create_box 2 b
create_atoms 1 random 30 1 b
create_atoms 2 random 20 2 b
mass 1 1.0
mass 2 2.5
velocity all create 1.0 5
group two type 2
compute ch all chunk/atom bin/1d x lower 1.0
"""
PLAIN = START.format(style="atomic") + "pair_style zero 1.0 nocoeff\npair_coeff * *\nfix move all nve\ntimestep 0.01\n"
_HEAT = "pair_style edpd 1.2 7\npair_coeff * * 18.75 4.5 0.41 1.2 1e-3 2 1.2\nfix move all mvv/edpd\ntimestep 0.01\n"
HEAT = START.format(style="edpd") + _HEAT
_SPECIES = "pair_style tdpd 1.0 1.2 7\npair_coeff * * 18.75 4.5 0.41 1.2 1.2 1 0 2 3 0 2\nfix move all mvv/tdpd\ntimestep 0.01\n"
SPECIES = START.format(style="tdpd 2") + _SPECIES + "set type 1 cc 1 2.0\nset type 2 cc 2 -1.0\n"
_TEN_TIMES = START.format(style="dpd").replace("-2 4 0 5 1 7", "-20 40 0 50 10 70").replace("x lower 1.0", "x lower 10.0")
ENERGY = f"units metal\n{_TEN_TIMES}set type 1 dpd/theta 300\nset type 2 dpd/theta 400\nfix in all eos/cv 0.0005\ntimestep 0.001\n"
ENERGY += "pair_style dpd/fdt/energy 10.0 7\npair_coeff * * 0.075 0.022 3.2e-5\nfix heat all dpd/energy\nfix move all nve\n"


def write(tmp_path, text: str) -> Path:
    return put(tmp_path / "in.deck", text)


def blocks_of(path: Path) -> list[tuple[list[float], np.ndarray]]:
    """Header line and rows of each block of an ave/chunk (or ave/time mode vector) file."""
    found: list = []
    for line in path.read_text().splitlines():
        numbers = [float(word) for word in line.split()] if not line.startswith("#") else None
        if numbers is not None and not line.startswith(" "):
            found.append((numbers, []))
        elif numbers is not None:
            found[-1][1].append(numbers)
    return [(head, np.array(rows)) for head, rows in found]


# -- within a run ------------------------------------------------------------------------------------------------------------------
WITHIN = """fix one all ave/time 1 60 60 v_gam c_thermo_temp format %.16g file one
fix few all ave/time 2 5 20 c_thermo_pe c_thermo_press[2] format %.16g file few
fix each all ave/time 3 1 3 c_thermo_press v_kin format %.16g file each
fix late all ave/correlate 1 4 30 c_thermo_press[4] type auto ave running file late
"""


@pytest.mark.parametrize("scheme", ["mvv", "middle"])
def test_averages_within_a_run_are_those_of_samples_between_runs(tmp_path, monkeypatch, scheme):
    """Where thermo output is due in every step, each sample is one between two runs of steps."""
    plain = START.format(style="atomic") + "pair_style dpd 1.0 1.0 7\npair_coeff * * 25 4.5 2.0\nfix move all nve\ntimestep 0.01\n"
    plain += "variable gam equal lz/2*(pzz-0.5*(pxx+pyy))\nvariable kin equal ke/count(all)\n"
    real, runs, found = Sampler.within, list[bool](), []
    monkeypatch.setattr(Sampler, "within", lambda *arguments: runs.append(real(*arguments)) or runs[-1])
    for every in (60, 1):
        out = tmp_path / f"{every}"
        run_deck(write(tmp_path, f"{plain}{WITHIN}thermo {every}\nrun 60\n"), replace(QUICK, scheme=scheme), out=out)
        files = [(out / name).read_text().splitlines() for name in ("one", "few", "each", "late")]
        found.append([[float(word) for line in lines if not line.startswith("#") for word in line.split()] for lines in files])
    assert sum(runs) > 4
    for within, between in zip(*found, strict=True):
        assert len(within) and within == pytest.approx(between, rel=1e-5 if within is found[0][3] else 1e-11, abs=1e-12)


@pytest.mark.parametrize("scheme", ["mvv", "middle"])
def test_averages_count_what_moves_beside_pairs(tmp_path, monkeypatch, scheme):
    """Thermostats and a piston that act at the end of steps, velocities of beads that do not move, and the clock: each sample is that of a
    run that ends there.  Steps between samples are played, also where those of a window follow each other."""
    fixes = ["", "fix move odd nve", "fix move all nve\nvariable c equal cpu\nfix late all ave/time 1 5 50 v_c file late"]
    if scheme == "mvv":
        acting = ["all nve\nfix t all temp/rescale 1 1 1 0.01 1", "all nve\nfix t all temp/berendsen 1 1 0.5", "all nvt temp 1 1 0.5"]
        fixes += [f"fix move {each}" for each in (*acting, "all npt temp 1 1 0.5 iso 2 2 1")]
    plain = (
        START.format(style="atomic")
        + "pair_style dpd 1.0 1.0 7\npair_coeff * * 25 4.5 2.0\ngroup odd id 1:200\ngroup rest subtract all odd\n"
    )
    plain += "velocity rest set 0.5 0 0\ntimestep 0.01\nthermo 200\n"
    real, play, played = Sampler.within, Tape.play, [0]
    monkeypatch.setattr(Tape, "play", lambda *its: (done := play(*its), played.append(done[0]))[0])
    for k, fix in enumerate(fixes):
        found = []
        for within in (real, lambda *its: False):
            monkeypatch.setattr(Sampler, "within", within)
            out, average = (
                tmp_path / f"{k}{within is real}",
                "fix one all ave/time 1 5 50 c_thermo_temp c_thermo_press format %.16g file one",
            )
            run_deck(write(tmp_path, f"{plain}{fix or 'fix move all nve'}\n{average}\nrun 200\n"), replace(QUICK, scheme=scheme), out=out)
            found.append((out / "one").read_text())
            assert fix or within is not real or sum(played) > 120
            spent = [float(line.split()[1]) for line in (out / "late").read_text().splitlines()[2:]] if "late" in fix else []
            assert spent == sorted(spent)
        assert found[0] == found[1], fix


# -- when ------------------------------------------------------------------------------------------------------------------------
def due_steps(schedule: Schedule, first: int, last: int) -> list[tuple[int, bool]]:
    """Steps of one run at which a sample is taken, and whether it ends a window."""
    schedule.begin(first)
    found = []
    while schedule.next <= last:
        found.append((schedule.next, schedule.advance()))
    return found


def test_when_samples_are_taken():
    assert due_steps(Schedule(2, 3, 10, 0), 0, 20) == [(6, False), (8, False), (10, True), (16, False), (18, False), (20, True)]
    # with one sample a window is that step alone, the present one included
    assert due_steps(Schedule(10, 1, 10, 30), 30, 50) == [(30, True), (40, True), (50, True)]
    assert due_steps(Schedule(1, 10, 10, 5), 5, 20)[0] == (11, False)  # a window that has begun is left out
    assert due_steps(Schedule(5, 2, 20, 15), 15, 20) == [(15, False), (20, True)]
    assert due_steps(Schedule(5, 2, 20, 0, start=50), 0, 60) == [(55, False), (60, True)]


def test_a_window_goes_on_over_two_runs_and_is_lost_if_steps_are_passed_over():
    schedule = Schedule(2, 3, 10, 0)
    assert due_steps(schedule, 0, 7) == [(6, False)]
    assert not schedule.begin(7)
    assert due_steps(schedule, 7, 10) == [(8, False), (10, True)]
    schedule.next, schedule.taken = 16, 1
    assert schedule.begin(17) and schedule.next == 26


# -- values of beads ---------------------------------------------------------------------------------------------------------------
def test_what_beads_carry_comes_from_the_running_scene(tmp_path):
    text = ENERGY + "compute b two dpd/atom\ncompute u two dpd\ncompute s all reduce sum c_b[2]\nthermo_style custom c_u[1]\n"
    request = request_of(tmp_path, text)
    units, n = request.state.units, 50
    fields = {"u_cond": np.linspace(-1, 1, n) * units.energy, "u_mech": np.linspace(1, 2, n) * units.energy}
    fields["theta"] = np.linspace(200, 500, n) * units.thermal_energy
    context = context_of(request, fields=fields)
    rows = context.bead_compute("b", None)
    assert not rows[:30].any()  # beads outside the group
    expected = np.column_stack([np.linspace(-1, 1, n), np.linspace(1, 2, n), np.linspace(200, 500, n)])
    np.testing.assert_allclose(rows[30:, [0, 1, 3]], expected[30:])
    theta = np.linspace(200, 500, n)[30:]
    expected = [np.linspace(-1, 1, n)[30:].sum(), np.linspace(1, 2, n)[30:].sum(), 0.0, 20 / np.sum(1 / theta), 20.0]
    np.testing.assert_allclose([context.compute("u", k) for k in range(1, 6)], expected)
    assert context.compute("s", None) == pytest.approx(expected[1])


def test_a_sample_without_what_beads_carry_is_refused(tmp_path):
    request = request_of(tmp_path, ENERGY + "compute u all dpd\n")
    raises(ValueError, "did not measure u cond", lambda: context_of(request, fields=None).compute("u", 1))


def test_single_beads_in_formulas(tmp_path):
    request = request_of(tmp_path, HEAT + "set atom 7 edpd/temp 1.5\ncompute t all edpd/temp/atom\nvariable hot equal c_t[7]-c_t[8]\n")
    assert context_of(request).variable("hot") == pytest.approx(0.5)


def test_reduce(tmp_path):
    text = PLAIN + "compute k all ke/atom\ncompute p all property/atom id mass\ncompute r two reduce sum c_k c_p[1] vx\n"
    text += "compute a two reduce ave c_p[2]\ncompute m two reduce max c_p[1]\n"
    text += "thermo_style custom c_m c_a c_r[2]\nthermo_modify norm yes\n"
    request = request_of(tmp_path, text)
    context, atoms = context_of(request), request.state.atoms
    energy = 0.5 * 2.5 * np.sum(atoms.velocities[30:] ** 2)
    np.testing.assert_allclose([context.compute("r", k) for k in (1, 2, 3)], [energy, sum(range(31, 51)), atoms.velocities[30:, 0].sum()])
    assert context.compute("a", None) == 2.5
    values = request.thermo.values(context.sample)  # sums are extensive, means and maxima are not
    assert values == pytest.approx({"c_m": 50, "c_a": 2.5, "c_r[2]": sum(range(31, 51)) / 50})


# -- slices ------------------------------------------------------------------------------------------------------------------------
@cases(
    "bins, start, count, volume",
    ("x lower 1.0", -2.0, 6, 30.0),
    ("x lower 4.0", -2.0, 2, 120.0),  # the last slice reaches beyond the box
    ("x upper 4.0", -4.0, 2, 120.0),
    ("x center 4.0", -3.0, 2, 120.0),
    ("x 10.5 1.0", -2.5, 7, 30.0),
    ("z -0.5 2.0", -0.5 + 0.0, 4, 60.0),
    ("y lower 0.1", 0.0, 50, 3.6),  # 5/0.1 is not exactly 50
    ("y lower 0.25 units reduced", 0.0, 4, 45.0),
    ("x lower 1.0 bound x 0 3.5", 0.0, 4, 30.0),
)
def test_slices(tmp_path, bins, start, count, volume):
    request = request_of(tmp_path, PLAIN.replace("x lower 1.0", bins))
    found = request.state.computes["ch"].settings.bins(request.state.box)
    assert (*found.starts, *found.counts, found.volume) == (pytest.approx(start), count, pytest.approx(volume))
    np.testing.assert_allclose(found.centres[:, 0], start + (np.arange(count) + 0.5) * found.thicknesses[0])


def test_lattice_units_are_the_default(tmp_path):
    text = PLAIN.replace("compute ch", "lattice fcc 0.5\ncompute ch").replace("x lower 1.0", "x -1 1")
    (slicing,) = request_of(tmp_path, text).state.computes["ch"].settings.axes
    assert (slicing.thickness, slicing.origin) == (2.0, -2.0)


@pytest.mark.parametrize(("options", "low", "high"), [("", 0, 0), (" discard no", 1, 3), (" discard yes", 0, 0), (" discard mixed", 0, 0)])
def test_beads_beyond_the_bounds(tmp_path, options, low, high):
    request = request_of(tmp_path, PLAIN.replace("x lower 1.0", "x lower 1.0 bound x 0 3" + options))
    x, number = request.state.atoms.positions[:, 0], context_of(request).bead_compute("ch", None)
    assert set(number[x < 0]) == {low} and set(number[x >= 3]) == {high}
    np.testing.assert_array_equal(number[(x >= 0) & (x < 3)], np.floor(x[(x >= 0) & (x < 3)]) + 1)


def test_a_box_that_has_grown_gets_more_slices(tmp_path):
    request = request_of(tmp_path, PLAIN)
    context = context_of(request, box=np.diag([7.5, 5.0, 6.0]))
    assert request.state.computes["ch"].settings.bins(context.box).count == 8


# -- averages ----------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("mode", "expected"), [("one", [1, 2, 3, 4]), ("running", [1, 1.5, 2, 2.5]), ("window 2", [1, 1.5, 2.5, 3.5])])
def test_how_windows_combine(tmp_path, mode, expected):
    request = request_of(tmp_path, PLAIN + f"variable a equal step/10\nfix t all ave/time 10 1 10 v_a ave {mode} start 10 file t.out\n")
    (average,) = request.averages
    found = []
    for step in (10, 20, 30, 40):
        average.take(context_of(request, step))
        found.append(average.value())
    assert found == pytest.approx(expected)
    lines = (tmp_path / "t.out").read_text().splitlines()
    assert lines[:2] == ["# Time-averaged data for fix t", "# TimeStep v_a"]
    assert [line.split() for line in lines[2:]] == [[str(10 * k), f"{value:g}"] for k, value in enumerate(expected, start=1)]


def test_other_averages_in_formulas_and_thermo_output(tmp_path):
    text = PLAIN + "variable a equal step\nfix s all ave/time 1 1 1 v_a v_a\nvariable twice equal 2*f_s[1]\n"
    text += "fix t all ave/time 1 2 2 v_twice\nthermo_style custom step f_t f_s[2] v_twice\n"
    request = request_of(tmp_path, text)
    assert request.thermo.values(context_of(request).sample)["f_t"] == 0  # before the first window is complete
    for step in (0, 1, 2):
        for average in request.averages:
            if average.next_due == step:
                average.take(context_of(request, step))
    assert request.thermo.values(context_of(request, 2).sample) == {"step": 2, "f_t": 3, "f_s[2]": 2, "v_twice": 4}


# -- in a run -----------------------------------------------------------------------------------------------------------------------
def test_a_run_takes_every_sample_and_reports_profiles(tmp_path):
    text = HEAT + "set type 2 edpd/temp 1.1\ncompute h all edpd/temp/atom\nvariable s equal step\n"
    text += "fix p all ave/chunk 2 3 10 ch c_h vx density/number file p.out\nfix t all ave/time 2 3 10 v_s file t.out\n"
    text += "thermo 7\nthermo_style custom step f_t\nrun 20\nrun 13\n"
    report = run_deck(write(tmp_path, text), QUICK, out=tmp_path)
    json.dumps(report)
    assert [head[0] for head, _ in blocks_of(tmp_path / "p.out")] == [10, 20, 30]
    np.testing.assert_allclose(np.loadtxt(tmp_path / "t.out"), [[10, 8], [20, 18], [30, 28]])
    assert report["runs"][1]["thermo"]["f_t"]["last"] == 28
    profile = report["profiles"]["p"]
    assert profile == report["runs"][1]["profiles"]["p"] and list(profile) == ["coord", "ncount", "c_h", "vx", "density/number"]
    np.testing.assert_allclose(np.transpose(list(profile.values())), blocks_of(tmp_path / "p.out")[2][1][:, 1:], rtol=1e-5)
    assert sum(profile["ncount"]) == pytest.approx(50)
    # the mean temperature (20 of 50 beads at 1.1) is conserved up to what friction makes of motion
    mean = np.average(profile["c_h"], weights=profile["ncount"])
    assert mean == pytest.approx(1.04, abs=1e-3) and np.ptp(profile["c_h"]) > 1e-3


def test_concentrations_of_a_run_add_up(tmp_path):
    text = SPECIES + "compute c1 all tdpd/cc/atom 1\ncompute c2 all tdpd/cc/atom 2\ncompute s1 all reduce sum c_c1\n"
    text += "compute s2 all reduce sum c_c2\nthermo_style custom step c_s1 c_s2\nthermo_modify norm no\n"
    text += "dump d all custom 5 d.out id c_c1 c_c2\nrun 5\n"
    thermo = run_deck(write(tmp_path, text), QUICK, out=tmp_path)["thermo"]
    assert thermo["c_s1"]["last"] == pytest.approx(60) and thermo["c_s2"]["last"] == pytest.approx(-20)
    frames = (tmp_path / "d.out").read_text().split("ITEM: ATOMS id c_c1 c_c2\n")[1:]
    first, last = (np.array([line.split() for line in frame.splitlines()[:50]], dtype=float) for frame in frames)
    np.testing.assert_array_equal(np.unique(first[:, 1:], axis=0), [[0, -1], [2, 0]])
    assert np.ptp(last[:30, 1]) > 1e-3 and last[:, 1].sum() == pytest.approx(60, rel=1e-4)


def test_dumps_show_the_temperatures_of_the_running_scene(tmp_path):
    text = ENERGY + "compute u all dpd\ndump d all custom 20 d.out dpdTheta uCond uMech\nthermo_style custom c_u[2] c_u[4]\nrun 20\n"
    thermo = run_deck(write(tmp_path, text), QUICK, out=tmp_path)["thermo"]
    frames = (tmp_path / "d.out").read_text().split("ITEM: ATOMS dpdTheta uCond uMech\n")[1:]
    first, last = (np.array([line.split() for line in frame.splitlines()[:50]], dtype=float) for frame in frames)
    np.testing.assert_allclose(first, np.repeat([[300, 0, 0.15], [400, 0, 0.2]], (30, 20), axis=0), rtol=1e-5)
    assert np.any(last[:, 0] != first[:, 0]) and np.any(last[:, 1] != 0)
    np.testing.assert_allclose(last[:, 0], last[:, 1:].sum(axis=1) / 0.0005, rtol=1e-4)
    assert thermo["c_u[2]"]["last"] == pytest.approx(last[:, 2].sum(), rel=1e-5)
    assert thermo["c_u[4]"]["last"] == pytest.approx(50 / np.sum(1 / last[:, 0]), rel=1e-5)


def test_nothing_is_written_when_a_deck_is_only_read(tmp_path):
    request_of(tmp_path, PLAIN + "fix t all ave/time 1 1 1 c_thermo_temp file t.out\nrun 1\n")
    assert not (tmp_path / "t.out").exists()


# -- what is refused ---------------------------------------------------------------------------------------------------------------
@cases(
    "text, message",
    ("compute x all chunk/atom bin/cone 1 1 1 0 1 2\n", "'bin/cone' is not supported"),
    ("compute x all chunk/atom bin/1d x lower 0\n", "the thickness of the slices must be > 0"),
    ("compute x all chunk/atom bin/1d x middle 1\n", "the origin of the slices"),
    ("compute x all chunk/atom bin/1d x lower 1 bound y 0 1\n", "bound y, but the slices are along x"),
    ("compute x all chunk/atom bin/1d x lower 1 bound x 3 1\n", "the lower bound 3 is not below the upper bound 1"),
    ("compute x all chunk/atom bin/1d x lower 1e-9\n", "a thickness of 1e-09 gives 6e\\+09 slices"),
    ("compute x all chunk/atom bin/1d x lower 1 region r\n", "there is no region 'r'"),
    ("compute x all dpd/atom\n", "compute dpd/atom needs atom_style dpd, but the deck has atom_style atomic"),
    ("compute x all edpd/temp/atom\n", "compute edpd/temp/atom needs atom_style edpd"),
    ("compute x all tdpd/cc/atom 1\n", "compute tdpd/cc/atom needs atom_style tdpd"),
    ("compute x all reduce sum c_y\n", "there is no compute 'y'"),
    ("compute x all reduce sum c_ch[1]\n", "compute ch .style chunk/atom. has one value per bead; use c_ch"),
    ("compute p all property/atom x y\ncompute x all reduce sum c_p\n", "has 2 values per bead; use c_p.1. and so on"),
    ("compute x all reduce sum c_ch\nthermo_style custom c_ch\n", "compute ch .style chunk/atom. has values of single beads"),
    ("fix f all ave/chunk 1 1 1 zz vx\n", "'zz' is not the id of a compute chunk/atom; defined are ch"),
    ("fix f all ave/chunk 1 1 1 ch x\n", "expected vx, vy, vz, fx, fy, fz, mass, density/number, density/mass, temp"),
    ("fix f all ave/chunk 1 1 1 ch vx y\n", "'y' is neither a value nor a supported option"),
    ("fix f all ave/chunk 10 10 50 ch vx\n", "Nfreq must be a multiple of Nevery, at least Nrepeat.Nevery"),
    ("fix f all ave/chunk 3 1 10 ch vx\n", "Nfreq must be a multiple of Nevery"),
    ("fix f all ave/chunk 1 1 1 ch vx ave window\n", "needs 2 values"),
    ("fix f all ave/time 1 1 1 v_no\n", "there is no variable 'no'"),
    ("fix f all ave/time 1 1 1 c_thermo_temp off 3\n", "off 3, but the fix averages 1"),
    ("fix f all ave/time 1 1 1 c_thermo_temp\nreset_timestep 10\n", "reset_timestep is not possible while fix f counts steps"),
    ("fix f all ave/time 1 1 1 c_thermo_temp\nthermo_style custom f_f[1]\n", "f_f: the fix averages 1 value; use f_f"),
    ("fix f all ave/chunk 1 1 1 ch vx\nthermo_style custom f_f\n", "f_f: the fix has 3 columns; use f_f.row..column."),
)
def test_errors(tmp_path, text, message):
    with pytest.raises(DeckError, match=r"in.deck:\d+: .*" + message):
        read_deck(write(tmp_path, PLAIN + text), stop_before_first_run=True, output=tmp_path)


def test_a_species_that_is_not_there(tmp_path):
    with pytest.raises(DeckError, match="there is no species 3; atom_style tdpd has 2"):
        read_deck(write(tmp_path, SPECIES + "compute x all tdpd/cc/atom 3\n"), stop_before_first_run=True)
