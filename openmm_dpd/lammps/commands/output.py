"""Commands about output and variables: thermo*, compute*, dump*, write_dump, write_data, variable, print."""

import re
from collections.abc import Iterator
from dataclasses import replace

from ...base.errors import ParameterError
from ...base.files import append_block, write_whole
from ..files.data_file import ARRAYS, JOINED, DataFile, data_lines, styles_of
from ..language import arguments as read
from ..output.dumps import BINARY, COLUMNS, COMPARED, PICTURES, STYLES as DUMP_STYLES, TEXTS, Dump
from ..output.pictures import MODIFIED, parse_picture, picture_name
from ..output.thermo import STYLES as THERMO_STYLES, check_format, check_word
from ..state.deck_state import DeckState
from ..state.records import Compute, ThermoSettings
from ..styles.words import bonded_styles
from ..values.computes import BUILT_IN, COMPUTES, check_bead_word, expanded
from ..values.resolver import present
from .setup import command


def data_file_lines(state: DeckState, *, pair: str | None = "ii", labels: bool = True) -> Iterator[str]:
    """Lines of a data file with the present state.  ``pair`` selects the pair coefficients: ``ii`` for like types, ``ij`` for all pairs,
    None for no coefficients at all.  Those of hybrid styles and tables do not fit into a data file and are left out."""
    box, atoms = state.require_box("write_data"), state.atoms
    arrays = {column: getattr(atoms, name) for column, name in ARRAYS.items()}
    data = DataFile(
        n_types=state.n_types,
        box=box,
        columns={"id": atoms.ids, "type": atoms.types} | arrays | {f"c{k}": c for k, c in enumerate(atoms.concentrations.T, start=1)},
        positions=atoms.positions,
        images=atoms.images,
        velocities=atoms.velocities,
        masses={kind: mass / state.units.mass for kind, mass in state.masses.items()} if len(state.masses) == state.n_types else {},
        **{f"n_{what}_types": getattr(state, f"n_{what}_types") for what in JOINED},  # type: ignore[arg-type]
        # as in LAMMPS, terms that are turned off get their type back
        **{f"{what}s": abs(getattr(state, f"{what}s")) for what in JOINED},  # type: ignore[arg-type]
    )
    for what, found in state.labels.items() if labels else ():
        if len(found) == (state.n_types if what == "atom" else getattr(state, f"n_{what}_types")):
            data.labels[what] = found
    title = f"LAMMPS data file written by openmm-dpd, timestep = {state.step}, units = {state.units.name}"
    return data_lines(data, title, styles_of(state.atom_style), state.n_species, coefficients=_coefficients(state, pair))


def _coefficients(state: DeckState, pair: str | None) -> Iterator[str]:
    if pair is not None:
        yield from _pair_coefficients(state, pair)
        for what in JOINED:
            yield from _bonded_coefficients(state, what)


def _pair_coefficients(state: DeckState, which: str) -> Iterator[str]:
    if state.pair.mode != "single" or state.pair.styles[0].name in ("table", "zero"):
        if state.pair.mode != "none":
            state.note(f"write_data: coefficients of pair style {state.pair.mode} are not written")
        return
    (table,), missing = state.pair.resolve(state.n_types)
    style = state.pair.styles[0]
    wanted = {key: found for key, found in sorted(table.items()) if which == "ij" or key[0] == key[1]}
    if missing or state.pair.excluded:
        state.note("write_data: pair coefficients are not written, since some type pairs have none")
        return
    yield from ("", f"{'PairIJ' if which == 'ij' else 'Pair'} Coeffs # {style.name}", "")
    for (i, j), found in wanted.items():
        types = f"{i} {j}" if which == "ij" else f"{i}"
        yield f"{types} {' '.join(style.words(found))}"


