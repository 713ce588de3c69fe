"""What is measured in the scenes of the suite, from positions, velocities and fields of single moments, whoever made them.

To add a quantity, add a row to :data:`QUANTITIES`; a scene of the suite names those that it is scored by.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ..measure.sample import Sample
from ..model.scene import Scene

#: Time between two samples, and lags of the mean square displacement, in units of the scene (ps).
INTERVAL, LAGS = 0.25, (2.0, 6.0)


@dataclass(frozen=True)
class Instant:
    """One moment of a run: sample, positions, unwrapped positions and velocities (N, 3); where a quantity needs them, the value of each
    bead's field (N,), and the kinetic and conservative part (6,) of the pressure tensor times the volume."""

    scene: Scene
    sample: Sample
    x: np.ndarray
    path: np.ndarray
    v: np.ndarray
    field: np.ndarray | None = None
    stress: np.ndarray | None = None

    @cached_property
    def edges(self) -> np.ndarray:
        """(3,), nm."""
        return np.diag(np.asarray(self.scene.box))

    @cached_property
    def near(self) -> np.ndarray:
        """Numbers of pairs within half of the unit of length, and within it."""
        folded = np.mod(self.x, self.edges)
        folded[folded >= self.edges] = 0.0  # what mod makes of a tiny negative number
        tree = cKDTree(folded, boxsize=self.edges)
        return (tree.count_neighbors(tree, [0.5, 1.0]) - len(self.x)) / 2

    def around(self, low: float, high: float, count: float) -> float:
        """The mean of g(r) in a shell that holds a number of pairs."""
        n = len(self.x)
        return count * 2 * float(np.prod(self.edges)) / (n * (n - 1) * 4 / 3 * np.pi * (high**3 - low**3))


Along = Callable[[list[Instant]], np.ndarray]  #: A series along a run


def _each(value: Callable[[Instant], float]) -> Along:
    return lambda run: np.array([value(moment) for moment in run], float)


def interval(run: list[Instant]) -> float:
    """Time between two moments."""
    return (run[-1].sample.time - run[0].sample.time) / (len(run) - 1)


def _kinetic(moment: Instant) -> float:
    """Along all axes; between walls across the flow only."""
    scene = moment.scene
    if not scene.immobile.any():
        return moment.sample.kT
    free = ~scene.immobile
    return float(np.mean(scene.bead_masses[free, None] * moment.v[free, 1:] ** 2))


def _configurational(run: list[Instant]) -> np.ndarray:
    """A series whose mean is the ratio of the means, and whose scatter is that of the ratio to first order."""
    above, below = (np.array([getattr(moment.sample, name) for moment in run]) for name in ("gradient2", "laplacian"))
    ratio = above.mean() / below.mean()
    return ratio + (above - ratio * below) / below.mean()


def _diffusion(which: Callable[[Scene], np.ndarray]) -> Along:
    """(msd(t2) - msd(t1))/(6 (t2 - t1)) up to each moment, for some of the beads."""

    def series(run: list[Instant]) -> np.ndarray:
        apart = interval(run)
        first, second = (round(lag / apart) for lag in LAGS)
        paths = np.array([moment.path for moment in run])[:, which(run[0].scene)]
        squares = [np.mean(np.sum((paths[lag:] - paths[:-lag]) ** 2, axis=2), axis=1) for lag in (first, second)]
        later = (squares[1] - squares[0][second - first :]) / (6 * (second - first) * apart)
        return np.concatenate([np.full(second, np.nan), later])

    return series


def _drift(run: list[Instant]) -> np.ndarray:
    """Growth of the energy in 1,000 units of time, relative to it: from moment to moment, so that the mean is that of the run."""
    total = np.array([moment.sample.total for moment in run])
    return np.concatenate([[np.nan], np.diff(total) / total[0] * 1000 / interval(run)])


def _bonds(moment: Instant) -> np.ndarray:
    """(B, 3) vectors along the bonds."""
    pairs = moment.scene.bonds[0].beads
    d = moment.path[pairs[:, 1]] - moment.path[pairs[:, 0]]
    return d - moment.edges * np.rint(d / moment.edges)


