"""chi to first order in the excess repulsion, from overlaps of beads of different molecules, for molecules of any shape."""

import numpy as np
from openmm import app, unit

from ..analysis.frames import Beads, Trajectories, frames_of, of_types, two_selected
from ..analysis.unwrapping import molecule_labels
from ..base.errors import ParameterError
from ..base.geometry import connected, pairs_within
from ..base.stats import Average, block_average
from ..base.units import whole_number
from ..measure.observer import require_built
from ..model.pairs import SoftRepulsion, checked
from ..model.scene import Scene
from ..simulation.built import BuiltSystem

_NAME = "the slope of chi"


class _Contacts:
    """Sum of overlaps between two sets of beads, over pairs of different molecules, per bead."""

    def __init__(self, first: np.ndarray, second: np.ndarray, labels: np.ndarray, cutoff: float):
        count = len(labels)
        self.labels, self.cutoff = labels, cutoff
        self.first, self.second = (np.bincount(chosen, minlength=count).astype(float) for chosen in (first, second))
        own = np.bincount(labels, self.first) @ np.bincount(labels, self.second)
        if not len(first) * len(second) > own:
            raise ParameterError(f"there are no two beads of different molecules, which {_NAME} needs")
        self.scale = count / (len(first) * len(second))

    def __call__(self, x: np.ndarray, box: np.ndarray | None) -> float:
        if box is None:
            raise ParameterError(f"{_NAME} needs a periodic box")
        i, j, r = pairs_within(x, None, box, self.cutoff)
        # a pair with both beads in both sets counts twice
        weight = self.first[i] * self.second[j] + self.first[j] * self.second[i]
        apart = self.labels[i] != self.labels[j]
        return float(self.scale * np.sum((weight * (1 - r / self.cutoff) ** 2)[apart]) / 2)


def chi_slope(trajectory: Trajectories, beads: Beads = None, other: Beads = None, *, cutoff=1.0) -> Average:
    r"""chi per excess repulsion between beads of different molecules, to first order, from a trajectory without it.

    .. math::

        \frac{\chi_{ab}\, kT}{\Delta A\, r_c} = \frac{N}{N_a N_b}
        \left\langle \sum_{i \in a,\ j \in b,\ \mathrm{other\ molecule}} \tfrac{1}{2} (1 - r_{ij}/r_c)^2 \right\rangle .

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        In a periodic box.  Molecules are beads connected by bonds, or residues if there are no bonds.
    beads, other : str, sequence of str, array of int, or None
        Types (or indices) a and b; by default all beads, and b = a.
    cutoff : length, default 1
        r_c of the repulsion, nm.

    Returns
    -------
    openmm_dpd.base.stats.Average
        chi kT/(dA rc).

    Raises
    ------
    ParameterError
        If there is no box, the cutoff does not fit into it, or there are no pairs.

    Notes
    -----
    The free energy of mixing per bead is chi_ab times the fractions of a and b among all beads, so this is its derivative with respect to
    the repulsion between a and b, at the repulsion of the trajectory.  For whole molecules of a one-component fluid, labelled P and Q,
    chi is that of all beads with all: chi = dA rho integral (1 - r)^2/2 g(r) d^3r, with the intermolecular g.  Contacts within a molecule
    change its free energy wherever it is, and are left out.

    References
    ----------
    First-order perturbation theory, as in D. C. Morse and J. K. Chung, arXiv:0810.5389 (2008).
    """
    topology, frames = frames_of(trajectory)
    contacts = _Contacts(
        *two_selected(topology, beads, other), molecule_labels(topology), checked(cutoff, "length", "cutoff", positive=True)
    )
    return block_average([contacts(frame.positions, frame.box) for frame in frames], name=_NAME)


def measured_chi_slope(
    built: BuiltSystem,
    beads: Beads = None,
    other: Beads = None,
    *,
    steps: int = 5000,
    every: int = 10,
    settle: int = 1000,
    simulation: app.Simulation | None = None,
) -> Average:
    """chi per excess repulsion between beads of different molecules, to first order, from a run without it; :func:`chi_slope` has theory.

    Parameters
    ----------
    built : BuiltSystem
        A built scene with molecules of any kind, and a repulsion A (1 - r/rc) between the beads in question, such as
        :class:`openmm_dpd.DPD`.
    beads, other : str, sequence of str, array of int, or None
        Types (or indices) a and b; by default all beads, and b = a.
    steps, every, settle : int
        Steps of the run, steps between samples, and steps before the first sample.
    simulation : Simulation, optional
        A simulation of ``built``, to be continued; by default a new one.

    Returns
    -------
    openmm_dpd.base.stats.Average
        chi kT/(dA rc).

    Raises
    ------
    ParameterError
        If there is no box, no pair of different molecules, or the beads do not repel with A (1 - r/rc) and one cutoff.
    """
    require_built(built, "measured_chi_slope")
    scene = built.plan.scene
    if built.plan.host is not None or scene is None:
        raise ParameterError("measured_chi_slope needs a scene built by openmm_dpd.build(), not a System with atoms beside the beads")
    steps, every = whole_number(steps, "steps", least=1), whole_number(every, "every", least=1)
    settle = whole_number(settle, "settle", least=0)
    types = np.array(scene.types)
    first = of_types(types, beads, "beads")
    second = first if other is None else of_types(types, other, "other")
    contacts = _Contacts(first, second, connected(scene.bond_pairs, scene.n_beads), _cutoff(scene, first, second))
    running = built.simulation() if simulation is None else simulation
    running.step(settle)
    rows = []
    for _ in range(max(1, steps // every)):
        running.step(every)
        state = running.context.getState(positions=True)
        x = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        rows.append(contacts(x, None if scene.box is None else state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)))
    return block_average(rows, name=_NAME)


def _cutoff(scene: Scene, first: np.ndarray, second: np.ndarray) -> float:
    """Common cutoff (nm) of the repulsion A (1 - r/rc) between two sets of beads; ParameterError if there is none."""
    names = scene.type_names
    found = set()
    for a in np.unique(scene.type_ids[first]):
        for b in np.unique(scene.type_ids[second]):
            pair = (names[min(a, b)], names[max(a, b)])
            terms = [table.resolve(names).get(pair) for table in scene.tables]
            cutoffs = {term.cutoff for term in terms if isinstance(term, SoftRepulsion)}
            if not cutoffs:
                raise ParameterError(f"{_NAME} needs a repulsion A (1 - r/rc), which types {pair[0]} and {pair[1]} do not have")
            found |= cutoffs
    if len(found) > 1:
        raise ParameterError(f"{_NAME} needs one cutoff for all of the beads; they have {', '.join(f'{c:g}' for c in sorted(found))} nm")
    return found.pop()
