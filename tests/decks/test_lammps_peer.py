"""The deck reader against a live LAMMPS: beads, groups, coefficients, thermo words, dump files and data files."""

import re
import shutil
from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import cases, put
from lammps_peer import ours, same_beads, theirs

from openmm_dpd.lammps import RunOptions, RunRequest, read_deck, run_deck
from openmm_dpd.lammps.commands.output import data_file_lines
from openmm_dpd.lammps.run.runner import DeckRunner
from openmm_dpd.lammps.state.records import DeckSample
from openmm_dpd.lammps.values.resolver import Resolver

pytestmark = lammps_peer.needed()

DECKS = Path(__file__).resolve().parents[2] / "examples" / "decks"
FINISH = "\npair_style zero 1.0\npair_coeff * *\nmass * 1.0\nrun 0\n"  # LAMMPS wraps beads that were moved when a run begins


BLOCK = "region b block 0 4 0 3 0 5\ncreate_box 2 b\n"
BEADS = {
    **{f"lattice {style}": f"lattice {style} 0.85\n{BLOCK}create_atoms 1 box\n" for style in ("sc", "bcc", "fcc", "hcp", "diamond")},
    "metal": "units metal\nlattice fcc 3.52 origin 0.25 0.1 0\nregion b block -2 4 1 3 0 5\ncreate_box 2 b\ncreate_atoms 1 box\n",
    "orient": f"lattice fcc 0.85 orient x 1 1 0 orient y -1 1 0 orient z 0 0 1\n{BLOCK}create_atoms 1 box\n",
    "custom": "lattice custom 1.7 a1 1 0 0 a2 0 1.5 0 a3 0 0 2 basis 0 0 0 basis 0.5 0.5 0.25\n" + BLOCK + "create_atoms 1 box basis 2 2\n",
    "prism": "lattice fcc 3.0\nregion b prism 0 5 0 4 0 6 1.3 -0.7 0.9\ncreate_box 2 b\ncreate_atoms 1 box\n",
    "regions": """lattice fcc 3.0
region b block 0 5.503 0 5.503 0 4.7 units box
create_box 2 b
region s sphere 2 2 2 1.5
region c cylinder z 2.5 2.5 1.7 INF INF units box
region o block 1 3 EDGE INF 1 2 side out
region u union 2 s c
region i intersect 2 s o
create_atoms 1 region u
create_atoms 2 region o
group s region s
group c region c
group i region i
""",
    "set in a tilted box": "lattice sc 1.0\nregion b prism 0 5 0 4 0 6 1.3 -0.7 0.9 units box\ncreate_box 2 b\n"
    "create_atoms 1 region b\nmass * 1.0\nset atom 1*20 x 7.5\nset atom 5*9 vx 3\nset type 1 vz -1\n",
    "groups and velocities": """region b block -1 5 0 5 2 5 units box
create_box 3 b
mass * 1.0
create_atoms 1 single -1 0 2
create_atoms 1 single 5 1 2.5
create_atoms 1 single 4.9999999999 1 2.5
create_atoms 2 single 1 1 3 units box
lattice fcc 0.5
create_atoms 3 single 1 2 1.7
create_atoms 2 region b
group a type 1 2
group bb id 1:3 7 10:20:3
group cc type > 1
group dd id <> 4 9
group ee subtract all a bb
group ff union a ee
group gg intersect all cc
group a id 30
set group bb type 3
set atom 12 type 2
set atom 3*5 x 1.5 y -3
velocity gg set 1.0 NULL -0.5
velocity bb set 1.0 2.0 NULL units box
velocity bb set 1.0 2.0 NULL units box sum yes
velocity all ramp vx 0 2 z 2 4 units box
velocity dd ramp vy -1 2 x 0 1 sum yes
delete_atoms group bb compress no
""",
}


@pytest.mark.parametrize("name", BEADS)
def test_beads_and_groups(tmp_path, name):
    same_beads(tmp_path, BEADS[name] + FINISH)


