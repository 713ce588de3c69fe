"""Energies and stresses of single beads: equal shares of every pair, contact, bond, angle, dihedral and improper."""

from typing import Any

import numpy as np

from ..base.errors import ParameterError
from ..kernels.engine import host_engine
from ..kernels.extras import BondedKernel
from ..kernels.layer import CONSERVATIVE, DISSIPATIVE, RANDOM, STRESS
from .present import Present
from .stress_parts import BondedStress, beside_pairs

#: Parts of the energies and stresses.
PARTS = ("pair", "bond", "angle", "dihedral", "improper")


def bead_shares(present: Present) -> dict[str, np.ndarray]:
    """By part, (N, 7) energy and r F (xx, yy, zz, xy, xz, yz) of each bead, kJ/mol, at the state that ``present`` has looked at.

    Their sums are the energies, and what :meth:`.Present.stress` has: with friction and noise where these are forces (``mvv``).
    ParameterError if the scene has charges, whose lattice sum belongs to no bead.
    """
    plan, x, box = present.plan, present.x, present.box
    found: dict[str, np.ndarray] = {part: np.zeros((len(x), 7)) for part in PARTS}
    for beads, values in pair_terms(present, friction=plan.options.predicting):
        _share(found["pair"], beads, values[:, :7])
    for part, beads, tensors in bond_terms(present):
        _share(found[part], beads, np.column_stack([np.zeros(len(beads)), tensors]))
    scene = plan.scene
    for part, groups, curves in (
        ("bond", scene.bonds, lambda its: its.curve(its.lengths(x, box))),
        ("angle", scene.angles, lambda its: its.curve(its.arms(x, box)[0])),
        ("dihedral", scene.dihedrals, turned := lambda its: its.curve(its.gradients(x, box)[0])),
        ("improper", scene.impropers, turned),
    ):
        for group in groups:
            _share(found[part], group.beads, np.asarray(curves(group)[0])[:, None])
    return found


def pair_terms(present: Present, friction: bool) -> list[tuple[np.ndarray, np.ndarray]]:
    """Beads (P, 2), or (P, 4) of contacts of bonds, and values (P, 10) of the pairs of each table of coefficients, as
    :meth:`.pairs.PairList.shared` has them: of the conservative forces, or with ``friction`` of all forces of a step of ``mvv``.
    ParameterError if the scene has charges."""
    plan, x, box, found, v = present.plan, present.x, present.box, list[tuple[np.ndarray, np.ndarray]](), None
    if plan.scene.electrostatics is not None:
        raise ParameterError("charges have no energies and stresses of single beads or pairs here")
    if plan.layers:
        engine, which = host_engine(plan.spec), CONSERVATIVE
        for pairs in engine.lists:
            pairs.apart = True
        if friction:
            v, which = present.force_velocities(), CONSERVATIVE | DISSIPATIVE | RANDOM
        if plan.scene.shear is not None:
            engine.set_flow(np.array([present.rate]))
        engine.prepare(x, box)
        tensors = 0 if plan.spec.fields is not None else STRESS  # of forces along the lines alone, these are known without
        engine.sums(which | tensors, v, present.kT, present.dt, present.seed, present.counter, present.values)
        found += [pairs.shared() for pairs in engine.lists]
    for extra in beside_pairs(plan):
        if extra.term != "bond":
            evaluator: Any = extra.evaluator()
            evaluator.list.apart = True
            evaluator.stress(x, box)
            found.append(evaluator.shared())
    return found


def bond_terms(present: Present) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Part, beads (T, 2), (T, 3) or (T, 4) and r F (T, 6), kJ/mol, of all bonds, angles, dihedrals and impropers of a kind."""
    bonded = [extra for extra in beside_pairs(present.plan) if isinstance(extra, BondedKernel)]
    return [(extra.called.split()[-1], *BondedStress(extra).each(present.x, present.box)) for extra in bonded]


def _share(found: np.ndarray, beads: np.ndarray, values: np.ndarray) -> None:
    """Add (T, columns) values of terms to their beads (T, k), in equal shares."""
    for k in range(beads.shape[1]):
        for column in range(values.shape[1]):
            found[:, column] += np.bincount(beads[:, k], values[:, column], len(found)) / beads.shape[1]
