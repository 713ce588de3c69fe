"""Export to LAMMPS without LAMMPS: the text, the differences, what comes back through the deck reader, and bad input."""

import dataclasses
import os
import re
import warnings

import exported
import numpy as np
import pytest
from cases import cases, put, raises

import openmm_dpd as dpd
from openmm_dpd.__main__ import main
from openmm_dpd.lammps import (
    ExportWarning,
    RunOptions,
    deck_forces,
    deck_scene,
    export_deck,
    export_lammps,
    read_lammps_data,
    read_lammps_dump,
    scene_from_data,
)
from openmm_dpd.lammps.styles.pair_styles import PAIR_STYLES
from openmm_dpd.lammps.styles.words import id_words, lammps_seed


def fluid(**changes) -> dpd.Scene:
    return dataclasses.replace(exported.scene("fluid"), **{"kT": 1.0, **changes})


def words(written, command: str) -> list[str]:
    """The commands of a deck that begin with a word, without that word."""
    lines = written.deck.read_text().replace(" &\n  ", " ").splitlines()
    return [line.removeprefix(command + " ") for line in lines if line.split()[:1] == [command]]


# -- what comes back through the deck reader ------------------------------------------------------------------------------------
#: LAMMPS runs these, but the deck reader has no hybrid atom styles and no open boxes.
#: Patterns of body forces come back as formulas, which grow.
NOT_READ = ("energy-chains", "open", "ions", "driven") + (() if "coul/slater/long" in PAIR_STYLES else ("electrolyte",))


def differences(one, other, names, where: str = "") -> list[str]:
    """What differs between two scenes, field by field."""
    if isinstance(one, np.ndarray):
        equal = one.shape == other.shape and np.allclose(one, other, rtol=1e-14, atol=1e-14)
        return [] if equal else [where]
    if isinstance(one, dpd.PairTable):
        one, other = one.resolve(names), other.resolve(names)
    if dataclasses.is_dataclass(one):
        pairs = [(f.name, getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one)]
    elif isinstance(one, dict):
        if set(one) != set(other):
            return [where]
        pairs = [(str(key), one[key], other[key]) for key in one]
    elif isinstance(one, (tuple, list)) and any(not isinstance(entry, (str, float, int)) for entry in one):
        pairs = [(str(k), *both) for k, both in enumerate(zip(one, other, strict=True))]
    else:
        return [] if one == other else [f"{where}: {one!r} and {other!r}"]
    return [found for name, a, b in pairs for found in differences(a, b, names, f"{where}.{name}")]


@pytest.mark.parametrize("name", [name for name in exported.SCENES if name not in NOT_READ])
def test_an_exported_deck_exported_again_is_the_same(name, tmp_path):
    first = export_lammps(exported.scene(name), tmp_path / "1", name, dt=0.001, steps=10, seed=3)
    second = export_deck(first.deck, tmp_path / "2", name="again", compat="lammps")
    third = export_deck(second.deck, tmp_path / "3", name="again", compat="lammps")

    def text(written):
        lines = [[line for line in path.read_text().splitlines() if line[:1] != "#"] for path in (written.deck, written.data)]
        if name == "tilted":
            # as in LAMMPS, positions in a tilted box go through fractions of its vectors, which rounds them
            lines[1] = [re.sub(r"\d+\.\d{13,}", lambda number: f"{float(number[0]):.13f}", line) for line in lines[1]]
        return lines

    assert text(second) == text(third)
    one, other = (deck_scene(written.deck) for written in (second, third))
    assert not differences(one, other, one.type_names)


