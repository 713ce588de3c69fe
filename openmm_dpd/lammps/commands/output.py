"""Commands about output and variables: thermo*, compute, dump*, write_data, variable, print, include."""

from __future__ import annotations

import re
from collections.abc import Callable

from ...errors import ParameterError
from ...files import append_block, write_whole
from ..language import arguments as read
from ..output.data_writer import data_file_lines
from ..output.dumps import BINARY, COLUMNS, STYLES as DUMP_STYLES, Dump
from ..output.thermo import STYLES as THERMO_STYLES, check_format, check_word
from ..state.deck_state import DeckState
from ..state.records import Compute, ThermoSettings
from ..values.computes import BUILT_IN, COMPUTES, check_bead_word, expanded
from ..values.resolver import Resolver
from .setup import by_name


def expand(state: DeckState, text: str) -> str:
    """Text with ``$`` substituted."""
    sample = state.last_sample if state.last_sample and state.last_sample.step == state.step else None
    return Resolver(state, sample).substituted(text)


# -- thermo -----------------------------------------------------------------------------------------------------------------
def thermo(state: DeckState, args: list[str]) -> None:
    """``thermo N``."""
    read.count(args, "thermo N", 1)
    state.thermo.every = read.integer(args[0], "the interval of thermo output", 0)


def thermo_style(state: DeckState, args: list[str]) -> None:
    """``thermo_style one|multi|yaml|custom words ...``; resets what thermo_modify has set, as in LAMMPS."""
    read.count(args, "thermo_style style ...", 1, None)
    style = read.choice(args[0], "the thermo style", [*THERMO_STYLES, "custom"])
    words = list(expanded(state, args[1:]) if style == "custom" else THERMO_STYLES[style])
    if style == "custom":
        read.count(words, "thermo_style custom word word ...", 1, None)
    for word in words:
        check_word(state, word)
    state.thermo = ThermoSettings(words, state.thermo.every, layout=style if style in ("multi", "yaml") else "one")


def thermo_modify(state: DeckState, args: list[str]) -> None:
    """``thermo_modify norm|temp|press|format|line|colname|flush|lost ... value``."""
    read.count(args, "thermo_modify keyword value ...", 2, None)
    index = 0
    while index < len(args):
        keyword, rest = args[index], args[index + 1 :]
        if keyword not in _THERMO_OPTIONS:
            raise ParameterError(f"thermo_modify has no option '{keyword}' here; supported are {', '.join(_THERMO_OPTIONS)}")
        size, handler = _THERMO_OPTIONS[keyword]
        if keyword in ("format", "colname") and rest[:1] in (["none"], ["default"]):
            size = 1
        if len(rest) < size:
            raise ParameterError(f"option '{keyword}' of thermo_modify needs {size} values")
        handler(state, rest[:size])
        index += 1 + size


def _norm(state: DeckState, words: list[str]) -> None:
    state.thermo.norm = read.switch(words[0], "norm")


def _temp(state: DeckState, words: list[str]) -> None:
    state.temperature_compute(words[0])
    state.thermo.temp = words[0]
    # the pressure that is printed takes it over, for good
    state.pressure_temps[state.thermo.press] = words[0]


def _press(state: DeckState, words: list[str]) -> None:
    if words[0] != "thermo_press" and (words[0] not in state.computes or state.computes[words[0]].style != "pressure"):
        raise ParameterError(f"'{words[0]}' is not the id of a compute of style pressure")
    state.thermo.press = words[0]


def _layout(state: DeckState, words: list[str]) -> None:
    state.thermo.layout = read.choice(words[0], "the line style", ("one", "multi", "yaml"))


def _format(state: DeckState, words: list[str]) -> None:
    if words == ["none"]:
        state.thermo.formats.clear()
        return
    target, form = words
    if target == "line":
        check_format(form, len(state.thermo.words))
    else:
        check_format(form, of=target if target in ("int", "float") else None)
    state.thermo.formats[_column(state, target, ("line", "int", "float"))] = form