@pytest.mark.parametrize("name", ["in.bonded", "in.dpd-shardlow", "in.dpd-vv", "in.dpd_tstat", "in.ramp", "in.triclinic"])
def test_beads_of_the_example_decks(tmp_path, name):
    """Positions, images, types and groups up to the first run; velocities where they come from a file."""
    text = (DECKS / name).read_text().partition("\nrun ")[0]
    text = re.sub(r"\b(data|table)\.", lambda match: f"{DECKS}/{match[0]}", text)
    same_beads(tmp_path, text + "\n", velocities="velocity" not in text)


LJ = "pair_coeff 1 1 0.5 1.0\npair_coeff 2 2 1.2 1.4 2.4\npair_coeff 3 3 1 1\n"
PAIRS = {
    "wildcards": "pair_style dpd 1 1 7\npair_coeff * * 25 4.5\npair_coeff 1 2* 30 5 0.9\npair_coeff *2 3 31 6\n"
    "pair_coeff 3 1 32 7 1.5\npair_coeff 2*3 2*3 33 8\npair_coeff 2 * 34 9\n",
    "repeated style": "pair_style dpd 1 1 7\npair_coeff * * 25 4.5\npair_coeff 1 2 30 5 0.9\npair_style dpd 2 1.3 8\n"
    "pair_coeff 1 3 26 4 1.1\n",
    "geometric": f"pair_style lj/cut 2.0\n{LJ}",
    "arithmetic": f"pair_style lj/cut 2.0\npair_modify mix arithmetic\n{LJ}",
    "sixthpower": f"pair_style lj/cut 2.0\npair_modify mix sixthpower\n{LJ}",
    "repeated lj/cut": "pair_style lj/cut 2.0\npair_modify mix arithmetic\npair_coeff * * 0.5 1.0 1.5\npair_style lj/cut 2.3\n",
}


@pytest.mark.parametrize("name", PAIRS)
def test_pair_coefficients(tmp_path, name):
    """Both write PairIJ Coeffs; the numbers must be the same."""
    start = "region b block 0 9 0 9 0 9\ncreate_box 3 b\ncreate_atoms 1 single 1 1 1\nmass * 1\ncomm_modify vel yes\n"
    with lammps_peer.instance() as lmp:
        lmp.commands_string(start + PAIRS[name] + f"run 0\nwrite_data {tmp_path}/theirs pair ij\n")
    ours(tmp_path, start + PAIRS[name] + "write_data ours pair ij\n")
    both = []
    for file in ("theirs", "ours"):
        lines = (tmp_path / file).read_text().splitlines()
        start_row = lines.index(next(line for line in lines if line.startswith("PairIJ"))) + 2
        both.append(np.array([line.split() for line in lines[start_row : start_row + 6]], dtype=float))
    np.testing.assert_allclose(both[1], both[0], rtol=5e-6)  # LAMMPS writes six digits: half a unit of the last one


WORDS = (
    "step elapsed time dt temp press pe ke etotal enthalpy evdwl ecoul elong epair ebond emol vol density lx ly lz xlo xhi ylo yhi "
    "zlo zhi xy xz yz cella cellb cellc cellalpha cellbeta cellgamma atoms fnorm fmax v_a v_b v_c v_d v_e v_f v_g v_h c_t c_k c_p "
    "c_pv c_m[2] c_c[1] c_thermo_pe c_thermo_temp"
)


