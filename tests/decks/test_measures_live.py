"""Computes, fixes and dumps that measure, beside a live LAMMPS without noise: rows of a run, and files word by word."""

import gzip
from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import put, raises
from deck_snippets import chains
from matplotlib.image import imread
from test_lammps_tensor_live import decks
from test_lammps_thermo_live import both

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, read_deck, run_deck

LAMMPS = lammps_peer.needed()

#: Chains that are folded into their box.
TURNS = chains(
    "chains",
    "molecular",
    12,
    5,
    lambda m, k: f"{0.4 + 0.55 * k} {0.2 + 0.235 * m + 0.3 * (k % 2)} {(0.5 + 0.7 * m + 0.2 * (k == 3) + 0.01 * k) % 3}",
)
TURNS = TURNS.replace("1 dihedral types\n", "1 dihedral types\n12 impropers\n1 improper types\n") + "\nImpropers\n\n"
TURNS += "".join(f"{k + 1} 1 {5 * k + 2} {5 * k + 3} {5 * k + 4} {5 * k + 1}\n" for k in range(12))
MDPD = """pair_style hybrid/overlay mdpd/rhosum mdpd 0.0 1.0 98
pair_coeff * * mdpd/rhosum 0.75
pair_coeff * * mdpd -40 25 18.0 1.0 0.75
fix 1 all mvv/dpd 0.5
"""
CHAINS = """atom_style molecular
atom_modify sort 0 0
special_bonds lj 0.5 0.3 1.0
bond_style harmonic
angle_style harmonic
dihedral_style opls
improper_style umbrella
read_data {folder}/data.turns
comm_modify vel yes
group ga id 1:43
bond_coeff 1 50 0.5
angle_coeff 1 5 120
dihedral_coeff 1 1 -2 3 0.5
improper_coeff 1 3 20
pair_style dpd 0.0 1.0 3
pair_coeff * * 25 0.1
velocity all ramp vy -1 1 z 0 3
fix 1 all nve
timestep 0.005
"""
SHARES = """compute s all stress/atom NULL
compute sv ga stress/atom NULL virial
compute tp ga temp/partial 1 0 1
compute sk all stress/atom tp ke pair
compute e all pe/atom
compute ep all pe/atom pair fix
compute c all chunk/atom bin/1d z lower 0.3 units reduced
variable x atom c_e*c_s[2]
compute r all reduce sum c_s[*] c_sv[1] c_sv[6] c_sk[1] c_sk[2] c_sk[4] c_e c_ep
compute m all reduce max c_s[1] v_x c_e
variable p equal press+(c_r[1]+c_r[2]+c_r[3])/3/vol
fix a all ave/chunk 1 3 3 c c_s[1] c_s[4] v_x c_e file f.chunk format " %.10g"
dump d all custom 3 f.dump id c_s[*] c_e c_sv[1] v_x
dump_modify d sort id format float %.10g
thermo_style custom step press c_r[*] c_m[*] v_p
"""


def start(folder: Path, base: str) -> str:
    """The beginning of a deck."""
    if base == "chains":
        (folder / "data.turns").write_text(TURNS, encoding="utf-8")
        return CHAINS.format(folder=folder)
    text = decks(folder, "predicted" if base == "mdpd" else base, "orthogonal" if base == "mdpd" else "tilted")
    return text[: text.index("pair_style")] + MDPD if base == "mdpd" else text


