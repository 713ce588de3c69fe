"""Bonds that form and break, as the kernel needs them."""

from typing import Any

import numpy as np

from ..kernels.exceptions import compressed_exceptions
from ..kernels.formed import BeadsOf, Formed, Left, Segments, both_ways, of_sorts
from ..kernels.reactions import BondsSpec, ReactionSpec, turn
from ..model.reactions import bond_sorts, terms_formed, terms_like, terms_taken, types_change
from ..model.scene import Scene
from ..model.segments import segment_parts
from .forces.segments import segment_spec
from .kinds import bonded_kind
from .pair_spec import neighbours_change


def _roles(scene: Scene, reaction: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Roles of types, and valences and further types of beads of each role, see :class:`.ReactionSpec`."""
    names, roles = scene.type_names, np.full(len(scene.type_names), 2, np.int32)
    for role in (1, 0) if reaction.forms else ():
        roles[names.index(reaction.types[role])] = role
    others = reaction.becomes if reaction.forms else None
    becomes = None if others is None else np.array([-1 if name is None else names.index(name) for name in (*others, None)])
    return roles, np.array([*reaction.valences, 0] if reaction.forms else [0, 0, 0]), becomes


def table_blocks(scene: Scene) -> int:
    """A third of the columns of the table of bonds: beads have room for as many as they may have at a time, of all sorts together."""
    turns = types_change(scene.reactions)
    most = np.full(scene.n_beads, int(turns))
    for bonds in bond_sorts(scene.reactions):
        roles = [_roles(scene, each) for each in scene.reactions if each.bonds is bonds]
        valences = [np.full(scene.n_beads, its.max()) if turns else its[role[scene.type_ids]] for role, its, _ in roles]
        most += np.max([*valences, np.bincount(np.append(bonds.pairs, bonds.counted), minlength=scene.n_beads)], axis=0)
    return -(-int(most.max(initial=1)) // 3)


def bonds_at_start(scene: Scene) -> np.ndarray:
    """(B, 2) all bonds at the start, those that may break among them."""
    return np.concatenate([scene.bond_pairs, *(bonds.pairs for bonds in bond_sorts(scene.reactions))])


def come_and_go(scene: Scene) -> list[tuple[Any, BeadsOf]]:
    """Angles, dihedrals and impropers that come and go with bonds: one like all of each, and what has their beads, of the table of
    bonds and the bonds at the start."""
    first = of_sorts([bonds.pairs for bonds in bond_sorts(scene.reactions)], scene.n_beads)
    found: list[tuple[Any, BeadsOf]] = [(term, Formed(term._BEADS[2])) for term in terms_formed(scene.reactions)]
    for term in terms_taken(scene.reactions):
        found.append((terms_like(term, term.beads[:1]), Left(term._BEADS[2], term.beads, first)))
    return found


def segments_then(scene: Scene) -> Segments:
    """What has the beads of all segments, of the table of bonds and the bonds at the start."""
    stay, sorts = segment_parts(scene)
    return Segments(stay, tuple(k for k, bonds in enumerate(bond_sorts(scene.reactions)) if any(bonds is each for each in sorts)))


def bonds_spec(scene: Scene) -> BondsSpec | None:
    """What the kernel needs of the reactions of a scene; None without any."""
    if not scene.reactions:
        return None
    sorts, n = bond_sorts(scene.reactions), scene.n_beads
    initial, groups = np.zeros((n, 3 * table_blocks(scene)), np.int64), [bonds.between(np.array([[0, 1]])) for bonds in sorts]
    for k, bonds in enumerate(sorts):
        turn(initial, np.zeros(n, np.int64), np.full(n, n), bonds.pairs.astype(np.uint32), np.ones(len(bonds.pairs), bool), k, 0)
        for bead in bonds.counted.tolist():
            initial[bead, np.argmin(initial[bead] != 0)] = -1 - k
    moving = come_and_go(scene)
    ones: list[Any] = [*groups, *(term for term, _ in moving)]
    kernels: list[Any] = [bonded_kind(type(one)).kernel(one.beads.astype(np.uint32), one.coefficients.T.copy()) for one in ones]
    specs = [ReactionSpec(each, [bonds is each.bonds for bonds in sorts].index(True), *_roles(scene, each)) for each in scene.reactions]
    stays, start = (both_ways(pairs, n) for pairs in (scene.bond_pairs, bonds_at_start(scene)))
    factors = scene.bonded_factors if neighbours_change(scene) else None
    neighbours = compressed_exceptions({(i, j): 0.0 for i, j in np.sort(scene.bond_pairs, axis=1).tolist()}, n, factors is not None)
    types = scene.type_ids.copy(), types_change(scene.reactions)
    bent, segments = list[BeadsOf]([beads_of for _, beads_of in moving]), segment_spec(scene)
    if segments is not None:
        kernels, bent = [*kernels, segments], [*bent, segments_then(scene)]
    return BondsSpec(tuple(specs), tuple(kernels), initial, neighbours, stays, start, tuple(bent), *types, factors)