def thermo_deck(units: str, norm: str, scale: float) -> tuple[str, str]:
    """What only LAMMPS does (a random bonded crystal), and what both do."""
    prepare = f"""units {units}
atom_style bond
lattice sc {scale}
region b prism 0 6 0 6 0 6 0.5 -0.7 1.1
create_box 2 b bond/types 1 extra/bond/per/atom 2
create_atoms 1 box
set group all type/fraction 2 0.3 77
mass 1 12.0
mass 2 20.0
pair_style lj/cut {1.9 * scale}
pair_coeff * * 0.3 {0.95 * scale}
pair_coeff 2 2 0.2 {0.8 * scale}
bond_style harmonic
bond_coeff 1 3.0 {0.9 * scale}
create_bonds single/bond 1 1 2
velocity all create {1.0 if units == "lj" else 300.0} 123 mom no
displace_atoms all random 0.1 0.1 0.1 55 units box
write_data data.start
clear
"""
    both = f"""units {units}
atom_style bond
bond_style harmonic
pair_style lj/cut {1.9 * scale}
read_data data.start
region b prism 0 {6 * scale} 0 {6 * scale} 0 {6 * scale} {0.5 * scale} {-0.7 * scale} {1.1 * scale} units box
special_bonds lj 0.3 0.5 1
group two type 2
reset_timestep 40
timestep 0.004
compute t two temp
compute k two ke
compute p all pressure t
compute pv all pressure NULL virial
compute m two momentum
compute c two com
variable a equal pe/count(all)
variable b equal etotal+c_t*ke
variable c equal c_k-count(two)
variable d equal vcm(two,y)+ke(two)
variable e equal mass(two)*x[3]+xcm(all,z)
variable f equal ramp(2,4)
variable g equal bound(two,xmax)
variable h equal c_thermo_pe/count(all,b)
fix 1 all nve
thermo_style custom {WORDS}
thermo_modify {norm} format float %.15g
dump 1 all atom 10 dump.atom
dump 2 two custom 10 dump.custom id type mol mass xs ysu x yu vx ix iz
dump_modify 1 sort id
dump_modify 2 sort id
run 0 start 20 stop 60
"""
    return prepare, both


@cases("units, norm, scale", ("lj", "", 1.0), ("lj", "norm no", 1.0), ("real", "", 4.0), ("metal", "norm yes", 4.0))
def test_thermo_words_and_dumps(tmp_path, units, norm, scale):
    """LAMMPS's energies, virial and forces are put in; every word and formula made of them must come out the same."""
    prepare, both = thermo_deck(units, norm, scale)
    log = tmp_path / "log"
    with lammps_peer.instance() as lmp:
        lmp.command(f"shell cd {tmp_path}")
        lmp.commands_string(prepare)
        lmp.command(f"log {log}")
        lmp.commands_string(both)
    lines = log.read_text().splitlines()
    header = lines.index(next(line for line in lines if line.split()[:2] == ["Step", "Elapsed"]))
    expected = dict(zip(WORDS.split(), map(float, lines[header + 1].split()), strict=True))
    for name in ("atom", "custom"):
        (tmp_path / f"dump.{name}").rename(tmp_path / f"theirs.{name}")

    found: dict[str, float] = {}

    def callback(request: RunRequest) -> None:
        state, scene = request.state, request.scene()
        u, n = state.units, scene.n_beads
        kinetic = 0.5 * float(scene.bead_masses @ np.sum(scene.velocities**2, axis=1))
        beads = n if norm == "norm yes" or (units == "lj" and not norm) else 1
        energies = {"pair_energy": expected["evdwl"] * beads * u.energy, "bond_energy": expected["ebond"] * beads * u.energy}
        virial = expected["press"] * u.pressure * 3 * state.box.volume * u.length**3 - 2 * kinetic
        forces = {"force_norm": expected["fnorm"] * u.force, "force_max": expected["fmax"] * u.force}
        moving = {"positions": scene.positions, "velocities": scene.velocities}
        sample = DeckSample(step=request.first_step, kinetic=kinetic, virial=virial, **energies, **forces, **moving)
        found.update(request.thermo.values(sample))
        for dump in request.dumps:
            assert dump.due(request.first_step)
            dump.write(Resolver(state, sample, request.window))

    read_deck(put(tmp_path / "in.ours", both), run_callback=callback, output=tmp_path)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)
    for name in ("atom", "custom"):
        mine, reference = ((tmp_path / f"{kind}.{name}").read_text().split() for kind in ("dump", "theirs"))
        assert len(mine) == len(reference)
        for one, other in zip(mine, reference, strict=True):
            # box bounds carry 17 digits; everything else must be the same text
            assert one == other or float(one) == pytest.approx(float(other), rel=1e-14)