@pytest.mark.parametrize("name", ["fluid", "chains", "segments", "transverse", "tilted", "none", "many-body"])
@pytest.mark.parametrize("units", ["lj", "real"])
def test_the_deck_reader_finds_the_forces_of_the_scene(name, units, tmp_path):
    if (name, units) == ("many-body", "real"):
        pytest.skip("LAMMPS has it in lj units only")
    scene = exported.scene(name)
    written = export_lammps(scene, tmp_path, name, dt=0.001, steps=0, seed=3, units=units)
    found = deck_forces(written.deck, RunOptions(platform="Reference"))
    expected = dpd.force_terms(dpd.build(scene, dt=0.001, scheme="mvv", platform="Reference", seed=3))
    unit = {"lj": 1.0, "real": 0.0239005736}[units]
    for term in ("conservative", "dissipative"):
        np.testing.assert_allclose(found[term], expected[term] * unit, rtol=1e-6, atol=1e-6 * np.abs(expected[term]).max() * unit)


def test_beads_on_which_only_body_forces_act(tmp_path):
    taken = np.ones((len(fluid().types), 3), bool)
    taken[:7, 2] = taken[5:9, 0] = False
    scene = fluid(interacting=taken, body_forces=[dpd.BodyForce((0.5, 0.25, -1)), dpd.PositionForce(("x", "0", "0"))])
    with pytest.warns(ExportWarning, match="beads whose forces are removed"):
        written = export_lammps(scene, tmp_path, "alone", dt=0.001, steps=10, scheme="shardlow", seed=3)
    assert "setforce 0.0 NULL 0.0" in written.deck.read_text() and "shardlow" not in " ".join(words(written, "fix"))
    again = deck_scene(written.deck)
    assert np.array_equal(again.interacting, taken)
    one, other = (dpd.force_terms(dpd.build(each, dt=0.001, scheme="mvv", platform="Reference"))["external"] for each in (scene, again))
    assert np.allclose(one, other, atol=1e-5)


def test_an_exported_deck_keeps_its_corner(tmp_path):
    deck = tmp_path / "in.corner"
    text = "units real\nregion b block -7 23 4 37 -2 31 units box\ncreate_box 1 b\ncreate_atoms 1 single 1 5 30\nmass 1 1\n"
    deck.write_text(text + "pair_style dpd 300 9 1\npair_coeff 1 1 0.5 1\nfix 1 all nve\nrun 1\n")
    lines = export_deck(deck, tmp_path / "out").data.read_text().splitlines()
    bounds = {line.split()[2]: [float(word) for word in line.split()[:2]] for line in lines if line.endswith("hi")}
    assert bounds["xlo"] == pytest.approx([-7, 23]) and bounds["ylo"] == pytest.approx([4, 37]) and bounds["zlo"] == pytest.approx([-2, 31])
    (row,) = [line.split() for line in lines if line.startswith("1 1 ") and len(line.split()) > 5]
    assert [float(word) for word in row[-6:-3]] == pytest.approx([1, 5, 30])


def test_numbers_keep_all_of_their_digits(tmp_path):
    scene = fluid()
    written = export_lammps(scene, tmp_path, "x", dt=0.1 / 3, steps=1)
    np.testing.assert_array_equal(deck_scene(written.deck).velocities, scene.velocities)
    state = read_lammps_data(written.data, scene)
    np.testing.assert_allclose(state.unwrapped[0], scene.positions, rtol=0, atol=4e-15)
    assert np.any(state.images)
    assert words(written, "timestep") == [repr(0.1 / 3)]


def test_velocities_that_are_not_given_are_those_of_build(tmp_path):
    scene = fluid(velocities=None)
    written = export_lammps(scene, tmp_path, "x", dt=0.01, steps=1, seed=9)
    built = dpd.build(scene, dt=0.01, seed=9, platform="Reference")
    np.testing.assert_array_equal(deck_scene(written.deck).velocities, built.velocities._value)


# -- the text -----------------------------------------------------------------------------------------------------------------
def test_a_plan_brings_its_choices(tmp_path):
    built = dpd.build(fluid(), dt=0.02, scheme="mvv", lam=0.65, seed=77, platform="Reference")
    written = export_lammps(built, tmp_path, "x", steps=5)
    assert words(written, "fix") == ["move all mvv/dpd 0.65"] and words(written, "atom_style") == ["mdpd"]
    assert words(written, "timestep") == ["0.02"] and words(written, "pair_style") == ["dpd 1.0 1.0 77"]
    assert not written.differences


