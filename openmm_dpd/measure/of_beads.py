"""Energies and stresses of single beads: equal shares of every pair, bond, angle, dihedral and contact."""

from typing import Any

import numpy as np

from ..base.errors import ParameterError
from ..kernels.engine import host_engine
from ..kernels.layer import CONSERVATIVE, DISSIPATIVE, RANDOM, STRESS
from .present import Present
from .stress_parts import BondedStress, beside_pairs

#: Parts of the energies and stresses, and how many beads a term of each has.
BEADS_OF = {"pair": 0, "bond": 2, "angle": 3, "dihedral": 4}


def bead_shares(present: Present) -> dict[str, np.ndarray]:
    """By part, (N, 7) energy and r F (xx, yy, zz, xy, xz, yz) of each bead, kJ/mol, at the state that ``present`` has looked at.

    Their sums are the energies, and what :meth:`.Present.stress` has: with friction and noise where these are forces (``mvv``).
    ParameterError if the scene has charges, whose lattice sum belongs to no bead, or shapes of the engine's own.
    """
    plan, x, box = present.plan, present.x, present.box
    if plan.scene.electrostatics is not None:
        raise ParameterError("charges have no energies and stresses of single beads here")
    found: dict[str, Any] = {part: np.zeros((len(x), 7)) for part in BEADS_OF}
    if plan.layers:
        engine, which = host_engine(plan.spec), CONSERVATIVE
        v = None
        for pairs in engine.lists:
            pairs.apart = True
        if plan.options.predicting:
            v, which = present.force_velocities(), CONSERVATIVE | DISSIPATIVE | RANDOM
        if plan.scene.shear is not None:
            engine.set_flow(np.array([present.rate]))
        engine.prepare(x, box)
        tensors = 0 if plan.spec.fields is not None else STRESS  # of forces along the lines alone, these are known without
        engine.sums(which | tensors, v, present.kT, present.dt, present.seed, present.counter, present.values)
        for pairs in engine.lists:
            _share(found["pair"], *pairs.shared())
    for extra in beside_pairs(plan):
        if extra.term == "bond":
            beads, tensors_of = BondedStress(extra).each(x, box)
            part = next(name for name, count in BEADS_OF.items() if count == beads.shape[1])
            _share(found[part], beads, np.column_stack([np.zeros(len(beads)), tensors_of]))
        else:
            evaluator: Any = extra.evaluator()
            evaluator.list.apart = True
            evaluator.stress(x, box)
            _share(found["pair"], *evaluator.shared())
    scene = plan.scene
    for part, groups, curves in (
        ("bond", scene.bonds, lambda its: its.curve(its.lengths(x, box))),
        ("angle", scene.angles, lambda its: its.curve(its.arms(x, box)[0])),
        ("dihedral", scene.dihedrals, lambda its: its.curve(its.gradients(x, box)[0])),
    ):
        for group in groups:
            _share(found[part], group.beads, np.asarray(curves(group)[0])[:, None])
    return found


def _share(found: np.ndarray, beads: np.ndarray, values: np.ndarray) -> None:
    """Add (T, columns) values of terms to their beads (T, k), in equal shares."""
    for k in range(beads.shape[1]):
        for column in range(values.shape[1]):
            found[:, column] += np.bincount(beads[:, k], values[:, column], len(found)) / beads.shape[1]
