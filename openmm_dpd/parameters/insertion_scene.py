"""A solvent with copies of a molecule, each coupled to the solvent by a fraction of its repulsion."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from scipy.sparse.csgraph import shortest_path

from ..base.errors import ParameterError, require, what_is
from ..base.geometry import graph, minimum_images, widths
from ..model.pairs import NONE, PairTable, SoftRepulsion
from ..model.scene import Scene
from ..model.temperature import TemperatureRamp
from ..molecules import Molecule, pack
from ..molecules.terms import many_terms


@dataclass(frozen=True, eq=False)
class Insertion:
    """Copies of a molecule in a solvent; the beads of the solvent come first."""

    scene: Scene  #: A bead in the middle of each copy is immobile
    solvent: int  #: Number of beads of the solvent
    copies: int
    #: A and cutoff between the n beads of the molecule and the S types of the solvent at full coupling, for each pair table; 0 for types
    #: without beads
    repulsion: tuple[tuple[np.ndarray, np.ndarray], ...]

    @property
    def reach(self) -> float:
        """Longest cutoff between molecule and solvent, nm."""
        return max(float(cutoff.max()) for _, cutoff in self.repulsion)

    def energies(self, distances: np.ndarray) -> np.ndarray:
        """Energies (copies,) with the solvent at full coupling, kJ/mol, from distances (copies, n, solvent) between beads."""
        kinds = self.scene.type_ids[: self.solvent]
        found = np.zeros(self.copies)
        for A, cutoff in self.repulsion:
            overlap = np.maximum(0.0, 1.0 - distances / np.maximum(cutoff, 1e-300)[:, kinds])
            found += 0.5 * np.einsum("cns,ns->c", overlap * overlap, (A * cutoff)[:, kinds])
        return found


def insertion(molecule: Molecule, solvent: Scene, parts: np.ndarray, seed: int) -> Insertion:
    """Copies of the molecule in the solvent, one for each coupling in ``parts``; ParameterError if molecule or solvent have terms that
    cannot be scaled."""
    check(molecule, solvent)
    copies = len(parts)
    names = {(k, name): _free_name(f"{name}:{k + 1}", solvent.type_names) for k in range(copies) for name in dict.fromkeys(molecule.types)}
    masses = dict(solvent.masses) | {new: solvent.masses[name] for (_, name), new in names.items()}
    tables = [table for table in solvent.tables if table.kind is not None]
    resolved = [table.resolve(solvent.type_names) for table in tables]
    own, anchor = _placed(molecule, solvent, copies, seed)
    start = solvent.n_beads
    first = start + molecule.n_beads * np.arange(copies)
    mobile = np.ones(start + own.shape[0] * own.shape[1], bool)
    mobile[first + anchor] = False
    scene = Scene(
        masses=masses,
        types=[*solvent.types, *(names[k, name] for k in range(copies) for name in molecule.types)],
        positions=np.concatenate([solvent.positions, own.reshape(-1, 3)]),
        pairs=[_coupled(table, solvent.type_names, names, parts) for table in resolved],
        kT=solvent.kT,
        box=solvent.box,
        bead_masses=np.concatenate([solvent.bead_masses, np.tile([solvent.masses[name] for name in molecule.types], copies)]),
        bonds=[*solvent.bonds, *_terms(molecule.bonds, first)],
        angles=[*solvent.angles, *_terms(molecule.angles, first)],
        dihedrals=[*solvent.dihedrals, *_terms(molecule.dihedrals, first)],
        impropers=solvent.impropers,
        bonded_factors=solvent.bonded_factors,
        mobile=mobile,
    )
    return Insertion(scene, start, copies, tuple(between(table, molecule, solvent) for table in resolved))


def check(molecule: Molecule, solvent: Scene) -> None:
    """Raise ParameterError if the molecule cannot be put into the solvent."""
    require(molecule, Molecule, "molecule must be a Molecule of openmm_dpd.molecules")
    require(solvent, Scene, "solvent must be a Scene, such as pack(...).scene(pairs=..., kT=...)")
    unknown = [name for name in molecule.types if name not in solvent.masses]
    if unknown:
        raise ParameterError(
            f"the solvent's scene does not have the bead type {what_is(unknown[0])} of the molecule {molecule.name}; add it to `masses`, "
            f"which has {', '.join(solvent.masses)}, and to the pair coefficients"
        )
    for table in solvent.tables:
        if table.kind is not None and not (issubclass(table.kind, SoftRepulsion) and table.kind.internal is None):
            raise ParameterError(f"only the soft repulsion of DPD can be switched on by a factor, not {table.kind.__name__}")
    refused = {
        "charges": solvent.electrostatics is not None or molecule.charges is not None,
        "beads with internal energies, temperatures or concentrations": solvent.internal is not None,
        "segmental repulsion": solvent.segments is not None,
        "forces on single beads": bool(solvent.body_forces),
        "walls": bool(solvent.walls),
        "a shear": solvent.shear is not None,
        "bonds that form and break": bool(solvent.reactions),
        "beads that do not move": bool(solvent.immobile.any()),
        "beads on which not all forces act": solvent.interacting is not None,
        "a temperature that changes": isinstance(solvent.kT, TemperatureRamp),
        "no box": solvent.box is None,
        "a temperature of 0": not isinstance(solvent.kT, TemperatureRamp) and solvent.initial_kT == 0,
    }
    for what, found in refused.items():
        if found:
            raise ParameterError(f"the excess chemical potential of a molecule cannot be measured with {what}")


def _free_name(name: str, taken: list[str]) -> str:
    while name in taken:
        name += "'"
    return name


def _terms(terms: tuple, first: np.ndarray) -> list:
    """Bonds, angles or dihedrals of all copies, from those of the molecule and the first bead of each copy."""
    beads = [[start + bead for bead in entry[:-1]] for start in first.tolist() for entry in terms]
    return many_terms(np.array(beads), [entry[-1] for entry in terms] * len(first)) if terms else []


def _coupled(resolved: Mapping, solvents: list[str], names: Mapping[tuple[int, str], str], parts: np.ndarray) -> PairTable:
    """Pair table with the copies' types: unchanged among the copies; to the solvent, the repulsion is scaled and the friction is not."""
    entries = dict(resolved)
    for (k, name), new in names.items():
        for other in solvents:
            pair = _entry(resolved, name, other)
            if pair is not None:
                entries[new, other] = pair if pair is NONE else replace(pair, A=pair.A * float(parts[k]))
    for (one, first), (other, second) in combinations_with_replacement([(name, new) for (_, name), new in names.items()], 2):
        pair = _entry(resolved, one, other)
        if pair is not None:
            entries[first, second] = pair
    return PairTable(entries)


