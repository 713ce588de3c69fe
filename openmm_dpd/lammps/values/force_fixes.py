"""Forces on single beads as LAMMPS's fixes make them, one fix after the other: addforce adds, setforce replaces."""

from __future__ import annotations

import numpy as np

from ..state.records import FORCE_FIXES
from .resolver import Resolver


def acted_on(moment: Resolver, forces: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """What the fixes make of forces (N, 3), and the total force on the group of each before it acts; all in the deck's units."""
    found, before = forces.copy(), {}
    for fix in moment.state.fixes.values():
        if fix.style not in FORCE_FIXES:
            continue
        members = moment.state.group(fix.group)
        before[fix.name] = found[members].sum(axis=0)
        for k, word in enumerate(fix.parameters["force"]):
            if word != "NULL":
                value = moment.bead_variable(word[2:]) if word.startswith("v_") else float(word)
                kept = found[members, k] if fix.style == "addforce" else 0.0
                found[members, k] = kept + np.broadcast_to(value, len(found))[members]
    return found, before
