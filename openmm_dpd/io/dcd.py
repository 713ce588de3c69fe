"""DCD trajectories: float32 positions in angstrom, in a file that is complete after every frame."""

import os
import struct

import numpy as np

from ..base.files import BlockFile

#: Places of the number of frames and of the last step in the header, and its length, in bytes.
_COUNT_AT, _LAST_AT, _HEADER = 8, 20, 276
_MOST = 2**31 - 1


class DCDWriter:
    """Writes a DCD file in CHARMM's layout, which mdtraj, MDAnalysis and VMD read.

    The file is complete after every frame, and stays so if the next one cannot be written.

    Parameters
    ----------
    path : path-like
    n_beads : int
        Number of beads of every frame.
    what : str
        Name of the file's content in errors.
    append : bool, default False
        Append to a file written by this class; otherwise the file is overwritten.
    first, every, dt
        Entries of the header: the first step, steps between frames, and the time step.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike, n_beads: int, what: str, append: bool = False, first: int = 0, every: int = 1, dt: float = 1.0
    ):
        self._frames, self._n_beads = 0, n_beads
        self._file = BlockFile(path, what, append)
        if append:
            # a frame has six numbers of the box and three columns; the header may count frames that were cut off
            self._count((os.path.getsize(path) - _HEADER) // (56 + 3 * (4 * n_beads + 8)))
            return
        # 20 numbers, with frames, first step and interval; the eleventh flags a box, the last one is CHARMM's version
        control = struct.pack("<9if10i", 0, min(first, _MOST), min(every, _MOST), *[0] * 6, dt, 1, *[0] * 8, 24)
        title = struct.pack("<i80s80s", 2, b"openmm-dpd".ljust(80), b"".ljust(80))
        self._file.write(_record(b"CORD" + control) + _record(title) + _record(struct.pack("<i", n_beads)))

    def write(self, positions: np.ndarray, box: np.ndarray, step: int | None = None) -> None:
        """Append a frame: positions (N, 3) and box vectors (3, 3) in angstrom; the header gets its ``step`` as the last one."""
        assert len(positions) == self._n_beads
        a, b, c = np.linalg.norm(box, axis=1)
        alpha, beta, gamma = box[1] @ box[2] / (b * c), box[0] @ box[2] / (a * c), box[0] @ box[1] / (a * b)
        frame = _record(struct.pack("<6d", a, gamma, b, beta, alpha, c))
        frame += b"".join(_record(np.ascontiguousarray(column, dtype="<f4").tobytes()) for column in np.asarray(positions).T)
        self._file.write(frame)
        self._count(self._frames + 1)
        if step is not None:
            self._file.replace(_LAST_AT, struct.pack("<i", min(step, _MOST)))

    def _count(self, frames: int) -> None:
        self._frames = frames
        self._file.replace(_COUNT_AT, struct.pack("<i", frames))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _record(content: bytes) -> bytes:
    """A Fortran record: the content between two copies of its length."""
    length = struct.pack("<i", len(content))
    return length + content + length