def _entry(resolved: Mapping, one: str, other: str):
    return resolved.get((one, other), resolved.get((other, one)))


def between(resolved: Mapping, molecule: Molecule, solvent: Scene) -> tuple[np.ndarray, np.ndarray]:
    """A and cutoffs between the n beads of the molecule and the S types of the solvent, (n, S) each; 0 for types without beads."""
    A, cutoff = np.zeros((2, molecule.n_beads, len(solvent.type_names)))
    for i, name in enumerate(molecule.types):
        for j in np.unique(solvent.type_ids).tolist():
            pair = _entry(resolved, name, solvent.type_names[j])
            if pair not in (None, NONE):
                A[i, j], cutoff[i, j] = pair.A, pair.cutoff
    return A, cutoff


def _placed(molecule: Molecule, solvent: Scene, copies: int, seed: int) -> tuple[np.ndarray, int]:
    """Positions of the copies, (copies, n, 3), each with its middle bead at a lattice point, and the index of that bead."""
    box = solvent.box
    assert box is not None
    mixture = pack({molecule: copies}, box=box, solvent=None, seed=seed, kT=solvent.initial_kT)
    beads = mixture.positions.reshape(copies, molecule.n_beads, 3)
    steps = shortest_path(graph(molecule.bond_pairs, molecule.n_beads).tocsr(), directed=False, unweighted=True)
    anchor = int(np.argmin(steps.max(axis=1)))
    return beads + (lattice_points(copies, box) - beads[:, anchor])[:, None, :], anchor


def lattice_points(count: int, box: np.ndarray) -> np.ndarray:
    """Points (count, 3) of the rank-1 lattice k (1, a, b)/count with the largest distance between its points."""
    multiples = np.arange(count)[:, None]
    best, chosen = -1.0, np.zeros((count, 3))
    for a in range(max(1, count)):
        for b in range(max(1, count)):
            points = (multiples * np.array([1, a, b]) / count % 1.0) @ box
            apart = np.linalg.norm(minimum_images(points[1:] - points[0], box), axis=1).min(initial=float(widths(box).min()))
            if apart > best + 1e-9:
                best, chosen = float(apart), points
    return chosen