DUMPS = """neigh_modify every 1 delay 0 check no
region left block 0 1.5 0 3 0 3
compute b all bond/local dist dx dy dz engpot force fx
compute bi ga property/local btype batom1 batom2
compute bg ga bond/local dist
compute ai all property/local atype aatom1 aatom2 aatom3
compute an all angle/local theta eng
compute d all dihedral/local phi
compute ii all improper/local chi
compute di all property/local dtype datom1 datom4
compute ke all ke/atom
compute rl all reduce max c_b[1] c_b[5] inputs local
compute v ga vacf
compute ra all reduce avesq c_an[1] inputs local
compute rr all reduce/region left sum x vy
dump l all local 2 f.l index c_b[*]
dump_modify l label BONDS format line "%d %g %g %g %.8g %g %10.5f %g"
dump a all local/gz 2 f.al.*.gz index c_ai[*] c_an[*]
dump i ga local 2 f.i c_bi[*] c_bg
dump j all local 2 f.dl.gz c_d c_di[2] c_di[*]
dump jj all local 2 f.il.gz c_ii
dump_modify j units yes time yes
dump c all custom/gz 1 f.c.gz id element x proc procp1
dump_modify c element O thresh x < 1.5 thresh c_ke != 0 region left time yes units yes sort id format 3 %.9f
dump g all atom/gz 1 f.g.*.gz
dump_modify g pad 5 sort id
dump h all xyz 1 f.x.gz
dump o ga custom 2 f.o id x vy
dump_modify o thresh vy >= 0 thresh none thresh x > 1 header no sort id thresh y <= 2.5 format line "%d %.8g %g"
dump z all atom 2 f.z.*
dump_modify z units yes time yes delay 2 format line "%d %d %.10g %.10g %.10g"
thermo_style custom step c_rl[*] c_ra c_rr[*] c_v[*]
"""
CHUNKS = """neigh_modify every 1 delay 0 check no
compute m all chunk/atom molecule
compute mg ga chunk/atom molecule compress yes
compute s all chunk/atom bin/sphere 1.5 1.4 1.5 0.3 1.2 3
compute sp all chunk/atom bin/sphere 0.5 0.4 0.5 0.3 1.2 3 pbc yes discard no
compute sd all chunk/atom bin/sphere 0.5 0.4 0.5 0.3 1.2 3 discard yes
compute c all chunk/atom bin/cylinder z lower 1.0 1.5 1.4 0.2 1.3 4
compute cd ga chunk/atom bin/cylinder x center 1.0 1.5 1.4 0.2 1.3 4 discard no
compute t all chunk/atom type
compute cl all cluster/atom 0.6
compute clc all chunk/atom c_cl compress yes
compute com all com/chunk m
compute msd all msd/chunk m
compute gyr all gyration/chunk m
compute gyt ga gyration/chunk m tensor
compute vcm all vcm/chunk m
compute pc all property/chunk mg count id
compute pp all property/chunk c coord1 coord2 count
compute size all property/chunk clc count
fix am all ave/chunk 1 2 2 m vx density/number file f.m
fix amg all ave/chunk 1 2 2 mg vx density/mass temp file f.mg
fix as all ave/chunk 1 2 2 s vx density/number file f.s
fix asp all ave/chunk 1 2 2 sp vx density/number file f.sp
fix ac all ave/chunk 1 2 2 c vx density/number file f.c
fix acd all ave/chunk 1 2 2 cd vx density/number file f.cd
fix at all ave/chunk 1 2 2 t mass density/number file f.t
fix acl all ave/chunk 2 1 2 clc mass file f.clc
fix a1 all ave/time 1 2 2 c_com[*] c_msd[*] c_gyr mode vector file f.a1
fix a2 all ave/time 1 2 2 c_pc[*] mode vector file f.a2
fix a3 all ave/time 1 2 2 c_gyt[*] c_vcm[2] mode vector file f.a3
fix a4 all ave/time 1 2 2 c_pp[*] mode vector file f.a4
fix h all ave/histo 2 1 2 0 70 7 c_size mode vector file f.h beyond end
dump d all custom 2 f.d id c_m c_mg c_s c_sp c_sd c_c c_cd c_cl c_clc
dump_modify d sort id
thermo_style custom step c_com[2][1] c_msd[3][4] c_gyr[2] c_vcm[4][2]
"""
NEIGHBOURS = """neigh_modify every 1 delay 0 check no
group gb subtract all ga
compute v ga vacf
compute co all coord/atom cutoff 0.8
compute co2 ga coord/atom cutoff 0.9 group gb 1 *
compute cl ga cluster/atom 0.6
compute fr ga fragment/atom
compute fs ga fragment/atom single yes
compute ag all aggregate/atom 0.7
compute r all reduce max c_co c_co2[1] c_co2[2] c_cl c_fr c_ag
compute r2 all reduce sum c_co c_co2[1] c_co2[2] c_cl c_fr c_ag
compute gg ga group/group gb
compute gi all group/group gb molecule inter
compute gs ga group/group ga molecule intra
compute b all bond/local dist
fix h all ave/histo 1 2 2 -1 1 8 vx vy mode vector file f.h
fix h2 all ave/histo 1 2 2 0.0 5 6 c_gg[1] c_r[1] c_v[4] file f.h2 ave window 2 beyond extra
fix h3 ga ave/histo 1 2 2 -0.5 0.5 5 vy v_speed mode vector file f.h3 ave running
fix h4 all ave/histo 1 2 2 0.5 0.7 5 c_b mode vector kind local file f.h4 ave window 2
fix vv all vector 1 c_v[4]
fix vw all vector 2 c_v[1] c_thermo_temp nmax 5
fix st ga store/state 0 xu vy c_co
fix st2 all store/state 2 x com yes
variable d equal dt*trap(f_vv)
variable sl equal slope(f_vv)
variable mx equal max(f_vv)+ave(f_vv)+sum(f_vv)-min(c_v)
variable hh equal f_h2[2][3]+f_h[2][2]
fix a5 all ave/time 2 1 2 f_h[1] f_h[2] f_h[3] v_hh file f.a5
variable dsp atom vy-f_st[2]
compute dr ga reduce sum v_dsp f_st[1] f_st2
dump d all custom 2 f.d id c_cl c_fr c_fs c_ag c_co c_co2[*] f_st[*] f_st2 v_dsp
dump_modify d sort id
thermo_style custom step c_v[*] c_r[*] c_r2[*] c_gg c_gg[1] c_gg[2] c_gi c_gi[3] c_gs c_gs[1] v_d v_sl v_mx c_dr[*]
"""
PAIRS = """neigh_modify every 1 delay 0 check no
labelmap atom 1 C-a.2
variable own atom type==label2type(atom,C-a.2)+is_typelabel(atom,Cb)
compute p all pair/local dist dx dy dz eng force fx fy fz
compute pg ga pair/local eng cutoff type
compute i all property/local patom1 patom2 ptype1 ptype2 cutoff type
compute s all reduce sum c_p[1] c_p[5] c_p[6] c_pg inputs local
compute o all reduce sum v_own
variable v vector 2*c_thermo_press
variable w vector [1,2.5]
fix v all ave/time 1 2 2 v_v c_thermo_press mode vector file f.v
fix w all ave/time 1 1 2 v_w mode vector file f.w
fix h all ave/histo 1 1 1 0 1 5 c_p[1] c_p[6] mode vector kind local file f.h
fix hv all ave/histo 1 1 1 0 3 5 v_v v_w mode vector file f.hv
dump p all local 1 f.pairs c_i[*] c_p[*]
dump l all custom 2 f.l id typelabel type
dump_modify p format float %.10g
dump_modify l sort id
thermo_style custom step c_s[*] c_o
"""
TWO_STYLES = """pair_style hybrid/overlay dpd 0.0 1.0 3 lj/cut 0.8
pair_coeff * * dpd 25 4.5
pair_coeff 1 * lj/cut 0.1 0.4
pair_coeff 2 2 lj/cut 0 0.4
"""
#: By name: how the deck begins, and what it measures.
DECKS = {
    **{f"shares {base}": (base, SHARES) for base in ("dpd", "predicted", "transverse", "two thermostats", "mdpd", "frozen")},
    "shares nve/limit": ("dpd", "unfix 1\nfix 1 all nve/limit 0.003\n" + SHARES),
    "dumps": ("chains", DUMPS),
    "pairs chains": ("chains", PAIRS),
    "pairs of two styles": ("dpd", TWO_STYLES + PAIRS.replace("atom 1", "atom 1 A 2")),
    "chunks": ("chains", CHUNKS),
    # neighbours are hidden where both factors are 0
    "hidden neighbours": (
        "chains",
        "special_bonds lj 0 0 1 coul 1 0 1\nneigh_modify every 1 delay 0 check no\ncompute co all coord/atom cutoff 0.8\n"
        "compute r all reduce sum c_co\ncompute g all rdf 8 cutoff 0.9\n"
        "thermo_style custom step c_r c_g[5][3] c_g[7][3] c_g[8][3]\n",
    ),
    "neighbours between walls": (
        "mdpd",
        "unfix 1\nfix 1 all nve\nchange_box all boundary p p f\nfix w all wall/reflect zlo EDGE zhi EDGE\ncompute co all coord/atom cutoff 0.8\n"
        "compute cl all cluster/atom 0.4\ncompute t ga temp/com\ncompute r all reduce sum c_co c_cl\nthermo_style custom step c_r[*] c_t c_t[2]\n",
    ),
    "neighbours beside exclusions": (
        "chains",
        "neigh_modify exclude molecule/intra ga\nneigh_modify exclude group ga all\n"
        + NEIGHBOURS.replace(
            "thermo_style custom",
            "compute g all rdf 5 cutoff 0.9\ncompute p all pair/local dist\ncompute s all reduce sum c_p inputs local\n"
            "thermo_style custom c_s c_g[2][3] c_g[5][3]",
        )
        .replace("thermo_style custom c_s c_g[2][3] c_g[5][3] step", "thermo_style custom step c_s c_g[2][3] c_g[5][3]")
        .replace("fix h3", "variable speed atom vx^2-vz\nfix h3"),
    ),
    "neighbours": ("chains", NEIGHBOURS.replace("fix h3", "variable speed atom vx^2-vz\nfix h3")),
    "shares chains": (
        "chains",
        SHARES.replace("c_ep\n", "c_ep c_b[4] c_a[5] c_t[1] c_pa c_pb\n", 1).replace(
            "compute c ",
            "compute b all stress/atom NULL bond\ncompute a all stress/atom NULL angle\ncompute t all stress/atom NULL dihedral ke\n"
            "compute pa all pe/atom angle\ncompute pb all pe/atom bond dihedral improper\ncompute c ",
        ),
    ),
}


