"""Parts of the stress tensor that the pair engine does not sum: other pair terms, bonds and angles, segments, charges.

Each part is a function (x, box) -> (6,) sums of r F (xx, yy, zz, xy, xz, yz; kJ/mol), in double precision on every platform.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import openmm
from openmm import unit

from ..forces.electrostatics import lattice_force
from ..forces.segments import segment_spec
from ..geometry import AXES_OF_TENSOR, minimum_images, symmetric_products
from ..kernels.engine import PairEngine, PairSpec
from ..kernels.layer import Table
from ..kernels.pairs import PairList, compressed_exceptions
from ..kernels.segments import SegmentEngine
from ..kinds import resolved_kind
from ..model.electrostatics import GaussianCharges, SlaterCharges, SmearedCharges
from ..plan import Plan
from .bonded_sums import bonded_stress

Part = Callable[[np.ndarray, np.ndarray], np.ndarray]

#: Strain of the finite differences of the lattice sum.  Measured with 6 to 800 charges, it is off by 1e-8 of the energy; that goes with the
#: square of the strain, and below 1e-5 rounding is more.
STRAIN = 1e-4


def stress_parts(plan: Plan) -> list[Part]:
    """All parts that a scene in a periodic box has."""
    scene = plan.scene
    parts: list[Part] = []
    if scene.bonds or scene.angles:
        parts.append(partial(bonded_stress, plan))
    segments = segment_spec(scene)
    if segments is not None:
        parts.append(partial(_segment_stress, SegmentEngine(segments)))
    more = [(table, kind.more_stress) for table, kind in zip(plan.spec.terms, plan.kinds, strict=True) if kind.more_stress is not None]
    if more:
        parts.append(_LayerStress(plan, more))
    parts += [_OverlayStress(plan, table) for table in plan.overlays]
    if scene.electrostatics is not None:
        parts += [_ShortChargeStress(plan), _LatticeStress(plan)]
    return parts


def engine_spec(plan: Plan) -> PairSpec:
    """The same terms for an engine that sums stress tensors; of many-body terms attraction and friction, which are those of DPD."""
    terms = [kind.stress_terms(table) for table, kind in zip(plan.spec.terms, plan.kinds, strict=True) if kind.stress_terms is not None]
    return replace(plan.spec, terms=tuple(terms))


def _segment_stress(engine: SegmentEngine, x: np.ndarray, box: np.ndarray) -> np.ndarray:
    engine.forces(x, box)
    return engine.stress


class _LayerStress:
    """What the terms of the engine's sums leave out of layers that have more."""

    def __init__(self, plan: Plan, found: list[tuple[Table, Callable[[Any], np.ndarray]]]):
        self._engine = PairEngine(replace(plan.spec, terms=tuple(table for table, _ in found)))
        self._more = [more for _, more in found]

    def __call__(self, x: np.ndarray, box: np.ndarray) -> np.ndarray:
        self._engine.prepare(x, box)
        stress = np.zeros(6)
        for layer, more in zip(self._engine.layers, self._more, strict=True):
            stress += more(layer)
        return stress


def _pair_list(types: np.ndarray, cutoff: np.ndarray, exceptions: dict[tuple[int, int], float]) -> PairList:
    return PairList(types, np.ones(len(types)), cutoff, compressed_exceptions(exceptions, len(types)))


def _pair_sum(pairs: PairList, x: np.ndarray, box: np.ndarray, virial: Callable) -> np.ndarray:
    """The sum of f r F e e over pairs of beads within reach, with r F = virial(i, j, r)."""
    pairs.build(x, box)
    i, j, e, r, factor = pairs.listed()
    return symmetric_products((factor * virial(i, j, r))[:, None] * e, e)


class _OverlayStress:
    """Pair potentials that a thermostat is laid over."""

    def __init__(self, plan: Plan, table: dict):
        scene, overlay = plan.scene, resolved_kind(table).overlay
        assert overlay is not None
        self._virial = overlay.virial
        names = {name: k for k, name in enumerate(scene.type_names)}
        self._kinds = {(names[a], names[b]): c for (a, b), c in table.items() if c.cutoff > 0}
        cutoff = np.zeros((len(names), len(names)))
        for (a, b), c in self._kinds.items():
            cutoff[a, b] = cutoff[b, a] = c.cutoff
        self._pairs, self._types = _pair_list(scene.type_ids, cutoff, plan.exceptions), scene.type_ids

    def __call__(self, x: np.ndarray, box: np.ndarray) -> np.ndarray:
        def virial(i, j, r):
            low, high = np.minimum(self._types[i], self._types[j]), np.maximum(self._types[i], self._types[j])
            found = np.zeros(len(r))
            for (a, b), coefficient in self._kinds.items():
                chosen = (low == min(a, b)) & (high == max(a, b))
                found[chosen] = self._virial(coefficient, r[chosen])
            return found

        return _pair_sum(self._pairs, x, box, virial)


