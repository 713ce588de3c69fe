"""Reading files of OpenMM's XmlSerializer without running foreign code.

A PythonForce is written as a pickled Python object, and unpickling can run any code: OpenMM's own ``XmlSerializer.deserialize`` does so
even for a file of unknown origin.
"""

import importlib
import io
import os
import pickle
from collections.abc import Container
from pathlib import Path
from typing import Any, TextIO
from xml.etree import ElementTree

import openmm

from .errors import ParameterError, require

#: Functions and classes that rebuild arrays, in NumPy 1 and 2.
ARRAYS = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    *((f"numpy.{core}.multiarray", name) for core in ("core", "_core") for name in ("_reconstruct", "scalar")),
    *((f"numpy.{core}.numeric", "_frombuffer") for core in ("core", "_core")),
}


#: Modules of registered kinds of pair terms, bonds or angles.
_REGISTERED: set[str] = set()


def trust(*modules: str) -> None:
    """Accept classes of these modules in files: registering a kind of theirs runs their code anyway."""
    _REGISTERED.update(modules)


class DataUnpickler(pickle.Unpickler):
    """Unpickler that accepts plain values, ``others``, and classes (not functions) of ``packages``, by default those of forces, and of
    ``registered`` modules."""

    packages: tuple[str, ...] = ("openmm_dpd.plan.forces.", "openmm_dpd.kernels.", "openmm_dpd.model.")
    registered: Container[str] = _REGISTERED
    others: Container[tuple[str, str]] = ARRAYS
    refusal = "it asks for {}"

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in self.others:
            return super().find_class(module, name)
        if (module.startswith(self.packages) or module in self.registered) and "." not in name:
            try:
                found = getattr(importlib.import_module(module), name, None)
            except ImportError:
                found = None
            if isinstance(found, type) and found.__module__ == module:
                return found
        raise pickle.UnpicklingError(self.refusal.format(f"{module}.{name}"))


def checked_xml(text: str) -> ElementTree.Element:
    """Elements of an XML text whose Python objects were checked.  ParameterError, before any code has run, if it is not XML, or one of its
    PythonForces is not of this package."""
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ParameterError(f"this is not a file of OpenMM's XmlSerializer: {error}") from None
    for node in root.iter():
        if node.get("type") != "PythonForce":
            continue
        try:
            DataUnpickler(io.BytesIO(bytes.fromhex(node.get("function", "")))).load()
        except Exception as error:  # a broken pickle can fail in any way
            raise ParameterError(
                f"the file holds a Python object that is not a force of this package ({error}): another version wrote it, or reading "
                "it would run foreign code; build the System anew, or, if you trust the file, use openmm.XmlSerializer.deserialize"
            ) from None
    return root


def load_xml(file: str | os.PathLike | TextIO) -> Any:
    """Read a System, integrator or State written by ``openmm.XmlSerializer.serialize``, if its Python objects are of this package.

    Parameters
    ----------
    file : path-like or text file

    Returns
    -------
    openmm.System, openmm.Integrator or openmm.State

    Raises
    ------
    ParameterError
        If this is not such a file, or a PythonForce in it is not of this package; none of its code has run.

    Examples
    --------
    >>> import openmm
    >>> with open("system.xml", "w") as file:
    ...     _ = file.write(openmm.XmlSerializer.serialize(openmm.System()))
    >>> load_xml("system.xml").getNumParticles()
    0
    """
    return deserialized(checked_xml(read_file(file)))


def read_file(file: str | os.PathLike | TextIO) -> str:
    """Text of a file, given its path or an open file."""
    if hasattr(file, "read"):
        return file.read()
    require(file, (str, os.PathLike), "file must be a path or a text file open for reading")
    return Path(file).read_text(encoding="utf-8")


def deserialized(root: ElementTree.Element) -> Any:
    """The object of checked elements, which are written anew, so that OpenMM reads exactly what was checked."""
    try:
        return openmm.XmlSerializer.deserialize(ElementTree.tostring(root, encoding="unicode"))
    except (openmm.OpenMMException, ValueError) as error:
        raise ParameterError(f"OpenMM cannot read this file: {error}") from None
