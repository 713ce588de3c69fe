"""Self-diffusion and the decay of shear waves in liquid argon: Hamiltonian dynamics, Langevin dynamics and pairwise friction.

Both thermostats exchange kinetic energy with their bath at the same rate.  A Langevin rate G takes 2 G of the excess kinetic energy per
time; radial friction takes 2 S/(3 m) with S = <sum over neighbours of gamma w^2>, so gamma is set such that S/(3 m) = G.

    python docs/measure/hydrodynamics.py --rate 0.5 --runs 6 --time 30 --picture hydrodynamics.png
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import openmm
from openmm import unit
from scipy.integrate import cumulative_trapezoid

import openmm_dpd as dpd
from openmm_dpd.units import BOLTZMANN

#: Argon as in Rahman, Phys. Rev. 136, A405 (1964): 864 atoms at 94.4 K and 1.374 g/cm^3.
SIGMA, EPSILON, MASS, TEMPERATURE = 0.34, 120 * BOLTZMANN, 39.95, 94.4
CELLS, EDGE = 6, 3.478
CUTOFF, SWITCH, FRICTION_CUTOFF = 0.8, 0.7, 0.5  # nm
DT, EVERY = 0.01, 2  # ps, steps between samples
LONGEST = 2.5  # ps, end of the integral that gives the diffusion constant
KT = BOLTZMANN * TEMPERATURE
DYNAMICS = ("Hamiltonian", "Langevin", "pairwise friction")


@dataclass
class Found:
    """Averages over the runs of one dynamics, with standard errors from the scatter of the runs.

    ``shear_time`` is the integral of the autocorrelation function of the shear waves up to LONGEST.
    """

    times: np.ndarray
    velocity: np.ndarray
    shear: np.ndarray
    shear_error: np.ndarray
    shear_time: float
    shear_time_error: float
    diffusion: float
    diffusion_error: float
    temperature: float


def argon() -> openmm.System:
    """Lennard-Jones atoms in a periodic box."""
    system = openmm.System()
    system.setDefaultPeriodicBoxVectors(*(EDGE * np.eye(3)))
    force = openmm.NonbondedForce()
    force.setNonbondedMethod(force.CutoffPeriodic)
    force.setCutoffDistance(CUTOFF)
    force.setUseSwitchingFunction(True)
    force.setSwitchingDistance(SWITCH)
    for _ in range(4 * CELLS**3):
        system.addParticle(MASS)
        force.addParticle(0, SIGMA, EPSILON)
    system.addForce(force)
    return system


def lattice() -> np.ndarray:
    """Face-centred cubic."""
    corner = np.stack(np.meshgrid(*[np.arange(CELLS)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    base = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    return (corner + base).reshape(-1, 3) * EDGE / CELLS


def simulation(system: openmm.System, integrator: openmm.Integrator) -> openmm.Context:
    """A Context on one thread."""
    return openmm.Context(system, integrator, openmm.Platform.getPlatformByName("CPU"), {"Threads": "1"})


def arrays(context: openmm.Context) -> tuple[np.ndarray, np.ndarray, float]:
    """Positions, velocities and potential energy."""
    state = context.getState(positions=True, velocities=True, energy=True)
    return (
        state.getPositions(asNumpy=True).value_in_unit(unit.nanometer),
        state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond),
        state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole),
    )


def starts(runs: int, seed: int, between: float = 5.0) -> list[tuple[np.ndarray, np.ndarray]]:
    """Equilibrated positions and velocities, without total momentum and all of the same, right, energy.

    So the runs without a thermostat have the mean temperature of the others.
    """
    integrator = openmm.LangevinMiddleIntegrator(TEMPERATURE, 2.0, DT)
    integrator.setRandomNumberSeed(seed)
    context = simulation(argon(), integrator)
    context.setPositions(lattice())
    context.setVelocitiesToTemperature(2 * TEMPERATURE, seed)
    integrator.step(round(20 / DT))
    found, potential, samples = [], [], 10
    for _ in range(runs):
        for _ in range(samples):
            integrator.step(round(between / samples / DT))
            potential.append(arrays(context)[2])
        found.append(arrays(context))
    # mean energy: kinetic energy is known, so that only the potential energy has to be averaged
    energy = float(np.mean(potential)) + 1.5 * (4 * CELLS**3 - 1) * KT
    states = []
    for x, v, u in found:
        v = v - v.mean(axis=0)
        states.append((x, v * np.sqrt((energy - u) / (0.5 * MASS * np.sum(v**2)))))
    return states


def gamma_for(rate: float, positions: list[np.ndarray]) -> float:
    """Friction coefficient whose mean rate per degree of freedom, S/(3 m), is ``rate``."""
    sums = []
    for x in positions:
        d = x[:, None] - x[None]
        d -= EDGE * np.rint(d / EDGE)
        w = np.clip(1 - np.linalg.norm(d, axis=2) / FRICTION_CUTOFF, 0, None)
        np.fill_diagonal(w, 0)
        sums.append(np.sum(w**2) / len(x))
    return 3 * MASS * rate / float(np.mean(sums))


def integrators(rate: float, gamma: float) -> dict[str, Callable[[openmm.System, int], openmm.Integrator]]:
    """What makes the integrator of each dynamics, from a System and a seed."""

    def langevin(system: openmm.System, seed: int) -> openmm.Integrator:
        made = openmm.LangevinMiddleIntegrator(TEMPERATURE, rate, DT)
        made.setRandomNumberSeed(seed)
        return made

    def pairwise(system: openmm.System, seed: int) -> openmm.Integrator:
        friction = dpd.DPD(gamma=gamma, cutoff=FRICTION_CUTOFF)
        return dpd.add_thermostat(system, friction, TEMPERATURE, DT, seed=seed, platform="CPU").integrator

    return dict(zip(DYNAMICS, (lambda system, seed: openmm.VerletIntegrator(DT), langevin, pairwise), strict=True))


def shear_waves(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Transverse currents at the smallest wave vectors of the box: three directions, two polarisations each."""
    waves = np.exp(-2j * np.pi / EDGE * x)
    return np.array([np.mean(waves[:, k] * v[:, (k + turn) % 3]) for k in range(3) for turn in (1, 2)])


