"""Scene -> what the pair engine has to know of it."""

from collections.abc import Sequence

import numpy as np

from ..kernels.fields import FieldSpec
from ..kernels.layer import PairSpec
from ..kernels.pairs import compressed_exceptions
from ..kernels.sweeps import EXACT, SHARDLOW
from ..model.bonds import bonded_neighbours
from ..model.scene import Scene
from ..model.schemes import Scheme
from .kinds import BeadData, Kind

#: Factors of bonded neighbours other than 1, by pair of beads.
Factors = dict[tuple[int, int], float]


def neighbour_factors(scene: Scene) -> tuple[Factors, Factors]:
    """Bonded neighbours whose factor is not 1: for pair terms, and for charges."""
    charges, alike = scene.electrostatics, (1.0, 1.0, 1.0)
    asked = scene.bonded_factors, alike if charges is None else charges.bonded_factors or scene.bonded_factors
    found = bonded_neighbours(scene.bond_pairs, scene.n_beads) if len(scene.bond_pairs) and asked != (alike, alike) else {}
    pair_terms, of_charges = (
        {pair: factors[k - 1] for k, pairs in found.items() if factors[k - 1] != 1.0 for pair in pairs} for factors in asked
    )
    return pair_terms, of_charges


def longest(layers: Sequence[dict]) -> float:
    """The longest cutoff of some tables."""
    return max((c.cutoff for table in layers for c in table.values()), default=0.0)


def pair_spec(
    scene: Scene,
    kinds: Sequence[Kind],
    layers: Sequence[dict],
    exceptions: Factors,
    scheme: Scheme,
    fields: FieldSpec | None,
    left_out: np.ndarray | None = None,
) -> PairSpec:
    """What the engine evaluates: the tables ``layers`` of these kinds; ``left_out`` (N,) says which particles take no part."""
    mobile, wall_velocity = ~scene.immobile, None
    if scene.velocities is not None and np.any(scene.velocities[~mobile] != 0):
        wall_velocity = np.where(mobile[:, None], 0.0, scene.velocities)
    beads = BeadData(scene.type_names, scene.bead_masses, scene.compat)
    return PairSpec(
        # numba would compile kernels of their own for the scene's read-only arrays
        types=scene.type_ids.copy() if left_out is None else np.where(left_out, np.int32(-1), scene.type_ids),
        inv_mass=np.where(mobile, 1.0 / scene.bead_masses, 0.0),
        terms=tuple(kind.terms(table, beads) for kind, table in zip(kinds, layers, strict=True)),  # type: ignore[misc]
        update=SHARDLOW if scheme.shardlow else EXACT,
        exceptions=compressed_exceptions(exceptions, scene.n_beads),
        wall_velocity=wall_velocity,
        fields=fields,
        sweeps=scheme.sweeps,
        sheared=scene.shear is not None,
    )
