"""A tensionless bilayer, its height fluctuations, and a vesicle.

A barostat with the surface tension 0 lets the area of the box follow the bilayer at constant volume.  The undulations of the bilayer
follow Helfrich's theory, A <|h_q|^2> = kT/(kappa q^4), which gives the bending modulus kappa; this run is too short for better than ten
per cent (``docs/measure/bending_modulus.py`` has a longer one).  Then a vesicle is built with the area per lipid and the thickness of the
flat bilayer, and relaxed; the picture shows a slice of it.

The lipid is that of ``09_lipid_bilayer.py``.

    python examples/14_tensionless_bilayer.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import mdtraj
import numpy as np
from openmm import app, unit

import openmm_dpd as dpd
from openmm_dpd.analysis import BendingModulus, HeightSpectrum, area_per_lipid, bending_modulus, bilayer_thickness, height_spectrum
from openmm_dpd.molecules import Bilayer, Vesicle, grafmueller_2009, pack, relax
from openmm_dpd.trajectory import load, load_topology

OUT = Path("out/14_tensionless_bilayer")
BOX, LIPIDS = (11.0, 11.0, 9.0), 174
DT, STEPS, EVERY, INTERVAL = 0.04, 9000, 25, 10
BEGIN = 0.2  # averages start after this fraction of the run
Q_MAX, SEED = 1.2, 1
RADIUS, MEMBRANE, VESICLE_BOX, VESICLE_STEPS = 4.0, 4.6, 13.5, 1500

MODEL = grafmueller_2009()


def flat(out: Path) -> mdtraj.Trajectory:
    """The tensionless bilayer at constant volume."""
    mixture = pack({MODEL.molecule: Bilayer(LIPIDS)}, solvent="W", density=MODEL.density, box=BOX, seed=SEED)
    built = dpd.build(relax(mixture.scene(pairs=MODEL.pairs(), kT=1.0)), dt=DT, scheme="middle", seed=SEED)
    dpd.add_barostat(built, surface_tension=0, zmode="constant volume", interval=INTERVAL)
    simulation = built.simulation()
    mixture.write_psf(out / "bilayer.psf")
    simulation.reporters.append(app.DCDReporter(str(out / "bilayer.dcd"), EVERY))
    simulation.step(STEPS)
    simulation.reporters.clear()  # closes the file
    trajectory = load(out / "bilayer.dcd", load_topology(out / "bilayer.psf"))
    return trajectory[int(BEGIN * len(trajectory)) :]


def vesicle(area: float) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Beads of a vesicle by their types, from its middle, as packed and after a short run."""
    shell = Vesicle(radius=RADIUS, area_per_lipid=area, thickness=MEMBRANE)
    mixture = pack({MODEL.molecule: shell}, solvent="W", density=MODEL.density, box=[VESICLE_BOX] * 3, seed=SEED)
    simulation = dpd.build(relax(mixture.scene(pairs=MODEL.pairs(), kT=1.0)), dt=DT, scheme="middle", seed=SEED).simulation()
    simulation.step(VESICLE_STEPS)
    after = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    lipids, types = mixture.beads(MODEL.molecule), np.array(mixture.types)

    def by_type(x: np.ndarray) -> dict[str, np.ndarray]:
        x = x - x[lipids].mean(axis=(0, 1))
        x -= VESICLE_BOX * np.round(x / VESICLE_BOX)
        return {name: x[types == name] for name in ("W", "T", "H")}

    return by_type(mixture.positions), by_type(np.array(after))


def picture(path: Path, trajectory: mdtraj.Trajectory, spectrum: HeightSpectrum, fit: BendingModulus, beads: dict[str, np.ndarray]) -> None:
    """The area over time, the spectrum with its fit, and a slice of the vesicle."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullFormatter

    figure, axes = plt.subplots(1, 3, figsize=(11.0, 3.6), layout="constrained", dpi=150)
    area = 2 * np.prod(trajectory.unitcell_lengths[:, :2], axis=1) / LIPIDS
    axes[0].plot(DT * EVERY * np.arange(len(area)), area, color="#1f5a99", lw=0.8)
    axes[0].set(xlabel="time", ylabel="area per lipid")
    curve, q = spectrum.curve, np.geomspace(spectrum.q[0] / 1.1, 1.1 * spectrum.q[-1], 50)
    axes[1].errorbar(curve.x, curve.y, curve.sem, fmt="o", ms=4, color="#1f5a99")
    axes[1].plot(q, fit(q), color="#c9a227", label=rf"$\kappa$ = {fit.kappa.mean:.1f}({fit.kappa.sem:.1f}) kT")
    axes[1].set(xscale="log", yscale="log", xlabel="q", ylabel=r"$A\,\langle|h_q|^2\rangle$")
    axes[1].yaxis.set_minor_formatter(NullFormatter())
    axes[1].legend(frameon=False)
    for name, colour in (("W", "#cfe2ef"), ("T", "#c9a227"), ("H", "#1f5a99")):
        near = np.abs(beads[name][:, 1]) < 0.75
        axes[2].scatter(*beads[name][near][:, [0, 2]].T, s=7, color=colour, linewidths=0)
    half = VESICLE_BOX / 2
    axes[2].set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xticks=[], yticks=[], title="a slice of the vesicle")
    for axis in axes[:2]:
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
    plt.close(figure)


def main(out: Path = OUT) -> dict[str, float]:
    """Run, analyse, draw."""
    out.mkdir(parents=True, exist_ok=True)
    trajectory = flat(out)
    area, thickness = area_per_lipid(trajectory, "H"), bilayer_thickness(trajectory, "H", "T")
    spectrum = height_spectrum(trajectory, "H", "T", q_max=Q_MAX)
    fit = bending_modulus(spectrum, kT=1.0, tension=0)
    packed, beads = vesicle(area.mean)
    picture(out / "membranes.png", trajectory, spectrum, fit, beads)
    inside = [np.sum(np.linalg.norm(x["W"], axis=1) < RADIUS - 0.5) for x in (packed, beads)]
    return {
        "area_per_lipid": area.mean,
        "area_per_lipid_error": area.sem or 0.0,
        "thickness": thickness.mean,
        "bending_modulus": fit.kappa.mean,
        "bending_modulus_error": fit.kappa.sem or 0.0,
        "water_packed_inside": float(inside[0]),
        "water_inside": float(inside[1]),
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:26s} {value:.3f}")
    print(f"picture: {OUT / 'membranes.png'}")
