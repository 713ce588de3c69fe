"""What thermo output, averages and formulas say at a step, beside a live LAMMPS: where a rule decides, not a trajectory."""

import re
from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import cases, put, raises

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, read_deck
from openmm_dpd.lammps.run.runner import DeckRunner

pytestmark = lammps_peer.needed()


def both(folder: Path, text: str, platform: str = "Reference") -> tuple[list[str], list[str]]:
    """Lines of thermo output of the last run, without the one about the CPU, of LAMMPS and of the deck reader; ``f.*`` files go to folders."""
    found = []
    for name in ("theirs", "ours"):
        (folder / name).mkdir()
    with lammps_peer.instance() as lmp:
        lmp.commands_list([f"shell cd {folder}/theirs", "log log"])
        lmp.commands_string(text)
        lmp.command("log none")
    found.append(table((folder / "theirs" / "log").read_text().splitlines()))
    path, lines = folder / "in.ours", []
    runner = DeckRunner(RunOptions(platform=platform, threads=1), lines.append)
    read_deck(put(path, text), run_callback=runner.carry_out, output=folder / "ours")
    found.append(table("\n".join(lines).splitlines()))
    return found[0], found[1]


def table(lines: list[str]) -> list[str]:
    """The last table in a log, up to what LAMMPS says about its loop."""
    loops = [k for k, line in enumerate(lines) if line.startswith("Loop time")]
    lines = lines[: loops[-1]] if loops else lines
    start = max(k for k, line in enumerate(lines) if "Step" in line.split() or line.startswith(("------------ Step", "keywords: ")))
    return lines[start:]


def numbers(rows: list[str]) -> dict[str, float]:
    """Last row by title."""
    return dict(zip(rows[0].split(), map(float, rows[-1].split()), strict=True))


# -- temperatures and pressures that thermo_modify chooses --------------------------------------------------------------------------
CHOICES = """lattice sc 1.0
region box block 0 5 0 5 0 5
create_box 2 box
create_atoms 1 region box
group ga id 1:60
group gb subtract all ga
mass * 1.0
comm_modify vel yes
pair_style dpd 0.0 1.0 3
pair_coeff * * 25 0
velocity ga set 1 0 0
velocity gb set -1 0.5 0
velocity gb ramp vy -1 1 z 0 5
compute ta ga temp
compute tb gb temp
compute pp all pressure ta
compute pq all pressure tb
compute pv all pressure NULL virial
fix 1 all nve
variable ct equal c_thermo_temp
variable cp equal c_thermo_press
variable ce equal c_thermo_pe+c_pp
"""
FULL = "thermo_style custom step temp press ke enthalpy c_thermo_temp c_thermo_press v_ct v_cp v_ce c_pp c_pq c_pv c_ta\n"


@cases(
    "text",
    FULL,
    FULL + "thermo_modify temp ta\n",
    FULL + "thermo_modify press pp\n",
    FULL + "thermo_modify temp ta press pq\n",
    FULL + "thermo_modify press pq temp ta\n",
    "thermo_style custom step temp c_thermo_temp v_cp ke\nthermo_modify temp ta\n",
    FULL + "thermo_modify temp ta\n" + FULL,
    "thermo_modify temp ta\n" + FULL,
    FULL + "thermo_modify temp ta\nthermo_modify temp thermo_temp\n",
)
def test_built_in_computes_beside_thermo_modify(tmp_path, text):
    average = "fix a all ave/time 1 1 1 c_thermo_temp c_thermo_press c_pp c_pq v_ct v_cp file f.ave\n"
    theirs, ours = both(tmp_path, CHOICES + text + average + "run 0\n")
    assert numbers(ours) == pytest.approx(numbers(theirs), rel=1e-7)
    assert (tmp_path / "ours" / "f.ave").read_text() == (tmp_path / "theirs" / "f.ave").read_text()


