"""Errors against the reference at a tiny step, and the step at which an error reaches a bound."""

from __future__ import annotations

import numpy as np

from openmm_dpd.score.scoring import reached, seen

from .sampling import BINS

#: Quantities whose error is charted, with how they are called.
MEASURES = {
    "T_conf": "configurational temperature",
    "T_kin": "kinetic temperature",
    "U": "potential energy, as the temperature that would change it so",
    "P": "pressure",
    "g": "g(r): norm of the difference over the norm",
    "D": "diffusion coefficient",
    "drift": "drift of the energy, relative, per ps",
}


def pooled(results: list[dict], name: str) -> tuple[float, float] | None:
    """Mean of several runs' averages, weighted by their errors."""
    pairs = [r[name] for r in results if r.get(name) and r[name][1]]
    if not pairs:
        return None
    mean, sem = np.array(pairs).T
    weight = 1 / sem**2
    return float((weight * mean).sum() / weight.sum()), float(weight.sum() ** -0.5)


def reference(results: list[dict]) -> dict:
    """What the runs at a tiny step say, together: {name: (mean, standard error)}, and the blocks of g(r)."""
    good = [r for r in results if "failed" not in r]
    found = {name: pooled(good, name) for name in ("U", "P", "D")}
    blocks = [block for r in good for block in r.get("g", ())]
    return {name: pair for name, pair in found.items() if pair} | ({"g": blocks} if blocks else {})


def heat_capacity(cold: dict, hot: dict) -> tuple[float, float]:
    """dU/dkT per bead from two runs, with its error."""
    change = hot["kT"] - cold["kT"]
    return (hot["U"][0] - cold["U"][0]) / change, (hot["U"][1] ** 2 + cold["U"][1] ** 2) ** 0.5 / change


def errors(result: dict, ref: dict, capacity: tuple[float, float] | None, conserves: bool) -> dict[str, list[float]]:
    """Relative errors of one run, {measure: [error, standard error]}."""
    if "failed" in result:
        return {}
    found: dict[str, list[float]] = {}
    target = result["theta"] if conserves else [result["kT"], 0.0]
    for name in ("T_conf", "T_kin"):
        if result.get(name):
            value, sem = result[name]
            found[name] = [value / target[0] - 1, float(np.hypot(sem or 0, target[1] or 0)) / target[0]]
    if conserves:
        if result.get("drift") and result["drift"][1]:
            found["drift"] = list(result["drift"])
        return found
    if capacity and "U" in ref:
        scale = capacity[0] * result["kT"]
        found["U"] = [(result["U"][0] - ref["U"][0]) / scale, float(np.hypot(result["U"][1] or 0, ref["U"][1])) / scale]
    for name in ("P", "D"):
        if result.get(name) and name in ref:
            found[name] = [result[name][0] / ref[name][0] - 1, float(np.hypot(result[name][1] or 0, ref[name][1])) / ref[name][0]]
    if result.get("g") and "g" in ref:
        found["g"] = list(norm(np.array(result["g"]), np.array(ref["g"])))
    return found


def norm(blocks: np.ndarray, ref: np.ndarray) -> tuple[float, float]:
    """|g - g_ref|/|g_ref| with the weight r^2, freed of what noise adds to a norm, and a jackknife error.

    The noise of the means adds the sum of their variances to the square of the norm; it is taken off, and what is negative then is 0.
    """
    weight = (np.arange(BINS) + 0.5) ** 2

    def value(a: np.ndarray, b: np.ndarray) -> float:
        noise = a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b)
        base = (weight * b.mean(axis=0) ** 2).sum()
        return float((weight * ((a.mean(axis=0) - b.mean(axis=0)) ** 2 - noise)).sum() / base)

    square = value(blocks, ref)
    left_out = [value(np.delete(blocks, k, axis=0), ref) for k in range(len(blocks))]
    sem = ((len(blocks) - 1) / len(blocks) * np.sum((np.array(left_out) - np.mean(left_out)) ** 2)) ** 0.5
    size = max(square, 0.0) ** 0.5
    # the error of a root: sem/(2 size), and sem^(1/2) where the square is lost in its noise
    return size, float(min(sem**0.5, sem / (2 * size)) if size > 0 else sem**0.5)


def crossing(dts: list[float], values: list[list[float]], bound: float, draws: int = 400) -> dict:
    """The step at which |error| first reaches a bound, by straight lines in log-log, with the spread that the errors' errors give it.

    Returns
    -------
    dict
        ``dt`` and ``sem``, or ``at_least`` (never reached up to there) or ``at_most`` (reached at the smallest step already).
    """
    order = np.argsort(dts)
    x, pairs = np.array(dts)[order], np.array(values)[order]
    best = _first(x, seen(pairs[:, 0], pairs[:, 1], bound), bound)
    if not best:
        return {"at_least": float(x[-1])} if best is None else {"at_most": float(x[0])}
    rng = np.random.default_rng(0)
    found = [_first(x, seen(rng.normal(pairs[:, 0], pairs[:, 1]), pairs[:, 1], bound), bound) for _ in range(draws)]
    # a draw that never reaches the bound counts as its last step, one that always exceeds it as the first
    ends = [x[-1] if f is None else f or x[0] for f in found]
    return {"dt": best, "sem": float(best * np.std(np.log(ends)))}


def _first(x: np.ndarray, size: np.ndarray, bound: float) -> float | None:
    """The step of the first crossing from below, whatever longer steps do; None if there is none, 0 if it lies before the first."""
    over = size > bound
    if not over.any():
        return None
    k = int(np.argmax(over))
    return reached(x[k - 1 :], size[k - 1 :], bound, 1e-2 * bound) if k else 0.0
