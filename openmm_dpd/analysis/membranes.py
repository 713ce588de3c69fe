"""Flat bilayers: thickness, area per lipid, height fluctuations and the bending modulus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..base.errors import ParameterError, what_is
from ..base.geometry import widths
from ..base.slices import axis_number, periodic_centre
from ..base.stats import Average, block_average, long_enough
from ..base.units import md_tension, thermal_energy, to_md
from .frames import Curve, Frame, curve_of, frames_of, positive_number, selected, weights_of
from .unwrapping import means_over, molecule_labels

if TYPE_CHECKING:
    from .frames import Beads, Trajectories

#: Fits of a spectrum, each weighted by the fit before; the first has equal weights, and the third changes nothing that matters.
_WEIGHINGS = 4


def bilayer_thickness(trajectory: Trajectories, heads: Beads, tails: Beads = None, *, axis: str | int = "z") -> Average:
    r"""Distance between the head groups of the two leaflets of a flat bilayer, D = <z>_upper - <z>_lower.

    Heads above the centre of mass of the bilayer belong to the upper leaflet, the others to the lower one; D is the difference of their
    mean heights in each frame.  For symmetric peaks this is the peak-to-peak distance in the density profile of the heads.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any periodic box.  The bilayer may cross the boundary and drift.
    heads : str, sequence of str, or array of int
        Beads of the head groups.
    tails : str, sequence of str, array of int, or None
        Beads whose centre of mass is the middle of the bilayer; the heads by default.  Needed if the solvent layer is about as thick as
        the bilayer, because the heads alone do not show which side is the inside.
    axis : {"z", "y", "x"} or int
        Box vector across the bilayer; heights are measured normal to the plane of the other two.

    Returns
    -------
    openmm_dpd.base.stats.Average
        Mean over frames (nm) with its standard error.

    Raises
    ------
    ParameterError
        If there is no box, the beads have no centre along the axis, or all heads are on one side.
    """
    topology, frames = frames_of(trajectory)
    head = selected(topology, heads, "heads")
    middle = head if tails is None else selected(topology, tails, "tails")
    k, masses, values = axis_number(axis), weights_of(topology), []
    for frame in frames:
        s = frame.fractions("a bilayer thickness")[:, k]
        height = s[head] - periodic_centre(s[middle], masses[middle])
        height = height - np.round(height)
        upper = height > 0
        if upper.all() or not upper.any():
            raise ParameterError("all heads are on one side of the bilayer's midplane; check heads, tails and axis")
        values.append((height[upper].mean() - height[~upper].mean()) * widths(frame.need_box("a bilayer thickness"))[k])
    return block_average(values, name="the thickness")


def area_per_lipid(trajectory: Trajectories, lipids: Beads | int, *, axis: str | int = "z") -> Average:
    r"""Area per lipid of a flat bilayer, a = A/(N/2), with the area A of the box normal to an axis.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
    lipids : int, str, sequence of str, or array of int
        Number of lipids N in both leaflets, or beads (such as their head groups) whose molecules are counted.
    axis : {"z", "y", "x"} or int
        Box vector across the bilayer.

    Returns
    -------
    openmm_dpd.base.stats.Average
        Mean over frames (nm^2) with its standard error, which is 0 for a constant box.

    Raises
    ------
    ParameterError
        If there is no box or no lipid.
    """
    topology, frames = frames_of(trajectory)
    if isinstance(lipids, (bool, np.bool_)):
        raise ParameterError(f"lipids must be their number or beads, not {what_is(lipids)}")
    if isinstance(lipids, (int, np.integer)):
        count = int(lipids)
    else:
        count = len(np.unique(molecule_labels(topology)[selected(topology, lipids, "lipids")]))
    if count < 1:
        raise ParameterError(f"the number of lipids must be above 0, not {count}")
    k = axis_number(axis)
    areas = [np.linalg.det(box) / widths(box)[k] for box in (frame.need_box("an area per lipid") for frame in frames)]
    return block_average(2 * np.array(areas) / count, name="the area per lipid")


# -- undulations -----------------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class HeightSpectrum:
    """Height fluctuations of a flat bilayer, frame by frame.

    Attributes
    ----------
    q : (K,) array
        Wave numbers of the box, 1/nm, in ascending order: one of each pair q, -q.  Means over the frames if the box changes.
    power : (F, K) array
        A |h_q|^2 of each frame, nm^4.
    noise : (K,) array
        Share of the lipids' scatter around the surface, nm^4, which is subtracted in ``power``; mean over the frames.
    """

    q: np.ndarray
    power: np.ndarray
    noise: np.ndarray

    @property
    def curve(self) -> Curve:
        """Spectrum averaged over the frames, with standard errors; x: q, y: A <|h_q|^2>."""
        return curve_of(self.q, list(self.power), name="the height spectrum")


@dataclass(frozen=True, eq=False)
class BendingModulus:
    """Bending modulus and tension of a bilayer, fitted by :func:`bending_modulus`; called with wave numbers q, it returns the fit.

    Attributes
    ----------
    kappa : openmm_dpd.base.stats.Average
        Bending modulus, kJ/mol, with its error from blocks of frames.
    tension : openmm_dpd.base.stats.Average
        Tension, kJ/mol/nm^2; without an error if it was prescribed.
    kT : float
        Thermal energy, kJ/mol.
    """

    kappa: Average
    tension: Average
    kT: float

    def __call__(self, q) -> np.ndarray:
        """Fitted spectrum A <|h_q|^2>, nm^4, at wave numbers q, 1/nm."""
        q = np.asarray(q, dtype=np.float64)
        return self.kT / (self.kappa.mean * q**4 + self.tension.mean * q**2)


def height_spectrum(trajectory: Trajectories, heads: Beads, tails: Beads, *, q_max, axis: str | int = "z") -> HeightSpectrum:
    r"""Spectrum of the height fluctuations of a flat bilayer, A <|h_q|^2>.

    .. math:: h(\mathbf r) = \sum_{\mathbf q} h_{\mathbf q} e^{i \mathbf q \cdot \mathbf r}

    is the surface between the two leaflets.  A lipid whose heads are above its tails belongs to the upper leaflet, however far the bilayer
    undulates.  For each leaflet, the head heights (one point per lipid) are fitted with the waves up to q_max by least squares; h is the
    mean of the two.  Scatter around the fit (protruding lipids, waves beyond q_max) adds to |h_q|^2 as much as it adds to the variance of
    the coefficients; this share is subtracted.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        A periodic box, which may change, with one edge normal to the other two.  The bilayer may cross the boundary and drift.
    heads, tails : str, sequence of str, or array of int
        Beads at the outer and inner end of each lipid.  Every molecule that has heads needs tails, and vice versa.
    q_max : 1/length
        Largest wave number.  Helfrich's theory holds for waves longer than the bilayer is thick, about 2 pi/q > 2 D.
    axis : {"z", "y", "x"} or int
        Normal of the bilayer.

    Raises
    ------
    ParameterError
        If the box is missing or tilted, no wave is below q_max, or there are too few lipids in a leaflet to determine all waves.

    Notes
    -----
    A fit needs no grid, so there are no empty cells and no smoothing.  It avoids the noise of the direct sum over lipids: E. G. Brandt,
    A. R. Braun, J. N. Sachs, J. F. Nagle and O. Edholm, Biophys. J. 100, 2104 (2011).
    """
    topology, frames = frames_of(trajectory)
    lipids = _Lipids.of(molecule_labels(topology), selected(topology, heads, "heads"), selected(topology, tails, "tails"))
    k, largest = axis_number(axis), positive_number(to_md(q_max, "inverse_length", "q_max"), "q_max")
    across = [other for other in range(3) if other != k]
    waves, numbers, powers, noises = None, [], [], []
    for frame in frames:
        box = frame.need_box("a height spectrum")
        if np.abs(box[across] @ box[k]).max() > 1e-6 * np.linalg.det(box) ** (2 / 3):
            raise ParameterError(f"edge {'xyz'[k]} of the box must be normal to the other two; check axis")
        reciprocal = 2 * np.pi * np.linalg.inv(box)[:, across]
        if waves is None:
            waves = _waves(reciprocal, largest)
        square, noise = _squared_heights(*lipids.points(frame, k, across), waves)
        area = np.linalg.det(box) / widths(box)[k]
        numbers.append(np.linalg.norm(reciprocal @ waves.T, axis=0))
        powers.append(area * (square - noise))
        noises.append(area * noise)
    q = np.mean(numbers, axis=0)
    order = np.argsort(q, kind="stable")
    return HeightSpectrum(q[order], np.array(powers)[:, order], np.mean(noises, axis=0)[order])


@dataclass(frozen=True, eq=False)
class _Lipids:
    """Head and tail beads with the number of the lipid (0 to count - 1) that each is in, and one bead of each lipid."""

    heads: np.ndarray
    tails: np.ndarray
    of_head: np.ndarray
    of_tail: np.ndarray
    first: np.ndarray

    @classmethod
    def of(cls, labels: np.ndarray, heads: np.ndarray, tails: np.ndarray) -> _Lipids:
        names, first, of_head = np.unique(labels[heads], return_index=True, return_inverse=True)
        if not np.array_equal(names, np.unique(labels[tails])):
            one = np.setxor1d(names, labels[tails])[0]
            bead = np.flatnonzero(labels == one)[0]
            raise ParameterError(f"the molecule of bead {bead} has only heads or only tails; every lipid needs both")
        return cls(heads, tails, of_head, np.searchsorted(names, labels[tails]), heads[first])

    def points(self, frame: Frame, k: int, across: list[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of each lipid's heads: place in the plane, (M, 2), in fractions of the box; height, nm; and whether they are above the tails."""
        s = frame.fractions("a height spectrum")
        start = s[self.first]

        def centre(beads: np.ndarray, lipid: np.ndarray) -> np.ndarray:
            d = s[beads] - start[lipid]
            return means_over(lipid, None, d - np.round(d))

        head, tail = centre(self.heads, self.of_head), centre(self.tails, self.of_tail)
        height = (start + head)[:, k] - periodic_centre(s[self.tails, k], np.ones(len(self.tails)))
        height = (height - np.round(height)) * widths(frame.need_box("a height spectrum"))[k]
        return (start + head)[:, across], height, head[:, k] > tail[:, k]


