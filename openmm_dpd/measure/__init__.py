"""Numbers from a live Context: temperatures, energies, pressures, momentum, forces term by term, stress, velocities; and reporters."""

from __future__ import annotations

from .flow import ProfileReporter, StressReporter
from .observer import Observer
from .reporters import DPDReporter
from .sample import Sample, SystemSample
from .temperature import kelvin, set_kT, set_temperature
from .terms import force_terms
from .velocities import VelocityReporter

__all__ = [
    "DPDReporter",
    "Observer",
    "ProfileReporter",
    "Sample",
    "StressReporter",
    "SystemSample",
    "VelocityReporter",
    "force_terms",
    "kelvin",
    "set_kT",
    "set_temperature",
]
