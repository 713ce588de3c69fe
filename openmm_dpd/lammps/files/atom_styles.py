"""Atom styles: what beads have beside position and velocity, and the columns of data files that say so."""

from collections.abc import Sequence

#: Columns of the Atoms section by atom style; ``tdpd`` has its concentrations after them.
ATOM_STYLES: dict[str, tuple[str, ...]] = {
    style: ("id", *columns.split(), "x", "y", "z")
    for style, columns in {
        **{"atomic": "type", "charge": "type charge", "bond": "molecule type", "angle": "molecule type", "molecular": "molecule type"},
        **{"full": "molecule type charge", "dpd": "type theta", "mdpd": "type rho", "edpd": "type temperature capacity", "tdpd": "type"},
    }.items()
}

#: Atom styles whose beads may be bonded.
BONDED_STYLES = ("bond", "angle", "molecular", "full")

#: What joins beads: how many each, and the atom styles that have it.
JOINED: dict[str, tuple[int, tuple[str, ...]]] = {
    "bond": (2, BONDED_STYLES),
    "angle": (3, ("angle", "molecular", "full")),
    "dihedral": (4, ("molecular", "full")),
}

#: Atom styles whose beads have charges.
CHARGED_STYLES = ("charge", "full")

#: Arrays of :class:`~openmm_dpd.lammps.state.atoms.Atoms` by their column in data files.
ARRAYS = {
    **{"charge": "charges", "molecule": "molecules", "theta": "thetas", "temperature": "temperatures", "capacity": "capacities"},
    "rho": "densities",
}


def atom_columns(styles: Sequence[str], n_species: int = 0) -> tuple[str, ...]:
    """Columns of the Atoms section, without image flags: of the atom style, or of several that follow ``hybrid``, with the columns ``c1``,
    ``c2``, ... of ``n_species`` concentrations of ``tdpd``."""
    plain = ATOM_STYLES["atomic"]
    columns = list(ATOM_STYLES[styles[0]] if len(styles) == 1 else plain)
    for style in styles:
        columns += [name for name in ATOM_STYLES[style] if len(styles) > 1 and name not in plain]
        columns += [f"c{k}" for k in range(1, n_species + 1)] if style == "tdpd" else []
    return tuple(columns)
