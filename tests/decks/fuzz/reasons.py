"""Where the two programs are known to part, on purpose: docs/decks/differences.md has the same list in full."""

import re

#: (area or None, what LAMMPS says, what ours says, the reason); a pattern of None fits everything.
EXPECTED: tuple[tuple[str | None, str | None, str | None, str], ...] = (
    (
        None,
        r"not computed at compatible time|was not computed|between runs is not current",
        None,
        "here an average that is read in between is the last one",
    ),
    (None, r"cannot set output array intensive/extensive", None, "LAMMPS does not say whether a vector beside a table is a sum"),
    (None, r"Thermo style does not use", None, "here a compute may be named that the present columns do not show"),
    (None, r"Unexpected empty line in \w+Coeffs section[^\0]*lammps_out.data", None, "LAMMPS cannot read what it writes for styles zero"),
    (None, r"Atom IDs must be consecutive for velocity create", None, "numbers belong to ids here, consecutive or not"),
    (None, r"Mismatched compute in variable formula", None, "LAMMPS takes sums over beads in formulas of single beads at some places only"),
    (None, r"Two fix commands using same compute chunk/atom", None, "LAMMPS ties the chunks of a compute to one fix at a time"),
    (None, r"in variable requires thermo to use/init", None, "LAMMPS computes in formulas what the thermo output computes"),
    (None, r"Fix momentum group has no atoms", None, "nothing is taken out of no beads"),
    (None, r"Failed to reorder neighbor lists", None, "LAMMPS asks for reports of this one"),
    (None, r"Cannot reset timestep with active dump", None, "frames are counted anew here"),
    (None, r"coord/atom cutoff is longer than pairwise cutoff", None, "neighbours are counted at any distance here"),
    (None, r"exceeds ghost atom range|requires ghost atoms store velocity|Rigid body extent", None, "there are no ghosts here"),
    (None, r"Must use variable energy with fix addforce", None, "a minimisation follows forces that are no gradients here"),
    (None, r"does not support compute pair/local", None, "pairs of all styles have forces here"),
    (None, r"Lost atoms|Non-numeric|simulation unstable", None, "beads that fly apart: each program has its own bound"),
)


def why_expected(area: str, lammps: str, ours: str) -> str | None:
    """The reason why this is no failure; None if it is one."""
    for where, theirs, mine, reason in EXPECTED:
        fits = all(pattern is None or re.search(pattern, text) for pattern, text in ((theirs, lammps), (mine, ours)))
        if fits and where in (None, area):
            return reason
    return None
