"""Commands that say what happens during a run: fix, unfix, timestep, reset_timestep."""

from collections.abc import Callable

from ...errors import ParameterError
from ..language import arguments as read
from ..output.averages import AveragingFix
from ..output.chunk_average import parse_ave_chunk
from ..output.correlation import parse_ave_correlate
from ..output.time_average import parse_ave_time
from ..state.deck_state import DeckState
from ..state.records import Fix
from .fix_styles import FIX_STYLES
from .setup import command

#: Fixes that average: from (state, id, group, words) to the average.
AVERAGES: dict[str, Callable[[DeckState, str, str, list[str]], AveragingFix]] = {
    "ave/time": parse_ave_time,
    "ave/chunk": parse_ave_chunk,
    "ave/correlate": parse_ave_correlate,
}


@command("fix ID group style ...", 3, None, box=True)
def fix(state: DeckState, args: list[str]) -> None:
    """``fix ID group style ...``; a fix of the same id and style is replaced."""
    name, group, style, *words = args
    read.identifier(name, "the id of a fix")
    state.group(group)
    read.style({**FIX_STYLES, **AVERAGES}, "fix", style)
    old = state.fixes.get(name)
    if old is not None and old.style != style:
        raise ParameterError(f"there is a fix {name} of style {old.style} already; unfix it first, or use another id")
    assert state.here is not None
    if style in AVERAGES:
        average = AVERAGES[style](state, name, group, words)
        parameters: dict = {"average": average, "reader": average}
    else:
        parameters = FIX_STYLES[style](state, group, words)
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
    options = dict(read.options(args[1:], {"time": 1}, "reset_timestep"))
    averages = [found.name for found in state.fixes_of(*AVERAGES)]
    if averages and step != state.step:
        raise ParameterError(f"reset_timestep is not possible while fix {', '.join(averages)} counts steps; unfix it before")
    state.reset_step(step)
    if "time" in options:
        state.time_origin = (read.number(options["time"][0], "the time") * state.units.time, step)
    for dump in state.dumps.values():
        dump.last_step = None
