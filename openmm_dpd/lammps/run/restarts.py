"""Restart files that are written while a run goes on."""

from copy import copy

import openmm

from ...build import BuiltSystem
from ...fields import read_fields
from ...files import write_whole
from ...names import COUNTER
from ..files.restart_file import restart_bytes
from .request import RunRequest
from .sampling import arrays


class RestartFiles:
    """Writes the files of ``restart N``: what ``write_restart`` would write if the run ended at that step."""

    def __init__(self, request: RunRequest, built: BuiltSystem, context: openmm.Context):
        self._request, self._built, self._context = request, built, context
        self._settings = request.state.restarts

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a file is written; the last step of the run without any."""
        every = self._settings.every
        return (step // every + 1) * every if every else self._request.last_step

    def write(self, step: int) -> None:
        """Write a file, if it is time; OutputError if it cannot be written."""
        settings = self._settings
        if not settings.every or step % settings.every or step == self._request.first_step:
            return
        state = copy(self._request.state)
        state.atoms = copy(state.atoms)
        x, v, box = arrays(self._context)
        state.write_back(x, v, box, read_fields(self._context, self._built.plan))
        state.step, state.runs = step, state.runs + 1
        if COUNTER in self._context.getParameters():
            state.noise_counter = self._context.getParameter(COUNTER)
        name = settings.files[settings.written % len(settings.files)]
        settings.written += 1
        write_whole(state.output_file(name, step), restart_bytes(state), "the restart file")
