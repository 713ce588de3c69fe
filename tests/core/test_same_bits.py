"""A run has the same bits with another C library, another BLAS and other vector instructions: another machine, made of this one."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from kinds import KINDS, everything, made, running
from scenes import fluid, stepped

import openmm_dpd as dpd
from openmm_dpd.lammps import RunOptions, run_deck

OTHER = {  # What makes a library choose functions that another processor has, or another version; they differ in their last bits.
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4",
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": "AVX512_SPR AVX512_ICL AVX512_SKX X86_V4 AVX2 FMA3 X86_V3",
}
RUNS = [
    ("dpd", "mvv"), ("dpd", "middle"), ("sigma", "bababo"), ("energies", "middle"), ("tabulated energies", "aboba"), ("edpd", "mvv"),
    ("tdpd", "mvv"), ("edpd", "middle"), ("tdpd", "bababo"), ("mdpd", "shardlow"), ("bonded", "middle"), ("patterns", "middle"),
]  # fmt: skip
CHARGES = {"slater": dpd.SlaterCharges(lamda=0.25, bjerrum_length=1.0), "gaussian": dpd.GaussianCharges(width=0.2, bjerrum_length=1.0)}
DECK = """units lj
region box block 0 5 0 5 0 5
create_box 1 box
create_atoms 1 random 300 7 box
mass 1 1.3
velocity all create 1.0 3 dist gaussian
pair_style dpd/ext 1.0 1.0 5
pair_coeff 1 1 25 4.5 2.5 0.4 0.7 1.0
fix 1 all nve
fix 2 all momentum 5 linear 1 1 1
timestep 0.02
dump 1 all custom 10 beads.dump id x y z vx vy vz
dump_modify 1 format float %.17g
run 10
"""


def _hash(*arrays) -> str:
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()[:12]


def _of_kind(kind: str, scheme: str) -> str:
    built = made(kind, scheme)
    found = everything(stepped(running(built), 5).context, built)
    return _hash(*(found[name] for name in sorted(found)))


def _of_charges(name: str) -> str:
    """With velocities that the package draws."""
    q = np.concatenate([np.tile([1.0, -1.0], 10), np.zeros(100)])
    scene = fluid(box=np.diag([3.9] * 3), n=120, charges=q, electrostatics=CHARGES[name], velocities=None)
    built = dpd.build(scene, dt=0.01, scheme="middle", platform="Reference", seed=1)
    assert "charges" in built.plan.execution.held
    found = everything(stepped(running(built), 5).context, built)
    return _hash(found["x"], found["v"])


def _of_deck(folder: Path) -> str:
    (folder / "in.bits").write_text(DECK, encoding="utf-8")
    run_deck(folder / "in.bits", RunOptions(platform="Reference", threads=1), out=folder)
    dpd.set_threads(None)
    return hashlib.sha256((folder / "beads.dump").read_bytes()).hexdigest()[:12]


def every(folder: Path) -> list[str]:
    """Lines with the name of a run and its hash, and how this machine rounds in a library."""
    x = np.linspace(-5, 5, 2001)
    rows = [f"library {_hash(np.exp(x))} {_hash(np.vander(x[:200]).T @ x[:200])}"]
    rows += [f"{kind}, {scheme}: {_of_kind(kind, scheme)}" for kind, scheme in RUNS if kind in KINDS]
    rows += [f"{name}: {_of_charges(name)}" for name in CHARGES]
    return [*rows, f"deck: {_of_deck(folder)}"]


@pytest.mark.slow
@pytest.mark.parametrize("cpu", [{}, pytest.param({"NUMBA_CPU_NAME": "generic"}, marks=pytest.mark.long)], ids=["libraries", "processor"])
def test_runs_have_the_same_bits_on_another_machine(tmp_path, cpu):
    """What a child process prints in which libraries take other functions; compiled for another processor, too, in the slow test."""
    lines, paths = {}, os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, sys.path)])
    for name, change in (("here", {}), ("there", OTHER | cpu)):
        folder = tmp_path / name
        folder.mkdir()
        command, environment = [sys.executable, __file__, str(folder)], {**os.environ, "PYTHONPATH": paths, **change}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        lines[name] = done.stdout.splitlines()
    if lines["here"][0] == lines["there"][0]:
        pytest.skip("the libraries of this machine take the same functions with any value of the variables")
    assert lines["there"][1:] == lines["here"][1:]


if __name__ == "__main__":
    print("\n".join(every(Path(sys.argv[1]))))
