"""Small rings in a graph of bonds, and rings pierced by a bond, which no minimisation frees because one bond would have to pass through
another."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from openmm import app

from ..base.errors import ParameterError, require
from ..base.geometry import minimum_images, pairs_within, widths
from ..base.units import position_array, whole_number
from ..model.box import box_vectors


def neighbours_of(bonds: np.ndarray, n: int) -> list[list[int]]:
    """Bonded neighbours of each of n atoms, from bonds (B, 2)."""
    found: list[list[int]] = [[] for _ in range(n)]
    for i, j in bonds.tolist():
        found[i].append(j)
        found[j].append(i)
    return found


def small_rings(bonds: np.ndarray, n: int, largest: int) -> list[tuple[int, ...]]:
    """Smallest rings of up to ``largest`` atoms through each bond: the atoms of each ring in the order of its bonds, each ring once.  Both
    rings of a fused pair are found, but not their outline, whose bonds are in smaller rings."""
    neighbours = [set(found) for found in neighbours_of(bonds, n)]
    ends = deque(atom for atom in range(n) if len(neighbours[atom]) == 1)
    while ends:  # strips side chains, linear molecules and most solvents, which are in no ring
        atom = ends.popleft()
        for other in neighbours[atom]:
            neighbours[other].discard(atom)
            if len(neighbours[other]) == 1:
                ends.append(other)
        neighbours[atom] = set()
    rings: dict[frozenset[int], tuple[int, ...]] = {}
    for i in range(n):
        for j in neighbours[i]:
            if i < j:
                for ring in _ways_around(neighbours, i, j, largest):
                    rings.setdefault(frozenset(ring), ring)
    return list(rings.values())


def _ways_around(neighbours: list[set[int]], start: int, end: int, largest: int) -> list[tuple[int, ...]]:
    """Shortest paths of at most ``largest`` atoms between two bonded atoms, other than the bond itself."""
    paths: list[tuple[int, ...]] = [(start,)]
    seen = {start}
    for _ in range(largest - 1):
        longer = [(*path, atom) for path in paths for atom in neighbours[path[-1]] - seen if (path[-1], atom) != (start, end)]
        whole = [path for path in longer if path[-1] == end]
        if whole:
            return whole
        seen.update(path[-1] for path in longer)
        paths = longer
    return []


def within_bonds(neighbours: list[list[int]], atoms: tuple[int, ...], reach: int) -> dict[int, int]:
    """Atoms at most ``reach`` bonds from one of the given atoms, and the number of bonds."""
    distance = dict.fromkeys(atoms, 0)
    queue = deque(atoms)
    while queue:
        atom = queue.popleft()
        if distance[atom] < reach:
            for other in neighbours[atom]:
                if other not in distance:
                    distance[other] = distance[atom] + 1
                    queue.append(other)
    return distance


#: Distance to push a bond beyond the edge of a ring that it pierced, nm: about the radius of a carbon atom.
BEYOND = 0.15
#: Number of bonds from a pushed bond over which atoms move with it, less with every bond.
REACH = 4


@dataclass(frozen=True)
class Piercing:
    """A bond that passes through a ring.

    Attributes
    ----------
    ring : tuple of int
        Atoms of the ring, in the order of its bonds.
    bond : (int, int)
        Atoms of the bond.
    text : str
        Description with chains, residues and atoms.
    """

    ring: tuple[int, ...]
    bond: tuple[int, int]
    text: str

    def __str__(self) -> str:
        return self.text


def find_piercings(topology: app.Topology, positions, box=None, *, max_ring: int = 8) -> list[Piercing]:
    """Bonds that pass through rings.

    The surface of a ring is the fan of triangles between its centroid and its bonds.  A bond pierces the ring if it crosses a triangle and
    has no atom in the ring.  All distances are minimum images, so molecules may be whole or wrapped.

    Parameters
    ----------
    topology : openmm.app.Topology
        Topology with bonds.
    positions : (N, 3) array of lengths
    box : (3,) or (3, 3) array of lengths, optional
        Edges or box vectors; by default those of the topology, if any.
    max_ring : int, default 8
        Number of atoms in the largest rings.  Of rings that share a bond, only the smallest is considered.

    Returns
    -------
    list of Piercing

    Raises
    ------
    ParameterError
        If the topology has no bonds, positions have the wrong shape or are not finite, or a ring or bond is too long for minimum images
        in this box.

    Examples
    --------
    >>> import numpy as np
    >>> from openmm import app
    >>> from openmm_dpd.molecules import find_piercings
    >>> topology = app.Topology()
    >>> chain = topology.addChain()
    >>> ring, thread = (topology.addResidue(name, chain) for name in ("BNZ", "ETH"))
    >>> atoms = [topology.addAtom(f"C{k}", app.element.carbon, ring if k < 6 else thread) for k in range(8)]
    >>> for k in range(6):
    ...     topology.addBond(atoms[k], atoms[(k + 1) % 6])
    >>> topology.addBond(atoms[6], atoms[7])
    >>> angle = np.arange(6) * np.pi / 3
    >>> hexagon = 0.14 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    >>> print(find_piercings(topology, np.vstack([hexagon, [[0, 0, -0.08], [0, 0.02, 0.07]]]))[0])
    the bond C6-C7 of ETH 2 passes through the ring C0 C5 C4 C3 C2 C1 of BNZ 1
    """
    bonds = bonds_of_topology(topology)
    if not len(bonds):
        raise ParameterError("the Topology has no bonds, so its rings are unknown; topology.createStandardBonds() adds bonds")
    x = position_array(positions, topology.getNumAtoms(), "the topology says")
    vectors = box_vectors(topology.getPeriodicBoxVectors() if box is None else box)
    rings = small_rings(bonds, len(x), whole_number(max_ring, "max_ring", least=3))
    return [Piercing(ring, bond, _words(topology, ring, bond)) for ring, bond in crossings(rings, bonds, x, vectors)]


def bonds_of_topology(topology: app.Topology) -> np.ndarray:
    """Bonds of a topology as pairs of atom indices, (B, 2)."""
    require(topology, app.Topology, "expected an openmm.app.Topology")
    return np.array([(bond[0].index, bond[1].index) for bond in topology.bonds()], dtype=np.int64).reshape(-1, 2)


def crossings(
    rings: list[tuple[int, ...]], bonds: np.ndarray, x: np.ndarray, box: np.ndarray | None
) -> list[tuple[tuple[int, ...], tuple[int, int]]]:
    """Pairs of a ring and a bond that passes through it; ParameterError if one is too long for minimum images."""
    if not rings:
        return []
    along = minimum_images(x[bonds[:, 1]] - x[bonds[:, 0]], box)
    corners = [_around(ring, x, box) for ring in rings]
    centres = np.array([corner.mean(axis=0) for corner in corners])
    extent = max(float(np.linalg.norm(corner - centre, axis=1).max()) for corner, centre in zip(corners, centres, strict=True))
    reach = extent + 0.5 * float(np.linalg.norm(along, axis=1).max())
    if box is not None and reach > 0.5 * widths(box).min():
        raise ParameterError(
            f"the longest bond and the largest ring reach {reach:.3g} nm, more than half the smallest width of the box, "
            f"{widths(box).min():.3g} nm, so minimum images are ambiguous; take a larger box"
        )
    found = []
    near, which, _ = pairs_within(centres, x[bonds[:, 0]] + 0.5 * along, box, reach)
    for r, b in zip(near.tolist(), which.tolist(), strict=True):
        i, j = bonds[b].tolist()
        if i in rings[r] or j in rings[r]:
            continue
        start = minimum_images((x[i] + 0.5 * along[b] - centres[r])[None], box)[0] - 0.5 * along[b]
        if _crosses(corners[r] - centres[r], start, along[b]):
            found.append((rings[r], (i, j)))
    return sorted(found)


def _around(ring: tuple[int, ...], x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """Positions of a ring's atoms in one piece, (n, 3)."""
    atoms = list(ring)
    steps = minimum_images(np.diff(x[atoms], axis=0), box)
    return x[atoms[0]] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def _crosses(corners: np.ndarray, start: np.ndarray, along: np.ndarray) -> bool:
    """Whether a segment meets a triangle of the fan around the origin (Moeller and Trumbore, J. Graphics Tools 2, 21 (1997))."""
    a, b = corners, np.roll(corners, -1, axis=0)
    h = np.cross(along, b)
    det = np.einsum("kd,kd->k", a, h)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (h @ start) / det
        q = np.cross(start, a)
        v = (q @ along) / det
        t = np.einsum("kd,kd->k", b, q) / det
        # NaN if the segment lies in the plane of a triangle: such a bond does not pass through the ring
        return bool(np.any((u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)))


