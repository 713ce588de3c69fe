"""Pair styles with charges: their arguments, the charges of a scene, and their export."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...base.units import COULOMB, UnitSystem
from ...model.electrostatics import GaussianCharges, SlaterCharges, SmearedCharges, ewald_sum
from ...model.point_charges import PointCharges
from ...model.scene import Scene
from ..files.data_file import CHARGED_STYLES
from ..language import arguments as read
from ..language.lexer import errors_at, located
from ..state.deck_state import DeckState
from ..state.pair_setup import Coefficient, Find, PairStyle, Spec, Values
from .dpd import STYLES as DPD_STYLES
from .radial import STYLES as RADIAL_STYLES
from .words import Differences, StyleUse, cutoff_of, exact, no_force, settings

#: Coulomb constant of LAMMPS's unit styles, energy times length per squared charge.
QQR2E = {"lj": 1.0, "real": 332.06371, "metal": 14.399645, "si": 8.9876e9, "cgs": 1.0, "micro": 8.987556e6, "nano": 230.7078669}


def _dpd_slater_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    """Parse ``A gamma [yes|no] [cutoff]``."""
    read.count(words, "A gamma [yes|no] [cutoff]", 2, 4)
    values: dict = {key: read.number(word, key) for key, word in zip(("A", "gamma"), words, strict=False)}
    values["charged"] = "yes" if len(words) > 2 and read.switch(words[2], "whether the pair is charged") else "no"
    return values, cutoff_of(words, 3)


def _slater_settings(words: list[str]) -> dict:
    found = settings("coul/slater/long", "lambda cutoff")(words)
    return {"lamda": found["lamda"], "cutoff_charges": found["cutoff"]}


def _no_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    """Check that ``pair_coeff * *`` has no coefficients."""
    read.count(words, f"pair_coeff i j ({style.name} has no coefficients)", 0)
    return {}, None


def _own_cutoff(style: PairStyle, words: list[str], _: Find) -> Values:
    """Parse the optional cutoff of ``coul/cut`` and ``coul/debye``, which has to be that of the style, or 0: no interaction."""
    read.count(words, "[cutoff]", 0, 1)
    if words and read.number(words[0], "the cutoff") == 0:
        return {"charged": "no"}, None
    _same_cutoff(style, cutoff_of(words, 0))
    return {}, None


def _soft_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    """Parse ``lambda [cutoff]`` of ``coul/cut/soft`` and ``coul/long/soft``, which has no cutoff of its own."""
    lattice = style.settings["lattice"]
    read.count(words, "lambda" if lattice else "lambda [cutoff]", 1, 1 if lattice else 2)
    _same_cutoff(style, cutoff_of(words, 1))
    lam = read.non_negative(words[0], "lambda")
    if lam > 1:
        raise ParameterError(f"lambda must be from 0 to 1, not {words[0]}")
    return {"lambda": lam}, None


def _same_cutoff(style: PairStyle, cutoff: float | None) -> None:
    if cutoff is not None and cutoff != style.settings["cutoff_charges"]:
        raise ParameterError(f"all charges have one cutoff here, {style.settings['cutoff_charges']:g} of pair_style; leave {cutoff:g} out")


def _lj_coefficient(style: PairStyle, words: list[str], find: Find) -> Values:
    """Parse ``epsilon sigma [cut_lj] [cut_coul]``."""
    if not style.settings["lattice"]:
        read.count(words, "epsilon sigma [cut_lj] [cut_coul]", 2, 4)
        _same_cutoff(style, cutoff_of(words, len(words) - 1) if len(words) > 2 else None)  # one cutoff is that of both
    return RADIAL_STYLES["lj/cut"].coefficient(style, words[:3], find)


def _lj_words(style: PairStyle, found: Coefficient) -> list[str]:
    """The words that :func:`_lj_coefficient` reads, with both cutoffs: one alone would be that of both."""
    return [f"{value:.15g}" for value in (*found.values.values(), style.cutoff(found), style.settings["cutoff_charges"])]


def _point_settings(name: str) -> Callable[[list[str]], dict]:
    """Arguments of a style with point charges: kappa of those that are screened, the cutoff of Lennard-Jones, that of the charges."""
    usage = ["kappa"] if name.endswith("debye") else ["n", "alpha_C"] if name.endswith("soft") else []
    usage += ["cutoff"] if name.startswith("lj") else []

    def reader(words: list[str]) -> dict:
        longest = [*usage, "cut_coul"]
        found = settings(name, " ".join(usage if len(words) == len(usage) and name.startswith("lj") else longest))(words)
        return {"cutoff_charges": found.get("cutoff"), **found, "lattice": "long" in name}

    return reader


def _point_style(name: str) -> Spec:
    """A style with point charges, alone or with Lennard-Jones."""
    if name.startswith("lj"):
        lj = RADIAL_STYLES["lj/cut"]
        write = None if name.endswith("long") else _lj_words
        return Spec(_point_settings(name), _lj_coefficient, lj.build, write, mixed=lj.mixed)
    coefficient = _soft_coefficient if name.endswith("soft") else _no_coefficient if name.endswith("long") else _own_cutoff
    return Spec(_point_settings(name), coefficient, no_force, own_cutoffs=True)


_DPD_SLATER = settings("dpd/coul/slater/long", "T cut_dpd seed lambda cut_coul")

STYLES = {
    # build makes the DPD part; charges belong to the beads
    "dpd/coul/slater/long": Spec(_DPD_SLATER, _dpd_slater_coefficient, DPD_STYLES["dpd"].build, thermostat=True),
    "coul/slater/long": Spec(_slater_settings, _no_coefficient, no_force, own_cutoffs=True),
    **{name: _point_style(name) for before in ("", "lj/cut/") for name in (f"{before}coul/{how}" for how in ("cut", "debye", "long"))},
    **{name: _point_style(name) for name in ("coul/cut/soft", "coul/long/soft")},
}


# -- from a scene -------------------------------------------------------------------------------------------------------------
def charge_use(scene: Scene, units: UnitSystem, types: list[str], differences: Differences) -> StyleUse | None:
    """Pair style for the charges, or None.  ParameterError for charges between walls, since LAMMPS's lattice sums need a periodic box."""
    charges = scene.electrostatics
    if charges is None:
        return None
    if scene.walls:
        raise ParameterError("charges between walls cannot be exported: LAMMPS's lattice sums need a periodic box")
    words = dict.fromkeys(combinations_with_replacement(types, 2), "")
    if isinstance(charges, PointCharges):
        reach = _farthest(scene, 0.0) if scene.ewald is None else scene.ewald.cutoff
        name = "coul/long" if charges.lattice and scene.box is not None else "coul/debye" if charges.screening else "coul/cut"
        before = f"{exact(charges.screening * units.length)} " if charges.screening else ""
        if charges.soft:
            # of all n, lambda and alpha_C with the same energy
            n, lam = (1, charges.strength) if charges.strength < 1 else (0, 0.5)
            before = f"{n} {exact((charges.softness / (1 - lam) / units.length) ** 2)} "
            name, words = f"{name}/soft", dict.fromkeys(words, exact(lam))
            if name == "coul/long/soft":
                differences.add("LAMMPS's forces of coul/long/soft are not the derivatives of its energies")
        return StyleUse(name, f"{before}{exact(reach / units.length)}", words, reach)
    width = _width(charges, differences)
    if scene.box is None:
        # the scene has no cutoff: take one that no pair reaches
        reach = _farthest(scene, width)
        differences.remark(f"charges interact up to a distance of {exact(reach / units.length)}, which should exceed all distances")
        return StyleUse("coul/slater/cut", f"{exact(width / units.length)} {exact(reach / units.length)}", words, reach)
    assert scene.ewald is not None
    reach = scene.ewald.cutoff
    return StyleUse("coul/slater/long", f"{exact(width / units.length)} {exact(reach / units.length)}", words, reach)


