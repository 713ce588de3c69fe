"""Independent numpy implementation of beads that bounce back from walls of any shape, one bead and one little stretch after the other."""

import numpy as np


def interpolated(distances: np.ndarray, edges: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(S,) distances at a point, from the eight points of the grid around it."""
    place = x / edges % 1.0 * distances.shape[1:]
    low = np.floor(place).astype(int)
    found = np.zeros(len(distances))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, place - low, 1 - place + low))
        found += weight * distances[(slice(None), *((low + corner) % distances.shape[1:]))]
    return found


def drifted(distances, edges, motion, x, v, mass: float, time: float, stretch: float):
    """Position, velocity and impulses (S, 2, 3) after a drift; the way is searched in stretches of this length, and each hit by halving."""
    x, v, left, taken = x.copy(), v.copy(), time, np.zeros((len(distances), 2, 3))
    bar = min(0.0, interpolated(distances, edges, x).min())
    for _ in range(8):
        way = left * v
        parts = np.linspace(0, 1, max(2, int(np.linalg.norm(way) / stretch) + 2))
        levels = [interpolated(distances, edges, x + p * way) for p in parts]
        beyond = next((k for k in range(1, len(parts)) if levels[k].min() <= bar), None)
        if beyond is None:
            return x + way, v, taken
        low, high = parts[beyond - 1], parts[beyond]
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if interpolated(distances, edges, x + middle * way).min() <= bar else (middle, high)
        wall = int(np.argmin(interpolated(distances, edges, x + high * way)))
        x, left = x + low * way, left * (1 - low)
        arm = x - motion[wall, 6:]
        arm -= edges * np.rint(arm / edges)
        new = 2 * (motion[wall, :3] + np.cross(motion[wall, 3:6], arm)) - v
        taken[wall] += [mass * (v - new), np.cross(arm, mass * (v - new))]
        v = new
    return x, v, taken
