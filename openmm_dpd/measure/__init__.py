"""Measurements of a live Context: temperatures, energies, pressures, momentum, forces term by term, stress, velocities; and reporters."""

from .flow import ProfileReporter as ProfileReporter, StressReporter as StressReporter
from .observer import Observer as Observer
from .reacting import ReactionReporter as ReactionReporter
from .reporters import DPDReporter as DPDReporter, VelocityReporter as VelocityReporter
from .sample import Sample as Sample, SystemSample as SystemSample
from .shadow_work import ShadowWorkReporter as ShadowWorkReporter
from .slabs import SlabStressReporter as SlabStressReporter
from .temperature import kelvin as kelvin, set_kT as set_kT, set_temperature as set_temperature
from .terms import force_terms as force_terms
from .unbiased import UnbiasedTemperatureReporter as UnbiasedTemperatureReporter
from .wall_forces import SolidReporter as SolidReporter, WallReporter as WallReporter
