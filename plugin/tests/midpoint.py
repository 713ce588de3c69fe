"""Pair updates of all pairs at once in numpy, by a dense solve, and whole steps with them."""

from __future__ import annotations

from functools import partial

import numpy as np
import oracle
from scenes import _fill, factor_of, oracle_params

import openmm_dpd as dpd
from openmm_dpd.kernels.noise import call_key, noise_key
from openmm_dpd.model.schemes import SWEEPS


def noise_of_piece(n: int, seed: int, counter: int, kT: float, piece: int, layer: int = 0):
    """The numbers of one piece of a sweep in a table of terms; the first piece has those of the host."""
    bits = int(np.float64(kT).view(np.uint64))
    table = np.full((n, n, 4), np.nan)
    key = noise_key(seed, counter, layer, kT) if layer else call_key(seed, counter, 0, bits, piece)
    _fill(key if layer or piece else noise_key(seed, counter, 0, kT), table)
    return lambda i, j, k: table[i, j, k]


def impulses(scene: dpd.Scene, x, v, h: float, kT: float, *noises) -> np.ndarray:
    """Forces (N, 3) whose impulse over h takes velocities v to those after an implicit midpoint step, with the noise of each table."""
    factor, n, all_params = (
        factor_of(scene) if len(scene.bond_pairs) else None,
        len(x),
        map(partial(oracle_params, scene), range(len(noises))),
    )
    friction, random = np.zeros((n, 3, n, 3)), np.zeros((n, 3))
    pairs = ((params, noise, pair) for params, noise in zip(all_params, noises, strict=True) for pair in listed(x, scene, params))
    for params, noise, (i, j, r, e) in pairs:
        a, b = scene.type_ids[i], scene.type_ids[j]
        f = 1.0 if factor is None else factor(i, j)
        w, along = 1 - r / params.cutoff[a, b], np.outer(e, e)
        g, g_perp = f * params.gamma[a, b] * w ** (2 * params.s[a, b]), f * params.gamma_perp[a, b] * w ** (2 * params.s_perp[a, b])
        block = g * along + g_perp * (np.eye(3) - along)
        for k, m, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            friction[k, :, m, :] += sign * block
        z = np.array([noise(i, j, k) for k in range(4)])
        kick = np.sqrt(2 * kT * g / h) * z[0] * e + np.sqrt(2 * kT * g_perp / h) * (z[1:] - along @ z[1:])
        random[i] += kick
        random[j] -= kick
    matrix = friction.reshape(3 * n, 3 * n)
    inverse = np.repeat(np.where(scene.immobile, 0.0, 1 / scene.bead_masses), 3)
    start = v.ravel() + 0.5 * h * inverse * random.ravel()
    between = np.linalg.solve(np.eye(3 * n) + 0.5 * h * inverse[:, None] * matrix, start)
    return (random.ravel() - matrix @ between).reshape(n, 3)


def listed(x, scene: dpd.Scene, params):
    """Pairs within the cutoffs of a table."""
    return zip(*oracle.pair_list(x, scene.type_ids, params, scene.box), strict=True)


def pieces_of(scene: dpd.Scene, h: float) -> int:
    """In how many midpoint steps an exact update over h is carried out: friction times step over mass is 2.1 at most in each."""
    params = oracle_params(scene)
    rate = max(params.gamma.max(), params.gamma_perp.max()) / scene.bead_masses[~scene.immobile].min()
    return max(1, int(np.ceil(rate * h / 2.1)))


def step(scene: dpd.Scene, word, x, v, dt: float, kT: float, seed: int, counter: int):
    """Positions, velocities and counter after one step of a word."""
    params, factor = oracle_params(scene), factor_of(scene) if len(scene.bond_pairs) else None
    inverse = np.where(scene.immobile, 0.0, 1 / scene.bead_masses)[:, None]
    for letter, part in word:
        h = float(part) * dt
        if letter == "A":
            x = x + h * np.where(inverse > 0, v, 0)
        elif letter == "B":
            v = v + h * inverse * oracle.conservative(x, scene.type_ids, params, scene.box, factor).forces
        else:
            assert letter in SWEEPS
            counter += 1
            pieces = pieces_of(scene, h) if letter == "O" else 1
            for piece in range(pieces):
                noise = noise_of_piece(len(x), seed, counter, kT, piece)
                v = v + h / pieces * inverse * impulses(scene, x, v, h / pieces, kT, noise)
    return x, v, counter
