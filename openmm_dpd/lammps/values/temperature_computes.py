"""Temperature computes: ``temp``, ``temp/partial``, ``temp/deform`` and ``temp/profile``."""

from collections.abc import Callable

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Compute, Temperature
from .compute_spec import ComputeSpec

#: Divisions of the box, by the axes that are cut.
_CUTS = ("x", "y", "z", "xy", "yz", "xz", "xyz")


def _whole(state: DeckState, group: str, words: list[str]) -> Temperature:
    read.count(words, "compute ID group temp (and no more)", 0)
    return Temperature()


def _deform(state: DeckState, group: str, words: list[str]) -> Temperature:
    read.count(words, "compute ID group temp/deform (and no more)", 0)
    return Temperature(deformed=True)


def _flags(words: list[str], what: str) -> tuple[bool, bool, bool]:
    x, y, z = (read.integer(word, f"a flag of compute {what}", 0) > 0 for word in words)
    return x, y, z


def _partial(state: DeckState, group: str, words: list[str]) -> Temperature:
    read.count(words, "compute ID group temp/partial xflag yflag zflag", 3)
    return Temperature(_flags(words, "temp/partial"))


def _profile(state: DeckState, group: str, words: list[str]) -> Temperature:
    usage = "compute ID group temp/profile xflag yflag zflag x|y|z|xy|yz|xz|xyz N ... [out tensor|bin]"
    read.count(words, usage, 5, None)
    streaming = _flags(words[:3], "temp/profile")
    if not any(streaming):
        raise ParameterError("compute temp/profile subtracts nothing: at least one of its flags must be 1")
    axes = read.choice(words[3], "the division of compute temp/profile", _CUTS)
    read.count(words, usage, 4 + len(axes), None)
    bins = [1, 1, 1]
    for axis, word in zip(axes, words[4:], strict=False):
        bins["xyz".index(axis)] = read.integer(word, f"the number of bins along {axis}", 1)
    options = read.single(words[4 + len(axes) :], "compute temp/profile", out="tensor")
    table = read.choice(options["out"], "out", ("tensor", "bin")) == "bin"
    # the overall mean velocity is subtracted with those of the bins
    return Temperature(streaming=streaming, bins=(bins[0], bins[1], bins[2]), table=table, extra=3.0 - sum(streaming))


def _of_bins(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Number of beads and temperature of each bin."""
    settings: Temperature = compute.settings
    masses, velocities, numbers = moment.thermal(compute)
    assert numbers is not None
    counts = np.bincount(numbers, minlength=settings.count)
    sums = np.bincount(numbers, masses * np.sum((velocities * moment.units.velocity) ** 2, axis=1), settings.count)
    # each bead has its share of the uncounted degrees of freedom
    freedom = counts * (3 - settings.extra / max(len(masses), 1)) - sum(settings.streaming)
    kT = np.divide(sums, freedom, out=np.zeros(settings.count), where=(freedom > 0) & (counts > 0))
    return np.column_stack([counts, kT / moment.units.thermal_energy])


def _spec(prepare: Callable[[DeckState, str, list[str]], Temperature]) -> ComputeSpec:
    return ComputeSpec(
        prepare,
        lambda moment, compute: moment.temperature(compute),
        lambda moment, compute: moment.kinetic_tensor(compute) / moment.units.energy,
        array=_of_bins,
        rows=lambda compute: compute.settings.count if compute.settings.table else 0,
        columns=lambda compute: 2,
        extensive_vector=True,
        size=lambda compute: 0 if compute.settings.table else 6,
    )


TEMPERATURES: dict[str, ComputeSpec] = {
    "temp": _spec(_whole),
    "temp/partial": _spec(_partial),
    "temp/deform": _spec(_deform),
    "temp/profile": _spec(_profile),
}
