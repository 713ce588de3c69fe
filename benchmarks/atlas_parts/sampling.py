"""What a run says: one row of numbers per sample, then averages with standard errors. The same for every method.

Everything is computed from positions and velocities by :class:`openmm_dpd.Observer`, whoever made them; only internal temperatures and the
conserved energy come from the run itself.
"""

from __future__ import annotations

import numpy as np
from numba import njit

import openmm_dpd as dpd
from openmm_dpd.measure import Sample
from openmm_dpd.stats import Average, block_average, ratio_average

#: Bins and range of g(r) in cutoffs, and the number of blocks its error is taken from.
BINS, REACH, BLOCKS = 40, 2.0, 10


class Series:
    """Collects samples of one run.

    Parameters
    ----------
    edges : (3,) array
        Edges of the box.
    range_of_pairs : float
        Cutoff of the fluid: g(r) is taken up to twice this.
    """

    def __init__(self, edges: np.ndarray, range_of_pairs: float):
        self.edges, self.width = np.asarray(edges, float), REACH * range_of_pairs / BINS
        self.rows: list[tuple] = []
        self.paths: list[np.ndarray] = []
        self.counts: list[np.ndarray] = []
        self._last: np.ndarray | None = None
        self._unwrapped = np.zeros(0)

    def add(self, sample: Sample, x: np.ndarray, time: float, theta: float | None, total: float | None) -> None:
        """Take one sample at positions x; theta and total are those of the run (None where there are none)."""
        n = sample.n_mobile
        conf = (sample.gradient2, sample.laplacian) if sample.laplacian else (np.nan, np.nan)
        self.rows.append((time, sample.kT, sample.potential / n, sample.pressure(full=False), *conf, theta or np.nan, total or np.nan))
        if self._last is None:
            self._unwrapped = x.copy()
        else:
            step = x - self._last
            self._unwrapped += step - self.edges * np.rint(step / self.edges)
        self._last = x.copy()
        self.paths.append(self._unwrapped.astype(np.float32))
        if len(self.rows) % 4 == 0:
            self.counts.append(histogram(x, self.edges, self.width, BINS))

    def report(self, lags: tuple[float, float]) -> dict:
        """Averages, each [mean, standard error]; g(r) in blocks; the energy's drift."""
        time, kT, potential, pressure, gradient2, laplacian, theta, total = np.array(self.rows).T
        found = {"T_kin": _pair(block_average(kT)), "U": _pair(block_average(potential)), "P": _pair(block_average(pressure))}
        if np.all(np.isfinite(laplacian)):
            found["T_conf"] = _pair(ratio_average(gradient2, laplacian))
        if np.all(np.isfinite(theta)):
            found["theta"] = _pair(block_average(theta))
        if np.all(np.isfinite(total)) and len(total) > 2:
            found["drift"] = list(slope(time, total))
        if len(time) > 1:
            found["D"] = self.diffusion(float(np.diff(time).mean()), lags)
        if len(self.counts) >= BLOCKS:
            found["g"] = [np.round(block.mean(axis=0), 5).tolist() for block in np.array_split(self._g(), BLOCKS)]
        return found | {"samples": len(time)}

    def _g(self) -> np.ndarray:
        counts = np.array(self.counts, float)
        n, r = len(self.paths[0]), self.width * np.arange(BINS + 1)
        return counts / (0.5 * n * (n - 1) * 4 / 3 * np.pi * np.diff(r**3) / np.prod(self.edges))

    def diffusion(self, interval: float, lags: tuple[float, float]) -> list | None:
        """D = (msd(t2) - msd(t1))/(6 (t2 - t1)) over all origins; None if the run is too short."""
        first, second = (max(1, round(lag / interval)) for lag in lags)
        paths = np.array(self.paths)
        if second <= first or len(paths) < second + 10:
            return None
        origins = range(len(paths) - second)
        msd = [[float(np.mean(np.sum((paths[k + lag] - paths[k]) ** 2, axis=1))) for k in origins] for lag in (first, second)]
        return _pair(block_average((np.array(msd[1]) - np.array(msd[0])) / (6 * interval * (second - first))))


def _pair(average: Average) -> list:
    return [average.mean, average.sem]


def slope(times: np.ndarray, energies: np.ndarray, pieces: int = 8) -> tuple[float, float | None]:
    """Slope of a straight line through the energy, relative to it and per time, with a standard error from pieces of the run.

    With noise the energy makes a random walk: the slopes of the pieces are independent measurements of the drift.
    """
    fit = np.polyfit(times, energies, 1)[0] / energies[0]
    pieces = min(pieces, len(times) // 3)
    if pieces < 2:
        return float(fit), None
    parts = zip(np.array_split(times, pieces), np.array_split(energies, pieces), strict=True)
    slopes = [np.polyfit(t, e, 1)[0] / energies[0] for t, e in parts]
    return float(fit), float(np.std(slopes, ddof=1) / pieces**0.5)


@njit(cache=True)
def histogram(x, edges, width, bins):
    """Numbers of pairs by distance, all pairs of a rectangular periodic box."""
    counts = np.zeros(bins, np.int64)
    reach = (width * bins) ** 2
    for i in range(len(x) - 1):
        for j in range(i + 1, len(x)):
            square = 0.0
            for k in range(3):
                d = x[i, k] - x[j, k]
                d -= edges[k] * np.rint(d / edges[k])
                square += d * d
            if square < reach:
                counts[int(np.sqrt(square) / width)] += 1
    return counts


class Measurer:
    """Samples of configurations that somebody else made.

    Parameters
    ----------
    scene : Scene
        The fluid.
    """

    def __init__(self, scene: dpd.Scene):
        # the scheme does not matter: nothing is stepped, and only conservative terms are asked for
        built = dpd.build(scene, dt=1e-3, scheme="mvv", platform="CPU", seed=1)
        self.context, self.observer = built.simulation(properties={"Threads": "1"}).context, dpd.Observer(built)

    def __call__(self, x: np.ndarray, v: np.ndarray) -> Sample:
        self.context.setPositions(x)
        self.context.setVelocities(v)
        return self.observer.sample(self.context)
