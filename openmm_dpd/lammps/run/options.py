"""Options that override settings of a deck."""

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path

from ...base.errors import ParameterError, require_one, what_is
from ...base.units import whole_number
from ...kernels.engines import engine_kind
from ...runtime import get_threads
from .deck import read_deck
from .request import RunRequest
from .trajectory import FORMATS

#: Platforms with a fixed precision.
FIXED_PRECISION = {"Reference": "double", "CPU": "mixed"}


@dataclass(frozen=True)
class RunOptions:
    """Settings that override those of a deck; None keeps the deck's."""

    platform: str | None = None  #: OpenMM platform (default: the fastest)
    precision: str | None = None  #: Precision of the platform
    scheme: str | None = None  #: Integration scheme of every run
    dt: float | None = None  #: Time step of every run, in the deck's units
    steps: int | None = None  #: Number of steps of every run
    seed: int | None = None  #: Seed of the noise
    threads: int | None = None  #: Threads of OpenMM's CPU platform and of the pair kernel
    #: Steps to exclude from averages at the start of every run of at least this length (default: those before equilibrium)
    discard: int | None = None
    conservative: str = "auto"  #: Where the conservative force is computed, see :func:`openmm_dpd.plan.plan.make_plan`
    engine: str = "auto"  #: What evaluates the pair terms, see :func:`openmm_dpd.plan.plan.make_plan`
    compat: str = "consistent"  #: ``consistent``, or ``lammps`` for the heat of pair style edpd as LAMMPS computes it
    checkpoint: int | None = None  #: Steps between two checkpoints; by default one is written when a run ends or is interrupted
    every: int | None = None  #: Steps between two frames of the trajectory (default: a hundredth of the run, at least 100)
    format: str = "dcd"  #: Format of the trajectory: ``dcd`` or ``xtc``

    def __post_init__(self):
        require_one(self.compat, ("consistent", "lammps"), "compat")
        if self.engine != "auto":
            engine_kind(self.engine)  # raises if unknown
        if self.format not in FORMATS:
            raise ParameterError(f"format must be {' or '.join(FORMATS)}, not {what_is(self.format)}")
        for name, low in (("steps", 0), ("threads", 1), ("discard", 0), ("seed", 0), ("checkpoint", 1), ("every", 1)):
            value = getattr(self, name)
            if value is not None and whole_number(value, name) < low:
                raise ParameterError(f"{name} must be at least {low}, but is {value}")
        if self.seed is not None and self.seed >= 2**31:
            raise ParameterError(f"seed must be less than 2^31, but is {self.seed}")
        if self.dt is not None and not (isinstance(self.dt, Real) and self.dt > 0):
            raise ParameterError(f"dt must be > 0, but is {what_is(self.dt)}")

    def properties(self, platform: str) -> dict[str, str]:
        """Properties of the OpenMM platform."""
        fixed = FIXED_PRECISION.get(platform)
        if fixed and self.precision not in (None, fixed):
            raise ParameterError(f"the {platform} platform only has {fixed} precision, not {self.precision}")
        if fixed:
            return {"Threads": str(get_threads())} if platform == "CPU" else {}
        return {"Precision": self.precision} if self.precision else {}


def first_request(path: str | Path, options: RunOptions, variables: Mapping[str, str] | None) -> RunRequest:
    """The request of a deck's first run, with the options applied."""
    state = read_deck(path, variables=variables or {}, stop_before_first_run=True)
    assert state.first_run is not None
    return overridden(state.first_run, options)


def overridden(request: RunRequest, options: RunOptions) -> RunRequest:
    """The request with the options applied."""
    dt = None if options.dt is None else options.dt * request.state.units.time
    return request.override(steps=options.steps, dt=dt, scheme=options.scheme, compat=options.compat)
