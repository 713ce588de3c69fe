"""Pair styles of LAMMPS's DPD-MESO package: beads with temperatures (edpd), with species (tdpd), many-body DPD (mdpd, mdpd/rhosum)."""

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.edpd import EDPD
from ...model.mdpd import MDPD
from ...model.tdpd import TDPD
from ..language import arguments as read
from ..state.pair_setup import Coefficient, Find, PairStyle, Spec, Term, Values
from .words import Columns, Exports, Pair, PairExport, StyleUse, exact, no_force, settings

_HEAT = {"kappa": "1/time", "exponent_T": "1", "cutoff_T": "length"}
_EDPD = Columns({"A": "force/kT", "gamma": "friction", "exponent": "1", "cutoff": "length", **_HEAT})


def _edpd_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    read.count(words, "A gamma power_f cutoff kappa power_T cutoff_T [power c1 c2 c3 c4] [kappa c1 c2 c3 c4]", 7, None)
    values: dict = _EDPD.read(words)
    for keyword, given in read.options(words[7:], {"power": 4, "kappa": 4}, "pair_coeff of edpd"):
        name = "exponent_polynomial" if keyword == "power" else "kappa_polynomial"
        values[name] = tuple(read.number(word, f"a coefficient of {keyword}") for word in given)
    return values, None


def _edpd_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    polynomials: dict = {name: values for name, values in found.values.items() if isinstance(values, tuple)}
    term = EDPD(**_EDPD.to_md(found.values, units), **polynomials)
    remark = "pair edpd: forces and heat have different cutoffs, which LAMMPS does not handle correctly; here each has its own"
    return term, remark if term.cutoff_T != term.cutoff else None


def _export_edpd(export: PairExport, entries: dict[Pair, EDPD]) -> list[StyleUse]:
    export.require_reduced("EDPD")
    words = {}
    for pair, c in entries.items():
        assert c.cutoff_T is not None  # filled by the coefficient
        if c.cutoff_T < c.cutoff:
            raise ParameterError(
                f"types {pair}: the heat has a shorter range ({c.cutoff_T:g} nm) than the forces ({c.cutoff:g} nm), where LAMMPS's "
                "edpd adds stale values; use the same cutoff for both"
            )
        if c.cutoff_T > c.cutoff:
            export.differences.add(f"types {pair}: LAMMPS's edpd cuts off the exchange of heat at the cutoff of the forces, {c.cutoff:g}")
        words[pair] = exact(_EDPD.of(c, export.units))
        for keyword, polynomial in (("power", c.exponent_polynomial), ("kappa", c.kappa_polynomial)):
            if any(polynomial):
                words[pair] += f" {keyword} {exact(polynomial)}"
    n = len(export.scene.type_names)
    different = len(set(words.values())) > 1 or len(words) < n * (n + 1) // 2
    if different and any(any(c.exponent_polynomial) or any(c.kappa_polynomial) for c in entries.values()):
        raise ParameterError(
            "EDPD: LAMMPS's edpd keeps only the polynomials of the last pair_coeff line, so with polynomials all type pairs must have the "
            "same coefficients"
        )
    if export.scene.compat != "lammps":
        export.differences.add(
            "LAMMPS's edpd computes the heat of friction and noise in a different way, which does not conserve energy "
            "(this package does the same with compat='lammps')"
        )
    if len(set(export.scene.bead_masses.tolist())) > 1:
        export.differences.add("LAMMPS's edpd uses the mass of one bead for both beads of a pair, which is wrong if their masses differ")
    longest = max(c.cutoff for c in entries.values())
    return [StyleUse("edpd", f"{exact(longest)} {{seed}}", words, longest)]


# -- tdpd ---------------------------------------------------------------------------------------------------------------------
_TDPD = Columns({"A": "force", "gamma": "friction", "exponent": "1", "cutoff": "length", "cutoff_c": "length"})


