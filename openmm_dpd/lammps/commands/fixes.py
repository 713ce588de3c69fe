"""Commands about fixes, time steps and restart files: fix, unfix, timestep, reset_timestep, write_restart, read_restart, restart."""

import re
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...base.errors import ParameterError
from ...base.files import write_whole
from ..files.data_file import JOINED
from ..files.lammps_restart import converted
from ..files.restart_file import LAMMPS_MAGIC, load_restart, restart_bytes
from ..language import arguments as read
from ..output.averages import AveragingFix, PrintFix
from ..output.averaging_fixes import ChunkAverage, Correlation, TimeAverage
from ..output.collecting_fixes import BeadStore, Histogram, Series
from ..state.deck_state import DeckState
from ..state.records import COUPLED, FIX_VALUES, Fix, RestartSettings, Valued
from .fix_styles import FIX_STYLES
from .setup import COMMANDS, REMEMBERED, command

#: Fixes that read values at the end of steps: constructors with the arguments (state, id, group, words).
READERS: dict[str, Callable[[DeckState, str, str, list[str]], Valued | PrintFix]] = {
    **{"ave/time": TimeAverage, "ave/chunk": ChunkAverage, "ave/correlate": Correlation, "print": PrintFix},
    **{"ave/histo": Histogram, "vector": Series, "store/state": BeadStore},
}
#: All fix styles by name.
STYLES: dict[str, Callable] = {**FIX_STYLES, **READERS}


@command("fix ID group style ...", 3, None, box=True)
def fix(state: DeckState, args: list[str]) -> None:
    """``fix ID group style ...``; replaces a fix with the same id and style."""
    name, group, style, *words = args
    read.identifier(name, "the id of a fix")
    state.group(group)
    read.style(STYLES, "fix", style)
    old = state.fixes.get(name)
    if old is not None and old.style != style:
        raise ParameterError(f"there already is a fix {name} of style {old.style}; unfix it first, or use another id")
    assert state.here is not None
    reader = READERS.get(style)
    if group in state.dynamic and reader is None:
        raise ParameterError(f"fix {style} on the dynamic group {group} is not supported: the beads of a fix cannot change")
    parameters = FIX_STYLES[style](state, group, words) if reader is None else {"reader": reader(state, name, group, words)}
    found = state.fixes[name] = Fix(name, group, style, parameters, state.here)
    before, runs, kept = state.restored.get(name, ("", 0, {}))
    if (before, runs) == (style, state.runs) and len(kept["numbers"]) == len(found.parameters["numbers"]):
        found.parameters.update(kept)


@command("fix_modify ID energy yes|no | temp ID | virial no", 3, None)
def fix_modify(state: DeckState, args: list[str]) -> None:
    """``fix_modify ID energy yes|no | temp ID | virial no``."""
    found = read.known(state.fixes, args[0], "fix")
    only = {"virial": (read.NO, "forces of fixes are not part of the pressure here"), "respa": ("", "there is one level of time steps")}
    for keyword, values in read.options(args[1:], dict.fromkeys(("energy", "temp", *only), 1), "fix_modify", only=only):
        if keyword == "energy":
            if not FIX_VALUES.get(found.style, (False,))[0] or found.style in (*COUPLED, "nve/limit"):
                raise ParameterError(f"fix_modify {found.name} energy: fix {found.style} has no energy here")
            found.parameters["counted"] = read.switch(values[0], "energy")
        elif keyword == "temp":
            if found.style not in COUPLED or found.style == "langevin":
                raise ParameterError(f"fix_modify {found.name} temp: fix {found.style} has no temperature here")
            state.temperature_compute(values[0])
            found.parameters["temp"] = values[0]


@command("unfix ID", 1)
def unfix(state: DeckState, args: list[str]) -> None:
    read.known(state.fixes, args[0], "fix")
    del state.fixes[args[0]]


@command("timestep dt", 1)
def timestep(state: DeckState, args: list[str]) -> None:
    _check_clock(state, "timestep")
    state.set_timestep(read.positive(args[0], "the time step") * state.units.time)


def _check_clock(state: DeckState, command: str) -> None:
    for found in state.fixes_of("move"):
        raise ParameterError(f"{command} is not possible while fix {found.name} (move) moves beads by the clock; unfix it first")


