"""One record for each kind of pair coefficients, bonds, angles, dihedrals and impropers, which the rest of the package asks."""

from . import dpd as dpd, fields as fields, overlays as overlays
from .bonded import (
    BONDED_KINDS as BONDED_KINDS,
    BondedKind as BondedKind,
    Energy as Energy,
    bonded_forces as bonded_forces,
    bonded_kind as bonded_kind,
    register_bonded as register_bonded,
)
from .record import (
    KINDS as KINDS,
    BeadData as BeadData,
    Kind as Kind,
    Resolved as Resolved,
    kind_for as kind_for,
    register as register,
    resolved_kind as resolved_kind,
)
