"""Forces on single beads as LAMMPS's fixes make them, one fix after the other: addforce and gravity add, setforce replaces."""

import numpy as np

from ..state.records import FORCE_FIXES
from .resolver import Resolver, evaluate_beads


def acted_on(moment: Resolver, forces: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """What the fixes make of forces (N, 3), and the total force on the group of each before it acts; all in the deck's units."""
    found, before = forces.copy(), {}
    for fix in moment.state.fixes_of(*FORCE_FIXES):
        members = moment.state.group(fix.group)
        before[fix.name] = found[members].sum(axis=0)
        for k, word in enumerate(fix.parameters["force"]):
            if word != "NULL":
                kept = 0.0 if fix.style == "setforce" else found[members, k]
                found[members, k] = kept + evaluate_beads(word, moment, len(found))[members]
    return found, before