@command("reset_timestep N [time T]", 1, 3)
def reset_timestep(state: DeckState, args: list[str]) -> None:
    step = read.integer(args[0], "the step", 0)
    time = read.single(args[1:], "reset_timestep", time="")["time"]
    averages = [found.name for found in state.fixes.values() if isinstance(found.parameters.get("reader"), AveragingFix)]
    if averages and step != state.step:
        raise ParameterError(f"reset_timestep is not possible while fix {', '.join(averages)} counts steps; unfix it first")
    _check_clock(state, "reset_timestep")
    if step < state.step:
        state.time_origin = (0.0, step)  # going back resets the clock to 0, going forward advances it
    state.step = step
    if time:
        state.time_origin = (read.number(time, "the time") * state.units.time, step)
    for dump in state.dumps.values():
        dump.last_step = None


@command("write_restart file", 1)
def write_restart(state: DeckState, args: list[str]) -> None:
    """``write_restart file``; ``*`` stands for the step."""
    write_whole(state.output_file(state.placed(args[0])), restart_bytes(state), "the restart file")


def _last(state: DeckState, name: str) -> str:
    """The name with ``*`` replaced by the largest number for which there is a file where input files are searched."""
    path = Path(state.folder, name)
    of_number = re.compile(r"(\d+)".join(map(re.escape, path.name.split("*", 1))))
    files = [file.name for folder in (state.path.parent, Path(), state.output) for file in (folder / path.parent).glob("*")]
    numbers = [found[1] for file in files if (found := of_number.fullmatch(file))]
    if not numbers:
        raise ParameterError(f"there is no file '{name}' with a number in the place of *")
    return name.replace("*", max(numbers, key=int), 1)


@command("read_restart file", 1, box=False)
def read_restart(state: DeckState, args: list[str]) -> None:
    """``read_restart file``: restores the system as if the commands that made it were part of this deck.  ``*`` stands for the largest
    number (the last step) that makes a name of a file."""
    path = state.find_file(_last(state, args[0]) if "*" in args[0] else args[0])
    if path.read_bytes().startswith(LAMMPS_MAGIC):
        _read_lammps(state, path)
        return
    for name, words in load_restart(state, path):
        REMEMBERED[name](state, words)


def _read_lammps(state: DeckState, path: Path) -> None:
    """Take the system from a restart file of LAMMPS; its pair style, of which only LAMMPS can read the arguments, is left to the deck."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        found = converted(path, data)
        x, y, z = found["periodicity"]
        parts = ((what, data.read_text().partition(f"{what.capitalize()} Coeffs # ")[2]) for what in JOINED)
        styles = {what: text.split(None, 1)[0] for what, text in parts if text}
        special = [f"{factor!r}" for name in ("special_lj", "special_coul") for factor in found[name][1:]]
        commands: list[tuple[str, list[str]]] = [
            ("units", [found["units"]]),
            ("dimension", [str(found["dimension"])]),
            ("atom_style", [found["atom_style"]]),
            ("boundary", ["p" if flag else "f" for flag in (x, y, z)]),
            ("special_bonds", ["lj", *special[:3], "coul", *special[3:]]),
            *((f"{what}_style", [style]) for what, style in styles.items()),
        ]
        for name, words in commands:
            COMMANDS[name](state, words)
        COMMANDS["read_data"](state, [str(data)])
        state.inputs.pop(str(data.resolve()))
    for name, members in found["groups"].items():
        state.groups[name] = np.isin(state.atoms.ids, members)
    state.step, state.timestep, state.reordered = found["ntimestep"], found["dt"] * state.units.time, state.sorts
    state.time_origin = (found["atime"] * state.units.time, found["atimestep"])
    state.note(f"{path.name}: read by LAMMPS; give again what it does not tell: the pair style, and all hybrid styles")


@command("restart N file [file]", 1, 3)
def restart(state: DeckState, args: list[str]) -> None:
    """``restart 0``, ``restart N root``, or ``restart N file file`` (written alternately); the last two forms can be active together."""
    every = read.integer(args[0], "the interval of restart", 0)
    if every == 0:
        state.restarts = {}
        return
    read.count(args, "restart N file [file]", 2, 3)
    names = tuple(map(state.placed, args[1:]))
    names = (f"{names[0]}.*",) if len(names) == 1 and "*" not in names[0] else names
    state.restarts = {**state.restarts, len(names): RestartSettings(every, names)}
