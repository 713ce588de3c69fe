"""One record for each kind of pair coefficients, in a file of its own: what the rest of the package asks about it."""

from . import dpd, edpd, energy, mdpd, overlays, tdpd
from .record import KINDS, Beads, Kind, Overlay, kind_of, register, resolved_kind

__all__ = ["KINDS", "Beads", "Kind", "Overlay", "dpd", "edpd", "energy", "kind_of", "mdpd", "overlays", "register", "resolved_kind", "tdpd"]
