"""The command line, ``openmm-dpd run | check | forces | explain | recommend | export | score | warm``: a layer over
:mod:`openmm_dpd.lammps` and :mod:`openmm_dpd.score`."""

import argparse
import json
import math
import os
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import openmm

from . import __version__
from .base.errors import DPDError, OutputError, ParameterError
from .base.files import write_whole
from .base.platforms import platform_here
from .base.signals import Signals
from .model.schemes import SCHEMES, scheme_of


def _option(*names: str, **settings) -> tuple[tuple[str, ...], dict]:
    """An option: its names, and its argparse settings."""
    return names, settings


_SCHEMES = f"integration scheme: {', '.join(SCHEMES)}, or a word such as 'B/2 A/2 O A/2 B/2' (default: what the deck's fixes say)"
_COMPAT = "heat of pair style edpd: consistent with the energy lost by motion (default), or as LAMMPS computes it"
_CONSERVATIVE = "what computes the conservative force: CustomNonbondedForce of OpenMM, or the pair kernel (default: auto)"
_VARIABLES = {"action": "append", "default": [], "help": "set an index variable of the deck; may be repeated"}

#: Options shared by several commands.
_SHARED = {
    "deck": _option("deck", type=Path, metavar="DECK", help="LAMMPS input script"),
    "var": _option("--var", "-var", nargs=2, metavar=("NAME", "VALUE"), **_VARIABLES),
    "scheme": _option("--scheme", metavar="S", help=_SCHEMES),
    "dt": _option("--dt", type=float, metavar="DT", help="time step, in the deck's units (default: the deck's)"),
    "steps": _option("--steps", type=int, metavar="N", help="number of steps of every run command (default: the deck's)"),
    "seed": _option("--seed", type=int, metavar="K", help="seed of the noise (default: the deck's)"),
    "compat": _option("--compat", choices=("consistent", "lammps"), default="consistent", help=_COMPAT),
    "platform": _option("--platform", metavar="P", help="Reference, CPU, OpenCL, CUDA or HIP (default: the fastest there is)"),
    "precision": _option("--precision", choices=("single", "mixed", "double"), help="of a GPU (default: single; with the plugin mixed)"),
    "threads": _option("--threads", type=int, metavar="N", help="threads of OpenMM and of the pair kernel (default: all cores)"),
    "conservative": _option("--conservative", choices=("auto", "openmm", "kernel"), default="auto", help=_CONSERVATIVE),
    "engine": _option("--engine", metavar="E", help="what evaluates the pair terms: auto (default), host, or one that was registered"),
}


def _add(parser: argparse.ArgumentParser, names: str) -> None:
    """Add options of :data:`_SHARED` to a parser."""
    for name in names.split():
        called, settings = _SHARED[name]
        parser.add_argument(*called, **settings)