def autocorrelation(series: np.ndarray, length: int) -> np.ndarray:
    """Mean over columns of Re <a*(0) a(t)>, for the first ``length`` times; ``series`` is (time, columns)."""
    n = len(series)
    transform = np.fft.fft(series, 2 * n, axis=0)
    power = np.fft.ifft(np.sum(np.abs(transform) ** 2, axis=1))[:length].real
    return power / (n - np.arange(length)) / series.shape[1]


def one_run(make, start, time: float, seed: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Velocity autocorrelation function, that of the shear waves, and the temperature of a run."""
    system = argon()
    integrator = make(system, seed)
    context = simulation(system, integrator)
    context.setPositions(start[0])
    context.setVelocities(start[1])
    integrator.step(round(1.0 / DT))
    frames = round(time / DT / EVERY)
    velocities, waves = np.empty((frames, 3 * len(start[0])), np.float32), np.empty((frames, 6), complex)
    for k in range(frames):
        integrator.step(EVERY)
        x, v, _ = arrays(context)
        velocities[k], waves[k] = v.ravel(), shear_waves(x, v)
    length = round(LONGEST / DT / EVERY) + 1
    squares = float(np.mean(velocities.astype(float) ** 2)) * len(start[0]) / (len(start[0]) - 1)
    return autocorrelation(velocities, length), autocorrelation(waves, length), MASS * squares / BOLTZMANN


def measure(make, states, time: float, seed: int) -> Found:
    """All runs of one dynamics."""
    results = [one_run(make, start, time, seed + k) for k, start in enumerate(states)]
    velocity, shear = (np.array([row[k] for row in results]) for k in (0, 1))
    times = np.arange(velocity.shape[1]) * DT * EVERY
    diffusion = cumulative_trapezoid(velocity, times, axis=1)[:, -1]
    shear = shear / shear[:, 0].mean()
    # a ratio of averages: the time integral over the value at 0; its error is that of the linearised ratio
    whole = np.trapezoid(shear, times, axis=1)
    rest = whole - whole.mean() * shear[:, 0]
    root = np.sqrt(len(states))
    return Found(
        times=times,
        velocity=velocity.mean(axis=0) / velocity[:, 0].mean(),
        shear=shear.mean(axis=0),
        shear_error=shear.std(axis=0, ddof=1) / root,
        shear_time=float(whole.mean()),
        shear_time_error=float(rest.std(ddof=1) / root),
        diffusion=float(diffusion.mean()),
        diffusion_error=float(diffusion.std(ddof=1) / root),
        temperature=float(np.mean([row[2] for row in results])),
    )


def compare(rate: float, runs: int, time: float, seed: int = 1) -> dict[str, Found]:
    """All three dynamics from the same states."""
    states = starts(runs, seed)
    gamma = gamma_for(rate, [x for x, _ in states])
    return {name: measure(make, states, time, 100 * seed) for name, make in integrators(rate, gamma).items()}


def picture(path: str, found: dict[str, Found]) -> None:
    """The autocorrelation functions of velocities and of shear waves."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.2), layout="constrained", dpi=150)
    for (name, one), colour in zip(found.items(), ("0.15", "#b3541e", "#1f5a99"), strict=True):
        style = "--" if name == DYNAMICS[0] else "-"
        axes[0].plot(one.times, one.velocity, color=colour, linestyle=style, linewidth=1.4, label=name)
        axes[1].plot(one.times, one.shear, color=colour, linestyle=style, linewidth=1.4)
        axes[1].fill_between(one.times, one.shear - one.shear_error, one.shear + one.shear_error, color=colour, alpha=0.2, linewidth=0)
    axes[0].set(xlabel="time [ps]", ylabel="velocity autocorrelation", xlim=(0, 1.2))
    axes[1].set(xlabel="time [ps]", ylabel="shear wave autocorrelation", xlim=(0, LONGEST))
    axes[0].legend(frameon=False)
    for axis in axes:
        axis.axhline(0, color="0.7", linewidth=0.8, zorder=0)
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main() -> None:
    """Run and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rate", type=float, default=0.5, help="rate of both thermostats, 1/ps")
    parser.add_argument("--runs", type=int, default=6, help="independent runs of each dynamics")
    parser.add_argument("--time", type=float, default=30.0, help="length of a run, ps")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--picture", help="file for the picture")
    options = parser.parse_args()
    found = compare(options.rate, options.runs, options.time, options.seed)
    for name, one in found.items():
        print(
            f"{name:18s} T = {one.temperature:.1f} K  D = {1e3 * one.diffusion:.3f}({1e3 * one.diffusion_error:.3f}) 10^-9 m^2/s  "
            f"shear wave {one.shear_time:.2f}({one.shear_time_error:.2f}) ps"
        )
    if options.picture:
        picture(options.picture, found)


if __name__ == "__main__":
    main()
