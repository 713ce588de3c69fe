"""Bonds that form and break, as the kernel needs them."""

from typing import Any

import numpy as np

from ..kernels.pairs import compressed_exceptions
from ..kernels.reactions import BondsSpec, ReactionSpec, both_ways, turn
from ..model.reactions import angle_formed, bond_sorts
from ..model.scene import Scene
from .kinds import bonded_kind
from .pair_spec import neighbours_change


def _roles(scene: Scene, reaction: Any) -> tuple[np.ndarray, np.ndarray]:
    """Roles and valences of the beads, see :class:`.ReactionSpec`."""
    roles = np.full(scene.n_beads, -1, np.int32)
    for role in (1, 0) if reaction.forms else ():
        roles[scene.type_ids == scene.type_names.index(reaction.types[role])] = role
    return roles, np.where(roles < 0, 0, np.array(reaction.valences if reaction.forms else (0, 0))[roles])


def table_blocks(scene: Scene) -> int:
    """A third of the columns of the table of bonds: beads have room for as many as they may have at a time, of all sorts together."""
    most = np.zeros(scene.n_beads, np.int64)
    for bonds in bond_sorts(scene.reactions):
        valences = [_roles(scene, each)[1] for each in scene.reactions if each.bonds is bonds]
        most += np.max([*valences, np.bincount(bonds.pairs.ravel(), minlength=scene.n_beads)], axis=0)
    return -(-int(most.max(initial=1)) // 3)


def bonds_at_start(scene: Scene) -> np.ndarray:
    """(B, 2) all bonds at the start, those that may break among them."""
    return np.concatenate([scene.bond_pairs, *(bonds.pairs for bonds in bond_sorts(scene.reactions))])


def bonds_spec(scene: Scene) -> BondsSpec | None:
    """What the kernel needs of the reactions of a scene; None without any."""
    if not scene.reactions:
        return None
    sorts, n = bond_sorts(scene.reactions), scene.n_beads
    initial, groups = np.zeros((n, 3 * table_blocks(scene)), np.int64), [bonds.between(np.array([[0, 1]])) for bonds in sorts]
    for k, bonds in enumerate(sorts):
        turn(initial, np.zeros(n, np.int64), np.full(n, n), bonds.pairs.astype(np.uint32), np.ones(len(bonds.pairs), bool), k, 0)
    angle = angle_formed(scene.reactions)
    ones: list[Any] = groups if angle is None else [*groups, angle]
    kernels = [bonded_kind(type(one)).kernel(one.beads.astype(np.uint32), one.coefficients.T.copy()) for one in ones]
    specs = [ReactionSpec(each, [bonds is each.bonds for bonds in sorts].index(True), *_roles(scene, each)) for each in scene.reactions]
    stays, start = (both_ways(pairs, n) for pairs in (scene.bond_pairs, bonds_at_start(scene)))
    factors = scene.bonded_factors if neighbours_change(scene) else None
    neighbours = compressed_exceptions({(i, j): 0.0 for i, j in np.sort(scene.bond_pairs, axis=1).tolist()}, n, factors is not None)
    return BondsSpec(tuple(specs), tuple(kernels), initial, neighbours, stays, start, angle is not None, factors)
