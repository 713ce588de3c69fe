"""Computes: values of groups of beads that thermo output and formulas can name."""

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import FIX_VALUES, Compute, FixValues, Temperature, Valued
from .chunk_computes import OF_CHUNKS
from .chunks import CHUNKS
from .compute_spec import ComputeSpec, check_place, no_arguments, reference
from .local import LOCAL
from .per_bead import BEAD_WORDS, PER_BEAD, check_carried
from .structure_computes import STRUCTURE

#: Divisions of the box, by the axes that are cut.
_CUTS = ("x", "y", "z", "xy", "yz", "xz", "xyz")


def _whole(state: DeckState, group: str, words: list[str]) -> Temperature:
    read.count(words, "compute ID group temp (and no more)", 0)
    return state.temperature()


def _deform(state: DeckState, group: str, words: list[str]) -> Temperature:
    read.count(words, "compute ID group temp/deform (and no more)", 0)
    if state.moving_box:
        raise ParameterError("compute temp/deform needs a fix deform with remap v")
    return state.temperature(deformed=True)


def _flags(state: DeckState, words: list[str], what: str) -> tuple[bool, bool, bool]:
    x, y, z = (read.integer(word, f"a flag of compute {what}", 0) > 0 for word in words)
    if z and state.dimension == 2:
        raise ParameterError(f"compute {what}: the flag of z must be 0 in two dimensions")
    return x, y, z


def _partial(state: DeckState, group: str, words: list[str]) -> Temperature:
    read.count(words, "compute ID group temp/partial xflag yflag zflag", 3)
    return state.temperature(counted=_flags(state, words, "temp/partial"))


def _profile(state: DeckState, group: str, words: list[str]) -> Temperature:
    usage = "compute ID group temp/profile xflag yflag zflag x|y|z|xy|yz|xz|xyz N ... [out tensor|bin]"
    read.count(words, usage, 5, None)
    streaming = _flags(state, words[:3], "temp/profile")
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
    extra = float(state.dimension - sum(streaming))
    return state.temperature(streaming=streaming, bins=(bins[0], bins[1], bins[2]), table=table, extra=extra)


def _of_motion(state: DeckState, group: str, words: list[str]) -> Temperature:
    read.count(words, "compute ID group temp/com", 0)
    return _profile(state, group, f"1 1 {state.dimension - 2} xyz 1 1 1".split())


