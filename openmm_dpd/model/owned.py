"""How frozen classes store their arguments, and which there are."""

from typing import Any

import numpy as np


def owned(array, dtype=None) -> np.ndarray:
    """A read-only copy: it is changed neither through the array it was made from nor by itself."""
    copy = np.array(array, dtype=dtype, order="C")
    copy.flags.writeable = False
    return copy


def keep(instance, **values) -> None:
    """Set attributes of a frozen instance; arrays are kept as read-only copies.  A caller goes on to change the mask or the positions it
    has handed over, and what was checked must stay what it was."""
    for name, value in values.items():
        object.__setattr__(instance, name, owned(value) if isinstance(value, np.ndarray) else value)


def known_under(kind: Any) -> list[str]:
    """Names of the classes under one that stand in its own file; anybody may have added others."""
    return [under.__name__ for under in kind.__subclasses__() if under.__module__ == kind.__module__]
