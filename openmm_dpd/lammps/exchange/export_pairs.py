"""Pair tables of a scene as LAMMPS pair styles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from ...errors import ParameterError
from ...model.edpd import EDPD
from ...model.energy_dpd import EnergyDPD
from ...model.mdpd import MDPD
from ...model.pairs import DPD, NONE, LennardJones, TabulatedPair
from ...model.scene import Scene
from ...model.tdpd import TDPD
from ...units import UnitSystem
from .export_beads import BeadTypes
from .export_words import Differences, lammps_seed, number, numbers

Pair = tuple[str, str]

#: Points of LAMMPS's own tables.
_TABLE_POINTS = 100000


@dataclass
class StyleUse:
    """One pair style and its coefficients.

    Attributes
    ----------
    name : str
    settings : str
        Words after the name, with ``{start}``, ``{stop}`` and ``{seed}`` where temperatures and seed go.
    coefficients : dict of pair to words
        By pair of the scene's bead types.
    cutoff : float
        Largest range, nm.
    modify : str
        Words of a pair_modify command, if it needs one.
    constant : bool
        Whether its temperature is 0 whatever the scene's (it has no friction).
    """

    name: str
    settings: str
    coefficients: dict[Pair, str]
    cutoff: float
    modify: str = ""
    constant: bool = False


@dataclass
class PairExport:
    """What the translation of tables needs to know, and the files it makes."""

    scene: Scene
    units: UnitSystem
    shardlow: bool
    name: str
    differences: Differences
    tables: dict[str, list[str]] = field(default_factory=dict)

    @property
    def temperature(self) -> float:
        """Thermal energy at the start, kJ/mol."""
        return self.scene.initial_kT

    @property
    def ramps(self) -> bool:
        """Whether the temperature changes."""
        kT = self.scene.kT
        return not isinstance(kT, float) and kT.start != kT.stop

    @property
    def scaled_neighbours(self) -> bool:
        """Whether some bonded neighbours interact in part."""
        return bool(len(self.scene.bond_pairs)) and any(0 < factor < 1 for factor in self.scene.special)


def pair_uses(export: PairExport) -> list[StyleUse]:
    """Styles of all tables, in the order in which LAMMPS needs them."""
    found: list[StyleUse] = []
    for table in export.scene.tables:
        entries = {pair: c for pair, c in table.resolve(export.scene.type_names).items() if c is not NONE}
        if not entries:
            continue
        if table.kind is None or table.kind not in TRANSLATORS:
            raise ParameterError(f"pair terms of kind {getattr(table.kind, '__name__', None)} cannot be exported to LAMMPS")
        found += TRANSLATORS[table.kind](export, entries)
    return found


def pair_lines(uses: list[StyleUse], types: BeadTypes, start: float, stop: float, seed: int) -> Iterator[str]:
    """The commands pair_style, pair_coeff and pair_modify.

    Parameters
    ----------
    start, stop : float
        Temperatures at the ends of the run, in LAMMPS's units.
    """
    if not uses:
        yield "pair_style none"
        return
    pairs = list(combinations_with_replacement(dict.fromkeys(types.names), 2))
    bare = [pair for pair in pairs if not any(pair in use.coefficients for use in uses)]
    single = len(uses) == 1 and not bare and uses[0].name not in _HYBRID_ONLY
    words, seeds = list[str](), 0
    for use in uses:
        ends = ("0.0", "0.0") if use.constant else (number(start), number(stop))
        words.append(f"{use.name} {use.settings.format(start=ends[0], stop=ends[1], seed=lammps_seed(seed, seeds))}".strip())
        seeds += "{seed}" in use.settings
    yield f"pair_style {words[0]}" if single else "pair_style hybrid/overlay " + " &\n  ".join(words)
    for first, second in bare:
        yield f"pair_coeff {types.span(first)} {types.span(second)} none"
    n, places = len(types), any(use.name == "srp" for use in uses)
    everything = f"1*{n}" if places else "*"
    if places:
        yield f"pair_coeff {everything} {n + 1} none"
    for use in uses:
        label = "" if single else f"{_label(use, uses)} "
        if use.name == "srp":
            yield f"pair_coeff {n + 1} {n + 1} srp {use.coefficients['*', '*']}"
        elif len(set(use.coefficients.values())) == 1 and len(use.coefficients) == len(pairs):
            yield f"pair_coeff {everything} {everything} {label}{use.coefficients[pairs[0]]}".rstrip()
        else:
            for first, second in sorted(use.coefficients, key=lambda pair: _acts(use, pair)):
                yield f"pair_coeff {types.span(first)} {types.span(second)} {label}{use.coefficients[first, second]}".rstrip()
        if use.modify:
            yield f"pair_modify {'' if single else f'pair {label}'}{use.modify}"


#: Styles that LAMMPS has as parts of hybrid/overlay only.
_HYBRID_ONLY = ("mdpd", "mdpd/rhosum", "srp", "coul/slater/long", "coul/slater/cut")


def _label(use: StyleUse, uses: list[StyleUse]) -> str:
    """Name of a style on pair_coeff lines of hybrid/overlay: with a number if there are several."""
    same = [id(other) for other in uses if other.name == use.name]
    return use.name if len(same) == 1 else f"{use.name} {same.index(id(use)) + 1}"


def _acts(use: StyleUse, pair: Pair) -> bool:
    # with fix shardlow LAMMPS leaves out all repulsion if the last pair_coeff line has A = 0
    return not use.coefficients[pair].startswith(("0.0 ", "-0.0 "))


# -- the DPD family -----------------------------------------------------------------------------------------------------------
def _friction(c: DPD, kT: float) -> float:
    return c.gamma if c.gamma is not None else c.sigma**2 / (2 * kT) if c.sigma else 0.0


def _dpd(export: PairExport, entries: dict[Pair, DPD]) -> list[StyleUse]:
    units, kT = export.units, export.temperature
    longest = max(c.cutoff for c in entries.values())
    reach = number(longest / units.length)
    gammas = {pair: _friction(c, kT) / units.friction for pair, c in entries.items()}
    A = {pair: c.A / units.force for pair, c in entries.items()}
    cutoffs = {pair: number(c.cutoff / units.length) for pair, c in entries.items()}
    general = any(c.gamma_perp or c.exponent != 1 or (c.exponent_perp != 1 and c.gamma_perp) for c in entries.values())
    fixed = {pair: c for pair, c in entries.items() if c.sigma and c.gamma is None}

    def use(name: str, settings: str, words: Callable[[Pair], str], constant: bool = False) -> StyleUse:
        coefficients = {pair: f"{words(pair)} {cutoffs[pair]}" for pair in entries}
        return StyleUse(name, settings, coefficients, longest, constant=constant)

    def transverse(pair: Pair) -> str:
        c = entries[pair]
        return f"{number(gammas[pair])} {number(c.gamma_perp / units.friction)} {number(c.exponent)} {number(c.exponent_perp)}"

    if export.ramps:
        if fixed:
            raise ParameterError(
                f"types {next(iter(fixed))} have a fixed sigma while the temperature changes; LAMMPS's pair styles with a temperature "
                "ramp (dpd/tstat) hold gamma fixed. Give gamma instead, or a constant kT"
            )
        thermostat = use(
            "dpd/ext/tstat" if general else "dpd/tstat",
            f"{{start}} {{stop}} {reach} {{seed}}",
            transverse if general else lambda pair: number(gammas[pair]),
        )
        if not any(A.values()):
            return [thermostat]
        # dpd has no ramp: the repulsion is a style of its own, without friction and noise
        return [use("dpd", f"{{start}} {reach} {{seed}}", lambda pair: f"{number(A[pair])} 0.0", True), thermostat]
    if export.shardlow or (len(fixed) == len(entries) and not general and not export.scaled_neighbours):

        def noise(pair: Pair) -> str:
            c = entries[pair]
            sigma = c.sigma if c.sigma is not None and c.gamma is None else np.sqrt(2 * kT * _friction(c, kT))
            return f"{number(A[pair])} {number(sigma / units.noise)}"

        return [use("dpd/fdt", f"{{start}} {reach} {{seed}}", noise)]
    bare = not any(A.values())
    if general and bare:
        return [use("dpd/ext/tstat", f"{{start}} {{stop}} {reach} {{seed}}", transverse)]
    if general:
        return [use("dpd/ext", f"{{start}} {reach} {{seed}}", lambda pair: f"{number(A[pair])} {transverse(pair)}")]
    if bare:
        return [use("dpd/tstat", f"{{start}} {{stop}} {reach} {{seed}}", lambda pair: number(gammas[pair]))]
    return [use("dpd", f"{{start}} {reach} {{seed}}", lambda pair: f"{number(A[pair])} {number(gammas[pair])}")]


def _energy(export: PairExport, entries: dict[Pair, EnergyDPD]) -> list[StyleUse]:
    units, longest = export.units, max(c.cutoff for c in entries.values())
    heat = units.energy * units.thermal_energy / units.time
    words = {
        pair: numbers([c.A / units.force, c.sigma / units.noise, c.kappa / heat, c.cutoff / units.length]) for pair, c in entries.items()
    }
    return [StyleUse("dpd/fdt/energy", f"{number(longest / units.length)} {{seed}}", words, longest)]


def _edpd(export: PairExport, entries: dict[Pair, EDPD]) -> list[StyleUse]:
    _reduced(export, "EDPD")
    words = {}
    for pair, c in entries.items():
        assert c.cutoff_T is not None  # filled by the coefficient
        if c.cutoff_T < c.cutoff:
            raise ParameterError(
                f"types {pair}: the heat has a shorter range ({c.cutoff_T:g} nm) than the forces ({c.cutoff:g} nm), for which LAMMPS's "
                "edpd adds stale values; give both one cutoff"
            )
        if c.cutoff_T > c.cutoff:
            export.differences.add(f"types {pair}: LAMMPS's edpd ends the exchange of heat at the cutoff of the forces, {c.cutoff:g}")
        values = [c.A, c.gamma, c.exponent, c.cutoff, c.kappa, c.exponent_T, c.cutoff_T]
        words[pair] = numbers(values)
        for keyword, polynomial in (("power", c.exponent_polynomial), ("kappa", c.kappa_polynomial)):
            if any(polynomial):
                words[pair] += f" {keyword} {numbers(polynomial)}"
    n = len(export.scene.type_names)
    different = len(set(words.values())) > 1 or len(words) < n * (n + 1) // 2
    if different and any(any(c.exponent_polynomial) or any(c.kappa_polynomial) for c in entries.values()):
        raise ParameterError(
            "EDPD: LAMMPS's edpd keeps the polynomials of the last pair_coeff line only, so with polynomials all type pairs must have the "
            "same coefficients"
        )
    if export.scene.compat != "lammps":
        export.differences.add(
            "LAMMPS's edpd computes the heat of friction and noise in another way, which does not conserve energy "
            "(this package does the same with compat='lammps')"
        )
    if len(set(export.scene.bead_masses.tolist())) > 1:
        export.differences.add("LAMMPS's edpd takes the mass of one bead of a pair for both, which is wrong for beads of different masses")
    longest = max(c.cutoff for c in entries.values())
    return [StyleUse("edpd", f"{number(longest)} {{seed}}", words, longest)]


def _tdpd(export: PairExport, entries: dict[Pair, TDPD]) -> list[StyleUse]:
    _reduced(export, "TDPD")
    words = {}
    for pair, c in entries.items():
        if c.cutoff_c > c.cutoff:  # type: ignore[operator]
            export.differences.add(f"types {pair}: LAMMPS's tdpd ends the exchange of species at the cutoff of the forces, {c.cutoff:g}")
        species = np.column_stack([c.kappa, c.epsilon, c.exponent_c])
        words[pair] = f"{numbers([c.A, c.gamma, c.exponent, c.cutoff, c.cutoff_c])} {numbers(species)}"
    longest = max(c.cutoff for c in entries.values())
    return [StyleUse("tdpd", f"{{start}} {number(longest)} {{seed}}", words, longest)]


def _mdpd(export: PairExport, entries: dict[Pair, MDPD]) -> list[StyleUse]:
    _reduced(export, "MDPD")
    if any(c.kernel == "quadratic" for c in entries.values()):
        export.differences.add(
            "LAMMPS has Lucy's kernel only for the densities of mdpd; the quadratic kernel of this scene is replaced by it, with the same "
            "range (densities count masses, and the force has no potential)"
        )
    forces = {pair: numbers([c.A, c.B, c.gamma, c.cutoff, c.cutoff_B]) for pair, c in entries.items()}
    densities = {pair: number(c.cutoff_density) for pair, c in entries.items()}
    longest = max(c.cutoff for c in entries.values())
    return [
        StyleUse("mdpd/rhosum", "", densities, max(c.cutoff_density for c in entries.values())),
        StyleUse("mdpd", f"{{start}} {number(longest)} {{seed}}", forces, longest),
    ]


def _reduced(export: PairExport, what: str) -> None:
    if export.ramps and what != "EDPD":
        raise ParameterError(f"{what} goes with one temperature in LAMMPS, but the scene has a ramp; LAMMPS has ramps for DPD only")
    if export.units.name != "lj":
        raise ParameterError(f"{what} goes with units lj only in LAMMPS, not with units {export.units.name}")


# -- potentials ---------------------------------------------------------------------------------------------------------------
def _lennard_jones(export: PairExport, entries: dict[Pair, LennardJones]) -> list[StyleUse]:
    units, found = export.units, []
    for shifted in (False, True):
        mine = {pair: c for pair, c in entries.items() if bool(c.shift) == shifted}
        if not mine:
            continue
        longest = max(c.cutoff for c in mine.values())
        words = {pair: numbers([c.epsilon / units.energy, c.sigma / units.length, c.cutoff / units.length]) for pair, c in mine.items()}
        found.append(StyleUse("lj/cut", number(longest / units.length), words, longest, "shift yes" if shifted else ""))
    return found


def _tabulated(export: PairExport, entries: dict[Pair, TabulatedPair]) -> list[StyleUse]:
    units, file = export.units, f"table.{export.name}"
    lines = export.tables.setdefault(file, ["# pair tables written by openmm-dpd, units = " + units.name])
    words, written = {}, dict[int, str]()
    for pair, c in entries.items():
        if id(c) not in written:
            keyword = f"TABLE_{1 + sum(line.startswith('TABLE_') for line in lines)}"
            written[id(c)] = keyword
            lines += _table_section(c, keyword, units)
        words[pair] = f"{file} {written[id(c)]} {number(c.cutoff / units.length)}"  # type: ignore[operator]
        export.differences.remark(
            f"LAMMPS stops where two beads of types {pair} are nearer than {number(_rows(c)[0][0] / units.length)}, where the table begins"
        )
    longest = max(float(c.cutoff) for c in entries.values())  # type: ignore[arg-type]
    return [StyleUse("table", f"spline {_TABLE_POINTS}", words, longest)]


def _rows(c: TabulatedPair) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (> 0), energies and forces."""
    r = np.array(c.distances)
    if r[0] == 0:
        r[0] = 1e-6 * r[1]  # LAMMPS has no table that begins at 0
    forces = c.forces if c.forces is not None else -_slopes(c)
    return r, c.energies, forces


def _slopes(c: TabulatedPair) -> np.ndarray:
    from scipy.interpolate import CubicSpline

    return CubicSpline(c.distances, c.energies).derivative()(c.distances)


def _table_section(c: TabulatedPair, keyword: str, units: UnitSystem) -> Iterator[str]:
    r, energies, forces = _rows(c)
    yield from ("", keyword, f"N {len(r)}", "")
    rows = np.column_stack([r / units.length, energies / units.energy, forces / units.force]).tolist()
    for k, row in enumerate(rows, start=1):
        yield f"{k} {' '.join(map(repr, row))}"


#: From the kind of a table to its translator.
TRANSLATORS: dict[type, Callable[[PairExport, dict[Pair, Any]], list[StyleUse]]] = {
    DPD: _dpd,
    EnergyDPD: _energy,
    EDPD: _edpd,
    TDPD: _tdpd,
    MDPD: _mdpd,
    LennardJones: _lennard_jones,
    TabulatedPair: _tabulated,
}