@cases(
    "term, expected",
    (dpd.DPD(A=25, gamma=4.5), "dpd 1.0 1.0 1"),
    (dpd.DPD(gamma=4.5), "dpd/tstat 1.0 1.0 1.0 1"),
    (dpd.DPD(A=25, sigma=3.0), "dpd/fdt 1.0 1.0 1"),
    (dpd.DPD(A=25, gamma=4.5, exponent=0.5), "dpd/ext 1.0 1.0 1"),
    (dpd.DPD(gamma=4.5, gamma_perp=1.0), "dpd/ext/tstat 1.0 1.0 1.0 1"),
)
def test_the_plainest_style_is_taken(term, expected, tmp_path):
    written = export_lammps(fluid(pairs={("*", "*"): term}), tmp_path, "x", dt=0.01, steps=1, seed=1)
    assert words(written, "pair_style") == [expected]


def test_masses_of_single_beads_become_types(tmp_path):
    scene = fluid(bead_masses=1.0 + np.arange(240) % 4)
    written = export_lammps(scene, tmp_path, "x", dt=0.01, steps=1)
    np.testing.assert_array_equal(deck_scene(written.deck).bead_masses, scene.bead_masses)
    assert words(written, "pair_coeff")[1] == "1*4 5*8 40.0 5.5 0.9"
    with pytest.raises(dpd.ParameterError, match="different masses"):
        many = dict(masses={"A": 1}, types=["A"] * 2500, positions=np.random.default_rng(1).random((2500, 3)) * 10, box=[10] * 3, kT=1)
        scene = dpd.Scene(pairs={("*", "*"): dpd.DPD(A=1)}, bead_masses=1 + np.arange(2500) / 2500, **many)
        export_lammps(scene, tmp_path, "x", dt=0.01)


def test_ramps_in_one_go_and_in_parts(tmp_path):
    def runs(begin, end, steps):
        return export_lammps(fluid(kT=dpd.TemperatureRamp(1.0, 2.0, begin, end)), tmp_path, "x", dt=0.01, steps=steps, seed=1)

    written = runs(-50, 100, 80)
    assert words(written, "run") == ["80 start 0 stop 150"] and words(written, "reset_timestep") == ["50"]
    assert deck_scene(written.deck).kT == dpd.TemperatureRamp(1.0, 2.0, -50, 100)
    assert words(runs(10, 40, 100), "run") == ["10", "30 start 10 stop 40", "60"]
    assert words(runs(200, 300, 100), "run") == ["100"]
    with pytest.raises(dpd.ParameterError, match="fixed sigma while the temperature changes"):
        scene = fluid(kT=dpd.TemperatureRamp(1.0, 2.0, 0, 10), pairs={("*", "*"): dpd.DPD(A=25, sigma=3.0)})
        export_lammps(scene, tmp_path, "x", dt=0.01)


def test_fixed_beads_and_their_groups(tmp_path):
    mobile = np.ones(240, bool)
    mobile[[0, 1, 2, 7]] = False
    written = export_lammps(fluid(mobile=mobile), tmp_path, "x", dt=0.01, steps=1)
    assert words(written, "group") == ["mobile id 4:7 9:240"] and words(written, "fix") == ["move mobile nve"]
    np.testing.assert_array_equal(deck_scene(written.deck).mobile, mobile)
    assert id_words(np.zeros(3, bool)) == [] and id_words(np.array([True, False, True])) == ["1", "3"]
    # those with internal energies are reservoirs, whatever their equation of state
    eos = [line.split()[2:4] for line in words(export_lammps(exported.scene("energy"), tmp_path, "x", dt=0.01), "fix") if "eos/" in line]
    assert eos == [["eos/cv", "50.0"], ["eos/cv", "1000000000000.0"], ["eos/table", "linear"], ["eos/cv", "1000000000000.0"]]


