"""XTC files of both programs as text."""

from pathlib import Path

import numpy as np
from mdtraj.formats import XTCTrajectoryFile


def texts(lammps: Path, ours: Path, precision: float = 1000.0) -> tuple[str, str]:
    """Steps, times, boxes and positions, single precision; positions one unit of the file's precision apart are LAMMPS's in both.

    LAMMPS may not have written what its buffer holds, and then says nothing.
    """
    if lammps.stat().st_size == 0:
        return "", ""
    left, right = _frames(lammps), _frames(ours)
    if left[0].shape == right[0].shape:
        near = np.abs(left[0] - right[0]) < 1.01 / precision + 1e-5 * np.abs(left[0])
        right = (np.where(near, left[0], right[0]), *right[1:])
    return _text(left), _text(right)


def _frames(path: Path) -> tuple[np.ndarray, ...]:
    with XTCTrajectoryFile(str(path)) as file:
        return file.read()


def _text(frames: tuple[np.ndarray, ...]) -> str:
    lines = []
    for x, time, step, box in zip(*frames, strict=True):
        lines.append(f"frame {step} {time:.5g} " + " ".join(f"{edge:.5g}" for edge in box.ravel()))
        lines += [" ".join(f"{value:.6g}" for value in row) for row in x]
    return "\n".join(lines) + "\n"
