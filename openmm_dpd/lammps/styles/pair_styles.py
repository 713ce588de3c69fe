"""Pair styles: what their arguments are, and which pair term of the model they become.

A style is one entry of :data:`PAIR_STYLES`; the commands in ``commands/pairs.py`` know none of them by name.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...errors import ParameterError
from ...model.edpd import EDPD
from ...model.energy_dpd import EnergyDPD
from ...model.mdpd import MDPD
from ...model.pairs import DPD, NONE, LennardJones
from ...model.tdpd import TDPD
from ...units import UnitSystem
from ..files.table_file import MODES, read_table, tabulated_pair
from ..language import arguments as read
from ..state.pair_setup import Coefficient, PairStyle, Spec
from .charges import both_coefficient, both_settings, slater_coefficient, slater_settings
from .srp import WORDS as SRP_WORDS
from .srp import srp_coefficient, srp_settings

MIXING = ("geometric", "arithmetic", "sixthpower")


# -- the DPD family -------------------------------------------------------------------------------------------------------
def _dpd(name: str, ramp: bool, columns: dict[str, str]) -> Spec:
    """A style of the DPD family; ``columns`` gives the dimension (an attribute of UnitSystem, or 1) of each coefficient."""
    usage = f"{name} {'Tstart Tstop' if ramp else 'T'} cutoff seed"

    def settings(words: list[str]) -> dict:
        read.count(words, usage, 4 if ramp else 3)
        temperatures = [read.non_negative(word, f"the temperature of {name}") for word in words[:-2]]
        return {
            "start": temperatures[0],
            "stop": temperatures[-1],
            "cutoff": read.positive(words[-2], f"the cutoff of {name}"),
            "seed": read.integer(words[-1], f"the seed of {name}", 1),
        }

    def coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
        read.count(words, f"{' '.join(columns)} [cutoff]", len(columns), len(columns) + 1)
        values = {key: read.number(word, key) for key, word in zip(columns, words, strict=False)}
        return values, read.positive(words[-1], "the cutoff") if len(words) > len(columns) else None

    def build(style: PairStyle, found: Coefficient, units: UnitSystem) -> tuple[object, str | None]:
        factors = {key: 1.0 if kind == "1" else getattr(units, kind) for key, kind in columns.items()}
        values = {key: value * factors[key] for key, value in found.values.items()}
        term = DPD(**values, cutoff=style.cutoff(found) * units.length)  # type: ignore[operator]
        for temperature in (style.settings["start"], style.settings["stop"]):
            term.check_temperature(temperature * units.thermal_energy)
        return term, None

    return Spec(settings, coefficient, build, thermostat=True)


# -- styles whose beads carry more than a velocity -----------------------------------------------------------------------------
def _seeded(name: str, isothermal: bool) -> Callable[[list[str]], dict]:
    """Reader of ``[T] cutoff seed``."""
    usage = f"{name} {'T ' if isothermal else ''}cutoff seed"

    def settings(words: list[str]) -> dict:
        read.count(words, usage, 3 if isothermal else 2)
        temperature = read.non_negative(words[0], f"the temperature of {name}") if isothermal else None
        found = {"start": temperature, "stop": temperature} if isothermal else {}
        cutoff, seed = words[-2:]
        return {**found, "cutoff": read.positive(cutoff, f"the cutoff of {name}"), "seed": read.integer(seed, f"the seed of {name}", 1)}

    return settings


def _energy_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    read.count(words, "A sigma kappa [cutoff]", 3, 4)
    values = {key: read.number(word, key) for key, word in zip(("A", "sigma", "kappa"), words, strict=False)}
    return values, read.positive(words[3], "the cutoff") if len(words) > 3 else None


def _energy_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> tuple[object, str | None]:
    # LAMMPS's kappa is an energy times a temperature per time, ours has the square of an energy
    factors = {"A": units.force, "sigma": units.noise, "kappa": units.energy * units.thermal_energy / units.time}
    values = {key: value * factors[key] for key, value in found.values.items()}
    return EnergyDPD(**values, cutoff=style.cutoff(found) * units.length), None  # type: ignore[operator]


_EDPD = ("A", "gamma", "exponent", "cutoff", "kappa", "exponent_T", "cutoff_T")


def _edpd_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    read.count(words, "A gamma power_f cutoff kappa power_T cutoff_T [power c1 c2 c3 c4] [kappa c1 c2 c3 c4]", 7, None)
    values: dict = {key: read.number(word, key) for key, word in zip(_EDPD, words, strict=False)}
    for keyword, numbers in read.options(words[7:], {"power": 4, "kappa": 4}, "pair_coeff of edpd"):
        name = "exponent_polynomial" if keyword == "power" else "kappa_polynomial"
        values[name] = tuple(read.number(word, f"a coefficient of {keyword}") for word in numbers)
    return values, None


def _edpd_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> tuple[object, str | None]:
    factors = {"A": units.force / units.thermal_energy, "gamma": units.friction, "kappa": 1 / units.time}
    factors |= {"cutoff": units.length, "cutoff_T": units.length}
    term = EDPD(**{key: value * factors[key] if key in factors else value for key, value in found.values.items()})
    remark = "pair edpd: forces and heat have different cutoffs, which LAMMPS does not compute correctly; here each has its own"
    return term, remark if term.cutoff_T != term.cutoff else None


_TDPD = ("A", "gamma", "exponent", "cutoff", "cutoff_c")


def _tdpd_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    n = style.settings["species"]
    each = " ".join(f"kappa_{k} epsilon_{k} power_{k}" for k in range(1, n + 1))
    read.count(words, f"A gamma power_f cutoff cutoff_c {each}", 5 + 3 * n)
    values = {key: read.number(word, key) for key, word in zip(_TDPD, words, strict=False)}
    return values | {"species": tuple(read.number(word, "a coefficient of a species") for word in words[5:])}, None


def _tdpd_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> tuple[object, str | None]:
    factors = {"A": units.force, "gamma": units.friction, "exponent": 1.0, "cutoff": units.length, "cutoff_c": units.length}
    kappa, epsilon, exponents = (found.values["species"][k::3] for k in range(3))
    term = TDPD(
        **{key: found.values[key] * factor for key, factor in factors.items()},
        kappa=tuple(k / units.time for k in kappa),
        epsilon=tuple(e / units.time**0.5 for e in epsilon),
        exponent_c=exponents,
    )
    remark = "pair tdpd: cutoff_c is longer than the cutoff, where LAMMPS ends the exchange; here it goes on to cutoff_c"
    return term, remark if term.cutoff_c > term.cutoff else None  # type: ignore[operator]


_MDPD = ("A", "B", "gamma", "cutoff", "cutoff_B")


def _mdpd_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    read.count(words, "A B gamma cutoff_A cutoff_B", 5)
    return {key: read.number(word, key) for key, word in zip(_MDPD, words, strict=True)}, None


def _mdpd_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> tuple[object, str | None]:
    factors = {"A": units.force, "B": units.force * units.length**3 / units.mass, "gamma": units.friction}
    values = {key: value * factors.get(key, units.length) for key, value in found.values.items()}
    return MDPD(**values, kernel="lucy"), None


def _rhosum_settings(words: list[str]) -> dict:
    read.count(words, "mdpd/rhosum", 0)
    return {}


def _rhosum_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    read.count(words, "cutoff", 1)
    return {}, read.positive(words[0], "the cutoff of the density")


# -- Lennard-Jones ----------------------------------------------------------------------------------------------------------
def _lj_settings(words: list[str]) -> dict:
    read.count(words, "lj/cut cutoff", 1)
    return {"cutoff": read.positive(words[0], "the cutoff of lj/cut")}


def _lj_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    read.count(words, "epsilon sigma [cutoff]", 2, 3)
    values = {"epsilon": read.non_negative(words[0], "epsilon"), "sigma": read.positive(words[1], "sigma")}
    return values, read.positive(words[2], "the cutoff") if len(words) > 2 else None


def _lj_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> tuple[object, str | None]:
    epsilon, sigma = found.values["epsilon"] * units.energy, found.values["sigma"] * units.length
    cutoff = style.cutoff(found) * units.length  # type: ignore[operator]
    return LennardJones(epsilon, sigma, cutoff, shift=style.shift), None


def mixed(style: PairStyle, first: Coefficient, second: Coefficient) -> Coefficient:
    """Lennard-Jones coefficients of unlike types from those of like types, by the style's mixing rule."""
    (e1, s1), (e2, s2) = ((c.values["epsilon"], c.values["sigma"]) for c in (first, second))
    c1, c2 = (style.cutoff(c) or 0.0 for c in (first, second))
    epsilon = (e1 * e2) ** 0.5
    if style.mix == "sixthpower":
        epsilon *= 2 * s1**3 * s2**3 / (s1**6 + s2**6)
    rules: dict[str, Callable[[float, float], float]] = {
        "geometric": lambda a, b: (a * b) ** 0.5,
        "arithmetic": lambda a, b: 0.5 * (a + b),
        "sixthpower": lambda a, b: (0.5 * (a**6 + b**6)) ** (1 / 6),
    }
    length = rules[style.mix]
    return Coefficient({"epsilon": epsilon, "sigma": length(s1, s2)}, length(c1, c2), None)


