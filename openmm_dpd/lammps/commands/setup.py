"""Commands that come before the beads: units, dimension, boundary, atom_style, and what has no meaning here."""

from collections.abc import Callable

import numpy as np

from ...errors import ParameterError
from ...units import UNIT_SYSTEMS
from ..files.atom_styles import ATOM_STYLES
from ..language import arguments as read
from ..language.arguments import INSTEAD
from ..state.deck_state import DeckState
from ..state.records import MIN_STYLES, NORMS

Handler = Callable[[DeckState, list[str]], None]


def by_name(*handlers: Handler) -> dict[str, Handler]:
    """A table of commands by the names of the functions; those that mean something else in Python end with an underscore."""
    return {handler.__name__.rstrip("_"): handler for handler in handlers}


def remembered(table: dict[str, Handler]) -> dict[str, Handler]:
    """The same commands, which are remembered in ``DeckState.setup`` once they are carried out."""

    def remembering(name: str, handler: Handler) -> Handler:
        def carry_out(state: DeckState, args: list[str]) -> None:
            words = list(args)
            handler(state, args)
            state.setup.append((name, words))

        return carry_out

    return {name: remembering(name, handler) for name, handler in table.items()}


#: Atom styles whose models are written in reduced units.
REDUCED = ("edpd", "tdpd", "mdpd")


def units(state: DeckState, args: list[str]) -> None:
    """``units lj|real|metal``."""
    read.count(args, "units style", 1)
    state.refuse_box("units")
    if state.atom_style in REDUCED and args[0] != "lj":
        raise ParameterError(f"atom_style {state.atom_style} needs units lj, not units {args[0]}")
    state.units = UNIT_SYSTEMS[read.choice(args[0], "units", list(UNIT_SYSTEMS))]
    state.timestep = state.units.timestep * state.units.time


def dimension(state: DeckState, args: list[str]) -> None:
    """``dimension 3``."""
    read.count(args, "dimension 3", 1)
    if args[0] != "3":
        raise ParameterError(f"only three dimensions are supported, not dimension {args[0]}: {INSTEAD['dimension 2']}")


def boundary(state: DeckState, args: list[str]) -> None:
    """``boundary p p p``, with f for axes that walls close (see :mod:`openmm_dpd.lammps.scene.flow`)."""
    read.count(args, "boundary p p p", 3)
    state.refuse_box("boundary")
    if any(word not in ("p", "pp", "f", "ff") for word in args):
        raise ParameterError(f"boundaries are periodic (p) or, behind fix wall/reflect, fixed (f), not '{' '.join(args)}'")
    x, y, z = (word in ("p", "pp") for word in args)
    state.periodic = x, y, z


def atom_style(state: DeckState, args: list[str]) -> None:
    """``atom_style style``, or ``atom_style tdpd N`` with the number of species."""
    read.count(args, "atom_style style", 1, None)
    state.refuse_box("atom_style")
    style = read.choice(args[0], "the atom style", list(ATOM_STYLES))
    read.count(args, f"atom_style {style}{' N' * (style == 'tdpd')}", 1 + (style == "tdpd"))
    if style in REDUCED and state.units.name != "lj":
        raise ParameterError(f"atom_style {style} needs units lj, but the deck's are {state.units.name}")
    state.atom_style = style
    state.n_species = read.integer(args[1], "the number of species", 1) if style == "tdpd" else 0
    state.atoms.concentrations = np.zeros((0, state.n_species))


def neigh_modify(state: DeckState, args: list[str]) -> None:
    """``neigh_modify``: lists are managed elsewhere, but ``exclude`` would change the forces."""
    if "exclude" in args:
        raise ParameterError("neigh_modify exclude is not supported; use 'pair_coeff i j none' or special_bonds")
    _ignored("neigh_modify")(state, args)


def run_style(state: DeckState, args: list[str]) -> None:
    """``run_style verlet``."""
    if args != ["verlet"]:
        raise ParameterError(f"only run_style verlet is supported, not '{' '.join(args)}'")


def atom_modify(state: DeckState, args: list[str]) -> None:
    """``atom_modify``: how beads are stored."""
    for word, values in read.options(args, {"map": 1, "sort": 2, "id": 1, "first": 1}, "atom_modify"):
        if word == "id":
            raise ParameterError("atom_modify id is not supported: beads always have ids")
        if word == "sort":
            state.sorts = read.integer(values[0], "the interval of sorting", 0) > 0
    _ignored("atom_modify")(state, args)


def min_style(state: DeckState, args: list[str]) -> None:
    """``min_style style``: there is one minimiser."""
    read.count(args, "min_style style", 1, None)
    state.min_style = read.choice(args[0], "the style of min_style", MIN_STYLES)
    state.note(f"min_style {' '.join(args)}: one minimiser (L-BFGS) goes down for all styles")


_MIN_OPTIONS = (
    "dmax line tmax tmin delaystep dtgrow dtshrink alpha0 alphashrink vdfmax halfstepback initialdelay integrator norm abcfire"
).split()


def min_modify(state: DeckState, args: list[str]) -> None:
    """``min_modify norm two|max|inf``; what is about steps of LAMMPS's minimisers has no meaning."""
    for keyword, values in read.options(args, dict.fromkeys(_MIN_OPTIONS, 1), "min_modify"):
        if keyword == "norm":
            state.force_norm = read.choice(values[0], "norm", list(NORMS))
        else:
            state.note(f"min_modify {keyword} has no meaning here and is ignored")


def _ignored(command: str) -> Handler:
    def handler(state: DeckState, args: list[str]) -> None:
        state.note(f"{command} has no meaning here and is ignored")

    return handler


#: Commands about how LAMMPS organises its work: read, said once, ignored.
IGNORED = tuple("comm_modify comm_style echo info log neighbor newton package processors suffix timer".split())

COMMANDS = by_name(units, dimension, boundary, atom_style, atom_modify, neigh_modify, min_style, min_modify, run_style)
COMMANDS |= {name: _ignored(name) for name in IGNORED}
