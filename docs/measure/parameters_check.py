"""Whether the parameters of openmm_dpd.parameters give what they were asked for: numbers of docs/validation.md.

    python docs/measure/parameters_check.py water --volume 3000
    python docs/measure/parameters_check.py chi
    python docs/measure/parameters_check.py transport

water: the compressibility of three waters in a bead, from the slope of the measured pressure and from the fluctuations of the volume at
constant pressure, in OpenMM's units.  chi: compositions of demixed slabs.  transport: fluids between the points of the table.
"""

from __future__ import annotations

import argparse

import numpy as np
from demixing import Model, demixed_chi
from openmm import unit
from transport_table import BASE, measure

import openmm_dpd as dpd
from openmm_dpd import parameters
from openmm_dpd.advice.stability_table import drag
from openmm_dpd.stats import block_average


def compressibility_from_slope(A: float, density: float, *, beads: int, time: float, seed: int = 11) -> tuple[float, float]:
    """(1/kT) dp/drho from pressures 4 % below and above, and its standard error."""
    width = 0.04
    low, high = (
        parameters.measured_pressure(A, density * (1 + side * width), beads=beads, time=time, seed=seed + side).pressure for side in (-1, 1)
    )
    step = 2 * width * density
    return (high.mean - low.mean) / step, float(np.hypot(low.sem, high.sem)) / step


def compressibility_from_volume(water: parameters.BeadMapping, *, beads: int, time: float, seed: int = 5) -> tuple[float, float, float]:
    """Compressibility in 1/Pa with its standard error, and the mean density in kg/m^3, at constant pressure in OpenMM's units."""
    A = water.repulsion().value
    edge = (beads / water.density) ** (1 / 3) * water.cutoff
    positions = np.random.default_rng(seed).random((beads, 3)) * edge
    pairs = {("W", "W"): water.coefficient(A, gamma=4.5)}
    scene = dpd.Scene({"W": water.mass}, ["W"] * beads, positions, pairs, kT=water.temperature * unit.kelvin, box=[edge] * 3)
    step = 0.028
    built = dpd.build(scene, dt=water.quantity(step, "time"), scheme="bababo", platform="CPU", seed=seed)
    dpd.add_barostat(built, water.quantity(parameters.pressure(A, water.density), "pressure"), interval=5)
    simulation = built.simulation()
    simulation.step(3000)
    volumes = []
    for _ in range(round(time / step / 5)):
        simulation.step(5)
        volumes.append(simulation.context.getState().getPeriodicBoxVolume().value_in_unit(unit.nanometer**3))
    v = np.array(volumes)
    square = block_average((v - v.mean()) ** 2)
    # <dV^2>/(kT <V>) in nm^3/(kJ/mol)
    found, error = (x / (water.thermal_energy * v.mean()) for x in (square.mean, square.sem))
    per_pascal = (unit.AVOGADRO_CONSTANT_NA * unit.nanometer**3 / unit.kilojoule).value_in_unit(unit.mole**-1 / unit.pascal)
    gram = beads * water.mass / v.mean() / 6.02214076e23 * 1e21
    return found * per_pascal, error * per_pascal, gram * 1e3


def water(options: argparse.Namespace) -> None:
    """Three waters in a bead."""
    mapping = parameters.water_mapping(3)
    A, target = mapping.repulsion().value, mapping.inverse_compressibility
    slope, error = compressibility_from_slope(A, mapping.density, beads=options.beads, time=options.time)
    print(f"A = {A:.2f}, (1/kT) dp/drho: wanted {target:.2f}, slope of the pressure {slope:.2f}({error:.2f})")
    if options.volume:
        found, error, mass = compressibility_from_volume(mapping, beads=300, time=options.volume)
        print(f"from the volume: {1e10 * found:.3f}({1e10 * error:.3f})e-10 1/Pa, wanted 4.525; density {mass:.1f} kg/m^3, wanted 997.05")


#: Density, wanted chi, A.
STATES = ((3.0, 3.0, None), (3.0, 4.0, None), (3.0, 3.5, 78.0), (5.0, 3.0, None), (5.0, 4.0, None))


def chi(options: argparse.Namespace) -> None:
    """Slabs at densities 3 and 5, and at a repulsion that no calibration run had."""
    for density, wanted, A in STATES:
        dA = parameters.repulsion_from_chi(wanted, density, A=A)
        found, error = demixed_chi(Model(density, A), dA.value, time=options.time, seed=501)
        print(f"density {density:g}, A {A}: chi wanted {wanted:g}, dA = {dA.value:.3f}, found {found:.3f}({error:.3f})", flush=True)


def transport(options: argparse.Namespace) -> None:
    """Between the points of the table, one for each plane."""
    for changed in ({"drag": 8.0}, {"drag": 25.0, "exponent": 0.7}, {"drag": 25.0, "transverse": 0.25}, {"drag": 8.0, "A": 65.0}):
        point = {**BASE, **changed}
        found = measure(point, options.time, 601)
        total = point["drag"] / drag(1.0, 3.0, point["exponent"])
        share = point["transverse"]
        said = parameters.transport(total * (1 - share), gamma_perp=total * share / 2, exponent=point["exponent"], A=point["A"])
        D, eta = said.diffusion, said.viscosity
        print(f"{changed}: D {found['D']:.4f}({found['D_error']:.4f}), table {D.value:.4f}({D.error:.4f});", end=" ")
        print(f"eta {found['eta']:.3f}({found['eta_error']:.3f}), table {eta.value:.3f}({eta.error:.3f})", flush=True)


def main() -> None:
    """Choose and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("water", "chi", "transport"))
    parser.add_argument("--beads", type=int, default=1500)
    parser.add_argument("--time", type=float, default=400.0, help="length of each run, in units of rc (m/kT)^(1/2)")
    parser.add_argument("--volume", type=float, default=0.0, help="length of the run at constant pressure")
    options = parser.parse_args()
    {"water": water, "chi": chi, "transport": transport}[options.what](options)


if __name__ == "__main__":
    main()
