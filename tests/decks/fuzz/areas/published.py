"""Decks in the manner of those that people publish, with other numbers, and with more of what such decks use."""

import re

from field_decks import DECKS

from ..deck import MARK, Deck
from ..draw import Draw

#: What a deck may have besides, with numbers drawn between the two in braces; statements, and columns of the thermo output.
MORE = {
    "fix bath all langevin 0 0 {0.5,5} 904": "",
    "fix bath all langevin 0 0 {0.5,5} 904 zero yes": "",
    "group odd id 1:60:2; fix hold odd spring/self {1,20}": "f_hold",
    "group odd id 1:60:2; fix hold odd spring/self {1,20} xy": "f_hold",
    "group odd id 1:60:2; fix pull odd spring tether {1,4} {1,4} NULL {1,20} {0,1}": "f_pull[1] f_pull[4]",
    "region part sphere {1,3} {1,3} {1,3} {0.7,1.5} units box; fix push all addforce {-1,1} 0 {-1,1} region part": "f_push[1]",
    "variable swing equal {0,1}*cos({1,9}*step*dt); fix push all addforce v_swing 0 0": "f_push[1]",
    "fix drag all viscous {0.1,3}": "",
    "fix still all momentum 2 linear 1 1 0": "",
    **{
        f"group odd id 1:60:2; group even subtract all odd; unfix move; fix move even nve; fix slide odd move {way} units box": ""
        for way in (
            "linear {-0.5,0.5} NULL {-0.5,0.5}",
            "wiggle {0,0.1} {0,0.1} NULL {0.1,0.5}",
            "rotate {1,3} {1,3} {1,3} {1,2} {-2,-1} 0 {1,3}",
        )
    },
    **{
        f"unfix move; fix move all npt temp {{1,2}} {{1,2}} {{0.2,1}} {box}": "press lx ly lz"
        for box in ("iso {1,20} {1,20} {1,3}", "aniso {1,20} {1,20} {1,3} couple xy drag {0,1}", "x {1,9} {1,9} {1,3} z 5 5 {1,3} mtk no")
    },
    "compute each all stress/atom NULL; compute sum all reduce sum c_each[1] c_each[2] c_each[4]": "c_sum[1] c_sum[2] c_sum[3]",
    "compute each all stress/atom NULL pair; compute top all reduce max c_each[1] c_each[6]": "c_top[1] c_top[2]",
    "compute touch all pair/local dist eng force; compute work all reduce sum c_touch[1] c_touch[2] c_touch[3] inputs local": "c_work[1] c_work[3]",
    "labelmap atom 1 W-w; variable w atom type==label2type(atom,W-w); compute w all reduce sum v_w": "c_w",
    "variable press vector c_thermo_press; fix vec all ave/time 1 2 4 v_press c_thermo_press mode vector file vec.txt": "",
    "compute each all pe/atom; compute sum all reduce sum c_each": "c_sum",
    "compute each all pe/atom pair; compute top all reduce max c_each": "c_top",
    "compute memory all vacf": "c_memory[1] c_memory[4]",
    "compute apart all msd com yes": "c_apart[4]",
    "compute near all coord/atom cutoff {0.5,1}; compute mean all reduce ave c_near": "c_mean",
    "compute cluster all cluster/atom {0.3,0.8}; compute top all reduce max c_cluster": "c_top",
    "group a type 1; group b subtract all a; compute inter a group/group all": "c_inter c_inter[1] c_inter[3]",
    "region part sphere {1,3} {1,3} {1,3} {0.7,1.5} units box; compute within all reduce/region part ave vx vy": "c_within[1] c_within[2]",
    "region part sphere {1,3} {1,3} {1,3} {0.7,1.5} units box; group now dynamic all region part every 2; variable n equal count(now)": "v_n",
    "variable right atom x > {1,3}; group some variable right; variable n equal count(some)": "v_n",
    "compute shape all gyration": "c_shape c_shape[1] c_shape[4]",
    "compute shape all chunk/atom molecule; compute size shape all gyration/chunk shape": "",
    "compute warm all temp/com": "c_warm",
    "compute turn all inertia/chunk": "",
    "variable slow atom v_half*vx; variable half equal {0.1,1}; compute v all reduce sum v_slow": "c_v",
    "fix mean all ave/time 1 5 5 c_thermo_temp c_thermo_press file mean.txt": "",
    "compute slice all chunk/atom bin/1d x lower 0.25 units reduced; fix mean all ave/chunk 1 5 5 slice density/number vx file slice.txt": "",
    "neigh_modify exclude type 1 1": "",
    "special_bonds lj {0,1} 1 1": "",
    "set group all image 0 0 0": "",
    "change_box all boundary p p p": "",
    "reset_timestep {1,9}": "",
    "dump more all custom 3 more.dump id mol element xu yu zu; dump_modify more sort id format float %.12g": "",
}


#: What a deck has, and what is then not drawn: LAMMPS's compute group/group has no energies of mdpd, and averages before a fix deform and
#: its local pairs are of the box before its change.
_APART = (("mdpd", "group/group"), (" deform ", "fix mean"), (" deform ", "pair/local"))


def published(draw: Draw) -> Deck:
    """One of them, with smaller coefficients and steps, moved, with up to three more statements, and in two runs."""
    name = draw.pick(list(DECKS))
    plain = DECKS[name]
    # within 0.001 of a straight angle LAMMPS takes this as its sine
    straight = 1e-4 if " 180.0" in plain.text else 0.0
    deck = Deck(draw, files=dict(plain.files), accuracy=max(plain.accuracy, straight))

    def number(found: re.Match) -> str:
        low, high = map(float, found[1].split(","))
        value = draw.real(low, high)
        return draw.word(int(value) if "reset_timestep" in found.string else value).lstrip("+")

    said = draw.some([words for words in MORE if not any(own in plain.text and other in words for own, other in _APART)], 0, 3)
    more = [re.sub(r"\{(.*?)\}", number, part.strip()) for words in said for part in words.split(";")]
    factor = draw.uniform(0.7, 1.0)
    for line in plain.text.splitlines():
        words = line.split()
        # the coefficient of coul/long/soft is lambda, for which other values than 1 have other forces in LAMMPS
        if words[0] in ("pair_coeff", "bond_coeff") and "mdpd" not in plain.text and "coul/long/soft" not in words:
            line = re.sub(r"(?<= )\d+\.\d+(?= |$)", lambda found: f"{float(found[0]) * factor:.9g}", line)
        if words[0] == "thermo_style":
            if draw.chance(0.5):
                deck.lines.append(f"displace_atoms all ramp x 0 {factor - 0.7:.6g} y 0 4 units box")
            deck.lines += more
            line += "".join(f" {MORE[words]}" for words in said)
        if words[0] == "run":
            deck.lines.append(f'print "{MARK}"')
            line = f"run {draw.whole(0, min(10, int(words[1])))}"
        deck.lines.append(line)
    return deck