def test_seeds_are_those_that_lammps_takes():
    assert [lammps_seed(seed) for seed in (1, 0, 900_000_000, 900_000_001)] == [1, 900_000_000, 900_000_000, 1]


# -- differences --------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", ["middle", "aboba", "bababo", "native"])
def test_schemes_that_lammps_lacks_are_replaced_and_said(scheme, tmp_path):
    with pytest.warns(ExportWarning, match="velocity Verlet"):
        written = export_lammps(fluid(), tmp_path, "x", dt=0.01, steps=1, scheme=scheme)
    assert words(written, "fix") == ["move all nve"]
    assert f"# DIFFERENT: {written.differences[0]}" in written.deck.read_text()


def test_shardlow_where_it_is_possible_and_where_not(tmp_path):
    written = export_lammps(fluid(), tmp_path, "x", dt=0.01, steps=1, scheme="shardlow", seed=1)
    assert words(written, "fix") == ["sweep all shardlow", "move all nve"] and words(written, "pair_style")[0].startswith("dpd/fdt")
    for changes, why in (
        ({"box": np.array([[5.0, 0, 0], [1.0, 5, 0], [0, 0, 5]])}, "without tilt"),
        ({"pairs": {("*", "*"): dpd.DPD(A=25, gamma=4.5, exponent=0.5)}}, "no exponents"),
        ({"kT": dpd.TemperatureRamp(1.0, 2.0, 0, 10)}, "no temperature ramp"),
        ({"box": [2.1, 5, 5]}, "twice the cutoff"),
    ):
        with pytest.warns(ExportWarning, match=why):
            written = export_lammps(fluid(**changes), tmp_path, "x", dt=0.01, steps=1, scheme="shardlow")
        assert words(written, "fix") == ["move all nve"]


def test_what_lammps_computes_in_another_way_is_said(tmp_path):
    heat = dataclasses.replace(exported.scene("heat"), compat="consistent")
    with pytest.warns(ExportWarning, match="does not conserve energy"):
        export_lammps(heat, tmp_path, "x", dt=0.01, steps=1)
    warren = fluid(pairs={("*", "*"): dpd.MDPD(A=-40, B=25, gamma=18)})
    with pytest.warns(ExportWarning, match="Lucy's kernel"):
        export_lammps(warren, tmp_path, "x", dt=0.01, steps=1)
    with pytest.warns(ExportWarning, match="clamps the two nearest points"):
        export_lammps(dataclasses.replace(exported.scene("nearest"), compat="consistent"), tmp_path, "x", dt=0.01, steps=1)
    with pytest.warns(ExportWarning, match="lambda = 0.65 needs units lj"):
        export_lammps(fluid(), tmp_path, "x", dt=0.01, steps=1, lam=0.65, units="real")