# -- layouts ------------------------------------------------------------------------------------------------------------------------
@cases(
    "text",
    "thermo_style multi",
    "thermo_style multi\nthermo_modify format float %12.3e",
    "thermo_style custom step temp pe press lx cella cellb cellc cellalpha atoms\nthermo_modify line multi",
    "thermo_style custom step temp pe press cella atoms\nthermo_modify line multi format float %10.3f format int %5d format 2 %9.1f",
    "thermo_style custom step temp pe press atoms\nthermo_modify format float %10.3f\nthermo_modify line multi",
    'thermo_style custom step temp pe press\nthermo_modify line multi format line "%d %g %8.3f %12.5e"',
    "thermo_style custom step temp cella press\nthermo_modify line one",
    "thermo_style custom press step atoms temp v_cp c_pp vol\nthermo_modify colname temp a_long_title_of_22_chars",
    "thermo_style one\nthermo_modify format int %4d",
    "thermo_style custom step atoms ke press\nthermo_modify format 3 %-20.5f format 1 '%5d:'",
    "thermo_style custom temp step\nthermo_modify format float %10.3f",
    "thermo_style custom pe step pe atoms\nthermo_modify format int %4ld format 3 %.1f format pe %.0f colname pe U colname 3 N",
    "thermo_style custom step pe atoms\nthermo_modify format float %8.3f format none flush yes lost warn",
    "thermo_modify format float %8.3f\nthermo_style custom step pe atoms",
    "thermo_style custom step pe atoms\nthermo_modify format line '%d %6.2f %5d'",
    "thermo_style yaml\nthermo_modify format float %.9g",
)
def test_layouts_to_the_character(tmp_path, text):
    theirs, ours = ("\n".join(lines) for lines in both(tmp_path, CHOICES + text + "\nrun 0\n"))
    assert re.sub("CPU = .* .sec", "", ours) == re.sub("CPU = .* .sec", "", theirs)


# -- forces and energies of few beads ------------------------------------------------------------------------------------------------
FOUR = """comm_modify vel yes
atom_modify map yes
region b block 0 4 0 4 0 4
create_box 2 b
create_atoms 1 single 1 1 1
create_atoms 1 single 1.4 1 1
create_atoms 2 single 1.2 1.5 1.1
create_atoms 2 single 1.3 1.6 1.7
mass * 1.0
pair_style dpd 0.0 1.0 3
pair_coeff * * 25 4.5
group m type 1
group f type 2
velocity m set 1 0.2 0
"""
ALONE = FOUR.partition("create_atoms 1 single 1.4")[0] + "mass * 1.0\npair_style dpd 0.0 1.0 3\n"
ALONE += "pair_coeff * * 25 4.5\nvelocity all set 1 2 3\n"
FEW = {
    "immobile": (FOUR + "velocity f set 0.3 0 0\nfix 1 m nve\n", "temp pe ke etotal fnorm fmax press"),
    "held": (FOUR + "fix 1 all nve\nfix 2 f setforce 0 0 0\n", "temp pe ke etotal fnorm fmax press enthalpy"),
    "pushed and held": (FOUR + "fix 1 all nve\nfix 2 all addforce 3 0.1 0.7\nfix 3 f setforce 0 0 0\n", "pe fnorm fmax"),
    "pushed": (FOUR + "fix 1 all nve\nfix 2 all addforce 3.0 0.1 0.7\n", "temp pe ke etotal evdwl fnorm fmax press enthalpy"),
    "pushed by a formula": (
        FOUR + "variable a atom 0.3*x+y\nfix 1 all nve\nfix 2 all addforce v_a 0.1 0.7\n",
        "temp pe ke etotal evdwl press",
    ),
    "alone": (
        ALONE + "fix 1 all nve\ncompute k all ke\ncompute t all temp\ngroup one id 1\ncompute to one temp\n",
        "temp ke pe etotal press c_k c_t c_to c_t[1]",
    ),
}


@pytest.mark.parametrize("platform", ["Reference", "CPU"])
@pytest.mark.parametrize("name", FEW)
def test_forces_and_energies_of_few_beads(tmp_path, name, platform):
    prepare, words = FEW[name]
    text = f"{prepare}thermo_style custom step {words}\nthermo_modify norm no format float %.15g\ndump 1 all custom 1 f.dump id fx fy fz\n"
    theirs, ours = both(tmp_path, text + "dump_modify 1 sort id format float %.9g\nrun 0\n", platform)
    assert numbers(ours) == pytest.approx(numbers(theirs), rel=1e-10, abs=1e-12)
    forces = [np.loadtxt(tmp_path / which / "f.dump", skiprows=9) for which in ("ours", "theirs")]
    # a formula sees positions rounded to 2^-20 nm, half of which times its slope (at most 1) is how far it may be off
    np.testing.assert_allclose(*forces, rtol=1e-8, atol=2.0**-20 if "formula" in name else 1e-9)


