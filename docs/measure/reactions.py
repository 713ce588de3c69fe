"""Bonds that form and break against theory: the tables of ``docs/howto/networks.md``.

    python docs/measure/reactions.py [dimers] [bell] [gel] [cost]

``dimers``: number and lifetime of bonds in equilibrium; ``bell``: lifetimes under tension; ``gel``: gel fraction of molecules with three
groups, beside Flory and Stockmayer; ``cost``: CPU time of a step on one thread with reactions beside one without, alternating in short pieces.
"""

import sys
import time

import numpy as np
from scipy.special import gammaln

import openmm_dpd as dpd
from openmm_dpd.analysis import gel_fraction, network
from openmm_dpd.stats import block_average


def built_of(reactions, types, edge, *, seed, dt=0.05, scheme="middle", A=0.0, pairs=(), positions=None):
    """A built scene of these beads, at density 3 or ideal, with springs between ``pairs``."""
    x = np.random.default_rng(seed).random((len(types), 3)) * edge if positions is None else positions
    bonds = [dpd.HarmonicBonds(pairs, k=20.0, r0=0.5)] if len(pairs) else []
    masses = dict.fromkeys(types, 1.0)
    table = {("*", "*"): dpd.DPD(A=A, gamma=4.5)}
    scene = dpd.Scene(masses, types, x, table, 1.0, [edge] * 3, bonds=bonds, reactions=reactions)
    return dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=seed)


def dimers(n=200, edge=6.0, samples=4000) -> None:
    """n ideal beads A and as many B: their dimers in a canonical ensemble, and how long each lives."""
    print("| scheme, step | k | energy | dimers | theory | lifetime | theory |\n| --- | --- | --- | --- | --- | --- | --- |")
    r = np.linspace(1e-6, edge / 2, 20_001)
    for scheme, dt, k, r0, energy, rate in (
        ("middle", 0.05, 5.0, 0.5, 1.0, 1.0),
        ("middle", 0.05, 20.0, 0.4, 3.0, 2.0),
        ("B/2 A/2 O A/2 B/2", 0.05, 20.0, 0.4, 3.0, 2.0),
        ("mvv", 0.01, 20.0, 0.4, 3.0, 2.0),
    ):
        every = round(0.25 / dt)
        bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": k, "r0": r0})
        reaction = dpd.BondFormation(bonds, ("A", "B"), within=1.0, valences=1, energy=energy, rate=rate, every=every)
        built = built_of([reaction], ["A", "B"] * n, edge, seed=7, dt=dt, scheme=scheme)
        simulation = built.simulation()
        simulation.step(round(50 / dt))
        counts, found = [dpd.read_reacted(simulation.context, built.plan)[0, 1]], []
        for _ in range(samples):
            simulation.step(round(0.5 / dt))
            found.append(len(dpd.read_bonds(simulation.context, built.plan)))
            counts.append(dpd.read_reacted(simulation.context, built.plan)[0, 1])
        weight = 4 * np.pi * r**2 * np.exp(energy - k * (r - r0) ** 2)
        breaks = -np.expm1(-rate * every * dt) / (1 + np.exp(energy - k * (r - r0) ** 2)) * (r < 1.0)
        pairs, lg = np.arange(n + 1), gammaln(np.arange(n + 1) + 1)
        logs = 2 * (lg[n] - lg[pairs] - lg[n - pairs]) + lg[pairs] + pairs * np.log(np.trapezoid(weight, r) / edge**3)
        theory = np.average(pairs, weights=np.exp(logs - logs.max()))
        lifetimes = 0.5 * np.add.reduceat(found, np.arange(0, samples, samples // 20)) / np.diff(counts[:: samples // 20])
        mean, error = lifetimes.mean(), lifetimes.std(ddof=1) / np.sqrt(len(lifetimes))
        average = block_average(np.array(found, dtype=float))
        print(
            f"| `{scheme}`, {dt} | {k:g} | {energy:g} | {average.mean:.2f}({average.sem:.2f}) | {theory:.2f} | {mean:.3f}({error:.3f}) "
            f"| {every * dt * weight.sum() / (weight @ breaks):.3f} |",
            flush=True,
        )


def bell(n=20_000) -> None:
    """Bonds between beads that stand still, of several tensions: mean lifetime."""
    print("| tension F x / kT | lifetime | theory |\n| --- | --- | --- |")
    for stretch in (0.0, 0.05, 0.1, 0.2):
        x = np.random.default_rng(1).random((n, 1, 3)) * 30.0 + np.array([[0.0, 0, 0], [0.5 + stretch, 0, 0]])
        bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 50.0, "r0": 0.5}, np.arange(2 * n).reshape(-1, 2))
        reaction = dpd.BondBreaking(bonds, rate=0.01, barrier=0.1)
        mobile = np.arange(2 * n + 1) == 2 * n
        pairs = {("*", "*"): dpd.DPD(A=0.0, gamma=4.5)}
        x = np.vstack([x.reshape(-1, 3), [[0.0, 0, 0]]])
        scene = dpd.Scene({"A": 1.0}, ["A"] * len(x), x, pairs, 1.0, [31.0] * 3, mobile=mobile, reactions=[reaction])
        built = dpd.build(scene, dt=0.05, platform="CPU", seed=2)
        simulation = built.simulation()
        rate = 0.01 * np.exp(2 * 50.0 * stretch * 0.1)
        steps = round(1.0 / rate / 0.05)
        simulation.step(steps)
        left = len(dpd.read_bonds(simulation.context, built.plan)) / n
        error = np.sqrt((1 - left) / left / n) / np.log(left) ** 2 * steps * 0.05
        print(f"| {10 * stretch:g} | {-steps * 0.05 / np.log(left):.2f}({error:.2f}) | {1 / rate:.2f} |", flush=True)


