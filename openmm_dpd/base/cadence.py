"""How often a reporter reports."""

from .units import whole_number


class Cadence:
    """Base of reporters: a report every ``interval`` steps; ``what`` comes then, for the error."""

    #: Parts of the State that OpenMM hands over, and whether their positions are folded into the box; None: as OpenMM finds right.
    _INCLUDE: tuple[str, ...] = ()
    _FOLDED: bool | None = None

    def __init__(self, interval: int, what: str = "reports"):
        self.interval = whole_number(interval, f"the interval between {what}, in steps,", least=1)

    def describeNextReport(self, simulation):
        """Steps until the next report, and what is wanted in the State that OpenMM hands over."""
        steps = self.interval - simulation.currentStep % self.interval
        return {"steps": steps, "periodic": self._FOLDED, "include": list(self._INCLUDE)}
