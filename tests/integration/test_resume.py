"""Decks that are interrupted anywhere and resumed: every file is, bit for bit, that of a run that was not interrupted."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from interrupted_runs import contents, interrupted, signal_at

from openmm_dpd.cli import main

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")

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
timestep 0.01
thermo 10
variable noise equal "random(0,1,77)"
compute m all msd average yes
compute origin all msd
compute cc all chunk/atom bin/1d x lower 0.25 units reduced
fix mean all ave/time 5 4 20 c_m[4] v_noise file mean.txt ave running
fix over all ave/time 10 2 40 c_thermo_temp file over.txt overwrite
fix prof all ave/chunk 3 5 30 cc vx density/number file prof.txt ave window 3
thermo_style custom step temp press pe c_m[4] c_origin[4] v_noise f_mean[1] f_prof[1][3]
thermo_modify format float %.17g
dump d all custom 15 dump.d id x y z vx vy vz
dump s all atom 25 dump.*.s
dump b all dcd 10 dump.dcd
print "begin" file said.txt
run 60
print "temperature $(temp) $(v_noise)" append said.txt
variable hot equal $(temp)
undump d
dump d all custom 15 dump.d id x y z
velocity all scale ${hot}
write_data data.between
reset_timestep 60
run 45
print "temperature $(temp)" append said.txt
"""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)


def arguments(deck: Path, out: Path, platform: str, *more: str) -> list[str]:
    return [
        "run",
        str(deck),
        "--platform",
        platform,
        "--threads",
        "1",
        "--out",
        str(out),
        "--json",
        str(out / "report.json"),
        "--quiet",
        *more,
    ]


def interrupt_and_resume(deck: Path, platform: str, moments: int, *options: str, seed: int = 1) -> None:
    """Interrupt a run at random moments by each signal in turn, each time resume it, and compare all files; every moment begins anew."""
    whole = deck.parent / "whole"
    with signal_at(0, 0) as calls:
        assert main(arguments(deck, whole, platform, *options)) == 0
    expected = contents(whole)
    assert "log.txt" in expected and not (whole / "checkpoint").exists()
    begun, rng = 0, np.random.default_rng(seed)
    for k, call in enumerate(rng.integers(calls[0] // 10, calls[0], moments)):
        number, out = SIGNALS[k % 3], deck.parent / f"out-{k}"
        status = interrupted(int(call), number, arguments(deck, out, platform, *options))
        assert status in (-number, 128 + number), (k, status)
        if not (out / "checkpoint" / "latest").exists():
            continue
        begun += 1
        resumed = ["run", str(deck), "--restart", str(out), "--json", str(out / "report.json"), "--quiet"]
        assert main(resumed) == 0
        found = contents(out)
        assert sorted(found) == sorted(expected), (k, call)
        differing = [name for name in expected if found[name] != expected[name]]
        assert not differing, (k, call, number, differing)
    assert begun > moments // 2


@pytest.fixture
def deck(tmp_path) -> Path:
    path = tmp_path / "in.tiny"
    path.write_text(TINY, encoding="utf-8")
    return path


@pytest.mark.parametrize("platform", ["Reference", "CPU"])
def test_three_interruptions_change_nothing(deck, platform):
    interrupt_and_resume(deck, platform, 3, "--checkpoint", "20")