# -- formulas --------------------------------------------------------------------------------------------------------------------------
FORMULAS = (
    "sign(0) sign(-0.0) sign(-2) round(-2.5) round(2.5) round(-0.5) round(0.49999999999999994) round(-3.2) round(1e17) 0^0 -2^2 "
    "5.5%2 -5%3 ceil(-0.5) atan2(0,ceil(-0.5)) atan2(0,round(-0.3)) atan2(0,floor(-0.0)) atan2(0,floor(0.3)) floor(-0.5) !0 !(2)+1 "
    "(1<2)<3 1&&0||1 2^-1 ternary(0,1,2) ternary(-1,1,2) atan2(1,2) log(1000) x[2] bound(all,zmax) xcm(all,x) count(all,low) "
    "vcm(m,x) mass(f)"
)


def test_formulas(tmp_path):
    listed = FORMULAS.split()
    prints = "".join(f'print "{formula} = $({formula})" append f.out\n' for formula in listed)
    atom = "".join(f"variable a{k} atom {text}\ncompute r{k} all reduce sum v_a{k}\n" for k, text in enumerate(ATOM))
    words = " ".join(f"c_r{k}" for k in range(len(ATOM)))
    text = f"{FOUR}region low block INF 1.2 INF INF INF INF\nfix 1 all nve\n{prints}{atom}thermo_style custom step {words}\nrun 0\n"
    theirs, ours = both(tmp_path, text)
    assert numbers(ours) == pytest.approx(numbers(theirs), rel=1e-7)
    lines = [(tmp_path / which / "f.out").read_text().splitlines() for which in ("ours", "theirs")]
    for one, other in zip(*lines, strict=True):
        assert one.split(" = ")[0] == other.split(" = ")[0]
        assert float(one.split(" = ")[1]) == pytest.approx(float(other.split(" = ")[1]), rel=1e-14), one


ATOM = ("sign(x-1.2)", "round(x*2.5)", "round(-2.5*x)", "sign(0)", "ternary(x>1.25,3,y)", "(x-1)%0.15", "!(type-1)", "vx^2-fx")


def test_variables_within_formulas_have_fifteen_digits(tmp_path):
    """LAMMPS puts their text there; alone they keep all digits."""
    text = f"""{FOUR}fix 1 all nve
variable a equal 0.1+0.2
variable b equal v_a==0.3
variable c equal v_a-0.3
variable d atom v_a-0.3
variable e equal 1/3
variable f equal 3*v_e-1
variable g index 0.30000000000000004
variable h equal v_g-0.3
compute d all reduce max v_d
thermo_style custom step v_a v_b v_c v_f v_h c_d
thermo_modify format float %.17g
fix a all ave/time 1 1 1 v_e v_f file f.ave format " %.17g"
run 0
print "$(v_b) $(v_c) $(v_a-0.3) ${{a}} $(v_e-1/3) $(v_h)" append f.out
"""
    theirs, ours = both(tmp_path, text)
    assert numbers(ours) == numbers(theirs)
    for name in ("f.ave", "f.out"):
        assert (tmp_path / "ours" / name).read_text() == (tmp_path / "theirs" / name).read_text()


@pytest.mark.parametrize("formula", ["2_5", "٣", "1e5_0", "1/0", "5%0", "sqrt(-1)", "ln(0)", "asin(2)", "0^-1", "ternary(1,2)", "abs(1"])
def test_formulas_that_both_refuse(tmp_path, formula):
    text = f'{FOUR}variable v equal {formula}\nprint "$({formula})"\n'
    with lammps_peer.instance() as lmp, pytest.raises(Exception, match="ERROR"):
        lmp.commands_string(text)
    path = put(tmp_path / "in.ours", text)
    raises(DeckError, r"in.ours:16: .*formula|in.ours:16: '\$\(' is never closed", lambda: read_deck(path))


