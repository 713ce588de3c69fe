"""Packages that only some functions need."""

from importlib import import_module
from types import ModuleType

from .errors import ParameterError


def optional_package(name: str, extra: str, what: str) -> ModuleType:
    """The module of this name.

    Parameters
    ----------
    name : str
        Such as ``gsd.hoomd``.
    extra : str
        The extra of this package that installs it.
    what : str
        What needs it, for the error.

    Raises
    ------
    ParameterError
        If it is not installed; the message says how to install it.
    """
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ParameterError(
            f"{what} the package {package}, which cannot be imported ({error}); install it: pip install 'openmm-dpd[{extra}]'"
        ) from None


__all__ = ["optional_package"]