def _parser() -> argparse.ArgumentParser:
    about = "Dissipative particle dynamics with OpenMM, from LAMMPS input scripts (decks)."
    parser = argparse.ArgumentParser(
        prog="openmm-dpd",
        description=about,
        epilog="First steps: openmm-dpd run DECK --out DIR; openmm-dpd COMMAND --help shows the options of a command",
    )
    parser.add_argument("--version", action="version", version=f"openmm-dpd {__version__}, OpenMM {openmm.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, text: str, shared: str) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        _add(added, shared)
        return added

    shared = "deck scheme dt steps seed var platform precision threads conservative engine compat"
    run = command("run", "run a deck; output goes into a folder", shared)
    _add_run_options(run)
    # None means not given: then the default, or with --restart the interrupted run's option
    run.set_defaults(compat=None, conservative=None, engine=None, discard=None, format=None)
    check = command("check", "say all that is not supported in a deck, and what is accepted with a remark", "deck var")
    data = "write the same as data to this file (without FILE to standard output)"
    check.add_argument("--json", type=Path, nargs="?", const=Path("-"), metavar="FILE", help=data)
    shared = "deck seed var platform precision threads conservative engine compat"
    forces = command("forces", "write the forces at the first configuration of a deck, term by term", shared)
    forces.add_argument("--json", type=Path, metavar="FILE", required=True, help="file for the forces")
    explain = command(
        "explain",
        "print what would be built for the first run of a deck",
        "deck scheme dt seed var platform threads conservative engine compat",
    )
    explain.add_argument("--program", action="store_true", help="also list the integrator's program")
    advice = command("recommend", "print which scheme and time step suit the first run of a deck", "deck scheme dt var")
    accepted = "relative error of the temperatures to accept, from 0.0001 to 0.1 (default: 0.01, that is 1 %%)"
    advice.add_argument("--error", type=float, default=0.01, metavar="E", help=accepted)
    export = command("export", "write the first run of a deck as in.NAME and data.NAME, for LAMMPS on a cluster", "deck")
    export.add_argument("directory", type=Path, metavar="DIR", help="folder to write to")
    export.add_argument("--name", metavar="NAME", help="files are in.NAME and data.NAME (default: the deck's name without 'in.')")
    export.add_argument("--every", type=int, metavar="N", help="steps between two frames (default: a hundredth of the steps)")
    _add(export, "scheme dt steps seed compat var")
    score = command("score", "print what a scheme costs at a joint error, in the scenes of the reference suite", "seed")
    score.add_argument("what", metavar="WORD|FRAMES", help="scheme or word, or with --dt frames that another program wrote (a text dump)")
    score.add_argument("--scenes", nargs="+", metavar="NAME", help="scenes of the suite (default: all that the scheme can run)")
    score.add_argument("--dt", type=float, metavar="DT", help="time step of FRAMES, whose scene --scenes names")
    score.add_argument("--error", type=float, default=0.01, metavar="E", help="relative error of every quantity to accept (default: 0.01)")
    score.add_argument("--time", type=float, default=200.0, metavar="T", help="length of each run, in units of the scene (default: 200)")
    score.add_argument("--json", type=Path, metavar="FILE", help="write all errors to this file")
    score.add_argument("--picture", type=Path, metavar="FILE", help="draw the last column, as a PNG file")
    command("warm", "compile the kernels of all kinds of models now rather than in their first run; takes about a minute", "threads")
    return parser


def _add_run_options(run: argparse.ArgumentParser) -> None:
    results = run.add_argument_group("results")
    results_in = "folder for all output files except those with absolute paths (default: out/NAME for in.NAME)"
    results.add_argument("--out", type=Path, metavar="DIR", help=results_in)
    results.add_argument("--json", type=Path, metavar="FILE", help="write averages and profiles to this file")
    left_out = "exclude the first N steps of every run of at least N steps from averages (default: those before equilibrium)"
    results.add_argument("--discard", type=int, metavar="N", help=left_out)
    results.add_argument(
        "--every", type=int, metavar="N", help="steps between two frames of the trajectory (default: 100 a run, one in 100 steps)"
    )
    results.add_argument("--format", choices=("dcd", "xtc"), default="dcd", help="format of the trajectory (default: dcd)")
    silence = "print nothing but errors; all rows are in DIR/log.txt (default: --no-quiet)"
    results.add_argument("--quiet", action=argparse.BooleanOptionalAction, help=silence)
    kept = run.add_argument_group("interruptions")
    stored = "write a checkpoint every N steps (default: at the end of each run, and on Ctrl-C or SIGTERM)"
    kept.add_argument("--checkpoint", type=int, metavar="N", help=stored)
    resumed = "continue an interrupted run of this DECK, with its options, in its folder DIR (its --out)"
    kept.add_argument("--restart", type=Path, metavar="DIR", help=resumed)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status: 0, 1 after an error (in lines on standard error), 2 for a bad option, 130 after Ctrl-C, 143
    after SIGTERM."""
    options = _parser().parse_args(arguments)
    signals = Signals()
    with signals.caught():
        try:
            commands: dict[str, Callable[[argparse.Namespace, Signals], int | None]] = {
                **{"run": _run, "check": _check, "forces": _forces, "explain": _explain, "recommend": _recommend},
                **{"export": _export, "score": _score, "warm": _warm},
            }
            return commands[options.command](options, signals) or 0
        except KeyboardInterrupt as error:
            return _interrupted(signals, str(error))
        except DPDError as error:
            if signals.seen:  # inside a force callback, a signal arrives as an OpenMM error without text
                return _interrupted(signals)
            print("\n".join(f"openmm-dpd: error: {line}" for line in _with_dashes(error, options).splitlines()), file=sys.stderr)
            return 1
        except BrokenPipeError:
            return 1


def _with_dashes(error: DPDError, options: argparse.Namespace) -> str:
    """The text of an error; if it begins with the name of an option, that gets its dashes."""
    text = str(error)
    name = re.match(r"\w*", text)[0]  # type: ignore[index]
    return f"--{text}" if isinstance(error, ParameterError) and name in vars(options).keys() - {"deck", "directory", "command"} else text


def _interrupted(signals: Signals, text: str = "") -> int:
    print(f"openmm-dpd: {text or f'interrupted by {signals.name}'}", file=sys.stderr)
    return signals.status


def _options(options: argparse.Namespace):
    from .lammps import RunOptions

    checks: tuple[tuple[str, Callable[[str], object]], ...] = (("scheme", scheme_of), ("platform", platform_here))
    for name, check in checks:
        # checked here, since an error at a line of the deck would blame the deck
        given = getattr(options, name, None)
        if given is not None:
            try:
                check(given)
            except ParameterError as error:
                raise ParameterError(f"{name}: {error}") from None
    names = RunOptions.__dataclass_fields__
    return RunOptions(**{name: value for name, value in vars(options).items() if name in names and value is not None})


def _run(options: argparse.Namespace, signals: Signals) -> None:
    from tqdm import tqdm

    from .lammps import run_deck
    from .lammps.run.checkpoint import Checkpoints

    chosen, asked = _options(options), {"json": options.json and options.json.absolute(), "quiet": options.quiet}
    if options.restart:
        out = Checkpoints.at(options.restart)
        latest = Checkpoints(out).latest()
        latest.check_given({name: value for name, value in vars(options).items() if name in latest.options and value is not None})
        asked = latest.asked | {name: value for name, value in asked.items() if value is not None}
    else:
        out = options.out or Path("out") / options.deck.name.removeprefix("in.")
    json_file, quiet = asked["json"], asked["quiet"]
    _make_folder(out, "--restart" if options.restart else "--out")
    if json_file:
        _check_target(json_file)

    def keep(report: dict) -> None:
        if json_file:
            _write(json_file, report)

    try:
        run_deck(
            options.deck,
            chosen,
            out=options.out if options.restart else out,
            # keeps lines above the progress bar
            log=(lambda _: None) if quiet else tqdm.write,
            variables=dict(options.var),
            progress=not quiet,
            keep=keep,
            signals=signals,
            restart=options.restart,
            asked=asked,
        )
    except KeyboardInterrupt as error:
        if error.args:  # a deck was being carried out
            stopped, remedy = error.args
            raise KeyboardInterrupt(f"{stopped}; results so far are in {out}/; {remedy}") from None
        raise
    if not quiet:
        tqdm.write(f"files are in {out}/")


def _check(options: argparse.Namespace, signals: Signals) -> int:
    from .lammps import check_deck
    from .lammps.run.check import as_data

    found = check_deck(options.deck, variables=dict(options.var))
    data = as_data(found)
    if options.json == Path("-"):
        print(json.dumps(data, indent=1))
        return int(not data["runs"])
    if options.json:
        _check_target(options.json)
        _write(options.json, data)
    said = f"{len(data['refused'])} refused, {(n := len(data['notes']))} note{'s' * (n != 1)}"
    print("\n".join([*map(str, found), f"{options.deck} {'runs' if data['runs'] else 'does not run'}: {said}"]))
    return int(not data["runs"])


def _forces(options: argparse.Namespace, signals: Signals) -> None:
    from .lammps import deck_forces

    _check_target(options.json)
    terms = deck_forces(options.deck, _options(options), variables=dict(options.var))
    _write(options.json, {"terms": {name: array.tolist() for name, array in terms.items()}})


def _explain(options: argparse.Namespace, signals: Signals) -> None:
    from .lammps import explain_deck

    print(explain_deck(options.deck, _options(options), variables=dict(options.var), program=options.program))


def _recommend(options: argparse.Namespace, signals: Signals) -> None:
    from .lammps import recommend_deck

    print(recommend_deck(options.deck, _options(options), error=options.error, variables=dict(options.var)))


def _export(options: argparse.Namespace, signals: Signals) -> None:
    import warnings

    from .lammps import ExportWarning, export_deck

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExportWarning)  # printed below, one line each
        choices = {name: getattr(options, name) for name in ("name", "dt", "steps", "scheme", "seed", "every", "compat")}
        written = export_deck(options.deck, options.directory, variables=dict(options.var), **choices)
    for text in written.differences:
        print(f"openmm-dpd: different in LAMMPS: {text}", file=sys.stderr)
    print("\n".join(str(path) for path in (written.deck, written.data, *written.tables)))


def _score(options: argparse.Namespace, signals: Signals) -> None:
    from .score import judge, load_suite, report, run_frames, score_word

    if options.dt is not None:
        suite = load_suite()
        if not options.scenes or len(options.scenes) != 1 or options.scenes[0] not in suite:
            raise ParameterError(f"scenes must be the one that the frames are of: {', '.join(suite)}")
        its = suite[options.scenes[0]]
        found = run_frames(its, options.what, options.dt)
        print(report.errors_in_words(its, judge(its, options.dt, found), found.mean))
        return
    for target in (options.json, options.picture):
        if target:
            _check_target(target)
    scores = score_word(options.what, options.scenes, error=options.error, time=options.time, seed=options.seed or 1)
    if left_out := [] if options.scenes else sorted(load_suite().keys() - {score.scene.name for score in scores}):
        print(f"{options.what} cannot run {', '.join(left_out)}")
    gained = report.gains(scores)
    print(report.in_words(scores, gained, options.error))
    if options.json:
        _write(options.json, {score.scene.name: score.as_data() | {"gain": gained[score.scene.name]} for score in scores})
    if options.picture:
        report.score_picture(options.picture, options.what, scores, gained)


def _warm(options: argparse.Namespace, signals: Signals) -> None:
    from .measure.warming import warm
    from .runtime import cache_folder, set_threads

    set_threads(options.threads)
    warm(print)
    folder = cache_folder()
    print("there is no folder for the kernels" if folder is None else f"kernels are in {folder}")


def _make_folder(folder: Path, option: str) -> None:
    """Create a folder for results.  ParameterError, before anything is computed, if this is impossible."""
    wrong = "cannot be created"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        wrong = "is not writable"
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ParameterError(f"{option}: the folder {folder} {wrong} ({error.strerror}); give another one") from None


def _check_target(path: Path) -> None:
    """Raise ParameterError unless the file of --json can be written."""
    if path.exists() and not path.is_file() and not path.is_dir():
        return  # a device or a pipe
    _make_folder(path.parent, "--json")
    if path.is_dir() or (path.exists() and not os.access(path, os.W_OK)):
        raise ParameterError(f"--json: {path} is {'a folder' if path.is_dir() else 'not writable'}; give the name of a file")


def _write(path: Path, content: dict) -> None:
    """Write results to a file; if this fails, write them to standard output so that they are not lost."""
    text = json.dumps(_strict(content), indent=1, allow_nan=False) + "\n"
    try:
        write_whole(path, text, "--json:")
    except OutputError as error:
        sys.stdout.write(text)
        raise OutputError(f"{error}; the results are on standard output instead") from None


def _strict(value):
    """Replace NaN and infinities, which JSON does not allow, by None."""
    if isinstance(value, dict):
        return {key: _strict(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    sys.exit(main())
