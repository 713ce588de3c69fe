"""Heat and species at long steps: the decay of a sine, equipartition, and what is conserved, for mvv and for words.

    python docs/measure/heat_steps.py            # prints the table of docs/howto/heat_species.md (half an hour)
    python docs/measure/heat_steps.py --runs 1
    python docs/measure/heat_steps.py --fast     # the table for fast exchange (ten minutes)
    python docs/measure/heat_steps.py --repulsion  # how fast eDPD with a repulsion gains energy (five minutes)

The fluid is that of examples/decks/in.edpd, with beads of a heat capacity of 10^4, in a box 10 long.  Temperatures (concentrations) begin as
1 + sin(k x)/4.  The rate at which the amplitude falls is compared with the mean over beads of kappa sum_j w_ij^2 (1 - cos k x_ij), the
continuum limit at that wave number with the neighbours that there are, and k^2 times the diffusion coefficient of the beads; both are
measured in the same run, and errors are standard errors over runs.
Equipartition is the kinetic temperature over the mean of the beads' temperatures (for species: over kT).

Fast exchange: the same decay at larger kappa dt, also of the heat of EnergyDPD, in the fluid of A = 25, density 3 and friction 4.5 and in
others, compared with the decay at a short step.
"""

from __future__ import annotations

import argparse

import numpy as np
from openmm import unit

import openmm_dpd as dpd

EDGES, DENSITY, CUTOFF = np.array([10.0, 5.0, 5.0]), 4.0, 1.58
A, GAMMA, EXPONENT, RATE, CAPACITY = 18.75, 4.5, 0.41, 1.41, 1e4
WAVE, AMPLITUDE, START, TIME, FRAMES = 2 * np.pi / EDGES[0], 0.25, 2.0, 4.0, 50
STEPS = {"mvv": (0.005, 0.01, 0.02, 0.04), "middle": (0.04, 0.08), "aboba": (0.04, 0.08), "bababo": (0.04, 0.08), "shardlow": (0.04,)}


def by_exchange(x: np.ndarray) -> float:
    """Rate of the decay by exchange alone, between these beads."""
    d = x[:, None] - x[None]
    d -= EDGES * np.round(d / EDGES)
    w = np.maximum(1 - np.sqrt(np.sum(d**2, axis=2)) / CUTOFF, 0.0)
    return float(RATE * np.sum(w**2 * (1 - np.cos(WAVE * d[:, :, 0]))) / len(x))


def scene(what: str, seed: int, capacity: float = CAPACITY) -> dpd.Scene:
    """The fluid, not yet in equilibrium."""
    n = round(DENSITY * np.prod(EDGES))
    same = {"A": A, "gamma": GAMMA, "cutoff": CUTOFF, "exponent": EXPONENT}
    if what == "heat":
        term, internal = dpd.EDPD(kappa=RATE / capacity, **same), dpd.BeadTemperatures(1.0, capacity)
    else:
        term, internal = dpd.TDPD(kappa=RATE, **same), dpd.Concentrations(np.ones(n))
    x = np.random.default_rng(seed).random((n, 3)) * EDGES
    return dpd.Scene({"W": 1.0}, ["W"] * n, x, {("W", "W"): term}, kT=1.0, box=EDGES, internal=internal)


def run(what: str, scheme: str, dt: float, seed: int) -> dict[str, float]:
    """One run: relative error of the rate, of equipartition, and how much energy per bead (species in all) came from nowhere."""
    built = dpd.build(scene(what, seed), dt=dt, scheme=scheme, seed=seed)
    simulation, observer = built.simulation(), dpd.Observer(built)
    simulation.step(round(START / dt))
    name = "theta" if what == "heat" else "concentrations"

    def look() -> tuple[np.ndarray, np.ndarray]:
        x = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        return x, dpd.read_fields(simulation.context, built.plan)[name].reshape(len(x))

    x, _ = look()
    start = 1.0 + AMPLITUDE * np.sin(WAVE * x[:, 0])
    dpd.write_fields(simulation.context, built.plan, **{name: start if what == "heat" else start[:, None]})
    first, begun, total = observer.sample(simulation.context), x, start.sum()
    rates, times, amplitudes, ratios = [by_exchange(x)], [0.0], [2 * np.mean((start - start.mean()) * np.sin(WAVE * x[:, 0]))], []
    every = round(TIME / FRAMES / dt)
    for frame in range(FRAMES):
        simulation.step(every)
        x, values = look()
        if frame % 10 == 9:
            rates.append(by_exchange(x))
        times.append((frame + 1) * every * dt)
        amplitudes.append(2 * np.mean((values - values.mean()) * np.sin(WAVE * x[:, 0])))
        ratios.append(observer.sample(simulation.context).kT / (values.mean() if what == "heat" else 1.0) - 1.0)
    diffusion = np.mean((x - begun) ** 2) / (2 * times[-1])
    rate = -np.polyfit(times, np.log(amplitudes), 1)[0]
    made = (observer.sample(simulation.context).total - first.total) / len(x) / times[-1] if what == "heat" else values.sum() / total - 1.0
    return {"rate": rate / (np.mean(rates) + WAVE**2 * diffusion) - 1.0, "equipartition": float(np.mean(ratios)), "made": float(made)}