def _farthest(scene: Scene, width: float) -> float:
    """A cutoff (nm) that no pair of charges without a box reaches."""
    return 2.0 * float(np.linalg.norm(np.ptp(scene.positions, axis=0))) + 10 * width


def _width(charges, differences: Differences) -> float:
    """The lambda (nm) of LAMMPS's Slater charges."""
    if isinstance(charges, SlaterCharges):
        return charges.lamda
    assert isinstance(charges, GaussianCharges)
    width = math.sqrt(math.pi) * charges.width
    differences.add(
        f"the Gaussian charges (width {charges.width:g}) are replaced by Slater charges with lambda = {width:g}, with the same energy "
        "at contact but a longer range"
    )
    return width


# -- to a scene ---------------------------------------------------------------------------------------------------------------
def electrostatics_of(state: DeckState) -> SmearedCharges | None:
    """The charges of the scene; None if no pair style has charges.  DeckError if styles, charges and box are inconsistent."""
    styles = [style for style in state.pair.styles if "cutoff_charges" in style.settings]
    if not styles:
        if state.kspace is not None:
            raise located(state.kspace.where, "kspace_style needs a pair style with charges: coul/slater/long, coul/long, ...")
        return None
    style = styles[0]
    if len(styles) > 1:
        raise located(style.where, f"there are two pair styles with charges, {style.name} and {styles[1].name}; use one")
    lattice = style.settings.get("lattice", True)
    if not lattice and style.coefficients and all(found.values.get("charged") == "no" for found in style.coefficients.values()):
        return None  # all cutoffs are 0
    if lattice and state.kspace is None:
        raise located(style.where, f"pair style {style.name} needs a kspace_style, ewald or pppm")
    if not lattice and state.kspace is not None:
        raise located(state.kspace.where, f"pair style {style.name} has no lattice sum; leave kspace_style out, or use coul/long")
    if not state.has_atom_style(*CHARGED_STYLES):
        raise located(style.where, f"pair style {style.name} needs charges; atom_style {state.atom_style} has none; use charge or full")
    if lattice and not all(state.periodic):
        raise located(style.where, f"pair style {style.name} needs periodic boundaries along all axes")
    _check_flags(state, style)
    settings, units, kspace = style.settings, state.units, state.kspace
    constant = QQR2E[units.name] * units.energy * units.length / state.dielectric
    known: dict[str, Any] = {"permittivity": COULOMB / constant, "cutoff": settings["cutoff_charges"] * units.length}
    known["bonded_factors"] = state.special_charges if len(state.bonds) else None
    if kspace is not None:
        known |= {"tolerance": kspace.accuracy, "alpha": kspace.gewald, "grid": kspace.mesh}
    with errors_at(style.where, f"pair style {style.name}: "):
        if "alpha_C" in settings:
            values = sorted({found.values["lambda"] for found in style.coefficients.values()})
            if len(values) > 1:
                raise ParameterError(f"all pairs have one lambda here, not {' and '.join(f'{value:g}' for value in values)}")
            known |= {"strength": values[0] ** settings["n"], "softness": settings["alpha_C"] ** 0.5 * (1 - values[0]) * units.length}
        if "lattice" in settings:
            return _on_mesh(state, PointCharges(screening=settings.get("kappa", 0.0) / units.length, lattice=lattice, **known))
        return _on_mesh(state, SlaterCharges(lamda=settings["lamda"] * units.length, **known))


