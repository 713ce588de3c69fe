"""Commands about interactions: pair_*, special_bonds, bond_*, angle_* and dihedral_*, and charges: kspace_style, kspace_modify,
dielectric."""

from dataclasses import replace
from functools import partial

from ...base.errors import ParameterError
from ..files.data_file import JOINED
from ..files.table_file import MODES
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.pair_setup import BondedSetup, Coefficient, PairSetup, PairStyle
from ..state.records import KspaceSetup
from ..styles.pair_styles import PAIR_STYLES
from ..styles.radial import MIXING
from ..styles.words import bonded_styles
from .setup import command

HYBRID = ("hybrid", "hybrid/overlay")


@command("pair_style style args ...", 1, None, remembered=True)
def pair_style(state: DeckState, args: list[str]) -> None:
    """``pair_style style args ...``; ``hybrid`` and ``hybrid/overlay`` take several styles with their arguments."""
    name, words = args[0], args[1:]
    if name == "none":
        read.count(words, "pair_style none", 0)
        state.pair = PairSetup("none", where=state.here)
        return
    if name in HYBRID:
        state.pair = PairSetup(name, [_style(state, part[0], part[1:]) for part in _parts(name, words)], where=state.here)
    else:
        style = _style(state, name, words)
        if style.spec.of_bonds:
            raise ParameterError(f"pair style {name} acts between bonds; use it in pair_style hybrid, together with a style for beads")
        old = state.pair.styles[0] if state.pair.mode == "single" else None
        excluded: set[tuple[int, int]] = set()
        if old is not None and old.name == name and style.spec.keeps_coefficients:
            # LAMMPS keeps the coefficients if the same style is set again, but resets all cutoffs to the new global one
            style.coefficients = {key: replace(found, cutoff=None) for key, found in old.coefficients.items()}
            style.mix, style.shift, excluded = old.mix, old.shift, state.pair.excluded
        state.pair = PairSetup("single", [style], excluded, state.here)
    if any("table" == style.name for style in state.pair.styles):
        state.note("pair_style table: a cubic spline through the energies of the file is used, regardless of the number of table points")


def _parts(name: str, words: list[str]) -> list[list[str]]:
    """Arguments of hybrid, split before the name of each style."""
    if not words:
        raise ParameterError(f"pair_style {name} needs at least one style")
    parts: list[list[str]] = []
    for word in words:
        is_style = word in PAIR_STYLES
        spec = PAIR_STYLES[parts[-1][0]] if parts else None
        own = spec is not None and (word in spec.words or (spec.of_bonds and len(parts[-1]) == 4))  # then it may be the name of a fix
        if not is_style and (not parts or not (word in (*MODES, "nocoeff") or own or is_number(word))):
            read.style(PAIR_STYLES, "pair", word, "none", *HYBRID)
        if is_style:
            parts.append([])
        parts[-1].append(word)
    return parts


def is_number(word: str) -> bool:
    """Whether a word is a number."""
    try:
        read.as_float(word)
    except ValueError:
        return False
    return True


def _style(state: DeckState, name: str, words: list[str]) -> PairStyle:
    assert state.here is not None
    spec = read.style(PAIR_STYLES, "pair", name, "none", *HYBRID)
    if spec.atom_style is not None:
        state.require_atom_style(f"pair style {name}", spec.atom_style)
    style = PairStyle(name, spec, spec.settings(words), state.here)
    if spec.atom_style == "tdpd":
        style.settings["species"] = state.n_species
    return style


