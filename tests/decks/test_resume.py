"""Decks that are interrupted anywhere and resumed: every file is, bit for bit, that of a run that was not interrupted."""

import os
import pickle
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
from cases import put, raises
from interrupted_runs import WITH_SIGNALS, contents, interrupted, signal_at

import openmm_dpd as dpd
from openmm_dpd.__main__ import main
from openmm_dpd.base.file_ledger import sealed
from openmm_dpd.base.files import BlockFile
from openmm_dpd.base.signals import Signals
from openmm_dpd.lammps import RunOptions, run_deck
from openmm_dpd.lammps.run.checkpoint import Checkpoints
from openmm_dpd.lammps.run.runner import DeckRunner
from openmm_dpd.lammps.values import computes

DECKS = Path(__file__).parents[2] / "examples" / "decks"

pytestmark = WITH_SIGNALS

#: Two runs with everything that remembers: averages of every kind, displacements, random numbers of formulas, files that grow, that are
#: written again and that are begun anew, commands between the runs that depend on the first.
TINY = """# everything that remembers
units lj
atom_style atomic
comm_modify vel yes
region box block 0 3 0 3 0 3 units box
create_box 2 box
create_atoms 1 random 40 4243 box
create_atoms 2 random 32 4244 box
mass 1 1.0
mass 2 2.0
pair_style dpd 1.0 1.0 34387
pair_coeff * * 25.0 4.5
velocity all create 1.0 87287
fix move all nve
fix still all momentum 9 linear 1 1 1
timestep 0.01
thermo 10
variable noise equal "random(0,1,77)"
compute m all msd average yes
compute origin all msd
compute cc all chunk/atom bin/1d x lower 0.25 units reduced
compute g all rdf 12 1 2
fix pairs all ave/time 5 2 20 c_g[*] file rdf.txt mode vector
fix mean all ave/time 5 4 20 c_m[4] v_noise file mean.txt ave running
fix over all ave/time 10 2 40 c_thermo_temp file over.txt overwrite
fix prof all ave/chunk 3 5 30 cc vx density/number file prof.txt ave window 3
thermo_style custom step temp press pe c_m[4] c_origin[4] v_noise f_mean[1] f_prof[1][3]
thermo_modify format float %.17g
dump d all custom 15 dump.d id x y z vx vy vz
dump s all atom 25 dump.*.s
dump b all dcd 10 dump.dcd
fix say all print 7 "at $(step) $(temp) $(v_noise)" file say.txt screen no
restart 13 a.restart b.restart
minimize 1e-3 1e-3 20 50
print "begin" file said.txt
fix down all gravity 0.2 chute 30
compute flow all temp/profile 1 0 1 y 2
fix corr all ave/correlate 1 5 6 c_flow v_noise type auto/upper file corr.txt
fix corrs all ave/correlate 2 3 12 c_flow c_m[4] type full ave running overwrite file corrs.txt
dump never all xyz 1000 never.xyz
run 20
write_dump all custom frame.d id x vx modify format float %.17g
variable k loop 3
label again
run 15
print "loop $k $(temp)" append said.txt
if "$k >= 2" then "jump SELF out"
next k
jump SELF again
label out
run 10
print "temperature $(temp) $(v_noise)" append said.txt
variable up atom vx+0.1*id
set group all vx v_up
variable hot equal $(temp)
undump d
dump d all custom 15 dump.d id x y z
velocity all scale ${hot}
write_data data.between
run 45
print "temperature $(temp)" append said.txt
"""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)


def arguments(deck: Path, out: Path, platform: str, *more: str) -> list[str]:
    where = ["--out", str(out), "--json", str(out / "report.json")]
    return ["run", str(deck), "--platform", platform, "--threads", "1", *where, "--quiet", *more]


def interrupt_again_and_again(deck: Path, platform: str, times: int, *options: str, seed: int) -> None:
    """Interrupt one run by each signal in turn, go on with it, and its options, until the next one comes; compare all files at its end."""
    whole, out = deck.parent / "whole", deck.parent / "out"
    with signal_at(0, 0) as calls:
        assert main(arguments(deck, whole, platform, *options)) == 0
    assert (whole / "log.txt").exists() and not (whole / "checkpoint").exists()
    words, resumed = arguments(deck, out, platform, *options), ["run", str(deck), "--restart", str(out)]
    rng, reached = np.random.default_rng(seed), list[tuple]()
    for k in range(times):
        # far enough that there is a checkpoint, or a new one; what is done is recalled in few calls
        call = int(calls[0] * (rng.uniform(0.2, 0.3) if k == 0 else 0.05 + rng.uniform(0.5, 1.0) / times))
        assert interrupted(call, SIGNALS[k % 3], words) in (-SIGNALS[k % 3], 128 + SIGNALS[k % 3]), (k, reached)
        latest = Checkpoints(out).latest()
        reached.append((latest.runs, latest.present and latest.present["step"]))
        words = resumed
    assert len(set(reached)) > times // 2, reached
    assert main(resumed) == 0
    assert contents(out) == contents(whole)