def _column(state: DeckState, word: str, others: tuple[str, ...] = ()) -> str | int:
    if word in others or word in state.thermo.words:
        return word
    number = read.integer(word, "the column (a number or a thermo word)")
    columns = len(state.thermo.words)
    if not (1 <= number <= columns or -columns <= number <= -1):
        raise ParameterError(f"column {word} is out of range: there are {columns}")
    return number if number > 0 else columns + 1 + number


def _colname(state: DeckState, words: list[str]) -> None:
    if words == ["default"]:
        state.thermo.headers.clear()
    else:
        state.thermo.headers[_column(state, words[0])] = words[1]


def _nothing(state: DeckState, words: list[str]) -> None:
    """Accepted: output is always flushed, and no bead is ever lost in a periodic box."""


_THERMO_OPTIONS: dict[str, tuple[int, Callable[[DeckState, list[str]], None]]] = {
    "norm": (1, _norm),
    "temp": (1, _temp),
    "press": (1, _press),
    "line": (1, _layout),
    "format": (2, _format),
    "colname": (2, _colname),
    "flush": (1, _nothing),
    "lost": (1, _nothing),
    "lost/bond": (1, _nothing),
    "warn": (1, _nothing),
}


# -- computes ---------------------------------------------------------------------------------------------------------------
def compute(state: DeckState, args: list[str]) -> None:
    """``compute ID group style ...``."""
    read.count(args, "compute ID group style ...", 3, None)
    name, group, style, *words = args
    state.require_box("compute")
    state.group(group)
    if style not in COMPUTES:
        raise ParameterError(f"compute style '{style}' is not supported; supported are {', '.join(COMPUTES)}")
    if name in state.computes or name in BUILT_IN:
        raise ParameterError(f"there is a compute {name} already")
    words = list(expanded(state, words))
    state.computes[name] = Compute(name, group, style, tuple(words), COMPUTES[style].prepare(state, group, words))


def uncompute(state: DeckState, args: list[str]) -> None:
    """``uncompute ID``."""
    read.count(args, "uncompute ID", 1)
    read.known(state.computes, args[0], "compute")
    state.pressure_temps.pop(args[0], None)
    del state.computes[args[0]]


# -- dumps ------------------------------------------------------------------------------------------------------------------
def dump(state: DeckState, args: list[str]) -> None:
    """``dump ID group atom|custom|dcd|xtc|xyz N file [columns ...]``."""
    read.count(args, "dump ID group style N file ...", 5, None)
    name, group, style, interval, file, *words = args
    state.group(group)
    if style not in DUMP_STYLES:
        raise ParameterError(f"dump style '{style}' is not supported; supported are {', '.join(DUMP_STYLES)}")
    if name in state.dumps:
        raise ParameterError(f"there is a dump {name} already; undump it first")
    every = read.integer(interval, "the interval of the dump", 1)
    if style == "custom":
        read.count(words, "dump ID group custom N file column ...", 1, None)
        words = list(expanded(state, words))
        for word in words:
            check_bead_word(state, word, tuple(COLUMNS), "a column of dump custom")
    else:
        read.count(words, f"dump ID group {style} N file", 0)
    if file.endswith((".gz", ".bz2", ".zst", ".bin")):
        raise ParameterError(f"dump file '{file}': compressed and binary files are not supported")
    if style in BINARY and "*" in file:
        raise ParameterError(f"dump {style} '{file}': all frames go into one file, leave the * out")
    state.output_path(file)  # what is wrong with its name is the mistake of this line
    columns = {"atom": ("id", "type", "xs", "ys", "zs"), "custom": tuple(words)}.get(style, ())
    state.dumps[name] = Dump(name, group, style, every, file, columns)


def undump(state: DeckState, args: list[str]) -> None:
    """``undump ID``."""
    read.count(args, "undump ID", 1)
    read.known(state.dumps, args[0], "dump").close()
    del state.dumps[args[0]]


