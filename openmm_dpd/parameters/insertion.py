"""Excess chemical potential of a molecule in a solvent, from a run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from openmm import unit

from ..advice.recommend import recommend
from ..base.errors import ParameterError
from ..base.geometry import minimum_images, widths
from ..base.stats import block_average
from ..base.units import whole_number
from ..model.pairs import checked
from ..model.scene import Scene
from ..molecules import Molecule
from ..simulation.build import build
from .estimate import Estimate, reduced_number
from .insertion_scene import Insertion, insertion

_SCHEME = "bababo"
#: Error of the temperature for which :func:`openmm_dpd.recommend` gives the default step.
_STEP_ERROR = 0.003
#: Solvent further than this many cutoffs from every copy counts as undisturbed, if it has at least this part of the box.  The solvent is
#: up to 1.6 % denser from 1.5 to 1.8, 0.5 % thinner from 1.9 to 2.1: from 1.65 on the two cancel, to about the last number.
_FAR, _LEAST_FAR, _LAYERS = 1.65, 0.15, 0.001
#: Time between samples, in units of rc (m/kT)^(1/2).
_EVERY = 0.2
#: Default step times the angular frequency of the stiffest bond.
_BOND_STEP = 0.4
#: Grid points along each edge of the box, to measure its part far from all copies.
_GRID = 10


@dataclass(frozen=True, eq=False)
class ExcessChemicalPotential:
    r"""Excess chemical potential of a molecule in a solvent, in units of kT, from :func:`excess_chemical_potential`.

    Attributes
    ----------
    value, error : float
        :math:`\mu_{ex}/k_BT` and its standard error.
    parts : (K,) array
        Coupling lambda of each copy of the molecule, 0 to 1.
    energies : (samples, K) array
        Energy of each copy with the solvent at full repulsion, over kT.
    densities : (samples,) array
        Density of the solvent far from all copies, relative to that of the scene.
    kT : float
        Thermal energy, kJ/mol.
    """

    parts: np.ndarray
    energies: np.ndarray
    densities: np.ndarray
    kT: float
    value: float = field(init=False)
    error: float = field(init=False)

    def __post_init__(self):
        whole = self.at(1.0)
        object.__setattr__(self, "value", whole.value)
        object.__setattr__(self, "error", whole.error)

    def __repr__(self) -> str:
        return f"<ExcessChemicalPotential {self.value:.4g} kT, standard error {self.error:.2g}>"

    def __float__(self) -> float:
        return self.value

    @property
    def molar_energy(self) -> unit.Quantity:
        """The value as a molar energy, kJ/mol."""
        return self.value * self.kT * unit.kilojoule_per_mole

    def at(self, part: float, base: float = 0.0) -> Estimate:
        """mu_ex/kT at coupling ``part`` (0 to 1) of the repulsion between molecule and solvent, less that at coupling ``base``.

        The polynomial of degree K - 1 through the mean energies is integrated.  Errors of the two terms cancel in part in the difference.

        Raises
        ------
        ParameterError
            If a coupling is out of bounds.
        """
        ends = [reduced_number(value, "the part of the repulsion") for value in (part, base)]
        if max(ends) > 1:
            raise ParameterError(f"the part of the repulsion must be from 0 to 1; {max(ends):g} was not measured")
        series = self.energies @ (weights(self.parts, ends[0]) - weights(self.parts, ends[1]))
        uncoupled = (ends[0] - ends[1]) * float(np.mean(self.energies @ interpolation(self.parts, 0.0)[0]))
        slope, doubt = 0.5 * (uncoupled + float(series.mean())), 0.5 * (uncoupled - float(series.mean()))
        average = block_average(series - slope * (self.densities - 1.0), name="the energy of the molecule with the solvent")
        assert average.mean is not None and average.sem is not None
        error = math.hypot(average.sem, doubt * (float(self.densities.mean()) - 1.0), slope * _LAYERS)
        return Estimate(average.mean, error, "openmm_dpd.parameters.excess_chemical_potential", {"part": (0.0, 1.0)})


def interpolation(parts: np.ndarray, points) -> np.ndarray:
    """Weights (P, K) that interpolate polynomials of degree K - 1 at P points from their values at K ``parts``, all in [0, 1]."""

    def basis(x) -> np.ndarray:
        # Legendre polynomials on [0, 1] keep the matrix well conditioned
        return np.polynomial.legendre.legvander(2.0 * np.atleast_1d(x) - 1.0, len(parts) - 1)

    return np.linalg.solve(basis(parts).T, basis(points).T).T


def weights(parts: np.ndarray, end: float) -> np.ndarray:
    """Weights (K,) that integrate polynomials of degree K - 1 from 0 to ``end``, from their values at ``parts``."""
    nodes, gauss = np.polynomial.legendre.leggauss(len(parts))
    return 0.5 * end * gauss @ interpolation(parts, 0.5 * end * (nodes + 1.0))


def excess_chemical_potential(
    molecule: Molecule,
    solvent: Scene,
    *,
    time: float = 300.0,
    settle: float = 30.0,
    copies: int = 6,
    dt=None,
    seed: int = 1,
    platform="CPU",
) -> ExcessChemicalPotential:
    r"""Excess chemical potential (solvation free energy) of a molecule at infinite dilution, by thermodynamic integration.

    The repulsion of DPD is bounded, so it can be switched on by a factor,

    .. math:: \mu_{ex} = \int_0^1 \langle U_{sv} \rangle_\lambda \, d\lambda ,

    where U_sv is the repulsion between molecule and solvent, scaled by lambda.  Bonds, angles and the repulsion within the molecule are
    never scaled: the reference state is the molecule in vacuum.

    Parameters
    ----------
    molecule : Molecule
    solvent : Scene
        Equilibrated box of solvent, whose scene also has the masses and pair coefficients of the molecule's beads.  A freshly packed box
        relaxes during ``settle``, which suffices for single beads and short chains.
    time : float, default 300
        Length of the run in units of rc (m/kT)^(1/2), with the longest cutoff rc and the smallest mass m.
    settle : float, default 30
        Equilibration time in the same unit; 4.4 times this is run in all, see Notes.
    copies : int, default 6
        Copies of the molecule in the box, 3 to 32, one for each point of a Gauss-Legendre quadrature in lambda.
    dt : time, optional
        Step size; by default that of :func:`openmm_dpd.recommend` for an error of 0.3 % with ``bababo``, or less for stiff bonds.
    seed : int
    platform : str

    Raises
    ------
    ParameterError
        If molecule or solvent have terms that cannot be scaled (charges, many-body or other potentials, internal energies, segmental
        repulsion, walls, ...), a type has no pair coefficients, the box is too small for the copies, or there is no default step.

    Notes
    -----
    All copies are in one box, each at its own lambda.  A bead in the middle of each is held at a lattice point; this does not change the
    integral, because the solvent is homogeneous, and keeps the copies apart.  Free copies, which do not repel each other, would share a
    cavity.

    The copies take up space and so compress the solvent.  After ``settle`` the density of the solvent is measured where no bead of a copy
    is within 1.65 cutoffs, and the box is scaled to the density of the scene, twice.  The remaining deviation is corrected to first order;
    d mu_ex/d ln rho is taken midway between mu_ex, its value in a dilute solvent, and <U_sv> at lambda = 0, its mean-field value.  The
    error includes half of their difference, and 0.1 % of the density for the solvent layers around the copies.  Measured values at density
    3: 1.22 mu_ex for a bead among its like at A = 25, 1.34 at A = 78, 1.4 for three beads at A = 40; midway is 1.15, 1.18 and 1.36.  So
    the result holds for a solvent at the density of the scene.

    References
    ----------
    D. Frenkel and B. Smit, Understanding Molecular Simulation (2002), section 7.1.
    """
    count = whole_number(copies, "copies", least=3)
    if count > 32:
        raise ParameterError(f"copies, the points of a quadrature, must be from 3 to 32, not {count}")
    length, before = reduced_number(time, "time", positive=True), reduced_number(settle, "settle", positive=True)
    if length < 10 * _EVERY:
        raise ParameterError(f"an average with an error needs a time of at least {10 * _EVERY:g}, not {length:g}")
    whole_number(seed, "seed", least=0)
    nodes, _ = np.polynomial.legendre.leggauss(count)
    parts = 0.5 * (nodes + 1.0)
    # lattice neighbours have different couplings
    order = np.random.default_rng(seed).permutation(count)
    made = insertion(molecule, solvent, parts[order], seed)
    assert solvent.box is not None and isinstance(solvent.kT, float)
    reach, width = made.reach, float(widths(solvent.box).min())
    density = solvent.n_beads / float(np.prod(np.diag(solvent.box)))
    if reach == 0:
        raise ParameterError(f"nothing acts between {molecule.name} and this solvent; its excess chemical potential is 0")
    if width < 2 * _FAR * reach:
        raise ParameterError(f"the box must be at least {2 * _FAR:g} cutoffs wide, {2 * _FAR * reach:g}, not {width:g}")
    second = reach * (min(made.scene.bead_masses) / solvent.kT) ** 0.5
    step = _default_step(made.scene) if dt is None else checked(dt, "time", "dt", positive=True)

    def run(turn: int, rest: float, long: float) -> _Run:
        return _Run(made, step, seed + turn, platform).advance(rest * second).sample(long * second, _EVERY * second)

    for turn, (rest, long) in enumerate(((before, before), (0.2 * before, 2 * before))):
        done = run(turn, rest, long)
        grown = float(np.mean(done.densities(density))) ** (1 / 3)
        scene = replace(made.scene, positions=_scaled(made, done.positions(), grown), box=made.scene.box * grown)
        made = replace(made, scene=scene)
    done = run(2, 0.2 * before, length)
    return ExcessChemicalPotential(parts, np.array(done.energies)[:, np.argsort(order)] / solvent.kT, done.densities(density), solvent.kT)


class _Run:
    """One run of the copies in their solvent, and its samples."""

    def __init__(self, made: Insertion, step: float, seed: int, platform: str):
        assert made.scene.box is not None
        self.made, self.step, self._volume = made, step, float(np.prod(np.diag(made.scene.box)))
        self._rng = np.random.default_rng(seed)
        self.built = build(made.scene, dt=step, scheme=_SCHEME, platform=platform, seed=seed)
        self.simulation = self.built.simulation()
        self.energies: list[np.ndarray] = []
        self._counts: list[int] = []
        self._rooms: list[float] = []

    def advance(self, time: float) -> _Run:
        """Run for a time (ps) without samples, and return the run."""
        self.simulation.step(round(time / self.step))
        return self

    def sample(self, time: float, every: float) -> _Run:
        """Run for a time (ps) with a sample at every interval ``every`` (ps), and return the run."""
        steps = max(1, round(every / self.step))
        for _ in range(max(1, round(time / self.step / steps))):
            self.simulation.step(steps)
            self._see(self._rng.random(3))
        return self

    def positions(self) -> np.ndarray:
        """Present positions (N, 3), nm."""
        return self.simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)

    def _see(self, offset: np.ndarray) -> None:
        """Take a sample: energies of the copies, and the solvent and room far from all copies, on a grid shifted by ``offset``."""
        made, box = self.made, self.made.scene.box
        assert box is not None
        x = self.positions()
        solvent, own = x[: made.solvent], x[made.solvent :]
        apart = _distances(own, solvent, box)
        self.energies.append(made.energies(apart.reshape(made.copies, -1, made.solvent)))
        far = _FAR * made.reach
        grid = np.stack(np.meshgrid(*[np.arange(_GRID)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        room = float(np.mean(_distances(own, ((grid + offset) / _GRID) @ box, box).min(axis=0) > far))
        self._counts.append(int(np.count_nonzero(apart.min(axis=0) > far)))
        self._rooms.append(room * self._volume)

    def densities(self, wanted: float) -> np.ndarray:
        """Densities of the solvent far from all copies, over the wanted one, (samples,); ParameterError if too little is undisturbed."""
        rooms = np.array(self._rooms)
        part = float(rooms.mean()) / self._volume
        if part < _LEAST_FAR:
            raise ParameterError(
                f"the copies leave {100 * part:.0f} % of the box as undisturbed solvent, but {100 * _LEAST_FAR:.0f} % are needed; "
                "take a larger box or fewer copies"
            )
        # excess of beads over those at the wanted density in the room of the same sample, which changes as copies bend
        return 1.0 + (np.array(self._counts) - wanted * rooms) / (wanted * rooms.mean())


def _distances(a: np.ndarray, b: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Distances (A, B) between A and B positions, by minimum image."""
    d = minimum_images((a[:, None, :] - b[None, :, :]).reshape(-1, 3), box)
    return np.sqrt(np.einsum("ij,ij->i", d, d)).reshape(len(a), len(b))


def _scaled(made: Insertion, x: np.ndarray, grown: float) -> np.ndarray:
    """Positions in a box scaled by a factor: the solvent scales, copies move with their fixed bead."""
    own = x[made.solvent :].reshape(made.copies, -1, 3)
    held = x[made.scene.immobile].reshape(made.copies, 1, 3)
    return np.concatenate([x[: made.solvent] * grown, (own + (grown - 1.0) * held).reshape(-1, 3)])


def _default_step(scene: Scene) -> float:
    """Recommended step (ps) of the soft beads, or a fraction of the period of the stiffest bond if that is shorter."""
    soft = replace(scene, mobile=None, bonds=(), angles=(), dihedrals=(), impropers=())
    found = [choice.dt for choice in recommend(soft, _STEP_ERROR).choices if choice.scheme == _SCHEME]
    if not found:
        raise ParameterError(f"there is no default step for {_SCHEME} with this solvent; give dt")
    step = found[0]
    for bonds in scene.bonds:
        stiffness = bonds.curve(bonds.lengths(scene.positions, scene.box))[2] * np.sum(1.0 / scene.bead_masses[bonds.pairs], axis=1)
        step = min(step, _BOND_STEP / float(np.sqrt(stiffness.max(initial=1e-300))))
    return step