def _tdpd_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    n = style.settings["species"]
    each = " ".join(f"kappa_{k} epsilon_{k} power_{k}" for k in range(1, n + 1))
    read.count(words, f"A gamma power_f cutoff cutoff_c {each}", 5 + 3 * n)
    return _TDPD.read(words) | {"species": tuple(read.number(word, "a coefficient of a species") for word in words[5:])}, None


def _tdpd_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    kappa, epsilon, exponents = (found.values["species"][k::3] for k in range(3))
    term = TDPD(
        **_TDPD.to_md(found.values, units),
        kappa=tuple(k / units.time for k in kappa),
        epsilon=tuple(e / units.time**0.5 for e in epsilon),
        exponent_c=exponents,
    )
    remark = "pair tdpd: cutoff_c is longer than the cutoff, where LAMMPS cuts off the exchange; here it extends to cutoff_c"
    return term, remark if term.cutoff_c > term.cutoff else None  # type: ignore[operator]


def _export_tdpd(export: PairExport, entries: dict[Pair, TDPD]) -> list[StyleUse]:
    export.require_reduced("TDPD")
    words = {}
    for pair, c in entries.items():
        if c.cutoff_c > c.cutoff:  # type: ignore[operator]
            export.differences.add(
                f"types {pair}: LAMMPS's tdpd cuts off the exchange of species at the cutoff of the forces, {c.cutoff:g}"
            )
        species = np.column_stack([c.kappa, c.epsilon, c.exponent_c])
        words[pair] = f"{exact(_TDPD.of(c, export.units))} {exact(species)}"
    longest = max(c.cutoff for c in entries.values())
    return [StyleUse("tdpd", f"{{start}} {exact(longest)} {{seed}}", words, longest)]


# -- mdpd ---------------------------------------------------------------------------------------------------------------------
_MDPD = Columns({"A": "force", "B": "force/density", "gamma": "friction", "cutoff": "length", "cutoff_B": "length"})
#: The cutoff of mdpd/rhosum, which pair_styles.py adds to these coefficients.
_DENSITY = Columns({"cutoff_density": "length"})


def _mdpd_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    read.count(words, "A B gamma cutoff_A cutoff_B", 5)
    return _MDPD.read(words), None


def _mdpd_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    return MDPD(**_MDPD.to_md(found.values, units), **_DENSITY.to_md(found.values, units), kernel="lucy"), None


def _rhosum_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    read.count(words, "cutoff", 1)
    return {}, read.positive(words[0], "the cutoff of the density")


def _export_mdpd(export: PairExport, entries: dict[Pair, MDPD]) -> list[StyleUse]:
    export.require_reduced("MDPD")
    if any(c.kernel == "quadratic" for c in entries.values()):
        export.differences.add(
            "LAMMPS only has Lucy's kernel for the densities of mdpd; it replaces the quadratic kernel of this scene, with the same "
            "range (densities are of mass, and the force has no potential)"
        )
    forces = {pair: exact(_MDPD.of(c, export.units)) for pair, c in entries.items()}
    densities = {pair: exact(c.cutoff_density) for pair, c in entries.items()}
    longest = max(c.cutoff for c in entries.values())
    return [
        StyleUse("mdpd/rhosum", "", densities, max(c.cutoff_density for c in entries.values())),
        StyleUse("mdpd", f"{{start}} {exact(longest)} {{seed}}", forces, longest),
    ]


def _spec(name: str, words: str, coefficient, build) -> Spec:
    return Spec(settings(name, words), coefficient, build, thermostat=True, atom_style=name, own_cutoffs=True)


STYLES = {
    "edpd": _spec("edpd", "cutoff seed", _edpd_coefficient, _edpd_build),
    "tdpd": _spec("tdpd", "T cutoff seed", _tdpd_coefficient, _tdpd_build),
    "mdpd/rhosum": Spec(settings("mdpd/rhosum", ""), _rhosum_coefficient, no_force, atom_style="mdpd"),
    "mdpd": _spec("mdpd", "T cutoff seed", _mdpd_coefficient, _mdpd_build),
}

EXPORTS: Exports = {EDPD: _export_edpd, TDPD: _export_tdpd, MDPD: _export_mdpd}
