"""Ten dense systems with molecules at random places, for trials of starting structures: each a function to topology, System, positions."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import openmm
from openmm import app, unit
from scipy.spatial.transform import Rotation

Packed = tuple[app.Topology, openmm.System, np.ndarray]

HERE = Path(__file__).resolve().parent
SHIPPED = Path(app.__file__).parent / "data"

#: g/mol in a nm^3 at 1 g/cm^3.
PER_VOLUME = 602.214

#: TraPPE-UA for alkanes (M. G. Martin and J. I. Siepmann, J. Phys. Chem. B 102, 2569 (1998)); its bonds are rigid.
UNITED = """<ForceField>
<AtomTypes>
 <Type name="CH3" class="C" element="C" mass="15.035"/>
 <Type name="CH2" class="C" element="C" mass="14.027"/>
</AtomTypes>
<Residues>
 <Residue name="CH3"><Atom name="C" type="CH3"/><ExternalBond atomName="C"/></Residue>
 <Residue name="CH2"><Atom name="C" type="CH2"/><ExternalBond atomName="C"/><ExternalBond atomName="C"/></Residue>
</Residues>
<HarmonicBondForce><Bond class1="C" class2="C" length="0.154" k="0"/></HarmonicBondForce>
<HarmonicAngleForce><Angle class1="C" class2="C" class3="C" angle="1.98968" k="519.65"/></HarmonicAngleForce>
<PeriodicTorsionForce><Proper class1="C" class2="C" class3="C" class4="C" periodicity1="1" phase1="0" k1="2.9519"
 periodicity2="2" phase2="3.14159265" k2="-0.5670" periodicity3="3" phase3="0" k3="6.5794"/></PeriodicTorsionForce>
<NonbondedForce coulomb14scale="0" lj14scale="0">
 <Atom type="CH3" charge="0" sigma="0.375" epsilon="0.8148"/>
 <Atom type="CH2" charge="0" sigma="0.395" epsilon="0.3825"/>