def charge_virial(charges: SmearedCharges, r: np.ndarray) -> np.ndarray:
    """-r ds/dr of the energy s of two smeared unit charges: s is homogeneous in r and the width w, so it is s + w ds/dw."""
    k = charges.steepness
    if isinstance(charges, SlaterCharges):
        return charges.potential(r) - k * (1 + 2 * k * r) * np.exp(-2 * k * r)
    return charges.potential(r) - 2 * k / math.sqrt(math.pi) * np.exp(-k * k * r * r)


class _ShortChargeStress:
    """What the lattice sum leaves out: s(r) - erf(alpha r)/r up to the cutoff, f s(r) - erf(alpha r)/r of bonded neighbours."""

    def __init__(self, plan: Plan):
        scene, ewald = plan.scene, plan.ewald
        assert scene.electrostatics is not None and scene.charges is not None and ewald is not None
        self._charges, self._constant = scene.electrostatics, scene.electrostatics.coulomb(scene.initial_kT)
        self._image = GaussianCharges(width=0.5 / ewald.alpha, permittivity=1.0)
        self._q = scene.charges
        bonded = {pair: f for pair, f in plan.charge_exceptions.items() if self._q[pair[0]] * self._q[pair[1]] != 0}
        self._bonded, self._factors = np.array(list(bonded), np.int64).reshape(-1, 2), np.array(list(bonded.values()))
        types = np.where(self._q != 0, 0, -1).astype(np.int32)
        self._pairs = _pair_list(types, np.array([[ewald.cutoff]]), dict.fromkeys(bonded, 0.0))

    def __call__(self, x: np.ndarray, box: np.ndarray) -> np.ndarray:
        stress = _pair_sum(self._pairs, x, box, lambda i, j, r: self._virial(i, j, r, 1.0))
        i, j = self._bonded.T
        d = minimum_images(x[i] - x[j], box)
        r = np.maximum(np.linalg.norm(d, axis=1), 1e-10)
        return stress + symmetric_products((self._virial(i, j, r, self._factors) / r**2)[:, None] * d, d)

    def _virial(self, i, j, r, factor):
        return self._constant * self._q[i] * self._q[j] * (factor * charge_virial(self._charges, r) - charge_virial(self._image, r))


class _LatticeStress:
    """The lattice sum of the charges: minus the derivative of its energy with respect to the six strains of box and positions.

    Central differences of the energy of the charges alone, in a Context of the Reference platform made once for this: single precision,
    that of the CPU platform, would leave an error of 1e-4 of the energy at the best strain.  The Context of the run is not touched.  A
    sample takes 12 energies.  Strains leave fractional coordinates as they are, so PME's energy is a smooth function of them, and the
    components are as exact as PME itself.  A strain that would tilt the box beyond OpenMM's limit gives NaN.
    """

    def __init__(self, plan: Plan):
        scene, ewald = plan.scene, plan.ewald
        assert scene.electrostatics is not None and scene.charges is not None and scene.box is not None and ewald is not None
        self._ions = np.flatnonzero(scene.charges)
        force = lattice_force(scene.charges[self._ions], scene.electrostatics.coulomb(scene.initial_kT), ewald, {})
        # there is no direct space; with the cutoff of the run, perhaps half the box, the box could not shrink
        force.setCutoffDistance(0.5 * ewald.cutoff)
        system = openmm.System()
        for _ in self._ions:
            system.addParticle(1.0)
        system.addForce(force)
        system.setDefaultPeriodicBoxVectors(*scene.box)
        self._context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName("Reference"))

    def __call__(self, x: np.ndarray, box: np.ndarray) -> np.ndarray:
        found = []
        for first, second in AXES_OF_TENSOR:
            energies = []
            for step in (STRAIN, -STRAIN):
                strain = np.eye(3)
                strain[second, first] += step  # x_first changes by step times x_second: box vectors stay lower triangular
                energies.append(self._energy(x[self._ions] @ strain, box @ strain))
            found.append((energies[1] - energies[0]) / (2 * STRAIN))
        return np.array(found)

    def _energy(self, x: np.ndarray, box: np.ndarray) -> float:
        if 2 * abs(box[1, 0]) > box[0, 0] or 2 * abs(box[2, 0]) > box[0, 0] or 2 * abs(box[2, 1]) > box[1, 1]:
            return math.nan
        self._context.setPeriodicBoxVectors(*box)
        self._context.setPositions(x)
        return self._context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