# -- tables and nothing -----------------------------------------------------------------------------------------------------
def _table_settings(words: list[str]) -> dict:
    read.count(words, f"table {'|'.join(MODES)} N", 2, None)
    if len(words) > 2:
        raise ParameterError(f"pair_style table: the options {' '.join(words[2:])} are not supported (they are for kspace solvers)")
    return {"mode": read.choice(words[0], "the table style", MODES), "points": read.integer(words[1], "the size of the table", 2)}


def _table_coefficient(style: PairStyle, words: list[str], find: Callable[[str], Path]) -> tuple[dict, float | None]:
    read.count(words, "file keyword [cutoff]", 2, 3)
    values = {"file": words[0], "keyword": words[1], "data": read_table(find(words[0]), words[1])}
    return values, read.positive(words[2], "the cutoff") if len(words) > 2 else None


def _table_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> tuple[object, str | None]:
    term, remark = tabulated_pair(found.values["data"], found.cutoff, units)
    return term, remark and f"pair table {found.values['keyword']} of {found.values['file']}: {remark}"


# -- charges ----------------------------------------------------------------------------------------------------------------
def _both_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> tuple[object, str | None]:
    """The DPD part; the charges are those of the beads (charges.py)."""
    plain = {key: found.values[key] for key in ("A", "gamma")}
    return PAIR_STYLES["dpd"].build(style, Coefficient(plain, found.cutoff, found.where), units)