def test_nothing_is_said_where_nothing_differs(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in exported.SCENES:
            assert export_lammps(exported.scene(name), tmp_path, name, dt=0.01, steps=1).differences == ()


# -- errors -------------------------------------------------------------------------------------------------------------------
@cases(
    "choices, message",
    ({"dt": None}, "dt, the step size, is required"),
    ({"dt": -1.0}, "dt must be > 0"),
    ({"scheme": "leapfrog"}, "unknown scheme 'leapfrog'; it must be one of mvv"),
    ({"units": "electron"}, "units must be one of .*'electron'"),
    ({"name": "a b"}, "the name of an export"),
    ({"name": "../x"}, "the name of an export"),
    ({"steps": 1.5}, "steps must be a whole number"),
    ({"lam": 2.0}, "between 0 and 1"),
    ({"every": 0}, "every must be at least 1"),
    ({"corner": [1.0]}, "corner must be three lengths"),
)
def test_bad_choices(choices, message, tmp_path):
    arguments = {"dt": 0.01, "name": "x", **choices}
    raises(dpd.ParameterError, message, lambda: export_lammps(fluid(), tmp_path, arguments.pop("name"), **arguments))


def test_what_is_no_scene_and_what_is_no_folder(tmp_path):
    raises(dpd.ParameterError, "expected a Scene", lambda: export_lammps("scene", tmp_path, "x", dt=0.01))
    with pytest.raises(dpd.OutputError, match="the folder .*file.* cannot be written .*write elsewhere"):
        export_lammps(fluid(), put(tmp_path / "file", ""), "x", dt=0.01)
    if os.getuid():
        (tmp_path / "closed").mkdir(mode=0o500)
        raises(dpd.ParameterError, "cannot be written", lambda: export_lammps(fluid(), tmp_path / "closed", "x", dt=0.01))


def test_a_part_of_a_scene_that_is_not_known_is_an_error(tmp_path, monkeypatch):
    from openmm_dpd.lammps.exchange import export_job

    monkeypatch.setattr(export_job, "_KNOWN", export_job._KNOWN - {"angles"})
    with pytest.raises(dpd.ParameterError, match="`angles` of the scene cannot be exported"):
        export_lammps(exported.scene("chains"), tmp_path, "x", dt=0.01)
    export_lammps(fluid(), tmp_path, "x", dt=0.01)


def test_edpd_that_lammps_computes_wrongly(tmp_path):
    beads = exported.scene("heat")
    poly = {"exponent_polynomial": (1.0, 0, 0, 0)}
    pairs = {("*", "*"): dpd.EDPD(A=18, gamma=1.0, kappa=0.1, **poly), ("A", "B"): dpd.EDPD(A=20, gamma=1.0, kappa=0.1, **poly)}
    with pytest.raises(dpd.ParameterError, match="the polynomials of the last pair_coeff line"):
        export_lammps(dataclasses.replace(beads, pairs=pairs), tmp_path, "x", dt=0.01)
    with pytest.warns(ExportWarning, match=r"no scheme 'shardlow' of such beads: the deck uses modified velocity Verlet \(fix mvv/edpd\)"):
        written = export_lammps(beads, tmp_path, "word", dt=0.01, scheme="shardlow")
    assert words(written, "fix")[0] == "move all mvv/edpd 0.5"
    short = {("*", "*"): dpd.EDPD(A=18, gamma=1.0, kappa=0.1, cutoff_T=0.5)}
    raises(dpd.ParameterError, "stale values", lambda: export_lammps(dataclasses.replace(beads, pairs=short), tmp_path, "x", dt=0.01))


# -- the command line ---------------------------------------------------------------------------------------------------------
def test_command_line(tmp_path, capsys):
    written = export_lammps(fluid(), tmp_path / "1", "x", dt=0.01, steps=5)
    assert main(["export", str(written.deck), str(tmp_path / "2"), "--scheme", "middle", "--steps", "7"]) == 0
    out, err = capsys.readouterr()
    assert out.split() == [str(tmp_path / "2" / "in.x"), str(tmp_path / "2" / "data.x")]
    assert "different in LAMMPS: LAMMPS has no scheme 'middle'" in err
    assert "run 7\n" in (tmp_path / "2" / "in.x").read_text()
    assert main(["export", str(written.deck), str(tmp_path / "1")]) == 1
    assert "is the deck itself" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "missing"), str(tmp_path / "2")]) == 1


# -- reading back -------------------------------------------------------------------------------------------------------------
HEADER = "ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp pp pp\n-2.0 2.0\n0 4\n0 4\n"


def pair_scene(**changes) -> dpd.Scene:
    two = {"masses": {"A": 1.0}, "types": ["A", "A"], "positions": [[0, 0, 0], [1, 0, 0]], "pairs": {("A", "A"): dpd.DPD(A=25)}, "kT": 1.0}
    return dpd.Scene(**{**two, "box": [4.0, 4, 4], **changes})


def dump(tmp_path, columns: str, *rows: str, header: str = HEADER):
    path = tmp_path / "x.dump"
    frames = [header.format(step=10 * k) + f"ITEM: ATOMS {columns}\n" + row for k, row in enumerate(rows)]
    return put(path, "".join(frames))


