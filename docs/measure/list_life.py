"""For how many steps a list of pairs with a skin would serve: until the fastest bead has moved half the skin.

The numbers of docs/atlas.md ("Where the time goes"), standard fluid with 10,000 beads.

    python docs/measure/list_life.py
"""

from __future__ import annotations

import numpy as np

import openmm_dpd as dpd

RUNS = (("mvv", 0.01), ("mvv", 0.02), ("aboba", 0.05), ("bababo", 0.12))
SKINS = (0.3, 0.65)


def standard_fluid(beads: int = 10_000) -> dpd.Scene:
    """Density 3, repulsion 25, friction 4.5, on random points."""
    edge = (beads / 3) ** (1 / 3)
    x = np.random.default_rng(1).random((beads, 3)) * edge
    return dpd.Scene({"W": 1.0}, ["W"] * beads, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[edge] * 3)


def life(paths: np.ndarray, skin: float, begin: int) -> int:
    """Steps that a list made at step ``begin`` serves."""
    moved = np.sqrt(((paths[begin + 1 :] - paths[begin]) ** 2).sum(axis=2).max(axis=1))
    return 1 + int(np.argmax(moved >= 0.5 * skin))


def main() -> None:
    """Print a line per scheme and step."""
    scene = standard_fluid()
    for scheme, dt in RUNS:
        simulation = dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=1).simulation()
        simulation.step(round(2 / dt))
        paths = []
        for _ in range(40):
            paths.append(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value.copy())
            simulation.step(1)
        steps = {skin: np.mean([life(np.array(paths), skin, begin) for begin in range(10)]) for skin in SKINS}
        print(f"{scheme}, dt {dt:g}: " + ", ".join(f"skin {skin:g}: {count:.1f} steps" for skin, count in steps.items()))


if __name__ == "__main__":
    main()
