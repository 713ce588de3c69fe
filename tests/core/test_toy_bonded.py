"""A bond, an angle and a dihedral that the package does not know, registered here: they build, run, explain, measure, and are read, written
or refused.

Stiff springs that are soft at rest, U = k (r - r0)^4, which LAMMPS does not have; LAMMPS's angle style cosine/shift,
U = -k/2 [1 + cos(theta - theta0)]; its dihedral style helix, U = A [1 - cos phi] + B [1 + cos 3 phi] + C [1 + cos(phi + pi/4)], which is not the
same for a left and a right turn.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import chains_of_beads as chains
import lammps_peer
import numpy as np
import openmm
import pytest
from cases import raises
from scenes import beads, stepped

import openmm_dpd as dpd
from openmm_dpd.advice.bonded_modes import bonded_modes
from openmm_dpd.base import serialized
from openmm_dpd.kernels.bonded import AngleTerms, BondTerms, DihedralTerms
from openmm_dpd.lammps import deck_scene, export_lammps
from openmm_dpd.measure.stress_parts import angle_sums, bond_sums, stress_parts, torsion_sums
from openmm_dpd.model.angles import Angles, Dihedrals
from openmm_dpd.model.bonds import Bonds
from openmm_dpd.molecules import linear, pack
from openmm_dpd.molecules.terms import AnyBend, AnySpring, AnyTwist
from openmm_dpd.plan import kinds

NO_LAMMPS = lammps_peer.why_missing()
EDGE = 6.0
BOX = np.diag([EDGE] * 3)

SUMS = (bond_sums, angle_sums, lambda plan, *at: torsion_sums(plan.scene.dihedrals, *at))


@dataclass(frozen=True, eq=False)
class ToyBonds(Bonds):
    pairs: np.ndarray
    k: np.ndarray
    r0: np.ndarray

    _DIMENSIONS = {"k": ("energy", ">= 0"), "r0": ("length", ">= 0")}

    def curve(self, r):
        return self.k * (r - self.r0) ** 4, 4 * self.k * (r - self.r0) ** 3, 12 * self.k * (r - self.r0) ** 2

    def reach(self, kT):
        return self.r0 + (40 * kT / self.k) ** 0.25


class ToyBondTerms(BondTerms):
    @staticmethod
    def formula(r, r2, p, n):
        stretch = r - p[1, n]
        return p[0, n] * stretch**4, -4.0 * p[0, n] * stretch**3 / r if r > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class ShiftedAngles(Angles):
    triples: np.ndarray
    k: np.ndarray
    theta0: np.ndarray

    _DIMENSIONS = {"k": ("energy", ">= 0"), "theta0": ("angle", ">= 0")}

    def curve(self, theta):
        wave, slope = (0.5 * self.k * f(theta - self.theta0) for f in (np.cos, np.sin))
        return -0.5 * self.k - wave, slope, wave


class ShiftedAngleTerms(AngleTerms):
    @staticmethod
    def formula(cross, dot, arms, p, n):
        s, c = 0.5 * p[0, n] * np.sin(p[1, n]), 0.5 * p[0, n] * np.cos(p[1, n])
        return -0.5 * p[0, n] - (dot * c + cross * s) * arms, (cross * c - dot * s) * arms


@dataclass(frozen=True, eq=False)
class HelixDihedrals(Dihedrals):
    quads: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray

    _DIMENSIONS = {name: ("energy", "") for name in ("A", "B", "C")}

    def curve(self, phi):
        waves = [(1, -self.A, 0.0), (3, self.B, 0.0), (1, self.C, np.pi / 4)]
        energy = self.A + self.B + self.C + sum(size * np.cos(n * phi + at) for n, size, at in waves)
        slope = -sum(n * size * np.sin(n * phi + at) for n, size, at in waves)
        return energy, slope, -sum(n * n * size * np.cos(n * phi + at) for n, size, at in waves)


class HelixDihedralTerms(DihedralTerms):
    @staticmethod
    def formula(cosine, sine, p, n):
        turned, thrice = (cosine - sine) * np.sqrt(0.5), cosine * (4.0 * cosine * cosine - 3.0)
        energy = p[0, n] * (1.0 - cosine) + p[1, n] * (1.0 + thrice) + p[2, n] * (1.0 + turned)
        return energy, sine * (p[0, n] - 3.0 * p[1, n] * (3.0 - 4.0 * sine * sine)) - p[2, n] * (sine + cosine) * np.sqrt(0.5)


@dataclass(frozen=True)
class ToySpring(AnySpring):
    k: float
    r0: float

    KIND = ToyBonds


@dataclass(frozen=True)
class ShiftedBend(AnyBend):
    k: float
    theta0: float

    KIND = ShiftedAngles


@dataclass(frozen=True)
class HelixTwist(AnyTwist):
    A: float
    B: float
    C: float

    KIND = HelixDihedrals


BOND = kinds.BondedKind(terms=ToyBonds, kernel=ToyBondTerms, energies=(kinds.Energy("toy bonds", "k*(r-r0)^4"),))
ANGLE = kinds.BondedKind(
    terms=ShiftedAngles,
    kernel=ShiftedAngleTerms,
    energies=(kinds.Energy("shifted angles", "-0.5*k*(1+cos(theta-theta0))"),),
    style="cosine/shift",
    words={"k": ("energy", "K"), "theta0": ("degrees", "theta0")},
)

DIHEDRAL = kinds.BondedKind(
    terms=HelixDihedrals,
    kernel=HelixDihedralTerms,
    energies=(kinds.Energy("helix dihedrals", "A*(1-cos(theta))+B*(1+cos(3*theta))+C*(1+cos(theta+0.7853981633974483))"),),
    style="helix",
    words={name: ("energy", name) for name in ("A", "B", "C")},
)


@pytest.fixture
def known():
    """All three kinds, for the time of a test."""
    for kind in (BOND, ANGLE, DIHEDRAL):
        kinds.register_bonded(kind)
    yield
    for kind in (BOND, ANGLE, DIHEDRAL):
        kinds.BONDED_KINDS.pop(kind.terms, None)
    serialized._REGISTERED.discard(__name__)


def scene(**options) -> dpd.Scene:
    """Chains of eight, with bonds, angles and dihedrals of the package among those of this file."""
    x, bonds, angles = chains.walks(40, 8, BOX, 3)
    quads, k = all_quads(), np.linspace(20, 60, len(bonds[::2]))
    terms = {
        "bonds": [ToyBonds(bonds[::2], k, 0.6), dpd.HarmonicBonds(bonds[1::2], 20, 0.7)],
        "angles": [dpd.CosineAngles(angles[::3], 4), ShiftedAngles(angles[1::3], 6, 2.0)],
        "dihedrals": [dpd.HarmonicDihedrals(quads[::2], 2, 1, 3), HelixDihedrals(quads[1::2], 3.0, -2.0, 5.0)],
    }
    return beads(len(x), positions=x, box=BOX, **terms, **options)


def all_quads() -> np.ndarray:
    """The dihedrals of 40 chains of eight."""
    return np.array([[8 * c + k + m for m in range(4)] for c in range(40) for k in range(5)])


def energy_of(made: dpd.Scene, x: np.ndarray, box=BOX) -> float:
    """The formulas once more, of all bonds, angles and dihedrals."""
    (toy, harmonic), (cosine, shifted_), (wave, helix) = made.bonds, made.angles, made.dihedrals

    def length(pairs):
        d = x[pairs[:, 0]] - x[pairs[:, 1]]
        return np.linalg.norm(d - np.round(d / np.diag(box)) * np.diag(box), axis=1)

    def cosines(triples):
        a, b = (x[triples[:, end]] - x[triples[:, 1]] for end in (0, 2))
        a, b = (d - np.round(d / np.diag(box)) * np.diag(box) for d in (a, b))
        return np.sum(a * b, axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)

    def turns(quads):
        """How far the last bond is turned from the first, as a right-handed screw about the middle one."""
        f, g, h = (x[quads[:, a]] - x[quads[:, b]] for a, b in ((0, 1), (2, 1), (3, 2)))
        f, g, h = (d - np.round(d / np.diag(box)) * np.diag(box) for d in (f, g, h))
        g /= np.linalg.norm(g, axis=1)[:, None]
        u, w = (d - np.sum(d * g, axis=1)[:, None] * g for d in (f, h))
        return np.arctan2(np.sum(g * np.cross(u, w), axis=1), np.sum(u * w, axis=1))

    phi, total = turns(helix.quads), np.sum(2 * (1 + np.cos(3 * turns(wave.quads))))
    total += np.sum(3 * (1 - np.cos(phi)) - 2 * (1 + np.cos(3 * phi)) + 5 * (1 + np.cos(phi + np.pi / 4)))
    total += np.sum(toy.k * (length(toy.pairs) - 0.6) ** 4) + np.sum(20 * (length(harmonic.pairs) - 0.7) ** 2)
    return float(total + np.sum(4 * (1 + cosines(cosine.triples))) + np.sum(-3 * (1 + np.cos(np.arccos(cosines(shifted_.triples)) - 2.0))))


def shifted(made: dpd.Scene, place: tuple[int, int], h: float) -> float:
    """The energy with one coordinate larger by h."""
    x = made.positions.copy()
    x[place] += h
    return energy_of(made, x)


@pytest.mark.parametrize("loop", [True, False])
def test_forces_are_the_gradient(known, loop):
    made, h = scene(), 1e-5
    built = dpd.build(made, dt=0.005, platform="Reference", conservative="kernel", seed=1, loop=loop)
    force = dpd.force_terms(built)["bond"]
    for place in ((0, 0), (7, 1), (100, 2), (319, 0)):
        slope = (shifted(made, place, h) - shifted(made, place, -h)) / (2 * h)
        assert force[place] == pytest.approx(-slope, rel=1e-6, abs=1e-6)


def test_loop_and_program_go_the_same_way(known):
    ends = []
    for loop in (True, False):
        built = dpd.build(scene(), dt=0.005, platform="Reference", conservative="kernel", seed=1, loop=loop)
        simulation = stepped(built.simulation(), 20)
        ends.append(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-12)


def test_they_are_measured(known):
    made, h = scene(), 1e-5
    built = dpd.build(made, dt=0.005, platform="Reference", seed=1)
    x, all_move = made.positions, np.ones(made.n_beads, bool)
    sample = dpd.Observer(built).sample(built.simulation().context)
    energy = energy_of(made, x)
    assert sample.bond + sample.angle + sample.dihedral == pytest.approx(energy, rel=1e-12)
    grown, shrunk = (energy_of(made, x * s, BOX * s) for s in (1 + h, 1 - h))
    stress = sum(part(x, BOX) for part in stress_parts(built.plan))
    assert stress[:3].sum() == pytest.approx(-(grown - shrunk) / (2 * h), rel=1e-7)
    laplacian = sum(sums(built.plan, x, BOX, all_move)[1] for sums in SUMS)
    h = 1e-4
    second = sum(shifted(made, place, h) + shifted(made, place, -h) - 2 * energy for place in np.ndindex(x.shape))
    assert laplacian == pytest.approx(second / h**2, rel=1e-5)


def test_they_are_explained_and_have_steps(known):
    text = dpd.explain_plan(dpd.make_plan(scene(), dt=0.005, seed=1))
    assert "140 toy bonds, 140 harmonic bonds; 0 bonded neighbours" in text
    assert "\n80 cosine angles\n80 shifted angles\n100 harmonic dihedrals\n100 helix dihedrals" in text
    stiff = [dict(bonds=[ToyBonds([(0, 1)], k, 0.6)]) for k in (1e2, 1e4)]
    fastest = [bonded_modes(beads(2, positions=np.array([[1.0, 1, 1], [1.6, 1, 1]]), **bonds))[0].fastest for bonds in stiff]
    # <(r - r0)^2> goes with k^-1/2, so the mean of k (r - r0)^2 does with k^1/2, and the frequency with k^1/4
    assert fastest[1] / fastest[0] == pytest.approx(100**0.25, rel=0.05)


def test_lammps_has_two_of_them(known, tmp_path):
    x, bonds, angles = chains.walks(40, 8, BOX, 3)
    message = "bonds of kind ToyBonds cannot be exported to LAMMPS"
    raises(dpd.ParameterError, message, export_lammps, scene(), tmp_path / "first", "toy", dt=0.005)
    terms = {"angles": [ShiftedAngles(angles, 6, 2.0)], "dihedrals": [HelixDihedrals(all_quads(), 3.0, -2.0, 5.0)]}
    made = beads(len(x), positions=x, box=BOX, bonds=[dpd.HarmonicBonds(bonds, 20, 0.7)], **terms)
    export_lammps(made, tmp_path, "toy", dt=0.005, steps=0)
    deck = tmp_path / "in.toy"
    assert re.search(r"angle_style cosine/shift\nangle_coeff 1 6(\.0)? 114\.59155902616", deck.read_text(encoding="utf-8"))
    again = deck_scene(deck)
    for found, expected in zip((*again.angles, *again.dihedrals), (*made.angles, *made.dihedrals), strict=True):
        assert type(found) is type(expected) and np.array_equal(found.beads, expected.beads)
        np.testing.assert_allclose(found.coefficients, expected.coefficients, rtol=1e-14)
    if not NO_LAMMPS:
        with lammps_peer.instance() as lmp:
            lmp.command(f"shell cd {tmp_path}")
            lmp.file(str(deck))
            energies = [lmp.get_thermo(word) for word in ("ebond", "eangle", "edihed")]
        plan, x, all_move = dpd.make_plan(made, dt=0.005, seed=1), made.positions, np.ones(made.n_beads, bool)
        expected = [sums(plan, x, BOX, all_move)[0] for sums in SUMS]
        np.testing.assert_allclose(energies, expected, rtol=1e-6)
    for kind, what in ((HelixDihedrals, "dihedral"), (ShiftedAngles, "angle")):
        kinds.BONDED_KINDS.pop(kind)
        raises(dpd.DeckError, f"the {what} style must be one of", deck_scene, deck)


def test_molecules_of_them(known):
    chain = linear("A4", ToySpring(50, 0.5), ShiftedBend(5, 2.0), twist=HelixTwist(3, -2, 5))
    mixture = pack({chain: 10}, solvent="W", density=3.0, box=[4.0] * 3, seed=1)
    (bonds,), (angles,), (dihedrals,) = mixture.bonds, mixture.angles, mixture.dihedrals
    assert type(bonds) is ToyBonds and len(bonds.pairs) == 30 and type(angles) is ShiftedAngles and len(angles.triples) == 20
    assert type(dihedrals) is HelixDihedrals and dihedrals.coefficients.tolist() == [[3, -2, 5]] * 10
    np.testing.assert_allclose(bonds.lengths(mixture.positions, mixture.box), 0.5, rtol=1e-9)


@pytest.mark.parametrize("loop", [True, False])
def test_a_kind_that_was_not_registered_is_refused(loop):
    message = "nothing is known of ToyBonds; register their kind"
    raises(dpd.ParameterError, message, dpd.build, scene(), dt=0.005, platform="CPU", seed=1, loop=loop)


def test_kinds_that_make_no_sense(known):
    raises(dpd.ParameterError, "there is a kind for ToyBonds already", kinds.register_bonded, replace(BOND))
    kinds.BONDED_KINDS.pop(ToyBonds)
    taken = replace(BOND, energies=(kinds.Energy("harmonic bonds", "0"),))
    message = "there are harmonic bonds already; give the energy of ToyBonds another name"
    raises(dpd.ParameterError, message, kinds.register_bonded, taken)
    raises(dpd.ParameterError, "the kernel of the kind ToyBonds is for 3 beads, not 2", replace, BOND, kernel=ShiftedAngleTerms)


def test_systems_with_them_are_read_where_they_are_known(known, tmp_path):
    built = dpd.build(scene(), dt=0.005, platform="CPU", seed=1)
    path = tmp_path / "system.xml"
    path.write_text(openmm.XmlSerializer.serialize(built.system), encoding="utf-8")
    assert dpd.load_xml(path).getNumForces() == built.system.getNumForces()
    serialized._REGISTERED.discard(__name__)
    raises(dpd.ParameterError, "asks for test_toy_bonded.ToyBondTerms", lambda: dpd.load_xml(path))
