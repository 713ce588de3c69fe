"""Which beads the fixes of a deck move, and with which scheme."""

from dataclasses import dataclass, replace

import numpy as np

from ..language.lexer import located
from ..state.deck_state import DeckState
from ..state.records import COUPLED, Fix, PressureControl
from ..state.rigid import RIGID, moved_by
from .flow import still_beads

#: Fixes that move beads.
INTEGRATORS = ("nve", "nve/sphere", "nve/limit", "nvt", "mvv/dpd", "mvv/edpd", "mvv/tdpd", "nph", "npt", "move", *RIGID)
#: Pair styles whose friction and noise fix shardlow applies.
SHARDLOW_PAIRS = ("dpd/fdt", "dpd/fdt/energy")
#: Pair styles with a bead field that only one fix advances: that fix, and the field.
ADVANCED_BY = {"edpd": ("mvv/edpd", "temperatures"), "tdpd": ("mvv/tdpd", "concentrations")}


@dataclass(frozen=True)
class Integration:
    """Combined effect of the integrating fixes."""

    scheme: str  #: ``mvv`` or ``shardlow``
    lambda_: float  #: Weight of the predicted velocity in ``mvv``; 1/2 is velocity Verlet
    mobile: np.ndarray  #: (N,) mask of the beads that some fix moves
    barostat: PressureControl | None = None  #: The pressure of ``fix nph``


def integration(state: DeckState) -> Integration:
    """Scheme and mobile beads from the present fixes.  DeckError if two fixes move the same bead, schemes are mixed, or a fix lacks its
    pair style or a pair style its fix."""
    mobile = np.zeros(len(state.atoms), dtype=bool)
    owners: list[Fix] = []
    for fix in state.fixes_of(*INTEGRATORS):
        group = moved_by(state, fix)
        if np.any(mobile & group):
            bead = int(state.atoms.ids[np.argmax(mobile & group)])
            others = ", ".join(other.name for other in owners)
            raise fix.error(f"bead {bead} is moved by fix {others} already; a bead can be in one integrating fix only")
        mobile |= group
        owners.append(fix)
    weights = {fix.parameters["lambda"] for fix in owners if fix.style != "move"}
    if len(weights) > 1:
        raise owners[-1].error(f"fixes with different lambda ({', '.join(f'{w:g}' for w in sorted(weights))}) cannot be combined")
    if not owners:
        state.note("no fix moves any beads")
    shardlow = state.fixes_of("shardlow")
    if shardlow:
        _check_shardlow(state, shardlow, owners)
    _check_energy(state, shardlow)
    _check_advanced(state, owners)
    mobile &= ~still_beads(state, mobile)
    return Integration("shardlow" if shardlow else "mvv", weights.pop() if weights else 0.5, mobile, _barostat(state, owners))


def _check_energy(state: DeckState, shardlow: list[Fix]) -> None:
    """Check that internal energies are advanced by exactly one of fix dpd/energy and fix shardlow."""
    heat = state.fixes_of("dpd/energy")
    styles = [style for style in state.pair.styles if style.name == "dpd/fdt/energy"]
    if len(heat) > 1:
        raise heat[1].error(f"there already is a fix dpd/energy ({heat[0].name})")
    if heat and shardlow:
        raise heat[0].error(f"dpd/energy and shardlow (fix {shardlow[0].name}) both advance the internal energies; use only one of them")
    if heat and not styles:
        names = ", ".join(style.name for style in state.pair.styles) or "none"
        raise heat[0].error(f"dpd/energy needs pair style dpd/fdt/energy; the deck has {names}")
    if styles and not heat and not shardlow:
        raise located(
            styles[0].where,
            "pair style dpd/fdt/energy needs fix dpd/energy (beside fix nve) or fix shardlow; "
            "without them the internal energies never change",
        )


def _check_advanced(state: DeckState, owners: list[Fix]) -> None:
    """Check that temperatures of edpd and concentrations of tdpd are advanced by the fix that moves the beads."""
    styles = {style.name: style for style in state.pair.styles}
    for pair, (fix_style, what) in ADVANCED_BY.items():
        for owner in owners:
            if owner.style == fix_style and pair not in styles:
                raise owner.error(f"{fix_style} needs pair style {pair}; the deck has {', '.join(styles) or 'none'}")
            if owner.style != fix_style and pair in styles:
                message = f"with pair style {pair}, use fix {fix_style} to move beads; {owner.style} would not change their {what}"
                raise owner.error(message)


def _barostat(state: DeckState, owners: list[Fix]) -> PressureControl | None:
    """The pressure of fix nph, and whether a thermostat holds the temperature."""
    fixes = [fix for fix in owners if fix.style in ("nph", "npt")]
    if not fixes:
        return None
    for fix in state.fixes_of("move"):
        raise fix.error(f"its beads cannot follow the box of fix {fixes[0].name} ({fixes[0].style})")
    if not all(state.periodic):
        raise fixes[0].error("constant pressure needs a box that is periodic along all axes")
    if len(fixes) > 1:
        raise fixes[1].error(f"there already is a fix {fixes[0].style} ({fixes[0].name}); use only one")
    unused = fixes[0].parameters["unused"]
    if fixes[0] in state.pistons:
        if fixes[0].style == "nph":
            _check_piston(state, fixes[0], unused)
        return fixes[0].parameters["pressure"]
    if unused:
        state.note(f"fix nph: {', '.join(unused)} (LAMMPS's motion of the box) has no effect here and is ignored")
    state.note(
        f"fix {fixes[0].style}: Monte Carlo volume moves replace LAMMPS's equations of motion of the box; averages are comparable, "
        "trajectories are not"
    )
    isothermal = bool(state.fixes_of(*COUPLED)) or any("start" in style.settings for style in state.pair.styles if style.spec.thermostat)
    return replace(fixes[0].parameters["pressure"], isothermal=isothermal)


def _check_piston(state: DeckState, fix: Fix, options: list[str]) -> None:
    """Check that a ``fix nph`` whose box moves as in LAMMPS says nothing that would have no effect."""
    if not state.group(fix.group).all() or state.require_box("fix nph").tilt.any():
        raise fix.error("with pair style mdpd, fix nph needs all beads, and a box without tilt")
    for word in {"nreset", "ptemp", "update"} & set(options):
        raise fix.error(f"with pair style mdpd, {word} of fix nph is not supported")


def _check_shardlow(state: DeckState, shardlow: list[Fix], owners: list[Fix]) -> None:
    fix = shardlow[0]
    if len(shardlow) > 1:
        raise shardlow[1].error(f"there already is a fix shardlow ({fix.name})")
    names = [style.name for style in state.pair.styles]
    if not set(names) & set(SHARDLOW_PAIRS):
        raise fix.error(f"fix shardlow needs pair style dpd/fdt or dpd/fdt/energy; the deck has {', '.join(names) or 'none'}")
    others = [style.name for style in state.pair.styles if style.spec.thermostat and style.name not in SHARDLOW_PAIRS]
    if others:
        raise fix.error(f"pair style {others[0]} with fix shardlow is not supported: its friction would act as a force")
    order = list(state.fixes)
    late = [owner for owner in owners if order.index(owner.name) < order.index(fix.name)]
    if late:
        raise fix.error(f"fix shardlow must come before the fix that moves the beads ({late[0].name}, style {late[0].style})")
    if not owners:
        raise fix.error("fix shardlow needs a fix nve after it")
    for owner in owners:
        if owner.style not in ("nve", "nph"):
            raise owner.error("with fix shardlow, use fix nve or nph to move beads")
