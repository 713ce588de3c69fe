"""OpenMM's CUDA platform on the driver of fake_cuda.c: every kernel is compiled by NVRTC, every launch checked; nothing is computed.

Prints a line for each configuration, with calls per step, and ends with an error where a kernel or a launch is wrong.
"""

import ctypes
import itertools
import sys

import numpy as np
import openmm
import openmm_dpd_device

import openmm_dpd as dpd
from openmm_dpd.base.names import Phase
from openmm_dpd.simulation import device_check

assert "CUDA" in openmm_dpd_device.loaded, openmm_dpd_device.failed
device_check.MOST = 0  # there are no numbers to compare
counts = (ctypes.c_long * 8).in_dll(ctypes.CDLL("libcuda.so.1"), "fake_counts")
D, wide = dpd.DPD, sys.argv[1:] == ["all"]


#: Configurations of what would take too long in all of them.
FEW = {"walls": (("single", "middle"), ("mixed", "mvv")), "sheared": (("mixed", "middle"), ("double", "mvv"))}


def scene(kind: str, scheme: str) -> dpd.Scene:
    rng = np.random.default_rng(1)
    n, box = 600, np.diag([6.0, 6.0, 6.0])
    table = {("*", "*"): D(A=25, gamma=4.5)}
    options = {}
    if kind == "everything":
        table = {
            ("A", "A"): D(A=25, gamma=4.5, gamma_perp=2, exponent=0.5),
            ("A", "B"): D(A=30, sigma=3),
            ("B", "B"): D(gamma=3, cutoff=1.2),
        }
        box[1, 0] = 1.0
        bonds = dpd.HarmonicBonds(np.arange(100).reshape(-1, 2), k=20, r0=0.6)
        options = {"bonds": [bonds], "bonded_factors": (0.5, 1.0, 1.0), "mobile": np.arange(n) < 580}
    elif kind == "warm":
        table = {("*", "*"): dpd.EDPD(A=25, gamma=4.5, kappa=0.1)}
        options = {"internal": dpd.BeadTemperatures(1.0, 100.0), "sources": [dpd.Source(dpd.Sphere([3.0, 3.0, 3.0], 1.0), 0.1)]}
    elif kind == "walls":
        behind = {} if scheme == "mvv" else {"behind": "A", "density": 3.0}
        walls = [dpd.Wall("z", -1.0, "above", velocity=(1, 0, 0), **behind), dpd.Wall("z", 7.0, "below", velocity=(1, 0, 0), period=2.0)]
        box, options = np.diag([6.0, 6.0, 9.0]), {"walls": walls}
    elif kind == "sheared":
        table, options = [table, {("*", "*"): D(gamma=1.0, gamma_perp=1.0)}], {"shear": dpd.LeesEdwards(rate=0.1)}
    elif kind == "energies":
        table = {("*", "*"): dpd.EnergyDPD(A=25, sigma=3, kappa=1.0)}
        curve = dpd.TabulatedEOS.from_functions(lambda theta: 3 * theta**2, (0.05, 8.0), points=9)
        options = {"internal": dpd.InternalEnergy({"A": dpd.ConstantHeatCapacity(60.0), "B": curve}, 1.0), "mobile": np.arange(n) < 580}
    elif kind == "free":
        table = {("*", "*"): dpd.MDPD(A=-40, B=25, gamma=4.5, kernel="lucy")}
    types = rng.choice(["A", "B"], n).tolist()
    return dpd.Scene(
        {"A": 1, "B": 2}, types, rng.random((n, 3)) @ np.diag([6.0, 6.0, 6.0]), table, kT=1, box=None if kind == "free" else box, **options
    )


CARRYING = ("warm", "energies")
schemes = ("middle", "bababo", "mvv")
for precision, scheme, kind in itertools.product(
    ("single", "mixed", "double"), schemes if wide else ("middle", "mvv"), ("plain", "everything", "free", *CARRYING, *FEW)
):
    if kind in FEW and (precision, scheme) not in FEW[kind]:
        continue
    less = precision == "single" or scheme == "bababo" or (kind, scheme) == ("energies", "mvv")
    if kind in CARRYING and (scheme, precision) != ("mvv", "single") and less:
        continue
    built = dpd.build(
        scene(kind, scheme), dt=0.04, scheme=scheme, platform="CUDA", seed=1, engine="device" if len(sys.argv) > 1 else "auto"
    )
    assert built.plan.execution.on_device, built.explain()
    simulation = built.simulation(properties={"Precision": precision})
    openmm.CustomIntegrator.step(built.integrator, 2)
    before = list(counts)
    openmm.CustomIntegrator.step(built.integrator, 50)
    calls = [(now - then) / 50 for now, then in zip(counts, before, strict=True)]
    sweeps = () if kind in CARRYING else (Phase.SWEEP_SEEN, Phase.SWEEP_SEEN + 1)
    for phase in (Phase.FORCE_SEEN, Phase.FORCE_KEPT, *sweeps, Phase.IDLE):
        simulation.context.setParameter("dpd_phase", phase)
        simulation.context.getState(forces=True, energy=True)
    transfers, waits = calls[1] + calls[2], calls[4] + calls[5]
    print(
        f"{precision:7} {scheme:7} {kind:11} launches {calls[0]:5.2f}, transfers to the host {transfers:.2f}, waits {waits:.2f}", flush=True
    )
    if counts[7]:
        sys.exit(f"{counts[7]} launches were wrong")
