"""Pair tables of a scene as LAMMPS pair styles, and the commands that sum charges up."""

from collections.abc import Iterator
from itertools import combinations_with_replacement

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.pairs import NONE
from ...model.scene import Scene
from ..styles.charges import QQR2E
from ..styles.pair_styles import EXPORTS
from ..styles.writing import Pair, PairExport, StyleUse, exact, lammps_seed
from .export_beads import BeadTypes


def pair_uses(export: PairExport) -> list[StyleUse]:
    """Styles of all tables, in the order in which LAMMPS needs them."""
    found: list[StyleUse] = []
    for table in export.scene.tables:
        entries = {pair: c for pair, c in table.resolve(export.scene.type_names).items() if c is not NONE}
        if not entries:
            continue
        if table.kind is None or table.kind not in EXPORTS:
            raise ParameterError(f"pair terms of kind {getattr(table.kind, '__name__', None)} cannot be exported to LAMMPS")
        found += EXPORTS[table.kind](export, entries)
    return found


def pair_lines(uses: list[StyleUse], types: BeadTypes, start: float, stop: float, seed: int) -> Iterator[str]:
    """The commands pair_style, pair_coeff and pair_modify; temperatures at the ends of the run in LAMMPS's units."""
    if not uses:
        yield "pair_style none"
        return
    pairs = list(combinations_with_replacement(dict.fromkeys(types.names), 2))
    bare = [pair for pair in pairs if not any(pair in use.coefficients for use in uses)]
    single = len(uses) == 1 and not bare and uses[0].name not in _HYBRID_ONLY
    words, seeds = list[str](), 0
    for use in uses:
        ends = ("0.0", "0.0") if use.constant else (exact(start), exact(stop))
        words.append(f"{use.name} {use.settings.format(start=ends[0], stop=ends[1], seed=lammps_seed(seed, seeds))}".strip())
        seeds += "{seed}" in use.settings
    yield f"pair_style {words[0]}" if single else "pair_style hybrid/overlay " + " &\n  ".join(words)
    for first, second in bare:
        yield f"pair_coeff {types.span(first)} {types.span(second)} none"
    n, bond_placeholders = len(types), any(use.name == "srp" for use in uses)
    everything = f"1*{n}" if bond_placeholders else "*"
    if bond_placeholders:
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


# -- charges --------------------------------------------------------------------------------------------------------------------
def charge_lines(scene: Scene, units: UnitSystem, of_deck: bool) -> Iterator[str]:
    """The commands dielectric and kspace_style.  LAMMPS's accuracy is relative to the force between two unit charges at a unit distance
    without a dielectric; that of a scene is relative to the forces that there are.  A deck keeps its own number."""
    charges = scene.electrostatics
    if charges is None:
        return
    assert scene.charges is not None
    strength = charges.coulomb(scene.initial_kT) / (units.energy * units.length)
    yield f"dielectric {exact(QQR2E[units.name] / strength)}"
    if scene.box is None:
        return
    accuracy = charges.tolerance
    if not of_deck:
        charged = scene.charges[scene.charges != 0]
        distance = (float(np.linalg.det(scene.box)) / max(1, len(charged))) ** (1 / 3) / units.length
        force = strength * float(np.mean(charged**2)) / distance**2 if len(charged) else 1.0
        accuracy *= min(1.0, force / QQR2E[units.name])
    yield f"kspace_style pppm {exact(accuracy)}"


def special_line(scene: Scene) -> str:
    """The special_bonds command; charges may have factors of their own."""
    factors = getattr(scene.electrostatics, "bonded_factors", None)
    if factors is None or tuple(factors) == tuple(scene.bonded_factors):
        return "special_bonds lj/coul " + " ".join(map(exact, scene.bonded_factors))
    return f"special_bonds lj {' '.join(map(exact, scene.bonded_factors))} coul {' '.join(map(exact, factors))}"
