"""The driver: reads a deck line by line and looks each command up in a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ..errors import DeckError, OutputError, ParameterError
from . import arguments as read
from .commands import beads, bonded, box, fixes, kspace, output, pairs, setup, velocity
from .commands.setup import Handler
from .integration import integration
from .lexer import Line, logical_lines, read_text, split_words
from .request import RunRequest
from .state import DeckState
from .variables import Variables

#: Files that may be read one inside the other.
MOST_INCLUDES = 100


def include(state: DeckState, args: list[str]) -> None:
    """``include file``."""
    read.count(args, "include file", 1)
    path = state.find_file(args[0])
    if len(state.reading) > MOST_INCLUDES:
        raise ParameterError(f"include '{args[0]}': files include each other {MOST_INCLUDES} deep already, and no deeper is supported")
    if path.resolve() in state.reading:
        raise ParameterError(f"include '{args[0]}': this file is being read already, it would include itself without end")
    outer = state.here
    state.reading.append(path.resolve())
    execute_file(state, path)
    state.reading.pop()
    state.here = outer


def quit_(state: DeckState, args: list[str]) -> None:
    """``quit``: the rest of the deck is not read."""
    state.finished = True


#: Every command of a deck.  Another command is another entry of one of the tables in ``commands/``.
COMMANDS: dict[str, Handler] = {
    **setup.COMMANDS,
    **box.COMMANDS,
    **beads.COMMANDS,
    **velocity.COMMANDS,
    **pairs.COMMANDS,
    **bonded.COMMANDS,
    **kspace.COMMANDS,
    **fixes.COMMANDS,
    **output.COMMANDS,
    "include": include,
    "quit": quit_,
}


def execute(state: DeckState, line: Line) -> None:
    """Carry out one logical line.

    Raises
    ------
    DeckError
        With the line's file and number, for unknown commands and whatever the command does not accept.
    """
    state.here = line
    try:
        words = split_words(output.expand(state, line.text))
        if not words:
            return
        if words[0] not in COMMANDS:
            raise ParameterError(f"unknown or unsupported command '{words[0]}'")
        COMMANDS[words[0]](state, words[1:])
    except DeckError as error:
        if error.file is None:
            raise DeckError(error.message, line.file, line.number) from None
        raise
    except (ParameterError, OutputError, OSError) as error:
        raise DeckError(str(error), line.file, line.number) from None


def execute_file(state: DeckState, path: Path) -> None:
    """Carry out every line of a file."""
    for line in logical_lines(read_text(path), str(path)):
        execute(state, line)
        if state.finished:
            return


def read_deck(
    path: str | Path,
    *,
    run_callback: Callable[[RunRequest], None] | None = None,
    variables: Mapping[str, str] | None = None,
    stop_before_first_run: bool = False,
    output: str | Path = ".",
    log: Callable[[str], None] = lambda text: None,
) -> DeckState:
    """Read a LAMMPS deck and carry it out, leaving the simulation itself to a callback.

    Parameters
    ----------
    path : str or Path
        The deck.  Files it names are looked for beside it first, then in the working directory.
    run_callback : callable, optional
        Called with a :class:`RunRequest` for every ``run`` command.
    variables : mapping of str to str, optional
        Index-style variables set from outside (LAMMPS: ``-var name value``); they win over the deck's.
    stop_before_first_run : bool, default False
        Stop at the first ``run``; ``state.first_run`` holds its request.  A deck without ``run`` is fine then (its request has 0 steps).
    output : str or Path
        Folder for what the deck writes.
    log : callable, optional
        Gets the text of ``print`` commands.

    Returns
    -------
    DeckState
        The state at the end.

    Raises
    ------
    DeckError
        With file and line, for anything unknown, unsupported, missing or out of bounds.
    """
    path = Path(path)
    state = DeckState(
        path=path,
        variables=Variables(dict(variables or {})),
        run_callback=run_callback,
        stop_before_first_run=stop_before_first_run,
        output=Path(output),
        log=log,
        reading=[path.resolve()],
    )
    try:
        execute_file(state, path)
    finally:
        for dump in state.dumps.values():
            dump.close()
    if state.first_run is None:
        if not stop_before_first_run:
            raise DeckError("the deck has no run command: there is nothing to do", str(path))
        if state.box is None:
            raise DeckError("the deck makes no simulation box: there is nothing to look at", str(path))
        state.first_run = RunRequest.of(state, 0, integration(state))
    return state
