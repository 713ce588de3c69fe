"""Computes of structure and motion: ``rdf``, ``msd``, ``vacf``, ``gyration``, neighbours, clusters, forces between two groups."""

from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy

from ...analysis.chains import gyration_tensors
from ...analysis.diffusion import mean_squares
from ...analysis.structure import distribution_of_counts
from ...base.errors import ParameterError
from ...base.geometry import pairs_within
from ...model.bonds import bonded_neighbours
from ..language import arguments as read
from ..state.deck_state import DeckState, pairs_left_out
from ..state.moment import DeckMoment, Window
from ..state.records import Compute
from ..styles.pair_styles import pair_tables
from .compute_spec import ComputeSpec, no_arguments
from .local import pairs_of
from .per_bead import check_carried


# -- compute rdf --------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Distribution:
    """Settings of a compute rdf: number of bins, the two sets of bead types of each g(r), and the largest distance (deck units) if
    given."""

    bins: int
    types: tuple[tuple[range, range], ...]
    cutoff: float | None


def parse_distribution(state: DeckState, group: str, words: list[str]) -> Distribution:
    """Parse the arguments of ``rdf Nbin itype1 jtype1 itype2 jtype2 ... cutoff Rcut``."""
    usage = "compute ID group rdf Nbin itype1 jtype1 ... [cutoff Rcut]"
    read.count(words, usage, 1, None)
    if not all(state.periodic):
        raise ParameterError("compute rdf: the box must be periodic along x, y and z")
    at = words.index("cutoff") if "cutoff" in words else len(words)
    types, options = words[1:at], words[at:]
    if len(types) % 2 or len(options) not in (0, 2):
        raise ParameterError(f"compute rdf: expected pairs of types, and one value after cutoff: {usage}")
    sets = [read.numeric_range(word, state.n_types, "atom type") for word in types or ("*", "*")]
    return Distribution(
        read.integer(words[0], "the number of bins of compute rdf", 1),
        tuple(zip(sets[::2], sets[1::2], strict=True)),
        read.positive(options[1], "the cutoff of compute rdf") if options else None,
    )


def _longest_cutoff(moment: DeckMoment) -> float:
    """Longest cutoff of the pair forces, charges included, in deck units."""
    cutoffs = [
        getattr(entry, "cutoff", 0.0) / moment.units.length for table in pair_tables(moment.state) for entry in table.entries.values()
    ]
    styles = moment.state.pair.styles
    cutoffs += [style.settings.get("cutoff_charges", 0.0) for style in styles]
    cutoffs += [style.cutoff(entry) or 0.0 for style in styles if style.name == "zero" for entry in style.coefficients.values()]
    if not max(cutoffs, default=0.0) > 0:
        raise ParameterError("compute rdf needs a pair force, or the keyword cutoff")
    return max(cutoffs)