def test_ids_images_and_units(tmp_path):
    first = "2 1 1 2 3 0 -1 0 .5 0 0 7\n1 1 -1 1 1 1 0 0 1 0 0 8\n"
    second = "1 1 -1 1 1.5 1 0 0 1 0 0 9\n2 1 1 2 3.5 0 -1 0 .5 0 0 10\n"
    path = dump(tmp_path, "id type x y z ix iy iz vx vy vz c_mine", first, second)
    frames = read_lammps_dump(path, pair_scene())
    assert frames.steps.tolist() == [0, 10] and frames.ids.tolist() == [1, 2]
    np.testing.assert_array_equal(frames.positions[0], [[-1, 1, 1], [1, 2, 3]])
    np.testing.assert_array_equal(frames.unwrapped[1], [[3, 1, 1.5], [1, -2, 3.5]])
    np.testing.assert_array_equal(frames.columns["c_mine"], [[8, 7], [9, 10]])
    found = frames.scene(0)
    np.testing.assert_array_equal(found.positions, [[3, 1, 1], [1, -2, 3]])
    np.testing.assert_array_equal(found.velocities, [[1, 0, 0], [0.5, 0, 0]])
    real = read_lammps_dump(path, units="real")
    np.testing.assert_allclose(real.unwrapped, frames.unwrapped * 0.1)
    np.testing.assert_allclose(real.velocities, frames.velocities * 100)
    raises(dpd.ParameterError, "check the units of the file", lambda: read_lammps_dump(path, pair_scene(box=[40.0, 40, 40])))
    trajectory = frames.trajectory(dt=0.5, unwrap=True)
    np.testing.assert_allclose(trajectory.xyz[0], [[5, 1, 1], [3, -2, 3]])  # from the corner of the box
    np.testing.assert_allclose(trajectory.time, [0, 5])
    np.testing.assert_allclose(trajectory.unitcell_lengths, 4)


@cases(
    "columns, row",
    ("xu yu zu", "-3 0 7"),
    ("xs ys zs ix iy iz", "0.75 0 0.75 -1 0 1"),
    ("xsu ysu zsu", "-0.25 0 1.75"),
    ("x y z ix iy iz", "1 0 3 -1 0 1"),
)
def test_every_kind_of_position(columns, row, tmp_path):
    path = dump(tmp_path, f"id {columns}", f"1 {row}\n2 {row}\n")
    np.testing.assert_allclose(read_lammps_dump(path).unwrapped[0], [[-3, 0, 7]] * 2)


def test_tilted_boxes_of_dumps(tmp_path):
    header = "ITEM: UNITS\nlj\nITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n2\n"
    header += "ITEM: BOX BOUNDS xy xz yz pp pp pp\n-0.5 5.0 1.0\n0.0 4.5 -0.5\n0.0 4.0 0.5\n"
    path = dump(tmp_path, "id xs ys zs ix iy iz", "1 0 0 0 0 0 1\n2 0.5 0 0 0 1 0\n", header=header)
    frames = read_lammps_dump(path)
    np.testing.assert_allclose(frames.boxes[0], [[4, 0, 0], [1, 4, 0], [-0.5, 0.5, 4]])
    np.testing.assert_allclose(frames.unwrapped[0], [[-0.5, 0.5, 4], [3, 4, 0]])
    raises(dpd.ParameterError, "states units lj, not real", lambda: read_lammps_dump(path, units="real"))