def _waves(reciprocal: np.ndarray, largest: float) -> np.ndarray:
    """Integers (K, 2) of all waves up to a wave number, one of each pair n, -n."""
    # |n_i| <= |q| |a_i|/(2 pi); the edges a_i/(2 pi) of the box are the rows of the pseudo-inverse
    reach = np.floor(largest * np.linalg.norm(np.linalg.pinv(reciprocal), axis=1) * (1 + 1e-9)).astype(int)
    n = np.stack(np.meshgrid(*[np.arange(-r, r + 1) for r in reach], indexing="ij"), axis=-1).reshape(-1, 2)
    n = n[(n[:, 0] > 0) | ((n[:, 0] == 0) & (n[:, 1] > 0))]
    used = np.linalg.norm(reciprocal @ n.T, axis=0) <= largest * (1 + 1e-9)
    if not used.any():
        least = np.linalg.norm(reciprocal, axis=0).min()
        raise ParameterError(f"q_max is {largest:g}/nm, below the shortest wave vector of this box, {least:g}/nm; take a larger one")
    return n[used]


def _squared_heights(place: np.ndarray, height: np.ndarray, upper: np.ndarray, waves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """|h_q|^2 of the mean of the two leaflets, (K,), and the share in it of the scatter around the fit, (K,)."""
    coefficients, noise = np.zeros((2, len(waves))), np.zeros(len(waves))
    for leaflet in (upper, ~upper):
        unknown, points = 1 + 2 * len(waves), int(leaflet.sum())
        if points < 2 * unknown:
            raise ParameterError(
                f"a leaflet of {points} lipids does not determine {len(waves)} waves; take a smaller q_max (or check heads, tails, axis)"
            )
        phase = 2 * np.pi * place[leaflet] @ waves.T
        design = np.column_stack([np.ones(points), np.cos(phase), np.sin(phase)])
        inverse = np.linalg.inv(design.T @ design)
        fit = inverse @ (design.T @ height[leaflet])
        scatter = np.sum((height[leaflet] - design @ fit) ** 2) / (points - unknown)
        coefficients += fit[1:].reshape(2, -1) / 2
        noise += scatter * np.diag(inverse)[1:].reshape(2, -1).sum(axis=0) / 4
    # h_q = (a - ib)/2 for a cos + b sin
    return np.sum(coefficients**2, axis=0) / 4, noise / 4


def bending_modulus(spectrum: HeightSpectrum, kT, *, q_max=None, tension=None) -> BendingModulus:
    r"""Bending modulus and tension of a bilayer from the spectrum of its height fluctuations.

    .. math:: A \langle |h_q|^2 \rangle = \frac{k_B T}{\kappa q^4 + \sigma q^2}

    is fitted by maximum likelihood for Gaussian amplitudes, whose squares are distributed exponentially.  So each wave counts by its
    relative deviation, with a weight that falls with its share of noise.  Each wave's contribution to the result has its own error from
    :func:`openmm_dpd.base.stats.block_average`; the squares of these errors add up, since the waves are independent.

    Parameters
    ----------
    spectrum : HeightSpectrum
    kT : energy or temperature
        Thermal energy; a bare number is in kJ/mol.
    q_max : 1/length, optional
        Largest wave number of the fit; by default that of the spectrum.  Check how the result depends on it: for waves about as short as
        the bilayer is thick, lipids tilt, and the fluctuations exceed the formula.
    tension : energy/area, optional
        sigma, if known, such as 0 for a bilayer under a barostat; a bare number is in kJ/mol/nm^2.  Fitted by default.

    Raises
    ------
    ParameterError
        If there are fewer distinct wave numbers than unknowns, or no positive spectrum fits.

    References
    ----------
    W. Helfrich, Z. Naturforsch. C 28, 693 (1973); R. Goetz, G. Gompper and R. Lipowsky, Phys. Rev. Lett. 82, 221 (1999).
    """
    if not isinstance(spectrum, HeightSpectrum):
        raise ParameterError(f"spectrum must be a HeightSpectrum, from height_spectrum(), not {type(spectrum).__name__}")
    energy = positive_number(thermal_energy(kT), "kT")
    known = None if tension is None else md_tension(tension)
    largest = np.inf if q_max is None else positive_number(to_md(q_max, "inverse_length", "q_max"), "q_max")
    used = spectrum.q <= largest * (1 + 1e-9)
    q, power = spectrum.q[used], spectrum.power[:, used] / energy
    unknown = 2 if known is None else 1
    if len(np.unique(np.round(q, 6))) < unknown:
        raise ParameterError(
            f"{unknown} unknowns need at least as many distinct wave numbers; there are too few up to {largest:g}/nm, take a larger q_max"
        )
    mean, noise = power.mean(axis=0), spectrum.noise[used] / energy
    # units in which both unknowns are of order 1
    unit_kappa = len(q) / np.sum(mean * q**4)
    if not unit_kappa > 0:
        raise ParameterError("the height spectrum is not positive; are these frames a bilayer across the axis?")
    units = unit_kappa * np.array([1.0, np.mean(q) ** 2])[:unknown]
    columns = np.array([q**4, q**2])[:unknown] * units[:, None]
    offset = np.zeros(len(q)) if known is None else known * q**2
    weights = np.ones(len(q))
    for _ in range(_WEIGHINGS):
        found = _most_likely(columns, offset, mean, weights)
        fit = 1 / (found @ columns + offset)
        weights, used_weights = (fit / (fit + noise)) ** 2, weights
    hessian = (columns * used_weights * fit**2) @ columns.T
    shares = units[:, None] * np.linalg.solve(hessian, columns) * used_weights
    kappa, *fitted = [_sum_of_waves(value, (fit - power) * share) for value, share in zip(units * found, shares, strict=True)]
    return BendingModulus(kappa, fitted[0] if known is None else Average(known, None, 0, None), energy)


def _sum_of_waves(value: float, series: np.ndarray) -> Average:
    """A result with the error of the waves' contributions (F, K) to it.  Errors are taken wave by wave, since in a sum the many fast, short
    waves would hide how slow the long ones are; waves move independently, so the squares add up."""
    waves = [block_average(column, name="a wave of the bilayer") for column in series.T]
    if waves[0].sem is None:
        return Average(value, None, 0, None)
    square, variance = sum(wave.sem**2 for wave in waves), series.var(axis=0, ddof=1).sum()  # type: ignore[operator,misc]
    tau = 0.5 * len(series) * square / variance if variance else None
    return Average(value, square**0.5, min(wave.n_blocks for wave in waves), tau, tau is None or long_enough(len(series), tau))


def _most_likely(columns: np.ndarray, offset: np.ndarray, mean: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Maximum-likelihood unknowns c of exponential variables with expectation 1/s, s = c . columns + offset > 0, given their means."""

    def cost(c):
        s = c @ columns + offset
        return np.sum(weights * (mean * s - np.log(s))) if np.all(s > 0) else np.inf

    def gradient(c):
        return columns @ (weights * (mean - 1 / (c @ columns + offset)))

    def hessian(c):
        return (columns * weights / (c @ columns + offset) ** 2) @ columns.T

    start = np.zeros(len(columns))
    # a start at which s > 0 for any offset
    start[0] = 1.0 + max(0.0, float(np.max(-offset / columns[0])))
    done = scipy.optimize.minimize(cost, start, jac=gradient, hess=hessian, method="trust-exact", options={"gtol": 1e-9})
    if not np.linalg.norm(gradient(done.x)) < 1e-6 * np.linalg.norm(columns @ (weights * np.abs(mean))):
        raise ParameterError(f"no bending modulus fits this spectrum: {done.message}")
    return done.x
