"""Errors before any line of the package."""

import sys
from pathlib import Path

import openmm_dpd as dpd

PACKAGE = str(Path(dpd.__file__).parent)


class Lines:
    """Counts the lines of the package (or of files whose paths begin with something else) that are carried out, and raises an error before one of them."""

    def __init__(self, at: int = 0, error: BaseException | None = None, files: str = PACKAGE):
        self.at, self.error, self.files, self.functions = at, error, files, []

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
        return self._line
