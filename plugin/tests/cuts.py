"""Runs that have to end with the same bits, however they are cut."""

from collections.abc import Callable
from pathlib import Path
from typing import Any


def ends_of_all_ways(
    run: Callable[[], Any], end: Callable[[Any], Any], folder: Path, loaded: Callable[[Any], None] = lambda _: None
) -> list:
    """What ``end`` finds of simulations after 20 steps: at once, in pieces with a look in between, from a checkpoint, from a saved state."""
    whole, cut, other = (run() for _ in range(3))
    whole.step(20)
    cut.step(7)
    cut.context.getState(energy=True, forces=True)
    cut.step(3)
    cut.saveCheckpoint(str(folder / "checkpoint"))
    cut.saveState(str(folder / "state.xml"))
    cut.step(10)
    ends = [end(whole), end(cut)]
    other.loadCheckpoint(str(folder / "checkpoint"))
    cut.loadState(str(folder / "state.xml"))
    for simulation in (other, cut):
        loaded(simulation)
        simulation.step(10)
        ends.append(end(simulation))
    return ends
