"""Every pair, bond and angle style reads what it writes: coefficients of decks, and terms of scenes."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from cases import cases

import openmm_dpd as dpd
from openmm_dpd.lammps.files.data_file import JOINED
from openmm_dpd.lammps.language.lexer import Line
from openmm_dpd.lammps.state.pair_setup import Coefficient, PairStyle
from openmm_dpd.lammps.styles.pair_styles import EXPORTS, PAIR_STYLES
from openmm_dpd.lammps.styles.words import Differences, PairExport, bonded_styles
from openmm_dpd.units import UNIT_SYSTEMS

HERE = Line("", "in.deck", 1)

WORDS = {  # Words after the name of each style, and those of a coefficient: # is a number, [#] a cutoff that may be left out.
    "dpd": ("1.0 1.5 7", "# # [#]"),
    "dpd/tstat": ("1.0 2.0 1.5 7", "# [#]"),
    "dpd/ext": ("1.0 1.5 7", "# # # # # [#]"),
    "dpd/ext/tstat": ("1.0 2.0 1.5 7", "# # # # [#]"),
    "dpd/fdt": ("1.0 1.5 7", "# # [#]"),
    "dpd/fdt/energy": ("1.5 7", "# # # [#]"),
    "edpd": ("1.5 7", "# # # # # # # power # # # # kappa # # # #"),
    "tdpd": ("1.0 1.5 7", "# # # # # # # # # # #"),
    "mdpd/rhosum": ("", "#"),
    "mdpd": ("1.0 1.5 7", "# # # # #"),
    "lj/cut": ("1.5", "# # [#]"),
    "yukawa": ("2.5 1.5", "# [#]"),
    "soft": ("1.5", "# [#]"),
    **dict.fromkeys(("gauss", "lj/class2", "lj/smooth/linear", "lj/sf"), ("1.5", "# # [#]")),
    **dict.fromkeys(("gauss/cut", "morse", "morse/smooth/linear", "buck"), ("1.5", "# # # [#]")),
    "mie/cut": ("1.5", "# # # # [#]"),
    "table": ("linear 100", "pair.table LJ [#]"),
    "dpd/coul/slater/long": ("1.0 1.5 7 0.25 3.0", "# # yes [#]"),
    "coul/slater/long": ("0.25 3.0", ""),
    "coul/cut": ("3.0", ""),
    **dict.fromkeys(("coul/cut/soft", "coul/long/soft"), ("2 0.5 3.0", "0.7")),
    "coul/debye": ("2.0 3.0", ""),
    "coul/long": ("3.0", ""),
    "lj/cut/coul/cut": ("1.5 3.0", "# #"),
    "lj/cut/coul/debye": ("2.0 1.5 3.0", "# #"),
    "lj/cut/coul/long": ("1.5 3.0", "# # [#]"),
    "srp": ("0.8 * mid", "# [#]"),
    "srp/react": ("0.8 * mid grow", "# [#]"),
    "zero": ("1.5", "[#]"),
}


def style_of(name: str, words: str) -> PairStyle:
    style = PairStyle(name, PAIR_STYLES[name], PAIR_STYLES[name].settings(words.split()), HERE)
    if name == "tdpd":
        style.settings["species"] = 2
    return style


def drawn(words: str, seed: int) -> list[str]:
    """The words with numbers in the places of #; every second draw leaves the cutoff out."""
    rng = np.random.default_rng(seed)
    words = words.replace("[#]", "#" if seed % 2 else "")
    return [f"{rng.uniform(0.3, 9):.9g}" if word == "#" else word for word in words.split()]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", PAIR_STYLES)
def test_pair_coefficients_come_back(name, seed, tmp_path):
    settings, words = WORDS[name]
    style = style_of(name, settings)
    (tmp_path / "pair.table").write_text("LJ\nN 3\n\n1 0.1 3.0 4.0\n2 0.5 1.7 3.0\n3 1.1 0.0 0.0\n")
    found = Coefficient(*style.spec.coefficient(style, drawn(words, seed), tmp_path.joinpath), HERE)
    again = Coefficient(*style.spec.coefficient(style, style.words(found), tmp_path.joinpath), HERE)
    ours, theirs = ({key: value for key, value in one.values.items() if key != "data"} for one in (found, again))
    assert ours == theirs and style.cutoff(found) == style.cutoff(again)
    if name == "table":
        assert np.array_equal(found.values["data"].energies, again.values["data"].energies)


BONDED = {f"{what} {name}": (style, beads) for what, (beads, _) in JOINED.items() for name, style in bonded_styles(what).items()}


@pytest.mark.parametrize("units", UNIT_SYSTEMS.values(), ids=UNIT_SYSTEMS)
@cases("style, beads", BONDED)
def test_bonded_coefficients_come_back(style, beads, units):
    words = " ".join("1" if dimension == "1" else "#" for dimension in style.columns.dimensions.values())
    values = style.coefficient(drawn(words, 3), "type", units)
    assert style.coefficient(style.words(values, units), "type", units) == pytest.approx(values, rel=1e-14)
    if style.kind is not None:
        terms = style.build(np.arange(beads)[None, :], values)
        words = [repr(float(column[0])) for column in style.columns.of(terms, units)]
        assert style.coefficient(words, "type", units) == pytest.approx(values, rel=1e-15)


