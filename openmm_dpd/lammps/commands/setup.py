"""The table of commands; the commands that come before the beads (units, dimension, boundary, atom_style); and those without effect."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UNIT_SYSTEMS
from ..files.data_file import ATOM_STYLES, BONDED_STYLES
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.records import MIN_STYLES, NORMS

Handler = Callable[[Any, list[str]], Iterator[Any] | None]
#: All commands of decks, by name; :func:`command` adds one.  A command that starts runs yields their requests
#: (:class:`openmm_dpd.lammps.run.request.RunRequest`).
COMMANDS: dict[str, Handler] = {}
#: Commands about interactions: ``DeckState.setup`` records them, and restart files repeat them.
REMEMBERED: dict[str, Handler] = {}


def command(
    usage: str, least: int, most: int | None = -1, *, box: bool | None = None, remembered: bool = False
) -> Callable[[Handler], Handler]:
    """Register a function as the command that ``usage`` begins with; it takes ``least`` to ``most`` words (see :func:`read.count`).
    ``box`` says whether a simulation box must exist (True) or must not exist yet (False)."""
    name = usage.split()[0]

    def enter(handler: Handler) -> Handler:
        def carry_out(state: DeckState, args: list[str]) -> Iterator[Any] | None:
            read.count(args, usage, least, most)
            if box is not None:
                (state.require_box if box else state.refuse_box)(name)
            words = list(args)
            requests = handler(state, args)
            if remembered:
                state.setup.append((name, words))
            return requests

        COMMANDS[name] = carry_out
        if remembered:
            REMEMBERED[name] = carry_out
        return handler

    return enter


#: Atom styles that require reduced units.
REDUCED = ("edpd", "tdpd", "mdpd")


@command("units style", 1, box=False)
def units(state: DeckState, args: list[str]) -> None:
    """``units style``; numbers that are reduced ones are found by the size of the box (``UnitSystem.for_box``)."""
    if state.has_atom_style(*REDUCED) and args[0] != "lj":
        raise ParameterError(f"atom_style {state.atom_style} needs units lj, not units {args[0]}")
    state.units = UNIT_SYSTEMS[read.choice(args[0], "units", list(UNIT_SYSTEMS))]
    state.timestep = state.units.timestep * state.units.time


@command("dimension 2|3", 1, box=False)
def dimension(state: DeckState, args: list[str]) -> None:
    """``dimension 2|3``."""
    state.set_dimension(int(read.choice(args[0], "the dimension", ("2", "3"))))


@command("boundary p p p", 3, box=False)
def boundary(state: DeckState, args: list[str]) -> None:
    """``boundary p p p``, with f for axes closed by walls (see :mod:`openmm_dpd.lammps.scene.flow`)."""
    if any(word not in ("p", "pp", "f", "ff") for word in args):
        raise ParameterError(f"boundaries must be periodic (p) or, with fix wall/reflect, fixed (f), not '{' '.join(args)}'")
    x, y, z = (word in ("p", "pp") for word in args)
    state.periodic = x, y, z


@command("atom_style style", 1, None, box=False)
def atom_style(state: DeckState, args: list[str]) -> None:
    """``atom_style style``, ``tdpd N`` with the number of species, ``template ID`` of a molecule, or ``hybrid`` with several of them."""
    styles, rest, state.n_species = list[str](), args[args[0] == "hybrid" :], 0
    while rest:
        style, *rest = rest
        if style == "template":  # Saves LAMMPS memory; the beads have the same as those of molecular.
            words, rest = read.taken(rest, 1, "atom_style template")
            read.known(state.templates, words[0], "molecule")
            style = "molecular"
        styles.append(read.choice(style, "the atom style", list(ATOM_STYLES)))
        if style == "tdpd":
            read.count(rest[:1], "atom_style tdpd N", 1, 1)
            words, rest = rest[:1], rest[1:]
            state.n_species = read.integer(words[0], "the number of species", 1)
        if style in REDUCED and state.units.name != "lj":
            raise ParameterError(f"atom_style {style} needs units lj, but the deck's are {state.units.name}")
    if not styles or len(styles) != (len(set(styles)) if args[0] == "hybrid" else 1):
        raise ParameterError(f"expected 'atom_style style' or 'atom_style hybrid style style ...', not '{' '.join(args)}'")
    state.atom_style = " ".join(args[:1] + styles if args[0] == "hybrid" else styles)
    state.atoms.concentrations = np.zeros((0, state.n_species))


#: What neigh_modify may exclude: number of words.
_EXCLUDED = {"type": 2, "group": 2, "molecule": 1, "molecule/intra": 1, "molecule/inter": 1, "none": 0}


@command("neigh_modify", 0, None)
def neigh_modify(state: DeckState, args: list[str]) -> None:
    """``neigh_modify exclude type|group|molecule/intra|molecule/inter|none ...``; other words concern LAMMPS's lists and are ignored."""
    rest = list(args)
    while "exclude" in rest:
        at = rest.index("exclude")
        kind = read.choice("".join(rest[at + 1 : at + 2]), "what neigh_modify excludes", list(_EXCLUDED))
        if kind == "molecule":
            state.note("neigh_modify exclude molecule is read as molecule/intra, its name in present LAMMPS")
            kind = "molecule/intra"
        words, after = read.taken(rest[at + 2 :], _EXCLUDED[kind], f"neigh_modify exclude {kind}")
        for word in words:
            (state.type_number if kind == "type" else state.group)(word)
        if kind.startswith("molecule"):
            state.require_atom_style(f"neigh_modify exclude {kind}", *BONDED_STYLES)
        state.exclusions = [*state.exclusions, (kind, *words)] if words else []
        rest = rest[:at] + after
    _only_all("neigh_modify", "include", rest)
    if rest:
        _ignored("neigh_modify")(state, rest)