def _bonded_coefficients(state: DeckState, what: str) -> Iterator[str]:
    setup, known = getattr(state, what), bonded_styles(what)
    if not setup.coefficients or setup.style == "zero":
        return
    if len(setup.coefficients) < getattr(state, f"n_{what}_types"):
        state.note(f"write_data: {what} coefficients are not written, since some types have none")
        return
    yield from ("", f"{what.capitalize()} Coeffs # {setup.style}", "")
    for kind, (style, values) in sorted(setup.coefficients.items()):
        words = known[style].words(values, state.units) if style != "none" else []
        yield " ".join([str(kind), *([style] if setup.style == "hybrid" else []), *words])


def expand(state: DeckState, text: str) -> str:
    """Text with ``$`` substituted."""
    return present(state).substituted(text)


# -- thermo -----------------------------------------------------------------------------------------------------------------
@command("thermo N", 1)
def thermo(state: DeckState, args: list[str]) -> None:
    state.thermo.every = read.integer(args[0], "the interval of thermo output", 0)


@command("thermo_style style ...", 1, None)
def thermo_style(state: DeckState, args: list[str]) -> None:
    """``thermo_style one|multi|yaml|custom words ...``; as in LAMMPS, resets the settings of thermo_modify."""
    style = read.choice(args[0], "the thermo style", [*THERMO_STYLES, "custom"])
    custom = style == "custom"
    words = list(expanded(state, args[1:]) if custom else THERMO_STYLES[style])
    if custom:
        read.count(words, "thermo_style custom word word ...", 1, None)
    for word in words:
        check_word(state, word)
    state.thermo = ThermoSettings(words, state.thermo.every, layout="one" if custom else style, custom=custom)


@command("thermo_modify keyword value ...", 2, None)
def thermo_modify(state: DeckState, args: list[str]) -> None:
    """``thermo_modify norm|temp|press|format|line|colname|flush|lost ... value``."""
    settings = state.thermo
    for keyword, values in read.options(args, THERMO_OPTIONS, "thermo_modify", alone={"format": "none", "colname": "default"}):
        word = values[0]
        if keyword == "norm":
            settings.norm = read.switch(word, "norm")
        elif keyword == "temp":
            state.temperature_compute(word)
            settings.temp = word
            # the printed pressure uses it, too
            state.pressure_temps[settings.press] = word
        elif keyword == "press":
            if word != "thermo_press" and (word not in state.computes or state.computes[word].style != "pressure"):
                raise ParameterError(f"'{word}' is not the id of a compute of style pressure")
            settings.press = word
        elif keyword == "lost":
            settings.lost = read.choice(word, "what happens to lost atoms", ("error", "warn", "ignore"))
        elif keyword == "line":
            settings.layout = read.choice(word, "the line style", ("one", "multi", "yaml"))
        elif keyword in ("format", "colname") and len(values) == 1:
            (settings.formats if keyword == "format" else settings.headers).clear()
        elif keyword == "format":
            check_format(values[1], len(settings.words) if word == "line" else None, of=word if word in ("int", "float") else None)
            settings.formats[_column(state, word, ("line", "int", "float"))] = values[1]
        elif keyword == "colname":
            settings.headers[_column(state, word)] = values[1]


def _column(state: DeckState, word: str, others: tuple[str, ...] = ()) -> str | int:
    columns = len(state.thermo.words)
    if word in others:
        return word
    if word in state.thermo.words:
        return columns - state.thermo.words[::-1].index(word)  # the last of duplicates, as in LAMMPS
    number = read.integer(word, "the column (a number or a thermo word)")
    if not (1 <= number <= columns or -columns <= number <= -1):
        raise ParameterError(f"column {word} is out of range: there are {columns}")
    return number if number > 0 else columns + 1 + number


#: Options of thermo_modify: number of values.  The last row has options without effect.
THERMO_OPTIONS = {
    **dict.fromkeys(("norm", "temp", "press", "line", "lost"), 1),
    **dict.fromkeys(("format", "colname"), 2),
    **dict.fromkeys(("flush", "lost/bond", "warn"), 1),
}


# -- computes ---------------------------------------------------------------------------------------------------------------
@command("compute ID group style ...", 3, None)
def compute(state: DeckState, args: list[str]) -> None:
    name, group, style, *words = args
    state.require_box("compute")
    state.group(group)
    spec = read.style(COMPUTES, "compute", style)
    if name in state.computes or name in BUILT_IN:
        raise ParameterError(f"there already is a compute {name}")
    words = list(expanded(state, words))
    state.computes[name] = Compute(name, group, style, tuple(words), spec.prepare(state, group, words))


