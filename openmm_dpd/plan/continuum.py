"""Walls that move or have something behind them: what the kernel has to know, and what cannot be combined with them.

Behind a plane lies a continuum of beads of one type with the density rho and the radial distribution g(r) of its fluid.  With the pairs'
force f(r) and friction gamma(r) = gamma w^2 there are these integrals over the half space beyond the distance h::

    F(h)       = pi rho int_h^rc f g (r^2 - h^2) dr
    Gamma_n(h) = 2 pi rho int_h^rc gamma g (r^3 - h^3)/(3 r) dr                    along the normal
    Gamma_p(h) = pi rho int_h^rc gamma g (r (r - h) - (r^3 - h^3)/(3 r)) dr        in each direction of the plane

g(r) is that of the hypernetted chain, which gives the pressure of soft repulsions to 1 %.  A mean force does not answer to the neighbours
of a bead: the force that keeps the density at that of the fluid up to the wall differs from F by a term whose integral is 0, measured over
repulsion and density.  In the plane the friction is 2 Gamma_p, since a fluid that goes on behind the wall, turned by 180 degrees, has twice
the velocity relative to a bead on average.  The correlation of forces adds its friction, f^2 tau/kT in place of gamma, with tau measured
for no slip.  docs/theory_flow.md derives it; docs/measure/walls.py measures both, and writes them to ``continuum.json``.
"""

import json
from functools import lru_cache
from importlib.resources import files

import numpy as np
import scipy
from numpy.polynomial import chebyshev, polynomial

from ..base.errors import PlanError, in_length, what_is
from ..kernels.driven import Continuum, Driven
from ..kernels.elementary import without_last_bits
from ..kernels.solids import Solids
from ..model.flow import AXES, Gap, Wall
from ..model.pairs import DPD, NONE
from ..model.scene import Scene
from ..model.schemes import Scheme
from ..model.temperature import TemperatureRamp
from .pair_spec import longest
from .solids import solid_walls

#: How far a wall reaches; rows of a table; points of the grid of g(r), and its length.  Lengths in cutoffs.
REACH, ROWS, POINTS, RANGE = 1.25, 256, 1024, 8.0
#: Bits behind the point that tables have, in their own units: transforms differ in the last ones from machine to machine.
BITS = 30


@lru_cache(maxsize=1)
def wall_measures() -> dict:
    """What was measured over repulsion a = A rc/kT and density n = rho rc^3: ``force`` (i, j, k), factors of a^(i + 1) n^-j in the k-th
    Chebyshev coefficient of the term beside F, in kT/rc, over the reach of a wall; ``time`` (i, j, k), factors of (ln a)^i n^-j b^k, with
    the friction b = gamma rc/sqrt(m kT), in the logarithm of tau, in rc sqrt(m/kT); and the ``range`` of a, n and b."""
    return json.loads(files(__package__).joinpath("continuum.json").read_text(encoding="utf-8"))


def driven_walls(scene: Scene, tables: list[dict], lam: float) -> Driven | Solids | None:
    """Walls as the kernel needs them; None if all are plain.  ``tables`` are the resolved pair coefficients, ``lam`` the weight of the
    prediction in ``mvv``."""
    if not any(wall.driven for wall in scene.walls):
        return None
    if not scene.gaps:
        if lam != 0.5:
            raise PlanError("velocities of beads that bounce back are not predicted: with walls of a shape lam must be 0.5")
        return solid_walls(scene, longest(tables))
    there, velocity, period, continuum = np.zeros((3, 2), bool), np.zeros((3, 2, 3)), np.zeros((3, 2)), None
    for axis, gap in scene.gaps.items():
        for side, wall in enumerate(gap.sides.get(name) for name in ("above", "below")):
            there[axis, side] = wall is not None
            if wall is not None and wall.velocity is not None:
                velocity[axis, side], period[axis, side] = wall.velocity, wall.period or 0.0
        if any(wall.behind for wall in gap.sides.values()):
            continuum = _continuum(scene, axis, gap, tables)
    return Driven(there, velocity, period, continuum)


