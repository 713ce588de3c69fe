"""Heat conduction in an eDPD fluid: a source in the upper half of a box, a sink in the lower, compared with the analytic solution.

With sources +s for 0 < y < L and -s for -L < y < 0, switched on at t = 0, the temperature of a fluid of diffusivity D is

    T(y, t) = 1 + sum over odd n of (4 s/(n pi)) (1 - exp(-D k^2 t))/(D k^2) sin(k y),   k = n pi/L,

and the continuum limit of the beads' heat exchange gives D = 2 pi rho C kappa rc^5/315.  The script averages the temperature of slices
over the second half of a run and fits D, and an offset, which is 0: pair updates conserve energy.  Slices of one run are correlated, so
the standard errors come from independent runs.  The step is four times that of scheme "mvv", whose heat makes the offset 0.004 (at this
strong friction; docs/howto/heat_species.md).

The formula is not exact: heat jumps between beads up to rc apart, which leaves a step of T where source and sink meet (lower picture; it
costs the fitted D about 1 %), and diffusing beads carry heat themselves (their D is 0.02).

    python examples/06_heat_conduction.py        # half a minute
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import matplotlib
import numpy as np
from openmm import unit
from scipy.optimize import curve_fit

import openmm_dpd as dpd

OUT = Path("out/06_heat_conduction")
EDGES, DENSITY, L = np.array([5.0, 20.0, 5.0]), 4.0, 10.0
A, GAMMA, EXPONENT, CUTOFF, KAPPA, CAPACITY = 18.75, 4.5, 0.41, 1.58, 1.41e-5, 1e5
SCHEME, SOURCE, DT, EQUILIBRATION, STEPS, EVERY, SLICES, RUNS = "middle", 0.01, 0.04, 50, 250, 5, 20, 4


def fluid(seed: int) -> dpd.Scene:
    """Beads at T = 1 everywhere; the source fills the upper half, the sink the lower."""
    beads = round(DENSITY * np.prod(EDGES))
    half = EDGES * [1, 0.5, 1]
    sources = [
        dpd.Source(dpd.Block((0, L, 0), (0, L, 0) + half), SOURCE),
        dpd.Source(dpd.Block((0, 0, 0), half), -SOURCE),
    ]
    table = {("W", "W"): dpd.EDPD(A=A, gamma=GAMMA, kappa=KAPPA, cutoff=CUTOFF, exponent=EXPONENT)}
    positions = np.random.default_rng(seed).random((beads, 3)) * EDGES
    internal = dpd.BeadTemperatures(1.0, CAPACITY)
    return dpd.Scene({"W": 1.0}, ["W"] * beads, positions, table, kT=1.0, box=EDGES, internal=internal, sources=sources)


def run(out: Path, seed: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Times since the heat was switched on, their mean profile over the second half of a run, and the mean temperature at its end."""
    built = dpd.build(fluid(seed), dt=DT, scheme=SCHEME, seed=seed)
    simulation = built.simulation()
    simulation.step(EQUILIBRATION)
    # the fluid is equilibrated: heat starts here
    dpd.write_fields(simulation.context, built.plan, theta=1.0)
    # reporters count steps from the start: their frames match the loop if EQUILIBRATION is a multiple of EVERY
    file = out / f"fields{seed}.npz"
    simulation.reporters.append(dpd.FieldReporter(file, EVERY, built))
    frames = []
    for _ in range(STEPS // EVERY):
        simulation.step(EVERY)
        positions = simulation.context.getState(positions=True).getPositions(asNumpy=True)
        frames.append(positions.value_in_unit(unit.nanometer)[:, 1])
    final = dpd.read_fields(simulation.context, built.plan)["theta"].mean()
    fields = dpd.load_fields(file)
    # y = 0, between sink and source, is the middle of the box; positions are unwrapped
    slices = (np.mod(frames, 2 * L) * SLICES / (2 * L)).astype(int) % SLICES
    late = slice(len(frames) // 2, None)
    pairs = zip(slices[late], fields["theta"][late], strict=True)
    rows = [np.bincount(s, temperatures, SLICES) / np.bincount(s, minlength=SLICES) for s, temperatures in pairs]
    return fields["time"][late] - EQUILIBRATION * DT, np.mean(rows, axis=0), float(final)


def solution(y: np.ndarray, diffusivity: float, offset: float, *, times: np.ndarray) -> np.ndarray:
    """The analytic profile averaged over slices and the same times: D has little effect early on, and half a frame changes it by 1 %."""
    width, profile = 2 * L / SLICES, np.full(len(y), 1.0 + offset)
    for n in range(1, 200, 2):
        k = n * np.pi / L
        rate = diffusivity * k * k
        profile += 4 * SOURCE / (n * np.pi) * np.mean(1 - np.exp(-rate * times)) / rate * np.sinc(k * width / (2 * np.pi)) * np.sin(k * y)
    return profile


def draw(path: Path, y: np.ndarray, profiles: np.ndarray, fit: np.ndarray, error: float, formula: float, times: np.ndarray) -> None:
    """Slices beside the fitted solution and the one with the formula's diffusivity; below, the residuals of the fit."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (upper, lower) = plt.subplots(
        2, 1, figsize=(6.4, 5.2), sharex=True, layout="constrained", dpi=150, gridspec_kw={"height_ratios": (3, 1)}
    )
    mean, errors = profiles.mean(axis=0), profiles.std(axis=0, ddof=1) / np.sqrt(len(profiles))
    theory, fine = partial(solution, times=times), np.linspace(-L, L, 401)
    for axis in (upper, lower):
        axis.axvspan(-L, 0, color="#e9f0f7", linewidth=0)
        axis.axvspan(0, L, color="#f9ece5", linewidth=0)
        axis.spines[["top", "right"]].set_visible(False)
    upper.plot(fine, theory(fine, *fit), color="0.2", linewidth=1.2, label=f"fit: D = {fit[0]:.3f} ± {error:.3f}")
    upper.plot(fine, theory(fine, formula, fit[1]), "--", color="#1f5a99", linewidth=1.2, label=f"continuum formula: D = {formula:.3f}")
    upper.errorbar(y, mean, errors, fmt="o", color="#b3541e", markersize=5, label="slices of the fluid")
    upper.legend(frameon=False, loc="upper left")
    upper.set(ylabel=f"temperature, mean over t = {times[0]:.1f} to {times[-1]:.1f}", xlim=(-L, L))
    upper.text(-L / 2, 1.0, f"sink, {-SOURCE:g}", color="#1f5a99", ha="center")
    upper.text(L / 2, 1.0, f"source, +{SOURCE:g}", color="#b3541e", ha="center")
    lower.axhline(0, color="0.2", linewidth=1.2)
    lower.plot(fine, 1e3 * (theory(fine, formula, fit[1]) - theory(fine, *fit)), "--", color="#1f5a99", linewidth=1.2)
    lower.errorbar(y, 1e3 * (mean - theory(y, *fit)), 1e3 * errors, fmt="o", color="#b3541e", markersize=4, capsize=2)
    lower.set(xlabel="y", ylabel="slices − fit, $10^{-3}$")
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """Run, fit, draw; diffusivity with its standard error over the runs, the formula's, the offset, and the rate of rise of the mean T.

    The rise is the difference between source and sink: there are more beads where it is cold.
    """
    out.mkdir(parents=True, exist_ok=True)
    y = (np.arange(SLICES) + 0.5) * 2 * L / SLICES - L
    times, profiles, finals = zip(*(run(out, seed) for seed in range(1, RUNS + 1)), strict=True)
    fits = np.array([curve_fit(partial(solution, times=times[0]), y, profile, p0=(1.0, 0.0))[0] for profile in profiles])
    fit, errors = fits.mean(axis=0), fits.std(axis=0, ddof=1) / np.sqrt(RUNS)
    formula = 2 * np.pi * DENSITY * CAPACITY * KAPPA * CUTOFF**5 / 315
    draw(out / "profile.png", y, np.array(profiles), fit, errors[0], formula, times[0])
    return {
        "D": float(fit[0]),
        "D_error": float(errors[0]),
        "D_formula": float(formula),
        "offset": float(fit[1]),
        "rise": float((np.mean(finals) - 1) / (STEPS * DT)),
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:10s} {value:.5f}")
    print(f"picture: {OUT / 'profile.png'}")
