"""What a step asks of the device: launches, transfers and waits under OpenCL, and all kernels compiled for CUDA and for HIP, without a GPU."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import openmm
import pytest
from conftest import available
from devices import Device

from openmm_dpd.model.schemes import SCHEMES

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
SOURCE = "".join((HERE.parent / "engine" / name).read_text() for name in ("Arguments.h", "kernels.cc", "fields.cc", "rounds.cc"))
KERNELS = set(re.findall(r"^KERNEL (?:BOUNDS )?void (\w+)", SOURCE, re.M))


def compiled(tmp_path: Path, source: str, name: str, *flags: str) -> Path:
    """A C file of this folder as a shared library."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler here")
    made = tmp_path / name
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-w", *flags, "-o", str(made), str(HERE / source), "-ldl"], check=True)
    return made


def run(script: str, *arguments: str, **variables: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_NUM_THREADS": "1"} | variables
    found = subprocess.run([sys.executable, str(HERE / script), *arguments], env=environment, capture_output=True, text=True, timeout=300)
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout


def per_step(tmp_path: Path, beside: str, *schemes: str) -> dict[str, list[float]]:
    """Launches, blocking transfers and waits per step of Simulation.step, by schemes."""
    available(Device("OpenCL", "single"))
    shim = compiled(tmp_path, "count.c", "count.so")
    return json.loads(run("count_calls.py", "200", beside, *schemes, LD_PRELOAD=str(shim)).splitlines()[-1])


def test_launches_of_a_step(tmp_path):
    most = {"middle": 5, "basa": 5, "aboba": 7, "shardlow": 7.5, "bababo": 7.5, "bababs": 7.5, "bab3": 8.5, "mvv": 3}
    found = per_step(tmp_path, "none", *most)
    assert not {scheme: calls for scheme, calls in found.items() if not (1 <= calls[0] <= most[scheme] and calls[1:] == [0, 0])}


def test_launches_beside_bonds_and_charges(tmp_path):
    """At most eight more than OpenMM's own Langevin dynamics of the same beads."""
    found = per_step(tmp_path, "bonds+charges", "langevin", *(name for name, scheme in SCHEMES.items() if not scheme.native))
    most = found.pop("langevin")[0] + 8
    assert not {scheme: calls for scheme, calls in found.items() if not (calls[0] <= most and calls[1:] == [0, 0])}


@pytest.mark.slow
def test_instructions_and_sectors():
    """In Oclgrind; blocks that take beads in the order of cells look at few sectors, however the fluid has mixed."""
    available(Device("OpenCL", "single"))
    if shutil.which("oclgrind") is None:
        pytest.skip("there is no oclgrind here: apt-get install oclgrind")
    found = json.loads(run("count_work.py", "mvv", "middle").splitlines()[-1])
    assert found["mvv"] < 11700 and found["middle"] < 27500, found
    assert found["sectors"] < 5 < found["sectors by number"], found


def cuda_packages() -> tuple[str, str]:
    """Folders of NVRTC's library and of ptxas, or a skipped test."""
    if not (Path(openmm.version.openmm_library_path) / "plugins" / "libOpenMMCUDA.so").exists():
        pytest.skip("OpenMM has no CUDA platform here: pip install --no-deps openmm-cuda-12")
    nvidia = importlib.util.find_spec("nvidia")
    folders = [] if nvidia is None else list(nvidia.submodule_search_locations)
    nvrtc, ptxas = (
        next((f for f in (Path(p) / part for p in folders) if f.exists()), None) for part in ("cuda_nvrtc/lib", "cuda_nvcc/bin/ptxas")
    )
    if nvrtc is None or ptxas is None:
        pytest.skip("there is no NVRTC or no ptxas here: pip install nvidia-cuda-nvrtc-cu12 nvidia-cuda-nvcc-cu12")
    return str(nvrtc), str(ptxas)


#: Registers of a thread: 256 threads of the most demanding kernel (double precision) must fit into a multiprocessor, and of the simplest scene's kernels
#: twice.  The plugin starts as many blocks as fit.
MOST_REGISTERS, IN_SIMPLEST = 144, 96


@pytest.mark.parametrize("architecture", [70, *(pytest.param(each, marks=pytest.mark.slow) for each in (80, 90)), 120])
def test_all_kernels_compile_for_cuda(architecture, tmp_path):
    """Through OpenMM's CUDA platform on a driver made for the test: it checks every launch, and no arithmetic."""
    nvrtc, ptxas = cuda_packages()
    compiled(tmp_path, "fake_cuda.c", "libcuda.so.1", "-Wl,-soname,libcuda.so.1")
    versions = tmp_path / "cufft.map"
    versions.write_text("libcufft.so.11 { global: *; };\n")
    compiled(tmp_path, "fake_cufft.c", "libcufft.so.11", "-Wl,-soname,libcufft.so.11", f"-Wl,--version-script={versions}")
    ptx = tmp_path / "ptx"
    ptx.mkdir()
    text = run("cuda_without_a_gpu.py", FAKE_SM=str(architecture), FAKE_DUMP=str(ptx), LD_LIBRARY_PATH=f"{tmp_path}:{nvrtc}")
    assert len(text.splitlines()) == 30
    # where OpenMM steps by itself what walls have taken up is, and what beads carry: then `mvv` asks whether they were moved
    asks = [line for line in text.splitlines() if re.search(r"mvv +(warm|energies)", line)]
    assert len(asks) == 4 and all("transfers to the host 1.00, waits 0.00" in line for line in asks)
    assert all("transfers to the host 0.00, waits 0.00" in line for line in text.splitlines() if line not in asks and "walls" not in line)
    kernels: dict[str, int] = {}  # with the fewest registers that each has
    for module in ptx.glob("*.ptx"):
        if "dpdRows" not in module.read_text():
            continue
        found = subprocess.run([ptxas, f"-arch=sm_{architecture}", "-v", str(module), "-o", os.devnull], capture_output=True, text=True)
        assert found.returncode == 0, found.stderr
        for name, registers in re.findall(r"entry function '(dpd\w+)'.*?Used (\d+) registers", found.stderr, re.S):
            kernels[name] = min(int(registers), kernels.get(name, MOST_REGISTERS))
            assert int(registers) <= MOST_REGISTERS, (name, registers)
        assert not re.search(r"[1-9]\d* bytes spill", found.stderr), found.stderr
    assert set(kernels) == KERNELS
    plain = {name: kernels[name] for name in ("dpdMove", "dpdKick", "dpdRows", "dpdPass", "dpdFinish", "dpdEvaluate")}
    assert max(plain.values()) <= IN_SIMPLEST, plain


#: What there is in every scene, and what the kernels are compiled with where a scene has everything.
PLAIN = {"NUM_ATOMS": 3000, "STRIDE": 3008, "NUM_TYPES": 2, "MOST_PASSES": 64, "MAX_CUTOFF": 1.0, "PERIODIC": 1, "LANES": 8, "BLOCK": 128}
PLAIN |= {"LAYERS": 1, "SHEARED": 0, "BEHIND_AXIS": 0, "BEHIND_ROWS": -1, "EQUAL_MASS": 1.0}
EVERYTHING = PLAIN | dict.fromkeys(set(re.findall(r"^#ifdef (\w+)", SOURCE, re.M)) - {"USE_MIXED_PRECISION"}, 1)
EVERYTHING |= {"CARRIES": 2, "CARRYING_ROWS": 5, "LAMMPS": 0, "ENERGIES": 0, "LAYERS": 2, "SHEARED": 1}  # species
BEHIND = PLAIN | dict.fromkeys(("WALLS", "DRIVEN", "EXCEPTIONS", "DETAILED", "TRANSVERSE"), 1) | {"BEHIND_AXIS": 2, "BEHIND_ROWS": 256}
HEAT = PLAIN | {"CARRIES": 1, "CARRYING_ROWS": 3, "LAMMPS": 0, "ENERGIES": 0} | dict.fromkeys(("TRICLINIC", "EXCEPTIONS", "IMMOBILE"), 1)
STATES = HEAT | {"ENERGIES": 1}


def hip_compiler() -> str:
    """A clang that makes code for AMD's GPUs, or a skipped test."""
    for name in ("amdclang++", "clang++", "clang", *(f"clang-{version}" for version in range(25, 14, -1))):
        found = shutil.which(name)
        if found and "amdgcn" in subprocess.run([found, "--print-targets"], capture_output=True, text=True).stdout:
            return found
    pytest.skip("there is no clang from 15 on for AMD's GPUs here: apt-get install clang-15")


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("architecture", ["gfx90a", "gfx1030"])
@pytest.mark.parametrize("names", [PLAIN, EVERYTHING, HEAT, STATES, BEHIND], ids=["plain", "everything", "heat", "energies", "behind"])
def test_all_kernels_compile_for_hip(names, architecture, precision, tmp_path):
    """To assembly, with OpenMM's options; GPUs with waves of 64 and of 32 threads (clang 15 crashes now and then for newer ones, as gfx1100)."""
    source, made = tmp_path / "kernels.cc", tmp_path / "kernels.s"
    source.write_text(SOURCE)
    options = f"-O3 -ffast-math -munsafe-fp-atomics --offload-arch={architecture} --cuda-device-only -nogpulib -nogpuinc -S".split()
    options += [f"-D{name}={value}" for name, value in (names | {f"USE_{precision.upper()}_PRECISION": 1}).items()]
    options += ["-include", str(HERE / "hip_prelude.h"), "-o", str(made)]
    found = subprocess.run([hip_compiler(), "-x", "hip", *options, str(source)], capture_output=True, text=True)
    assert found.returncode == 0 and not found.stderr, found.stderr
    text = re.findall(r"\.symbol:\s+(dpd\w+)\.kd\n.*?\.vgpr_count:\s+(\d+)\n\s+\.vgpr_spill_count:\s+(\d+)", made.read_text(), re.S)
    assert {name for name, *_ in text} == KERNELS
    # whether velocities are finite is asked of their bits: -ffast-math leaves out comparisons
    exponent = "0x7f800000" if precision == "single" else "0x7ff00000"
    assert exponent in re.search(r"^dpdMove:.*?s_endpgm", made.read_text(), re.S | re.M).group()
    # a compute unit of gfx90a and a workgroup processor of gfx1030 have 131,072 registers, twice as many
    assert all(int(registers) <= 256 and spilt == "0" for _, registers, spilt in text), text