def hidden(state: DeckState, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Which of the pairs i < j LAMMPS's neighbour lists leave out: bonded neighbours with factors 0, and those that the deck excludes."""
    n = len(state.atoms)
    shells = bonded_neighbours(state.atoms.index_of(state.bonds[:, 1:].ravel()).reshape(-1, 2), n)
    off = (pairs for k, pairs in shells.items() if not state.special[k - 1] and not state.special_charges[k - 1])
    bonded = np.isin(i * n + j, np.array([a * n + b for pairs in off for a, b in pairs], dtype=np.int64))
    return bonded | pairs_left_out(state, state.atoms.types, lambda values: values, i, j)


def _distribution(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Centres of the bins, then g(r) and the number of neighbours up to r for each pair of sets of types."""
    settings: Distribution = compute.settings
    state, box = moment.state, moment.box
    reach = settings.cutoff or _longest_cutoff(moment)
    member = np.flatnonzero(state.group(compute.group))
    types = state.atoms.types[member]
    i, j, r = pairs_within(moment.folded[0][member], None, box.reduced_vectors, reach)
    kept = ~hidden(state, member[i], member[j])
    i, j, r = i[kept], j[kept], r[kept]
    bins = (r * (1 / (reach / settings.bins))).astype(np.int64)
    inside = bins < settings.bins
    i, j, bins = i[inside], j[inside], bins[inside]
    edges = np.arange(settings.bins + 1) * (reach / settings.bins)
    columns = [0.5 * (edges[1:] + edges[:-1])]
    for first, second in settings.types:
        a, b = np.isin(types, first), np.isin(types, second)
        counts = np.bincount(np.concatenate([bins[a[i] & b[j]], bins[a[j] & b[i]]]), minlength=settings.bins)
        # a bead is not its own neighbour
        pairs = a.sum() * b.sum() - (a & b).sum()
        columns.append(
            distribution_of_counts(counts, edges, float(pairs), box.volume, state.dimension) if pairs > 0 else np.zeros(settings.bins)
        )
        columns.append(np.cumsum(counts) / a.sum() if pairs > 0 else np.zeros(settings.bins))
    return np.column_stack(columns)


# -- compute msd --------------------------------------------------------------------------------------------------------------
@dataclass
class Displacements:
    """Settings of a compute msd, and its reference positions."""

    com: bool  #: Whether the motion of the group's centre of mass is subtracted
    average: bool  #: Whether displacements are relative to the mean of all positions so far
    origin: np.ndarray  #: (n, 3) reference positions of the group (deck units)
    count: int = 1  #: Number of positions in the mean ``origin``
    _seen: tuple[Window, int] | None = field(default=None, repr=False)

    def include(self, moment: DeckMoment, positions: np.ndarray) -> None:
        """Add the positions of a step to the mean, once per step of a run."""
        if not self.average or moment.window is None or (self._seen and self._seen[0] is moment.window and self._seen[1] == moment.step):
            return
        self._seen = (moment.window, moment.step)
        self.origin = (self.origin * self.count + positions) / (self.count + 1)
        self.count += 1


def parse_displacements(state: DeckState, group: str, words: list[str]) -> Displacements:
    """Parse the arguments of ``msd [com yes|no] [average yes|no]``; the present positions become the reference."""
    options = read.single(words, "compute msd", com="no", average="no")
    if group in state.dynamic:
        raise ParameterError(f"compute msd: group {group} is dynamic, which is not supported, as in LAMMPS")
    com = read.switch(options["com"], "com")
    atoms = state.atoms
    origin = _members(state, state.require_box("compute msd").unwrap(atoms.positions, atoms.images), group, com)
    return Displacements(com, read.switch(options["average"], "average"), origin)


def _members(state: DeckState, unwrapped: np.ndarray, group: str, com: bool) -> np.ndarray:
    """Unwrapped positions of a group, relative to its centre of mass if ``com``."""
    mask = state.group(group)
    return unwrapped[mask] - (state.mass_average(unwrapped, mask) if com and mask.any() else 0.0)


def _displacements(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Mean squared displacements along x, y, z, and their sum."""
    settings: Displacements = compute.settings
    positions = _members(moment.state, moment.unwrapped, compute.group, settings.com)
    if len(positions) != len(settings.origin):
        raise ParameterError(
            f"compute {compute.name} (style msd): its group has {len(positions)} beads, but had {len(settings.origin)} at its definition"
        )
    if not len(positions):
        return np.zeros(4)
    settings.include(moment, positions)
    squares = mean_squares(settings.origin, positions)
    return np.append(squares, squares.sum())


# -- compute gyration ---------------------------------------------------------------------------------------------------------
def _gyration_tensor(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Gyration tensor of the group: xx, yy, zz, xy, xz, yz."""
    mask = moment.state.group(compute.group)
    if not mask.any():
        return np.zeros(6)
    return gyration_tensors(moment.unwrapped[mask], moment.state.bead_masses()[mask], np.zeros(mask.sum(), dtype=np.int64))[0]


# -- compute vacf -------------------------------------------------------------------------------------------------------------
def _start_velocities(state: DeckState, group: str, words: list[str]) -> np.ndarray:
    no_arguments("vacf")(state, group, words)
    return state.atoms.velocities[state.group(group)]


def _autocorrelation(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Means of v(0) v along x, y, z, and their sum; v(0) are the velocities at the definition."""
    before, now = compute.settings, moment.velocities[moment.state.group(compute.group)]
    if len(before) != len(now):
        raise ParameterError(f"compute {compute.name} (style vacf): its group had {len(before)} beads at its definition, now {len(now)}")
    found = np.mean(before * now, axis=0) if len(now) else np.zeros(3)
    return np.append(found, found.sum())


# -- neighbours and clusters --------------------------------------------------------------------------------------------------
class Neighbourhood(NamedTuple):
    """Settings of computes of neighbours: the cutoff (0 for bonds alone), the group of the neighbours, sets of their types."""

    cutoff: float
    group: str = "all"
    types: tuple[range, ...] = ()


def _parse_neighbours(style: str, state: DeckState, group: str, words: list[str]) -> Neighbourhood:
    if style == "fragment/atom":
        read.single(words, "compute fragment/atom", single="no")
        return Neighbourhood(0.0)
    if style != "coord/atom":
        read.count(words, f"compute ID group {style} cutoff", 1)
        return Neighbourhood(read.positive(words[0], f"the cutoff of compute {style}"))
    read.count(words, "compute ID group coord/atom cutoff R [group G] [type type ...]", 2, None)
    read.choice(words[0], "the criterion of compute coord/atom", ("cutoff",))
    named, kinds = (words[3:4], words[4:]) if words[2:3] == ["group"] else (["all"], words[2:])
    state.group("".join(named))
    types = tuple(read.numeric_range(word, state.n_types, "atom type") for word in kinds or ("*",))
    return Neighbourhood(read.positive(words[1], "the cutoff of compute coord/atom"), named[0], types)


def _neighbours(moment: DeckMoment, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of beads within a distance, but for bonded ones whose factor is 0."""
    state = moment.state
    i, j, r = pairs_within(moment.folded[0], None, moment.box.reduced_vectors if any(state.periodic) else None, reach)
    kept = (r < reach) & ~hidden(state, i, j)
    return i[kept], j[kept]


def _coordination(moment: DeckMoment, compute: Compute) -> np.ndarray:
    state, settings = moment.state, compute.settings
    one, other = _neighbours(moment, settings.cutoff)
    i, j = np.concatenate([one, other]), np.concatenate([other, one])
    counted, n = state.group(settings.group)[j] & state.group(compute.group)[i], len(state.atoms)
    columns = [np.bincount(i[counted & np.isin(state.atoms.types[j], kinds)], minlength=n) for kinds in settings.types]
    return np.stack(columns, axis=1).astype(float) if len(columns) > 1 else columns[0].astype(float)


def _clusters(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Smallest id of the beads of the group that neighbours (aggregates: and bonds; fragments: bonds alone) join to each bead; 0 for beads
    outside, and for those without a bond in a fragment unless ``single yes``."""
    state, mask, n = moment.state, moment.state.group(compute.group), len(moment.state.atoms)
    i, j = _neighbours(moment, compute.settings.cutoff) if compute.settings.cutoff else np.zeros((2, 0), int)
    if compute.style != "cluster/atom":
        ends = state.atoms.index_of(state.bonds[:, 1:].ravel()).reshape(-1, 2)
        i, j = np.append(i, ends[:, 0]), np.append(j, ends[:, 1])
    inside = mask[i] & mask[j]
    _, label = scipy.sparse.csgraph.connected_components(
        scipy.sparse.coo_array((np.ones(inside.sum()), (i[inside], j[inside])), shape=(n, n)), directed=False
    )
    least = np.full(n, np.inf)
    np.minimum.at(least, label, state.atoms.ids)
    single = compute.style != "fragment/atom" or compute.arguments[-1:] == ("yes",)
    return np.where(mask & (single | np.isin(np.arange(n), [i, j])), least[label], 0.0)


# -- compute group/group ------------------------------------------------------------------------------------------------------
class Between(NamedTuple):
    """Settings of compute group/group: the other group, and which molecules the pairs may be of."""

    group: str
    molecule: str = "off"


def _parse_between(state: DeckState, group: str, words: list[str]) -> Between:
    read.count(words, "compute ID group group/group group2 [pair yes] [kspace no] [molecule off|inter|intra]", 1, None)
    state.group(words[0])
    only = {"pair": (read.YES, ""), "kspace": (read.NO, "charges have no forces of single pairs here")}
    sizes = dict.fromkeys(("pair", "kspace", "boundary", "molecule"), 1)
    found = dict(read.options(words[1:], sizes, "compute group/group", only=only))
    molecule = read.choice(found.get("molecule", ["off"])[0], "molecule", ("off", "inter", "intra"))
    if molecule != "off":
        check_carried(state, "mol")
    return Between(words[0], molecule)


def _between(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Energy, and force on the group, of its pairs with the other group."""
    state, settings = moment.state, compute.settings
    one, other = state.group(compute.group), state.group(settings.group)
    beads, values = pairs_of(moment, compute)
    i, j = beads.T
    along, against = one[i] & other[j], one[j] & other[i]
    if settings.molecule != "off":
        alike = state.atoms.molecules[i] == state.atoms.molecules[j]
        along, against = ((each & (alike == (settings.molecule == "intra"))) for each in (along, against))
    total = np.append(values[along | against, 0].sum(), values[along, 1:].sum(axis=0) - values[against, 1:].sum(axis=0))
    return total / ([moment.units.energy] + 3 * [moment.units.force])


#: Computes of structure and motion.
STRUCTURE: dict[str, ComputeSpec] = {
    "rdf": ComputeSpec(
        array=_distribution,
        rows=lambda compute: compute.settings.bins,
        columns=lambda compute: 1 + 2 * len(compute.settings.types),
        prepare=parse_distribution,
    ),
    "msd": ComputeSpec(vector=_displacements, size=lambda compute: 4, prepare=parse_displacements),
    "gyration": ComputeSpec(
        no_arguments("gyration"),
        lambda moment, compute: float(np.sqrt(_gyration_tensor(moment, compute)[:3].sum())),
        _gyration_tensor,
        size=lambda compute: 6,
    ),
    "vacf": ComputeSpec(vector=_autocorrelation, size=lambda compute: 4, prepare=_start_velocities),
    "coord/atom": ComputeSpec(
        partial(_parse_neighbours, "coord/atom"),
        per_bead=_coordination,
        columns=lambda compute: len(compute.settings.types) if len(compute.settings.types) > 1 else 0,
    ),
    **{
        style: ComputeSpec(partial(_parse_neighbours, style), per_bead=_clusters)
        for style in ("cluster/atom", "fragment/atom", "aggregate/atom")
    },
    "group/group": ComputeSpec(
        _parse_between,
        lambda moment, compute: float(_between(moment, compute)[0]),
        lambda moment, compute: _between(moment, compute)[1:],
        extensive=True,
        size=lambda compute: 3,
    ),
}
