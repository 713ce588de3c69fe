"""What every room may use: errors and their wording, units, names of context parameters, geometry, files that are whole, averages.

It imports from no other room.
"""

from .errors import (
    DeckError as DeckError,
    DPDError as DPDError,
    OutputError as OutputError,
    ParameterError as ParameterError,
    PlanError as PlanError,
    ProgramError as ProgramError,
    RunError as RunError,
)
from .platforms import fastest_platform as fastest_platform
