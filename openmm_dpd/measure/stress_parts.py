"""Parts of the stress tensor that the pair engine does not sum: other pair terms, bonds, angles and dihedrals, segments, charges.

Each part is a function (x, box) -> (6,) sums of r F (xx, yy, zz, xy, xz, yz; kJ/mol), in double precision on every platform.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import openmm
from openmm import unit

from ..extra_forces import radial_terms
from ..forces.electrostatics import lattice_force
from ..forces.segments import segment_spec
from ..geometry import AXES_OF_TENSOR, minimum_images, symmetric_products
from ..kernels.pairs import PairList, compressed_exceptions
from ..kernels.segments import SegmentEngine
from ..model.electrostatics import GaussianCharges, SlaterCharges, SmearedCharges
from ..neighbours import coincident_pairs
from ..plan import Plan
from .bonded_sums import bonded_stress

Part = Callable[[np.ndarray, np.ndarray | None], np.ndarray]

#: Strain of the finite differences of the lattice sum.  Measured with 6 to 800 charges, it is off by 1e-8 of the energy; that goes with the
#: square of the strain, and below 1e-5 rounding is more.
STRAIN = 1e-4


def stress_parts(plan: Plan) -> list[Part]:
    """All parts that a scene in a periodic box has."""
    parts: list[Part] = [partial(bonded_stress, plan)] if plan.scene.bonded else []
    parts += virial_parts(plan)
    if plan.scene.electrostatics is not None:
        parts += [ShortCharges(plan), _LatticeStress(plan)]
    return parts


def virial_parts(plan: Plan) -> list[Part]:
    """Those whose traces are all that is known of their virials: of segments and of overlays."""
    scene, segments = plan.scene, segment_spec(plan.scene)
    parts: list[Part] = [] if segments is None else [partial(_segment_stress, SegmentEngine(segments))]
    return parts + [radial_terms(table, scene.type_ids, scene.type_names, plan.exceptions).evaluator().stress for table in plan.overlays]


def _segment_stress(engine: SegmentEngine, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    engine.forces(x, box)
    return engine.stress


def charge_virial(charges: SmearedCharges, r: np.ndarray) -> np.ndarray:
    """-r ds/dr of the energy s of two smeared unit charges: s is homogeneous in r and the width w, so it is s + w ds/dw."""
    k = charges.steepness
    if isinstance(charges, SlaterCharges):
        return charges.potential(r) - k * (1 + 2 * k * r) * np.exp(-2 * k * r)
    return charges.potential(r) - 2 * k / math.sqrt(math.pi) * np.exp(-k * k * r * r)


class ShortCharges:
    """What the lattice sum leaves out: s(r) - erf(alpha r)/r up to the cutoff, f s(r) - erf(alpha r)/r of bonded neighbours."""

    def __init__(self, plan: Plan):
        scene, ewald = plan.scene, plan.ewald
        assert scene.electrostatics is not None and scene.charges is not None and ewald is not None
        self._charges, self._constant = scene.electrostatics, scene.electrostatics.coulomb(scene.initial_kT)
        self._image = GaussianCharges(width=0.5 / ewald.alpha, permittivity=1.0)
        self._q = q = scene.charges
        # beads at the same point are in no list
        bonded = dict.fromkeys(coincident_pairs(scene.positions, scene.box, 1e-4 / scene.electrostatics.steepness), 1.0)
        bonded = {pair: f for pair, f in (bonded | plan.charge_exceptions).items() if q[pair[0]] * q[pair[1]] != 0}
        self._bonded, self._factors = np.array(list(bonded), np.int64).reshape(-1, 2), np.array(list(bonded.values()))
        exceptions = compressed_exceptions(dict.fromkeys(bonded, 0.0), len(q))
        types = np.where(q != 0, 0, -1).astype(np.int32)
        self._pairs = PairList(types, np.ones(len(q)), np.array([[ewald.cutoff]]), exceptions)

    def __call__(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """(6,) sums of r F."""
        (qq, e, r), (bonded, d, apart) = self._all_pairs(x, box)
        virial = qq * (charge_virial(self._charges, r) - charge_virial(self._image, r))
        of_bonded = bonded * (self._factors * charge_virial(self._charges, apart) - charge_virial(self._image, apart))
        return symmetric_products(virial[:, None] * e, e) + symmetric_products((of_bonded / apart**2)[:, None] * d, d)

    def width_derivative(self, x: np.ndarray, box: np.ndarray | None) -> float:
        """Sum over pairs of w ds/dw with the width w of the charges.

        Energies of charges are homogeneous of degree -1 in all lengths, the width included.  So the virial, minus the derivative with
        respect to the logarithm of the box's edges alone, is the energy plus this: no virial of the lattice sum is needed.
        """
        (qq, _, r), (bonded, _, apart) = self._all_pairs(x, box)
        slopes, of_bonded = (charge_virial(self._charges, at) - self._charges.potential(at) for at in (r, apart))
        return float(qq @ slopes + (bonded * self._factors) @ of_bonded)

    def _all_pairs(self, x: np.ndarray, box: np.ndarray | None):
        """Of the listed pairs C q q, directions and distances; of bonded neighbours C q q, vectors and distances."""
        self._pairs.build(x, box)
        i, j, e, r, _ = self._pairs.listed()
        first, second = self._bonded.T
        d = minimum_images(x[first] - x[second], box)
        apart = np.maximum(np.linalg.norm(d, axis=1), 1e-10)
        q, constant = self._q, self._constant
        return (constant * q[i] * q[j], e, r), (constant * q[first] * q[second], d, apart)


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

    def __call__(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        assert box is not None
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
