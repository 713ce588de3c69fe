"""Smeared charges with all their images: a short-ranged sum over pairs and a sum over waves (see :mod:`.charge_pairs`, :mod:`.waves`).

A pair and its images have the energy sum over images of C q q s(R).  The waves hold the part erf(alpha R)/R of every pair, bonded or not,
and of a charge with itself, which is taken off; pairs within the cutoff have s(r) - erf(alpha r)/r on top.  A uniform background makes up
for a net charge.  Bonded neighbours with a factor f have f s(r) - erf(alpha r)/r at any distance.  Without a box all pairs have s(r).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from ..base.errors import RunError, bead_number, in_length
from ..base.geometry import weighted_sum
from ..runtime import Kernel, get_threads, helper, meet
from .charge_pairs import SHARES, Quintics, charge_row, exception
from .columns import add_stress, push
from .elementary import erfc, exp
from .extras import box_array, inverse_edges, minimum_image, run_terms
from .vectors import LANES, load_lanes, splat, store_lanes
from .waves import ISOTROPIC, PULLS, STRIP, WEIGHTS, Waves, copy_steps, lattice_forces, structure_factors, write_phases

#: Less work than this (pairs of charges, and of charges and waves) is not worth waking a second thread for.
FEW = 400_000


@dataclass(frozen=True, eq=False)
class ChargeTerms:
    """All charges."""

    term: ClassVar[str] = "electrostatic"
    beads: np.ndarray  #: (M,) beads that have a charge
    charges: np.ndarray  #: (M,) theirs, in elementary charges
    constant: float  #: Coulomb constant, kJ/mol nm
    short: Quintics  #: s(r) - erf(alpha r)/r up to the cutoff; s(r), and 1/r from its end on, where there is no box
    cutoff: float  # nm; infinite without a box
    alpha: float  #: Splitting parameter (1/nm); 0 without a box
    k_max: float  #: The longest wave vector, 1/nm; 0 without a box
    whole: Quintics  #: s(r), and 1/r from its end on; for bonded neighbours
    pairs: np.ndarray  #: (E, 2) bonded neighbours, as numbers of charges (not of beads)
    factors: np.ndarray  #: (E,) theirs
    bare: float = 0.0  #: 1 for point charges: their functions are 1/r more than what ``short`` and ``whole`` hold
    soft2: float = -1.0  #: Of softened charges a^2 >= 0: their functions are bare/sqrt(r^2 + a^2) times ``short`` and ``whole``

    def evaluator(self) -> ChargeEvaluator:
        """What computes it."""
        return ChargeEvaluator(self)

    def few(self) -> tuple[ChargeTerms, np.ndarray, np.ndarray]:
        """Two charges."""
        line = Quintics(np.ones((1, 6)), 1.0)
        bond = np.zeros((1, 2), np.int64), np.ones(1)
        terms = ChargeTerms(np.arange(2), np.array([1.0, -1.0]), 1.0, line, 1.0, 1.0, 4.0, line, *bond)
        return terms, np.array([[0.0, 0, 0], [0.5, 0.5, 0.5]]), np.diag([4.0] * 3)


class Law(NamedTuple):
    """How two charges act on each other, for the kernel."""

    cutoff: float
    alpha: float
    end: float
    per_length: float
    short: np.ndarray
    whole_end: float
    whole_per_length: float
    whole: np.ndarray
    bare: float
    soft2: float


class ChargeSpace(NamedTuple):
    """What the kernel writes on; ``room`` is the number of charges, and some without a charge that make up whole strips."""

    xs: np.ndarray  #: (3 room,) positions, x of all charges first
    q: np.ndarray  #: (room,) charges; 0 at the end
    tables: np.ndarray  # tables, start: phases of all charges and where they begin for each axis, see :func:`.waves.write_phases`
    start: np.ndarray
    counts: np.ndarray  #: (3,) how many of them
    steps: np.ndarray  #: (16 room,) see :func:`.waves.copy_steps`
    energies: np.ndarray  # energies, pulls: see :func:`.waves.structure_factors`
    pulls: np.ndarray
    forces: np.ndarray  #: Three components of the forces of the lattice, then those of each share of the pairs
    of_shares: np.ndarray  #: (shares, 7) energy and six sums of r F of shares of the pairs
    of_blocks: np.ndarray  #: (B,) energy of blocks of waves
    outer: np.ndarray  #: (parts, 18 room) scratch of each thread
    hits: np.ndarray  #: (parts, room) uint32 the same


@helper
def _gather(x, beads, room, xs):
    """Copy the positions of the charges; returns whether they are finite."""
    odd = 0.0
    for k in range(len(beads)):
        i = beads[k]
        xs[k], xs[room + k], xs[2 * room + k] = x[i, 0], x[i, 1], x[i, 2]
        odd += 0.0 * (x[i, 0] + x[i, 1] + x[i, 2])
    return odd == 0.0


@helper
def _phases(waves, space, part, parts):
    """The phases of some charges."""
    room = len(space.q)
    for first in range(part * LANES, room, parts * LANES):
        write_phases(space.xs, room, waves.recip, space.counts, space.tables, space.start, first)
        copy_steps(space.tables, room, space.start[1] * room, space.steps, first)


@helper
def _pairs_and_blocks(n, box, law, waves, space, tensor, part, parts):
    """Some of the pairs, and some blocks of waves."""
    room = len(space.q)
    outer, hits = space.outer[part], space.hits[part]
    for block in range(part, len(waves.blocks), parts):
        to_write = outer, space.energies, space.pulls
        space.of_blocks[block] = structure_factors(waves, block, space.q, n, space.tables, room, space.start, space.steps, *to_write)
    cut2, f = law.cutoff * law.cutoff, space.forces
    for share in range(part, SHARES, parts):
        to = 3 * room * (1 + share)
        for k in range(to, to + 3 * room, LANES):
            store_lanes(f, k, splat(0.0))
        space.of_shares[share] = 0.0
        for i in range(share, n, SHARES):
            pieces = law.end, law.per_length, law.short, law.bare, law.soft2
            found = charge_row(space.xs, space.q, n, room, i, box, cut2, *pieces, outer, hits, f, to, tensor)
            for k in range(7):
                space.of_shares[share, k] += found[k]


@helper
def _strips(beads, constant, waves, space, force, part, parts):
    """Forces on some charges."""
    room, n, f = len(space.q), len(beads), space.forces
    for first in range(part * STRIP, room, parts * STRIP):
        if len(waves.blocks):
            lattice_forces(waves, space.q, space.tables, room, space.start, space.pulls, f, first)
        for axis in range(3):
            for at in range(axis * room + first, axis * room + first + STRIP, LANES):
                pairs = splat(0.0)
                for share in range(1, SHARES + 1):
                    pairs = pairs + load_lanes(f, 3 * room * share + at)
                lattice = load_lanes(f, at) if len(waves.blocks) else splat(0.0)
                store_lanes(f, at, lattice + splat(constant) * pairs)
        for k in range(first, min(first + STRIP, n)):
            i = beads[k]
            force[i, 0] += f[k]
            force[i, 1] += f[room + k]
            force[i, 2] += f[2 * room + k]


@helper
def _exceptions(beads, q, constant, pairs, factors, box, law, xs, force, stress):
    """Add the forces of bonded neighbours, and their sums of r F if there is room; returns the energy."""
    inverse, room, energy = inverse_edges(box), len(q), 0.0
    for n in range(len(pairs)):
        i, j = pairs[n, 0], pairs[n, 1]
        dx, dy, dz = minimum_image(xs[i] - xs[j], xs[room + i] - xs[room + j], xs[2 * room + i] - xs[2 * room + j], box, inverse)
        r2 = dx * dx + dy * dy + dz * dz
        r = np.sqrt(r2)
        value, slope = exception(r, factors[n], law.cutoff, law.alpha, law.whole_end, law.whole_per_length, law.whole, law.bare, law.soft2)
        qq = constant * q[i] * q[j]
        pull = -qq * slope / r if r > 0.0 else 0.0
        energy += qq * value
        push(force, beads[i], beads[j], pull * dx, pull * dy, pull * dz)
        if len(stress):
            add_stress(stress, 0, (pull * dx * dx, pull * dy * dy, pull * dz * dz, pull * dx * dy, pull * dx * dz, pull * dy * dz))
    return energy


def _charge_forces(x, box, beads, constant, pairs, factors, law, waves, space, force, stress, found, part, parts, team):
    """Add the forces, and to ``stress`` (1, 6), if it has rows, the sums of r F of pairs; writes down the energies of pairs and of
    waves.  These are not numbers if a position is not finite."""
    n, room = len(beads), len(space.q)
    if part == 0:
        found[0] = 0.0 if _gather(x, beads, room, space.xs) else np.nan
    meet(team, parts)
    if np.isnan(found[0]):
        return 1
    if len(waves.blocks):
        _phases(waves, space, part, parts)
        meet(team, parts)
    _pairs_and_blocks(n, box, law, waves, space, len(stress) > 0, part, parts)
    meet(team, parts)
    _strips(beads, constant, waves, space, force, part, parts)
    meet(team, parts)
    if part > 0:
        return 0
    short, lattice = 0.0, 0.0
    for share in range(SHARES):
        short += space.of_shares[share, 0]
        for k in range(6 * len(stress)):
            stress[0, k] += constant * space.of_shares[share, 1 + k]
    for block in range(len(waves.blocks)):
        lattice += space.of_blocks[block]
    found[0] = constant * short + _exceptions(beads, space.q, constant, pairs, factors, box, law, space.xs, force, stress)
    found[1] = lattice
    return 0 if np.isfinite(found[0] + found[1]) else 1


charge_forces = Kernel(_charge_forces)


class ChargeEvaluator:
    """Computes :class:`ChargeTerms`; from so much work as ``fewest`` on several threads share it."""

    repeats = True

    def __init__(self, terms: ChargeTerms):
        self.terms, self.fewest, self._beads = terms, FEW, terms.beads.copy()
        self._charge, self._alone = float(terms.charges.sum()), _alone(terms)
        short, whole = terms.short, terms.whole
        pieces = short.end, short.per_length, short.coefficients, whole.end, whole.per_length, whole.coefficients
        self._law = Law(terms.cutoff, terms.alpha, *pieces, terms.bare, terms.soft2)
        self._box, self._key, self._waves = box_array(None), b"", Waves.none()
        self._space: ChargeSpace | None = None
        self._strains: np.ndarray | None = None
        self._work = 0

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        """See :meth:`.pairs.PairList.seat`."""
        self._beads[...] = places[self.terms.beads]

    def _prepare(self, box: np.ndarray | None) -> ChargeSpace:
        """Waves of the present box, and room for them."""
        key = b"none" if box is None else box.tobytes()
        if key != self._key:
            terms = self.terms
            if box is not None and not terms.cutoff <= 0.5 * float(np.diag(box).min()) * (1 + 1e-9):
                raise RunError(f"the box is narrower than twice the cutoff of the charges, {in_length(terms.cutoff)}")
            present = box_array(box).copy()
            waves = Waves.none() if box is None or terms.alpha == 0.0 else Waves.of(present, terms.k_max, terms.alpha, terms.constant)
            work = len(terms.beads) * (len(terms.beads) + LANES * int(waves.blocks[:, 2].sum()))
            # together: an error before, or Ctrl-C, leaves those of the last box
            self._box, self._waves, self._work, self._space, self._strains, self._key = present, waves, work, None, None, key
        threads = get_threads()
        if self._space is None or len(self._space.outer) != threads:
            self._space = _space_for(self.terms.charges, self._waves, threads)
        return self._space

    def _run(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, stress: np.ndarray) -> tuple[float, float]:
        """Energies of both parts; adds the forces, and the sums of r F if there is room for them."""
        terms, space = self.terms, self._prepare(box)
        many, given = self._work >= self.fewest, (self._beads, terms.constant, terms.pairs, terms.factors)
        rest = self._law, self._waves, space, force, stress
        short, lattice = run_terms(charge_forces, many, x, self._box, *given, *rest)
        if not math.isfinite(short + lattice):
            bad = terms.beads[~np.isfinite(x[self._beads]).all(axis=1)]
            if len(bad):
                raise RunError(f"the position of bead {bead_number(bad[0])} is not finite: {x[bad[0]].tolist()}")
            raise RunError("the energy of the charges is not finite")
        if box is not None and terms.alpha > 0.0:
            background = -math.pi * terms.constant * (self._charge / terms.alpha) ** 2 / (2 * float(np.prod(np.diag(box))))
            lattice += self._alone[0] + background
            if len(stress):
                if self._strains is None:
                    self._strains = self._waves.strains(terms.alpha)
                stress[0] += weighted_sum(space.energies, self._strains) + (self._alone[1] / 3 + background) * ISOTROPIC
        return short, lattice

    def add_to(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, scale: float) -> float:
        """See :class:`.extras.Evaluator`; RunError if a position is not finite, or the box narrower than twice the cutoff."""
        return sum(self._run(x, box, force, np.zeros((0, 6))))

    def parts(self, x: np.ndarray, box: np.ndarray | None) -> tuple[float, float, np.ndarray]:
        """Energies of the short-ranged part (with what is taken out for bonded neighbours) and of the lattice, and the stress of both.  All
        in kJ/mol; the stress has (6,) sums of r F, minus the derivatives of the energy with respect to strains of box and positions.
        RunError as above."""
        stress = np.zeros((1, 6))
        return *self._run(x, box, np.zeros_like(x), stress), stress[0]


def _alone(terms: ChargeTerms) -> tuple[float, float]:
    """What all charges have for themselves in a box: energy and virial.  The waves hold the interaction of each charge with itself, C q^2
    alpha/sqrt(pi) if there are all of them.  Those up to k_max hold the part erf(k_max/(2 alpha)) of it, and a virial."""
    square, alpha, k = terms.constant * float(np.sum(terms.charges**2)), terms.alpha, terms.k_max
    if alpha == 0.0:
        return 0.0, 0.0
    u = k / (2 * alpha)
    return -square * alpha / math.sqrt(math.pi) * (1 - erfc(u)), -square * k / math.pi * exp(-u * u)


def _space_for(charges: np.ndarray, waves: Waves, threads: int) -> ChargeSpace:
    """Scratch for so many threads."""
    n = len(charges)
    room = max(1, -(-n // STRIP)) * STRIP
    counts = waves.tables if len(waves.blocks) else (0, 0, 0)
    start = np.concatenate([[0], 2 * np.cumsum(counts)]).astype(np.int64)
    rows = int(waves.blocks[:, 2].sum())
    return ChargeSpace(
        xs=np.zeros(3 * room),
        q=np.concatenate([charges, np.zeros(room - n)]),
        tables=np.zeros(int(start[3]) * room),
        start=start[:3].copy(),
        counts=np.array(counts, np.int64),
        steps=np.zeros(STRIP * room),
        energies=np.zeros(WEIGHTS * rows),
        pulls=np.zeros(PULLS * rows),
        forces=np.zeros(3 * room * (1 + SHARES)),
        of_shares=np.zeros((SHARES, 7)),
        of_blocks=np.zeros(len(waves.blocks)),
        outer=np.zeros((threads, (STRIP + 2) * room)),
        hits=np.zeros((threads, room), np.uint32),
    )


def cost(n_charges: int, box: np.ndarray | None, k_max: float, cutoff: float) -> float:
    """Microseconds that one evaluation takes on one core, to a tenth or so on the one where this was measured.  The longest wave vector
    ``k_max`` (1/nm) and the cutoff are of no importance without a box."""
    near, waves = 1.0, 0.0
    if box is not None:
        volume = float(np.prod(np.diag(box)))
        near = min(1.0, 4 / 3 * math.pi * cutoff**3 / volume)
        waves = 2 / 3 * math.pi * volume * (k_max / (2 * math.pi)) ** 3
    # per charge; per pair that is looked at, and per one within the cutoff, counted twice; per wave, and per wave and charge
    return 7.7 + 0.082 * n_charges + (4.7e-4 + 5.6e-3 * near) * n_charges**2 + (1.6e-3 + 1.74e-4 * n_charges) * waves


def pme_cost(grid: tuple[int, int, int], n_beads: int) -> float:
    """Estimated time of the lattice part alone with OpenMM's PME on the CPU platform, where beads without a charge count too."""
    points = float(np.prod(np.array(grid, dtype=float)))
    return 196.0 + 0.116 * n_beads + 2.9e-4 * points * math.log2(points)