@command("pair_coeff i j values ...", 2, None, box=True, remembered=True)
def pair_coeff(state: DeckState, args: list[str]) -> None:
    """``pair_coeff i j [style [n]] values ...``, or ``pair_coeff i j none``."""
    setup = state.pair
    if setup.mode == "none":
        raise ParameterError("pair_coeff needs a preceding pair_style")
    first, second = (read.numeric_range(word, state.n_types, "atom type") for word in args[:2])
    # ranges select pairs i <= j; single numbers may be in either order
    pairs = [(i, j) for i in first for j in second if i <= j]
    if not pairs and "*" not in args[0] + args[1]:
        pairs = [(second[0], first[0])]
    if not pairs:
        raise ParameterError(f"'{args[0]} {args[1]}' contains no pair of types with i <= j")
    words = args[2:]
    if words == ["none"]:
        setup.excluded.update(pairs)
        for style in setup.styles:
            for pair in pairs:
                style.coefficients.pop(pair, None)
        return
    style, words = _chosen(setup, words) if setup.mode in HYBRID else (setup.styles[0], words)
    values, cutoff = style.spec.coefficient(style, words, state.find_file)
    coefficient = Coefficient(values, cutoff, state.here)
    try:
        # built once here, so that an invalid value is reported with its line
        style.spec.build(style, coefficient, state.units)
    except ParameterError as error:
        raise ParameterError(f"pair style {style.name}, types {args[0]} {args[1]}: {error}") from None
    for pair in pairs:
        setup.excluded.discard(pair)
        if setup.mode == "hybrid":
            for other in setup.styles:
                other.coefficients.pop(pair, None)
        style.coefficients[pair] = coefficient


def _chosen(setup: PairSetup, words: list[str]) -> tuple[PairStyle, list[str]]:
    """The style named by a pair_coeff line of hybrid, and the words after the name."""
    names = [style.name for style in setup.styles]
    if not words or words[0] not in names:
        raise ParameterError(f"expected one of the styles {', '.join(dict.fromkeys(names))} or none, not '{' '.join(words[:1])}'")
    same = [style for style in setup.styles if style.name == words[0]]
    if len(same) == 1:
        return same[0], words[1:]
    if len(words) < 2:
        raise ParameterError(f"style {words[0]} is used {len(same)} times; give its number after the name")
    number = read.integer(words[1], f"which of the {len(same)} styles {words[0]} is meant", 1)
    if number > len(same):
        raise ParameterError(f"style {words[0]} is used {len(same)} times; there is no number {number}")
    return same[number - 1], words[2:]


@command("pair_modify", 0, None, remembered=True)
def pair_modify(state: DeckState, args: list[str]) -> None:
    """``pair_modify [pair style] mix|shift|tail|... value``."""
    if state.pair.mode == "none":
        raise ParameterError("pair_modify needs a preceding pair_style")
    styles = state.pair.styles
    words = list(args)
    if words[:1] == ["pair"]:
        if len(words) < 2:
            raise ParameterError("pair_modify pair needs the name of a style")
        style, rest = _chosen(state.pair, words[1:])
        styles, words = [style], rest
    sizes = {"mix": 1, "shift": 1, "tail": 1, "table": 1, "tabinner": 1, "compute": 1, "nofdotr": 0, "neigh/trim": 1}
    only = {"tail": (read.NO, "there are no long-range corrections here"), "compute": (read.YES, "use 'pair_coeff i j none'")}
    for keyword, values in read.options(words, sizes, "pair_modify", only=only):
        if keyword == "mix":
            for style in styles:
                style.mix = read.choice(values[0], "mix", MIXING)
        elif keyword == "shift":
            for style in styles:
                style.shift = read.switch(values[0], "shift")


#: Presets of special_bonds: factors of pair terms and of charges.
_SPECIAL_PRESETS = {
    "amber": ((0.0, 0.0, 0.5), (0.0, 0.0, 5.0 / 6.0)),
    "charmm": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "dreiding": ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)),
    "fene": ((0.0, 1.0, 1.0), (0.0, 1.0, 1.0)),
}


@command("special_bonds keyword values ...", 1, None, remembered=True)
def special_bonds(state: DeckState, args: list[str]) -> None:
    """``special_bonds lj/coul|lj|coul f2 f3 f4``, or a preset; omitted keywords are reset to their defaults."""
    factors = charges = (0.0, 0.0, 0.0)
    sizes = {"lj": 3, "coul": 3, "lj/coul": 3, "angle": 1, "dihedral": 1, **dict.fromkeys(_SPECIAL_PRESETS, 0)}
    for keyword, values in read.options(args, sizes, "special_bonds", only=dict.fromkeys(("angle", "dihedral"), (read.NO, ""))):
        if keyword in _SPECIAL_PRESETS:
            factors, charges = _SPECIAL_PRESETS[keyword]
        elif keyword in ("lj", "coul", "lj/coul"):
            given = tuple(read.number(word, f"factor 1-{k}") for k, word in enumerate(values, start=2))
            if not all(0 <= factor <= 1 for factor in given):
                raise ParameterError(f"the factors of special_bonds must be between 0 and 1, not {' '.join(f'{f:g}' for f in given)}")
            factors = given if keyword != "coul" else factors  # type: ignore[assignment]
            charges = given if keyword != "lj" else charges  # type: ignore[assignment]
    state.special, state.special_charges = factors, charges


