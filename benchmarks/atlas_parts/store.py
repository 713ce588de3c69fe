"""Results of jobs in a file of JSON lines: a job that is there is not run again, so that a long run can be interrupted."""

from __future__ import annotations

import json
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

#: What a report adds to a job.
RESULTS = (
    "failed", "seconds", "samples", "T_kin", "T_conf", "theta", "U", "P", "D", "D_error", "eta", "eta_error", "g", "drift", "ms", "levels",
    "ladder", "error", "averages",
)  # fmt: skip


def key(job: dict) -> str:
    """A job without its results, as text."""
    return json.dumps({name: value for name, value in sorted(job.items()) if name not in RESULTS})


class Store:
    """A file of results, one JSON object per line; an incomplete last line (a run that was killed) is ignored."""

    def __init__(self, file: Path):
        self.file = file
        file.parent.mkdir(parents=True, exist_ok=True)
        self.results: dict[str, dict] = {}
        for line in file.read_text().splitlines() if file.exists() else ():
            try:
                result = json.loads(line)
            except json.JSONDecodeError:
                continue
            self.results[key(result)] = result

    def __contains__(self, job: dict) -> bool:
        return key(job) in self.results

    def get(self, job: dict) -> dict | None:
        """The result of a job, or None."""
        return self.results.get(key(job))

    def add(self, result: dict) -> None:
        """Keep a result, in memory and on disk."""
        self.results[key(result)] = result
        with self.file.open("a") as file:
            file.write(json.dumps(result) + "\n")


def _quiet(threads: str) -> None:
    # inherited by the processes that a job starts; the package reads them when it is imported
    os.environ |= {"OMP_NUM_THREADS": threads, "NUMBA_NUM_THREADS": threads}


def carry_out(jobs: Iterable[dict], work: Callable[[dict], dict], store: Store, processes: int, say: Callable[[str], None]) -> None:
    """Run all jobs that are not in the store yet, longest (by ``cost``) first, on some processes of one thread each."""
    left = sorted((job for job in jobs if job not in store), key=lambda job: -_cost(job))
    if not left:
        return
    begun = time.perf_counter()
    _quiet("1")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        futures = [pool.submit(work, job) for job in left]
        broken: list[Exception] = []
        try:
            for k, future in enumerate(as_completed(futures), start=1):
                try:
                    result = future.result()
                except Exception as error:  # a mistake in one job must not cost the others their hour; it is raised at the end
                    broken.append(error)
                    say(f"{k}/{len(left)}: {type(error).__name__}: {error}")
                    continue
                store.add(result)
                spent = time.perf_counter() - begun
                say(f"{k}/{len(left)} after {spent:.0f} s: {label(result)}")
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    if broken:
        raise broken[0]


def _cost(job: dict) -> float:
    return job.get("time", 0.0) / job.get("dt", 1.0) * job.get("beads", 1)


def label(result: dict) -> str:
    """One line about a result."""
    name = " ".join(str(result[word]) for word in ("part", "fluid", "method", "scheme", "point", "threads") if word in result)
    dt = f" dt {result['dt']:g}" if "dt" in result else ""
    numbers = [f"{word} {result[word][0]:.4f}({result[word][1] or 0:.4f})" for word in ("T_kin", "T_conf", "U") if result.get(word)]
    numbers += [f"{result['ms']:.2f} ms"] if "ms" in result else []
    return (
        name
        + dt
        + ": "
        + (f"failed: {result['failed']}" if "failed" in result else "  ".join(numbers) + f"  {result.get('seconds', 0):.1f} s")
    )
