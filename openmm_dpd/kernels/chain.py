"""Chains of Nose-Hoover thermostats (Martyna et al., Mol. Phys. 87, 1117 (1996)), as arrays of numbers."""

import numpy as np


def masses(n: int, kT: float, damp: float, degrees: float) -> np.ndarray:
    """Masses (n,) of the thermostats of so many ``degrees`` of freedom, with a time of relaxation ``damp``."""
    return kT * damp**2 * np.array([degrees, *[1.0] * (n - 1)])


def pushes(mass: np.ndarray, rate: np.ndarray, kT: float) -> np.ndarray:
    """Accelerations (n - 1,) of all thermostats but the first by the one before each."""
    return (mass[:-1] * rate[:-1] ** 2 - kT) / mass[1:]


def half_step(
    numbers: np.ndarray,
    dt: float,
    kT: float,
    damp: float,
    degrees: float,
    twice: float,
    loops: int,
    drag: float,
    heavy: float | None = None,
) -> float:
    """Move positions, velocities and accelerations of the thermostats (3 n numbers, which change) by half a step.

    ``twice`` is twice the kinetic energy, kJ/mol, of what is thermostatted; returns the factor of its velocities.  ``heavy``
    are the degrees of freedom that the mass of the first thermostat is made for, by default all.
    """
    eta, rate, push = numbers.reshape(3, -1)
    last, mass = len(eta) - 1, masses(len(eta), kT, damp, degrees if heavy is None else heavy)
    quarter, slower, factor = 0.25 * dt / loops, 1.0 - dt * drag / damp / loops, 1.0
    push[0] = (twice - degrees * kT) / mass[0]

    def kick(k: int, slower: float) -> None:
        slows = np.exp(-0.5 * quarter * rate[k + 1]) if k < last else 1.0
        rate[k] = (rate[k] * slows + push[k] * quarter) * slower * slows

    for _ in range(loops):
        for k in range(last, -1, -1):
            kick(k, slower)
        scale = np.exp(-2.0 * quarter * rate[0])
        factor, twice = factor * scale, twice * scale**2
        eta += 2.0 * quarter * rate
        push[0] = (twice - degrees * kT) / mass[0]
        for k in range(last + 1):
            if k:
                push[k] = pushes(mass[k - 1 : k + 1], rate[k - 1 : k + 1], kT)[0]
            kick(k, 1.0)
    return float(factor)
