"""What decks have for LAMMPS's accelerators or from its older versions, in the present words; clear and shell."""

import re
from collections.abc import Callable
from dataclasses import fields

from ...base.errors import ParameterError
from ..files.data_file import JOINED
from ..language import arguments as read
from ..state.deck_state import DeckState
from .setup import command

#: Commands with names of styles, and the places of these; those of the last row may be anywhere.
_STYLED: dict[str, tuple[int, ...]] = {
    **dict.fromkeys(("fix", "compute", "dump", "pair_coeff"), (3,)),
    **dict.fromkeys(((*(f"{what}_coeff" for what in JOINED), "pair_modify", "region")), (2,)),
    **dict.fromkeys(("kspace_style", "run_style", "min_style"), (1,)),
    **dict.fromkeys("pair_style bond_style angle_style dihedral_style improper_style atom_style".split(), tuple(range(1, 99))),
}
_SUFFIX = re.compile(r"(?<=\w)/(omp|opt|gpu|intel|kk(/host|/device)?)$")
#: Commands with types, for which labels may stand: of what they are types, and the places of these; the last rows also need a word.
_TYPED: dict[str, tuple[str, tuple[int, ...]]] = {
    **{"mass": ("atom", (1,)), "pair_coeff": ("atom", (1, 2)), "create_atoms": ("atom", (1,))},
    **{f"{what}_coeff": (what, (1,)) for what in JOINED},
    **{f"delete_bonds {what}": (what, (3,)) for what in ("atom", *JOINED)},
    **{"group type": ("atom", tuple(range(3, 99))), "set type": ("atom", (2,)), "neigh_modify exclude": ("atom", (3, 4))},
    "compute rdf": ("atom", tuple(range(5, 99))),
}
#: Words of ``set`` before a type.
_SETS = {"type": "atom", **dict.fromkeys(("type/fraction", "type/ratio", "type/subset"), "atom"), **{what: what for what in JOINED}}
#: Words of ``fix ave/spatial`` that are now those of ``compute chunk/atom``: number of values.
_OF_BINS = {"units": 1, "region": 1, "bound": 3, "discard": 1}


def _ave_spatial(state: DeckState, words: list[str]) -> list[list[str]]:
    """``fix ave/spatial`` as a compute chunk/atom and a fix ave/chunk."""
    name, group, _, *rest = words[1:]
    steps, rest = read.taken(rest, 3, "fix ave/spatial")
    bins, ours, others = list[str](), list[str](), list[str]()
    while rest[:1] and rest[0] in ("x", "y", "z"):
        place, rest = read.taken(rest, 3, "fix ave/spatial")
        bins += place
    while rest:
        size = 1 + _OF_BINS.get(rest[0], 0)
        (ours if rest[0] in _OF_BINS else others).extend(rest[:size])
        rest = rest[size:]
    chunks = f"{name}_spatial"
    state.computes.pop(chunks, None)
    return [
        ["compute", chunks, group, "chunk/atom", f"bin/{len(bins) // 3}d", *bins, *ours],
        ["fix", name, group, "ave/chunk", *steps, chunks, *others],
    ]


def _porosity(state: DeckState, words: list[str]) -> list[list[str]]:
    """``delete_atoms porosity group region fraction seed ...`` as ``random``."""
    (*place, fraction, seed), rest = read.taken(words[2:], 4, "delete_atoms porosity")
    return [["delete_atoms", "random", "fraction", fraction, "no", *place, seed, *rest]]


#: Older commands and styles: what they are called, and their lines in the present words.
_OLDER: dict[tuple[str, str], tuple[str, Callable[[DeckState, list[str]], list[list[str]]]]] = {
    ("communicate", ""): ("comm_modify mode", lambda state, words: [["comm_modify", "mode", *words[1:]]]),
    ("delete_atoms", "porosity"): ("delete_atoms random fraction", _porosity),
    ("fix", "ave/spatial"): ("compute chunk/atom and fix ave/chunk", _ave_spatial),
}


def translated(state: DeckState, words: list[str]) -> list[list[str]]:
    """The words of a line in the words of this package, as one or more lines."""
    places = [k for k in _STYLED.get(words[0], ()) if k < len(words)]
    if any(_SUFFIX.search(words[k]) for k in places):
        state.note("styles with the suffixes of LAMMPS's accelerators (/omp, /gpu, /intel, /kk, /opt) are the plain ones here")
        words = [_SUFFIX.sub("", word) if k in places else word for k, word in enumerate(words)]
    words = _numbered(state, words) if state.labels else words
    key = next((key for key in ((words[0], ""), *((words[0], word) for word in words[1:4:2])) if key in _OLDER), None)
    if key is None:
        return [words]
    present, lines = _OLDER[key]
    state.note(f"{' '.join(key).rstrip()} is read as {present}, its name in present LAMMPS")
    return lines(state, words)


def _numbered(state: DeckState, words: list[str]) -> list[str]:
    """The words of a line with numbers in the place of labels of types."""
    what, places = next((_TYPED[key] for key in (words[0], *(f"{words[0]} {word}" for word in words[1:4])) if key in _TYPED), ("", ()))
    found = [state.numbered(what, word) if k in places else word for k, word in enumerate(words)]
    for k in range(3, len(words) - 1) if words[0] == "set" else ():
        if words[k] in _SETS:
            found[k + 1] = state.numbered(_SETS[words[k]], words[k + 1])
    return found


@command("labelmap option args ...", 1, None)
def labelmap(state: DeckState, args: list[str]) -> None:
    """``labelmap atom|bond|angle|dihedral|improper type label ...``, or ``labelmap clear``."""
    if args == ["clear"]:
        state.labels = {}
        return
    what = read.choice(args[0], "the option of labelmap", ("atom", *JOINED, "clear"))
    most = state.n_types if what == "atom" else getattr(state, f"n_{what}_types")
    state.require_box("labelmap")
    read.count(args[1:], f"labelmap {what} type label ...", 2, None)
    for number, label in zip(args[1::2], [*args[2::2], ""], strict=False):
        (kind,) = read.numeric_range(number, most, f"the {what} type")
        state.add_label(what, kind, label)


#: What ``clear`` leaves as it is: the deck and its variables, what runs have counted, and where output goes.
_KEPT = set("path variables skips_jump notes runs systems here output folder carried_out first_run finished scripts log findings".split())
_KEPT |= {"generators", "inputs"}


@command("clear", 0)
def clear_(state: DeckState, args: list[str]) -> None:
    """``clear``: forgets the system and all settings; variables stay, and so do the files of earlier runs."""
    for dump in state.dumps.values():
        dump.close()
    fresh = DeckState(state.path)
    for item in fields(DeckState):
        if item.name not in _KEPT:
            setattr(state, item.name, getattr(fresh, item.name))
    state.systems += 1


@command("shell", 1, None)
def shell(state: DeckState, args: list[str]) -> None:
    """``shell cd|mkdir|echo ...``, in the output folder; other words of a shell are errors."""
    word, *names = [*args[0].split(), *args[1:]] if args[0].startswith(("mkdir ", "echo ")) else args  # Words in quotes, too.
    if word == "echo":
        state.log(" ".join(names))
    elif word == "mkdir":
        for name in names:
            state.output_file(f"{state.placed(name)}/.")
    elif word == "cd" and len(names) == 1:
        state.folder = state.placed(names[0])
    else:
        raise ParameterError(f"shell {' '.join(args)}: only cd, mkdir and echo; decks cannot run programs or move files here")
