"""The driver: reads a deck line by line and looks up each command in a table.

:func:`deck_runs` yields a request for each run and minimisation, and continues with the next line after it has been carried out; commands
that can start a run are generators.
"""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...base.errors import DeckError, OutputError, ParameterError, read_by
from ...base.files import digest
from ..commands import beads, box, fixes, interactions, joining, moving, output, reading, reshaping  # noqa: F401  each enters its commands
from ..commands.setup import COMMANDS, command
from ..commands.translated import translated
from ..language import arguments as read
from ..language.arguments import INSTEAD
from ..language.expressions import condition_holds
from ..language.lexer import Line, Script, located, split_words, strip_comment
from ..language.variables import Variables
from ..scene.flow import held_beads
from ..scene.integration import Integration, integration
from ..state.deck_state import DeckState
from ..state.records import DAMPED, StoppingRule
from ..styles.srp import without_beads_of_bonds
from .request import RunRequest

_LOGGER = logging.getLogger("openmm_dpd")


#: Maximum depth of nested include files.
MOST_INCLUDES = 100


@command("include file", 1)
def include(deck: DeckState, args: list[str]) -> Iterator[RunRequest]:
    path = deck.find_file(args[0])
    if len(deck.scripts) > MOST_INCLUDES:
        raise ParameterError(f"include '{args[0]}': include files are nested more than {MOST_INCLUDES} deep")
    if path.resolve() in [script.path.resolve() for script in deck.scripts]:
        raise ParameterError(f"include '{args[0]}': the file includes itself")
    outer = deck.here
    yield from execute_file(deck, path)
    deck.here = outer


@command("quit [status]", 0, 1)
def quit_(deck: DeckState, args: list[str]) -> None:
    """``quit [0]``: ignore the rest of the deck."""
    if deck.findings is not None and deck.runs and deck.findings.conditional:
        return  # a condition on values that no run has computed
    if args and read.integer(args[0], "the exit status", 0):
        raise ParameterError(f"quit {args[0]}: the deck ends here with a nonzero exit status")
    deck.finished = True


@command("label name", 1)
def label(deck: DeckState, args: list[str]) -> None:
    """``label name``: a target of jump."""


@command("jump file|SELF [label]", 1, 2)
def jump(deck: DeckState, args: list[str]) -> None:
    """``jump file|SELF [label]``: continue there instead of the present file; skipped directly after a ``next`` that has exhausted its
    variables."""
    if deck.skips_jump or not (deck.findings is None or deck.findings.follows()):
        deck.skips_jump = False
        return
    script = deck.scripts[-1] if args[0] == "SELF" else Script(deck.find_file(args[0]))
    script.seek(args[1] if len(args) > 1 else None)
    deck.scripts[-1] = script


@command("next variable ...", 1, None)
def next_(deck: DeckState, args: list[str]) -> None:
    """``next name name ...``: advance these variables; if one has no further value, the next jump is skipped."""
    if not deck.variables.advance(args):
        deck.skips_jump = True


@command("if", 0, None)
def if_(deck: DeckState, args: list[str]) -> Iterator[RunRequest]:
    """``if condition then command ... [elif condition command ...] [else command ...]``."""
    usage = "if condition then command ... elif condition command ... else command ..."
    read.count(args, usage, 3, None)
    if args[1] != "then":
        raise ParameterError(f"expected '{usage}', but found '{args[1]}' instead of then")
    for condition, commands in _branches(args):
        # a quoted condition still contains its variables
        if condition is None or condition_holds(output.expand(deck, condition)):
            for text in commands:
                yield from execute_text(deck, text)
            return


def _branches(args: list[str]) -> list[tuple[str | None, list[str]]]:
    """Branches of an if command: the condition (None for else), and the commands."""
    rest, found = ["elif", args[0], *args[2:]], list[tuple[str | None, list[str]]]()
    while rest:
        word, first = rest[0], 1 if rest[0] == "else" else 2
        last = next((k for k, other in enumerate(rest) if k >= first and other in ("elif", "else")), len(rest))
        if last <= first:
            raise ParameterError(f"if: expected {'a condition and ' * (first == 2)}commands after '{word}'")
        if first == 1 and last < len(rest):
            raise ParameterError(f"if: '{rest[last]}' after else, which must come last")
        found.append((rest[1] if first == 2 else None, rest[first:last]))
        rest = rest[last:]
    return found