@command("comm_modify", 0, None)
def comm_modify(state: DeckState, args: list[str]) -> None:
    """``comm_modify``: ignored, except for ``group``, since other beads would have no forces across faces."""
    _only_all("comm_modify", "group", args)
    _ignored("comm_modify")(state, args)


def _only_all(command: str, word: str, args: list[str]) -> None:
    if word in args and args[args.index(word) + 1 :][:1] != ["all"]:
        raise ParameterError(f"{command} {word} must be all: other beads would lack forces; set their pair_coeff to none")


@command("run_style", 0, None)
def run_style(state: DeckState, args: list[str]) -> None:
    """``run_style verlet``."""
    one_step = args[:1] == ["respa"] and args[1:2] and set(args[2 : 1 + read.integer(args[1], "the number of levels", 1)]) <= {"1"}
    if args != ["verlet"] and not one_step:
        raise ParameterError(f"only run_style verlet, or respa whose levels have the same step, is supported, not '{' '.join(args)}'")


@command("atom_modify", 0, None)
def atom_modify(state: DeckState, args: list[str]) -> None:
    """``atom_modify``: storage of beads; only ``sort`` matters."""
    only = {"id": (read.YES, "beads always have ids")}
    for word, values in read.options(args, {"map": 1, "sort": 2, "id": 1, "first": 1}, "atom_modify", only=only):
        if word == "sort":
            state.sorts = read.integer(values[0], "the interval of sorting", 0) > 0
    _ignored("atom_modify")(state, args)


@command("min_style style", 1, None)
def min_style(state: DeckState, args: list[str]) -> None:
    """``min_style style``; all styles use the same minimiser."""
    state.min_style = read.choice(args[0], "the style of min_style", MIN_STYLES)
    state.note(f"min_style {' '.join(args)}: the minimiser is L-BFGS for all styles")


_MIN_OPTIONS = (
    "dmax line tmax tmin delaystep dtgrow dtshrink alpha0 alphashrink vdfmax halfstepback initialdelay integrator norm abcfire"
).split()


@command("min_modify", 0, None)
def min_modify(state: DeckState, args: list[str]) -> None:
    """``min_modify norm two|max|inf``; options of LAMMPS's minimisers are ignored."""
    for keyword, values in read.options(args, dict.fromkeys(_MIN_OPTIONS, 1), "min_modify"):
        if keyword == "norm":
            state.force_norm = read.choice(values[0], "norm", list(NORMS))
        else:
            state.note(f"min_modify {keyword} has no effect here and is ignored")


def _ignored(command: str) -> Handler:
    def handler(state: DeckState, args: list[str]) -> None:
        state.note(f"{command} has no effect here; keep it for LAMMPS")

    return handler


#: Commands about LAMMPS's internals: ignored with a note.
IGNORED = tuple("balance comm_style echo info log neighbor newton package processors suffix timer".split())

COMMANDS |= {name: _ignored(name) for name in IGNORED}
