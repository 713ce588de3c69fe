"""Reading what OpenMM's XmlSerializer wrote, without running other people's code in it.

A PythonForce is written as a pickled Python object, and to unpickle is to run: OpenMM's own ``XmlSerializer.deserialize`` carries out
even if a file of unknown origin asks for it.
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

from .errors import ParameterError

#: What arrays are made of, in NumPy 1 and 2.
ARRAYS = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    *((f"numpy.{core}.multiarray", name) for core in ("core", "_core") for name in ("_reconstruct", "scalar")),
    *((f"numpy.{core}.numeric", "_frombuffer") for core in ("core", "_core")),
}


#: Modules of kinds of pair terms, bonds or angles that were registered.
_REGISTERED: set[str] = set()


def trust(*modules: str) -> None:
    """Accept classes of these modules in files: whoever has registered a kind of theirs runs their code anyway."""
    _REGISTERED.update(modules)


class DataUnpickler(pickle.Unpickler):
    """Accepts plain values, ``others``, and classes (not functions) of ``packages``, by default those of forces, and of ``registered``
    modules."""

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
    """The elements of an XML text, after a check of all Python objects in it.  ParameterError if it is no XML, or one of its PythonForces
    is not of this package; nothing of it has been run then."""
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ParameterError(f"this is no file that OpenMM's XmlSerializer wrote: {error}") from None
    for node in root.iter():
        if node.get("type") != "PythonForce":
            continue
        try:
            DataUnpickler(io.BytesIO(bytes.fromhex(node.get("function", "")))).load()
        except Exception as error:  # what is pickled badly can fail in any way
            raise ParameterError(
                f"the file holds a Python object that is not a force of this package ({error}): another version wrote it, or to "
                "read it would be to run it; build the System anew, or, if you trust the file, use openmm.XmlSerializer.deserialize"
            ) from None
    return root


def load_xml(file: str | os.PathLike | TextIO) -> Any:
    """Read a System, integrator or State that ``openmm.XmlSerializer.serialize`` wrote, if it holds no Python code but this package's.

    Parameters
    ----------
    file : path-like or text file

    Returns
    -------
    openmm.System, openmm.Integrator or openmm.State

    Raises
    ------
    ParameterError
        If it is no such file, or a PythonForce in it is not one of this package; nothing of it has been run then.

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
    """Text of a file by its name, or of an open one."""
    return Path(file).read_text(encoding="utf-8") if isinstance(file, (str, os.PathLike)) else file.read()


def deserialized(root: ElementTree.Element) -> Any:
    """The object of elements that were looked at; they are written anew, so that OpenMM reads exactly what was checked."""
    try:
        return openmm.XmlSerializer.deserialize(ElementTree.tostring(root, encoding="unicode"))
    except (openmm.OpenMMException, ValueError) as error:
        raise ParameterError(f"OpenMM cannot read this file: {error}") from None
