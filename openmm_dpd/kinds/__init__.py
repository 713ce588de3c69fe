"""One record for each kind of pair coefficients, in a file of its own, which the rest of the package asks."""

from . import dpd as dpd, edpd as edpd, energy as energy, mdpd as mdpd, overlays as overlays, tdpd as tdpd
from .record import (
    KINDS as KINDS,
    BeadData as BeadData,
    Kind as Kind,
    Resolved as Resolved,
    kind_for as kind_for,
    register as register,
    resolved_kind as resolved_kind,
)