def in_order(text: str) -> str:
    """A file of pairs, each from its smaller id to the larger one, in the order of these."""
    blocks = []
    for block in text.split("ITEM: TIMESTEP\n")[1:]:
        head, _, body = block.partition("ENTRIES c_")
        rows = np.array([row.split() for row in body.splitlines()[1:]], float)
        turned = rows[:, 0] > rows[:, 1]
        rows[turned] = (rows[turned] * np.array([1.0] * 5 + [-1.0] * 3 + [1.0] * 2 + [-1.0] * 3))[:, [1, 0, 3, 2, *range(4, 13)]]
        blocks += [head, *map(str, rows[np.lexsort((rows[:, 1], rows[:, 0]))].ravel())]
    return " ".join(blocks)


def same_words(one: Path, other: Path) -> None:
    """Files of words and numbers agree."""
    texts = [gzip.open(path, "rt").read() if path.suffix == ".gz" else path.read_text() for path in (one, other)]
    texts = [in_order(text) for text in texts] if one.suffix == ".pairs" else texts
    there, here = (text.split() for text in texts)
    assert len(there) == len(here), one.name
    for k, (a, b) in enumerate(zip(there, here, strict=True)):
        if a != b:
            assert float(b) == pytest.approx(float(a), rel=1e-6, abs=1e-7), f"{one.name}, word {k}: {there[max(k - 30, 0) : k + 5]}"


