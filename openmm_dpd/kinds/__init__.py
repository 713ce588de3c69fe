"""One record for each kind of pair coefficients, in a file of its own, which the rest of the package asks."""

from . import dpd, edpd, energy, mdpd, overlays, tdpd
from .record import KINDS, BeadData, Kind, Overlay, Resolved, kind_for, register, resolved_kind

__all__ = [
    "KINDS",
    "BeadData",
    "Kind",
    "Overlay",
    "Resolved",
    "dpd",
    "edpd",
    "energy",
    "kind_for",
    "mdpd",
    "overlays",
    "register",
    "resolved_kind",
    "tdpd",
]
