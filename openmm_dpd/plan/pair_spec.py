"""A scene as the engine needs it: its pair terms, and the kernels of all other conservative forces."""

from collections.abc import Container, Sequence
from itertools import groupby

import numpy as np

from ..base.geometry import pairs_within, widths
from ..kernels import external
from ..kernels.bodies import BodySpec
from ..kernels.exceptions import compressed_exceptions
from ..kernels.external import BodyTerms
from ..kernels.extras import Extra
from ..kernels.fields import FieldSpec
from ..kernels.layer import PairSpec
from ..kernels.radial import RadialTerms
from ..kernels.solids import Carried
from ..kernels.sweeps import EXACT, SHARDLOW
from ..model.bonds import bonded_neighbours
from ..model.flow import AXES, BodyForce
from ..model.pairs import NONE, PairTable
from ..model.reactions import types_change
from ..model.scene import Scene
from ..model.schemes import Scheme
from .forces.expressions import type_pairs
from .forces.segments import segment_spec
from .kinds import BeadData, Kind, bonded_kind, resolved_kind

#: Factors of bonded neighbours other than 1, by pair of beads.
Factors = dict[tuple[int, int], float]


def neighbour_factors(scene: Scene, bonds: np.ndarray) -> tuple[Factors, Factors]:
    """Factors of neighbours by ``bonds`` (B, 2), where they are not 1: for pair terms, and for charges."""
    charges, alike = scene.electrostatics, (1.0, 1.0, 1.0)
    asked = scene.bonded_factors, alike if charges is None else charges.bonded_factors or scene.bonded_factors
    found = bonded_neighbours(bonds, scene.n_beads) if len(bonds) and asked != (alike, alike) else {}
    pair_terms, of_charges = (
        {pair: factors[k - 1] for k, pairs in found.items() if factors[k - 1] != 1.0 for pair in pairs} for factors in asked
    )
    return pair_terms, of_charges


def neighbours_change(scene: Scene) -> bool:
    """Whether factors of bonded neighbours change with bonds that form and break."""
    return bool(scene.reactions) and scene.bonded_factors not in (None, (1.0, 1.0, 1.0))


def inner_factors(scene: Scene, reach: float) -> Factors:
    """Factors 0 of pairs within bodies that do not count their inner energies, as far as pair terms reach; of all pairs of a body that may
    come near its own image."""
    found: Factors = {}
    for shape in scene.shapes:
        beads, across = shape.body.beads, 2.0 * float(np.linalg.norm(shape.places, axis=1).max())
        near = scene.box is not None and across + reach > 0.9 * widths(scene.box).min()
        i, j = np.triu_indices(len(beads), 1) if near else pairs_within(shape.places, None, None, reach)[:2]
        i, j = (i[:0], j[:0]) if shape.body.inner else (i, j)
        found |= {(min(pair), max(pair)): 0.0 for pair in zip(beads[i].tolist(), beads[j].tolist(), strict=True)}
    return found


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
    carried: Carried | None = None,
) -> PairSpec:
    """The pair terms for the engine: the tables ``layers`` of these kinds; ``left_out`` (N,) says which particles take no part, ``carried``
    which of the immobile ones walls take along."""
    mobile, wall_velocity = ~scene.immobile, None
    if scene.velocities is not None and np.any(scene.velocities[~mobile] != 0):
        wall_velocity = np.where(mobile[:, None], 0.0, scene.velocities)
    elif carried is not None:
        wall_velocity = np.zeros((scene.n_beads, 3))
    beads = BeadData(scene.type_names, scene.bead_masses, scene.compat, scene.initial_kT)
    return PairSpec(
        # numba would compile kernels of their own for the scene's read-only arrays
        types=scene.type_ids.copy() if left_out is None else np.where(left_out, np.int32(-1), scene.type_ids),
        inv_mass=np.where(mobile, 1.0 / scene.bead_masses, 0.0),
        terms=tuple(kind.terms(table, beads) for kind, table in zip(kinds, layers, strict=True)),  # type: ignore[misc]
        update=SHARDLOW if scheme.shardlow else EXACT,
        exceptions=compressed_exceptions(exceptions, scene.n_beads, neighbours_change(scene)),
        wall_velocity=wall_velocity,
        fields=fields,
        sweeps=scheme.sweeps,
        sheared=scene.shear is not None,
        carried=carried,
        bodies=BodySpec.of(scene.shapes) if scene.shapes else None,
    )


