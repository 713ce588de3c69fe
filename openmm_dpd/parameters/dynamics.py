"""Diffusion, viscosity and Schmidt number of a one-component fluid at density 3, and the friction for a given one.

Reduced units: rc = m = kT = 1.  The table (docs/measure/transport_table.py) has three planes through the base fluid (A = 25, exponent 1, no
transverse friction), each over the drag on a bead and the exponent, the transverse fraction of the drag, or the repulsion."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import brentq

from ..advice.stability_table import drag
from ..base.errors import ParameterError
from .estimate import Bounds, Estimate, outside, reduced_number, shipped_rows

#: The only density that was measured.
DENSITY = 3.0
_BASE = {"A": 25.0, "exponent": 1.0, "transverse": 0.0}
_SOURCE = "docs/measure/transport_table.py"


@dataclass(frozen=True)
class Transport:
    """Transport coefficients of a fluid, in units of rc, m and kT.

    Attributes
    ----------
    diffusion : Estimate
        D of a bead, rc^2/tau, for an infinite box.
    viscosity : Estimate
        eta, m/(rc tau), at a wavelength of 10 rc.
    schmidt : Estimate
        eta/(rho m D).
    """

    diffusion: Estimate
    viscosity: Estimate
    schmidt: Estimate


@dataclass(frozen=True)
class Friction:
    """Friction coefficients of a pair, and the transport coefficients of the fluid.

    Attributes
    ----------
    gamma, gamma_perp : float
        Friction along and across the line of centres, m/tau.
    exponent : float
        Exponent of both noise weights.
    transport : Transport
    """

    gamma: float
    gamma_perp: float
    exponent: float
    transport: Transport


@dataclass(frozen=True)
class _Plane:
    """ln D and ln eta as functions of ln drag and one more variable, and their relative errors."""

    values: tuple[RectBivariateSpline, RectBivariateSpline]
    errors: tuple[RectBivariateSpline, RectBivariateSpline]
    bounds: Bounds

    def __call__(self, drag_: float, other: float) -> tuple[float, ...]:
        at = (math.log(drag_), other)
        return tuple(float(surface(*at)[0, 0]) for surface in (*self.values, *self.errors))


def _plane(rows: list[dict], name: str) -> _Plane:
    """The plane of the table in which ``name`` varies with the drag."""
    chosen = [row for row in rows if all(row[other] == value for other, value in _BASE.items() if other != name)]
    drags, others = sorted({row["drag"] for row in chosen}), sorted({row[name] for row in chosen})
    found = {(row["drag"], row[name]): row for row in chosen}

    def surface(what, order: int) -> RectBivariateSpline:
        grid = [[what(found[d, o]) for o in others] for d in drags]
        return RectBivariateSpline(np.log(drags), others, grid, kx=3 if order > 1 else 1, ky=order)

    values = tuple(surface(lambda row, key=key: math.log(row[key]), 2) for key in ("D", "eta"))
    errors = tuple(surface(lambda row, key=key: row[f"{key}_error"] / row[key], 1) for key in ("D", "eta"))
    return _Plane(values, errors, {"drag": (drags[0], drags[-1]), name: (others[0], others[-1])})  # type: ignore[arg-type]


@lru_cache(maxsize=1)
def _planes() -> Mapping[str, _Plane]:
    rows = shipped_rows("transport")
    return {name: _plane(rows, name) for name in _BASE}


def _chosen(values: Mapping[str, float]) -> tuple[_Plane, str]:
    """The plane that contains a fluid, and its variable; ParameterError if more than one value differs from the base fluid."""
    other = [name for name, value in values.items() if abs(value - _BASE[name]) > 1e-9]
    if len(other) > 1:
        raise ParameterError(
            f"{' and '.join(f'{name} = {values[name]:g}' for name in other)} were not varied together; only one of A = 25, exponent = 1 "
            f"and no transverse friction may be changed ({_SOURCE})"
        )
    name = other[0] if other else "exponent"
    return _planes()[name], name


def _at(friction: float, values: Mapping[str, float], extrapolate: bool | None) -> Transport:
    """Transport coefficients at a drag and the other values of a fluid, from the plane that contains it."""
    plane, name = _chosen(values)
    beyond = outside({"drag": friction, name: values[name]}, plane.bounds, _SOURCE, extrapolate)
    log_d, log_eta, d_error, eta_error = plane(friction, values[name])

    def estimate(value: float, relative: float) -> Estimate:
        return Estimate(value, None if beyond else relative * value, _SOURCE, plane.bounds, beyond)

    D, eta = math.exp(log_d), math.exp(log_eta)
    return Transport(estimate(D, d_error), estimate(eta, eta_error), estimate(eta / (DENSITY * D), math.hypot(d_error, eta_error)))


def transport(gamma, *, gamma_perp=0.0, exponent=1.0, A=25.0, extrapolate: bool = False) -> Transport:
    r"""Diffusion coefficient, viscosity and Schmidt number of a fluid at density 3, from the measured table.

    The table is over the drag on a bead in its surroundings,

    .. math:: g = (\gamma + 2\gamma_\perp) \frac{60}{(2s+1)(2s+2)(2s+3)},

    which is gamma for exponent s = 1 and no transverse friction.

    Parameters
    ----------
    gamma, gamma_perp : float
        Friction along and across the line of centres, m/tau, >= 0.
    exponent : float, default 1
        Exponent s of both noise weights.
    A : float, default 25
        A rc/kT.  Only one of A, exponent and gamma_perp may differ from 25, 1 and 0.
    extrapolate : bool
        Outside of the table, use the value at the nearest bound.

    Raises
    ------
    ParameterError
        If the fluid is outside of the table: drag 2 to 120, exponent 0.25 to 1, A from 25 to 80.

    References
    ----------
    Measured with this package: docs/measure/transport_table.py, docs/validation.md.
    """
    gamma, gamma_perp = reduced_number(gamma, "gamma"), reduced_number(gamma_perp, "gamma_perp")
    exponent, A = reduced_number(exponent, "exponent"), reduced_number(A, "A")
    total = gamma + 2 * gamma_perp
    if total == 0:
        raise ParameterError("gamma and gamma_perp are both 0; the table has fluids with friction only")
    share = 2 * gamma_perp / total
    return _at(drag(total, DENSITY, exponent), {"A": A, "exponent": exponent, "transverse": share}, extrapolate)


def friction_for(*, schmidt=None, viscosity=None, diffusion=None, exponent=1.0, transverse=0.0, A=25.0) -> Friction:
    """Friction for a given Schmidt number, viscosity or diffusion coefficient at density 3.

    Parameters
    ----------
    schmidt, viscosity, diffusion : float
        Target, in reduced units; give one of them.
    exponent : float, default 1
        Exponent of both noise weights.
    transverse : float, default 0
        Fraction of the friction across the line of centres, 2 gamma_perp/(gamma + 2 gamma_perp).
    A : float, default 25
        A rc/kT.

    Raises
    ------
    ParameterError
        If none or several targets are given, or no friction in the table reaches it; the message has the range.

    Notes
    -----
    At strong friction, long steps spoil diffusion long before the temperature; the table has friction rate times step below 1/3.
    """
    wanted = {
        name: value for name, value in (("schmidt", schmidt), ("viscosity", viscosity), ("diffusion", diffusion)) if value is not None
    }
    if len(wanted) != 1:
        raise ParameterError(f"give exactly one of schmidt, viscosity and diffusion, not {len(wanted)}")
    ((name, value),) = wanted.items()
    target = reduced_number(value, name, positive=True)
    exponent, A = reduced_number(exponent, "exponent"), reduced_number(A, "A")
    transverse = reduced_number(transverse, "transverse")
    values = {"A": A, "exponent": exponent, "transverse": transverse}
    low, high = _chosen(values)[0].bounds["drag"]

    def off(log_drag: float) -> float:
        return math.log(getattr(_at(math.exp(log_drag), values, None), name).value / target)

    ends = (math.log(low), math.log(high))
    if off(ends[0]) * off(ends[1]) > 0:
        reached = sorted(target * math.exp(off(end)) for end in ends)
        raise ParameterError(
            f"{name} = {target:g} is outside of {reached[0]:.3g} to {reached[1]:.3g}, the range of this fluid in {_SOURCE}"
        )
    friction = math.exp(brentq(off, *ends))
    total = friction / drag(1.0, DENSITY, exponent)
    return Friction(total * (1 - transverse), total * transverse / 2, exponent, _at(friction, values, None))
