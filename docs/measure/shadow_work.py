"""Does the shadow work of kicks and drifts predict the errors of a step?  Errors of temperatures and energy beside it, for words and steps.

    python docs/measure/shadow_work.py            # the table of docs/schemes.md (an hour on one core)
    python docs/measure/shadow_work.py --time 20 --scenes 1

Fluids of 648 beads (375 many-body beads), 60 units of time.  Each row has the errors of the kinetic temperature, the configurational
temperature and the potential energy (against `bababo` at a step of 0.02), the mean and the variance of the shadow work per bead and step, and
the error of the kinetic temperature that the mean predicts: the power at which the step heats the fluid over the rate at which friction
cools it, sum over pairs of gamma w^2 (1/m_i + 1/m_j) per bead.
"""

from __future__ import annotations

import argparse

import numpy as np
import openmm
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.base.geometry import minimum_images
from openmm_dpd.measure import Observer, ShadowWorkReporter
from openmm_dpd.stats import block_average, ratio_average

STEPS = {"shardlow": (0.02, 0.04), "aboba": (0.04, 0.08), "middle": (0.04, 0.08), "bababo": (0.1, 0.14), "bab3": (0.15, 0.2, 0.25)}
EDGE, EVERY, WAIT = 6.0, 0.3, 10.0


def scenes() -> dict[str, tuple[dpd.Scene, dict]]:
    """Scenes with the friction of each pair of types."""
    rng = np.random.default_rng(1)

    def fluid(density, terms, share=1.0, masses=(1.0, 1.0), edge=EDGE, **more):
        n = round(density * edge**3)
        types = ["W"] * round(share * n) + ["S"] * (n - round(share * n))
        names = dict(zip("WS", masses, strict=True)) if share < 1 else {"W": masses[0]}
        x = rng.random((n, 3)) * edge
        if "bonds" in more:
            for k in range(1, 10):
                x[k::10] = x[k - 1 :: 10] + rng.normal(size=x[k::10].shape) * 0.3
        gammas = {pair: getattr(term, "gamma", 0.0) for pair, term in terms.items()}
        return dpd.Scene(names, types, x, terms, kT=1.0, box=[edge] * 3, **more), gammas

    def plain(a, gamma):
        return {("W", "W"): dpd.DPD(A=a, gamma=gamma)}

    mixed = {("W", "W"): dpd.DPD(A=25, gamma=4.5), ("W", "S"): dpd.DPD(A=30, gamma=20), ("S", "S"): dpd.DPD(A=35, gamma=60)}
    chain = np.arange(650 // 10 * 10).reshape(-1, 10)
    links = np.concatenate([chain[:, k : k + 2] for k in range(9)])
    return {
        "standard, 4.5": fluid(3, plain(25, 4.5)),
        "standard, 40.5": fluid(3, plain(25, 40.5)),
        "A 78": fluid(3, plain(78, 4.5)),
        "A 60, friction 15": fluid(3, plain(60, 15)),
        "density 6, A 10, friction 20": fluid(6, plain(10, 20), edge=5.0),
        "masses 1:3, frictions 4.5, 20, 60": fluid(3, mixed, share=0.5, masses=(1.0, 3.0)),
        "chains, k 4": fluid(650 / EDGE**3, plain(25, 4.5), bonds=[dpd.HarmonicBonds(links, k=4.0, r0=0.0)]),
        "many-body": fluid(6, {("W", "W"): dpd.MDPD(A=-40, B=40, gamma=4.5, cutoff=1.0, cutoff_B=0.75)}, edge=4.0),
    }


def cooling(x: np.ndarray, scene: dpd.Scene, gammas: dict) -> float:
    """Rate at which friction cools random velocities, per bead."""
    i, j = np.triu_indices(len(x), 1)
    w2 = np.maximum(1 - np.linalg.norm(minimum_images(x[i] - x[j], scene.box), axis=1), 0) ** 2
    table = {tuple(sorted(pair)): gamma for pair, gamma in gammas.items()}
    names = np.array(scene.types)
    gamma = np.array([[table[tuple(sorted((a, b)))] for b in scene.type_names] for a in scene.type_names])
    ids = np.array([scene.type_names.index(name) for name in names])
    return float(np.sum(gamma[ids[i], ids[j]] * w2 * (1 / scene.bead_masses[i] + 1 / scene.bead_masses[j])) / len(x))


def run(scene: dpd.Scene, gammas: dict, scheme: str, dt: float, time: float) -> dict[str, tuple[float, float]]:
    """Averages of a run with standard errors."""
    built = dpd.build(scene, dt=dt, scheme=scheme, seed=1, platform="CPU")
    simulation, observer, every = built.simulation(), Observer(built), max(2, round(EVERY / dt))
    simulation.minimizeEnergy(maxIterations=50)
    simulation.step(round(WAIT / dt / every) * every)
    meter, rows, cold = ShadowWorkReporter(every, built), [], []
    simulation.reporters.append(meter)
    for k in range(round(time / dt / every)):
        simulation.step(every)
        sample = observer.sample(simulation.context)
        rows.append((sample.gradient2, sample.laplacian or np.nan, sample.kT, sample.potential / sample.n_mobile))
        if k % 20 == 0:
            x = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
            cold.append(cooling(x, scene, gammas))
    squares, laplacians, kT, potential = np.array(rows).T
    found = {
        "conf": ratio_average(squares, laplacians),
        "kin": block_average(kT),
        "energy": block_average(potential),
        "heat": meter.heating,
    }
    values = {name: (one.mean, one.sem) for name, one in found.items()}
    values["variance"] = (meter.variance, meter.variance * (2 / len(meter.work)) ** 0.5)
    values["predicted"] = tuple(part / np.mean(cold) for part in values["heat"])
    return values


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--time", type=float, default=60.0)
    parser.add_argument("--scenes", type=int, default=99)
    given = parser.parse_args()
    print("| scene | scheme, step | T_conf | T_kin | predicted | U | variance of the work |\n| --- | --- | --- | --- | --- | --- | --- |")
    for name, (scene, gammas) in list(scenes().items())[: given.scenes]:
        limit = run(scene, gammas, "bababo", 0.02, 2 * given.time)["energy"]
        for scheme, steps in STEPS.items():
            for dt in steps:
                try:
                    found = run(scene, gammas, scheme, dt, given.time)
                except (dpd.RunError, openmm.OpenMMException):
                    print(f"| {name} | `{scheme}`, {dt} | breaks down | | | | |", flush=True)
                    continue
                off = {what: f"{100 * (found[what][0] - 1):+.1f}({100 * found[what][1]:.1f}) %" for what in ("conf", "kin")}
                told = f"{100 * found['predicted'][0]:+.2f}({100 * found['predicted'][1]:.2f}) %"
                u = f"{100 * (found['energy'][0] / limit[0] - 1):+.1f}({100 * np.hypot(found['energy'][1], limit[1]) / abs(limit[0]):.1f}) %"
                print(
                    f"| {name} | `{scheme}`, {dt} | {off['conf']} | {off['kin']} | {told} | {u} | {found['variance'][0]:.1e} |", flush=True
                )


if __name__ == "__main__":
    main()