def _of_bins(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Number of beads and temperature of each bin."""
    settings: Temperature = compute.settings
    masses, velocities, numbers = moment.thermal(compute)
    assert numbers is not None
    counts = np.bincount(numbers, minlength=settings.count)
    sums = np.bincount(numbers, masses * np.sum((velocities * moment.units.velocity) ** 2, axis=1), settings.count)
    # each bead has its share of the uncounted degrees of freedom
    freedom = counts * (settings.dimension - settings.extra / max(len(masses), 1)) - sum(settings.streaming)
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
    "temp/com": _spec(_of_motion),
    "temp/partial": _spec(_partial),
    "temp/deform": _spec(_deform),
    "temp/profile": _spec(_profile),
}


#: A reference to several values: ``c_id[*]``, ``c_id[2*4]``, ``f_id[*]``.
_WILD = re.compile(r"([cf])_(\w+)\[(\d*\*\d*)\]", re.ASCII)


def _all_only(style: str, allowed: tuple[str, ...]) -> Callable[[DeckState, str, list[str]], None]:
    def check(state: DeckState, group: str, words: list[str]) -> None:
        if group != "all":
            raise ParameterError(f"compute {style} must use group all")
        for word in words:
            read.choice(word, f"an argument of compute {style}", allowed)

    return check


def _check_pressure(state: DeckState, group: str, words: list[str]) -> None:
    read.count(words, "compute ID all pressure temp-ID|NULL [virial|ke]", 1, 2)
    if words[0] == "NULL" and "virial" not in words[1:]:
        raise ParameterError("compute pressure needs the id of a temperature compute, or NULL with virial")
    if words[0] != "NULL":
        state.temperature_compute(words[0])
    _all_only("pressure", ("virial", "ke"))(state, group, words[1:])


#: Parts of the potential energy that compute pe can select.
_PARTS = ("pair", "bond", "angle", "dihedral", "improper")


def potential_energy(moment: DeckMoment, parts: Sequence[str] = _PARTS) -> float:
    """Sum of parts of the potential energy, in the deck's units."""
    return sum(moment.energy(f"{part}_energy") for part in parts)


def _pressure(moment: DeckMoment, compute: Compute) -> float:
    kinetic = 0.0
    if "virial" not in compute.arguments[1:]:
        kinetic = moment.kinetic(moment.state.temperature_of_pressure(compute.name))
    return moment.pressure_of(kinetic, 0.0 if "ke" in compute.arguments[1:] else moment.need("virial"))


def _pressure_tensor(moment: DeckMoment, compute: Compute) -> np.ndarray:
    words = compute.arguments[1:]
    return moment.pressure_tensor(compute.name, "virial" not in words or "ke" in words, "ke" not in words)


def _kinetic_energy(moment: DeckMoment, compute: Compute) -> float:
    mask = moment.state.group(compute.group)
    return moment.kinetic_of(moment.state.bead_masses()[mask], moment.velocities[mask]) / moment.units.energy


def _momentum(moment: DeckMoment, compute: Compute) -> np.ndarray:
    mask, masses = moment.state.group(compute.group), moment.state.bead_masses()
    return masses[mask] @ moment.velocities[mask] / moment.units.mass


def _dpd(moment: DeckMoment, compute: Compute) -> np.ndarray:
    mask, units = moment.state.group(compute.group), moment.units
    conductive, mechanical = (float(moment.field(name)[mask].sum()) / units.energy for name in ("u_cond", "u_mech"))
    thetas = moment.field("theta")[mask] / units.thermal_energy
    harmonic = len(thetas) / np.sum(1 / thetas) if len(thetas) and np.all(thetas > 0) else 0.0
    # LAMMPS's third energy is chemical: there are no reactions here
    return np.array([conductive, mechanical, 0.0, harmonic, float(len(thetas))])


# -- values of single beads, by name -------------------------------------------------------------------------------------------
def check_bead_word(
    state: DeckState, word: str, allowed: tuple[str, ...] = tuple(BEAD_WORDS), what: str = "a value of the beads", local: bool = False
) -> None:
    """Raise ParameterError unless a word names a per-bead value, or with ``local`` one of bonds, angles, dihedrals or impropers."""
    if word.startswith("v_"):
        style = state.variables.get(word[2:]).style
        if not style.startswith("atom"):
            raise ParameterError(f"{word}: variable {word[2:]} is {style}-style; only atom-style ones have values of single beads")
        return
    if word.startswith("f_") and not local:
        _, name, indices = reference(word)
        store = state.fixes[name].parameters.get("reader") if name in state.fixes else None
        columns = getattr(store, "columns", None)
        if columns is None or len(indices) != (columns > 0) or not all(1 <= index <= columns for index in indices):
            raise ParameterError(f"{word}: there is no such value of single beads; fix store/state has f_id, or f_id[1] and so on")
        return
    if not word.startswith("c_"):
        check_carried(state, word)
        read.choice(word, what, [*allowed, "c_id", "c_id[column]", "v_name", "f_id"])
        return
    _, name, indices = reference(word)
    compute, spec = compute_of(state, name, word)
    if (spec.local if local else spec.per_bead) is None:
        raise ParameterError(f"{word}: compute style {compute.style} has no values of single {'bonds or angles' if local else 'beads'}")
    columns, per = spec.columns(compute), "term" if local else "bead"
    if columns == 0 and indices:
        raise ParameterError(f"{word}: compute {name} (style {compute.style}) has one value per {per}; use c_{name}")
    if columns and (len(indices) != 1 or not 1 <= indices[0] <= columns):
        raise ParameterError(f"{word}: compute {name} (style {compute.style}) has {columns} values per {per}; use c_{name}[1] and so on")


def is_of_beads(state: DeckState, word: str) -> bool:
    """Whether a word names values of single beads."""
    if word.startswith("v_"):
        return state.variables.get(word[2:]).style.startswith("atom")
    if word.startswith("f_"):
        fix = state.fixes.get(reference(word).name)
        return fix is not None and hasattr(fix.parameters.get("reader"), "of_beads")
    return not word.startswith("c_") or compute_of(state, reference(word).name, word)[1].per_bead is not None


def is_of_terms(state: DeckState, word: str) -> bool:
    """Whether a word names values of bonds, angles, dihedrals or impropers."""
    return word.startswith("c_") and compute_of(state, reference(word).name, word)[1].local is not None


# -- compute reduce -----------------------------------------------------------------------------------------------------------
_MODES: dict[str, Callable[[np.ndarray], float]] = {
    "sum": lambda values: float(values.sum()),
    "min": lambda values: float(values.min()),
    "max": lambda values: float(values.max()),
    "ave": lambda values: float(values.mean()),
    "sumsq": lambda values: float(np.sum(values**2)),
    "avesq": lambda values: float(np.mean(values**2)),
    "sumabs": lambda values: float(np.abs(values).sum()),
    "aveabs": lambda values: float(np.abs(values).mean()),
}


#: Values for an empty group, where they are not 0.
_OF_NONE = {"min": 1e20, "max": -1e20}


class Reduction(NamedTuple):
    """Settings of compute reduce and reduce/region; ``local``: whether the values are those of bonds, angles, dihedrals or impropers."""

    mode: str
    words: tuple[str, ...]
    local: bool = False
    region: str | None = None


def _parse_reduce(state: DeckState, group: str, words: list[str]) -> Reduction:
    read.count(words, "compute ID group reduce mode value value ... [inputs peratom|local]", 2, None)
    mode, local = read.choice(words[0], "the mode of compute reduce", list(_MODES)), False
    if words[-2] == "inputs":
        local, words = read.choice(words[-1], "inputs", ("peratom", "local")) == "local", words[:-2]
    for word in words[1:]:
        check_bead_word(state, word, tuple(f"{kind}{axis}" for kind in ("", "v", "f") for axis in "xyz"), local=local)
    return Reduction(mode, tuple(words[1:]), local)


def _parse_region(state: DeckState, group: str, words: list[str]) -> Reduction:
    read.count(words, "compute ID group reduce/region region mode value value ...", 3, None)
    state.region(words[0])
    return _parse_reduce(state, group, words[1:])._replace(region=words[0])


def _reduced(moment: DeckMoment, compute: Compute) -> np.ndarray:
    mode, words, local, region = compute.settings
    if local:
        found = [moment.local_values(word) for word in words]
    else:
        mask = moment.state.group(compute.group)
        if region is not None:
            mask = mask & moment.region(region).contains(moment.folded[0])
        found = [moment.bead_values(word)[mask] for word in words] if mask.any() else [np.zeros(0)] * len(words)
    return np.array([_MODES[mode](values) if len(values) else _OF_NONE.get(mode, 0.0) for values in found])


def _reduced_one(moment: DeckMoment, compute: Compute) -> float:
    if (count := len(compute.settings.words)) > 1:
        raise ParameterError(f"compute {compute.name} (style {compute.style}) has {count} values; use c_{compute.name}[1]")
    return float(_reduced(moment, compute)[0])


def _reduce(prepare: Callable[[DeckState, str, list[str]], Reduction]) -> ComputeSpec:
    extensive = lambda compute: compute.settings.mode.startswith("sum")  # noqa: E731
    return ComputeSpec(prepare, _reduced_one, _reduced, extensive=extensive, size=lambda compute: len(compute.settings.words))


#: Compute styles by name.
COMPUTES: dict[str, ComputeSpec] = {
    **TEMPERATURES,
    "ke": ComputeSpec(no_arguments("ke"), _kinetic_energy, extensive=True),
    "pe": ComputeSpec(_all_only("pe", _PARTS), lambda m, c: potential_energy(m, c.arguments or _PARTS), extensive=True),
    "pressure": ComputeSpec(_check_pressure, _pressure, _pressure_tensor, size=lambda compute: 6),
    "com": ComputeSpec(
        no_arguments("com"), vector=lambda m, c: m.state.mass_average(m.unwrapped, m.state.group(c.group)), size=lambda compute: 3
    ),
    "momentum": ComputeSpec(no_arguments("momentum"), vector=_momentum, extensive=True, size=lambda compute: 3),
    "dpd": ComputeSpec(no_arguments("dpd", "dpd"), vector=_dpd, size=lambda compute: 5),
    "reduce": _reduce(_parse_reduce),
    "reduce/region": _reduce(_parse_region),
    "chunk/atom": CHUNKS,
    **OF_CHUNKS,
    **STRUCTURE,
    **PER_BEAD,
    **LOCAL,
}


#: Predefined computes, and the thermo word equivalent to each.
BUILT_IN = {"thermo_temp": "temp", "thermo_press": "press", "thermo_pe": "pe"}


def _built_in(state: DeckState, name: str) -> Compute:
    """The definition of a predefined compute: temperature or potential energy of all beads, or their pressure with that temperature."""
    press, pe = Compute(name, "all", "pressure", ("thermo_temp",)), Compute(name, "all", "pe")
    return {"thermo_temp": state.thermo_temp, "thermo_press": press, "thermo_pe": pe}[name]


# -- names of values -----------------------------------------------------------------------------------------------------------
def compute_of(state: DeckState, name: str, word: str = "") -> tuple[Compute, ComputeSpec]:
    """A compute of the deck and its style.  ParameterError, with ``word`` as prefix, if there is none."""
    if name not in state.computes and name not in BUILT_IN:
        known = [*BUILT_IN, *state.computes]
        raise ParameterError(
            f"{word}{': ' if word else ''}there is no compute '{name}'; defined are {', '.join(known)}{read.near(name, known)}"
        )
    compute = state.computes[name] if name in state.computes else _built_in(state, name)
    return compute, COMPUTES[compute.style]


def average_of(state: DeckState, name: str) -> Any:
    """The :class:`~openmm_dpd.lammps.output.averages.AveragingFix` or fix that acts with this name.  ParameterError if there is none."""
    fix = state.fixes.get(name)
    found = None if fix is None else FixValues(fix) if fix.style in FIX_VALUES else fix.parameters.get("reader")
    if not isinstance(found, Valued):
        raise ParameterError(
            f"f_{name}: there is no fix '{name}' with a value; fix ave/time has values, fix ave/chunk f_id[bin][column], "
            "so have forces, walls and thermostats"
        )
    return found


def is_extensive(state: DeckState, word: str) -> bool:
    """Whether the value of ``c_id``, ``f_id`` or ``v_name`` (with indices) is a sum over beads, which thermo output may normalise."""
    kind, name, indices = reference(word)
    if kind == "v":
        return False
    if kind == "f":
        return average_of(state, name).is_extensive(*indices)
    compute, spec = compute_of(state, name)
    return spec.is_extensive(compute, bool(indices))


def check_value(
    state: DeckState, name: str, index: int | None = None, column: int | None = None, *, word: str = ""
) -> tuple[Compute, ComputeSpec]:
    """The compute and its style.  ParameterError unless ``c_name``, ``c_name[index]`` or ``c_name[index][column]`` is a number."""
    compute, spec = compute_of(state, name, word)
    what = f"{word}{': ' if word else ''}compute {name} (style {compute.style})"
    if name in BUILT_IN and index is not None:
        word = word or f"c_{name}[{index}]"
        if spec.vector is None:
            raise ParameterError(f"{word}: compute {name} has a single value only; use c_{name}")
        if column is not None or not 1 <= index <= 6:
            raise ParameterError(f"{word}: compute {name} has 6 values; use c_{name}[1] to c_{name}[6]")
    if spec.tabled(compute) and not (index is None and spec.scalar is not None):
        check_place(compute, spec, index, column)
    elif column is not None:
        raise ParameterError(f"{what} has no table of values")
    elif spec.per_bead is not None:
        raise ParameterError(f"{what} has values of single beads; use c_{name}[id] in a formula, compute reduce or fix ave/chunk")
    elif index is None and spec.scalar is None:
        raise ParameterError(f"{what} has no single value; use c_{name}[1]")
    elif index is not None and spec.vector is None:
        raise ParameterError(f"{what} has no vector; use c_{name}")
    return compute, spec


def expanded(state: DeckState, words: Sequence[str], tables: bool = False) -> tuple[str, ...]:
    """The words with every ``*`` in an index expanded; with ``tables`` only columns of the tables of computes.  ParameterError if such a
    word names nothing with several values, or a range is out of bounds."""
    found: list[str] = []
    for word in words:
        match = _WILD.fullmatch(word)
        if match is None:
            found.append(word)
            continue
        kind, name, index = match.groups()
        if tables and not (kind == "c" and name in state.computes and COMPUTES[state.computes[name].style].tabled(state.computes[name])):
            found.append(word)
            continue
        size = count_of(state, kind, name)
        if size == 0:
            raise ParameterError(f"{word}: {'compute' if kind == 'c' else 'fix'} {name} does not have several values")
        found += [f"{kind}_{name}[{k}]" for k in read.numeric_range(index, size, f"value of {kind}_{name}")]
    return tuple(found)


def count_of(state: DeckState, kind: str, name: str) -> int:
    """Number of values of a compute (kind ``c``) or fix (``f``): columns for per-bead values and tables, 0 for a single value."""
    if kind == "f":
        found = average_of(state, name)
        return getattr(found, "columns", 0) or found.size
    compute, spec = compute_of(state, name)
    listed = spec.per_bead is not None or spec.local is not None or spec.tabled(compute)
    return spec.columns(compute) if listed else spec.size(compute)