@pytest.mark.parametrize("number", ["2_5", "٢٥", "2e1_0", "nan", "inf", "1d2", "0x19"])
def test_numbers_that_both_refuse(tmp_path, number):
    text = f"region b block 0 4 0 4 0 4\ncreate_box 1 b\nmass 1 {number}\n"
    with lammps_peer.instance() as lmp, pytest.raises(Exception, match="ERROR|utf-8"):  # its message may be cut in the middle of a letter
        lmp.commands_string(text)
    path = put(tmp_path / "in.ours", text)
    raises(DeckError, "in.ours:3: .*mass", lambda: read_deck(path))
    for place in (f"1 1 1 {number} 1", f"1 {number} 1 1 1", f"{number} 1 1 1 1"):
        data = tmp_path / "data"
        head = "title\n\n1 atoms\n1 atom types\n\n0 4 xlo xhi\n0 4 ylo yhi\n0 4 zlo zhi\n\n"
        data.write_text(f"{head}Atoms # atomic\n\n{place}\n", encoding="utf-8")
        with lammps_peer.instance() as lmp, pytest.raises(Exception, match="ERROR|utf-8"):
            lmp.command(f"read_data {data}")
        raises(DeckError, "data:12: ", lambda: read_deck(put(path, "read_data data\n")))


# -- steps at which ramps, oscillations and averages begin --------------------------------------------------------------------------------
def test_formulas_count_from_the_start_that_run_names(tmp_path):
    text = f"""{FOUR}fix 1 all nve
timestep 0.01
variable v equal vdisplace(0,1)
variable s equal swiggle(0,1,0.2)
variable c equal cwiggle(1,2,0.3)
variable r equal ramp(0,3)
run 4 start 0 stop 8
run 4 start 0 stop 8
fix a all ave/time 1 1 1 v_v v_s v_c v_r file f.ave format " %.6g"
run 1 start 0 stop 9
run 2
run 2 start 8
"""
    both(tmp_path, text)
    assert (tmp_path / "ours" / "f.ave").read_text() == (tmp_path / "theirs" / "f.ave").read_text()


@pytest.mark.parametrize("begin", [0, 3])
def test_steps_of_averages(tmp_path, begin):
    """Averages of the number of the step say from which steps they are taken, and at which they are written."""
    cases = [(schedule, start) for schedule in ("1 1 5", "5 1 5", "1 2 5", "2 3 10", "1 1 1") for start in (None, 0, 3, 5, 6, 10, 11)]
    fixes = "".join(
        f"fix a{k} all ave/time {schedule} v_s {'' if start is None else f'start {start}'} file f{k}.ave\n"
        for k, (schedule, start) in enumerate(cases)
    )
    both(tmp_path, f"{FOUR}fix 1 all nve\nreset_timestep {begin}\nvariable s equal step\n{fixes}run 14\nrun 7\n")
    for k, case in enumerate(cases):
        ours, theirs = ((tmp_path / which / f"f{k}.ave").read_text() for which in ("ours", "theirs"))
        assert ours == theirs, case


# -- one temperature ---------------------------------------------------------------------------------------------------------------------------
@cases(
    "styles, coefficients, temperature",
    ("dpd/ext 1.0 1.0 35 dpd/tstat 3.0 3.0 1.0 36", ("dpd/ext 25 0 4.5 1 1", "dpd/tstat 0.05"), None),
    ("dpd 0.0 1.0 35 dpd/ext/tstat 1.0 1.0 1.0 36", ("dpd 25 0", "dpd/ext/tstat 0 4.5 1 1"), 1.0),
    ("dpd/fdt 2.0 1.0 35 dpd/tstat 1.0 1.0 1.0 36", ("dpd/fdt 25 0", "dpd/tstat 4.5"), 1.0),
    ("dpd/fdt 2.0 1.0 35 dpd/tstat 1.0 1.0 1.0 36", ("dpd/fdt 25 3", "dpd/tstat 4.5"), None),
    ("dpd 2.0 1.0 35 dpd/tstat 1.0 1.0 1.0 36", ("dpd 25 0", "dpd/tstat 0"), 2.0),
)
def test_the_temperature_is_that_of_the_styles_with_friction(tmp_path, styles, coefficients, temperature):
    lines = "".join(f"pair_coeff * * {words}\n" for words in coefficients)
    path = tmp_path / "in.ours"
    plain = "pair_style dpd 0.0 1.0 3\npair_coeff * * 25 4.5\n"
    path.write_text(FOUR.replace(plain, f"pair_style hybrid/overlay {styles}\n{lines}") + "fix 1 all nve\nrun 0\n")
    if temperature is None:
        raises(DeckError, "in.ours:.*have different temperatures", lambda: read_deck(path))
        return
    assert read_deck(path, stop_before_first_run=True).first_run.scene().kT == temperature


