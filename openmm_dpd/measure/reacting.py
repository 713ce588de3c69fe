"""Reporter of bonds that form and break."""

import os
from typing import TextIO

from ..base.errors import ParameterError
from ..kernels.reactions import Event
from ..simulation.built import BuiltSystem
from .observer import require_built
from .reporters import RowReporter


class ReactionReporter(RowReporter):
    """Reporter that writes a row for each bond that was made or broken to a CSV file, every ``interval`` steps those of all steps since.

    The columns are the step, the number of the reaction in the scene's ``reactions``, the change (1 or -1), the two beads, the length of
    the bond then (nm), and by how much that changed its energy (kJ/mol).  With ``append``, rows of steps that are still to come
    are removed from the file first.  :class:`openmm_dpd.FieldReporter` writes all bonds that there are.
    """

    _columns = ("step", "reaction", "change", "i", "j", "length", "energy")

    def __init__(self, file: str | os.PathLike | TextIO, interval: int, built: BuiltSystem, append: bool = False):
        require_built(built, "a ReactionReporter")
        if not built.plan.scene.reactions:
            raise ParameterError("the bonds of this scene neither form nor break: there is nothing to report")
        super().__init__(interval)
        self._events, self._again = list[Event](), append and isinstance(file, (str, os.PathLike))
        self._open(file, append)
        built.integrator.whole.heard.append(self._events)  # type: ignore[union-attr]

    def describeNextReport(self, simulation):
        """Steps until the next report, and what it needs."""
        if self._again:
            with open(self._out.name) as there:
                header, *rows = there.readlines()
            kept = [row for row in rows if int(row.partition(",")[0]) <= simulation.currentStep]
            os.truncate(self._out.name, len("".join([header, *kept])))
            self._again = False
        return super().describeNextReport(simulation)

    def report(self, simulation, state):
        """Write the rows of the steps since the last report."""
        for event in self._events:
            self._write([str(value) if isinstance(value, int) else f"{value:.10g}" for value in event])
        self._events.clear()
