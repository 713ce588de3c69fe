"""XTC trajectories: compressed positions in nm, in a file that is complete after every frame."""

import errno
import os
import struct
import tempfile
from pathlib import Path

import numpy as np

from ..base.errors import RunError
from ..base.files import BlockFile, writing
from ..base.openmm_private import xtc_write_frame

#: Parts of a nm that the library rounds to, and the place of this number in a frame; frames of up to nine beads are not rounded.
_PRECISION, _PLACE, _MOST_PLAIN = 1000, slice(56, 60), 9


class XTCWriter:
    """Writes an XTC file, frame by frame, with positions rounded to 1/``precision`` nm, by default 0.001 nm as in GROMACS and mdtraj.
    A frame that cannot be written raises OutputError and leaves the file as it was.  ``append`` keeps existing frames."""

    def __init__(self, path: str | os.PathLike, n_beads: int, what: str, append: bool = False, precision: int = _PRECISION):
        self._file, self._n_beads, self._what, self._precision = BlockFile(path, what, append), n_beads, what, precision

    def write(self, positions: np.ndarray, box: np.ndarray, time: float, step: int) -> None:
        """Append a frame: positions (N, 3) and box vectors (3, 3) in nm, time in ps.  The format has 32 bits for steps, so larger ones wrap
        to 0.  RunError if a position is too large for the format."""
        assert len(positions) == self._n_beads
        if not self._n_beads:
            return  # neither the library nor LAMMPS writes frames without beads
        largest = (2**31 - 1) / self._precision  # whole numbers in 32 bits
        if not np.abs(positions).max(initial=0.0) < largest:
            raise RunError(
                f"a position beyond {largest:.4g} nm does not fit into an XTC file of precision {self._precision}; write a DCD file"
            )
        # the library has one precision: lengths are scaled, and the frame's own precision is overwritten
        scale = self._precision / _PRECISION if self._n_beads > _MOST_PLAIN else 1.0
        arrays = (np.array(values, dtype=np.float32, order="C") for values in (scale * positions, box))
        with writing(self._file.path, self._what), tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "frame.xtc"  # the library writes files by name only
            xtc_write_frame(os.fsencode(path), *arrays, np.float32(time), np.int32(step % 2**31))
            frame = path.read_bytes()
            if len(frame) != _length(frame):  # the library raises no error
                raise OSError(errno.ENOSPC, f"no space in the folder for temporary files, {folder}")
        if scale != 1.0:
            frame = frame[: _PLACE.start] + struct.pack(">f", self._precision) + frame[_PLACE.stop :]
        self._file.write(frame)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _length(frame: bytes) -> int:
    """Number of bytes that a frame must have: up to nine beads are not compressed; with more, the header has the length."""
    beads = int.from_bytes(frame[52:56], "big")
    if beads <= _MOST_PLAIN:
        return 56 + 12 * beads
    return 92 + (int.from_bytes(frame[88:92], "big") + 3) // 4 * 4