#: Fluids of fast exchange: A, density, range, edges.
STANDARD, DENSE, WIDE = (25.0, 3.0, 1.0, (10, 4, 4)), (25.0, 6.0, 1.0, (10, 4, 4)), (18.75, 4.0, 1.58, (10, 5, 5))
#: What decays, in which fluid, kappa (as a rate between two beads), for how long; the short step, and pairs of scheme and step.
FAST = [
    *((what, STANDARD, 20.0, 3.0, 0.02, (("bababo", 0.12), ("bab3", 0.12), ("bab3", 0.22))) for what in ("species", "heat", "energies")),
    ("species", STANDARD, 20.0, 3.0, 0.02, (("mvv", 0.01), ("mvv", 0.02))),
    ("species", STANDARD, 40.0, 2.0, 0.02, (("mvv", 0.02),)),
    ("species", STANDARD, 40.0, 2.0, 0.01, (("bababo", 0.06), ("bababo", 0.11))),
    ("species", DENSE, 25.0, 1.0, 0.01, (("bababo", 0.1), ("bab3", 0.18))),
    ("species", WIDE, 15.0, 0.32, 0.005, (("bababo", 0.08),)),
]


def fluid(what: str, kind: tuple, rate: float, seed: int, capacity: float = CAPACITY) -> dpd.Scene:
    """A fluid whose beads exchange species, heat (eDPD), or internal energies."""
    a, density, cutoff, edges = kind
    n = round(density * np.prod(edges))
    if what == "species":
        term, internal = dpd.TDPD(A=a, gamma=GAMMA, kappa=rate, cutoff=cutoff), dpd.Concentrations(np.ones(n))
    elif what == "heat":
        term, internal = dpd.EDPD(A=a, gamma=GAMMA, kappa=rate / capacity, cutoff=cutoff), dpd.BeadTemperatures(1.0, capacity)
    else:
        term = dpd.EnergyDPD(A=a, sigma=np.sqrt(2 * GAMMA), kappa=rate * capacity, cutoff=cutoff)
        internal = dpd.InternalEnergy(dpd.ConstantHeatCapacity(capacity), 1.0)
    x = np.random.default_rng(seed).random((n, 3)) * edges
    return dpd.Scene({"W": 1.0}, ["W"] * n, x, {("W", "W"): term}, kT=1.0, box=list(map(float, edges)), internal=internal)


def decay(scene: dpd.Scene, scheme: str, dt: float, time: float, decays: int, seed: int = 3) -> tuple[float, float]:
    """Rate at which the amplitude of a sine falls during a time, and its standard error, from so many decays in one run."""
    built = dpd.build(scene, dt=0.01, scheme=scheme, seed=seed)
    simulation = built.simulation()
    simulation.step(500)
    simulation.integrator.setStepSize(dt)
    simulation.step(round(10 / dt))
    name = "concentrations" if isinstance(scene.internal, dpd.Concentrations) else "theta"
    wave, every, found = 2 * np.pi / scene.box[0, 0], max(1, round(time / 12 / dt)), []
    look = lambda: simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)[:, 0]  # noqa: E731
    for _ in range(decays):
        simulation.step(round(1 / dt))
        start = 1.0 + AMPLITUDE * np.sin(wave * look())
        dpd.write_fields(simulation.context, built.plan, **{name: start if name == "theta" else start[:, None]})
        row = []
        for _ in range(int(time / (every * dt))):
            simulation.step(every)
            values = dpd.read_fields(simulation.context, built.plan)[name].ravel()
            row.append(np.mean((values - values.mean()) * np.sin(wave * look())))
        found.append(row)
    times = every * dt * np.arange(1, 1 + len(found[0]))
    rates = [-np.polyfit(times, np.log(np.mean(group, axis=0)), 1)[0] for group in np.array_split(found, 8)]
    return float(np.mean(rates)), float(np.std(rates, ddof=1) / np.sqrt(8))