#: Styles of kspace_style; all of them use OpenMM's PME.
KSPACE_STYLES = ("ewald", "pppm", "pppm/cg")
#: Keywords of kspace_modify about how LAMMPS computes the sum: number of values.
_MANNERS = dict.fromkeys("collective diff fftbench minorder mix/disp order overlap pressure/scalar cutoff/adjust".split(), 1)
_MANNERS["kmax/ewald"] = 3
#: Keywords of kspace_modify that would change the sum: their supported values, and why there are no others.
_KSPACE_ONLY = {
    "compute": (read.YES, "the real-space part alone is not physical"),
    "slab": ("", "charges are periodic in three dimensions"),
    "force": ("", "use the relative accuracy of kspace_style"),
}


@command("kspace_style style accuracy", 1, 2, remembered=True)
def kspace_style(state: DeckState, args: list[str]) -> None:
    """``kspace_style ewald|pppm accuracy``, or ``none``; OpenMM's PME computes the lattice sum to this accuracy."""
    if args[0] == "none":
        read.count(args, "kspace_style none", 1)
        state.kspace = None
        return
    read.choice(args[0], "the style of kspace_style", ("none", *KSPACE_STYLES))
    read.count(args, f"kspace_style {args[0]} accuracy", 2)
    accuracy = read.positive(args[1], "the accuracy of kspace_style")
    if not 1e-10 <= accuracy <= 0.1:
        raise ParameterError(f"the accuracy of kspace_style must be between 1e-10 and 0.1, not {args[1]}")
    state.kspace = replace(state.kspace or KspaceSetup(), accuracy=accuracy, where=state.here)


@command("kspace_modify", 0, None, remembered=True)
def kspace_modify(state: DeckState, args: list[str]) -> None:
    """``kspace_modify gewald|mesh ...``; options that would change the sum (``slab``, ``compute no``, ...) are errors."""
    if state.kspace is None:
        raise ParameterError("kspace_modify needs a preceding kspace_style")
    sizes = {"gewald": 1, "mesh": 3, "compute": 1, "slab": 1, "force": 1, **_MANNERS}
    for keyword, values in read.options(args, sizes, "kspace_modify", only=_KSPACE_ONLY):
        if keyword == "gewald":
            g = read.non_negative(values[0], "gewald")
            state.kspace = replace(state.kspace, gewald=g / state.units.length if g else None)
        elif keyword == "mesh":
            mesh = tuple(read.integer(word, "the mesh", 0) for word in values)
            if any(mesh) and min(mesh) < 6:
                raise ParameterError(f"kspace_modify mesh needs at least 6 points along each axis, not {' '.join(values)}")
            state.kspace = replace(state.kspace, mesh=mesh if any(mesh) else None)
        elif keyword in _MANNERS:
            state.note(f"kspace_modify {keyword} has no effect here and is ignored: OpenMM's PME computes the sum")


@command("dielectric value", 1, remembered=True)
def dielectric(state: DeckState, args: list[str]) -> None:
    """``dielectric value``: divides the Coulomb constant of the units."""
    state.dielectric = read.positive(args[0], "the dielectric constant")


def _bonded_style(state: DeckState, args: list[str], what: str) -> None:
    """``bond_style``, ``angle_style`` or ``dihedral_style``: none, zero, a registered style, or ``hybrid`` with several."""
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
                raise ParameterError(f"{what}_style hybrid gives {name} twice")
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
        raise ParameterError(f"{command} needs a preceding {what}_style, such as '{what}_style {others}'")
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
    command(f"{_what}_style style", 1, None, remembered=True)(partial(_bonded_style, what=_what))
    command(f"{_what}_coeff type values ...", 0, None, remembered=True)(partial(_coeff, what=_what))