def _of_gel(simulation, built, pairs) -> tuple[float, float]:
    bonds = np.vstack([pairs, dpd.read_bonds(simulation.context, built.plan)[:, :2]])
    n = built.plan.scene.n_beads
    return 2 * (len(bonds) - len(pairs)) / n, network(bonds, n).gel


def gel(molecules=400, seeds=4) -> None:
    """Triangles whose beads each have one valence: pairs at random (ideal, bonds without a force, half the box apart), and a melt."""
    corners = 3 * np.arange(molecules)[:, None, None] + np.array([[0, 1], [1, 2], [0, 2]])
    pairs, types, ideal = corners.reshape(-1, 2), ["A"] * (3 * molecules), (molecules / 1.0) ** (1 / 3)
    print("| conversion, at random | gel fraction | Flory, Stockmayer |\n| --- | --- | --- |")
    for wanted in (0.4, 0.55, 0.65, 0.75, 0.85):
        energy = np.log(wanted / (1 - wanted) ** 2 / len(types))
        found = []
        for seed in range(seeds):
            bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 0.0, "r0": 0.5})
            reaction = dpd.BondFormation(bonds, ("A", "A"), within=ideal / 2, valences=1, energy=energy, probability=0.3, every=50)
            built = built_of([reaction], types, ideal, seed=seed, pairs=pairs)
            simulation = built.simulation()
            simulation.minimizeEnergy(maxIterations=100)
            simulation.step(1500)
            for _ in range(10):
                simulation.step(100)
                found.append(_of_gel(simulation, built, pairs))
        p, part = np.mean(found, axis=0)
        error = np.std(np.reshape(found, (seeds, -1, 2)).mean(axis=1)[:, 1], ddof=1) / np.sqrt(seeds)
        print(f"| {p:.3f} | {part:.3f}({error:.3f}) | {float(gel_fraction(p, 3)):.3f} |", flush=True)
    print("| conversion, in a melt | gel fraction | Flory, Stockmayer |\n| --- | --- | --- |")
    marks, found = [0.5, 0.55, 0.6, 0.65, 0.7, 0.8, 0.9], []
    for seed in range(seeds):
        bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 20.0, "r0": 0.5})
        reaction = dpd.BondFormation(bonds, ("A", "A"), within=0.8, valences=1, rate=0.05, every=10)
        edge = (2 * len(types) / 3.0) ** (1 / 3)
        x = np.random.default_rng(seed).random((2 * molecules, 1, 3)) * edge + np.random.default_rng(9).normal(size=(3, 3)) * 0.2
        twice = np.vstack([pairs, pairs + len(types)])
        built = built_of([reaction], types * 2, edge, seed=seed, dt=0.04, A=25.0, pairs=twice, positions=x.reshape(-1, 3))
        simulation, rows = built.simulation(), []
        simulation.minimizeEnergy(maxIterations=50)
        while not rows or rows[-1][0] < 0.92:
            simulation.step(10)
            rows.append(_of_gel(simulation, built, twice))
        found.append(np.interp(marks, *np.transpose(rows)))
    for p, part, error in zip(marks, np.mean(found, axis=0), np.std(found, axis=0, ddof=1) / np.sqrt(seeds), strict=True):
        print(f"| {p:.2f} | {part:.3f}({error:.3f}) | {float(gel_fraction(p, 3)):.3f} |", flush=True)


def cost(seconds=40.0) -> None:
    """The standard fluid of 10,125 beads on one thread, with a tenth and with all of the beads reacting, beside the same beads without."""
    edge, n = 15.0, 10_125
    dpd.set_threads(1)
    runs = {}
    for name, many in (("a tenth", n // 10), ("all", n - 1)):
        types = ["A", "B"] * (many // 2) + ["W"] * (n - many // 2 * 2)
        bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 20.0, "r0": 0.5})
        formation = dpd.BondFormation(bonds, ("A", "B"), within=0.7, valences=2, every=10, rate=0.1)
        for reactions in ([], [formation, dpd.BondBreaking(bonds, beyond=1.0, every=10)]):
            runs[name, bool(reactions)] = built_of(reactions, types, edge, seed=1, dt=0.04, A=25.0).simulation()
            runs[name, bool(reactions)].step(300)
    times: dict[tuple[str, bool], list[float]] = {name: [] for name in runs}
    begun = time.monotonic()
    while time.monotonic() - begun < seconds:
        for name, simulation in runs.items():
            before = time.process_time()
            simulation.step(100)
            times[name].append(time.process_time() - before)
    for name in ("a tenth", "all"):
        without, reacting = (np.quantile(times[name, both], 0.25) for both in (False, True))
        print(f"| {name} | {10 * without:.2f} ms | {10 * reacting:.2f} ms | {reacting / without:.3f} |")


if __name__ == "__main__":
    for name in sys.argv[1:] or ("dimers", "bell", "gel", "cost"):
        {"dimers": dimers, "bell": bell, "gel": gel, "cost": cost}[name]()