# -- what differs is said or refused --------------------------------------------------------------------------------------------------------------
def test_pre_no_is_said(tmp_path):
    path = put(tmp_path / "in.ours", FOUR + "fix 1 all nve\nrun 2\nrun 2 pre no\n")
    assert any("forces are recomputed" in note for note in read_deck(path).notes)
    assert not any("anew" in note for note in read_deck(put(path, FOUR + "fix 1 all nve\nrun 2\nrun 2 pre yes post no\n")).notes)


@pytest.mark.parametrize("last", ["", "bond_coeff 3 harmonic 10 1\n"])
def test_lammps_reads_coefficients_of_hybrid_bonds(tmp_path, last):
    """A section that would not name every type, which LAMMPS cannot read, is left out."""
    text = "title\n\n2 atoms\n1 atom types\n1 bonds\n3 bond types\n\n0 5 xlo xhi\n0 5 ylo yhi\n0 5 zlo zhi\n\nMasses\n\n1 1\n\n"
    (tmp_path / "data").write_text(text + "Atoms # bond\n\n1 1 1 1 1 1\n2 1 1 1.5 1 1\n\nBonds\n\n1 1 1 2\n")
    styles = "atom_style bond\nbond_style hybrid fene zero harmonic\nspecial_bonds fene\n"
    path = tmp_path / "in.ours"
    path.write_text(f"{styles}read_data data\nbond_coeff 1 fene 30 1.5 1 1\nbond_coeff 2 zero\n{last}write_data data.out\nquit\n")
    state = read_deck(path, stop_before_first_run=True, output=tmp_path)
    assert ("Bond Coeffs" in (tmp_path / "data.out").read_text()) == bool(last)
    assert any("since some types have none" in note for note in state.notes) == (not last)
    with lammps_peer.instance() as lmp:
        lmp.commands_string(f"{styles}read_data {tmp_path}/data.out\n")
        assert lmp.get_natoms() == 2


# -- beads on faces while a run measures -----------------------------------------------------------------------------------------
ON_FACES = "units {units}\nlattice sc {scale}\nregion box {box}\ncreate_box 2 box\ncreate_atoms 1 box\nmass * 1.0\npair_style zero 0.5\n"
ON_FACES += "pair_coeff * *\nfix 1 all nve\n"


def on_faces(units: str, tilt: str) -> str:
    """Beads that nothing moves on faces of everything, where a rounding error on the way through a simulation would show."""
    scale = 1.1 if units == "real" else 1.1**-3
    return ON_FACES.format(units=units, scale=scale, box=f"prism 0 8 0 8 0 8 {tilt}" if tilt else "block 0 8 0 8 0 8")


@pytest.mark.parametrize("units", ["lj", "real"])
@pytest.mark.parametrize("tilt", ["", "2.2 -1.1 0.7"])
def test_beads_on_faces_of_regions_in_a_run(tmp_path, units, tilt):
    text = f"""{on_faces(units, tilt)}region r block 3 6 INF INF EDGE 5
region s sphere 3 3 3 2
variable r equal count(all,r)
variable s equal count(all,s)
variable b equal bound(all,xmax)
fix v all ave/time 1 1 1 v_r v_s v_b file f.v
thermo_style custom step v_r v_s v_b
"""
    after = 'run 0\ngroup r region r\nprint "$(count(r)) $(count(all,s))" append f.n\n'
    theirs, ours = both(tmp_path, text + after + after.replace("run 0", "run 2").replace("group r", "group q"))
    assert numbers(ours) == numbers(theirs)
    for name in ("v", "n"):
        assert (tmp_path / "ours" / f"f.{name}").read_text() == (tmp_path / "theirs" / f"f.{name}").read_text()


