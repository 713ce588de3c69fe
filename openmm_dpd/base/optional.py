"""Packages that only some functions need."""

from importlib import import_module
from types import ModuleType

from .errors import ParameterError


def optional_package(name: str, extra: str, what: str) -> ModuleType:
    """The module of a name, such as ``gsd.hoomd``; ParameterError, which says what needs it and which extra installs it, if it is not
    there."""
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ParameterError(
            f"{what} the package {package}, which cannot be imported ({error}); install it: pip install 'openmm-dpd[{extra}]'"
        ) from None