def print_fast(decays: int) -> None:
    """The table of fast exchange."""
    print("| beads with | fluid (A, density, range) | kappa | scheme | step | kappa dt | decay rate |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for what, kind, kappa, time, short, longer in FAST:
        scene = fluid(what, kind, kappa, 3)
        right, error = decay(scene, "bababo", short, time, decays)
        for scheme, dt in longer:
            rate, its = decay(scene, scheme, dt, time, decays)
            off = f"{100 * (rate / right - 1):+.1f}({100 * np.hypot(its, error) / right:.1f}) %"
            print(
                f"| {what} | {', '.join(f'{n:g}' for n in kind[:3])} | {kappa:g} | `{scheme}` | {dt} | {kappa * dt:.1f} | {off} |",
                flush=True,
            )


def gained(begun: dpd.Scene, scheme: str, dt: float, time: float, seed: int) -> float:
    """Energy U + K + sum C T per bead and time that a fluid of eDPD gains."""
    built = dpd.build(begun, dt=dt, scheme=scheme, seed=seed)
    simulation, observer = built.simulation(), dpd.Observer(built)
    simulation.integrator.setStepSize(0.01)
    simulation.step(500)
    simulation.integrator.setStepSize(dt)
    first = observer.sample(simulation.context).total
    simulation.step(round(time / dt))
    return (observer.sample(simulation.context).total - first) / begun.n_beads / time


def print_gains() -> None:
    """What the repulsion A T_m w gives to beads of small heat capacity."""
    print("| fluid (A, density, range) | heat capacity | step | energy gained per bead and time |")
    print("| --- | --- | --- | --- |")
    for kind in ((18.75, 3.0, 1.0, (8, 4, 4)), (18.75, 4.0, 1.58, (6, 5, 5))):
        for capacity, time, dt in ((10.0, 5.0, 0.02), (100.0, 20.0, 0.02), (100.0, 20.0, 0.01), (1e3, 20.0, 0.02), (1e4, 20.0, 0.02)):
            found = [gained(fluid("heat", kind, RATE, seed, capacity), "bababo", dt, time, seed) for seed in (1, 2, 3, 4)]
            text = f"{np.mean(found):.2g}({np.std(found, ddof=1) / 2:.1g})"
            print(f"| {', '.join(f'{n:g}' for n in kind[:3])} | {capacity:g} | {dt} | {text} |", flush=True)

    for dt in (0.01, 0.04):
        found = [gained(scene("heat", seed, 1e5), "middle", dt, 20.0, seed) for seed in (1, 2, 3, 4)]
        print(f"| in.edpd, `middle` | 100000 | {dt} | {np.mean(found):.2g}({np.std(found, ddof=1) / 2:.1g}) |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--fast", action="store_true")
    parser.add_argument("--repulsion", action="store_true")
    given = parser.parse_args()
    runs = given.runs
    if given.fast or given.repulsion:
        print_fast(40) if given.fast else print_gains()
        return
    print("| beads with | scheme | step | decay rate | equipartition | energy gained per bead and time, or change of the sum |")
    print("| --- | --- | --- | --- | --- | --- |")
    for what in ("heat", "species"):
        for scheme, steps in STEPS.items():
            for dt in steps:
                try:
                    found = [run(what, scheme, dt, seed) for seed in range(1, runs + 1)]
                except Exception as error:
                    print(f"| {what} | `{scheme}` | {dt} | breaks down: {str(error)[:60]} | | |", flush=True)
                    continue
                cells = []
                for key, unit_ in (("rate", 100), ("equipartition", 100)):
                    values = unit_ * np.array([one[key] for one in found])
                    cells.append(f"{values.mean():+.2f}({values.std(ddof=1) / np.sqrt(runs) if runs > 1 else np.nan:.2f}) %")
                cells.append(f"{np.mean([one['made'] for one in found]):.1e}")
                print(f"| {what} | `{scheme}` | {dt} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