def dump_modify(state: DeckState, args: list[str]) -> None:
    """``dump_modify ID keyword value ...``."""
    read.count(args, "dump_modify ID keyword value ...", 2, None)
    found = read.known(state.dumps, args[0], "dump")
    once = ("every", "first", "append", "sort", "unwrap", "scale", "image", "flush", "pbc", "precision", "sfactor", "tfactor")
    sizes = dict.fromkeys(once, 1) | {"format": 2, "element": state.n_types}
    for keyword, values in read.options(args[1:], sizes, "dump_modify"):
        word = values[0]
        if keyword in _OF_STYLES and found.style not in _OF_STYLES[keyword]:
            raise ParameterError(f"dump_modify {keyword} is for dump style {' and '.join(_OF_STYLES[keyword])}")
        if keyword == "every":
            found.every = read.integer(word, "the interval of the dump", 1)
        elif keyword in ("first", "append", "unwrap"):
            setattr(found, keyword, read.switch(word, keyword))
        elif keyword in ("scale", "image"):
            _atom_columns(found, keyword, read.switch(word, keyword))
        elif keyword == "format":
            _dump_format(found, word, values[1])
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
            raise ParameterError("dump_modify sort: beads are written in the order of their ids; only 'sort id' is supported")
    if found.append and found.style in BINARY:
        raise ParameterError(f"dump_modify append is for dump styles in text: LAMMPS writes a new {found.style} file in spite of it")


#: What dump_modify precision may be.
_PRECISIONS = tuple(10**k for k in range(1, 7))

#: Keywords of dump_modify that some styles have.
_OF_STYLES = {
    "unwrap": BINARY,
    "scale": ("atom",),
    "image": ("atom",),
    "format": ("atom", "custom", "xyz"),
    "element": ("xyz",),
    "precision": ("xtc",),
    "sfactor": ("xtc",),
    "tfactor": ("xtc",),
}


def _dump_format(found: Dump, word: str, form: str) -> None:
    if found.style == "xyz":
        if word != "line" or not re.fullmatch(r"[^%]*%-?\d*s" + 3 * r"[^%]*%[-+ #0]*\d*(?:\.\d+)?[eEfFgG]" + "[^%]*", form):
            raise ParameterError(f"dump_modify format: style xyz has a line such as '%s %g %g %g', not '{word} {form}'")
    elif word not in ("int", "float", *found.columns):
        raise ParameterError(f"dump_modify format: expected int, float or a column, not '{word}'")
    else:
        check_format(form, of=word if word in ("int", "float") else None)
    found.formats[word] = form


def _atom_columns(found: Dump, keyword: str, value: bool) -> None:
    if keyword == "scale":
        found.columns = (*found.columns[:2], *(("xs", "ys", "zs") if value else ("x", "y", "z")), *found.columns[5:])
    else:
        found.columns = (*found.columns[:5], *(("ix", "iy", "iz") if value else ()))


def write_data(state: DeckState, args: list[str]) -> None:
    """``write_data file [pair ii|ij] [nocoeff] [nofix]``."""
    read.count(args, "write_data file ...", 1, None)
    pair: str | None = "ii"
    for keyword, values in read.options(args[1:], {"pair": 1, "nocoeff": 0, "nofix": 0, "nolabelmap": 0}, "write_data"):
        if keyword == "pair":
            pair = read.choice(values[0], "pair", ("ii", "ij"))
        elif keyword == "nocoeff":
            pair = None
    state.settle("write_data")
    write_whole(state.output_file(args[0]), "\n".join(data_file_lines(state, pair=pair)) + "\n", "the data file")


# -- variables and text -----------------------------------------------------------------------------------------------------
def variable(state: DeckState, args: list[str]) -> None:
    """``variable name equal|string|index|loop|delete value``."""
    assert state.here is not None
    state.variables.define(args, state.here, lambda text: expand(state, text))


def print_(state: DeckState, args: list[str]) -> None:
    """``print text [file|append name] [screen yes|no]``."""
    read.count(args, "print text ...", 1, None)
    text, show = expand(state, args[0]), True
    for keyword, values in read.options(args[1:], {"file": 1, "append": 1, "screen": 1, "universe": 1}, "print"):
        if keyword in ("file", "append"):
            append_block(state.output_file(values[0]), text + "\n", "the file of print", anew=keyword == "file")
        elif keyword == "screen":
            show = read.switch(values[0], "screen")
    if show:
        state.log(text)


COMMANDS = by_name(thermo, thermo_style, thermo_modify, compute, uncompute, dump, undump, dump_modify, write_data, variable, print_)
