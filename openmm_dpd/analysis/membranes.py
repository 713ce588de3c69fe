"""Flat bilayers: thickness, area per lipid, height fluctuations and the bending modulus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..base.errors import ParameterError, what_is
from ..base.geometry import widths
from ..base.stats import Average, block_average, long_enough
from ..base.units import md_tension, thermal_energy, to_md
from .curves import Curve, curve_of
from .frames import Frame, axis_number, frames_of, positive_number, selected, weights_of
from .profiles import periodic_centre
from .unwrapping import means_over, molecule_labels

if TYPE_CHECKING:
    from .frames import Beads, Trajectories

#: Fits of a spectrum with weights from the one before; the first counts all waves alike, and the third moves nothing that matters.
_WEIGHINGS = 4


def bilayer_thickness(trajectory: Trajectories, heads: Beads, tails: Beads = None, *, axis: str | int = "z") -> Average:
    r"""Distance between the head groups of the two leaflets of a flat bilayer, D = <z>_upper - <z>_lower.

    Heads above the centre of mass of the bilayer are the upper leaflet, the others the lower one; in every frame their mean heights are
    subtracted.  For symmetric peaks this is the distance between the peaks of the density profile of the heads.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any periodic box.  The bilayer may cross the boundary and drift.
    heads : str, sequence of str, or array of int
        Beads of the head groups.
    tails : str, sequence of str, array of int, or None
        Beads whose centre of mass is the middle of the bilayer; the heads by default.  Needed if the layer of solvent is about as thick as
        the bilayer, because the heads alone do not show which side of them is inside.
    axis : {"z", "y", "x"} or int
        Box vector across the bilayer; heights are measured normal to the plane of the two others.

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
            raise ParameterError("all heads are on one side of the middle of the bilayer; check heads, tails and axis")
        values.append((height[upper].mean() - height[~upper].mean()) * widths(frame.need_box("a bilayer thickness"))[k])
    return block_average(values, name="the thickness")


def area_per_lipid(trajectory: Trajectories, lipids: Beads | int, *, axis: str | int = "z") -> Average:
    r"""Area of the box across an axis for each lipid of one leaflet, a = A/(N/2).

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
        Mean over frames (nm^2) with its standard error, which is 0 if the box does not change.

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
        Wave numbers of the box, 1/nm, rising: one of each pair q, -q.  Means over the frames, if the box changes.
    power : (F, K) array
        A |h_q|^2 of each frame, nm^4.
    noise : (K,) array
        What was taken off A |h_q|^2 because lipids scatter around the surface, mean over the frames, nm^4.
    """

    q: np.ndarray
    power: np.ndarray
    noise: np.ndarray

    @property
    def curve(self) -> Curve:
        """Means over the frames with standard errors; x: q, y: A <|h_q|^2>."""
        return curve_of(self.q, list(self.power), name="the height spectrum")


@dataclass(frozen=True, eq=False)
class BendingModulus:
    """Result of :func:`bending_modulus`.

    Attributes
    ----------
    kappa : openmm_dpd.base.stats.Average
        Bending modulus, kJ/mol, with its error from blocks of frames.
    tension : openmm_dpd.base.stats.Average
        Tension, kJ/mol/nm^2; without an error if it was given.
    kT : float
        Thermal energy, kJ/mol.
    """

    kappa: Average
    tension: Average
    kT: float

    def __call__(self, q) -> np.ndarray:
        """A <|h_q|^2> of the fit at wave numbers q."""
        q = np.asarray(q, dtype=np.float64)
        return self.kT / (self.kappa.mean * q**4 + self.tension.mean * q**2)


def height_spectrum(trajectory: Trajectories, heads: Beads, tails: Beads, *, q_max, axis: str | int = "z") -> HeightSpectrum:
    r"""Spectrum of the height fluctuations of a flat bilayer, A <|h_q|^2>.

    .. math:: h(\mathbf r) = \sum_{\mathbf q} h_{\mathbf q} e^{i \mathbf q \cdot \mathbf r}

    is the surface between the two leaflets.  A lipid whose heads are above its tails is in the upper leaflet, so leaflets are distinguished
    however far the bilayer undulates.  The heights of the heads of each leaflet, one point for each lipid, are fitted by the waves up to
    q_max (least squares), and h is the mean of both.  What scatters around the fit, lipids that stick out and waves beyond q_max, adds to
    |h_q|^2 as much as it adds to the variance of the coefficients; that is taken off.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        A periodic box with one edge normal to the two others, which may change.  The bilayer may cross the boundary and drift.
    heads, tails : str, sequence of str, or array of int
        Beads of each lipid on its outer and its inner end.  Every molecule that has some of either needs some of both.
    q_max : 1/length
        Largest wave number.  Helfrich's theory holds where waves are longer than the bilayer is thick, 2 pi/q > 2 D or so.
    axis : {"z", "y", "x"} or int
        Normal of the bilayer.

    Raises
    ------
    ParameterError
        If there is no box or a tilted one, no wave fits below q_max, or so many do that the lipids of a leaflet do not determine them.

    Notes
    -----
    A fit needs no grid, hence neither empty cells nor smoothing; for the direct sum over lipids, whose noise it avoids, see E. G. Brandt,
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
            raise ParameterError(f"edge {'xyz'[k]} of the box must be normal to the two others")
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
            raise ParameterError(f"the molecule of bead {bead} has heads or tails alone; every lipid needs both")
        return cls(heads, tails, of_head, np.searchsorted(names, labels[tails]), heads[first])

    def points(self, frame: Frame, k: int, across: list[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Place of each lipid's heads across the axis (fractions of the box), their height (nm), and whether they are above the tails."""
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
    """Pairs of integers, (K, 2), of the waves up to a wave number, one of each pair n, -n."""
    # |n_i| <= |q| |a_i|/(2 pi), with the edges a_i of the box, whose matrix is the pseudo-inverse
    reach = np.floor(largest * np.linalg.norm(np.linalg.pinv(reciprocal), axis=1) * (1 + 1e-9)).astype(int)
    n = np.stack(np.meshgrid(*[np.arange(-r, r + 1) for r in reach], indexing="ij"), axis=-1).reshape(-1, 2)
    n = n[(n[:, 0] > 0) | ((n[:, 0] == 0) & (n[:, 1] > 0))]
    used = np.linalg.norm(reciprocal @ n.T, axis=0) <= largest * (1 + 1e-9)
    if not used.any():
        least = np.linalg.norm(reciprocal, axis=0).min()
        raise ParameterError(f"q_max is {largest:g}/nm, below the shortest wave vector of this box, {least:g}/nm")
    return n[used]


