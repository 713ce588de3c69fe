"""DCD trajectories: float32 angstrom, in a file that is whole after every frame."""

import os
import struct

import numpy as np

from ..base.files import BlockFile

#: Where the header holds the number of frames and the last step, and how long it is.
_COUNT_AT, _LAST_AT, _HEADER = 8, 20, 276
_MOST = 2**31 - 1


class DCDWriter:
    """Writes a DCD file in CHARMM's layout, which mdtraj, MDAnalysis and VMD read.

    The file is whole after every frame, and stays so if the next one cannot be written.

    Parameters
    ----------
    path : path-like
    n_beads : int
        Number of beads of every frame.
    what : str
        What it is, for errors.
    append : bool, default False
        Go on with the frames of a file that this class has written; otherwise the file is written anew.
    first, every, dt
        What the header says: the first step, steps between frames, and the time of a step.

    Raises
    ------
    OutputError
        If it cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike, n_beads: int, what: str, append: bool = False, first: int = 0, every: int = 1, dt: float = 1.0
    ):
        self._frames, self._n_beads = 0, n_beads
        self._file = BlockFile(path, what, append)
        if append:
            # six numbers of the box and three columns; the header may have counted frames that were cut off
            self._count((os.path.getsize(path) - _HEADER) // (56 + 3 * (4 * n_beads + 8)))
            return
        # 20 numbers: frames, first step and interval among them; the last one is CHARMM's version, the eleventh says that there is a box
        control = struct.pack("<9if10i", 0, min(first, _MOST), min(every, _MOST), *[0] * 6, dt, 1, *[0] * 8, 24)
        title = struct.pack("<i80s80s", 2, b"openmm-dpd".ljust(80), b"".ljust(80))
        self._file.write(_record(b"CORD" + control) + _record(title) + _record(struct.pack("<i", n_beads)))

    def write(self, positions: np.ndarray, box: np.ndarray, step: int | None = None) -> None:
        """Add a frame: positions (N, 3) and box vectors (3, 3) in angstrom; and the last ``step`` to the header."""
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
    """A Fortran record: its length on both sides."""
    length = struct.pack("<i", len(content))
    return length + content + length
