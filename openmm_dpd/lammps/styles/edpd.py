"""Pair style edpd: DPD between beads with temperatures of their own."""

from ...errors import ParameterError
from ...model.edpd import EDPD
from ...units import UnitSystem
from ..language import arguments as read
from ..state.pair_setup import Coefficient, Find, PairStyle, Spec, Term, Values
from .columns import Columns, seeded
from .writing import Exports, Pair, PairExport, StyleUse, exact

_COLUMNS = Columns(
    {
        "A": "force/kT",
        "gamma": "friction",
        "exponent": "1",
        "cutoff": "length",
        "kappa": "1/time",
        "exponent_T": "1",
        "cutoff_T": "length",
    }
)


def _edpd_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    read.count(words, "A gamma power_f cutoff kappa power_T cutoff_T [power c1 c2 c3 c4] [kappa c1 c2 c3 c4]", 7, None)
    values: dict = _COLUMNS.read(words)
    for keyword, given in read.options(words[7:], {"power": 4, "kappa": 4}, "pair_coeff of edpd"):
        name = "exponent_polynomial" if keyword == "power" else "kappa_polynomial"
        values[name] = tuple(read.number(word, f"a coefficient of {keyword}") for word in given)
    return values, None


def _edpd_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    polynomials: dict = {name: values for name, values in found.values.items() if isinstance(values, tuple)}
    term = EDPD(**_COLUMNS.to_md(found.values, units), **polynomials)
    remark = "pair edpd: forces and heat have different cutoffs, which LAMMPS does not compute correctly; here each has its own"
    return term, remark if term.cutoff_T != term.cutoff else None


STYLES = {
    "edpd": Spec(seeded("edpd", 0), _edpd_coefficient, _edpd_build, thermostat=True, atom_style="edpd", own_cutoffs=True),
}


def _export(export: PairExport, entries: dict[Pair, EDPD]) -> list[StyleUse]:
    export.require_reduced("EDPD")
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
        words[pair] = exact(_COLUMNS.of(c, export.units))
        for keyword, polynomial in (("power", c.exponent_polynomial), ("kappa", c.kappa_polynomial)):
            if any(polynomial):
                words[pair] += f" {keyword} {exact(polynomial)}"
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
    return [StyleUse("edpd", f"{exact(longest)} {{seed}}", words, longest)]


EXPORTS: Exports = {EDPD: _export}