def _on_mesh(state: DeckState, charges: SmearedCharges) -> SmearedCharges:
    """The charges without the mesh of kspace_modify, with a note, where it is too coarse; ParameterError if something else is wrong."""
    if charges.grid is None:
        return charges
    box, count = state.require_box("kspace_style").vectors * state.units.length, int(np.count_nonzero(state.atoms.charges))
    try:
        ewald_sum(charges, box, count)
    except ParameterError:
        finer = replace(charges, grid=None)
        grid = ewald_sum(finer, box, count).grid
        if any(own < given for own, given in zip(grid, charges.grid, strict=True)):
            raise
        mesh, own = (" x ".join(map(str, points)) for points in (charges.grid, grid))
        state.note(f"kspace_modify mesh: {mesh} points are too few for the accuracy of kspace_style; {own} are used")
        return finer
    return charges


def _check_flags(state: DeckState, style: PairStyle) -> None:
    """Check that every pair of types with charges is a charged pair, since the lattice sum includes all charges."""
    charged = sorted(np.unique(state.atoms.types[state.atoms.charges != 0]).tolist())
    counts = {kind: int(np.sum(state.atoms.types == kind)) for kind in charged}
    for k, i in enumerate(charged):
        for j in charged[k:]:
            if i == j and counts[i] == 1:
                continue
            found = style.coefficients.get((i, j))
            if found is None and style.spec.mixed and {(i, i), (j, j)} <= set(style.coefficients):
                continue  # mixed
            if found is not None and found.values.get("charged", "yes") == "yes":
                continue
            where = style.where if found is None else found.where
            remedy = "say 'yes' on its pair_coeff line" if style.name.startswith("dpd") else f"add a pair_coeff line of {style.name}"
            raise located(
                where,
                f"types {i} {j} both have charges, but pair style {style.name} does not treat the pair as charged. All charges interact "
                f"here, and in a lattice sum, so their interaction would be wrong without the real-space part; {remedy}",
            )
    if not charged:
        raise style.error("no bead has a charge; read charges from the data file, or use 'set type'")
    for (i, j), found in sorted(style.coefficients.items()):
        if style.name.startswith("dpd") and found.values["charged"] == "yes" and not {i, j} <= set(charged):
            state.note(f"pair_coeff {i} {j} is marked as charged, but beads of these types have no charge: the flag has no effect")
