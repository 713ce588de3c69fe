"""What a scheme does to a harmonic vibration: known exactly from a two by two matrix, for every word."""

from fractions import Fraction
from functools import lru_cache

import numpy as np

from ..model.schemes import SWEEPS, Scheme

#: Friction of the mode times the step, for the sweep: what a symmetric word does to a mode does not depend on it.
_FRICTION = 0.02
#: omega dt at which errors are tabulated; no word with ten forces a step is stable beyond.
_GRID = np.linspace(0.0, 20.0, 20001)[1:]


def mode_errors(scheme: Scheme, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r"""Relative errors of the temperatures of a harmonic mode.

    A step maps the state (omega x, v) by a matrix M and adds noise with the covariance C, both products of what the letters do: A adds
    ``part theta v`` to the first, B takes ``part theta omega x`` from the second, O and S multiply the second by q and add noise with the
    variance 1 - q^2.  What is sampled has the covariance S = M S M^T + C, so that S_00 - 1 is the error of the configurational
    temperature and S_11 - 1 that of the kinetic one.  Schemes that are no words count as velocity Verlet with a sweep behind it.

    Parameters
    ----------
    scheme : Scheme
    theta : (n,) array
        omega dt, > 0.

    Returns
    -------
    configurational, kinetic : (n,) arrays
        Infinite where the step is unstable.
    """
    letters = [*scheme.motion]
    if not any(letter in SWEEPS for letter, _ in letters):
        letters.append((SWEEPS[0], Fraction(1)))
    total, spread = np.tile(np.eye(2), (len(theta), 1, 1)), np.zeros((len(theta), 2, 2))
    for letter, part in letters:
        one, noise = np.tile(np.eye(2), (len(theta), 1, 1)), np.zeros((2, 2))
        if letter == "A":
            one[:, 0, 1] = float(part) * theta
        elif letter == "B":
            one[:, 1, 0] = -float(part) * theta
        else:
            x = _FRICTION * float(part)
            q = np.exp(-x) if letter == "O" else (1 - x / 2) / (1 + x / 2)
            one[:, 1, 1], noise[1, 1] = q, 1 - q * q
        total, spread = one @ total, one @ spread @ one.transpose(0, 2, 1) + noise
    stable = np.abs(np.linalg.eigvals(total)).max(axis=1) < 1 - 1e-9
    twice = np.einsum("nij,nkl->nikjl", total[stable], total[stable]).reshape(-1, 4, 4)
    found = np.full((len(theta), 4), np.inf)
    found[stable] = np.linalg.solve(np.eye(4) - twice, spread[stable].reshape(-1, 4, 1))[:, :, 0]
    return found[:, 0] - 1, found[:, 3] - 1


@lru_cache
def _table(scheme: Scheme) -> tuple[np.ndarray, np.ndarray, float]:
    """Errors on the grid up to the first unstable omega dt, and that."""
    conf, kin = mode_errors(scheme, _GRID)
    unstable = np.flatnonzero(~np.isfinite(conf))
    end = unstable[0] if len(unstable) else len(_GRID)
    return np.concatenate([[0.0], conf[:end]]), np.concatenate([[0.0], kin[:end]]), float(_GRID[end - 1])


def largest_stable(scheme: Scheme) -> float:
    """omega dt below which a scheme is stable."""
    return _table(scheme)[2]


def exact_for_springs(scheme: Scheme) -> bool:
    """Whether a scheme samples harmonic modes without an error, as far as it is stable."""
    conf, kin, _ = _table(scheme)
    return bool(np.abs(conf).max() < 1e-6 and np.abs(kin).max() < 1e-6)


def tabulated_errors(scheme: Scheme, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """:func:`mode_errors`, interpolated from a table: for very many values."""
    conf, kin, end = _table(scheme)
    at = np.concatenate([[0.0], _GRID])[: len(conf)]
    return np.where(theta > end, np.inf, np.interp(theta, at, conf)), np.where(theta > end, np.inf, np.interp(theta, at, kin))