def check_driven(scene: Scene, scheme: Scheme, tables: list[dict], thermostat: bool) -> None:
    """Raise PlanError if a fluid behind a wall cannot be combined with the scene."""
    behind = [wall for wall in scene.walls if wall.behind]
    if not behind:
        return
    wall = behind[0]
    other = other_terms(tables)
    reasons = {
        f"the scheme {scheme.name!r} has no pair updates, which its friction goes with": not scheme.sweeps,
        "nothing has friction or noise": not thermostat,
        "its structure is that of one temperature above 0": isinstance(scene.kT, TemperatureRamp) or scene.initial_kT == 0.0,
        "walls with something behind them stand along one axis": len({each.axis for each in behind}) > 1,
        f"there is no bead type {wall.behind!r}": any(each.behind not in scene.type_names for each in behind),
        other or "": other is not None,
        "charges would have images there": scene.electrostatics is not None,
    }
    if other is None:
        alone = next((each.behind for each in behind if tables[0].get((each.behind, each.behind), NONE) is NONE), None)
        reasons[f"beads of type {what_is(alone)} do not interact"] = alone is not None
    reason = next((reason for reason, holds in reasons.items() if holds), None)
    if reason is not None:
        raise PlanError(f"no fluid can be behind a wall: {reason}")
    for each in behind:
        _check_measured(scene, each, tables[0])
    axis = AXES.index(wall.axis)
    gap = scene.gaps[axis]
    reach = max(c.cutoff for c in tables[0].values())
    if gap.period is not None and gap.period - (gap.high - gap.low) < reach * (1 - 1e-9):
        raise PlanError(
            f"the solid between the walls along {wall.axis} is thinner than the cutoff of {in_length(reach)}: beads on both sides would "
            "feel each other beside the fluid behind the walls"
        )
    z = gap.fold(scene.positions[:, axis])
    if np.any(scene.immobile & ((z < gap.low) | (z > gap.high))):
        raise PlanError("immobile beads lie where a fluid is behind a wall: either of them is what beads near the wall feel")


def other_terms(tables: list[dict]) -> str | None:
    """Why pairs do not interact by one table of :class:`.DPD` with friction, in words, or None."""
    coefficients = [c for table in tables for c in table.values() if c is not NONE]
    others = sorted({type(c).__name__ for c in coefficients} - {"DPD"})
    if others or len(tables) != 1:
        return f"pairs interact by {', '.join(others) or 'several tables'}, not by one table of DPD"
    return "sigma is fixed and gamma not; give gamma" if any(c.gamma is None and c.sigma for c in coefficients) else None


def _with_wall(scene: Scene, wall: Wall, table: dict) -> dict[str, DPD]:
    """By bead type, the coefficients with the type behind a wall; without types that do not interact with it."""
    found = {name: table.get((name, wall.behind)) or table.get((wall.behind, name)) for name in scene.type_names}
    return {name: pair for name, pair in found.items() if pair is not None and pair is not NONE}


def _check_measured(scene: Scene, wall: Wall, table: dict) -> None:
    kT, limits = scene.initial_kT, wall_measures()["range"]
    for name, pair in _with_wall(scene, wall, table).items():
        values = {"repulsion A rc/kT": pair.A * pair.cutoff / kT, "density rho rc^3": (wall.density or 0.0) * pair.cutoff**3}
        if name == wall.behind:
            values["friction gamma rc/sqrt(m kT)"] = (pair.gamma or 0.0) * pair.cutoff / np.sqrt(scene.masses[name] * kT)
        for (what, value), (low, high) in zip(values.items(), limits, strict=False):
            low *= name == wall.behind or not what.startswith("repulsion")  # which a bead in the fluid may lack
            if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
                raise PlanError(
                    f"no fluid can be behind a wall: what beads feel there was measured for a {what} from {low:g} to {high:g}, but between "
                    f"{name!r} and {wall.behind!r} it is {value:.4g}; use frozen beads behind a plain wall"
                )


def _continuum(scene: Scene, axis: int, gap: Gap, tables: list[dict]) -> Continuum:
    reach = REACH * max(c.cutoff for c in tables[0].values())
    walls = [gap.sides.get(name) for name in ("above", "below")]
    rows = [_rows(scene, wall, tables[0], reach) for wall in walls]
    start, period = -1e9, 4e9
    if gap.period is not None:
        start, period = 0.5 * (gap.low + gap.high - gap.period), gap.period
    return Continuum(
        types=scene.type_ids.copy(),
        inv_mass=np.where(scene.immobile, 0.0, 1.0 / scene.bead_masses),
        axis=axis,
        planes=np.array([gap.low, gap.high]),
        there=np.array([float(wall is not None and wall.behind is not None) for wall in walls]),
        start=start,
        period=period,
        tables=np.array(rows),
        reach=reach,
    )


def _rows(scene: Scene, wall: Wall | None, table: dict, reach: float) -> np.ndarray:
    """(T, ROWS + 1, 4) tables of force, energy and frictions against the distance from a wall, by bead type."""
    found = np.zeros((len(scene.type_names), ROWS + 1, 4))
    if wall is None or wall.behind is None or wall.density is None:
        return found
    h, pure, kT = np.linspace(0.0, reach, ROWS + 1), table[wall.behind, wall.behind], scene.initial_kT
    _, _, fluid = fluid_structure(pure, wall.density, kT)
    for k, name in enumerate(scene.type_names):
        pair = _with_wall(scene, wall, table).get(name)
        if pair is not None:
            r, g, _ = fluid_structure(pair, wall.density, kT, reach=pure.cutoff, fluid=fluid)
            found[k] = wall_table(pair, scene.masses[name], kT, wall.density, r, g, h)
    return found


