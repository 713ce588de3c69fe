"""Small rings in a graph of bonds."""

from collections import deque

import numpy as np


def neighbours_of(bonds: np.ndarray, n: int) -> list[list[int]]:
    """Bonded neighbours of each of n atoms; ``bonds`` is (B, 2)."""
    found: list[list[int]] = [[] for _ in range(n)]
    for i, j in bonds.tolist():
        found[i].append(j)
        found[j].append(i)
    return found


def small_rings(bonds: np.ndarray, n: int, largest: int) -> list[tuple[int, ...]]:
    """The smallest rings through each bond, of up to ``largest`` atoms: the atoms of each in the order of its bonds, each ring once.  The
    two rings of a fused pair are both found, the outline around them is not: each of its bonds is in a smaller ring."""
    neighbours = [set(found) for found in neighbours_of(bonds, n)]
    ends = deque(atom for atom in range(n) if len(neighbours[atom]) == 1)
    while ends:  # what hangs on a ring is in none: chains and most solvents are gone after this
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
    """Shortest paths of at most ``largest`` atoms between two bonded atoms that do not take the bond itself."""
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
    """Atoms that are at most so many bonds from one of these, and how many."""
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