@cases(
    "columns, rows, message",
    ("type x y z", ["1 1 1 1\n1 1 1 1\n"], "no column id"),
    ("id vx vy vz", ["1 1 1 1\n2 1 1 1\n"], "the file has no positions"),
    ("id x y z", ["1 1 1 1\n"], "truncated"),
    ("id x y z", ["1 1 1 1\n2 1 1\n"], r"x.dump:11: expected 4 values"),
    ("id x y z", ["1 1 1 1\n2 1 1 a\n"], r"x.dump:11: expected a number in column z"),
    ("id x y z", ["1 1 1 1\n1 1 1 1\n"], "id 1 appears twice"),
    ("id x y z", ["1 1 1 1\n2 1 1 1\n", "1 1 1 1\n3 1 1 1\n"], "step 10 contains different beads from step 0"),
    ("id x y z", ["1 1 1 1\n2 1 1 1\nrubbish\n"], "expected a line 'ITEM"),
)
def test_broken_dumps(columns, rows, message, tmp_path):
    raises(dpd.DeckError, message, lambda: read_lammps_dump(dump(tmp_path, columns, *rows)))


def test_missing_columns_and_wrong_scenes(tmp_path):
    path = dump(tmp_path, "id type x y z", "1 1 1 1 1\n2 1 1 1 1\n")
    frames = read_lammps_dump(path, pair_scene())
    raises(dpd.ParameterError, "has no velocities; have LAMMPS write the columns vx vy vz", frames.scene)
    raises(dpd.ParameterError, "ix iy iz, or xu yu zu", lambda: frames.trajectory(unwrap=True))
    assert frames.trajectory().n_atoms == 2
    raises(dpd.ParameterError, "give the scene", lambda: read_lammps_dump(path).scene())
    raises(dpd.ParameterError, "2 beads, but the scene has 240", lambda: read_lammps_dump(path, fluid()))
    raises(dpd.ParameterError, "there is no frame 3", lambda: frames.scene(3))
    two = pair_scene(masses={"A": 1.0, "B": 1.0}, types=["A", "B"], pairs={("*", "*"): dpd.DPD(A=25)})
    raises(dpd.ParameterError, "id 2 has the type 1, but bead 1 of the scene is 'B', type 2", lambda: read_lammps_dump(path, two))
    raises(dpd.DeckError, "cannot read the file", lambda: read_lammps_dump(tmp_path / "nothing"))


def test_internal_temperatures_come_from_the_computes(tmp_path):
    scene = pair_scene(pairs={("A", "A"): dpd.EnergyDPD(A=25, sigma=3)}, internal=dpd.InternalEnergy(dpd.ConstantHeatCapacity(10.0), 1.0))
    path = dump(tmp_path, "id x y z vx vy vz c_a[1] c_a[2] c_a[4]", "1 0 0 0 0 0 0 5 15 2\n2 0 0 0 0 0 0 -5 35 3\n")
    raises(dpd.ParameterError, "no internal temperatures", lambda: read_lammps_dump(path, scene).scene())
    found = read_lammps_dump(path, scene, names={"c_a[1]": "u_cond", "c_a[2]": "u_mech", "c_a[4]": "theta"}).scene()
    np.testing.assert_allclose(found.internal.energies(found.type_ids, found.type_names), [[5, 15], [-5, 35]])


def test_broken_data_files(tmp_path):
    scene = fluid()
    written = export_lammps(scene, tmp_path, "x", dt=0.01, steps=1)
    text = written.data.read_text()
    np.testing.assert_array_equal(scene_from_data(written.data, scene).velocities, scene.velocities)

    def broken(old: str, new: str):
        assert old in text
        return scene_from_data(put(written.data, text.replace(old, new, 1)), scene)

    raises(dpd.DeckError, "section Atoms has 240 lines, but the header announces 241", lambda: broken("240 atoms", "241 atoms"))
    raises(dpd.DeckError, "expected an atom of atom_style atomic: id type x y z", broken, "Atoms # atomic\n\n1 ", "Atoms # atomic\n\nx ")
    raises(dpd.ParameterError, "no velocities", lambda: broken("Velocities", "Speeds"))
    raises(dpd.DeckError, "has no line 'xlo xhi'", lambda: broken("xlo xhi", "xlow xhigh"))
    raises(dpd.ParameterError, "states units lj, not real", lambda: scene_from_data(written.data, scene, units="real"))