def pushed_out(
    x: np.ndarray,
    found: list[tuple[tuple[int, ...], tuple[int, int]]],
    bonds: np.ndarray,
    box: np.ndarray | None,
    mobile: np.ndarray,
    *,
    turn: int = 0,
) -> np.ndarray:
    """Positions (N, 3) with pierced rings and bonds, from :func:`crossings`, moved apart in the plane of the ring, over one of its edges.
    The bond moves past the ``turn``-th nearest edge; atoms up to four bonds away follow part of the way, which bends the chain but does
    not tear it.  If the bond cannot move (``mobile`` (N,) marks atoms that can), the ring moves the other way."""
    x = x.copy()
    neighbours = neighbours_of(bonds, len(x))
    for ring, bond in found:
        corners = _around(ring, x, box)
        centre = corners.mean(axis=0)
        corners -= centre
        along = minimum_images((x[bond[1]] - x[bond[0]])[None], box)[0]
        start = minimum_images((x[bond[0]] + 0.5 * along - centre)[None], box)[0] - 0.5 * along
        normal = np.linalg.svd(corners)[2][2]
        rise = float(along @ normal)
        point = start + along * np.clip(-float(start @ normal) / rise if rise else 0.5, 0, 1)
        point -= (point @ normal) * normal
        ways = 0.5 * (corners + np.roll(corners, -1, axis=0)) - point  # to the midpoints of the edges
        ways -= np.outer(ways @ normal, normal)
        length = np.linalg.norm(ways, axis=1)
        edge = np.argsort(length)[turn % len(ring)]
        away = ways[edge] * (1 + BEYOND / max(length[edge], 1e-6))
        moved, sign, held = (bond, 1.0, ring) if np.all(mobile[list(bond)]) else (ring, -1.0, bond)
        for atom, steps in within_bonds(neighbours, moved, REACH).items():
            if mobile[atom] and atom not in held:
                x[atom] += sign * (1 - steps / (REACH + 1)) * away
    return x


def _words(topology: app.Topology, ring: tuple[int, ...], bond: tuple[int, int]) -> str:
    atoms = list(topology.atoms())
    return f"the bond {_named([atoms[k] for k in bond], '-')} passes through the ring {_named([atoms[k] for k in ring], ' ')}"


def _named(atoms: list[app.topology.Atom], between: str) -> str:
    """Names of atoms with their residues, and with their chain if the topology has several."""
    residues = list(dict.fromkeys(atom.residue for atom in atoms))
    chains, own = list(residues[0].chain.topology.chains()), residues[0].chain
    chain = f" of chain {own.id.strip() or own.index + 1}" if len(chains) > 1 else ""
    return f"{between.join(atom.name for atom in atoms)} of {'/'.join(f'{r.name} {r.id}' for r in residues)}{chain}"
