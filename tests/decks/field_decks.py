"""Decks in the manner of those that people publish, small and without noise, by what they are about.

``DECKS`` has them by name, ``REFUSED`` what is said to those that use a word that is not supported.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Beads:
    """Beads of a data file: single ones on a shaken lattice, chains that begin at some of its sites, and layers."""

    edges: tuple[float, float, float] = (4.2, 4.2, 4.2)
    spacing: float = 0.7
    apart: float = 0.0
    inside: str = "True"
    seed: int = 1
    places: list[np.ndarray] = field(default_factory=list)
    kinds: list[tuple[int, int, float]] = field(default_factory=list)  # Type, molecule, charge.
    bonds: list[tuple[int, ...]] = field(default_factory=list)
    angles: list[tuple[int, ...]] = field(default_factory=list)

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed)
        counts = [max(1, round(edge / self.spacing)) for edge in self.edges]
        sites = (np.array(list(itertools.product(*map(range, counts))), float) + 0.5) * self.edges / counts
        self.sites = [x for x in self.rng.permutation(sites) if eval(self.inside, {}, {"x": x[0], "y": x[1], "z": x[2]})]
        self.wide = np.array([edge > 0.5 for edge in self.edges])  # A box of two dimensions is thin along z.

    def _site(self, *more: np.ndarray) -> np.ndarray:
        """The next site where this and the places that far from it are free."""
        while not all(self._free(self.sites[-1] + away) for away in (np.zeros(3), *more)):
            self.sites.pop()
        return self.sites.pop()

    def _free(self, place: np.ndarray) -> bool:
        away = place - np.array(self.places or [place + np.array(self.edges) / 2])
        return bool(np.linalg.norm(away - self.edges * np.round(away / self.edges), axis=1).min() >= self.apart)

    def single(self, count: int, kind: int = 1, charge: float = 0.0) -> Beads:
        """Beads of a type in no molecule."""
        for _ in range(count):
            self.places.append(self._site() + self.wide * self.rng.uniform(-0.1, 0.1, 3) * (not self.apart))
            self.kinds.append((kind, 0, charge))
        return self

    def chains(self, count: int, kinds: str, step: float = 0.6, axis: str = "", charge: float = 0.0) -> Beads:
        """Chains with a digit for the type of each bead, along an axis or any way; the first bead of each has the charge."""
        for _ in range(count):
            along = step * np.eye(3)["xyz".find(axis or "x")]
            place = self._site(*(k * along for k in range(len(kinds))))
            first, molecule = len(self.places) + 1, 1 + max((m for _, m, _ in self.kinds), default=0)
            for k, kind in enumerate(kinds):
                self.places.append(place)
                self.kinds.append((int(kind), molecule, charge * (k == 0)))
                way = (along + self.rng.uniform(-0.03, 0.03, 3) if axis else self.rng.normal(size=3)) * self.wide
                place = place + step * way / np.linalg.norm(way)
                self.bonds += [(first + k - 1, first + k)] if k else []
                self.angles += [(first + k - 2, first + k - 1, first + k)] if k > 1 else []
        return self

    def layer(self, height: float, kind: int, spacing: float, charge: float = 0.0) -> Beads:
        """A square lattice of beads of one molecule, with bonds between neighbours; every seventh bead has the charge."""
        size, first = round(self.edges[0] / spacing), len(self.places) + 1
        for k, (x, y) in enumerate(itertools.product(range(size), repeat=2)):
            self.places.append(np.array([(x + 0.5) * spacing, (y + 0.5) * spacing, height]))
            self.kinds.append((kind, round(10 * height), charge * (k % 7 == 0)))
            self.bonds += [(first + k - 1, first + k)] if y else []
            self.bonds += [(first + k - size, first + k)] if x else []
        return self

    def text(self, style: str, types: int = 0) -> str:
        """The data file for an atom style."""
        edges, places, count = np.array(self.edges), np.array(self.places), len(self.places)
        places[:, ~self.wide] = 0.0
        low = np.where(self.wide, 0.0, -edges / 2)
        images = np.floor((places - low) / edges).astype(int)
        places -= images * edges
        speeds = self.rng.normal(size=(count, 3)) * 0.3 * self.wide
        columns = {"atomic": "", "charge": "q", "full": "mq", "mdpd": "r", "hybrid bond mdpd": "mr"}.get(style, "m")
        types = types or max(kind for kind, _, _ in self.kinds)
        rows = {"Bonds": self.bonds if "m" in columns else [], "Angles": self.angles if style in ("angle", "molecular", "full") else []}
        lines = ["beads", "", f"{count} atoms", f"{types} atom types"]
        lines += [f"{len(found)} {name.lower()}\n1 {name[:-1].lower()} types" for name, found in rows.items() if found]
        lines += [f"{b:.9g} {b + e:.9g} {axis}lo {axis}hi" for b, e, axis in zip(low, edges, "xyz", strict=True)]
        lines += ["", "Masses", "", *(f"{k} 1.0" for k in range(1, types + 1)), "", "Atoms", ""]
        for k, (x, (kind, molecule, charge)) in enumerate(zip(places, self.kinds, strict=True)):
            carried = {"m": f"{molecule}", "q": f"{charge:g}", "r": "0.0"}
            words = [*(carried["m"] for c in columns if c == "m"), str(kind), *(carried[c] for c in columns if c != "m")]
            at = [f"{value:.9f}" for value in x]
            words = [str(kind), *at, *(carried[c] for c in columns)] if style.startswith("hybrid") else [*words, *at]
            lines.append(" ".join([str(k + 1), *words, *map(str, images[k])]))
        lines += ["", "Velocities", "", *(f"{k + 1} {x:.9f} {y:.9f} {z:.9f}" for k, (x, y, z) in enumerate(speeds))]
        for name, found in rows.items():
            lines += ["", name, "", *(f"{k} 1 " + " ".join(map(str, row)) for k, row in enumerate(found, start=1))] if found else []
        return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class FieldDeck:
    """The text of a deck, the files beside it, and the accuracy to which two programs must agree."""

    text: str
    beads: Callable[[], str] | None
    accuracy: float

    @property
    def files(self) -> dict[str, str]:
        """Contents by names; data files are made when they are asked for."""
        files = {"mol.lipid": LIPID, "mol.flat": LIPID.replace("2 0 0 0.6", "2 0.6 0 0").replace("3 0 0 1.2", "3 1.2 0 0")}
        return files | ({} if self.beads is None else {"data.beads": self.beads()})


def _inner(beads: Beads) -> Beads:
    """With the sites nearest to the middle used first."""
    beads.sites.sort(key=lambda x: -np.linalg.norm(x - np.array(beads.edges) / 2))
    return beads


FLAT = (8.0, 8.0, 0.2)
TALL = (4.2, 4.2, 6.3)
BEADS = {
    "ionomer": lambda: Beads().chains(8, "1112113").single(120, 4),
    "slab": lambda: Beads((4.2, 4.2, 5.6), inside="z > 1").layer(0.4, 5, 0.7).chains(8, "1112113").single(90, 4),
    "lipids": lambda: Beads(TALL).chains(16, "12222", axis="z").single(120, 3),
    "flat lipids": lambda: Beads(FLAT).chains(24, "122").single(45, 3),
    "diblocks": lambda: Beads().chains(18, "1111122222"),
    "triblocks": lambda: Beads().chains(15, "112222211"),
    "dimers": lambda: Beads().chains(20, "11").single(100),
    "overlapping": lambda: Beads((5.4, 5.4, 5.4), 0.9).chains(10, "1111", 0.95).single(40),
    "melt": lambda: Beads((7.0, 7.0, 7.0), 1.15, 1.0).chains(24, "111", 0.97, "x").single(60),
    "strings": lambda: Beads((5.6, 5.6, 5.6), 0.8).chains(40, "111", 0.85, "y"),
    "fluid": lambda: Beads().single(190),
    "drop": lambda: _inner(Beads((7.0, 7.0, 7.0), 0.6)).single(200),
    "soap": lambda: Beads(spacing=0.6).chains(10, "122").single(180, 1),
    "wall": lambda: Beads((4.2, 4.2, 7.0), 0.65, inside="1 < z < 2.6").layer(0.2, 2, 0.6).layer(0.8, 2, 0.6).single(70),
    "thread": lambda: Beads((7.0, 5.0, 5.0), 0.6, inside="(y - 2.5)**2 + (z - 2.5)**2 < 2.2").single(100),
    "solution": lambda: Beads(TALL).chains(10, "11111").single(150, 2),
    "plates": lambda: Beads((4.2, 4.2, 7.0), inside="1 < z < 6").layer(0.4, 2, 0.7).layer(6.6, 2, 0.7).single(170),
    "clay": lambda: Beads((5.6, 5.6, 5.6), 0.8).layer(1.4, 1, 0.8, -1.0).chains(14, "233", charge=0.5).single(80, 4),
    "gel": lambda: Beads((7.0, 7.0, 7.0), 1.1).single(200),
    "rods": lambda: Beads((5.6, 5.6, 5.6), 0.8).chains(8, "111", 0.5, "x").single(150, 2),
    "ions": lambda: Beads().single(20, 2, 1.0).single(20, 3, -1.0).single(140, 1),
    "film": lambda: Beads(FLAT).single(60).single(60, 2),
    "layers": lambda: Beads(TALL).chains(10, "1111").single(70, 2).single(70, 3),
}

#: What decks share: a statement ``@name word ...`` stands for these, with the words for %1, %2, ...
SHARED = {
    "chains": "bond_style harmonic; special_bonds lj 1 1 1; BEADS; bond_coeff 1 %1 %2",
    "bent": "bond_style harmonic; angle_style %1; special_bonds lj 1 1 1; BEADS; bond_coeff 1 64 0.5; angle_coeff 1 6.0 180.0",
    "fene": "bond_style fene; special_bonds fene; BEADS; bond_coeff 1 30 1.5 1.0 1.0",
    "one": "pair_style dpd 0 1.0 4711; pair_coeff * * 25 4.5 1.0",
    "two": "@one; pair_coeff 1 2 60 4.5 1.0",
    "three": "@one; pair_coeff 1 2 40 4.5 1.0; pair_coeff 1 3 70 4.5 1.0; pair_coeff 2 3 30 4.5 1.0",
    "membrane": "@one; pair_coeff 1 2 50 4.5 1.0; pair_coeff 2 3 75 4.5 1.0; pair_coeff 1 3 35 4.5",
    "ionomer": "@chains 4.0 0.1; @one; pair_coeff 1 3 36 4.5; pair_coeff 1 4 38 4.5; pair_coeff 2 4 33 4.5; pair_coeff 3 4 22 4.5",
    "mdpd": "pair_style hybrid/overlay mdpd/rhosum mdpd 0 1.0 99; pair_coeff * * mdpd/rhosum 0.75; pair_coeff * * mdpd -40 25 18 1.0 0.75",
    "wetting": "BEADS; @mdpd; pair_coeff 1 2 mdpd -25 25 18 1.0 0.75; group wall type 2; group liquid type 1; velocity wall set 0 0 0; timestep 0.005",
    "wca": "pair_style lj/cut 1.122462; pair_modify shift yes; pair_coeff * * 1.0 1.0; timestep 0.002",
    "clay": "bond_style harmonic; special_bonds lj/coul 1 1 1; BEADS; bond_coeff 1 100 0.8; pair_style hybrid/overlay dpd 0 1.0 6 %1 %2 %3 %4; "
    "pair_coeff * * dpd 25 5 1.0; pair_coeff 1 2 dpd 20 5 1.0; pair_coeff * * %1 %5",
    "smeared": "BEADS; pair_style dpd/coul/slater/long 0 1.0 123 0.6 2.0; pair_coeff * * 25 4.5 yes; kspace_style ewald 1e-5; accuracy 1e-4",
    "move": "fix move all nve; timestep 0.01",
    "mvv": "fix move all mvv/dpd 0.5; timestep 0.005",
    "flat": "HEAD dimension 2; fix flat all enforce2d; @move",
    "limits": "RUNS variable size loop 3; RUNS label again; RUNS fix limit all nve/limit $(0.01*v_size); RUNS run 4; RUNS unfix limit; RUNS next size; "
    "RUNS jump SELF again; RUNS fix move all nve; RUNS run 5",
    "film": "HEAD dimension 2; lattice %1 1.5; region box block 0 6 0 6 -0.1 0.1; create_box 2 box; create_atoms 1 box; mass * 1.0; "
    "region half block 0 3 INF INF INF INF; set region half type 2; @two; velocity all ramp vx -0.5 0.5 y 0 5; @flat",
    "triclinic": "BEADS; @one; RUNS change_box all triclinic; RUNS fix move all nve; RUNS fix shear all deform 1 %1 erate 0.2 remap v; RUNS run 15; accuracy 1e-2",  # LAMMPS: images of the step before
}

#: Decks: name, beads, atom style, and statements.  Those with HEAD come first, those with RUNS last (default: run 15).
TEXTS = """
= ionomer : ionomer : molecular : @ionomer; @move
= ionomer, minimized : ionomer : full : @ionomer; @move; RUNS minimize 0 0 0 0; RUNS run 10
= ionomer at constant temperature : ionomer : molecular : @ionomer; fix move all nvt temp 1.0 1.0 0.5; timestep 0.01
= ionomer at constant pressure : ionomer : molecular : @ionomer; fix move all npt temp 1 1 0.5 iso 23.7 23.7 2; timestep 0.01
= ionomer beside a frozen slab : slab : molecular :
@ionomer; pair_coeff 5 * 40 4.5; group slab type 5; group fluid subtract all slab; velocity slab set 0 0 0
neigh_modify exclude group slab slab; fix move fluid nve; timestep 0.01
= swollen ionomer : ionomer : molecular :
@ionomer; @move; RUNS run 5; RUNS change_box all x scale 1.02 y scale 1.02 z scale 1.02 remap units box; RUNS run 5
= bilayer : lipids : angle : @bent harmonic; @membrane; @move
= bilayer of stiff tails : lipids : angle : @bent cosine/delta; @membrane; @move
= bilayer with squared cosines : lipids : molecular : @bent cosine/squared; @membrane; @move
= bilayer without tension : lipids : angle : @bent harmonic; @membrane; fix move all npt temp 1 1 1 aniso 20 20 5 couple xy; timestep 0.01
= bilayer, pushed apart first : lipids : molecular : @bent harmonic; @membrane; timestep 0.01; @limits
= lipid pulled out : lipids : angle :
@bent harmonic; @membrane; group one id 1; fix pull one smd cvel 5.0 0.5 tether NULL NULL 8 0.5; @move
= lipids placed as molecules :  : template lipid :
HEAD molecule lipid mol.lipid; region box block 0 4.2 0 4.2 0 4.2; create_box 3 box bond/types 1 extra/bond/per/atom 2 extra/special/per/atom 4; mass * 1.0
create_atoms 0 single 0.5 0.5 1 mol lipid 7 rotate 0 1 0 0 units box; bond_style harmonic; bond_coeff 1 99 0.5
create_atoms 0 single 1.1 0.5 1.3 mol lipid 7 rotate 40 1 0 0 units box; create_atoms 0 single 1 1 3 mol lipid 7 rotate 180 1 0 0 units box
special_bonds lj 1 1 1; @membrane; @move
= molecules placed anywhere in a plane :  : bond : HEAD dimension 2; region box block 0 8 0 8 -0.5 0.5
create_box 3 box bond/types 1 extra/bond/per/atom 2 extra/special/per/atom 4; mass * 1.0; molecule lipid mol.flat
create_atoms 0 random 20 77 box mol lipid 99; bond_style harmonic; bond_coeff 1 99 0.5; special_bonds lj 1 1 1; @membrane; @flat
= lipids in a plane : flat lipids : bond : @chains 64 0.5; @membrane; @flat
= diblock lamella : diblocks : bond : @chains 50 0.7; @two; @move
= diblock with a table of chi : diblocks : bond :
@chains 50 0.7; variable chi equal 8; variable a equal 25+3.27*${chi}; @one; pair_coeff 1 2 ${a} 4.5; @move
= triblock, relaxed : triblocks : bond : @chains 50 0.7; @two; @move; RUNS minimize 0 0 0 0; RUNS reset_timestep 0; RUNS run 10
= clear, folders and names of elements : diblocks : bond :
HEAD clear; HEAD shell "mkdir frames"; @chains 50 0.7; @two; @move; dump f all custom 5 frames.dump id type element xu yu zu
dump_modify f sort id element A B format float %.10g
= hybrid of ordinary atom styles : diblocks : hybrid bond : @chains 50 0.7; @two; @move
= copolymer drawn out : diblocks : bond :
@chains 50 0.7; @two; @move; RUNS fix draw all deform 1 x erate 0.2 units box remap x; RUNS run 10
= energies between blocks : diblocks : bond :
@chains 50 0.7; @two; group A type 1; group B type 2; compute inter A group/group B; @move; show c_inter c_inter[1]
= melt of Kremer and Grest : melt : bond : @fene; @wca; fix move all nve
= melt pushed apart by a soft potential : overlapping : bond :
bond_style harmonic; special_bonds lj 0 1 1; BEADS; bond_coeff 1 100 0.97; pair_style soft 1.12246; pair_coeff * * 20.0
variable a equal ramp(1,60); fix grow all adapt 1 pair soft a * * v_a; fix move all nve/limit 0.02; timestep 0.005
= melt pushed apart by dpd : overlapping : bond : @chains 100 0.9; @one; timestep 0.01; @limits
= melt with a thermostat of pairs : melt : bond :
@fene; pair_style hybrid/overlay lj/cut 1.122462 dpd/tstat 0 0 1.5 33; pair_modify shift yes; pair_coeff * * lj/cut 1 1
pair_coeff * * dpd/tstat 4.5; fix move all nve; timestep 0.002
= melt in a cold bath : melt : bond : @fene; @wca; fix move all nve; fix bath all langevin 0 0 2.0 904
= chains that cannot cross : strings : bond :
bond_style harmonic; BEADS; bond_coeff 1 225 0.85; pair_style hybrid dpd 0 1.0 77 srp 0.8 1 mid exclude yes; pair_coeff 1 1 dpd 60 4.5 1.0
pair_coeff 1 2 none; pair_coeff 2 2 srp 80 0.8; @move; types 2
= chains that grow : dimers : bond :
@chains 50 0.5; @one; fix grow all bond/create 5 1 1 0.5 1 iparam 2 1 jparam 2 1; @move; reads extra/bond/per/atom 4 extra/special/per/atom 9
= bonds that break : diblocks : bond : @chains 50 0.7; @two; fix tear all bond/break 5 1 0.9; @move
= network that forms and tears : dimers : bond :
@chains 50 0.5; @one; fix grow all bond/create 4 1 1 0.6 1 iparam 3 1 jparam 3 1; fix tear all bond/break 6 1 0.55; @move; RUNS run 27
show ebond bonds f_grow[1] f_grow[2] f_tear[1] f_tear[2]; reads extra/bond/per/atom 4 extra/special/per/atom 19
= bonds over two runs : dimers : bond :
@chains 50 0.5; @one; fix grow all bond/create 5 1 1 0.5 1 iparam 2 1 jparam 2 1; @move; RUNS run 8; RUNS run 13
show ebond bonds f_grow[1] f_grow[2]; reads extra/bond/per/atom 4 extra/special/per/atom 9
= drop : drop : mdpd : BEADS; @mdpd; @mvv
= thread : thread : mdpd : BEADS; @mdpd; @mvv; compute rho all property/atom rho; compute mean all reduce ave c_rho; show c_mean
= drop on a wall : wall : mdpd : @wetting; fix hold wall setforce 0 0 0; fix move liquid mvv/dpd 0.5
= drop driven along a wall : wall : mdpd : @wetting; fix push liquid addforce 0.1 0 0; fix move liquid mvv/dpd 0.5
= drop, minimized : drop : mdpd : BEADS; @mdpd; @mvv; RUNS minimize 0 0 0 0; RUNS run 5
= surfactants in many-body dpd : soap : hybrid bond mdpd : @chains 50 0.5; @mdpd; pair_coeff 1 2 mdpd -25 25 18 1.0 0.75; @mvv
= evaporating drop : drop : mdpd :
BEADS; @mdpd; @mvv; region far sphere 3.5 3.5 3.5 3.2 side out; group gas dynamic all region far every 5; variable n equal count(gas); show v_n
= drop under a wall of lj : wall : mdpd :
HEAD boundary p p f; @wetting; fix top liquid wall/lj93 zhi EDGE 1.0 1.0 2.5; fix hold wall setforce 0 0 0; fix move liquid mvv/dpd 0.5
= sheared fluid : fluid : atomic : @triclinic xy
= fluid sheared in another plane : fluid : atomic : @triclinic xz
= polymers driven by opposite forces : solution : bond :
@chains 30 0.5; @two; region upper block INF INF INF INF 1.6 4.75; fix up all addforce 0.1 0 0 region upper; @move
fix down all addforce -0.05 0 0; compute layer all chunk/atom bin/1d z lower 0.7 units box
fix profile all ave/chunk 1 10 10 layer vx density/number file vx.profile
= flow between walls that reflect : fluid : atomic :
HEAD boundary p p f; BEADS; @one; fix wall all wall/reflect zlo EDGE zhi EDGE; fix push all gravity 0.1 vector 1 0 0; @move
= plates that move : plates : bond :
@chains 100 0.7; @two; group low id 1:36; group high id 37:72; group fluid type 1; fix move fluid nve; timestep 0.01
fix low low move linear -0.5 0 0 units box; fix high high move linear 0.5 0 0 units box
= stress of single beads : solution : bond :
@chains 30 0.5; @two; compute stress all stress/atom NULL; compute sum all reduce sum c_stress[1] c_stress[4]; @move; show c_sum[1] c_sum[2]
= velocities remembered : fluid : atomic : BEADS; @one; compute memory all vacf; @move; show c_memory[4]
= viscosity by exchange of momentum : fluid : atomic : BEADS; @one; fix exchange all viscosity 5 x z 6; @move
= flow that decays : fluid : atomic :
BEADS; @one; variable speed atom 0.2*z; velocity all set v_speed NULL NULL sum yes; compute thermal all temp/profile 1 0 0 z 6; @move; show c_thermal
= oscillating force : fluid : atomic : BEADS; @one; variable push equal 0.2*sin(6.28*time); fix push all addforce v_push 0 0; @move
= ends held by springs : solution : bond : @chains 30 0.5; @two; group first id 1 6 11; fix hold first spring/self 20; @move
= clay with charges cut off : clay : full : @clay coul/cut 2.0; @move
= clay with soft charges : clay : full : @clay coul/cut/soft 2 1 2.0 1.0; @move
= clay with soft long-range charges : clay : full : HEAD kspace_style ewald 1e-7; @clay coul/long/soft 2 1 2.0 1.0; @move; accuracy 2e-5
= rigid clay : clay : full :
bond_style harmonic; BEADS; bond_coeff 1 100 0.7; @one; group clay type 1; group rest subtract all clay; fix rigid clay rigid/nve molecule
fix move rest nve; timestep 0.0002; RUNS thermo_style custom step temp pe ke; RUNS run 0; RUNS run 10
= gel of morse and friction : gel : atomic :
BEADS; pair_style hybrid/overlay morse 1.6 dpd/tstat 0 0 1.2 88; pair_coeff * * morse 5.0 6.0 1.0; pair_coeff * * dpd/tstat 4.5; @move
= gel of lj in a bath : gel : atomic :
BEADS; pair_style lj/cut 2.5; pair_coeff * * 1.0 1.0; fix move all nve; fix bath all langevin 0 0 1.0 5; timestep 0.005
= gel of yukawa and dpd : gel : atomic :
BEADS; pair_style hybrid/overlay yukawa 2.0 2.0 dpd 0 1.0 3; pair_coeff * * yukawa 1.0 2.0; pair_coeff * * dpd 25 4.5 1.0; @move
= rods as rigid bodies : rods : bond :
@chains 100 0.5; @two; group rods type 1; group rest type 2; fix rods rods rigid/small molecule; fix move rest nve; timestep 0.0002; accuracy 1e-4
RUNS thermo_style custom step temp pe ke; RUNS run 0; RUNS run 10
= electrolyte of smeared charges : ions : charge : @smeared; @move
= electrolyte, hybrid : ions : full :
BEADS; pair_style hybrid/overlay dpd 0 1 5 coul/slater/long 0.6 2.0; pair_coeff * * dpd 25 4.5; pair_coeff * * coul/slater/long
kspace_style pppm 1e-5; @move; accuracy 1e-4
= electrolyte, screened : ions : charge :
BEADS; pair_style hybrid/overlay dpd 0 1 5 coul/debye 1.5 2.0; pair_coeff * * dpd 25 4.5; pair_coeff * * coul/debye; @move
= electrolyte in a field : ions : charge : @smeared; fix field all efield 0.5 0 0; @move
= film of two liquids : film : atomic : BEADS; @two; @flat
= film on a square lattice :  : atomic : @film sq
= film on a hexagonal lattice :  : atomic : @film hex
= phase inversion in units si : layers : bond : HEAD units si; @chains 4 0; @three; @move; si
= phase inversion between solvents : layers : bond :
@chains 4 0; @three; region bath block INF INF INF INF 3 INF; set region bath type/fraction 3 1.0 5; @move
= beads that change their type : layers : bond : @chains 4 0; @three; @move; RUNS run 5; RUNS set group all type 3; RUNS run 5
= a core and a shell : fluid : atomic :
region inner block 0.5 3.5 0.5 3.5 0.5 3.5 units box; BEADS; group inner region inner; set group inner type 2; @two; @move; types 2
= repulsion without friction : fluid : atomic : BEADS; pair_style dpd/fdt 1.0 1.0 5; pair_coeff * * 25 0.0 1.0; @move
= friction along and across : fluid : atomic : BEADS; pair_style dpd/ext 0 1.0 5; pair_coeff * * 25 4.5 4.5 0.5 0.5 1.0; @move
= balanced, with energies of beads : layers : bond :
HEAD processors * * *; @chains 4 0; @three; fix even all balance 5 1.05 shift xyz 5 1.1; compute each all pe/atom; compute most all reduce max c_each
@move; show c_most
= accelerated styles : layers : bond :
HEAD package omp 1; HEAD suffix omp; @chains 4 0; pair_style dpd/omp 0 1.0 7; pair_coeff * * 25 4.5; @move
= solvent that overlaps deleted : layers : bond : @chains 4 0; @three; group free type 2 3; delete_atoms overlap 0.45 free free; @move
= held in a region : drop : atomic :
region ball sphere 3.5 3.5 3.5 3.6; BEADS; @one; fix ball all wall/region ball harmonic 10 1 0.5; @move
"""

LIPID = """lipid

