"""Constant pressure: what ``fix nph`` asks for."""

from dataclasses import dataclass

from ...errors import ParameterError
from ...units import UnitSystem
from ..language import arguments as read

Three = tuple[float, float, float]


@dataclass(frozen=True)
class PressureControl:
    """The pressure that the box follows.

    Attributes
    ----------
    axes : three bools
        Edges of the box that may change.
    coupled : bool
        Whether all change by the same factor.
    start, stop : three floats
        Pressure along each axis at the beginning and at the end of the run, kJ/mol/nm^3 (0 for edges that stay).
    isothermal : bool
        Whether a thermostat holds the temperature; otherwise the enthalpy is what stays.
    """

    axes: tuple[bool, bool, bool]
    coupled: bool
    start: Three
    stop: Three
    isothermal: bool = False

    @property
    def constant(self) -> bool:
        """Whether the pressure stays the same during the run."""
        return self.start == self.stop


#: Options of fix nph that are about LAMMPS's own equations of motion for the box: number of values.
_DYNAMICS = {"drag": 1, "pchain": 1, "ploop": 1, "nreset": 1, "mtk": 1, "ptemp": 1, "flip": 1, "update": 1, "fixedpoint": 3}
_DYNAMICS |= {"scalexy": 1, "scalexz": 1, "scaleyz": 1}


def parse_nph(words: list[str], units: UnitSystem) -> tuple[PressureControl, list[str]]:
    """Words after ``fix ID group nph``, and the options among them that have no meaning here.

    Raises
    ------
    ParameterError
        For unknown or unsupported keywords, or if no pressure is given.
    """
    sizes = {**dict.fromkeys(("iso", "aniso", "x", "y", "z"), 3), "couple": 1, "dilate": 1, **_DYNAMICS}
    start: list[float | None] = [None] * 3
    stop = [0.0] * 3
    coupled, unused = False, []
    for keyword, values in read.options(words, sizes, "fix nph"):
        if keyword == "couple":
            coupled = read.choice(values[0], "couple", ("none", "xyz")) == "xyz"
        elif keyword == "dilate":
            if values[0] != "all":
                raise ParameterError(f"fix nph dilate {values[0]} is not supported: all beads move with the box")
        elif keyword in _DYNAMICS:
            unused.append(keyword)
        else:
            first, last = (read.number(word, f"the pressure of {keyword}") for word in values[:2])
            read.positive(values[2], "the damping time of the box")
            coupled = keyword == "iso"
            for axis in range(3) if keyword in ("iso", "aniso") else ["xyz".index(keyword)]:
                start[axis], stop[axis] = first, last
    axes = tuple(value is not None for value in start)
    low = tuple(units.pressure * (value or 0.0) for value in start)
    high = tuple(units.pressure * value for value in stop)
    if not any(axes):
        raise ParameterError("expected 'fix ID group nph iso|aniso|x|y|z Pstart Pstop Pdamp ...', but no pressure is given")
    if coupled and not (all(axes) and len(set(low)) == len(set(high)) == 1):
        raise ParameterError("fix nph: edges that change together (couple xyz) need the same pressure along x, y and z")
    return PressureControl(axes, coupled, low, high), unused  # type: ignore[arg-type]