def _squared_heights(place: np.ndarray, height: np.ndarray, upper: np.ndarray, waves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """|h_q|^2 of the mean of both leaflets, (K,), and the share that the scatter around it has in that."""
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
    r"""Bending modulus of a bilayer, and its tension, from the spectrum of its height fluctuations.

    .. math:: A \langle |h_q|^2 \rangle = \frac{k_B T}{\kappa q^4 + \sigma q^2}

    is fitted by the most likely kappa and sigma for Gaussian amplitudes, whose squares are distributed exponentially: every wave counts
    by its relative deviation, and the less the more of it was noise.  Errors are those of :func:`openmm_dpd.base.stats.block_average` for
    what each wave contributes to the result, added up as those of independent waves.

    Parameters
    ----------
    spectrum : HeightSpectrum
    kT : energy or temperature
        Thermal energy.
    q_max : 1/length, optional
        Largest wave number of the fit; by default all of the spectrum.  Look how the result depends on it: where waves are about as short
        as the bilayer is thick, lipids tilt, and the fluctuations are larger than the formula says.
    tension : energy/area, optional
        sigma, if it is known, such as 0 of a bilayer under a barostat; bare numbers: kJ/mol/nm^2.  By default it is fitted.

    Raises
    ------
    ParameterError
        If there are fewer different wave numbers than unknowns, or no positive spectrum fits.

    References
    ----------
    W. Helfrich, Z. Naturforsch. C 28, 693 (1973); R. Goetz, G. Gompper and R. Lipowsky, Phys. Rev. Lett. 82, 221 (1999).
    """
    if not isinstance(spectrum, HeightSpectrum):
        raise ParameterError("a bending modulus is fitted to what height_spectrum() returned")
    energy = positive_number(thermal_energy(kT), "kT")
    known = None if tension is None else md_tension(tension)
    largest = np.inf if q_max is None else positive_number(to_md(q_max, "inverse_length", "q_max"), "q_max")
    used = spectrum.q <= largest * (1 + 1e-9)
    q, power = spectrum.q[used], spectrum.power[:, used] / energy
    unknown = 2 if known is None else 1
    if len(np.unique(np.round(q, 6))) < unknown:
        raise ParameterError(
            f"{unknown} unknowns need at least as many different wave numbers; there are too few of them up to {largest:g}"
        )
    mean, noise = power.mean(axis=0), spectrum.noise[used] / energy
    # in units that make both unknowns of order 1
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
    """A result to which each wave adds a series (F, K), with its error: wave by wave, since the many short waves, which are fast, would
    hide in a sum how slow the long ones are; waves move independently."""
    waves = [block_average(column, name="a wave of the bilayer") for column in series.T]
    if waves[0].sem is None:
        return Average(value, None, 0, None)
    square, variance = sum(wave.sem**2 for wave in waves), series.var(axis=0, ddof=1).sum()  # type: ignore[operator,misc]
    tau = 0.5 * len(series) * square / variance if variance else None
    return Average(value, square**0.5, min(wave.n_blocks for wave in waves), tau, tau is None or long_enough(len(series), tau))


def _most_likely(columns: np.ndarray, offset: np.ndarray, mean: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Unknowns c for which exponential variables of means 1/s, with s = c . columns + offset > 0, are most likely to have these means."""

    def cost(c):
        s = c @ columns + offset
        return np.sum(weights * (mean * s - np.log(s))) if np.all(s > 0) else np.inf

    def gradient(c):
        return columns @ (weights * (mean - 1 / (c @ columns + offset)))

    def hessian(c):
        return (columns * weights / (c @ columns + offset) ** 2) @ columns.T

    start = np.zeros(len(columns))
    # positive for any offset
    start[0] = 1.0 + max(0.0, float(np.max(-offset / columns[0])))
    done = scipy.optimize.minimize(cost, start, jac=gradient, hess=hessian, method="trust-exact", options={"gtol": 1e-9})
    if not np.linalg.norm(gradient(done.x)) < 1e-6 * np.linalg.norm(columns @ (weights * np.abs(mean))):
        raise ParameterError(f"no bending modulus fits this spectrum: {done.message}")
    return done.x
