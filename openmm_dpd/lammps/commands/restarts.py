"""Restart files: write_restart, read_restart, restart."""

from ...errors import ParameterError
from ...files import write_whole
from ..files.restart_file import load_restart, restart_bytes
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.records import RestartSettings
from .setup import REMEMBERED, command


@command("write_restart file", 1)
def write_restart(state: DeckState, args: list[str]) -> None:
    """``write_restart file``; a ``*`` becomes the step."""
    write_whole(state.output_file(args[0]), restart_bytes(state), "the restart file")


@command("read_restart file", 1, box=False)
def read_restart(state: DeckState, args: list[str]) -> None:
    """``read_restart file``: as if the commands that made the system stood here."""
    if "*" in args[0]:
        raise ParameterError(f"read_restart '{args[0]}': name one file")
    for name, words in load_restart(state, state.find_file(args[0])):
        REMEMBERED[name](state, words)


@command("restart N file [file]", 1, 3)
def restart(state: DeckState, args: list[str]) -> None:
    """``restart 0``, ``restart N root``, or ``restart N file file``, which are written in turn."""
    every = read.integer(args[0], "the interval of restart", 0)
    if every == 0:
        state.restarts = RestartSettings()
        return
    read.count(args, "restart N file [file]", 2, 3)
    for name in args[1:]:
        state.output_path(name)  # what is wrong with it is the mistake of this line
    single = len(args) == 2 and "*" not in args[1]
    state.restarts = RestartSettings(every, (f"{args[1]}.*",) if single else tuple(args[1:]))
