"""The command line, ``openmm-dpd run | forces | explain | export``: thin over :mod:`openmm_dpd.lammps`."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from .errors import DPDError, OutputError, ParameterError
from .files import write_whole
from .signals import Signals


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="openmm-dpd", description="Dissipative particle dynamics with OpenMM, from LAMMPS decks.")
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="run a deck", description="Run a LAMMPS deck.")
    run.add_argument(
        "--scheme",
        help="integration scheme of every run, a name or a word (default: what the deck's fixes say)",
    )
    run.add_argument("--dt", type=float, metavar="DT", help="time step of every run, in the deck's units")
    run.add_argument("--steps", type=int, metavar="N", help="number of steps of every run")
    run.add_argument("--discard", type=int, default=0, metavar="N", help="leave the first N steps of each run out of averages")
    run.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for all files that are written but those with absolute names (default: out/NAME)"
    )
    run.add_argument("--quiet", action="store_true", help="print nothing but errors")
    forces = commands.add_parser("forces", help="forces term by term at the first configuration of a deck")
    export = commands.add_parser("export", help="write the first run of a deck as in.NAME and data.NAME, for LAMMPS on a cluster")
    explain = commands.add_parser("explain", help="print what would be built for the first run of a deck")
    explain.add_argument("--scheme", help="integration scheme, a name or a word (default: what the deck's fixes say)")
    explain.add_argument("--dt", type=float, metavar="DT", help="time step, in the deck's units")
    for command in (run, forces, explain):
        command.add_argument("deck", type=Path, metavar="DECK", help="LAMMPS input file")
        command.add_argument("--platform", metavar="P", help="Reference, CPU, OpenCL or CUDA (default: the fastest there is)")
        command.add_argument("--seed", type=int, metavar="K", help="seed of the noise (default: the deck's)")
        command.add_argument("--threads", type=int, metavar="N", help="threads of OpenMM and of the pair kernel (default: all cores)")
        command.add_argument(
            "--conservative",
            choices=("auto", "openmm", "kernel"),
            default="auto",
            help="where the conservative force is computed: CustomNonbondedForce or pair kernel",
        )
        command.add_argument(
            "--compat",
            choices=("consistent", "lammps"),
            default="consistent",
            help="heat of pair style edpd: so that energy is conserved (default), or as LAMMPS computes it",
        )
        command.add_argument(
            "--var", "-var", nargs=2, action="append", default=[], metavar=("NAME", "VALUE"), help="set an index variable of the deck"
        )
    _add_export_options(export)
    for command in (run, forces):
        command.add_argument("--precision", choices=("single", "mixed", "double"), help="precision of a GPU platform")
        command.add_argument("--json", type=Path, metavar="FILE", required=command is forces, help="write results to this file")
    return parser


def _add_export_options(export: argparse.ArgumentParser) -> None:
    export.add_argument("deck", type=Path, metavar="DECK", help="LAMMPS input file")
    export.add_argument("directory", type=Path, metavar="DIR", help="folder to write to")
    export.add_argument("--name", metavar="NAME", help="files are in.NAME and data.NAME (default: the deck's name without 'in.')")
    export.add_argument("--scheme", help="integration scheme, a name or a word; what LAMMPS does not have is replaced by what is nearest")
    export.add_argument("--dt", type=float, metavar="DT", help="time step, in the deck's units")
    export.add_argument("--steps", type=int, metavar="N", help="number of steps")
    export.add_argument("--every", type=int, metavar="N", help="steps between two frames (default: a hundredth of the steps)")
    export.add_argument("--seed", type=int, metavar="K", help="seed of the noise (default: the deck's)")
    export.add_argument(
        "--compat", choices=("consistent", "lammps"), default="consistent", help="what the scene means where LAMMPS differs on purpose"
    )
    export.add_argument(
        "--var", "-var", nargs=2, action="append", default=[], metavar=("NAME", "VALUE"), help="set an index variable of the deck"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status.

    0, 1 after an error (one line on standard error), 2 for a bad option, 130 after Ctrl-C, 143 after SIGTERM.
    """
    options = _parser().parse_args(arguments)
    signals = Signals()
    with signals.caught():
        try:
            {"run": _run, "forces": _forces, "explain": _explain, "export": _export}[options.command](options, signals)
        except KeyboardInterrupt as error:
            return _interrupted(signals, str(error))
        except DPDError as error:
            if signals.seen:  # one that comes inside a force callback reaches us as an error of OpenMM without a text
                return _interrupted(signals)
            print(f"openmm-dpd: error: {error}", file=sys.stderr)
            return 1
        except BrokenPipeError:
            return 1
    return 0