def _ends(moment: Instant) -> float:
    """Mean square distance of the ends of chains, whose bonds come chain by chain or place by place."""
    pairs, vectors = moment.scene.bonds[0].beads, _bonds(moment)
    chain = np.cumsum(~np.isin(np.arange(len(moment.x)), pairs[:, 1])) - 1
    sums = np.zeros((chain.max() + 1, 3))
    np.add.at(sums, chain[pairs[:, 0]], vectors)
    return float(np.mean(np.sum(sums**2, axis=1)))


def _density(moment: Instant) -> float:
    """In the middle of a slab across z, over 3 of its thickness."""
    height = moment.edges[2]
    turn = 2 * np.pi * moment.x[:, 2] / height
    apart = moment.x[:, 2] - np.angle(np.mean(np.exp(1j * turn))) * height / (2 * np.pi)
    inside = np.abs(apart - height * np.rint(apart / height)) < 1.5
    return float(inside.sum() / (3.0 * np.prod(moment.edges[:2])))


def _tension(moment: Instant) -> float:
    assert moment.stress is not None
    xx, yy, zz = moment.stress[:3] / np.prod(moment.edges)
    return float(0.5 * moment.edges[2] * (zz - 0.5 * (xx + yy)))


def _halves(moment: Instant) -> float:
    """Mean of the first half of the beads less that of the second, relative to the mean of all."""
    assert moment.field is not None
    first, second = np.array_split(moment.field, 2)
    return float((first.mean() - second.mean()) / moment.field.mean())


def _wave(moment: Instant) -> float:
    """Amplitude of the first sine along x."""
    assert moment.field is not None
    sine = np.sin(2 * np.pi * moment.x[:, 0] / moment.edges[0])
    return float(2 * np.mean((moment.field - moment.field.mean()) * sine))


def _layer(moment: Instant) -> float:
    """Beads that move within 0.3 of the places where the walls end, over their mean number: the first layers."""
    free = ~moment.scene.immobile
    y, wall = np.mod(moment.x[free, 1], moment.edges[1]), 1.0
    near = (y < wall + 0.3) | (y > moment.edges[1] - wall - 0.3)
    return float(near.sum() / (0.6 / (moment.edges[1] - 2 * wall) * free.sum()))


def _type(index: int) -> Callable[[Scene], np.ndarray]:
    return lambda scene: scene.type_ids == index


#: Name: what it is called, and its series along a run.  Series may begin with NaN.
QUANTITIES: Mapping[str, tuple[str, Along]] = {
    "T_kin": ("kinetic temperature", _each(_kinetic)),
    "T_conf": ("configurational temperature", _configurational),
    "U": ("potential energy per bead", _each(lambda moment: moment.sample.potential / len(moment.x))),
    "P": ("pressure", _each(lambda moment: float(moment.sample.pressure(full=False) or np.nan))),
    "g_core": ("mean of g(r) below 0.5", _each(lambda moment: moment.around(0.0, 0.5, moment.near[0]))),
    "g_shell": ("mean of g(r) from 0.5 to 1", _each(lambda moment: moment.around(0.5, 1.0, moment.near[1] - moment.near[0]))),
    "D": ("diffusion coefficient", _diffusion(lambda scene: ~scene.immobile)),
    "D_first": ("diffusion coefficient of the first type", _diffusion(_type(0))),
    "D_second": ("diffusion coefficient of the second type", _diffusion(_type(1))),
    "bond": ("mean length of bonds", _each(lambda moment: float(np.mean(np.linalg.norm(_bonds(moment), axis=1))))),
    "R2": ("mean square distance of the ends of chains", _each(_ends)),
    "density": ("density in the middle of the slab", _each(_density)),
    "tension": ("surface tension", _each(_tension)),
    "theta": ("internal temperature", _each(lambda moment: float(moment.sample.theta or np.nan))),
    "drift": ("growth of the energy in 1,000 units of time", _drift),
    "difference": ("temperature of heated less that of cooled beads, over the mean", _each(_halves)),
    "wave": ("amplitude of the concentration along x", _each(_wave)),
    "stress": ("shear stress, kinetic and conservative part", _each(lambda moment: float(-moment.stress[3] / np.prod(moment.edges)))),  # type: ignore[index]
    "flow": ("mean velocity along x of the beads that move", _each(lambda moment: float(moment.v[~moment.scene.immobile, 0].mean()))),
    "layer": ("density beside the walls, relative to the mean", _each(_layer)),
}  # fmt: skip