</NonbondedForce></ForceField>"""


# -- molecules ---------------------------------------------------------------------------------------------------------------------
class Shape:
    """Atoms of one molecule: names, types, places and bonds."""

    def __init__(self, carbons: np.ndarray, kind: str, ring: bool = False):
        n = len(carbons)
        self.x = list(carbons)
        self.types = [kind] * n
        self.bonds = [(k, (k + 1) % n) for k in range(n if ring else n - 1)]

    def put(self, kind: str, place: np.ndarray, bonded: int) -> int:
        """Add an atom, and return its number."""
        self.x.append(place)
        self.types.append(kind)
        self.bonds.append((bonded, len(self.x) - 1))
        return len(self.x) - 1

    def hydrogens(self, k: int, before: np.ndarray, after: np.ndarray) -> list[np.ndarray]:
        """Directions of the two further bonds of a saturated carbon between two others."""
        u, v = unit_vector(before - self.x[k]), unit_vector(after - self.x[k])
        out, side = -unit_vector(u + v), unit_vector(np.cross(u, v))
        return [0.58 * out + sign * 0.81 * side for sign in (1, -1)]

    def phenyl(self, k: int, out: np.ndarray, rng: np.random.Generator) -> None:
        """A phenyl group on atom k."""
        side = unit_vector(np.cross(out, rng.normal(size=3)))
        rays = [-np.cos(a) * out + np.sin(a) * side for a in np.arange(6) * np.pi / 3]
        centre = self.x[k] + (0.151 + 0.14) * out
        ring = [self.put("CA", centre + 0.14 * rays[0], k)]
        for ray in rays[1:]:
            ring.append(self.put("CA", centre + 0.14 * ray, ring[-1]))
        self.bonds.append((ring[-1], ring[0]))
        for carbon, ray in zip(ring[1:], rays[1:], strict=True):
            self.put("HA", centre + 0.248 * ray, carbon)

    def template(self, name: str) -> str:
        """Residue of a ForceField; a carbon has the charge that balances its hydrogens."""
        held = {"HC": 0.06, "HA": 0.115}
        charges = [held.get(kind, 0.0) for kind in self.types]
        for i, j in self.bonds:
            if self.types[j] in held:
                charges[i] -= held[self.types[j]]
        atoms = "".join(f'<Atom name="A{k}" type="{t}" charge="{q}"/>' for k, (t, q) in enumerate(zip(self.types, charges, strict=True)))
        return f'<Residue name="{name}">{atoms}{"".join(f"""<Bond from="{i}" to="{j}"/>""" for i, j in self.bonds)}</Residue>'


def unit_vector(v: np.ndarray) -> np.ndarray:
    """A vector of length 1."""
    return v / np.linalg.norm(v)


def walk(n: int, bond: float, angle: float, rng: np.random.Generator) -> np.ndarray:
    """A chain of n atoms with fixed bonds (nm) and angles (degrees), and any torsions: it may cross itself."""
    x, u = [np.zeros(3)], unit_vector(rng.normal(size=3))
    turn = np.radians(180 - angle)
    for _ in range(n - 1):
        x.append(x[-1] + bond * u)
        u = np.cos(turn) * u + np.sin(turn) * unit_vector(np.cross(u, rng.normal(size=3)))
    return np.array(x)


def alkane(n: int, rng: np.random.Generator, phenyl: bool = False) -> Shape:
    """A chain of n carbons; with a phenyl group on every second one, polystyrene of any tacticity."""
    path = walk(n + 2, 0.1529, 112.7, rng)
    shape = Shape(path[1:-1], "CT")
    for k in range(n):
        ways = shape.hydrogens(k, path[k], path[k + 2])
        if phenyl and k % 2:
            shape.phenyl(k, ways.pop(rng.integers(2)), rng)
        for end in [m for m in (k, k + 2) if m in (0, n + 1)]:
            ways.append(unit_vector(path[end] - path[k + 1]))
        for way in ways:
            shape.put("HC", shape.x[k] + 0.109 * way, k)
    return shape


def cyclohexane() -> Shape:
    """The chair."""
    a = np.arange(6) * np.pi / 3
    shape = Shape(np.column_stack([0.1458 * np.cos(a), 0.1458 * np.sin(a), 0.023 * (-1.0) ** np.arange(6)]), "CT", ring=True)
    for k in range(6):
        for way in shape.hydrogens(k, shape.x[k - 1], shape.x[(k + 1) % 6]):
            shape.put("HC", shape.x[k] + 0.109 * way, k)
    return shape


def benzene() -> Shape:
    """A flat ring."""
    a = np.arange(6) * np.pi / 3
    rays = np.column_stack([np.cos(a), np.sin(a), 0 * a])
    shape = Shape(0.14 * rays, "CA", ring=True)
    for k, ray in enumerate(rays):
        shape.put("HA", 0.248 * ray, k)
    return shape


# -- boxes -------------------------------------------------------------------------------------------------------------------------
def scattered(molecules: list[np.ndarray], edge: float, rng: np.random.Generator) -> np.ndarray:
    """Molecules turned at random, with their centres at random places."""
    turned = [Rotation.random(random_state=rng).apply(x - x.mean(axis=0)) + edge * rng.random(3) for x in molecules]
    return np.concatenate(turned)


def cube(topology: app.Topology, edge: float) -> None:
    """Give a topology a cubic box."""
    topology.setPeriodicBoxVectors(np.eye(3) * edge * unit.nanometer)


def system_of(field: app.ForceField, topology: app.Topology) -> openmm.System:
    """Periodic, with rigid bonds to hydrogen."""
    return field.createSystem(
        topology, nonbondedMethod=app.PME, nonbondedCutoff=0.9 * unit.nanometer, constraints=app.HBonds, rigidWater=True
    )


def hydrocarbons(make: Callable[[np.random.Generator], Shape], count: int, density: float, seed: int) -> Packed:
    """So many molecules of one kind in a cube; every one has a shape of its own.  The density is in g/cm^3."""
    rng = np.random.default_rng(seed)
    shapes = [make(rng) for _ in range(count)]
    text = (HERE / "hydrocarbons.xml").read_text(encoding="utf-8")
    residues = f"<Residues>{shapes[0].template('MOL')}</Residues>"
    field = app.ForceField(io.StringIO(text.replace("</AtomTypes>", "</AtomTypes>" + residues)))
    topology, mass = app.Topology(), 0.0
    for shape in shapes:
        residue = topology.addResidue("MOL", topology.addChain())
        elements = [app.element.carbon if kind[0] == "C" else app.element.hydrogen for kind in shape.types]
        mass += sum(element.mass.value_in_unit(unit.dalton) for element in elements)
        atoms = [topology.addAtom(f"A{k}", element, residue) for k, element in enumerate(elements)]
        for i, j in shape.bonds:
            topology.addBond(atoms[i], atoms[j])
    edge = (mass / PER_VOLUME / density) ** (1 / 3)
    cube(topology, edge)
    return topology, system_of(field, topology), scattered([np.array(shape.x) for shape in shapes], edge, rng)


def united_atoms(chains: int, length: int, density: float, seed: int) -> Packed:
    """Polyethylene of united atoms with rigid bonds."""
    rng = np.random.default_rng(seed)
    topology = app.Topology()
    for _ in range(chains):
        chain, last = topology.addChain(), None
        for k in range(length):
            atom = topology.addAtom("C", app.element.carbon, topology.addResidue("CH3" if k in (0, length - 1) else "CH2", chain))
            if last is not None:
                topology.addBond(last, atom)
            last = atom
    edge = (chains * (14.027 * length + 2.016) / PER_VOLUME / density) ** (1 / 3)
    cube(topology, edge)
    system = app.ForceField(io.StringIO(UNITED)).createSystem(
        topology, nonbondedMethod=app.CutoffPeriodic, nonbondedCutoff=1.0, constraints=app.AllBonds
    )
    return topology, system, scattered([walk(length, 0.154, 114.0, rng) for _ in range(chains)], edge, rng)


def solution(field: app.ForceField, solutes: list[tuple[app.Topology, np.ndarray]], waters: int, edge: float, seed: int) -> Packed:
    """Solutes and rigid waters at random places in a cube."""
    rng = np.random.default_rng(seed)
    modeller = app.Modeller(app.Topology(), [] * unit.nanometer)
    for topology, x in solutes:
        modeller.add(topology, x * unit.nanometer)
    water = app.Topology()
    chain = water.addChain()
    for _ in range(waters):
        residue = water.addResidue("HOH", chain)
        o, h1, h2 = (water.addAtom(name, app.element.get_by_symbol(name[0]), residue) for name in ("O", "H1", "H2"))
        water.addBond(o, h1)
        water.addBond(o, h2)
    if waters:
        modeller.add(water, np.tile([[0, 0, 0], [0.09572, 0, 0], [-0.024, 0.09266, 0]], (waters, 1)) * unit.nanometer)
    modeller.addExtraParticles(field)
    x = np.array(modeller.positions.value_in_unit(unit.nanometer))
    molecules, first = [], 0
    for size in [topology.getNumAtoms() for topology, _ in solutes] + [
        len(list(residue.atoms())) for residue in modeller.topology.residues() if residue.name == "HOH"
    ]:
        molecules.append(x[first : first + size])
        first += size
    cube(modeller.topology, edge)
    return modeller.topology, system_of(field, modeller.topology), scattered(molecules, edge, rng)


def ion(name: str, symbol: str) -> tuple[app.Topology, np.ndarray]:
    """A topology of one atom."""
    topology = app.Topology()
    topology.addAtom(name, app.element.get_by_symbol(symbol), topology.addResidue(name, topology.addChain()))
    return topology, np.zeros((1, 3))


def piece(file: str, first: int, count: int) -> tuple[app.Topology, np.ndarray]:
    """Some residues of a structure that OpenMM ships; a peptide's last one gets the oxygen it lacks."""
    pdb = app.PDBFile(str(SHIPPED / file))
    residues = list(pdb.topology.residues())
    modeller = app.Modeller(pdb.topology, pdb.positions)
    modeller.delete(residues[:first] + residues[first + count :])
    x = [np.array(row) for row in modeller.positions.value_in_unit(unit.nanometer)]
    topology = modeller.topology
    last = list(topology.residues())[-1]
    atoms = {atom.name: atom for atom in last.atoms()}
    if "CA" in atoms and "OXT" not in atoms:
        grown = app.Topology()
        chain, new, places = grown.addChain(), {}, []
        for residue in topology.residues():
            copy = grown.addResidue(residue.name, chain, residue.id)
            for atom in residue.atoms():
                new[atom] = grown.addAtom(atom.name, atom.element, copy)
                places.append(x[atom.index])
        for bond in topology.bonds():
            grown.addBond(new[bond[0]], new[bond[1]])
        middle, ca, o = (x[atoms[name].index] for name in ("C", "CA", "O"))
        grown.addBond(new[atoms["C"]], grown.addAtom("OXT", app.element.oxygen, copy))
        places.append(middle - 0.125 * unit_vector(unit_vector(ca - middle) + unit_vector(o - middle)))
        return grown, np.array(places)
    return topology, np.array(x)


