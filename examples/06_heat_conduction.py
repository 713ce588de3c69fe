"""Heat conduction in an eDPD fluid: a source in the upper half of a box, a sink in the lower, and the profile beside the analytic solution.

With sources +s for 0 < y < L and -s for -L < y < 0, switched on at t = 0, the temperature of a fluid of diffusivity D is

    T(y, t) = 1 + sum over odd n of (4 s/(n pi)) (1 - exp(-D k^2 t))/(D k^2) sin(k y),   k = n pi/L,

and the continuum limit of the beads' heat exchange gives D = 2 pi rho C kappa rc^5/315.  The script averages the temperature of slices, fits
D (and an offset, since velocity Verlet heats a fluid with so much friction a little), and draws both.

    python examples/06_heat_conduction.py        # about a minute
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from scipy.optimize import curve_fit

import openmm_dpd as dpd

OUT = Path("out/06_heat_conduction")
EDGES, DENSITY, L = np.array([6.0, 20.0, 6.0]), 4.0, 10.0
A, GAMMA, EXPONENT, CUTOFF, KAPPA, CAPACITY = 18.75, 4.5, 0.41, 1.58, 1.41e-5, 1e5
SOURCE, DT, EQUILIBRATION, STEPS, EVERY, SLICES = 0.01, 0.01, 300, 500, 5, 20


def fluid(beads: int) -> dpd.Scene:
    """Beads at T = 1 everywhere; the source fills the upper half, the sink the lower."""
    half = EDGES * [1, 0.5, 1]
    sources = [
        dpd.Source(dpd.Block((0, L, 0), (0, L, 0) + half), SOURCE),
        dpd.Source(dpd.Block((0, 0, 0), half), -SOURCE),
    ]
    table = {("W", "W"): dpd.EDPD(A=A, gamma=GAMMA, kappa=KAPPA, cutoff=CUTOFF, exponent=EXPONENT)}
    positions = np.random.default_rng(1).random((beads, 3)) * EDGES
    internal = dpd.BeadTemperatures(1.0, CAPACITY)
    return dpd.Scene({"W": 1.0}, ["W"] * beads, positions, table, kT=1.0, box=EDGES, internal=internal, sources=sources)


def run(out: Path) -> np.ndarray:
    """Temperature of each slice over the second half of the run."""
    built = dpd.build(fluid(int(DENSITY * np.prod(EDGES))), dt=DT, scheme="mvv", seed=3)
    simulation = built.simulation()
    simulation.step(EQUILIBRATION)
    # the fluid has found its structure: heat starts from here
    dpd.write_fields(simulation.context, built.plan, temperature=1.0)
    simulation.reporters.append(dpd.FieldReporter(out / "fields.npz", EVERY, built))
    frames = []
    for _ in range(STEPS // EVERY):
        simulation.step(EVERY)
        frames.append(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value[:, 1])
    temperature = dpd.load_fields(out / "fields.npz")["temperature"]
    # y = 0 is in the middle of the box, between sink and source
    slices = (np.mod(frames, 2 * L) * SLICES / (2 * L)).astype(int)
    late = slice(len(frames) // 2, None)
    rows = [[t[s == k].mean() for k in range(SLICES)] for s, t in zip(slices[late], temperature[late], strict=True)]
    return np.mean(rows, axis=0)


def solution(y: np.ndarray, diffusivity: float, offset: float) -> np.ndarray:
    """The analytic profile, averaged over slices and over the second half of the time."""
    end, width = STEPS * DT, 2 * L / SLICES
    begin, profile = end / 2, np.full(len(y), 1.0 + offset)
    for n in range(1, 200, 2):
        k = n * np.pi / L
        rate = diffusivity * k * k
        decay = (np.exp(-rate * begin) - np.exp(-rate * end)) / (rate * (end - begin))
        profile += 4 * SOURCE / (n * np.pi) * (1 - decay) / rate * np.sinc(k * width / (2 * np.pi)) * np.sin(k * y)
    return profile


def draw(path: Path, y: np.ndarray, profile: np.ndarray, fit: np.ndarray, formula: float) -> None:
    """Slices, fitted solution and the solution with the formula's diffusivity."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    fine = np.linspace(-L, L, 401)
    axes.axvspan(-L, 0, color="tab:blue", alpha=0.08, lw=0)
    axes.axvspan(0, L, color="tab:red", alpha=0.08, lw=0)
    axes.plot(fine, solution(fine, *fit), color="black", label=f"fit: D = {fit[0]:.3f}")
    axes.plot(fine, solution(fine, formula, fit[1]), "--", color="grey", label=f"continuum formula: D = {formula:.3f}")
    axes.plot(y, profile, "o", color="tab:orange", label="slices of the fluid")
    axes.set(xlabel="y", ylabel="T", xlim=(-L, L), title=f"sink and source of {SOURCE:g}, t = {STEPS * DT / 2:g} to {STEPS * DT:g}")
    axes.legend()
    figure.savefig(path, dpi=150)


def main(out: Path = OUT) -> dict[str, float]:
    """Run, fit, draw; the fitted diffusivity, its error and the formula's."""
    out.mkdir(parents=True, exist_ok=True)
    y = (np.arange(SLICES) + 0.5) * 2 * L / SLICES - L
    profile = run(out)
    fit, covariance = curve_fit(solution, y, profile, p0=(1.0, 0.0))
    formula = 2 * np.pi * DENSITY * CAPACITY * KAPPA * CUTOFF**5 / 315
    draw(out / "profile.png", y, profile, fit, formula)
    found = {"D": fit[0], "D_error": covariance[0, 0] ** 0.5, "D_formula": formula, "offset": fit[1]}
    print("D = {D:.3f}({D_error:.3f}), continuum formula {D_formula:.3f}; offset {offset:.4f}".format(**found))
    return found


if __name__ == "__main__":
    main()
