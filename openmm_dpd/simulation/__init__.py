"""A plan becomes a System, an integrator and a Simulation; steps, and what may change between them."""

from ..base.serialized import load_xml as load_xml
from .barostat import EnthalpyBarostat as EnthalpyBarostat, add_barostat as add_barostat
from .build import build as build, build_plan as build_plan
from .built import BuiltSystem as BuiltSystem
from .field_file import FieldReporter as FieldReporter, load_fields as load_fields
from .fields import read_fields as read_fields, write_fields as write_fields
from .mixed_system import MixedSystem as MixedSystem, create_mixed_system as create_mixed_system
from .thermostat import add_thermostat as add_thermostat