@LAMMPS
@pytest.mark.parametrize("name", DECKS)
def test_rows_and_files(tmp_path, name):
    base, text = DECKS[name]
    tail = "thermo 1\nthermo_modify format float %.12g\nrun 3\n"
    theirs, ours = both(tmp_path, start(tmp_path, base) + text + tail)
    a, b = (np.array([row.split() for row in rows[1:] if row.split()[0].isdigit()], float) for rows in (theirs, ours))
    assert a.shape == b.shape
    np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-10 * np.abs(a).max())
    files = sorted(path.name for path in (tmp_path / "theirs").glob("f*"))
    assert files == sorted(path.name for path in (tmp_path / "ours").glob("f*"))
    for file in files:
        same_words(tmp_path / "theirs" / file, tmp_path / "ours" / file)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("style", ["dpd 1.0 1.0 3", "dpd/ext 1.0 1.0 3", "tdpd 1 1 7", "srp"])
def test_shares_add_up_with_noise(tmp_path, style, threads):
    """To the pressure and the energy, where there is no LAMMPS to compare with."""
    coefficients = {"dpd": "25 4.5", "dpd/ext": "25 4.5 3.0 0.5 1.0 1.0", "tdpd": "25 4.5 0.5 1 1 0.1 0.0 2"}.get(style.split()[0])
    text = f"""atom_style {"tdpd 1" if "tdpd" in style else "atomic"}
region box block 0 4 0 4 0 4
create_box 1 box
create_atoms 1 random 150 5 NULL
mass 1 1
velocity all create 1 4
pair_style {style}
pair_coeff 1 1 {coefficients}
fix 1 all {"mvv/tdpd" if "tdpd" in style else "nve"}
"""
    if style == "srp":
        text = CHAINS.format(folder=tmp_path).replace("pair_style dpd 0.0", "pair_style hybrid/overlay srp 0.8 * mid dpd 1.0")
        text = text.replace("pair_coeff * * 25", "pair_coeff 2 2 srp 60\npair_coeff 1 2 none\npair_coeff 1 1 dpd 25").replace(
            "data.turns", "data.turns extra/atom/types 1"
        )
        text = text.replace("bond_coeff", "mass 2 1.0\nbond_coeff", 1)
        (tmp_path / "data.turns").write_text(TURNS, encoding="utf-8")
    (tmp_path / "in.sums").write_text(
        text
        + """compute s all stress/atom NULL
compute e all pe/atom
compute v all pressure NULL virial
compute r all reduce sum c_s[*] c_e
variable p equal press+(c_r[1]+c_r[2]+c_r[3])/3/vol
thermo 2
thermo_style custom step press v_p c_r[7] c_thermo_pe
thermo_modify norm no
run 4
""",
        encoding="utf-8",
    )
    report = run_deck(tmp_path / "in.sums", RunOptions(platform="Reference", threads=threads))
    rows = report["runs"][0]["thermo"]
    assert abs(rows["v_p"]["last"]) < 1e-9 * abs(rows["press"]["last"])
    assert rows["c_r[7]"]["last"] == pytest.approx(rows["c_thermo_pe"]["last"], rel=1e-9)


