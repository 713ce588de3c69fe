"""Flows: forces on single beads, and walls that reflect beads."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from ..base.errors import ParameterError, bead_number, either, in_length, in_number, require, require_one, unit_name, what_is
from ..base.geometry import folded
from ..base.units import keep, to_md
from .formulas import read_formula, values
from .pairs import checked
from .sources import point

AXES = ("x", "y", "z")
#: Variation of a body force along its axis.
PATTERNS = ("uniform", "halves", "sine")
#: Kinds of reflection at walls; "mixed": axes with walls of different kinds.
SPECULAR, BOUNCE_BACK, MIXED = "specular", "bounce-back", "mixed"
KINDS = (SPECULAR, BOUNCE_BACK)
#: Position of a missing wall: far beyond any bead, and finite, so that 0 times it is 0.
NOWHERE = 1e30


class _OnBeads:
    """Base of forces on single beads, selected by bead types (one or more names) and a mask; None means all."""

    types: str | Sequence[str] | None
    beads: np.ndarray | None
    _WHAT: ClassVar[str]

    def _keep_beads(self) -> None:
        """Check ``types`` and ``beads``, and keep them as a tuple and an array."""
        types, beads, what = self.types, self.beads, self._WHAT
        if types is not None:
            types = (types,) if isinstance(types, str) else tuple(types) if isinstance(types, Iterable) else types
            if not isinstance(types, tuple) or not types or not all(isinstance(name, str) for name in types):
                raise ParameterError(f"{what}: types must be the name of a bead type or several, not {what_is(types)}")
        if beads is not None:
            beads = np.asarray(beads)
            if beads.dtype != np.bool_ or beads.ndim != 1:
                raise ParameterError(
                    f"{what}: beads must be one True or False per bead (for indices: numpy.isin(numpy.arange(N), indices))"
                )
        keep(self, types=types, beads=beads)

    def mask(self, scene_types: np.ndarray, type_names: list[str]) -> np.ndarray:
        """(N,) mask of the beads it acts on; ParameterError for an unknown type, a mask of the wrong length, or if it acts on no bead."""
        what, chosen = self._WHAT, np.ones(len(scene_types), bool)
        if self.types is not None:
            unknown = [name for name in self.types if name not in type_names]
            if unknown:
                raise ParameterError(f"{what} names the bead type {what_is(unknown[0])}; the scene has {', '.join(type_names)}")
            chosen &= np.isin(scene_types, [type_names.index(name) for name in self.types])
        if self.beads is not None:
            if self.beads.shape != chosen.shape:
                raise ParameterError(f"{what}: beads must have one entry per bead, {len(chosen)}, not shape {self.beads.shape}")
            chosen &= self.beads
        if not chosen.any():
            raise ParameterError(f"{what} acts on no bead; check its types and beads")
        return chosen


def _axis(value, what: str) -> int:
    if value not in AXES:
        raise ParameterError(f"the axis of {what} must be 'x', 'y' or 'z', not {what_is(value)}")
    return AXES.index(value)


def require_plain_axis(box: np.ndarray | None, axis: str, what: str) -> float | None:
    """Period along an axis, nm, or None without a box; ParameterError if another box vector has a component along the axis."""
    if box is None:
        return None
    k = AXES.index(axis)
    if any(box[other, k] != 0 for other in range(3) if other != k):
        raise ParameterError(f"{what} varies along {axis}, but the box is tilted: another box vector points along {axis} as well; use z")
    return float(box[k, k])


@dataclass(frozen=True, eq=False)
class BodyForce(_OnBeads):
    r"""A force on selected beads, uniform or with a sign or sine along an axis.

    .. math:: \mathbf F_i = s(r_i)\,\mathbf f_i

    with s = 1 (``uniform``), s = +1 in the lower and -1 in the upper half of the box along ``axis`` (``halves``: reverse Poiseuille flow),
    or s = sin(2 pi (r - origin)/L) (``sine``), where positions r are wrapped into the box.

    The box is that of the scene: a pattern does not follow a barostat.  In a periodic box the force has no meaningful potential energy,
    and none is reported; without a box it has one.  With ``halves`` momentum is conserved on average, since the total force is zero if
    both halves contain equal numbers of beads; it fluctuates with the difference.

    Parameters
    ----------
    force : (3,) or (N, 3) array of forces
        Force, kJ/mol/nm: one vector, or one for each bead of the scene.
    types : str or sequence of str, optional
        Bead types it acts on; all by default.
    beads : (N,) array of bool, optional
        Beads it acts on; all by default.
    pattern : {"uniform", "halves", "sine"}
    axis : {"x", "y", "z"}, optional
        Axis of the pattern; required, like a box, unless the force is uniform.
    origin : length, default 0
        Start of the first half, or of the sine.
    """

    force: np.ndarray
    types: str | Sequence[str] | None = None
    beads: np.ndarray | None = None
    pattern: str = "uniform"
    axis: str | None = None
    origin: float = 0.0
    _WHAT = "a body force"

    def __post_init__(self):
        force = np.asarray(to_md(self.force, "force", "a body force"))
        if force.shape != (3,) and not (force.ndim == 2 and force.shape[1] == 3):
            raise ParameterError(f"a body force must be three components, or three for each bead, not an array of shape {force.shape}")
        keep(self, force=force)
        self._keep_beads()
        require_one(self.pattern, PATTERNS, "the pattern of a body force")
        if self.pattern == "uniform" and self.axis is not None:
            raise ParameterError("a uniform body force has no axis; for reverse Poiseuille flow use pattern='halves'")
        if self.pattern != "uniform":
            _axis(self.axis, f"a body force with the pattern {what_is(self.pattern)}")
        keep(self, origin=checked(self.origin, "length", "the origin of a body force", signed=True))

    def vectors(self, type_ids: np.ndarray, type_names: list[str], box: np.ndarray | None) -> np.ndarray:
        """(N, 3) force of each bead without the pattern, kJ/mol/nm; ParameterError if it does not fit the scene."""
        chosen = self.mask(type_ids, type_names)
        if self.force.ndim == 2 and len(self.force) != len(type_ids):
            raise ParameterError(f"a body force has {len(self.force)} vectors, but the scene has {len(type_ids)} beads")
        if self.pattern != "uniform":
            if box is None:
                raise ParameterError(f"a body force with the pattern {what_is(self.pattern)} needs a periodic box")
            require_plain_axis(box, self.axis, "a body force")  # type: ignore[arg-type]
        return np.where(chosen[:, None], np.broadcast_to(self.force, (len(type_ids), 3)), 0.0)

    def __str__(self) -> str:
        components = ", ".join(in_number(component, "force") for component in np.atleast_2d(self.force)[0])
        force = "one vector per bead" if self.force.ndim == 2 else f"({components}) {unit_name('force')}".rstrip()
        where = {"uniform": "", "halves": f", reversed in the upper half along {self.axis}", "sine": f", a sine along {self.axis}"}
        return force + where[self.pattern]


@dataclass(frozen=True, eq=False)
class PositionForce(_OnBeads):
    """A force on single beads, given as formulas of the position wrapped into the box.

    No potential energy is reported for it.

    Parameters
    ----------
    formulas : three texts
        Components in kJ/mol/nm, in OpenMM's expression language, as functions of ``x``, ``y`` and ``z`` in nm:
        ``("0.1*sin(z)", "0", "0")``.
    types, beads : as in :class:`BodyForce`
    corner : three lengths, default (0, 0, 0)
        Lower corner of the box that positions are wrapped into.
    """

    formulas: tuple[str, str, str]
    types: str | Sequence[str] | None = None
    beads: np.ndarray | None = None
    corner: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    _WHAT = "a position force"

    def __post_init__(self):
        formulas = self.formulas
        if (
            not isinstance(formulas, (tuple, list))
            or len(formulas) != 3
            or not all(isinstance(text, str) and text.strip() for text in formulas)
        ):
            raise ParameterError(f"a position force needs three formulas, one per component, not {what_is(formulas)}")
        for text in formulas:
            read_formula(text, AXES, "a position force")
        keep(self, formulas=tuple(formulas))
        self._keep_beads()
        keep(self, corner=point(self.corner, "the corner of a position force"))

    def check_values(self, x: np.ndarray, members: np.ndarray, box: np.ndarray | None) -> None:
        """Raise ParameterError if the force on one of these beads is not finite at its position x."""
        variables = dict(zip(AXES, (folded(x - self.corner, box) + self.corner).T, strict=True))
        for text in self.formulas:
            found = np.broadcast_to(values(read_formula(text, AXES, "a position force"), variables), len(x))
            bad = np.flatnonzero(members & ~np.isfinite(found))
            if len(bad):
                where = ", ".join(f"{name} = {in_length(variables[name][bad[0]])}" for name in AXES)
                raise ParameterError(
                    f"the formula '{text}' of a position force gives {found[bad[0]]:g} for bead {bead_number(bad[0])} at {where}; "
                    "the force must be finite everywhere"
                )

    def __str__(self) -> str:
        return f"({', '.join(self.formulas)}) {unit_name('force')}".rstrip()


@dataclass(frozen=True)
class Wall:
    """A plane that reflects beads.

    After each drift, a bead beyond the plane is reflected, and its velocity reversed: the component along the axis (``specular``: no shear
    is transmitted), or the full vector (``bounce-back``: no slip).  Both preserve the Maxwell distribution and a uniform density.  A wall
    takes momentum from the fluid; a plain wall exerts no force, and no wall has a virial.

    Parameters
    ----------
    axis : {"x", "y", "z"}
        Normal of the plane.
    position : length
        Position of the plane along the axis, nm.
    side : {"above", "below"}
        Side of the beads: above, at larger coordinates than the plane, or below.
    kind : {"specular", "bounce-back"}
        Kind of reflection; all walls on one axis are of one kind.
    velocity : three velocities, optional
        Velocity, nm/ps, of a bounce-back wall in its plane, and so of the fluid next to it.  (0, 0, 0) is a wall at rest.  If any wall of a
        scene has a velocity, or a continuum behind it, the impulses on all walls are recorded.
    period : time, optional
        The velocity is multiplied by cos(2 pi t/period), with t the Context's time in the middle of a step.
    behind : str, optional
        Bead type of a continuum behind the wall: its repulsion, and friction with noise, act on beads closer than 1.25 cutoffs
        (:doc:`/theory_flow`).  The first layer then has the density and temperature of the fluid.  Measured for fluids with A rc/kT
        from 15 to 80, densities rho rc^3 from 3 to 6, and frictions gamma rc/sqrt(m kT) from 4 to 45; others are refused.
    density : float, optional
        Density of the continuum, beads per nm^3.

    Raises
    ------
    ParameterError
        If a value is out of bounds, a specular wall has a velocity or a continuum, a velocity points out of the plane, or only one of
        ``behind`` and ``density`` is given.

    Notes
    -----
    In a periodic box walls come in pairs, one with the beads above and one with the beads below; the space between the second and the next
    image of the first is solid.  It must be as thick as the cutoff if forces should not reach through it, and may hold immobile beads.
    """

    axis: str
    position: float
    side: str
    kind: str = "bounce-back"
    velocity: tuple[float, float, float] | None = None
    period: float | None = None
    behind: str | None = None
    density: float | None = None

    def __post_init__(self):
        _axis(self.axis, "a wall")
        keep(self, position=checked(self.position, "length", "the position of a wall", signed=True))
        require_one(self.side, ("above", "below"), "the side of a wall, where the beads are,")
        require_one(self.kind, KINDS, "the kind of a wall")
        if self.driven and self.kind != BOUNCE_BACK:
            raise ParameterError("a specular wall transmits no shear, so it has no velocity and nothing behind it; use kind='bounce-back'")
        self._keep_velocity()
        if (self.behind is None) != (self.density is None):
            raise ParameterError("behind a wall is a bead type with its density: give both `behind` and `density`, or neither")
        if self.behind is not None:
            require(self.behind, str, "`behind` of a wall must be the name of a bead type")
            keep(self, density=checked(self.density, "number_density", "the density behind a wall", positive=True))

    def _keep_velocity(self) -> None:
        """Check ``velocity`` and ``period``, and keep them in MD units."""
        if self.velocity is None:
            if self.period is not None:
                raise ParameterError("a wall with a period needs a velocity")
            return
        velocity = np.asarray(to_md(self.velocity, "velocity", "the velocity of a wall"))
        if velocity.shape != (3,):
            raise ParameterError(f"the velocity of a wall must be three components, not {what_is(self.velocity)}")
        if velocity[AXES.index(self.axis)] != 0:
            raise ParameterError(f"a wall across {self.axis} moves in its plane, but its velocity along {self.axis} is not 0")
        keep(self, velocity=tuple(velocity.tolist()))
        if self.period is not None:
            keep(self, period=checked(self.period, "time", "the period of a wall", positive=True))

    @property
    def moves(self) -> bool:
        """Whether it has a velocity."""
        return self.velocity is not None and any(self.velocity)

    @property
    def driven(self) -> bool:
        """Whether the wall has a velocity or a continuum behind it."""
        return self.velocity is not None or self.behind is not None


class Gap(NamedTuple):
    """The space between the walls of one axis: limits, kind, period (None if not periodic), and the walls by the side of the beads."""

    low: float
    high: float
    kind: str
    period: float | None
    sides: dict[str, Wall]

    def fold(self, coordinate: np.ndarray) -> np.ndarray:
        """Coordinates wrapped into the period around the middle of the gap."""
        if self.period is None:
            return coordinate
        return coordinate - self.period * np.floor((coordinate - 0.5 * (self.low + self.high - self.period)) / self.period)


def gaps(walls: Sequence[Wall], box: np.ndarray | None) -> dict[int, Gap]:
    """Gap between the walls of each axis, by the number of the axis.  ParameterError if two walls have the same axis and side, kinds differ
    on one axis, a periodic axis has a single wall, or there is no solid between the images."""
    if not isinstance(walls, Sequence) or not all(isinstance(wall, Wall) for wall in walls):
        raise ParameterError(f"walls must be a sequence of Wall, such as [Wall('z', 0.0, 'above'), ...], not {what_is(walls)}")
    found: dict[int, Gap] = {}
    for name in dict.fromkeys(wall.axis for wall in walls):
        mine = [wall for wall in walls if wall.axis == name]
        sides = {wall.side: wall for wall in mine}
        if len(sides) < len(mine):
            raise ParameterError(
                f"there are two walls along {name} with the beads on the same side; an axis can have one above and one below the beads"
            )
        kinds = {wall.kind for wall in mine}
        if len(kinds) > 1:
            raise ParameterError(f"the walls along {name} are of different kinds, {' and '.join(sorted(kinds))}; they must be of one kind")
        low = sides["above"].position if "above" in sides else -NOWHERE
        high = sides["below"].position if "below" in sides else NOWHERE
        period = require_plain_axis(box, name, "a wall")
        if period is not None:
            if len(sides) < 2:
                missing = "below" if "above" in sides else "above"
                raise ParameterError(
                    f"the box is periodic along {name}: beads would reach the back of the only wall there; "
                    f"add one with the beads {what_is(missing)}"
                )
            high -= period * np.ceil((high - low) / period - 1.0)
            if not high - low < period * (1 - 1e-9):
                raise ParameterError(
                    f"the walls along {name} leave no solid between the periodic images; make the box longer than the gap of "
                    f"{in_length(high - low)}, by the cutoff if forces should not reach through"
                )
        if low >= high:
            raise ParameterError(f"the lower wall along {name}, at {in_length(low)}, is not below the upper one, at {in_length(high)}")
        found[AXES.index(name)] = Gap(low, high, kinds.pop(), period, sides)
    return found


def kind_of(found: Mapping[int, Gap]) -> str:
    """Kind of all walls, or "mixed", for programs; "" without walls."""
    kinds = {gap.kind for gap in found.values()}
    return MIXED if len(kinds) > 1 else kinds.pop() if kinds else ""


def check_inside(found: Mapping[int, Gap], x: np.ndarray, mobile: np.ndarray) -> None:
    """Raise ParameterError if a mobile bead starts beyond a wall."""
    for axis, gap in found.items():
        folded = gap.fold(x[:, axis])
        beyond = np.flatnonzero(mobile & ((folded < gap.low) | (folded > gap.high)))
        if len(beyond):
            bead = int(beyond[0])
            raise ParameterError(
                f"bead {bead_number(bead)} starts at {AXES[axis]} = {in_length(x[bead, axis])}, beyond a wall ({len(beyond)} such beads); "
                f"the gap is from {in_length(gap.low)} to {in_length(gap.high)}. Beads of the wall itself are frozen "
                + either("with `mobile`", "where no fix moves them: leave them out of its group")
            )