def _interrupted(signals: Signals, text: str = "") -> int:
    print(f"openmm-dpd: {text or f'interrupted by {signals.name}'}", file=sys.stderr)
    return signals.status


def _options(options: argparse.Namespace):
    from .lammps import RunOptions

    names = RunOptions.__dataclass_fields__
    return RunOptions(**{name: value for name, value in vars(options).items() if name in names})


def _run(options: argparse.Namespace, signals: Signals) -> None:
    from tqdm import tqdm

    from .lammps import run_deck

    # lines above the progress bar, not through it
    log = (lambda _: None) if options.quiet else tqdm.write
    out = options.out or Path("out") / options.deck.name.removeprefix("in.")
    _make_folder(out, "--out")
    if options.json:
        _check_target(options.json)

    def keep(report: dict) -> None:
        if options.json:
            _write(options.json, report)

    chosen, variables, progress = _options(options), dict(options.var), not options.quiet
    try:
        run_deck(options.deck, chosen, out=out, log=log, variables=variables, progress=progress, keep=keep, signals=signals)
    except KeyboardInterrupt as error:
        if error.args:  # a run had begun
            raise KeyboardInterrupt(f"{error}; what was computed until then is in {out}/") from None
        raise
    log(f"files are in {out}/")


def _forces(options: argparse.Namespace, signals: Signals) -> None:
    from .lammps import deck_forces

    _check_target(options.json)
    terms = deck_forces(options.deck, _options(options), variables=dict(options.var))
    _write(options.json, {"terms": {name: array.tolist() for name, array in terms.items()}})


def _explain(options: argparse.Namespace, signals: Signals) -> None:
    from .lammps import explain_deck

    print(explain_deck(options.deck, _options(options), variables=dict(options.var)))


def _export(options: argparse.Namespace, signals: Signals) -> None:
    import warnings

    from .lammps import ExportWarning, export_deck

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExportWarning)  # said below, one line each
        written = export_deck(
            options.deck,
            options.directory,
            name=options.name,
            dt=options.dt,
            steps=options.steps,
            scheme=options.scheme,
            seed=options.seed,
            every=options.every,
            compat=options.compat,
            variables=dict(options.var),
        )
    for text in written.differences:
        print(f"openmm-dpd: different in LAMMPS: {text}", file=sys.stderr)
    print("\n".join(str(path) for path in (written.deck, written.data, *written.tables)))


def _make_folder(folder: Path, option: str) -> None:
    """Make a folder for results; ParameterError if that is impossible, before anything is computed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"{option}: the folder {folder} cannot be made ({error.strerror}); give another one") from None
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ParameterError(f"{option}: the folder {folder} is not writable ({error.strerror}); give another one") from None


def _check_target(path: Path) -> None:
    """ParameterError unless the file of --json can be written."""
    if path.exists() and not path.is_file() and not path.is_dir():
        return  # a device or a pipe
    _make_folder(path.parent, "--json")
    if path.is_dir() or (path.exists() and not os.access(path, os.W_OK)):
        raise ParameterError(f"--json: {path} is {'a folder' if path.is_dir() else 'not writable'}; give the name of a file")


def _write(path: Path, content: dict) -> None:
    """Write results; where that fails after all, they go to standard output, so that they are not lost."""
    text = json.dumps(_strict(content), indent=1, allow_nan=False) + "\n"
    try:
        write_whole(path, text, "--json:")
    except OutputError as error:
        sys.stdout.write(text)
        raise OutputError(f"{error}; the results are on standard output instead") from None


def _strict(value):
    """The same without NaN and infinities, which JSON does not have: None."""
    if isinstance(value, dict):
        return {key: _strict(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    sys.exit(main())