# -- pictures ------------------------------------------------------------------------------------------------------------------
@pytest.fixture
def undrawn():
    """Pictures are drawn here."""


def test_pictures_have_what_the_deck_says(tmp_path):
    """Colours by type and by value, the box in LAMMPS's projection, sticks, and names of files."""
    (tmp_path / "data.turns").write_text(TURNS, encoding="utf-8")
    (tmp_path / "in.pictures").write_text(
        CHAINS.format(folder=tmp_path)
        + """variable phi equal 30*step
region left block INF 10 INF INF INF INF
dump i all image 2 i.*.jpg type type view 70 v_phi zoom 1.4 size 80 60 box yes 0.01 bond atom 0.1 adiam 0.5 axes yes 1 1
dump_modify i backcolor white boxcolor black acolor 1 blue element C
dump m ga movie 2 m.mpg id mass view 90 90 size 60 60 box no 0.02 bond none none
dump_modify m region left color own 0 1 0 backcolor own
run 2
""",
        encoding="utf-8",
    )
    run_deck(tmp_path / "in.pictures", RunOptions(platform="Reference"), out=tmp_path / "out")
    pictures = {path.name: imread(path)[..., :3] for path in (tmp_path / "out").glob("[im].*.png")}
    assert sorted(pictures) == ["i.0.png", "i.2.png", "m.0.png", "m.2.png"]
    first, turned, film = pictures["i.0.png"], pictures["i.2.png"], pictures["m.2.png"]
    assert first.shape == turned.shape == (60, 80, 3) and not np.array_equal(first, turned)
    blue = (first[..., 2] > 0.5) & (first[..., 0] < 0.4)
    assert 0.02 < blue.mean() < 0.3 and np.all(first[0, 0] == 1.0)
    # five beads of diameter 1 in a row, in a window of twice the box, from blue to red before green
    green = np.all(film == [0.0, 1.0, 0.0], axis=-1)
    assert film.shape == (60, 60, 3) and 0.05 < 1.0 - green.mean() < 0.35
    assert np.any((film[..., 0] > 0.6) & (film[..., 2] < 0.4)) and np.any((film[..., 2] > 0.6) & (film[..., 0] < 0.4))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("dump i all image 2 i.png type type", "put a \\* into the name"),
        ("dump i all movie 2 i.*.mpg type type", "remove the \\*"),
        ("dump i all image 2 i.*.png type type bond red 1", "the colour of bonds must be one of"),
        ("dump i all image 2 i.*.png type type\ndump_modify i backcolor wite", "there is no colour 'wite'; did you mean white"),
        ("dump i all image 2 i.*.png typ type", "a column of dump image must be one of"),
        ("dump i all custom/gz 2 i.txt id", "must end with .gz"),
        ("dump i all local 2 i.txt id", "a column of dump local must be one of index"),
        ("dump i all custom 2 i.txt id\ndump_modify i thresh x ~ 2", "the sign of dump_modify thresh"),
        ("compute c all property/local batom1 aatom1", "are of different kinds"),
        ("compute c all pair/local dist cutoff radius", "cutoff must be one of type"),
        ("variable a equal label2type(atom,W)\nprint $(v_a)", "there is no label of atom types 'W'"),
        ("dump i all custom 2 i.txt id mux", "mux needs atom_style dipole, but the deck has atom_style molecular"),
        ("compute p all property/atom radius", "radius needs atom_style sphere"),
        ("dump i all custom 2 i.txt typelabel", "not all atom types have a label; use labelmap"),
        ("compute c all chunk/atom bin/sphere 1 1 1 2 1 3", "the largest radius 1 is not above"),
        ("compute c all chunk/atom mol", "compute chunk/atom style 'mol' is not supported"),
        ("compute v all ke/atom\ncompute c all chunk/atom c_v ids once", "ids must be every"),
        ("compute c all com/chunk k", "'k' is not the id of a compute chunk/atom"),
        ("compute c all chunk/atom type\ncompute p all property/chunk c size", "a value of a compute of chunks must be one of"),
        ("compute g all group/group all kspace yes", "compute group/group kspace yes is not supported"),
        ("fix h all ave/histo 1 1 1 1 0 5 vx mode vector", "is not above the lower end"),
        ("fix v all vector 1 c_thermo_temp\nvariable t equal trap(f_v)\nthermo_style custom v_t\nprint $(v_t)", "has no values yet"),
        ("fix s all store/state 0 x\nthermo_style custom f_s", "use them in formulas and outputs of single beads"),
        ("compute s all stress/atom NULL bonds", "an argument of compute stress/atom must be one of"),
    ],
)
def test_what_is_refused(tmp_path, line, message):
    (tmp_path / "data.turns").write_text(TURNS, encoding="utf-8")
    raises(DeckError, message, lambda: read_deck(put(tmp_path / "in.bad", CHAINS.format(folder=tmp_path) + line + "\nrun 0\n")))
