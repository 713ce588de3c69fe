"""Scores in words, and as a picture."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np

from ..io.pictures import finish_axis, new_figure, write_picture
from .quantities import QUANTITIES
from .runs import run_word
from .scoring import Judged, Score
from .suite import SuiteScene

#: What others are compared with: LAMMPS's schemes, at their own longest steps, timed here; the second where the first has no such step.
PEER, PEERS = "mvv", ("mvv", "shardlow")


def gain(score: Score) -> float:
    """CPU time of the first of ``PEERS`` that has a longest step over that of a score, both on this machine; NaN if one has none."""
    peer = next((word for word in PEERS if score.scene.scores.get(word, {}).get("limit")), None)
    if not peer or not score.limit or not np.isfinite(score.seconds):
        return np.nan
    return run_word(score.scene, peer, score.scene.scores[peer]["limit"], time=20.0, discard=2.0).seconds / score.seconds


def gains(scores: Sequence[Score]) -> dict[str, float]:
    """:func:`gain` of each scene."""
    return {score.scene.name: gain(score) for score in scores}


def in_words(scores: Sequence[Score], gained: Mapping[str, float], accepted: float) -> str:
    """A table: for each scene the longest step, what limits it, and the CPU time there."""
    heads = ("scene", f"dt, {accepted:.3g}", "limited by", "us per bead and unit", f"times as fast as {PEER} at 1 %")
    rows = []
    for score in scores:
        us = 1e6 * score.seconds / score.scene.scene.n_beads
        sign = "" if score.limited_by else "> "
        step = f"{sign}{score.limit:.3g}" if score.limit else f"< {score.runs[0].dt:.2g}"
        rows.append((score.scene.name, step, score.limited_by[:40] or "-", _number(us), _number(gained[score.scene.name])))
    known = [value for value in gained.values() if np.isfinite(value)]
    if known:
        rows.append((f"geometric mean of {len(known)}", "", "", "", _number(float(np.exp(np.mean(np.log(known)))))))
    return _table(heads, rows)


def errors_in_words(its: SuiteScene, run: Judged, values: np.ndarray) -> str:
    """A table of one run: each quantity with its reference and error."""
    if run.reason:
        return f"{its.name} at {run.dt:g} breaks down: {run.reason}"
    rows = [
        (name, QUANTITIES[name][0], f"{value:.5g}", f"{reference:.5g}", f"{100 * error:+.2f} ({100 * sem:.2f}) %")
        for name, value, reference, error, sem in zip(its.quantities, values, its.reference, run.errors, run.sems, strict=True)
    ]
    return _table(("quantity", "", "value", "reference", "error"), rows)


def _number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "-"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[k]) for row in (heads, *rows)) for k in range(len(heads))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in (heads, *rows))


def score_picture(path: str | os.PathLike, name: str, scores: Sequence[Score], gained: Mapping[str, float]) -> None:
    """Draw how many times as fast as ``mvv`` a method is in each scene, each at its own longest step, with the quantity that limits it.

    Parameters
    ----------
    path : path-like
        PNG file to write.
    name : str
        Of the method.
    scores : sequence of Score
    gained : mapping of str to float
        What :func:`gains` returns.
    """
    figure = new_figure(6.0, 0.9 + 0.3 * len(scores))
    axis = figure.subplots()
    labels = [f"{score.scene.name}, {score.limit:.2g}" for score in reversed(scores)]
    values = [gained[score.scene.name] for score in reversed(scores)]
    axis.barh(range(len(labels)), np.nan_to_num(values), color="#1f5a99", height=0.6)
    for place, score in enumerate(reversed(scores)):
        axis.text(np.nan_to_num(values[place]), place, f" {score.limited_by[:24]}", va="center", fontsize=9)
    axis.axvline(1.0, color="0.6", linewidth=0.8)
    finish_axis(axis, "", legend=False)
    axis.set_yticks(range(len(labels)), labels)
    axis.set(xlabel=f"{name}: times as fast as {PEER} at 1 %", xlim=(0.0, 1.25 * max([1.0, *np.nan_to_num(values)])))
    write_picture(path, figure)