AMBER = ("amber14-all.xml", "amber14/tip3p.xml")


def protein(residues: int, waters: int, edge: float, seed: int) -> Packed:
    """The first residues of the protein that OpenMM ships (the villin headpiece, 35 in all) in TIP3P."""
    return solution(app.ForceField(*AMBER), [piece("test.pdb", 0, residues)], waters, edge, seed)


def lipids(copies: int, waters: int, edge: float, seed: int) -> Packed:
    """DLPC in TIP3P, with CHARMM36, whose Lennard-Jones terms are in a CustomNonbondedForce."""
    return solution(app.ForceField("charmm36.xml", "charmm36/water.xml"), [piece("DLPC.pdb", 0, 1)] * copies, waters, edge, seed)


def salt_water(pairs: int, waters: int, edge: float, seed: int) -> Packed:
    """Sodium chloride in TIP3P."""
    ions = [ion("NA", "Na"), ion("CL", "Cl")] * pairs
    return solution(app.ForceField(*AMBER), ions, waters, edge, seed)


#: Name and maker of each system.
SYSTEMS: dict[str, Callable[[], Packed]] = {
    "polyethylene, 10 x C100, united atoms": lambda: united_atoms(10, 100, 0.78, 1),
    "polyethylene, 8 x C40": lambda: hydrocarbons(lambda rng: alkane(40, rng), 8, 0.78, 1),
    "polystyrene, 8 x 8 units": lambda: hydrocarbons(lambda rng: alkane(17, rng, phenyl=True), 8, 0.95, 1),
    "benzene, 100": lambda: hydrocarbons(lambda rng: benzene(), 100, 0.87, 1),
    "cyclohexane, 70": lambda: hydrocarbons(lambda rng: cyclohexane(), 70, 0.77, 1),
    "water TIP3P, 700": lambda: solution(app.ForceField(*AMBER), [], 700, 2.76, 1),
    "water TIP4P-Ew, 500": lambda: solution(app.ForceField("amber14/tip4pew.xml"), [], 500, 2.47, 1),
    "salt water, 30 NaCl, 600 TIP3P": lambda: salt_water(30, 600, 2.68, 1),
    "protein of 35 residues, 500 TIP3P": lambda: protein(35, 500, 2.75, 1),
    "lipids DLPC, 6, 150 TIP3P (CHARMM36)": lambda: lipids(6, 150, 2.2, 1),
}