def renew(scene: Scene, kept: Sequence[dict], spec: PairSpec, tables: Sequence[PairTable]) -> None:
    """Write other coefficients of the same kinds, for the same types and cutoffs, into the tables of a plan, ``kept``, layers before
    overlays, and of kernels that hold all pair terms."""
    names, beads = scene.type_names, BeadData(scene.type_names, scene.bead_masses, scene.compat, scene.initial_kT)
    found = [table for table in (table.resolve(names) for table in tables) if any(c is not NONE for c in table.values())]
    found.sort(key=lambda table: resolved_kind(table).overlay is not None)
    held = [*spec.terms, *(extra for extra in spec.extras if isinstance(extra, RadialTerms))]
    for old, table, terms in zip(kept, found, held, strict=True):
        old.update(table)
        kind = resolved_kind(table)
        if kind.overlay is not None:
            terms.numbers[...] = kind.overlay(table, names).numbers  # type: ignore[attr-defined]
        else:
            for name, values in vars(kind.terms(table, beads)).items():  # type: ignore[misc]
                if isinstance(values, np.ndarray):
                    getattr(terms, name)[...] = values


_PATTERNS = {"uniform": external.UNIFORM, "halves": external.HALVES, "sine": external.SINE}


def extras(
    scene: Scene, overlays: Sequence[dict], exceptions: dict[tuple[int, int], float], held: Container[str] | None = None
) -> tuple[Extra, ...]:
    """The conservative forces of a scene beside its pair terms, those that are ``held`` (see ``Execution``), by default all; OpenMM's own
    are in :mod:`openmm_dpd.plan.forces`.  ``overlays`` and factors of bonded neighbours (``exceptions``) are those of a ``Plan``."""
    # PositionForce (formulas given as text) has no kernel: OpenMM evaluates it.  Charges are in charge_forces.py.
    found: list[Extra] = []

    def wanted(name: str) -> bool:
        return held is None or name in held

    for terms, one_kind in groupby((group for group in scene.bonded if wanted(bonded_kind(type(group)).name)), type):
        groups = list(one_kind)
        beads, coefficients = (np.concatenate([getattr(group, name) for group in groups]) for name in ("beads", "coefficients"))
        if len(beads):
            found.append(bonded_kind(terms).kernel(beads.astype(np.uint32), np.ascontiguousarray(coefficients.T)))
    if wanted("overlays"):
        its = scene.type_ids, scene.type_names, exceptions, neighbours_change(scene), types_change(scene.reactions)
        found += [radial_terms(table, *its) for table in overlays]
    segments = segment_spec(scene) if wanted("segments") else None
    if segments is not None and len(segments.pairs):
        found.append(segments)
    if wanted("body forces"):
        found += [body_terms(term, scene) for term in scene.body_forces if isinstance(term, BodyForce)]
    return tuple(found)


def radial_terms(
    table: dict, type_ids: np.ndarray, names: list[str], exceptions: Factors, changes: bool = False, turns: bool = False
) -> RadialTerms:
    """A table of radial potentials laid over the pair terms, as the kernel needs it."""
    overlay = resolved_kind(table).overlay
    assert overlay is not None
    cutoff = type_pairs(table, names, lambda c: c.cutoff, 0.0)
    # beads that interact with no other, and never will, are not even sorted
    types = np.where(turns | np.any(cutoff > 0, axis=1)[type_ids], type_ids, -1).astype(np.int32)
    return RadialTerms(types, cutoff, *overlay(table, names), compressed_exceptions(exceptions, len(type_ids), changes))


def body_terms(term: BodyForce, scene: Scene) -> BodyTerms:
    """A force on single beads, as the kernel needs it."""
    vectors = term.vectors(scene.type_ids, scene.type_names, scene.box)
    beads = np.flatnonzero(np.any(vectors != 0, axis=1))
    axis = 0 if term.axis is None else AXES.index(term.axis)
    period = 1.0 if scene.box is None else float(scene.box[axis, axis])
    return BodyTerms(beads.astype(np.uint32), vectors[beads], _PATTERNS[term.pattern], axis, term.origin, period)