@pytest.mark.parametrize("units", ["lj", "real"])
@pytest.mark.parametrize("tilt", ["", "2.2 -1.1 0.7"])
def test_beads_on_faces_of_slices_in_a_run(tmp_path, units, tilt):
    options = "units reduced" if tilt else "units box"
    width = 0.125 if tilt else 1.1
    text = f"""{on_faces(units, tilt)}compute x all chunk/atom bin/1d x lower {width} {options}
compute yz all chunk/atom bin/2d y 0.0 {width} z lower {2 * width} {options}
fix x all ave/chunk 1 1 1 x density/number file f.x
fix yz all ave/chunk 1 1 1 yz density/number file f.yz
run 0
"""
    both(tmp_path, text)
    for name in ("x", "yz"):
        assert (tmp_path / "ours" / f"f.{name}").read_text() == (tmp_path / "theirs" / f"f.{name}").read_text()


# -- what is printed, and where ------------------------------------------------------------------------------------------------------
@cases(
    "lines, files",
    ('thermo_style custom step temp pe\nthermo_modify format line "%d, %g; %g"\nrun 1\n', ()),
    ('thermo_style custom step temp pe\nthermo_modify format line "old%ld l%g, fell%g" format 3 field=%8.3f\nrun 1\n', ()),
    ('thermo_style custom step temp pe\nthermo_modify format line "%d %g %g" format float %8.3f format 3 %.1f\nrun 1\n', ()),
    ("group e empty\ncompute a e reduce min x\ncompute b e reduce max x vx\ncompute c e com\n"
     "thermo_style custom step c_a c_b[1] c_b[2] c_c[1]\nthermo_modify format float %g\nrun 0\n", ()),
    ('variable i index 1\nvariable j equal 2*step\nfix p$i all print 1 "x $(step)" file f.p*.txt screen no\nvariable cmd string "fix q all print 1 hello file f.q.txt screen no"\n'
     'print "hi" file f.print.*.txt screen no\n${cmd}\nfix a all ave/time 1 1 1 v_j file f.a*.txt\nrun 1\n',
     ("f.p*.txt", "f.q.txt", "f.print.*.txt", "f.a*.txt")),
)  # fmt: skip
def test_formats_and_names(tmp_path, lines, files):
    """Separators of a format line, and other formats beside it; what no beads give; names with a star, and fixes that a variable names."""
    theirs, ours = both(tmp_path, f"{FOUR}fix 1 all nve\ntimestep 0.01\n{lines}")
    assert [line.split() for line in ours] == [line.split() for line in theirs]
    for name in files:
        assert (tmp_path / "ours" / name).read_text() == (tmp_path / "theirs" / name).read_text()


def test_rdf_up_to_the_cutoff_of_charges(tmp_path):
    """... where that is the longest."""
    lines = "set group all charge v_q\npair_style hybrid/overlay dpd 0 0.8 4 coul/slater/long 0.5 1.9\npair_coeff * * dpd 25 2\n"
    text = f"""units lj
atom_style charge
comm_modify vel yes
lattice sc 1.0
region b block 0 4 0 4 0 4
create_box 1 b
create_atoms 1 region b
mass 1 1
displace_atoms all ramp x 0 0.3 y 0 4
displace_atoms all ramp z 0 0.45 x 0 4
variable q atom 1-2*(id%2)
{lines}pair_coeff * * coul/slater/long
kspace_style ewald 1e-4
compute r all rdf 5
fix r all ave/time 1 1 1 c_r[*] file f.rdf mode vector
fix 1 all nve
thermo_style custom step
run 0
"""
    both(tmp_path, text)
    ours, theirs = (np.loadtxt(tmp_path / which / "f.rdf", skiprows=4) for which in ("ours", "theirs"))
    assert np.allclose(ours, theirs, rtol=1e-5) and ours[-1, 1] == pytest.approx(1.71)
