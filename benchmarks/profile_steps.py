"""Where the time of a step goes on the CPU platform, kernel by kernel and thread by thread, and what is left for more cores.

Steps are played in compiled code (openmm_dpd/runtime/tape.py), whose clock is read before and after each kernel and after the threads have
met.  A line for each kernel: its time with one thread; with several the work of the slowest, the waiting of the others, and how much faster
that is.  Serial is what one thread does alone, and every moment in which some wait.  The last lines have the speedup that Amdahl's law makes
of the share that does not get faster, s = (n T_n/T_1 - 1)/(n - 1), for 4, 8 and 16 cores.  A quiet machine is needed.

    python benchmarks/profile_steps.py                      # 10,000 beads, middle and bab3, on one core and on two
    python benchmarks/profile_steps.py --beads 100000 --threads 4
    python benchmarks/profile_steps.py --kinds energies many-body charges --schemes mvv middle
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.kernels.engine import PairEngine  # noqa: E402
from openmm_dpd.runtime.tape import Tape  # noqa: E402

PLAY, REPEATS = Tape.play, PairEngine.repeats


def scene_of(kind: str, beads: int) -> tuple[dpd.Scene, float]:
    """A fluid of one of :data:`KINDS`, and a step for it."""
    edge, rng = (beads / 3) ** (1 / 3), np.random.default_rng(1)
    x = rng.random((beads, 3)) * edge
    if kind == "chains":
        x = x[np.arange(beads) // 10] + np.cumsum(rng.normal(size=(beads, 3)) * 0.3, axis=0)
    pair, more = KINDS[kind](beads)
    scene = dpd.Scene({"W": 1.0}, ["W"] * beads, x, {("W", "W"): pair}, kT=1.0, box=np.full(3, edge), **more)
    return scene, {"fluid": 0.05, "many-body": 0.01}.get(kind, 0.02)


def pairs_in_line(beads: int) -> dict:
    """Bonds of chains of ten beads."""
    first = np.flatnonzero(np.arange(beads) % 10 < 9)[: -(beads % 10) or None]
    return {"bonds": [dpd.HarmonicBonds(np.stack([first, first + 1], axis=1), 10.0, 0.5)]}


def charges_of_some(beads: int) -> dict:
    """Two beads of a hundred have a charge."""
    ions = 2 * (beads // 100)
    charges = np.where(np.arange(beads) < ions, 1.0 - 2.0 * (np.arange(beads) % 2), 0.0)
    return {"charges": charges, "electrostatics": dpd.SlaterCharges(lamda=0.67, bjerrum_length=1.0, cutoff=3.0)}


#: What pairs do, and what else is in the scene.
KINDS: dict[str, Callable[[int], tuple[Any, dict]]] = {
    "fluid": lambda n: (dpd.DPD(A=25, gamma=4.5), {}),
    "chains": lambda n: (dpd.DPD(A=25, gamma=4.5), pairs_in_line(n)),
    "charges": lambda n: (dpd.DPD(A=25, gamma=4.5), charges_of_some(n)),
    "shear": lambda n: (dpd.DPD(A=25, gamma=4.5), {"shear": dpd.LeesEdwards(rate=0.2)}),
    "many-body": lambda n: (dpd.MDPD(A=-40, B=25, gamma=4.5), {}),
    "energies": lambda n: (
        dpd.EnergyDPD(A=25, sigma=3.0, kappa=1.0),
        {"internal": dpd.InternalEnergy(dpd.ConstantHeatCapacity(60.0), np.ones(n))},
    ),
    "temperatures": lambda n: (dpd.EDPD(A=18.75, gamma=4.5, kappa=1e-5), {"internal": dpd.BeadTemperatures(1.0, 1e5)}),
    "concentrations": lambda n: (dpd.TDPD(A=18.75, gamma=4.5, kappa=(1.0,)), {"internal": dpd.Concentrations(np.ones((n, 1)))}),
}


class Clock:
    """Plays steps, and adds up what each kernel takes: (calls, threads, 2), work and waiting."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.spent, self.played, self.seconds = np.zeros((0, 0, 2)), 0, 0.0

    def play(self, tape: Tape, counter: int, steps: int, heats: np.ndarray | None, *seldom: Any) -> tuple[int, int | None]:
        """As :meth:`openmm_dpd.runtime.tape.Tape.play`."""
        threads = tape.threads
        spent, begun = np.zeros((len(tape.calls), threads, 2), np.int64), time.perf_counter()
        found = PLAY(tape, counter, steps, heats, *seldom, spent)
        if not spent[:, -1].any():
            return found  # fewer did all: there were not cores enough
        names = [call.layout.name for call in tape.calls]
        if names != self.names or self.spent.shape != spent.shape:
            self.names, self.spent, self.played, self.seconds = names, np.zeros(spent.shape), 0, 0.0
        self.spent, self.played, self.seconds = self.spent + spent, self.played + found[0], self.seconds + time.perf_counter() - begun
        return found


