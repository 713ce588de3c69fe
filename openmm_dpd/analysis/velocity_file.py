"""Velocities over time from the file of a :class:`openmm_dpd.measure.VelocityReporter`."""

import os
from collections.abc import Iterator
from zipfile import is_zipfile

import numpy as np

from ..base.errors import ParameterError


def read_velocities(file: str | os.PathLike) -> Iterator[np.ndarray]:
    """Velocities (N, 3), nm/ps, frame by frame; one frame at a time is in memory.  For all at once: ``load_fields(file)["velocities"]``.

    Raises
    ------
    ParameterError
        If there is no such file, or it is not one of :class:`VelocityReporter`.
    """
    try:
        if os.path.isfile(file) and not is_zipfile(file):
            raise ValueError("it is no zip archive, or a part of one")
        opened = np.load(file)
    except (OSError, ValueError, TypeError) as error:
        raise ParameterError(f"{file} cannot be read as a file of velocities (written by VelocityReporter): {error}") from None
    if not isinstance(opened, np.lib.npyio.NpzFile) or not any(name.startswith("velocities/") for name in opened.files):
        raise ParameterError(f"{file} is no file of velocities written by VelocityReporter")
    with opened as archive:
        for member in sorted(name for name in archive.files if name.startswith("velocities/")):
            yield archive[member]