R = np.array([0.125, 0.5, 0.875, 1.25])

TERMS = {
    dpd.DPD: [
        dpd.DPD(A=25.3, gamma=4.7, cutoff=1.1),
        dpd.DPD(A=25.3, sigma=3.1, cutoff=0.9),
        dpd.DPD(A=0.0, gamma=4.7, cutoff=1.1),
        dpd.DPD(A=21.3, gamma=4.7, gamma_perp=1.7, exponent=0.7, exponent_perp=1.9, cutoff=1.1),
        dpd.DPD(A=0.0, gamma=4.7, gamma_perp=1.7, exponent=0.7, exponent_perp=1.9, cutoff=1.1),
    ],
    dpd.EnergyDPD: [dpd.EnergyDPD(A=25.3, sigma=3.1, kappa=2.7, cutoff=1.1)],
    dpd.EDPD: [
        dpd.EDPD(A=18.3, gamma=4.7, kappa=2e-3, cutoff=1.1, exponent=0.7),
        dpd.EDPD(A=18.3, gamma=4.7, kappa=2e-3, exponent_polynomial=(0.3, 0.1, 0.2, 0.4), kappa_polynomial=(0.5, -0.2, 0.1, 0.0)),
    ],
    dpd.TDPD: [dpd.TDPD(A=18.3, gamma=4.7, kappa=(1.3, 0.7), epsilon=(0.02, 0.0), exponent=0.7, exponent_c=(2.0, 1.5), cutoff_c=0.9)],
    dpd.MDPD: [dpd.MDPD(A=-40.3, B=25.7, gamma=18.1, cutoff=1.1, cutoff_B=0.75, cutoff_density=0.8, kernel="lucy")],
    dpd.LennardJones: [dpd.LennardJones(1.3, 0.7, cutoff=1.9), dpd.LennardJones(1.3, 0.7, cutoff=1.9, shift=True)],
    dpd.RadialPair: [
        dpd.RadialPair("soft", {"A": 1.3}, 1.1),
        dpd.RadialPair("gauss", {"A": 1.3, "B": 2.7}, 1.9, shift=True),
        dpd.RadialPair("gauss/cut", {"H": 1.3, "r0": 0.7, "sigma": 0.4}, 1.9),
        dpd.RadialPair("yukawa", {"A": 1.3, "kappa": 2.7}, 1.9),
        dpd.RadialPair("buck", {"A": 130.0, "rho": 0.3, "C": 1.7}, 1.9),
        dpd.RadialPair("lj/smooth/linear", {"epsilon": 1.3, "sigma": 0.7}, 1.9),
    ],
    dpd.TabulatedPair: [dpd.TabulatedPair(R, 3 * (1.25 - R) ** 2, 6 * (1.25 - R))],
}


REDUCED = (dpd.EDPD, dpd.TDPD, dpd.MDPD)  # LAMMPS has these in lj units only.


@pytest.mark.parametrize(
    ("kind", "k", "units"),
    [(kind, k, name) for kind in EXPORTS for k in range(len(TERMS[kind])) for name in UNIT_SYSTEMS if name == "lj" or kind not in REDUCED],
)
def test_terms_of_scenes_come_back(kind, k, units, tmp_path):
    term, kT = TERMS[kind][k], 1.3
    known = {"bond_pairs": (), "bonded_factors": (1.0, 1.0, 1.0), "compat": "lammps", "bead_masses": np.ones(1)}
    scene = SimpleNamespace(kT=kT, initial_kT=kT, type_names=("W",), **known)
    export = PairExport(scene, UNIT_SYSTEMS[units], False, "x", Differences())
    *others, use = EXPORTS[kind](export, {("W", "W"): term})
    for name, lines in export.tables.items():
        (tmp_path / name).write_text("\n".join(lines) + "\n")
    temperature = repr(kT / export.units.thermal_energy)
    style = style_of(use.name, use.settings.format(start=temperature, stop=temperature, seed=7))
    style.shift = use.modify == "shift yes"
    values, cutoff = style.spec.coefficient(style, use.coefficients["W", "W"].split(), tmp_path.joinpath)
    if others:
        (densities,) = others
        values["cutoff_density"] = float(densities.coefficients["W", "W"])
    again, _ = style.spec.build(style, Coefficient(values, cutoff, HERE), export.units)
    assert type(again) is kind
    for item in dataclasses.fields(kind):
        one, other = getattr(term, item.name), getattr(again, item.name)
        if one is None or isinstance(one, (str, bool)):
            assert one == other, item.name
        else:
            np.testing.assert_allclose(other, one, rtol=1e-14, atol=1e-15, err_msg=item.name)