@command("run N ...", 0, None)
def run_command(deck: DeckState, args: list[str]) -> Iterator[RunRequest]:
    """``run N [upto] [start N] [stop N] [pre yes|no] [post yes|no] [every M command ... | every M NULL]``."""
    at = args.index("every") if "every" in args else len(args)
    commands = args[at + 2 :]
    if at < len(args) and not commands:
        raise ParameterError("expected 'run N ... every M \"command\" ...' or 'every M NULL'")
    steps, begin, end = _extent(deck, args[:at])
    if at == len(args):
        yield from _run(deck, steps, begin, end)
        return
    every = read.integer(args[at + 1], "every", 1)
    if deck.findings is not None:
        every = max(every, steps // 10)
    last = deck.step + steps
    while True:
        # as in LAMMPS, each piece is a run with its own ramps, unless start and stop are given
        yield from _run(deck, min(every, last - deck.step), begin, end)
        where = deck.here
        for text in commands if commands != ["NULL"] else []:
            yield from execute_text(deck, text)
            deck.here = where
        if deck.finished or deck.step >= last:
            return


def _extent(deck: DeckState, args: list[str]) -> tuple[int, int | None, int | None]:
    """Number of steps of a run, and the values of its options start and stop."""
    read.count(args, "run N ...", 1, None)
    deck.require_box("run")
    if deck.pair.where is None:
        raise ParameterError("run needs a preceding pair_style; use 'pair_style none' if the beads do not interact")
    steps = read.integer(args[0], "the number of steps", 0)
    begin = end = None
    for keyword, values in read.options(args[1:], {"upto": 0, "start": 1, "stop": 1, "pre": 1, "post": 1}, "run"):
        if keyword == "upto":
            steps -= deck.step
            if steps < 0:
                raise ParameterError(f"run {args[0]} upto: the present step, {deck.step}, is later")
        elif keyword == "start":
            begin = read.integer(values[0], "start", 0)
        elif keyword == "stop":
            end = read.integer(values[0], "stop", 0)
        elif not read.switch(values[0], keyword) and keyword == "pre":
            deck.note("run pre no: forces are recomputed with new noise, as with pre yes; LAMMPS continues with the previous ones")
    if begin is not None and begin > deck.step:
        raise ParameterError(f"run: start {begin} is after the first step of the run, {deck.step}")
    if end is not None and end < deck.step + steps:
        raise ParameterError(f"run: stop {end} is before the last step of the run, {deck.step + steps}")
    return steps, begin, end


def _run(deck: DeckState, steps: int, begin: int | None, end: int | None) -> Iterator[RunRequest]:
    """Yield one run, and count it after it has been carried out."""
    deck.settle("run")
    without_beads_of_bonds(deck)
    request = RunRequest.of(deck, steps, integration(deck), begin, end)
    if deck.first_run is None:
        deck.first_run = request
    yield request
    if deck.step == request.first_step:
        deck.step = request.last_step  # nobody called finish
    deck.runs += 1


@command("minimize etol ftol maxiter maxeval", 4, box=True)
def minimize(deck: DeckState, args: list[str]) -> Iterator[RunRequest]:
    """``minimize etol ftol maxiter maxeval``: moves all beads, even without an integrating fix, except those held by fix setforce."""
    if deck.pair.where is None:
        raise ParameterError("minimize needs a preceding pair_style")
    etol, ftol = (read.non_negative(word, name) for word, name in zip(args[:2], ("etol", "ftol"), strict=True))
    most, evaluations = (read.integer(word, name, 0) for word, name in zip(args[2:], ("maxiter", "maxeval"), strict=True))
    if deck.min_style == "hftn" and deck.force_norm == "max":
        raise ParameterError("min_style hftn does not support 'min_modify norm max', as in LAMMPS; use norm two or inf")
    rule = StoppingRule(etol, ftol, most, evaluations, deck.force_norm)
    if not deck.carried_out and deck.findings is None:
        note = "minimize is not carried out here: the beads stay where they are"
        deck.note(note)
        _LOGGER.warning("%s:%d: %s", *((deck.here.file, deck.here.number) if deck.here else (deck.path, 0)), note)
        return
    deck.settle("minimize")
    without_beads_of_bonds(deck)
    if deck.min_style in DAMPED:
        deck.atoms.velocities = np.zeros_like(deck.atoms.velocities)
    yield replace(RunRequest.of(deck, 0, Integration("mvv", 0.5, ~held_beads(deck))), minimization=rule)


def execute_text(deck: DeckState, text: str) -> Iterator[RunRequest]:
    """Carry out a command that is an argument of another one; errors refer to the line of that one."""
    assert deck.here is not None
    if not deck.finished:
        yield from execute(deck, replace(deck.here, text=strip_comment(text)))


@contextmanager
def at_line(line: Line | None) -> Iterator[None]:
    """Turn errors in this block into DeckErrors with the file and number of a line, unless they have one."""
    try:
        yield
    except (DeckError, ParameterError, OutputError, OSError) as error:
        if isinstance(error, DeckError) and error.file is not None:
            raise
        raise located(line, str(error)) from None


def execute(deck: DeckState, line: Line) -> Iterator[RunRequest]:
    """Carry out one logical line.  DeckError, with its file and number, if the command is unknown or its arguments are invalid; where
    all errors of a deck are collected, the line is tried again without the refused word, if that makes sense."""
    words: list[str] | None = None
    while words is None or words:
        deck.here = line
        try:
            with at_line(line):
                words = words or split_words(output.expand(deck, line.text))
                yield from carried_out(deck, words)
                return
        except DeckError as error:
            if deck.findings is None:
                raise
            words = deck.findings.refuse(line, words or [], error)


def carried_out(deck: DeckState, words: list[str]) -> Iterator[RunRequest]:
    """Carry out the command that these words make."""
    for name, *args in translated(deck, words) if words else ():
        if name in INSTEAD:
            raise ParameterError(f"{name}: {INSTEAD[name]}")
        if name not in COMMANDS:
            raise ParameterError(f"unknown or unsupported command '{name}'{read.near(name, COMMANDS)}")
        if deck.findings is not None and deck.findings.passes_over(name):
            continue
        yield from COMMANDS[name](deck, args) or ()


def execute_file(deck: DeckState, path: Path) -> Iterator[RunRequest]:
    """Carry out every line of a file, and of files that it jumps to."""
    deck.scripts.append(Script(path))
    while not deck.finished and (line := deck.scripts[-1].take()) is not None:
        if deck.findings is not None:
            deck.findings.visit(line)
        yield from execute(deck, line)
    deck.scripts.pop()


@contextmanager
def open_deck(
    path: Path, variables: Mapping[str, str] | None, output: Path, log: Callable[[str], None], *, carried_out: bool
) -> Iterator[DeckState]:
    """Open a deck before its first line is read, and close its files at the end; see :func:`read_deck`.  With ``carried_out`` its runs are
    carried out and its output files written."""
    deck = DeckState(path, variables=Variables(dict(variables or {})), output=output, log=log, carried_out=carried_out)
    deck.inputs[str(path.resolve())] = digest(path)
    try:
        with read_by(deck):
            yield deck
    finally:
        for dump in deck.dumps.values():
            dump.close()


def deck_runs(deck: DeckState) -> Iterator[RunRequest]:
    """Carry out a deck, and yield a request for each run and minimisation, which the caller carries out before it asks for the next.
    DeckError if the deck has no run."""
    yield from execute_file(deck, deck.path)
    if deck.first_run is None:
        raise DeckError("the deck has no run command; add one at its end, such as 'run 0' after minimize", str(deck.path))


def read_deck(
    path: str | Path,
    *,
    run_callback: Callable[[RunRequest], None] | None = None,
    variables: Mapping[str, str] | None = None,
    stop_before_first_run: bool = False,
    output: str | Path = ".",
    log: Callable[[str], None] = lambda text: None,
) -> DeckState:
    """Read a LAMMPS deck and carry out everything except the simulation itself, which is left to ``run_callback``.

    Parameters
    ----------
    path : str or Path
        The deck.  Files it names are looked up in its folder first, then in the working directory.
    run_callback : callable, optional
        Called with a :class:`RunRequest` for every ``run`` and ``minimize``.
    variables : mapping of str to str, optional
        Index-style variables (LAMMPS: ``-var name value``); they override the deck's.
    stop_before_first_run : bool, default False
        Stop at the first ``run``; ``state.first_run`` is its request.  The deck may then lack a ``run`` (the request has 0 steps).
    output : str or Path
        Folder for the deck's output files.
    log : callable, optional
        Receives the text of ``print`` commands.

    Returns
    -------
    DeckState
        The final state.

    Raises
    ------
    DeckError
        With file and line, for anything unknown, unsupported, missing or out of bounds.
    """
    with open_deck(Path(path), variables, Path(output), log, carried_out=run_callback is not None) as deck:
        for request in execute_file(deck, deck.path) if stop_before_first_run else deck_runs(deck):
            if stop_before_first_run and deck.first_run is request:
                return deck
            with at_line(request.where):
                if request.minimization is None:
                    request.scene()  # what is missing or wrong is reported, whatever the caller does
                if run_callback is not None:
                    run_callback(request)
    if deck.first_run is None:
        if deck.box is None:
            raise DeckError("the deck creates no simulation box", str(path))
        deck.first_run = RunRequest.of(deck, 0, integration(deck))
    return deck
