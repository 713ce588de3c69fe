"""Single numbers with units, as they are given."""

from .errors import ParameterError
from .units import to_md
from .wording import in_number


def checked(value, dimension: str, name: str, *, positive: bool = False, signed: bool = False) -> float:
    """One finite number >= 0 (or > 0, or of either sign) in MD units."""
    number = to_md(value, dimension, name)
    if not isinstance(number, float):
        raise ParameterError(f"{name} must be a single number, not an array of shape {number.shape}")
    if not signed and (number < 0 or (positive and number == 0)):
        raise ParameterError(f"{name} must be {'> 0' if positive else '>= 0'}, but is {in_number(number, dimension)}")
    return number
