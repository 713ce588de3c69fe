"""View beads in a notebook, with nglview."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..base.errors import ParameterError, optional_package, what_is
from ..model.pairs import checked
from ..model.scene import Scene
from .snapshot import Snapshot, pdb_text

#: Colours of the types in their order, those of matplotlib; repeated if there are more types.
COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf")


def view(source, *, state=None, radii=None):
    """nglview widget with a sphere for each bead, coloured by type, sticks for bonds, and the edges of the box.

    Parameters
    ----------
    source : BuiltSystem or Scene
        A scene, or the result of :func:`openmm_dpd.build`, with at most 99,999 beads.
    state : openmm.State or openmm.Context, optional
        Positions and box of a run; by default those of the start.  Where reactions change bonds and types, a Context has those.
    radii : length, or mapping of types to lengths, optional
        Radii of the beads; by default a quarter of the cutoff between beads of the type.  0 hides a type.

    Returns
    -------
    nglview.NGLWidget

    Raises
    ------
    ParameterError
        If nglview is not installed, a radius is negative, missing or of an unknown type, or the beads do not fit into the PDB file that
        is passed to nglview.
    """
    nglview = optional_package("nglview", "view", "the view in a notebook needs")
    now = Snapshot.of(source, state)
    scene = now.scene
    sizes = radii_of(scene.type_names, default_radii(scene) if radii is None else radii)
    widget = nglview.NGLWidget(nglview.TextStructure(pdb_text(now), ext="pdb"))
    widget.clear_representations()
    for k, name in enumerate(scene.type_names):
        beads = np.flatnonzero(scene.type_ids == k)
        if len(beads) and sizes[name] > 0:
            colour = COLOURS[k % len(COLOURS)]
            widget.add_representation("spacefill", selection=_selection(beads), color=colour, radius=10 * sizes[name])
    bonded = np.unique(scene.bond_pairs)
    if len(bonded):
        thin = min([size for size in sizes.values() if size > 0], default=0.1) / 3
        widget.add_representation("licorice", selection=_selection(bonded), color="#555555", radius=10 * thin)
    if scene.box is not None:
        widget.add_representation("unitcell")
    widget.center()
    return widget


def _selection(beads: np.ndarray) -> str:
    """NGL selection of beads, by index: atom names in selections are upper case only."""
    return "@" + ",".join(map(str, beads.tolist()))


def default_radii(scene: Scene) -> dict[str, float]:
    """A quarter of the cutoff (nm) of each type with itself; of the largest cutoff where a type does not interact with itself."""
    reach: dict[tuple[str, str], float] = {}
    for pair, its in (item for table in scene.tables for item in table.resolve(scene.type_names).items()):
        reach[pair] = max(reach.get(pair, 0.0), getattr(its, "cutoff", 0.0))
    largest = max(reach.values(), default=0.0) or 1.0
    return {name: 0.25 * (reach.get((name, name)) or largest) for name in scene.type_names}


def radii_of(names: Sequence[str], given) -> dict[str, float]:
    """Radius (nm) of every type, from one for all or a mapping."""
    named = given if isinstance(given, Mapping) else dict.fromkeys(names, given)
    wrong = sorted(map(str, set(named) ^ set(names)))
    if wrong:
        raise ParameterError(f"radii must have one entry for each of the types {', '.join(names)}; {wrong[0]} is missing or unknown")
    return {name: checked(size, "length", f"the radius of type {what_is(name)}") for name, size in named.items()}
