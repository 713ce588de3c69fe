"""Which beads the deck's fixes move, and by which scheme."""

from dataclasses import dataclass, replace

import numpy as np

from ..language.lexer import located
from ..state.deck_state import DeckState
from ..state.records import Fix, PressureControl
from .flow import still_beads

#: Fixes that move beads.
INTEGRATORS = ("nve", "mvv/dpd", "mvv/edpd", "mvv/tdpd", "nph")
#: Pair styles that fix shardlow takes over.
SHARDLOW_PAIRS = ("dpd/fdt", "dpd/fdt/energy")
#: Pair styles with a field of the beads that only one fix advances.
ADVANCED_BY = {"edpd": ("mvv/edpd", "temperatures"), "tdpd": ("mvv/tdpd", "concentrations")}


@dataclass(frozen=True)
class Integration:
    """What the fixes add up to."""

    scheme: str  #: ``mvv`` or ``shardlow``
    lambda_: float  #: Weight of the predicted velocity in ``mvv``; 1/2 is velocity Verlet
    mobile: np.ndarray  #: (N,) beads that some fix moves
    barostat: PressureControl | None = None  #: The pressure of ``fix nph``


def integration(state: DeckState) -> Integration:
    """Scheme and mobile beads of the deck's present fixes.  DeckError if two fixes move one bead, two schemes are mixed, a fix lacks its
    pair style, or a pair style its fix."""
    mobile = np.zeros(len(state.atoms), dtype=bool)
    owners: list[Fix] = []
    for fix in state.fixes_of(*INTEGRATORS):
        group = state.group(fix.group)
        if np.any(mobile & group):
            bead = int(state.atoms.ids[np.argmax(mobile & group)])
            others = ", ".join(other.name for other in owners)
            raise fix.error(f"bead {bead} is moved by fix {others} already; a bead can be in one integrating fix only")
        mobile |= group
        owners.append(fix)
    weights = {fix.parameters["lambda"] for fix in owners}
    if len(weights) > 1:
        raise owners[-1].error(f"fixes with different lambda ({', '.join(f'{w:g}' for w in sorted(weights))}) cannot be combined")
    if not owners:
        state.note("no fix integrates any bead: nothing will move")
    shardlow = state.fixes_of("shardlow")
    if shardlow:
        _check_shardlow(state, shardlow, owners)
    _check_energy(state, shardlow)
    _check_advanced(state, owners)
    mobile &= ~still_beads(state, mobile)
    return Integration("shardlow" if shardlow else "mvv", weights.pop() if weights else 0.5, mobile, _barostat(state, owners))


def _check_energy(state: DeckState, shardlow: list[Fix]) -> None:
    """Internal energies are advanced by fix dpd/energy or by fix shardlow, not by both and not by neither."""
    heat = state.fixes_of("dpd/energy")
    styles = [style for style in state.pair.styles if style.name == "dpd/fdt/energy"]
    if len(heat) > 1:
        raise heat[1].error(f"there is a fix dpd/energy already ({heat[0].name})")
    if heat and shardlow:
        raise heat[0].error(f"dpd/energy beside shardlow (fix {shardlow[0].name}) would do its work twice; use one of them")
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
    """Temperatures of edpd and concentrations of tdpd are advanced by the fix that moves the beads."""
    styles = {style.name: style for style in state.pair.styles}
    for pair, (fix_style, what) in ADVANCED_BY.items():
        for owner in owners:
            if owner.style == fix_style and pair not in styles:
                raise owner.error(f"{fix_style} needs pair style {pair}; the deck has {', '.join(styles) or 'none'}")
            if owner.style != fix_style and pair in styles:
                message = f"with pair style {pair} beads are moved by fix {fix_style}; {owner.style} would leave their {what} as they are"
                raise owner.error(message)


def _barostat(state: DeckState, owners: list[Fix]) -> PressureControl | None:
    """The pressure of fix nph, and whether something holds the temperature."""
    fixes = [fix for fix in owners if fix.style == "nph"]
    if not fixes:
        return None
    if not all(state.periodic):
        raise fixes[0].error("constant pressure needs a box that is periodic along all axes")
    if len(fixes) > 1:
        raise fixes[1].error(f"there is a fix nph already ({fixes[0].name}); a box follows one pressure")
    state.note("fix nph: Monte Carlo moves of the volume replace LAMMPS's motion of the box; averages compare, the path does not")
    isothermal = any("start" in style.settings for style in state.pair.styles if style.spec.thermostat)
    return replace(fixes[0].parameters["pressure"], isothermal=isothermal)


def _check_shardlow(state: DeckState, shardlow: list[Fix], owners: list[Fix]) -> None:
    fix = shardlow[0]
    if len(shardlow) > 1:
        raise shardlow[1].error(f"there is a fix shardlow already ({fix.name})")
    names = [style.name for style in state.pair.styles]
    if not set(names) & set(SHARDLOW_PAIRS):
        raise fix.error(f"fix shardlow needs pair style dpd/fdt or dpd/fdt/energy; the deck has {', '.join(names) or 'none'}")
    others = [style.name for style in state.pair.styles if style.spec.thermostat and style.name not in SHARDLOW_PAIRS]
    if others:
        raise fix.error(f"pair style {others[0]} beside fix shardlow is not supported: it would act as a force there")
    order = list(state.fixes)
    late = [owner for owner in owners if order.index(owner.name) < order.index(fix.name)]
    if late:
        raise fix.error(f"fix shardlow must come before the fix that moves the beads ({late[0].name}, style {late[0].style})")
    if not owners:
        raise fix.error("fix shardlow needs a fix nve after it")
    for owner in owners:
        if owner.style not in ("nve", "nph"):
            raise owner.error("beside fix shardlow beads are moved by fix nve or nph")