def fluid_structure(pair, density: float, kT: float, reach: float | None = None, fluid: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
    """Distances, g(r) and the transform of g - 1 of a fluid whose beads repel each other by A w, from the hypernetted chain, solved by
    iteration; with the transform of a ``fluid`` whose cutoff is ``reach``, of a single bead in it."""
    length = RANGE * (reach or pair.cutoff)
    dr, n = length / POINTS, np.arange(1, POINTS)
    r, k = dr * n, np.pi / length * n
    energy = 0.5 * pair.A * pair.cutoff * np.clip(1.0 - r / pair.cutoff, 0.0, None) ** 2 / kT
    indirect, direct = np.zeros(len(r)), -energy  # the mean field is close where beads are dense
    for _ in range(5000):
        in_k = 2.0 * np.pi * dr / k * scipy.fft.dst(r * direct, type=1)
        around = in_k / (1.0 - density * in_k) if fluid is None else fluid
        new = scipy.fft.dst(k * density * in_k * around, type=1) / (4.0 * np.pi * length * r)
        off = float(np.abs(new - indirect).max())
        indirect = 0.5 * (indirect + new)
        direct = np.exp(indirect - energy) - 1.0 - indirect
        if off < 1e-11:
            return r, np.exp(indirect - energy), around
        if not off < 1e6:
            break
    raise PlanError(
        f"the structure of the fluid behind a wall, with the density {density:g} and A = {pair.A:g}, is not to be had: the hypernetted "
        "chain does not converge"
    )


def wall_table(pair, mass: float, kT: float, density: float, r: np.ndarray, g: np.ndarray, h: np.ndarray) -> np.ndarray:
    """(len(h), 4) force, energy, and frictions along the normal and in the plane, of a continuum for beads of this mass, at distances h."""
    gamma, fine = pair.gamma or 0.0, np.linspace(0.0, pair.cutoff, 4 * ROWS + 1)
    w, there = 1.0 - fine / pair.cutoff, np.interp(fine, r, g)

    def integral(values, weight):
        """2 pi rho times the integral of values(r) g(r) weight(r, h) over r > h, for each distance h."""
        rows = []
        for low in np.minimum(h, pair.cutoff):
            s = low + (pair.cutoff - low) * np.linspace(0.0, 1.0, 4 * ROWS + 1)
            y = np.interp(s, fine, values * there) * weight(np.maximum(s, 1e-12), low)
            rows.append(0.5 * np.sum((y[1:] + y[:-1]) * np.diff(s)))
        return 2.0 * np.pi * density * np.array(rows)

    def frictions(drag):
        """Frictions of a wall along its normal and in each direction of its plane, from the drag(r) along the line of centres."""
        trace, normal = integral(drag, lambda s, low: s * (s - low)), integral(drag, lambda s, low: (s**3 - low**3) / (3.0 * s))
        return normal, 0.5 * (trace - normal)

    force = integral(pair.A * w, lambda s, low: 0.5 * (s * s - low * low))
    tables, reduced, dense = wall_measures(), pair.A * pair.cutoff / kT, density * pair.cutoff**3
    beside = chebyshev.chebval(2.0 * h / (REACH * pair.cutoff) - 1.0, reduced * polynomial.polyval2d(reduced, 1.0 / dense, tables["force"]))
    force += kT / pair.cutoff * np.where(h < REACH * pair.cutoff, beside, 0.0)
    tau = 0.0
    if reduced:
        power = polynomial.polyval3d(np.log(reduced), 1.0 / dense, gamma * pair.cutoff / np.sqrt(mass * kT), tables["time"])
        tau = pair.cutoff * np.sqrt(mass / kT) * np.exp(power)
    normal, plane = frictions(gamma * w ** (2.0 * pair.exponent))
    perpendicular = frictions(pair.gamma_perp * w ** (2.0 * pair.exponent_perp))
    collisions = [tau / kT * part for part in frictions((pair.A * w) ** 2)]
    normal, plane = normal + 2.0 * perpendicular[1] + collisions[0], 2.0 * (plane + sum(perpendicular)) + collisions[1]
    force, normal, plane = (without_last_bits(column, BITS) for column in (force, normal, plane))
    energy = np.append(np.cumsum((0.5 * np.diff(h) * (force[1:] + force[:-1]))[::-1])[::-1], 0.0)
    return np.stack([force, energy, normal, plane], axis=1)
