"""Numbers from a relation or a table, with their error, source and bounds."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files

from ..base.errors import ParameterError
from ..model.pairs import checked

#: Lowest and highest value of each variable for which a relation holds.
Bounds = Mapping[str, tuple[float, float]]
#: Tolerance for rounding at a bound.
_SLACK = 1e-9


@dataclass(frozen=True)
class Estimate:
    """A number from a relation or a table.

    Attributes
    ----------
    value : float
        In reduced units, rc = m = kT = 1, unless the function that returns it has others.
    error : float or None
        Standard error, if known.
    source : str
        Publication of the relation, or the script that measured it.
    bounds : mapping of str to (float, float)
        Range of each variable for which the relation holds.
    extrapolated : bool
        Whether a variable was outside of its bounds.
    """

    value: float
    error: float | None
    source: str
    bounds: Bounds
    extrapolated: bool = False

    def __repr__(self) -> str:
        error = "" if self.error is None else f" +- {self.error:.2g}"
        return f"<Estimate {self.value:.6g}{error}, {self.source}{', extrapolated' if self.extrapolated else ''}>"

    def __float__(self) -> float:
        return self.value


def reduced_number(value, name: str, *, positive: bool = False) -> float:
    """A reduced number >= 0 (or > 0), bare or an Estimate, as a float; ParameterError for anything else."""
    return checked(value.value if isinstance(value, Estimate) else value, "dimensionless", name, positive=positive)


def shipped_rows(name: str) -> list:
    """Rows of a measured table that comes with the package."""
    return json.loads(files(__package__).joinpath(f"{name}.json").read_text(encoding="utf-8"))["rows"]


def outside(values: Mapping[str, float], bounds: Bounds, source: str, extrapolate: bool | None) -> bool:
    """Whether a value is outside of its bounds; ParameterError if so, unless ``extrapolate`` (None: the caller has no such option)."""
    for name, value in values.items():
        low, high = bounds[name]
        slack = _SLACK * max(abs(low), abs(high))
        if not low - slack <= value <= high + slack:
            if extrapolate:
                return True
            way_out = "" if extrapolate is None else "; use extrapolate=True to allow it"
            raise ParameterError(f"{name} = {value:g} is outside of {low:g} to {high:g}, the range of {source}{way_out}")
    return False
