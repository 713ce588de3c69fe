"""Commands about fixes, time steps and restart files: fix, unfix, timestep, reset_timestep, write_restart, read_restart, restart."""

from collections.abc import Callable

from ...base.errors import ParameterError
from ...base.files import write_whole
from ..files.restart_file import load_restart, restart_bytes
from ..language import arguments as read
from ..output.averages import AveragingFix, PrintFix
from ..output.averaging_fixes import ChunkAverage, Correlation, TimeAverage
from ..state.deck_state import DeckState
from ..state.records import Fix, RestartSettings
from .fix_styles import FIX_STYLES
from .setup import REMEMBERED, command

#: Fixes that read values at the end of steps: constructors with the arguments (state, id, group, words).
READERS: dict[str, Callable[[DeckState, str, str, list[str]], AveragingFix | PrintFix]] = {
    **{"ave/time": TimeAverage, "ave/chunk": ChunkAverage, "ave/correlate": Correlation, "print": PrintFix}
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
    state.fixes[name] = Fix(name, group, style, parameters, state.here)


@command("unfix ID", 1)
def unfix(state: DeckState, args: list[str]) -> None:
    read.known(state.fixes, args[0], "fix")
    del state.fixes[args[0]]


@command("timestep dt", 1)
def timestep(state: DeckState, args: list[str]) -> None:
    state.set_timestep(read.positive(args[0], "the time step") * state.units.time)


@command("reset_timestep N [time T]", 1, 3)
def reset_timestep(state: DeckState, args: list[str]) -> None:
    step = read.integer(args[0], "the step", 0)
    time = read.single(args[1:], "reset_timestep", time="")["time"]
    averages = [found.name for found in state.fixes.values() if isinstance(found.parameters.get("reader"), AveragingFix)]
    if averages and step != state.step:
        raise ParameterError(f"reset_timestep is not possible while fix {', '.join(averages)} counts steps; unfix it first")
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


@command("read_restart file", 1, box=False)
def read_restart(state: DeckState, args: list[str]) -> None:
    """``read_restart file``: restores the system as if the commands that made it were part of this deck."""
    if "*" in args[0]:
        raise ParameterError(f"read_restart '{args[0]}': give the name of one file")
    for name, words in load_restart(state, state.find_file(args[0])):
        REMEMBERED[name](state, words)


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
