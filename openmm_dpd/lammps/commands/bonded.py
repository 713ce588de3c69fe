"""Commands about bonds, angles and dihedrals: bond_style, bond_coeff, angle_style, angle_coeff, dihedral_style, dihedral_coeff."""

from functools import partial

from ...base.errors import ParameterError
from ..files.atom_styles import JOINED
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.pair_setup import BondedSetup
from ..styles.bonded_styles import bonded_styles
from .setup import command


def _style(state: DeckState, args: list[str], what: str) -> None:
    """``bond_style``, ``angle_style`` or ``dihedral_style``: none, zero, a style that is known, or ``hybrid`` with several of them."""
    known, old = bonded_styles(what), getattr(state, what)
    style = read.choice(args[0], f"the {what} style", ("none", *known, "hybrid"))
    setup = BondedSetup(style, where=state.here)
    if style == "none":
        read.count(args[1:], f"{what}_style none", 0)
    elif style == "hybrid":
        read.count(args[1:], f"{what}_style hybrid style style ...", 1, None)
        for k, name in enumerate(args[1:], start=1):
            read.choice(name, f"a style of {what}_style hybrid", tuple(known))
            if name in args[1:k]:
                raise ParameterError(f"{what}_style hybrid names {name} twice")
        setup.styles = tuple(args[1:])
    else:
        read.choice(" ".join(args[1:]), f"the argument of {what}_style {style}", ("", "nocoeff") if style == "zero" else ("",))
        setup.styles, setup.coefficients = (style,), dict(old.coefficients) if old.style == style else {}
    setattr(state, what, setup)


def _coeff(state: DeckState, args: list[str], what: str) -> None:
    """``bond_coeff type [style] values ...``, ``angle_coeff`` or ``dihedral_coeff``."""
    command, known, setup, types = f"{what}_coeff", bonded_styles(what), getattr(state, what), getattr(state, f"n_{what}_types")
    state.require_box(command)
    if setup.style == "none":
        others = "cosine" if what == "angle" else "harmonic"
        raise ParameterError(f"{command} needs a{'n' * (what == 'angle')} {what}_style before it, such as '{what}_style {others}'")
    read.count(args, f"{command} type values ...", 1, None)
    if types == 0:
        raise ParameterError(f"{command}: there are no {what} types")
    kinds = read.numeric_range(args[0], types, f"{what} type")
    style, words = setup.style, args[1:]
    if style == "hybrid":
        allowed = (*setup.styles, "none")
        if not words or words[0] not in allowed:
            raise ParameterError(f"expected one of the styles {', '.join(allowed)} after the type, not '{' '.join(words[:1])}'")
        style, words = words[0], words[1:]
    if style == "none":
        values: dict[str, float] = {}
        read.count(words, f"{command} type none", 0)
    else:
        usage = f"{command} type {style}" if setup.style == "hybrid" else f"{command} type"
        values = known[style].coefficient(words, usage, state.units)
    setup.coefficients.update(dict.fromkeys(kinds, (style, values)))


for _what in JOINED:
    command(f"{_what}_style style", 1, None, remembered=True)(partial(_style, what=_what))
    command(f"{_what}_coeff type values ...", 0, None, remembered=True)(partial(_coeff, what=_what))