def measured(kind: str, scheme: str, beads: int, threads: int, count: int) -> tuple[list[str], np.ndarray, float]:
    """Names of kernels, microseconds a step of each (calls, threads, 2), and of a whole step with all that lies between calls."""
    dpd.set_threads(threads)
    scene, dt = scene_of(kind, beads)
    simulation = dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=1).simulation()
    warm = time.perf_counter() + 3.0  # on a virtual machine both threads can be on one core for the first second
    while time.perf_counter() < warm:
        simulation.step(100)
    PairEngine.repeats = property(lambda self: True)  # type: ignore[method-assign, assignment]  # many beads too, with one thread
    clock = Clock()
    Tape.play = lambda *arguments: clock.play(*arguments)  # type: ignore[method-assign]
    begun = time.perf_counter()
    simulation.step(count)
    whole = time.perf_counter() - begun
    Tape.play, PairEngine.repeats = PLAY, REPEATS  # type: ignore[method-assign]
    if not clock.played:
        raise SystemExit(f"no step was played with {threads} thread(s): there are no cores for them, or the beads are too few")
    ticks = clock.spent[:, 0].sum() / clock.seconds  # of the processor's clock in a second
    return clock.names, 1e6 * clock.spent / clock.played / ticks, 1e6 * whole / count


def report(kind: str, scheme: str, beads: int, threads: int, count: int) -> None:
    """Print the table of a scheme."""
    names, alone, whole = measured(kind, scheme, beads, 1, count)
    _, shared, whole_shared = measured(kind, scheme, beads, threads, count)
    print(f"{kind}, {scheme}, {beads:,} beads, microseconds a step")
    print(f"{'kernel':28s} {'1 thread':>9s} {f'{threads} threads':>10s} {'waiting':>8s} faster")
    for name in dict.fromkeys(names):
        of_it = [k for k, other in enumerate(names) if other == name]
        one, work = alone[of_it, 0, 0].sum(), shared[of_it, :, 0].max(axis=1).sum()
        print(f"{len(of_it)} x {name:24s} {one:9.1f} {work:10.1f} {shared[of_it, :, 1].max(axis=1).sum():8.1f} {one / work:6.2f}")
    one, all_of_them = alone[:, 0].sum(), shared[:, 0].sum()
    waiting = shared[:, :, 1].max(axis=1).sum() / all_of_them
    for what, first, second in (("kernels", one, all_of_them), ("with all between", whole, whole_shared)):
        share = max(0.0, (threads * second / first - 1) / (threads - 1))
        cores = ", ".join(f"{1 / (share + (1 - share) / n):.1f} on {n}" for n in (4, 8, 16))
        print(f"{what:28s} {first:9.1f} {second:10.1f} {'':8s} {first / second:6.2f}   does not get faster: {100 * share:.1f} %; {cores}")
    print(f"waiting: {100 * waiting:.1f} % of the time\n")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beads", type=int, default=10_000)
    parser.add_argument("--threads", type=int, default=2, help="two and more, beside one")
    parser.add_argument("--steps", type=int, default=0, help="a million beads and steps by default")
    parser.add_argument("--schemes", nargs="+", default=["middle", "bab3"])
    parser.add_argument("--kinds", nargs="+", default=["fluid"], choices=KINDS, help="of fluids")
    options = parser.parse_args()
    if options.threads < 2:
        parser.error("--threads must be two or more: one is what they are compared with")
    for kind in options.kinds:
        for scheme in options.schemes:
            report(kind, scheme, options.beads, options.threads, options.steps or max(100, 1_000_000 // options.beads))


if __name__ == "__main__":
    main()