@pytest.mark.parametrize("tilted", [False, True])
def test_lammps_reads_the_data_files_we_write(tmp_path, tilted):
    text = f"""units real
atom_style full
bond_style harmonic
region b {"prism -3 27 0 31 2 35 4.5 -6 7" if tilted else "block -3 27 0 31 2 35"} units box
create_box 2 b bond/types 1
create_atoms 1 random 30 5 NULL
create_atoms 2 random 20 6 NULL
mass 1 12.0
mass 2 18.0154
set type 1 charge -0.5 mol 3
set atom 7 image -1 2 3
bond_coeff 1 30 1.5
velocity all create 300 77
pair_style dpd 300 9 1
pair_coeff * * 0.5 1.0
pair_coeff 1 2 0.4 1.5 8.0
write_data data.ours pair ij
"""
    state = ours(tmp_path, text)
    styles = "units real\natom_style full\nbond_style harmonic\npair_style dpd 300 9 1\ncomm_modify vel yes\n"
    beads, _ = theirs(tmp_path, styles + "read_data data.ours\nrun 0\n")
    np.testing.assert_allclose(beads[:, 2:5], state.atoms.positions, rtol=1e-12)
    np.testing.assert_allclose(beads[:, 8:], state.atoms.velocities, rtol=1e-12)
    assert np.array_equal(beads[:, 5:8], state.atoms.images)


# -- steps without noise -----------------------------------------------------------------------------------------------------
BEADS_OF_STEPS = """units {units}
atom_style {style}
lattice fcc {density} origin 0.1 0.1 0.1
region b {region}
create_box 2 b
create_atoms 1 box
set atom 1*60 type 2
group two type 2
mass 1 {mass}
mass 2 $(1.7*{mass})
set atom 3*9 vx {speed}
velocity all ramp vx -{speed} {speed} y 0 4 units box
velocity all ramp vz {speed} -{speed} x 0 3 sum yes units box
"""
LJ_BEADS = BEADS_OF_STEPS.format(units="lj", style="atomic", density=3.1, region="prism 0 4 0 3 0 3 0.7 -0.5 0.3", mass=0.9, speed=1.3)
REAL_BEADS = BEADS_OF_STEPS.format(units="real", style="atomic", density=7.1, region="block 0 4 0 3 0 3", mass=54.0, speed=0.01)
STEPS = {
    "dpd": LJ_BEADS + "pair_style dpd 0 1.1 3\npair_coeff * * 23.5 3.75\npair_coeff 1 2 31 6 0.9\nfix 1 all nve\ntimestep 0.02\n",
    "moving beads in no fix": LJ_BEADS
    + "pair_style dpd 0 1.1 3\npair_coeff * * 23.5 3.75\nfix 1 two nve\ntimestep 0.02\ncompute everything all temp\n",
    "ext": LJ_BEADS + "pair_style dpd/ext 0 1.2 3\npair_coeff * * 18 2.5 1.25 0.6 1.9\nfix 1 all nve\ntimestep 0.015\n",
    "overlay": LJ_BEADS
    + """pair_style hybrid/overlay lj/cut 1.3 dpd/tstat 0 0 1.2 3 dpd/ext/tstat 0 0 1.0 4
pair_coeff 1 1 lj/cut 0.3 0.55
pair_coeff 2 2 lj/cut 0.2 0.6 1.1
pair_coeff * * dpd/tstat 5.5
pair_coeff 2 2 dpd/ext/tstat 2.5 1.5 0.5 1.5
pair_modify pair lj/cut mix arithmetic shift yes
fix 1 all nve
timestep 0.003
""",
    "real units": REAL_BEADS + "pair_style dpd 0 6.5 3\npair_coeff * * 3.1 25.0\nfix 1 all nve\ntimestep 20\n",
}