@pytest.fixture
def deck(tmp_path) -> Path:
    return put(tmp_path / "in.tiny", TINY)


def test_three_interruptions_of_one_run_change_nothing(deck):
    interrupt_again_and_again(deck, "CPU", 3, "--checkpoint", "10", seed=1)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("options", [("--checkpoint", "5"), ("--format", "xtc", "--every", "4")], ids=["often", "only at signals"])
@pytest.mark.parametrize("platform", ["Reference", "CPU"])
def test_ten_interruptions_of_one_run_change_nothing(deck, platform, options):
    """Without --checkpoint, a run that is killed goes on where the last one ended."""
    interrupt_again_and_again(deck, platform, 10, *options, seed=3)


SMALL = {  # Example decks with few beads: what is changed of them.
    "in.edpd": {"-10 10 -10 10 -5 5 units": "-3 3 -3 3 -3 3 units", "random 16000": "random 400"},
    "in.dpdh-pressure": {"0 9 0 9 0 10": "0 4 0 4 0 4"},
    "in.mdpd": {"-20 20 -7.5 7.5 -2 2 units": "-4 4 -4 4 -2 2 units"},
    "in.srp": {},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
def test_fields_volumes_and_densities_are_resumed(tmp_path, name):
    """Bead fields and their file, moves of the volume, densities, forces between bonds."""
    for path in DECKS.iterdir():
        shutil.copy(path, tmp_path / path.name)
    text = (DECKS / name).read_text(encoding="utf-8")
    for old, new in SMALL[name].items():
        assert old in text
        text = text.replace(old, new)
    deck, more = put(tmp_path / name, text), ("--steps", "60", "--checkpoint", "10", "--every", "1", "--var", "every", "10")
    with signal_at(0, 0) as calls:
        assert main(arguments(deck, tmp_path / "whole", "CPU", *more)) == 0
    for number, moment in zip(SIGNALS, (0.75, 0.85, 0.95), strict=True):
        out = tmp_path / f"out-{number}"
        assert interrupted(int(moment * calls[0]), number, arguments(deck, out, "CPU", *more)) in (-number, 128 + number)
        assert main(["run", str(deck), "--restart", str(out), "--json", str(out / "report.json"), "--quiet"]) == 0
        assert contents(out) == contents(tmp_path / "whole"), number


def stopped(deck: Path, *more: str) -> Path:
    """A run that was interrupted in its second half."""
    out = deck.parent / "out"
    with signal_at(0, 0) as calls:
        assert main(arguments(deck, deck.parent / "whole", "CPU", *more)) == 0
    assert interrupted(3 * calls[0] // 4, signal.SIGTERM, arguments(deck, out, "CPU", *more)) == 143
    return out


def error_of(capsys, *words: str) -> str:
    capsys.readouterr()
    assert main(["run", *words, "--quiet"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("openmm-dpd: error: ") and error.count("\n") == 1
    return error


def test_what_cannot_be_resumed_is_said_with_the_remedy(deck, capsys):
    """Other options, another deck, files that have gone, checkpoints that are none; and then it goes on after all."""
    out = stopped(deck)
    assert f"; continue with: openmm-dpd run {deck} --restart {out}\n" in capsys.readouterr().err
    again = (str(deck), "--restart", str(out))
    wrong = error_of(capsys, *again, "--dt", "0.02")
    assert "--dt 0.02 cannot be combined with --restart: the interrupted run had none; omit the option" in wrong
    assert "--platform Reference cannot be combined" in error_of(capsys, *again, "--platform", "Reference")
    assert "--var cannot be changed by --restart" in error_of(capsys, *again, "--var", "x", "1")
    assert "cannot be another folder" in error_of(capsys, *again, "--out", str(deck.parent / "elsewhere"))
    put(deck, TINY.replace("0.01", "0.02"))
    assert "is not the deck of the interrupted run, or has changed since" in error_of(capsys, *again)
    put(deck, TINY)
    log = (out / "log.txt").read_bytes()
    (out / "log.txt").write_bytes(log[:-1])
    assert "at the checkpoint: the run cannot continue; put the file back" in error_of(capsys, *again)
    (out / "log.txt").write_bytes(log)
    (deck.parent / "older" / "checkpoint").mkdir(parents=True)
    (deck.parent / "older" / "checkpoint" / "latest").write_bytes(pickle.dumps({"format": "openmm-dpd checkpoint 2"}))
    said = "latest was written by another version (openmm-dpd checkpoint 2, not 3)"
    assert said in error_of(capsys, *again[:2], str(deck.parent / "older"))
    # by a file of it, with what may change
    assert main(["run", str(deck), "--restart", str(out / "checkpoint" / "latest"), "--threads", "2", "--checkpoint", "10", "--quiet"]) == 0
    (out / "report.json").write_bytes((deck.parent / "whole" / "report.json").read_bytes())
    assert contents(out) == contents(deck.parent / "whole")
    assert "there is no checkpoint in" in error_of(capsys, *again)


def test_what_is_damaged_is_refused_or_the_checkpoint_before_is_used(deck, caplog):
    """A byte changed, fifty bytes zeroed, or the end cut off, anywhere in any file that a restart reads."""
    out, copy, draw = stopped(deck, "--checkpoint", "10"), deck.parent / "copy", np.random.default_rng(1)
    refused, instead = set[str](), set[str]()
    for path in sorted((out / "checkpoint").iterdir()):
        for kind in range(15):
            shutil.rmtree(copy, ignore_errors=True)
            shutil.copytree(out, copy)
            whole, at = path.read_bytes(), draw.integers(path.stat().st_size)
            behind = (bytes([whole[at] ^ 1 << draw.integers(8)]) + whole[at + 1 :], bytes(len(whole[at:][:50])) + whole[at + 50 :], b"")
            (copy / "checkpoint" / path.name).write_bytes(damaged := whole[:at] + behind[kind % 3])
            if damaged == whole:  # zeros in the place of zeros
                continue
            checkpoints = Checkpoints(copy)
            try:
                checkpoints.resume(checkpoints.latest())
            except dpd.ParameterError as error:
                assert f"{path.name} is missing, damaged or" in str(error) or f"{path.name} was written by another version" in str(error)
                refused.add(path.name)
            else:
                used = (copy / "checkpoint" / "latest").read_bytes()
                assert used == (out / "checkpoint" / ("latest" if path.name == "before" else "before")).read_bytes()
                instead.add(path.name)
    assert instead == {"latest", "before"} and {"files", "run-1"} <= refused
    assert refused | instead == {path.name for path in (out / "checkpoint").iterdir()}
    (out / "checkpoint" / "latest").write_bytes(b"")
    caplog.clear()
    assert main(["run", str(deck), "--restart", str(out), "--quiet"]) == 0
    assert "latest is missing, damaged or no checkpoint; the run continues from the previous one\n" in caplog.text
    (out / "report.json").write_bytes((deck.parent / "whole" / "report.json").read_bytes())
    assert contents(out) == contents(deck.parent / "whole")


def test_an_interruption_near_the_end_can_be_resumed_or_changes_nothing(tmp_path):
    """Ctrl-C at any of the last calls: 130 with a checkpoint that leads to the end, or 0 with all that belongs there, and nothing else."""
    deck, whole, found = put(tmp_path / "in.tiny", f"{TINY.partition('compute m')[0]}run 4\n"), tmp_path / "whole", set[int]()
    with signal_at(0, 0) as calls:
        assert main(arguments(deck, whole, "Reference")) == 0
    for call in range(calls[0] - 240, calls[0] + 1, 15):
        out = tmp_path / f"out-{call}"
        found.add(status := interrupted(call, signal.SIGINT, arguments(deck, out, "Reference")))
        assert status in (0, 130) and (out / "checkpoint").exists() == (status == 130)
        assert status == 0 or main(["run", str(deck), "--restart", str(out), "--json", str(out / "report.json"), "--quiet"]) == 0
        assert contents(out) == contents(whole)
    assert found == {0, 130}


def test_a_crash_behind_short_runs_leaves_no_older_final_state(tmp_path, monkeypatch):
    """The state at the end of the second run is not written at once, since that would take longer than the run."""
    deck = put(tmp_path / "in.tiny", f"{TINY.partition('compute m')[0]}run 4\nrun 3\n")
    whole, crashed, say = tmp_path / "whole", tmp_path / "crashed", DeckRunner.say_notes
    with monkeypatch.context() as patched:
        patched.setattr("openmm_dpd.lammps.run.trajectory.SELDOM", 1e9)
        patched.setattr(
            DeckRunner, "say_notes", lambda self, state: (shutil.copytree(whole, crashed, dirs_exist_ok=True), say(self, state))
        )
        assert main(arguments(deck, whole, "Reference")) == 0
    assert main(["run", str(deck), "--restart", str(crashed), "--json", str(crashed / "report.json"), "--quiet"]) == 0
    assert contents(crashed) == contents(whole)


def test_a_deck_that_is_edited_while_it_runs_is_another_one(deck):
    signals, out = Signals(), deck.parent / "out"

    def log(text: str) -> None:
        put(deck, f"{TINY}# else\n")
        signals.seen += [signal.SIGTERM] * text.startswith("Loop")

    with pytest.raises(KeyboardInterrupt):
        run_deck(deck, RunOptions(platform="Reference"), out=out, log=log, signals=signals)
    raises(dpd.ParameterError, "is not the deck of the interrupted run, or has changed since", run_deck, deck, restart=out)


class Forgetful:
    """Settings of a compute that take up what a restart would refuse, at the first step or later."""

    def __init__(self, calls: int):
        self.calls, self.kept = calls, None

    def __call__(self) -> None:
        self.calls -= 1
        if self.calls <= 0:
            self.kept = 1j


Forgetful.__module__ = "openmm_dpd.lammps.values.computes"  # as if it were one of the classes that checkpoints hold


@pytest.mark.parametrize("calls", [0, 4])
def test_what_a_restart_would_refuse_is_an_error_at_once(deck, capsys, monkeypatch, calls):
    """Before the first step, or, where it comes about later, before the checkpoint takes the place of one that is good."""

    def prepare(state, group, words):
        settings = Forgetful(calls)
        if not calls:
            settings()
        return settings

    def scalar(moment, compute):
        compute.settings()
        return 1.0

    monkeypatch.setattr(computes, "Forgetful", Forgetful, raising=False)
    monkeypatch.setitem(computes.COMPUTES, "gyration", computes.ComputeSpec(prepare, scalar))
    out = put(deck, f"{TINY.partition('compute m')[0]}compute g all gyration\nthermo_style custom step c_g\nrun 100\n").parent / "out"
    words = ["--out", str(out), "--platform", "Reference", "--threads", "1"]
    error = error_of(capsys, str(deck), *words, "--checkpoint", "10")
    assert "builtins.complex does not belong in a checkpoint" in error
    assert ("--checkpoint: this run could not be resumed" in error) == (not calls)
    rows = [line for line in (out / "log.txt").read_text(encoding="utf-8").splitlines() if line.split()[-1] == "1"]
    assert len(rows) == calls
    if calls:
        assert Checkpoints(out).latest().present["step"] == 20
    else:
        assert main(["run", str(deck), *words, "--quiet"]) == 0


def test_code_in_a_checkpoint_is_not_run(deck, capsys):
    """Neither a function, nor a class that would write."""
    out = deck.parent / "out"
    (out / "checkpoint").mkdir(parents=True)

    class Planted:
        def __init__(self, call, *words):
            self.made = call, words

        def __reduce__(self):
            return self.made

    target = deck.parent / "planted"
    for planted in (Planted(os.system, f"touch {target}"), Planted(BlockFile, str(target), "x"), Planted(Path.touch, target)):
        (out / "checkpoint" / "latest").write_bytes(sealed(pickle.dumps({"deck": planted})))
        assert "does not belong in a checkpoint" in error_of(capsys, str(deck), "--restart", str(out))
    assert not target.exists()


def test_volume_moves_of_openmm_are_refused(capsys, tmp_path):
    deck = DECKS / "in.dpdp-pressure"
    error = error_of(capsys, *[str(deck), "--platform", "CPU", "--threads", "1", "--out", str(tmp_path), "--checkpoint", "10"])
    assert "--checkpoint: this run could not be resumed: OpenMM's MonteCarlo" in error and "omit the option" in error


def test_forces_of_openmm_on_the_cpu_platform_are_not_bit_for_bit(deck, capsys):
    words = ["run", str(deck), "--out", str(deck.parent / "out"), *"--platform CPU --threads 1 --steps 2 --checkpoint 1".split()]
    for more, said in (([], False), (["--conservative", "openmm"], True)):
        assert main([*words, *more]) == 0
        assert ("not bit for bit" in capsys.readouterr().out) == said


@pytest.mark.parametrize(("steps", "same"), [(50, True), (55, False), (150, False)])
def test_what_checkpoints_hold_of_openmm_barostats(steps, same):
    """Random numbers, but neither the steps since the last move (every 10 steps) nor the length of moves, which is adapted after 10 of them."""

    def simulation():
        x = np.random.default_rng(1).random((81, 3)) * 3
        scene = dpd.Scene({"W": 1}, ["W"] * 81, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, 1.0, box=[3] * 3)
        built = dpd.build(scene, dt=0.02, platform="Reference", seed=3)
        dpd.add_barostat(built, 23.6, interval=10)
        return built.simulation()

    first, second = simulation(), simulation()
    first.step(steps)
    checkpoint = first.context.createCheckpoint()
    volumes = []
    for each in (first, second):
        if each is second:
            each.context.loadCheckpoint(checkpoint)
        found = []
        for _ in range(4):
            each.step(10)
            found.append(each.context.getState().getPeriodicBoxVolume()._value)
        volumes.append(found)
    assert (volumes[0] == volumes[1]) == same