def _zero_settings(words: list[str]) -> dict:
    read.count(words, "zero cutoff [nocoeff]", 1, 2)
    for word in words[1:]:
        read.choice(word, "the option of pair style zero", ("nocoeff",))
    return {"cutoff": read.positive(words[0], "the cutoff of zero")}


def _zero_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    return {}, read.positive(words[0], "the cutoff") if words else None


#: Pair styles by name.
PAIR_STYLES: dict[str, Spec] = {
    "dpd": _dpd("dpd", False, {"A": "force", "gamma": "friction"}),
    "dpd/tstat": _dpd("dpd/tstat", True, {"gamma": "friction"}),
    "dpd/ext": _dpd(
        "dpd/ext",
        False,
        {"A": "force", "gamma": "friction", "gamma_perp": "friction", "exponent": "1", "exponent_perp": "1"},
    ),
    "dpd/ext/tstat": _dpd("dpd/ext/tstat", True, {"gamma": "friction", "gamma_perp": "friction", "exponent": "1", "exponent_perp": "1"}),
    "dpd/fdt": _dpd("dpd/fdt", False, {"A": "force", "sigma": "noise"}),
    "dpd/fdt/energy": Spec(_seeded("dpd/fdt/energy", False), _energy_coefficient, _energy_build, thermostat=True, atom_style="dpd"),
    "edpd": Spec(_seeded("edpd", False), _edpd_coefficient, _edpd_build, thermostat=True, atom_style="edpd", own_cutoffs=True),
    "tdpd": Spec(_seeded("tdpd", True), _tdpd_coefficient, _tdpd_build, thermostat=True, atom_style="tdpd", own_cutoffs=True),
    "mdpd/rhosum": Spec(_rhosum_settings, _rhosum_coefficient, lambda *_: (NONE, None), atom_style="mdpd"),
    "mdpd": Spec(_seeded("mdpd", True), _mdpd_coefficient, _mdpd_build, thermostat=True, atom_style="mdpd", own_cutoffs=True),
    "lj/cut": Spec(_lj_settings, _lj_coefficient, _lj_build, mixed=mixed),
    "table": Spec(_table_settings, _table_coefficient, _table_build, keeps_coefficients=False),
    "dpd/coul/slater/long": Spec(both_settings, both_coefficient, _both_build, thermostat=True),
    "coul/slater/long": Spec(slater_settings, slater_coefficient, lambda *_: (NONE, None), own_cutoffs=True),
    "srp": Spec(srp_settings, srp_coefficient, lambda *_: (NONE, None), words=SRP_WORDS, of_bonds=True),
    "zero": Spec(_zero_settings, _zero_coefficient, lambda *_: (NONE, None)),
}


def coefficient_words(style: PairStyle, found: Coefficient) -> list[str]:
    """Words after the types on a ``pair_coeff`` line, in the deck's units, the cutoff included."""
    words: list[str] = []
    for name, value in found.values.items():
        if name.endswith("_polynomial"):
            words.append("power" if name.startswith("exponent") else "kappa")
        words += [w if isinstance(w, str) else f"{w:.15g}" for w in (value if isinstance(value, tuple) else (value,))]
    return words if style.spec.own_cutoffs else [*words, f"{style.cutoff(found):.15g}"]