3 atoms
2 bonds

Coords

1 0 0 0\n2 0 0 0.6\n3 0 0 1.2

Types

1 1\n2 2\n3 2

Bonds

1 1 1 2\n2 1 2 3

Special Bond Counts

1 1 1 0\n2 2 0 0\n3 1 1 0

Special Bonds

1 2 3\n2 1 3\n3 2 1
"""


def _statements(text: str) -> list[str]:
    found = []
    for words in (part.split() for part in text.replace("\n", ";").split(";")):
        if words and words[0].startswith("@"):
            shared = SHARED[words[0][1:]]
            for k in range(5, 0, -1):
                shared = shared.replace(f"%{k}", words[k] if k < len(words) else "")
            found += _statements(shared)
        elif words:
            found.append(" ".join(words))
    return found


def _deck(beads: str, style: str, text: str) -> FieldDeck:
    said: dict[str, str] = {}
    head, body, runs = ["units lj", "neighbor 0.3 bin", "neigh_modify every 1 delay 0 check yes", "comm_modify vel yes cutoff 2.5"], [], []
    for statement in _statements(text):
        first, _, rest = statement.partition(" ")
        if first in ("accuracy", "reads", "show", "types", "si"):
            said[first] = rest
        else:
            {"HEAD": head, "RUNS": runs}.get(first, body).append(rest if first in ("HEAD", "RUNS") else statement)
    head.sort(key=lambda line: line.split()[0] not in ("clear", "units"))  # These must come before all others.
    head = [line for k, line in enumerate(head) if not (line == "units lj" and "units si" in head)]
    shown = "pe evdwl" if "si" in said else "temp pe ke press evdwl emol lx ly lz"
    tail = [f"thermo_style custom step {shown} {said.get('show', '')}", "thermo_modify norm no format float %.15g", "thermo 5"]
    last = "write_dump all custom last.dump id type xu yu zu vx vy vz modify sort id format float %.12g"
    text = "\n".join([*head, f"atom_style {style}", *body, *tail, *(runs or ["run 15"]), last]) + "\n"
    data = (lambda: BEADS[beads]().text(style, int(said.get("types", 0)))) if beads else None
    return FieldDeck(text.replace("BEADS", f"read_data data.beads {said.get('reads', '')}"), data, float(said.get("accuracy", 1e-6)))


DECKS: dict[str, FieldDeck] = {}
for part in TEXTS.split("\n= ")[1:]:
    name, beads, style, text = (word.strip() for word in part.split(":", 3))
    DECKS[name] = _deck(beads, style, text)

#: What is said to decks that are refused, and which they are.
REFUSED: dict[str, tuple[str, ...]] = {
    "'smd'": ("lipid pulled out",),
    "'viscosity'": ("viscosity by exchange of momentum",),
}