@pytest.mark.parametrize("name", STEPS)
def test_steps_without_noise(tmp_path, name):
    """At temperature 0 nothing is random: six steps with friction end where LAMMPS's do, with the same thermo output at both ends."""
    titles = {"temp": "Temp", "press": "Press", "pe": "PotEng", "ke": "KinEng", "etotal": "TotEng", "enthalpy": "Enthalpy"}
    deck = STEPS[name] + f"thermo_style custom step {' '.join(titles)}\n"
    if "compute everything" in deck:
        deck += "thermo_modify temp everything\n"  # LAMMPS's temperature counts beads that nothing integrates
    with lammps_peer.instance() as lmp:
        lmp.commands_string(deck + "comm_modify vel yes\nneigh_modify every 1 delay 0 check yes\nrun 0\n")
        first = lmp.last_thermo()
        lmp.command("run 6")
        last = lmp.last_thermo()
    found = run_deck(put(tmp_path / "in.ours", deck + "run 6\n"), RunOptions(platform="Reference", threads=1))["thermo"]
    for word, title in titles.items():
        assert first[title] != pytest.approx(last[title], rel=1e-4)  # something happens
        assert (found[word]["first"], found[word]["last"]) == pytest.approx((first[title], last[title]), rel=1e-9)


# -- energies of the first configuration of example decks with energies, heat, species and densities ------------------------------
EXAMPLES = ("dpde-vv", "dpde-shardlow", "dpdp-shardlow", "dpdh-shardlow", "dpde-table", "edpd", "tdpd", "mdpd")

#: Commands about output, which the energy of the first configuration does not need.
WITHOUT_ENERGY = ("compute", "thermo", "thermo_style", "thermo_modify", "dump", "reset_timestep")


def physics(name: str) -> str:
    """Lines of an example deck up to its first run, without output, and a run of no steps."""
    lines = (DECKS / f"in.{name}").read_text().replace("&\n", " ").splitlines()
    kept: list[str] = []
    for line in lines:
        words = line.partition("#")[0].split()
        if words[:1] == ["run"]:
            break
        output = words[:1] and (words[0] in WITHOUT_ENERGY or (words[0] == "fix" and words[3].startswith("ave/")))
        if words and not output and not (words[0] == "variable" and words[2] != "index"):
            kept.append(line)
    return "\n".join([*kept, "thermo_style custom step pe ke press", "thermo_modify norm no", "run 0", ""])


@pytest.mark.parametrize("name", EXAMPLES)
def test_energies_of_the_example_decks_are_those_of_lammps(tmp_path, name):
    """LAMMPS starts from the data file that we write at this point."""
    for path in (*DECKS.glob("data.*"), *DECKS.glob("table.*")):
        shutil.copy(path, tmp_path)
    text = physics(name)
    (tmp_path / "in.deck").write_text(text)
    runner = DeckRunner(RunOptions(platform="CPU", threads=1))
    state = read_deck(tmp_path / "in.deck", run_callback=runner.carry_out, output=tmp_path)
    (tmp_path / "data.ours").write_text("\n".join(data_file_lines(state, pair=None)) + "\n")
    ours = {word: runner.results[0].rows[word][0] for word in ("pe", "ke", "press")}
    with lammps_peer.instance() as lmp:
        lmp.command(f"shell cd {tmp_path}")
        for line in text.splitlines():
            word = line.split()[0]
            if word in ("read_data", "create_box"):
                lmp.command("read_data data.ours")
            elif word not in ("create_atoms", "velocity", "set", "lattice"):
                lmp.command(line)
        theirs = {word: lmp.get_thermo(word) for word in ours}
        inner = None
        if state.atoms.u_mech.any():
            lmp.command("compute inner all dpd/atom")
            inner = lmp.numpy.extract_compute("inner", 1, 2)[np.argsort(lmp.numpy.extract_atom("id")[: len(state.atoms)])].copy()
    assert ours["pe"] == pytest.approx(theirs["pe"], rel=1e-11)
    assert ours["ke"] == pytest.approx(theirs["ke"], rel=1e-12)
    if "shardlow" in name or name == "dpde-table":  # there is no noise in the pressure
        assert ours["press"] == pytest.approx(theirs["press"], rel=1e-10)
    if inner is not None:
        u_cond, u_mech, _, theta = inner.T
        np.testing.assert_allclose(state.atoms.u_mech / state.units.energy, u_mech, rtol=1e-12)
        np.testing.assert_allclose(state.atoms.thetas, theta, rtol=1e-12)
        assert not u_cond.any() and not state.atoms.u_cond.any()
