"""Errors before any line of the package."""

import sys
from collections.abc import Iterator
from pathlib import Path

import openmm_dpd as dpd

PACKAGE = str(Path(dpd.__file__).parent)


class Lines:
    """Counts the lines of the package (or of files whose paths begin with something else) that are carried out, and raises an error before one of them."""

    def __init__(self, at: int = 0, error: BaseException | None = None, files: str = PACKAGE):
        self.at, self.error, self.files, self.functions = at, error, files, []
        self.calls: dict[tuple, list[int]] = {}  # A line behind the lines that led to it -> when it is carried out, counted from 1.

    def __enter__(self):
        self.before = sys.gettrace()
        sys.settrace(self._call)
        return self

    def __exit__(self, *_):
        sys.settrace(self.before)

    def _call(self, frame, event, argument):
        return self._line if frame.f_code.co_filename.startswith(self.files) else None

    def _line(self, frame, event, argument):
        if event == "line":
            self.functions.append(frame.f_code.co_name)
            if len(self.functions) == self.at:
                raise self.error
            if not self.at:
                self.calls.setdefault(tuple(self._path(frame)), []).append(len(self.functions))
        return self._line

    def _path(self, frame) -> Iterator[tuple]:
        """Lines from this one outwards; of functions that call themselves, once."""
        before = None
        while frame is not None and frame.f_code.co_filename.startswith(PACKAGE):
            if frame.f_code is not before:
                yield frame.f_code, frame.f_lineno
            before, frame = frame.f_code, frame.f_back

    @property
    def places(self) -> list[int]:
        """When each line is carried out for the first and for the last time, behind the same lines."""
        return sorted({at for its in self.calls.values() for at in (its[0], its[-1])})
