"""Rigid bodies: beads that move and turn together."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import ParameterError, bead_names, bead_number, what_is
from ..base.geometry import weighted_sum
from ..base.units import keep

#: Part of its size by which the beads of a body may be off a line that count as in line.
_THIN = 1e-6


@dataclass(frozen=True, eq=False)
class Body:
    """Beads that move together as a rigid body, in the shape that they have in the scene.

    The body moves and turns under the sum of the forces on its beads, with their masses; friction and noise act at its beads with the
    mass that the body has there.  See :doc:`/theory_bodies` for the equations.

    Parameters
    ----------
    beads : sequence of int
        Indices of at least two beads, whole: not on two sides of a periodic box.
    moves : str, default "xyz"
        Axes along which its centre moves; along the others it is held where it is.
    turns : bool, default True
        Whether it turns.
    inner : bool, default False
        Whether pair terms between its own beads count in energies.  They have no effect on its motion.

    Raises
    ------
    ParameterError
        If the beads are no body.

    Examples
    --------
    >>> import openmm_dpd as dpd
    >>> rods = [dpd.Body(range(start, start + 5)) for start in range(0, 50, 5)]
    """

    beads: np.ndarray
    moves: str = "xyz"
    turns: bool = True
    inner: bool = False

    def __post_init__(self):
        beads = np.asarray(list(self.beads) if isinstance(self.beads, Iterable) else self.beads)
        if beads.ndim != 1 or not np.issubdtype(beads.dtype, np.integer) or len(beads) < 2:
            raise ParameterError(f"a body needs the indices of at least two beads, not {what_is(self.beads)}")
        if len(np.unique(beads)) < len(beads) or beads.min() < 0:
            raise ParameterError(f"the beads of a body must be different ones, counted from 0, not {what_is(self.beads)}")
        if not isinstance(self.moves, str) or set(self.moves) - set("xyz"):
            raise ParameterError(f"a body moves along axes such as 'xyz' or 'xy', or '' for none, not {what_is(self.moves)}")
        keep(self, beads=beads.astype(np.int64), turns=bool(self.turns), inner=bool(self.inner))


@dataclass(frozen=True, eq=False)
class GivenBody(Body):
    """A body of which more is known than its beads: they may overlap in a solid, and only show how it moves.  Decks make it.

    Parameters
    ----------
    mass : float
        Of the body, Da.
    centre : (3,) array
        Its centre of mass, nm, where its beads are in the scene.
    inertia : (3, 3) array
        Tensor of inertia about it, Da nm^2.
    """

    mass: float = 0.0
    centre: np.ndarray | tuple[float, ...] = ()
    inertia: np.ndarray | tuple[float, ...] = ()

    def __post_init__(self):
        super().__post_init__()
        keep(self, centre=np.asarray(self.centre, dtype=float), inertia=np.asarray(self.inertia, dtype=float))
        moments, _ = _diagonalised(np.asarray(self.inertia))
        if not self.mass > 0.0 or not moments.min() >= -1e-9 * moments.max() or 2.0 * moments.max() > moments.sum() * (1 + 1e-6):
            found = f"{self.mass:g} and {', '.join(f'{moment:g}' for moment in moments)}"
            raise ParameterError(f"a body has a mass > 0 and moments of inertia >= 0, none above the sum of the others, not {found}")


class Shape(NamedTuple):
    """A body about its centre of mass.  The first two of its principal axes have the most similar moments of inertia."""

    body: Body
    mass: np.ndarray  #: (M,) masses of its beads, Da
    places: np.ndarray  #: (M, 3) places of its beads along its principal axes, nm
    moments: np.ndarray  #: (3,) moments of inertia, Da nm^2; the third is 0 for beads in line
    given: float | None = None  #: Mass of the body if it is not that of its beads

    @property
    def in_line(self) -> bool:
        """Whether its beads are in line."""
        return self.moments[2] == 0.0

    @property
    def freedom(self) -> int:
        """Number of degrees of freedom."""
        return len(set(self.body.moves)) + (3 - self.in_line) * self.body.turns


def shape_of(body: Body, positions: np.ndarray, masses: np.ndarray) -> Shape:
    """The shape of a body from the positions (N, 3) and masses (N,) of all beads; ParameterError if all of its beads are at one place."""
    mass, x = masses[body.beads], positions[body.beads]
    centre = x[0] + weighted_sum(mass, x - x[0]) / mass.sum()
    r = x - centre
    size2 = float(np.max(np.sum(r * r, axis=1)))
    if not size2 > 0.0:
        raise ParameterError(f"all beads of the body of {bead_names(*body.beads[:2])} are at one place")
    squares = np.array([[weighted_sum(mass, (r[:, a] * r[:, b])[:, None])[0] for b in range(3)] for a in range(3)])
    moments, axes = _diagonalised(squares)
    moments = moments.sum() - moments  # about each axis, from sums of squares along it
    third = int(np.argmin(moments))
    in_line, given = bool(moments[third] <= _THIN**2 * mass.sum() * size2), None
    if isinstance(body, GivenBody):
        r, given, line = x - body.centre, body.mass, axes[:, third]
        moments, axes = _diagonalised(np.asarray(body.inertia))
        third = int(np.argmax(np.abs(line @ axes)))
        across = [moments[third - 1], moments[third - 2]]
        name = bead_names(*body.beads[:2])
        if in_line and (np.ptp(across) > 1e-6 * max(across) or np.abs(np.cross(r, axes[:, third])).max() > _THIN * np.sqrt(size2)):
            raise ParameterError(f"the beads of the body of {name} are in line: its centre must be there, and its moments across alike")
        if not in_line and moments.min() < 1e-7 * moments.max():
            raise ParameterError(f"the beads of the body of {name} are not in line: none of its moments of inertia is 0")
    if not in_line:
        third = int(np.argmin([abs(1.0 / moments[(k + 1) % 3] - 1.0 / moments[(k + 2) % 3]) for k in range(3)]))
    order = [(third + 1) % 3, (third + 2) % 3, third]
    axes = axes[:, order]
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    places = np.stack([np.sum(r * axes[:, k], axis=1) for k in range(3)], axis=1)
    if in_line:
        moments[third], places[:, :2] = 0.0, 0.0
    return Shape(body, mass, places, moments[order], given)


def _diagonalised(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (3,) and eigenvectors, as columns, of a symmetric matrix, by Jacobi's rotations: with the same bits on all machines."""
    a, vectors = matrix.copy(), np.eye(3)
    for _ in range(30):
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if abs(a[p, q]) <= 1e-17 * abs(np.trace(a)):
                continue
            ratio = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
            t = (1.0 if ratio >= 0.0 else -1.0) / (abs(ratio) + np.sqrt(1.0 + ratio * ratio))
            c = 1.0 / np.sqrt(1.0 + t * t)
            for rows in (a, a.T, vectors):
                rows[:, p], rows[:, q] = c * rows[:, p] - t * c * rows[:, q], t * c * rows[:, p] + c * rows[:, q]
    return np.diagonal(a).copy(), vectors