@command("compute_modify ID keyword value ...", 3, None)
def compute_modify(state: DeckState, args: list[str]) -> None:
    """``compute_modify ID keyword value ...``: changes the degrees of freedom of a temperature compute."""
    found = state.temperature_compute(args[0])
    for keyword, values in read.options(args[1:], {"extra/dof": 1, "dynamic/dof": 1}, "compute_modify"):
        if keyword == "extra/dof":
            found = replace(found, settings=replace(found.settings, extra=read.number(values[0], keyword)))
        else:
            read.switch(values[0], keyword)  # degrees of freedom are always recounted
    if found.name == "thermo_temp":
        state.thermo_temp = found
    else:
        state.computes[found.name] = found


@command("uncompute ID", 1)
def uncompute(state: DeckState, args: list[str]) -> None:
    read.known(state.computes, args[0], "compute")
    state.pressure_temps.pop(args[0], None)
    del state.computes[args[0]]


# -- dumps ------------------------------------------------------------------------------------------------------------------
@command("dump ID group style N file ...", 5, None)
def dump(state: DeckState, args: list[str]) -> None:
    """``dump ID group style N file [columns, or colour diameter keyword value ...]``."""
    name, group, style, interval, file, *words = args
    if name in state.dumps:
        raise ParameterError(f"there already is a dump {name}; undump it first")
    state.dumps[name] = found = _new_dump(state, name, group, style, read.integer(interval, "the interval of the dump", 1), file, words)
    if style in BINARY:
        found.begin(state)


@command("write_dump group style file ...", 3, None)
def write_dump(state: DeckState, args: list[str]) -> None:
    """``write_dump group style file [columns ...] [modify keyword value ...]``: writes one frame."""
    at = args.index("modify") if "modify" in args else len(args)
    group, style, file, *words = args[:at]
    found = _new_dump(state, "write_dump", group, style, max(state.step, 1), file, words)
    _modify_dump(state, found, args[at + 1 :])
    moment = present(state)
    if found.pbc:
        # including beads that a command has moved outside
        moment.folded = moment.box.wrap(moment.positions)
    found.write(moment)
    found.close()


def _new_dump(state: DeckState, name: str, group: str, style: str, every: int, file: str, words: list[str]) -> Dump:
    state.group(group)
    read.style(dict.fromkeys(DUMP_STYLES), "dump", style)
    if style.endswith("/gz") and not file.endswith(".gz"):
        raise ParameterError(f"dump {style} '{file}': the name of the file must end with .gz")
    style, columns, picture = style.removesuffix("/gz"), list[str](), None
    allowed, local = (*COLUMNS, *(TEXTS if style == "custom" else ())), style == "local"
    if style in ("custom", "local"):
        read.count(words, f"dump ID group {style} N file column ...", 1, None)
        columns = list(expanded(state, words))
    elif style in PICTURES:
        read.count(words, f"dump ID group {style} N file colour diameter ...", 2, None)
        picture = parse_picture(state, words)
        columns = [word for word in picture.words["shown"] if word != "type"]
        file = picture_name(state, style, file)
    else:
        read.count(words, f"dump ID group {style} N file", 0)
    if "typelabel" in columns and len(state.labels.get("atom", ())) < state.n_types:
        raise ParameterError(f"dump {style} typelabel: not all atom types have a label; use labelmap")
    for word in columns:
        if word != "index" or not local:
            check_bead_word(state, word, allowed if not local else ("index",), f"a column of dump {style}", local)
    if file.endswith((".bz2", ".zst", ".bin", ".xz")) or (file.endswith(".gz") and style in BINARY):
        raise ParameterError(f"dump file '{file}': of compressed and binary files only text with .gz is supported")
    if "%" in file:
        raise ParameterError(f"dump file '{file}': one file per processor (%) is not supported")
    if style in BINARY and "*" in file:
        raise ParameterError(f"dump {style} '{file}': all frames go into one file; remove the *")
    state.placed(file)  # a wrong name is reported for this line
    columns = ["id", "type", "xs", "ys", "zs"] if style == "atom" else [] if style in PICTURES else columns
    return Dump(name, group, style, every, file, tuple(columns), picture=picture)