def check_bodies(bodies: Sequence[Body], scene: Any) -> tuple[Shape, ...]:
    """The shapes of the bodies of a scene; ParameterError if they cannot be those of the scene, with the reason."""
    owner = np.full(scene.n_beads, -1)
    for number, body in enumerate(bodies):
        if body.beads.max() >= scene.n_beads:
            raise ParameterError(f"body {number} has bead {body.beads.max()}, but there are {scene.n_beads}")
        twice, still = owner[body.beads] >= 0, scene.immobile[body.beads]
        if twice.any():
            raise ParameterError(f"bead {bead_number(body.beads[np.argmax(twice)])} is in two bodies")
        if still.any():
            raise ParameterError(
                f"bead {bead_number(body.beads[np.argmax(still)])} of body {number} is immobile; moves='' and turns=False hold a body"
            )
        owner[body.beads] = number
    reasons = {
        "Lees-Edwards shear does not move bodies": scene.shear is not None,
        "walls reflect beads one by one; a force that depends on the position keeps bodies back": bool(scene.walls),
        "beads with energies, temperatures or concentrations are in none": scene.internal is not None,
        "`interacting` takes forces from beads": scene.interacting is not None,
    }
    wrong = next((reason for reason, holds in reasons.items() if holds), None) if bodies else None
    if wrong is not None:
        raise ParameterError(f"rigid bodies are not possible in this scene: {wrong}")
    return tuple(shape_of(body, scene.positions, scene.bead_masses) for body in bodies)