@command("undump ID", 1)
def undump(state: DeckState, args: list[str]) -> None:
    read.known(state.dumps, args[0], "dump").close()
    del state.dumps[args[0]]


@command("dump_modify ID keyword value ...", 2, None)
def dump_modify(state: DeckState, args: list[str]) -> None:
    _modify_dump(state, read.known(state.dumps, args[0], "dump"), args[1:])


def _modify_dump(state: DeckState, found: Dump, args: list[str]) -> None:
    sizes = {"format": 2, "element": state.n_types, "thresh": 3, "colname": 2} | dict.fromkeys(_ONE_VALUE, 1)
    sizes |= {"amap": 5} | (MODIFIED if found.picture is not None else {})
    alone = {"format": "none", "thresh": "none", "colname": "default"}
    only = {"types": ("numeric", "types are numbers"), "maxfiles": ("-1", "files are not removed")}
    only |= {"amap": ("", "the colours of values go from blue (least) to red"), "colname": ("default", "columns have their own names")}
    for keyword, values in read.options(args, sizes, "dump_modify", alone=alone, only=only):
        word = values[0]
        if keyword in _OF_STYLES and found.style not in _OF_STYLES[keyword]:
            raise ParameterError(f"dump_modify {keyword} is for dump style {' and '.join(_OF_STYLES[keyword])}")
        if found.picture is not None and keyword in MODIFIED:
            found.picture.modify(state, keyword, values)
        elif keyword == "every":
            found.every = read.integer(word, "the interval of the dump", 1)
        elif keyword in ("first", "append", "unwrap", "pbc", "time", "units", "header"):
            setattr(found, keyword, read.switch(word, keyword))
        elif keyword in ("pad", "delay"):
            setattr(found, keyword, read.integer(word, keyword, 0))
        elif keyword == "label":
            found.label = word
        elif keyword == "region":
            if word != "none":
                state.region(word)
            found.region = None if word == "none" else word
        elif keyword == "thresh":
            found.thresholds = () if word == "none" else (*found.thresholds, _threshold(state, values))
        elif keyword in ("scale", "image"):
            _atom_columns(found, keyword, read.switch(word, keyword))
        elif keyword == "format":
            _dump_format(found, word, values[-1])
        elif keyword == "element":
            found.elements = tuple(values)
        elif keyword in ("sfactor", "tfactor"):
            found.factors[keyword] = read.positive(word, keyword)
        elif keyword == "precision":
            found.precision = int(read.number(word, keyword))
            if read.number(word, keyword) not in _PRECISIONS:
                raise ParameterError(f"dump_modify precision must be one of {', '.join(map(str, _PRECISIONS))}, not {word}")
        elif keyword == "sort" and word == "off" and found.style in BINARY:
            raise ParameterError(f"dump_modify sort off: dump {found.style} is sorted by id")
        elif keyword == "sort" and word not in ("id", "off"):
            raise ParameterError("dump_modify sort: beads are always sorted by id; only 'sort id' is supported")
    if found.append and (found.style in BINARY or found.picture is not None):
        raise ParameterError(f"dump_modify append is for text styles only: LAMMPS overwrites {found.style} files regardless")


#: Keywords of dump_modify with one value; those of the last row have no effect.
_ONE_VALUE = (
    *("every", "first", "append", "sort", "unwrap", "scale", "image", "pbc", "precision", "sfactor", "tfactor"),
    *("region", "time", "units", "header", "pad", "delay", "label", "types", "maxfiles"),
    *("flush", "buffer", "nfile", "fileper", "compression_level"),
)


def _threshold(state: DeckState, values: list[str]) -> tuple[str, str, float]:
    check_bead_word(state, values[0], tuple(COLUMNS), "the value of dump_modify thresh")
    sign = read.choice(values[1], "the sign of dump_modify thresh", tuple(COMPARED))
    return values[0], sign, read.number(values[2], "the number of dump_modify thresh")


#: Allowed values of dump_modify precision.
_PRECISIONS = tuple(10**k for k in range(1, 7))

#: Keywords of dump_modify that are limited to some styles.
_OF_STYLES = {
    **{"unwrap": BINARY, "scale": ("atom",), "image": ("atom",), "format": ("atom", "custom", "xyz", "local")},
    **{"element": ("xyz", "custom", *PICTURES), "label": ("local",), "thresh": ("custom", *PICTURES), "region": ("custom", *PICTURES)},
    **dict.fromkeys(("time", "units", "header"), ("atom", "custom", "local")),
    **dict.fromkeys(("precision", "sfactor", "tfactor"), ("xtc",)),
}


def _dump_format(found: Dump, word: str, form: str) -> None:
    if word == "none":
        found.formats.clear()
        return
    if word.isdigit() and 0 < int(word) <= len(found.columns):
        word = found.columns[int(word) - 1]
    if found.style == "xyz":
        if word != "line" or not re.fullmatch(r"[^%]*%-?\d*s" + 3 * r"[^%]*%[-+ #0]*\d*(?:\.\d+)?[eEfFgG]" + "[^%]*", form):
            raise ParameterError(f"dump_modify format: style xyz expects a line such as '%s %g %g %g', not '{word} {form}'")
    elif word == "line":
        check_format(re.sub(r"%-?\d*s", "%d", form), len(found.columns))
    elif word not in ("int", "float", *found.columns):
        raise ParameterError(f"dump_modify format: expected line, int, float, a column or its number, not '{word}'")
    elif word not in TEXTS:
        check_format(form, of=word if word in ("int", "float") else None)
    found.formats[word] = form


def _atom_columns(found: Dump, keyword: str, value: bool) -> None:
    if keyword == "scale":
        found.columns = (*found.columns[:2], *(("xs", "ys", "zs") if value else ("x", "y", "z")), *found.columns[5:])
    else:
        found.columns = (*found.columns[:5], *(("ix", "iy", "iz") if value else ()))


@command("write_data file ...", 1, None)
def write_data(state: DeckState, args: list[str]) -> None:
    """``write_data file [pair ii|ij] [nocoeff] [nofix] [nolabelmap]``."""
    pair: str | None = "ii"
    labels = "nolabelmap" not in args[1:]
    for keyword, values in read.options(args[1:], {"pair": 1, "nocoeff": 0, "nofix": 0, "nolabelmap": 0}, "write_data"):
        if keyword == "pair":
            pair = read.choice(values[0], "pair", ("ii", "ij"))
        elif keyword == "nocoeff":
            pair = None
    state.settle("write_data")
    text = "\n".join(data_file_lines(state, pair=pair, labels=labels)) + "\n"
    write_whole(state.output_file(state.placed(args[0])), text, "the data file")


# -- variables and text -----------------------------------------------------------------------------------------------------
@command("variable", 0, None)
def variable(state: DeckState, args: list[str]) -> None:
    """``variable name equal|string|index|loop|delete|... value``."""
    assert state.here is not None
    args = [*args[:2], *map(str, map(state.find_file, args[2:]))] if args[1:2] == ["atomfile"] else args
    state.variables.define(args, state.here, lambda text: expand(state, text))


@command("print text ...", 1, None)
def print_(state: DeckState, args: list[str]) -> None:
    """``print text [file|append name] [screen yes|no]``."""
    text, show = expand(state, args[0]), True
    for keyword, values in read.options(args[1:], {"file": 1, "append": 1, "screen": 1, "universe": 1}, "print"):
        if keyword in ("file", "append"):
            append_block(
                state.output_file(state.placed(values[0]), as_it_is=True), text + "\n", "the file of print", anew=keyword == "file"
            )
        elif keyword == "screen":
            show = read.switch(values[0], "screen")
    if show:
        state.log(text)
